"""What the step of a safe controller publishes, and whether it does.

Purpose: W015, a constant outside of the set of its topic, a step fault whenever it is published;
W016, a path through the step on which an output is not published: the topic keeps what AC wrote.
Non-goals: values that are known only at run time; other nodes; W016 for an SC that looks whether it
has control.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fix import replace
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import BudgetExceeded
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import FloatType, IntType, leaf_count

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Value

BUDGET = 20_000
_CLOSED = (
    typed.Literal,
    typed.ParamRead,
    typed.TypedUnary,
    typed.TypedBinary,
    typed.Aggregate,
)


def doubt_publications(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """W015 and W016 for the safe controller of a module."""
    sc = system.components[module.sc]
    if sc.node is None or sc.extern:
        return
    publications = [n for n in nodes(sc.node.step) if isinstance(n, typed.TypedPublish)]
    for publication in publications:
        _outside(system, sc, publication, diagnostics)
    if sc.node.takeover is not None or any(
        isinstance(n, typed.InControl) for n in nodes(sc.node.step)
    ):
        return  # it knows when it has control, and speaks when it means to
    for topic in sc.node.publishes:
        first = next((p for p in publications if p.topic is topic), None)
        if first is None or _always(sc.node.step, topic):
            continue
        diagnostics.warning(
            "W016",
            f"`{sc.node.name}` does not publish `{topic.name}` on every path of its step",
            first.span,
            "published here",
            also=((module.symbol.sc_span or module.symbol.span, "the safe controller"),),
            notes=("where it is silent, the last value that AC published stays in force",),
            helps=("publish on every path: what stands in an `if` also needs an `else`",),
        )


def _always(statements: tuple[typed.TypedStmt, ...], topic: typed.TopicSymbol) -> bool:
    """Whether every path through the statements publishes the topic."""
    for s in statements:
        if isinstance(s, typed.TypedPublish) and s.topic is topic:
            return True
        if isinstance(s, typed.TypedIf) and s.otherwise:
            bodies = [*(body for _, body in s.arms), s.otherwise]
            if all(_always(body, topic) for body in bodies):
                return True
        if isinstance(s, typed.ForRange) and s.low < s.high and _always(s.body, topic):
            return True
    return False


def _outside(
    system: System, sc: Component, publication: typed.TypedPublish, diagnostics: Diagnostics
) -> None:
    expr, topic = publication.value, publication.topic
    if not all(isinstance(n, _CLOSED) for n in nodes([expr])):
        return
    if not isinstance(expr.type, (FloatType, IntType)) or leaf_count(topic.type) != 1:
        return
    (bound,) = system.topics[sc.scope.topics[topic]].bounds
    try:
        value: Value = Evaluator(sc.scope.params, budget=BUDGET).value(expr)
    except (StepFault, BudgetExceeded):
        return
    if bound is None or bound.low <= value <= bound.high:
        return
    nearest = bound.low if value < bound.low else bound.high
    diagnostics.warning(
        "W015",
        f"{value!r} is outside of the set of `{topic.name}`",
        expr.span,
        f"[{bound.low!r}, {bound.high!r}] is allowed",
        also=((topic.span, "declared here"),),
        notes=("publishing it is a step fault, which a safe controller must never have",),
        helps=(replace(expr.span, repr(nearest), f"the nearest value is `{nearest!r}`"),),
    )
