"""The re-checker's own bounds of flows and laws: never exceeded, and no wider than the prover's."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from soter.certificate.polytope.certificate_tables import HalfSpaces
from soter.certificate.polytope.half_space_images import BallFlow, FreeImage, HoldImage
from soter.certificate.polytope.linear_laws import CommandLaw
from soter.certificate.reading.linear_flows import LinearFlow
from soter.certificate.report import RejectedError
from soter.certificate.terms.linear_enclosures import ZERO, exact
from soter.verify.polytope import linear_group as polytope_model
from soter.verify.polytope.linear_group import LinearGroup, free_instants, hold_instants
from soter.verify.polytope.matrices import exact as ball
from soter.verify.polytope.matrices import exponential
from soter.verify.polytope.proofs import Claims, Windows, find_core, prove_core
from unit.verify.polytope.polytope_adversary import MS, Attack, random_group

pytest.importorskip("highspy")

TIMES = ((0, 0), (10, 4), (1, 7))
CLOSE = 1e-9


def numbers(values: object) -> list[list[Any]]:
    return [[exact(float(x)) for x in row] for row in np.asarray(values)]


def flow_of(group: LinearGroup) -> BallFlow:
    """The numbers of a group in balls."""
    centre, radius = group.drift
    ends = [
        (exact(a), exact(b)) for a, b in zip(group.control_low, group.control_high, strict=True)
    ]
    linear = LinearFlow(
        tuple(range(len(group.low))),
        numbers(group.state),
        numbers(group.control),
        [exact(float(x)) for x in centre],
        numbers(np.diag(radius)),
        tuple(ends),
    )
    box = list(zip(group.low.tolist(), group.high.tolist(), strict=True))
    return BallFlow(linear, box, range(len(ends)))


def law_of(group: LinearGroup) -> CommandLaw:
    error = np.abs(group.gain) @ group.error + group.remainder
    rows = (group.offset, error, group.law_low, group.law_high)
    offset, spread, low, high = ([exact(float(x)) for x in row] for row in rows)
    return CommandLaw(tuple(range(len(offset))), numbers(group.gain), offset, spread, low, high)


def hold_of(group: LinearGroup, rate: object) -> HoldImage:
    delays = (group.delay_ns, group.jitter_ns)
    instants = hold_instants(group.delta_ns)
    return HoldImage(flow_of(group), law_of(group), np.asarray(rate).tolist(), instants, delays)


def rows_of(group: LinearGroup, seed: int) -> Any:
    n = len(group.low)
    chance = np.random.default_rng(seed)
    return np.concatenate([np.eye(n), -np.eye(n), chance.normal(size=(10, n))])


def floats(moved: Any) -> tuple[Any, Any]:
    rows, losses = moved
    return np.array([[float(x) for x in r] for r in rows]), np.array([float(x) for x in losses])


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize("seed", [0, 4, 5])
def test_its_bounds_are_no_wider_than_those_of_the_prover(
    seed: int, times: tuple[int, int]
) -> None:
    chance = np.random.default_rng(seed)
    group = random_group(chance, delay_ms=times[0], jitter_ms=times[1])
    rate, rows = np.full(len(group.offset), 3.0), rows_of(group, seed)
    theirs, own = polytope_model.Hold(group, rate), hold_of(group, rate)
    pairs = [(theirs.after(ball(rows)), own.at_end(numbers(rows)))]
    pairs += zip(theirs.everywhere(ball(rows)), own.at_all_times(numbers(rows)), strict=True)
    free = polytope_model.FreePhase(group, 54 * MS).everywhere(ball(rows))
    again = FreeImage(flow_of(group), free_instants(54 * MS)).at_all_times(numbers(rows))
    pairs += zip(free, again, strict=True)
    for (row, loss), moved in pairs:
        own_row, own_loss = floats(moved)
        assert np.abs(row.mid - own_row).max() < CLOSE
        assert (own_loss <= loss + CLOSE).all()


@pytest.mark.parametrize("times", [(10, 4), (1, 7)])
@pytest.mark.parametrize("seed", [0, 4])
def test_no_run_ends_a_hold_beyond_its_bounds(seed: int, times: tuple[int, int]) -> None:
    chance = np.random.default_rng(seed)
    group = random_group(chance, delay_ms=times[0], jitter_ms=times[1])
    sets = find_core(group, Windows(60 * MS, 50 * MS, 3))
    assert sets is not None
    prove_core(sets, Claims())
    rows = rows_of(group, seed)
    row, loss = floats(hold_of(group, sets.rate).at_end(numbers(rows)))
    blind = replace(group, jitter_ns=0, error=group.error * 0.0)
    _, less = floats(hold_of(blind, sets.rate).at_end(numbers(rows)))
    worst = np.zeros(0)
    for lead in (0, times[1]):
        for before, after in pairwise(Attack(group, sets.core, 200, lead, chance).run(12).nominal):
            worst = np.append(worst, (after @ rows.T - before @ row.T - loss).max())
    assert worst.max() <= 1e-7
    assert (less < loss).any()


@pytest.mark.parametrize("seed", [0, 4])
def test_no_command_leaves_the_bounds_of_a_free_phase(seed: int) -> None:
    chance = np.random.default_rng(seed)
    group = random_group(chance, delay_ms=0, jitter_ms=0)
    flow, rows = flow_of(group), rows_of(group, seed)
    moved = [floats(m) for m in FreeImage(flow, free_instants(40 * MS)).at_all_times(numbers(rows))]
    x0 = chance.uniform(group.low / 4, group.high / 4, (50, len(group.low)))
    bound = np.max([x0 @ r.T + loss for r, loss in moved], axis=0)
    e, g = exponential(group.state, MS)
    for k in range(len(rows)):
        x = x0
        for t in range(40):
            left = exponential(group.state, (39 - t) * MS)[0].mid
            aim = rows[k] @ left
            u = np.sign(aim @ group.control) * group.control_high
            x = x @ e.mid.T + (group.control @ u + np.sign(aim) * group.drift_high) @ g.mid.T
            assert (x @ rows.T <= bound + 1e-9).all()
        assert ((bound - x @ rows.T)[:, k].min()) < 0.2, "and they are close"


def test_bounds_by_multipliers_hold_at_random_points() -> None:
    chance = np.random.default_rng(3)
    faces, limits = chance.normal(size=(8, 3)), chance.uniform(0.3, 1.0, 8)
    one = (1.0, 1.0, 1.0)
    p = HalfSpaces(
        tuple(-x for x in one), one, tuple(map(tuple, faces.tolist())), tuple(limits.tolist())
    )
    points = chance.uniform(-1, 1, (20_000, 3))
    points = points[(points @ faces.T <= limits).all(axis=1)]
    for _ in range(20):
        row = chance.normal(size=3)
        weights = [(int(k), float(chance.uniform(0, 2))) for k in chance.integers(8, size=3)]
        bound = p.upper_bound([exact(float(x)) for x in row], weights)
        assert (points @ row).max() <= float(bound)
    with pytest.raises(RejectedError):
        p.require("nothing", numbers(np.eye(3)), [ZERO] * 3, [[], [], []])
