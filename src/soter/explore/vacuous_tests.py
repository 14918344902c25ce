"""Finds the parts of a test that say nothing, whatever the search found.

Purpose: `find_vacuous_parts` makes one list for every output: properties that cannot fail or were
never put to the test, contracts that permit nothing, faults, inputs and replacements that change
nothing. For that every scalar that a property reads has a range: its declared set and type, or one
value where nobody can write another one.
Non-goals: deciding conditions (`constant_truth.py`); verdicts (`command.py`); what steps compute,
which a search answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.explore.constant_truth import holds_always
from soter.explore.judge import test_plan
from soter.language.evaluate.range_evaluation import all_values, constant_range
from soter.language.evaluate.ranges import ANY_FLOAT, INF, Range
from soter.language.evaluate.topic_ranges import range_in_set
from soter.language.model import typed
from soter.language.model.tree_walk import children, nodes, premise_of, topic_reads
from soter.language.model.types import BOOL, leaf_count, show_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.explore.constant_truth import Read
    from soter.language.evaluate.range_evaluation import Known, ReadPlace
    from soter.language.model.system import Component, Property, Scope, System, TimedProperty
    from soter.language.model.types import Type


class Domains:
    """The ranges of all scalars that a test may read; with `start`, those before the first step."""

    def __init__(self, system: System, *, start: bool = False) -> None:
        self._system = system
        self._start = start
        self._writable = _writable_topics(system)
        plan = test_plan(system)
        late = max((f.by_ns for f in plan.faults if f.kind == "late"), default=0)
        long = max((f.by_ns for f in plan.faults if f.kind == "overrun"), default=0)
        self._end_s = (plan.horizon_ns + plan.skew_ns + late + long) / 1e9

    def scalar_range(self, place: ReadPlace) -> Range:
        """The range of a scalar that a condition reads."""
        if place.kind == "topic":
            return self._topic_range(place)
        if place.kind == "truth":
            return self._state_range(place)
        if place.kind == "mode":
            module = self._system.modules[place.index]
            if module.forced is not None or self._start:
                mode = int(module.forced == "ac")
                return Range(mode, mode)
            return Range(0, 1)
        if self._start:
            return ANY_FLOAT
        return Range(0.0, self._end_s if place.kind == "time" else INF)

    def _topic_range(self, place: ReadPlace) -> Range:
        topic = self._system.topics[place.index]
        if topic.queue_of is not None:
            return _scalar_range(all_values(place.type), place.type)
        if self._start or place.index not in self._writable:
            return _range_at(constant_range(topic.type, topic.default), place.path, place.type)
        return range_in_set(topic, place)

    def _state_range(self, place: ReadPlace) -> Range:
        component = self._system.components[place.index]
        plant = component.plant
        assert plant is not None
        state = plant.states[place.path[0]]
        moved = plant.extern or state in plant.der or state in plant.next
        drawn = component.initial_range and component.initial_range[place.path[0]]
        if moved and not self._start:
            return _scalar_range(all_values(place.type), place.type)
        if drawn:
            return Range(*drawn)
        first = constant_range(state.type, component.initial[place.path[0]])
        return _range_at(first, place.path[1:], place.type)


def _writable_topics(system: System) -> set[int]:
    """The topics that an input or a component may write up to the horizon."""
    horizon = test_plan(system).horizon_ns
    topics = {drive.topic for drive in system.inputs}
    for component in system.components:
        if component.phase_ns <= horizon:
            topics |= set(component.writes)
    return topics


def _range_at(ranges: Known, path: tuple[int, ...], leaf_type: Type) -> Range:
    for index in path:
        ranges = ranges[index] if isinstance(ranges, tuple) and index < len(ranges) else None
    return ranges if isinstance(ranges, Range) else _scalar_range(all_values(leaf_type), leaf_type)


def _scalar_range(ranges: Known, leaf_type: Type) -> Range:
    assert isinstance(ranges, Range), (leaf_type, leaf_count(leaf_type))
    return ranges


def permits_nothing(c: Component, read: Read) -> bool:
    """Whether the component's guarantees fail for all values, so that it can publish nothing."""
    if c.node is None or not c.node.publishes:
        return False
    locals_ = {
        s.variable: s.value
        for s in _statements_below(c.node.step)
        if isinstance(s, typed.TypedDeclare)
    }
    guarantees = [
        _condition_and_publication(condition, body)
        for s in _statements_below(c.node.step)
        if isinstance(s, typed.TypedIf)
        for condition, body in s.arms
        if any(isinstance(n, typed.TypedPublish) for n in nodes(body)) and _is_guarantee(condition)
    ]
    return bool(guarantees) and all(
        holds_always(e, False, c.scope, read, c.period_ns, locals_) for e in guarantees
    )


