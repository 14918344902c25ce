"""`margin(M)`: nobody takes over before it says, whatever AC does; and by how much at most.

The carts start anywhere where SC may still brake. Their ACs rush at the wall that the input
names, or read the margin themselves, keep where it is short, and rush where it is long.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from long_tests import examples, seeds
from soter.language.front_end import check_file, system_of
from soter.verify.deploy.level_tables import GroupTable
from soter.verify.deploy.missing_predicates import looks_with_control
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import DiscreteParameter, assumption_texts
from soter.verify.tubes.tube_levels import TubeLevels

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from soter.simulate.result import Run

    Times = npt.NDArray[np.int64]

RUNS = examples(16)
PERIOD_NS = 50_000_000
AFTER = 10**18
"""No take-over any more."""
RUSH = "push > 0.0 ? A : -A"
LURK = """
    margin(Keep) > BOLD || abs(push) > 0.5
      ? (push > 0.0 ? A : -A)
      : clamp(-8.0 * motion.v, -A, A)"""

CART = """
soter 1;
const A: float = 3.0;
const WALL: float = 10.0;
const BOLD: float = 0.08;
type Motion = { x: float, v: float };
topic motion: Motion max_age 5ms;
input topic push: float in [-1.0, 1.0] = 1.0;
topic accel: float in [-A, A] = 0.0;
topic told: float in [0.0, 10.0] = 0.0;
plant Cart period 5ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float in [-5.0, 5.0];
  state v: float in [-2.0, 2.0];
  disturbance wind: float in [-0.2, 0.2];
  der x = v;
  der v = accel + wind;
  measured motion.x within 0.002, motion.v within 0.005;
}
node Ram period 10ms {
  subscribes motion, push;
  publishes accel;
  step { publish accel = COMMAND; }
}
node Careful period 10ms {
  subscribes motion;
  publishes accel;
  step { publish accel = clamp(-2.0 * motion.x - 3.0 * motion.v, -A, A); }
}
node Watch period 5ms { publishes told; step { publish told = margin(Keep); } }
rta Keep {
  ac Ram; sc Careful; period 50ms;
  safe abs(motion.x) < WALL;
  PREDICATES
  verify {
    grid motion.x in [-WALL, WALL] / 400, motion.v in [-8.0, 8.0] / 320;
    levels LEVELS;
  }
}
system S default {
  c: Cart; module Keep; node Watch; input push every 500ms; until 20s;
  always abs(c.truth.x) < WALL;
}
"""
BY_HAND = "ttf abs(motion.x) > 8.0; safer abs(motion.x) < 7.0 && abs(motion.v) < 1.0;"


def cart(folder: Path, *, levels: int, command: str, predicates: str = "") -> soter.Program:
    text = CART.replace("LEVELS", str(levels)).replace("PREDICATES", predicates)
    path = folder / "cart.soter"
    path.write_text(text.replace("COMMAND", command), encoding="utf-8")
    return soter.load(path)


def slack(run: Run, above_ns: int = 0) -> Times:
    """Of every instant with a margin above that: until the next take-over, less the margin, ns."""
    now = np.rint(run.time_s() * 1e9).astype(np.int64)
    told = np.rint(run.topic("told") * 1e9).astype(np.int64)
    mode = run.mode("Keep")
    taken = np.append(now[1:][(mode[:-1] == 1) & (mode[1:] == 0)], AFTER)
    slacks: Times = (taken[np.searchsorted(taken, now, side="right")] - now - told)[told > above_ns]
    return slacks


@pytest.mark.parametrize(
    ("command", "tight_ns"), [(RUSH, 0), (LURK, PERIOD_NS)], ids=["rushes", "lurks"]
)
@pytest.mark.random
def test_nobody_takes_over_before_the_margin_said(
    tmp_path: Path, command: str, tight_ns: int
) -> None:
    least, longest = AFTER, 0.0
    program = cart(tmp_path, levels=3, command=command)
    for seed in seeds(RUNS):
        run = program.simulate(seed=seed, sha256=False)
        assert run.violations == 0
        slacks = slack(run)
        assert slacks.min() >= 0, f"seed {seed}"
        least = min(least, int(slack(run, PERIOD_NS).min(initial=AFTER)))
        longest = max(longest, float(run.topic("told").max()))
    assert longest == 0.1, "two periods right after a look that found `safer`"
    assert least <= tight_ns, "of margins longer than a period: a bit more would be wrong"


@pytest.mark.parametrize("levels", [2, 6])
def test_levels_are_counted(tmp_path: Path, levels: int) -> None:
    program = cart(tmp_path, levels=levels, command=LURK)
    for seed in range(4):
        run = program.simulate(seed=seed, sha256=False)
        assert slack(run).min() >= 0
        assert run.topic("told").max() == (levels - 1) * 0.05


def test_engines_agree_and_the_interpreter_keeps_the_margin_too(tmp_path: Path) -> None:
    program = cart(tmp_path, levels=3, command=LURK)
    native, told = (program.simulate(seed=7, until=8, engine=e) for e in ("native", "interp"))
    assert native.trace_sha256 == told.trace_sha256
    assert slack(told).min() >= 0
    assert told.topic("told").max() > 0.05


def test_predicates_by_hand_tell_when_the_next_look_is(tmp_path: Path) -> None:
    program = cart(tmp_path, levels=6, command=RUSH, predicates=BY_HAND)
    run = program.simulate(seed=3)
    in_ac = run.mode("Keep") == 1
    now = np.rint(run.time_s() * 1e9).astype(np.int64)
    left = PERIOD_NS - now % PERIOD_NS
    told = np.rint(run.topic("told") * 1e9).astype(np.int64)
    assert in_ac.any()
    assert (told == np.where(in_ac, left, 0)).all()


def test_a_late_decision_module_is_taken_off(tmp_path: Path) -> None:
    program = cart(tmp_path, levels=3, command=LURK)
    path = tmp_path / "late.soter"
    text = (tmp_path / "cart.soter").read_text(encoding="utf-8")
    path.write_text(text.replace("levels 3;", "levels 3; late dm 2ms;"), encoding="utf-8")
    on_time, late = (p.simulate(seed=1).topic("told").max() for p in (program, soter.load(path)))
    assert (on_time, late) == (0.1, 0.098)


def test_levels_do_not_count_where_the_argument_has_a_gap(tmp_path: Path) -> None:
    """Maps, checks in flight, and a table for several values of a parameter: just the next look."""
    cart(tmp_path, levels=6, command=RUSH)
    flat = system_of(check_file(str(tmp_path / "cart.soter")), "S")
    problem = extract(flat, flat.modules[0])
    assert problem.kind == "flow"
    table: Any = GroupTable((), (), np.zeros(1, dtype=np.uint8))
    check: Any = object.__new__(TubeLevels)
    sides = DiscreteParameter("side", (0, 1))
    assert looks_with_control(problem, [table]) == 5
    assert looks_with_control(problem, [table, check]) == 1
    assert looks_with_control(replace(problem, kind="map"), [table]) == 1
    assert looks_with_control(replace(problem, parameters=(sides,)), [table]) == 1


def test_in_a_proof_a_margin_is_any_value_at_any_read(tmp_path: Path) -> None:
    cart(tmp_path, levels=6, command=RUSH, predicates=f"{BY_HAND[:-1]} && margin(Keep) < 1.0;")
    flat = system_of(check_file(str(tmp_path / "cart.soter")), "S")
    problem = extract(flat, flat.modules[0])
    assert "margin(Keep): 0 to 0.25 s, anew at every read" in assumption_texts(problem.assumptions)
    (bound,) = problem.system.topics[-1].bounds
    assert bound is not None
    assert (bound.low, bound.high) == (0.0, 0.25)


def test_safe_speaks_of_no_margin(tmp_path: Path) -> None:
    cart(tmp_path, levels=3, command=RUSH, predicates=BY_HAND)
    path = tmp_path / "cart.soter"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("safe abs", "safe margin(Keep) < 9.0 && abs"), encoding="utf-8")
    flat = system_of(check_file(str(path)), "S")
    with pytest.raises(soter.SoterError) as refused:
        extract(flat, flat.modules[0])
    assert [d.code for d in refused.value.diagnostics] == ["R007"]
