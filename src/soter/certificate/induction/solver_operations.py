"""Operations on values of inductions: exact on truths, ints and enums, opaque on floats.

Purpose: operators and built-in functions: computed where all is known; ages are compared as whole
nanoseconds; of floats nothing is known but that the same operation on the same values is the same.
And what goes wrong: `fault` and `doubt`.
Non-goals: statements and expressions (`solver_reading.py`).
"""

from __future__ import annotations

from bisect import bisect_left
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.induction.solver_values import (
    LARGEST,
    OPAQUE,
    SMALLEST,
    Elapsed,
    applied,
    both,
    either,
    negation,
    one_of,
    shaped,
    term,
)
from soter.certificate.reading.symbolic_operations import BUILTINS, COMPARED, FLOATS, INTS
from soter.certificate.reading.symbolic_values import is_known
from soter.certificate.terms.terms import NotRecheckedError
from soter.language.evaluate import arithmetic
from soter.language.model.types import FloatType

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.types import Type

Term = Any


class SolverOperations:
    """What operators give; what is known of the terms goes to `facts`."""

    negation, both, one_of = staticmethod(negation), staticmethod(both), staticmethod(one_of)

    def __init__(self, facts: list[Term]) -> None:
        self.facts = facts
        self.path: Term = True
        """Under which condition the code being read runs."""
        self.fault: Term = False
        self.doubt: Term = False
        """That a function which is not read faults, or compares a NaN."""

    def oblige(self, what: Term) -> None:
        """Else the step faults, wherever the code being read runs."""
        self.fault = one_of(self.fault, both(self.path, negation(what)))

    def suspect(self, doubt: Term) -> None:
        """That it may fault there."""
        self.doubt = one_of(self.doubt, both(self.path, doubt))

    def join(self, of: Type, c: Term, a: Term, b: Term) -> Term:
        """`c ? a : b`."""
        return either(c, shaped(of, a, self.facts), shaped(of, b, self.facts))

    def negated(self, x: Term) -> Term:
        """Minus x."""
        if is_known(x):
            return arithmetic.neg_int(x) if isinstance(x, int) else -x
        if is_float(x):
            return z3.Function("floats negated", OPAQUE, OPAQUE)(term(x))
        self.oblige(x != SMALLEST)
        return -x

    def compared(self, op: str, a: Term, b: Term) -> Term:
        """Two scalars compared."""
        if isinstance(a, Elapsed) and isinstance(b, float):
            return age_compared(op, a.ns, b)
        if isinstance(a, float) and isinstance(b, Elapsed):
            return age_compared(op.translate(str.maketrans("<>", "><")), b.ns, a)
        if (is_float(a) or is_float(b)) and not (is_known(a) and is_known(b)):
            return of_floats(op, a, b, z3.BoolSort())
        return COMPARED[op](a, b)

    def arithmetic(self, op: str, a: Term, b: Term) -> Term:
        """+ - * / % on scalars; NotRecheckedError for a division by what is not known."""
        if is_known(a) and is_known(b):
            return INTS[op](a, b) if isinstance(a, int) else FLOATS[op](a, b)
        if is_float(a) or is_float(b):
            if op == "/":
                raise NotRecheckedError("a division of floats outside of a function")
            return of_floats(op, a, b, OPAQUE)
        if op in "/%":
            return self._divided(op, a, b)
        value = a + b if op == "+" else a - b if op == "-" else a * b
        self.oblige(both(value >= SMALLEST, value <= LARGEST))
        return value

    def _divided(self, op: str, a: Term, b: Term) -> Term:
        if not isinstance(b, int) or b == 0:
            raise NotRecheckedError("a division by what is not known")
        size = z3.If(a >= 0, a, -a) / abs(b)
        q = z3.If(a >= 0 if b > 0 else a < 0, size, -size)
        if op == "%":  # of the smallest one by -1 it is 0
            return a - q * b
        if b == -1:
            self.oblige(a != SMALLEST)
        return q

    def extreme(self, name: str, a: Term, b: Term) -> Term:
        """`min` or `max` of two scalars."""
        if is_known(a) and is_known(b):
            return arithmetic.minimum(a, b) if name == "min" else arithmetic.maximum(a, b)
        if is_float(a) or is_float(b):
            return applied(f"built in {name}", [a, b], FloatType(), self.facts)
        return z3.If(b < a if name == "min" else b > a, term(b), term(a))

    def builtin(self, name: str, x: Term) -> Term:
        """A built-in function of one scalar; NotRecheckedError for a float that becomes an int."""
        if is_known(x):
            return BUILTINS[name](x)
        if name == "abs" and not is_float(x):
            self.oblige(x != SMALLEST)
            return z3.If(x < 0, -x, x)
        if name == "int":
            raise NotRecheckedError(f"`{name}` outside of a function")
        return applied(f"built in {name}", [x], FloatType(), self.facts)

    def narrowed(self, x: Term, low: int, high: int) -> Term:
        """X, which faults unless it lies there."""
        if is_known(x):
            return arithmetic.narrow(x, low, high)
        self.oblige(both(x >= low, x <= high))
        return x


def is_float(x: Term) -> bool:
    """Whether a scalar is one."""
    return isinstance(x, (float, Elapsed)) or (z3.is_expr(x) and x.sort() == OPAQUE)


def of_floats(op: str, a: Term, b: Term, sort: Any) -> Term:  # noqa: ANN401 - a sort
    """What a machine operation gives: the same for the same."""
    return z3.Function(f"floats {op}", OPAQUE, OPAQUE, sort)(term(a), term(b))


def is_nan(x: Term) -> Term:
    """Whether a float is none."""
    if isinstance(x, float):
        return x != x  # noqa: PLR0124 - NaN
    return z3.Function("floats NaN", OPAQUE, z3.BoolSort())(term(x))


# ---------------------------------------------------------------- ages


def age_compared(op: str, ns: Term, limit: float) -> Term:
    """`float(ns) / 1e9 op limit`, by the least whole nanoseconds that reach it, and exceed it."""
    if limit != limit:  # noqa: PLR0124 - NaN
        return op == "!="
    least = _first(lambda n: n / 1e9 >= limit)
    beyond = _first(lambda n: n / 1e9 > limit)
    if op in ("==", "!="):
        equal = both(ns >= least, ns < beyond)
        return equal if op == "==" else negation(equal)
    return {"<": ns < least, ">=": ns >= least, "<=": ns < beyond, ">": ns >= beyond}[op]


def _first(there: Callable[[int], bool]) -> int:
    """The least n from which on it is so; more than any age where it never is."""
    return bisect_left(range(LARGEST), x=True, hi=LARGEST, key=there)
