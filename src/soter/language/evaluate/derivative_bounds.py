"""How fast an expression changes with each state: bounds of its derivatives.

Purpose: `Slopes`: checked expressions to intervals and intervals of partial derivatives, so that a
Jacobian can be bounded without a proof, without NumPy and without running anything.
Non-goals: claims that a proof rests on (`verify/enclose/`): nothing is rounded outward here.

What is not known has the derivative (-inf, inf) for every state that it may depend on, so a bound
is either right, up to rounding, or says nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from soter.language.evaluate.conjuncts import returned
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import ArrayType, FloatType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.language.model.types import Type, Value

Range: TypeAlias = tuple[float, float]
ANY: Range = (-math.inf, math.inf)
UNIT: Range = (-1.0, 1.0)
BOUNDED = {"sin": UNIT, "cos": UNIT, "tanh": (0.0, 1.0), "atan": (0.0, 1.0)}
"""Functions of one number with values in [-2, 2], and bounds of their derivatives."""


@dataclass(frozen=True)
class Slope:
    """A number in [low, high]; `by`: state -> bounds of its derivative. Absent: it is 0."""

    low: float
    high: float
    by: Mapping[int, Range] = field(default_factory=dict)

    @property
    def range(self) -> Range:
        """Of the number itself."""
        return self.low, self.high


Tree: TypeAlias = "Slope | tuple[Tree, ...]"
"""A number, or the parts of a record or an array."""


class Slopes:
    """Evaluates expressions whose variables have known slopes."""

    def __init__(
        self,
        variables: Mapping[typed.Variable, Tree],
        topic: Callable[[typed.TopicSymbol], Tree],
        param: Callable[[typed.ParamSymbol], Value],
    ) -> None:
        self.variables = dict(variables)
        self.topic = topic
        self.param = param

    def of(self, e: typed.TypedExpr) -> Tree:
        """The slopes of an expression, in the shape of its type."""
        if isinstance(e, typed.Literal):
            return fixed(e.value)
        if isinstance(e, typed.ParamRead):
            return fixed(self.param(e.param))
        if isinstance(e, typed.VarRead):
            slopes = self.variables.get(e.variable)
            return unknown(e.type, {}) if slopes is None else slopes
        if isinstance(e, typed.TopicRead):
            return self.topic(e.topic)
        if isinstance(e, typed.TypedField):
            target = self.of(e.target)
            return target[e.index] if isinstance(target, tuple) else unknown(e.type, target.by)
        if isinstance(e, typed.Aggregate):
            parts = [self.of(x) for x in e.elements]
            order = e.order or tuple(range(len(parts)))
            return tuple(parts[order.index(k)] for k in range(len(parts)))
        return self._computed(e)

    def _computed(self, e: typed.TypedExpr) -> Tree:
        if isinstance(e, typed.TypedUnary) and e.op == "-":
            return each(self.of(e.operand), lambda x: times(x, Slope(-1.0, -1.0)))
        if isinstance(e, typed.TypedBinary) and isinstance(e.type, (FloatType, IntType)):
            a, b = self.of(e.left), self.of(e.right)
            if isinstance(a, Slope) and isinstance(b, Slope):
                return arithmetic(e.op, a, b)
        if isinstance(e, typed.Vector):
            return self._vector(e)
        if isinstance(e, typed.Conditional):
            return both(self.of(e.then), self.of(e.otherwise))
        if isinstance(e, typed.Builtin):
            return self._builtin(e)
        if isinstance(e, typed.TypedCall):
            inner = returned(e)
            if inner is not None:
                return self.of(inner)
            bound = BOUNDED.get(e.fun.name) if e.fun.prelude else None
            x = self.of(e.arguments[0]) if e.arguments else None
            if bound is not None and isinstance(x, Slope):
                return Slope(-2.0, 2.0, {k: product(bound, d) for k, d in x.by.items()})
        return unknown(e.type, self._touched(e))

    def _vector(self, e: typed.Vector) -> Tree:
        a, b = self.of(e.left), self.of(e.right)
        if isinstance(a, tuple) and isinstance(b, tuple):
            pairs = list(zip(a, b, strict=True))
        elif isinstance(a, tuple):
            pairs = [(x, b) for x in a]
        else:
            assert isinstance(b, tuple)
            pairs = [(a, y) for y in b]
        elements = []
        for x, y in pairs:
            if not (isinstance(x, Slope) and isinstance(y, Slope)):
                return unknown(e.type, self._touched(e))
            elements.append(arithmetic(e.op, x, y))
        return tuple(elements)

    def _builtin(self, e: typed.Builtin) -> Tree:
        parts = [self.of(x) for x in e.arguments]
        if e.name in ("min", "max") and all(isinstance(p, Slope) for p in parts):
            return both(parts[0], parts[1])
        if e.name == "abs" and isinstance(parts[0], Slope):
            return both(parts[0], times(parts[0], Slope(-1.0, -1.0)))
        if e.name == "float" and isinstance(parts[0], Slope):
            return parts[0]
        return unknown(e.type, self._touched(e))

    def _touched(self, e: typed.TypedExpr) -> dict[int, Range]:
        """Every state that an expression may depend on, each with any derivative."""
        read = [n.variable for n in nodes([e]) if isinstance(n, typed.VarRead)]
        trees = (self.variables[v] for v in read if v in self.variables)
        return dict.fromkeys((k for t in trees for k in _states(t)), ANY)


def _states(t: Tree) -> set[int]:
    if isinstance(t, Slope):
        return set(t.by)
    return {k for part in t for k in _states(part)}


def fixed(value: Value) -> Tree:
    """A constant."""
    if isinstance(value, tuple):
        return tuple(fixed(v) for v in value)
    if isinstance(value, (int, float)):
        return Slope(float(value), float(value))
    return Slope(*ANY)


def unknown(t: Type, by: Mapping[int, Range]) -> Tree:
    """Any value of a type that depends on these states in any way."""
    if isinstance(t, RecordType):
        return tuple(unknown(f, by) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(unknown(t.element, by) for _ in range(t.size))
    return Slope(*ANY, dict.fromkeys(by, ANY))


def each(t: Tree, change: Callable[[Slope], Slope]) -> Tree:
    """Every number of a tree changed."""
    return change(t) if isinstance(t, Slope) else tuple(each(part, change) for part in t)


def both(a: Tree, b: Tree) -> Tree:
    """Either of two values of one type; lists of it may differ in length: any value then."""
    if isinstance(a, Slope) and isinstance(b, Slope):
        by = {k: hull(a.by.get(k, (0.0, 0.0)), b.by.get(k, (0.0, 0.0))) for k in {*a.by, *b.by}}
        return Slope(*hull(a.range, b.range), by)
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return tuple(both(x, y) for x, y in zip(a, b, strict=True))
    return Slope(*ANY, dict.fromkeys(_states(a) | _states(b), ANY))


def arithmetic(op: str, a: Slope, b: Slope) -> Slope:
    """`a op b`."""
    if op == "+":
        return plus(a, b)
    if op == "-":
        return plus(a, times(b, Slope(-1.0, -1.0)))
    if op == "*":
        return times(a, b)
    if op == "/" and not b.by and (b.low > 0.0 or b.high < 0.0):
        return times(a, Slope(1.0 / b.high, 1.0 / b.low))
    return Slope(*ANY, dict.fromkeys([*a.by, *b.by], ANY))


def plus(a: Slope, b: Slope) -> Slope:
    """Their sum."""
    by = {k: total(a.by.get(k, (0.0, 0.0)), b.by.get(k, (0.0, 0.0))) for k in {*a.by, *b.by}}
    return Slope(*total(a.range, b.range), by)


def times(a: Slope, b: Slope) -> Slope:
    """Their product."""
    by = {}
    for k in {*a.by, *b.by}:
        left, right = a.by.get(k, (0.0, 0.0)), b.by.get(k, (0.0, 0.0))
        by[k] = total(product(left, b.range), product(a.range, right))
    return Slope(*product(a.range, b.range), by)


def hull(a: Range, b: Range) -> Range:
    """Both ranges, and what lies between."""
    return min(a[0], b[0]), max(a[1], b[1])


def total(a: Range, b: Range) -> Range:
    """Sums of one number of each."""
    return a[0] + b[0], a[1] + b[1]


def product(a: Range, b: Range) -> Range:
    """Products of one number of each; 0 times anything is 0."""
    ends = [0.0 if 0.0 in (x, y) else x * y for x in a for y in b]
    return min(ends), max(ends)
