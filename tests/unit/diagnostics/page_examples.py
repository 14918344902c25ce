"""The example of a page of `soter explain`: as it stands, and with its remedy."""

from __future__ import annotations

import re

from soter.diagnostics.codes import explain

IN_WORDS = {"L002", "L003", "M016", "S020", "S021"}
"""Pages whose remedy is a sentence: a missing end takes the comment, or all is too much."""


def wrong(code: str) -> str:
    """The one example of a page, which gives its code."""
    page = explain(code)
    assert page is not None
    if code in IN_WORDS:
        (example,) = re.findall(r"^```soter,wrong\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
        return str(example)
    return _side(code, "- ")


def mended(code: str) -> str:
    """The example with its remedy; "" where that is said in words."""
    return "" if code in IN_WORDS else _side(code, "+ ")


def _side(code: str, kept: str) -> str:
    """One side of the difference that a page shows."""
    (example,) = re.findall(r"^```diff\n(.*?)^```$", explain(code) or "", re.MULTILINE | re.DOTALL)
    lines = [line for line in example.splitlines() if line[:2] in ("", "  ", kept)]
    assert any(line[:2] in ("- ", "+ ") for line in example.splitlines()), code
    return "".join(f"{line[2:]}\n" for line in lines)