def _condition_and_publication(
    condition: typed.TypedExpr, body: tuple[typed.TypedStmt, ...]
) -> typed.TypedExpr:
    """The condition; where each output has an `if` of its own, also that one is published."""
    if any(isinstance(s, typed.TypedPublish) for s in body):
        return condition
    published: typed.TypedExpr | None = None
    for s in body:
        if isinstance(s, typed.TypedIf):
            chosen = s.arms[0][0]
            either = (BOOL, condition.span, "||", published, chosen)
            published = chosen if published is None else typed.TypedBinary(*either)  # type: ignore[arg-type]
    assert published is not None
    return typed.TypedBinary(BOOL, condition.span, "&&", published, condition)


def _is_guarantee(condition: typed.TypedExpr) -> bool:
    """Whether a condition is a guarantee, not the choice of whether to publish."""
    return not isinstance(condition, (typed.TypedChoose, typed.VarRead))


def _statements_below(body: object) -> list[object]:
    """All statements of a body, also those inside other statements."""
    parts = list(body) if isinstance(body, tuple) else children(body)
    statements = [p for p in parts if isinstance(p, typed.TypedStmt)]
    return statements + [inner for p in statements for inner in _statements_below(p)]


CANNOT_FAIL = "property"


@dataclass(frozen=True)
class VacuousPart:
    """One part of a test that says nothing.

    `what`: property (it cannot fail), premise (it was never put to the test), contract, module,
    fault, input or replacement; `name`: its name or text; `why` it says nothing.
    """

    what: str
    name: str
    why: str

    @property
    def text(self) -> str:
        """A sentence with the part and the reason."""
        return f"{self.name} {self.why}"

    @property
    def cannot_fail(self) -> bool:
        """Whether the part is a property that no execution could violate."""
        return self.what == CANNOT_FAIL


def find_vacuous_parts(
    system: System,
    met: Sequence[tuple[bool, bool]],
    unreached: Sequence[str] = (),
    replaced: Sequence[tuple[str, str]] = (),
    *,
    ended: bool,
) -> tuple[VacuousPart, ...]:
    """All parts of a test that say nothing.

    `met`: for each property, then each timed one, whether it was judged, and put to the test.
    `unreached`: modes that no execution reached. `replaced`: pairs of a component and what replaces
    it. `ended`: the search saw all executions, so what none of them met cannot be met.
    """
    vacuities = [*_vacuous_statements(system, met, ended=ended), *_unread_parts(system, replaced)]
    for module in system.modules:
        if ended and f"{module.name} in AC" in unreached:
            why = "never gives AC control, in no execution: nothing is said of what AC does"
            vacuities.append(VacuousPart("module", module.name, why))
    return tuple(dict.fromkeys(vacuities))


def _vacuous_statements(
    system: System, met: Sequence[tuple[bool, bool]], *, ended: bool
) -> Iterator[VacuousPart]:
    domains = Domains(system)
    horizon = test_plan(system).horizon_ns
    for prop in system.properties:
        stepped = prop.component is None or system.components[prop.component].phase_ns <= horizon
        if stepped:
            yield from _property_vacuity(system, prop, domains, met[prop.index], ended=ended)
    for timed in test_plan(system).timed:
        yield from _timed_vacuity(
            system, timed, domains, met[len(system.properties) + timed.index], ended=ended
        )
    yield from _contract_vacuities(system, domains)
    yield from _fault_vacuities(system)


