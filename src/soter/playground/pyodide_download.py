"""Where the page's Python comes from: the npm package `pyodide`.

Purpose: `runtime_files`: the files of Pyodide out of a folder, out of a package file, or fetched
with the npm client into a folder that is gone afterwards.
Non-goals: other versions than the one that was tried.
"""

from __future__ import annotations

import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from soter.diagnostics.codes import Code


VERSION = "314.0.7"
FILES = (
    "pyodide.asm.wasm", "pyodide.asm.mjs", "pyodide.mjs", "python_stdlib.zip", "pyodide-lock.json",
)  # fmt: skip
FETCH_S = 300.0


def runtime_files(given: str | Path | None = None) -> dict[str, bytes]:
    """The files by name; `given`: a folder with them, or a file as `npm pack pyodide` makes it.

    Without it npm is asked. SoterError D007 where there is none, D006 where files are missing.
    """
    if given is not None:
        return _folder(Path(given)) if Path(given).is_dir() else _package(Path(given))
    npm = shutil.which("npm")
    if npm is None:
        raise _problem(
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
            raise _problem("D007", message, "give the package yourself: --pyodide pyodide.tgz")
        return _package(packages[0])


def _folder(folder: Path) -> dict[str, bytes]:
    missing = [name for name in FILES if not (folder / name).is_file()]
    if missing:
        raise _problem("D006", f"`{folder}` is no Pyodide: there is no {', '.join(missing)}")
    return {name: (folder / name).read_bytes() for name in FILES}


def _package(path: Path) -> dict[str, bytes]:
    content_by_name: dict[str, bytes] = {}
    try:
        with tarfile.open(path) as packed:
            for name in FILES:
                member = packed.extractfile(f"package/{name}")
                assert member is not None, name
                content_by_name[name] = member.read()
    except (OSError, KeyError, AssertionError, tarfile.TarError) as error:
        raise _problem("D006", f"`{path}` is no npm package of Pyodide: {error}") from error
    return content_by_name


def _problem(code: Code, message: str, *helps: str) -> SoterError:
    return SoterError((Diagnostic(code, message, helps=helps),))
