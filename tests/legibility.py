"""What hinders reading on a page that a browser shows: cut, tiny or pale text, empty views.

Purpose: measure every text of a page as it is drawn, HTML and SVG alike, and name those that a
reader cannot read, each with the reason.
Non-goals: whether what stands there is true or well put; looks.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import browser

TEXT_PX_MIN = 9.0
"""Of letters as they are shown, after a drawing was made smaller."""
CONTRAST_MIN, CONTRAST_OF_LARGE_MIN = 4.5, 3.0
"""WCAG 2.2, criterion 1.4.3."""

HINDRANCES = Path(__file__).with_suffix(".js").read_text("utf-8")


def hindrances(page: browser.Page) -> list[str]:
    """What a reader of the page stumbles on, as it is shown now; empty where nothing is."""
    page.size(int(page.value("innerWidth")), int(page.value("document.body.scrollHeight")))
    call = f"{HINDRANCES}({TEXT_PX_MIN}, {CONTRAST_MIN}, {CONTRAST_OF_LARGE_MIN})"
    told: list[str] = page.value(call)
    return told
