"""Operations on the re-checker's values: computed where all numbers are known, terms otherwise.

Purpose: operators, built-in functions and those of the prelude, choices, look-ups in tables.
Non-goals: values (`symbolic_values.py`); expressions and statements (`symbolic_reading.py`); terms
themselves (`certificate/terms/`), those of a solver (`certificate/induction/solver_steps.py`).
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
    as_bool,
    as_truth,
    is_identical,
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
    and_of,
    choice_of_truths,
    input_atoms,
    is_same_number,
    negation,
    or_of,
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
    """Decorates an operation: with the same operand objects it returns the same object again.

    So equal code in a program may cancel, as on the machine. Obligations are added each time.
    """

    @wraps(operation)
    def call_once(self: Operations, *operands: Any) -> Value:  # noqa: ANN401 - as it is declared
        result = operation(self, *operands)
        numbers = (repr(x) if isinstance(x, (bool, int, float, str)) else id(x) for x in operands)
        key = operation.__name__, self.is_rounded, *numbers
        return self.made.setdefault(key, (result, operands))[0]

    return call_once  # type: ignore[return-value]  # of the same type


def remembered_with_doubts(operation: F) -> F:
    """Decorates like `remembered`; results also keep the doubts of operands and operation."""

    @wraps(operation)
    def call_once(self: Operations, *operands: Any) -> Value:  # noqa: ANN401 - as it is declared
        before = len(self.doubts)
        result = operation(self, *operands)
        rests = (d for x in operands if isinstance(x, Linear) for d in x.rests)
        return _with_doubts(result, [*rests, *self.doubts[before:]])

    return remembered(call_once)  # type: ignore[return-value]  # of the same type


def _with_doubts(result: Value, doubts: Sequence[Proposition]) -> Value:
    """The result, known only if `doubts` hold; otherwise a truth may have either value."""
    if isinstance(result, Linear):
        rests = tuple(dict.fromkeys([*result.rests, *doubts]))
        known = rests == result.rests or isinstance(result, SymbolicInt)  # an int is always some
        return result if known else replace(result, rests=rests)
    if not doubts:
        return result
    if isinstance(result, (bool, Proposition)):
        any_truth = Proposition("below", argument=ANYTHING)
        return as_bool(choice_of_truths(reduce(and_of, doubts), as_truth(result), any_truth))
    return result


class Operations:
    """The operators over terms: as the machine computes if `rounded`, else over real numbers.

    On known numbers a function (`sqrt(2.0)`) gives the machine's result, also in a flow.
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
        return as_bool(self.terms.path)

    @path.setter
    def path(self, condition: Value) -> None:
        self.terms.path = as_truth(condition)

    def add_obligation(self, truth: Value) -> None:
        """Adds the obligation that a truth holds wherever the code being read runs."""
        self.terms.add_obligation(as_truth(truth))

    def demand_finite(self, *numbers: Value) -> None:
        """Adds the obligations that these numbers are finite, and no NaN."""
        for x in numbers:
            if isinstance(x, Linear):
                for truth in (*x.rests, *x.beyond):
                    self.terms.add_obligation(truth)

    def add_doubt(self, truth: Value) -> None:
        """Notes that the result of the current operation is known only if a truth holds."""
        if as_bool(as_truth(truth)) is not True:
            self.doubts.append(as_truth(truth))

    @remembered_with_doubts
    def negation(self, a: Value) -> Value:
        """The truth "not `a`"."""
        return as_bool(negation(as_truth(a)))

    @remembered_with_doubts
    def and_of(self, a: Value, b: Value) -> Value:
        """The truth "`a` and `b`"."""
        return as_bool(and_of(as_truth(a), as_truth(b)))

    @remembered_with_doubts
    def or_of(self, a: Value, b: Value) -> Value:
        """The truth "`a` or `b`"."""
        return as_bool(or_of(as_truth(a), as_truth(b)))

    @remembered
    def choice_of(self, of: Type, c: Proposition, a: Value, b: Value) -> Value:
        """`c ? a : b`, leaf by leaf; raises NotRecheckedError for lists of unequal length."""
        if isinstance(a, tuple):
            if len(a) != len(b):
                raise NotRecheckedError(f"a list whose length depends on a branch {NOT_HERE}")
            return tuple(self.choice_of(of, c, x, y) for x, y in zip(a, b, strict=True))
        if isinstance(a, (bool, Proposition)):
            return as_bool(choice_of_truths(c, as_truth(a), as_truth(b)))
        if not isinstance(a, Linear) and not isinstance(b, Linear) and is_identical(a, b):
            return a
        x, y = self._as_term(a), self._as_term(b)
        finite, rests = (_choice_doubts(c, x.beyond, y.beyond), _choice_doubts(c, x.rests, y.rests))
        chosen = _with_finiteness_conditions(self.terms.choose(c, x, y), finite)
        chosen = replace(chosen, rests=()) if chosen.rests else chosen
        return _with_doubts(self.int_if_any(chosen, a, b), rests)

    @remembered_with_doubts
    def negate(self, x: Value) -> Value:
        """The number `-x`."""
        if isinstance(x, Linear):
            return self.int_if_any(
                _with_finiteness_conditions(self.terms.combine(((-ONE, x),)), x.beyond), x
            )
        return arith.neg_int(x) if isinstance(x, int) else -x

    @remembered_with_doubts
    def compare(self, op: str, a: Value, b: Value) -> Value:
        """Whether `a op b` holds of two scalars."""
        if isinstance(a, Proposition) or isinstance(b, Proposition):
            equal = choice_of_truths(as_truth(a), as_truth(b), negation(as_truth(b)))
            return as_bool(equal if op == "==" else negation(equal))
        if isinstance(a, Linear) or isinstance(b, Linear):
            x, y = self._operand_terms(op, a, b)
            if not (is_same_number(x, y) or _is_whole(a, b)):
                x = self.widened_at_jump(x, self.terms.subtract(x, y))
            return as_bool(self.terms.compare(op, x, y))
        _refuse_nan(a, b)
        return COMPARED[op](a, b)

    @remembered_with_doubts
    def arithmetic(self, op: str, a: Value, b: Value) -> Value:
        """`a op b` of scalars for `+ - * / %`; of real numbers if this reader does not round.

        Raises NotRecheckedError for `/` and `%` of ints that depend on inputs.
        """
        if isinstance(a, int) and isinstance(b, int):
            return INTS[op](a, b)
        if not isinstance(a, Linear) and not isinstance(b, Linear) and self.is_rounded:
            return FLOATS[op](a, b)
        whole = _is_whole(a, b)
        x, y = self._operand_terms(op, a, b)
        if op == "+":
            result = self.terms.add(x, y)
        elif op == "-":
            result = self.terms.subtract(x, y)
        elif op == "*":
            result = self.terms.multiply(x, y)
        elif op == "/" and not whole:
            self.demand_finite(replace(y, beyond=()))  # it may be 0 where it is not as enclosed
            result = self.terms.divide(x, y)
        else:
            raise NotRecheckedError(f"`{op}` of ints that depend on inputs {NOT_HERE}")
        return self.as_int(result) if whole else self._rounded_if_needed(result)

    @remembered_with_doubts
    def min_or_max(self, name: str, a: Value, b: Value) -> Value:
        """The `min` or `max` of two scalars; `name` selects which."""
        if not isinstance(a, Linear) and not isinstance(b, Linear):
            _refuse_nan(a, b)
            return arith.minimum(a, b) if name == "min" else arith.maximum(a, b)
        x, y = self._operand_terms(name, a, b)
        choose = self.terms.minimum if name == "min" else self.terms.maximum
        # plants: limits keep ends of grids; two numbers that vary: either is a limit
        tight = not self.is_rounded or not (x.is_constant or y.is_constant)
        return self.int_if_any(
            _with_finiteness_conditions(choose(x, y, tight=tight), x.beyond + y.beyond), a, b
        )

    @remembered_with_doubts
    def clamp(self, x: Value, low: Value, high: Value) -> Value:
        """The prelude's `clamp`: x between two limits; the result assumes low <= high."""
        if isinstance(low, Linear) or isinstance(high, Linear):  # where they meet no rate jumps
            self.add_doubt(self.terms.compare("<=", *self._operand_terms("<=", low, high)))
        else:
            self.add_doubt(self.compare("<=", low, high))
        return self.min_or_max("min", self.min_or_max("max", x, low), high)

    def add_doubt_below_zero(self, x: Linear) -> None:
        """Notes that the result of the operation is known only if `x` is not below 0."""
        self.add_doubt(negation(self.terms.below_zero(x)))

    @remembered_with_doubts
    def result_of_builtin(self, name: str, x: Value) -> Value:
        """The result of a built-in function of a scalar; raises NotRecheckedError if unknown."""
        if not isinstance(x, Linear):
            return BUILTINS[name](x)
        argument, x = x, self.finite_term(x)
        if name == "sqrt":
            if not x.nonnegative:
                self.add_doubt_below_zero(x)
            return self._rounded_if_needed(self.terms.apply_function("sqrt", x, nonnegative=True))
        if name == "abs":
            return self.int_if_any(self.terms.apply_function("abs", x, nonnegative=True), x)
        if name == "float":
            return Linear(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)
        if name == "int":
            self.demand_finite(argument)  # an int of what is infinite, or no number, is a fault
            if not self._is_floor(x):
                x = self.terms.apply_function("truncated", self.widened_at_jump(x))
            return self.as_int(x)
        if name != "floor":
            raise NotRecheckedError(f"`{name}` of what depends on inputs {NOT_HERE}")
        return self.terms.apply_function("floor", self.widened_at_jump(x))

    def widened_at_jump(self, x: Linear, at: Linear | None = None) -> Linear:
        """The number `x`, slightly widened if a rate jumps: where `at`, by default `x`, is 0.

        So at a jump the rate is any value between the rates of both sides, and not only the value
        exactly there, which no solution feels. Only states pass a jump.
        """
        terms, at = self.terms, at or x
        if not self.everywhere or not any(
            terms.atoms[i].kind == "state" for i in input_atoms(terms, [at])
        ):
            return x
        if len(at.terms) == 1:
            terms.compared.update(at.terms)
        if terms.is_outside_state(at):
            return x
        return replace(
            x, radius=x.radius + HAIR, low=x.low - HAIR, high=x.high + HAIR, nonnegative=False
        )

    def _is_floor(self, x: Linear) -> bool:
        """Whether `x` is the result of `floor` and so a whole number already."""
        if len(x.terms) != 1 or not (x.const.is_zero() and x.radius.is_zero()):
            return False
        ((atom, factor),) = x.terms.items()
        return bool(factor == 1) and self.terms.atoms[atom].kind == "floor"

    def demand_between(self, x: Value, low: Value, high: Value) -> Value:
        """`x`, with the obligation that it lies between `low` and `high`."""
        if not isinstance(x, Linear):
            return arith.require_in_range(x, low, high)
        for short in (((ONE, x),), exact(-low)), (((-ONE, x),), exact(high)):
            self.terms.add_obligation(negation(self.terms.below_zero(self.terms.combine(*short))))
        return x

    def int_if_any(self, x: Linear, *of: Value) -> Value:
        """`x`, as an int if one of the operands is an int."""
        return self.as_int(x) if _is_whole(*of) else x

    def as_int(self, x: Linear) -> Value:
        """The term as an exact int; raises NotRecheckedError if it may exceed 2^53."""
        if not (magnitude(x.low) < 2**53 and magnitude(x.high) < 2**53):
            raise NotRecheckedError(f"an int beyond 2^53 that depends on inputs {NOT_HERE}")
        return SymbolicInt(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)

    def _rounded_if_needed(self, x: Linear) -> Linear:
        return self.terms.rounded_term(x) if self.is_rounded else x

    def _operand_terms(self, op: str, a: Value, b: Value) -> tuple[Linear, Linear]:
        """Two operands as terms; adds the doubt that they are finite if `op` needs that."""
        x, y = self._as_term(a), self._as_term(b)
        for one, other in ((x, y), (y, x)):
            large = self.is_rounded and (other.low >= 1 or other.high <= -1)
            small = abs(hull(other.low, other.high)) < SMALL
            added = small and self.is_rounded
            shown = {"*": large, "+": added, "-": added, "/": False, "%": False}.get(op, small)
            if other.beyond or not shown:
                self.finite_term(one)
        return x, y

    def finite_term(self, x: Value) -> Linear:
        """A number as a term; the operation's result is known only if this number is finite."""
        term = self._as_term(x)
        self.doubts += term.beyond
        return term

    def _as_term(self, x: Value) -> Linear:
        if isinstance(x, Linear):
            return x
        if isinstance(x, float) and x - x != 0.0:
            raise NotRecheckedError(f"an infinite or undefined number {NOT_HERE}")
        return self.terms.constant(x)


def _with_finiteness_conditions(x: Linear, beyond: Sequence[Proposition]) -> Linear:
    """The number `x`, maybe infinite unless `beyond` hold; a bounded `x` has none of these."""
    bounded = magnitude(x.low).max(magnitude(x.high)) < LARGEST
    return x if bounded or not beyond else replace(x, beyond=tuple(beyond))


def _choice_doubts(
    c: Proposition, a: Sequence[Proposition], b: Sequence[Proposition]
) -> list[Proposition]:
    """The propositions that `c ? a : b` needs, from those that a and b need."""
    alone = [or_of(negation(c), p) for p in a if p not in b]
    alone += [or_of(c, p) for p in b if p not in a]
    return [*(p for p in a if p in b), *alone]


def _is_whole(*values: Value) -> bool:
    return any(isinstance(x, (int, SymbolicInt)) for x in values)


def _refuse_nan(*compared: Value) -> None:
    """Raises NotRecheckedError for a NaN, because operators treat NaN differently."""
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
