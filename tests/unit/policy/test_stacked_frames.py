"""Frames of several axes lie in an observation where `VecFrameStack` puts them, or are refused."""

from __future__ import annotations

import json
import pickle
import re
import shutil
from functools import partial
from itertools import product
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import example, given
from hypothesis import strategies as st
from policy_files import FILES, change_pickle, changed  # type: ignore[import-not-found]

import soter
from soter.cli.main import main
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.named_files import binding_of
from soter.language.model.types import ArrayType, FloatType, IntType
from soter.policy import policy_extern
from soter.policy.c_source import c_source
from soter.policy.network import Network, Policy
from soter.policy.policy_extern import (
    frame_row_count,
    load_policy,
    reads_in_order,
    require_axes,
)
from soter.policy.sb3_file import read_sb3

if TYPE_CHECKING:
    from pathlib import Path

STACKS = json.loads((FILES / "stacks.json").read_text(encoding="utf-8"))
"""What `predict` answered behind the library's own VecFrameStack, world by world."""
NUMBER = FloatType()
PROGRAM = """soter 1;
topic seen: float[3][2];
topic u: float[2];
plant World period 10ms {
  drives seen = [[p, -2.0 * p, p * p], [0.5, q, p - q]];
  state p: float;
  state q: float;
  disturbance draw: float in [-1.0, 1.0];
  next p = draw;
  next q = 0.5 * draw - p;
}
extern node Pilot period 10ms from "sb3:%s" { subscribes seen; publishes u; }
system S { w: World; node Pilot; until 300ms; always u[0] < 9.0; }
"""


def array(*shape: int) -> Any:
    """The type of an array of floats with these axes, the first one first."""
    made: Any = NUMBER
    for n in reversed(shape):
        made = ArrayType(made, n)
    return made


def loaded(file: str, read: Any, write: Any) -> Any:
    binding = binding_of(f"sb3:{file}")
    assert binding is not None
    return load_policy(binding.in_folder(FILES), [("seen", read)], [("u", write)], None)


def refused(file: str, read: Any, write: Any) -> Diagnostic:
    with pytest.raises(SoterError) as caught:
        loaded(file, read, write)
    (problem,) = caught.value.diagnostics
    assert problem.code == "X014"
    return problem


@pytest.mark.parametrize("name", STACKS)
def test_answers_are_those_of_predict(name: str) -> None:
    told = STACKS[name]
    policy = loaded(f"{name}.zip", array(2, 3), array(2))
    asked = zip(told["observations"], told["starts"], strict=True)
    answers = []
    for seen, start in asked:
        if start:
            policy.reset(0)
        answers.append(policy.step(SimpleNamespace(seen=np.array(seen)))[0])
    assert answers == [pytest.approx(a, abs=3e-6) for a in told["actions"]]
    assert len(set(answers)) > 30


@pytest.mark.parametrize("name", STACKS)
def test_the_c_of_a_node_stacks_as_the_file_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    for path in FILES.glob(f"{name}*"):
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.soter").write_text(PROGRAM % f"{name}.zip", encoding="utf-8")
    program = soter.load("p.soter")
    by_file = program.simulate(engine="interp")
    assert main(["policy", f"{name}.zip", "--node", "p.soter:Pilot", "-o", "pilot.c"]) == 0
    by_c = program.bind("Pilot", "c:pilot.c:Pilot_step").simulate(engine="interp")
    assert by_c.array("u") == pytest.approx(by_file.array("u"), abs=1e-6)
    assert np.ptp(by_file.array("u"), axis=0).max() > 0


def test_numbers_that_may_be_frames_along_two_axes_are_refused_and_each_way_out_is_one() -> None:
    problem = refused("rows_by_default.zip", array(6), array(2))
    assert (
        "(2 x 6), the node reads 6 (`seen`): 2 frames, along the first axis or" in problem.message
    )
    ways = re.findall(r"`float\[(\d+)\]\[(\d+)\]`", problem.helps[0])
    told = [
        loaded("rows_by_default.zip", array(int(rows), int(columns)), array(2)).assumed
        for columns, rows in ways
    ]
    assert [sum("along the last axis" in line for line in lines) for lines in told] == [0, 1]


@pytest.mark.parametrize("shape", [(3, 2), (3, 4), (12, 1), (6, 1)], ids=str)
def test_a_topic_in_another_shape_is_no_frame(shape: tuple[int, int]) -> None:
    """Of as many numbers, or of half of them, in whatever order they would be read."""
    assert (
        f"the node reads {np.prod(shape)}"
        in refused("rows_first.zip", array(*shape), array(2)).message
    )


def test_an_observation_by_name_is_read_in_its_own_shape() -> None:
    keys, shapes = [("ahead", 6), ("gear", 3)], {"ahead": (2, 3)}
    gear = ("gear", array(3))
    for read in (array(2, 3), array(6)):
        assert reads_in_order(FILES, keys, shapes, [gear, ("ahead", read)])[0] == (
            "ahead",
            read,
        )
    with pytest.raises(SoterError, match=r"6 numbers \(2 x 3\), the node reads 6"):
        reads_in_order(FILES, keys, shapes, [gear, ("ahead", array(3, 2))])


