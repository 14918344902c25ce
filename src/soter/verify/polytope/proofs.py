"""The sets of linear groups as polytopes: K, R(H), S_j and Q are found, and claims proved.

Purpose: `compute` finds the sets of a `LinearGroup` with linear programs as hints; `prove` checks
every claim about them by multipliers alone, rounding outward: only that may a verdict rest on
(docs/verification.md, section 3).
Non-goals: reading a program (`extract_group.py`); grids.

The claims, over K = `core`, R = `free`, S_j = `allowed[j]`, Q = `kept`:
- K lies in the extent; on K the law is linear (each command clear of its clamp, whatever the error
  and the age of the read) and `rate` holds;
- from K, C holds during a whole hold, and K when it ends: by induction over the holds of an SC run
  that starts in K, its state is in K at every nominal time a_0 + k delta, in C throughout (P2a);
  a_0 is the run's own, wherever in its window it lies (docs/proof-sets.md, "Polytopes");
- R in K, and from R the state stays in K for all of [0, H] under any control of U;
- S_0 - E in R; for j > 0: G_j is carried into S_{j-1} eroded by E during the whole window,
  S_j - E in G_j, S_j in S_{j-1};
- Q is like K with `safer` eroded by E in place of C, so that an estimate within Q's tube satisfies
  `safer` at every release of the DM; K is carried into Q in `periods` holds (P2b).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.polytope.half_spaces import (
    SLACK,
    Bounds,
    LinearProgram,
    Polytope,
    Work,
    box_polytope,
    lean,
)
from soter.verify.polytope.linear_group import FreePhase, Hold, LinearGroup
from soter.verify.polytope.matrices import Array, Ball, exact, up_product, up_sum

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from soter.verify.polytope.linear_group import Pairs

WORK = 4_000_000, 8_000_000, 12_000_000, 32_000_000
"""The limit (`Work`) of half-spaces for the linear programs of a group of one state, two, three,
four or more, to find and to prove. A proof of four states takes that much, one of three does not.
"""
GAINED = 0.01
"""A `rate` that is smaller by less than this share is not worth another fixpoint."""
WAVES_MAX = 2000
PERIODS_MAX = 5000


@dataclass(frozen=True, eq=False)
class Windows:
    """Times of the free phase in ns: `horizon` is H, `window` Delta + A + J_dm, between looks."""

    horizon_ns: int
    window_ns: int
    levels: int = 3


@dataclass(eq=False)
class PolytopeSets:
    """The sets that `compute` found and `prove` proves, over the group's own states."""

    group: LinearGroup
    windows: Windows
    rate: Array
    core: Polytope
    free: Polytope
    allowed: list[Polytope]
    """S_0, S_1, ..., sets of estimates."""
    carried: list[Polytope]
    """G_1, G_2, ..., sets of states: G_j holds every state behind an estimate in S_j."""
    kept: Polytope | None = None
    kept_rate: Array = field(default_factory=lambda: np.zeros(0))
    periods: int = 0
    """How many holds after which every run from K is in Q."""
    work: Work = field(default_factory=lambda: Work(WORK[-1]))
    """The limit for levels and Q."""
    target: Polytope | None = None
    """States all of whose estimates satisfy `safer`; None: S_(m-2) of this case, eroded by E."""

    @property
    def ttf(self) -> Polytope:
        """`ttf` is false exactly on this set of estimates (computed predicates)."""
        return self.allowed[0]

    @property
    def safer(self) -> Polytope:
        """`safer` is true exactly on this set of estimates (computed predicates)."""
        return self.allowed[-1]


class NotProvedError(Exception):
    """A claim is not proved; the text says which, and by how much its bound is missed.

    `row`: the half-space on which it is missed most, (n,), if there is one.
    """

    def __init__(self, text: str, row: Array | None = None) -> None:
        super().__init__(text)
        self.row = row


# ---------------------------------------------------------------- finding


