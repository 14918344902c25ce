"""Programs in real time: nobody late is virtual time; whoever fails is seen and harms nobody.

The clock of the trusted thread, and who is scheduled when, are the test's (`owned_clock.c`). What
the machine itself does is tried by `test_scheduled_by_the_machine.py` (`make test-real-time`).
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import pytest

import processes
import soter
from generators.c_packages import CART
from generators.channel_programs import source_in
from generators.posix_packages import (
    FAST,
    PATIENT,
    QUIET,
    built,
    cart_in_c,
    cart_with_extern,
    end_of,
    over,
    owned,
    report,
    worker_in_c,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

WORKER = "SafeCart.Fast"
STOPPED = "held:395000000:2000000000"
"""For 2 s nobody schedules the trusted thread, which should have waken at 395 ms."""


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return owned(CART, tmp_path_factory.mktemp("cart") / "out")


@pytest.fixture(scope="module")
def cart_apart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cart_in_c(tmp_path_factory.mktemp("cart_apart"))


@pytest.fixture(scope="module")
def track(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A module with a fail-safe law; its plant is here."""
    folder = tmp_path_factory.mktemp("track")
    return owned(source_in(folder), folder / "out")


def faulty(tmp_path: Path, body: str, before: str = "") -> tuple[str, str]:
    """The option for an AC that does `body` after its first fifty steps."""
    head, rest = FAST.split("int fast_step", 1)
    begin = rest.index("{") + 1
    code = f"""#define _GNU_SOURCE
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
{before}
{head}static long steps;
int fast_step{rest[:begin]}
  if (++steps > 50) {{ {body} }}
{rest[begin:]}"""
    return "--worker", worker_in_c(tmp_path, code)


# ---------------------------------------------------------------- on time


@pytest.mark.parametrize("seed", [1, 7])
def test_a_run_without_a_miss_has_the_trace_of_virtual_time(cart: Path, seed: int) -> None:
    run_report = report(cart, "--until", "0.5", "--seed", str(seed))
    assert run_report["trace_sha256"] == end_of(CART, "0.5s", seed=seed)
    assert (
        run_report["misses"]
        == run_report["late_instants"]
        == run_report["late_untrusted_instants"]
        == 0
    )
    assert run_report["instants"] == 101
    assert 4_000_000 < run_report["silence_ns"] < 5_000_000, "an instant every 5 ms"


def test_an_ac_in_a_process_of_its_own_changes_nothing(cart_apart: Path) -> None:
    run_report = report(cart_apart, "--until", "1")
    worker = run_report["workers"][WORKER]
    assert worker["answered"] == worker["asked"] == 101
    assert worker["later"] == worker["missing"] == 0
    assert run_report["trace_sha256"] == end_of(CART, "1s")


def test_the_report_counts_every_node_at_every_release(cart: Path) -> None:
    run_report = report(cart, "--until", "0.5")
    counts = {name: node["completion"]["count"] for name, node in run_report["nodes"].items()}
    assert counts == {"c": 101, "SafeCart.dm": 11, "SafeCart.Careful": 51, "SafeCart.Fast": 51}
    assert sum(n for _, n in run_report["wake"]["bins"]) == run_report["instants"]
    assert run_report["modules"]["SafeCart"].keys() >= {"ac_share", "switches_to_sc", "takeovers"}


# ---------------------------------------------------------------- late


def test_a_trusted_part_that_is_held_up_is_seen_and_its_module_goes_to_sc(cart: Path) -> None:
    run_report = report(cart, "--until", "1.2", events=["held:795000000:200000000"], expected=4)
    nodes = run_report["nodes"]
    late = {name: n["released_late"] + n["completed_late"] for name, n in nodes.items()}
    assert late == {"c": 0, "SafeCart.dm": 4, "SafeCart.Careful": 20, "SafeCart.Fast": 0}
    assert run_report["misses"] == 24
    assert (run_report["late_instants"], run_report["late_untrusted_instants"]) == (20, 20)
    assert run_report["modules"]["SafeCart"]["takeovers"]["missed"] == 1
    assert run_report["violations"] == run_report["calendars"] == 0
    assert run_report["instants"] == 241, "all of them are made up for"


