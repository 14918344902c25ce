"""What every bridge in C++ does, without a middleware: what goes out, and how old messages are.

Non-goals: the nodes (`tests/correct/test_ros_nodes.py`), conversions (`tests/unit/targets/`).
"""

from __future__ import annotations

import shutil
import sys
from typing import TYPE_CHECKING

import pytest

import processes
from generators.channel_programs import Number, Words, library
from soter.native.shared_library import RUNTIME

if TYPE_CHECKING:
    import ctypes
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

POSIX, BRIDGE = RUNTIME / "posix", RUNTIME / "bridge"
HOUR_NS, NEVER_SILENT_NS = 3600 * 10**9, 10**18
GONE = (
    "nobody writes it: the actuators, or the trusted part, were gone when the bridge began, and "
    "nothing is published"
)
MAIN = """\
#include "soter_bridge_core.hpp"
#include <cstdio>
#include <cstdlib>
static int64_t silent = 0, delay = -1;
struct Topic : soter::OneSource {
  struct Message { int64_t stamp; double value; };
  typedef double Value;
  static const char* channel() { return "x"; }
  static uint64_t hash() { return 7; }
  static const char* topic() { return "/x"; }
  static const char* publisher() { return ""; }
  static bool frame(const Message&) { return true; }
  static bool stamped() { return delay < 0; }
  static int64_t delay_ns() { return delay < 0 ? 0 : delay; }
  static int64_t stamp_ns(const Message& m) { return m.stamp; }
  static bool convert(const Message& m, Value* to) { *to = m.value; return true; }
  static bool law(Value*) { return false; }
  static int64_t silent_ns() { return silent; }
};
/* out FOLDER SILENT_NS HELD_UP_NS: says that it runs, and after a line of input what two turns
 * publish, with its stamp; whoever reads the clock of the stamps, which stands still, is held up.
 * how FOLDER SILENT_NS: how its topic is after two turns.
 * diagnostics FOLDER: what the trusted part says of the module M.
 * in FOLDER NOW NOW_OF_STAMPS STAMP ERROR [DELAY]: when a message counts as measured; with a DELAY
 * it has no stamp. */
int main(int count, char** words) {
  if (count == 5) {
    silent = std::atoll(words[3]);
    const int64_t held_up = std::atoll(words[4]);
    soter::Outward<Topic> out;
    if (out.open(words[2]) != nullptr) return 1;
    std::puts("it runs");
    std::fflush(stdout);
    (void)std::getchar();
    int turns = 2;
    out.serve([&turns] { return turns-- > 0; },
              [held_up] {
                const int64_t end = soter::monotonic_ns() + held_up;
                while (soter::monotonic_ns() < end) {
                }
                return int64_t{1000000000000};
              },
              [](const double& value, int64_t stamp) {
                std::printf("%g %lld\\n", value, static_cast<long long>(stamp));
              });
    return 0;
  }
  if (count == 4) {
    silent = std::atoll(words[3]);
    soter::Outward<Topic> out;
    if (out.open(words[2]) != nullptr) return 1;
    int turns = 2;
    out.serve([&turns] { return turns-- > 0; }, [] { return int64_t{0}; },
              [](const double&, int64_t) {});
    const soter::Status how = out.status();
    std::printf("%d %s\\n", how.level, how.message.c_str());
    return 0;
  }
  if (count == 3) {
    soter::TrustedPart part({9, {"M"}, {"M"}, {"position"}, 8, "arm"});
    if (part.open(words[2]) != nullptr) return 1;
    (void)part.hear();
    const soter::Status module = part.statuses()[0];
    for (const std::pair<std::string, std::string>& value : module.values)
      std::printf("%s: %s\\n", value.first.c_str(), value.second.c_str());
    return 0;
  }
  delay = count > 7 ? std::atoll(words[7]) : -1;
  soter::Inward<Topic> in(std::atoll(words[6]));
  if (in.open(words[2]) != nullptr) return 1;
  in.take({std::atoll(words[5]), 1.0}, "node", std::atoll(words[3]), std::atoll(words[4]));
  soter_outside channel;
  int64_t measured = -1;
  double value = 0.0;
  if (soter_outside_open(&channel, words[2], "x", 7, sizeof value, false) != nullptr ||
      !soter_outside_read(&channel, &measured, &value, nullptr)) return 1;
  std::printf("%lld\\n", static_cast<long long>(measured));
}
"""


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("library"))


@pytest.fixture(scope="module")
def bridge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler here")
    folder = tmp_path_factory.mktemp("bridge")
    (folder / "main.cpp").write_text(MAIN)
    include = [f"-I{x}" for x in (RUNTIME, POSIX, BRIDGE)]
    own = [
        POSIX / f"{x}.c"
        for x in ("soter_outside", "soter_channel", "soter_posix_check", "soter_status_text")
    ]
    processes.run(["cc", "-c", "-O1", *include, *own], cwd=folder, check=True)
    objects = [folder / f"{x.stem}.o" for x in own]
    words = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", *include, "-pthread"]
    processes.run([*words, "-o", "bridge", "main.cpp", *objects], cwd=folder, check=True)
    return folder / "bridge"


