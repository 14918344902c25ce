"""Terms (`terms.py`) become functions over a whole set of states, programs of `straight_line.py`.

Purpose: each function takes the *form* of a set (below). `compile_step` gives the form of what the
terms make of it, with ranges that are wanted; `compile_lines` rows over the states that hold all
over the form; `compile_truths` what is known of propositions there, `all_certain` of them over
whole ranges. To make them, `AffineForms` has a row and a range of every `Linear`, once
`enter_atoms` has made those of its atoms.
Non-goals: reading programs (`reading/symbolic_reading.py`), which sets to check
(`grid/sc_chains.py`, `cell_predicates.py`), how programs run (`straight_line.py`).

Argument: over the form an atom lies in its range (`bounds`), and is its row times the inputs plus
its constant, up to its spread (`rows`). Arguments come first, so each rule below rests on
lines and ranges that hold already.

The form of a set is a flat tuple: for each state an interval l, h; then for each the centre m, the
coefficients g on the symbols of the cell, the radius b of the rest:

    x in { m + sum g[k] eps_k + b beta : eps_k, beta in [-1, 1] }   and   x in [l, h]

eps_k are shared by all states, beta is its own for each state. With no symbols it is a box. States
may be followed by *memories*, commands that still act: what they have in common with the betas of
the states stands in coefficients a, and only their remainder has a beta of its own:

    u in { m + sum g[k] eps_k + sum a[i] b[i] beta_i + b beta }
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from soter.certificate.extras import extras
from soter.certificate.terms.linear_enclosures import HALF, ONE, ZERO, exact
from soter.certificate.terms.straight_line import (
    CERTAIN,
    DEMAND,
    Builder,
    Function,
    apply_operation,
)
from soter.certificate.terms.terms import atoms_under, input_atoms

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.certificate.terms.straight_line import Value
    from soter.certificate.terms.terms import Atom, Linear, Proposition, Terms

    Row = tuple[dict[int, Value], Value, Value]
    """Coefficients over the states of a form and what else is free, a constant, a spread."""
    Ends = tuple[Value, Value]
    Step = Callable[[tuple[arb, ...]], "tuple[tuple[arb, ...], tuple[float, ...]] | None"]


COARSE = exact(2.0**-20)
"""Where rounding may matter as much, what is known of a number anywhere is asked, too."""
TAIL = 4
"""Behind the coefficients of a row: constant, spread, low, high."""


class AffineForms:
    """Rows and ranges of terms over the form of a set, as values of a program (`make`)."""

    def __init__(
        self,
        terms: Terms,
        states: Sequence[int],
        symbols: int,
        boxes: Mapping[int, tuple[arb, arb]],
        *,
        noisy: bool = False,
    ) -> None:
        """`noisy`: after the form follows a noise for each state, which is added to the state."""
        self.terms, self.states, self.boxes = terms, states, boxes
        self.make = make = Builder()
        self.symbols = range(symbols)
        n = len(states)
        self.length = (4 + symbols + noisy) * n
        """How many numbers a form has: ends, centres, coefficients on symbols, rests; noises."""
        inputs = [make.input_at(i) for i in range(self.length)]
        self.centre = dict(zip(states, inputs[2 * n :], strict=False))
        self.symbol = {a: inputs[3 * n + i * symbols :] for i, a in enumerate(states)}
        self.rest = dict(zip(states, inputs[(3 + symbols) * n :], strict=False))
        self.rows: dict[int, Row] = {a: ({a: make.one}, make.zero, make.zero) for a in states}
        """Atom -> its line, a row that encloses it."""
        self.free: dict[int, Ends] = {}
        """The middle and half of the width of each input that the form does not describe: its
        columns stay in the rows, so that what comes of one several ways may cancel, until the rows
        are over the form. The noise of a state is another one, numbered below 0."""
        for a, noise in zip(states, inputs[(4 + symbols) * n :], strict=False):
            self.free[-1 - a] = make.zero, noise
            self.rows[a][0][-1 - a] = make.one
        self.bounds: dict[int, Ends] = {
            a: (inputs[2 * i], inputs[2 * i + 1]) for i, a in enumerate(states)
        }
        """Atom -> the ends of its range."""
        self._known: dict[tuple[str, int], Any] = {}
        self._keep: list[object] = []

    def enter_box(self, index: int, atom: Atom) -> None:
        """Enters row and range of an input outside the form, from its box or its domain."""
        low, high = self.boxes.get(index, (atom.low, atom.high))
        middle, half = (low + high) * HALF, (high - low) * HALF
        self.free[index] = self.make.constant(middle), self.make.constant(half)
        self.rows[index] = {index: self.make.one}, self.make.zero, self.make.zero
        self.bounds[index] = self.make.constant(low), self.make.constant(high)

    def value_made_once(self, kind: str, x: object, made_of: Callable[[Any], Any]) -> Any:  # noqa: ANN401
        """The value `made_of(x)`, made once for each kind and x."""
        key = (kind, id(x))
        if key not in self._known:
            self._keep.append(x)
            self._known[key] = made_of(x)
        return self._known[key]

    def row_of(self, x: Linear) -> Row:
        """The row of a term: coefficients over states and free inputs, a constant, a spread."""
        row: Row = self.value_made_once("row", x, self._new_row)
        return row

    def _new_row(self, x: Linear) -> Row:
        columns: dict[int, list[Value]] = {}
        constants: list[arb | Value] = [x.const]
        spreads: list[arb | Value] = [x.radius]
        for a, c in x.terms.items():
            row, constant, spread = self.rows[a]
            for j, factor in row.items():
                columns.setdefault(j, []).append(c * factor)
            constants.append(c * constant)
            spreads.append(abs(c) * spread)
        sums = {j: self.make.sum(parts) for j, parts in columns.items()}
        return sums, self.make.sum(constants), self.make.sum(spreads)

    def row_over_states(self, row: Row) -> Row:
        """The row with the inputs outside the form moved into its constant and spread."""
        factors, constant, spread = row
        free = [(f, *self.free[a]) for a, f in factors.items() if a in self.free]
        return (
            {a: f for a, f in factors.items() if a not in self.free},
            self.make.sum([constant, *(f * middle for f, middle, _ in free)]),
            self.make.sum([spread, *(abs(f) * half for f, _, half in free)]),
        )

    def row_over_form(self, row: Row) -> tuple[Value, list[Value], Value]:
        """A row over the form: its centre, coefficients on the symbols, and radius of the rest."""
        factors, constant, spread = self.row_over_states(row)
        total = self.make.sum
        return (
            total([constant, *(f * self.centre[a] for a, f in factors.items())]),
            [total([f * self.symbol[a][k] for a, f in factors.items()]) for k in self.symbols],
            total([spread, *(abs(f) * self.rest[a] for a, f in factors.items())]),
        )

    def row_ends(self, row: Row) -> Ends:
        """The ends of the interval in which a row lies on the set."""
        centre, symbols, rest = self.row_over_form(row)
        radius = self.make.sum([rest, *map(abs, symbols)])
        return centre - radius, centre + radius

    def term_ends(self, x: Linear) -> Ends:
        """The ends of a term's range on the set; a limit that is reached exactly stays exact."""
        ends: Ends = self.value_made_once("range", x, self._new_range)
        return ends

    def _new_range(self, x: Linear) -> Ends:
        low, high = self.row_ends(self.row_of(x))
        states = sum(a in self.centre for a in x.terms)
        others = any(self.terms.atoms[a].kind not in ("state", "box") for a in x.terms)
        if states == (0 if others else 1):
            low, high = self.tighter_ends(low, high, *self.term_ends_by_atoms(x))
        if x.nonnegative:
            low = self.make.apply("larger", low, self.make.zero)
        if x.rounds:
            least, most = map(self.make.apply, ("round_down", "round_up"), self.term_ends(x.rounds))
            low, high = self.tighter_ends(least, most, low, high)
        if x.radius > COARSE:
            low, high = self.tighter_ends(low, high, *map(self.make.constant, (x.low, x.high)))
        return low, high

    def tighter_ends(self, low: Value, high: Value, least: Value, most: Value) -> Ends:
        """The tighter ends of two ranges, both of which hold."""
        return self.make.apply("larger", low, least), self.make.apply("smaller", high, most)

    def term_ends_by_atoms(self, x: Linear) -> Ends:
        """The range of a term from the ranges of its atoms; exact if a limit is reached."""
        lows: list[arb | Value] = [x.const - x.radius]
        highs: list[arb | Value] = [x.const + x.radius]
        for a, c in x.terms.items():
            ends = [c * end for end in self.bounds[a]]
            if not (c >= 0 or c <= 0):  # a sign that is not certain
                ends = [self.make.apply(name, *ends) for name in ("min", "max")]
            low, high = reversed(ends) if c <= 0 else ends
            lows.append(low)
            highs.append(high)
        return self.make.sum(lows), self.make.sum(highs)


