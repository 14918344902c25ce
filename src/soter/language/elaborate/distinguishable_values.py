"""Finds what the code of a test can distinguish.

Purpose: if no step, predicate, contract or property distinguishes two values of a stand-in's topic,
a test needs to try only one of them (docs/testing.md, "Floats, lists, wide ints"). Of a part that
nobody reads, it tries any value. Of a number that is only compared with constants, it tries each
constant, one number between two neighbours, and one beyond them. For times it computes into how
many parts the grid of a test must be cut.
Non-goals: which values are published (`passes/stand_ins.py`); following values into a local, an
argument or a calculation, as all of them count as distinguished; thresholds and the greatest common
divisor (`elaborate/time_grid.py`).

Why that is enough: times of steps are the nodes of a graph; time zero is one, and stands also for
steps that cannot be late. A comparison of two times is an edge whose length is a multiple of the
greatest common divisor g. Times at which all comparisons and the order of steps hold exist if every
circle has a length of at least zero, and of more (so at least g) if one of its edges is strict. If
no circle has more than s strict edges, each of these can be made g/s shorter: then such times exist
on the grid of g/s. An observed configuration is a strict edge, too: before the end of open windows.
"""

from __future__ import annotations

import itertools
import operator
import sys
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import children, nodes, plant_code
from soter.language.model.types import FloatType, IntType

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Bound, Component, Module, Scope, System
    from soter.language.model.types import Value

    Constant = Callable[[typed.TypedExpr, Scope], Value | None]


_HOLDS = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_TURNED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
_CLOSED = (
    typed.Literal,
    typed.ParamRead,
    typed.TypedUnary,
    typed.TypedBinary,
    typed.Builtin,
    typed.TypedField,
)
"""Classes of expressions that a constant may consist of."""

Path = tuple[int, ...]
"""Indices of record fields, from the whole topic inwards; () is the whole."""
Comparison = tuple[str, int | float]
"""An operator, and the constant that a number is compared with."""
FINEST = 8
"""The most parts that a grid is cut into."""
AT_A_STEP = 2
"""Most edges of a circle that meet at the time of one step."""


@dataclass
class ReadTopic:
    """The reads of a topic: parts read as a whole, with a place, and numbers only compared."""

    whole: dict[Path, Span] = field(default_factory=dict)
    compared: dict[Path, set[Comparison]] = field(default_factory=dict)

    def place_of_whole_read(self, path: Path) -> Span | None:
        """Gives the code that reads this part, or a part around it, as a whole; or None."""
        return next((s for p, s in self.whole.items() if path[: len(p)] == p), None)


