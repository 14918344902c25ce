"""Processes by name, and the lines that each of them prints.

Purpose: start, signal and end what a bench consists of. Non-goals: which programs, what they say.
"""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from pathlib import Path

PATIENCE_S = 20.0


class Processes:
    """`heard`: the lines that each printed, both streams as one, by its name."""

    ENDED_BY: ClassVar[signal.Signals] = signal.SIGTERM

    def __init__(self) -> None:
        self.environment: dict[str, str] | None = None
        self.running: dict[str, subprocess.Popen[str]] = {}
        self.readers: dict[str, threading.Thread] = {}
        self.heard: dict[str, list[str]] = {}

    def start(self, name: str, *words: str | Path) -> subprocess.Popen[str]:
        """A process; its lines are collected as they come."""
        process = subprocess.Popen(
            [str(w) for w in words],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        assert process.stdout is not None
        lines = self.heard.setdefault(name, [])
        reader = threading.Thread(target=lines.extend, args=(process.stdout,), daemon=True)
        reader.start()
        self.running[name], self.readers[name] = process, reader
        return process

    def tell(self, name: str, number: signal.Signals) -> int:
        """Send it; CLOCK_MONOTONIC just before, ns."""
        now = time.monotonic_ns()
        self.running[name].send_signal(number)
        return now

    def end(self, name: str, number: signal.Signals | None = None) -> int:
        """End one and wait for it; its exit code. None: as this kind is ended, `ENDED_BY`."""
        process = self.running.pop(name)
        process.send_signal(number or self.ENDED_BY)
        try:
            code = process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        self.readers.pop(name).join(PATIENCE_S)
        assert process.stdout is not None
        process.stdout.close()
        return code

    def end_all(self) -> None:
        """Kill what still runs, the last one first."""
        for name in reversed([*self.running]):
            self.end(name, signal.SIGKILL)
