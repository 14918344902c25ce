"""Draws that mean harm: the same on both engines, within their sets, and at their ends."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.codegen.unit import generate
from soter.core.layout import state_layout
from soter.language.front_end import check_file, system_of
from soter.language.model.system import Bound
from soter.language.model.types import BOOL, FLOAT, EnumType, IntType
from soter.native.loaded_program import Library
from soter.native.shared_library import library
from soter.semantics.adverse_draws import (
    CORNER,
    HOLDS,
    MIXED,
    TOGETHER,
    TURN,
    AdverseDraws,
    adverse_float,
)
from soter.semantics.interpreter import Interpreter
from soter.semantics.recorded_draws import ChoiceError, RecordedDraws, Recorder
from soter.simulate.run import state_bytes

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.language.model.types import Type

TEXT = """soter 1;
type Motion = { x: float, v: float };
input topic mood: int in [-3, 4];
input topic light: bool;
topic motion: Motion;
topic force: float in [-2.0, 2.0];
plant Cart period 5ms {
  reads force, mood, light;
  drives motion = { x: x, v: v };
  state x: float in [-1.0, 1.0];
  state v: float = 0.0;
  disturbance wind: float in [-0.3, 0.2];
  disturbance gust: float in [-1.0, 1.0] hold 20ms;
  der x = v;
  der v = force + wind + gust + 0.01 * float(mood) + (light ? 0.1 : 0.0);
  measured motion.x within 0.1, motion.v within 0.05;
}
node Brake period 10ms {
  subscribes motion;
  publishes force;
  step { publish force = clamp(-motion.x - motion.v, -2.0, 2.0); }
}
system S { c: Cart; node Brake; input mood every 30ms; input light every 40ms; until 1s; }
"""


@pytest.fixture(scope="module")
def system() -> System:
    return system_of(check_file("adversary.soter", TEXT), "S")


@pytest.fixture(scope="module")
def compiled(system: System) -> Library:
    unit = generate(system)
    path = library(unit, "-O2", ("-DSOTER_ADVERSARY",))
    return Library(path, unit.prefix, unit.layout.size)


@pytest.mark.parametrize("pattern", range(8))
def test_both_engines_choose_the_same(system: System, compiled: Library, pattern: int) -> None:
    seed = (pattern << 56) | 0x1234567
    trace = np.zeros((300, compiled.state_size), dtype=np.uint8)
    _, written, _ = compiled.run_until(compiled.new_state(seed), 1_000_000_000, trace)
    layout = state_layout(system)
    interpreted: list[bytes] = []
    Interpreter(system, seed, draws=AdverseDraws(seed)).run(
        observe=lambda c, record: interpreted.append(state_bytes(system, layout, c, record, seed))
    )
    assert written == len(interpreted) == 201
    for k, row in enumerate(interpreted):
        assert trace[k].tobytes() == row, f"instant {k}"


def test_a_normal_build_draws_by_chance(system: System, compiled: Library) -> None:
    unit = generate(system)
    normal = Library(library(unit), unit.prefix, unit.layout.size)
    seed = (CORNER << 56) | 1
    states = [x.new_state(seed) for x in (normal, compiled)]
    for x, state in zip((normal, compiled), states, strict=True):
        x.run_until(state, 100_000_000)
    assert bytes(states[0]) != bytes(states[1])


@given(
    st.sampled_from([CORNER, TURN, HOLDS, TOGETHER, MIXED]),
    st.integers(0, 2**56 - 1),
    st.text(max_size=20),
    st.integers(0, 2**40),
    st.floats(-1e6, 1e6),
    st.floats(0.0, 1e6),
)
def test_a_choice_lies_in_its_set(
    pattern: int, key: int, stream: str, index: int, low: float, width: float
) -> None:
    high = low + width
    value = adverse_float((pattern << 56) | key, stream, index, low, high)
    assert low <= value <= high
    if pattern != MIXED:
        assert value in {low, high}


def test_a_corner_is_kept_and_both_are_chosen() -> None:
    seeds = [(CORNER << 56) | k for k in range(20)]
    runs = [{adverse_float(s, "a.b", i, -1.0, 2.0) for i in range(100)} for s in seeds]
    assert all(len(r) == 1 for r in runs)
    assert set.union(*runs) == {-1.0, 2.0}


def test_a_turn_comes_once_and_sometimes() -> None:
    turns = []
    for k in range(60):
        chosen = [adverse_float((TURN << 56) | k, "a", i, 0.0, 1.0) for i in range(3000)]
        turns.append(sum(a != b for a, b in pairwise(chosen)))
    assert set(turns) == {0, 1}


def test_what_was_recorded_is_chosen_again(system: System) -> None:
    recorder = Recorder(AdverseDraws((MIXED << 56) | 7))
    end, _ = Interpreter(system, draws=recorder).run()
    again, _ = Interpreter(system, seed=99, draws=RecordedDraws(recorder.choices)).run()
    assert repr(again) == repr(end)
    assert set(recorder.choices) == {
        "c.x.start", "c.wind", "c.gust", "c.motion.x", "c.motion.v", "input.mood", "input.light",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("t", "bound", "value"),
    [
        (FLOAT, Bound(0.0, 1.0), 1.5),
        (FLOAT, Bound(0.0, 1.0), float("nan")),
        (FLOAT, Bound(0.0, 1.0), True),
        (FLOAT, Bound(0.0, 1.0), "0.5"),
        (IntType(0, 3), None, 4),
        (IntType(0, 9), Bound(2, 3), 4),
        (IntType(0, 3), None, 1.0),
        (EnumType("E", ("A", "B")), None, 2),
        (BOOL, None, 1),
    ],
)
def test_a_written_choice_outside_its_set_is_refused(
    t: Type, bound: Bound | None, value: object
) -> None:
    with pytest.raises(ChoiceError):
        RecordedDraws({"s": [(0, value)]}).leaf_value(t, bound, "s", 3)


def test_a_choice_that_nobody_wrote_is_refused() -> None:
    with pytest.raises(ChoiceError):
        RecordedDraws({"s": [(2, 0.5)]}).uniform("s", 1, 0.0, 1.0)
