"""What an environment does, against what the plant of the proof can do."""

from __future__ import annotations

import tempfile
import warnings
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import pytest
from gym_cart import CART, Cart  # type: ignore[import-not-found]
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st

import soter
from soter.gym import Conformance, Protected, SafetyWarning, conformance

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[3]
WIND = 0.2
"""What the program declares, m/s^2."""


class Pushed(Cart):  # type: ignore[misc]
    """The cart in a wind that it is given, and with an engine that may be too strong."""

    def __init__(self, wind: Any, strength: float = 1.0) -> None:
        super().__init__()
        self.wind, self.strength = wind, strength

    def step(self, action: Any) -> Any:
        return super().step(action * self.strength + self.wind(self.done))


@given(st.lists(st.floats(-WIND, WIND), min_size=1, max_size=8), st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_winds_within_the_declared_ones_are_inside_and_found(winds: list[float], seed: int) -> None:
    env = Protected(PROGRAM, Pushed(lambda i: winds[i % len(winds)]))
    report = conformance(env, 2 * len(winds), seed=seed)
    assert report.inside == report.steps >= 2 * len(winds)
    assert max(report.residual.values()) <= 2e-9
    assert report.used["c.wind"] == pytest.approx(max(map(abs, winds)) / WIND, abs=1e-5)


@given(st.floats(1.01 * WIND, 3.0 * WIND), st.sampled_from([-1.0, 1.0]))
@settings(max_examples=20, deadline=None)
def test_stronger_winds_are_outside_and_said_by_how_much(size: float, sign: float) -> None:
    wind = sign * size
    env = Protected(PROGRAM, Pushed(lambda i: wind * (i % 2)))
    report = conformance(env, 100)
    assert report.share == 0.5
    assert report.residual["v"] == pytest.approx(0.005 * (size - WIND), rel=1e-5)
    assert report.undisturbed["v"] == pytest.approx(0.005 * size, rel=1e-5)
    assert report.used["c.wind"] == 1.0
    start, end = (np.array(report.worst[k]) for k in ("from", "to"))
    (accel,) = report.worst["command"]
    assert end[1] - start[1] - 0.005 * accel == pytest.approx(0.005 * wind)


def test_the_alarm_says_which_step_was_outside() -> None:
    env = Protected(PROGRAM, Pushed(lambda i: 1.0 if i == 21 else 0.0))
    _, info = env.reset(seed=1)
    alarms = []
    for i in range(20):
        with pytest.warns(SafetyWarning) if i == 10 else nullcontext():
            *_, info = env.step(np.zeros(1))
        alarms.append(info["off_model"])
    assert [i for i, a in enumerate(alarms) if a] == [10], "plant steps 20 and 21"


def test_only_the_first_step_outside_is_warned_of() -> None:
    env = Protected(PROGRAM, Pushed(lambda _: 1.0))
    with warnings.catch_warnings(record=True) as told_of:
        warnings.simplefilter("always")
        conformance(env, 10)
        assert told_of == [], "who measures is told in numbers"
        for _ in range(2):
            env.reset(seed=1)
            assert all(env.step(np.zeros(1))[4]["off_model"] for _ in range(3))
    (told,) = told_of
    assert told.category is SafetyWarning
    assert "what plant `c` of the program cannot" in str(told.message)
    assert told.filename == __file__


def test_what_is_shown_in_single_precision_is_compared_so() -> None:
    class Single(Cart):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.observation_space = spaces.Box(-1000.0, 1000.0, (2,), np.float32)

        def step(self, action: Any) -> Any:
            state, *rest = super().step(action)
            self.state = state.astype(np.float32).astype(np.float64)
            return state.astype(np.float32), *rest

    assert conformance(Protected(PROGRAM, Single()), 300).share == 1.0
    assert conformance(Protected(PROGRAM, Single(), tolerance=0.0), 300).share < 1.0


def test_gymnasiums_car_is_the_proved_one_without_any_tolerance() -> None:
    program = soter.load(ROOT / "examples" / "mountain_car" / "cliff.soter")
    car = gymnasium.make("MountainCarContinuous-v0")
    report = conformance(Protected(program, car, tolerance=1e-15), 2000, policy=back_and_forth)
    assert report.share > 0.999
    assert 0.01 < report.used["car.rounding_x"] <= 1.0


def back_and_forth(observation: Any) -> Any:
    return np.array([1.0 if observation[1] >= 0.0 else -1.0], dtype=np.float32)


def test_states_that_nobody_observes_are_not_compared() -> None:
    env = Protected(PROGRAM, Cart(), observe=lambda o: {"x": o[0]})
    with pytest.warns(SafetyWarning, match="gives no `v`"):
        report = conformance(env, 50)
    assert report.residual["v"] == 0.0
    assert report.residual["x"] > 0.0, "the plant's own speed stays 0"
    assert report.not_observed == ("v",)
    lines = str(report).splitlines()
    assert "  v: not observed" in lines
    assert not any(line.startswith("  v: residual") for line in lines)
    assert conformance(Protected(PROGRAM, Cart()), 10).not_observed == ()


def test_a_share_of_one_says_who_drove(tmp_path: Path) -> None:
    report = conformance(Protected(PROGRAM, Cart(), info_keys=()), 20)
    assert (report.share, report.ac_share) == (1.0, 1.0)
    assert "  AC had control in 100.0% of its steps" in str(report).splitlines()
    path = tmp_path / "cart.soter"
    path.write_text(CART.read_text(encoding="utf-8").replace("SafeCart ac;", "SafeCart sc;"))
    careful = Protected(path, Cart(), system="Unprotected")
    with pytest.warns(SafetyWarning, match="AC had control in none of its 10 steps") as told_of:
        report = conformance(careful, 20)
    assert told_of[0].filename == __file__
    assert (report.share, report.ac_share) == (1.0, 0.0)
    assert "  AC had control in 0.0% of its steps" in str(report).splitlines()


TWO = """soter 1;
topic at: float in [-100.0, 100.0] max_age 1s;
topic push: float in [-1.0, 1.0];
topic told: float in [-1.0, 1.0];
plant P period 10ms { reads push, told; drives at = a; state a: float; state b: float;
  disturbance d: float[2] in [-0.5, 0.5]; disturbance gust: float in [-1.0, 3.0] hold 1s;
  der a = b + sin(a) * gust; der b = push + told + d[0] * a - d[1]; }
node Teller period 10ms { publishes told; step { publish told = min(time, 1.0); } }
extern node Ac period 10ms { subscribes at; publishes push; }
node Sc period 10ms { publishes push; step { publish push = 0.0; } }
rta M { ac Ac; sc Sc; period 10ms; safe at < 99.0; ttf false; safer true; }
system S default { p: P; module M; node Teller; until 10s; }
"""


class Twin(Cart):  # type: ignore[misc]
    """The plant `P` of `TWO`, flown by the program itself, with a push that is given on top."""

    def __init__(self, run: soter.Run, at: int, off: float = 0.0) -> None:
        super().__init__()
        self.observation_space = spaces.Box(-1e6, 1e6, (2,), np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float64)
        truth = run.truth("p")
        self.rows = np.stack([truth["a"], truth["b"]], axis=1)
        self.rows[at] += off

    def reset(self, **_: Any) -> Any:
        self.done = 0
        return self.rows[0], {}

    def step(self, action: Any) -> Any:
        del action
        self.done += 1
        return self.rows[self.done], 0.0, False, self.done == len(self.rows) - 1, {}


def in_turn(pushes: Iterator[Any], _: Any) -> Any:
    """A policy that goes through given pushes."""
    return np.array([next(pushes)])


OF_A_RECORD = (
    TWO.replace("d: float[2]", "d: { x: float, y: float }")
    .replace("d[0]", "d.x")
    .replace("d[1]", "d.y")
)


@pytest.mark.parametrize("text", [TWO, OF_A_RECORD], ids=["array", "record"])
@pytest.mark.parametrize("seed", range(4))
def test_every_run_of_the_program_conforms_and_a_jump_in_it_does_not(seed: int, text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "two.soter"
        path.write_text(text)
        program = soter.load(path)
    rng = np.random.default_rng(seed)
    pushes = rng.uniform(-1.0, 1.0, 400)
    told = iter(pushes)
    program.bind("Ac", lambda _: {"push": next(told)})
    run = program.simulate(until=2.0, seed=seed)
    for off, outside in ((0.0, 0), (1.0, 2)):
        env = Protected(program, Twin(run, 100, off))
        report = conformance(env, 199, policy=partial(in_turn, iter(pushes)))
        assert report.steps - report.inside == outside
        assert set(report.used) == {"p.d.[0]", "p.d.[1]", "p.gust"} or len(report.used) == 3


TURNING = """soter 1;
topic at: float in [-100.0, 100.0] max_age 1s;
topic push: float in [-1.0, 1.0];
plant P period 10ms { reads push; drives at = angle; state angle: float; state b: float;
  disturbance d: float in [-0.5, 0.5];
  der angle = 3.0 + d; der b = push; }
extern node Ac period 10ms { subscribes at; publishes push; }
node Sc period 10ms { publishes push; step { publish push = 0.0; } }
rta M { ac Ac; sc Sc; period 10ms; safe at < 99.0; ttf false; safer true; }
system S default { p: P; module M; until 10s; }
"""


class Turning(Cart):  # type: ignore[misc]
    """The plant of `TURNING`, whose angle goes back by so much where it comes to pi."""

    def __init__(self, back: float) -> None:
        super().__init__()
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
        self.back = back
        self.state = np.zeros(2)

    def step(self, action: Any) -> Any:
        angle, b = self.state
        angle += 0.01 * 3.2
        self.state = np.array([angle - self.back * (angle > np.pi), b + 0.01 * float(action[0])])
        self.done += 1
        return self.state.copy(), 0.0, False, False, {}


@pytest.mark.parametrize(("back", "hinted"), [(2.0 * np.pi, True), (4.0, False)])
def test_an_angle_that_wraps_around_is_hinted_at(back: float, hinted: bool, tmp_path: Path) -> None:
    path = tmp_path / "turning.soter"
    path.write_text(TURNING)
    env = Protected(path, Turning(back))
    report = conformance(env, 600, policy=lambda _: np.zeros(1))
    assert report.inside < report.steps
    outside = report.steps - report.inside
    assert report.wrapped == ({"angle": outside} if hinted else {})
    told = "angle is about a multiple of 2 pi off in" in str(report)
    assert told is hinted
    unwrapped = [0.0]

    def observe(o: Any) -> Any:
        unwrapped[0] += np.mod(o[0] - unwrapped[0] + np.pi, 2.0 * np.pi) - np.pi
        return {"angle": unwrapped[0], "b": o[1]}

    if hinted:  # what the help says helps
        assert conformance(Protected(path, Turning(back), observe=observe), 600).share == 1.0


def test_the_plant_of_the_proof_has_no_faults(tmp_path: Path) -> None:
    path = tmp_path / "cart.soter"
    faults = "faults { scale c.wind by 9.0 at 3600 per 1h for 1s; }\n  until 30s;"
    path.write_text(CART.read_text().replace("until 30s;", faults, 1))
    program = soter.load(path)
    assert conformance(Protected(program, Cart()), 100).share == 1.0
    windy = Pushed(lambda i: 2.0 * WIND * (i % 2))
    assert conformance(Protected(program, windy), 100).share == 0.5


# ---------------------------------------------------------------- where it cannot be


def test_without_a_plant_of_its_own_there_is_nothing_to_compare_with() -> None:
    program = soter.load(ROOT / "examples" / "mountain_car" / "gymnasium.soter")
    car = gymnasium.make("MountainCarContinuous-v0")
    env = Protected(program, car)
    assert env.reset(seed=1)[1]["off_model"] is None
    with pytest.raises(soter.SoterError, match="no model"):
        conformance(env)
    with pytest.raises(soter.SoterError, match="is extern in the program"):
        Protected(program, car, alarm=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"tolerance": {"z": 1.0}}, "no state `z`"), ({"tolerance": -1.0}, "cannot be -1.0")],
)
def test_wrong_tolerances_are_said(options: Any, words: str) -> None:
    with pytest.raises(soter.SoterError, match=words):
        Protected(PROGRAM, Cart(), **options)


def test_no_steps_are_no_measurement() -> None:
    with pytest.raises(soter.SoterError, match="0 steps"):
        conformance(Protected(PROGRAM, Cart()), 0)


def test_it_reads_as_text() -> None:
    report = Conformance(4, 3, {"x": 0.5}, {"x": 1.0}, {"c.wind": 1.0})
    assert str(report).splitlines() == [
        "3 of 4 steps (75.0000%) are explained",
        "  x: residual 0.5, undisturbed 1",
        "  c.wind: 100.0% of its bounds",
    ]


PROGRAM = soter.load(CART)
