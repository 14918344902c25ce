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
import time
from dataclasses import asdict, astuple, dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.named_files import read_bytes
from soter.native.compiler import python_child
from soter.report.atomic_write import own_place

if TYPE_CHECKING:
    from pathlib import Path

STRETCHES = 1000
"""Parts between the quantiles that are kept: one release in a thousand is later than the last."""
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
    """Measure for so long; raises OSError, SoterError D006 where nothing keeps the machine busy."""
    cores = os.cpu_count() or 1
    busy: list[subprocess.Popen[bytes]] = []
    try:
        busy.extend(_started() for _ in range(2 * cores))
        _require_busy(busy, [p.stdout.read(1) for p in busy if p.stdout is not None])
        late = _released(seconds, period_ns)
        _require_busy(busy, [b"" if p.poll() is not None else b"!" for p in busy])
    finally:
        for process in busy:
            process.kill()
            process.communicate()
    late.sort()
    last = len(late) - 1
    quantiles = tuple(late[round(k * last / STRETCHES)] for k in range(STRETCHES + 1))
    return Lateness(quantiles, len(late), period_ns, len(busy), cores)


def _started() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        python_child(BUSY, str(os.getpid())),
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def _require_busy(busy: list[subprocess.Popen[bytes]], alive: list[bytes]) -> None:
    """SoterError D006 where a process that is to compute has ended."""
    ended = alive.count(b"")
    if ended:
        what = "how late releases are beside busy processes cannot be measured"
        note = f"{ended} of the {len(busy)} processes that are to keep the machine busy have ended"
        raise SoterError((Diagnostic("D006", what, notes=(note,)),))


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


def _read(path: Path) -> Lateness:
    """What stands in a file; SoterError D006 where it is not what `kept` writes."""
    try:
        said = json.loads(read_bytes(path))
        made = Lateness(**{**said, "quantiles_ns": tuple(said["quantiles_ns"])})
        numbers = (*made.quantiles_ns, *astuple(made)[1:])
        if len(made.quantiles_ns) > 1 and all(type(n) is int and 0 <= n < 2**63 for n in numbers):
            return made
    except (ValueError, TypeError, KeyError, RecursionError):
        pass
    help_ = "take it away to have it measured again"
    raise SoterError((Diagnostic("D006", f"`{path}`: it is no lateness", helps=(help_,)),))


def kept(path: Path, seconds: float) -> Lateness:
    """What stands in a file, else what is measured now and kept there."""
    if path.exists():
        return _read(path)
    made = measured(seconds)
    own_place(path.parent, path.name).write_text(json.dumps(asdict(made)) + "\n", encoding="utf-8")
    return made
