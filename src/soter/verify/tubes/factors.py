"""Expressions seen as graphs, and with one of their inputs taken out.

Purpose: `Node`; `factor`, of a product; `split`, of a sum, term by term; and `in_order`, all nodes.
Non-goals: making and differentiating expressions (`expressions.py`, whose `Expressions` is `make`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, eq=False, slots=True)
class Node:
    """An operator and what it is applied to: nodes; of "number" and "input" a value.

    `Expressions` makes each once: two are the same one, or differ.
    """

    op: str
    of: tuple[Any, ...]


class Maker(Protocol):
    """What makes nodes."""

    def number(self, value: float, /) -> Node: ...  # noqa: D102
    def function(self, name: str, a: Node, /) -> Node: ...  # noqa: D102
    def add(self, a: Node, b: Node, /) -> Node: ...  # noqa: D102
    def mul(self, a: Node, b: Node, /) -> Node: ...  # noqa: D102
    def div(self, a: Node, b: Node, /) -> Node: ...  # noqa: D102
    def neg(self, a: Node, /) -> Node: ...  # noqa: D102


def factor(make: Maker, e: Node, x: Node) -> Node | None:
    """The p of e = x p, for all values; None where it is not seen."""
    if e is x:
        return make.number(1.0)
    if e is make.number(0.0):
        return e
    if e.op == "friction" and e.of[0] is x:
        return make.function("inverse", make.add(make.function("abs", x), e.of[1]))
    if e.op == "square":
        return x if e.of[0] is x else None
    if e.op in ("add", "sub"):
        a, b = (factor(make, y, x) for y in e.of)
        return None if a is None or b is None else getattr(make, e.op)(a, b)
    if e.op in ("neg", "over"):
        p = factor(make, e.of[0], x)
        if p is None:
            return None
        return make.neg(p) if e.op == "neg" else make.div(p, e.of[1])
    if e.op == "mul":
        a, b = e.of
        if (p := factor(make, a, x)) is not None:
            return make.mul(p, b)
        p = factor(make, b, x)
        return None if p is None else make.mul(a, p)
    return None


def split(make: Maker, e: Node, x: Node) -> tuple[Node, Node]:
    """The p and the rest of e = x p + rest."""
    if (p := factor(make, e, x)) is not None:
        return p, make.number(0.0)
    if e.op in ("add", "sub"):
        a, b = (split(make, y, x) for y in e.of)
        join = getattr(make, e.op)
        return join(a[0], b[0]), join(a[1], b[1])
    if e.op == "neg":
        p, rest = split(make, e.of[0], x)
        return make.neg(p), make.neg(rest)
    return make.number(0.0), e


def in_order(roots: Sequence[Node]) -> list[Node]:
    """All nodes below, each behind what it is made of."""
    seen: dict[Node, None] = {}
    todo = [(root, False) for root in reversed(roots)]
    while todo:
        e, below_seen = todo.pop()
        if below_seen:
            seen[e] = None
        elif e not in seen:
            todo.append((e, True))
            todo += [(x, False) for x in reversed(e.of) if isinstance(x, type(e))]
    return list(seen)
