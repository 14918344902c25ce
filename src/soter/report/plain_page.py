"""A page of headings, sentences and tables: what a command told, to file.

Purpose: the inside of such a page, without drawings or scripts.
Non-goals: what is told; pages with pictures, which put theirs beside these sections.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from soter.report.run.result_wording import prose

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

LONG = 24
"""Cells of more letters keep a width that is read well, where the window is narrow."""

PHONE_COLUMNS, PHONE_ROWS = 4, 8
"""A table of more columns is cut on a phone; of more rows its list would be too long."""


@dataclass(frozen=True)
class PageSection:
    """A heading, what is said below it, a table: rows of text under `head`."""

    title: str
    says: tuple[str, ...]
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


def sections_main(
    title: str, headline: str, verdict: str, sections: Sequence[PageSection]
) -> Iterator[str]:
    """The body of the page; `verdict`: "good", "bad" or "", how the headline is coloured."""
    yield f'<h1>{escape(title)}</h1>\n<p class="verdict {verdict}">'
    yield f"<strong>{prose(headline)}</strong></p>"
    yield from sections_told(sections)


def sections_told(sections: Sequence[PageSection]) -> Iterator[str]:
    """Sections alone."""
    for section in sections:
        yield from _section(section)


def _section(section: PageSection) -> Iterator[str]:
    yield f'<section class="told"><h2>{prose(section.title)}</h2>'
    for text in section.says:
        yield f"<p>{prose(text)}</p>"
    if section.rows:
        yield table_of(section.head, section.rows)
    yield "</section>"


def table_of(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of text; one too wide for a phone becomes a list of its rows there.

    That is one with long cells, and one of a few rows with many columns.
    """
    long = any(len(cell) > LONG for row in rows for cell in row)
    long = long or (len(head) > PHONE_COLUMNS and len(rows) <= PHONE_ROWS)
    heads = "".join(f'<th scope="col">{prose(h)}</th>' for h in head)
    lines = "".join(f"<tr>{_cells(head, row)}</tr>" for row in rows)
    return (
        f'<div class="wide"><table{" class=stacked" if long else ""}><thead><tr>{heads}</tr>'
        f"</thead><tbody>{lines}</tbody></table></div>"
    )


def _cells(head: Sequence[str], row: Sequence[str]) -> str:
    return "".join(
        f"<td{' class=long' if len(cell) > LONG else ''}{data_head(h)}>{prose(cell)}</td>"
        for h, cell in zip(head, row, strict=True)
    )


def data_head(head: str) -> str:
    """The attribute by which a cell of a stacked table says its head."""
    return f' data-head="{escape(head.replace("`", ""), quote=True)}"'
