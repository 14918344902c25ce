"""Linear forms over the form of a set, as values of a straight-line program.

Purpose: rows, ranges and forms of `terms.Linear`, once the atoms in them have values
(`atom_values.py`).
Non-goals: what the form of a set is (`compile_terms.py`); how programs run (`straight_line.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.terms.arb_balls import HALF, ONE, ZERO
from soter.certificate.terms.straight_line import Builder

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.certificate.terms.straight_line import Value
    from soter.certificate.terms.terms import Atom, Linear, Terms

    Form = tuple[Value, list[Value], list[Value | None], Value]
    Row = tuple[dict[int, arb | Value], Value | None, Value | None]


class AffineForms:
    """What is known of linear forms over the form of a set, and the values that are made of it."""

    def __init__(
        self,
        terms: Terms,
        states: Sequence[int],
        symbols: int,
        boxes: Mapping[int, tuple[arb, arb]],
        memories: int = 0,
    ) -> None:
        self.terms = terms
        self.builder = Builder()
        self.leading = len(states) - memories
        self.place = {atom: i for i, atom in enumerate(states)}
        self.symbols = range(symbols)
        n, k = len(states), len(states) * symbols
        self.length = 4 * n + k + memories * self.leading
        """Of a form: its ends, centres, coefficients on symbols, rests, what memories share."""
        inputs = [self.builder.input(i) for i in range(self.length)]
        self.low, self.high, self.centre = (
            inputs[: 2 * n : 2],
            inputs[1 : 2 * n : 2],
            inputs[2 * n :],
        )
        self.symbol = [inputs[3 * n + i * symbols :] for i in range(n)]
        self.rest = inputs[3 * n + k :]
        self.common = [inputs[4 * n + k + i * self.leading :] for i in range(memories)]
        self.boxes = boxes
        self.rows: dict[int, dict[int, Value]] = {}
        """Row of an atom over the inputs: each coefficient."""
        self.tails: dict[int, tuple[Value, Value]] = {}
        """Constant and spread of an atom's line."""
        self.bounds: dict[int, tuple[Value, Value]] = {}
        self.known: dict[tuple[str, int], Any] = {}
        self.keep: list[object] = []

    def _input_range(self, atom: int) -> tuple[arb, arb]:
        a = self.terms.atoms[atom]
        return self.boxes.get(atom, (a.low, a.high))

    def cached(self, kind: str, x: Linear, make: Callable[[Linear], Any]) -> Any:  # noqa: ANN401
        """What `make` gives of x, once."""
        key = (kind, id(x))
        if key not in self.known:
            self.keep.append(x)
            self.known[key] = make(x)
        return self.known[key]

    def parts(self, x: Linear) -> tuple[dict[int, arb], dict[int, arb]]:
        """Coefficients of inputs, and of other atoms."""
        inputs: dict[int, arb] = {}
        others: dict[int, arb] = {}
        for a, c in x.terms.items():
            (inputs if self.is_input(self.terms.atoms[a]) else others)[a] = c
        return inputs, others

    @staticmethod
    def is_input(atom: Atom) -> bool:
        """Whether the form, or a box, says its values."""
        return atom.kind in ("state", "box")

    def row(self, x: Linear) -> Row:
        """Coefficients over the inputs, the constant, the spread; all atoms replaced by lines."""
        row: Row = self.cached("row", x, self._make_row)
        return row

    def _make_row(self, x: Linear) -> Row:
        """Only states keep a coefficient: what a box adds is part of the spread from here on."""
        inputs, others = self.parts(x)
        const, radius = x.const, x.radius
        row: dict[int, arb | Value] = {}
        for a, c in inputs.items():
            if a in self.place:
                row[a] = c
                continue
            low, high = self._input_range(a)
            const += c * (low + high) * HALF
            radius += abs(c) * (high - low) * HALF
        make = self.builder
        columns: dict[int, list[Value]] = {}
        constants: list[Value | None] = []
        spreads: list[Value | None] = []
        for a, c in others.items():
            for j, factor in self.rows[a].items():
                part = make.times(c, factor)
                if part is not None:
                    columns.setdefault(j, []).append(part)
            constant, spread = self.tails[a]
            constants.append(make.times(c, constant))
            spreads.append(make.times(abs(c), spread))
        for j, parts in columns.items():
            row[j] = make.sum(parts, inputs.get(j, ZERO)) or make.zero
        return row, make.sum(constants, const), make.sum(spreads, radius)

    def centre_and_radius(
        self, row: Mapping[int, arb | Value], constant: Value | None, spread: Value | None
    ) -> tuple[Value, Value]:
        """Of a row over the form."""
        make = self.builder
        centre, symbols, betas, rest = self._over_form(row, constant, spread)
        radius = [*self.betas([make.sum(parts) for parts in betas]), *rest]
        sums = [make.sum(parts) for parts in symbols]
        radius += [make.absolute(x) for x in sums if x is not None]
        return make.sum(centre) or make.zero, make.sum(radius) or make.zero

    def _over_form(
        self, row: Mapping[int, arb | Value], constant: Value | None, spread: Value | None
    ) -> tuple[
        list[Value | None], list[list[Value | None]], list[list[Value | None]], list[Value | None]
    ]:
        """Parts of the centre, of each symbol's and each beta's coefficient, of the rest."""
        make = self.builder
        centre: list[Value | None] = [constant]
        rest: list[Value | None] = [spread]
        symbols: list[list[Value | None]] = [[] for _ in self.symbols]
        betas: list[list[Value | None]] = [[] for _ in range(self.leading)]
        for atom, factor in row.items():
            i = self.place[atom]
            centre.append(make.times(factor, self.centre[i]))
            for k in self.symbols:
                symbols[k].append(make.times(factor, self.symbol[i][k]))
            if i < self.leading:
                betas[i].append(make.coefficient(factor))
                continue
            size = make.absolute(make.coefficient(factor))
            rest.append(make.times(size, self.rest[i]))
            for k in range(self.leading):
                betas[k].append(make.times(factor, self.common[i - self.leading][k]))
        return centre, symbols, betas, rest

    def betas(self, betas: Sequence[Value | None]) -> list[Value | None]:
        """What the betas of the states add to a radius."""
        make = self.builder
        return [
            make.times(make.absolute(x), self.rest[i]) for i, x in enumerate(betas) if x is not None
        ]

    def range_of(self, x: Linear) -> tuple[Value, Value]:
        """The ends of its range."""
        ends: tuple[Value, Value] = self.cached("range", x, self._make_range)
        return ends

    def _make_range(self, x: Linear) -> tuple[Value, Value]:
        make = self.builder
        low, high = self._around(*self.centre_and_radius(*self.row(x)))
        inputs, others = self.parts(x)
        states = [a for a in inputs if a in self.place]
        if len(states) == 0 if others else len(states) == 1:
            natural = self.natural(x, inputs, others)
            low = make.apply("larger", low, natural[0])
            high = make.apply("smaller", high, natural[1])
        if x.nonnegative:
            low = make.apply("larger", low, make.zero)
        return low, high

    def _around(self, centre: Value, radius: Value) -> tuple[Value, Value]:
        """The ends of an interval."""
        make = self.builder
        return make.apply("sub", centre, radius), make.apply("add", centre, radius)

    def natural(
        self,
        x: Linear,
        inputs: Mapping[int, arb],
        others: Mapping[int, arb],
    ) -> tuple[Value, Value]:
        """The range from the intervals of the atoms: exact where a limit is reached."""
        make = self.builder
        lows: list[Value | None] = []
        highs: list[Value | None] = []
        const, radius = x.const, x.radius
        for a, c in inputs.items():
            if a in self.place:
                i = self.place[a]
                self._ends(c, (self.low[i], self.high[i]), lows, highs)
                continue
            low, high = self._input_range(a)
            const += c * (low + high) * HALF
            radius += abs(c) * (high - low) * HALF
        for a, c in others.items():
            self._ends(c, self.bounds[a], lows, highs)
        return (
            make.sum(lows, const - radius) or make.zero,
            make.sum(highs, const + radius) or make.zero,
        )

    def _ends(
        self,
        factor: arb,
        interval: tuple[Value, Value],
        lows: list[Value | None],
        highs: list[Value | None],
    ) -> None:
        """Add factor * interval; the sign of a factor that is not certain is handled by both."""
        make = self.builder
        low, high = (make.times(factor, end) for end in interval)
        if factor >= 0:
            lows.append(low)
            highs.append(high)
        elif factor <= 0:
            lows.append(high)
            highs.append(low)
        else:
            ends = low or make.zero, high or make.zero
            lows.append(make.apply("min", *ends))
            highs.append(make.apply("max", *ends))

    def form(self, x: Linear) -> Form:
        """Centre, coefficients on symbols and on the betas of the states, radius of the rest."""
        make = self.builder
        centre, symbols, betas, rest = self._over_form(*self.row(x))
        return (
            make.sum(centre) or make.zero,
            [make.sum(parts) or make.zero for parts in symbols],
            [make.sum(parts) for parts in betas],
            make.sum(rest) or make.zero,
        )

    def in_common(self, memory: Form, states: Sequence[Form]) -> tuple[Value, list[Value]]:
        """A memory over the betas of the new states: the remainder and the coefficients.

        With old betas B beta: states R B beta + noise, memory S B beta + rest. For any row a it is
        a (states) + (S - a R) B beta - a noise + rest; a = S (2 - R) is nearly S R^-1.
        """
        make = self.builder
        s, n = memory[2], self.leading
        r = [f[2] for f in states]
        two = make.constant(2 * ONE)

        def product(row: Sequence[Value | None]) -> list[Value | None]:
            pairs = [[(row[k], r[k][j]) for k in range(n)] for j in range(n)]
            return [make.sum([make.times(x, y) for x, y in c if x and y]) for c in pairs]

        def less(x: Value | None, y: Value | None) -> Value | None:
            return make.sum([x, make.apply("neg", y) if y else None])

        doubled = [make.times(two, x) if x else None for x in s]
        a = [less(x, y) for x, y in zip(doubled, product(s), strict=True)]
        a = [make.apply("mid", x) if x else None for x in a]
        left = [less(x, y) for x, y in zip(s, product(a), strict=True)]
        noise = [make.times(make.absolute(x), f[3]) for x, f in zip(a, states, strict=True) if x]
        rest = make.sum([memory[3], *self.betas(left), *noise]) or make.zero
        return rest, [x or make.zero for x in a]

    def range_of_form(self, x: Linear, form: Form, rest: Value) -> tuple[Value, Value]:
        """The interval that goes with a form; limits that are reached exactly stay exact."""
        inputs, others = self.parts(x)
        states = [a for a in inputs if a in self.place]
        if ("range", id(x)) in self.known or (len(states) == 0 if others else len(states) == 1):
            return self.range_of(x)
        make = self.builder
        centre, symbols = form[:2]
        radius = make.sum([rest, *map(make.absolute, symbols)]) or make.zero
        return self._around(centre, radius)
