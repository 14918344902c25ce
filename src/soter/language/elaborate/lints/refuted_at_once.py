"""Warns, without a proof, of claims that a proof or a run would refute at once.

Purpose: W021 (`safe` does not hold at the start), W022 (`ttf` or `safer` is the same everywhere, or
seems to hold only where `safe` is lost), W023 (nothing reads what the module publishes), W024 (the
DM steps rarely compared with its plant), W027 (a property that the start violates), D019 (a plant
that flies is measured less exactly than the one that it is proved with).
Non-goals: a proof; initial states between the ends of their sets; `ttf` and `safer` that exclude
`safe` only in part.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from soter.language.elaborate.lints.contradictory_predicates import (
    Trial,
    evaluator_of_predicates,
    indices_of_tried_topics,
    read_nothing_but_topics,
    scalars_in,
    text_of_values,
    trials_of_predicates,
    with_scalars,
)
from soter.language.elaborate.passes.read_ages import fresh_ages_ns
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.evaluate.predicates import maybe_nan
from soter.language.evaluate.statements import Evaluator
from soter.language.evaluate.topic_ranges import reader_with_limits, truth_by_parts
from soter.language.model import typed
from soter.language.model.system import name_of_subsystem
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.types import (
    default_value,
    leaf_name,
    leaves,
    show_ns,
    write_ns,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.elaborate.lints.contradictory_predicates import Holds
    from soter.language.model.system import Component, Module, Property, System
    from soter.language.model.types import Value

BUDGET = 20_000
RARELY = 1000
"""A DM that steps once in this many steps of its plant reacts too late; examples have 100."""
OUTPUTS_SHOWN = 3
PROPERTIES_MAX = 32
"""Most properties of a system that are tried, a part of a millisecond each."""
BOTH_EXPECTED = 8.0
"""W022 needs at least so many tried values that would meet both conditions if they were
independent. If none does, values between are tried: the conditions may meet in a thin band."""
PAIRS, HALVINGS = 24, 40
"""Between how many pairs of values a search looks, and how often it halves the way."""


def warn_of_unsafe_start(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W021 if `safe` is false at the start, at the low or the high end of all states."""
    safe = module.symbol.safe
    if not read_nothing_but_topics([safe]):
        return
    indices = [module.scope.topics.get(t, -1) for t in topic_reads(safe)]
    evaluator = Evaluator(module.scope.params, budget=BUDGET, topics=module.scope.topics)
    for topics in _topics_at_start(system, indices):
        env = Environment(topics=topics, stamps=[0] * len(topics))
        try:
            holds = evaluator.value(safe, env)
        except (StepFault, BudgetExceeded):
            return
        if not holds:
            where = text_of_values(system, indices, [topics[i] for i in indices])
            trials = trials_of_predicates(system, module, (safe, safe, safe), indices)
            nowhere = all(not t[2] for t in trials)
            values = f"at none of {len(trials)} values that were tried"
            diagnostics.warning(
                "W021",
                f"`safe` of module `{module.symbol.name}` does not hold at the start",
                safe.span,
                f"false where {where}" if where else "false everywhere",
                notes=("an invariant holds from the start on: `soter verify` refutes this one",),
                helps=(f"say what is to hold: this does {values}",)
                if nowhere
                else ("begin inside of it: `state x: float = ...;`",),
            )
            return


def warn_of_properties_at_start(system: System, diagnostics: Diagnostics) -> None:
    """Warns W027 of an `always` or `never` that is violated at the start."""
    for p in system.properties[:PROPERTIES_MAX]:
        if p.component is None and p.kind in {"always", "never"}:
            _warn_of_property_at_start(system, p, diagnostics)


def _warn_of_property_at_start(system: System, p: Property, diagnostics: Diagnostics) -> None:
    if not read_nothing_but_topics([p.condition]):
        return
    indices = [p.scope.topics.get(t, -1) for t in topic_reads(p.condition)]
    scope = p.scope
    evaluator = Evaluator(scope.params, budget=BUDGET, topics=scope.topics, plants=scope.plants)
    topics: list[Value] = []
    for end, topics in enumerate(_topics_at_start(system, indices)):
        known = [None if c.plant is None or c.plant.extern else c for c in system.components]
        states = [c and (*start_values(c, end).variables.values(),) for c in known]
        env = Environment(topics=topics, stamps=[0] * len(topics), truth=states.__getitem__)
        try:
            holds = bool(evaluator.value(p.condition, env))
        except (StepFault, BudgetExceeded, TypeError):
            return  # the state of an extern plant is not known
        if holds == (p.kind == "always"):
            return
    if not topics:
        return
    where = text_of_values(system, indices, [topics[i] for i in indices])
    other = "never" if p.kind == "always" else "always"
    begins = "false" if p.kind == "always" else "true"
    diagnostics.warning(
        "W027",
        f"`{p.kind} {p.text}` is violated at the start",
        p.condition.span,
        f"{begins} where {where}" if where else f"{begins} in the first state",
        notes=("a property is judged from the first instant on",),
        helps=(f"`{other}` says the opposite; or begin elsewhere: `state x: float = ...;`",),
    )


