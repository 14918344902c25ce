"""Results as a notebook shows them: a line that says how it went, a table, and the report.

Purpose: the HTML of `_repr_html_`, without scripts and in the notebook's own style; below it the
whole report in a frame of its own (`srcdoc`), which a notebook that trusts nobody leaves out.
Non-goals: what the report says (`run/`, `proof/`).
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


def shown(
    head: str, headers: Sequence[str], rows: Iterable[Sequence[object]], notes: Sequence[str] = ()
) -> str:
    """Return HTML: `head` in bold, a table with as many entries a row as `headers`, notes."""
    titles = "".join(f"<th>{escape(h)}</th>" for h in headers)
    lines = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    table = f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    below = f"<ul>{items}</ul>" if items else ""
    return f"<div><b>{escape(head)}</b>{table if lines else ''}{below}</div>"


def framed(document: str, height_px: int = 720) -> str:
    """Return an HTML document in a frame: its scripts reach neither notebook nor network."""
    return (
        f'<iframe srcdoc="{escape(document, quote=True)}" sandbox="allow-scripts" title="report" '
        f'loading="lazy" style="width:100%;height:{height_px}px;border:1px solid #8888"></iframe>'
    )
