"""Finds the parts of a test that say nothing, whatever the search found.

Purpose: `of_test` makes one list for every output: properties that cannot fail or were never put to
the test, contracts that permit nothing, faults, inputs and replacements that change nothing. For
that every scalar that a property reads has a range: its declared set and type, or one value where
nobody can write another one.
Non-goals: deciding conditions (`constant_truth.py`); verdicts (`command.py`); what steps compute,
which a search answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.explore.constant_truth import holds_always
from soter.explore.judge import plan_of
from soter.language.evaluate.range_evaluation import anything, constant
from soter.language.evaluate.ranges import ANY_FLOAT, INF, Range
from soter.language.evaluate.topic_ranges import published
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
    """The ranges of what a flattened test reads; with `start` before any step of it."""

    def __init__(self, system: System, *, start: bool = False) -> None:
        self._system = system
        self._start = start
        self._writable = _writable(system)
        plan = plan_of(system)
        late = max((f.by_ns for f in plan.faults if f.kind == "late"), default=0)
        long = max((f.by_ns for f in plan.faults if f.kind == "overrun"), default=0)
        self._end_s = (plan.horizon_ns + plan.skew_ns + late + long) / 1e9

    def of(self, place: ReadPlace) -> Range:
        """The range of a scalar."""
        if place.kind == "topic":
            return self._topic(place)
        if place.kind == "truth":
            return self._truth(place)
        if place.kind == "mode":
            module = self._system.modules[place.index]
            if module.forced is not None or self._start:
                mode = int(module.forced == "ac")
                return Range(mode, mode)
            return Range(0, 1)
        if self._start:
            return ANY_FLOAT
        return Range(0.0, self._end_s if place.kind == "time" else INF)

    def _topic(self, place: ReadPlace) -> Range:
        topic = self._system.topics[place.index]
        if topic.queue_of is not None:
            return _range(anything(place.type), place.type)
        if self._start or place.index not in self._writable:
            return _at(constant(topic.type, topic.default), place.path, place.type)
        return published(topic, place)

    def _truth(self, place: ReadPlace) -> Range:
        component = self._system.components[place.index]
        plant = component.plant
        assert plant is not None
        state = plant.states[place.path[0]]
        moved = plant.extern or state in plant.der or state in plant.next
        drawn = component.initial_range and component.initial_range[place.path[0]]
        if drawn:
            low, high = drawn
            return (
                _range(anything(place.type), place.type)
                if moved and not self._start
                else (Range(low, high))
            )
        if not (moved and not self._start):
            first = constant(state.type, component.initial[place.path[0]])
            return _at(first, place.path[1:], place.type)
        return _range(anything(place.type), place.type)


def _writable(system: System) -> set[int]:
    """Topics that somebody may write up to the horizon."""
    horizon = plan_of(system).horizon_ns
    topics = {drive.topic for drive in system.inputs}
    for c in system.components:
        if c.phase_ns <= horizon:
            topics |= set(c.writes)
    return topics


def _at(whole: Known, path: tuple[int, ...], of: Type) -> Range:
    for index in path:
        whole = whole[index] if isinstance(whole, tuple) and index < len(whole) else None
    return whole if isinstance(whole, Range) else _range(anything(of), of)


def _range(known: Known, of: Type) -> Range:
    assert isinstance(known, Range), (of, leaf_count(of))
    return known


def permits_nothing(c: Component, read: Read) -> bool:
    """Whether a component's guarantees fail for all values of its topics, whatever else is read."""
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
    """The condition and that something is published: with several outputs perhaps none is."""
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
    """Whether a condition is a guarantee, not the choice whether anything is published."""
    return not isinstance(condition, (typed.TypedChoose, typed.VarRead))


def _statements(body: object) -> list[object]:
    """All statements, also those inside others."""
    parts = list(body) if isinstance(body, tuple) else children(body)
    statements = [p for p in parts if isinstance(p, typed.TypedStmt)]
    return statements + [inner for p in statements for inner in _statements(p)]


CANNOT_FAIL = "property"


@dataclass(frozen=True)
class VacuousPart:
    """One part of a test that says nothing.

    `what`: property (it cannot fail), premise (it was never put to the test), contract, module,
    fault, input or replacement; `name`: as people write it; `why` it says nothing.
    """

    what: str
    name: str
    why: str

    @property
    def text(self) -> str:
        """The part and the reason in a sentence."""
        return f"{self.name} {self.why}"

    @property
    def cannot_fail(self) -> bool:
        """Whether it is a property that no execution could violate."""
        return self.what == CANNOT_FAIL


