"""Whether a proof says anything: how often AC can have control at all.

Purpose: per group and combination of parameter values, how much of K `ttf` and `safer` leave to AC;
the least of it, in words for a headline, where it is nothing or hardly anything. What is called
*never* is enclosed: it holds of every state. What is called *hardly ever* is a share that was
measured: of cells on which a predicate may let AC have control, or of states drawn from K.
Non-goals: verdicts: a proof about an empty set is a proof.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.program.durations import show_ns
from soter.reach.boxes import holding, share
from soter.reach.polytope_sets import Program
from soter.reach.products import candidates
from soter.reach.results import Vacuity

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from soter.reach.claims import Case
    from soter.reach.polytope_sets import Polytope
    from soter.reach.results import GroupSets, PolytopePart

    Floats = NDArray[np.float64]

HARDLY = 0.01
"""Below this share of a group's K (of C_g for K itself) a headline says so: decision 45."""
DRAWN = 2000
ENOUGH = 0.1
"""Drawing ends early where so much of at least `FEW` states lets AC have control."""
FEW = 100
ANCHORS_MAX = 4
LETS = {"ttf": 1, "safer": 2}
"""The bit of a predicate's truth that says: AC may have control."""
NEVER, HARDLY_EVER = "never", "hardly ever"


def vacuity(done: Sequence[Case]) -> Vacuity | None:
    """The worst of all cases; None where every one leaves AC something."""
    every = [(case, found) for case in done for found in _of_case(case)]
    if not every:
        return None
    worst = min((v for _, v in every), key=lambda v: (v.how_often != NEVER, v.share))
    if len(done) == 1:
        return worst
    bad = {id(case) for case, _ in every}
    case = next(c for c, v in every if v is worst)
    named = _named(case) if len(bad) < len(done) else "every parameter value"
    also = f" and {len(bad) - 1} more of {len(done)}" if 1 < len(bad) < len(done) else ""
    return Vacuity(
        worst.how_often,
        worst.what,
        worst.share,
        f"with {named}{also} {worst.text}",
        tuple(zip((p.name for p in case.problem.parameters), case.parameter, strict=True)),
    )


def _named(case: Case) -> str:
    pairs = zip(case.problem.parameters, case.parameter, strict=True)
    return ", ".join(f"{p.name} = {value}" for p, value in pairs)


def _of_case(case: Case) -> Iterator[Vacuity]:
    """What is vacuous in one case; nothing where it has no K."""
    if case.failed("P2a") or any(p.sets is None for p in case.sets.polytopes):
        return
    yield from _core(case)
    free = _least_free(case)
    for predicate in ("safer", "ttf"):
        if _excluded(case, predicate):
            yield Vacuity(NEVER, predicate, 0.0, _never(case, predicate, empty=free == 0.0))
            continue
        found = min(_shares(case, predicate), default=1.0)
        if found < HARDLY:
            yield Vacuity(HARDLY_EVER, predicate, found, _hardly(predicate, found))


def _core(case: Case) -> Iterator[Vacuity]:
    for part in case.sets.groups:
        edges = [np.asarray(e) for e in part.edges]
        whole = share(part.allowed, edges)
        found = share((part.core > 0) & part.allowed, edges) / whole if whole else 0.0
        if found < HARDLY:
            text = f"SC keeps `safe` from hardly any state (K is {found:.2%} of C)"
            yield Vacuity(HARDLY_EVER, "core", found, text)


def _never(case: Case, predicate: str, *, empty: bool) -> str:
    times = case.problem.times
    if empty:
        within = show_ns(times.horizon_ns)
        return f"AC never has control (R(H) is empty: it could leave K within {within})"
    if predicate == "safer":
        return "AC never has control (`safer` holds nowhere)"
    span = show_ns(times.delta_dm)
    return f"AC never keeps control (`ttf` holds everywhere: {span} at a time at most)"


def _hardly(predicate: str, found: float) -> str:
    """In words; `found` may be of states drawn: then none of them is not nothing."""
    much = f"{found:.2%}" if found > 0.0 else "none of the states drawn"
    what = "keeps" if predicate == "ttf" else "gets"
    says = "`ttf` is false" if predicate == "ttf" else "`safer` holds"
    return f"AC hardly ever {what} control ({says} on {much} of K)"


def _least_free(case: Case) -> float:
    return min(
        (float(np.mean(p.free)) for p in case.sets.groups if p.free is not None), default=1.0
    )


# ---------------------------------------------------------------- never


def _excluded(case: Case, predicate: str) -> bool:
    """Whether no estimate of a state of K can let AC have control; enclosed, not sampled."""
    for part in case.sets.groups:
        lets = part.lets_ac if predicate == "ttf" else part.gives_back
        if lets is not None and not (lets & (part.core > 0)).any():
            return True
    if case.problem.computed:
        return False  # an empty set is a failure of its own
    box = case.forms.whole.copy()
    for polytope in case.sets.polytopes:
        for axis, ends in zip(polytope.group.axes, polytope.limits, strict=True):
            box[axis.state] = ends
    return not case.forms.truth(predicate, box) & LETS[predicate]


# ---------------------------------------------------------------- shares of K


