"""Makes one SC of the plans of a module: `sc Brake, Left, Right;`.

Purpose: `sc_and_its_topic` makes one node for all plans. `set_step_from_plans` makes its step,
which runs the step of one plan: the plan whose number is in a hidden topic of the module. It
reports M030 for plans that cannot replace each other in flight.
Non-goals: which plan runs (the DM chooses), their periods (`make_components.py`), whether
they are safe (`verify/`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.types import BOOL, IntType

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.syntax import tree


def sc_and_its_topic(
    module: str, plans: Sequence[typed.NodeSymbol | None]
) -> tuple[typed.NodeSymbol | None, typed.TopicSymbol | None]:
    """Gives the node `sc` of a module, still without a step, and the topic of the plan's number.

    (None, None) if the module has no plans, or one is unknown. `module` is its full name.
    """
    known = [p for p in plans if p is not None]
    if not known or len(known) < len(plans):
        return None, None
    first, read = known[0], {s.topic: s for p in known for s in p.subscribes}
    node = first.node_with_step((), tuple(read.values()))
    number = IntType(0, len(plans) - 1)
    topic = typed.TopicSymbol(f"{module}.plan", first.span, number, False, {}, None, None)
    return replace(node, name=f"{module}.sc", takes=None), topic


def set_step_from_plans(
    module: typed.ModuleSymbol, decl: tree.RtaDecl, diagnostics: Diagnostics
) -> None:
    """Sets the step of a module's SC, after the steps of its plans were checked; reports M030."""
    assert module.plan is not None
    topic, span = module.plan, module.sc.span
    if decl.rest is None:
        diagnostics.error(
            "M030",
            f"module `{decl.name.text}` has several plans, and no `rest`",
            decl.plans[1].span,
            notes=("of several plans a DM chooses that from which it can follow SC to rest",),
            helps=(f"write `rest ... within ...;`, or one plan alone: `sc {decl.plans[0].text};`",),
        )
    for k, (plan, ref) in enumerate(zip(module.plans, decl.plans, strict=True)):
        for why in _flaws_of_plan(module, k, plan):
            diagnostics.error(
                "M030",
                f"`{plan.name}` cannot be one of several plans: it {why}",
                ref.span,
                also=((plan.span, "declared here"),),
                notes=("the DM may go over to another plan at any look, and none has a past",),
                helps=("leave it out of the plans, or change it",),
            )
    arms = [
        (
            typed.TypedBinary(
                BOOL,
                span,
                "==",
                typed.TopicRead(topic.type, span, topic),
                typed.Literal(topic.type, span, k),
            ),
            plan.step,
        )
        for k, plan in enumerate(module.plans)
    ]
    module.sc.step = (typed.TypedIf(span, tuple(arms[:-1]), arms[-1][1]),)


def _flaws_of_plan(module: typed.ModuleSymbol, k: int, plan: typed.NodeSymbol) -> Iterator[str]:
    first = module.plans[0]
    wrong = {
        "is named twice": plan in module.plans[:k],
        "is AC, too": plan is module.ac,
        "is an extern": plan.extern,
        "has variables": plan.locals,
        "has `on takeover`": plan.takeover is not None,
        "has a contract": plan.assumes or plan.guarantees,
        "has fail-safe values": plan.failsafe,
        "says how long its steps take": plan.takes,
        "may publish several messages a step": plan.bursts,
        "reads a queue": any(s.queue is not None for s in plan.subscribes),
        f"does not publish what `{first.name}` does": {*plan.publishes} != {*first.publishes},
    }
    yield from (why for why, present in wrong.items() if present)