def of_test(
    system: System,
    met: Sequence[tuple[bool, bool]],
    unreached: Sequence[str] = (),
    replaced: Sequence[tuple[str, str]] = (),
    *,
    ended: bool,
) -> tuple[VacuousPart, ...]:
    """All parts of a test that say nothing.

    `met`: for each property, then each timed one, whether it was judged, and put to the test.
    `unreached`: modes, as coverage names them. `replaced`: components and what stands in their
    place. `ended`: the search saw all executions, so what was not met cannot be met.
    """
    vacuities = [*_all(system, met, ended=ended), *_unread_parts(system, replaced)]
    for m in system.modules:
        if ended and f"{m.name} in AC" in unreached:
            why = "never gives AC control, in no execution: nothing is said of what AC does"
            vacuities.append(VacuousPart("module", m.name, why))
    return tuple(dict.fromkeys(vacuities))


def _all(system: System, met: Sequence[tuple[bool, bool]], *, ended: bool) -> Iterator[VacuousPart]:
    domains = Domains(system)
    horizon = plan_of(system).horizon_ns
    for p in system.properties:
        stepped = p.component is None or system.components[p.component].phase_ns <= horizon
        if stepped:
            yield from _property(system, p, domains, met[p.index], ended=ended)
    for t in plan_of(system).timed:
        yield from _vacuity(system, t, domains, met[len(system.properties) + t.index], ended=ended)
    yield from _contracts(system, domains)
    yield from _faults(system)


# ---------------------------------------------------------------- properties


def _property(
    system: System, p: Property, domains: Domains, met: tuple[bool, bool], *, ended: bool
) -> Iterator[VacuousPart]:
    name = f"{p.kind} {p.text}"
    wanted = p.kind != "never"
    judged, held = met
    period_ns = 0 if p.component is None else system.components[p.component].period_ns
    if holds_always(p.condition, wanted, p.scope, domains.of, period_ns):
        what = CANNOT_FAIL if judged else "premise"
        yield VacuousPart(what, name, _why(p.condition, wanted, p, domains))
        return
    premise = premise_of(p.condition) if p.kind == "always" else None
    if ended and premise is not None and judged and not held:
        text = _text(premise)
        yield VacuousPart(
            "premise", name, f"was never put to the test: `{text}` held in no execution"
        )


def _why(condition: typed.TypedExpr, wanted: bool, p: Property, domains: Domains) -> str:
    """Why a property that cannot fail cannot, in words."""
    reads = [n for n in nodes([condition]) if isinstance(n, _READ_KINDS)]
    if not reads:
        return "cannot fail: it reads nothing"
    premise = premise_of(condition) if wanted else None
    if premise is not None and holds_always(premise, False, p.scope, domains.of):
        return f"cannot fail: `{_text(premise)}` holds for no value of what it reads"
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


def _vacuity(
    system: System, t: TimedProperty, domains: Domains, met: tuple[bool, bool], *, ended: bool
) -> Iterator[VacuousPart]:
    judged, owed = met
    if t.kind == "invariant":
        assert t.module is not None
        module = system.modules[t.module]
        if holds_always(module.symbol.safe, True, module.scope, domains.of):
            why = "asks only whether SC acts in time: `safe` holds for every value"
            yield VacuousPart("premise", t.text, why)
        return
    assert t.condition is not None
    if why := _holds_anyway(t.condition, t.premise, t.scope, domains):
        yield VacuousPart(CANNOT_FAIL if judged else "premise", t.text, f"cannot fail: {why}")
    elif t.premise is not None and ended and not judged:
        why = f"was never put to the test: `{_text(t.premise)}` held in no execution in time"
        yield VacuousPart("premise", t.text, why)
    elif t.kind == "eventually" and ended and judged and not owed:
        start = Domains(system, start=True)
        if holds_always(t.condition, True, t.scope, start.of):
            why = "was never put to the test: it holds at the start already, in every execution"
            yield VacuousPart("premise", t.text, why)


