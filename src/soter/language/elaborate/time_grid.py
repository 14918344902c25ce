"""Computes the grid of times of a test from the times that its program distinguishes.

Purpose: a step that may be late happens as early as it can or at a multiple of the *quantum*
(docs/testing.md). The quantum is the declared one; else the greatest common divisor of every time
of the calendar and every time that the program compares `time` or an age with, cut into as many
parts as comparisons need that have to hold together (`distinguishable_values.py`). The
file also finds reads of time for which no such grid is enough.
Non-goals: choosing times (the explorer), costs.

A *clock* is `time`, `age(t)`, a local that only clocks and constants are put into, or a sum or
difference of clocks and constants. A clock that is compared with clocks and constants has a
*threshold*, the constant between the two. A clock that goes anywhere else (into a product, a
function, a message) is *open*: its value matters, not its place among the thresholds. A comparison
is open as well if it contains more than one time less another one: with `time + time`, say, half of
the constant would be the threshold.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from soter.language.elaborate.distinguishable_values import (
    FINEST,
    ReadClocks,
    grid_part_count,
    release_count,
)
from soter.language.model import typed
from soter.language.model.tree_walk import children, nodes
from soter.language.model.types import DurationType, IntType

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Scope, System

    CodeToRead = tuple[
        "_TimeReader", list[typed.TypedExpr | None], list[tuple[typed.TypedStmt, ...]]
    ]
    """A reader, and the expressions and bodies that share its locals."""

COMPARISONS = {"<", "<=", ">", ">=", "==", "!="}
PASSES = 8
"""Most passes over the code of a reader; locals that hand on clocks in longer chains are open."""
OFFSETS = 16
"""Most different constants that may be added to a clock in a local; with more it is open."""
MANY = 2
"""A clock that adds, or takes off, this many times or more is open if it is compared."""


class ClockTerms(NamedTuple):
    """The counts of times that a clock adds and subtracts; each count is at most `MANY`.

    `now`: how often it adds the time of the step that computes the clock, minus how often it
    subtracts it. `added`, `taken_off`: how often it adds and subtracts other times: of an earlier
    step, kept in a local, or of a measurement. So `age(t)` is (1, 0, 1).
    """

    now: int
    added: int
    taken_off: int


CONSTANT = ClockTerms(0, 0, 0)


@dataclass(frozen=True)
class TimesRead:
    """The use of time in the code and the properties of a test.

    `thresholds_ns`: times with which clocks are compared, rising; `open`: places of other uses of
    clocks. `deadlines_ns`: deadlines of properties, if thresholds exist; without thresholds, steps
    at their earliest or latest times suffice to miss a deadline that can be missed. `together`:
    into how many parts the grid is cut so that strict comparisons can hold together; `crowded`: the
    places of these comparisons, if there are more than `FINEST` parts.
    """

    thresholds_ns: tuple[int, ...]
    open: tuple[Span, ...]
    deadlines_ns: tuple[int, ...] = ()
    together: int = 1
    crowded: tuple[Span, ...] = ()


def times_read(system: System) -> TimesRead:
    """Gives the use of time in the components, decisions and properties of a test's system."""
    assert system.test is not None, f"{system.name} is no test"
    thresholds = _max_ages_read(system)
    opened: list[Span] = []
    watched: list[ReadClocks] = []
    for reader, expressions, bodies in _code_with_readers(system):
        reader.read_until_stable(expressions, bodies)
        thresholds |= reader.thresholds
        opened += reader.open
        watched.append(reader.watched)
    opened += [
        latch.span
        for m in system.modules
        if m.acknowledgement is not None and (latch := m.symbol.latch) is not None
    ]
    deadlines = sorted({t.within_ns for t in system.test.timed if t.within_ns and thresholds})
    judged = thresholds or any(t.kind == "invariant" for t in system.test.timed)
    parts = grid_part_count(system, watched) if judged else 1
    compared = [s for w in watched for s in w.compared] if parts > FINEST else []
    return TimesRead(
        tuple(sorted(thresholds)),
        _sorted_spans(opened),
        tuple(deadlines),
        parts,
        _sorted_spans(compared),
    )


def _max_ages_read(system: System) -> set[int]:
    """Gives the `max_age` of every topic that a decision module reads."""
    reads = {t for m in system.modules if m.forced is None for t in m.reads}
    return {age for t in reads if (age := system.topics[t].max_age_ns) is not None}


def _sorted_spans(spans: Iterable[Span]) -> tuple[Span, ...]:
    """Gives the spans without duplicates, ordered by file name and place."""
    places = {(s.source.name, s.start, s.end): s for s in spans}
    return tuple([places[k] for k in sorted(places)])


