"""Atoms and propositions as values: a line and a range for each atom, bits for each truth.

Purpose: how each kind of atom is enclosed over a form, and which truths are certain.
Non-goals: linear forms (`affine_forms.py`); the rounding of functions of one number
(`arb_balls.py`).

Argument: over the form an atom lies in its range (`bounds`), and is its row times the inputs plus
its constant, up to its spread (`rows`, `tails`). Arguments come first, so each rule below rests on
lines and ranges that hold already.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.terms.arb_balls import HALF, UNIVARIATE
from soter.certificate.terms.operations import CERTAIN
from soter.certificate.terms.terms import closure

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.certificate.terms.affine_forms import AffineForms
    from soter.certificate.terms.straight_line import Value
    from soter.certificate.terms.terms import Atom, Linear, Proposition

    Columns = dict[int, list[Value | None]]

RANGES = ("spread", "table")
"""Kinds of which nothing but a range is known."""


def make_atoms(forms: AffineForms, roots: Sequence[Linear | Proposition]) -> None:
    """Make the values of every atom that the roots need, arguments first."""
    for index in sorted(closure(forms.terms, roots)):
        atom = forms.terms.atoms[index]
        if forms.is_input(atom):
            continue
        if atom.kind in UNIVARIATE:
            _univariate(forms, index, atom)
        else:
            _ATOMS[atom.kind](forms, index, atom)
        if atom.kind not in RANGES:
            _at_most_its_range(forms, index)


def _at_most_its_range(forms: AffineForms, index: int) -> None:
    """A line with a spread above that of the range says less than the range."""
    make = forms.builder
    ends = *forms.tails[index], *forms.bounds[index]
    weight, offset, rest = make.parts("line_or_range", 3, *ends)
    forms.rows[index] = {j: make.apply("mul", weight, x) for j, x in forms.rows[index].items()}
    forms.tails[index] = offset, rest


def _summed(forms: AffineForms, columns: Columns) -> dict[int, Value]:
    """A row out of the summands of each coefficient."""
    return {j: forms.builder.sum(parts) or forms.builder.zero for j, parts in columns.items()}


def _middle(forms: AffineForms, low: Value, high: Value) -> Value:
    return forms.builder.apply("mul", forms.builder.apply("add", low, high), _half(forms))


def _half_width(forms: AffineForms, low: Value, high: Value) -> Value:
    return forms.builder.apply("mul", forms.builder.apply("sub", high, low), _half(forms))


def _half(forms: AffineForms) -> Value:
    return forms.builder.constant(HALF)


def _univariate(forms: AffineForms, index: int, atom: Atom) -> None:
    make = forms.builder
    (x,) = atom.arguments
    low, high = forms.range_of(x)
    row, constant, rest = forms.row(x)
    if atom.kind == "max0" and rest is not None:
        least, most = make.parts("range_max0", 2, low, high)
        centre, radius = forms.centre_and_radius(row, constant, None)
        ends = make.apply("sub", centre, radius), make.apply("add", centre, radius)
        slope, offset, spread = make.parts("line_noisy_max0", 3, *ends, rest)
        rest = None
    else:
        slope, offset, spread, least, most = make.parts(f"line_{atom.kind}", 5, low, high)
    if not atom.extra.is_zero():
        extra = make.constant(atom.extra)
        spread = make.apply("add", spread, extra)
        least = make.apply("larger", make.apply("sub", least, extra), make.constant(atom.low))
        most = make.apply("smaller", make.apply("add", most, extra), make.constant(atom.high))
    forms.rows[index] = {
        j: make.times(slope, make.coefficient(c)) or make.zero for j, c in row.items()
    }
    offset = make.sum([make.times(slope, constant) if constant else None, offset]) or make.zero
    carried = make.times(make.absolute(slope), rest) if rest else None
    forms.tails[index] = offset, make.sum([carried, spread]) or make.zero
    forms.bounds[index] = (least, most)


def _product(forms: AffineForms, index: int, atom: Atom) -> None:
    """A b = a_m b + b_m a - a_m b_m + (a - a_m) (b - b_m), a_m and b_m in the middle."""
    make = forms.builder
    a, b = atom.arguments
    (al, ah), (bl, bh) = forms.range_of(a), forms.range_of(b)
    am, bm = (make.apply("mid", _middle(forms, *ends)) for ends in ((al, ah), (bl, bh)))
    ar, br = (
        make.apply("max", make.apply("sub", high, m), make.apply("sub", m, low))
        for low, m, high in ((al, am, ah), (bl, bm, bh))
    )
    (row_a, c_a, r_a), (row_b, c_b, r_b) = forms.row(a), forms.row(b)
    columns: Columns = {}
    for row, factor in ((row_a, bm), (row_b, am)):
        for j, c in row.items():
            columns.setdefault(j, []).append(make.times(factor, make.coefficient(c)))
    forms.rows[index] = _summed(forms, columns)
    constant = [make.times(f, c) for f, c in ((bm, c_a), (am, c_b)) if c]
    constant.append(make.apply("neg", make.apply("mul", am, bm)))
    spread = [make.times(make.absolute(f), r) for f, r in ((bm, r_a), (am, r_b)) if r]
    spread.append(make.apply("mul", ar, br))
    forms.tails[index] = (make.sum(constant) or make.zero, make.sum(spread) or make.zero)
    low, high = make.parts("corners", 2, al, ah, bl, bh)
    forms.bounds[index] = (low, high)


def _extreme(forms: AffineForms, index: int, atom: Atom) -> None:
    """min(a, b) = b - rest or max(a, b) = b + rest, no further than a and b are."""
    make = forms.builder
    b, rest, a = atom.arguments
    sign = "sub" if atom.kind == "min" else "add"
    columns: dict[int, Value] = {}
    (row, c, r), (row_rest, c_rest, r_rest) = forms.row(b), forms.row(rest)
    for j in row.keys() | row_rest.keys():
        own = make.coefficient(row[j]) if j in row else make.zero
        columns[j] = own
        if j in row_rest:
            columns[j] = make.apply(sign, own, make.coefficient(row_rest[j]))
    forms.rows[index] = columns
    forms.tails[index] = (
        make.apply(sign, c or make.zero, c_rest or make.zero),
        make.sum([r, r_rest]) or make.zero,
    )
    (al, ah), (bl, bh), (least, most) = (forms.range_of(x) for x in (a, b, rest))
    if sign == "sub":
        least, most = most, least
    low, high = make.apply(sign, bl, least), make.apply(sign, bh, most)
    forms.bounds[index] = (
        make.apply("larger", make.apply(atom.kind, al, bl), low),
        make.apply("smaller", make.apply(atom.kind, ah, bh), high),
    )


def _choice(forms: AffineForms, index: int, atom: Atom) -> None:
    """A where the condition holds, else b; (a + b)/2 +- |a - b|/2 where it is not certain."""
    make = forms.builder
    a, b, difference = atom.arguments
    assert atom.condition is not None
    truth = truth_of(forms, atom.condition)
    rows = [forms.row(x) for x in (a, b)]
    (al, ah), (bl, bh) = (forms.range_of(x) for x in (a, b))
    low, high = forms.range_of(difference)
    gap = make.apply("mul", make.apply("max", high, make.apply("neg", low)), _half(forms))
    weight = make.apply("by_truth", truth, make.one, make.zero, _half(forms))
    pairs = list(zip(rows, (weight, make.apply("sub", make.one, weight)), strict=True))
    columns: Columns = {}
    for (row, _, _), w in pairs:
        for j, c in row.items():
            columns.setdefault(j, []).append(make.times(w, make.coefficient(c)))
    forms.rows[index] = _summed(forms, columns)
    constant = [make.times(w, c) for (_, c, _), w in pairs if c]
    spread = [make.times(w, r) for (_, _, r), w in pairs if r]
    spread.append(make.apply("by_truth", truth, make.zero, make.zero, gap))
    forms.tails[index] = (make.sum(constant) or make.zero, make.sum(spread) or make.zero)
    forms.bounds[index] = (
        make.apply("by_truth", truth, al, bl, make.apply("min", al, bl)),
        make.apply("by_truth", truth, ah, bh, make.apply("max", ah, bh)),
    )


def _spread(forms: AffineForms, index: int, atom: Atom) -> None:
    """Anything up to the weighted sizes of its arguments."""
    make = forms.builder
    parts: list[Value | None] = []
    for weight, x in zip(atom.weights, atom.arguments, strict=True):
        sizes = [make.absolute(end) for end in forms.range_of(x)]
        parts.append(make.times(weight, make.apply("max", *sizes)))
    size = make.sum(parts) or make.zero
    forms.rows[index] = {}
    forms.tails[index] = (make.zero, size)
    forms.bounds[index] = (make.apply("neg", size), size)


def _any(forms: AffineForms, index: int, atom: Atom) -> None:
    """The first alternative, and what the others are off it."""
    make = forms.builder
    count = (len(atom.arguments) + 1) // 2
    row, constant, spread = forms.row(atom.arguments[0])
    low = high = make.zero
    for least, most in (forms.range_of(x) for x in atom.arguments[count:]):
        low, high = make.apply("min", low, least), make.apply("max", high, most)
    forms.rows[index] = {j: make.coefficient(c) for j, c in row.items()}
    forms.tails[index] = (
        make.sum([constant, _middle(forms, low, high)]) or make.zero,
        make.sum([spread, _half_width(forms, low, high)]) or make.zero,
    )
    (low, high), *others = (forms.range_of(x) for x in atom.arguments[:count])
    for least, most in others:
        low, high = make.apply("min", low, least), make.apply("max", high, most)
    forms.bounds[index] = (low, high)


def _table(forms: AffineForms, index: int, atom: Atom) -> None:
    """Whatever stands between the least and the greatest position."""
    make = forms.builder
    values = make.constant(np.array(atom.values).reshape(atom.shape))
    positions: list[Value] = []
    for low, high in (forms.range_of(x) for x in atom.arguments):
        positions += [make.apply("below", low), make.apply("above", high)]
    low, high = make.parts("pick", 2, values, *positions)
    forms.rows[index] = {}
    forms.tails[index] = _middle(forms, low, high), _half_width(forms, low, high)
    forms.bounds[index] = (low, high)


def truth_of(forms: AffineForms, x: Proposition) -> Value:
    """The bits of a proposition: 0: may be false, 1: may be true."""
    key = ("truth", id(x))
    if key not in forms.known:
        forms.keep.append(x)
        forms.known[key] = _make_truth(forms, x)
    bits: Value = forms.known[key]
    return bits


def _make_truth(forms: AffineForms, x: Proposition) -> Value:
    make = forms.builder
    if x.kind == "constant":
        return make.constant(CERTAIN if x.value else 1)
    if x.kind == "below":
        assert x.argument is not None
        return make.apply("negative" if x.strict else "not_positive", *forms.range_of(x.argument))
    assert x.kind in ("not", "and", "or"), x.kind
    return make.apply(x.kind, *(truth_of(forms, p) for p in x.parts))


def demand(forms: AffineForms, must: Sequence[Proposition]) -> None:
    """Give nothing where something is not certain."""
    for truth in must:
        forms.builder.demand(truth_of(forms, truth))


_ATOMS: dict[str, Callable[[AffineForms, int, Atom], None]] = {
    "product": _product,
    "choice": _choice,
    "spread": _spread,
    "min": _extreme,
    "max": _extreme,
    "any": _any,
    "table": _table,
}
