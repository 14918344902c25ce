"""Whether a condition has one truth value whatever values it reads.

Purpose: `holds_always` first evaluates the condition over intervals, cut at the constants that it
compares with, and over small sets value by value; then, where z3 is installed, it asks that solver,
with IEEE floats, about conditions that compare values with each other.
Non-goals: what may be read and what is said of it (`explore/vacuous_tests.py`). The solver leaves
loops, arrays with indices that are read, and functions of more than one `return` undecided.
"""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from random import Random
from typing import TYPE_CHECKING, Any

from soter.language.evaluate.range_evaluation import (
    COMPARISONS,
    RangeEvaluator,
    ReadPlace,
    TooHardError,
)
from soter.language.evaluate.ranges import Range
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in, nodes, returned
from soter.language.model.types import INT_MAX, INT_MIN, FloatType, IntType
from soter.workers.interruptible_solver import ask_solver

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from soter.language.model.system import Scope

    Read = Callable[[ReadPlace], Range]


PATIENCE_MS = 1_000


@lru_cache(maxsize=1)
def _z3_module() -> Any:  # noqa: ANN401 - z3 has no types
    """The module z3; None if it is not installed."""
    try:
        import z3  # noqa: PLC0415 - an extra
    except ImportError:
        return None
    return z3


def solver_proves(
    condition: typed.TypedExpr,
    wanted: bool,
    scope: Scope,
    ranges: Mapping[ReadPlace, Range],
    period_ns: int,
) -> bool:
    """Whether z3 proves that the condition is `wanted` and never faults for values in `ranges`."""
    z3 = _z3_module()
    if z3 is None:
        return False
    try:
        terms = _Terms(z3, scope, ranges, period_ns)
        condition_term = terms.term_of(condition)
    except TooHardError:
        return False
    solver = z3.Solver()
    solver.set("timeout", PATIENCE_MS)
    solver.add(*terms.ranges)
    solver.add(z3.Or(condition_term != z3.BoolVal(wanted), *terms.faults))
    return bool(ask_solver(solver) == z3.unsat)


