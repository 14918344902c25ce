"""Operations on the re-checker's values: computed where all numbers are known, terms otherwise.

Purpose: operators, built-in functions and those of the prelude, choices, look-ups in tables.
Non-goals: values (`symbolic_values.py`); expressions and statements (`symbolic_reading.py`); terms
themselves (`certificate/terms/`), those of a solver (`certificate/induction/solver_reading.py`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import reduce, wraps
from operator import add, eq, ge, gt, le, lt, mul, ne, sub
from typing import TYPE_CHECKING, Any, TypeVar

from soter.certificate.reading.symbolic_values import (
    NOT_HERE,
    SymbolicInt,
    Value,
    decided,
    identical,
    truth_of,
)
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import (
    ONE,
    exact,
    hull,
    magnitude,
)
from soter.certificate.terms.terms import (
    ANYTHING,
    LARGEST,
    Linear,
    Proposition,
    Terms,
    both,
    choice_of_truths,
    either,
    inputs_of,
    is_same_number,
    negation,
)
from soter.language.evaluate import arithmetic as arith

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.types import Type


HAIR = exact(2.0**-500)
"""By so much a number is wider where a rate may jump: by more than nothing."""
F = TypeVar("F", bound="Callable[..., Any]")
SMALL = exact(2.0**900)
"""An infinite number stays one where any 2^60 smaller ones are added, and is beyond all of them."""


def remembered(operation: F) -> F:
    """A decorator: of the same operands, as objects, an operation gives one and the same value.

    The machine does, and so what a program writes twice may cancel. What must hold is demanded
    anew each time.
    """

    @wraps(operation)
    def asked(self: Operations, *operands: Any) -> Value:  # noqa: ANN401 - as it is declared
        result = operation(self, *operands)
        numbers = (repr(x) if isinstance(x, (bool, int, float, str)) else id(x) for x in operands)
        key = operation.__name__, self.is_rounded, *numbers
        return self.made.setdefault(key, (result, operands))[0]

    return asked  # type: ignore[return-value]  # of the same type


def one_number(operation: F) -> F:
    """As `remembered`, where a result rests on all that its operands rest on, and on its doubts."""

    @wraps(operation)
    def asked(self: Operations, *operands: Any) -> Value:  # noqa: ANN401 - as it is declared
        before = len(self.doubts)
        result = operation(self, *operands)
        rests = (d for x in operands if isinstance(x, Linear) for d in x.rests)
        return _resting_on(result, [*rests, *self.doubts[before:]])

    return remembered(asked)  # type: ignore[return-value]  # of the same type


def _resting_on(result: Value, doubts: Sequence[Proposition]) -> Value:
    """A result that is known where there is no doubt; of numbers that are none any truth is."""
    if isinstance(result, Linear):
        rests = tuple(dict.fromkeys([*result.rests, *doubts]))
        known = rests == result.rests or isinstance(result, SymbolicInt)  # an int is always some
        return result if known else replace(result, rests=rests)
    if not doubts:
        return result
    if isinstance(result, (bool, Proposition)):
        any_truth = Proposition("below", argument=ANYTHING)
        return decided(choice_of_truths(reduce(both, doubts), truth_of(result), any_truth))
    return result


class Operations:
    """The operators over terms. `rounded`: as the machine computes them; else over real numbers.

    A function of a known number (`sqrt(2.0)`) is what the machine makes of it, in a flow, too.
    """

    def __init__(self, terms: Terms, *, rounded: bool) -> None:
        self.terms = terms
        self.is_rounded = rounded
        self.made: dict[object, tuple[Value, object]] = {}
        """Operation and operands -> the result, and these operands, which keep their identity."""
        self.doubts: list[Proposition] = []
        """Without which a number is infinite or none, but nothing faults: entered as they come."""
        self.everywhere = False
        """Whether functions of the prelude are exact, also beyond their error bounds' domains."""

    @property
    def path(self) -> Value:
        """The condition under which the code being read runs."""
        return decided(self.terms.path)

    @path.setter
    def path(self, condition: Value) -> None:
        self.terms.path = truth_of(condition)

    def add_obligation(self, truth: Value) -> None:
        """Demand it wherever the code being read runs."""
        self.terms.add_obligation(truth_of(truth))

    def demand(self, *numbers: Value) -> None:
        """Demand of numbers that they are some, and not infinite."""
        for x in numbers:
            if isinstance(x, Linear):
                for truth in (*x.rests, *x.beyond):
                    self.terms.add_obligation(truth)

    def add_doubt(self, truth: Value) -> None:
        """Let what is made of the operands rest on it, unless it certainly holds."""
        if decided(truth_of(truth)) is not True:
            self.doubts.append(truth_of(truth))

    @one_number
    def negation(self, a: Value) -> Value:
        """The truth "not `a`"."""
        return decided(negation(truth_of(a)))

    @one_number
    def both(self, a: Value, b: Value) -> Value:
        """The truth "`a` and `b`"."""
        return decided(both(truth_of(a), truth_of(b)))

    @one_number
    def one_of(self, a: Value, b: Value) -> Value:
        """The truth "`a` or `b`"."""
        return decided(either(truth_of(a), truth_of(b)))

    @remembered
    def join(self, of: Type, c: Proposition, a: Value, b: Value) -> Value:
        """`c ? a : b`, leaf by leaf; NotRecheckedError for lists of two lengths."""
        if isinstance(a, tuple):
            if len(a) != len(b):
                raise NotRecheckedError(f"a list whose length depends on a branch {NOT_HERE}")
            return tuple(self.join(of, c, x, y) for x, y in zip(a, b, strict=True))
        if isinstance(a, (bool, Proposition)):
            return decided(choice_of_truths(c, truth_of(a), truth_of(b)))
        if not isinstance(a, Linear) and not isinstance(b, Linear) and identical(a, b):
            return a
        x, y = self._term(a), self._term(b)
        finite, rests = _of_chosen(c, x.beyond, y.beyond), _of_chosen(c, x.rests, y.rests)
        chosen = _with_beyond(self.terms.choose(c, x, y), finite)
        chosen = replace(chosen, rests=()) if chosen.rests else chosen
        return _resting_on(self.like(chosen, a, b), rests)

    @one_number
    def negate(self, x: Value) -> Value:
        """The number `-x`."""
        if isinstance(x, Linear):
            return self.like(_with_beyond(self.terms.combine(((-ONE, x),)), x.beyond), x)
        return arith.neg_int(x) if isinstance(x, int) else -x

    @one_number
    def compare(self, op: str, a: Value, b: Value) -> Value:
        """Whether `a op b` holds of two scalars."""
        if isinstance(a, Proposition) or isinstance(b, Proposition):
            equal = choice_of_truths(truth_of(a), truth_of(b), negation(truth_of(b)))
            return decided(equal if op == "==" else negation(equal))
        if isinstance(a, Linear) or isinstance(b, Linear):
            x, y = self._operands(op, a, b)
            if not (is_same_number(x, y) or _is_whole(a, b)):
                x = self.on_both_sides(x, self.terms.subtract(x, y))
            return decided(self.terms.compare(op, x, y))
        _require_numbers(a, b)
        return COMPARED[op](a, b)

    @one_number
    def arithmetic(self, op: str, a: Value, b: Value) -> Value:
        """`+ - * / %` of scalars; of real numbers where this reader does not round.

        NotRecheckedError for `/` and `%` of ints that depend on inputs.
        """
        if isinstance(a, int) and isinstance(b, int):
            return INTS[op](a, b)
        if not isinstance(a, Linear) and not isinstance(b, Linear) and self.is_rounded:
            return FLOATS[op](a, b)
        whole = _is_whole(a, b)
        x, y = self._operands(op, a, b)
        if op == "+":
            result = self.terms.add(x, y)
        elif op == "-":
            result = self.terms.subtract(x, y)
        elif op == "*":
            result = self.terms.multiply(x, y)
        elif op == "/" and not whole:
            self.demand(replace(y, beyond=()))  # it may be 0 where it is not as enclosed
            result = self.terms.divide(x, y)
        else:
            raise NotRecheckedError(f"`{op}` of ints that depend on inputs {NOT_HERE}")
        return self.as_int(result) if whole else self._as_computed(result)

    @one_number
    def extreme(self, name: str, a: Value, b: Value) -> Value:
        """`min` or `max` of two scalars."""
        if not isinstance(a, Linear) and not isinstance(b, Linear):
            _require_numbers(a, b)
            return arith.minimum(a, b) if name == "min" else arith.maximum(a, b)
        x, y = self._operands(name, a, b)
        choose = self.terms.minimum if name == "min" else self.terms.maximum
        # plants: limits keep ends of grids; two numbers that vary: either is a limit
        tight = not self.is_rounded or not (x.is_constant or y.is_constant)
        return self.like(_with_beyond(choose(x, y, tight=tight), x.beyond + y.beyond), a, b)

    @one_number
    def clamp(self, x: Value, low: Value, high: Value) -> Value:
        """The prelude's `clamp`: x between limits; it is a number where these are in order."""
        if isinstance(low, Linear) or isinstance(high, Linear):  # where they meet no rate jumps
            self.add_doubt(self.terms.compare("<=", *self._operands("<=", low, high)))
        else:
            self.add_doubt(self.compare("<=", low, high))
        return self.extreme("min", self.extreme("max", x, low), high)

    def add_doubt_below_zero(self, x: Linear) -> None:
        """Let what is made of the operands rest on that a number is not below 0."""
        self.add_doubt(negation(self.terms.below_zero(x)))

    @one_number
    def builtin(self, name: str, x: Value) -> Value:
        """A built-in function of one scalar; NotRecheckedError where it is not understood."""
        if not isinstance(x, Linear):
            return BUILTINS[name](x)
        argument, x = x, self.finite(x)
        if name == "sqrt":
            if not x.nonnegative:
                self.add_doubt_below_zero(x)
            return self._as_computed(self.terms.apply_function("sqrt", x, nonnegative=True))
        if name == "abs":
            return self.like(self.terms.apply_function("abs", x, nonnegative=True), x)
        if name == "float":
            return Linear(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)
        if name == "int":
            self.demand(argument)  # an int of what is infinite, or no number, is a fault
            if not self._is_floor(x):
                x = self.terms.apply_function("truncated", self.on_both_sides(x))
            return self.as_int(x)
        if name != "floor":
            raise NotRecheckedError(f"`{name}` of what depends on inputs {NOT_HERE}")
        return self.terms.apply_function("floor", self.on_both_sides(x))

    def on_both_sides(self, x: Linear, at: Linear | None = None) -> Linear:
        """A number by which a rate jumps where `at` is 0 (it itself: anywhere), a hair wider.

        So where it touches a jump the rate is any between those on both sides, and never what it is
        there alone, which no solution feels. States alone pass a jump.
        """
        terms, at = self.terms, at or x
        if not self.everywhere or not any(
            terms.atoms[i].kind == "state" for i in inputs_of(terms, [at])
        ):
            return x
        if len(at.terms) == 1:
            terms.compared.update(at.terms)
        if terms.is_beside(at):
            return x
        return replace(
            x, radius=x.radius + HAIR, low=x.low - HAIR, high=x.high + HAIR, nonnegative=False
        )

    def _is_floor(self, x: Linear) -> bool:
        """Whether it is the result of `floor`, a whole number already."""
        if len(x.terms) != 1 or not (x.const.is_zero() and x.radius.is_zero()):
            return False
        ((atom, factor),) = x.terms.items()
        return bool(factor == 1) and self.terms.atoms[atom].kind == "floor"

    def narrow(self, x: Value, low: Value, high: Value) -> Value:
        """`x`, which faults unless it lies between `low` and `high`."""
        if not isinstance(x, Linear):
            return arith.narrow(x, low, high)
        for short in (((ONE, x),), exact(-low)), (((-ONE, x),), exact(high)):
            self.terms.add_obligation(negation(self.terms.below_zero(self.terms.combine(*short))))
        return x

    def like(self, x: Linear, *of: Value) -> Value:
        """`x`, as an int if any operand in `of` is an int."""
        return self.as_int(x) if _is_whole(*of) else x

    def as_int(self, x: Linear) -> Value:
        """An int: exact, and never near the ends of 64 bits; NotRecheckedError beyond 2^53."""
        if not (magnitude(x.low) < 2**53 and magnitude(x.high) < 2**53):
            raise NotRecheckedError(f"an int beyond 2^53 that depends on inputs {NOT_HERE}")
        return SymbolicInt(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)

    def _as_computed(self, x: Linear) -> Linear:
        return self.terms.rounded(x) if self.is_rounded else x

    def _operands(self, op: str, a: Value, b: Value) -> tuple[Linear, Linear]:
        """Two operands as terms; one may be infinite if the result then is, or a limit is not."""
        x, y = self._term(a), self._term(b)
        for one, other in ((x, y), (y, x)):
            large = self.is_rounded and (other.low >= 1 or other.high <= -1)
            small = abs(hull(other.low, other.high)) < SMALL
            added = small and self.is_rounded
            shown = {"*": large, "+": added, "-": added, "/": False, "%": False}.get(op, small)
            if other.beyond or not shown:
                self.finite(one)
        return x, y

    def finite(self, x: Value) -> Linear:
        """A number as a term; what is made of it rests on that it is not infinite."""
        term = self._term(x)
        self.doubts += term.beyond
        return term

    def _term(self, x: Value) -> Linear:
        if isinstance(x, Linear):
            return x
        if isinstance(x, float) and x - x != 0.0:
            raise NotRecheckedError(f"an infinite or undefined number {NOT_HERE}")
        return self.terms.constant(x)


