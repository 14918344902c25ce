"""Write the playground.

Purpose: `write_playground`: the page into a folder, with programs to choose from.
Non-goals: its content (`page.py`).
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.playground.page import page
from soter.playground.pyodide_download import runtime_files
from soter.report.errors import ReportError
from soter.report.html import write_text

FILE = "index.html"


def write_playground(
    folder: str | Path,
    pyodide: str | Path | None = None,
    examples: str | Path | None = None,
    links: str = "",
) -> Path:
    """Write the page and return its path; SoterError D006, D007.

    `pyodide`: see `runtime_files`; `examples`: a folder whose `*.soter` files are offered; `links`:
    HTML below the title.
    """
    offered = examples_in(Path(examples)) if examples is not None else own_examples()
    if not offered:
        raise SoterError((Diagnostic("D006", f"there is no `*.soter` below `{examples}`"),))
    text = page(runtime_files(pyodide), offered, links)
    try:
        return write_text(text, Path(folder) / FILE)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error


def examples_in(folder: Path) -> dict[str, str]:
    """Programs below a folder, by path; SoterError D006 where one cannot be read."""
    try:
        return {
            p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8")
            for p in sorted(folder.rglob("*.soter"))
        }
    except (OSError, UnicodeDecodeError) as error:
        raise SoterError((Diagnostic("D006", f"cannot read `{folder}`: {error}"),)) from error


def own_examples() -> dict[str, str]:
    """What comes with Soter: a small robot."""
    assets = resources.files("soter.playground") / "assets"
    return {
        Path(p.name).name: p.read_text(encoding="utf-8")
        for p in sorted(assets.iterdir(), key=lambda p: p.name)
        if p.name.endswith(".soter")
    }
