"""Pacing a virtual-time run against the wall clock: `--real-time`.

Purpose: let no instant happen before its time on the clock, and know how late the worst was.
Non-goals: guarantees. This is the virtual-time driver on an ordinary operating system; the
real-time runtime has priorities and a driver of its own.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.simulate.interrupt import StopRequest

NAP_S = 0.01
"""Longest single sleep, so that Ctrl-C is answered at once."""


class Pacer:
    """Waits until virtual times come; the clock starts with the first wait."""

    def __init__(self) -> None:
        self._began_s: float | None = None
        self.lag_s_max = 0.0

    def wait(self, time_ns: int, stop: StopRequest) -> None:
        """Sleep until virtual time `time_ns`, or until a stop is wanted."""
        now_s = time.perf_counter()
        if self._began_s is None:
            self._began_s = now_s - time_ns / 1e9
        due_s = self._began_s + time_ns / 1e9
        self.lag_s_max = max(self.lag_s_max, now_s - due_s)
        while now_s < due_s and not stop.wanted:
            time.sleep(min(due_s - now_s, NAP_S))
            now_s = time.perf_counter()
