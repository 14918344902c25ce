"""The names of `soter` mean the same however often they are used, and in whatever order."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

import processes

if TYPE_CHECKING:
    from pathlib import Path

ORDERS = {
    "twice": "soter.recheck; soter.recheck(at); soter.recheck(at)",
    "after its package was imported": "import soter.certificate.rechecker; soter.recheck(at)",
    "before and after": "soter.recheck(at); from soter.certificate import rechecker; "
    "soter.recheck(at)",
    "the package, too": "soter.recheck(at); assert soter.certificate.rechecker.recheck",
    "from soter": "from soter import recheck; recheck(at); recheck(at); soter.recheck(at)",
}


@pytest.mark.parametrize("code", ORDERS.values(), ids=list(ORDERS))
def test_recheck_is_a_function_before_and_after_its_package_is_imported(
    code: str, tmp_path: Path
) -> None:
    """Each call ends in the diagnostic that says that there is no certificate."""
    text = "import soter\nat = 'nothing'\n"
    for line in code.split("; "):
        called = "(at)" in line
        text += f"try:\n  {line}\nexcept soter.SoterError: pass\n" if called else f"{line}\n"
    done = processes.run(
        [sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
