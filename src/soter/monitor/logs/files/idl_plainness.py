"""Whether a text of IDL is as plain as those that ROS writes.

Purpose: one pass over its tokens. The parser of `rosbags` takes exponential time for parentheses in
parentheses, and calculates constants of any size: definitions of messages have neither.
Non-goals: whether it is IDL at all.
"""

from __future__ import annotations

import re

TOKEN = re.compile(
    r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*(?s:.*?)\*/|[A-Za-z_]\w*|\.?[0-9](?:[0-9.]|[eE][-+]?)*|\s+|.',
    re.ASCII,
)
PARENTHESES_MAX, ANGLES_MAX = 1, 2
"""How deep they stand in one another: `@default (value=0)`, `sequence<string<5>>`."""
VALUES_MAX = 2000
"""Annotations, values and sizes of arrays: the parser is slow at each of them."""
OPERATORS = set('*/%^|&~"')
"""Of constants that are calculated; and a quotation mark that nothing closes."""


def is_plain(text: str) -> bool:
    """Whether nothing in it is nested deeply or calculated."""
    parentheses = angles = values = 0
    before = ""
    for match in TOKEN.finditer(text):
        piece = match[0]
        if piece.isspace() or piece.startswith(("//", "/*")):
            continue
        parentheses += (piece == "(") - (piece == ")")
        angles += (piece == "<") - (piece == ">")
        values += piece in ("@", "=", "[")
        signed = piece in ("+", "-") and (before[-1:].isalnum() or before[-1:] in ("_", ")"))
        if piece in OPERATORS or signed or piece == before == "<":
            return False
        if not (0 <= parentheses <= PARENTHESES_MAX and 0 <= angles <= ANGLES_MAX):
            return False
        before = piece
    return values <= VALUES_MAX