def quantum_of(system: System, read: TimesRead | None = None) -> int:
    """Gives the quantum of a test's grid of times, in ns.

    Between zero and the first threshold or deadline, and between two neighbours, lies at least one
    time of the grid, as a clock may be above the one and below the other. If several clocks are
    compared, the grid is cut into `TimesRead.together` parts; if these were more than `FINEST`, it
    is not cut, and no search on it may be called exhausted.
    """
    plan = system.test
    assert plan is not None, f"{system.name} is no test"
    if plan.quantum_ns:
        return plan.quantum_ns
    read = read or times_read(system)
    thresholds = (*read.thresholds_ns, *read.deadlines_ns)
    times = [
        *(t for c in system.components for t in (c.period_ns, c.phase_ns)),
        *(d.every_ns for d in system.inputs),
        *(plan.skew_ns, *thresholds),
        *(t for f in plan.faults for t in (f.by_ns, f.least_ns)),
    ]
    quantum = math.gcd(*times) or 1
    near = any(b - a <= quantum for a, b in itertools.pairwise(sorted({0, *thresholds})))
    parts = read.together if read.together <= FINEST else 1
    return quantum // _least_divisor(quantum, max(parts, 2 if near else 1))


def _least_divisor(n: int, least: int) -> int:
    """Gives the least number that divides n and is at least `least`; n if no smaller one does."""
    divisors = [k for k in range(1, math.isqrt(n) + 1) if n % k == 0]
    return min((k for d in divisors for k in (d, n // d) if k >= least), default=n)


def _code_with_readers(system: System) -> Iterator[CodeToRead]:
    """Yields the code of each component, module and property, with a reader for it."""
    yield from _code_of_components(system)
    for m in system.modules:
        decides = ReadClocks(component=m.dm)
        if m.forced is None:
            aged = [system.topics[t] for t in m.inputs if system.topics[t].max_age_ns is not None]
            decides.ages |= {t.index for t in aged}
            decides.compared += [t.symbol.span for t in aged]
        yield _TimeReader(m.scope, watched=decides), [*m.symbol.predicates], []
    for q in system.properties:
        yield _TimeReader(q.scope, watched=ReadClocks(component=q.component)), [q.condition], []
    assert system.test is not None
    for t in system.test.timed:
        ages = any(isinstance(n, typed.AgeRead) for n in nodes([t.condition]))
        every = (release_count(system, c.index) for c in system.components)
        looks = sum(every) if ages else 2 if t.kind == "leadsto" else 1
        reader = _TimeReader(t.scope, watched=ReadClocks(looks=looks, deadline=t.kind))
        yield reader, [t.premise, t.condition], []


def _code_of_components(system: System) -> Iterator[CodeToRead]:
    for c in system.components:
        reader = _TimeReader(c.scope, c.period_ns, ReadClocks(component=c.index))
        if c.node is not None:
            n = c.node
            first: tuple[typed.TypedStmt, ...] = tuple(
                typed.TypedDeclare(value.span, variable, value)
                for variable, value in zip(n.locals, n.initial, strict=True)
                if value is not None
            )
            reader.offsets |= {v: {0.0} for v in n.locals}
            reader.terms |= {v: {CONSTANT} for v in n.locals}
            contracts = [*n.assumes, *n.guarantees, *n.failsafe.values()]
            yield reader, [*contracts], [first, n.takeover or (), n.step]
        elif c.plant is not None:
            p = c.plant
            lets: tuple[typed.TypedStmt, ...] = tuple(
                typed.TypedDeclare(value.span, variable, value) for variable, value in p.lets
            )
            yield reader, [*p.der.values(), *p.next.values(), *(e for _, e in p.drives)], [lets]


class _TimeReader:
    """Finds the clocks, thresholds and open reads of one component or one predicate."""

    def __init__(self, scope: Scope, period_ns: int = 0, watched: ReadClocks | None = None) -> None:
        self.scope = scope
        self.period_ns = period_ns
        self.watched = watched or ReadClocks()
        self.clocks: set[typed.Variable] = set()
        self.others: set[typed.Variable] = set()
        """Locals that also get a value which is neither a clock nor a constant."""
        self.offsets: dict[typed.Variable, set[float]] = {}
        """Local -> the constants put into it, or added to clocks in it, in seconds."""
        self.terms: dict[typed.Variable, set[ClockTerms]] = {}
        """Local -> terms of clocks put into it; the time of that step counts as another time."""
        self.thresholds: set[int] = set()
        self.open: list[Span] = []

    def read_until_stable(
        self,
        expressions: Iterable[typed.TypedExpr | None],
        bodies: Sequence[tuple[typed.TypedStmt, ...]],
    ) -> None:
        """Reads the code repeatedly until it finds no more locals that are clocks."""
        every = [e for e in expressions if e is not None]
        for _ in range(PASSES):
            before = self._counts_of_known()
            for known in (self.thresholds, self.others, self.open):
                known.clear()
            for body in bodies:
                self._read_body(body)
            for e in every:
                self._read_as_value(e)
            if self._counts_of_known() == before:
                return
        self.open += [e.span for e in every] or [s.span for body in bodies for s in body[:1]]

    def _counts_of_known(self) -> tuple[int, int, int]:
        """Gives the counts of known clocks, constants and terms of locals, which only increase."""
        offsets = sum(map(len, self.offsets.values()))
        return len(self.clocks), offsets, sum(map(len, self.terms.values()))

    # ------------------------------------------------------------ statements

    def _read_body(self, body: Sequence[typed.TypedStmt]) -> None:
        for s in body:
            self._read_statement(s)

    def _read_statement(self, s: typed.TypedStmt) -> None:
        if isinstance(s, typed.TypedDeclare):
            self._note_assignment(s.variable, s.value)
        elif isinstance(s, typed.TypedAssign) and not s.place.path:
            self._note_assignment(s.place.variable, s.value)
        elif isinstance(s, typed.TypedIf):
            for condition, body in s.arms:
                self._read_as_value(condition)
                self._read_body(body)
            self._read_body(s.otherwise)
        elif isinstance(s, (typed.ForRange, typed.ForEach)):
            if isinstance(s, typed.ForEach):
                self._read_as_value(s.sequence)
            self._read_body(s.body)
        else:
            for part in children(s):
                self._read_within(part)

    def _note_assignment(self, variable: typed.Variable, value: typed.TypedExpr) -> None:
        if self._is_clock(value):
            self.clocks.add(variable)
            if variable in self.others:
                self.open.append(value.span)
            self._add_offsets(variable, value)
        elif self._constant_in_s(value) is not None:
            self._add_offsets(variable, value)
        else:
            self.others.add(variable)
            if variable in self.clocks:
                self.open.append(value.span)

    def _add_offsets(self, variable: typed.Variable, value: typed.TypedExpr) -> None:
        """Adds the constants and the terms of `value` to those of a local."""
        self.terms.setdefault(variable, set()).update(
            _limited_terms(0, t.added + max(t.now, 0), t.taken_off + max(-t.now, 0))
            for t in self._terms_of(value)
        )
        known = self.offsets.setdefault(variable, set())
        if len(known) < OFFSETS:
            known |= self._added_constants(value)
        else:
            self.open.append(value.span)

    def _read_within(self, part: object) -> None:
        """Reads all expressions of a part of a statement or of an expression."""
        if isinstance(part, typed.TypedExpr):
            self._read_as_value(part)
        else:
            for inner in children(part):
                self._read_within(inner)

    # ------------------------------------------------------------ expressions

    def _read_as_value(self, e: typed.TypedExpr) -> None:
        """Reads an expression whose value is used; records it as open if it is a clock."""
        if self._is_clock(e):
            self.open.append(e.span)

    def _is_clock(self, e: typed.TypedExpr) -> bool:
        """Whether `e` is a clock; also records the clocks and thresholds in its parts."""
        if isinstance(e, typed.TimeRead):
            self.watched.now = True
            return True
        if isinstance(e, typed.AgeRead):
            self.watched.ages.add(self.scope.topics[e.topic])
            return True
        if isinstance(e, typed.MarginRead):
            self.open.append(e.span)
            return False
        if isinstance(e, typed.VarRead):
            kept = e.variable in self.clocks
            self.watched.kept |= kept and e.variable.kind == "local"
            return kept
        if isinstance(e, typed.TypedBinary) and e.op in {"+", "-", *COMPARISONS}:
            clocks = self._clock_flags(e, e.left, e.right)
            return any(clocks) and self._note_comparison_or_sum(e, both=all(clocks))
        if isinstance(e, typed.Conditional):
            self._read_as_value(e.condition)
            return any(self._clock_flags(e, e.then, e.otherwise))
        for part in children(e):
            self._read_within(part)
        return False

    def _clock_flags(
        self, e: typed.TypedExpr, one: typed.TypedExpr, other: typed.TypedExpr
    ) -> list[bool]:
        """Gives which of two parts are clocks; adds `e` to `open` if a clock's partner may vary."""
        clocks = [self._is_clock(one), self._is_clock(other)]
        beside = other if clocks[0] else one
        if any(clocks) and not all(clocks) and self._constant_in_s(beside) is None:
            self.open.append(e.span)
        return clocks

    def _note_comparison_or_sum(self, e: typed.TypedBinary, *, both: bool) -> bool:
        """Notes thresholds of a sum, difference or comparison of clocks; False for a comparison."""
        self.watched.crossed |= both
        left, right = self._added_constants(e.left), self._added_constants(e.right)
        if e.op in COMPARISONS:
            self.watched.compared.append(e.span)
            for a, b in itertools.product(left, right):
                self._add_threshold(b - a)
            if any(map(_has_several_times, self._sums_of(e.left, e.right, -1))):
                self.open.append(e.span)
            return False
        for constant in left | right:
            self._add_threshold(constant)
        return True

    def _add_threshold(self, seconds: float) -> None:
        if math.isfinite(seconds):
            self.thresholds.add(round(abs(seconds) * 1e9))

    def _added_constants(self, e: typed.TypedExpr) -> set[float]:
        """Gives the constants, in s, that `e` may add to a clock; for a constant `e`, its value."""
        if isinstance(e, typed.Conditional):
            return self._added_constants(e.then) | self._added_constants(e.otherwise)
        if isinstance(e, typed.VarRead):
            return self.offsets.get(e.variable, set()) or {0.0}
        if isinstance(e, typed.TypedBinary) and e.op in {"+", "-"}:
            sign = 1.0 if e.op == "+" else -1.0
            pairs = itertools.product(self._added_constants(e.left), self._added_constants(e.right))
            off = sorted({a + sign * b for a, b in pairs})
            if len(off) > OFFSETS:
                self.open.append(e.span)
            return set(off[:OFFSETS])
        return {self._constant_in_s(e) or 0.0}

    def _terms_of(self, e: typed.TypedExpr) -> set[ClockTerms]:
        """Gives the terms that an expression may have; CONSTANT if it is no clock."""
        if isinstance(e, typed.TimeRead):
            return {ClockTerms(now=1, added=0, taken_off=0)}
        if isinstance(e, typed.AgeRead):
            return {ClockTerms(now=1, added=0, taken_off=1)}
        if isinstance(e, typed.VarRead):
            return self.terms.get(e.variable, {CONSTANT})
        if isinstance(e, typed.Conditional):
            return self._terms_of(e.then) | self._terms_of(e.otherwise)
        if isinstance(e, typed.TypedBinary) and e.op in {"+", "-"}:
            return self._sums_of(e.left, e.right, 1 if e.op == "+" else -1)
        return {CONSTANT}

    def _sums_of(self, left: typed.TypedExpr, right: typed.TypedExpr, sign: int) -> set[ClockTerms]:
        """Gives the terms of left + sign * right, `sign` being 1 or -1."""
        sums: set[ClockTerms] = set()
        for a, b in itertools.product(self._terms_of(left), self._terms_of(right)):
            added, off = (b.added, b.taken_off) if sign > 0 else (b.taken_off, b.added)
            sums.add(_limited_terms(a.now + sign * b.now, a.added + added, a.taken_off + off))
        return sums

    def _constant_in_s(self, e: typed.TypedExpr) -> float | None:
        """Gives the value of a constant expression, with durations in seconds; else None."""
        if isinstance(e, (typed.Literal, typed.ParamRead)):
            value = e.value if isinstance(e, typed.Literal) else self.scope.params.get(e.param)
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                return None
            return value / 1e9 if isinstance(e.type, DurationType) else float(value)
        if isinstance(e, typed.PeriodRead):
            return self.period_ns / 1e9
        if isinstance(e, typed.Builtin) and e.name in {"seconds", "float"}:
            return self._constant_in_s(e.arguments[0])
        if isinstance(e, typed.TypedUnary) and e.op == "-":
            value = self._constant_in_s(e.operand)
            return None if value is None else -value
        if isinstance(e, typed.TypedBinary) and e.op in {"+", "-", "*", "/"}:
            return self._computed_constant(e)
        return None

    def _computed_constant(self, e: typed.TypedBinary) -> float | None:
        left, right = self._constant_in_s(e.left), self._constant_in_s(e.right)
        if left is None or right is None:
            return None
        if e.op == "+":
            return left + right
        if e.op == "-":
            return left - right
        if e.op == "*":
            return left * right
        return _quotient(e, left, right) if right else None


def _quotient(e: typed.TypedBinary, left: float, right: float) -> float:
    """Gives the quotient as the language computes it: ints and durations are truncated."""
    if isinstance(e.type, DurationType):
        return math.trunc(round(left * 1e9) / right) / 1e9
    return float(math.trunc(left / right)) if isinstance(e.type, IntType) else left / right


def _limited_terms(now: int, added: int, taken_off: int) -> ClockTerms:
    """Gives the terms with counts limited to `MANY`, so that few different terms exist."""
    return ClockTerms(max(-MANY, min(now, MANY)), min(added, MANY), min(taken_off, MANY))


def _has_several_times(terms: ClockTerms) -> bool:
    """Whether a clock adds more than one time, or subtracts more than one."""
    return terms.added + max(terms.now, 0) >= MANY or terms.taken_off + max(-terms.now, 0) >= MANY
