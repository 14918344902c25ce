"""Straight-line programs over balls: written down once, run on every cell.

Purpose: a `Builder` writes a program down as a list of values, each an input, a constant or one of
the `OPERATIONS` on earlier values; a `Function` computes those that are asked for, of any inputs.
What needs no input is computed at once; what is asked twice is one value; what nothing depends on
is left out. A truth is bits: 0: may be false, 1: may be true. Sums and products of matrices, as
lists of rows, are computed of balls at once, and written down of values.
Non-goals: what is to be computed (`compile_terms.py`, `grid/flow_chains.py`); lines over functions
of one number (`linear_enclosures.py`); exponentials (`linear_flows.py`, `flow_enclosures.py`).

Argument: each operation encloses what it names for balls that enclose its arguments (by Arb, by
`linear_enclosures.py`, or as its function below says), so by induction along the program each value
encloses what it stands for, whatever the inputs enclose. A value that is demanded is a truth:
unless it is certain, nothing is given.
"""

from __future__ import annotations

import operator
from itertools import chain
from operator import itemgetter
from typing import TYPE_CHECKING, Any, TypeAlias

from flint import arb, arb_mat

from soter.certificate.extras import extras
from soter.certificate.terms.linear_enclosures import (
    ONE,
    ZERO,
    ball_key,
    exact,
    larger,
    line_function,
    line_noisy_max0,
    line_or_range,
    lower,
    magnitude,
    range_max0,
    smaller,
    upper,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    Number: TypeAlias = "arb | Value"
    Rows = list[list[Any]]


CERTAIN = 2
"""The bits of what is certainly true."""
PART, DEMAND = "part", "demand"
"""Operations: one part of a tuple; that nothing is given unless a truth is certain."""
CONSTANT, INPUT = "constant", "input"


class NotCertainError(Exception):
    """A truth that the program demands may be false."""


def product_range(low_a: arb, high_a: arb, low_b: arb, high_b: arb) -> tuple[arb, arb]:
    """The range of the product of numbers in two ranges, from the corners of the ranges."""
    a, b, c, d = low_a * low_b, low_a * high_b, high_a * low_b, high_a * high_b
    return a.min(b).min(c.min(d)), a.max(b).max(c.max(d))


def range_between(
    low: arb,
    high: arb,
    low_after: arb,
    high_after: arb,
    least: arb,
    most: arb,
    factor: arb,
    rest: arb,
    span: arb,
    grown: arb,
) -> tuple[arb, arb]:
    """The range of a state x between two instants with these ranges, if x' = factor x + rest.

    `least` and `most` bound x': if both have the same sign, x runs from one range to the other.
    Otherwise x stays below the solution of y' = factor y + max rest from `high`, which is monotone:
    y only rises if factor high + max rest > 0, and by that times `grown`, the integral of e^{factor
    s} over the time. Nor is x further above `high_after` than `least` allows.
    """
    if least >= 0:
        return low, high_after
    if most <= 0:
        return low_after, high
    down, up = arb((factor * low + rest).lower()), arb((factor * high + rest).upper())
    least, most = arb(least.lower()), arb(most.upper())
    return (
        (low if down >= 0 else low + down * grown).max(low_after - span * most.max(ZERO)),
        (high if up <= 0 else high + up * grown).min(high_after - span * least.min(ZERO)),
    )


def range_after(
    low: arb, high: arb, low_after: arb, high_after: arb, factor: arb, rest: arb, grown: arb
) -> tuple[arb, arb]:
    """The range of a state after a time: the known range, narrowed as `range_between` does."""
    down, up = arb((factor * low + rest).lower()), arb((factor * high + rest).upper())
    return (
        low_after.max(low + down.min(ZERO) * grown),
        high_after.min(high + up.max(ZERO) * grown),
    )


def growth_bound(factor: arb, span: arb) -> arb:
    """An upper bound of the integral of e^{factor s} over [0, span]."""
    if factor > 0 or factor < 0:
        return arb((((factor * span).exp() - 1) / factor).upper())
    return span if factor <= 0 else span * (factor * span).exp()


def truth_bits(yes: bool, no: bool) -> int:
    """The bits of a proposition: 2 if it is certainly true, 1 if certainly false, 3 otherwise."""
    return 2 if yes else (1 if no else 3)


def choose_by_truth(truth: int, yes: arb, no: arb, both: arb) -> arb:
    """Gives `yes` for a certainly true proposition, `no` for a certainly false one, else `both`."""
    return yes if truth == 2 else (no if truth == 1 else both)


def weighted_ball(weight: arb, x: arb) -> arb:
    """The product `weight * x`; a weight of 0 gives 0 even if x is infinite or no number."""
    return ZERO if weight.is_zero() else weight * x


def require_certain(truth: int) -> None:
    """Raises NotCertainError if a proposition may be false."""
    if truth != CERTAIN:
        raise NotCertainError


OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "neg": operator.neg,
    "abs": abs,
    "min": arb.min,
    "max": arb.max,
    "mid": arb.mid,
    "union": arb.union,
    "larger": larger,
    "smaller": smaller,
    "below": lower,
    "above": upper,
    "magnitude": magnitude,
    "round_down": lambda low: exact(lower(low)),
    "round_up": lambda high: exact(upper(high)),
    "corners": product_range,
    "range_between": range_between,
    "range_after": range_after,
    "inside": lambda low, high, least, most: truth_bits(low >= least and high <= most, no=False),
    "range_of_table": lambda *values: extras.array_elements.range_of_table(*values),  # noqa: PLW0108 - an extra
    "range_max0": range_max0,
    "line_noisy_max0": line_noisy_max0,
    "line_or_range": line_or_range,
    "negative": lambda low, high: truth_bits(high < 0, low >= 0),
    "not_positive": lambda low, high: truth_bits(high <= 0, low > 0),
    "not": (0, 2, 1, 3).__getitem__,
    "and": lambda a, b: ((a | b) & 1) | (a & b & 2),
    "or": lambda a, b: ((a | b) & 2) | (a & b & 1),
    "by_truth": choose_by_truth,
    "share": weighted_ball,
    DEMAND: require_certain,
}


