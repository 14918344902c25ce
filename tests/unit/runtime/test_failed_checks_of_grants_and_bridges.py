"""Checks of who gives leases, and of bridges in C++: each fails where it is called as nobody may.

Non-goals: what actuators do (`tests/unit/targets/test_leases.py`), the driver and its checks
(`tests/correct/test_failed_checks.py`).
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

import processes
from soter.api import load
from soter.native.compiler import STRICT, WARNINGS, find_compiler
from soter.native.shared_library import CHECK_FAILED, RUNTIME

if TYPE_CHECKING:
    from pathlib import Path

DEFECT = 70
POSIX, BRIDGE = RUNTIME / "posix", RUNTIME / "bridge"

# ---------------------------------------------------------------- who gives leases

GRANT = """\
#include "soter_grant.h"
#include <stddef.h>
#include <stdlib.h>

int main(int count, char** words) {
  static const soter_budget node[] = {{50, 0, 0, 40}, {10, 0, 0, 1}};
  static const soter_budget still[] = {{50, 0, 0, 40}, {0, 0, 0, 1}};
  const soter_grant_info info = {node, 2}, alone = {node, 1}, stands = {still, 2};
  const soter_grant_info* const infos[] = {&info, NULL, &alone, &stands};
  const int wrong = count > 1 ? atoi(words[1]) : 0;
  int64_t done[2], stamp = 0, expiry = 0;
  soter_grant grant;
  soter_grant_begin(&grant, infos[wrong < 4 ? wrong : 0], wrong == 4 ? NULL : done, 0);
  done[0] = wrong == 5 ? -1 : 0;
  (void)soter_grant_done(&grant, wrong == 6 ? 2U : 0U, 0, 1);
  (void)soter_grant_due(&grant, wrong == 7 ? 2U : 1U);
  (void)soter_grant_lease(&grant, 1, wrong == 8 ? NULL : &stamp, wrong == 9 ? NULL : &expiry);
  return 0;
}
"""
BEGUN = "info != NULL && done != NULL && info->nodes > SC"
KNOWN = "node < grant->info->nodes && grant->done[node] >= 0"
ANSWERED = "stamp != NULL && expiry != NULL"
OF_GRANTS = {
    "no tables": (1, BEGUN),
    "a DM without an SC": (2, BEGUN),
    "a period of 0": (3, "info->node[k].period > 0"),
    "no room": (4, BEGUN),
    "a count below 0": (5, KNOWN),
    "a node that is none, done": (6, KNOWN),
    "a node that is none, due": (7, "node < grant->info->nodes"),
    "no room for a stamp": (8, ANSWERED),
    "no room for an expiry": (9, ANSWERED),
}


@pytest.fixture(scope="module")
def grant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("grant")
    (folder / "main.c").write_text(GRANT)
    words = [*find_compiler().command, *STRICT, *WARNINGS, "-O1", f"-I{RUNTIME}", "main.c"]
    sources = [RUNTIME / "soter_grant.c", CHECK_FAILED]
    processes.run([*words, *sources, "-o", "grant"], cwd=folder, check=True)
    return folder / "grant"


@pytest.mark.parametrize(("wrong", "said"), OF_GRANTS.values(), ids=OF_GRANTS)
def test_a_grant_that_is_called_as_nobody_may_ends_who_gives_leases(
    grant: Path, wrong: int, said: str
) -> None:
    done = processes.run([grant, str(wrong)], capture_output=True, text=True)
    assert done.returncode == DEFECT
    assert done.stderr.endswith(f": not {said}\n")


def test_a_grant_that_is_called_as_it_is_meant_goes_on(grant: Path) -> None:
    assert processes.run([grant]).returncode == 0


# ---------------------------------------------------------------- bridges

BRIDGED = """\
#include "soter_bridge_core.hpp"
#include <string>
struct Message {};
template <class T>
struct Topic {
  typedef ::Message Message;
  typedef T Value;
  struct Shared {};
  static soter::Sources* sources() { static soter::Sources made({0, 5}); return &made; }
  static size_t rank() { return 0; }
  static bool fits(const T&) { return true; }
  static const char* channel() { return "x"; }
  static uint64_t hash() { return 7; }
  static const char* topic() { return "/x"; }
  static const char* publisher() { return ""; }
  static bool frame(const Message&) { return true; }
  static bool stamped() { return true; }
  static int64_t delay_ns() { return 0; }
  static int64_t stamp_ns(const Message&) { return 1; }
  static bool convert(const Message&, T* to) { *to = T(); return true; }
};
struct Two { double x, y; };
struct Narrow : Topic<double> { typedef Topic<double>::Shared Shared; };
struct Wide : Topic<Two> { typedef Topic<double>::Shared Shared; };
int main(int, char** words) {
  const std::string wrong = words[1];
  soter::Sources sources({0, 5});
  (void)sources.take(wrong == "rank" ? 2U : 1U, wrong == "stamp" ? 0 : 1, [] {});
  (void)sources.counts(wrong == "counts" ? 2U : 1U);
  soter::Inward<Narrow> narrow(wrong == "error" ? -1 : 0);
  soter::Inward<Wide> wide(0);
  if (narrow.open(words[2]) != nullptr || wide.open(words[2]) != nullptr) return 1;
  narrow.take(Message(), "node", 1, 1);
  if (wrong == "value") wide.take(Message(), "node", 1, 1);
  return 0;
}
"""
OF_BRIDGES = {
    "rank": "rank < of_.size() && stamp_ns > 0",
    "stamp": "rank < of_.size() && stamp_ns > 0",
    "counts": "rank < of_.size()",
    "error": "clock_error_ns >= 0",
    "value": "channel()->size == sizeof value",
}


@pytest.fixture(scope="module")
def bridge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler here")
    folder = tmp_path_factory.mktemp("bridge")
    (folder / "main.cpp").write_text(BRIDGED)
    include = [f"-I{x}" for x in (RUNTIME, POSIX, BRIDGE)]
    names = ("soter_outside", "soter_channel", "soter_posix_check", "soter_status_text")
    own = [POSIX / f"{x}.c" for x in names]
    processes.run(["cc", "-c", *include, *own], cwd=folder, check=True)
    words = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", *include, "-pthread", "main.cpp"]
    objects = [f"{x}.o" for x in names]
    processes.run([*words, *objects, "-o", "bridge"], cwd=folder, check=True)
    return folder / "bridge"


@pytest.mark.parametrize(("wrong", "said"), OF_BRIDGES.items(), ids=OF_BRIDGES)
def test_a_bridge_that_is_called_as_nobody_may_ends(
    bridge: Path, tmp_path: Path, wrong: str, said: str
) -> None:
    done = processes.run([bridge, wrong, tmp_path], capture_output=True, text=True)
    assert done.returncode == DEFECT
    assert done.stderr.endswith(f": not {said}\n")


def test_a_bridge_that_is_called_as_it_is_meant_goes_on(bridge: Path, tmp_path: Path) -> None:
    assert processes.run([bridge, "nothing", tmp_path]).returncode == 0


# ---------------------------------------------------------------- simulated time

SIMULATED = """\
#include "soter_simulation_core.hpp"
static uint32_t number = 0;
template <class T>
struct Topic : soter::OneSource {
  struct Message {};
  typedef T Value;
  static uint32_t index() { return number; }
  static const char* publisher() { return ""; }
  static bool frame(const Message&) { return true; }
  static bool stamped() { return true; }
  static int64_t stamp_ns(const Message&) { return 1; }
  static bool convert(const Message&, T*) { return true; }
  static void convert(const T&, int64_t, Message*) {}
};
template <class T>
struct In : soter::SimulatedInput<T> { void refused(const char*) override {} };
template <class T>
struct Out : soter::SimulatedOutput<T> { void publish(const typename T::Message&) override {} };
struct Simulation : soter::SimulationCore {
  void began_anew() override {}
  void mode_changed() override {}
};
int main(int, char** words) {
  const std::string wrong = words[1];
  Simulation simulation;
  number = wrong == "topic in" || wrong == "topic out" ? APP_PROGRAM->topics : 0U;
  if (wrong == "topic in" || wrong == "fine") simulation.add(new In<Topic<double>>);
  if (wrong == "topic out" || wrong == "fine") simulation.add(new Out<Topic<double>>);
  if (wrong == "value in") simulation.add(new In<Topic<float>>);
  if (wrong == "value out") simulation.add(new Out<Topic<float>>);
  if (simulation.prepare(0.0, 1) != nullptr) return 1;
  (void)simulation.clock(1000000);
  return 0;
}
"""
TOPIC = "T::index() < APP_PROGRAM->topics"
VALUE = "APP_PROGRAM->topic[T::index()].size == sizeof(typename T::Value)"
OF_SIMULATIONS = {"topic in": TOPIC, "topic out": TOPIC, "value in": VALUE, "value out": VALUE}
PROGRAM = """soter 1;
input topic seen: float;
topic out: float = 0.0;
node N period 10ms { subscribes seen; publishes out; step { publish out = seen; } }
system Robot { external topic seen; external topic out; n: N; until 1s; }
"""
MAPPED = {"channel": "/seen", "type": "std_msgs/Float64", "fields": {"value": "data"}}


@pytest.fixture(scope="module")
def simulation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler here")
    folder = tmp_path_factory.mktemp("simulation")
    (folder / "robot.soter").write_text(PROGRAM)
    mapping = {"topics": {"seen": MAPPED}}
    load(folder / "robot.soter").build("ros2", folder / "out", "Robot", mapping=mapping)
    simulated = folder / "out" / "simulated"
    mains = ("main.c", "soter_main.c", "soter_virtual.c")
    sources = [p.name for p in simulated.glob("*.c") if p.name not in mains]
    processes.run(["cc", "-std=c99", "-c", *sources], cwd=simulated, check=True)
    (folder / "out" / "main.cpp").write_text(SIMULATED)
    words = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-Isrc", "-Isimulated", "main.cpp"]
    objects = [str(p) for p in simulated.glob("*.o")]
    processes.run([*words, *objects, "-lm", "-o", "run"], cwd=folder / "out", check=True)
    return folder / "out" / "run"


@pytest.mark.parametrize(("wrong", "said"), OF_SIMULATIONS.items(), ids=OF_SIMULATIONS)
def test_a_simulation_with_a_topic_that_is_none_ends(
    simulation: Path, wrong: str, said: str
) -> None:
    done = processes.run([simulation, wrong], capture_output=True, text=True)
    assert done.returncode == DEFECT
    assert done.stderr.endswith(f": not {said}\n")


def test_a_simulation_of_its_own_topics_goes_on(simulation: Path) -> None:
    assert processes.run([simulation, "fine"]).returncode == 0
