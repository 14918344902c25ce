"""A program under /clock, by the C++ of the simulation nodes, without any ROS.

Non-goals: roscpp (`tests/correct/test_ros_nodes.py`), rclcpp (`tests/correct/test_ros2_types.py`).
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

import processes
from soter.api import load

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Told = Callable[..., list[str]]

PROGRAM = """soter 1;
input topic seen: float;
topic out: float = 0.0;
node N period 10ms { subscribes seen; publishes out; step { publish out = seen; } }
system Robot { external topic seen; external topic out; n: N; until 1s; }
"""
MAPPING = {
    "topics": {
        "seen": {
            "channel": "/seen",
            "type": "geometry_msgs/PointStamped",
            "fields": {"value": "point.x"},
        }
    }
}
MAIN = """
#include "soter_simulation_core.hpp"

#include <iostream>

struct Message { double value; int64_t stamp; };
struct Seen {
  typedef ::Message Message;
  typedef double Value;
  static uint32_t index() { return INDEX; }
  static const char* publisher() { return ""; }
  static bool frame(const Message&) { return true; }
  static bool stamped() { return STAMPED; }
  static int64_t stamp_ns(const Message& m) { return m.stamp; }
  static bool convert(const Message& m, Value* to) { *to = m.value; return m.value < 100.0; }
};
struct Only : Seen, soter::OneSource {};
struct Both {
  static soter::Sources* sources() { static soter::Sources made({0, 30000000}); return &made; }
  static bool fits(double value) { return value <= 10.0; }
};
struct First : Seen, Both { static size_t rank() { return 0; } };
struct Second : Seen, Both { static size_t rank() { return 1; } };

template <class T>
struct In : soter::SimulatedInput<T> {
  void hear(const Message& m, const std::string& who) {
    this->take(m, who == "nobody" ? "" : who);
  }
  void refused(const char* why) override { std::printf("refused: %s\\n", why); }
};
struct Shown : soter::Simulated {
  void out(const APP_STATE* state, int64_t) override {
    const int64_t stamp = soter_stamps_of(APP_PROGRAM, const_cast<APP_STATE*>(state))[INDEX];
    if (stamp != told) {
      double value;
      const uint8_t* const bytes = reinterpret_cast<const uint8_t*>(state);
      std::memcpy(&value, bytes + APP_PROGRAM->topic[INDEX].offset, sizeof value);
      const int64_t ct = soter_header_of(const_cast<APP_STATE*>(state))->ct;
      std::printf("%g ms: %g of %g ms\\n", ct / 1e6, value, stamp / 1e6);
      told = stamp;
    }
  }
  void begin() override { told = SOTER_NEVER; }
  int64_t told = SOTER_NEVER;
};
struct Simulation : soter::SimulationCore {
  void began_anew() override { std::printf("anew\\n"); }
  void mode_changed() override {}
};

int main() {
  Simulation simulation;
  In<FIRST>* const in = new In<FIRST>;
  In<Second>* const second = new In<Second>;
  simulation.add(in);
  simulation.add(second);
  simulation.add(new Shown);
  if (simulation.prepare(Simulation::UNTIL_S, 1) != nullptr) return 1;
  std::string word, who;
  double ms, value;
  while (std::cin >> word >> ms) {
    const int64_t at = static_cast<int64_t>(ms * 1e6);
    if (word == "clock") {
      simulation.clock(at);
    } else if (std::cin >> who >> value) {
      SEVERAL && who == "b" ? second->hear(Message{value, at}, who)
                            : in->hear(Message{value, at}, who);
    }
  }
  (void)simulation.result();
  return simulation.exit_code();
}
"""
BUILDS = {
    "one": ("STAMPED=true", "SEVERAL=false", "FIRST=Only"),
    "unstamped": ("STAMPED=false", "SEVERAL=false", "FIRST=Only"),
    "two": ("STAMPED=true", "SEVERAL=true", "FIRST=First"),
}
"""`two`: `a` and `b` are sources of the topic, and b takes over where it is 30 ms younger."""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package of ROS 2: the sources that both have in common, compiled but for the main."""
    if shutil.which("g++") is None or shutil.which("cc") is None:
        pytest.skip("no C++ compiler here")
    folder = tmp_path_factory.mktemp("clock")
    (folder / "robot.soter").write_text(PROGRAM)
    load(folder / "robot.soter").build("ros2", folder / "out", "Robot", mapping=MAPPING)
    simulated = folder / "out" / "simulated"
    mains = ("main.c", "soter_main.c", "soter_virtual.c")
    sources = [p.name for p in simulated.glob("*.c") if p.name not in mains]
    processes.run(["cc", "-std=c99", "-O1", "-c", *sources], cwd=simulated, check=True)
    return folder / "out"


@pytest.fixture(scope="module")
def told(package: Path) -> Told:
    """What a run prints: of times of /clock and messages (name, stamp, value); times in ms."""
    system = load(package.parent / "robot.soter").flat("Robot")
    (index,) = (t.index for t in system.topics if t.name == "seen")
    (package / "main.cpp").write_text(MAIN)
    for build, macros in BUILDS.items():
        words = ["g++", "-std=c++11", "-O1", "-Wall", "-Wextra", "-Werror", "-Isrc", "-Isimulated"]
        words += [f"-D{macro}" for macro in (f"INDEX={index}U", *macros)]
        words += ["-o", f"main_{build}", "main.cpp"]
        objects = [str(p) for p in (package / "simulated").glob("*.o")]
        processes.run([*words, *objects, "-lm"], cwd=package, check=True)

    def run(
        *events: float | tuple[str, float, float], build: str = "one", ends: int = 130
    ) -> list[str]:
        lines = [f"{e[1]} {e[0]} {e[2]}" if isinstance(e, tuple) else f"clock {e}" for e in events]
        text = "\n".join(line if line[0] == "c" else f"message {line}" for line in lines)
        program = package / f"main_{build}"
        (package / "events").write_text(text)
        with (package / "events").open() as events_:
            done = processes.run([program], stdin=events_, capture_output=True, text=True)
        assert done.returncode == ends, done.stderr
        return str(done.stdout).splitlines()

    return run