def start_values(c: Component, end: int, topics: list[Value] | None = None) -> Environment:
    """Gives the values for a plant's code, each state at the low (0) or high (1) end of its set.

    With `topics`, the disturbances are also set, to the middles of their ranges.
    """
    ranges = c.initial_range or (None,) * len(c.initial)
    variables = {
        v: x if r is None else with_scalars([x], [r[end]] * len(scalars_in(x)))[0]
        for v, x, r in zip(c.variables, c.initial, ranges, strict=True)
    }
    for d in c.disturbances if topics else ():
        middle = [(d.low + d.high) / 2] * len(d.streams)
        variables[d.variable] = with_scalars([default_value(d.variable.type)], middle)[0]
    return Environment(variables, topics=topics or (), period_ns=c.period_ns)


def _topics_at_start(system: System, indices: Sequence[int]) -> Iterator[list[Value]]:
    """Yields the first values of topics: for low ends of the states' sets, then for high ends.

    Yields none if a topic of `indices` is driven by no plant, depends on a draw, or leaves its set.
    """
    for end in (0, 1):
        topics, known = [t.default for t in system.topics], set()
        for c in system.components:
            if c.plant is None or c.plant.extern or not {*c.writes} & {*indices}:
                continue
            evaluator, env = Evaluator(c.scope.params, budget=BUDGET), start_values(c, end)
            for target, e in (*c.plant.lets, *c.plant.drives):
                with suppress(StepFault, BudgetExceeded, LookupError, TypeError, RuntimeError):
                    value = evaluator.value(e, env)  # fails where it reads more than states
                    if isinstance(target, typed.TopicSymbol):
                        topics[c.scope.topics[target]] = value
                        known.add(c.scope.topics[target])
                    elif isinstance(target, typed.Variable):
                        env.variables[target] = value
        if not all(i in known and _is_in_its_set(system, i, topics[i]) for i in indices):
            return
        yield topics


def _is_in_its_set(system: System, index: int, value: Value) -> bool:
    """Whether a value lies in its topic's set; a plant that publishes any other value faults."""
    bounds = system.topics[index].bounds
    return len(bounds) != len(scalars_in(value)) or all(
        b is None or b.low <= x <= b.high for b, x in zip(bounds, scalars_in(value), strict=True)
    )


def warn_of_constant_predicates(
    system: System, module: Module, trials: Sequence[Trial], diagnostics: Diagnostics
) -> bool:
    """Warns W022 if `ttf` or `safer` is always true or always false; returns whether it warned."""
    symbol = module.symbol
    ttf, safer = symbol.ttf, symbol.safer
    if ttf is None or safer is None or not topic_reads(symbol.safe):
        return False  # predicates are computed, or `safe` reads no topic, of which W021 warns
    ttf_always, safer_always = _constant_truths(system, module, trials, (ttf, safer))
    if (ttf_always, safer_always) == (None, None):
        return False
    if maybe_nan(system, module):
        return False  # ranges do not hold for a NaN, which counts as danger
    name = f"of module `{symbol.name}`"
    if ttf_always is False:
        message, at, label = f"`ttf` {name} never holds", ttf, "AC is never taken off"
    elif ttf_always and safer_always is not False:
        message, at, label = f"`ttf` {name} always holds", ttf, "AC never keeps control"
    elif safer_always is False and not ttf_always:
        message, at, label = f"`safer` {name} never holds", safer, "AC never has control"
    else:
        return False
    _warn_of_predicate(module, message, at, label, diagnostics)
    return True


