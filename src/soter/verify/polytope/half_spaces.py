"""Polytopes in half-space form, and upper bounds of linear functions on them.

Purpose: `Polytope` = a box cut by half-spaces; `Bounds` gives, for rows c, numbers that c x does
not exceed on it. A linear program only suggests multipliers: for every lambda >= 0 (Farkas)

    c x  <=  lambda . f  +  max over the box of (c - lambda F) x,

and the right side is what is computed, rounding outward. So a wrong suggestion gives a useless
bound, never a wrong one, and multipliers can be kept and used again without any solver.
Non-goals: which sets are wanted (`proofs.py`).
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.verify.polytope.matrices import Array, Ball, centred, exact, up_product, up_sum
from soter.version import pip_install
from soter.workers.solvers import new_highs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SLACK = 1e-6
"""A half-space counts only if it cuts by this much; thresholds are lowered by it for rounding."""
CLOSE = 2.0**-40
"""Beyond this relative distance from a half-space rounding cannot change the answer."""
GAP = SLACK / 1000
"""Multipliers are good if their bound lies above the value by no more than this, relative to it."""
SOLVE = 500
"""The fixed cost of a solve, as a number of half-spaces."""
TOLD = 200_000
"""After this many half-spaces progress is reported."""
USUAL: dict[str, object] = {"solver": "choose", "simplex_strategy": 1, "simplex_scale_strategy": 2}
WAYS: tuple[dict[str, object] | None, ...] = (
    None,
    {},
    {"simplex_strategy": 4},
    {"simplex_strategy": 1, "simplex_scale_strategy": 0},
    {"solver": "ipm"},
)
"""How HiGHS is asked, in turn: from where it is (None), then from scratch; with a primal simplex;
without its scaling; by interior points. Which vertex it returns must not decide a verdict."""


@dataclass(frozen=True, eq=False)
class Polytope:
    """{x : low <= x <= high, rows x <= bounds}; rows (N, n)."""

    low: Array
    high: Array
    rows: Array
    bounds: Array

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Centre and radius of the box, (n,) each."""
        return centred(self.low, self.high)

    @cached_property
    def faces(self) -> tuple[Array, Array]:
        """All half-spaces, those of the box last: (N + 2n, n), (N + 2n,)."""
        eye = np.eye(len(self.low))
        rows = np.concatenate([self.rows, eye, -eye])
        return rows, np.concatenate([self.bounds, self.high, -self.low])

    def contains(self, points: Array) -> npt.NDArray[np.bool_]:
        """For each point (k, n): whether it lies inside, as plain floats say (plots, tests)."""
        inside = ((points >= self.low) & (points <= self.high)).all(axis=1)
        return np.asarray(inside & (points @ self.rows.T <= self.bounds).all(axis=1))

    def with_rows(self, rows: Array, bounds: Array) -> Polytope:
        """This polytope cut by further half-spaces rows x <= bounds, (k, n) and (k,)."""
        return Polytope(
            self.low,
            self.high,
            np.concatenate([self.rows, rows]),
            np.concatenate([self.bounds, bounds]),
        )

    def meet(self, other: Polytope) -> Polytope:
        """The intersection of both."""
        low, high = np.maximum(self.low, other.low), np.minimum(self.high, other.high)
        return Polytope(low, high, self.rows, self.bounds).with_rows(other.rows, other.bounds)

    def shrunk(self, error: Array) -> Polytope:
        """{z : z + E inside}, E = the box of radius `error` (n,); rounds inward."""
        loss = up_product(np.abs(self.rows), error) if len(self.rows) else np.zeros(0)
        return Polytope(
            np.nextafter(self.low + error, np.inf),
            np.nextafter(self.high - error, -np.inf),
            self.rows,
            np.nextafter(self.bounds - loss, -np.inf),
        )


def box_polytope(low: Array, high: Array) -> Polytope:
    """The box of all points between `low` and `high`, (n,) each, as a polytope."""
    return Polytope(low, high, np.zeros((0, len(low))), np.zeros(0))


class SpentError(Exception):
    """The linear programs of a group have used up their limit of half-spaces."""


class Work:
    """The limit for the linear programs of one group: work is counted, never timed.

    A solve counts as its half-spaces plus `SOLVE`. `tell` is called now and then, and may end the
    work by raising.
    """

    def __init__(self, most: int, tell: Callable[[], None] | None = None) -> None:
        self.most, self.left = most, most
        self._tell = tell

    @contextmanager
    def half(self) -> Iterator[None]:
        """A `with` block in which only half of what is left may be spent."""
        kept = self.left - self.left // 2
        self.left -= kept
        yield
        self.left += kept

    def count(self, half_spaces: int) -> None:
        """Counts a solve, or work that takes as long; `SpentError` beyond the limit."""
        before = self.left
        self.left -= SOLVE + half_spaces
        if self.left < 0:
            raise SpentError(
                f"linear programs that look at {self.most:,} half-spaces in all, at half of "
                f"them for K, and count as {SOLVE} more each"
            )
        if self._tell is not None and before // TOLD != self.left // TOLD:
            self._tell()