def _with_beyond(x: Linear, beyond: Sequence[Proposition]) -> Linear:
    """A number that may be infinite, unless these hold or it is bounded all the same."""
    bounded = magnitude(x.low).max(magnitude(x.high)) < LARGEST
    return x if bounded or not beyond else replace(x, beyond=tuple(beyond))


def _of_chosen(
    c: Proposition, a: Sequence[Proposition], b: Sequence[Proposition]
) -> list[Proposition]:
    """What must hold of the chosen one of two numbers; what must of both is said once."""
    alone = [either(negation(c), p) for p in a if p not in b]
    alone += [either(c, p) for p in b if p not in a]
    return [*(p for p in a if p in b), *alone]


def _is_whole(*values: Value) -> bool:
    return any(isinstance(x, (int, SymbolicInt)) for x in values)


def _require_numbers(*compared: Value) -> None:
    """NotRecheckedError for a NaN: what it means depends on who compares it."""
    if any(isinstance(x, float) and x != x for x in compared):  # noqa: PLR0124
        raise NotRecheckedError(f"a NaN that is compared {NOT_HERE}")


COMPARED: dict[str, Callable[[Any, Any], bool]] = dict(
    zip(("<", "<=", ">", ">=", "==", "!="), (lt, le, gt, ge, eq, ne), strict=True)
)
INTS: dict[str, Callable[[int, int], int]] = {
    "+": arith.add_int,
    "-": arith.sub_int,
    "*": arith.mul_int,
    "/": arith.div_int,
    "%": arith.mod_int,
}
FLOATS: dict[str, Callable[[float, float], float]] = {
    "+": add,
    "-": sub,
    "*": mul,
    "/": arith.div_float,
}
BUILTINS: dict[str, Callable[[Any], Value]] = {
    "sqrt": arith.sqrt,
    "abs": lambda x: arith.abs_int(x) if isinstance(x, int) else abs(x),
    "floor": arith.floor,
    "float": float,
    "int": arith.int_of_float,
    "seconds": arith.seconds,
}