def _holds_anyway(
    condition: typed.TypedExpr, premise: typed.TypedExpr | None, scope: Scope, domains: Domains
) -> str:
    """Why values alone decide that it holds in time; "" where they do not."""
    if holds_always(condition, True, scope, domains.of):
        return f"`{_text(condition)}` holds for every value of what it reads"
    if premise is None:
        return ""
    if holds_always(premise, False, scope, domains.of):
        return f"`{_text(premise)}` holds for no value of what it reads"
    if holds_always(_implication(premise, condition), True, scope, domains.of):
        return f"where `{_text(premise)}` holds, `{_text(condition)}` holds at once"
    return ""


def _implication(premise: typed.TypedExpr, condition: typed.TypedExpr) -> typed.TypedExpr:
    """An expression: the condition holds wherever the premise does."""
    fails = typed.TypedUnary(BOOL, premise.span, "!", premise)
    return typed.TypedBinary(BOOL, condition.span, "||", fails, condition)


def _text(e: typed.TypedExpr) -> str:
    return " ".join(e.span.text.split())


# ---------------------------------------------------------------- what a test changes


def _contracts(system: System, domains: Domains) -> Iterator[VacuousPart]:
    of: dict[str, list[Component]] = {}
    for c in system.components:
        if c.stands_for is not None:
            of.setdefault(c.stands_for.of, []).append(c)
    for name, stand_ins in of.items():
        if all(permits_nothing(c, domains.of) for c in stand_ins):
            why = "permits nothing: no publication keeps it, so nothing is ever published there"
            yield VacuousPart("contract", f"the contract of {name}", why)


def _faults(system: System) -> Iterator[VacuousPart]:
    plan = plan_of(system)
    for f in plan.faults:
        c = system.components[f.component]
        if f.least_ns:
            continue
        name = f"{f.kind} {c.name}"
        if c.phase_ns > plan.horizon_ns:
            first = f"{show_ns(c.phase_ns)}, after the horizon"
            yield VacuousPart("fault", name, f"cannot occur: its first release is at {first}")
        elif f.kind == "overrun" and not c.writes:
            yield VacuousPart("fault", name, "changes nothing: it publishes nothing")


def _unread_parts(system: System, replaced: Sequence[tuple[str, str]]) -> Iterator[VacuousPart]:
    """Inputs that are drawn, and replacements that publish, though nobody reads them.

    Replacements by contracts are left out: they make a test smaller, and are not meant to be read.
    """
    read = _read(system)
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        if drive.topic not in read and not read & set(topic.queues):
            yield VacuousPart(
                "input", topic.name, "is drawn for nobody: nothing in the test reads it"
            )
    for c in system.components:
        written = set(c.writes)
        queues = {q for t in written for q in system.topics[t].queues}
        of = next((p for p, by in replaced if c.node is not None and c.node.name == by), None)
        if of is None or not written or read & (written | queues) or _is_extern(system, of):
            continue
        name = f"the replacement of {of}"
        yield VacuousPart("replacement", name, "changes nothing: nobody reads what it publishes")


def _is_extern(system: System, path: str) -> bool:
    """Whether the replaced component is extern, so that it had to be replaced."""
    test = system.program.tests.get(plan_of(system).name)
    was = None if test is None else at(test, path)
    return not isinstance(was, typed.NodeSymbol) or was.extern


def _read(system: System) -> set[int]:
    """Topics that a step, a decision or a property reads."""
    topics: set[int] = set()
    for c in system.components:
        topics |= {*c.reads}
    for m in system.modules:
        topics |= {*m.reads}
        topics |= {m.scope.topics[t] for t in topic_reads(m.symbol.safe) if t in m.scope.topics}
    for p in system.properties:
        topics |= {p.scope.topics[t] for t in topic_reads(p.condition)}
    for q in plan_of(system).timed:
        roots = [e for e in (q.premise, q.condition) if e is not None]
        topics |= {q.scope.topics[t] for t in topic_reads(*roots)}
    return topics


def at(test: typed.TestSymbol, of: str) -> typed.ModuleSymbol | typed.NodeSymbol | None:
    """The module or node of that name in the system of a test, before anything is replaced."""
    what: object = test.system
    for name in of.split("."):
        if isinstance(what, typed.ModuleSymbol):
            names = {n.name.rpartition(".")[2]: n for n in what.own}
            what = names.get(name)
            continue
        instance = what.by_name.get(name) if isinstance(what, typed.SystemSymbol) else None
        what = None if instance is None else instance.what
    return what if isinstance(what, (typed.ModuleSymbol, typed.NodeSymbol)) else None
