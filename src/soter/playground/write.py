"""Write the playground: one HTML file with script, Soter and Pyodide, which opens from a disk.

Purpose: pack the rooms that run in a browser, some examples and the files of Pyodide, compressed,
into one page whose content security policy lets no request leave. Pyodide comes from a folder, from
a package file, or from npm through a temporary folder.
Non-goals: what the page does (`session.py`, `assets/`); other versions than the one that was tried.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import shutil
import subprocess
import tarfile
import tempfile
import zipfile
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import mistake
from soter.report.html import write_text

if TYPE_CHECKING:
    from collections.abc import Mapping


ROOMS = ("diagnostics", "diagram", "language", "playground", "report", "semantics")
"""The rooms that run in the page; of `report` only the files that show texts."""
ONLY = {"report": ("__init__.py", "wording.py")}
ENDINGS = {".py", ".md", ".soter", ".toml"}
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; connect-src 'none'; form-action 'none'; "
    "base-uri 'none'"
)
CLOCK = (1980, 1, 1, 0, 0, 0)
"""The time of all files in archives, so that the same sources give the same page."""


def page_text(runtime: Mapping[str, bytes], examples: Mapping[str, str], links: str = "") -> str:
    """The HTML of the page; `runtime`: Pyodide's files by name; `examples`: programs by path.

    `links` is HTML to show below the title, such as a link to the docs.
    """
    packed = {
        "wasm": runtime["pyodide.asm.wasm"],
        "stdlib": runtime["python_stdlib.zip"],
        "asm": runtime["pyodide.asm.mjs"],
        "pyodide": runtime["pyodide.mjs"],
        "lock": _lock_without_packages(runtime["pyodide-lock.json"]),
        "soter": soter_archive(examples),
    }
    parts = "\n".join(
        f'<script type="text/plain" id="packed-{name}">{_packed_text(data)}</script>'
        for name, data in packed.items()
    )
    return (
        _asset_text("playground.html")
        .replace("{policy}", POLICY)
        .replace("{style}", _asset_text("playground.css"))
        .replace("{links}", links)
        .replace("{packed}", parts)
        .replace("{examples}", json.dumps(sorted(examples)).replace("<", "\\u003c"))
        .replace("{script}", _asset_text("playground.js"))
    )


def soter_archive(examples: Mapping[str, str]) -> bytes:
    """A zip file with Soter and the examples: `soter/...` and `examples/...`."""
    root = Path(str(resources.files("soter")))
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as zipped:
        for path in sorted([root / "__init__.py", root / "version.py", *_packed_files(root)]):
            name = f"soter/{path.relative_to(root).as_posix()}"
            zipped.writestr(zipfile.ZipInfo(name, CLOCK), path.read_bytes())
        for name, text in sorted(examples.items()):
            zipped.writestr(zipfile.ZipInfo(f"examples/{name}", CLOCK), text.encode())
    return made.getvalue()


def _packed_files(root: Path) -> list[Path]:
    paths = []
    for room in ROOMS:
        only = ONLY.get(room)
        files = [p for p in (root / room).rglob("*") if p.suffix in ENDINGS]
        paths += [p for p in files if only is None or (p.name in only and p.parent.name == room)]
    return paths


def _lock_without_packages(text: bytes) -> bytes:
    """Pyodide's lock file with an empty list of packages, since the page includes no packages."""
    return json.dumps({**json.loads(text), "packages": {}}).encode()


def _packed_text(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, mtime=0)).decode("ascii")


def _asset_text(name: str) -> str:
    return (resources.files("soter.playground") / "assets" / name).read_text(encoding="utf-8")


VERSION = "314.0.7"
FILES = (
    "pyodide.asm.wasm", "pyodide.asm.mjs", "pyodide.mjs", "python_stdlib.zip", "pyodide-lock.json",
)  # fmt: skip
FETCH_S = 300.0


def runtime_files(source: str | Path | None = None) -> dict[str, bytes]:
    """Pyodide's files by name; `source` is their folder, or a file from `npm pack pyodide`.

    Without `source`, npm fetches them. Raises SoterError D007 if npm is missing, D006 if files are.
    """
    if source is not None:
        return _read_folder(Path(source)) if Path(source).is_dir() else _read_package(Path(source))
    npm = shutil.which("npm")
    if npm is None:
        raise mistake(
            "D007",
            "the page needs Pyodide, which comes with npm, and there is no `npm` here",
            "install Node.js, or fetch the npm package `pyodide` elsewhere and give it: "
            "--pyodide pyodide.tgz",
        )
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [npm, "pack", "--silent", f"pyodide@{VERSION}"],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=FETCH_S,
            check=False,
        )
        packages = sorted(Path(folder).glob("*.tgz"))
        if done.returncode or not packages:
            lines = done.stderr.strip().splitlines() or ["npm said nothing"]
            message = f"npm could not fetch `pyodide@{VERSION}`: {lines[-1]}"
            raise mistake("D007", message, "give the package yourself: --pyodide pyodide.tgz")
        return _read_package(packages[0])


def _read_folder(folder: Path) -> dict[str, bytes]:
    if missing := [name for name in FILES if not (folder / name).is_file()]:
        raise mistake("D006", f"`{folder}` is no Pyodide: there is no {', '.join(missing)}")
    return {name: (folder / name).read_bytes() for name in FILES}


def _read_package(path: Path) -> dict[str, bytes]:
    content_by_name: dict[str, bytes] = {}
    try:
        with tarfile.open(path) as packed:
            for name in FILES:
                member = packed.extractfile(f"package/{name}")
                assert member is not None, name
                content_by_name[name] = member.read()
    except (OSError, KeyError, AssertionError, tarfile.TarError) as error:
        raise mistake("D006", f"`{path}` is no npm package of Pyodide: {error}") from error
    return content_by_name


FILE = "index.html"


def write_playground(
    folder: str | Path,
    pyodide: str | Path | None = None,
    examples: str | Path | None = None,
    links: str = "",
) -> Path:
    """Writes the page and gives its path; raises SoterError D006, D007.

    `pyodide` is the `source` of `runtime_files`. `examples` is a folder with `*.soter` files to
    offer. `links` is HTML to show below the title.
    """
    offered = examples_in(Path(examples)) if examples is not None else own_examples()
    if not offered:
        raise mistake("D006", f"there is no `*.soter` below `{examples}`")
    return write_text(page_text(runtime_files(pyodide), offered, links), Path(folder) / FILE)


def examples_in(folder: Path) -> dict[str, str]:
    """The programs below a folder, by path; raises SoterError D006 if one cannot be read."""
    try:
        return {
            p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8")
            for p in sorted(folder.rglob("*.soter"))
        }
    except (OSError, UnicodeDecodeError) as error:
        raise mistake("D006", f"cannot read `{folder}`: {error}") from error


def own_examples() -> dict[str, str]:
    """The examples that come with Soter, by file name."""
    assets = resources.files("soter.playground") / "assets"
    return {
        Path(p.name).name: p.read_text(encoding="utf-8")
        for p in sorted(assets.iterdir(), key=lambda p: p.name)
        if p.name.endswith(".soter")
    }
