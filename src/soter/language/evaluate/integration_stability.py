"""Finds plants for which the integration scheme diverges though the solution does not.

Purpose: `groups_that_diverge` finds states whose rates, times the step, lie outside of the region
in which the scheme is stable. `Slopes` bounds the Jacobian for it: it evaluates expressions to
intervals with intervals of their partial derivatives, without NumPy and without running anything.
Non-goals: the error of a stable scheme; claims that a proof rests on (`verify/enclose/`), as
nothing is rounded outward here.

An unknown value has the derivative (-inf, inf) by every state that it may depend on, so a bound is
either right, up to rounding, or says nothing.

States that depend on each other in a circle are examined together. With one derivative for all
states and inputs, A, a step is R(hA), R the scheme's polynomial: it diverges where the spectral
radius of R(hA) is above 1 and above that of e^(hA). A state by itself, whose derivative lies in
[a, b], diverges where |R(ha)| and |R(hb)| are above 1 and b < 0, as R(z) stays above 1 below the
end of its region.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from soter.language.model import typed
from soter.language.model.tree_walk import nodes, returned
from soter.language.model.types import ArrayType, FloatType, IntType, RecordType, leaf_name
from soter.language.syntax.schemes import SCHEMES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.language.model.system import Component, System
    from soter.language.model.types import Type, Value

    Matrix = list[list[float]]


Range: TypeAlias = tuple[float, float]
ANY: Range = (-math.inf, math.inf)
UNIT: Range = (-1.0, 1.0)
BOUNDED = {"sin": UNIT, "cos": UNIT, "tanh": (0.0, 1.0), "atan": (0.0, 1.0)}
"""Functions of one number with values in [-2, 2] -> bounds of their derivatives."""


@dataclass(frozen=True)
class Slope:
    """A number in [low, high]; `by` maps a state to bounds of the derivative, 0 if absent."""

    low: float
    high: float
    by: Mapping[int, Range] = field(default_factory=dict)

    @property
    def range(self) -> Range:
        """Gives the range of the number itself."""
        return self.low, self.high


Tree: TypeAlias = "Slope | tuple[Tree, ...]"
"""The slope of a number, or the trees of the parts of a record or an array."""


class Slopes:
    """Evaluates expressions to slopes; `variables`, `topic` and `param` give what they read."""

    def __init__(
        self,
        variables: Mapping[typed.Variable, Tree],
        topic: Callable[[typed.TopicSymbol], Tree],
        param: Callable[[typed.ParamSymbol], Value],
    ) -> None:
        self.variables = dict(variables)
        self.topic = topic
        self.param = param

    def slopes_of(self, e: typed.TypedExpr) -> Tree:
        """Gives the slopes of an expression, in the structure of its type."""
        if isinstance(e, typed.Literal):
            return constant_tree(e.value)
        if isinstance(e, typed.ParamRead):
            return constant_tree(self.param(e.param))
        if isinstance(e, typed.VarRead):
            slopes = self.variables.get(e.variable)
            return unknown_tree(e.type, {}) if slopes is None else slopes
        if isinstance(e, typed.TopicRead):
            return self.topic(e.topic)
        if isinstance(e, typed.TypedField):
            target = self.slopes_of(e.target)
            return target[e.index] if isinstance(target, tuple) else unknown_tree(e.type, target.by)
        if isinstance(e, typed.Aggregate):
            parts = [self.slopes_of(x) for x in e.elements]
            order = e.order or tuple(range(len(parts)))
            return tuple(parts[order.index(k)] for k in range(len(parts)))
        return self._slopes_of_operation(e)

    def _slopes_of_operation(self, e: typed.TypedExpr) -> Tree:
        if isinstance(e, typed.TypedUnary) and e.op == "-":
            return mapped_tree(
                self.slopes_of(e.operand), lambda x: slope_product(x, Slope(-1.0, -1.0))
            )
        if isinstance(e, typed.TypedBinary) and isinstance(e.type, (FloatType, IntType)):
            a, b = self.slopes_of(e.left), self.slopes_of(e.right)
            if isinstance(a, Slope) and isinstance(b, Slope):
                return operation_slope(e.op, a, b)
        if isinstance(e, typed.Vector):
            return self._slopes_of_vector(e)
        if isinstance(e, typed.Conditional):
            return union_tree(self.slopes_of(e.then), self.slopes_of(e.otherwise))
        if isinstance(e, typed.Builtin):
            return self._slopes_of_builtin(e)
        if isinstance(e, typed.TypedCall):
            return self._slopes_of_call(e)
        return unknown_tree(e.type, self._states_read(e))

    def _slopes_of_call(self, e: typed.TypedCall) -> Tree:
        inner = returned(e)
        if inner is not None:
            return self.slopes_of(inner)
        bound = BOUNDED.get(e.fun.name) if e.fun.prelude else None
        x = self.slopes_of(e.arguments[0]) if e.arguments else None
        if bound is not None and isinstance(x, Slope):
            return Slope(-2.0, 2.0, {k: range_product(bound, d) for k, d in x.by.items()})
        return unknown_tree(e.type, self._states_read(e))

    def _slopes_of_vector(self, e: typed.Vector) -> Tree:
        a, b = self.slopes_of(e.left), self.slopes_of(e.right)
        if isinstance(a, tuple) and isinstance(b, tuple):
            pairs = list(zip(a, b, strict=True))
        elif isinstance(a, tuple):
            pairs = [(x, b) for x in a]
        else:
            assert isinstance(b, tuple)
            pairs = [(a, y) for y in b]
        slopes = [(x, y) for x, y in pairs if isinstance(x, Slope) and isinstance(y, Slope)]
        if len(slopes) < len(pairs):
            return unknown_tree(e.type, self._states_read(e))
        return tuple(operation_slope(e.op, x, y) for x, y in slopes)

    def _slopes_of_builtin(self, e: typed.Builtin) -> Tree:
        parts = [self.slopes_of(x) for x in e.arguments]
        if e.name in ("min", "max") and all(isinstance(p, Slope) for p in parts):
            return union_tree(parts[0], parts[1])
        if e.name == "abs" and isinstance(parts[0], Slope):
            return union_tree(parts[0], slope_product(parts[0], Slope(-1.0, -1.0)))
        if e.name == "float" and isinstance(parts[0], Slope):
            return parts[0]
        return unknown_tree(e.type, self._states_read(e))

    def _states_read(self, e: typed.TypedExpr) -> dict[int, Range]:
        """Gives state -> any derivative, for the states that an expression may depend on."""
        read = [n.variable for n in nodes([e]) if isinstance(n, typed.VarRead)]
        trees = (self.variables[v] for v in read if v in self.variables)
        return dict.fromkeys((k for t in trees for k in _states_in(t)), ANY)


def _states_in(t: Tree) -> set[int]:
    if isinstance(t, Slope):
        return set(t.by)
    return {k for part in t for k in _states_in(part)}


def constant_tree(value: Value) -> Tree:
    """Gives the slopes of a constant, in the structure of its value; all derivatives are 0."""
    if isinstance(value, tuple):
        return tuple(constant_tree(v) for v in value)
    if isinstance(value, (int, float)):
        return Slope(float(value), float(value))
    return Slope(*ANY)


def unknown_tree(t: Type, by: Mapping[int, Range]) -> Tree:
    """Gives slopes of an unknown value of type `t`, with any derivative by the states in `by`."""
    return uniform_tree(t, Slope(*ANY, dict.fromkeys(by, ANY)))


def uniform_tree(t: Type, slope: Slope) -> Tree:
    """Gives the tree for a value of type `t` in which all numbers have this slope."""
    if isinstance(t, RecordType):
        return tuple(uniform_tree(f, slope) for _, f in t.fields)
    return (uniform_tree(t.element, slope),) * t.size if isinstance(t, ArrayType) else slope


def mapped_tree(t: Tree, change: Callable[[Slope], Slope]) -> Tree:
    """Gives the tree with `change` applied to every slope."""
    return change(t) if isinstance(t, Slope) else tuple(mapped_tree(part, change) for part in t)


def union_tree(a: Tree, b: Tree) -> Tree:
    """Gives a tree that covers two trees of one type; unknown if their lists differ in length."""
    if isinstance(a, Slope) and isinstance(b, Slope):
        by = {k: hull(a.by.get(k, (0.0, 0.0)), b.by.get(k, (0.0, 0.0))) for k in {*a.by, *b.by}}
        return Slope(*hull(a.range, b.range), by)
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return tuple(union_tree(x, y) for x, y in zip(a, b, strict=True))
    return Slope(*ANY, dict.fromkeys(_states_in(a) | _states_in(b), ANY))


def operation_slope(op: str, a: Slope, b: Slope) -> Slope:
    """Gives the slope of `a op b`."""
    if op == "+":
        return slope_sum(a, b)
    if op == "-":
        return slope_sum(a, slope_product(b, Slope(-1.0, -1.0)))
    if op == "*":
        return slope_product(a, b)
    if op == "/" and not b.by and (b.low > 0.0 or b.high < 0.0):
        return slope_product(a, Slope(1.0 / b.high, 1.0 / b.low))
    return Slope(*ANY, dict.fromkeys([*a.by, *b.by], ANY))


def slope_sum(a: Slope, b: Slope) -> Slope:
    """Gives the slope of `a + b`."""
    by = {k: range_sum(a.by.get(k, (0.0, 0.0)), b.by.get(k, (0.0, 0.0))) for k in {*a.by, *b.by}}
    return Slope(*range_sum(a.range, b.range), by)


def slope_product(a: Slope, b: Slope) -> Slope:
    """Gives the slope of `a * b`."""
    by = {}
    for k in {*a.by, *b.by}:
        left, right = a.by.get(k, (0.0, 0.0)), b.by.get(k, (0.0, 0.0))
        by[k] = range_sum(range_product(left, b.range), range_product(a.range, right))
    return Slope(*range_product(a.range, b.range), by)


def hull(a: Range, b: Range) -> Range:
    """Gives the smallest range that contains the ranges a and b."""
    return min(a[0], b[0]), max(a[1], b[1])


def range_sum(a: Range, b: Range) -> Range:
    """Gives the range of x + y for all x in `a` and y in `b`."""
    return a[0] + b[0], a[1] + b[1]


def range_product(a: Range, b: Range) -> Range:
    """Gives the range of x * y for all x in `a` and y in `b`; 0 times anything is 0."""
    ends = [0.0 if 0.0 in (x, y) else x * y for x in a for y in b]
    return min(ends), max(ends)


TOGETHER_MAX = 12
"""Most states that depend on each other in one circle; larger circles are not examined."""
SQUARINGS = 40
GROWS = 1e-6
"""Logarithm of a step's growth that is more than rounding."""
SPARE = 1.1
"""The advised step is by this factor shorter than the longest stable one."""
PARTS_MAX = 64
"""At most this multiple of the present substeps is tried."""
Leaf = tuple["typed.Variable", tuple[int, ...]]


