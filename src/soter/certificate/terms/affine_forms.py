"""Linear forms over the form of a set, as values of a straight-line program.

Purpose: rows and ranges of `terms.Linear`, once the atoms in them have theirs (`atom_values.py`).
Non-goals: what the form of a set is (`compile_terms.py`); how programs run (`straight_line.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.terms.arb_balls import HALF
from soter.certificate.terms.straight_line import Builder

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.certificate.terms.straight_line import Value
    from soter.certificate.terms.terms import Atom, Linear, Terms

    Row = tuple[dict[int, Value], Value, Value]
    """Coefficients over the states of a form, a constant, a spread."""
    Ends = tuple[Value, Value]


class AffineForms:
    """What is known of linear forms over the form of a set, and the values that are made of it."""

    def __init__(
        self,
        terms: Terms,
        states: Sequence[int],
        symbols: int,
        boxes: Mapping[int, tuple[arb, arb]],
        *,
        noisy: bool = False,
    ) -> None:
        """`noisy`: states are what the form describes and a noise each, which stands behind it."""
        self.terms, self.states, self.boxes = terms, states, boxes
        self.make = make = Builder()
        self.symbols = range(symbols)
        n = len(states)
        self.length = (4 + symbols + noisy) * n
        """Of a form: its ends, centres, coefficients on symbols, rests; noises."""
        inputs = [make.input(i) for i in range(self.length)]
        self.centre = dict(zip(states, inputs[2 * n :], strict=False))
        self.symbol = {a: inputs[3 * n + i * symbols :] for i, a in enumerate(states)}
        self.rest = dict(zip(states, inputs[(3 + symbols) * n :], strict=False))
        noises = inputs[(4 + symbols) * n :] or [make.zero] * n
        self.rows: dict[int, Row] = {
            a: ({a: make.one}, make.zero, noise) for a, noise in zip(states, noises, strict=True)
        }
        """Of each atom: its line."""
        self.bounds: dict[int, Ends] = {
            a: (inputs[2 * i], inputs[2 * i + 1]) for i, a in enumerate(states)
        }
        """Of each atom: the ends of its range."""
        self._known: dict[tuple[str, int], Any] = {}
        self._keep: list[object] = []

    def enter_box(self, index: int, atom: Atom) -> None:
        """An input that the form does not describe: its box, or its domain."""
        low, high = self.boxes.get(index, (atom.low, atom.high))
        middle, half = (low + high) * HALF, (high - low) * HALF
        self.rows[index] = {}, self.make.constant(middle), self.make.constant(half)
        self.bounds[index] = self.make.constant(low), self.make.constant(high)

    def cached(self, kind: str, x: object, made_of: Callable[[Any], Any]) -> Any:  # noqa: ANN401
        """What is made of x, once."""
        key = (kind, id(x))
        if key not in self._known:
            self._keep.append(x)
            self._known[key] = made_of(x)
        return self._known[key]

    def row(self, x: Linear) -> Row:
        """Coefficients over the states, the constant, the spread; all atoms replaced by lines."""
        row: Row = self.cached("row", x, self._make_row)
        return row

    def _make_row(self, x: Linear) -> Row:
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

    def over_form(self, row: Row) -> tuple[Value, list[Value], Value]:
        """Centre, coefficients on the symbols, radius of the rest."""
        factors, constant, spread = row
        total = self.make.sum
        return (
            total([constant, *(f * self.centre[a] for a, f in factors.items())]),
            [total([f * self.symbol[a][k] for a, f in factors.items()]) for k in self.symbols],
            total([spread, *(abs(f) * self.rest[a] for a, f in factors.items())]),
        )

    def ends_of_row(self, row: Row) -> Ends:
        """Of the interval of a row over the form."""
        centre, symbols, rest = self.over_form(row)
        radius = self.make.sum([rest, *map(abs, symbols)])
        return centre - radius, centre + radius

    def range_of(self, x: Linear) -> Ends:
        """The ends of its range; limits that are reached exactly stay exact."""
        ends: Ends = self.cached("range", x, self._make_range)
        return ends

    def _make_range(self, x: Linear) -> Ends:
        low, high = self.ends_of_row(self.row(x))
        states = sum(a in self.centre for a in x.terms)
        others = any(self.terms.atoms[a].kind not in ("state", "box") for a in x.terms)
        if states == (0 if others else 1):
            low, high = self.within(low, high, *self.natural(x))
        if x.nonnegative:
            low = self.make.apply("larger", low, self.make.zero)
        return low, high

    def within(self, low: Value, high: Value, least: Value, most: Value) -> Ends:
        """The tighter ones of two pairs of ends, of which each holds."""
        return self.make.apply("larger", low, least), self.make.apply("smaller", high, most)

    def natural(self, x: Linear) -> Ends:
        """The range from the intervals of the atoms: exact where a limit is reached."""
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
