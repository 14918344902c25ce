"""Whether a contract leaves its stand-in anything to publish.

Purpose: the step of a stand-in (`language/elaborate/tests_and_faults/contract_stand_ins.py`), read
over ranges.
Non-goals: what a contract forbids one by one: the search tries all of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.explore.vacuity.constant_truth import holds_always
from soter.language.model import typed
from soter.language.model.tree_walk import children, nodes
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from soter.explore.vacuity.constant_truth import Read
    from soter.language.model.system import Component


def permits_nothing(c: Component, read: Read) -> bool:
    """Whether no values of its topics keep the guarantees, whatever else is read."""
    if c.node is None or not c.node.publishes:
        return False
    given = {
        s.variable: s.value for s in _statements(c.node.step) if isinstance(s, typed.TypedDeclare)
    }
    asked = [
        _and_publishes(condition, body)
        for s in _statements(c.node.step)
        if isinstance(s, typed.TypedIf)
        for condition, body in s.arms
        if any(isinstance(n, typed.TypedPublish) for n in nodes(body)) and _is_guarantee(condition)
    ]
    return bool(asked) and all(
        holds_always(e, False, c.scope, read, c.period_ns, given) for e in asked
    )


def _and_publishes(
    condition: typed.TypedExpr, body: tuple[typed.TypedStmt, ...]
) -> typed.TypedExpr:
    """That it holds, and that something is published: with several outputs perhaps none is."""
    if any(isinstance(s, typed.TypedPublish) for s in body):
        return condition
    published: typed.TypedExpr | None = None
    for s in body:
        if isinstance(s, typed.TypedIf):
            also = s.arms[0][0]
            both = (BOOL, condition.span, "||", published, also)
            published = also if published is None else typed.TypedBinary(*both)  # type: ignore[arg-type]
    assert published is not None
    return typed.TypedBinary(BOOL, condition.span, "&&", published, condition)


def _is_guarantee(condition: typed.TypedExpr) -> bool:
    """Not the choice whether something is published at all."""
    return not isinstance(condition, (typed.TypedChoose, typed.VarRead))


def _statements(body: object) -> list[object]:
    """All of them, those inside others as well."""
    parts = list(body) if isinstance(body, tuple) else children(body)
    statements = [p for p in parts if isinstance(p, typed.TypedStmt)]
    return statements + [inner for p in statements for inner in _statements(p)]