class Bounds:
    """Upper bounds of rows on one polytope, by multipliers of an LP or of an earlier proof."""

    def __init__(
        self,
        polytope: Polytope,
        multipliers: list[Array] | None = None,
        work: Work | None = None,
    ) -> None:
        """`multipliers`: the `record` of an earlier, equal use; with them nothing is solved."""
        self.polytope = polytope
        self.record: list[Array] = []
        self._kept = iter(multipliers) if multipliers is not None else None
        self._solver = None if multipliers is not None else LinearProgram(polytope, work)

    @property
    def empty(self) -> bool:
        """Whether the LP found no point (a hint)."""
        return self._solver is not None and self._solver.empty

    def of(self, rows: Ball) -> Array:
        """An upper bound of each row on the polytope; (N, n) -> (N,)."""
        if not len(rows.mid):
            return np.zeros(0)
        p = self.polytope
        if self._kept is not None:
            weights = next(self._kept)
        else:
            assert self._solver is not None
            weights = np.array([self._solver.weights(row) for row in rows.mid])
        self.record.append(weights)
        return bound(p, rows, weights)


def bound(p: Polytope, rows: Ball, weights: Array) -> Array:
    """The bound weights f + max over the box of (rows - weights F) x, rounded outward, (N,).

    `rows` (N, n); ValueError where `weights` are not (N, half_spaces) or one is negative.
    """
    if weights.shape != (len(rows.mid), len(p.rows)) or not (weights >= 0).all():
        raise ValueError("multipliers are one non-negative number per row and half-space")
    w = exact(weights)
    rest = rows - w @ exact(p.rows) if len(p.rows) else rows
    centre, radius = p.box
    flat = rest @ exact(centre[:, None])
    if len(p.rows):
        flat = flat + w @ exact(p.bounds[:, None])
    return up_sum(flat.upper()[:, 0], up_product(rest.magnitude(), radius))


class LinearProgram:
    """Maximises linear functions on a polytope by HiGHS, again and again; only for hints."""

    def __init__(self, polytope: Polytope, work: Work | None = None) -> None:
        """`work`: counts each solve; None: they are not counted."""
        self._highs = require_highs()
        self._work = work
        self._highs.setOptionValue("presolve", "off")
        for side in ("primal", "dual"):
            self._highs.setOptionValue(f"{side}_feasibility_tolerance", 1e-10)
        self.n = len(polytope.low)
        self._box = polytope.low, polytope.high
        self._rows: list[Array] = []
        self._bounds: list[float] = []
        self._columns = np.arange(self.n, dtype=np.int32)
        self._highs.addVars(self.n, polytope.low, polytope.high)
        for row, limit in zip(polytope.rows, polytope.bounds, strict=True):
            self.add(row, limit)
        self.empty = self.is_empty()

    def add(self, row: Array, limit: float) -> None:
        """Cuts the polytope by a half-space row x <= limit, `row` (n,)."""
        self._highs.addRow(-np.inf, float(limit), self.n, self._columns, row)
        self._rows.append(row)
        self._bounds.append(float(limit))

    def is_empty(self) -> bool:
        """Whether the solver found no point (a hint)."""
        return self._solve(np.zeros(self.n)) is None

    def limit(self, place: int, limit: float) -> None:
        """Changes the bound of half-space number `place`."""
        self._highs.changeRowBounds(place, -np.inf, float(limit))
        self._bounds[place] = float(limit)

    def _solve(self, row: Array) -> tuple[Array, Array] | None:
        """A point (n,) where row x is greatest, and multipliers (half_spaces,); None: not found.

        The solver goes on from the last vertex. Where it finds nothing there, or multipliers whose
        bound is too far above row x, it is asked from scratch, and in other ways (`WAYS`).
        """
        if self._work is not None:
            self._work.count(len(self._rows))
        self._highs.changeColsCost(self.n, self._columns, -row)
        best, least = None, np.inf
        for way in WAYS:
            if way is not None:
                self._highs.clearSolver()
                for option, value in way.items():
                    self._highs.setOptionValue(option, value)
            self._highs.run()
            status = self._highs.getModelStatus().name
            if status == "kOptimal":
                solution = self._highs.getSolution()
                x = np.asarray(solution.col_value, dtype=np.float64)
                weights = np.maximum(-np.asarray(solution.row_dual, dtype=np.float64), 0.0) + 0.0
                bound = self._bound(row, weights)
                if best is None or bound < least:
                    best, least = (x, weights), bound
                if bound - row @ x <= GAP * (1.0 + abs(bound)):
                    break
            elif way is not None and status == "kInfeasible":
                break
        if way:
            for option, value in USUAL.items():
                self._highs.setOptionValue(option, value)
            self._highs.clearSolver()
        return best

    def _bound(self, row: Array, weights: Array) -> float:
        """The bound of row x by multipliers (half_spaces,), in plain floats; inf: there is none."""
        used = np.flatnonzero(weights)
        rest = row - sum((weights[k] * self._rows[k] for k in used), np.zeros(self.n))
        low, high = self._box
        with np.errstate(invalid="ignore"):
            ends = np.where(rest > 0.0, rest * high, np.where(rest < 0.0, rest * low, 0.0))
        bound = float(ends.sum()) + float(sum(weights[k] * self._bounds[k] for k in used))
        return bound if np.isfinite(bound) else np.inf

    def weights(self, row: Array) -> Array:
        """Multipliers, (half_spaces,), that bound row x, `row` (n,); zeros if there are none."""
        solution = self._solve(row)
        if solution is None or not np.isfinite(solution[1]).all():
            return np.zeros(len(self._rows))
        return solution[1]

    def greatest(self, row: Array) -> tuple[float, Array]:
        """The greatest value of row x, `row` (n,), and x; infinity where the solver found none."""
        solution = self._solve(row)
        if solution is None:
            return np.inf, np.zeros(self.n)
        return float(row @ solution[0]), solution[0]


