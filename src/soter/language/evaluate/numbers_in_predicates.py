"""Numbers in predicates: operands that may be NaN, and limits that they set to signals.

Purpose: which operands are numbers in every step of the DM is decided once, from declared sets and
types, for C, proofs and the re-checker; where none may be NaN nothing is looked at. And for
reports: `abs(motion.x) < WALL`, also inside of functions that only return it, as two levels of the
signal `motion.x`.
Non-goals: what a NaN means (`predicates.py`); conditions on the way, which refine nothing; limits
of several signals together, so that a report without a limit says nothing.

Topics hold finite numbers in their sets, as the gate refuses all else; of extern functions nothing
is known. Functions of the prelude are told by the domains of `function_error_bounds.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates import compared_operands, conjuncts, has_nan, returned
from soter.language.evaluate.range_evaluation import (
    ELEMENTS,
    UNKNOWN,
    RangeEvaluator,
    ReadPlace,
    TooHardError,
    anything,
)
from soter.language.evaluate.ranges import ANY_FLOAT, INF, Range
from soter.language.evaluate.statements import Evaluator
from soter.language.evaluate.topic_ranges import MOST, published
from soter.language.model import typed
from soter.language.model import typed as t
from soter.language.model.tree_walk import nodes
from soter.language.model.types import (
    ArrayType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    has_list,
    leaf_count,
    leaf_name,
)
from soter.language.prelude.function_error_bounds import BOUNDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.evaluate.range_evaluation import Known
    from soter.language.model.system import Module, Scope, System
    from soter.language.model.types import Type


BUDGET = 20_000
TURNS = 3
"""Of a loop; what still changes then may be anything of its type, and changes no more."""
TIMES = Range(0.0, 1e10)
"""Seconds that 64 bits of nanoseconds hold."""
TOTAL = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "tanh", "hypot"),
    *("wrap_angle", "sign"),
}
"""Functions of the prelude that give a number for all numbers of their domain; `pow` of x >= 0."""


def maybe_nan(system: System, module: Module, *more: t.TypedExpr) -> frozenset[t.TypedExpr]:
    """Operands in `ttf`, `safer` and `progress` of a module, and in what they call.

    And in `more`, made of these. One set for all, so that a function is one wherever it is called.
    """
    symbol = module.symbol
    found: set[t.TypedExpr] = set()
    for predicate in (symbol.ttf, symbol.safer, *symbol.verify.progress, *more):
        if predicate is None:
            continue
        looking = _Looking(system, module)
        try:
            looking.evaluate(predicate)
            found |= looking.found
        except TooHardError:
            found |= all_operands(predicate)
    return frozenset(found)


def operands_in(fun: t.FunSymbol) -> set[t.TypedExpr]:
    """All that a function of the program compares, itself or in what it calls."""
    return set() if fun.prelude else all_operands(*(fun.body or ()))


def all_operands(*roots: object) -> set[t.TypedExpr]:
    """Whatever is compared in some code, and in what it calls, but for the prelude and numbers."""
    found: set[t.TypedExpr] = set()
    todo, seen = list(roots), set()
    while todo:
        for n in nodes([todo.pop()]):
            if isinstance(n, t.TypedExpr):
                found |= {e for e in compared_operands(n) if not _is_number(e)}
            if isinstance(n, t.TypedCall) and n.fun not in seen and not n.fun.prelude:
                seen.add(n.fun)
                todo += n.fun.body or ()
    return found


def _is_number(e: t.TypedExpr) -> bool:
    return isinstance(e, t.Literal) and not has_nan(e.value)


class _Looking(RangeEvaluator):
    """Ranges of all that is evaluated; `found` fills with compared operands that may be NaN."""

    def __init__(self, system: System, module: Module) -> None:
        super().__init__(module.scope, module.period_ns, lambda place: _read(system, place))
        self.system = system
        self.left = BUDGET
        self.compared: set[t.TypedExpr] = set()
        self.found: set[t.TypedExpr] = set()

    def evaluate(self, e: t.TypedExpr) -> Known:
        """As `RangeEvaluator` says."""
        known = super().evaluate(e)
        if e in self.compared and any(r.nan for r in self._flat(known, e.type)):
            self.found.add(e)
        return known

    def _comparing(self, e: Any) -> Known:  # noqa: ANN401 - a binary or a builtin operation
        self.compared |= set(compared_operands(e))
        return RangeEvaluator.EXPRESSIONS[type(e)](self, e)

    # ------------------------------------------------------------ calls

    def _call(self, e: t.TypedCall) -> Known:
        if e.fun.body is not None and not e.fun.prelude:
            return super()._call(e)
        given = [self.evaluate(a) for a in e.arguments]
        if e.fun.body is None:
            return anything(e.type)
        if e.fun.name in TOTAL or e.fun.name == "pow":
            arguments = [self._scalar(g, a.type) for g, a in zip(given, e.arguments, strict=True)]
            return _of_prelude(e.fun.name, arguments)
        outside, self.variables = self.variables, dict(zip(e.fun.parameters, given, strict=True))
        compared, found, self.compared, self.found = self.compared, self.found, set(), set()
        try:
            returned, _ = self._run(e.fun.body, None, e.type)
        finally:
            self.variables, self.compared, self.found = outside, compared, found
        return anything(e.type) if returned is None else returned

    # ------------------------------------------------------------ arrays and lists

    def _literal(self, e: t.Literal) -> Known:
        if leaf_count(e.type) <= ELEMENTS:
            return super()._literal(e)
        return UNKNOWN

    def _index(self, e: t.Index) -> Known:
        target = e.target
        if isinstance(target, t.Literal) and isinstance(e.type, FloatType):
            self.number(e.index)
            return self._row_of(target)
        known, of = self.evaluate(target), target.type
        long = isinstance(of, ListType) or (isinstance(of, ArrayType) and of.size > ELEMENTS)
        if long and isinstance(known, ReadPlace) and known.kind == "topic":
            self.number(e.index)
            return _finite(e.type)
        return super()._index(e)

    def _row_of(self, table: t.Literal) -> Range:
        known = self._literals.get(table)
        if known is None:
            values = [float(v) for v in table.value]
            clear = not any(math.isnan(v) for v in values) and values
            known = Range(min(values), max(values)) if clear else ANY_FLOAT
            self._literals[table] = known
        return known

    def _length(self, e: t.TypedLength) -> Known:
        if isinstance(e.target.type, ListType):
            self.evaluate(e.target)
        return super()._length(e)

    def _plain(self, s: t.TypedStmt) -> bool:
        if not isinstance(s, (t.TypedAssign, t.TypedPush)):
            return super()._plain(s)
        variable, path = s.place.variable, s.place.path
        steps = [Range(k, k) if isinstance(k, int) else self.number(k) for k in path]
        value = self.evaluate(s.value)
        if isinstance(s, t.TypedAssign):
            old = self.variables.get(variable, UNKNOWN)
            self.variables[variable] = self._put(old, variable.type, steps, value)
        else:
            self.variables[variable] = anything(variable.type)
        return True

    def _put(self, old: Known, of: Type, steps: list[Range], value: Known) -> Known:
        """A value of which a part, at one of these places, is another one."""
        if not steps:
            return value
        (at, *rest), parts = steps, []
        if isinstance(of, ListType):
            return UNKNOWN
        for k, (part, t_) in enumerate(self._parts(old, of)):
            if not at.has(k):
                parts.append(part)
                continue
            new = self._put(part, t_, rest, value)
            parts.append(new if at.single else self._joined(part, new, t_))
        return tuple(parts)

    def _loop(self, s: t.ForRange | t.ForEach, returned: Known, of: Type) -> tuple[Known, bool]:
        """All rounds at once: what holds before each of them, found by going round."""
        if isinstance(s, t.ForRange):
            item: Known = Range(s.low, s.high - 1)
            if s.high <= s.low:
                return returned, True
        else:
            item = self._element(self.evaluate(s.sequence), s.sequence.type)
        turns = 0
        while True:
            before = dict(self.variables)
            self.variables[s.variable] = item
            returned, falls = self._run(s.body, returned, of)
            after = self._merged([before, *([self.variables] if falls else [])], before)
            if after == before:
                self.variables = before
                return returned, True
            turns += 1
            if turns >= TURNS:
                after = {v: k if k == before[v] else anything(v.type) for v, k in after.items()}
            self.variables = after

    def _element(self, whole: Known, of: Type) -> Known:
        """What the elements of an array or a list may be."""
        assert isinstance(of, (ArrayType, ListType))
        if isinstance(whole, ReadPlace) and whole.kind == "topic":
            return _finite(of.element)
        if not isinstance(whole, tuple) or not whole or isinstance(of, ListType):
            return anything(of.element)
        union = whole[0]
        for part in whole[1:]:
            union = self._joined(union, part, of.element)
        return union

    EXPRESSIONS: ClassVar[dict[type[t.TypedExpr], Callable[[Any, Any], Known]]] = {
        **RangeEvaluator.EXPRESSIONS,
        t.TypedBinary: _comparing,
        t.Builtin: _comparing,
        t.TypedCall: _call,
        t.Literal: _literal,
        t.Index: _index,
        t.TypedLength: _length,
    }


def _read(system: System, place: ReadPlace) -> Range:
    """What may be read there: finite numbers, of a topic of its set."""
    if place.kind == "topic" and not has_list(system.topics[place.index].type):
        return published(system.topics[place.index], place)
    if place.kind in ("time", "age", "margin"):
        return TIMES
    known = anything(place.type) if place.kind == "truth" else _finite(place.type)
    if not isinstance(known, Range):
        raise TooHardError
    return known


def _of_prelude(name: str, arguments: list[Range]) -> Range:
    """What a function gives that is a number for all numbers of its domain."""
    bound = BOUNDS[name]
    domain = ((0.0, INF), bound.domain[1]) if name == "pow" else bound.domain
    inside = all(
        low <= a.low and a.high <= high and not a.nan
        for a, (low, high) in zip(arguments, domain, strict=True)
    )
    return Range(*bound.values, nan=not inside)


def _finite(of: Type) -> Known:
    """All values of a type that a topic may have."""
    if isinstance(of, FloatType):
        return Range(-MOST, MOST)
    if isinstance(of, RecordType) and of.scalars <= ELEMENTS:
        return tuple([_finite(f) for _, f in of.fields])
    if isinstance(of, ArrayType) and of.size <= ELEMENTS:
        return (_finite(of.element),) * of.size
    return anything(of)


BELOW, ABOVE = {"<", "<="}, {">", ">="}
OPENED_MAX = 8
"""Functions inside functions that are opened."""


@dataclass(frozen=True)
class Limit:
    """`signal` (`motion.x`, `c.x`) may not pass `value`; `by` says who demands it."""

    signal: str
    value: float
    by: str


@dataclass(frozen=True)
class _ScaledSignal:
    """`scale * signal + offset`, or with `folded` of the amount of the signal."""

    signal: str
    scale: float
    offset: float
    folded: bool = False


def limits(system: System) -> list[Limit]:
    """The limits of every module's `safe` and of every property `always`, each once."""
    unique_limits: dict[Limit, None] = {}
    for m in system.modules:
        for limit in _LimitReader(system, m.scope).limits(m.symbol.safe, f"safe of {m.name}"):
            unique_limits[limit] = None
    for p in system.properties:
        if p.kind == "always":
            for limit in _LimitReader(system, p.scope).limits(p.condition, "always"):
                unique_limits[limit] = None
    return list(unique_limits)