class _Terms:
    """Translates expressions to z3 terms; collects their faults and the ranges of all reads."""

    def __init__(
        self,
        z3: Any,  # noqa: ANN401 - it has no types
        scope: Scope,
        range_by_place: Mapping[ReadPlace, Range],
        period_ns: int,
    ) -> None:
        self.z3 = z3
        self.scope = scope
        self.range_by_place = range_by_place
        self.period_s = period_ns / 1e9
        self.sort = z3.Float64()
        self.round = z3.RNE()
        self.ranges: list[Any] = []
        self.faults: list[Any] = []
        self._known: dict[ReadPlace, Any] = {}

    def term_of(self, e: typed.TypedExpr) -> Any:  # noqa: ANN401 - a term
        """The z3 term of an expression; TooHardError if it has no translation."""
        if isinstance(e, typed.Literal):
            return self._constant_term(e.type, e.value)
        if isinstance(e, typed.ParamRead):
            return self._constant_term(e.type, self.scope.params[e.param])
        if isinstance(e, typed.PeriodRead):
            return self._constant_term(e.type, self.period_s)
        place = self._read_place(e)
        if place is not None:
            return self._read_term(place)
        if isinstance(e, typed.TypedUnary):
            return self._unary_term(e)
        if isinstance(e, typed.TypedBinary):
            return self._binary_term(e)
        if isinstance(e, typed.Conditional):
            return self.z3.If(*map(self.term_of, (e.condition, e.then, e.otherwise)))
        if isinstance(e, typed.Builtin) and e.name in {"min", "max", "abs"}:
            return self._builtin_term(e)
        if isinstance(e, typed.TypedCall):
            inner = returned(e)
            if inner is not None:
                return self.term_of(inner)
        raise TooHardError

    def _read_place(self, e: typed.TypedExpr) -> ReadPlace | None:
        if isinstance(e, typed.TopicRead):
            return ReadPlace("topic", self.scope.topics[e.topic], e.type)
        if isinstance(e, typed.TruthRead):
            return ReadPlace("truth", self.scope.plants[e.instance], e.type)
        if isinstance(e, typed.ModeRead):
            return ReadPlace("mode", self.scope.modules[e.module], e.type)
        if isinstance(e, typed.TimeRead):
            return ReadPlace("time", 0, e.type)
        if isinstance(e, typed.AgeRead):
            return ReadPlace("age", self.scope.topics[e.topic], e.type)
        if isinstance(e, typed.TypedField):
            target = self._read_place(e.target)
            if target is not None:
                return ReadPlace(target.kind, target.index, e.type, (*target.path, e.index))
        return None

    def _read_term(self, place: ReadPlace) -> Any:  # noqa: ANN401 - a term
        if place not in self._known:
            bounds = self.range_by_place.get(place)
            if bounds is None or bounds.low > bounds.high:
                raise TooHardError
            z3, name = self.z3, f"{place.kind}{place.index}{place.path}"
            if isinstance(place.type, FloatType):
                term = z3.FP(name, self.sort)
                inside = z3.And(
                    z3.fpGEQ(term, z3.FPVal(bounds.low, self.sort)),
                    z3.fpLEQ(term, z3.FPVal(bounds.high, self.sort)),
                )
                self.ranges.append(z3.Or(z3.fpIsNaN(term), inside) if bounds.nan else inside)
            elif type(place.type).__name__ == "BoolType":
                term = z3.Bool(name)
                if bounds.single:
                    self.ranges.append(term == bool(bounds.low))
            else:
                term = z3.Int(name)
                self.ranges += [term >= int(bounds.low), term <= int(bounds.high)]
            self._known[place] = term
        return self._known[place]

    def _constant_term(self, type_: object, value: Any) -> Any:  # noqa: ANN401 - a term
        if isinstance(value, bool):
            return self.z3.BoolVal(value)
        if isinstance(type_, FloatType):
            return self.z3.FPVal(float(value), self.sort)
        if isinstance(value, int):
            return self.z3.IntVal(value)
        raise TooHardError

    def _note_overflow(self, term: Any) -> Any:  # noqa: ANN401 - a term
        """Adds the fault of an int out of range to the faults, and gives the term back."""
        self.faults.append(self.z3.Or(term < INT_MIN, term > INT_MAX))
        return term

    def _unary_term(self, e: typed.TypedUnary) -> Any:  # noqa: ANN401 - a term
        a = self.term_of(e.operand)
        if e.op == "!":
            return self.z3.Not(a)
        if isinstance(e.type, FloatType):
            return self.z3.fpNeg(a)
        if isinstance(e.type, IntType):
            return self._note_overflow(-a)
        raise TooHardError

    def _binary_term(self, e: typed.TypedBinary) -> Any:  # noqa: ANN401 - a term
        z3 = self.z3
        a, b = self.term_of(e.left), self.term_of(e.right)
        if e.op in {"&&", "||"}:
            return z3.And(a, b) if e.op == "&&" else z3.Or(a, b)
        if e.op in COMPARISONS:
            return self._comparison_term(e, a, b)
        if isinstance(e.type, FloatType) and e.op in {"+", "-", "*"}:
            operation = {"+": z3.fpAdd, "-": z3.fpSub, "*": z3.fpMul}[e.op]
            return operation(self.round, a, b)
        if isinstance(e.type, IntType) and e.op in {"+", "-", "*"}:
            return self._note_overflow(a + b if e.op == "+" else a - b if e.op == "-" else a * b)
        raise TooHardError

    def _comparison_term(self, e: typed.TypedBinary, a: Any, b: Any) -> Any:  # noqa: ANN401 - terms
        z3 = self.z3
        if isinstance(e.left.type, FloatType):
            comparison = {
                "<": z3.fpLT,
                "<=": z3.fpLEQ,
                ">": z3.fpGT,
                ">=": z3.fpGEQ,
                "==": z3.fpEQ,
                "!=": z3.fpNEQ,
            }[e.op]
            return comparison(a, b)
        if e.op == "==":
            return a == b
        if e.op == "!=":
            return a != b
        return {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b}[e.op]

    def _builtin_term(self, e: typed.Builtin) -> Any:  # noqa: ANN401 - a term
        z3 = self.z3
        floats = isinstance(e.arguments[0].type, FloatType)
        a = self.term_of(e.arguments[0])
        if e.name == "abs":
            return z3.fpAbs(a) if floats else self._note_overflow(z3.If(a < 0, -a, a))
        b = self.term_of(e.arguments[1])
        if e.name == "min":
            return z3.If(z3.fpLT(b, a) if floats else b < a, b, a)
        return z3.If(z3.fpGT(b, a) if floats else b > a, b, a)