def _constant_truths(
    system: System,
    module: Module,
    trials: Sequence[Trial],
    predicates: tuple[typed.TypedExpr, typed.TypedExpr],
) -> list[bool | None]:
    """Gives True for each predicate that always holds, False if it never holds, else None."""
    aged = any(isinstance(n, typed.AgeRead) for n in nodes(predicates))  # no trials then
    read = reader_with_limits(system, fresh_ages_ns(system, module)) if aged else None
    return [
        truth_by_parts(e, system, module.scope, read)
        if aged or len({t[i] for t in trials}) == 1
        else None
        for i, e in enumerate(predicates)
    ]


def warn_of_predicates_outside_safe(
    system: System, module: Module, trials: Sequence[Trial], diagnostics: Diagnostics
) -> None:
    """Warns W022 if `ttf` or `safer` seems to hold only where `safe` does not."""
    symbol = module.symbol
    if symbol.ttf is None or symbol.safer is None or not trials:
        return
    lost = f"of module `{symbol.name}` seems to hold only where `safe` is lost"
    if _seems_to_exclude_safe(system, module, trials, 0):
        label = "AC would be taken off when it is too late"
        _warn_of_predicate(module, f"`ttf` {lost}", symbol.ttf, label, diagnostics, symbol.safe)
    elif _seems_to_exclude_safe(system, module, trials, 1):
        label = "AC would get control where it must not be"
        _warn_of_predicate(module, f"`safer` {lost}", symbol.safer, label, diagnostics, symbol.safe)


def _warn_of_predicate(
    module: Module,
    message: str,
    at: typed.TypedExpr,
    label: str,
    diagnostics: Diagnostics,
    safe: typed.TypedExpr | None = None,
) -> None:
    sampled = ("no value that was tried meets both, which is no proof",) if safe else ()
    early = f"two periods ({show_ns(2 * module.period_ns)}) of what AC can do"
    if at is module.symbol.ttf:
        helps = [f"let `ttf` hold while `safe` does and has less room than {early}"]
    else:
        helps = ["let `safer` hold where `safe` does, with more room than `ttf` leaves"]
    if module.symbol.verify.groups and module.symbol.verify.induction is None:
        helps.append("or leave both out: then they are computed from `safe`")
    diagnostics.warning(
        "W022",
        message,
        at.span,
        label,
        also=((safe.span, "`safe`"),) if safe is not None else (),
        notes=(
            "`ttf` says when AC must not go on, `safer` when it may have control again",
            "both are for states where `safe` holds and can still be kept",
            *sampled,
        ),
        helps=tuple(helps),
    )


def _seems_to_exclude_safe(
    system: System, module: Module, trials: Sequence[Trial], number: int
) -> bool:
    """Whether `ttf` (0) or `safer` (1) never holds with `safe`, although chance predicts it."""
    one, other = [t for t in trials if t[number]], [t for t in trials if t[2]]
    if len(one) * len(other) < BOTH_EXPECTED * len(trials) or any(t[2] for t in one):
        return False
    predicate = (module.symbol.ttf, module.symbol.safer)[number]
    predicates = tuple(e for e in (predicate, module.symbol.safe) if e is not None)
    asked = evaluator_of_predicates(system, module, indices_of_tried_topics(module))
    try:
        return not any(
            _hold_together_between(asked, predicates, beyond[3], inside[3])
            for beyond, inside in zip(_sample_of(one), _sample_of(other), strict=False)
        )
    except BudgetExceeded:
        return False