# ---------------------------------------------------------------- properties


def _property_vacuity(
    system: System, prop: Property, domains: Domains, met: tuple[bool, bool], *, ended: bool
) -> Iterator[VacuousPart]:
    name = f"{prop.kind} {prop.text}"
    wanted = prop.kind != "never"
    judged, held = met
    period_ns = 0 if prop.component is None else system.components[prop.component].period_ns
    if holds_always(prop.condition, wanted, prop.scope, domains.scalar_range, period_ns):
        part = CANNOT_FAIL if judged else "premise"
        yield VacuousPart(part, name, _why_it_cannot_fail(prop.condition, wanted, prop, domains))
        return
    premise = premise_of(prop.condition) if prop.kind == "always" else None
    if ended and premise is not None and judged and not held:
        text = premise.span.text_on_one_line
        yield VacuousPart(
            "premise", name, f"was never put to the test: `{text}` held in no execution"
        )


def _why_it_cannot_fail(
    condition: typed.TypedExpr, wanted: bool, prop: Property, domains: Domains
) -> str:
    reads = [n for n in nodes([condition]) if isinstance(n, _READ_KINDS)]
    if not reads:
        return "cannot fail: it reads nothing"
    premise = premise_of(condition) if wanted else None
    if premise is not None and holds_always(premise, False, prop.scope, domains.scalar_range):
        return f"cannot fail: `{premise.span.text_on_one_line}` holds for no value of what it reads"
    holds = "holds for every value" if wanted else "its condition holds for no value"
    return f"cannot fail: {'it ' if wanted else ''}{holds} of what it reads"


_READ_KINDS = (
    typed.TopicRead,
    typed.TruthRead,
    typed.ModeRead,
    typed.MarginRead,
    typed.TimeRead,
    typed.AgeRead,
)


def _timed_vacuity(
    system: System, prop: TimedProperty, domains: Domains, met: tuple[bool, bool], *, ended: bool
) -> Iterator[VacuousPart]:
    judged, owed = met
    if prop.kind == "invariant":
        assert prop.module is not None
        module = system.modules[prop.module]
        if holds_always(module.symbol.safe, True, module.scope, domains.scalar_range):
            why = "asks only whether SC acts in time: `safe` holds for every value"
            yield VacuousPart("premise", prop.text, why)
        return
    assert prop.condition is not None
    if why := _why_it_holds_anyway(prop.condition, prop.premise, prop.scope, domains):
        yield VacuousPart(CANNOT_FAIL if judged else "premise", prop.text, f"cannot fail: {why}")
    elif prop.premise is not None and ended and not judged:
        premise = prop.premise.span.text_on_one_line
        why = f"was never put to the test: `{premise}` held in no execution in time"
        yield VacuousPart("premise", prop.text, why)
    elif prop.kind == "eventually" and ended and judged and not owed:
        start = Domains(system, start=True)
        if holds_always(prop.condition, True, prop.scope, start.scalar_range):
            why = "was never put to the test: it holds at the start already, in every execution"
            yield VacuousPart("premise", prop.text, why)


def _why_it_holds_anyway(
    condition: typed.TypedExpr, premise: typed.TypedExpr | None, scope: Scope, domains: Domains
) -> str:
    """The reason why a timed property holds for all values; "" if it need not hold."""
    if holds_always(condition, True, scope, domains.scalar_range):
        return f"`{condition.span.text_on_one_line}` holds for every value of what it reads"
    if premise is None:
        return ""
    if holds_always(premise, False, scope, domains.scalar_range):
        return f"`{premise.span.text_on_one_line}` holds for no value of what it reads"
    if holds_always(_implication(premise, condition), True, scope, domains.scalar_range):
        texts = premise.span.text_on_one_line, condition.span.text_on_one_line
        return "where `{}` holds, `{}` holds at once".format(*texts)
    return ""