LATER = "refused: a message was stamped later than now: two clocks, or a wrong one"


def test_a_message_is_as_old_as_its_stamp(told: Told) -> None:
    lines = told(1000, 1020, ("a", 1015, 1.5), 1030, 1040)
    assert lines[0] == "30 ms: 1.5 of 15 ms"


def test_a_stamp_that_is_later_than_the_next_clock_is_refused_and_nothing_is_taken(
    told: Told,
) -> None:
    lines = told(1000, 1020, ("a", 1031, 1.5), 1030, 1040, 1050)
    assert lines[:-2] == [LATER]


def test_who_stamps_may_have_heard_clock_earlier_and_nothing_is_taken_before_its_stamp(
    told: Told,
) -> None:
    lines = told(1000, 1010, ("a", 1040, 1.5), 1050)  # /clock steps over four instants
    assert lines[:-2] == ["40 ms: 1.5 of 40 ms"]


def test_a_later_stamp_that_is_refused_leaves_the_message_before_it(told: Told) -> None:
    lines = told(1000, 1020, ("a", 1019, 1.5), ("a", 9000, 2.5), 1030)
    assert lines[:-2] == [LATER, "30 ms: 1.5 of 19 ms"]


@pytest.mark.parametrize("stamp", [0.0, -5.0])
def test_a_message_that_nobody_stamped_is_refused(told: Told, stamp: float) -> None:
    assert told(1000, ("a", stamp, 1.5), 1030)[:-2] == ["refused: a message has no stamp"]


def test_a_message_without_a_stamp_counts_from_the_next_instant(told: Told) -> None:
    lines = told(1000, 1020, ("a", 0.0, 1.5), 1040, build="unstamped")
    assert lines[:-2] == ["30 ms: 1.5 of 30 ms"]


def test_one_node_speaks_on_a_topic(told: Told) -> None:
    lines = told(1000, ("a", 1000, 1.5), ("b", 1000, 2.5), ("a", 1000, 101.0), 1010)
    assert lines[:2] == [
        "refused: a second node publishes it",
        "refused: a message has no such element, or a number that the topic cannot hold",
    ]
    assert lines[2:-2] == ["10 ms: 1.5 of 0 ms"]


def test_a_message_whose_node_nobody_can_tell_is_refused_and_binds_nobody(told: Told) -> None:
    lines = told(1000, ("nobody", 1000, 1.5), ("a", 1000, 2.5), 1010)
    assert lines[0].startswith("refused: which node publishes it cannot be told")
    assert lines[1:-2] == ["10 ms: 2.5 of 0 ms"]


def test_a_clock_that_goes_back_is_a_beginning_and_forgets_what_was_heard(told: Told) -> None:
    lines = told(1000, 1020, ("a", 1020, 1.5), 500, ("a", 500, 2.5), 520)
    assert lines[:-2] == ["anew", "10 ms: 2.5 of 0 ms"]
    assert told(1000, 1020, ("a", 1020, 1.5), 500, 1100)[:-2] == ["anew"]


def test_a_second_source_is_read_while_the_first_is_silent(told: Told) -> None:
    lines = told(
        1000, ("a", 1000, 1.5), 1010, ("b", 1010, 2.5), 1030, ("b", 1030, 3.5), 1040,
        ("b", 1031, 4.5), 1050, ("a", 1045, 5.5), 1060, ("b", 1060, 6.5), 1070, build="two",
    )  # fmt: skip
    assert lines[:-2] == [
        "10 ms: 1.5 of 0 ms", "50 ms: 4.5 of 31 ms", "60 ms: 5.5 of 45 ms"
    ]  # fmt: skip


@pytest.mark.parametrize("wrong", [("a", 9000, 1.5), ("a", 1010, 50.0), ("a", 0, 1.5)])
def test_what_is_no_sample_of_a_source_keeps_no_other_one_waiting(
    told: Told, wrong: tuple[str, float, float]
) -> None:
    lines = told(1000, 1010, wrong, ("b", 1010, 2.5), 1020, build="two")
    assert [line.partition(":")[0] for line in lines[:-2]].count("refused") == 1
    assert "20 ms: 2.5 of 10 ms" in lines


def test_whether_it_is_the_turn_of_a_stamp_ahead_is_known_at_its_instant(told: Told) -> None:
    begun = (1000, ("a", 1000, 1.5), 1010, ("b", 1040, 2.5))
    assert told(*begun, 1040, build="two")[1:-2] == ["40 ms: 2.5 of 40 ms"]
    lines = told(*begun, ("a", 1010, 3.5), 1040, build="two")
    assert lines[1:-2] == ["20 ms: 3.5 of 10 ms"]


def test_sources_are_forgotten_where_clock_goes_back(told: Told) -> None:
    lines = told(1000, 1020, ("a", 1020, 1.5), 1030, 500, 510, ("b", 505, 2.5), 520, build="two")
    assert lines[1:-2] == ["anew", "20 ms: 2.5 of 5 ms"]


def test_the_trace_does_not_depend_on_who_ticks(told: Told) -> None:
    once = told(1000, 2010, ends=0)
    often = told(*range(1000, 2020, 7), ends=0)
    anew = told(1000, 1500, 700, 1000, 1720, ends=0)
    assert once == often == anew[1:]
    assert once[0] == "safe"
    assert once[1].startswith("trace_sha256 ")
