"""Where in a text the cursor is, told from the tokens before it, however broken the rest is.

Purpose: which body it stands in, what of the item at hand is written, what stands before a dot.
Non-goals: what may be written there (`completion.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

from soter.diagnostics.source import Source
from soter.language.syntax.tokens import NAME, lex

BODIES = {
    "node": "node", "rta": "rta", "verify": "verify", "view": "view", "plant": "plant",
    "system": "system", "test": "test", "faults": "faults", "fun": "block", "step": "block",
    "on": "block", "if": "block", "elseif": "block", "else": "block", "enum": "names",
}  # fmt: skip
"""By the word that begins an item, what its braces hold."""


@dataclass(frozen=True)
class CursorContext:
    """`body`: the body around, "file" at the top, "value" in braces of a value.

    `head`: the words of the declaration around (`node`, its name); `item`: the tokens of the item
    at hand, up to the word that is being written; `dotted`: the names before the dots in front of
    it; `word`: what of it is there, from offset `start`.
    """

    body: str
    head: tuple[str, ...]
    item: tuple[str, ...]
    dotted: tuple[str, ...]
    word: str
    start: int
    quiet: bool = False
    """In a comment or a string: nothing is to be offered."""


def cursor_at(text: str, offset: int) -> CursorContext:
    """The place of the cursor at a character offset."""
    tokens = lex(Source("", text[:offset]))
    for start, end in tokens.comments:
        if start < offset <= end and not text[start:end].endswith("*/"):
            return CursorContext("", (), (), (), "", offset, quiet=True)
    texts, ends, starts = list(tokens.texts), tokens.ends, tokens.starts
    kinds = tokens.kinds
    count = next((i for i, kind in enumerate(kinds) if kind == "EOF"), len(kinds))
    if tokens.truncated or (
        count and texts[count - 1].startswith('"') and ends[count - 1] == offset
    ):
        return CursorContext("", (), (), (), "", offset, quiet=True)
    word, at = "", offset
    if (
        count
        and ends[count - 1] == offset
        and (kinds[count - 1] == NAME or texts[count - 1].isidentifier())
    ):
        count -= 1
        word, at = texts[count], starts[count]
    stack: list[tuple[str, list[str]]] = [("file", [])]
    for text_ in texts[:count]:
        _step(stack, text_)
    body, item = stack[-1]
    head = tuple(stack[0][1])
    dotted: list[str] = []
    i = len(item)
    while i >= 2 and item[i - 1] == "." and item[i - 2].isidentifier():
        dotted.insert(0, item[i - 2])
        i -= 2
    return CursorContext(body, head, tuple(item), tuple(dotted), word, at)


def _step(stack: list[tuple[str, list[str]]], text: str) -> None:
    body, item = stack[-1]
    if text == "{":
        stack.append((_inside(body, item), []))
        item.append(text)
    elif text == "}":
        if len(stack) > 1:
            stack.pop()
            outer = stack[-1][1]
            if body not in {"value", "names", "wires"}:
                outer.clear()
            else:
                outer.append("}")
    elif text == ";":
        item.clear()
    else:
        item.append(text)


def _inside(body: str, item: list[str]) -> str:
    """What the braces hold that an item opens."""
    words = [w for w in item if w != "extern"]
    first = words[0] if words else ""
    if "=" in item and first not in BODIES:
        return "value"
    if first == "for":
        return "block" if body == "block" else body
    if body == "system" and (first in {"module", "node"} or (len(item) > 2 and item[-2] == ":")):
        return "wires"
    if body == "system" and ":" in item:
        return "wires"
    return BODIES.get(first, "value")
