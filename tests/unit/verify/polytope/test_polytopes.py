"""Polytope groups: what is proved holds in simulation, and what is wrong is not proved."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.verify.polytope.half_spaces import (
    TOLD,
    Bounds,
    LinearProgram,
    Polytope,
    SpentError,
    Work,
    inner_point,
    surely_inside,
)
from soter.verify.polytope.linear_group import LinearGroup
from soter.verify.polytope.matrices import Array, exponential
from soter.verify.polytope.proofs import (
    NotProvedError,
    PolytopeSets,
    Windows,
    compute,
    find_core,
    prove,
)
from tables import all_rows

highspy = pytest.importorskip("highspy")

MS = 1_000_000
WINDOWS = Windows(60 * MS, 50 * MS, 3)


def cart(delay_ms: int = 0, jitter_ms: int = 0, gain: float = 1.0) -> LinearGroup:
    """A pushed mass with walls at +-1.5 m; PD control, 20 ms."""
    return LinearGroup(
        state=np.array([[0.0, 1.0], [0.0, 0.0]]),
        control=np.array([[0.0], [1.0]]),
        drift_low=np.array([0.0, -0.3]),
        drift_high=np.array([0.0, 0.3]),
        control_low=np.array([-5.0]),
        control_high=np.array([5.0]),
        error=np.array([0.05, 0.1]),
        gain=gain * np.array([[-2.0, -2.5]]),
        offset=np.zeros(1),
        remainder=np.full(1, 1e-9),
        law_low=np.array([-5.0]),
        law_high=np.array([5.0]),
        low=np.array([-1.5, -6.0]),
        high=np.array([1.5, 6.0]),
        rows=np.zeros((0, 2)),
        bounds=np.zeros(0),
        delta_ns=20 * MS,
        jitter_ns=jitter_ms * MS,
        delay_ns=delay_ms * MS,
    )


def axis() -> LinearGroup:
    """Five states: p, v, acceleration behind a second-order filter, and a leaky wind."""
    w = 8.0
    state = np.zeros((5, 5))
    state[0, 1] = state[1, 2] = state[2, 3] = state[1, 4] = 1.0
    state[3, 2:4] = -w * w, -2 * w
    state[4, 4] = -2.0
    control = np.zeros((5, 1))
    control[3, 0] = w * w
    drift = np.array([0.0, 0.2, 0.0, 0.0, 0.4])
    high = np.array([1.5, 6.0, 7.0, 120.0, 0.3])
    return LinearGroup(
        state=state,
        control=control,
        drift_low=-drift,
        drift_high=drift,
        control_low=np.array([-5.0]),
        control_high=np.array([5.0]),
        error=np.array([0.05, 0.1, 0.0, 0.0, 0.0]),
        gain=np.array([[-1.72, -2.28, -0.49, -0.03, 0.0]]),
        offset=np.zeros(1),
        remainder=np.full(1, 1e-9),
        law_low=np.array([-5.0]),
        law_high=np.array([5.0]),
        low=-high,
        high=high,
        rows=np.zeros((0, 5)),
        bounds=np.zeros(0),
        delta_ns=40 * MS,
    )


@lru_cache(maxsize=4)
def proved(delay_ms: int, jitter_ms: int) -> tuple[PolytopeSets, list[Array]]:
    sets = compute(cart(delay_ms, jitter_ms), WINDOWS)
    assert sets is not None
    return sets, prove(sets)


# ---------------------------------------------------------------- simulation


def vertices(p: Polytope, count: int, rng: np.random.Generator) -> Array:
    """Points of the border: extreme in random directions, and a little inside."""
    program = LinearProgram(p)
    points = [program.greatest(rng.normal(size=len(p.low)))[1] for _ in range(count)]
    return np.array(points) * (1 - 1e-9)


def flow(group: LinearGroup, ms: int) -> tuple[Array, Array]:
    e, g = exponential(group.state, ms * MS)
    return e.mid, g.mid


def step(group: LinearGroup, x: Array, u: Array, w: Array, e: Array, g: Array) -> Array:
    """Exact for constant u and w over the step; rows are states."""
    return np.asarray(x @ e.T + (u @ group.control.T + w) @ g.T)


def worst(rng: np.random.Generator, shape: tuple[int, ...], bound: Array) -> Array:
    """Values at their bounds: constant in time or changing, by row."""
    return np.asarray(rng.choice([-1.0, 1.0], size=shape) * bound)


def sc_run(
    group: LinearGroup, x: Array, holds: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """(all states on the way, states at the holds), 1 ms apart, errors and ages at their bounds."""
    e, g = flow(group, 1)
    per = group.delta_ns // MS
    d, j = group.delay_ns // MS, group.jitter_ns // MS
    n = len(x)
    total = holds * per + j + 1
    acting = [0] + [k * per + int(rng.integers(-j, j + 1)) for k in range(1, holds + 1)]
    bias, always = worst(rng, (n, len(group.low)), group.error), rng.random(n) < 0.5
    wind = worst(rng, (n, len(group.low)), group.drift_high)
    past, seen, u = [x], [x], np.zeros((n, 1))
    for t in range(total):
        if t in acting:
            age = int(rng.integers(0, d + 1))
            y = past[max(len(past) - 1 - age, 0)]
            error = worst(rng, (n, len(group.low)), group.error)
            y = y + np.where(always[:, None], bias, error)
            u = np.clip(y @ group.gain.T + group.offset, group.control_low, group.control_high)
        change = rng.random((n, 1)) < 0.05
        wind = np.where(change, worst(rng, (n, len(group.low)), group.drift_high), wind)
        past.append(step(group, past[-1], u, wind, e, g))
        seen.append(past[-1])
    return np.array(seen), np.array(seen[::per])


@pytest.mark.parametrize(("delay_ms", "jitter_ms"), [(0, 0), (10, 2)])
def test_sc_keeps_the_constraint_from_every_state_of_k(delay_ms: int, jitter_ms: int) -> None:
    sets, _ = proved(delay_ms, jitter_ms)
    rng = np.random.default_rng(delay_ms)
    start = vertices(sets.core, 400, rng)
    seen, at_holds = sc_run(sets.group, start, 150, rng)
    assert (np.abs(seen) <= sets.group.high + 1e-9).all()
    if not delay_ms:
        assert all(sets.core.contains(x * (1 - 1e-7)).all() for x in at_holds)


def test_the_simulation_would_notice_a_set_that_is_too_large() -> None:
    sets, _ = proved(0, 0)
    rng = np.random.default_rng(1)
    seen, _ = sc_run(sets.group, vertices(sets.core, 200, rng) * 1.15, 150, rng)
    assert (np.abs(seen) > sets.group.high).any()


def test_no_command_leaves_k_within_the_horizon_where_the_dm_allows_ac() -> None:
    sets, _ = proved(0, 0)
    rng = np.random.default_rng(2)
    group = sets.group
    estimate = vertices(sets.ttf, 200, rng)
    e, g = flow(group, 1)
    corners = np.array(list(itertools.product([-1.0, 1.0], repeat=4)))
    for signs in corners:
        x = estimate + signs[:2] * group.error
        u, w = np.full((len(x), 1), 5.0 * signs[2]), np.array([0.0, 0.3 * signs[3]])
        for _ in range(sets.windows.horizon_ns // MS):
            x = step(group, x, u, np.broadcast_to(w, x.shape), e, g)
            assert sets.core.contains(x * (1 - 1e-9)).all()


def test_levels_are_nested_and_not_empty() -> None:
    sets, _ = proved(0, 0)
    rng = np.random.default_rng(3)
    assert sets.free.contains(vertices(sets.allowed[0], 50, rng)).all()
    assert sets.allowed[0].contains(vertices(sets.allowed[1], 50, rng)).all()
    assert sets.safer.contains(np.zeros((1, 2))).all()
    assert sets.kept is not None
    assert sets.periods > 0


def test_every_run_from_k_comes_back_to_q() -> None:
    sets, _ = proved(0, 0)
    assert sets.kept is not None
    rng = np.random.default_rng(4)
    _, at_holds = sc_run(sets.group, vertices(sets.core, 200, rng), sets.periods + 20, rng)
    for x in at_holds[sets.periods :]:
        assert sets.kept.contains(x * (1 - 1e-7)).all()


def test_a_proof_is_checked_again_without_a_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    sets, multipliers = proved(0, 0)
    monkeypatch.setattr(
        "soter.verify.polytope.half_spaces.require_highs", lambda: pytest.fail("solved")
    )
    assert len(prove(sets, multipliers)) == len(multipliers)


# ---------------------------------------------------------------- what is wrong is not proved


def larger(p: Polytope, factor: float) -> Polytope:
    return Polytope(p.low, p.high, p.rows, p.bounds * factor)


def more(group: LinearGroup, **changes: object) -> LinearGroup:
    return replace(group, **changes)  # type: ignore[arg-type]


WRONG = {
    "K is larger": lambda s: replace(s, core=larger(s.core, 1.02)),
    "R is larger": lambda s: replace(s, free=larger(s.free, 1.02)),
    "S_0 is R": lambda s: replace(s, allowed=[s.free, s.allowed[1]]),
    "S_1 is S_0": lambda s: replace(s, allowed=[s.allowed[0], s.allowed[0]]),
    "Q is K": lambda s: replace(s, kept=s.core),
    "too few holds": lambda s: replace(s, periods=s.periods // 2),
    "more wind": lambda s: replace(
        s,
        group=more(s.group, drift_low=s.group.drift_low * 1.2, drift_high=s.group.drift_high * 1.2),
    ),
    "larger errors": lambda s: replace(s, group=more(s.group, error=s.group.error * 1.2)),
    "a later SC": lambda s: replace(s, group=more(s.group, delay_ns=20 * MS)),
    "a slower SC": lambda s: replace(s, group=more(s.group, delta_ns=60 * MS)),
    "a weaker SC": lambda s: replace(s, group=more(s.group, gain=s.group.gain * 0.8)),
    "the wrong sign": lambda s: replace(s, group=more(s.group, gain=-s.group.gain)),
    "a longer horizon": lambda s: replace(s, windows=replace(s.windows, horizon_ns=90 * MS)),
    "a stronger AC": lambda s: replace(
        s, group=more(s.group, control_low=np.array([-6.0]), control_high=np.array([6.0]))
    ),
    "an earlier clamp": lambda s: replace(
        s, group=more(s.group, law_low=np.array([-3.0]), law_high=np.array([3.0]))
    ),
    "a nearer wall": lambda s: replace(s, group=more(s.group, high=np.array([1.4, 6.0]))),
}


@all_rows("name", WRONG)
def test_a_wrong_claim_is_not_proved(name: str) -> None:
    sets, _ = proved(0, 0)
    with pytest.raises(NotProvedError):
        prove(WRONG[name](sets))


@all_rows("name", WRONG)
def test_nor_with_the_multipliers_of_the_right_one(name: str) -> None:
    sets, multipliers = proved(0, 0)
    with pytest.raises((NotProvedError, ValueError)):
        prove(WRONG[name](sets), multipliers)


def test_negative_multipliers_are_refused() -> None:
    sets, multipliers = proved(0, 0)
    bad = [m.copy() for m in multipliers]
    next(m for m in bad if m.size).flat[0] = -1.0
    with pytest.raises(ValueError, match="non-negative"):
        prove(sets, bad)


def test_an_unstable_loop_has_no_k() -> None:
    assert compute(cart(gain=-1.0), WINDOWS) is None


# ---------------------------------------------------------------- numbers


def test_bounds_hold_at_random_points() -> None:
    rng = np.random.default_rng(5)
    p = Polytope(-np.ones(3), np.ones(3), rng.normal(size=(12, 3)), rng.uniform(0.2, 1.0, 12))
    points = rng.uniform(-1, 1, size=(20_000, 3))
    points = points[p.contains(points)]
    from soter.verify.polytope.matrices import exact

    rows = rng.normal(size=(20, 3))
    bounds = Bounds(p).of(exact(rows))
    values = (points @ rows.T).max(axis=0)
    assert (values <= bounds).all()
    assert (bounds - values < 0.2).all(), "and they are close"


@pytest.mark.long
def test_five_states_are_proved() -> None:
    sets = compute(axis(), Windows(40 * MS, 30 * MS, 2))
    assert sets is not None
    prove(sets)
    fast = np.zeros((1, 5))
    fast[0, 1] = 1.0
    assert sets.ttf.contains(fast).all(), "AC may cross the centre line at 1 m/s"


# ---------------------------------------------------------------- a point inside


@given(st.integers(1, 6), st.integers(0, 12), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_an_inner_point_lies_inside_and_on_no_half_space(n: int, cuts: int, seed: int) -> None:
    chance = np.random.default_rng(seed)
    size = 10.0 ** chance.uniform(-3, 3, n)
    inside = chance.uniform(-0.5, 0.5, n) * size
    rows = chance.normal(size=(cuts, n)) / size
    room = 10.0 ** chance.uniform(-3, 0, cuts)
    point = inner_point(Polytope(-size, size, rows, rows @ inside + room))
    assert point is not None
    assert (rows @ point < rows @ inside + room).all()
    assert (np.abs(point) <= size).all()


def test_an_inner_point_lies_on_no_half_space_though_the_ends_of_all_axes_do() -> None:
    # of the triangle (0, 0), (1, 1), (0.6, 0.5) the least and the greatest x and y lie on x = y
    rows = np.array([[-1.0, 1.0], [0.5, -0.6], [1.25, -1.0]])
    triangle = Polytope(np.zeros(2), np.ones(2), rows, np.array([0.0, 0.0, 0.25]))
    point = inner_point(triangle)
    assert point is not None
    assert (rows @ point < triangle.bounds - 1e-3).all()


def test_a_flat_set_has_an_inner_point_and_an_empty_one_has_none() -> None:
    low, high = np.array([0.0, 0.5]), np.array([1.0, 0.5])
    flat = Polytope(low, high, np.array([[1.0, 1.0]]), np.array([1.25]))
    point = inner_point(flat)
    assert point is not None
    assert point[1] == 0.5
    assert 0.0 < point[0] < 0.75
    assert inner_point(flat.with_rows(np.array([[1.0, 0.0]]), np.array([-0.1]))) is None


def polytope(low: list[float], high: list[float], *cuts: tuple[list[float], float]) -> Polytope:
    rows = np.array([row for row, _ in cuts]).reshape(-1, len(low))
    return Polytope(np.array(low), np.array(high), rows, np.array([b for _, b in cuts]))


@pytest.mark.parametrize(
    "flat",
    [
        polytope([0.0, 0.0], [6.0, 6.0], ([3.0, 1.0], 7.0), ([-3.0, -1.0], -7.0)),
        polytope([0.0, 0.0], [7.0, 7.0], ([-3.0, -3.0], -10.0), ([2.0, 0.0], 0.0)),
        polytope([-0.007], [0.007], ([3e11], -1e8), ([-9e-11], 2e-13)),
    ],
)
def test_a_set_without_an_inside_still_has_a_point(flat: Polytope) -> None:
    point = inner_point(flat)
    assert point is not None
    assert surely_inside(flat, point)


def test_no_point_is_given_that_does_not_surely_lie_inside() -> None:
    # x = 1/3 is no double
    thirds = polytope([0.0, 0.0], [1.0, 1.0], ([3.0, 0.0], 1.0), ([-3.0, 0.0], -1.0))
    assert inner_point(thirds) is None


def test_the_middle_of_the_largest_box_is_in_proportion_to_the_ranges() -> None:
    # of the triangle (0, 0), (1, 1), (0.6, 0.5), a thousand times as wide as high
    rows = [([-1.0, 1e3], 0.0), ([0.5, -0.6e3], 0.0), ([1.25, -1e3], 0.25e3)]
    point = inner_point(polytope([0.0, 0.0], [1e3, 1.0], *rows))
    assert point is not None
    x, y = point[0] / 1e3, point[1]
    least = min((x - y) / 2.0, (0.6 * y - 0.5 * x) / 1.1, (0.25 + y - 1.25 * x) / 2.25)
    t = 0.011  # the largest one is 0.0116 of the ranges from each side
    assert least > t


def test_half_spaces_without_end_cut_nothing_and_those_of_nan_are_in_no_set() -> None:
    wide = polytope([-np.inf, 0.0], [np.inf, 1.0], ([1.0, 0.0], 2.0), ([-1.0, 0.0], np.inf))
    assert surely_inside(wide, np.array([1.0, 0.5]))
    assert not surely_inside(wide, np.array([2.5, 0.5]))
    assert not surely_inside(polytope([0.0], [1.0], ([np.nan], 1.0)), np.array([0.5]))
    assert not surely_inside(polytope([0.0], [1.0], ([1.0], np.nan)), np.array([0.5]))
    assert not surely_inside(polytope([0.0], [1.0], ([0.0], -np.inf)), np.array([0.5]))


# ---------------------------------------------------------------- how much it may take


def test_work_is_counted_and_the_same_each_time() -> None:
    spent = []
    for _ in range(2):
        work = Work(10**9)
        assert find_core(cart(10, 5), WINDOWS, work) is not None
        spent.append(work.most - work.left)
    assert spent[0] == spent[1] > 0
    assert find_core(cart(10, 5), WINDOWS, Work(2 * spent[0])) is not None
    with pytest.raises(SpentError):
        find_core(cart(10, 5), WINDOWS, Work(spent[0] - 1))


def test_who_is_told_of_work_may_end_it() -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Work(10**9, stop).count(TOLD)