def test_an_instant_of_plants_alone_is_counted_and_no_miss(cart: Path) -> None:
    run_report = report(cart, "--until", "0.5", events=["held:395000000:2000000"])
    assert (
        run_report["misses"],
        run_report["late_instants"],
        run_report["late_untrusted_instants"],
    ) == (0, 0, 1)


def test_who_wakes_early_begins_no_step_early_and_changes_nothing(
    cart: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    run_report = report(cart, "--until", "0.5", "--early", "2000", "--log", str(log))
    late = [int(x.split(",")[1]) for x in log.read_text().splitlines()[1:]]
    assert len(late) == 101
    assert 0 <= min(late) <= max(late) < 20_000, "it looked at the clock until it was time"
    assert run_report["trace_sha256"] == end_of(CART, "0.5s")


def test_every_late_step_is_a_miss_where_nothing_may_be_late(cart: Path) -> None:
    run_report = report(cart, "--until", "0.3", "--late", "0", expected=4)
    trusted = run_report["nodes"]["SafeCart.dm"], run_report["nodes"]["SafeCart.Careful"]
    assert [n["released_late"] for n in trusted] == [7, 31]
    assert run_report["modules"]["SafeCart"]["ac_share"] == 0.0


# ---------------------------------------------------------------- a second behind, and more


def test_a_calendar_that_is_a_second_behind_begins_anew(cart: Path) -> None:
    run_report = report(cart, "--until", "0.5", events=[STOPPED], expected=4)
    assert run_report["calendars"] == 1
    assert run_report["trace_sha256"] is None
    assert run_report["instants"] == 101
    assert (run_report["silence_ns"] // 10**6, run_report["silence_after_ns"]) == (
        2004,
        390_000_000,
    )
    late = {name: n["released_late"] for name, n in run_report["nodes"].items()}
    assert late == {"c": 0, "SafeCart.dm": 40, "SafeCart.Careful": 200, "SafeCart.Fast": 0}
    assert run_report["misses"] == 240 + run_report["calendars"], (
        "all releases that were slept through"
    )


def test_after_the_gap_it_begins_in_sc(cart: Path) -> None:
    """It was AC that acted on, until the next decision, 35 ms later."""
    with over(cart, "held:365000000:2000000000"):
        run = soter.load(CART).simulate(until=0.5, real_time=True)
    before = run.time_s() < 0.365
    (first,) = (run.time_s() == 0.365).nonzero()[0]
    assert run.mode("SafeCart")[before].any()
    assert run.mode("SafeCart")[first] == 0
    assert run.truth("c")["x"][first] > 0.1
    motion = run.topic("motion")[first]
    wanted = min(max(-2.0 * motion["x"] - 3.0 * motion["v"], -3.0), 3.0)
    assert run.topic("accel")[first] == wanted < 0.0, "SC's command, made in this instant"
    assert run.topic("accel")[first - 1] > 0.0, "AC's"


def test_what_ac_answered_before_the_gap_is_not_taken(cart_apart: Path) -> None:
    run_report = report(
        cart_apart, "--until", "0.5", events=["held:365000000:2000000000"], expected=4
    )
    worker = run_report["workers"][WORKER]
    assert (worker["asked"], worker["answered"], worker["missing"]) == (51, 50, 1)
    assert run_report["modules"]["SafeCart"]["takeovers"]["missed"] == 1


@pytest.mark.parametrize(("allowed", "exit_code"), [("0", 4), ("240", 4), ("241", 0)])
def test_more_misses_than_are_allowed_are_told_and_no_success(
    cart: Path, allowed: str, exit_code: int
) -> None:
    options = ["--until", "0.5", "--misses", allowed, "--quiet"]
    run_report = report(cart, *options, events=[STOPPED], expected=exit_code)
    assert run_report["misses_allowed"] == int(allowed)
    words = processes.run(
        [cart, *options], capture_output=True, text=True, env={**os.environ, "OWNED_CLOCK": STOPPED}
    )
    assert words.returncode == exit_code
    late = f"LATE: 241 misses of the trusted part, {allowed} are allowed (--misses)"
    assert (late in words.stdout) == (exit_code == 4)
    assert "longest silence 2004." in words.stdout
    assert "ms, after the instant at 0.390000 s" in words.stdout
    assert "SafeCart: no fail-safe law, its last command stayed" in words.stdout


def test_what_actuators_did_in_the_silence_is_told(track: Path) -> None:
    """The lease of the SC release at 900 ms, given for ones to come, ends 0.14 s behind 1 s."""
    run_report = report(track, "--until", "2", events=["held:1000000000:2000000000"], expected=4)
    lease = run_report["leases"]["Guard"]
    assert lease["ended_ns"] is not None
    assert lease["law"] > 10
    assert 1_800_000_000 < lease["silence_law_ns"] < 2_000_000_000 < run_report["silence_ns"]
    with over(track, "held:1000000000:2000000000"):
        run = soter.load(track.parent.parent / "stop.soter").simulate(until=2.0, real_time=True)
    (note,) = [n for n in run.notes if "the trusted part was late" in n]
    assert f"for the last {lease['silence_law_ns'] / 1e6:.1f} ms of it" in note
    moved = run.truth("c")["x"][run.time_s() > 1.2]
    assert (moved[1:] <= moved[:-1]).all(), "it drives by the law, backwards"


def test_plants_that_are_here_obey_leases_and_nothing_else_changes(track: Path) -> None:
    run_report = report(track, "--until", "1")
    leases = run_report["leases"]["Guard"]
    silent = leases["silence_law_ns"]
    assert leases == {
        "given": leases["given"], "stale": 0, "law": 0, "silence_law_ns": silent, "ended_ns": None
    }  # fmt: skip
    assert leases["given"] > 10
    assert run_report["trace_sha256"] == end_of(track.parent.parent / "stop.soter", "1s")


def test_plants_that_are_here_are_held_by_the_law_once_a_lease_has_ended(track: Path) -> None:
    run_report = report(track, "--until", "3", events=["held:1000000000:400000000"], expected=4)
    leases = run_report["leases"]["Guard"]
    assert leases["ended_ns"] is not None
    assert leases["law"] > 10
    assert run_report["calendars"] == 0


# ---------------------------------------------------------------- controllers that fail

FAULTS = {
    "crash": ("*(volatile int *)0 = 1;", "missing"),
    "exit": ("_exit(0);", "missing"),
    "hang": ("for (;;) pause();", "missing"),
    "spin": ("for (;;) {}", "missing"),
    "memory": ("for (;;) { char *p = malloc(1 << 24); if (p) memset(p, 1, 1 << 24); }", "missing"),
    "flood": ("for (;;) if (write(1, FLOOD, 4096) < 0) {}", "missing"),
    "nan": ("out->accel = 0.0 / (in->goal - in->goal); out->has_accel = 1; return 0;", "gate"),
    "outside": ("out->accel = 1e9; out->has_accel = 1; return 0;", "gate"),
    "failed": ("return 1;", "failed"),
    "torn": ("for (;;) SEGMENT[0] |= 1u;", "torn"),
    "scribbled": ("for (;;) memset((void *)SEGMENT, rand(), 72);", "missing"),
    "size": ("for (;;) { SEGMENT[0] = 2; SEGMENT[2] = UINT64_MAX; }", "size"),
    "layout": ("for (;;) { SEGMENT[0] = 2; SEGMENT[1] = 1; }", "layout"),
    "stale": ("for (;;) { SEGMENT[0] += 2; }", "missing"),
    "cut": (
        "if (ftruncate(4, 0) == 0) abort(); out->accel = 1e9; out->has_accel = 1; return 0;",
        "gate",
    ),
}
MAPPED = """#define FLOOD ((const char *)mmap(0, 4096, 1, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0))
#define SEGMENT ((volatile uint64_t *)mmap(0, 72, 3, MAP_SHARED, 4, 0))
"""


SETTLED = {
    **dict.fromkeys(("torn", "size", "layout"), "answers:50:1"),
    **dict.fromkeys(("hang", "spin", "memory", "flood", "scribbled", "stale"), "answers:50:0"),
}
"""Behind its fiftieth request such an AC is waited for until what it writes is there, or never."""


@pytest.mark.parametrize("kind", FAULTS)
def test_an_ac_that_fails_loses_control_and_nothing_else_happens(
    cart_apart: Path, tmp_path: Path, kind: str
) -> None:
    body, sign = FAULTS[kind]
    body = body.replace("SEGMENT[", "segment[").replace("SEGMENT", "segment")
    body = body.replace("for (;;)", "volatile uint64_t *segment = SEGMENT; (void)segment; for (;;)")
    options = [*faulty(tmp_path, body, MAPPED), "--restarts", "0", "--worker-memory", "256"]
    run_report = report(cart_apart, *options, "--until", "1.5", events=[SETTLED.get(kind, "")])
    module, worker = run_report["modules"]["SafeCart"], run_report["workers"][WORKER]
    assert run_report["violations"] == 0
    assert run_report["instants"] == 301
    assert module["gate_faults"] > 50
    assert module["takeovers"]["silent"] + module["takeovers"]["gate"] == 1
    assert (module["switches_to_ac"], module["switches_to_sc"]) == (1, 1), "it ends in SC"
    if sign != "gate":
        assert worker[sign] > 50


@pytest.mark.parametrize("option", ["", "--ignore-signal=CHLD"])
def test_an_ac_that_is_killed_is_started_again_and_wins_control_back(
    cart_apart: Path, option: str
) -> None:
    """Whoever starts the program may ignore how children end, and hands that on."""
    program = cart_apart.with_name("started")
    program.write_text(f'#!/bin/sh\nexec env {option} {cart_apart} "$@"\n')
    program.chmod(0o755)
    events = ["killed:900000000:1", "started:1500000000:2"]
    run_report = report(program, "--until", "2.5", events=events)
    worker, module = run_report["workers"][WORKER], run_report["modules"]["SafeCart"]
    assert (worker["starts"], worker["ends"]) == (2, 1)
    assert worker["missing"] >= 1
    assert module["takeovers"]["silent"] >= 1
    assert module["switches_to_ac"] >= 2
    assert run_report["violations"] == 0


@pytest.mark.long
def test_restarts_are_bounded(cart_apart: Path, tmp_path: Path) -> None:
    option = faulty(tmp_path, "_exit(7);")
    events = ["started:1000000000:2", "ended:2000000000:2"]
    run_report = report(cart_apart, *option, "--until", "2.5", "--restarts", "1", events=events)
    worker = run_report["workers"][WORKER]
    assert (worker["starts"], worker["ends"]) == (2, 2)


def children_of(pid: int) -> list[int]:
    found = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(child) for child in found.read_text().split()]


