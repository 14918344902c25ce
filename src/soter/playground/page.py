"""The page itself: HTML, script, Soter and Pyodide in one file that opens from a disk.

Purpose: pack the rooms that run in a browser, some examples and the files of Pyodide, compressed,
into one HTML file whose content security policy lets no request leave.
Non-goals: getting Pyodide (`pyodide_download.py`), what the page does (`session.py`, `assets/`).
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import zipfile
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOMS = ("diagnostics", "diagram", "language", "playground", "report", "semantics")
"""What runs in the page; of `report` only what shows texts."""
ONLY = {"report": ("__init__.py", "printable_text.py")}
ENDINGS = {".py", ".md", ".soter"}
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; connect-src 'none'; form-action 'none'; "
    "base-uri 'none'"
)
CLOCK = (1980, 1, 1, 0, 0, 0)
"""The time of files in archives: the same sources give the same page."""


def page(runtime: Mapping[str, bytes], examples: Mapping[str, str], links: str = "") -> str:
    """The page. `runtime`: the files of Pyodide by name; `examples`: texts by path below examples.

    `links`: HTML below the title, such as the way to the docs.
    """
    packed = {
        "wasm": runtime["pyodide.asm.wasm"],
        "stdlib": runtime["python_stdlib.zip"],
        "asm": runtime["pyodide.asm.mjs"],
        "pyodide": runtime["pyodide.mjs"],
        "lock": _lock(runtime["pyodide-lock.json"]),
        "soter": archive(examples),
    }
    parts = "\n".join(
        f'<script type="text/plain" id="packed-{name}">{_text(data)}</script>'
        for name, data in packed.items()
    )
    names = json.dumps(sorted(examples)).replace("<", "\\u003c")
    return (
        _asset("playground.html")
        .replace("{policy}", POLICY)
        .replace("{style}", _asset("playground.css"))
        .replace("{links}", links)
        .replace("{packed}", parts)
        .replace("{examples}", names)
        .replace("{script}", _asset("playground.js"))
    )


def archive(examples: Mapping[str, str]) -> bytes:
    """Soter and the examples as a zip file: `soter/...` and `examples/...`."""
    root = Path(str(resources.files("soter")))
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as zipped:
        for path in sorted([root / "__init__.py", root / "version.py", *_files(root)]):
            name = f"soter/{path.relative_to(root).as_posix()}"
            zipped.writestr(zipfile.ZipInfo(name, CLOCK), path.read_bytes())
        for name, text in sorted(examples.items()):
            zipped.writestr(zipfile.ZipInfo(f"examples/{name}", CLOCK), text.encode())
    return made.getvalue()


def _files(root: Path) -> list[Path]:
    paths = []
    for room in ROOMS:
        only = ONLY.get(room)
        files = [p for p in (root / room).rglob("*") if p.suffix in ENDINGS]
        paths += [p for p in files if only is None or (p.name in only and p.parent.name == room)]
    return paths


def _lock(text: bytes) -> bytes:
    """The lock file without packages: the page has none."""
    lock = json.loads(text)
    return json.dumps({**lock, "packages": {}}).encode()


def _text(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, mtime=0)).decode("ascii")


def _asset(name: str) -> str:
    return (resources.files("soter.playground") / "assets" / name).read_text(encoding="utf-8")
