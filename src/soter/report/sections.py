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
    yield f"<strong>{escape(headline)}</strong></p>"
    yield from sections_told(sections)


def sections_told(sections: Sequence[PageSection]) -> Iterator[str]:
    """Sections alone."""
    for section in sections:
        yield from _section(section)


def _section(section: PageSection) -> Iterator[str]:
    yield f'<section class="told"><h2>{escape(section.title)}</h2>'
    for text in section.says:
        yield f"<p>{prose(text)}</p>"
    if section.rows:
        head = "".join(f"<th>{escape(h)}</th>" for h in section.head)
        rows = "".join(f"<tr>{_cells(row)}</tr>" for row in section.rows)
        yield f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
        yield f"<tbody>{rows}</tbody></table></div>"
    yield "</section>"


def _cells(row: Sequence[str]) -> str:
    return "".join(
        f'<td class="long">{escape(cell)}</td>' if len(cell) > LONG else f"<td>{escape(cell)}</td>"
        for cell in row
    )
