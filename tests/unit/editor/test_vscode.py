"""The extension in VS Code itself: its web build (code-server), in a headless browser.

`SOTER_CODE_SERVER` names the program `code-server` (docs/testing.md), and `make vscode` makes the
extension; without either the test says that it was skipped.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import browser
import processes

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[3]
EXTENSION = ROOT / "editors" / "vscode" / "dist" / "soter.vsix"
SOTER = Path(sys.executable).with_name("soter")
CART = ROOT / "examples" / "wall" / "cart.soter"
SETTINGS = {
    "soter.command": str(SOTER),
    "security.workspace.trust.enabled": False,
    "workbench.startupEditor": "none",
    "telemetry.telemetryLevel": "off",
}
LENSES = "[...document.querySelectorAll('.codelens-decoration')].map((e) => e.textContent)"
WRONG = "document.querySelectorAll('.squiggly-error').length"

pytestmark = pytest.mark.long


@contextmanager
def served(server: str, folder: Path) -> Iterator[str]:
    """code-server over a folder, with the extension; its address."""
    data, extensions = folder / "data", folder / "extensions"
    (data / "User").mkdir(parents=True)
    (data / "User" / "settings.json").write_text(json.dumps(SETTINGS))
    own = ["--user-data-dir", str(data), "--extensions-dir", str(extensions)]
    processes.run(
        [server, *own, "--install-extension", str(EXTENSION)], capture_output=True, check=True
    )
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"127.0.0.1:{port}"
    line = [server, *own, "--auth", "none", "--bind-addr", address, "--disable-telemetry"]
    line += ["--disable-update-check", "--config", str(folder / "config.yaml")]
    with (
        (folder / "server.log").open("wb") as log,
        processes.started(line, stdout=log, stderr=log, cwd=folder),
    ):
        yield address


def opened(address: str, file: Path) -> str:
    """Where the editor opens a file."""
    payload = json.dumps([["openFile", f"vscode-remote://{address}{file}"]])
    return f"http://{address}/?folder={file.parent}&payload={payload}"


def test_vs_code_shows_lenses_of_a_sound_program_and_what_is_wrong_with_another(
    tmp_path: Path,
) -> None:
    server = os.environ.get("SOTER_CODE_SERVER") or shutil.which("code-server")
    if server is None:
        pytest.skip("neither SOTER_CODE_SERVER nor code-server")
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    if not EXTENSION.is_file():
        pytest.skip("the extension is not built: make vscode")
    work = tmp_path / "work"
    work.mkdir()
    text = CART.read_text(encoding="utf-8")
    (work / "cart.soter").write_text(text, encoding="utf-8")
    broken = text.replace("const FAST", "const B: float = WALLS;\nconst FAST")
    (work / "broken.soter").write_text(broken, encoding="utf-8")
    with served(server, tmp_path) as address, browser.page(served=True) as page:
        page.size(1280, 2400)
        _reached(page, f"http://{address}/healthz")
        page.open(opened(address, work / "cart.soter"))
        page.wait(f"{LENSES}.some((text) => text.includes('prove'))", 180.0)
        assert any("run" in text for text in page.value(LENSES))
        assert page.value(WRONG) == 0
        page.open(opened(address, work / "broken.soter"))
        page.wait(f"{WRONG} > 0", 180.0)


def _reached(page: browser.Page, address: str) -> None:
    """Wait until somebody answers there."""
    for _ in range(120):
        page.open(address)
        try:
            page.wait("document.body !== null && document.body.textContent.includes('status')", 1.0)
        except AssertionError:
            continue
        return
    raise AssertionError(f"nobody answers at {address}")
