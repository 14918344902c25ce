"""The example of a page of `soter explain`: as it stands, and with the remedy in its comments.

A line `code  // a -> b` says b in place of a, `code  // leave out` says nothing, and `// and: code`
is a line more.
"""

from __future__ import annotations

import re

from soter.diagnostics.codes import explain

IN_WORDS = {"L002", "L003", "M016", "S020", "S021"}
"""Pages whose remedy is a sentence: a missing end takes the comment, or all is too much."""


def wrong(code: str) -> str:
    """The one example of a page, which gives its code."""
    page = explain(code)
    assert page is not None
    (example,) = re.findall(r"^```soter,wrong\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert (example == _mended(example)) == (code in IN_WORDS)
    return str(example)


def mended(code: str) -> str:
    """The example with its remedy; "" where that is said in words."""
    return "" if code in IN_WORDS else _mended(wrong(code))


def _mended(example: str) -> str:
    lines = []
    for line in example.splitlines():
        more = re.fullmatch(r"( *)// and: (.*)", line)
        code, _, remedy = line.partition("  // ")
        old, arrow, new = remedy.partition(" -> ")
        if more is not None:
            lines.append(more[1] + more[2])
        elif arrow:
            assert code.count(old) == 1, line
            lines.append(code.replace(old, new))
        elif remedy != "leave out":
            lines.append(line)
    return "\n".join(lines) + "\n"
