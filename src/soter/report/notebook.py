"""Results as a notebook shows them: a line that says how it went, and a table.

Purpose: the HTML of `_repr_html_`, without scripts and in the notebook's own style.
Non-goals: reports with drawings (`run/`, `proof/`).
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