def _shares(case: Case, predicate: str) -> Iterator[float]:
    """Per group the share of K_g that lets AC have control, the others where that is most."""
    for part in case.sets.groups:
        cells = _cells(part, predicate)
        if cells is not None:
            edges = [np.asarray(e) for e in part.edges]
            core = part.core > 0
            yield share(cells & core, edges) / share(core, edges)
    if case.problem.computed:
        for polytope in case.sets.polytopes:
            if polytope.deployed is not None and polytope.sets is not None:
                drawn = _inside(polytope.sets.core, np.random.default_rng(0), DRAWN)
                inner = polytope.deployed[0 if predicate == "ttf" else 1]
                yield float(inner.contains(drawn).mean())
        return
    drawer = _Drawer(case, predicate)
    for own in drawer.groups:
        yield drawer.share(own)


def _cells(part: GroupSets, predicate: str) -> NDArray[np.bool_] | None:
    if part.deployed is not None:
        return part.deployed[0 if predicate == "ttf" else 1]
    return part.lets_ac if predicate == "ttf" else part.gives_back


class _Drawer:
    """States of K, drawn group by group, and what a predicate says of estimates of them."""

    def __init__(self, case: Case, predicate: str) -> None:
        self.case, self.predicate = case, predicate
        self.chance = np.random.default_rng(0)
        self.groups: list[GroupSets | PolytopePart] = [*case.sets.groups, *case.sets.polytopes]
        self.drawn = {id(g): self._draw(g) for g in self.groups}
        self.anchors = self._anchors()

    def share(self, own: GroupSets | PolytopePart) -> float:
        """Of one group, the others at the anchor that leaves AC most."""
        best = 0.0
        for anchor in self.anchors:
            best = max(best, self._share(own, anchor))
            if best >= HARDLY:
                break
        return best

    def _share(self, own: GroupSets | PolytopePart, anchor: Floats) -> float:
        states = [a.state for a in own.group.axes]
        count = 0
        for k, values in enumerate(self.drawn[id(own)], 1):
            point = anchor.copy()
            point[states] = values
            count += self._lets(point)
            if k >= FEW and count >= ENOUGH * k:
                return count / k
        return count / DRAWN

    def _lets(self, point: Floats) -> bool:
        """Whether an estimate of the state surely lets AC have control."""
        whole = self.case.forms.whole
        box = np.repeat(self.chance.uniform(whole[:, :1], whole[:, 1:]), 2, axis=1)
        box[: len(point)] = point[:, None]
        found = self.case.forms.truth(self.predicate, box)
        return found & 3 == LETS[self.predicate]

    def _draw(self, part: GroupSets | PolytopePart) -> Floats:
        sets = getattr(part, "sets", None)
        if sets is not None:
            return _inside(sets.core, self.chance, DRAWN)
        core = np.argwhere(part.core > 0)  # type: ignore[union-attr]
        edges = [np.asarray(a.edges) for a in part.group.axes]
        sizes = np.prod([np.diff(e)[core[:, k]] for k, e in enumerate(edges)], axis=0)
        at = core[self.chance.choice(len(core), DRAWN, p=sizes / sizes.sum())]
        low = np.stack([e[at[:, k]] for k, e in enumerate(edges)], axis=1)
        high = np.stack([e[at[:, k] + 1] for k, e in enumerate(edges)], axis=1)
        return np.asarray(self.chance.uniform(low, high))

    def _anchors(self) -> list[Floats]:
        """Where the other groups are: usual points, and drawn ones at which AC has control."""
        found = candidates(self.case.problem)
        if len(self.groups) < 2:
            return found[:1]
        for k in range(DRAWN):
            point = found[0].copy()
            for part in self.groups:
                point[[a.state for a in part.group.axes]] = self.drawn[id(part)][k]
            if self._lets(point):
                found.append(point)
            if len(found) >= len(candidates(self.case.problem)) + ANCHORS_MAX:
                break
        return found[::-1]


def _inside(p: Polytope, chance: np.random.Generator, count: int) -> Floats:
    """Points of a polytope: uniform where they can be found, else mixtures of extreme ones."""
    low, high = np.maximum(p.low, -1e300), np.minimum(p.high, 1e300)
    points = chance.uniform(low, high, (50 * count, len(low)))
    inside = points[p.contains(points)][:count]
    if len(inside) == count:
        return np.asarray(inside)
    program, eye = Program(p), np.eye(len(low))
    extremes = np.array([program.greatest(row)[1] for row in np.concatenate([eye, -eye, p.rows])])
    weights = chance.dirichlet(np.full(len(extremes), 0.3), count)
    return np.asarray(weights @ extremes)


# ---------------------------------------------------------------- the start


def at_the_start(done: Sequence[Case]) -> str:
    """A line where AC cannot have control at the start: the state is not in `safer` yet."""
    for case in done:
        if case.parameter != case.problem.parameter_start or case.failed("P2a"):
            continue
        for part, engine in zip(case.sets.groups, case.groups, strict=True):
            ends = [case.problem.initial[s] for s in engine.axes]
            box = [holding(e, i.low, i.high) for e, i in zip(engine.edges, ends, strict=True)]
            at = tuple(b for b in box if b is not None)
            if (
                len(at) == len(box)
                and part.gives_back is not None
                and not part.gives_back[at].any()
            ):
                return "at the start `safer` does not hold: SC has control until the state is there"
    return ""
