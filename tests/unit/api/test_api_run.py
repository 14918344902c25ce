"""A run as a script sees it: names, arrays, seeds, and what is refused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """
soter 1;
param GAIN: float = 1.0;
type Pose = { p: Vec2, on: bool, legs: float[3] };
topic pose: Pose;
topic few: float[<=3];
topic u: float in [-1.0, 1.0];
plant Boat period 10ms {
  reads u; drives pose = { p: p, on: true, legs: [1.0, 2.0, 3.0] };
  state p: Vec2; state heading: float; der p = { x: GAIN * u, y: 1.0 }; der heading = 0.0;
}
extern node Pilot period 20ms { subscribes pose; publishes u; }
node Stay period 20ms { publishes u; step { publish u = 0.5; } }
rta Guard { ac Pilot; sc Stay; period 100ms; safe true; ttf false; safer true; }
system One default { boat: Boat; module Guard; until 1s; always boat.truth.p.x < 9.0; }
system Two { left: One; right: One; until 1s; }
"""


@pytest.fixture
def program(tmp_path: Path) -> soter.Program:
    path = tmp_path / "boat.soter"
    path.write_text(TEXT)
    return soter.load(path)


@pytest.fixture
def bound(program: soter.Program) -> soter.Program:
    return program.bind("Pilot", lambda _: 0.25)


# ---------------------------------------------------------------- bind


def test_a_name_of_nothing_is_refused_at_once(program: soter.Program) -> None:
    with pytest.raises(soter.SoterError, match="U005") as caught:
        program.bind("Pilto", lambda _: 0.0)
    assert "Pilot" in caught.value.diagnostics[0].helps[0]
    with pytest.raises(soter.SoterError, match="code of its own"):
        program.bind("Stay", lambda _: 0.0)
    assert program.bind("Pilot", lambda _: 0.0).simulate().violations == 0, "not poisoned"


def test_a_name_of_another_system_is_fine(program: soter.Program) -> None:
    program.bind("left.Guard.Pilot", lambda _: 0.0)
    program.bind("right.Guard.Pilot", lambda _: 0.0)
    assert program.simulate("Two").violations == 0


@pytest.mark.parametrize("target", [3, None, object(), [1.0]])
def test_what_cannot_be_called_is_refused_at_once(program: soter.Program, target: object) -> None:
    with pytest.raises(soter.SoterError, match="X002"):
        program.bind("Pilot", target)
    with pytest.raises(soter.SoterError, match="X001"):
        program.simulate()


def test_unbind(bound: soter.Program) -> None:
    assert bound.unbind("Pilot") is bound
    with pytest.raises(soter.SoterError, match="X001"):
        bound.simulate()
    with pytest.raises(soter.SoterError, match="U005"):
        bound.unbind("Pilot")


# ---------------------------------------------------------------- seeds


def test_seeds_are_whole_numbers_of_any_kind(bound: soter.Program) -> None:
    hashes = {bound.simulate(seed=seed).trace_sha256 for seed in (3, np.int64(3), np.uint8(3))}
    assert len(hashes) == 1
    assert type(bound.simulate(seed=np.int64(3)).seed) is int
    assert bound.simulate(seed=2**64 - 1).seed == 2**64 - 1


@pytest.mark.parametrize("seed", [-1, 2**64, 3.0, "3", None, np.float64(3)])
@pytest.mark.parametrize("engine", ["native", "interp"])
def test_seeds_that_cannot_be(bound: soter.Program, seed: Any, engine: str) -> None:
    with pytest.raises(soter.SoterError, match="U001") as caught:
        bound.simulate(seed=seed, engine=engine)
    assert "2^64 - 1" in caught.value.diagnostics[0].helps[0]


# ---------------------------------------------------------------- the trace


def test_a_run_is_shown_in_a_line(bound: soter.Program) -> None:
    assert repr(bound.simulate()) == "<soter.Run One seed 1: 1 s, 0 violations>"
    assert len(repr(bound)) < 200
    assert all(len(repr(p.native)) < 200 for p in bound._prepared._kept.values())


def test_topics_truths_and_modes(bound: soter.Program) -> None:
    run = bound.simulate()
    n = len(run.time_s())
    assert run.topic("u").shape == (n,)
    assert run.truth("boat")["p"]["x"].shape == (n,)
    assert run.topic("boat.truth")["heading"][-1] == 0.0
    assert run.mode("Guard").shape == (n,)
    assert run.mode("Guard").all()


def test_vectors_are_arrays(bound: soter.Program) -> None:
    run = bound.simulate()
    n = len(run.time_s())
    shapes = {
        "boat.truth": (n, 3),
        "boat.truth.p": (n, 2),
        "boat.truth.p.x": (n,),
        "pose": (n, 6),
        "pose.legs": (n, 3),
        "pose.on": (n,),
        "u": (n,),
    }
    assert {name: run.array(name).shape for name in shapes} == shapes
    np.testing.assert_array_equal(run.array("pose.legs")[-1], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(run.array("boat.truth.p")[:, 1], run.truth("boat")["p"]["y"])
    assert run.array("pose").dtype == np.float64


def test_parts_have_their_full_names(program: soter.Program) -> None:
    run = program.bind("Pilot", lambda _: 0.0).simulate("Two")
    assert run.array("left.boat.truth.p").shape == (len(run.time_s()), 2)
    assert run.mode("right.Guard").all()


@pytest.mark.parametrize("name", ["ghost", "boat", "boat.truth.q", "few", "u.x"])
def test_names_that_are_not_there(bound: soter.Program, name: str) -> None:
    with pytest.raises(soter.SoterError, match="U001"):
        bound.simulate().array(name)


def test_a_run_without_a_trace_says_how_to_get_one(bound: soter.Program, tmp_path: Path) -> None:
    run = bound.simulate(trace=False)
    for ask in (
        run.time_s,
        lambda: run.topic("u"),
        lambda: run.truth("boat"),
        lambda: run.mode("Guard"),
        lambda: run.array("u"),
        lambda: bound.write_report(run, tmp_path / "a.html"),
        lambda: bound.write_log(run, tmp_path / "a.mcap"),
    ):
        with pytest.raises(soter.SoterError) as caught:
            ask()
        assert "simulate(trace=True)" in caught.value.diagnostics[0].helps[0]
    assert list(tmp_path.glob("a.*")) == []