EACH_MAX = 64
"""A set of up to this many ints is tried value by value."""
BOXES_MAX = 2_048
POINTS_MAX = 512
RANDOM_POINTS = 64
"""How many random points are tried first."""
SAMPLES = 3
"""How many values of a range are tried as examples: its ends and its middle."""


def holds_always(
    condition: typed.TypedExpr,
    wanted: bool,
    scope: Scope,
    read: Read,
    period_ns: int = 0,
    values: Mapping[typed.Variable, typed.TypedExpr] | None = None,
) -> bool:
    """Whether the condition is `wanted` and never faults, whatever it reads; False if unknown.

    `values`: the locals that the condition reads, with the expressions of their values.
    """
    try:
        return _Condition(condition, wanted, scope, read, period_ns, values or {}).holds_always()
    except TooHardError:
        return False


class _Condition:
    def __init__(
        self,
        condition: typed.TypedExpr,
        wanted: bool,
        scope: Scope,
        read: Read,
        period_ns: int,
        values: Mapping[typed.Variable, typed.TypedExpr],
    ) -> None:
        self.condition = condition
        self.wanted = wanted
        self.scope = scope
        self.read = read
        self.period_ns = period_ns
        self.local_values = list(values.values())
        self.locals = {v: ReadPlace("local", i, v.type) for i, v in enumerate(values)}
        self.asked: dict[ReadPlace, Range] = {}

    def holds_always(self) -> bool:
        """Whether the condition is `wanted` everywhere: over all ranges, by boxes, or by z3."""
        judgement = self._truth_in({})
        if judgement is not None:
            return judgement
        cuts = [_parts_of_range(span, self._cut_points()) for span in self.asked.values()]
        places = list(self.asked)
        if self._fails_at_some_point(places, _random_points(cuts)):
            return False
        unknown: list[tuple[Range, ...]] = [tuple(self.asked.values())]
        if math.prod(map(len, cuts)) <= BOXES_MAX:
            unknown = []
            for box in itertools.product(*cuts):
                judgement = self._truth_in(dict(zip(places, box, strict=True)))
                if judgement is False:
                    return False
                if judgement is None:
                    unknown.append(box)
        if not unknown:
            return True
        if self._fails_at_some_point(
            places, itertools.islice(_example_points(unknown), POINTS_MAX)
        ):
            return False
        return solver_proves(self.condition, self.wanted, self.scope, self.asked, self.period_ns)

    def _fails_at_some_point(
        self, places: list[ReadPlace], points: Iterable[tuple[Range, ...]]
    ) -> bool:
        return any(
            self._truth_in(dict(zip(places, point, strict=True))) is False for point in points
        )

    def _truth_in(self, box: dict[ReadPlace, Range]) -> bool | None:
        """Whether the condition is `wanted` on all of a box; False for a fault, None if unknown."""

        def read(place: ReadPlace) -> Range:
            known = box.get(place)
            if known is None:
                known = self.asked.setdefault(place, self._range_at_place(place, read))
            return known

        evaluator = RangeEvaluator(self.scope, self.period_ns, read)
        evaluator.variables |= self.locals
        truth = evaluator.bounds(self.condition)
        if evaluator.faults.possible and box and all(r.single for r in box.values()):
            return False
        if not truth.single:
            return None
        if truth.holds(self.wanted):
            return None if evaluator.faults.possible else True
        return False

    def _range_at_place(self, place: ReadPlace, read: Callable[[ReadPlace], Range]) -> Range:
        """The range of the values at a place; for a local, it is computed from its expression."""
        if place.kind != "local":
            return self.read(place)
        evaluator = RangeEvaluator(self.scope, self.period_ns, read)
        evaluator.variables |= self.locals
        return evaluator.bounds_of_part(self.local_values[place.index], place)

    def _cut_points(self) -> list[float]:
        """The constants, and their negatives, in the condition and in functions that it calls."""
        roots: list[object] = [self.condition]
        seen: set[typed.FunSymbol] = set()
        for root in roots:
            for call in calls_in(root):
                if call.fun not in seen:
                    seen.add(call.fun)
                    roots += call.fun.body or ()
        constants: set[float] = {0}
        for node in nodes(roots):
            value = None
            if isinstance(node, typed.Literal):
                value = node.value
            elif isinstance(node, typed.ParamRead):
                value = self.scope.params.get(node.param)
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                constants |= {value, -value}
        return sorted(constants)


