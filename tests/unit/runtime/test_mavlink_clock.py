"""The autopilot's clock, as TIMESYNC tells it: what is said lies on the right side of the truth.

Non-goals: messages (`tests/correct/test_mavlink.py`).
"""

from __future__ import annotations

import random
import shutil
from typing import TYPE_CHECKING, Any

import pytest

import processes
from soter.native.shared_library import RUNTIME

if TYPE_CHECKING:
    from pathlib import Path

MS = 10**6
S = 10**9
EXCHANGES = 16
DECLARED = """
typedef struct { int64_t sent, received, remote; } soter_mavlink_exchange;
typedef struct {
  soter_mavlink_exchange exchange[16]; uint64_t exchanges; int64_t pending[8]; uint64_t requests;
  uint64_t slow, unasked, jumps;
} soter_mavlink_clock;
void soter_mavlink_clock_ask(soter_mavlink_clock* clock, int64_t now);
bool soter_mavlink_clock_hear(soter_mavlink_clock* clock, int64_t now, int64_t ts1, int64_t remote);
bool soter_mavlink_clock_runs(const soter_mavlink_clock* clock, int64_t now);
void soter_mavlink_clock_turn(const soter_mavlink_clock* clock, int64_t now, int64_t stamp,
                              int64_t* earliest, int64_t* latest);
"""


class Clock:
    def __init__(self, ffi: Any, lib: Any) -> None:
        self.ffi, self.lib = ffi, lib
        self.state = ffi.new("soter_mavlink_clock*")

    def exchange(self, sent: int, there_ns: int, back_ns: int, remote: int) -> bool:
        del there_ns  # `remote` was read after it
        self.lib.soter_mavlink_clock_ask(self.state, sent)
        return bool(self.hear(sent + back_ns, sent, remote))

    def hear(self, now: int, ts1: int, remote: int) -> bool:
        return bool(self.lib.soter_mavlink_clock_hear(self.state, now, ts1, remote))

    def runs(self, now: int) -> bool:
        return bool(self.lib.soter_mavlink_clock_runs(self.state, now))

    def turn(self, now: int, stamp: int) -> tuple[int, int]:
        both = self.ffi.new("int64_t[2]")
        self.lib.soter_mavlink_clock_turn(self.state, now, stamp, both, both + 1)
        return int(both[0]), int(both[1])


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Any:
    cffi = pytest.importorskip("cffi")
    if shutil.which("cc") is None:
        pytest.skip("no C compiler here")
    folder: Path = tmp_path_factory.mktemp("clock")
    sources = [
        RUNTIME / "mavlink" / "soter_mavlink_clock.c",
        RUNTIME / "posix" / "soter_posix_check.c",
    ]
    words = ["cc", "-std=c99", "-shared", "-fPIC", "-O1", "-fsanitize=undefined"]
    words += ["-fsanitize-undefined-trap-on-error", "-Wall", "-Wextra", "-Werror", f"-I{RUNTIME}"]
    processes.run([*words, "-o", str(folder / "clock.so"), *map(str, sources)], check=True)
    ffi = cffi.FFI()
    ffi.cdef(DECLARED)
    lib = ffi.dlopen(str(folder / "clock.so"))
    return lambda: Clock(ffi, lib)


@pytest.mark.parametrize("ppm", [-100, 0, 100])
def test_what_was_measured_lies_between_earliest_and_latest(make: Any, ppm: int) -> None:
    draw = random.Random(ppm)  # noqa: S311 - delays
    clock, offset = make(), 37 * S

    def remote_at(ns: int) -> int:
        return offset + ns + ns * ppm // 10**6

    for k in range(1, 400):
        now = k * 100 * MS
        there, back = draw.randrange(20_000, 5 * MS), draw.randrange(20_000, 5 * MS)
        assert clock.exchange(now, there, there + back, remote_at(now + there))
        measured = now + draw.randrange(10 * MS, 90 * MS)
        earliest, latest = clock.turn(now + 95 * MS, remote_at(measured))
        assert earliest <= measured <= latest
        assert k < EXCHANGES or latest - earliest < 8 * MS
    assert clock.state.jumps == 0


def test_half_a_round_trip_makes_a_message_older_and_never_newer(make: Any) -> None:
    clock = make()
    assert clock.exchange(S, 3 * MS, 4 * MS, 50 * S)
    earliest, latest = clock.turn(S + 5 * MS, 50 * S)
    assert S - MS // 100 < earliest <= S
    assert S + 4 * MS <= latest < S + 4 * MS + MS // 100


def test_an_answer_counts_once_and_only_if_it_was_asked_for(make: Any) -> None:
    clock = make()
    assert not clock.hear(S, S - MS, 5 * S)
    assert not clock.hear(S, 0, 5 * S)
    assert clock.exchange(2 * S, MS, 2 * MS, 5 * S)
    assert not clock.hear(2 * S + 3 * MS, 2 * S, 9 * S)
    assert (clock.state.unasked, clock.state.exchanges) == (3, 1)


@pytest.mark.parametrize("remote", [0, -1, -(2**63), 2**62, 2**63 - 1])
def test_a_time_that_is_none_is_not_taken(make: Any, remote: int) -> None:
    clock = make()
    assert not clock.exchange(S, MS, 2 * MS, remote)
    assert clock.state.exchanges == 0


def test_a_slow_answer_tells_too_little(make: Any) -> None:
    clock = make()
    assert clock.exchange(S, MS, 51 * MS, 5 * S)
    assert (clock.state.slow, clock.state.exchanges) == (1, 0)
    assert not clock.runs(S + 60 * MS)


def test_without_answers_for_long_it_does_not_run(make: Any) -> None:
    clock = make()
    assert not clock.runs(S)
    clock.exchange(S, MS, 2 * MS, 5 * S)
    assert clock.runs(S + 5 * S)
    assert not clock.runs(S + 6 * S)


@pytest.mark.parametrize("after", [1 * S, 200 * S])
def test_a_clock_that_jumped_is_begun_anew(make: Any, after: int) -> None:
    clock = make()
    for k in range(1, 20):
        clock.exchange(k * 100 * MS, MS, 2 * MS, 50 * S + k * 100 * MS + MS)
    clock.exchange(2 * S, MS, 2 * MS, after)
    assert (clock.state.jumps, clock.state.exchanges) == (1, 1)
    assert clock.turn(2 * S + 3 * MS, after)[0] <= 2 * S


@pytest.mark.parametrize("stamp", [0, 2**62, 2**63 - 1, 4 * 10**18])
def test_no_stamp_overflows(make: Any, stamp: int) -> None:
    clock = make()
    clock.exchange(2**60, MS, 2 * MS, 2**60)
    earliest, latest = clock.turn(2**60 + S, stamp)
    assert earliest <= latest
