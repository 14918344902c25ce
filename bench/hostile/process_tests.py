"""Every test that starts a process, again and again beside processes that keep the machine busy.

    .venv/bin/python bench/hostile/process_tests.py [--runs N] [--busy N] [--list FILE]

First `make test` runs once, undisturbed, and writes down in FILE (build/process_tests.txt) which of
its tests start a process that is no compiler: Python says so of every process (`sys.addaudithook`).
Where FILE is there already it is used as it is. Then these tests run N times (10) with a process
that spins beside them for each of N (4); nothing is tried again. Exit code 1 where a test failed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

if TYPE_CHECKING:
    from collections.abc import Iterator

RECORD, ONLY = "SOTER_RECORD_PROCESS_TESTS", "SOTER_ONLY_PROCESS_TESTS"
COMPILERS = frozenset(("cc", "gcc", "clang", "zig", "make"))
STARTS = frozenset(("subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system"))


# ---------------------------------------------------------------- in pytest: who starts a process

_now = {"test": ""}
_found: set[str] = set()


def _compiles(event: str, given: tuple[Any, ...]) -> bool:
    """Whether a process that is started is a compiler, or what calls one."""
    if event != "subprocess.Popen":
        return False
    words = given[1] if isinstance(given[1], (list, tuple)) else [given[1]]
    return Path(os.fsdecode(words[0])).name in COMPILERS or "ziglang" in words


def _hear(event: str, given: tuple[Any, ...]) -> None:
    if event in STARTS and _now["test"] and not _compiles(event, given):
        _found.add(_now["test"])


def pytest_configure() -> None:
    """Listen, where that is asked for."""
    if RECORD in os.environ:
        sys.addaudithook(_hear)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Which test it is that starts processes."""
    _now["test"] = item.nodeid
    outcome = yield
    _now["test"] = ""
    return outcome


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the tests of a list."""
    if ONLY in os.environ:
        wanted = {*Path(os.environ[ONLY]).read_text(encoding="utf-8").splitlines()}
        config.hook.pytest_deselected(items=[x for x in items if x.nodeid not in wanted])
        items[:] = [x for x in items if x.nodeid in wanted]


def pytest_sessionfinish() -> None:
    """Write down what was heard; workers of xdist one after the other."""
    if RECORD in os.environ and _found:
        with Path(os.environ[RECORD]).open("a", encoding="utf-8") as out:
            out.write("".join(f"{name}\n" for name in sorted(_found)))


# ---------------------------------------------------------------- runs


def run(tests: list[str], **environment: str) -> tuple[int, list[str], float]:
    """One run as `make test` has them: how many tests, which failed, seconds."""
    with tempfile.TemporaryDirectory() as place:
        told = Path(place) / "told.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "bench.hostile.process_tests"]
        command += ["-n", str(len(os.sched_getaffinity(0))), "--dist", "loadfile"]
        command += ["--no-loadscope-reorder", f"--junitxml={told}", *tests]
        path = os.pathsep.join((str(ROOT), os.environ.get("PYTHONPATH", "")))
        began = time.perf_counter()
        done = subprocess.run(
            command,
            cwd=ROOT,
            env={**os.environ, **environment, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - began
        if done.returncode not in (0, 1):
            raise RuntimeError(done.stdout[-2000:] + done.stderr[-2000:])
        cases = list(ET.parse(told).getroot().iter("testcase"))  # noqa: S314 - our own
    bad = [c for c in cases if c.find("failure") is not None or c.find("error") is not None]
    return len(cases), [f"{c.get('classname')}::{c.get('name')}" for c in bad], seconds


def recorded(path: Path) -> list[str]:
    """The tests that start a process; found by a run of all where nobody has written them down."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        count, failed, seconds = run([], **{RECORD: str(path)})
        print(f"`make test`, undisturbed: {count} tests, {len(failed)} failed, {seconds:.0f} s")
        for name in failed:
            print(f"  failed  {name}")
    return sorted({*path.read_text(encoding="utf-8").splitlines()})


def main() -> int:
    """Run; 1 where a test failed."""
    from bench.real_time.driver_runs import busy  # noqa: PLC0415 - a plugin needs no driver

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--busy", type=int, default=4)
    parser.add_argument("--list", type=Path, default=ROOT / "build" / "process_tests.txt")
    given = parser.parse_args()
    names = recorded(given.list)
    files = sorted({name.partition("::")[0] for name in names})
    cores = sorted(os.sched_getaffinity(0))
    print(f"{len(names)} tests of {len(files)} files start a process that is no compiler")
    print(f"{len(cores)} cores, kept busy by {given.busy} processes")
    total = 0
    for k in range(given.runs):
        with ExitStack() as stack:
            for n in range(given.busy):
                stack.enter_context(busy(cores[n % len(cores)], 1))
            count, failed, seconds = run(files, **{ONLY: str(given.list)})
        total += len(failed)
        print(f"run {k + 1:>2}: {count} tests, {len(failed)} failed, {seconds:.0f} s", flush=True)
        for name in failed:
            print(f"  failed  {name}")
    print(f"{given.runs} runs: {total} failures (target 0), nothing was tried twice")
    return 1 if total else 0


if __name__ == "__main__":
    sys.exit(main())