@dataclass(frozen=True)
class Diverging:
    """A group of states that the scheme makes diverge, though the exact solution does not."""

    names: tuple[str, ...]
    variable: typed.Variable
    """The first of these states."""
    rate: float
    """The spectral radius of their Jacobian, in 1/s, at the end that grows least."""
    step_s: float
    growth: float
    """The factor by which a step multiplies them, at least."""
    substeps: int | None
    """The number of substeps with which it would be stable; None: none was found."""
    other: str | None
    """A scheme that would be stable with the same step; None: there is none."""


def groups_that_diverge(
    system: System, c: Component, ranges: Mapping[tuple[str, tuple[str, ...]], Range] | None = None
) -> list[Diverging]:
    """Gives the groups of a plant's states that its scheme makes diverge; [] if none is known.

    `ranges`: (state, path of a leaf) -> the range of its values; absent: all numbers.
    """
    plant = c.plant
    if plant is None or plant.extern or not plant.der:
        return []
    leaves = [(v, at) for v in plant.der for at in _float_places(v.type)]
    jacobian = _jacobian(system, c, leaves, ranges or {})
    scheme = SCHEMES[plant.method]
    step = c.period_ns / 1e9 / c.substeps
    divergences = []
    for block in _circles_of_states(jacobian):
        growths = [
            (_spurious_growth(a, step, scheme.order), a) for a in _end_matrices(jacobian, block)
        ]
        known = [(growth, a) for growth, a in growths if growth is not None]
        if known and len(known) == len(growths):
            _, slowest = min(known, key=lambda pair: pair[0])
            divergences.append(_divergence(leaves, block, slowest, step, c.substeps, plant.method))
    return divergences


