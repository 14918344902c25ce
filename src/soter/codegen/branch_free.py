"""Choices between two whole numbers as masks, without a branch.

Purpose: `branch_free`: a search by halving goes left or right like a coin, and a processor that
guesses is wrong every second time. The numbers are the same.
Non-goals: what ships, which is read; branches with more in them than one number.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.codegen.c import tree as c

if TYPE_CHECKING:
    from collections.abc import Iterator

WHOLE = "int64_t"


def branch_free(f: c.FunctionDef) -> c.FunctionDef:
    """A function whose `if`s that only choose a whole number on each side are computed instead."""
    if f.body is None:
        return f
    whole = {s.name for s in _all(f.body) if isinstance(s, c.Declare) and s.type == WHOLE}
    return replace(f, body=tuple(_Masks(whole).block(f.body)))


def _all(block: tuple[c.CStmt, ...]) -> Iterator[c.CStmt]:
    for s in block:
        yield s
        if isinstance(s, c.For):
            yield from _all(s.body)
        elif isinstance(s, c.IfStmt):
            yield from _all((*s.then, *s.otherwise))


class _Masks:
    """Names of masks, each its own."""

    def __init__(self, whole: set[str]) -> None:
        self._whole = whole
        self._count = 0

    def block(self, block: tuple[c.CStmt, ...]) -> Iterator[c.CStmt]:
        """The same statements."""
        for s in block:
            if isinstance(s, c.For):
                yield replace(s, body=tuple(self.block(s.body)))
            elif isinstance(s, c.IfStmt):
                yield from self._chosen(s)
            else:
                yield s

    def _chosen(self, s: c.IfStmt) -> Iterator[c.CStmt]:
        then, otherwise = self._choice(s.then), self._choice(s.otherwise)
        if then is None or otherwise is None:
            sides = (tuple(self.block(side)) for side in (s.then, s.otherwise))
            yield c.IfStmt(s.condition, *sides)
            return
        self._count += 1
        on = c.Name(f"given_mask_{self._count}")
        off = c.Unary("~", on)
        yield c.Declare(WHOLE, on.text, c.Unary("-", c.Cast(WHOLE, s.condition)), const=True)
        for side, there, elsewhere in ((then, on, off), (otherwise, off, on)):
            taken, left = c.Binary("&", side.value, there), c.Binary("&", side.target, elsewhere)
            yield c.Assign(side.target, c.Binary("|", taken, left))

    def _choice(self, side: tuple[c.CStmt, ...]) -> c.Assign | None:
        """The one assignment of a side, if it is that of a whole number to a local."""
        (made, *more) = side or (None,)
        if more or not isinstance(made, c.Assign):
            return None
        names = [x for x in (made.target, made.value) if isinstance(x, c.Name)]
        return made if len(names) == 2 and {x.text for x in names} <= self._whole else None
