"""What a policy calls: read, every, publish, publish_chunk, and what is told where it cannot be."""

from __future__ import annotations

import json
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import processes
import soter
import soter.remote
from generators.channel_programs import soon
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.remote import Robot

LIGHT = """
import sys
import soter.remote
heavy = {"numpy", "cffi", "torch", "soter.language.front_end", "soter.targets.package"}
print(sorted(heavy & set(sys.modules)))
"""


def told(call: Callable[[], object]) -> tuple[str, str]:
    with pytest.raises(SoterError) as caught:
        call()
    (problem,) = caught.value.diagnostics
    return problem.code, problem.message


def test_importing_it_loads_nothing_heavy() -> None:
    done = processes.run([sys.executable, "-c", LIGHT], stdout=processes.PIPE, text=True)
    assert done.stdout == "[]\n"


# ---------------------------------------------------------------- connecting


def test_a_folder_that_is_not_there_is_told(program: Path, tmp_path: Path) -> None:
    def connect() -> Robot:
        return soter.remote.connect(program, system="Robot", channels=tmp_path / "gone")

    code, message = told(connect)
    assert code == "X013"
    assert "there is no folder" in message
    assert "--channels" in message


def test_program_loaded_program_and_package_know_the_same(
    program: Path, folder: Path, document: dict[str, Any]
) -> None:
    (folder / "channels.json").write_text(json.dumps(document))
    known = []
    for source in (program, str(program), soter.load(program), folder, folder / "channels.json"):
        with soter.remote.connect(source, system="Robot", channels=folder) as robot:
            known.append(robot.topics)
    assert all(topics == known[0] for topics in known)
    assert list(known[0]) == ["position", "goal", "wish", "arm", "wide", "few", "speed"]


def test_a_program_with_a_mistake_is_told_as_everywhere(tmp_path: Path, folder: Path) -> None:
    (tmp_path / "wrong.soter").write_text("soter 1;\ntopic x: flaot;\n")
    with pytest.raises(SoterError):
        soter.remote.connect(tmp_path / "wrong.soter", channels=folder)


# ---------------------------------------------------------------- reading and publishing


def test_a_reading_has_value_stamp_and_age(robot: Robot) -> None:
    assert robot.read("position") is None
    before = time.monotonic_ns()
    robot.publish("position", 1.5)
    reading = robot.read("position")
    assert reading is not None
    assert reading.value == 1.5
    assert before <= reading.stamp <= time.monotonic_ns()
    again = robot.read("position")
    assert again is not None, "the newest value, whether or not it was read before"
    assert (again.stamp, again.value) == (reading.stamp, 1.5)
    assert again.age >= reading.age >= 0.0


def test_an_action_says_when_its_observation_was_measured(robot: Robot) -> None:
    measured = time.monotonic_ns() - 7_000_000
    robot.publish("wish", 0.5, measured=measured)
    reading = robot.read("wish")
    assert reading is not None
    assert reading.stamp == measured
    assert reading.age >= 0.007


@pytest.mark.parametrize(
    ("measured", "code"), [(2**62, "U012"), (-1, "U012"), (1.5, "U001"), (True, "U001")]
)
def test_nothing_is_measured_in_the_future(robot: Robot, measured: Any, code: str) -> None:
    assert told(lambda: robot.publish("wish", 0.5, measured=measured))[0] == code
    assert robot.read("wish") is None


def test_what_is_refused_is_not_written(robot: Robot) -> None:
    robot.publish("wish", 0.5)
    for wrong in (2.0, float("nan"), "fast", [0.1, 0.2]):
        assert told(lambda w=wrong: robot.publish("wish", w))[0] == "U012"  # type: ignore[misc]
    reading = robot.read("wish")
    assert reading is not None
    assert reading.value == 0.5
    robot.publish("wish", 2.0, clip=True)
    reading = robot.read("wish")
    assert reading is not None
    assert reading.value == 1.0


def test_what_the_robot_publishes_is_read_and_not_written(robot: Robot) -> None:
    assert robot.read("speed") is None
    assert told(lambda: robot.publish("speed", 0.5))[0] == "U001"
    assert told(lambda: robot.publish_chunk("speed", [0.5], every="20ms"))[0] == "U001"


# ---------------------------------------------------------------- every


def test_every_gives_an_observation_a_value_of_the_first_topic(robot: Robot) -> None:
    robot.publish("position", 0.0)  # before anybody asked: no news
    robot.publish("goal", {"x": 1.0, "y": 2.0})
    observations = robot.every("position", "goal")
    seen = []
    for x in (1.0, 2.0, 3.0):
        robot.publish("position", x)
        seen.append(next(observations))
    assert [o["position"] for o in seen] == [1.0, 2.0, 3.0]
    assert all(o["goal"] == {"x": 1.0, "y": 2.0} for o in seen)
    first = seen[0]
    assert first.measured == first.readings["goal"].stamp < first.readings["position"].stamp
    assert first.age == first.readings["goal"].age


def test_who_is_slow_misses_values_and_sees_the_newest(robot: Robot) -> None:
    observations = robot.every("position")
    for x in range(10):
        robot.publish("position", float(x))
    assert next(observations)["position"] == 9.0
    robot.publish("position", 11.0)
    assert next(observations)["position"] == 11.0