def test_a_killed_trusted_part_is_followed_though_what_starts_its_workers_lives(
    cart_apart: Path, tmp_path: Path
) -> None:
    """It has the files of the channels, too, as a fork has: a lock of them would live in it."""
    options = ("--channels", str(tmp_path), "--until", "0.1")
    sleeps = ("--worker", "Fast=exec sleep 600")
    command: list[str | Path] = [cart_apart, *QUIET, *PATIENT, *options, *sleeps]
    with processes.started(command, stdout=processes.DEVNULL) as process:
        processes.until(lambda: children_of(process.pid), process)
        (keeper,) = children_of(process.pid)
        try:
            processes.until(lambda: children_of(keeper), process)
            os.kill(keeper, signal.SIGSTOP)
            other = processes.run(command, capture_output=True, text=True)
            assert "`soter.status`" in other.stderr
            assert "it has a writer already" in other.stderr
            process.kill()
            process.wait()
            assert report(cart_apart, *options)["instants"] == 21
        finally:
            os.kill(keeper, signal.SIGKILL)


# ---------------------------------------------------------------- what is not there


def test_an_ac_whose_program_is_missing_leaves_its_module_with_sc(cart_apart: Path) -> None:
    worker = cart_apart.parent / "cart_SafeCart_Fast"
    away = worker.rename(worker.with_suffix(".away"))
    try:
        run_report = report(cart_apart, "--until", "0.3")
    finally:
        away.rename(worker)
    assert any("there is no program `cart_SafeCart_Fast`" in n for n in run_report["notes"])
    assert run_report["modules"]["SafeCart"]["ac_share"] == 0.0
    assert run_report["violations"] == 0
    assert run_report["instants"] == 61


