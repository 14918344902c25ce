"""How fast a term grows in one input, over the ranges of all.

Purpose: `slope`: a ball around every derivative, at kinks around Clarke's.
Non-goals: terms (`terms/terms.py`).

The argument is the chain rule, atom by atom, with the range of each atom for its value: by the mean
value theorem (Lebourg's, of functions that are Lipschitz) a term differs between two values of the
input by something in that ball times how far these are apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.terms.arb_balls import HALF, ONE, UNIT, ZERO, hull
from soter.certificate.terms.terms import closure, inputs_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from flint import arb

    from soter.certificate.terms.terms import Atom, Linear, Proposition, Terms


class NoSlopeError(Exception):
    """The term may jump, or nothing is known of it."""


def slope(terms: Terms, x: Linear, at: int) -> arb:
    """Of a term in the input that is atom `at`; NoSlopeError where there may be none."""
    slopes: dict[int, arb] = {at: ONE}

    def of(x: Linear) -> arb:
        if not x.radius.is_zero():
            raise NoSlopeError
        return sum((c * slopes[a] for a, c in x.terms.items()), ZERO)

    for index in sorted(closure(terms, [x])):
        atom = terms.atoms[index]
        if index == at:
            continue
        roots: list[Linear | Proposition] = [*atom.arguments]
        roots += [] if atom.condition is None else [atom.condition]
        if at not in inputs_of(terms, roots):
            slopes[index] = ZERO
            continue
        if not atom.extra.is_zero() or atom.kind not in _RULES:
            raise NoSlopeError
        slopes[index] = _RULES[atom.kind](atom, [of(y) for y in atom.arguments])
    return of(x)


def _range(x: Linear) -> arb:
    return hull(x.low, x.high)


def _of_one(factor: Callable[[arb], arb]) -> Callable[[Atom, list[arb]], arb]:
    """The rule of a function of one number: the derivative over its range."""
    return lambda atom, slopes: factor(_range(atom.arguments[0])) * slopes[0]


def _kinked(beneath: arb, between: arb) -> Callable[[Atom, list[arb]], arb]:
    """The same of max(x, 0) and |x|: one of two functions where x keeps its sign."""

    def rule(atom: Atom, slopes: list[arb]) -> arb:
        (x,) = atom.arguments
        return slopes[0] * (ONE if x.low >= 0 else beneath if x.high <= 0 else between)

    return rule


def _product(atom: Atom, slopes: list[arb]) -> arb:
    a, b = map(_range, atom.arguments)
    return a * slopes[1] + b * slopes[0]


def _extreme(_: Atom, slopes: list[arb]) -> arb:
    return slopes[0].union(slopes[2])


_RULES: dict[str, Callable[[Atom, list[arb]], arb]] = {
    "product": _product,
    "min": _extreme,
    "max": _extreme,
    "max0": _kinked(ZERO, hull(ZERO, ONE)),
    "abs": _kinked(-ONE, UNIT),
    "square": _of_one(lambda x: 2 * x),
    "inverse": _of_one(lambda x: -((1 / x) ** 2)),
    "sqrt": _of_one(lambda x: HALF / x.sqrt()),
    "soft_sign": _of_one(lambda x: (1 / (1 + abs(x))) ** 2),
    "sin": _of_one(lambda x: x.cos()),
    "cos": _of_one(lambda x: -x.sin()),
    "exp": _of_one(lambda x: x.exp()),
    "log": _of_one(lambda x: 1 / x),
    "tanh": _of_one(lambda x: 1 - x.tanh() ** 2),
    "atan": _of_one(lambda x: 1 / (1 + x * x)),
    "tan": _of_one(lambda x: 1 + x.tan() ** 2),
}
