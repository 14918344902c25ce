"""Verdicts: what is right is proved, and each way to be wrong is not."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from soter.language.front_end import check_file
from soter.verify import verify_module as verifying
from soter.verify.claims.results import PROPERTIES, ModuleResult
from soter.verify.command import verify
from soter.verify.problem.problem import assumption_texts

ROOT = Path(__file__).parents[3]
CART = (ROOT / "examples" / "wall" / "cart.soter").read_text("utf-8")
COARSE = (
    ("/ 400", "/ 100"),
    ("/ 320", "/ 80"),
    ("tau * tau) + 0.12", "tau * tau) + 0.8"),
)
"""A coarser grid needs wider margins; it is a sixteenth of the work."""


@pytest.fixture(autouse=True)
def _no_finer_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)


def changed(*pairs: tuple[str, str]) -> str:
    text = CART
    for old, new in (*COARSE, *pairs):
        assert old in text, old
        text = text.replace(old, new)
    return text


def result_of(text: str, *, refute: bool = False) -> ModuleResult:
    checked = check_file("cart.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    (module_result,) = verify(checked, refute=refute).modules
    return module_result


def verdicts(module_result: ModuleResult) -> dict[str, str]:
    return {name: f.verdict for name, f in module_result.findings.items()}


@pytest.fixture(scope="module")
def cart() -> ModuleResult:
    return result_of(changed())


def test_the_cart_is_proved(cart: ModuleResult) -> None:
    assert verdicts(cart) == {**dict.fromkeys(PROPERTIES, "proved"), "failsafe": "assumed"}
    assert cart.verdict == "proved"


def test_sets_lie_inside_each_other_and_are_not_empty(cart: ModuleResult) -> None:
    (case,) = cart.cases
    (part,) = case.groups
    core = part.core > 0
    assert part.free is not None
    assert part.lets_ac is not None
    assert part.gives_back is not None
    assert part.home is not None
    assert part.rank is not None
    chain = [part.gives_back, part.lets_ac, part.free, core, part.allowed]
    for small, large in pairwise(chain):
        assert small.any()
        assert not (small & ~large).any()
    assert np.array_equal(part.rank > 0, core)
    assert not ((part.home > 0) & (part.rank != 1)).any()
    assert 0.5 < cart.shares["gives_back"] < cart.shares["core"] < 1.0


def test_time_to_return_is_told(cart: ModuleResult) -> None:
    assert cart.recover_s is not None
    assert 1.0 < cart.recover_s < 10.0


def test_linear_plants_cover_the_simulators_scheme(cart: ModuleResult) -> None:
    assert not any("scheme" in a for a in assumption_texts(cart.assumptions))
    euler = result_of(changed(("state x: float", "integrate euler;\n  state x: float")))
    assert not any("scheme" in a for a in assumption_texts(euler.assumptions))
    assert "scheme" not in euler.assumed


WRONG = {
    "ttf comes too late": (("Room(motion, 0.12) < 0.0", "Room(motion, 0.02) < 0.0"), "ttf"),
    "safer is too large": (
        ("safer Room(motion, 0.24) > 0.0", "safer Room(motion, 0.0) > -0.2"), "safer",
    ),
    "SC pushes the wrong way": (("-2.0 * motion.x - 3.0", "2.0 * motion.x - 3.0"), "P2a"),
    "SC publishes outside its set": (
        ("clamp(-2.0 * motion.x - 3.0 * motion.v, -A, A)", "-2.0 * motion.x - 3.0 * motion.v"),
        "P2a",
    ),
    "errors are larger than the margins": (
        ("motion.x within 0.02, motion.v within 0.05", "motion.x within 0.6, motion.v within 0.3"),
        "ttf",
    ),
    "the wind is stronger than the motor": (("wind: float in [-0.2, 0.2]",
        "wind: float in [-4.0, 4.0]"), "P2a"),
    "samples are older than the margins": (("max_age 20ms", "max_age 400ms"), "ttf"),
    "the horizon is too short": (("acts within 1ms;", "acts within 1ms; horizon 70ms;"), "P1c"),
    "the grid is smaller than what ttf admits": (("motion.v in [-8.0, 8.0]",
        "motion.v in [-5.0, 5.0]"), "ttf"),
    "the start is at the wall": (('unit "m" = 0.0', 'unit "m" = 9.96'), "start"),
    "the start is too fast": (
        ('v: float unit "m/s" = 0.0', 'v: float unit "m/s" in [7.0, 7.9]'), "start",
    ),
    "SC only brakes and never returns": (
        ("-2.0 * motion.x - 3.0 * motion.v", "-1.0 * motion.v"), "P2b",
    ),
    "it takes longer than promised": (("acts within 1ms;",
        "acts within 1ms; recover within 500ms;"), "P2b"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_not_proved(what: str) -> None:
    change, suspect = WRONG[what]
    module_result = result_of(changed(change))
    assert module_result.verdict == "undecided"
    assert module_result.findings[suspect].verdict == "undecided", verdicts(module_result)
    assert module_result.findings[suspect].text
    if suspect in ("ttf", "safer"):
        assert module_result.findings["P3"].verdict == "undecided"
        assert module_result.findings[suspect].regions


SLOW = """soter 1;
topic position: float max_age 500ms;
topic push: float in [-1.5, 1.5] = 0.0;
plant Cart period 1s { reads push; drives position = x; state x: float = 0.0; next x = x + push; }
node Still period 2s { publishes push; step { publish push = 0.0; } }
node Back period 2s {
  subscribes position;
  publishes push;
  step { publish push = clamp(-GAIN * position, -1.5, 1.5); }
}
rta M {
  ac Still;
  sc Back;
  period 2s;
  safe abs(position) <= 1.0;
  ttf true;
  safer false;
  verify { grid position in [-1.0, 1.0] / 40; }
}
system S { cart: Cart; module M; }
"""


@pytest.mark.parametrize(("gain", "verdict"), [("0.5", "proved"), ("1.5", "undecided")])
def test_the_command_of_a_slow_controller_acts_on_every_step_of_a_map(
    gain: str, verdict: str
) -> None:
    module_result = result_of(SLOW.replace("GAIN", gain))  # 1.5: x, -x/2, -2x
    assert module_result.findings["P2a"].verdict == verdict


CORNERS = """soter 1;
topic at_a: float max_age 500ms;
topic at_b: float max_age 500ms;
topic push: float in [-1.0, 1.0] = 0.0;
plant P period 1s {
  reads push;
  drives at_a = a;
  drives at_b = b;
  state a: float = 0.9;
  state b: float = 0.8;
  state leg: int in [0, 1] = 0;
  next a = a < 0.6 ? 0.5 * a : 0.9 + 0.5 * (a - 0.9);
  next b = b < 0.55 ? 0.5 * b : 0.8 + 0.5 * (b - 0.8) + 0.0 * push;
}
node Ac period 1s { publishes push; step { publish push = 0.0; } }
node Sc period 1s { publishes push; step { publish push = 0.0; } }
rta M {
  ac Ac;
  sc Sc;
  period 1s;
  safe (abs(at_a - 0.9) <= 0.03 && abs(at_b - 0.8) <= 0.2)
    || (abs(at_a) <= 0.4 && abs(at_b) <= 0.4);
  ttf true;
  safer abs(at_b) <= 0.11;
  verify { grid at_a in [-3.0, 3.0] / 60; grid at_b in [-1.0, 1.0] / 40; }
}
system S { p: P; module M; }
"""


def test_a_finer_grid_of_one_group_does_not_pair_sets_of_different_corners(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 2)
    module_result = result_of(CORNERS)
    assert module_result.findings["P2a"].verdict == "proved"
    for case in module_result.cases:
        near = []
        for part in case.groups:
            (edges,) = part.edges
            middles = (np.array(edges[:-1]) + np.array(edges[1:])) / 2
            near.append({bool(m < 0.5) for m in middles[part.core > 0]})
        assert near[0] == near[1] in ({True}, {False})  # `safe` is no product of both corners
