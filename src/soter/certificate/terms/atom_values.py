"""Atoms and propositions as values: a line and a range for each atom, bits for each truth.

Purpose: how each kind of atom is enclosed over a form, and which truths are certain.
Non-goals: linear forms (`affine_forms.py`); the rounding of functions of one number
(`arb_balls.py`).

Argument: over the form an atom lies in its range (`bounds`), and is its row times the inputs plus
its constant, up to its spread (`rows`). Arguments come first, so each rule below rests on
lines and ranges that hold already.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.terms.arb_balls import HALF, ONE, UNIVARIATE, ZERO
from soter.certificate.terms.operations import CERTAIN, DEMAND
from soter.certificate.terms.terms import closure

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.certificate.terms.affine_forms import AffineForms, Ends, Row
    from soter.certificate.terms.straight_line import Value
    from soter.certificate.terms.terms import Atom, Linear, Proposition

RANGES = ("spread", "table")
"""Kinds of which nothing but a range is known."""


def make_atoms(forms: AffineForms, roots: Sequence[Linear | Proposition]) -> None:
    """Make the values of every atom that the roots need, arguments first."""
    for index in sorted(closure(forms.terms, roots)):
        atom = forms.terms.atoms[index]
        if index in forms.centre:
            continue
        if atom.kind in ("state", "box"):
            forms.enter_box(index, atom)
            continue
        rule = _univariate if atom.kind in UNIVARIATE else _ATOMS[atom.kind]
        forms.rows[index], forms.bounds[index] = rule(forms, atom)
        if atom.kind not in RANGES:
            _at_most_its_range(forms, index)


def _at_most_its_range(forms: AffineForms, index: int) -> None:
    """A line with a spread above that of the range says less than the range."""
    row, offset, rest = forms.rows[index]
    ends = offset, rest, *forms.bounds[index]
    weight, offset, rest = forms.make.parts("line_or_range", 3, *ends)
    forms.rows[index] = _scaled(weight, row), offset, rest


def _scaled(weight: Value, row: dict[int, Value]) -> dict[int, Value]:
    return {j: weight * x for j, x in row.items()}


def _summed(forms: AffineForms, rows: Sequence[dict[int, Value]]) -> dict[int, Value]:
    """A row out of several."""
    columns = dict.fromkeys(j for row in rows for j in row)
    return {j: forms.make.sum([row[j] for row in rows if j in row]) for j in columns}


def _univariate(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    make = forms.make
    (x,) = atom.arguments
    low, high = forms.range_of(x)
    row, constant, rest = forms.row(x)
    if atom.kind == "max0" and rest is not make.zero:
        least, most = make.parts("range_max0", 2, low, high)
        ends = forms.ends_of_row((row, constant, make.zero))
        slope, offset, spread = make.parts("line_noisy_max0", 3, *ends, rest)
        rest = make.zero
    else:
        slope, offset, spread, least, most = make.parts(f"line_{atom.kind}", 5, low, high)
    if not atom.extra.is_zero():
        spread += atom.extra
        ends = make.constant(atom.low), make.constant(atom.high)
        least, most = forms.within(least - atom.extra, most + atom.extra, *ends)
    line = _scaled(slope, row), slope * constant + offset, abs(slope) * rest + spread
    return line, (least, most)


def _product(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """A b = a_m b + b_m a - a_m b_m + (a - a_m) (b - b_m), a_m and b_m in the middle."""
    make = forms.make
    (al, ah), (bl, bh) = (forms.range_of(x) for x in atom.arguments)
    am, bm = (make.apply("mid", (low + high) * HALF) for low, high in ((al, ah), (bl, bh)))
    ar, br = (make.apply("max", h - m, m - low) for low, m, h in ((al, am, ah), (bl, bm, bh)))
    (row_a, c_a, r_a), (row_b, c_b, r_b) = (forms.row(x) for x in atom.arguments)
    line = (
        _summed(forms, [_scaled(bm, row_a), _scaled(am, row_b)]),
        bm * c_a + am * c_b - am * bm,
        abs(bm) * r_a + abs(am) * r_b + ar * br,
    )
    low, high = make.parts("corners", 2, al, ah, bl, bh)
    return line, (low, high)


def _extreme(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """min(a, b) = b - rest or max(a, b) = b + rest, no further than a and b are."""
    b, rest, a = atom.arguments
    sign = forms.make.constant(-ONE if atom.kind == "min" else ONE)
    (row, c, r), (row_rest, c_rest, r_rest) = forms.row(b), forms.row(rest)
    line = _summed(forms, [row, _scaled(sign, row_rest)]), c + sign * c_rest, r + r_rest
    ends = [forms.range_of(x) for x in (a, b)]
    (_, (bl, bh)), (least, most) = ends, forms.range_of(rest)
    if atom.kind == "min":
        least, most = most, least
    low, high = (forms.make.apply(atom.kind, *pair) for pair in zip(*ends, strict=True))
    return line, forms.within(low, high, bl + sign * least, bh + sign * most)


def _choice(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """A where the condition holds, else b; (a + b)/2 +- |a - b|/2 where it is not certain."""
    make = forms.make
    a, b, difference = atom.arguments
    assert atom.condition is not None
    truth = truth_of(forms, atom.condition)
    (al, ah), (bl, bh), (low, high) = (forms.range_of(x) for x in (a, b, difference))
    gap = make.apply("max", high, -low) * HALF
    weight = make.apply("by_truth", truth, ONE, ZERO, HALF)
    others = make.one - weight
    (row_a, c_a, r_a), (row_b, c_b, r_b) = (forms.row(x) for x in (a, b))
    line = (
        _summed(forms, [_scaled(weight, row_a), _scaled(others, row_b)]),
        weight * c_a + others * c_b,
        weight * r_a + others * r_b + make.apply("by_truth", truth, ZERO, ZERO, gap),
    )
    least, most = make.apply("min", al, bl), make.apply("max", ah, bh)
    low = make.apply("by_truth", truth, al, bl, least)
    return line, (low, make.apply("by_truth", truth, ah, bh, most))


def _spread(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """Anything up to the weighted sizes of its arguments."""
    sizes = [
        weight * forms.make.apply("max", *map(abs, forms.range_of(x)))
        for weight, x in zip(atom.weights, atom.arguments, strict=True)
    ]
    size = forms.make.sum(sizes)
    return ({}, forms.make.zero, size), (-size, size)


def _any(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """The first alternative, and what the others are off it."""
    count = (len(atom.arguments) + 1) // 2
    alternatives, gaps = atom.arguments[:count], atom.arguments[count:]
    row, constant, spread = forms.row(alternatives[0])
    nothing = forms.make.zero, forms.make.zero
    low, high = _hull(forms, [nothing, *map(forms.range_of, gaps)])
    line = row, constant + (low + high) * HALF, spread + (high - low) * HALF
    return line, _hull(forms, [forms.range_of(x) for x in alternatives])


def _hull(forms: AffineForms, intervals: Sequence[Ends]) -> Ends:
    """The ends of the smallest interval around all of them."""
    (low, high), *others = intervals
    for least, most in others:
        low, high = forms.make.apply("min", low, least), forms.make.apply("max", high, most)
    return low, high


def _table(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """Whatever stands between the least and the greatest position."""
    make = forms.make
    values = make.constant(np.array(atom.values).reshape(atom.shape))
    positions: list[Value] = []
    for low, high in (forms.range_of(x) for x in atom.arguments):
        positions += [make.apply("below", low), make.apply("above", high)]
    low, high = make.parts("pick", 2, values, *positions)
    return ({}, (low + high) * HALF, (high - low) * HALF), (low, high)


def truth_of(forms: AffineForms, x: Proposition) -> Value:
    """The bits of a proposition: 0: may be false, 1: may be true."""
    bits: Value = forms.cached("truth", x, partial(_make_truth, forms))
    return bits


def _make_truth(forms: AffineForms, x: Proposition) -> Value:
    make = forms.make
    if x.kind == "constant":
        return make.constant(CERTAIN if x.value else 1)
    if x.kind == "below":
        assert x.argument is not None
        return make.apply("negative" if x.strict else "not_positive", *forms.range_of(x.argument))
    return make.apply(x.kind, *(truth_of(forms, p) for p in x.parts))


def demand(forms: AffineForms, must: Sequence[Proposition]) -> None:
    """Give nothing where something is not certain."""
    for truth in must:
        forms.make.apply(DEMAND, truth_of(forms, truth))


_ATOMS: dict[str, Callable[[AffineForms, Atom], tuple[Row, Ends]]] = {
    "product": _product,
    "choice": _choice,
    "spread": _spread,
    "min": _extreme,
    "max": _extreme,
    "any": _any,
    "table": _table,
}