def test_an_ac_of_another_layout_is_never_believed(cart_apart: Path, tmp_path: Path) -> None:
    source = cart_with_extern(tmp_path / "source")
    source.write_text(source.read_text().replace("subscribes motion, goal;", "subscribes motion;"))
    (source.parent / "fast.c").write_text(FAST.replace("in->goal", "9.5"))
    older = built(source, tmp_path / "out").parent / "cart_SafeCart_Fast"
    run_report = report(
        cart_apart, "--until", "0.5", "--worker", f"Fast=exec {older}", "--wait", "1"
    )
    worker = run_report["workers"][WORKER]
    assert worker["answered"] == 0
    assert worker["layout"] == worker["missing"] > 0
    assert run_report["modules"]["SafeCart"]["ac_share"] == 0.0


def test_a_log_on_a_full_disk_ends_and_the_run_goes_on(cart: Path) -> None:
    run_report = report(cart, "--until", "0.5", "--log", "/dev/full")
    assert any("the log `/dev/full` cannot be written" in n for n in run_report["notes"])
    assert run_report["instants"] == 101
    assert run_report["trace_sha256"] == end_of(CART, "0.5s")


def test_the_log_has_a_line_an_instant(cart: Path, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    report(cart, "--until", "0.5", "--log", str(log))
    lines = log.read_text().splitlines()
    assert lines[0] == "ct_ns,wake_late_ns,done_ns,raw_ns,misses,modes"
    assert [int(x.split(",")[0]) for x in lines[1:]] == list(range(0, 500_000_001, 5_000_000))


def test_without_permission_the_run_says_what_is_lost(cart: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("nobody to take permissions from")
    run_report = json.loads(
        processes.run(
            ["setpriv", "--bounding-set=-all", "--inh-caps=-all", "--securebits=+noroot",
             "prlimit", "--memlock=65536", cart, *QUIET, "--until", "0.2"],
            capture_output=True, text=True, check=True, cwd=cart.parent,
        ).stdout
    )  # fmt: skip
    said = " ".join(run_report["notes"])
    assert "SCHED_FIFO is not permitted" in said
    assert "memory is not locked" in said
    assert (run_report["policy"], run_report["locked"]) == ("ordinary", False)
    assert run_report["violations"] == 0


def test_one_processor_is_said(cart: Path) -> None:
    core = str(min(os.sched_getaffinity(0)))
    done = processes.run(
        ["taskset", "-c", core, cart, *QUIET, "--until", "0.1"],
        capture_output=True,
        text=True,
        check=True,
        cwd=cart.parent,
    )
    assert any("one processor only" in n for n in json.loads(done.stdout)["notes"])


NO_SEGMENTS = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdarg.h>
#include <sys/syscall.h>
long syscall(long number, ...) {
  va_list rest;
  va_start(rest, number);
  long a[6];
  for (int i = 0; i < 6; i++) a[i] = va_arg(rest, long);
  va_end(rest);
  if (number == SYS_memfd_create) { errno = ENOSYS; return -1; }
  long (*real)(long, ...) = (long (*)(long, ...))dlsym(RTLD_NEXT, "syscall");
  return real(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}
"""


def test_without_shared_memory_the_trusted_part_goes_on(cart_apart: Path, tmp_path: Path) -> None:
    (tmp_path / "no.c").write_text(NO_SEGMENTS)
    library = tmp_path / "no.so"
    processes.run(["cc", "-shared", "-fPIC", "-o", library, tmp_path / "no.c", "-ldl"], check=True)
    done = processes.run(
        [cart_apart, *QUIET, "--until", "0.3"],
        capture_output=True,
        text=True,
        check=True,
        cwd=cart_apart.parent,
        env={**os.environ, "LD_PRELOAD": str(library)},
    )
    run_report = json.loads(done.stdout)
    assert any("no shared memory" in n for n in run_report["notes"])
    assert run_report["instants"] == 61
    assert run_report["modules"]["SafeCart"]["ac_share"] == 0.0


@pytest.mark.parametrize(
    "options",
    [
        ["--until", "-1"],
        ["--until"],
        ["--policy", "best"],
        ["--worker", "X=true"],
        ["x"],
        ["--early", "20000"],
    ],
)
def test_a_wrong_option_is_refused(cart: Path, options: list[str]) -> None:
    done = processes.run([cart, *options], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "usage" in done.stderr


def test_a_signal_ends_the_run_with_its_report(cart: Path) -> None:
    run_report = report(cart, "--until", "30", events=["terminated:800000000:0"], expected=130)
    assert run_report["stopped"] is True
    assert run_report["instants"] == 160


def test_the_machine_s_own_clock_brings_a_run_to_its_end(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """However late: nothing else is judged."""
    program = built(CART, tmp_path_factory.mktemp("shipped") / "out")
    run_report = report(program, "--until", "0.5", "--misses", "1000000")
    assert run_report["instants"] == 101
    assert run_report["violations"] == 0
