"""How late this machine releases an ordinary process while it is busy.

Purpose: `measure_lateness` sleeps to periodic releases, under the ordinary policy, beside twice as
many computing processes as there are cores; `stored_lateness` keeps the measurement in a file.
Non-goals: flying under it (`arms.py`); real-time policies; what a deployed program does.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import time
from dataclasses import asdict, astuple, dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.named_files import read_bytes
from soter.native.compiler import python_command
from soter.report.atomic_write import path_without_links

if TYPE_CHECKING:
    from pathlib import Path


QUANTILE_PARTS = 1000
"""The number of equal parts into which the quantiles divide the measured releases."""
PERIOD_NS = 10_000_000
BUSY = """
import ctypes, os
ctypes.CDLL(None).prctl(1, 9)  # PR_SET_PDEATHSIG, SIGKILL: whoever measures may be killed
os.write(1, b"!")
while os.getppid() == int(sys.argv[1]):
    while True: pass
"""
CLOCK_MONOTONIC, TIMER_ABSTIME = 1, 1


@dataclass(frozen=True)
class Lateness:
    """A measurement of the lateness of releases: quantiles in ns, from least to greatest."""

    quantiles_ns: tuple[int, ...]
    releases: int
    period_ns: int
    busy_processes: int
    cores: int

    def as_text(self) -> str:
        """The measurement in words."""
        q = self.quantiles_ns
        half, last = q[len(q) // 2] / 1e6, q[-1] / 1e6
        late = q[int(0.99 * (len(q) - 1))] / 1e6
        return (
            f"{self.releases} releases every {self.period_ns / 1e6:g} ms, ordinary policy, "
            f"{self.busy_processes} busy processes on {self.cores} cores: median {half:.3f} ms, "
            f"99 % {late:.3f} ms, at most {last:.3f} ms"
        )


def measure_lateness(seconds: float) -> Lateness:
    """Measures lateness for `seconds`. Raises OSError, or D006 if a busy process has ended."""
    cores = os.cpu_count() or 1
    busy: list[subprocess.Popen[bytes]] = []
    try:
        busy.extend(_start_busy_process() for _ in range(2 * cores))
        _require_busy(busy, [p.stdout.read(1) for p in busy if p.stdout is not None])
        late = _measure_releases(seconds)
        _require_busy(busy, [b"" if p.poll() is not None else b"!" for p in busy])
    finally:
        for process in busy:
            process.kill()
            process.communicate()
    late.sort()
    last = len(late) - 1
    quantiles = tuple(late[round(k * last / QUANTILE_PARTS)] for k in range(QUANTILE_PARTS + 1))
    return Lateness(quantiles, len(late), PERIOD_NS, len(busy), cores)


def _start_busy_process() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        python_command(BUSY, str(os.getpid())),
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def _require_busy(busy: list[subprocess.Popen[bytes]], alive: list[bytes]) -> None:
    """Raises SoterError D006 if a process that keeps the machine busy has ended."""
    ended = alive.count(b"")
    if ended:
        message = "how late releases are beside busy processes cannot be measured"
        note = f"{ended} of the {len(busy)} processes that are to keep the machine busy have ended"
        raise SoterError((Diagnostic("D006", message, notes=(note,)),))


class _Timespec(ctypes.Structure):
    _fields_ = (("s", ctypes.c_long), ("ns", ctypes.c_long))


def _measure_releases(seconds: float) -> list[int]:
    """Sleeps until each release, and returns the lateness of each in ns."""
    libc = ctypes.CDLL(None, use_errno=True)
    late, at = [], time.monotonic_ns()
    for _ in range(max(1, int(seconds * 1e9 / PERIOD_NS))):
        at += PERIOD_NS
        when = _Timespec(at // 10**9, at % 10**9)
        libc.clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, ctypes.byref(when), None)
        late.append(max(0, time.monotonic_ns() - at))
    return late


def _read_lateness(path: Path) -> Lateness:
    """Reads a measurement. Raises SoterError D006 if `stored_lateness` did not write the file."""
    try:
        fields = json.loads(read_bytes(path))
        made = Lateness(**{**fields, "quantiles_ns": tuple(fields["quantiles_ns"])})
        numbers = (*made.quantiles_ns, *astuple(made)[1:])
        if len(made.quantiles_ns) > 1 and all(type(n) is int and 0 <= n < 2**63 for n in numbers):
            return made
    except (ValueError, TypeError, KeyError, RecursionError):
        pass
    help_ = "take it away to have it measured again"
    raise SoterError((Diagnostic("D006", f"`{path}`: it is no lateness", helps=(help_,)),))


def stored_lateness(path: Path, seconds: float) -> Lateness:
    """Reads the measurement from a file; if the file is missing, measures and writes it."""
    if path.exists():
        return _read_lateness(path)
    made = measure_lateness(seconds)
    path_without_links(path.parent, path.name).write_text(
        json.dumps(asdict(made)) + "\n", encoding="utf-8"
    )
    return made
