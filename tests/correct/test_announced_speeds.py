"""Others that announce their speed, and several at once: what is told is no more than what is.

Purpose: in `examples/exploration/announced.soter` what `Clearance` tells is no more than is left,
and what is left changes as the plant of its proof may; each is seen to fail where the file is
wrong; the least of several distances changes as one of them may.
Non-goals: the proof, and that nobody is hit (`test_vehicles_among_people.py`); wrong modules
(`unit/verify/claims/test_passive_vehicles.py`).
"""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

import soter

FILE = Path(__file__).resolve().parents[2] / "examples" / "exploration" / "announced.soter"


@cache
def source() -> str:
    """The text of the file."""
    return FILE.read_text("utf-8")


def edited(folder: Path, *edits: tuple[str, str]) -> soter.Program:
    """The program with each of these replaced once."""
    text = source()
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    tree = Path(shutil.copytree(FILE.parents[1], folder / "examples"))
    path = tree / "exploration" / FILE.name
    path.write_text(text, "utf-8")
    return soter.load(path)


# ---------------------------------------------------------------- what is told, as they drive
SCENES = {
    "as they like": {},
    "suddenly": {"SUDDEN": True},
    "without a word": {"HEARD": False},
}


def told_too_much(program: soter.Program, scene: str, kind: str, seeds: range) -> int:
    """In how many runs `Clearance` tells more than is left at that instant."""
    params = {"walkers.KIND": kind, **SCENES[scene]}
    runs = [program.simulate(system="Hunted", seed=s, params=params) for s in seeds]
    return sum(any("clearance.gap" in v.what for v in run.violation_list) for run in runs)


@pytest.mark.whole
@pytest.mark.parametrize("kind", ["Hunting", "Luring", "Strolling"])
@pytest.mark.parametrize("scene", SCENES)
def test_no_more_is_told_than_is_left(scene: str, kind: str) -> None:
    assert told_too_much(soter.load(FILE), scene, kind, range(1, 4)) == 0


LIMIT = "bound(said.limit, said.old + age(said) + LATE)"
WRONG_NODES = {
    "an announcement is taken for ever": ((LIMIT, "bound(said.limit, 0.0)"), "suddenly"),
    "who says nothing is taken to be slow": ((f"{LIMIT} : W", f"{LIMIT} : 0.3"), "without a word"),
    "they speed up faster than is reckoned with": (
        ("min(limit + RISE * old, W)", "min(limit + 0.2 * RISE * old, W)"),
        "suddenly",
    ),
    "the error of the distance is not taken off": (
        ("const ERROR_GAP: float = 0.05", "const ERROR_GAP: float = 0.0"),
        "as they like",
    ),
    "the gap itself is told": (
        (" * late - reach(stands(fast), limit);", " * late;"),
        "as they like",
    ),
}


@pytest.mark.whole
@pytest.mark.parametrize("name", WRONG_NODES)
def test_a_node_that_tells_too_much_is_seen(name: str, tmp_path: Path) -> None:
    edit, scene = WRONG_NODES[name]
    assert told_too_much(edited(tmp_path, edit), scene, "Hunting", range(1, 7)) > 0


# ---------------------------------------------------------------- how what is left changes
W, RISE, A, GAIN, SLOPE, FASTEST = 1.0, 0.5, 2.0, 6.0, 0.1, 1.2
STEP = 1e-5
"""s: so much later the rates are taken."""


@dataclass(frozen=True)
class Instant:
    """Speeds in m/s: of this robot and what it is told, and the others' limit; rates of change.

    gain, most: of the base, in shares of what is nominal; slope, rises (of the limit): m/s^2.
    """

    v: float
    told: float
    limit: float
    gain: float
    most: float
    slope: float
    rises: float

    def pull(self) -> float:
        """v' of the base, m/s^2."""
        most = self.most * A
        return min(max(self.gain * GAIN * (self.told - self.v), -most), most) + self.slope


def instant(draw: Random) -> Instant:
    """Anything that is declared, its ends among it."""

    def within(low: float, high: float) -> float:
        return draw.choice([low, high, draw.uniform(low, high)])

    return Instant(
        v=draw.choice([within(-FASTEST, FASTEST), draw.uniform(-0.4, 0.4)]),
        told=draw.choice([0.0, within(-FASTEST, FASTEST)]),
        limit=within(0.0, W),
        gain=within(0.8, 1.2),
        most=within(0.8, 1.2),
        slope=within(-SLOPE, SLOPE),
        rises=draw.choice([RISE, draw.uniform(-2.0, RISE)]),
    )


def excess(program: soter.Program, at: Instant) -> float:
    """By how much what is left falls faster than in the proof: m/s.

    They come straight at this robot, and it drives at them. Rates are those over STEP, so that the
    speed and the limit are a little off: 1e-3 covers that.
    """
    reach, stands = program.function("reach"), program.function("stands")
    later_by = program.function("put_off")(at.v, at.told)
    after = at.v + STEP * at.pull()
    limit = min(max(at.limit + STEP * at.rises, 0.0), W)
    before_t, after_t = stands(at.v), stands(after)
    nearer = STEP * max(at.limit, limit) + STEP * max(abs(at.v), abs(after))
    falls = (nearer + reach(after_t, limit) - reach(before_t, at.limit)) / STEP
    return float(falls - abs(at.v) - W * later_by) - 1e-3