def operation_named(name: str) -> Callable[..., Any]:
    """The operation called `name` in `OPERATIONS`; `line_f` computes the line over f."""
    return OPERATIONS.get(name) or line_function(name.removeprefix("line_"))


class Value:
    """A value in a program: the result of an operation, a constant, or an input.

    `content`: a constant's number, an input's place, or which part of a tuple. Values can be added,
    multiplied and compared in size like balls, and together with balls, so that code that does not
    branch on numbers works with both.
    """

    __slots__ = ("arguments", "content", "make", "operation")

    def __init__(
        self,
        make: Builder,
        operation: str,
        arguments: tuple[Value, ...],
        content: Any,  # noqa: ANN401
    ) -> None:
        self.make, self.operation = make, operation
        self.arguments, self.content = arguments, content

    @property
    def is_constant(self) -> bool:
        """Whether the value depends on no input."""
        return self.operation == CONSTANT

    def __add__(self, other: Number) -> Value:
        return self.make.apply("add", self, other)

    def __radd__(self, other: Number) -> Value:
        return self.make.apply("add", other, self)

    def __sub__(self, other: Number) -> Value:
        return self.make.apply("sub", self, other)

    def __rsub__(self, other: Number) -> Value:
        return self.make.apply("sub", other, self)

    def __mul__(self, other: Number) -> Value:
        return self.make.apply("mul", self, other)

    def __rmul__(self, other: Number) -> Value:
        return self.make.apply("mul", other, self)

    def __neg__(self) -> Value:
        return self.make.apply("neg", self)

    def __abs__(self) -> Value:
        return self.make.apply("abs", self)


