"""What is known of a state after many holds beside a limit of SC, as tight as the prover has it.

Lines over a clamp lie within its limits only as far as what is not known of a sample is kept apart;
and what a chain takes apart cancels in numbers only, not in balls. Where either fails, bounds grow
with every hold, and ways that the prover shows are rejected.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from flint import arb

import soter
from soter.api import recheck
from soter.certificate.cell_sets import Cells, Grid
from soter.certificate.grid.group_claims import ChainCheck, GroupTables
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.terms.compile_terms import form_of_box
from soter.certificate.terms.linear_enclosures import exact, line_max0, line_noisy_max0
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

WALL = """soter 1;
type Wall = { q: float, w: float };
topic near: Wall max_age 11ms;
topic u: float in [-4.15, 4.15] = 0.0;
plant P period 10ms {
  reads u; drives near = { q: q, w: w };
  state q: float = 1.0;
  state w: float;
  disturbance d: float in [-0.47, 0.47];
  der w = u DRAG + d;
  der q = -w;
  measured near.q within 0.08, near.w within 0.1;
}
node Ac period 10ms { publishes u; step { publish u = 4.15; } }
node Sc period 10ms {
  subscribes near; publishes u;
  step {
    publish u = clamp(9.0 * (clamp(2.0 * (near.q - 0.78), -0.9, 0.9) - near.w), -4.15, 4.15);
  }
}
rta M {
  ac Ac; sc Sc; period 10ms;
  safe near.q >= 0.0;
  verify { grid near.q in [0.04, 2.04] / 80, near.w in [-2.0, 2.0] / 60; levels 2; TIMES }
}
system S default { p: P; module M; until 10s; }
"""
"""Towards a wall at q = 0, w m/s; SC goes back to where there is room, no faster than 0.9 m/s."""
LATE = "late dm 500us, sc 500us; response dm 200us, sc 200us; acts within 0ms;"
ON_TIME = "acts within 0ms;"
EXTENTS = (0.04, 2.04), (-2.0, 2.0)
CELL = ((8, 9), (20, 21))
"""q in [0.24, 0.265], w in [-0.667, -0.6]: soon the clamp takes effect at both ends."""
MANY = 24
FAST = ((4, 5), (6, 7))
"""w in [-1.6, -1.533]: SC brakes, and what it may read does not reach the other side of 0."""
HOLD, HARDEST = 0.01, 4.15 + 0.47
"""In s, and in m/s^2: the limit of a command and the disturbance."""
NARROW = arb(2) ** -80


def wall(tmp_path: Path, drag: str, times: str) -> Path:
    path = tmp_path / "wall.soter"
    path.write_text(WALL.replace("DRAG", drag).replace("TIMES", times))
    return path


def check_of(path: Path, delay_ns: int) -> ChainCheck:
    """`delay_ns`: how old samples are, as a certificate may have it."""
    facts = small_proofs.facts_of(path, "S", "M")
    facts.times["d_ns"] = delay_ns
    edges = (small_proofs.even_edges(*e, n) for e, n in zip(EXTENTS, (80, 60), strict=True))
    grid = Grid(tuple(edges))
    model = CaseModel(facts, (), EXTENTS)
    return ChainCheck(model, GroupTables((0, 1), grid, np.ones(grid.shape, dtype=np.uint8)))


@pytest.mark.parametrize(
    ("delay_us", "drag", "times"),
    [
        (11_200, "", LATE),
        (11_200, "", ON_TIME),
        (11_200, "- 0.3 * w", LATE),
        (15_000, "", LATE),
        (22_000, "", LATE),
    ],
)
def test_what_is_known_lasts(tmp_path: Path, delay_us: int, drag: str, times: str) -> None:
    """A chain computes with numbers: after many holds no ball of its form has grown."""
    check = check_of(wall(tmp_path, drag, times), delay_us * 1000)
    chain = check.compiled_chain(1)
    form, step = form_of_box(check.group.grid.box_of(CELL), symbols=True), chain.first
    for _ in range(MANY):
        image = step(form)
        assert image is not None
        form, step = image[0], chain.later
        assert all(x.rad() <= NARROW * (1 + abs(x)) for x in form)


@pytest.mark.parametrize("delay_us", [5_000, 11_200, 22_000])
def test_no_command_leads_beyond_its_limit(tmp_path: Path, delay_us: int) -> None:
    """SC brakes as hard as it may, or nearly so, whatever is not known of the sample."""
    check = check_of(wall(tmp_path, "", LATE), delay_us * 1000)
    grid = check.group.grid
    box = grid.box_of(FAST)
    within = Cells(grid, np.ones(grid.shape, dtype=np.bool_))
    late = check.model.facts.jitter_ns / 1e9
    ((_, ends),) = check.follow(box, [1], within, 1)
    assert all(end[3] <= float(box[1][1]) + (HOLD + late) * HARDEST + 1e-12 for end in ends)


def test_ways_that_the_prover_shows_are_accepted(tmp_path: Path) -> None:
    """Ways of 32 holds: one of which too little is known is rejected."""
    path = wall(tmp_path, "", LATE)
    verify_report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert verify_report.verdict == "proved"
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason
    assert "P2b" in report.modules[0].confirmed


def test_a_slope_that_is_1_is_not_taken_for_none() -> None:
    """A quotient of equal numbers may be rounded to more than 1; its line is x, to within noise."""
    draw = np.random.default_rng(5)
    for _ in range(300):
        low, width, more = ((exact(float(x)) / 7).mid() for x in draw.uniform(0.1, 1.0, 3))
        slope, _, _, spread = line_noisy_max0(-low, width, low + more)
        assert slope >= 1 - NARROW
        assert slope <= 1
        assert spread <= (low + more) * (1 + NARROW)
        slope, _, spread, _, _ = line_max0(-low * NARROW, width)
        assert slope <= 1
        assert spread <= 2 * low * NARROW