def require_highs() -> Any:  # noqa: ANN401 - an untyped module
    """The LP solver HiGHS; `SoterError` D007 where the extra is not installed."""
    try:
        return new_highs()
    except ImportError:
        raise SoterError(
            (
                Diagnostic(
                    "D007",
                    "polytopes need the package `highspy`",
                    helps=(f"install it: {pip_install('prove')}",),
                ),
            )
        ) from None


def lean(polytope: Polytope, work: Work | None = None) -> Polytope:
    """The polytope without half-spaces that the others imply, by the LP, which may err.

    So claims have to be proved about the result, not about the polytope that was given.
    """
    rows, bounds = polytope.rows, polytope.bounds
    scale = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
    order = np.lexsort((bounds / scale,))
    kept: list[int] = []
    program = LinearProgram(box_polytope(polytope.low, polytope.high), work)
    for i in order:
        if program.greatest(rows[i])[0] > bounds[i]:
            program.add(rows[i], bounds[i])
            kept.append(int(i))
    for place in range(len(kept) - 1, -1, -1):
        program.limit(place, np.inf)
        if program.greatest(rows[kept[place]])[0] > bounds[kept[place]]:
            program.limit(place, bounds[kept[place]])
        else:
            kept[place] = -1
    left = sorted(k for k in kept if k >= 0)
    return Polytope(polytope.low, polytope.high, rows[left], bounds[left])


def inner_point(p: Polytope) -> Array | None:
    """A point (n,) that surely lies in a polytope; None without any.

    The middle of the ends along all axes; where that lies on a half-space the middle of the largest
    box, in the proportions of the ranges; where that does, too, as in a flat set, either, or the
    middle of the ends along all half-spaces.
    """
    program = LinearProgram(p)
    if program.empty:
        return None
    eye = np.eye(len(p.low))
    inner = p.shrunk(SLACK * _ranges(p))

    def clear(x: Array) -> bool:
        """Whether a point lies inside, clear of every half-space."""
        return bool((inner.rows @ x < inner.bounds).all()) and surely_inside(p, x)

    ends = [program.greatest(row)[1] for row in (*eye, *-eye)]
    middle: Array = np.mean(ends, axis=0)
    if clear(middle):
        return middle
    box = _middle_of_largest_box(p)
    if clear(box):
        return box
    ends += [program.greatest(row)[1] for row in p.rows]
    points = (middle, box, np.mean(ends, axis=0))
    return next((point for point in points if surely_inside(p, point)), None)


def _ranges(p: Polytope) -> Array:
    """The widths of the polytope's box, (n,); 1 where it has no ends."""
    width = p.high - p.low
    return np.where(np.isfinite(width), width, 1.0)


def _middle_of_largest_box(p: Polytope) -> Array:
    """The x, (n,), with the greatest t such that x - t w and x + t w are inside; w: the widths."""
    width = _ranges(p)
    rows, bounds = p.faces
    boxes = Polytope(
        np.append(p.low, 0.0),
        np.append(p.high, 1.0),
        np.column_stack([rows, np.abs(rows) @ width]),
        bounds,
    )
    return LinearProgram(boxes).greatest(np.append(np.zeros(len(width)), 1.0))[1][:-1]


def surely_inside(p: Polytope, x: Array) -> bool:
    """Whether a point (n,) lies in a polytope, decided in rationals where floats could err.

    False where a half-space is NaN.
    """
    rows, limits = p.faces
    if not (np.isfinite(x).all() and np.isfinite(rows).all() and (limits > -np.inf).all()):
        return False
    rows, limits = rows[limits < np.inf], limits[limits < np.inf]
    excess, size = rows @ x - limits, np.abs(rows) @ np.abs(x) + np.abs(limits)
    close = np.abs(excess) <= CLOSE * size + 2.0**-1000
    if (excess[~close] > 0).any():
        return False
    point = [Fraction(v) for v in x]
    return all(
        sum(Fraction(a) * v for a, v in zip(row, point, strict=True)) <= Fraction(limit)
        for row, limit in zip(rows[close], limits[close], strict=True)
    )
