"""The half-spaces of a polytope group, as a DM reads them and as a certificate has them.

Purpose: `Facets` holds S_0 and S_(m-2) of a group; `facets_function` writes the function that finds
the level of an estimate by some hundred scalar products, which the interpreter, Core and C treat
like any other. `entry` writes the group's sets and multipliers into a certificate.
Non-goals: the sets (`proofs.py`), tables of grids (`verify/deploy/level_tables.py`), checking a
certificate (`soter recheck`).

Why it is sound. The estimate is first compared with a box, which NaN, infinities and everything
outside fail: level 0, that is `ttf` and not `safer`. Inside, a product of n terms is computed with
an error of at most n u / (1 - n u) sum |r_k| |x_k| (Higham, section 3.1; any order, fused or not),
so it is compared with the threshold less (n + 2) 1.01 u sum |r_k| X_k, X the box, rounded down: if
the computed product is not above that, the real one is not above the threshold. The number of
operations is fixed.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.model import typed as t
from soter.language.model.types import BOOL, FLOAT, INT
from soter.verify.claims.case import axes_entry, matrix_entry
from soter.verify.deploy.level_tables import EstimateSamples, LevelTable
from soter.verify.polytope.half_spaces import Polytope, inner_point, surely_inside
from soter.verify.polytope.linear_group import free_instants, hold_instants

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from soter.certificate.folder import Certificate
    from soter.core.layout import Floats
    from soter.verify.claims.results import PolytopePart
    from soter.verify.deploy.level_tables import Writer
    from soter.verify.problem.problem import Group, Problem


def half_spaces(stem: str, p: Polytope, files: dict[str, bytes]) -> dict[str, object]:
    """An entry for a polytope: its box, and half-spaces with thresholds last; files are added."""
    faces = np.concatenate([p.rows, p.bounds[:, None]], axis=1)
    box = np.stack([p.low, p.high])
    return {
        "box": matrix_entry(f"{stem}_box.bin", box, files),
        "faces": matrix_entry(f"{stem}_faces.bin", faces, files),
    }


def polytope_of(certificate: Certificate, given: Mapping[str, Any]) -> Polytope:
    """The polytope that `half_spaces` wrote; `ValueError` where a file has another shape."""
    box, faces = (
        np.frombuffer(certificate.plain(given[k]["file"]), "<f8").reshape(given[k]["shape"]).copy()
        for k in ("box", "faces")
    )
    return Polytope(box[0], box[1], faces[:, :-1].copy(), faces[:, -1].copy())


def entry(
    problem: Problem, part: PolytopePart, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """The group's entry in a certificate; its files are added to `files`.

    Boxes are (2, n), half-spaces (N, n + 1) with their thresholds last. Multipliers are triples
    (row, half-space, value) of a sparse matrix of shape `of`; they presuppose `law`, `instants`
    and, where the flow is not linear, `flow`.
    """
    made = axes_entry(problem, part.group, stem, files)

    def array(name: str, values: NDArray[Any]) -> dict[str, object]:
        return matrix_entry(f"{stem}_{name}.bin", values, files)

    def sparse(name: str, values: NDArray[Any]) -> dict[str, object]:
        at = np.nonzero(values)
        return {"of": list(values.shape), **array(name, np.stack([*at, values[at]], axis=1))}

    sets = part.sets
    if sets is None or part.model is None:  # nothing is claimed: a grid on which K is empty
        name = f"{stem}_K.bin"
        files[name] = bytes(prod(len(a.edges) - 1 for a in part.group.axes))
        return {**made, "kind": "grid", "K": name}
    law, times = part.model.law, problem.times
    made["C"] = array("C", np.array(part.limits).T)
    made["law"] = {
        "controls": [problem.quantities.controls[a].name for a in part.model.commands],
        "gain": array("law_gain", law.gain),
        "offset": array("law_offset", law.offset),
        "limits": array("law_limits", np.stack([law.low, law.high])),
    }
    linear = part.model.group
    if not part.model.covers_scheme:
        made["flow"] = {
            "A": array("flow_A", linear.state),
            "B": array("flow_B", linear.control),
            "c": array("flow_c", linear.drift[0]),
        }
    polytope_by_name = {"K": sets.core, "R": sets.free, "Q": sets.kept, "target": sets.target}
    made.update({k: half_spaces(f"{stem}_{k}", p, files) for k, p in polytope_by_name.items() if p})
    made["S"] = [half_spaces(f"{stem}_S{j}", p, files) for j, p in enumerate(sets.allowed)]
    made["G"] = [half_spaces(f"{stem}_G{j + 1}", p, files) for j, p in enumerate(sets.carried)]
    made["rates"] = {"K": array("K_rate", sets.rate), "Q": array("Q_rate", sets.kept_rate)}
    made["periods"] = sets.periods
    made["instants"] = {
        "hold": list(hold_instants(times.delta_sc)),
        "R": list(free_instants(times.horizon_ns)),
        "window": list(free_instants(times.decision)),
        "start": list(free_instants(times.start)),
    }
    made["multipliers"] = {
        name: [sparse(f"{name}_m{i}", m) for i, m in enumerate(record)]
        for name, record in part.multipliers.items()
    }
    return made


SAMPLES = 100_000
RAYS = 40
NEAR, APART = 2.0**-45, 2.0**-30
"""How close to a border points are tried; how much too far inside a level may begin."""


def drawn_states(group: Group) -> Floats:
    """Random states within a group's ranges, (SAMPLES, axes), uniform and always the same."""
    low, high = np.array([(a.edges[0], a.edges[-1]) for a in group.axes]).T
    return np.random.default_rng(0).uniform(low, high, (SAMPLES, len(low)))


