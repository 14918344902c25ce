"""Writes reports: HTML files that need no network, and beside them one drawing library for all.

Purpose: page, figures, style and script are one file that opens from a disk or an archive, also in
ten years; its content security policy forbids all network access. The drawing library, twenty times
as large as a page, lies once beside the reports of a folder, named by its hash; with
`self_contained` it is put into the page, so that the report can be sent alone.
Non-goals: other formats; people print it or save the figures from it.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
from html import escape
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.report.atomic_write import atomic_write, path_without_links
from soter.report.run.page import page_body
from soter.report.templates import packed_numbers, script_json
from soter.version import pip_command

if TYPE_CHECKING:
    import os

    from soter.report.run.record import Json, ReportPage

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)

BESIDE = POLICY.replace("script-src", "script-src 'self' file:")
"""The content security policy of a page whose drawing library lies beside it."""


def require_report_package() -> None:
    """Raises `SoterError` D007 if `plotly`, which draws reports, is not installed."""
    if find_spec("plotly") is None:
        raise _missing_plotly_error()


def _missing_plotly_error() -> SoterError:
    message = "reports are drawn with the package `plotly`, which is not installed"
    return mistake("D007", message, f"install it: {pip_command('report')}")


def write_html(
    page: ReportPage, path: str | os.PathLike[str], *, self_contained: bool = False
) -> Path:
    """Writes `page` to `path` and gives the path; the drawing library goes beside or into it.

    The same page gives the same bytes. If `path` is no regular file, the page has the library.
    Raises `SoterError` D007 if the extra `report` is not installed, D006 if the file cannot be
    written; an older file at `path` is then unchanged.
    """
    library, target = _drawing_library(), Path(path)
    if self_contained or (target.exists() and not target.is_file()):
        return write_text(html_document(page, library), path)
    name = f"soter-plotly-{hashlib.sha256(library.encode()).hexdigest()[:12]}.js"
    written = write_text(html_document(page, beside=name), path)
    try:
        script = path_without_links(target.resolve().parent, name)
    except OSError as error:
        raise _write_error(target, error) from error
    if not script.is_file() or script.stat().st_size != len(library.encode()):
        write_text(library, script)
    return written


def inline_document(page: ReportPage) -> str:
    """The page as one small text that contains the compressed drawing library.

    The page unpacks the library, which browsers since 2023 can do. Raises `SoterError` D007 if the
    extra `report` is not installed.
    """
    library = gzip.compress(_drawing_library().encode(), mtime=0)
    text = html_document(page)
    first = text.index("<script>")
    after = text[first:].replace("<script>", '<script type="text/plain" class="later">')
    compressed = base64.b64encode(library).decode("ascii")
    last = f"<script>\n{asset_text('inline.js')}</script>\n</body>"
    return (
        f'{text[:first]}<script type="text/plain" id="library">{compressed}</script>\n'
        + after.replace("</body>", last)
    )


def write_document(title: str, main: str, path: str | os.PathLike[str]) -> Path:
    """Writes a page without the drawing library; raises D006 if it cannot be written."""
    return write_text(document(title, main), path)


def document(title: str, main: str, asset: str = "") -> str:
    """The text of a page without the drawing library, with `asset.css` and `asset.js` if named."""
    if not asset:
        return _html_text(title, main, "")
    script = f"<script>\n{asset_text(f'{asset}.js')}</script>\n"
    return _html_text(title, main, script, asset_text(f"{asset}.css"))


def write_text(text: str, path: str | os.PathLike[str]) -> Path:
    """Writes a finished page to `path` and gives the path; raises D006 if that fails."""
    target = Path(path)
    content = text.encode()
    try:
        with atomic_write(target) as stream:
            stream.write(content)
    except OSError as error:
        raise _write_error(target, error) from error
    return target


def _write_error(target: Path, error: OSError) -> SoterError:
    return mistake("D006", f"cannot write the report {target}: {reason(error)}")


def html_document(page: ReportPage, drawing_library: str = "", beside: str = "") -> str:
    """The HTML of a page; `drawing_library`: plotly's JavaScript, `beside`: a file that has it."""
    main, figures = page_body(page)
    drawings = script_json([_packed_figure(f.to_json()) for f in figures])
    scripts = f"""<noscript><p>JavaScript draws the figures; it is switched off.</p></noscript>
<script type="application/json" id="figures">{drawings}</script>
{f'<script src="{escape(beside)}"></script>' if beside else f"<script>{drawing_library}</script>"}
<script>
{asset_text("packed.js")}{asset_text("report.js")}</script>
{_led_script(main)}"""
    return _html_text(page.title, main, scripts, policy=BESIDE if beside else POLICY)


def _packed_figure(figure: Json) -> Json:
    """The figure as JSON, with long lists of x and y packed (`templates.py`)."""
    traces = figure["data"]
    assert isinstance(traces, list)
    data = [
        {k: packed_numbers(v) if k in ("x", "y") else v for k, v in trace.items()}
        for trace in traces
    ]
    return {**figure, "data": data}


def _led_script(main: str) -> str:
    """The script that draws to where SC would lead, if the page has such a drawing; else ""."""
    return f"<script>\n{asset_text('led.js')}</script>\n" if 'class="led"' in main else ""


def _html_text(title: str, main: str, scripts: str, style: str = "", policy: str = POLICY) -> str:
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="color-scheme" content="light dark">
<meta name="generator" content="soter">
<title>{escape(title)}</title>
<style>
{asset_text("report.css")}{style}</style>
</head>
<body>
<main>
{main}
</main>
{scripts}</body>
</html>
"""


def _drawing_library() -> str:
    """The JavaScript of the installed plotly; raises `SoterError` D007 if there is none."""
    try:
        from plotly.offline import get_plotlyjs  # noqa: PLC0415 - an extra, and slow to import
    except ImportError as error:
        raise _missing_plotly_error() from error
    return str(get_plotlyjs())


def asset_text(name: str) -> str:
    """The text of a file in the `assets` folder."""
    return (resources.files("soter.report") / "assets" / name).read_text(encoding="utf-8")
