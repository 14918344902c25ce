"""The tables of a polytope group in a certificate: half-spaces, multipliers, what they presuppose.

Purpose: `read_polytope` reads `PolytopeTables` off a manifest and checks every shape and number.
`HalfSpaces.upper_bound` says what a linear function is at most on half-spaces, by weak duality with
given multipliers: for lambda >= 0 and every x of {low <= x <= high, F x <= f}

    r x  <=  lambda f + max over the box of (r - lambda F) x,

in balls. Multipliers are hints of the certificate: wrong ones give a useless bound, never a false
one.
Non-goals: finding multipliers; believing any of it (`polytope_check.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.cell_sets import Axes, Grid
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import HALF, ZERO, exact

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.folder import Certificate

    Rows = Sequence[Sequence[arb]]
    Weights = Sequence[tuple[int, float]]
    """(index of a half-space in `rows`, its multiplier), where that is not zero."""
    Floats = NDArray[np.float64]
    Triples = list[list[tuple[int, float]]]
    """For each row its `Weights`."""


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """{x : low <= x <= high, rows x <= bounds}."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]
    bounds: tuple[float, ...]

    @property
    def faces(self) -> tuple[list[tuple[float, ...]], list[float]]:
        """Every half-space: those of the box last, upper ends before lower ones."""
        n = len(self.low)
        units = [tuple(float(i == j) for j in range(n)) for i in range(n)]
        below = [tuple(-x for x in row) for row in units]
        return [*self.rows, *units, *below], [*self.bounds, *self.high, *(-x for x in self.low)]

    @cached_property
    def in_balls(self) -> tuple[list[list[arb]], list[arb]]:
        """`faces` in balls."""
        faces, ends = self.faces
        return [[exact(x) for x in row] for row in faces], [exact(x) for x in ends]

    @cached_property
    def own_faces(self) -> tuple[list[list[arb]], list[arb]]:
        """The half-spaces of `rows` alone, without those of the box, in balls."""
        faces, ends = self.in_balls
        return faces[: len(self.rows)], ends[: len(self.rows)]

    def boxed_in(self, other: HalfSpaces) -> bool:
        """Whether its box is part of another one."""
        return all(a >= b for a, b in zip(self.low, other.low, strict=True)) and all(
            a <= b for a, b in zip(self.high, other.high, strict=True)
        )

    def upper_bound(self, row: Sequence[arb], weights: Weights) -> arb:
        """An upper bound of `row` x on these half-spaces, by these multipliers."""
        rows, limits = self.own_faces
        rest, total = list(row), ZERO
        for face, value in weights:
            weight = exact(value)
            total += weight * limits[face]
            rest = [x - weight * y for x, y in zip(rest, rows[face], strict=True)]
        for x, low, high in zip(rest, map(exact, self.low), map(exact, self.high), strict=True):
            total += (x * (low + high) + abs(x) * (high - low)) * HALF
        return total

    def require(
        self, what: str, rows: Rows, limits: Sequence[arb], weights: Sequence[Weights] | None
    ) -> None:
        """RejectedError unless rows x <= limits is certain everywhere on these half-spaces."""
        if weights is None:
            weights = [[] for _ in rows]
        if len(weights) != len(rows):
            raise RejectedError(f"{what}: the multipliers are not one list for each row")
        for row, limit, own in zip(rows, limits, weights, strict=True):
            if any(face >= len(self.rows) for face, _ in own):
                raise RejectedError(f"{what}: a multiplier belongs to no half-space")
            if not self.upper_bound(row, own) <= limit:
                raise RejectedError(f"{what}: not confirmed by its multipliers")


def minus_losses(limits: Sequence[arb], losses: Sequence[arb]) -> list[arb]:
    """Limits less losses, row by row."""
    return [a - b for a, b in zip(limits, losses, strict=True)]


INSTANTS = ("hold", "R", "window", "start")
PARTS = ("K", "R", "S", "Q")
REQUIRED = ("kind", "axes", "C", "law", "K", "R", "S", "G", "rates", "periods", "instants")
OPTIONAL = ("Q", "target")
HINTS = ("flow", "multipliers")
INSTANTS_MAX = 1_000
PERIODS_MAX = 100_000
FACES_MAX = 10_000
TRIPLES_MAX = 2_000_000
"""Multipliers of a group, rows without any counted in."""
BOX = 2
"""A box is a matrix of two rows, low and high; half-spaces are one of two dimensions."""
TRIPLE = 3


