"""Programs in real time: nobody late is virtual time; whoever fails is seen and harms nobody.

No test judges how late the machine was.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest

import processes
from generators.packages import CART
from generators.real_time import (
    FAST,
    FORGIVING,
    QUIET,
    built,
    cart_in_c,
    cart_with_extern,
    end_of,
    report,
    worker_in_c,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

WORKER = "SafeCart.Fast"
TRIES = 10


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(CART, tmp_path_factory.mktemp("cart") / "out")


@pytest.fixture(scope="module")
def cart_apart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cart_in_c(tmp_path_factory.mktemp("cart_apart"))


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
    found = report(cart, "--until", "0.5", "--seed", str(seed), *FORGIVING)
    assert found["trace_sha256"] == end_of(CART, "0.5s", seed=seed)
    assert found["misses"] == 0
    assert found["instants"] == 101


def test_an_ac_in_a_process_of_its_own_changes_nothing(cart_apart: Path) -> None:
    for _ in range(TRIES):
        found = report(cart_apart, "--until", "1", *FORGIVING)
        worker = found["workers"][WORKER]
        if worker["later"] == worker["missing"] == 0:
            break
    assert worker["answered"] == worker["asked"] == 101
    assert found["trace_sha256"] == end_of(CART, "1s")


def test_the_report_counts_every_node_at_every_release(cart: Path) -> None:
    found = report(cart, "--until", "0.5", *FORGIVING)
    counts = {name: node["completion"]["count"] for name, node in found["nodes"].items()}
    assert counts == {"c": 101, "SafeCart.dm": 11, "SafeCart.Careful": 51, "SafeCart.Fast": 51}
    assert sum(n for _, n in found["wake"]["bins"]) == found["instants"]
    assert found["modules"]["SafeCart"].keys() >= {"ac_share", "switches_to_sc", "takeovers"}


# ---------------------------------------------------------------- late


def test_a_trusted_part_that_is_held_up_is_seen_and_its_module_goes_to_sc(cart: Path) -> None:
    with processes.started(
        [cart, *QUIET, "--until", "1.2", "--late", "50000"],
        cwd=cart.parent,
        stdout=processes.PIPE,
    ) as running:
        time.sleep(0.8)
        os.kill(running.pid, signal.SIGSTOP)
        time.sleep(0.2)
        os.kill(running.pid, signal.SIGCONT)
        out, _ = running.communicate(timeout=60)
    found = json.loads(out)
    assert found["misses"] > 0
    assert found["modules"]["SafeCart"]["takeovers"]["missed"] >= 1
    assert (
        sum(n["released_late"] + n["completed_late"] for n in found["nodes"].values())
        == (found["misses"])
    )
    assert found["violations"] == 0


def test_who_wakes_early_begins_no_step_early_and_changes_nothing(
    cart: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    found = report(cart, "--until", "0.5", "--early", "2000", "--log", str(log), *FORGIVING)
    late = [int(x.split(",")[1]) for x in log.read_text().splitlines()[1:]]
    assert len(late) == 101
    assert min(late) >= 0
    assert found["trace_sha256"] == end_of(CART, "0.5s")
    assert min(late) < 20_000, "it looked at the clock until it was time: no wake-up in between"


def test_every_late_step_is_a_miss_where_nothing_may_be_late(cart: Path) -> None:
    found = report(cart, "--until", "0.3", "--late", "0")
    trusted = found["nodes"]["SafeCart.dm"], found["nodes"]["SafeCart.Careful"]
    assert [n["released_late"] for n in trusted] == [7, 31]
    assert found["modules"]["SafeCart"]["ac_share"] == 0.0


def test_a_calendar_that_is_a_second_behind_begins_anew(cart: Path) -> None:
    with processes.started(
        [cart, *QUIET, "--until", "0.5"], cwd=cart.parent, stdout=processes.PIPE
    ) as running:
        time.sleep(0.4)
        os.kill(running.pid, signal.SIGSTOP)
        time.sleep(1.5)
        os.kill(running.pid, signal.SIGCONT)
        out, _ = running.communicate(timeout=60)
    found = json.loads(out)
    assert found["calendars"] == 1
    assert found["trace_sha256"] is None
    assert found["instants"] == 101


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


@pytest.mark.parametrize("kind", FAULTS)
def test_an_ac_that_fails_loses_control_and_nothing_else_happens(
    cart_apart: Path, tmp_path: Path, kind: str
) -> None:
    body, sign = FAULTS[kind]
    body = body.replace("SEGMENT[", "segment[").replace("SEGMENT", "segment")
    body = body.replace("for (;;)", "volatile uint64_t *segment = SEGMENT; (void)segment; for (;;)")
    worker_option = faulty(tmp_path, body, MAPPED)
    found = report(
        cart_apart,
        *worker_option,
        "--until",
        "1.5",
        "--restarts",
        "0",
        "--worker-memory",
        "256",
        *FORGIVING,
    )
    module, worker = found["modules"]["SafeCart"], found["workers"][WORKER]
    assert found["violations"] == 0
    assert found["instants"] == 301
    assert module["gate_faults"] > 50
    assert module["takeovers"]["silent"] + module["takeovers"]["gate"] >= 1
    assert module["switches_to_sc"] == module["switches_to_ac"], "it ends in SC"
    if sign != "gate":
        assert worker[sign] > 50


def test_an_ac_that_is_killed_is_started_again_and_wins_control_back(cart_apart: Path) -> None:
    with processes.started(
        [cart_apart, *QUIET, "--until", "2.5", *FORGIVING],
        cwd=cart_apart.parent,
        stdout=processes.PIPE,
    ) as running:
        time.sleep(0.9)
        os.kill(_child_called("cart_SafeCart_F", running.pid), signal.SIGKILL)
        out, _ = running.communicate(timeout=60)
    found = json.loads(out)
    worker, module = found["workers"][WORKER], found["modules"]["SafeCart"]
    assert (worker["starts"], worker["ends"]) == (2, 1)
    assert worker["missing"] >= 1
    assert module["takeovers"]["silent"] >= 1
    assert module["switches_to_ac"] >= 2
    assert found["violations"] == 0


def test_restarts_are_bounded(cart_apart: Path, tmp_path: Path) -> None:
    option = faulty(tmp_path, "_exit(7);")
    found = report(cart_apart, *option, "--until", "2.5", "--restarts", "1", *FORGIVING)
    worker = found["workers"][WORKER]
    assert (worker["starts"], worker["ends"]) == (2, 2)


def _child_called(name: str, ancestor: int) -> int:
    """The process of that name below `ancestor`."""
    known = {ancestor}
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:
            continue
        begin, end = text.index("("), text.rindex(")")
        parents[int(text[:begin])] = (int(text[end + 2 :].split()[1]), text[begin + 1 : end])
    for _ in range(3):
        known |= {pid for pid, (parent, _) in parents.items() if parent in known}
    (found,) = [pid for pid in known if pid in parents and parents[pid][1] == name]
    return found


# ---------------------------------------------------------------- what is not there


def test_an_ac_whose_program_is_missing_leaves_its_module_with_sc(cart_apart: Path) -> None:
    worker = cart_apart.parent / "cart_SafeCart_Fast"
    away = worker.rename(worker.with_suffix(".away"))
    try:
        found = report(cart_apart, "--until", "0.3", *FORGIVING)
    finally:
        away.rename(worker)
    assert any("there is no program `cart_SafeCart_Fast`" in n for n in found["notes"])
    assert found["modules"]["SafeCart"]["ac_share"] == 0.0
    assert found["violations"] == 0
    assert found["instants"] == 61


def test_an_ac_of_another_layout_is_never_believed(cart_apart: Path, tmp_path: Path) -> None:
    source = cart_with_extern(tmp_path / "source")
    source.write_text(source.read_text().replace("subscribes motion, goal;", "subscribes motion;"))
    (source.parent / "fast.c").write_text(FAST.replace("in->goal", "9.5"))
    older = built(source, tmp_path / "out").parent / "cart_SafeCart_Fast"
    found = report(
        cart_apart, "--until", "0.5", "--worker", f"Fast=exec {older}", "--wait", "1", *FORGIVING
    )
    worker = found["workers"][WORKER]
    assert worker["answered"] == 0
    assert worker["layout"] == worker["missing"] > 0
    assert found["modules"]["SafeCart"]["ac_share"] == 0.0


def test_a_log_on_a_full_disk_ends_and_the_run_goes_on(cart: Path) -> None:
    found = report(cart, "--until", "0.5", "--log", "/dev/full", *FORGIVING)
    assert any("the log `/dev/full` cannot be written" in n for n in found["notes"])
    assert found["instants"] == 101
    assert found["trace_sha256"] == end_of(CART, "0.5s")


def test_the_log_has_a_line_an_instant(cart: Path, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    report(cart, "--until", "0.5", "--log", str(log), *FORGIVING)
    lines = log.read_text().splitlines()
    assert lines[0] == "ct_ns,wake_late_ns,done_ns,raw_ns,misses,modes"
    assert [int(x.split(",")[0]) for x in lines[1:]] == list(range(0, 500_000_001, 5_000_000))


def test_without_permission_the_run_says_what_is_lost(cart: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("nobody to take permissions from")
    found = json.loads(
        processes.run(
            ["setpriv", "--bounding-set=-all", "--inh-caps=-all", "--securebits=+noroot",
             "prlimit", "--memlock=65536", cart, *QUIET, "--until", "0.2", *FORGIVING],
            capture_output=True, text=True, check=True, cwd=cart.parent,
        ).stdout
    )  # fmt: skip
    said = " ".join(found["notes"])
    assert "SCHED_FIFO is not permitted" in said
    assert "memory is not locked" in said
    assert (found["policy"], found["locked"]) == ("ordinary", False)
    assert found["violations"] == 0


def test_one_processor_is_said(cart: Path) -> None:
    core = str(min(os.sched_getaffinity(0)))
    done = processes.run(
        ["taskset", "-c", core, cart, *QUIET, "--until", "0.1", *FORGIVING],
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
        [cart_apart, *QUIET, "--until", "0.3", *FORGIVING],
        capture_output=True,
        text=True,
        check=True,
        cwd=cart_apart.parent,
        env={**os.environ, "LD_PRELOAD": str(library)},
    )
    found = json.loads(done.stdout)
    assert any("no shared memory" in n for n in found["notes"])
    assert found["instants"] == 61
    assert found["modules"]["SafeCart"]["ac_share"] == 0.0


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
    with processes.started(
        [cart, *QUIET, "--until", "30"], cwd=cart.parent, stdout=processes.PIPE
    ) as running:
        time.sleep(0.8)
        os.kill(running.pid, signal.SIGTERM)
        out, _ = running.communicate(timeout=20)
    found = json.loads(out)
    assert running.returncode == 130
    assert found["stopped"] is True
    assert 0 < found["instants"] < 6000