def with_space(file: str, which: str, space: Any, to: Path) -> str:
    """A copy of a file with another space of as many numbers."""
    change = partial(change_pickle, which=which, change=lambda _: pickle.dumps(space))
    (to / "p.zip").write_bytes(changed(f"{file}.zip", change))
    return str(to / "p.zip")


def test_bits_of_several_axes_are_read_in_their_own_rows(tmp_path: Path) -> None:
    space = spaces.MultiBinary((3, 4))
    file = with_space("rows_first", "observation_space", space, tmp_path)
    for read in (array(3, 4), array(12)):
        assert not any("stacked" in line for line in loaded(file, read, array(2)).assumed)
    assert "12 numbers (3 x 4)" in refused(file, array(4, 3), array(2)).message


TWELVE = [s for k in (1, 2, 3) for s in product(range(1, 13), repeat=k) if np.prod(s) == 12]
"""All axes, up to three, of twelve numbers."""


def test_frames_along_an_axis_of_their_own_may_be_those_of_gymnasium(tmp_path: Path) -> None:
    """Whose wrapper begins otherwise: no file says which one it was."""
    for shape, other in (((3, 4), True), ((12,), False)):
        seen = spaces.Box(-1.0, 1.0, shape, np.float32)
        file = with_space("rows_first", "observation_space", seen, tmp_path)
        (told,) = [line for line in loaded(file, array(4), array(2)).assumed if "stacked" in line]
        assert "zeros before the first" in told
        assert ("FrameStackObservation repeats the first" in told) == other


@given(shape=st.sampled_from(TWELVE), topic=st.sampled_from(TWELVE))
@example(shape=(2, 6), topic=(6, 2))
def test_an_action_has_its_own_rows_in_its_topic_or_is_flat(
    shape: tuple[int, ...], topic: tuple[int, ...]
) -> None:
    """An axis of one number moves none."""
    own, axes = ([n for n in sizes if n > 1] for sizes in (shape, topic))
    writes = [("u", array(*topic))]
    if axes == own or len(axes) < 2 or len(own) < 2:
        require_axes("p", shape, writes)
        return
    with pytest.raises(SoterError) as caught:
        require_axes("p", shape, writes)
    way = re.findall(r"\[(\d+)\]", caught.value.diagnostics[0].helps[0].partition(",")[0])
    require_axes("p", shape, [("u", array(*map(int, way[::-1])))])


def test_the_rows_of_an_action_are_those_of_its_space(tmp_path: Path) -> None:
    push = spaces.Box(-1.0, 1.0, (2, 2), np.float32)
    assert with_space("bits", "action_space", push, tmp_path)
    assert read_sb3(tmp_path / "p.zip").acted == (2, 2)


@pytest.mark.parametrize("way", ["file", "C"])
def test_an_action_in_other_rows_is_refused_by_every_way(
    monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    policy = Policy("p", Network(6, ()), acted=(2, 3))
    monkeypatch.setattr(policy_extern, "read_sb3", lambda *_: policy)

    def answered(write: Any) -> object:
        if way == "file":
            return loaded("p.zip", array(6), write)
        return c_source(policy, "f", "n", "n.h", [("seen", array(6))], [("u", write)])

    assert answered(array(2, 3))
    with pytest.raises(SoterError, match=r"it answers 2 x 3 numbers, `u` has other rows"):
        answered(array(3, 2))


@pytest.mark.parametrize(("file", "writes"), [("maskable", (2,)), ("bits", (4,))])
def test_choices_and_bits_are_not_stacked(file: str, writes: tuple[int]) -> None:
    """`VecFrameStack` takes a Box or a Dict: what reads one of several reads too few."""
    write = ArrayType(IntType(0, 9), *writes)
    assert "the node reads 1 (`seen`)" in refused(f"{file}.zip", IntType(0, 2), write).message


@given(
    shape=st.lists(st.integers(1, 4), min_size=1, max_size=3),
    frames=st.integers(1, 4),
    last=st.booleans(),
)
def test_a_frame_is_found_where_numpy_puts_it(shape: list[int], frames: int, *, last: bool) -> None:
    """Of frames that are stacked along the first or the last axis, by the shape of one alone."""
    axis = len(shape) - 1 if last else 0
    each = np.arange(1.0, np.prod(shape) + 1.0).reshape(shape)
    stacked = np.concatenate([np.zeros_like(each)] * (frames - 1) + [each], axis)
    rows = frame_row_count("p", stacked.shape, stacked.size, [("seen", array(*shape))])
    newest = stacked.reshape(rows, -1)[:, -(each.size // rows) :]
    assert newest.ravel().tolist() == each.ravel().tolist()