@given(st.integers(0, 2**32))
def test_what_is_left_falls_as_it_may_in_the_proof(seed: int) -> None:
    draw = Random(seed)  # noqa: S311 - draws, not secrets
    for _ in range(10):
        at = instant(draw)
        assert excess(soter_file(), at) <= 0.0, at


@cache
def soter_file() -> soter.Program:
    """The file as it is."""
    return soter.load(FILE)


WRONG_RATES = {
    "they speed up and are not reckoned with": (
        "RISE * rising * (t - 0.5 * rising)",
        "0.5 * RISE * rising * (t - 0.5 * rising)",
    ),
    "this robot is taken to brake better": (
        "return abs(v) / wheels.BRAKE",
        "return abs(v) / (1.5 * wheels.BRAKE)",
    ),
    "AC does not put off when it stands": (
        "? less / wheels.BRAKE : MOST",
        "? less / wheels.BRAKE : 1.0",
    ),
    "it brakes as well when it is slow": (
        "? less / wheels.BRAKE : MOST",
        "? 0.0 : MOST",
    ),
    "a slope does not put off when it stands": (
        "wheels.A - wheels.GAIN * abs(v), 0.0)",
        "wheels.A - 1.2 * wheels.GAIN * abs(v), 0.0)",
    ),
}


@pytest.mark.parametrize("name", WRONG_RATES)
def test_a_rate_that_the_proof_does_not_have_is_seen(name: str, tmp_path: Path) -> None:
    program = edited(tmp_path, WRONG_RATES[name])
    draw = Random(1)  # noqa: S311 - draws, not secrets
    assert max(excess(program, instant(draw)) for _ in range(2000)) > 0.05


@given(st.floats(0.0, 1.5), st.floats(0.0, W))
def test_reach_is_how_far_somebody_gets_who_speeds_up(t: float, limit: float) -> None:
    count = 500
    h = t / count
    by_steps = sum(h * min(limit + RISE * h * (k + 0.5), W) for k in range(count))
    assert abs(soter_file().function("reach")(t, limit) - by_steps) < 1e-4


@given(st.integers(0, 2**32))
def test_no_more_is_told_with_every_error_at_its_bound(seed: int) -> None:
    """What `surely` says holds `late` after it was measured, however both moved meanwhile."""
    program = soter_file()
    draw = Random(seed)  # noqa: S311 - draws, not secrets
    gap, v, late = draw.uniform(-0.2, 8.0), draw.uniform(-1.2, 1.2), draw.uniform(0.0, 0.01)
    limit = draw.uniform(0.0, W)
    after = v + draw.choice([-1.0, 1.0]) * 2.5 * late
    nearer = gap - late * (W + 0.5 * abs(v + after))
    for error_gap in (-0.05, 0.05):
        for error_v in (-0.02, 0.02):
            told = program.function("surely")(gap + error_gap, v + error_v, late, limit)
            t = program.function("stands")(after)
            assert told <= nearer - program.function("reach")(t, limit) + 1e-9


# ---------------------------------------------------------------- any speed told, several at once
@given(st.floats(-1.25, 1.25), st.floats(-1.2, 1.2), st.floats(0.8, 1.2))
def test_a_base_that_is_told_any_speed_is_one_of_the_proof(
    v: float, told: float, gain: float
) -> None:
    """`push` of the plant: some push in [-A, A] gives what the base does."""
    does = min(max(gain * GAIN * (told - v), -gain * A), gain * A)
    push = min(max(does / gain, -A), A)
    assert gain * min(max(push, -GAIN * (FASTEST + v)), GAIN * (FASTEST - v)) == pytest.approx(does)


WALKERS = soter.load(FILE.with_name("walkers.soter"))
PLACE = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
WALK = st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 2.0 * math.pi))


@given(st.lists(st.tuples(PLACE, WALK), min_size=3, max_size=3), st.floats(-1.2, 1.2))
def test_the_least_of_several_distances_changes_as_one_of_them_may(
    people: list[tuple[tuple[float, float], tuple[float, float]]], v: float
) -> None:
    nearest = WALKERS.function("nearest")

    def least(s: float) -> float:
        """`nearest` of `walkers.soter` after s seconds."""
        everybody = [
            {
                "p": {"x": x + s * w * math.cos(a), "y": y + s * w * math.sin(a)},
                "v": {"x": 0.0, "y": 0.0},
                "leaving": False,
                "near": False,
            }
            for (x, y), (w, a) in people
        ]
        disc = {"p": {"x": s * v, "y": 0.0}, "v": {"x": v, "y": 0.0}, "radius": 0.3, "fast": 1.2}
        return float(nearest(everybody, disc))

    assert abs(least(0.5) - least(0.0)) <= 0.5 * (1.0 + abs(v)) + 1e-9
