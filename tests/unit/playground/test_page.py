"""The playground in a browser: from a file, offline, it checks and runs.

Pyodide comes from the npm registry: where `SOTER_PYODIDE` names its package (docs/testing.md) or
npm can fetch it, the page is opened; else the test says that it was skipped.
"""

from __future__ import annotations

import os
import shutil
from typing import TYPE_CHECKING

import pytest

import browser
from soter.diagnostics.diagnostic import SoterError
from soter.playground.write import runtime_files, write_playground

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.long


def test_the_page_runs_the_cart_from_a_file_and_asks_for_nothing(tmp_path: Path) -> None:
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    given = os.environ.get("SOTER_PYODIDE")
    if given is None and shutil.which("npm") is None:
        pytest.skip("neither SOTER_PYODIDE nor npm")
    try:
        runtime_files(given)
    except SoterError as error:
        pytest.skip(f"no Pyodide: {error}")
    path = write_playground(tmp_path, given)
    with browser.page() as page:
        page.open(f"{path.as_uri()}#run")
        page.wait("document.body?.dataset.ran !== undefined")
        assert page.value("document.body.dataset.ran") == "0"
        assert page.value("document.querySelectorAll('#chart polyline').length") == 6
        assert page.value("document.querySelectorAll('#events li').length") == 7
        page.value("document.getElementById('program').value += ' let'")
        page.value("document.getElementById('check').click()")
        assert "error[S" in page.value("document.getElementById('told').textContent")
        page.value("document.getElementById('code').value = 'P1b'")
        page.value("document.querySelector('#explain button').click()")
        assert page.value("document.getElementById('told').textContent").startswith("# P1b")
        assert {r.split(":")[0] for r in page.requests} <= {"file", "blob", "data"}
        assert page.requests[0] == f"{path.as_uri()}#run".partition("#")[0]
        assert page.errors == []