@dataclass(frozen=True, eq=False)
class ClaimedLaw:
    """z = gain inputs + offset: SC is said to command z while that is between low and high."""

    controls: tuple[str, ...]
    gain: Floats
    """(controls, inputs), inputs in the order of the manifest."""
    offset: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, eq=False)
class ClaimedRates:
    """x' = state x + control u + constant, to within what the re-checker finds."""

    state: Floats
    """(n, n)"""
    control: Floats
    """(n, controls of the law)"""
    constant: Floats
    """(n,)"""


@dataclass(eq=False, kw_only=True)
class PolytopeTables:
    """The sets and hints of one group; `multipliers`: of each part of the proof, claim by claim."""

    states: tuple[int, ...]
    constraint: HalfSpaces
    """C_g, a box."""
    law: ClaimedLaw
    flow: ClaimedRates | None
    """The linear rates around which a flow that is not linear is enclosed."""
    core: HalfSpaces
    """K."""
    free: HalfSpaces
    """R(H)."""
    home: HalfSpaces | None
    """Q; `target`: where `safer` is certain, and Q lies."""
    target: HalfSpaces | None
    levels: list[HalfSpaces]
    """S_0, S_1, ..., of estimates; `carried`: G_1, G_2, ..., the states behind them from S_1 on."""
    carried: list[HalfSpaces]
    rates: dict[str, Floats]
    """By "K" and "Q" how fast z may change there, for each control of the law, but for noise."""
    periods: int
    """In how many holds of SC it leads from all of K to Q."""
    instants: dict[str, tuple[int, ...]]
    """By the names of `INSTANTS` the times in ns, from 0 on, at which a motion is looked at."""
    multipliers: dict[str, list[Triples]] = field(default_factory=dict)
    gives_back: list[tuple[tuple[float, ...], arb]] | None = None
    """Half-spaces of real estimates on which the DM gives control back (`polytope_group.py`)."""
    leaves: list[tuple[tuple[float, ...], arb]] | None = None
    """Half-spaces of real estimates on which it leaves AC in control."""

    def as_cell(self, box: HalfSpaces) -> Axes:
        """A box as a grid of one cell."""
        return Axes(self.states, Grid(tuple(zip(box.low, box.high, strict=True))))


# ---------------------------------------------------------------- reading


def read_polytope(
    certificate: Certificate,
    entry: dict[str, Any],
    states: tuple[int, ...],
    extents: Sequence[tuple[float, float]],
    inputs: int,
) -> PolytopeTables:
    """Read a group of the manifest; `extents`: its states' ranges; `inputs`: how many there are.

    `RejectedError`, or an error of Python's where the manifest is not as it should be.
    """
    n = len(states)
    reader = _MatrixReader(certificate, n)
    low, high = reader.box(entry["C"])
    for (least, most), a, b in zip(extents, low, high, strict=True):
        if not least <= a < b <= most:
            raise RejectedError("C of a polytope is no box within the ranges of its states")
    law = _read_law(reader, entry["law"], inputs)
    tables = PolytopeTables(
        states=states,
        constraint=HalfSpaces(low, high, (), ()),
        law=law,
        flow=_read_rates(reader, entry["flow"], len(law.controls)) if "flow" in entry else None,
        core=reader.half_spaces(entry["K"]),
        free=reader.half_spaces(entry["R"]),
        home=reader.half_spaces(entry["Q"]) if "Q" in entry else None,
        target=reader.half_spaces(entry["target"]) if "target" in entry else None,
        levels=[reader.half_spaces(e) for e in entry["S"]],
        carried=[reader.half_spaces(e) for e in entry["G"]],
        rates={k: reader.matrix(rate, None) for k, rate in entry["rates"].items()},
        periods=_read_whole_number(entry["periods"], PERIODS_MAX, "`periods`"),
        instants={k: _read_instants(given, k) for k, given in entry["instants"].items()},
    )
    given = entry.get("multipliers", {})
    if not set(given) <= set(PARTS):
        raise RejectedError("multipliers of an unknown part")
    tables.multipliers = {k: [reader.triples(e) for e in records] for k, records in given.items()}
    return tables


def read_half_spaces(certificate: Certificate, entry: Any, n: int) -> HalfSpaces:  # noqa: ANN401
    """A polytope over n states."""
    return _MatrixReader(certificate, n).half_spaces(entry)