class Readers:
    """The reads of each topic in the code of a system; `constant` evaluates constant expressions.

    `heard` has the topics of which some code can tell whether, or when, they were published.
    """

    def __init__(
        self, system: System, asked: Iterable[tuple[typed.TypedExpr, Scope]], constant: Constant
    ) -> None:
        """`asked`: further conditions that the test judges, each with its scope."""
        self._constant = constant
        self.topics: dict[int, ReadTopic] = {}
        self.heard: set[int] = set()
        for m in system.modules:
            if m.symbol.ttf is None or m.symbol.safer is None:  # they may read anything then
                for topic in system.topics:
                    self._add_whole_read(topic.index, m.symbol.span)
        for c in system.components:
            self._add_reads_of_component(c)
        for m in system.modules:
            self._add_reads_of_module(m)
        for p in system.properties:
            self._add_reads((p.condition,), p.scope)
        for condition, scope in asked:
            self._add_reads((condition,), scope)
        for topic in system.topics:
            if topic.queue_of is not None:
                self._add_whole_read(topic.queue_of, topic.symbol.span)
        self._add_reads_of_contracts([c for c in system.components if c.stands_for is not None])

    def reads_of_topic(self, topic: int) -> ReadTopic:
        """Gives the reads of the topic with this index."""
        return self.topics.setdefault(topic, ReadTopic())

    def _add_whole_read(self, topic: int, span: Span) -> None:
        self.heard.add(topic)
        self.reads_of_topic(topic).whole.setdefault((), span)

    def _add_reads_of_component(self, c: Component) -> None:
        if c.node is not None and c.stands_for is None:
            node = c.node
            self._add_reads((*node.step, *(node.takeover or ()), *node.assumes), c.scope)
            self._add_reads(node.guarantees, c.scope)
            if c.extern:
                for s in node.subscribes:
                    self._add_whole_read(c.scope.topics[s.topic], s.span)
            self.heard |= {c.scope.topics[s.topic] for s in node.subscribes}
        elif c.plant is not None:
            self._add_reads(plant_code(c.plant), c.scope)
            self.heard |= {*c.reads}

    def _add_reads_of_contracts(self, stand_ins: list[Component]) -> None:
        """Adds the reads of contracts, for each stand-in that something can observe."""
        waiting = stand_ins
        while True:
            heard = [c for c in waiting if self.may_be_observed(c)]
            waiting = [c for c in waiting if c not in heard]
            if not heard:
                return
            for c in heard:
                assert c.stands_for is not None
                self._add_reads(c.stands_for.asked, c.scope)

    def may_be_observed(self, c: Component) -> bool:
        """Whether a DM, or code outside of stand-in `c`, can tell what or when `c` publishes."""
        assert c.node is not None
        outputs = {*c.writes}
        return c.module is not None or bool(outputs & self.heard)

    def _add_reads_of_module(self, m: Module) -> None:
        symbol = m.symbol
        self._add_reads(
            [e for e in (symbol.safe, symbol.ttf, symbol.safer) if e is not None], m.scope
        )
        self.heard |= {*m.reads}
        if m.acknowledgement is not None:
            self._add_whole_read(m.acknowledgement, m.symbol.span)
        if m.shield is not None:
            for topic in m.outputs:
                self._add_whole_read(topic, m.symbol.span)

    # ------------------------------------------------------------ code

    def _add_reads(self, roots: Iterable[object], scope: Scope) -> None:
        todo = list(roots)
        while todo:
            node = todo.pop()
            if isinstance(node, typed.AgeRead):
                self.heard.add(scope.topics[node.topic])
            elif isinstance(node, typed.TypedBinary) and self._note_comparison(node, scope):
                continue
            elif isinstance(node, (typed.TopicRead, typed.TypedField)):
                place = self._place_that_is_read(node, scope)
                if place is not None:
                    self.heard.add(place[0])
                    self.reads_of_topic(place[0]).whole.setdefault(place[1], node.span)
                    continue
            todo += children(node)

    def _note_comparison(self, e: typed.TypedBinary, scope: Scope) -> bool:
        """Records that `e` compares a number of a topic with a constant; returns False if not."""
        if e.op not in _HOLDS or not isinstance(e.left.type, (FloatType, IntType)):
            return False
        for read, other in ((e.left, e.right), (e.right, e.left)):
            place = self._place_that_is_read(read, scope)
            if place is None or not all(isinstance(n, _CLOSED) for n in nodes([other])):
                continue
            value = self._constant(other, scope)
            if value is None:
                return False
            self.heard.add(place[0])
            op = e.op if read is e.left else _TURNED[e.op]
            self.reads_of_topic(place[0]).compared.setdefault(place[1], set()).add((op, value))
            return True
        return False

    def _place_that_is_read(self, e: object, scope: Scope) -> tuple[int, Path] | None:
        """Gives the topic, and the path of the field, that an expression reads; or None."""
        path: list[int] = []
        while isinstance(e, typed.TypedField):
            path.append(e.index)
            e = e.target
        if not isinstance(e, typed.TopicRead):
            return None
        return scope.topics[e.topic], tuple(reversed(path))


def representative_numbers(
    compared: set[Comparison], bound: Bound | None, t: IntType | FloatType, first: Value
) -> list[int | float]:
    """Gives one number, `first` for one, for each possible combination of comparisons' results.

    All numbers lie in the set `bound`, as `first` does; None stands for a topic without a set.
    """
    constants = {c for _, c in compared}
    low: float
    high: float
    if isinstance(t, IntType):
        low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
    elif bound is None:
        least, greatest = float(min(constants)), float(max(constants))
        low = max(least - max(1.0, abs(least)), -sys.float_info.max)
        high = min(greatest + max(1.0, abs(greatest)), sys.float_info.max)
    else:
        low, high = bound.low, bound.high
    cuts = sorted({low, high, *(c for c in constants if low <= c <= high)})
    between = [_number_between(a, b, t) for a, b in itertools.pairwise(cuts)]
    by_answers: dict[tuple[bool, ...], int | float] = {}
    for number in (first, *cuts, *between):
        answers = tuple(_HOLDS[op](number, c) for op, c in compared)
        by_answers.setdefault(answers, number)
    return list(by_answers.values())