def _parts_of_range(span: Range, constants: list[float]) -> list[Range]:
    """The parts of a range between constants; each constant is a separate part, and so is NaN."""
    parts: list[Range] = []
    if span.nan:
        parts.append(Range(math.inf, -math.inf, nan=True))
        span = Range(span.low, span.high)
    of_ints = isinstance(span.low, int) and isinstance(span.high, int)
    if of_ints and span.high - span.low < EACH_MAX:
        return parts + [Range(i, i) for i in range(int(span.low), int(span.high) + 1)]
    low = span.low
    for number in constants:
        if of_ints and number != int(number):
            continue
        cut = int(number) if of_ints else float(number)
        if not low <= cut <= span.high:
            continue
        below = cut - 1 if of_ints else math.nextafter(cut, -math.inf)
        if low <= below:
            parts.append(Range(low, below))
        parts.append(Range(cut, cut))
        if cut == span.high:
            return parts
        low = cut + 1 if of_ints else math.nextafter(cut, math.inf)
    return [*parts, Range(low, span.high)]


def _example_points(boxes: list[tuple[Range, ...]]) -> Iterator[tuple[Range, ...]]:
    """Yields a few points of each box, made of the ends and middles of its ranges."""
    for box in boxes:
        yield from itertools.islice(
            itertools.product(*map(_sample_values, box)), SAMPLES ** len(box) * SAMPLES
        )


def _random_points(cuts: list[list[Range]]) -> Iterator[tuple[Range, ...]]:
    """Yields random points, the same ones every time; one of them decides most conditions."""
    dice = Random(0)  # noqa: S311 - no secret
    for _ in range(RANDOM_POINTS):
        yield tuple([dice.choice(_sample_values(dice.choice(parts))) for parts in cuts])


def _sample_values(span: Range) -> list[Range]:
    """The two ends and the middle of a range, each as a range of one value."""
    if span.nan or span.low > span.high:
        return [span]
    of_ints = isinstance(span.low, int) and isinstance(span.high, int)
    low, high = max(span.low, -1e300), min(span.high, 1e300)
    middle = (int(low) + int(high)) // 2 if of_ints else low / 2 + high / 2
    values = dict.fromkeys(
        (span.low, span.high, middle if span.low <= middle <= span.high else span.low)
    )
    return [Range(v, v) for v in values]
