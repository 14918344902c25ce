"""Straight-line programs over balls: operations one after the other, and the walk along them.

Purpose: `Builder` makes values out of inputs, constants and operations; `Function` computes those
that are asked for, of any inputs. What needs no input is computed at once; what is asked twice is
one value; what nothing depends on is left out.
Non-goals: what is to be computed (`affine_forms.py`, `atom_values.py`).

Argument: an operation encloses what it names for balls that enclose its arguments (Arb, and
`arb_balls.py`, `operations.py`), so by induction along the program each value encloses what it
stands for, whatever the inputs enclose. A value that is demanded is a truth: unless it is certain,
nothing is given.
"""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb

from soter.certificate.terms.arb_balls import ONE, ZERO, key_of
from soter.certificate.terms.operations import CERTAIN, DEMAND, OPERATIONS, PART, NotCertainError

if TYPE_CHECKING:
    from collections.abc import Sequence

CONSTANT, INPUT = "constant", "input"


class Value:
    """What an operation makes of other values; a constant and an input need none.

    `content`: the number of a constant, the place of an input, which part of a tuple.
    """

    __slots__ = ("arguments", "content", "operation")

    def __init__(self, operation: str, arguments: tuple[Value, ...], content: Any) -> None:  # noqa: ANN401
        self.operation, self.arguments, self.content = operation, arguments, content

    @property
    def is_constant(self) -> bool:
        """Whether no input is in it."""
        return self.operation == CONSTANT


class Builder:
    """The values of a program, in the order in which they were made."""

    def __init__(self) -> None:
        self.values: list[Value] = []
        self._known: dict[object, Value] = {}
        self.zero, self.one = self.constant(ZERO), self.constant(ONE)

    def _value(self, operation: str, arguments: tuple[Value, ...], content: Any = None) -> Value:  # noqa: ANN401
        key = operation, tuple(map(id, arguments)), content
        if key not in self._known:
            self._known[key] = Value(operation, arguments, content)
            self.values.append(self._known[key])
        return self._known[key]

    def constant(self, x: Any) -> Value:  # noqa: ANN401  a ball, a truth, a table
        """Of a number; equal balls are one value."""
        key = CONSTANT, (content_of(x) if isinstance(x, (arb, int, float)) else id(x))
        if key not in self._known:
            self._known[key] = Value(CONSTANT, (), x)
            self.values.append(self._known[key])
        return self._known[key]

    def input(self, place: int) -> Value:
        """The number of a form at a place."""
        return self._value(INPUT, (), place)

    def apply(self, operation: str, *arguments: Value) -> Value:
        """What an operation of `OPERATIONS` makes of values."""
        if all(x.is_constant for x in arguments):
            return self.constant(OPERATIONS[operation](*(x.content for x in arguments)))
        return self._value(operation, arguments)

    def parts(self, operation: str, count: int, *arguments: Value) -> list[Value]:
        """The same of one that gives so many values."""
        whole = self.apply(operation, *arguments)
        if whole.is_constant:
            return [self.constant(x) for x in whole.content]
        return [self._value(PART, (whole,), k) for k in range(count)]

    def demand(self, truth: Value) -> None:
        """From here on nothing is given unless this is certainly so."""
        if not (truth.is_constant and truth.content == CERTAIN):
            self._value(DEMAND, (truth,))

    # ------------------------------------------------------------ sums and products

    def absolute(self, x: Value) -> Value:
        """|x|."""
        return self.apply("abs", x)

    def times(self, factor: arb | Value, x: Value) -> Value | None:
        """`factor * x`; None for zero: what is unbounded is finite all the same."""
        factor = self.coefficient(factor)
        if self.zero in (factor, x):
            return None
        if factor.is_constant and factor.content == -1:
            return self.apply("neg", x)
        if self.one in (factor, x):
            return x if factor is self.one else factor
        return self.apply("mul", factor, x)

    def sum(self, parts: Sequence[Value | None], offset: arb = ZERO) -> Value | None:
        """Of all of them, in their order; None for zero."""
        kept = [p for p in parts if p is not None and p is not self.zero]
        if not offset.is_zero():
            kept.insert(0, self.constant(offset))
        if not kept:
            return None
        total = kept[0]
        for x in kept[1:]:
            total = self.apply("add", total, x)
        return total

    def coefficient(self, factor: arb | Value) -> Value:
        """As a value."""
        return factor if isinstance(factor, Value) else self.constant(factor)


class Function:
    """What a program gives of a form: the values asked for, or None where a demand is not certain.

    `after`: the values in two tuples, so many of them in the first one.
    """

    def __init__(
        self, builder: Builder, length: int, outputs: Sequence[Value], after: int | None = None
    ) -> None:
        """`length`: of a form."""
        order = _needed(builder.values, outputs)
        constants = [v for v in order if v.is_constant]
        place = {id(v): length + k for k, v in enumerate(constants)}
        place |= {id(v): v.content for v in order if v.operation == INPUT}
        steps = [v for v in order if v.operation not in (CONSTANT, INPUT)]
        for k, v in enumerate(steps):
            place[id(v)] = length + len(constants) + k
        self._constants = tuple(v.content for v in constants)
        self._steps = [_step(v, place) for v in steps]
        self._wanted = tuple(place[id(v)] for v in outputs)
        self._after = after
        names = tuple(
            (v.operation, v.content, tuple(place[id(x)] for x in v.arguments)) for v in steps
        )
        self.content: object = (tuple(map(content_of, self._constants)), names, self._wanted)
        """Equal for functions only that give the same of every form."""

    def __call__(self, form: tuple[arb, ...]) -> Any:  # noqa: ANN401  as was asked for
        """Of one form."""
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
        made = tuple([values[k] for k in self._wanted])
        return made if self._after is None else (made[: self._after], made[self._after :])


def _needed(values: Sequence[Value], outputs: Sequence[Value]) -> list[Value]:
    """What outputs and demands depend on, in the order in which it was made."""
    needed = {id(v) for v in outputs}
    for v in reversed(values):
        if id(v) in needed or v.operation == DEMAND:
            needed.add(id(v))
            needed.update(id(x) for x in v.arguments)
    return [v for v in values if id(v) in needed]


def _step(v: Value, place: dict[int, int]) -> tuple[Any, Any, Any]:
    """An operation and its places: of one argument, of both, or None and what takes them all."""
    operation: Any = itemgetter(v.content) if v.operation == PART else OPERATIONS[v.operation]
    places = [place[id(x)] for x in v.arguments]
    if len(places) == 1:
        return operation, places[0], None
    if len(places) == 2:
        return operation, *places
    return operation, None, itemgetter(*places)


def content_of(constant: Any) -> object:  # noqa: ANN401  a ball, a pair of balls, a table, a truth
    """Equal for equal constants only; of what is no number or table equal to nothing else."""
    if isinstance(constant, tuple):
        return tuple(content_of(x) for x in constant)
    if isinstance(constant, arb) and constant.is_finite():
        return key_of(constant)
    if isinstance(constant, np.ndarray):
        return constant.dtype.str, constant.shape, constant.tobytes()
    return (type(constant), repr(constant)) if isinstance(constant, (int, float)) else object()
