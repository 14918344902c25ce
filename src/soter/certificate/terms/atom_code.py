"""Atoms and propositions as code: a line and a range for each atom, a pair of bits for each truth.

Purpose: how each kind of atom is enclosed over a form, and which truths are certain.
Non-goals: linear forms (`affine_forms.py`); the rounding of functions of one number
(`arb_balls.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.terms.arb_balls import UNIVARIATE
from soter.certificate.terms.terms import closure

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.certificate.terms.affine_forms import AffineForms
    from soter.certificate.terms.terms import Atom, Linear, Proposition


RANGES = ("spread", "table")
"""Kinds of which nothing but a range is known."""


def write_atoms(forms: AffineForms, roots: Sequence[Linear | Proposition]) -> None:
    """Write every atom that the roots need, arguments first."""
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
    constant, spread = forms.tails[index]
    low, high = forms.bounds[index]
    code = f"line_or_range({constant}, {spread}, {low}, {high})"
    weight, offset, rest = forms.text.values(code, 3)
    forms.rows[index] = {
        j: forms.text.new(f"{weight}*{factor}") for j, factor in forms.rows[index].items()
    }
    forms.tails[index] = offset, rest


def _univariate(forms: AffineForms, index: int, atom: Atom) -> None:
    (x,) = atom.arguments
    low, high = forms.range_of(x)
    row, constant, rest = forms.row(x)
    if atom.kind == "max0" and rest is not None:
        least, most = forms.text.values(f"range_max0({low}, {high})", 2)
        centre, radius = forms.centre_and_radius(row, constant, None)
        ends = forms.text.new(f"{centre} - {radius}"), forms.text.new(f"{centre} + {radius}")
        code = f"line_noisy_max0({ends[0]}, {ends[1]}, {rest})"
        slope, offset, spread = forms.text.values(code, 3)
        rest = None
    else:
        code = f"line_{atom.kind}({low}, {high})"
        slope, offset, spread, least, most = forms.text.values(code, 5)
    if not atom.extra.is_zero():
        extra = forms.text.constant(atom.extra)
        spread = forms.text.new(f"{spread} + {extra}")
        least = forms.text.new(f"larger({least} - {extra}, {forms.text.constant(atom.low)})")
        most = forms.text.new(f"smaller({most} + {extra}, {forms.text.constant(atom.high)})")
    forms.rows[index] = {
        j: forms.text.new(f"{slope}*{forms.text.code(factor)}") for j, factor in row.items()
    }
    forms.tails[index] = (
        forms.text.new(f"{slope}*{constant} + {offset}" if constant else offset),
        forms.text.new(f"abs({slope})*{rest} + {spread}" if rest else spread),
    )
    forms.bounds[index] = (least, most)


def _product(forms: AffineForms, index: int, atom: Atom) -> None:
    a, b = atom.arguments
    (al, ah), (bl, bh) = forms.range_of(a), forms.range_of(b)
    am, bm = (forms.text.new(f"(({lo} + {hi})*HALF).mid()") for lo, hi in ((al, ah), (bl, bh)))
    ar, br = (
        forms.text.new(f"({hi} - {m}).max({m} - {lo})")
        for lo, m, hi in ((al, am, ah), (bl, bm, bh))
    )
    (row_a, c_a, r_a), (row_b, c_b, r_b) = forms.row(a), forms.row(b)
    columns: dict[int, list[str]] = {}
    for row, factor in ((row_a, bm), (row_b, am)):
        for j, c in row.items():
            columns.setdefault(j, []).append(f"{factor}*{forms.text.code(c)}")
    forms.rows[index] = {j: forms.text.new(" + ".join(parts)) for j, parts in columns.items()}
    constant = [f"{f}*{c}" for f, c in ((bm, c_a), (am, c_b)) if c] + [f"(-{am}*{bm})"]
    spread = [f"abs({f})*{r}" for f, r in ((bm, r_a), (am, r_b)) if r] + [f"{ar}*{br}"]
    forms.tails[index] = (forms.text.new(" + ".join(constant)), forms.text.new(" + ".join(spread)))
    ends = forms.text.new(f"corners({al}, {ah}, {bl}, {bh})")
    forms.bounds[index] = (f"{ends}[0]", f"{ends}[1]")


def _extreme(forms: AffineForms, index: int, atom: Atom) -> None:
    """min(a, b) = b - rest or max(a, b) = b + rest, no further than a and b are."""
    b, rest, a = atom.arguments
    sign = "-" if atom.kind == "min" else "+"
    columns: dict[int, str] = {}
    (row, c, r), (row_rest, c_rest, r_rest) = forms.row(b), forms.row(rest)
    for j in row.keys() | row_rest.keys():
        parts = [forms.text.code(row[j])] if j in row else ["ZERO"]
        parts += [f"{sign} {forms.text.code(row_rest[j])}"] if j in row_rest else []
        columns[j] = forms.text.new(" ".join(parts))
    forms.rows[index] = columns
    forms.tails[index] = (
        forms.text.new(f"{c or 'ZERO'} {sign} {c_rest or 'ZERO'}"),
        forms.text.sum([r, r_rest]) or "ZERO",
    )
    (al, ah), (bl, bh), (least, most) = (forms.range_of(x) for x in (a, b, rest))
    if sign == "-":
        least, most = most, least
    low, high = forms.text.new(f"{bl} {sign} {least}"), forms.text.new(f"{bh} {sign} {most}")
    forms.bounds[index] = (
        forms.text.new(f"larger({al}.{atom.kind}({bl}), {low})"),
        forms.text.new(f"smaller({ah}.{atom.kind}({bh}), {high})"),
    )


def _choice(forms: AffineForms, index: int, atom: Atom) -> None:
    a, b, difference = atom.arguments
    assert atom.condition is not None
    truth = truth_of(forms, atom.condition)
    rows = [forms.row(x) for x in (a, b)]
    ranges = [forms.range_of(x) for x in (a, b)]
    low, high = forms.range_of(difference)
    gap = forms.text.new(f"{high}.max(-{low})*HALF")
    weight = forms.text.new(f"by_truth({truth}, ONE, ZERO, HALF)")
    other = forms.text.new(f"ONE - {weight}")
    columns: dict[int, list[str]] = {}
    for (row, _, _), w in zip(rows, (weight, other), strict=True):
        for j, c in row.items():
            columns.setdefault(j, []).append(f"{w}*{forms.text.code(c)}")
    forms.rows[index] = {j: forms.text.new(" + ".join(parts)) for j, parts in columns.items()}
    pairs = list(zip(rows, (weight, other), strict=True))
    constant = [f"{w}*{c}" for (_, c, _), w in pairs if c]
    spread = [f"{w}*{r}" for (_, _, r), w in pairs if r]
    spread.append(f"by_truth({truth}, ZERO, ZERO, {gap})")
    forms.tails[index] = (
        forms.text.new(" + ".join(constant)) if constant else "ZERO",
        forms.text.new(" + ".join(spread)),
    )
    (al, ah), (bl, bh) = ranges
    forms.bounds[index] = (
        forms.text.new(f"by_truth({truth}, {al}, {bl}, {al}.min({bl}))"),
        forms.text.new(f"by_truth({truth}, {ah}, {bh}, {ah}.max({bh}))"),
    )


def _spread(forms: AffineForms, index: int, atom: Atom) -> None:
    parts: list[str | None] = []
    for weight, x in zip(atom.weights, atom.arguments, strict=True):
        low, high = forms.range_of(x)
        parts.append(forms.text.times(weight, f"abs({low}).max(abs({high}))"))
    size = forms.text.sum(parts) or "ZERO"
    forms.rows[index] = {}
    forms.tails[index] = ("ZERO", size)
    forms.bounds[index] = (f"(-{size})", size)


def _any(forms: AffineForms, index: int, atom: Atom) -> None:
    """The first alternative, and what the others are off it."""
    count = (len(atom.arguments) + 1) // 2
    row, constant, spread = forms.row(atom.arguments[0])
    gaps = [forms.range_of(x) for x in atom.arguments[count:]]
    low = forms.text.new("ZERO" + "".join(f".min({low})" for low, _ in gaps))
    high = forms.text.new("ZERO" + "".join(f".max({high})" for _, high in gaps))
    forms.rows[index] = {j: forms.text.new(forms.text.code(c)) for j, c in row.items()}
    middle = forms.text.new(f"({low} + {high})*HALF")
    half = forms.text.new(f"({high} - {low})*HALF")
    forms.tails[index] = (
        forms.text.new(f"{constant} + {middle}") if constant else middle,
        forms.text.new(f"{spread} + {half}") if spread else half,
    )
    first, *others = (forms.range_of(x) for x in atom.arguments[:count])
    forms.bounds[index] = (
        forms.text.new(first[0] + "".join(f".min({low})" for low, _ in others)),
        forms.text.new(first[1] + "".join(f".max({high})" for _, high in others)),
    )


def _table(forms: AffineForms, index: int, atom: Atom) -> None:
    values = f"T{index}"
    forms.text.names[values] = np.array(atom.values).reshape(atom.shape)
    ranges = [forms.range_of(x) for x in atom.arguments]
    positions = ", ".join(f"below({low}), above({high})" for low, high in ranges)
    ends = forms.text.new(f"pick({values}, {positions})")
    low, high = forms.text.new(f"{ends}[0]"), forms.text.new(f"{ends}[1]")
    forms.rows[index] = {}
    forms.tails[index] = (
        forms.text.new(f"({low} + {high})*HALF"),
        forms.text.new(f"({high} - {low})*HALF"),
    )
    forms.bounds[index] = (low, high)


def truth_of(forms: AffineForms, x: Proposition) -> str:
    """A name for the bits of a proposition: 0: may be false, 1: may be true."""
    key = ("truth", id(x))
    if key not in forms.known:
        forms.keep.append(x)
        forms.known[key] = _make_truth(forms, x)
    name: str = forms.known[key]
    return name


def _make_truth(forms: AffineForms, x: Proposition) -> str:
    if x.kind == "constant":
        return "2" if x.value else "1"
    if x.kind == "below":
        assert x.argument is not None
        low, high = forms.range_of(x.argument)
        if x.strict:
            return forms.text.new(f"bits({high} < 0, {low} >= 0)")
        return forms.text.new(f"bits({high} <= 0, {low} > 0)")
    parts = [truth_of(forms, p) for p in x.parts]
    if x.kind == "not":
        return forms.text.new(f"NOT[{parts[0]}]")
    a, b = parts
    if x.kind == "and":
        return forms.text.new(f"(({a} | {b}) & 1) | ({a} & {b} & 2)")
    assert x.kind == "or", x.kind
    return forms.text.new(f"(({a} | {b}) & 2) | ({a} & {b} & 1)")


def demand(forms: AffineForms, must: Sequence[Proposition]) -> None:
    """Give back None where something is not certain."""
    for truth in must:
        name = truth_of(forms, truth)
        if forms.text.names.get(name) != 2:
            forms.text.lines.append(f"if {name} != 2: return None")


_ATOMS: dict[str, Callable[[AffineForms, int, Atom], None]] = {
    "product": _product,
    "choice": _choice,
    "spread": _spread,
    "min": _extreme,
    "max": _extreme,
    "any": _any,
    "table": _table,
}
