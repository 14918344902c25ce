"""Warns of what is doubtful in a system without errors.

Purpose: W012 (AC and SC look exchanged), W018 (`safe` reads an output of its module), W033 (several
commands move one group of a shield), W036 (a plant or node reads what it publishes), W028 (a topic
is older than its `max_age` before it is published again, or is never published), W034 (a measured
topic may have any age), W035 (an age is compared with a time that it never reaches), W026 (a
property speaks of a time at which the system has ended). `warn_of_doubtful_parts` runs them all.
Non-goals: proofs of P1, P2 or P3, which need no warning; what late steps do (`timing/`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.diagnostics.fixes import exchange, replace
from soter.language.elaborate.composition_check import fix_that_adds
from soter.language.elaborate.lints.contradictory_predicates import (
    cached_trials,
    warn_of_contradictions,
)
from soter.language.elaborate.lints.refuted_at_once import (
    warn_of_constant_predicates,
    warn_of_ineffective_module,
    warn_of_inexact_topics,
    warn_of_predicates_outside_safe,
    warn_of_properties_at_start,
    warn_of_unsafe_start,
)
from soter.language.elaborate.lints.rest_lints import warn_of_rest
from soter.language.elaborate.lints.step_lints import warn_of_faults, warn_of_plant, warn_of_silence
from soter.language.elaborate.passes.read_ages import is_measured, least_age_ns
from soter.language.evaluate.range_evaluation import (
    COMPARISONS,
    RangeEvaluator,
    TooHardError,
    all_values,
)
from soter.language.evaluate.ranges import FALSE, Range
from soter.language.model import typed
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.types import (
    BOOL,
    ArrayType,
    RecordType,
    leaf_name,
    positions,
    show_ns,
    write_ns,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Diagnostics, Help
    from soter.language.evaluate.range_evaluation import ReadPlace
    from soter.language.model.system import Component, Module, Property, Scope, System, Topic
    from soter.language.model.typed import TopicSymbol

    Path = tuple[str, ...]
    Leaf = tuple[typed.PlantSymbol, typed.TypedExpr, Path]


WHOLE = RecordType, ArrayType
"""Types whose parts are followed one by one."""
TRIED_MAX = 16
"""Most modules of a system whose predicates are tried, some milliseconds each."""
SLOWER = 5
"""An SC with this many times AC's period is hardly the controller that acts at once."""
PROPERTIES_MAX = 32
"""How many properties of a system are examined."""
BUDGET = 600
"""Most expressions that are evaluated for one comparison."""
MUCH_OLDER = 100
"""A bound of this many times a topic's greatest age was probably meant in another unit."""
AGES = ("a module that reads what is too old takes AC off",)


