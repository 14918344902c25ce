"""Checks that the topics which DM or SC read together show the plants at one instant.

Purpose: `check_one_instant` reports R016 where the DM's topics may show several instants and no
check at run time finds that, or where SC's topics may and the proof follows a single state.
Non-goals: how old each read is (`schedule.py`); how the DM looks at stamps
(`language/model/read_together.py`).

*The DM.* For a proof the DM's estimate is one state plus an error. Topics that plants of one period
and phase drive are published in the same instants; where one of them fell silent, their stamps
differ, and the DM calls them stale. A node's stamp says nothing of what the node had read. So what
comes through nodes has to come the same way, and where sensors may be silent (`dropout`) through
nodes that hear one topic of plants alone. One number may come several ways: that a node shows the
plant by it is an assumption, printed.

*SC.* It acts on what it has, stale or not. Chains and tubes give each state that is read its own
age. So each topic may have its own age, if no state is in two topics. The same holds for the
numbers of one topic that a node made of several reads.
"""

from __future__ import annotations

from itertools import repeat
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import leaves, show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component
    from soter.verify.problem.cause_effect_chains import CauseEffectChain, CauseEffectChains
    from soter.verify.problem.verification_system import VerificationSystem

ESTIMATE = "an estimate is the state at one instant, plus an error"
ONE_TOPIC = "publish them as one topic: a record, made of one read"


def check_one_instant(
    place: VerificationSystem, chains: CauseEffectChains, dropout: int, diagnostics: Diagnostics
) -> None:
    """Reports R016 if one read may show several instants and the proof does not cover this."""
    for who, ways in (("the DM", chains.by_dm), ("SC", chains.by_sc)):
        if not place.abstract:
            _require_equal_periods(
                place, who, list(dict.fromkeys(w.topic.index for w in ways)), diagnostics
            )
    if diagnostics.has_errors:
        return
    shown = [w for w in chains.by_dm if w.sensor is not None]
    if _may_show_several_instants(place, shown, dropout):
        _refuse_several_instants(
            place, "the DM", shown, (ESTIMATE, "a node's stamp does not say"), diagnostics
        )
    shown = [w for w in chains.by_sc if w.sensor is not None]
    if _count_of_instants(place, shown, dropout) > 1:
        why = _why_one_age_needed(place, shown, dropout)
        if why:
            _refuse_several_instants(
                place, "SC", shown, ("their ages may differ", why), diagnostics
            )


def _may_show_several_instants(
    place: VerificationSystem, ways: Sequence[CauseEffectChain], dropout: int
) -> bool:
    """Whether the numbers that the DM reads may show several instants, which no stamp reveals."""
    topics = dict.fromkeys(w.topic for w in ways)
    numbers = sum(len(list(leaves(topic.type))) for topic in topics)
    by_nodes = dropout if any(w.nodes for w in ways) else 0
    return _count_of_instants(place, ways, 0) > 1 < numbers or (
        by_nodes > 0 and _count_of_instants(place, ways, dropout) > 1
    )


def _count_of_instants(
    place: VerificationSystem, ways: Sequence[CauseEffectChain], dropout: int
) -> int:
    """The largest number of instants in one read, counted by paths, or by topics with dropout."""
    every = {(w.path.sensor, w.nodes) for w in ways}
    if not dropout:
        return len(every)
    return max(len(every), len({t for w in ways for t in _sensed_topics(place, w)}))


def _sensed_topics(place: VerificationSystem, way: CauseEffectChain) -> set[str]:
    """The names of the plants' topics with which a path begins."""
    if not way.nodes:
        return {way.topic.name}
    plant, first = way.sensor, way.nodes[0]
    assert plant is not None
    heard = {*first.reads} & {*plant.writes}
    return {place.flat.topics[i].name for i in heard}


def _why_one_age_needed(
    place: VerificationSystem, ways: Sequence[CauseEffectChain], dropout: int
) -> str:
    """Why SC's proof needs the same age for all that SC reads; "" if the ages may differ."""
    seen: dict[tuple[Component, typed.Variable], tuple[int, int]] = {}
    for topic in dict.fromkeys(w.topic.index for w in ways):
        plant = place.driven[topic]
        assert plant.plant is not None
        lets = dict(plant.plant.lets)
        driven = [e for t, e in plant.plant.drives if plant.scope.topics[t] == topic]
        apart = _count_of_instants(place, [w for w in ways if w.topic.index == topic], dropout) > 1
        parts = [[x] for e in driven for x in _expression_of_each_number(e)] if apart else [driven]
        for k, part in enumerate(parts):
            for variable in _variables_read(part, lets):
                if seen.setdefault((plant, variable), (topic, k)) != (topic, k):
                    return f"`{plant.name}.{variable.name}` is in two numbers of them"
    return ""


def _expression_of_each_number(e: typed.TypedExpr) -> Iterator[typed.TypedExpr]:
    """The expression of each number in a value; `e` for every number if `e` has no parts."""
    if isinstance(e, typed.Aggregate):
        for element in e.elements:
            yield from _expression_of_each_number(element)
    else:
        yield from repeat(e, len(list(leaves(e.type))))


def _variables_read(
    code: Iterable[object], lets: dict[typed.Variable, typed.TypedExpr]
) -> set[typed.Variable]:
    """The states and disturbances that a plant's code reads."""
    read = {e.variable for e in nodes(code) if isinstance(e, typed.VarRead)}
    behind = [lets[v] for v in read & lets.keys()]
    return (read - lets.keys()) | (_variables_read(behind, lets) if behind else set())


def _refuse_several_instants(
    place: VerificationSystem,
    who: str,
    ways: Sequence[CauseEffectChain],
    notes: tuple[str, str],
    diagnostics: Diagnostics,
) -> None:
    names = ", ".join(f"`{n}`" for n in dict.fromkeys(w.topic.name for w in ways))
    by = [
        f"`{w.topic.name}` comes from `{w.sensor.name}`"
        + "".join(f" by `{n.name}`" for n in w.nodes)
        for w in ways
        if w.sensor is not None
    ]
    diagnostics.error(
        "R016",
        f"what {who} reads ({names}) may show the plants at different times",
        place.module.symbol.span,
        notes=(*dict.fromkeys(by), *notes),
        helps=(ONE_TOPIC,),
    )


def _require_equal_periods(
    place: VerificationSystem, who: str, topics: Sequence[int], diagnostics: Diagnostics
) -> None:
    """Reports R016 where plants with different periods or phases publish parts of one read."""
    first, *others = topics or (None,)
    for index in others:
        assert first is not None
        plants = [place.driven[i] for i in (first, index)]
        if (plants[0].period_ns, plants[0].phase_ns) == (plants[1].period_ns, plants[1].phase_ns):
            continue
        names = [place.system.topics[i].name for i in (first, index)]
        periods = [show_ns(c.period_ns) for c in plants]
        diagnostics.error(
            "R016",
            f"{who} reads `{names[0]}` and `{names[1]}`, which show the plants at different times",
            plants[1].span,
            f"publishes `{names[1]}` every {periods[1]}",
            also=((plants[0].span, f"publishes `{names[0]}` every {periods[0]}"),),
            notes=(ESTIMATE,),
            helps=("give these plants one period",),
        )
        return