class Builder:
    """Records a program as the list of its values, in the order in which they were made."""

    def __init__(self) -> None:
        self.values: list[Value] = []
        self._known: dict[object, Value] = {}
        self.zero, self.one, self._minus_one = map(self.constant, (ZERO, ONE, -ONE))

    def _unique(self, operation: str, arguments: tuple[Value, ...], content: Any = None) -> Value:  # noqa: ANN401
        key = operation, tuple(map(id, arguments)), content
        if key not in self._known:
            self._known[key] = Value(self, operation, arguments, content)
            self.values.append(self._known[key])
        return self._known[key]

    def constant(self, x: Any) -> Value:  # noqa: ANN401  a ball, a truth, a table
        """The value of a constant; equal balls share a value."""
        plain = repr(x) if isinstance(x, (int, float)) else id(x)
        key = CONSTANT, (ball_key(x) if isinstance(x, arb) else (type(x), plain))
        if key not in self._known:
            self._known[key] = Value(self, CONSTANT, (), x)
            self.values.append(self._known[key])
        return self._known[key]

    def input_at(self, place: int) -> Value:
        """The value of the number at index `place` of the form."""
        return self._unique(INPUT, (), place)

    def apply(self, operation: str, *arguments: Any, content: Any = None) -> Value:  # noqa: ANN401
        """Adds an operation of `OPERATIONS` on values and constants, and returns the result.

        `PART` takes number `content` of a tuple. After `DEMAND` the program returns nothing unless
        the truth is certain.
        """
        values = [x if isinstance(x, Value) else self.constant(x) for x in arguments]
        if operation == DEMAND:
            (truth,) = values
            known = truth.is_constant and truth.content == CERTAIN
            return truth if known else self._unique(DEMAND, (truth,))
        if all(x.is_constant for x in values):
            known = [x.content for x in values]
            return self.constant(
                known[0][content] if operation == PART else operation_named(operation)(*known)
            )
        simple = operation in ("add", "sub", "mul", "share")
        same = self._result_without_operation(operation, *values) if simple else None
        return self._unique(operation, tuple(values), content) if same is None else same

    def _result_without_operation(self, operation: str, x: Value, y: Value) -> Value | None:
        """The result of x op y if it needs no operation, else None.

        0 times an unbounded value is 0: if the obligations hold, that value is a number.
        """
        if operation in ("mul", "share"):
            if self.zero in (x, y):
                return self.zero
            if self._minus_one in (x, y):
                return -(y if x is self._minus_one else x)
            return {x: y, y: x}.get(self.one)
        if x is self.zero:
            return -y if operation == "sub" else y
        return x if y is self.zero else None

    def apply_for_parts(self, operation: str, count: int, *arguments: Number) -> list[Value]:
        """Adds an operation that returns a tuple, and gives the `count` parts of the tuple."""
        whole = self.apply(operation, *arguments)
        return [self.apply(PART, whole, content=k) for k in range(count)]

    def sum(self, parts: Iterable[Number]) -> Value:
        """The sum of the parts; constants are added first."""
        total = self.zero
        for x in sorted(parts, key=lambda x: isinstance(x, Value) and not x.is_constant):
            total += x
        return total


def apply_operation(operation: str, *arguments: Any, parts: int = 0) -> Any:  # noqa: ANN401
    """Applies an operation to balls, or records it for values; `parts`: the number of results."""
    for x in arguments:
        if isinstance(x, Value):
            make = x.make
            if parts:
                return tuple(make.apply_for_parts(operation, parts, *arguments))
            return make.apply(operation, *arguments)
    return operation_named(operation)(*arguments)