def warn_of_shield_groups(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W033 of each declared group of a module's shield that several commands move."""
    symbol = module.symbol
    if symbol.shield is None:
        return
    plants = [link.plant for link in symbol.verify.abstracts]
    plants = plants or [c.plant for c in system.components if c.plant is not None]
    outputs = {*symbol.ac.publishes, *symbol.sc.publishes}
    for group in symbol.verify.groups:
        moved = [leaf for axis in group.axes for leaf in _rates_of_axis(axis, plants)]
        found = dict.fromkeys(u for p, e, path in moved for u in _commands_in(p, e, path, outputs))
        if len(found) > 1:
            diagnostics.warning(
                "W033",
                f"the shield of module `{symbol.name}` judges one command of a group, and "
                f"{' and '.join(f'`{u}`' for u in found)} move this one",
                group.span,
                also=((symbol.shield.span, "the shield"),),
                notes=("nothing is permitted there: AC never gets control",),
                helps=("a `grid` line for the states of each command, or leave `shield` out",),
            )


def _rates_of_axis(
    axis: typed.TypedGridAxis, plants: Sequence[typed.PlantSymbol]
) -> Iterator[Leaf]:
    """Yields plant, expression of `der` or `next`, and path, for each state that an axis means."""
    if axis.plant is not None:
        found = [
            (axis.plant, v, axis.path[1:]) for v in axis.plant.states if v.name == axis.path[0]
        ]
    else:
        driven = [(p, e) for p in plants for t, e in p.drives if t is axis.topic]
        found = [(p, *at) for p, e in driven if (at := _state_read_by(p, e, axis.path)) is not None]
    for plant, state, path in found:
        rate = plant.der.get(state, plant.next.get(state))
        if rate is not None:
            yield plant, rate, path


def _state_read_by(
    plant: typed.PlantSymbol, e: typed.TypedExpr, path: Path
) -> tuple[typed.Variable, Path] | None:
    """Gives the state, and the path in it, that `path` of `e` reads unchanged; or None."""
    if isinstance(e, typed.VarRead):
        value = dict(plant.lets).get(e.variable)
        return (e.variable, path) if value is None else _state_read_by(plant, value, path)
    inner = _source_of_part(e, path)
    return None if inner is None else _state_read_by(plant, *inner)


def _source_of_part(e: typed.TypedExpr, path: Path) -> tuple[typed.TypedExpr, Path] | None:
    """Gives the inner expression that supplies part `path` of `e`, and the path in it; or None."""
    if isinstance(e, typed.TypedField) and isinstance(e.target.type, RecordType):
        return e.target, (e.target.type.fields[e.index][0], *path)
    if isinstance(e, typed.Index) and isinstance(e.index, typed.Literal):
        return e.target, (f"[{e.index.value}]", *path)
    if isinstance(e, typed.Aggregate) and isinstance(e.type, WHOLE) and path:
        at = positions(e.type, path[:1])[0]
        order = e.order or tuple(range(len(e.elements)))
        return e.elements[order.index(at)], path[1:]
    return None


def _commands_in(
    plant: typed.PlantSymbol, e: typed.TypedExpr, path: Path, outputs: Iterable[typed.TopicSymbol]
) -> Iterator[str]:
    """Yields the names of numbers in `outputs` that part `path` of `e` certainly reads."""
    parts: list[tuple[typed.TypedExpr, Path]] = []
    inner = _source_of_part(e, path)
    if isinstance(e, typed.TopicRead):
        if e.topic in outputs:
            yield leaf_name(e.topic.name, path)
    elif inner is not None:
        parts = [inner]
    elif isinstance(e, typed.VarRead):
        value = dict(plant.lets).get(e.variable)
        parts = [] if value is None else [(value, path)]
    elif isinstance(e, (typed.Vector, typed.TypedBinary)):
        parts = [(x, path if isinstance(x.type, WHOLE) else ()) for x in (e.left, e.right)]
    elif isinstance(e, typed.TypedUnary):
        parts = [(e.operand, path)]
    elif isinstance(e, (typed.Builtin, typed.TypedCall)) and not path:
        parts = [(x, ()) for x in e.arguments if not isinstance(x.type, WHOLE)]
    for x, part in parts:
        yield from _commands_in(plant, x, part, outputs)


def warn_of_doubtful_parts(system: System, diagnostics: Diagnostics) -> None:
    """Warns of doubtful parts of plants, properties, and modules with their own controllers."""
    for component in system.components:
        warn_of_plant(system, component, diagnostics)
        _warn_of_reading_own_output(component, diagnostics)
    warn_of_faults(system, diagnostics)
    warn_of_properties_at_start(system, diagnostics)
    warn_of_property_times(system, diagnostics)
    for number, module in enumerate(system.modules):
        symbol = module.symbol
        sc, ac = system.components[module.sc], system.components[module.ac]
        if sc.node is not symbol.sc or ac.node is not symbol.ac:
            continue  # replaced in this system
        _warn_of_exchange(system, module, diagnostics)
        _warn_of_outputs_in_safe(module, diagnostics)
        warn_of_silence(system, module, diagnostics)
        warn_of_ineffective_module(system, module, diagnostics)
        warn_of_old_topics(system, module, diagnostics)
        warn_of_ageless_topics(system, module, diagnostics)
        warn_of_age_units(system, module, diagnostics)
        warn_of_shield_groups(system, module, diagnostics)
        warn_of_inexact_topics(system, module, diagnostics)
        if number < TRIED_MAX:
            warn_of_rest(system, module, diagnostics)
            warn_of_unsafe_start(system, module, diagnostics)
            trials = cached_trials(system, module)
            if not (
                warn_of_constant_predicates(system, module, trials, diagnostics)
                or warn_of_contradictions(system, module, trials, diagnostics)
            ):
                warn_of_predicates_outside_safe(system, module, trials, diagnostics)


def _warn_of_exchange(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W012 if AC is written in Soter, and SC is an extern or much slower.

    The period does not count for a module with `rest`: its DM follows each hold of SC, so that even
    a slow SC acts in time.
    """
    symbol = module.symbol
    ac, sc = system.components[module.ac], system.components[module.sc]
    at_ac, at_sc = symbol.ac_span, symbol.sc_span
    if ac.extern or symbol.synthesized or at_ac is None or at_sc is None:
        return
    if sc.extern:
        label, of_ac = "an extern: no proof knows what it does", "written in Soter"
    elif symbol.rest is None and sc.period_ns >= SLOWER * ac.period_ns:
        label = f"steps every {show_ns(sc.period_ns)}"
        of_ac = f"steps every {show_ns(ac.period_ns)}"
    else:
        return
    diagnostics.warning(
        "W012",
        f"AC and SC of module `{symbol.name}` look exchanged",
        at_sc,
        label,
        also=((at_ac, of_ac),),
        notes=("the safe controller is the one that is trusted, and acts at once",),
        helps=(exchange(at_ac, at_sc, f"exchange them: `ac {at_sc.text};`, `sc {at_ac.text};`"),),
    )


def _warn_of_reading_own_output(component: Component, diagnostics: Diagnostics) -> None:
    """Warns W036 of a component with an input and an output that are wired to the same topic."""
    topics, plant, node = component.scope.topics, component.plant, component.node
    reads: list[TopicSymbol] = []
    if plant is not None:
        reads = list(plant.reads)
    elif node is not None:
        reads = [s.topic for s in node.subscribes]
    written = {topics[t]: t for t in component.published}
    for topic in reads:
        out = written.get(topics[topic])
        if out is None or out is topic:
            continue
        diagnostics.warning(
            "W036",
            f"`{component.name}` reads as `{topic.name}` what it publishes itself",
            component.span,
            f"`{topic.name}` and `{out.name}` are wired to one topic",
            also=((topic.span, "what it reads"), (out.span, "what it publishes")),
            notes=("nobody else says anything on that topic",),
            helps=(f"wire `{topic.name}` to what another one publishes",),
        )


def _warn_of_outputs_in_safe(module: Module, diagnostics: Diagnostics) -> None:
    """Warns W018 if `safe` reads an output: AC may publish any value of its set at any time."""
    symbol = module.symbol
    outputs = {t for n in (symbol.ac, symbol.sc) for t in n.publishes}
    for topic, read in topic_reads(symbol.safe).items():
        if topic not in outputs:
            continue
        diagnostics.warning(
            "W018",
            f"`safe` of module `{symbol.name}` speaks of its own output `{topic.name}`",
            read.span,
            "AC may publish any value of its set",
            also=((topic.span, "declared here"),),
            notes=("no switch prevents a command that was given: the gate bounds it by its set",),
            helps=("say it with the set of the topic; `safe` speaks of the state of the plant",),
        )


def warn_of_old_topics(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W028 of a topic that gets too old before the next publication, or never has one."""
    drivers = {
        c.scope.topics[topic]: c
        for c in system.components
        for topic in c.published
        if topic in c.scope.topics
    }
    drawn_every = {d.topic: d.every_ns for d in system.inputs}
    outside = {e.topic for e in system.externals}
    for index in module.inputs:
        topic = system.topics[index]
        if topic.max_age_ns is None or index in outside:
            continue
        if index in drivers:
            _warn_of_rare_publication(topic, module, drivers[index], topic.max_age_ns, diagnostics)
        elif topic.symbol.input and _runs_alone(system):
            every_ns = drawn_every.get(index)
            _warn_of_rarely_drawn_inputs(system, topic, module, every_ns, diagnostics)


def warn_of_ageless_topics(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W034 of a measured topic that a DM reads at any age; only at the first such module."""
    if not _runs_alone(system):
        return
    before = {system.topics[i].symbol for m in system.modules[: module.index] for i in m.inputs}
    asked = [{n.topic for n in _age_reads(e)} for e in _written_ttf_and_safer(module)]
    aged = set.intersection(*asked) if asked else set()
    for index in module.inputs:
        topic = system.topics[index]
        if topic.max_age_ns is not None or topic.symbol in aged | before:
            continue
        if not is_measured(system, index):
            continue
        least = least_age_ns(system, index)
        helps: tuple[Help, ...] = (
            "say how old it may be: `topic ... max_age ...;`, at least as long as two publications",
        )
        if least is not None:
            helps = (f"`max_age {write_ns(least)}` is the least that the periods allow",)
        diagnostics.warning(
            "W034",
            f"`{topic.symbol.name}` is trusted, however old it is",
            topic.symbol.span,
            "it has no `max_age`",
            also=((module.symbol.span, "the DM reads it"),),
            notes=("of a sensor that falls silent, or never spoke, AC keeps control",)
            if not any(topic.symbol in topics for topics in asked)
            else ("only one of `ttf` and `safer` looks at its age: the other one trusts it",),
            helps=helps,
        )


def warn_of_age_units(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W035 if `ttf` or `safer` compares an age with far more than any possible age."""
    for n in _comparisons(_written_ttf_and_safer(module)):
        usual_by_topic = {
            t: t.max_age_ns or least_age_ns(system, i)
            for i in dict.fromkeys(module.scope.topics[read.topic] for read in _age_reads(n))
            for t in (system.topics[i],)
        }
        known = [age for age in usual_by_topic.values() if age is not None]
        if not known or len(known) < len(usual_by_topic):
            continue
        topic, usual = next(iter(usual_by_topic)), max(known)
        ages = Range(0.0, MUCH_OLDER * usual / 1e9)
        truth = _truth_in_ranges(module.scope, n, {"age": ages})
        if (
            not truth.single
            or _truth_in_ranges(module.scope, n, {"age": Range(0.0, math.inf)}).single
        ):
            continue
        label = f"no older than {show_ns(usual)}" if topic.max_age_ns else "published as often"
        diagnostics.warning(
            "W035",
            f"this comparison is {'always' if truth.low else 'never'} true of an age of "
            f"`{topic.name}` that is possible",
            n.span,
            f"ages are in seconds, here up to {show_ns(usual)}",
            also=((topic.symbol.span, label),),
            notes=("what is older than `max_age` is stale, and AC has no control anyway",),
            helps=(f"write a time with its unit: `age(...) < seconds({write_ns(usual)})`",),
        )


def _comparisons(expressions: Iterable[typed.TypedExpr]) -> Iterator[typed.TypedExpr]:
    """Yields the comparisons in expressions, and the calls that may contain comparisons."""
    for n in nodes(expressions):
        compares = n.op in COMPARISONS if isinstance(n, typed.TypedBinary) else True
        if compares and isinstance(n, (typed.TypedBinary, typed.TypedCall)) and n.type == BOOL:
            yield n


def _age_reads(e: typed.TypedExpr) -> list[typed.AgeRead]:
    return [n for n in nodes([e]) if isinstance(n, typed.AgeRead)]


def _written_ttf_and_safer(module: Module) -> list[typed.TypedExpr]:
    symbol = module.symbol
    return [e for e in (symbol.ttf, symbol.safer) if e is not None]


def _warn_of_rare_publication(
    topic: Topic, module: Module, driver: Component, max_age_ns: int, diagnostics: Diagnostics
) -> None:
    if driver.period_ns <= max_age_ns:
        return
    driving = driver.plant or driver.node
    assert driving is not None
    age = write_ns(driver.period_ns)
    often = write_ns(max_age_ns)
    older = f"or let it be {age} old, and let `ttf` look that much further ahead"
    helps: tuple[Help, ...] = (
        replace(driving.period.span, often, f"publish it every {often} at least"),
        older,
    )
    if topic.symbol.max_age is not None:
        helps = (helps[0], replace(topic.symbol.max_age.span, age, older))
    diagnostics.warning(
        "W028",
        f"`{topic.name}` is too old for module `{module.symbol.name}` between two publications",
        driving.period.span,
        f"published every {show_ns(driver.period_ns)}",
        also=((topic.symbol.span, f"no older than {show_ns(max_age_ns)}"),),
        notes=AGES,
        helps=helps,
    )


def _runs_alone(system: System) -> bool:
    """Whether a system is meant to run by itself, not only inside another system or in tests.

    If not, the system around it drives its inputs, or the test says how they are drawn.
    """
    systems = system.program.systems
    symbol = systems.get(system.name)
    if symbol is None or any(i.what is symbol for s in systems.values() for i in s.instances):
        return False
    tested = any(t.system is symbol for t in system.program.tests.values())
    return symbol.default or symbol.until is not None or not tested


def _warn_of_rarely_drawn_inputs(
    system: System, topic: Topic, module: Module, every_ns: int | None, diagnostics: Diagnostics
) -> None:
    """Warns W028 of an input topic that runs of this system draw too rarely, or never."""
    max_age_ns = topic.max_age_ns
    assert max_age_ns is not None
    if every_ns is not None and every_ns <= max_age_ns:
        return
    where = f"in system `{system.name}`"
    when = f"is drawn every {show_ns(every_ns)}" if every_ns else "nothing drives"
    message = f"input topic `{topic.name}`, which module `{module.symbol.name}` reads, "
    message += f"is too old between two draws {where}" if every_ns else f"is never drawn {where}"
    symbol, often = system.program.systems[system.name], write_ns(max_age_ns)
    item = next((i for i in symbol.inputs if i.topic is topic.symbol), None)
    drawn = (
        fix_that_adds(symbol, f"input {topic.symbol.name} every {often};")
        if item is None
        else replace(item.every.span, often, f"draw it every {often} at least")
    )
    diagnostics.warning(
        "W028",
        message,
        topic.symbol.span,
        f"no older than {show_ns(max_age_ns)}, and {when}" + ("" if every_ns else " it"),
        notes=AGES if every_ns else (f"from {show_ns(max_age_ns)} on AC has no control",),
        helps=(drawn, "or leave its `max_age` out"),
    )


def warn_of_property_times(system: System, diagnostics: Diagnostics) -> None:
    """Warns W026 of a comparison with `time` that holds, but never before the system ends."""
    if system.until_ns is None:
        return
    for p in system.properties[:PROPERTIES_MAX]:
        for n in nodes([p.condition]) if p.component is None else ():
            if isinstance(n, typed.TypedBinary) and n.op in COMPARISONS and _reads_time(n):
                _warn_of_time_after_end(system, p, n, diagnostics)


def _reads_time(e: typed.TypedExpr) -> bool:
    return any(isinstance(n, typed.TimeRead) for n in nodes([e]))


def _warn_of_time_after_end(
    system: System, p: Property, comparison: typed.TypedBinary, diagnostics: Diagnostics
) -> None:
    assert system.until_ns is not None
    before, ever = Range(0.0, system.until_ns / 1e9), Range(0.0, math.inf)
    if (
        _truth_in_ranges(p.scope, comparison, {"time": before}) != FALSE
        or _truth_in_ranges(p.scope, comparison, {"time": ever}) == FALSE
    ):
        return
    diagnostics.warning(
        "W026",
        "this condition never holds",
        comparison.span,
        f"system `{system.name}` ends at {show_ns(system.until_ns)}",
        also=((p.span, f"so `{p.kind}` says nothing of it"),) if p.kind == "never" else (),
        notes=("`time` is in seconds",),
        helps=("compare it with a time before the end, or let the system go on: `until ...;`",),
    )


def _truth_in_ranges(
    scope: Scope, comparison: typed.TypedExpr, ranges: Mapping[str, Range]
) -> Range:
    """Gives the truth of a comparison, as a range, for all `time` and `age` in `ranges`."""

    def range_of_place(place: ReadPlace) -> Range:
        known = ranges[place.kind] if place.kind in ranges else all_values(place.type)
        if not isinstance(known, Range):
            raise TooHardError
        return known

    evaluator = RangeEvaluator(scope, 0, range_of_place)
    evaluator.left = BUDGET
    try:
        return evaluator.bounds(comparison)
    except TooHardError:
        return all_values(comparison.type)  # type: ignore[no-any-return]