def _implication(premise: typed.TypedExpr, condition: typed.TypedExpr) -> typed.TypedExpr:
    """The expression `!premise || condition`."""
    fails = typed.TypedUnary(BOOL, premise.span, "!", premise)
    return typed.TypedBinary(BOOL, condition.span, "||", fails, condition)


# ---------------------------------------------------------------- changes that a test makes


def _contract_vacuities(system: System, domains: Domains) -> Iterator[VacuousPart]:
    stand_ins_by_instance: dict[str, list[Component]] = {}
    for component in system.components:
        if component.stands_for is not None:
            stand_ins_by_instance.setdefault(component.stands_for.of, []).append(component)
    for name, stand_ins in stand_ins_by_instance.items():
        if all(permits_nothing(component, domains.scalar_range) for component in stand_ins):
            why = "permits nothing: no publication keeps it, so nothing is ever published there"
            yield VacuousPart("contract", f"the contract of {name}", why)


def _fault_vacuities(system: System) -> Iterator[VacuousPart]:
    plan = test_plan(system)
    for fault in plan.faults:
        component = system.components[fault.component]
        if fault.least_ns:
            continue
        name = f"{fault.kind} {component.name}"
        if component.phase_ns > plan.horizon_ns:
            first = f"{show_ns(component.phase_ns)}, after the horizon"
            yield VacuousPart("fault", name, f"cannot occur: its first release is at {first}")
        elif fault.kind == "overrun" and not component.writes:
            yield VacuousPart("fault", name, "changes nothing: it publishes nothing")


def _unread_parts(system: System, replaced: Sequence[tuple[str, str]]) -> Iterator[VacuousPart]:
    """Yields inputs that are drawn, and replacements that publish, though nobody reads them.

    Replacements by contracts are left out: they make a test smaller, and are not meant to be read.
    """
    read = _topics_read(system)
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        if drive.topic not in read and not read & set(topic.queues):
            yield VacuousPart(
                "input", topic.name, "is drawn for nobody: nothing in the test reads it"
            )
    for component in system.components:
        written = set(component.writes)
        queues = {q for t in written for q in system.topics[t].queues}
        instance = next(
            (p for p, by in replaced if component.node is not None and component.node.name == by),
            None,
        )
        if (
            instance is None
            or not written
            or read & (written | queues)
            or _replaces_extern(system, instance)
        ):
            continue
        name = f"the replacement of {instance}"
        yield VacuousPart("replacement", name, "changes nothing: nobody reads what it publishes")


def _replaces_extern(system: System, path: str) -> bool:
    """Whether the replaced component is extern, so that a test must replace it."""
    test = system.program.tests.get(test_plan(system).name)
    was = None if test is None else symbol_at_path(test, path)
    return not isinstance(was, typed.NodeSymbol) or was.extern


def _topics_read(system: System) -> set[int]:
    """The topics that a step, a decision or a property reads."""
    topics: set[int] = set()
    for c in system.components:
        topics |= {*c.reads}
    for m in system.modules:
        topics |= {*m.reads}
        topics |= {m.scope.topics[t] for t in topic_reads(m.symbol.safe) if t in m.scope.topics}
    for prop in system.properties:
        topics |= {prop.scope.topics[t] for t in topic_reads(prop.condition)}
    for timed in test_plan(system).timed:
        roots = [e for e in (timed.premise, timed.condition) if e is not None]
        topics |= {timed.scope.topics[t] for t in topic_reads(*roots)}
    return topics


def symbol_at_path(
    test: typed.TestSymbol, path: str
) -> typed.ModuleSymbol | typed.NodeSymbol | None:
    """The module or node at a path in a test's system before replacements; None if neither."""
    found: object = test.system
    for name in path.split("."):
        if isinstance(found, typed.ModuleSymbol):
            names = {n.name.rpartition(".")[2]: n for n in found.controllers}
            found = names.get(name)
            continue
        instance = found.by_name.get(name) if isinstance(found, typed.SystemSymbol) else None
        found = None if instance is None else instance.what
    return found if isinstance(found, (typed.ModuleSymbol, typed.NodeSymbol)) else None
