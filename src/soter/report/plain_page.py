"""A page of headings, sentences and tables: what a command told, to file.

Purpose: the inside of such a page, without drawings or scripts.
Non-goals: what is told; pages with pictures, which put theirs beside these sections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.report.templates import filled

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class PageSection:
    """A heading, what is said below it, a table: rows of text under `head`."""

    title: str
    says: tuple[str, ...]
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


def sections_main(title: str, headline: str, verdict: str, sections: Sequence[PageSection]) -> str:
    """The body of the page; `verdict`: "good", "bad" or "", how the headline is coloured."""
    return filled(
        "report/plain_page.html.j2",
        title=title,
        headline=headline,
        verdict=verdict,
        sections=sections,
    )
