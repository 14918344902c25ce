"""Runs of the real-time driver for driver.py: programs, processes that keep a core busy.

Purpose: what its parts share. Non-goals: judging anything.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import soter

if TYPE_CHECKING:
    from collections.abc import Iterator

HERE = Path(__file__).resolve().parent
LOOP = HERE / "real_time_loop.soter"
WORKER, MODULE = "SafeCart.Fast", "SafeCart"
SPIN = "while True: pass"


class Line(NamedTuple):
    """An instant of a driver's log, times in ns; `misses` of it, bit 0 of `modes`: AC.

    `behind`: how late it woke by the driver's own clock and calendar.
    """

    ct: int
    raw: int
    misses: int
    modes: int
    behind: int


def said(right: bool) -> str:
    """Whether a target was met."""
    return "ok" if right else "missed"


def build(source: Path, folder: Path, system: str | None = None) -> Path:
    """The package of a program, compiled: its trusted part."""
    soter.load(source).build("posix", folder, system)
    subprocess.run(["make", "-C", str(folder)], check=True, capture_output=True)
    return folder / source.stem


def run(program: Path, *options: str, **environment: str) -> dict[str, Any]:
    """A run's report."""
    done = subprocess.run(
        [program, "--json", "--quiet", *options],
        capture_output=True,
        check=False,
        env={**os.environ, **environment},
    )
    if done.returncode not in (0, 3, 4):
        raise RuntimeError(done.stderr.decode("utf-8", "replace")[-500:])
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def log_of(path: Path) -> list[Line]:
    """The lines of a driver's log."""
    with path.open() as stream:
        return [
            Line(
                int(r["ct_ns"]),
                int(r["raw_ns"]),
                int(r["misses"]),
                int(r["modes"]),
                int(r["wake_late_ns"]),
            )
            for r in csv.DictReader(stream)
        ]


@contextmanager
def busy(core: int, count: int) -> Iterator[None]:
    """So many ordinary processes that spin on a processor."""
    with ExitStack() as stack:
        for _ in range(count):
            process = subprocess.Popen(
                [sys.executable, "-c", SPIN],
                preexec_fn=lambda: os.sched_setaffinity(0, {core}),  # noqa: PLW1509 - no threads
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield


def steps_left_out(report: dict[str, Any]) -> bool:
    """Whether a step of DM or SC of the loop did not happen."""
    instants, nodes = report["instants"], report["nodes"]
    decided = nodes["SafeCart.dm"]["completion"]["count"]
    careful = nodes["SafeCart.Careful"]["completion"]["count"]
    return bool(careful != instants or decided != -(-instants // 10))


def trusted_misses(report: dict[str, Any]) -> int:
    """Late steps of DM and SC of the loop."""
    nodes = (report["nodes"][n] for n in ("SafeCart.dm", "SafeCart.Careful"))
    return sum(n["released_late"] + n["completed_late"] for n in nodes)