def compute(group: LinearGroup, windows: Windows) -> PolytopeSets | None:
    """The sets, still to be proved; None where the fixpoint ran empty or reached its limit."""
    sets = find_core(group, windows)
    if sets is not None:
        find_levels(sets)
        find_return(sets)
    return sets


def work_of(group: LinearGroup, tell: Callable[[], None] | None = None) -> Work:
    """The limit of work for a group; `tell` is called now and then."""
    return Work(WORK[min(len(group.low), len(WORK)) - 1], tell)


def find_core(
    group: LinearGroup, windows: Windows, work: Work | None = None
) -> PolytopeSets | None:
    """Finds K and R(H), no levels yet; `SpentError` where K takes more than half of `work`."""
    work = work_of(group) if work is None else work
    with work.half():
        solution = _greatest_kept_set(group, group.rows, group.bounds, work)
    if solution is None:
        return None
    core, rate = solution
    free = _set_that_stays(group, core, core, windows.horizon_ns, work)
    return PolytopeSets(group, windows, rate, core, free, [], [], work=work)


def find_levels(sets: PolytopeSets) -> None:
    """Fills in S_0, S_1, ... and G_1, G_2, ..."""
    group, windows, free, work = sets.group, sets.windows, sets.free, sets.work
    sets.allowed, sets.carried = [lean(_tighter(free.shrunk(group.error)), work)], []
    for _ in range(windows.levels - 2):
        inner = sets.allowed[-1].shrunk(group.error)
        following = _set_that_stays(group, free, inner, windows.window_ns, work)
        estimates = _tighter(following.shrunk(group.error))
        sets.carried.append(following)
        sets.allowed.append(lean(estimates.meet(_tighter(sets.allowed[-1])), work))


def _plain_rows(rows: Ball, limits: Array, reach: Array) -> tuple[Array, Array]:
    """Rows of doubles, of length one, for rows of balls; thresholds are lowered for the radii."""
    limits = limits - up_product(rows.rad, reach)
    size = np.maximum(np.linalg.norm(rows.mid, axis=1), 1e-12)
    return rows.mid / size[:, None], limits / size - SLACK


def _first_rows(hold: Hold, rows: Array, bounds: Array) -> tuple[Array, Array]:
    """The half-spaces that a state must satisfy for one hold: C throughout, linear law, rate."""
    group = hold.group
    half_spaces = [(row, bounds - loss) for row, loss in hold.everywhere(exact(rows))]
    half_spaces += _rows_of_linear_law(hold)
    plain = [_plain_rows(row, limit, group.reach) for row, limit in half_spaces]
    return np.concatenate([r for r, _ in plain]), np.concatenate([b for _, b in plain])


def _rows_of_linear_law(hold: Hold) -> Pairs:
    """Half-spaces on which the law is linear and the rate holds."""
    command, low, high = hold.commands()
    half_spaces = [(command, high), (-command, -low)]
    if hold.timed:
        offset = hold.rate_offset
        half_spaces += [
            (hold.rate_rows, -up_sum(offset.upper(), -hold.rate)),
            (-hold.rate_rows, -up_sum(-offset.lower(), -hold.rate)),
        ]
    return half_spaces


def _greatest_kept_set(
    group: LinearGroup, rows: Array, bounds: Array, work: Work
) -> tuple[Polytope, Array] | None:
    """The greatest set that SC keeps inside rows x <= bounds, and its `rate`; None: it is empty.

    It is computed twice, the second time with a better `rate`.
    """
    eye = np.eye(len(group.low))
    rows = np.concatenate([rows, eye, -eye])
    bounds = np.concatenate([bounds, group.high, -group.low])
    gain = np.abs(group.gain @ group.state)
    offset = group.gain @ (group.constant.mid)
    rate = gain @ group.reach + np.abs(offset) + SLACK
    best = None
    timed = group.delay_ns + group.jitter_ns > 0
    for _ in range(3 if timed else 1):
        hold = Hold(group, rate)
        start = Polytope(group.low, group.high, *_first_rows(hold, rows, bounds))
        core = _fixpoint(hold, start, work)
        if core is None:
            if best is not None or not timed:
                break
            core = start  # nothing stays with this rate: try what the linear law alone allows
            program = LinearProgram(core)
            if program.empty:
                break
            rate = _greatest_rate(program, hold)
            continue
        best = (core, rate)
        rate = _greatest_rate(LinearProgram(core), hold)
        if (rate >= best[1] * (1 - GAINED)).all():
            break
    return None if best is None else (lean(best[0], work), best[1])


