"""Plain characters, where an encoding or a terminal has no others.

Purpose: an error handler of codecs that writes `->` for an arrow in place of `?`, and the same for
terminals that draw no boxes.
Non-goals: which streams it is for (`console.py`).
"""

from __future__ import annotations

import codecs
import re

DASHES = "\u2500\u2501\u2504\u2505\u254c\u254d\u2010\u2011\u2013\u2014\u2015\u2212"
BARS = "\u2502\u2503\u2506\u250a\u258f\u2595\u254e"
CORNERS = "\u250c\u2510\u2514\u2518\u251c\u2524\u252c\u2534\u253c\u256d\u256e\u256f\u2570"
BLOCKS = "\u2588\u2593\u2592\u2591\u25a0\u2587\u2586\u2585\u2584\u2583\u2582\u2581"
DOTS = "\u00b7\u2022\u2219\u25cf"
PLAIN = {
    **dict.fromkeys(DASHES, "-"),
    **dict.fromkeys(BARS, "|"),
    **dict.fromkeys(CORNERS, "+"),
    **dict.fromkeys(BLOCKS, "#"),
    **dict.fromkeys(DOTS, "*"),
    "\u2192": "->",
    "\u2190": "<-",
    "\u2194": "<->",
    "\u21d2": "=>",
    "\u2264": "<=",
    "\u2265": ">=",
    "\u2260": "!=",
    "\u2248": "~",
    "\u221e": "inf",
    "\u00d7": "x",
    "\u00b5": "u",
    "\u03bc": "u",
    "\u00b0": " deg",
    "\u00b1": "+-",
    "\u00b2": "^2",
    "\u00b3": "^3",
    "\u221a": "sqrt",
    "\u2208": "in",
    "\u2026": "...",
    "\u0394": "Delta",
    "\u03b4": "delta",
    "\u03c0": "pi",
    "\u00a7": "section ",
    "\u2018": "'",
    "\u2019": "'",
    "\u201c": '"',
    "\u201d": '"',
    "\u00a0": " ",
    "\u2713": "ok",
    "\u2717": "x",
}
"""What is written for what is not there; everything else becomes `?` where it cannot be written."""
_TABLE = str.maketrans(PLAIN)
PLAIN_ERRORS = "soter.plain"
TERMS = re.compile(r"(dumb|unknown|ansi|cons25|vt(52|1\d\d|2\d\d))(-.*)?")


def draws_no_boxes(term: str) -> bool:
    """Whether a terminal, by its $TERM, is one of those that have plain characters only."""
    return TERMS.fullmatch(term) is not None


def plainly(text: str) -> str:
    """A text in plain characters, as far as they are known; the rest stays."""
    return text.translate(_TABLE)


def _encoded(error: UnicodeError) -> tuple[str, int]:
    """What an encoding does not have, in characters that it has."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    missing = error.object[error.start : error.end]
    return "".join(PLAIN.get(char, "?") for char in missing), error.end


codecs.register_error(PLAIN_ERRORS, _encoded)