def _sample_of(trials: Sequence[Trial]) -> Sequence[Trial]:
    return trials[:: max(1, len(trials) // PAIRS)][:PAIRS]


def _hold_together_between(
    holds: Holds,
    predicates: Sequence[typed.TypedExpr],
    beyond: Sequence[Value],
    inside: Sequence[Value],
) -> bool:
    """Whether two conditions both hold somewhere between `beyond` and `inside`, by halving.

    The second one holds at `inside`. The search goes straight, or changes one number only.
    """
    far, near = scalars_in(tuple(beyond)), scalars_in(tuple(inside))
    ends = [near, *([*far[:k], near[k], *far[k + 1 :]] for k in range(len(far)))]
    for end in ends:
        low, high = far, end
        for _ in range(HALVINGS):
            one, other = holds(predicates, with_scalars(inside, high))
            if one and other:
                return True
            if high is end and not other:
                break  # the second condition does not hold at this end
            middle = [_midpoint(a, b) for a, b in zip(low, high, strict=True)]
            if middle in (low, high):
                break
            if holds(predicates[1:], with_scalars(inside, middle))[0]:
                high = middle
            else:
                low = middle
    return False


def _midpoint(a: Value, b: Value) -> Value:
    if isinstance(a, bool) or a == b:
        return b
    return (a + b) // 2 if isinstance(a, int) else a / 2 + b / 2


def warn_of_ineffective_module(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W023 if nothing reads the module's outputs, W024 if its DM is too slow for a plant."""
    safe = {module.scope.topics.get(t, -1) for t in topic_reads(module.symbol.safe)}
    for plant in system.components:
        if plant.plant is None or not safe & {*plant.writes}:
            continue
        if module.forced is None and not set(module.outputs) & _topics_others_read(system, module):
            _warn_of_unread_outputs(system, module, diagnostics)
            return
        if module.period_ns >= RARELY * plant.period_ns:
            _warn_of_slow_dm(system, module, plant, diagnostics)
            return


def _topics_others_read(system: System, module: Module) -> set[int]:
    """Gives the topics that plants, other DMs, and nodes other than the module's AC and SC read."""
    read = {t for other in system.modules if other.index != module.index for t in other.inputs}
    for component in system.components:
        topics = component.scope.topics
        if component.plant is not None:
            read |= {topics[t] for t in component.plant.reads if t in topics}
        elif component.node is not None and component.index not in (module.ac, module.sc):
            read |= {topics[s.topic] for s in component.node.subscribes if s.topic in topics}
    return read | {source for t in read if (source := system.topics[t].queue_of) is not None}


def _warn_of_unread_outputs(system: System, module: Module, diagnostics: Diagnostics) -> None:
    outputs = [system.topics[i] for i in module.outputs]
    names = ", ".join(f"`{t.name}`" for t in outputs[:OUTPUTS_SHOWN])
    diagnostics.warning(
        "W023",
        f"nothing reads what module `{module.symbol.name}` publishes",
        outputs[0].symbol.span,
        "no plant, no node and no other DM reads it",
        also=((module.symbol.span, f"publishes {names}"),),
        notes=("what no plant feels keeps nothing safe",),
        helps=(f"let a plant read it: `reads {outputs[0].symbol.name.rpartition('.')[2]};`",),
    )


def _warn_of_slow_dm(
    system: System, module: Module, plant: Component, diagnostics: Diagnostics
) -> None:
    assert plant.plant is not None
    of_sc = system.components[module.sc].period_ns
    diagnostics.warning(
        "W024",
        f"module `{module.symbol.name}` looks once in {module.period_ns // plant.period_ns:,} "
        f"steps of plant `{plant.plant.name}`",
        module.symbol.span,
        f"looks every {show_ns(module.period_ns)}",
        also=((plant.plant.span, f"moves every {show_ns(plant.period_ns)}"),),
        notes=("AC acts unseen between two looks: a proof counts with two periods of it",),
        helps=(f"look as often as SC acts: `period {write_ns(of_sc)};`",),
    )


def warn_of_inexact_topics(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns D019 of a topic whose error in the flying plant is larger than in the proof."""
    verify, symbol = module.symbol.verify, module.symbol
    links = [*verify.abstracts, *(link for view in verify.views for link in view.block.abstracts)]
    evaluator = Evaluator({**module.around, **module.scope.params})
    outer = name_of_subsystem(module)
    read = {**system.components[module.sc].scope.topics, **module.scope.topics}
    for link in dict.fromkeys(links):
        name = f"{outer}.{link.instance}" if outer else link.instance
        for m in next((c.measured for c in system.components if c.name == name), ()):
            topic = system.topics[m.topic]
            path = [path for path, _ in leaves(topic.type)][m.leaf]
            errors = [x for x in link.plant.measured if x.topic is topic.symbol]
            bounds = [evaluator.value(x.within) for x in errors if path[: len(x.path)] == x.path]
            proved = max((float(b) for b in bounds if isinstance(b, float)), default=0.0)
            driven = topic.symbol in dict(link.plant.drives) and read.get(topic.symbol) == m.topic
            if driven and m.bound > proved:
                leaf, within = leaf_name(topic.name, path), f"within {proved:g} of its plant"
                diagnostics.warning(
                    "D019",
                    f"{link.instance} publishes `{leaf}` within {m.bound:g} of its state, and "
                    f"`{symbol.name}` is proved with {proved:g}",
                    link.span,
                    f"{link.plant.name} publishes it {within}",
                    notes=("what is proved of these modules is not about this plant",),
                    helps=(f"`measured {leaf} within {m.bound:g}` in {link.plant.name}, too",),
                )