def _greatest_rate(program: LinearProgram, hold: Hold) -> Array:
    """The greatest |K (A x + b + B u_c)| on a set."""
    row, offset = hold.rate_rows.mid, hold.rate_offset.mid
    rates = [
        max(program.greatest(r)[0] + o, program.greatest(-r)[0] - o)
        for r, o in zip(row, offset, strict=True)
    ]
    return np.array(rates) * (1 + 1e-6) + SLACK


def _fixpoint(hold: Hold, start: Polytope, work: Work) -> Polytope | None:
    """The states from which every run of holds satisfies `start` at each one; None: empty."""
    p = box_polytope(start.low, start.high)
    program = LinearProgram(p, work)
    wave = (start.rows, start.bounds)
    for _ in range(WAVES_MAX):
        fresh = []
        for i, (row, limit) in enumerate(zip(*wave, strict=True)):
            if program.greatest(row)[0] > limit:
                program.add(row, limit)
                fresh.append(i)
        if not fresh:
            return p
        if program.is_empty():
            return None
        cut = wave[0][fresh], wave[1][fresh]
        p, wave = p.with_rows(*cut), _rows_before_hold(hold, *cut)
    return None


def _rows_before_hold(hold: Hold, rows: Array, bounds: Array) -> tuple[Array, Array]:
    """The half-spaces of states from which a hold ends in rows x <= bounds."""
    row, loss = hold.after(exact(rows))
    return _plain_rows(row, bounds - loss, hold.group.reach)


def _set_that_stays(
    group: LinearGroup, outer: Polytope, inner: Polytope, until_ns: int, work: Work
) -> Polytope:
    """The states of `outer` that stay in `inner` during [0, until], whatever control acts."""
    rows, bounds = inner.faces
    pairs = FreePhase(group, until_ns).everywhere(exact(rows))
    plain = [_plain_rows(row, bounds - loss, group.reach) for row, loss in pairs]
    return lean(
        outer.with_rows(
            np.concatenate([r for r, _ in plain]), np.concatenate([b for _, b in plain])
        ),
        work,
    )


def _tighter(p: Polytope) -> Polytope:
    """A slightly smaller set, to make up for half-spaces that an LP dropped wrongly."""
    return Polytope(p.low + SLACK, p.high - SLACK, p.rows, p.bounds - SLACK)


def find_return(sets: PolytopeSets) -> None:
    """Finds Q inside `home`, and after how many holds every run from K is in it."""
    group = sets.group
    solution = _greatest_kept_set(group, *home(sets).faces, sets.work)
    if solution is None:
        return
    sets.kept, sets.kept_rate = solution
    sets.periods = 0
    try:
        _prove_home(Claims(None, sets.work), sets)
    except NotProvedError:
        sets.kept = None
        return
    sets.periods = _return_periods(sets)
    if not sets.periods:
        sets.kept = None


