"""The grid of times of a test, and the times that its program tells apart.

Purpose: where a step may be late, it happens as early as it can or at a multiple of the *quantum*
(docs/testing.md). As declared; else the greatest common divisor of every time of the calendar and
of every time that the program compares `time` or an age with, half of it where nothing would lie
between two of these, so that no single comparison is decided by the grid; and which readings of
time no such grid does justice to.
Non-goals: choosing times (the explorer), costs.

A *clock* is `time`, `age(t)`, a local that only clocks and constants are put into, or a sum or
difference of clocks and constants. A clock that is compared with clocks and constants has a
*threshold*, the constant between the two. A clock that goes anywhere else (into a product, a
function, a message) is *open*: its value matters, not its place among the thresholds.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.program.model import typed
from soter.program.model.types import DurationType
from soter.program.model.walk import children

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.diagnostics.span import Span
    from soter.program.model.system import Scope, System

COMPARISONS = {"<", "<=", ">", ">=", "==", "!="}
PASSES = 8
"""Locals that get a clock from one another, so many deep; deeper ones are open."""
OFFSETS = 16
"""Constants that one clock may be off by; with more it is open."""


@dataclass(frozen=True)
class TimesRead:
    """What the code and the properties of a test make of time.

    `thresholds_ns`: times that clocks are compared with, rising; `open`: where a clock is read
    otherwise.
    """

    thresholds_ns: tuple[int, ...]
    open: tuple[Span, ...]


def times_read(system: System) -> TimesRead:
    """Of every component, decision and property of a flattened test."""
    assert system.test is not None, f"{system.name} is no test"
    found = {
        age
        for m in system.modules
        if m.forced is None
        for age in (system.topics[t].max_age_ns for t in m.inputs)
        if age is not None
    }
    opened: dict[tuple[str, int, int], Span] = {}
    for reader, expressions, bodies in _texts(system):
        reader.run(expressions, bodies)
        found |= reader.thresholds
        opened |= {(s.source.name, s.start, s.end): s for s in reader.open}
    return TimesRead(tuple(sorted(found)), tuple(opened[k] for k in sorted(opened)))


def quantum_of(system: System, read: TimesRead | None = None) -> int:
    """The grid of times in ns.

    Between zero and the first threshold, and between two that follow each other, lies at least one
    of its times: a clock may be above the one and below the other. Where several clocks have to lie
    strictly between thresholds and strictly apart from each other, a finer grid may be needed: the
    grid stands beside every verdict.
    """
    plan = system.test
    assert plan is not None, f"{system.name} is no test"
    if plan.quantum_ns:
        return plan.quantum_ns
    thresholds = (read or times_read(system)).thresholds_ns
    times = [t for c in system.components for t in (c.period_ns, c.phase_ns)]
    times += [d.every_ns for d in system.inputs]
    times += [plan.skew_ns, *(f.by_ns for f in plan.faults), *thresholds]
    quantum = math.gcd(*times) or 1
    apart = itertools.pairwise(sorted({0, *thresholds}))
    near = any(b - a <= quantum for a, b in apart)
    return quantum // 2 if near and quantum % 2 == 0 else quantum


def _texts(
    system: System,
) -> Iterator[tuple[_Reader, list[typed.Expr | None], list[tuple[typed.Stmt, ...]]]]:
    """Everything that runs: expressions and bodies that share locals, each with its reader."""
    plan = system.test
    assert plan is not None
    for c in system.components:
        reader = _Reader(c.scope, c.period_ns)
        if c.node is not None:
            n = c.node
            first: tuple[typed.Stmt, ...] = tuple(
                typed.Declare(value.span, variable, value)
                for variable, value in zip(n.locals, n.initial, strict=True)
                if value is not None
            )
            reader.offsets |= {v: {0.0} for v in n.locals}
            contracts = [*n.assumes, *n.guarantees, *n.failsafe.values()]
            yield reader, [*contracts], [first, n.takeover or (), n.step]
        elif c.plant is not None:
            p = c.plant
            lets: tuple[typed.Stmt, ...] = tuple(
                typed.Declare(value.span, variable, value) for variable, value in p.lets
            )
            yield reader, [*p.der.values(), *p.next.values(), *(e for _, e in p.drives)], [lets]
    for m in system.modules:
        yield _Reader(m.scope), [*m.symbol.predicates], []
    for q in system.properties:
        yield _Reader(q.scope), [q.condition], []
    for t in plan.timed:
        yield _Reader(t.scope), [t.premise, t.condition], []


class _Reader:
    """Of one component, or of one predicate."""

    def __init__(self, scope: Scope, period_ns: int = 0) -> None:
        self.scope = scope
        self.period_ns = period_ns
        self.clocks: set[typed.Variable] = set()
        self.others: set[typed.Variable] = set()
        """Locals that something is put into that is neither a clock nor a constant."""
        self.offsets: dict[typed.Variable, set[float]] = {}
        """Of locals: the constants, and by what the clocks in them are off, in seconds."""
        self.thresholds: set[int] = set()
        self.open: list[Span] = []

    def run(
        self,
        expressions: Iterable[typed.Expr | None],
        bodies: Sequence[tuple[typed.Stmt, ...]],
    ) -> None:
        """Read all of it, until no more locals turn out to be clocks."""
        every = [e for e in expressions if e is not None]
        for _ in range(PASSES):
            before = self._known()
            for known in (self.thresholds, self.others, self.open):
                known.clear()
            for body in bodies:
                self._body(body)
            for e in every:
                self._plain(e)
            if self._known() == before:
                return
        self.open += [e.span for e in every] or [s.span for body in bodies for s in body[:1]]

    def _known(self) -> tuple[int, int]:
        return len(self.clocks), sum(map(len, self.offsets.values()))

    # ------------------------------------------------------------ statements

    def _body(self, body: Sequence[typed.Stmt]) -> None:
        for s in body:
            self._statement(s)

    def _statement(self, s: typed.Stmt) -> None:
        if isinstance(s, typed.Declare):
            self._put(s.variable, s.value)
        elif isinstance(s, typed.Assign) and not s.place.path:
            self._put(s.place.variable, s.value)
        elif isinstance(s, typed.If):
            for condition, body in s.arms:
                self._plain(condition)
                self._body(body)
            self._body(s.otherwise)
        elif isinstance(s, (typed.ForRange, typed.ForEach)):
            if isinstance(s, typed.ForEach):
                self._plain(s.sequence)
            self._body(s.body)
        else:
            for part in children(s):
                self._parts(part)

    def _put(self, variable: typed.Variable, value: typed.Expr) -> None:
        if self._is_clock(value):
            self.clocks.add(variable)
            if variable in self.others:
                self.open.append(value.span)
            self._off(variable, value)
        elif self._constant(value) is not None:
            self._off(variable, value)
        else:
            self.others.add(variable)
            if variable in self.clocks:
                self.open.append(value.span)

    def _off(self, variable: typed.Variable, value: typed.Expr) -> None:
        """What is put into a local adds to what it may be off by."""
        known = self.offsets.setdefault(variable, set())
        if len(known) < OFFSETS:
            known |= self._offset(value)
        else:
            self.open.append(value.span)

    def _parts(self, part: object) -> None:
        if isinstance(part, typed.Expr):
            self._plain(part)
        else:
            for inner in children(part):
                self._parts(inner)

    # ------------------------------------------------------------ expressions

    def _plain(self, e: typed.Expr) -> None:
        """Where only a value will do: a clock is open here."""
        if self._is_clock(e):
            self.open.append(e.span)

    def _is_clock(self, e: typed.Expr) -> bool:
        """Whether it is a clock; what it holds besides is read."""
        if isinstance(e, (typed.TimeRead, typed.AgeRead)):
            return True
        if isinstance(e, typed.VarRead):
            return e.variable in self.clocks
        if isinstance(e, typed.Binary) and e.op in {"+", "-", *COMPARISONS}:
            clocks = [self._is_clock(x) for x in (e.left, e.right)]
            if any(clocks):
                return self._combined(e, clocks)
            return False
        if isinstance(e, typed.Conditional):
            self._plain(e.condition)
            clocks = [self._is_clock(x) for x in (e.then, e.otherwise)]
            other = e.otherwise if clocks[0] else e.then
            if any(clocks) and not all(clocks) and self._constant(other) is None:
                self.open.append(e.span)
            return any(clocks)
        for part in children(e):
            self._parts(part)
        return False

    def _combined(self, e: typed.Binary, clocks: list[bool]) -> bool:
        """A sum, a difference or a comparison with a clock in it."""
        if not all(clocks) and self._constant(e.right if clocks[0] else e.left) is None:
            self.open.append(e.span)
        left, right = self._offset(e.left), self._offset(e.right)
        if e.op in COMPARISONS:
            for a, b in itertools.product(left, right):
                self._threshold(b - a)
            return False
        for constant in left | right:
            self._threshold(constant)
        return True

    def _threshold(self, seconds: float) -> None:
        if math.isfinite(seconds):
            self.thresholds.add(round(abs(seconds) * 1e9))

    def _offset(self, e: typed.Expr) -> set[float]:
        """By what a clock may be off, or the constant itself, in seconds."""
        if isinstance(e, typed.Conditional):
            return self._offset(e.then) | self._offset(e.otherwise)
        if isinstance(e, typed.VarRead):
            return self.offsets.get(e.variable, set()) or {0.0}
        if isinstance(e, typed.Binary) and e.op in {"+", "-"}:
            sign = 1.0 if e.op == "+" else -1.0
            pairs = itertools.product(self._offset(e.left), self._offset(e.right))
            off = sorted({a + sign * b for a, b in pairs})
            if len(off) > OFFSETS:
                self.open.append(e.span)
            return set(off[:OFFSETS])
        return {self._constant(e) or 0.0}

    def _constant(self, e: typed.Expr) -> float | None:
        """Its value, durations in seconds; None where it is no constant."""
        if isinstance(e, (typed.Literal, typed.ParamRead)):
            value = e.value if isinstance(e, typed.Literal) else self.scope.params.get(e.param)
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                return None
            return value / 1e9 if isinstance(e.type, DurationType) else float(value)
        if isinstance(e, typed.PeriodRead):
            return self.period_ns / 1e9
        if isinstance(e, typed.Builtin) and e.name in {"seconds", "float"}:
            return self._constant(e.arguments[0])
        if isinstance(e, typed.Unary) and e.op == "-":
            value = self._constant(e.operand)
            return None if value is None else -value
        if isinstance(e, typed.Binary) and e.op in {"+", "-", "*", "/"}:
            return self._folded(e)
        return None

    def _folded(self, e: typed.Binary) -> float | None:
        left, right = self._constant(e.left), self._constant(e.right)
        if left is None or right is None:
            return None
        if e.op == "+":
            return left + right
        if e.op == "-":
            return left - right
        if e.op == "*":
            return left * right
        return left / right if right else None