def _divergence(
    leaves: Sequence[Leaf],
    block: Sequence[int],
    a: Matrix,
    step: float,
    substeps: int,
    method: str,
) -> Diverging:
    order = SCHEMES[method].order
    names = tuple(leaf_name(leaves[k][0].name, _path_of(*leaves[k])) for k in block)
    room = SPARE * step * substeps
    parts = next(
        (
            n
            for n in _larger_substep_counts(substeps)
            if _spurious_growth(a, room / n, order) is None
        ),
        None,
    )
    other = next(
        (s.name for s in SCHEMES.values() if _spurious_growth(a, step, s.order) is None), None
    )
    growth = _spurious_growth(a, step, order)
    assert growth is not None
    return Diverging(names, leaves[block[0]][0], _spectral_radius(a), step, growth, parts, other)


def _larger_substep_counts(substeps: int) -> Iterator[int]:
    n = substeps
    while n < PARTS_MAX * substeps:
        n = max(n + 1, n * 5 // 4)
        yield n


# ---------------------------------------------------------------- the Jacobian


def _float_places(t: Type) -> Iterator[tuple[int, ...]]:
    """Yields the paths of a type's floats, as tuples of indices of fields and elements."""
    if isinstance(t, RecordType):
        parts = [f for _, f in t.fields]
    elif isinstance(t, ArrayType):
        parts = [t.element] * t.size
    else:
        if isinstance(t, FloatType):
            yield ()
        return
    for k, part in enumerate(parts):
        for rest in _float_places(part):
            yield (k, *rest)


def _path_of(variable: typed.Variable, place: tuple[int, ...]) -> tuple[str, ...]:
    path, t = [], variable.type
    for k in place:
        if isinstance(t, RecordType):
            path.append(t.fields[k][0])
            t = t.fields[k][1]
        else:
            assert isinstance(t, ArrayType)
            path.append(f"[{k}]")
            t = t.element
    return tuple(path)


def _jacobian(
    system: System,
    c: Component,
    leaves: Sequence[Leaf],
    ranges: Mapping[tuple[str, tuple[str, ...]], Range],
) -> list[list[Range]]:
    """Gives bounds of the derivative of each rate by each state, a row for each rate."""
    plant = c.plant
    assert plant is not None
    number = {leaf: k for k, leaf in enumerate(leaves)}

    def state_tree(v: typed.Variable, t: Type, at: tuple[int, ...] = ()) -> Tree:
        if isinstance(t, RecordType):
            return tuple(state_tree(v, f, (*at, k)) for k, (_, f) in enumerate(t.fields))
        if isinstance(t, ArrayType):
            return tuple(state_tree(v, t.element, (*at, k)) for k in range(t.size))
        span = ranges.get((v.name, _path_of(v, at)), ANY)
        return Slope(*span, {number[v, at]: (1.0, 1.0)} if (v, at) in number else {})

    variables: dict[typed.Variable, Tree] = {v: state_tree(v, v.type) for v in plant.states}
    for d in c.disturbances:
        variables[d.variable] = uniform_tree(d.variable.type, Slope(d.low, d.high))
    slopes = Slopes(variables, lambda t: _topic_tree(system, c, t), lambda p: c.scope.params[p])
    for variable, value in plant.lets:
        slopes.variables[variable] = slopes.slopes_of(value)
    rows: list[list[Range]] = []
    for v, e in plant.der.items():
        tree = slopes.slopes_of(e)
        for place in _float_places(v.type):
            at = tree
            for k in place:
                at = at[k] if isinstance(at, tuple) else at
            assert isinstance(at, Slope)
            rows.append([at.by.get(k, (0.0, 0.0)) for k in range(len(leaves))])
    return rows


def _topic_tree(system: System, c: Component, symbol: typed.TopicSymbol) -> Tree:
    """Gives the tree of a topic: the declared set for a float with one, else an unknown value."""
    bounds = system.topics[c.scope.topics[symbol]].bounds
    if isinstance(symbol.type, FloatType) and bounds[0] is not None:
        return Slope(bounds[0].low, bounds[0].high)
    return unknown_tree(symbol.type, {})


# ---------------------------------------------------------------- what belongs together


def _circles_of_states(jacobian: Sequence[Sequence[Range]]) -> list[list[int]]:
    """Gives groups of states that depend on each other in a circle; each state is in one group."""
    n = len(jacobian)
    reach = [{j for j in range(n) if jacobian[i][j] != (0.0, 0.0)} for i in range(n)]
    for k in range(n):
        for i in range(n):
            if k in reach[i]:
                reach[i] |= reach[k]
    circles: list[list[int]] = []
    seen: set[int] = set()
    for i in range(n):
        if i not in seen:
            circles.append([i, *(j for j in range(i + 1, n) if j in reach[i] and i in reach[j])])
            seen.update(circles[-1])
    return circles


def _end_matrices(jacobian: Sequence[Sequence[Range]], block: Sequence[int]) -> list[Matrix]:
    """Gives the Jacobian of `block` if it is exact, both bounds for a single state, else []."""
    ends = [jacobian[i][j] for i in block for j in block]
    n = len(block)
    if n > TOGETHER_MAX or not all(math.isfinite(x) for r in ends for x in r):
        return []
    if all(low == high for low, high in ends):
        return [[[jacobian[i][j][0] for j in block] for i in block]]
    low, high = ends[0]
    return [[[low]], [[high]]] if n == 1 and high < 0.0 else []


# ---------------------------------------------------------------- growth


def _spurious_growth(a: Matrix, step: float, order: int) -> float | None:
    """Gives the growth factor per step if only the scheme diverges, not the solution; else None."""
    z = [[x * step for x in row] for row in a]
    scheme = _spectral_radius(_scheme_polynomial(z, order))
    parts = 2 ** max(0, math.ceil(math.log2(max(_matrix_norm(z), 1e-300))) + 4)
    small = [[x / parts for x in row] for row in z]
    exact = parts * math.log(max(_spectral_radius(_scheme_polynomial(small, 12)), 1e-300))
    grows = math.log(max(scheme, 1e-300))
    return scheme if grows > max(exact, 0.0) + GROWS else None


def _scheme_polynomial(z: Matrix, order: int) -> Matrix:
    """Gives 1 + z + ... + z^order / order!, the matrix with which a step multiplies the states."""
    n = len(z)
    total = [[float(i == j) for j in range(n)] for i in range(n)]
    power = [row[:] for row in total]
    for k in range(1, order + 1):
        power = [[x / k for x in row] for row in _matrix_product(power, z)]
        total = [
            [x + y for x, y in zip(a, b, strict=True)] for a, b in zip(total, power, strict=True)
        ]
    return total


def _matrix_product(a: Matrix, b: Matrix) -> Matrix:
    columns = list(zip(*b, strict=True))
    return [
        [sum(x * y for x, y in zip(row, column, strict=True)) for column in columns] for row in a
    ]


def _matrix_norm(a: Matrix) -> float:
    return max(sum(abs(x) for x in row) for row in a)


def _spectral_radius(a: Matrix) -> float:
    """Gives the spectral radius, as |a^(2^k)|^(1/2^k), with scaling at every squaring."""
    scale = 0.0
    for k in range(SQUARINGS):
        size = _matrix_norm(a)
        if size == 0.0:
            return 0.0
        scale += math.log(size) / 2**k
        a = [[x / size for x in row] for row in a]
        a = _matrix_product(a, a)
    size = _matrix_norm(a)
    return math.exp(scale + math.log(size) / 2**SQUARINGS) if size else 0.0