def published(
    bridge: Path, folder: Path, code: ctypes.CDLL, silent_ns: int, behind_ns: int, held_ns: int = 0
) -> list[tuple[str, int]]:
    """Value and age of what goes out of one that is written while the bridge runs.

    It is written `behind_ns` before now; the bridge is held up for `held_ns` between the clocks.
    """
    words = (bridge, "out", folder, str(silent_ns), str(held_ns))
    pipes = {"stdin": processes.PIPE, "stdout": processes.PIPE}
    with processes.started(words, text=True, **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "it runs\n"
        Number(code, folder, "x", 7, writes=True).write(0.5, behind_ns)
        out, _ = process.communicate("\n")
    lines = [line.split() for line in str(out).splitlines()]
    return [(value, 10**12 - int(stamp)) for value, stamp in lines]


def test_a_value_of_now_goes_out(bridge: Path, code: ctypes.CDLL, tmp_path: Path) -> None:
    ((value, age_ns),) = published(bridge, tmp_path, code, NEVER_SILENT_NS, 0)
    assert value == "0.5"
    assert age_ns > 0


def test_who_is_held_up_between_the_clocks_stamps_a_value_older(
    bridge: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    held_ns = 50 * 10**6
    ((_, age_ns),) = published(bridge, tmp_path, code, NEVER_SILENT_NS, 0, held_ns)
    assert age_ns >= held_ns


def test_a_value_of_before_the_machine_was_started_does_not_go_out(
    bridge: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    """Its time is on a clock that has begun anew since: it lies after now."""
    assert published(bridge, tmp_path, code, NEVER_SILENT_NS, -HOUR_NS) == []


def test_a_value_that_its_writer_held_back_does_not_go_out(
    bridge: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    """An actuator that was stopped between the time and the value writes a command of back then."""
    assert published(bridge, tmp_path, code, 1, 0) == []


@pytest.mark.parametrize(
    ("written", "silent_ns", "said"),
    [
        (False, 1, "0 nothing to publish yet"),
        (True, NEVER_SILENT_NS, "0 nothing to publish yet"),
        (
            True,
            1,
            f"2 {GONE}",
        ),
    ],
)
def test_a_bridge_that_begins_after_the_end_of_who_writes_says_so(
    bridge: Path, code: ctypes.CDLL, tmp_path: Path, written: bool, silent_ns: int, said: str
) -> None:
    """A value of before tells that somebody wrote; where none is there nobody may have begun."""
    if written:
        Number(code, tmp_path, "x", 7, writes=True).write(0.5)
    words = (bridge, "how", tmp_path, str(silent_ns))
    done = processes.run(words, check=True, capture_output=True, text=True)
    assert done.stdout == f"{said}\n"


@pytest.mark.parametrize(
    ("stamp", "error", "measured"), [(4000, 0, 9000), (4000, 50, 8950), (5020, 50, 9970)]
)
def test_a_message_is_as_old_as_its_stamp_on_a_clock_that_was_read_before(
    bridge: Path, tmp_path: Path, stamp: int, error: int, measured: int
) -> None:
    """Whoever is stopped between the clocks makes a message older: `now` is no clock of its own."""
    now = [str(x) for x in (10_000, 5000, stamp, error)]
    said = processes.run([bridge, "in", tmp_path, *now], check=True, capture_output=True, text=True)
    assert int(said.stdout) == measured


@pytest.mark.parametrize("delay_ns", [0, 30])
def test_a_message_without_a_stamp_was_measured_its_declared_delay_before_it_came(
    bridge: Path, tmp_path: Path, delay_ns: int
) -> None:
    now = [str(x) for x in (10_000, 5000, 0, 50, delay_ns)]
    said = processes.run([bridge, "in", tmp_path, *now], check=True, capture_output=True, text=True)
    assert int(said.stdout) == 10_000 - delay_ns


OLD_READS = [
    ((1, 93_000_000, 80_000_000), "position 93.000 ms old, of 80.000 ms"),
    ((1, -(2**62), 0), "position, which nobody had published"),
    ((2, 2_000_000, 1_000_000), "a topic inside 2.000 ms old, of 1.000 ms"),
    ((0, 0, 0), None),
]


@pytest.mark.parametrize(("old", "told"), OLD_READS)
def test_diagnostics_say_which_reading_the_leases_ended_with(
    bridge: Path, code: ctypes.CDLL, tmp_path: Path, old: tuple[int, ...], told: str | None
) -> None:
    words = [*[0] * (3 + 9), 5, 1, 1, *old, *[0] * 6]
    status = Words(code, tmp_path, "soter.status", 9, len(words), writes=True)
    status.write(*words)
    said = processes.run(
        [bridge, "diagnostics", tmp_path], check=True, capture_output=True, text=True
    )
    values = dict(line.split(": ", 1) for line in said.stdout.splitlines())
    assert values.get("its leases ended with a read of") == told
    assert values["leases given"] == "5"
