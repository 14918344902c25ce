"""Makes text harmless for the terminal that shows it.

Purpose: `legible` takes away what a terminal, or GitHub, would obey instead of showing.
Non-goals: who prints (`cli/terminal/`), rendering (`render.py`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


CONTROLS = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
COLOURS = re.compile("(\x1b\\[(?:0|1|2|34|1;3[1-4])m)")


def legible(text: str, *, color: bool = False, words: Iterable[str] = ()) -> str:
    """The text without sequences that a terminal or GitHub would execute.

    `color`: keeps our colours; `words`: words of the command line, which may add no lines.
    """
    for part in {w[max(0, i - 4) : i + 5] for w in words for i, c in enumerate(w) if c == "\n"}:
        text = text.replace(part, part.replace("\n", "\r")) if len(part.strip()) > 1 else text
    text = re.sub(r"(?m)^(\s*):(?=:)|##(?=\[)", "\\1: ", text)
    parts = COLOURS.split(text) if color else [text]
    return "".join(p if k % 2 else CONTROLS.sub("\ufffd", p) for k, p in enumerate(parts))