class Function:
    """Runs a program on a form: returns the outputs, or None if a demand is uncertain.

    `after`: how many outputs are in the first of two tuples; None: all are in a single tuple.
    """

    def __init__(
        self,
        builder: Builder,
        length: int,
        outputs: Sequence[Any],
        after: int | None = None,
    ) -> None:
        """`length` is the number of numbers in a form."""
        outputs = [x if isinstance(x, Value) else builder.constant(x) for x in outputs]
        order = _values_needed(builder.values, outputs)
        constants = [v for v in order if v.is_constant]
        steps = [v for v in order if v.operation not in (CONSTANT, INPUT)]
        place = {id(v): v.content for v in order if v.operation == INPUT}
        place |= {id(v): length + k for k, v in enumerate((*constants, *steps))}
        self._constants = tuple(v.content for v in constants)
        self._steps = [_compiled_step(v, place) for v in steps]
        self._wanted = tuple(place[id(v)] for v in outputs)
        self._after, self._length = after, length
        self._named = tuple(
            (v.operation, v.content, tuple(place[id(x)] for x in v.arguments)) for v in steps
        )

    def __call__(self, form: tuple[Any, ...]) -> Any:  # noqa: ANN401  as was asked for
        """The outputs for a form, as numbers; as values for a form of values of another program.

        Raises AssertionError for a form of another length, as constants are stored after it.
        """
        if len(form) != self._length:
            raise AssertionError("a form of another length")
        if Value in map(type, form):
            make = next(x.make for x in form if isinstance(x, Value))
            return self._enter_in_program(make, form)
        values: list[Any] = [*form, *self._constants]
        keep = values.append
        try:
            for operation, one, other in self._steps:
                if other is None:
                    keep(operation(values[one]))
                elif one is None:
                    keep(operation(*other(values)))
                else:
                    keep(operation(values[one], values[other]))
        except NotCertainError:
            return None
        return self._outputs_out_of(values)

    def _enter_in_program(self, make: Builder, form: Sequence[Number]) -> Any:  # noqa: ANN401
        values: list[Any] = [*form, *self._constants]
        for operation, content, places in self._named:
            arguments = [values[k] for k in places]
            values.append(make.apply(operation, *arguments, content=content))
        return self._outputs_out_of(values)

    def _outputs_out_of(self, values: Sequence[Any]) -> Any:  # noqa: ANN401
        made = tuple([values[k] for k in self._wanted])
        return made if self._after is None else (made[: self._after], made[self._after :])


def _values_needed(values: Sequence[Value], outputs: Sequence[Value]) -> list[Value]:
    """The values that outputs and demands depend on, in the order in which they were made."""
    needed = {id(v) for v in outputs}
    for v in reversed(values):
        if id(v) in needed or v.operation == DEMAND:
            needed.add(id(v))
            needed.update(id(x) for x in v.arguments)
    return [v for v in values if id(v) in needed]


def _compiled_step(v: Value, place: dict[int, int]) -> tuple[Any, Any, Any]:
    """(operation, place, None), (operation, place, place), or (operation, None, getter of all)."""
    operation: Any = itemgetter(v.content) if v.operation == PART else operation_named(v.operation)
    places = [place[id(x)] for x in v.arguments]
    if len(places) == 1:
        return operation, places[0], None
    if len(places) == 2:
        return operation, *places
    return operation, None, itemgetter(*places)


def total(parts: Iterable[Any]) -> Any:  # noqa: ANN401  a ball or a value
    """The sum of some balls or values."""
    return sum(parts, ZERO)


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:  # noqa: ANN401  a ball or a value
    """The sum of the products of two rows, entry by entry."""
    return total(x * y for x, y in zip(a, b, strict=True))


def product(a: Rows, b: Rows) -> Rows:
    """The product of two matrices."""
    if Value in map(type, chain(*a, *b)):
        columns = list(zip(*b, strict=True))
        return [[dot(row, column) for column in columns] for row in a]
    return (arb_mat(a) * arb_mat(b)).tolist()


def times_column(a: Rows, column: Sequence[Any]) -> list[Any]:
    """The product of a matrix with one column."""
    return [dot(row, column) for row in a]


def unit_rows(n: int, *, width: int = 0, first: int = 0) -> Rows:
    """`n` unit vectors as rows: row i has its 1 in column first + i of `width` (or n) columns."""
    return [[ONE if k == first + i else ZERO for k in range(width or n)] for i in range(n)]


def plus_scaled(a: Rows, b: Rows, factor: Any = ONE) -> Rows:  # noqa: ANN401  a ball or a value
    """The matrix `a + factor b`."""
    return [[x + factor * y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def side_by_side(a: Rows, b: Rows) -> Rows:
    """Two matrices side by side."""
    return [[*x, *y] for x, y in zip(a, b, strict=True)]


def bound_of_dot(row: Sequence[Any], sizes: Sequence[Any]) -> Any:  # noqa: ANN401
    """A bound of |row . x| for all x with |x_i| at most `sizes[i]`; 0 without sizes."""
    return dot(list(map(abs, row)), sizes) if sizes else ZERO
