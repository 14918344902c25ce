"""How late an ordinary process is released on this machine, while it is busy.

Purpose: the quantiles that the arm with the paper's rules is flown with: periodic threads under the
ordinary policy, as many processes that compute as twice the cores beside them.
Non-goals: real-time policies; what a deployed program does.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from soter.language.load.bounded_read import read_bytes

if TYPE_CHECKING:
    from pathlib import Path

STRETCHES = 1000
"""Parts between the quantiles that are kept: one release in a thousand is later than the last."""
PERIOD_NS = 10_000_000
BUSY = """import ctypes, os, sys
ctypes.CDLL(None).prctl(1, 9)  # PR_SET_PDEATHSIG, SIGKILL: whoever measures may be killed
while os.getppid() == int(sys.argv[1]):
    while True: pass
"""
CLOCK_MONOTONIC, TIMER_ABSTIME = 1, 1


@dataclass(frozen=True)
class Lateness:
    """What was measured: quantiles in ns, the first the least and the last the most."""

    quantiles_ns: tuple[int, ...]
    releases: int
    period_ns: int
    busy_processes: int
    cores: int

    def text(self) -> str:
        """For people."""
        q = self.quantiles_ns
        half, last = q[len(q) // 2] / 1e6, q[-1] / 1e6
        late = q[int(0.99 * (len(q) - 1))] / 1e6
        return (
            f"{self.releases} releases every {self.period_ns / 1e6:g} ms, ordinary policy, "
            f"{self.busy_processes} busy processes on {self.cores} cores: median {half:.3f} ms, "
            f"99 % {late:.3f} ms, at most {last:.3f} ms"
        )


def measured(seconds: float = 20.0, period_ns: int = PERIOD_NS) -> Lateness:
    """Measure for so long; raises OSError where processes cannot be started."""
    cores, own = os.cpu_count() or 1, str(os.getpid())
    busy = [
        subprocess.Popen(
            [sys.executable, "-c", BUSY, own], start_new_session=True, stderr=subprocess.DEVNULL
        )
        for _ in range(2 * cores)
    ]
    try:
        late = _released(seconds, period_ns)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    late.sort()
    last = len(late) - 1
    quantiles = tuple(late[round(k * last / STRETCHES)] for k in range(STRETCHES + 1))
    return Lateness(quantiles, len(late), period_ns, len(busy), cores)


class _Timespec(ctypes.Structure):
    _fields_ = (("s", ctypes.c_long), ("ns", ctypes.c_long))


def _released(seconds: float, period_ns: int) -> list[int]:
    """How late each release was, ns."""
    libc = ctypes.CDLL(None, use_errno=True)
    late, at = [], time.monotonic_ns()
    for _ in range(max(1, int(seconds * 1e9 / period_ns))):
        at += period_ns
        when = _Timespec(at // 10**9, at % 10**9)
        libc.clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, ctypes.byref(when), None)
        late.append(max(0, time.monotonic_ns() - at))
    return late


def kept(path: Path, seconds: float) -> Lateness:
    """What stands in a file, else what is measured now and kept there."""
    if path.exists():
        fields = json.loads(read_bytes(path))
        return Lateness(**{**fields, "quantiles_ns": tuple(fields["quantiles_ns"])})
    made = measured(seconds)
    path.write_text(json.dumps(asdict(made)) + "\n", encoding="utf-8")
    return made