class _LimitReader:
    """Reads bounds off predicates of one scope."""

    def __init__(self, system: System, scope: Scope) -> None:
        self.system = system
        self.scope = scope
        self.evaluator = Evaluator.of(scope)

    def limits(self, predicate: typed.TypedExpr, by: str) -> Iterator[Limit]:
        """The limits of single signals among the parts of a predicate."""
        for part in conjuncts(_opened(predicate)):
            opened = _opened(part)
            parts = conjuncts(opened) if opened is not part else [part]
            for each in parts:
                if isinstance(each, typed.TypedBinary) and each.op in BELOW | ABOVE:
                    yield from self._comparison(each, by)

    def _comparison(self, e: typed.TypedBinary, by: str) -> Iterator[Limit]:
        left, right = self._line(e.left), self._line(e.right)
        if left is None or right is None or bool(left.signal) == bool(right.signal):
            return
        line, constant = (left, right.offset) if left.signal else (right, left.offset)
        below = (e.op in BELOW) == bool(left.signal)
        if not line.scale:
            return
        value = (constant - line.offset) / line.scale
        if not line.folded:
            yield Limit(line.signal, value, by)
        elif below == (line.scale > 0) and value >= 0:
            yield Limit(line.signal, -value, by)
            yield Limit(line.signal, value, by)

    def _line(self, e: typed.TypedExpr) -> _ScaledSignal | None:
        """A side of a comparison as a line over one signal; over none where it is constant."""
        e = _opened(e)
        constant = self._constant(e)
        if constant is not None:
            return _ScaledSignal("", 0.0, constant)
        signal = self._signal(e)
        if signal is not None:
            return _ScaledSignal(signal, 1.0, 0.0)
        if isinstance(e, typed.TypedUnary) and e.op == "-":
            return _scaled(self._line(e.operand), -1.0)
        if isinstance(e, typed.Builtin) and e.name == "abs":
            inner = self._line(e.arguments[0])
            plain = inner is not None and not inner.folded and inner.offset == 0.0
            return (
                _ScaledSignal(inner.signal, abs(inner.scale), 0.0, True)
                if inner and plain
                else None
            )
        if isinstance(e, typed.TypedBinary) and e.op in {"+", "-", "*"}:
            return self._combined(e)
        return None

    def _combined(self, e: typed.TypedBinary) -> _ScaledSignal | None:
        left, right = self._line(e.left), self._line(e.right)
        if left is None or right is None or (left.signal and right.signal):
            return None
        if e.op == "*":
            line, factor = (left, right.offset) if left.signal else (right, left.offset)
            return _scaled(line, factor)
        right = right if e.op == "+" else _scaled(right, -1.0)
        assert right is not None
        line, other = (left, right) if left.signal else (right, left)
        return _ScaledSignal(line.signal, line.scale, line.offset + other.offset, line.folded)

    def _constant(self, e: typed.TypedExpr) -> float | None:
        """The value of an expression that reads nothing but parameters."""
        fixed = (
            typed.Literal, typed.ParamRead, typed.TypedUnary, typed.TypedBinary, typed.Builtin,
            typed.TypedField, typed.Index, typed.TypedLength, typed.Conditional, typed.Narrow,
        )  # fmt: skip
        number = isinstance(e.type, (FloatType, IntType))
        if not number or not all(isinstance(n, fixed) for n in nodes([e])):
            return None
        try:
            return float(self.evaluator.expression(e)(Environment()))
        except StepFault:
            return None

    def _signal(self, e: typed.TypedExpr) -> str | None:
        """The name of a leaf of a topic or of the truth of a plant, as reports call it."""
        path: list[str] = []
        while isinstance(e, (typed.TypedField, typed.Index)):
            if isinstance(e, typed.TypedField):
                assert isinstance(e.target.type, RecordType)
                path.insert(0, e.target.type.fields[e.index][0])
            elif isinstance(e.index, typed.Literal):
                path.insert(0, f"[{e.index.value}]")
            else:
                return None
            e = e.target
        if isinstance(e, typed.TopicRead):
            root = self.system.topics[self.scope.topics[e.topic]].name
        elif isinstance(e, typed.TruthRead):
            root = self.system.components[self.scope.plants[e.instance]].name
        else:
            return None
        return leaf_name(root, path)


def _scaled(line: _ScaledSignal | None, by: float) -> _ScaledSignal | None:
    if line is None:
        return None
    return _ScaledSignal(line.signal, line.scale * by, line.offset * by, line.folded)


def _opened(e: typed.TypedExpr) -> typed.TypedExpr:
    """What calls of functions that only return something stand for."""
    for _ in range(OPENED_MAX):
        inner = returned(e) if isinstance(e, typed.TypedCall) else None
        if inner is None:
            return e
        e = inner
    return e