def enter_atoms(forms: AffineForms, roots: Sequence[Linear | Proposition]) -> None:
    """Enters row and range of each atom that the roots need; arguments come first."""
    for index in sorted(atoms_under(forms.terms, roots)):
        atom = forms.terms.atoms[index]
        if index in forms.centre:
            continue
        if atom.kind in ("state", "box"):
            forms.enter_box(index, atom)
            continue
        forms.rows[index], forms.bounds[index] = _ATOMS.get(atom.kind, _enclose_function)(
            forms, atom
        )
        if atom.kind not in ("spread", "table"):  # of these only a range is known
            _replace_row_by_range(forms, index)


def _replace_row_by_range(forms: AffineForms, index: int) -> None:
    """Replaces the row of an atom by its range if the range has the smaller spread."""
    row, offset, rest = forms.rows[index]
    _, _, more = forms.row_over_states((row, forms.make.zero, forms.make.zero))
    ends = offset, rest, *forms.bounds[index], more
    weight, offset, rest = forms.make.apply_for_parts("line_or_range", 3, *ends)
    forms.rows[index] = _scale_row(weight, row), offset, rest


def _scale_row(weight: Value, row: dict[int, Value]) -> dict[int, Value]:
    """A row times a weight; a weight of 0 gives 0 even if the row is infinite."""
    return {j: weight.make.apply("share", weight, x) for j, x in row.items()}