def _return_periods(sets: PolytopeSets) -> int:
    """The number of holds after which every run from K is in Q, to be proved; 0: none found."""
    assert sets.kept is not None
    hold, bounds = Hold(sets.group, sets.rate), Bounds(sets.core, work=sets.work)
    faces, limits = sets.kept.faces
    row, loss = exact(faces), np.zeros(len(faces))
    done, last = 0, 0  # `last`: the half-space that failed last, and mostly fails again
    for periods in _guesses():
        for _ in range(periods - done):
            sets.work.count(len(faces))
            row, more = _one_hold_back(hold, row)
            loss = up_sum(loss, more)
        done = periods
        limit = np.nextafter(limits - loss, -np.inf)
        if bounds.of(row[last : last + 1])[0] > limit[last]:
            continue
        excess = bounds.of(row) - limit
        if (excess <= 0).all():
            return periods
        last = int(np.argmax(excess))
    return 0


def home(sets: PolytopeSets) -> Polytope:
    """The states all of whose estimates satisfy `safer`, or a part of them."""
    return sets.safer.shrunk(sets.group.error) if sets.target is None else sets.target


def _guesses() -> Iterable[int]:
    periods = 1
    while periods <= PERIODS_MAX:
        yield periods
        periods = max(periods + 1, periods * 5 // 4)


# ---------------------------------------------------------------- proving


class Claims:
    """Proves claims one after the other, with multipliers found by LPs or taken from a record.

    Multipliers are (rows, half_spaces) for each claim, in order. `work`: the limit for the LPs.
    """

    def __init__(self, multipliers: list[Array] | None = None, work: Work | None = None) -> None:
        self.record: list[Array] = []
        self._work = work
        self._kept = iter(multipliers) if multipliers is not None else None

    def greatest(self, polytope: Polytope, rows: Ball) -> Array:
        """Proved upper bounds of rows on a polytope; (N, n) -> (N,)."""
        if self._kept is not None:
            bounds = Bounds(polytope, [next(self._kept)])
        else:
            bounds = Bounds(polytope, None, self._work)
        upper_bounds = bounds.of(rows)
        self.record += bounds.record
        return upper_bounds

    def holds(self, what: str, polytope: Polytope, rows: Ball, limits: Array) -> None:
        """Proves rows x <= limits on a polytope; `NotProvedError` where that fails.

        `rows` (N, n), `limits` (N,).
        """
        excess = self.greatest(polytope, rows) - limits
        if not (excess <= 0).all():
            worst = rows.mid[int(np.argmax(excess))]
            raise NotProvedError(f"{what}: exceeded by {np.max(excess):.3g}", worst)


def prove(sets: PolytopeSets, multipliers: list[Array] | None = None) -> list[Array]:
    """Proves every claim about K, R and S_j and returns the multipliers; `NotProvedError`.

    With `multipliers` of an earlier proof nothing is solved: they are checked. They are
    (rows, half_spaces) for each claim, in order.
    """
    claims = Claims(multipliers)
    prove_core(sets, claims)
    prove_free(sets, claims)
    prove_levels(sets, claims)
    if sets.kept is not None:
        prove_return(sets, claims)
    return claims.record


def prove_core(sets: PolytopeSets, claims: Claims) -> None:
    """Proves P2a: SC keeps C from K."""
    group = sets.group
    _prove_kept(claims, "K", Hold(group, sets.rate), sets.core, group.rows, group.bounds)


def prove_free(sets: PolytopeSets, claims: Claims) -> None:
    """Proves R(H): no control of U leads out of K within H."""
    _prove_free(claims, "R(H)", sets.group, sets.free, sets.core, sets.windows.horizon_ns)


def prove_start(sets: PolytopeSets, claims: Claims, start: Polytope, until_ns: int) -> None:
    """Proves that from every state of `start` the state is in K during all of [0, until]."""
    _prove_free(claims, "the start", sets.group, start, sets.core, until_ns)


def prove_levels(sets: PolytopeSets, claims: Claims) -> None:
    """Proves S_0, S_1, ..., the sets of estimates."""
    group = sets.group
    _prove_estimates(claims, "S_0", group, sets.allowed[0], sets.free)
    for j, carried in enumerate(sets.carried):
        before, after = sets.allowed[j], sets.allowed[j + 1]
        inner = before.shrunk(group.error)
        _prove_free(claims, f"G_{j + 1}", group, carried, inner, sets.windows.window_ns)
        _prove_estimates(claims, f"S_{j + 1}", group, after, carried)
        _prove_inside(claims, f"S_{j + 1} in S_{j}", after, before)


def prove_return(sets: PolytopeSets, claims: Claims) -> None:
    """Proves P2b: SC keeps Q, and every run from K is in Q after `periods` holds."""
    _prove_home(claims, sets)
    _prove_recovery(claims, sets, sets.periods)


def _prove_inside(claims: Claims, what: str, inner: Polytope, outer: Polytope) -> None:
    if not ((inner.low >= outer.low) & (inner.high <= outer.high)).all():
        raise NotProvedError(f"{what}: its box is larger")
    if len(outer.rows):
        claims.holds(what, inner, exact(outer.rows), outer.bounds)


def _prove_kept(
    claims: Claims, what: str, hold: Hold, core: Polytope, rows: Array, bounds: Array
) -> None:
    """Proves that SC keeps `core`, the extent and rows x <= bounds from every state of `core`."""
    group = hold.group
    extent = Polytope(group.low, group.high, rows, bounds)
    _prove_inside(claims, f"{what} in the extent", core, extent)
    for row, limit in _rows_of_linear_law(hold):
        claims.holds(f"{what}: the law is linear", core, row, limit)
    every, limits = extent.faces
    for row, loss in hold.everywhere(exact(every)):
        claims.holds(f"{what}: C during a hold", core, row, np.nextafter(limits - loss, -np.inf))
    faces, limits = core.faces
    row, loss = hold.after(exact(faces))
    claims.holds(f"{what} after a hold", core, row, np.nextafter(limits - loss, -np.inf))


def _prove_free(
    claims: Claims, what: str, group: LinearGroup, start: Polytope, inner: Polytope, until_ns: int
) -> None:
    """Proves that from `start` the state stays in `inner` during [0, until], whatever control acts.

    The bounds hold for states of the extent, of which `start` must be a part.
    """
    _prove_inside(claims, f"{what} in the extent", start, box_polytope(group.low, group.high))
    rows, limits = inner.faces
    for row, loss in FreePhase(group, until_ns).everywhere(exact(rows)):
        claims.holds(what, start, row, np.nextafter(limits - loss, -np.inf))


def _prove_estimates(
    claims: Claims, what: str, group: LinearGroup, estimates: Polytope, states: Polytope
) -> None:
    """Proves that every state within E of an estimate in `estimates` lies in `states`."""
    rows, limits = states.faces
    loss = up_product(np.abs(rows), group.error)
    claims.holds(what, estimates, exact(rows), np.nextafter(limits - loss, -np.inf))


def _prove_home(claims: Claims, sets: PolytopeSets) -> None:
    assert sets.kept is not None
    rows, bounds = home(sets).faces
    _prove_kept(claims, "Q", Hold(sets.group, sets.kept_rate), sets.kept, rows, bounds)


def _prove_recovery(claims: Claims, sets: PolytopeSets, periods: int) -> None:
    assert sets.kept is not None
    hold = Hold(sets.group, sets.rate)
    faces, limits = sets.kept.faces
    row, loss = exact(faces), np.zeros(len(faces))
    for _ in range(periods):
        row, more = _one_hold_back(hold, row)
        loss = up_sum(loss, more)
    claims.holds("K returns to Q", sets.core, row, np.nextafter(limits - loss, -np.inf))


def _one_hold_back(hold: Hold, rows: Ball) -> tuple[Ball, Array]:
    """(row, loss) in plain doubles: c x after any hold <= row x + loss for x in the extent."""
    row, loss = hold.after(rows)
    return exact(row.mid), up_sum(loss, up_product(row.rad, hold.group.reach))
