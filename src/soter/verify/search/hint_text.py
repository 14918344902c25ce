"""Hints of a proof in the text of a program: where they are, where found ones are put.

Purpose: `with_hints` replaces the hints of one module in the text: `grid` lines in its `verify`
block, or `rest` and `shield` among its clauses. It removes hints of the other proof method.
Non-goals: finding hints (`grid_hints.py`, `rest_hints.py`); the layout (`syntax/printer.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.syntax.lexer import lex

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Source
    from soter.language.model.typed import ModuleSymbol
    from soter.language.syntax.lexer import Tokens

BESIDE_REST = ("grid", "core", "levels", "rest", "ttf", "safer", "shield")
"""The clauses of a module and items of its `verify` block that a found `rest` replaces."""
BESIDE_GRIDS = ("grid", "rest")
"""What found `grid` lines replace; a `shield` is removed together with a `rest`."""
COMMENT = "  // found by `soter verify --write`"


@dataclass(frozen=True)
class Hints:
    """Items of a `verify` block, or clauses of a module, each with its semicolon.

    With `added` they are added to the items of the program and replace none. `longer` is the clause
    `rest` with a longer time, to try if only the start is not led to rest in time. `farther` has
    hints with larger bounds of `moves`, to try if the bounds are not shown.
    """

    items: tuple[str, ...] = ()
    clauses: tuple[str, ...] = ()
    added: bool = False
    longer: str = ""
    farther: Hints | None = None

    def __str__(self) -> str:
        return " ".join((*self.clauses, *self.items))


def with_hints(source: Source, module: ModuleSymbol, hints: Hints, comment: str = "") -> str:
    """The text of `source` with these hints in place in the declaration of `module`."""
    tokens, text = lex(source), source.text
    edits: list[tuple[int, int, str]] = []
    of_grids = BESIDE_GRIDS if module.rest is None else (*BESIDE_GRIDS, "shield")
    replaced = () if hints.added else BESIDE_REST if hints.clauses else of_grids
    opened, block = _opening_brace(tokens, module.span.start), None
    for first, last in _items_of_body(tokens, opened):
        word = tokens.texts[first]
        if word == "verify":
            block = first + 1
            gone = [i for i in _items_of_body(tokens, block) if tokens.texts[i[0]] in replaced]
            emptied = not hints.items and len(gone) == sum(1 for _ in _items_of_body(tokens, block))
            gone = [(first, last)] if emptied else gone
        elif word in replaced:
            gone = [(first, last)]
        else:
            continue
        edits += [_removal_edit(text, tokens.starts[a], tokens.ends[b]) for a, b in gone]
    closed = tokens.starts[_closing_brace(tokens, opened)]
    lines = [f"  {hint}{comment}\n" for hint in hints.clauses]
    if hints.items and block is not None:
        at, inner = tokens.ends[block], "".join(f"\n    {hint}" for hint in hints.items)
        edits.append((at, at, f"{comment}{inner}\n   "))
    elif hints.items:
        lines.append(
            "".join(("  verify {", comment, *(f"\n    {i}" for i in hints.items), "\n  }\n"))
        )
    edits.append((closed, closed, "".join(lines)))
    ends_of_lines = "\r\n" if text.partition("\n")[0].endswith("\r") else "\n"
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new.replace("\n", ends_of_lines) + text[end:]
    return text


def _opening_brace(tokens: Tokens, start: int) -> int:
    """The index of the token that opens the body of a declaration with its name at `start`."""
    return tokens.kinds.index("{", tokens.starts.index(start))


def _closing_brace(tokens: Tokens, opened: int) -> int:
    """The index of the token that closes the body opened by the token `opened`."""
    depth = 0
    for k in range(opened, len(tokens.kinds)):
        depth += {"{": 1, "}": -1}.get(tokens.kinds[k], 0)
        if depth == 0:
            return k
    raise AssertionError  # the program was checked


def _items_of_body(tokens: Tokens, opened: int) -> Iterator[tuple[int, int]]:
    """The indices of the first and last token of each item in the body opened by `opened`."""
    first = k = opened + 1
    while tokens.kinds[k] != "}":
        k = _closing_brace(tokens, k) if tokens.kinds[k] == "{" else k
        following = tokens.kinds[k + 1]
        if tokens.kinds[k] == ";" or (tokens.kinds[k] == "}" and following not in (";", ",")):
            yield first, k
            first = k + 1
        k += 1


def _removal_edit(text: str, start: int, end: int) -> tuple[int, int, str]:
    """The edit that removes an item together with the spaces before it on the same line."""
    while text[start - 1] in " \t":
        start -= 1
    return start, end, ""