def _read_law(reader: _MatrixReader, entry: dict[str, Any], inputs: int) -> ClaimedLaw:
    if set(entry) != {"controls", "gain", "offset", "limits"}:
        raise RejectedError("the law of a polytope group is controls, gain, offset and limits")
    controls = tuple(entry["controls"])
    m = len(controls)
    if not m or not all(isinstance(c, str) for c in controls):
        raise RejectedError("the law of a polytope group names no controls")
    low, high = reader.matrix(entry["limits"], (BOX, m))
    return ClaimedLaw(
        controls,
        reader.matrix(entry["gain"], (m, inputs)),
        reader.matrix(entry["offset"], (m,)),
        low,
        high,
    )


def _read_rates(reader: _MatrixReader, entry: dict[str, Any], controls: int) -> ClaimedRates:
    n = reader.n
    shapes = {"A": (n, n), "B": (n, controls), "c": (n,)}
    if set(entry) != set(shapes):
        raise RejectedError("the flow of a polytope group is A, B and c")
    return ClaimedRates(*(reader.matrix(entry[k], shape) for k, shape in shapes.items()))


def _read_whole_number(value: object, most: int, what: str) -> int:
    if type(value) is not int or not 0 <= value <= most:
        raise RejectedError(f"{what} of a polytope group is no number that can be")
    return value


def _read_instants(value: Any, what: str) -> tuple[int, ...]:  # noqa: ANN401
    whole = isinstance(value, list) and all(type(t) is int for t in value)
    if whole and BOX <= len(value) <= INSTANTS_MAX and value[0] == 0 and sorted(value) == value:
        return tuple(value)
    raise RejectedError(f"the instants of `{what}` are not as they should be")


class _MatrixReader:
    """Matrices of a certificate, for groups of n states."""

    def __init__(self, certificate: Certificate, n: int) -> None:
        self.certificate, self.n = certificate, n
        self.weights = 0
        """Multipliers that were asked for so far."""

    def matrix(self, entry: Any, shape: tuple[int, ...] | None) -> Floats:  # noqa: ANN401
        """Finite numbers, of a shape if one is given."""
        if set(entry) != {"file", "shape"}:
            raise RejectedError("a matrix is a file and a shape")
        given = tuple(entry["shape"])
        if not all(type(k) is int and k >= 0 for k in given) or shape not in (None, given):
            raise RejectedError(f"`{entry['file']}` has another shape than it should have")
        data = self.certificate.plain(entry["file"])
        if len(data) != 8 * math.prod(given):
            raise RejectedError(f"`{entry['file']}` is not the size of its matrix")
        numbers = np.frombuffer(data, dtype="<f8").reshape(given)
        if not np.isfinite(numbers).all():
            raise RejectedError(f"`{entry['file']}` holds numbers that are not finite")
        return numbers

    def box(self, entry: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:  # noqa: ANN401
        low, high = self.matrix(entry, (BOX, self.n)).tolist()
        return tuple(low), tuple(high)

    def half_spaces(self, entry: Any) -> HalfSpaces:  # noqa: ANN401
        if set(entry) != {"box", "faces"}:
            raise RejectedError("a polytope is a box with faces")
        box, rows = self.box(entry["box"]), self.matrix(entry["faces"], None)
        if rows.ndim != BOX or rows.shape[1] != self.n + 1:
            raise RejectedError("the faces of a polytope are not over the states of its group")
        if len(rows) > FACES_MAX:
            raise NotRecheckedError(f"a polytope of more than {FACES_MAX:,} half-spaces")
        faces = rows.tolist()
        return HalfSpaces(*box, tuple(tuple(f[:-1]) for f in faces), tuple(f[-1] for f in faces))

    def triples(self, entry: Any) -> Triples:  # noqa: ANN401
        """Multipliers: none is negative, and each belongs to a row and a half-space."""
        count, width = (
            _read_whole_number(k, 1 << 24, "the size of multipliers") for k in entry["of"]
        )
        given = self.matrix({k: v for k, v in entry.items() if k != "of"}, None)
        self.weights += count + len(given)
        if self.weights > TRIPLES_MAX:
            raise NotRecheckedError(f"more than {TRIPLES_MAX:,} multipliers: not looked at")
        triples: Triples = [[] for _ in range(count)]
        if given.ndim != BOX or given.shape[1] != TRIPLE:
            raise RejectedError("multipliers are not triples")
        for row, face, value in given.tolist():
            i, k = int(row), int(face)
            if (i, k) != (row, face) or not (0 <= i < count and 0 <= k < width):
                raise RejectedError("a multiplier belongs to no half-space")
            if not value >= 0.0:
                raise RejectedError("a multiplier is negative")
            triples[i].append((k, value))
        return triples