@dataclass(frozen=True, eq=False)
class Facets(LevelTable):
    """The levels of one polytope group, over the states of its axes.

    `outer`: S_0, `inner`: S_(m-2), each the intersection over all combinations of parameters.
    """

    states: tuple[int, ...]
    outer: Polytope
    inner: Polytope

    @classmethod
    def of(cls, states: Sequence[int], pairs: Sequence[tuple[Polytope, Polytope]]) -> Facets:
        """The levels that hold in every case, from the pair (S_0, S_(m-2)) of each."""
        outer, inner = pairs[0]
        for more, deeper in pairs[1:]:
            outer, inner = outer.meet(more), inner.meet(deeper)
        return cls(tuple(states), outer, inner.meet(outer))

    @property
    def ends(self) -> tuple[tuple[float, ...], ...]:
        """For each state the ends of the box around S_0, which divide classes of input."""
        return tuple(zip(self.outer.low.tolist(), self.outer.high.tolist(), strict=True))

    def share(self, group: Group) -> float:
        """The share of the group's ranges that S_0 has, by samples."""
        return float(self.certain[0].contains(drawn_states(group)).mean())

    @property
    def full(self) -> tuple[float, ...] | None:
        """A point well inside S_(m-2); None: none was found."""
        point = inner_point(self.inner)
        return None if point is None else tuple(point.tolist())

    @property
    def samples(self) -> EstimateSamples | None:
        """Points on both sides of the borders of S_0 and S_(m-2), and anywhere in the box."""
        if self.full is None:
            return None
        return EstimateSamples(*border_points(self), whole=False)

    def function(self, w: Writer, name: str) -> t.FunSymbol:
        """The function that finds the level of an estimate, half-space by half-space."""
        return facets_function(w, name, self)

    def entry(self, names: Sequence[str], stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The half-spaces of levels 1 and 2, with the thresholds that C compares products with."""
        entry: dict[str, object] = {"states": [names[s] for s in self.states]}
        for name, p in (("outer", self.outer), ("inner", self.inner)):
            held = Polytope(p.low, p.high, p.rows, thresholds(p))
            entry[name] = half_spaces(f"{stem}_{name}", held, files)
        return entry

    @property
    def certain(self) -> tuple[Polytope, Polytope]:
        """The parts of S_0 and S_(m-2) at which the function certainly gives levels 1 and 2."""
        outer = _certain_part(self.outer)
        return _without_equal_rows(outer), _without_equal_rows(
            _certain_part(self.inner).meet(outer)
        )

    @property
    def polytopes(self) -> tuple[Polytope, Polytope]:
        """S_0 and S_(m-2), as polytopes."""
        return self.outer, self.inner


def thresholds(p: Polytope) -> Floats:
    """Thresholds (N,): a computed product at most this large means a real one within its bound."""
    reach = [Fraction(max(abs(a), abs(b))) for a, b in zip(p.low, p.high, strict=True)]
    limits = []
    for row, limit in zip(p.rows, p.bounds, strict=True):
        size = sum((abs(Fraction(r)) * x for r, x in zip(row, reach, strict=True)), Fraction(0))
        slack = Fraction(len(row) + 2) * Fraction(101, 100) * size / 2**53 + Fraction(1, 2**1000)
        exact = Fraction(limit) - slack
        value = float(exact)
        limits.append(value if Fraction(value) <= exact else float(np.nextafter(value, -np.inf)))
    return np.array(limits)


def _certain_part(p: Polytope) -> Polytope:
    """The part of a polytope on which the computed comparisons certainly succeed."""
    once = Polytope(p.low, p.high, p.rows, thresholds(p))
    return Polytope(p.low, p.high, p.rows, thresholds(once))


def _without_equal_rows(p: Polytope) -> Polytope:
    """The polytope with only the least threshold of equal rows."""
    rows, at = np.unique(p.rows, axis=0, return_inverse=True)
    bounds = np.full(len(rows), np.inf)
    np.minimum.at(bounds, at.reshape(-1), p.bounds)
    return Polytope(p.low, p.high, rows, bounds)


def facets_function(w: Writer, name: str, facets: Facets) -> t.FunSymbol:
    """`fun level(x0: float, ...): int`: 0, 1 or 2 for an estimate; 0 outside S_0."""
    inputs = tuple(w.variable(f"x{k}", "parameter", FLOAT) for k in range(len(facets.states)))
    level = w.variable("level", "var", INT)
    inside = _inside_box(w, inputs, facets.inner)
    outside = t.TypedUnary(BOOL, w.span, "!", _inside_box(w, inputs, facets.outer))
    body: list[t.TypedStmt] = [
        t.TypedIf(w.span, ((outside, (w.give(w.number(0)),)),), ()),
        w.declare(level, t.Conditional(INT, w.span, inside, w.number(2), w.number(1))),
    ]
    for value, part, p in ((1, "inner", facets.inner), (0, "outer", facets.outer)):
        if len(p.rows):
            body.append(_scan_half_spaces(w, f"{name}_{part}", inputs, level, value, p))
    return w.function(name, inputs, [*body, w.give(w.read(level))])


def _scan_half_spaces(
    w: Writer, name: str, inputs: Sequence[t.Variable], level: t.Variable, value: int, p: Polytope
) -> t.TypedStmt:
    """The statement that sets the level to `value` unless every half-space holds."""
    n = len(inputs)
    rows = w.array(f"{name}_ROWS", FLOAT, tuple(float(x) for x in p.rows.ravel()))
    limits = w.array(f"{name}_LIMITS", FLOAT, tuple(float(x) for x in thresholds(p)))
    i = w.variable("row", "loop", INT)
    total: t.TypedExpr | None = None
    for k, x in enumerate(inputs):
        at = w.op("+", w.op("*", w.read(i), w.number(n)), w.number(k))
        term = w.real("*", w.at(rows, at), w.read(x))
        total = term if total is None else w.real("+", total, term)
    assert total is not None
    holds = w.op("<=", total, w.at(limits, w.read(i)))
    now = t.Conditional(INT, w.span, holds, w.read(level), w.number(value))
    place = t.Place(level, (), level.type, w.span)
    return t.ForRange(w.span, i, 0, len(p.rows), (t.TypedAssign(w.span, place, now),))


def _inside_box(w: Writer, inputs: Sequence[t.Variable], p: Polytope) -> t.TypedExpr:
    """The expression that the estimate lies in the polytope's box."""
    tests = []
    for x, low, high in zip(inputs, p.low, p.high, strict=True):
        tests.append(w.op(">=", w.read(x), w.decimal(float(low))))
        tests.append(w.op("<=", w.read(x), w.decimal(float(high))))
    return w.chain("&&", tests)


# ---------------------------------------------------------------- for the check of a DM


def border_points(facets: Facets) -> tuple[Floats, NDArray[np.uint8], NDArray[np.uint8]]:
    """Points (k, n), the level of each (k,), and the least level that it must be given (k,).

    They lie on rays from a point inside, close to where these leave S_0 and S_(m-2), and anywhere
    in the box. Levels are computed in rationals; the least one is that of a point further out.
    """
    chance = np.random.default_rng(0)
    centre = np.array(facets.full)
    width = facets.outer.high - facets.outer.low
    rays = chance.normal(size=(RAYS, len(centre))) * width
    batches = [chance.uniform(facets.outer.low, facets.outer.high, rays.shape)]
    for p in facets.polytopes:
        rows, limits = p.faces
        slope, room = rays @ rows.T, limits - rows @ centre
        with np.errstate(divide="ignore"):
            far = np.where(slope > 0, room / slope, np.inf).min(axis=1)
        batches += [centre + rays * (far * s)[:, None] for s in (0.5, 1 - NEAR, 1.0, 1 + NEAR, 1.5)]
    points = np.ascontiguousarray(np.concatenate(batches))
    return points, _levels(facets, points), _levels(facets, points + (points - centre) * APART)


def _levels(facets: Facets, points: Floats) -> NDArray[np.uint8]:
    """The level, 0, 1 or 2, of each point, decided in rationals where floats leave it open."""
    levels = np.zeros(len(points), dtype=np.uint8)
    for k, x in enumerate(points):
        if surely_inside(facets.outer, x):
            levels[k] = 2 if surely_inside(facets.inner, x) else 1
    return levels