def _number_between(a: float, b: float, t: IntType | FloatType) -> float:
    """Gives a number between two others; for neighbouring ints, the lower of the two."""
    if isinstance(t, IntType):
        return (int(a) + int(b)) // 2
    return float((Fraction(a) + Fraction(b)) / 2)


@dataclass
class ReadClocks:
    """The clocks that one piece of code reads: the step of `component`, or a property if None.

    `ages`: topic indices; `now`: whether it reads `time`; `kept`: whether it reads locals with a
    time of an earlier step; `crossed`: whether it compares a clock with another. For a property
    `looks` is the number of moments that decide it, and `deadline` the kind of a timed one.
    """

    component: int | None = None
    looks: int = 1
    deadline: str = ""
    ages: set[int] = field(default_factory=set)
    now: bool = False
    kept: bool = False
    crossed: bool = False
    compared: list[Span] = field(default_factory=list)

    @property
    def clock_count(self) -> int:
        """Gives how many clocks the code reads; all its locals with times count as one clock."""
        return len(self.ages) + self.now + self.kept


def grid_part_count(system: System, watched: Sequence[ReadClocks]) -> int:
    """Gives the number of parts of a grid: the most strict edges in a circle of times."""
    late = _late_components(system)
    if not late:
        return 1
    moved = _topics_with_late_stamps(system, late)
    in_steps, looked_at, seen, from_zero, clocks = 0, 0, 0, False, 0
    for w in watched:
        free = late if w.component is None else late & {w.component}
        ages = {system.topics[t].source for t in w.ages}
        edges, moving, has_zero = _edge_and_clock_counts(w, ages, moved, free=bool(free))
        from_zero |= has_zero
        clocks += moving
        if w.component is not None:
            in_steps += edges * release_count(system, w.component)
        else:
            looks = w.looks * edges + (w.deadline in {"leadsto", "invariant"})
            looked_at, seen = max(looked_at, looks), max(seen, looks + (edges < AT_A_STEP))
    strict = in_steps + (looked_at + 2 if from_zero else seen)
    asked = any(w.deadline == "invariant" for w in watched)
    return max(strict, 2) if clocks or asked else 1


def _late_components(system: System) -> set[int]:
    assert system.test is not None
    late = {f.component for f in system.test.faults if f.kind != "skip" and f.by_ns}
    if system.test.skew_ns:
        late |= {c.index for c in system.components if c.plant is None}
    return late


def _edge_and_clock_counts(
    w: ReadClocks, ages: set[int], moved: set[int], *, free: bool
) -> tuple[int, int, bool]:
    """Gives the strict edges and moving clocks of a run of `w`'s code, and if time 0 is a node.

    `ages`: topics whose age it reads; `moved`: topics whose stamps may be late; `free`: whether the
    code itself may run late.
    """
    loose = len(ages & moved)
    loose += w.kept if free or loose else 0
    edges = 0
    if w.crossed and loose:
        edges = loose + free
    elif free:
        edges = min(loose, AT_A_STEP)
    fixed = ages - moved if free else ages & moved
    clocks = (loose if free else 0) + len(fixed) + (free and w.now)
    return edges, clocks, bool(fixed) or (free and (w.now or w.deadline == "eventually"))


def _topics_with_late_stamps(system: System, late: set[int]) -> set[int]:
    return {
        c.scope.topics[t]
        for c in system.components
        if c.index in late and c.node is not None
        for t in c.node.publishes
    }


def release_count(system: System, component: int) -> int:
    """Gives the number of a component's releases up to the horizon."""
    assert system.test is not None
    c = system.components[component]
    return max(0, (system.test.horizon_ns - c.phase_ns) // c.period_ns + 1)
