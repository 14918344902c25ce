"""Programs in real time as this machine schedules them: `make test-real-time`.

What they judge is what `test_real_time.py` judges over a clock of its own. A machine that is busy
elsewhere may fail them: they say so, once, and nothing is tried again.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import processes
import soter
from generators.c_packages import CART
from generators.channel_programs import source_in
from generators.posix_packages import (
    FAST,
    FORGIVING,
    PATIENT,
    QUIET,
    built,
    cart_with_extern,
    end_of,
    report,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux"),
]

WORKER = "SafeCart.Fast"


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(CART, tmp_path_factory.mktemp("cart") / "out")


@pytest.fixture(scope="module")
def cart_apart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cart_apart")
    source = cart_with_extern(folder / "source")
    (source.parent / "fast.c").write_text(FAST)
    return built(source, folder / "out")


@contextmanager
def going(program: Path, run_report: dict[str, Any], *options: str) -> Iterator[processes.Process]:
    """The process of a run; what it reports is `found` when the block is left."""
    with processes.started(
        [program, *QUIET, *PATIENT, *options], cwd=program.parent, stdout=processes.PIPE
    ) as running:
        yield running
        out, _ = running.communicate(timeout=processes.TIMEOUT_S)
        run_report.update(json.loads(out), exit=running.returncode)


def stop(process: processes.Process, after_s: float, for_s: float) -> None:
    """SIGSTOP, and SIGCONT."""
    time.sleep(after_s)
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(for_s)
    os.kill(process.pid, signal.SIGCONT)


def test_a_run_without_a_miss_has_the_trace_of_virtual_time(cart: Path) -> None:
    run_report = report(cart, "--until", "0.5", *FORGIVING)
    assert run_report["misses"] == 0
    assert run_report["trace_sha256"] == end_of(CART, "0.5s")


def test_an_ac_in_a_process_of_its_own_changes_nothing(cart_apart: Path) -> None:
    run_report = report(cart_apart, "--until", "1", *FORGIVING)
    worker = run_report["workers"][WORKER]
    assert worker["later"] == worker["missing"] == 0
    assert worker["answered"] == worker["asked"] == 101
    assert run_report["trace_sha256"] == end_of(CART, "1s")


def test_an_ac_in_python_changes_nothing(tmp_path: Path) -> None:
    source = cart_with_extern(tmp_path, "python:fast.py:step")
    wanted = "4.0 * (x.goal - x.motion.x) - 1.0 * x.motion.v"
    (tmp_path / "fast.py").write_text(f"def step(x):\n    return max(-3.0, min(3.0, {wanted}))\n")
    run = soter.load(source).simulate(until=1.0, real_time=True)
    assert run.timing is not None
    worker = run.timing["workers"][WORKER]
    assert worker["later"] == worker["missing"] == run.timing["misses"] == 0
    assert run.trace_sha256 == end_of(CART, "1s")


def test_a_trusted_part_that_is_held_up_is_seen_and_its_module_goes_to_sc(cart: Path) -> None:
    run_report: dict[str, Any] = {}
    with going(cart, run_report, "--until", "1.2", "--late", "50000") as running:
        stop(running, 0.8, 0.2)
    assert run_report["exit"] == 4
    assert run_report["misses"] > 0
    assert run_report["modules"]["SafeCart"]["takeovers"]["missed"] >= 1
    assert run_report["silence_ns"] > 150_000_000
    assert run_report["violations"] == 0


def test_a_calendar_that_is_a_second_behind_begins_anew(cart: Path) -> None:
    run_report: dict[str, Any] = {}
    with going(cart, run_report, "--until", "0.5") as running:
        stop(running, 0.4, 1.5)
    assert run_report["exit"] == 4
    assert (run_report["calendars"], run_report["trace_sha256"], run_report["instants"]) == (
        1,
        None,
        101,
    )
    assert run_report["misses"] > 100


def test_an_ac_that_is_killed_is_started_again_and_wins_control_back(cart_apart: Path) -> None:
    run_report: dict[str, Any] = {}
    with going(cart_apart, run_report, "--until", "2.5", *FORGIVING) as running:
        time.sleep(0.9)
        os.kill(_child_called("cart_SafeCart_F", running.pid), signal.SIGKILL)
    worker, module = run_report["workers"][WORKER], run_report["modules"]["SafeCart"]
    assert (worker["starts"], worker["ends"]) == (2, 1)
    assert module["takeovers"]["silent"] >= 1
    assert module["switches_to_ac"] >= 2
    assert run_report["violations"] == 0


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
    (child_pid,) = [pid for pid in known if pid in parents and parents[pid][1] == name]
    return child_pid


def test_a_signal_ends_the_run_with_its_report(cart: Path) -> None:
    run_report: dict[str, Any] = {}
    with going(cart, run_report, "--until", "30") as running:
        time.sleep(0.8)
        os.kill(running.pid, signal.SIGTERM)
    assert (run_report["exit"], run_report["stopped"]) == (130, True)
    assert 0 < run_report["instants"] < 6000


def test_plants_that_are_here_obey_leases_until_one_ends(tmp_path: Path) -> None:
    track = built(source_in(tmp_path), tmp_path / "out")
    leases = report(track, "--until", "1", *FORGIVING)["leases"]["Guard"]
    assert leases["ended_ns"] is None
    assert leases["given"] > 10
    run_report: dict[str, Any] = {}
    with going(track, run_report, "--until", "3") as running:
        stop(running, 1.0, 0.4)
    leases = run_report["leases"]["Guard"]
    assert leases["ended_ns"] is not None
    assert leases["law"] > 10
