"""Terms become straight Python code over Arb balls: one call encloses a step over a whole cell.

Purpose: `compile_step`: a function from the form of a set of states to the forms of what a step
makes of it, with the ranges wanted and the propositions that must hold.
Non-goals: reading programs (`symbolic.py`), which sets to check (`chains.py`, `predicates.py`).

The form of a set is a flat tuple: for each state an interval l, h; then for each the centre m, the
coefficients g on the symbols of the cell, the radius b of the rest:

    x in { m + sum g[k] eps_k + b beta : eps_k, beta in [-1, 1] }   and   x in [l, h]

eps_k are shared by all states, beta is its own for each state. With no symbols it is a box. States
may be followed by *memories*, commands that still act: what they have in common with the betas of
the states stands in coefficients a, and only their remainder has a beta of its own:

    u in { m + sum g[k] eps_k + sum a[i] b[i] beta_i + b beta }
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb

from soter.recheck.balls import (
    HALF,
    ONE,
    UNIVARIATE,
    ZERO,
    above,
    below,
    exact,
    key_of,
    larger,
    line_noisy_max0,
    range_max0,
    smaller,
)
from soter.recheck.terms import Linear, Truth, closure

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.recheck.terms import Atom, Terms

    Form = tuple[str, list[str], list[str | None], str]
    Step = Callable[[tuple[arb, ...]], "tuple[tuple[arb, ...], tuple[float, ...]] | None"]


@dataclass(frozen=True, eq=False)
class Sweep:
    """Where the states are at some time between two instants, as one box.

    `drift`: rows over states and `arguments`, and `drift_constant`, all balls: x(t) - x(start) for
    every t between. `rate`: rows over states and `commands` (of each several that may act), and
    `rate_constant`: the derivative. Where that has one sign the ends are those of the instants.
    """

    starts: tuple[Linear, ...]
    ends: tuple[Linear, ...]
    arguments: tuple[Linear, ...]
    drift: tuple[tuple[arb, ...], ...]
    drift_constant: tuple[arb, ...]
    commands: tuple[tuple[Linear, ...], ...]
    rate: tuple[tuple[arb, ...], ...]
    rate_constant: tuple[arb, ...]
    span: arb
    """The time between the instants, in s."""

    @property
    def parts(self) -> tuple[Linear, ...]:
        """Every form in it."""
        acting = (u for alternatives in self.commands for u in alternatives)
        return (*self.starts, *self.ends, *self.arguments, *acting)


def compile_step(
    terms: Terms,
    states: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    *,
    ranges: Sequence[Linear | Sweep] = (),
    must: Sequence[Truth] = (),
    boxes: Mapping[int, tuple[arb, arb]] | None = None,
    memories: tuple[int, int] = (0, 0),
) -> Step:
    """`form -> (form of the outputs, (low, high) of each of `ranges`)`.

    None where something in `must` is not certain. `states`: atoms that the form describes, every
    other input ranges over `boxes`, or its domain where nothing is said there. `memories`: how
    many of the states, and of the outputs, are memories: the last ones.
    """
    writer = Writer(terms, states, symbols, boxes or {}, memories[0])
    return writer.step(outputs, ranges, must, memories[1])


def compile_truths(
    terms: Terms,
    states: Sequence[int],
    truths: Sequence[Truth],
    boxes: Mapping[int, tuple[arb, arb]],
) -> Callable[[tuple[arb, ...]], tuple[int, ...]]:
    """`form of a box -> truths`: bit 0: may be false, bit 1: may be true."""
    return Writer(terms, states, 0, boxes).truths(truths)


def form_of_box(box: Sequence[tuple[arb, arb]], *, symbols: bool) -> tuple[arb, ...]:
    """The form of a box; each axis has a symbol of its own where `symbols`."""
    centres = [(low + high) * HALF for low, high in box]
    radii = [(high - low) * HALF for low, high in box]
    form = [end for interval in box for end in interval] + centres
    if symbols:
        n = len(box)
        form += [radii[i] if i == k else ZERO for i in range(n) for k in range(n)]
        form += [ZERO] * n
    else:
        form += radii
    return tuple(form)


WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
"""A name in our own code; `.max` is none."""
PLAIN = {"abs", "if", "else", "return", "None"}


class Writer:
    """Writes one function; what needs no input is computed once, what is written twice, too."""

    def __init__(
        self,
        terms: Terms,
        states: Sequence[int],
        symbols: int,
        boxes: Mapping[int, tuple[arb, arb]],
        memories: int = 0,
    ) -> None:
        self.terms = terms
        self.leading = len(states) - memories
        self.place = {atom: i for i, atom in enumerate(states)}
        self.symbols = range(symbols)
        self.boxes = boxes
        self.lines: list[str] = []
        self.names: dict[str, Any] = {
            "HALF": HALF,
            "line_noisy_max0": line_noisy_max0,
            "range_max0": range_max0,
            "ZERO": ZERO,
            "larger": larger,
            "smaller": smaller,
            "below": below,
            "above": above,
            "pick": _pick,
            "swept": _swept,
            "corners": _corners,
            "NOT": (0, 2, 1, 3),
            **{f"line_{name}": f for name, f in UNIVARIATE.items()},
        }
        self.count = 0
        self.rows: dict[int, dict[int, str]] = {}
        """Row of an atom over the inputs: code of each coefficient."""
        self.tails: dict[int, tuple[str, str]] = {}
        """Constant and spread of an atom's line."""
        self.bounds: dict[int, tuple[str, str]] = {}
        self.known: dict[tuple[str, int], Any] = {}
        self.keep: list[object] = []
        self.written: dict[str, list[str]] = {}
        """Code -> the names of its values."""
        self.numbers: dict[object, str] = {key_of(ZERO): "ZERO", key_of(HALF): "HALF"}
        """Constant -> its name."""

    # ------------------------------------------------------------ functions

    def step(
        self,
        outputs: Sequence[Linear],
        ranges: Sequence[Linear | Sweep],
        must: Sequence[Truth],
        memories: int,
    ) -> Step:
        linear = [y for x in ranges for y in (x.parts if isinstance(x, Sweep) else (x,))]
        self._atoms([*outputs, *linear, *must])
        self._demand(must)
        forms = [self._form(x) for x in outputs]
        radii = [self._sum([*self._betas(f[2]), f[3]]) or "ZERO" for f in forms]
        found = [
            self._range_of_form(x, f, b) for x, f, b in zip(outputs, forms, radii, strict=True)
        ]
        flat = [end for interval in found for end in interval]
        flat += [f[0] for f in forms]
        flat += [g for f in forms for g in f[1]]
        leading = len(outputs) - memories
        flat += radii[:leading]
        shared = [self._in_common(f, forms[:leading]) for f in forms[leading:]]
        flat += [rest for rest, _ in shared]
        flat += [a for _, row in shared for a in row]
        ends = [
            self._swept(x)
            if isinstance(x, Sweep)
            else "below({}), above({})".format(*self._range(x))
            for x in ranges
        ]
        self.lines.append(f"return ({_tuple(flat)}, {_tuple(ends)})")
        found_step: Step = self._function()
        return found_step

    def _demand(self, must: Sequence[Truth]) -> None:
        """Give back None where something is not certain."""
        for truth in must:
            found = self._truth(truth)
            if self.names.get(found) != 2:
                self.lines.append(f"if {found} != 2: return None")

    def truths(self, truths: Sequence[Truth]) -> Callable[[tuple[arb, ...]], tuple[int, ...]]:
        self._atoms(truths)
        found = [self._truth(x) for x in truths]
        self.lines.append(f"return {_tuple(found)}")
        compiled: Callable[[tuple[arb, ...]], tuple[int, ...]] = self._function()
        return compiled

    def _function(self) -> Any:  # noqa: ANN401  made from text
        n = len(self.place)
        names = [f"{end}{i}" for i in range(n) for end in "lh"]
        names += [f"m{i}" for i in range(n)]
        names += [f"g{i}_{k}" for i in range(n) for k in self.symbols]
        names += [f"b{i}" for i in range(n)]
        names += [f"a{i}_{k}" for i in range(self.leading, n) for k in range(self.leading)]
        head = [f"{_tuple(names)} = form"] if names else []
        body = "\n    ".join(head + _used(self.lines))
        exec(f"def run(form):\n    {body}\n", self.names)  # noqa: S102  our own text
        return self.names["run"]

    # ------------------------------------------------------------ text

    def _new(self, code: str) -> str:
        """A name for a value."""
        if code.isidentifier():
            return code
        return self._values(code, 1)[0]

    def _values(self, code: str, count: int) -> list[str]:
        """Names for the values of some code: constants where no input is in it."""
        if code in self.written:
            return self.written[code]
        if all(w in self.names or w in PLAIN for w in WORD.findall(code)):
            value = eval(code, self.names)  # noqa: S307  our own text
            names = [self._constant(v) for v in (value if count > 1 else (value,))]
        else:
            names = []
            for _ in range(count):
                self.count += 1
                names.append(f"v{self.count}")
            self.lines.append(f"{', '.join(names)} = {code}")
        self.written[code] = names
        return names

    def _constant(self, x: Any) -> str:  # noqa: ANN401  a ball, a truth, a pair of balls
        """The name of a number; equal ones have one name."""
        key: object = key_of(x) if isinstance(x, arb) else (type(x), id(x))
        if key not in self.numbers:
            self.count += 1
            name = f"K{self.count}"
            self.names[name] = x
            self.numbers[key] = name
        return self.numbers[key]

    def _absolute(self, code: str) -> str:
        """The absolute value of a name, computed at once where it is a constant."""
        return self._constant(abs(self.names[code])) if code in self.names else f"abs({code})"

    def _product_of(self, a: str, b: str) -> str:
        """A * b."""
        for one, other in ((a, b), (b, a)):
            if one in self.names and self.names[one] == 1 and isinstance(self.names[one], arb):
                return other
        return f"{a}*{b}"

    def _times(self, factor: arb | str, code: str) -> str | None:
        """`factor * code`; None for zero."""
        if isinstance(factor, str):
            return None if "ZERO" in (factor, code) else self._product_of(factor, code)
        if factor.is_zero() or code == "ZERO":  # what is unbounded is finite all the same
            return None
        if factor == 1:
            return code
        if factor == -1:
            return f"(-{code})"
        return f"{self._constant(factor)}*{code}"

    def _sum(self, parts: Sequence[str | None], offset: arb = ZERO) -> str | None:
        """A name for the sum; None for zero."""
        kept = [p for p in parts if p is not None and p != "ZERO"]
        if not offset.is_zero() or not kept:
            if not kept and offset.is_zero():
                return None
            kept.insert(0, self._constant(offset))
        return self._new(" + ".join(kept))

    def _input_range(self, atom: int) -> tuple[arb, arb]:
        a = self.terms.atoms[atom]
        return self.boxes.get(atom, (a.low, a.high))

    def _swept(self, x: Sweep) -> str:
        """The ends of the box, one state after the other."""
        balls = [self._ball(y) for y in x.starts]
        arguments = [*balls, *(self._ball(y) for y in x.arguments)]
        between = []
        for ball, row, constant in zip(balls, x.drift, x.drift_constant, strict=True):
            between.append(self._sum([ball, self._dot(row, arguments, constant)]) or "ZERO")
        acting = []
        for alternatives in x.commands:
            first, *others = (self._ball(u) for u in alternatives)
            acting.append(self._new(first + "".join(f".union({v})" for v in others)))
        found = []
        for i, (row, constant) in enumerate(zip(x.rate, x.rate_constant, strict=True)):
            low, high = self._range(x.starts[i])
            own = row[i]
            other = [*row[:i], ZERO, *row[i + 1 :]]
            rest = self._dot(other, [*between, *acting], constant)
            if rest is None and own.is_zero():
                found.append(f"below({low}), above({high})")
                continue
            after = ", ".join(self._range(x.ends[i]))
            grown = self._constant(_grown(own, x.span))
            law = f"{between[i]}, {rest or 'ZERO'}, {self._constant(own)}, {grown}"
            found.append(f"*swept({low}, {high}, {after}, {law})")
        return ", ".join(found)

    def _dot(self, row: Sequence[arb], names: Sequence[str], constant: arb) -> str | None:
        parts = [self._times(c, name) for c, name in zip(row, names, strict=True)]
        return self._sum(parts, constant)

    def _ball(self, x: Linear) -> str:
        found: str = self._memo(
            "ball", x, lambda y: self._new("{}.union({})".format(*self._range(y)))
        )
        return found

    # ------------------------------------------------------------ linear forms

    def _memo(self, kind: str, x: Linear, make: Callable[[Linear], Any]) -> Any:  # noqa: ANN401
        key = (kind, id(x))
        if key not in self.known:
            self.keep.append(x)
            self.known[key] = make(x)
        return self.known[key]

    def _parts(self, x: Linear) -> tuple[dict[int, arb], dict[int, arb]]:
        """Coefficients of inputs, and of other atoms."""
        inputs: dict[int, arb] = {}
        others: dict[int, arb] = {}
        for a, c in x.terms.items():
            (inputs if self._is_input(self.terms.atoms[a]) else others)[a] = c
        return inputs, others

    @staticmethod
    def _is_input(atom: Atom) -> bool:
        return atom.kind in ("state", "box")

    def _row(self, x: Linear) -> tuple[dict[int, arb | str], str | None, str | None]:
        """Coefficients over the inputs, the constant, the spread; all atoms replaced by lines."""
        found: tuple[dict[int, arb | str], str | None, str | None] = self._memo(
            "row", x, self._make_row
        )
        return found

    def _make_row(self, x: Linear) -> tuple[dict[int, arb | str], str | None, str | None]:
        """Only states keep a coefficient: what a box adds is part of the spread from here on."""
        inputs, others = self._parts(x)
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
                part = self._times(c, code)
                if part is not None:
                    columns.setdefault(j, []).append(part)
            for found, code in zip((constants, spreads), self.tails[a], strict=True):
                if code != "ZERO":
                    found.append(self._times(c if found is constants else abs(c), code))
        for j, parts in columns.items():
            row[j] = self._sum(parts, inputs.get(j, ZERO)) or "ZERO"
        return row, self._sum(constants, const), self._sum(spreads, radius)

    def _centre_and_radius(
        self, row: Mapping[int, arb | str], constant: str | None, spread: str | None
    ) -> tuple[str, str]:
        """Of a row over the form."""
        centre, symbols, betas, rest = self._over_form(row, constant, spread)
        radius = [*self._betas(betas), *rest]
        radius += [self._absolute(self._new(" + ".join(parts))) for parts in symbols if parts]
        return self._sum(centre) or "ZERO", self._sum(radius) or "ZERO"

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
            centre.append(self._times(factor, f"m{i}"))
            for k in self.symbols:
                part = self._times(factor, f"g{i}_{k}")
                if part is not None:
                    symbols[k].append(part)
            if i < self.leading:
                betas[i].append(self._code(factor))
                continue
            size = self._absolute(factor) if isinstance(factor, str) else abs(factor)
            rest.append(self._times(size, f"b{i}"))
            for k in range(self.leading):
                part = self._times(factor, f"a{i}_{k}")
                if part is not None:
                    betas[k].append(part)
        return centre, symbols, betas, rest

    def _betas(self, betas: Sequence[Sequence[str] | str | None]) -> list[str]:
        """What the betas of the states add to a radius."""
        found = []
        for i, parts in enumerate(betas):
            if not parts:
                continue
            code = parts if isinstance(parts, str) else " + ".join(parts)
            found.append(self._product_of(self._absolute(self._new(code)), f"b{i}"))
        return found

    def _range(self, x: Linear) -> tuple[str, str]:
        found: tuple[str, str] = self._memo("range", x, self._make_range)
        return found

    def _make_range(self, x: Linear) -> tuple[str, str]:
        row, constant, spread = self._row(x)
        centre, radius = self._centre_and_radius(row, constant, spread)
        low, high = self._new(f"{centre} - {radius}"), self._new(f"{centre} + {radius}")
        inputs, others = self._parts(x)
        states = [a for a in inputs if a in self.place]
        if len(states) == 0 if others else len(states) == 1:
            natural = self._natural(x, inputs, others)
            low = self._new(f"larger({low}, {natural[0]})")
            high = self._new(f"smaller({high}, {natural[1]})")
        if x.nonnegative:
            low = self._new(f"larger({low}, ZERO)")
        return low, high

    def _natural(
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
            self._sum(lows, const - radius) or "ZERO",
            self._sum(highs, const + radius) or "ZERO",
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
            lows.append(self._times(factor, low))
            highs.append(self._times(factor, high))
        elif factor <= 0:
            lows.append(self._times(factor, high))
            highs.append(self._times(factor, low))
        else:
            name = self._constant(factor)
            lows.append(f"({name}*{low}).min({name}*{high})")
            highs.append(f"({name}*{low}).max({name}*{high})")

    def _form(self, x: Linear) -> Form:
        """Centre, coefficients on symbols and on the betas of the states, radius of the rest."""
        centre, symbols, betas, rest = self._over_form(*self._row(x))
        return (
            self._sum(centre) or "ZERO",
            [self._sum(parts) or "ZERO" for parts in symbols],
            [self._sum(parts) if parts else None for parts in betas],
            self._sum(rest) or "ZERO",
        )

    def _in_common(self, memory: Form, states: Sequence[Form]) -> tuple[str, list[str]]:
        """A memory over the betas of the new states: the remainder and the coefficients.

        With old betas B beta: states R B beta + noise, memory S B beta + rest. For any row a it is
        a (states) + (S - a R) B beta - a noise + rest; a = S (2 - R) is nearly S R^-1.
        """
        s, n = memory[2], self.leading
        r = [f[2] for f in states]

        def product(row: Sequence[str | None]) -> list[str | None]:
            pairs = [[(row[k], r[k][j]) for k in range(n)] for j in range(n)]
            return [self._sum([f"{x}*{y}" for x, y in column if x and y]) for column in pairs]

        a = [
            self._sum([f"2*{x}" if x else None, f"(-{y})" if y else None])
            for x, y in zip(s, product(s), strict=True)
        ]
        a = [self._new(f"{x}.mid()") if x else None for x in a]
        left = [
            self._sum([x, f"(-{y})" if y else None]) for x, y in zip(s, product(a), strict=True)
        ]
        noise = [f"abs({x})*{f[3]}" for x, f in zip(a, states, strict=True) if x]
        rest = self._sum([memory[3], *self._betas(left), *noise]) or "ZERO"
        return rest, [x or "ZERO" for x in a]

    def _range_of_form(self, x: Linear, form: Form, rest: str) -> tuple[str, str]:
        """The interval that goes with a form; limits that are reached exactly stay exact."""
        inputs, others = self._parts(x)
        states = [a for a in inputs if a in self.place]
        if ("range", id(x)) in self.known or (len(states) == 0 if others else len(states) == 1):
            return self._range(x)
        centre, symbols = form[:2]
        radius = self._new(" + ".join([rest, *(f"abs({g})" for g in symbols)]))
        return self._new(f"{centre} - {radius}"), self._new(f"{centre} + {radius}")

    # ------------------------------------------------------------ atoms

    def _atoms(self, roots: Sequence[Linear | Truth]) -> None:
        for index in sorted(closure(self.terms, roots)):
            atom = self.terms.atoms[index]
            if self._is_input(atom):
                continue
            if atom.kind in UNIVARIATE:
                self._univariate(index, atom)
            else:
                _ATOMS[atom.kind](self, index, atom)

    def _univariate(self, index: int, atom: Atom) -> None:
        (x,) = atom.arguments
        low, high = self._range(x)
        row, constant, rest = self._row(x)
        if atom.kind == "max0" and rest is not None:
            least, most = self._values(f"range_max0({low}, {high})", 2)
            centre, radius = self._centre_and_radius(row, constant, None)
            ends = self._new(f"{centre} - {radius}"), self._new(f"{centre} + {radius}")
            code = f"line_noisy_max0({ends[0]}, {ends[1]}, {rest})"
            slope, offset, spread = self._values(code, 3)
            rest = None
        else:
            code = f"line_{atom.kind}({low}, {high})"
            slope, offset, spread, least, most = self._values(code, 5)
        if not atom.extra.is_zero():
            extra = self._constant(atom.extra)
            spread = self._new(f"{spread} + {extra}")
            least = self._new(f"larger({least} - {extra}, {self._constant(atom.low)})")
            most = self._new(f"smaller({most} + {extra}, {self._constant(atom.high)})")
        self.rows[index] = {
            j: self._new(f"{slope}*{self._code(factor)}") for j, factor in row.items()
        }
        self.tails[index] = (
            self._new(f"{slope}*{constant} + {offset}" if constant else offset),
            self._new(f"abs({slope})*{rest} + {spread}" if rest else spread),
        )
        self.bounds[index] = (least, most)

    def _code(self, factor: arb | str) -> str:
        return factor if isinstance(factor, str) else self._constant(factor)

    def _product(self, index: int, atom: Atom) -> None:
        a, b = atom.arguments
        (al, ah), (bl, bh) = self._range(a), self._range(b)
        am, bm = (self._new(f"(({lo} + {hi})*HALF).mid()") for lo, hi in ((al, ah), (bl, bh)))
        ar, br = (
            self._new(f"({hi} - {m}).max({m} - {lo})") for lo, m, hi in ((al, am, ah), (bl, bm, bh))
        )
        (row_a, c_a, r_a), (row_b, c_b, r_b) = self._row(a), self._row(b)
        columns: dict[int, list[str]] = {}
        for row, factor in ((row_a, bm), (row_b, am)):
            for j, c in row.items():
                columns.setdefault(j, []).append(f"{factor}*{self._code(c)}")
        self.rows[index] = {j: self._new(" + ".join(parts)) for j, parts in columns.items()}
        constant = [f"{f}*{c}" for f, c in ((bm, c_a), (am, c_b)) if c] + [f"(-{am}*{bm})"]
        spread = [f"abs({f})*{r}" for f, r in ((bm, r_a), (am, r_b)) if r] + [f"{ar}*{br}"]
        self.tails[index] = (self._new(" + ".join(constant)), self._new(" + ".join(spread)))
        ends = self._new(f"corners({al}, {ah}, {bl}, {bh})")
        self.bounds[index] = (f"{ends}[0]", f"{ends}[1]")

    def _extreme(self, index: int, atom: Atom) -> None:
        """min(a, b) = b - rest or max(a, b) = b + rest, no further than a and b are."""
        b, rest, a = atom.arguments
        sign = "-" if atom.kind == "min" else "+"
        columns: dict[int, str] = {}
        (row, c, r), (row_rest, c_rest, r_rest) = self._row(b), self._row(rest)
        for j in row.keys() | row_rest.keys():
            parts = [self._code(row[j])] if j in row else ["ZERO"]
            parts += [f"{sign} {self._code(row_rest[j])}"] if j in row_rest else []
            columns[j] = self._new(" ".join(parts))
        self.rows[index] = columns
        self.tails[index] = (
            self._new(f"{c or 'ZERO'} {sign} {c_rest or 'ZERO'}"),
            self._sum([r, r_rest]) or "ZERO",
        )
        (al, ah), (bl, bh), (least, most) = (self._range(x) for x in (a, b, rest))
        if sign == "-":
            least, most = most, least
        low, high = self._new(f"{bl} {sign} {least}"), self._new(f"{bh} {sign} {most}")
        self.bounds[index] = (
            self._new(f"larger({al}.{atom.kind}({bl}), {low})"),
            self._new(f"smaller({ah}.{atom.kind}({bh}), {high})"),
        )

    def _choice(self, index: int, atom: Atom) -> None:
        a, b, difference = atom.arguments
        assert atom.condition is not None
        truth = self._truth(atom.condition)
        rows = [self._row(x) for x in (a, b)]
        ranges = [self._range(x) for x in (a, b)]
        low, high = self._range(difference)
        gap = self._new(f"{high}.max(-{low})*HALF")
        chosen = f"(1 if {truth} == 2 else (0 if {truth} == 1 else HALF))"
        weight = self._new(chosen)
        other = self._new(f"1 - {weight}")
        columns: dict[int, list[str]] = {}
        for (row, _, _), w in zip(rows, (weight, other), strict=True):
            for j, c in row.items():
                columns.setdefault(j, []).append(f"{w}*{self._code(c)}")
        self.rows[index] = {j: self._new(" + ".join(parts)) for j, parts in columns.items()}
        pairs = list(zip(rows, (weight, other), strict=True))
        constant = [f"{w}*{c}" for (_, c, _), w in pairs if c]
        spread = [f"{w}*{r}" for (_, _, r), w in pairs if r]
        spread.append(f"({gap} if {truth} == 3 else ZERO)")
        self.tails[index] = (
            self._new(" + ".join(constant)) if constant else "ZERO",
            self._new(" + ".join(spread)),
        )
        (al, ah), (bl, bh) = ranges
        self.bounds[index] = (
            self._new(f"{al} if {truth} == 2 else ({bl} if {truth} == 1 else {al}.min({bl}))"),
            self._new(f"{ah} if {truth} == 2 else ({bh} if {truth} == 1 else {ah}.max({bh}))"),
        )

    def _spread(self, index: int, atom: Atom) -> None:
        parts: list[str | None] = []
        for weight, x in zip(atom.weights, atom.arguments, strict=True):
            low, high = self._range(x)
            parts.append(self._times(weight, f"abs({low}).max(abs({high}))"))
        size = self._sum(parts) or "ZERO"
        self.rows[index] = {}
        self.tails[index] = ("ZERO", size)
        self.bounds[index] = (f"(-{size})", size)

    def _any(self, index: int, atom: Atom) -> None:
        """The first alternative, and what the others are off it."""
        count = (len(atom.arguments) + 1) // 2
        row, constant, spread = self._row(atom.arguments[0])
        gaps = [self._range(x) for x in atom.arguments[count:]]
        low = self._new("ZERO" + "".join(f".min({low})" for low, _ in gaps))
        high = self._new("ZERO" + "".join(f".max({high})" for _, high in gaps))
        self.rows[index] = {j: self._new(self._code(c)) for j, c in row.items()}
        middle = self._new(f"({low} + {high})*HALF")
        half = self._new(f"({high} - {low})*HALF")
        self.tails[index] = (
            self._new(f"{constant} + {middle}") if constant else middle,
            self._new(f"{spread} + {half}") if spread else half,
        )
        first, *others = (self._range(x) for x in atom.arguments[:count])
        self.bounds[index] = (
            self._new(first[0] + "".join(f".min({low})" for low, _ in others)),
            self._new(first[1] + "".join(f".max({high})" for _, high in others)),
        )

    def _table(self, index: int, atom: Atom) -> None:
        values = f"T{index}"
        self.names[values] = np.array(atom.values).reshape(atom.shape)
        ranges = [self._range(x) for x in atom.arguments]
        positions = ", ".join(f"below({low}), above({high})" for low, high in ranges)
        ends = self._new(f"pick({values}, {positions})")
        low, high = self._new(f"{ends}[0]"), self._new(f"{ends}[1]")
        self.rows[index] = {}
        self.tails[index] = (
            self._new(f"({low} + {high})*HALF"),
            self._new(f"({high} - {low})*HALF"),
        )
        self.bounds[index] = (low, high)

    # ------------------------------------------------------------ propositions

    def _truth(self, x: Truth) -> str:
        key = ("truth", id(x))
        if key not in self.known:
            self.keep.append(x)
            self.known[key] = self._make_truth(x)
        found: str = self.known[key]
        return found

    def _make_truth(self, x: Truth) -> str:
        if x.kind == "constant":
            return "2" if x.value else "1"
        if x.kind == "below":
            assert x.argument is not None
            low, high = self._range(x.argument)
            if x.strict:
                return self._new(f"2 if {high} < 0 else (1 if {low} >= 0 else 3)")
            return self._new(f"2 if {high} <= 0 else (1 if {low} > 0 else 3)")
        parts = [self._truth(p) for p in x.parts]
        if x.kind == "not":
            return self._new(f"NOT[{parts[0]}]")
        a, b = parts
        if x.kind == "and":
            return self._new(f"(({a} | {b}) & 1) | ({a} & {b} & 2)")
        assert x.kind == "or", x.kind
        return self._new(f"(({a} | {b}) & 2) | ({a} & {b} & 1)")


_ATOMS: dict[str, Callable[[Writer, int, Atom], None]] = {
    "product": Writer._product,  # noqa: SLF001  a table of its own methods
    "choice": Writer._choice,  # noqa: SLF001
    "spread": Writer._spread,  # noqa: SLF001
    "min": Writer._extreme,  # noqa: SLF001
    "max": Writer._extreme,  # noqa: SLF001
    "any": Writer._any,  # noqa: SLF001
    "table": Writer._table,  # noqa: SLF001
}


# ---------------------------------------------------------------- helpers


def _tuple(parts: Sequence[str]) -> str:
    return f"({', '.join(parts)},)" if parts else "()"


def _used(lines: Sequence[str]) -> list[str]:
    """The lines on which the last one, or one that may return, depends."""
    needed: set[str] = set()
    kept = []
    for line in reversed(lines):
        names, found, code = line.partition(" = ")
        if not found or line.startswith(("return", "if ")):
            code = line
        elif needed.isdisjoint(WORD.findall(names)):
            continue
        needed.update(WORD.findall(code))
        kept.append(line)
    return kept[::-1]


def _corners(al: arb, ah: arb, bl: arb, bh: arb) -> tuple[arb, arb]:
    """The range of a product."""
    a, b, c, d = al * bl, al * bh, ah * bl, ah * bh
    return a.min(b).min(c.min(d)), a.max(b).max(c.max(d))


def _swept(
    low: arb,
    high: arb,
    low_after: arb,
    high_after: arb,
    between: arb,
    rest: arb,
    own: arb,
    grown: arb,
) -> tuple[float, float]:
    """The ends of a state x between two instants with these ranges, x' = own x + rest.

    Where x' has one sign over the box `between`, x runs from one range to the other. Elsewhere a
    comparison: x stays below the solution of y' = own y + max rest from `high`, which is monotone:
    it only rises where own high + max rest > 0, and then by that times `grown`, the integral of
    e^{own s} over the time.
    """
    rate = own * between + rest
    if rate >= 0:
        return below(low), above(high_after)
    if rate <= 0:
        return below(low_after), above(high)
    down, up = arb((own * low + rest).lower()), arb((own * high + rest).upper())
    return (
        below(low if down >= 0 else low + down * grown),
        above(high if up <= 0 else high + up * grown),
    )


def _grown(own: arb, span: arb) -> arb:
    """The integral of e^{own s} over [0, span], from above."""
    if own > 0 or own < 0:
        return arb((((own * span).exp() - 1) / own).upper())
    return span if own <= 0 else span * (own * span).exp()


def _pick(values: NDArray[np.float64], *ends: float) -> tuple[arb, arb]:
    """The range of a table between positions, which are whole numbers."""
    part = []
    for axis, size in enumerate(values.shape):
        low, high = ends[2 * axis], ends[2 * axis + 1]
        first = 0 if not low > 0 else min(math.ceil(low), size - 1)
        last = size - 1 if not high < size - 1 else max(math.floor(high), 0)
        part.append(slice(first, last + 1) if first <= last else slice(None))
    there = values[tuple(part)]
    return exact(float(there.min())), exact(float(there.max()))


__all__ = ["ONE", "compile_step", "compile_truths", "form_of_box"]