def test_reading_beside_takes_nothing_away(robot: Robot) -> None:
    observations = robot.every("position")
    robot.publish("position", 1.0)
    reading = robot.read("position")
    assert reading is not None
    assert next(observations).readings["position"].stamp == reading.stamp


def test_a_topic_that_nobody_writes_ends_the_loop_with_its_name(robot: Robot) -> None:
    with pytest.raises(TimeoutError, match="nobody wrote `position`"):
        next(robot.every("position", timeout="1ms"))
    observations = robot.every("position", "goal", timeout="1ms")
    robot.publish("position", 1.0)
    with pytest.raises(TimeoutError, match="nobody wrote `goal`"):
        next(observations)


def test_what_was_written_before_anybody_asked_is_no_news(robot: Robot) -> None:
    robot.publish("position", 1.0)
    with pytest.raises(TimeoutError, match="nobody wrote `position`"):
        next(robot.every("position", timeout="1ms"))


def test_news_of_another_topic_than_the_first_is_no_observation(robot: Robot) -> None:
    observations = robot.every("position", "goal", timeout="1ms")
    robot.publish("position", 1.0)
    robot.publish("goal", {"x": 1.0, "y": 2.0})
    next(observations)
    robot.publish("goal", {"x": 3.0, "y": 4.0})
    with pytest.raises(TimeoutError, match="nobody wrote `position`"):
        next(observations)


def test_a_closed_connection_ends_the_loop(program: Path, folder: Path) -> None:
    robot = soter.remote.connect(program, system="Robot", channels=folder)
    observations = robot.every("position")
    robot.publish("position", 1.0)
    next(observations)
    robot.close()
    assert list(observations) == []
    with pytest.raises(ValueError, match="closed"):
        robot.read("goal")


@pytest.mark.parametrize(
    ("topics", "timeout"), [((), None), (("positoin",), None), (("position",), "soon")]
)
def test_every_is_asked_rightly(robot: Robot, topics: tuple[str, ...], timeout: Any) -> None:
    assert told(lambda: robot.every(*topics, timeout=timeout))[0] == "U001"


# ---------------------------------------------------------------- chunks


def test_a_chunk_of_rows_begins_at_once(robot: Robot) -> None:
    robot.publish_chunk("arm", np.array([[0.5, 0.0, -0.5], [1.0, 1.0, 1.0]]), every="1h")
    reading = robot.read("arm")
    assert reading is not None
    assert reading.value.tolist() == [0.5, 0.0, -0.5]


def test_a_chunk_says_of_a_stamp_which_action_it_was(robot: Robot) -> None:
    start = time.monotonic_ns() - 9_900_000_000
    chunk = robot.publish_chunk("wish", [0.1, 0.3, 0.5], every="10s", start=start)
    reading = robot.read("wish")
    assert reading is not None
    assert chunk.slot(reading.stamp) == 0
    assert [chunk.slot(start + s * 10**9) for s in (-1, 10, 29)] == [-1, 1, 2]


def test_actions_of_one_number_are_rows_or_numbers(robot: Robot) -> None:
    for actions in (np.array([[0.5], [1.0]], dtype=np.float32), [0.5, 1.0], ([0.5], [1.0])):
        robot.publish("wish", 0.0)
        robot.publish_chunk("wish", actions, every="1h")
        reading = robot.read("wish")
        assert reading is not None
        assert reading.value == 0.5


def test_a_wrong_action_leaves_the_chunk_before(robot: Robot) -> None:
    begun = time.monotonic_ns()
    robot.publish_chunk("wish", [0.5, 0.6], every="1h")
    for wrong, words in (([0.1, 2.0], "wish 1: 2.0 is not in"), ("ab", "sequence"), (0.1, "seq")):
        code, message = told(
            lambda w=wrong: robot.publish_chunk("wish", w, every="1h")  # type: ignore[misc]
        )
        assert code == "U012"
        assert words in message
    (playing,) = robot._player._playing.values()
    assert playing.chunk.start_ns >= begun
    assert len(playing.chunk.images) == 2


def test_a_value_ends_the_chunk(robot: Robot) -> None:
    robot.publish_chunk("wish", [0.5, 0.6], every="1h")
    robot.publish("wish", 0.1)
    assert robot._player._playing == {}


@pytest.mark.parametrize("every", [0, -1, "20", "soon", None])
def test_the_time_between_actions_is_a_time(robot: Robot, every: Any) -> None:
    assert told(lambda: robot.publish_chunk("wish", [0.5], every=every))[0] == "U001"


def test_a_chunk_is_played_by_a_thread_to_its_end(robot: Robot) -> None:
    start = time.monotonic_ns() - 9_900_000_000
    robot.publish_chunk("wish", [0.1, 0.3], every="10s", start=start)
    reading = robot.read("wish")
    assert reading is not None
    assert reading.value == 0.1

    def over() -> bool:
        with robot._player._changed:
            return not robot._player._playing

    soon(over)
    reading = robot.read("wish")
    assert reading is not None
    assert (reading.value, reading.stamp) == (0.3, start + 10_000_000_000)
