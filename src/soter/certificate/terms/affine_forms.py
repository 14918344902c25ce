"""Linear forms over the form of a set, as code.

Purpose: rows, ranges and forms of `terms.Linear`, once the atoms in them are written
(`atom_code.py`).
Non-goals: what the form of a set is (`compile_terms.py`); text (`python_source.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.terms.arb_balls import HALF, ZERO
from soter.certificate.terms.python_source import PythonSource

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.certificate.terms.terms import Atom, Linear, Terms

    Form = tuple[str, list[str], list[str | None], str]


class AffineForms:
    """What is known of linear forms over the form of a set, and the text that computes it."""

    def __init__(
        self,
        terms: Terms,
        states: Sequence[int],
        symbols: int,
        boxes: Mapping[int, tuple[arb, arb]],
        memories: int = 0,
    ) -> None:
        self.terms = terms
        self.text = PythonSource()
        self.leading = len(states) - memories
        self.place = {atom: i for i, atom in enumerate(states)}
        self.symbols = range(symbols)
        self.boxes = boxes
        self.rows: dict[int, dict[int, str]] = {}
        """Row of an atom over the inputs: code of each coefficient."""
        self.tails: dict[int, tuple[str, str]] = {}
        """Constant and spread of an atom's line."""
        self.bounds: dict[int, tuple[str, str]] = {}
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

    def row(self, x: Linear) -> tuple[dict[int, arb | str], str | None, str | None]:
        """Coefficients over the inputs, the constant, the spread; all atoms replaced by lines."""
        row: tuple[dict[int, arb | str], str | None, str | None] = self.cached(
            "row", x, self._make_row
        )
        return row

    def _make_row(self, x: Linear) -> tuple[dict[int, arb | str], str | None, str | None]:
        """Only states keep a coefficient: what a box adds is part of the spread from here on."""
        inputs, others = self.parts(x)
        const, radius = x.const, x.radius
        row: dict[int, arb | str] = {}
        for a, c in inputs.items():
            if a in self.place:
                row[a] = c
                continue
            low, high = self._input_range(a)
            const += c * (low + high) * HALF
            radius += abs(c) * (high - low) * HALF
        columns: dict[int, list[str]] = {}
        constants: list[str | None] = []
        spreads: list[str | None] = []
        for a, c in others.items():
            for j, code in self.rows[a].items():
                part = self.text.times(c, code)
                if part is not None:
                    columns.setdefault(j, []).append(part)
            for summands, code in zip((constants, spreads), self.tails[a], strict=True):
                if code != "ZERO":
                    summands.append(self.text.times(c if summands is constants else abs(c), code))
        for j, parts in columns.items():
            row[j] = self.text.sum(parts, inputs.get(j, ZERO)) or "ZERO"
        return row, self.text.sum(constants, const), self.text.sum(spreads, radius)

    def centre_and_radius(
        self, row: Mapping[int, arb | str], constant: str | None, spread: str | None
    ) -> tuple[str, str]:
        """Of a row over the form."""
        centre, symbols, betas, rest = self._over_form(row, constant, spread)
        radius = [*self.betas(betas), *rest]
        radius += [
            self.text.absolute(self.text.new(" + ".join(parts))) for parts in symbols if parts
        ]
        return self.text.sum(centre) or "ZERO", self.text.sum(radius) or "ZERO"

    def _over_form(
        self, row: Mapping[int, arb | str], constant: str | None, spread: str | None
    ) -> tuple[list[str | None], list[list[str]], list[list[str]], list[str | None]]:
        """Parts of the centre, of each symbol's and each beta's coefficient, of the rest."""
        centre: list[str | None] = [constant]
        rest: list[str | None] = [spread]
        symbols: list[list[str]] = [[] for _ in self.symbols]
        betas: list[list[str]] = [[] for _ in range(self.leading)]
        for atom, factor in row.items():
            i = self.place[atom]
            centre.append(self.text.times(factor, f"m{i}"))
            for k in self.symbols:
                part = self.text.times(factor, f"g{i}_{k}")
                if part is not None:
                    symbols[k].append(part)
            if i < self.leading:
                betas[i].append(self.text.code(factor))
                continue
            size = self.text.absolute(factor) if isinstance(factor, str) else abs(factor)
            rest.append(self.text.times(size, f"b{i}"))
            for k in range(self.leading):
                part = self.text.times(factor, f"a{i}_{k}")
                if part is not None:
                    betas[k].append(part)
        return centre, symbols, betas, rest

    def betas(self, betas: Sequence[Sequence[str] | str | None]) -> list[str]:
        """What the betas of the states add to a radius."""
        products = []
        for i, parts in enumerate(betas):
            if not parts:
                continue
            code = parts if isinstance(parts, str) else " + ".join(parts)
            products.append(self.text.product_of(self.text.absolute(self.text.new(code)), f"b{i}"))
        return products

    def range_of(self, x: Linear) -> tuple[str, str]:
        """The names of the ends of its range."""
        ends: tuple[str, str] = self.cached("range", x, self._make_range)
        return ends

    def _make_range(self, x: Linear) -> tuple[str, str]:
        row, constant, spread = self.row(x)
        centre, radius = self.centre_and_radius(row, constant, spread)
        low, high = self.text.new(f"{centre} - {radius}"), self.text.new(f"{centre} + {radius}")
        inputs, others = self.parts(x)
        states = [a for a in inputs if a in self.place]
        if len(states) == 0 if others else len(states) == 1:
            natural = self.natural(x, inputs, others)
            low = self.text.new(f"larger({low}, {natural[0]})")
            high = self.text.new(f"smaller({high}, {natural[1]})")
        if x.nonnegative:
            low = self.text.new(f"larger({low}, ZERO)")
        return low, high

    def natural(
        self,
        x: Linear,
        inputs: Mapping[int, arb],
        others: Mapping[int, arb],
    ) -> tuple[str, str]:
        """The range from the intervals of the atoms: exact where a limit is reached."""
        lows: list[str | None] = []
        highs: list[str | None] = []
        const, radius = x.const, x.radius
        for a, c in inputs.items():
            if a in self.place:
                self._ends(c, (f"l{self.place[a]}", f"h{self.place[a]}"), lows, highs)
                continue
            low, high = self._input_range(a)
            const += c * (low + high) * HALF
            radius += abs(c) * (high - low) * HALF
        for a, c in others.items():
            self._ends(c, self.bounds[a], lows, highs)
        return (
            self.text.sum(lows, const - radius) or "ZERO",
            self.text.sum(highs, const + radius) or "ZERO",
        )

    def _ends(
        self,
        factor: arb,
        interval: tuple[str, str],
        lows: list[str | None],
        highs: list[str | None],
    ) -> None:
        """Add factor * interval; the sign of a factor that is not certain is handled by both."""
        low, high = interval
        if factor >= 0:
            lows.append(self.text.times(factor, low))
            highs.append(self.text.times(factor, high))
        elif factor <= 0:
            lows.append(self.text.times(factor, high))
            highs.append(self.text.times(factor, low))
        else:
            name = self.text.constant(factor)
            lows.append(f"({name}*{low}).min({name}*{high})")
            highs.append(f"({name}*{low}).max({name}*{high})")

    def form(self, x: Linear) -> Form:
        """Centre, coefficients on symbols and on the betas of the states, radius of the rest."""
        centre, symbols, betas, rest = self._over_form(*self.row(x))
        return (
            self.text.sum(centre) or "ZERO",
            [self.text.sum(parts) or "ZERO" for parts in symbols],
            [self.text.sum(parts) if parts else None for parts in betas],
            self.text.sum(rest) or "ZERO",
        )

    def in_common(self, memory: Form, states: Sequence[Form]) -> tuple[str, list[str]]:
        """A memory over the betas of the new states: the remainder and the coefficients.

        With old betas B beta: states R B beta + noise, memory S B beta + rest. For any row a it is
        a (states) + (S - a R) B beta - a noise + rest; a = S (2 - R) is nearly S R^-1.
        """
        s, n = memory[2], self.leading
        r = [f[2] for f in states]

        def product(row: Sequence[str | None]) -> list[str | None]:
            pairs = [[(row[k], r[k][j]) for k in range(n)] for j in range(n)]
            return [self.text.sum([f"{x}*{y}" for x, y in column if x and y]) for column in pairs]

        a = [
            self.text.sum([f"2*{x}" if x else None, f"(-{y})" if y else None])
            for x, y in zip(s, product(s), strict=True)
        ]
        a = [self.text.new(f"{x}.mid()") if x else None for x in a]
        left = [
            self.text.sum([x, f"(-{y})" if y else None]) for x, y in zip(s, product(a), strict=True)
        ]
        noise = [f"abs({x})*{f[3]}" for x, f in zip(a, states, strict=True) if x]
        rest = self.text.sum([memory[3], *self.betas(left), *noise]) or "ZERO"
        return rest, [x or "ZERO" for x in a]

    def range_of_form(self, x: Linear, form: Form, rest: str) -> tuple[str, str]:
        """The interval that goes with a form; limits that are reached exactly stay exact."""
        inputs, others = self.parts(x)
        states = [a for a in inputs if a in self.place]
        if ("range", id(x)) in self.known or (len(states) == 0 if others else len(states) == 1):
            return self.range_of(x)
        centre, symbols = form[:2]
        radius = self.text.new(" + ".join([rest, *(f"abs({g})" for g in symbols)]))
        return self.text.new(f"{centre} - {radius}"), self.text.new(f"{centre} + {radius}")

    def arguments(self) -> list[str]:
        """The names of the numbers of a form, in its order."""
        n = len(self.place)
        names = [f"{end}{i}" for i in range(n) for end in "lh"]
        names += [f"m{i}" for i in range(n)]
        names += [f"g{i}_{k}" for i in range(n) for k in self.symbols]
        names += [f"b{i}" for i in range(n)]
        names += [f"a{i}_{k}" for i in range(self.leading, n) for k in range(self.leading)]
        return names