def _add_rows(forms: AffineForms, rows: Sequence[dict[int, Value]]) -> dict[int, Value]:
    columns = dict.fromkeys(j for row in rows for j in row)
    return {j: forms.make.sum([row[j] for row in rows if j in row]) for j in columns}


def _enclose_function(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """The row and range of a function: its line, applied to the rows of its arguments."""
    make = forms.make
    ends = [end for x in atom.arguments for end in forms.term_ends(x)]
    rows, constants, rests = zip(*map(forms.row_of, atom.arguments), strict=True)
    parts = make.apply_for_parts(f"line_{atom.kind}", len(rows) + 4, *ends)
    *slopes, offset, spread, least, most = parts
    if not atom.extra.is_zero():
        off, over = (atom.share * abs(end) + atom.extra for end in (least, most))
        spread += make.apply("max", off, over)
        known = make.constant(atom.low), make.constant(atom.high)
        least, most = forms.tighter_ends(least - off, most + over, *known)
    line = (
        _add_rows(forms, list(map(_scale_row, slopes, rows))),
        make.sum([*(s * c for s, c in zip(slopes, constants, strict=True)), offset]),
        make.sum([*(abs(s) * r for s, r in zip(slopes, rests, strict=True)), spread]),
    )
    return line, (least, most)


def _enclose_max0(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """Row and range of max(x, 0): free inputs in x are noise, unless x is never negative."""
    make, (x,) = forms.make, atom.arguments
    row, constant, rest = forms.row_of(x)
    states, middle, noise = forms.row_over_states((row, constant, rest))
    if noise is make.zero:
        return _enclose_function(forms, atom)
    ends = forms.row_ends((states, middle, make.zero))
    slope, kept, offset, spread = make.apply_for_parts("line_noisy_max0", 4, *ends, noise)
    free = {a: f for a, f in row.items() if a in forms.free}
    moved = make.sum(f * forms.free[a][0] for a, f in free.items())
    line = (
        {**_scale_row(slope, states), **_scale_row(kept, free)},
        make.sum([slope * middle, offset, -(kept * moved)]),
        make.sum([kept * rest, spread]),
    )
    low, high = make.apply_for_parts("range_max0", 2, *forms.term_ends(x))
    return line, (low, high)


def _enclose_product(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """Row and range of a b = a_m b + b_m a - a_m b_m + (a - a_m) (b - b_m), by middles a_m, b_m."""
    make = forms.make
    ends = [forms.term_ends(x) for x in atom.arguments]
    a_m, b_m = (make.apply("mid", (low + high) * HALF) for low, high in ends)
    pairs = zip(ends, (a_m, b_m), strict=True)
    radius_a, radius_b = (make.apply("max", high - m, m - low) for (low, high), m in pairs)
    (row_a, constant_a, spread_a), (row_b, constant_b, spread_b) = map(forms.row_of, atom.arguments)
    line = (
        _add_rows(forms, [_scale_row(b_m, row_a), _scale_row(a_m, row_b)]),
        b_m * constant_a + a_m * constant_b - a_m * b_m,
        abs(b_m) * spread_a + abs(a_m) * spread_b + radius_a * radius_b,
    )
    low, high = make.apply_for_parts("corners", 2, *ends[0], *ends[1])
    return line, (low, high)


def _enclose_extreme(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """The row and range of min(a, b) or max(a, b), as b -+ rest; only a or b if that is certain."""
    b, rest, a = atom.arguments
    make, sign = forms.make, -ONE if atom.kind == "min" else ONE
    (apart,) = forms.terms.atoms[rest.atom].arguments
    ends = [forms.term_ends(x) for x in (a, b)]
    (low, high), (least, most) = ends if atom.kind == "max" else ends[::-1]
    known = forms.tighter_ends(*forms.term_ends(apart), low - most, high - least)
    truth = make.apply("negative", *known)  # then it is b, else if certain a
    weights = [make.apply("by_truth", truth, *w) for w in ((ONE, ZERO, ONE), (ZERO, ONE, ZERO))]
    weights.append(make.apply("by_truth", truth, ZERO, ZERO, sign))
    parts = list(zip(weights, map(forms.row_of, (b, a, rest)), strict=True))
    line = (
        _add_rows(forms, [_scale_row(w, row) for w, (row, _, _) in parts]),
        make.sum([make.apply("share", w, constant) for w, (_, constant, _) in parts]),
        make.sum([make.apply("share", abs(w), spread) for w, (_, _, spread) in parts]),
    )
    (_, (low_b, high_b)), (least, most) = ends, forms.term_ends(rest)
    if atom.kind == "min":
        least, most = most, least
    low, high = (make.apply(atom.kind, *pair) for pair in zip(*ends, strict=True))
    return line, forms.tighter_ends(low, high, low_b + sign * least, high_b + sign * most)


def _enclose_choice(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """The row and range of a choice: a or b if it is certain, else (a + b)/2 +- |a - b|/2."""
    make = forms.make
    a, b, difference = atom.arguments
    assert atom.condition is not None
    truth = truth_value(forms, atom.condition)
    (low_a, high_a), (low_b, high_b), (low, high) = map(forms.term_ends, (a, b, difference))
    gap = make.apply("max", high, -low) * HALF
    weights = [make.apply("by_truth", truth, *w) for w in ((ONE, ZERO, HALF), (ZERO, ONE, HALF))]
    parts = list(zip(weights, map(forms.row_of, (a, b)), strict=True))
    spreads = [make.apply("share", w, spread) for w, (_, _, spread) in parts]
    line = (
        _add_rows(forms, [_scale_row(w, row) for w, (row, _, _) in parts]),
        make.sum([make.apply("share", w, constant) for w, (_, constant, _) in parts]),
        make.sum([*spreads, make.apply("by_truth", truth, ZERO, ZERO, gap)]),
    )
    least, most = make.apply("min", low_a, low_b), make.apply("max", high_a, high_b)
    low = make.apply("by_truth", truth, low_a, low_b, least)
    return line, (low, make.apply("by_truth", truth, high_a, high_b, most))


def _enclose_difference(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """Row and range of a difference; the range is no wider than those of its two numbers allow."""
    ends, (low, high), (least, most) = map(forms.term_ends, atom.arguments)
    return forms.row_of(atom.arguments[0]), forms.tighter_ends(low - most, high - least, *ends)


def _enclose_spread(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """The row and range of any number up to the weighted sum of the arguments' sizes."""
    size = forms.make.sum(
        weight * forms.make.apply("max", *map(abs, forms.term_ends(x)))
        for weight, x in zip(atom.weights, atom.arguments, strict=True)
    )
    return ({}, forms.make.zero, size), (-size, size)


def truth_value(forms: AffineForms, x: Proposition) -> Value:
    """The bits of a proposition as a value: bit 0, may be false; bit 1, may be true."""
    bits: Value = forms.value_made_once("truth", x, partial(_new_truth, forms))
    return bits


def _new_truth(forms: AffineForms, x: Proposition) -> Value:
    make = forms.make
    if x.kind == "constant":
        return make.constant(CERTAIN if x.value else 1)
    if x.kind == "below":
        assert x.argument is not None
        return make.apply("negative" if x.strict else "not_positive", *forms.term_ends(x.argument))
    return make.apply(x.kind, *(truth_value(forms, p) for p in x.parts))


def demand_truths(forms: AffineForms, must: Sequence[Proposition]) -> None:
    """Makes the program return nothing if one of these truths is uncertain."""
    for truth in must:
        forms.make.apply(DEMAND, truth_value(forms, truth))


_ATOMS: dict[str, Callable[[AffineForms, Atom], tuple[Row, Ends]]] = {
    "max0": _enclose_max0,
    "product": _enclose_product,
    "apart": _enclose_difference,
    "choice": _enclose_choice,
    "spread": _enclose_spread,
    "min": _enclose_extreme,
    "max": _enclose_extreme,
    "any": lambda *values: extras.sc_locals_and_modes.enclose_any(*values),  # noqa: PLW0108 - an extra
    "table": lambda *values: extras.array_elements.enclose_element(*values),  # noqa: PLW0108 - an extra
}


def compile_step(
    terms: Terms,
    states: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    *,
    ranges: Sequence[Linear] = (),
    must: Sequence[Proposition] = (),
    boxes: Mapping[int, tuple[arb, arb]] | None = None,
) -> Step:
    """The function `form -> (form of the outputs, (low, high) of each of `ranges`)`.

    It returns None if something in `must` is uncertain. `states`: atoms that the form describes;
    every other input ranges over its box in `boxes`, or else over its domain.
    """
    forms = AffineForms(terms, states, symbols, boxes or {})
    enter_atoms(forms, [*outputs, *ranges, *must])
    demand_truths(forms, must)
    flat = [end for x in outputs for end in forms.term_ends(x)]
    centres, rows, rests = zip(
        *(forms.row_over_form(forms.row_of(x)) for x in outputs), strict=True
    )
    flat += [*centres, *(g for row in rows for g in row), *rests]
    ends = [
        apply_operation(name, end)
        for x in ranges
        for name, end in zip(("below", "above"), forms.term_ends(x), strict=True)
    ]
    return Function(forms.make, forms.length, [*flat, *ends], after=len(flat))


def compile_lines(
    terms: Terms,
    inputs: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    must: Sequence[Proposition],
    boxes: Mapping[int, tuple[arb, arb]],
    *,
    noisy: bool = False,
) -> Function:
    """The function `form -> row, row, ...`; it returns None if something in `must` is uncertain.

    For every point of the form: output = sum coefficient * input + constant +- spread, and the
    output lies in [low, high]. Inputs outside the form range over `boxes` or over their domains.
    `noisy`: after the form follows how far each input may be off its point; coefficients are of the
    point, and the ends of the form are those of the input.
    """
    forms = AffineForms(terms, inputs, symbols, boxes, noisy=noisy)
    enter_atoms(forms, [*outputs, *must])
    demand_truths(forms, must)
    entries = []
    for x in outputs:
        row, constant, spread = forms.row_over_states(forms.row_of(x))
        ends = forms.tighter_ends(*forms.term_ends(x), *forms.term_ends_by_atoms(x))
        entries += [*(row.get(a, forms.make.zero) for a in inputs), constant, spread, *ends]
    return Function(forms.make, forms.length, entries)


def compile_truths(
    terms: Terms,
    states: Sequence[int],
    truths: Sequence[Proposition],
    boxes: Mapping[int, tuple[arb, arb]],
) -> Function:
    """The function `form of a box -> bits of each truth`: bit 0, may be false; 1, may be true."""
    forms = AffineForms(terms, states, 0, boxes)
    enter_atoms(forms, truths)
    return Function(forms.make, forms.length, [truth_value(forms, x) for x in truths])


def all_certain(terms: Terms, truths: Sequence[Proposition]) -> bool:
    """Whether all truths certainly hold for any inputs in their ranges."""
    places = sorted(input_atoms(terms, truths))
    box = [(terms.atoms[i].low, terms.atoms[i].high) for i in places]
    decided = compile_truths(terms, places, truths, {})(form_of_box(box, symbols=False))
    return all(bits == CERTAIN for bits in decided)


def form_of_box(box: Sequence[tuple[arb, arb]], *, symbols: bool) -> tuple[arb, ...]:
    """The form of a box; with `symbols`, each axis gets a separate symbol."""
    ends, centres = [e for i in box for e in i], [(low + high) * HALF for low, high in box]
    radii = [(high - low) * HALF for low, high in box]
    n = range(len(box) if symbols else 0)
    coefficients = [radii[i] if i == k else ZERO for i in n for k in n]
    return (*ends, *centres, *coefficients, *([ZERO for _ in n] if symbols else radii))
