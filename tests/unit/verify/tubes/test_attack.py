"""A compiled check against an adversary that knows everything: bench/tubes in small."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench.tubes import smaller_constants, wrong_rests
from bench.tubes.small_rests import drawn
from bench.tubes.tube_module import Loop, module_of

from long_tests import examples, seed_of, some
from unit.verify.tubes.test_precision import QUICK

FOLLOW = Path(__file__).parents[4] / "examples" / "evidence" / "follow.soter"
SLIPPING = [
    ("der x = v + wind;", "der x = v * (1.0 + 0.5 * slip) + wind;"),
    ("  disturbance wind", "  disturbance slip: float in [-1.0, 1.0];\n  disturbance wind"),
]
BY_TUBE, BY_POINT, ALWAYS_AC = range(3)


@pytest.fixture(scope="module")
def follow() -> Loop:
    return Loop(module_of(FOLLOW.name, FOLLOW.read_text(encoding="utf-8")), "-O1")


def test_no_flight_is_violated_and_flights_by_points_are(follow: Loop) -> None:
    """The same starts, AC, errors, ages and winds; who decides differs."""
    by_tube, by_point, by_ac = (follow.run("fly", 1, 60, how) for how in range(3))
    assert (by_tube.runs, by_tube.violated) == (60, 0)
    assert 0.5 < by_tube.in_ac / by_tube.in_all < 1.0
    assert by_point.violated >= 6
    assert by_ac.violated >= 6


def test_every_hold_of_a_fall_back_run_is_in_its_tube(follow: Loop) -> None:
    told = follow.run("contain", 1, 10_000, 0)
    assert told.holds >= 10_000
    assert (told.outside, told.violated) == (0, 0)


def test_every_hold_is_in_its_tube_where_a_command_is_followed_in_several_steps() -> None:
    """The slip multiplies a speed, so each step leaves over much that has no other symbol."""
    text = QUICK
    for old, new in SLIPPING:
        assert old in text
        text = text.replace(old, new)
    told = Loop(module_of("quick.soter", text), "-O1").run("contain", 1, 6_000, 0)
    assert told.holds >= 6_000
    assert (told.outside, told.violated) == (0, 0)


def test_ac_is_stopped_before_the_last_moment_and_by_points_after_it(follow: Loop) -> None:
    told = follow.run("late", 1, 5, 0)
    assert (told.dives, told.violated) == (5, 0)
    assert 0 <= told.early < 10 * told.dives
    assert told.late < 0


@pytest.mark.parametrize("number", range(examples(2)))
@pytest.mark.random
def test_small_programs_stay_in_their_tubes(number: int) -> None:
    module = module_of("small.soter", drawn(seed_of(number)), claimed=number % 3 == 0)
    told = Loop(module, "-O1").run("contain", number, 4_000, 0)
    assert told.outside == 0
    assert not (module.kept and told.violated)


@pytest.mark.parametrize("kind", smaller_constants.KINDS)
def test_a_constant_that_is_smaller_than_declared_is_seen(kind: str) -> None:
    """Beside the program's text and the formulas of docs/proof-flight.md."""
    asked = 0
    for number in range(6):
        program = drawn(number)
        if any(smaller_constants.declared(program)[kind]):
            asked += 1
            text = smaller_constants.check_of(program)
            assert smaller_constants.unlike(program, text) == []
            changed = smaller_constants.smaller(kind)(text)
            assert smaller_constants.unlike(program, changed) == [kind]
    assert asked > 1


@pytest.mark.parametrize("kind", some(("E", "D, before SC acts", "H"), quick=1))
def test_runs_leave_the_tube_of_a_check_with_a_smaller_constant(kind: str) -> None:
    found = 0
    for number in range(4):
        changed = smaller_constants.smaller(kind)
        module = module_of("small.soter", drawn(number), changed, claimed=False)
        found += bool(Loop(module, "-O1").run("contain", 1, 5_000, 0).outside)
        if found:
            break
    assert found


@pytest.mark.parametrize("number", range(examples(2)))
@pytest.mark.random
def test_a_wrong_rest_is_not_proved(number: int) -> None:
    why, text = wrong_rests.drawn(seed_of(5 * number))
    assert not wrong_rests.proved(text), why
