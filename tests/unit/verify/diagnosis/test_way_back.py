"""Why SC does not give control back, and that what the message advises mends the program."""

from __future__ import annotations

import re

import pytest

from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from unit.verify.diagnosis.tank_modules import cause, changed, explained, kinds

LIFT = """soter 1;
type Motion = { h: float, v: float };
topic motion: Motion max_age 50ms;
topic drive: float in [-2.0, 2.0] = 0.0;
plant Elevator period 50ms {
  reads drive;
  drives motion = { h: h, v: v };
  state h: float = 5.0;
  state v: float = 0.0;
  disturbance load: float in [-0.1, 0.1];
  der h = v;
  der v = drive + load;
  measured motion.h within 0.02;
}
node Learned period 50ms { subscribes motion; publishes drive; step { publish drive = 2.0; } }
node Home period 50ms {
  subscribes motion;
  publishes drive;
  step { publish drive = clamp(1.0 * (5.0 - motion.h) - 1.5 * motion.v, -2.0, 2.0); }
}
rta SafeLift {
  ac Learned;
  sc Home;
  period 50ms;
  safe motion.h > 0.0 && motion.h < 10.0;
  ttf motion.h < 2.0 || motion.h > 8.0 || abs(motion.v) > 1.0;
  safer motion.h > 3.0 && motion.h < 7.0 && abs(motion.v) < 0.5;
  verify { grid motion.h in [0.0, 10.0] / 40, motion.v in [-3.0, 3.0] / 24; }
}
system Tower { e: Elevator; module SafeLift; until 30s; }
"""
LAW = "1.0 * (5.0 - motion.h) - 1.5 * motion.v"
ELSEWHERE = ("safer motion.h > 3.0 && motion.h < 7.0", "safer motion.h > 6.0 && motion.h < 7.5")
FINE = (
    "[0.0, 10.0] / 40, motion.v in [-3.0, 3.0] / 24",
    "[0.0, 10.0] / 160, motion.v in [-3.0, 3.0] / 96",
)


def helped(module_result: ModuleResult, claim: str = "P2b") -> str:
    return module_result.findings[claim].hint


@pytest.fixture(scope="module")
def elsewhere() -> ModuleResult:
    return explained(changed(ELSEWHERE, FINE, text=LIFT))


def test_an_sc_that_rests_outside_safer_is_told_where_it_rests(elsewhere: ModuleResult) -> None:
    assert elsewhere.findings["P2b"].verdict == "undecided"
    why = cause(elsewhere, "P2b", "stays_away")
    assert "comes to rest at e.h = 5, e.v = 0" in why.text


@pytest.mark.long
def test_cells_that_are_too_coarse_are_told_with_what_does() -> None:
    """Computed sets do on the same cells; given ones want more of them."""
    coarse = explained(LIFT)
    assert coarse.findings["P2b"].verdict == "undecided"
    assert "stays_away" not in kinds(coarse, "P2b")
    computed = "neither `ttf` nor `safer`: left out, both are computed"
    assert helped(coarse) == f"{computed} (tried: every claim is proved)"
    assert explained(re.sub(r"  (ttf|safer) [^;]*;\n", "", LIFT)).verdict == "proved"
    assert explained(changed(FINE, text=LIFT)).verdict == "proved"


def test_a_disturbance_that_pushes_sc_out_of_safer_is_named_with_how_far() -> None:
    """It rests where 0.5 (1 - x) is the leak: from 0.96 to 1, and 0.01 of error on either side."""
    narrow = ("safer level > 0.4 && level < 1.6", "safer level > 0.965 && level < 1.1")
    module_result = explained(changed(narrow))
    why = cause(module_result, "P2b", "pushed_out")
    assert "leak = 0.02" in why.text
    assert "error of level = -0.01" in why.text
    assert "`safer` does not hold there of every estimate" in why.text
    rests = re.search(r"t\.h = ([\d.]+)", why.text.partition("comes to rest")[2])
    assert rests is not None
    assert 0.95 - 2e-3 <= float(rests[1]) <= 0.98


def test_a_safer_without_room_for_the_error_is_told_how_wide_it_has_to_be() -> None:
    module_result = explained(
        changed(("safer level > 0.4 && level < 1.6", "safer level > 0.99 && level < 1.0"))
    )
    assert kinds(module_result, "P2b") == ["no_target"]


def test_an_sc_that_is_too_slow_is_told_the_time_that_it_needs() -> None:
    grid = "verify { grid level in [0.2, 1.8] / 320;"
    module_result = explained(changed((grid, f"{grid} recover within 500ms;")))
    enough = re.search(r"`recover within (\d+)ms;`", helped(module_result))
    assert enough is not None
    mended = explained(changed((grid, f"{grid} recover within {enough[1]}ms;")))
    assert mended.findings["P2b"].verdict == "proved"
    less = f"{grid} recover within {int(enough[1]) - 1}ms;"
    assert explained(changed((grid, less))).findings["P2b"].verdict == "undecided"
