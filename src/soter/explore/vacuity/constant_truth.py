"""Whether a condition has one truth value whatever is read.

Purpose: `holds_always`: intervals first, cut at the constants that the condition compares with and
small sets value by value; then a solver, where it is installed (`solver.py`).
Non-goals: what may be read (`value_domains.py`), what is said of it (`vacuous_tests.py`).
"""

from __future__ import annotations

import itertools
import math
from random import Random
from typing import TYPE_CHECKING

from soter.explore.vacuity.solver import solved
from soter.language.evaluate.range_evaluation import RangeEvaluator, ReadPlace, TooHardError
from soter.language.evaluate.ranges import Range
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in, nodes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from soter.language.model.system import Scope

    Read = Callable[[ReadPlace], Range]

EACH_MAX = 64
"""A set of at most so many ints is looked at value by value."""
BOXES_MAX = 2_048
POINTS_MAX = 512
DRAWN = 64
"""Points that are tried first."""
FEW = 3
"""Numbers of an open part that are tried as examples."""


def holds_always(
    condition: typed.TypedExpr,
    wanted: bool,
    scope: Scope,
    read: Read,
    period_ns: int = 0,
    given: Mapping[typed.Variable, typed.TypedExpr] | None = None,
) -> bool:
    """Whether it is `wanted`, and does not fault, for all values; False where that is not known.

    `given`: locals that it reads, and what may be in them.
    """
    try:
        return _Condition(condition, wanted, scope, read, period_ns, given or {}).decided()
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
        given: Mapping[typed.Variable, typed.TypedExpr],
    ) -> None:
        self.condition = condition
        self.wanted = wanted
        self.scope = scope
        self.read = read
        self.period_ns = period_ns
        self.given = list(given.values())
        self.locals = {v: ReadPlace("local", i, v.type) for i, v in enumerate(given)}
        self.asked: dict[ReadPlace, Range] = {}

    def decided(self) -> bool:
        """All values at once, then box by box, then by the solver."""
        judgement = self._judged({})
        if judgement is not None:
            return judgement
        cuts = [_parts(r, self._constants()) for r in self.asked.values()]
        places = list(self.asked)
        if self._fails_at_some(places, _drawn(cuts)):
            return False
        unknown: list[tuple[Range, ...]] = [tuple(self.asked.values())]
        if math.prod(map(len, cuts)) <= BOXES_MAX:
            unknown = []
            for box in itertools.product(*cuts):
                judgement = self._judged(dict(zip(places, box, strict=True)))
                if judgement is False:
                    return False
                if judgement is None:
                    unknown.append(box)
        if not unknown:
            return True
        if self._fails_at_some(places, itertools.islice(_examples(unknown), POINTS_MAX)):
            return False
        return solved(self.condition, self.wanted, self.scope, self.asked, self.period_ns)

    def _fails_at_some(self, places: list[ReadPlace], points: Iterable[tuple[Range, ...]]) -> bool:
        return any(self._judged(dict(zip(places, point, strict=True))) is False for point in points)

    def _judged(self, box: dict[ReadPlace, Range]) -> bool | None:
        """True: as wanted in all of the box; False: not at all, or it faults; None: not known."""

        def read(place: ReadPlace) -> Range:
            known = box.get(place)
            if known is None:
                known = self.asked.setdefault(place, self._range(place, read))
            return known

        evaluator = RangeEvaluator(self.scope, self.period_ns, read)
        evaluator.variables |= self.locals
        truth = evaluator.number(self.condition)
        if evaluator.faults.possible and box and all(r.single for r in box.values()):
            return False
        if not truth.single:
            return None
        if truth.has(self.wanted):
            return None if evaluator.faults.possible else True
        return False

    def _range(self, place: ReadPlace, read: Callable[[ReadPlace], Range]) -> Range:
        """Of what is read, or of a local."""
        if place.kind != "local":
            return self.read(place)
        evaluator = RangeEvaluator(self.scope, self.period_ns, read)
        evaluator.variables |= self.locals
        return evaluator.part(self.given[place.index], place)

    def _constants(self) -> list[float]:
        """Numbers that it, or a function that it calls, is written with."""
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


def _parts(r: Range, constants: list[float]) -> list[Range]:
    """A range cut at constants: each of them, and what lies between; NaN by itself."""
    parts: list[Range] = []
    if r.nan:
        parts.append(Range(math.inf, -math.inf, nan=True))
        r = Range(r.low, r.high)
    whole = isinstance(r.low, int) and isinstance(r.high, int)
    if whole and r.high - r.low < EACH_MAX:
        return parts + [Range(i, i) for i in range(int(r.low), int(r.high) + 1)]
    at = r.low
    for number in constants:
        if whole and number != int(number):
            continue
        c = int(number) if whole else float(number)
        if not at <= c <= r.high:
            continue
        below = c - 1 if whole else math.nextafter(c, -math.inf)
        if at <= below:
            parts.append(Range(at, below))
        parts.append(Range(c, c))
        if c == r.high:
            return parts
        at = c + 1 if whole else math.nextafter(c, math.inf)
    return [*parts, Range(at, r.high)]


def _examples(boxes: list[tuple[Range, ...]]) -> Iterator[tuple[Range, ...]]:
    """Some points of each box."""
    for box in boxes:
        yield from itertools.islice(itertools.product(*map(_some, box)), FEW ** len(box) * FEW)


def _drawn(cuts: list[list[Range]]) -> Iterator[tuple[Range, ...]]:
    """Points by chance, the same every time: of most conditions one of them is enough."""
    dice = Random(0)  # noqa: S311 - no secret
    for _ in range(DRAWN):
        yield tuple([dice.choice(_some(dice.choice(parts))) for parts in cuts])


def _some(r: Range) -> list[Range]:
    if r.nan or r.low > r.high:
        return [r]
    whole = isinstance(r.low, int) and isinstance(r.high, int)
    low, high = max(r.low, -1e300), min(r.high, 1e300)
    middle = (int(low) + int(high)) // 2 if whole else low / 2 + high / 2
    values = dict.fromkeys((r.low, r.high, middle if r.low <= middle <= r.high else r.low))
    return [Range(v, v) for v in values]
