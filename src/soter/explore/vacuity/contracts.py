"""Whether a contract leaves its stand-in anything to publish.

Purpose: the step of a stand-in (`program/flatten/trials/contracts.py`), read over ranges.
Non-goals: what a contract forbids one by one: the search tries all of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.explore.vacuity.decide import holds_always
from soter.program.model import typed
from soter.program.model.types import BOOL
from soter.program.model.walk import children, nodes

if TYPE_CHECKING:
    from soter.explore.vacuity.decide import Read
    from soter.program.model.system import Component


def permits_nothing(c: Component, read: Read) -> bool:
    """Whether no values of its topics keep the guarantees, whatever else is read."""
    if c.node is None or not c.node.publishes:
        return False
    given = {s.variable: s.value for s in _statements(c.node.step) if isinstance(s, typed.Declare)}
    asked = [
        _and_publishes(condition, body)
        for s in _statements(c.node.step)
        if isinstance(s, typed.If)
        for condition, body in s.arms
        if any(isinstance(n, typed.Publish) for n in nodes(body)) and _is_guarantee(condition)
    ]
    return bool(asked) and all(
        holds_always(e, False, c.scope, read, c.period_ns, given) for e in asked
    )


def _and_publishes(condition: typed.Expr, body: tuple[typed.Stmt, ...]) -> typed.Expr:
    """That it holds, and that something is published: with several outputs perhaps none is."""
    if any(isinstance(s, typed.Publish) for s in body):
        return condition
    published: typed.Expr | None = None
    for s in body:
        if isinstance(s, typed.If):
            also = s.arms[0][0]
            both = (BOOL, condition.span, "||", published, also)
            published = also if published is None else typed.Binary(*both)  # type: ignore[arg-type]
    assert published is not None
    return typed.Binary(BOOL, condition.span, "&&", published, condition)


def _is_guarantee(condition: typed.Expr) -> bool:
    """Not the choice whether something is published at all."""
    return not isinstance(condition, (typed.Choose, typed.VarRead))


def _statements(body: object) -> list[object]:
    """All of them, those inside others as well."""
    parts = list(body) if isinstance(body, tuple) else children(body)
    found = [p for p in parts if isinstance(p, typed.Stmt)]
    return found + [inner for p in found for inner in _statements(p)]
