"""Chunks of actions: what a policy wants for its next steps, written each at its time.

Purpose: the actions of a chunk have slots of time, [start + k every, start + (k+1) every); `Player`
writes each in its slot. A chunk replaces what is left of the one before; after the last action
nothing is written, so that the age of the topic grows and SC takes over.
Non-goals: blending of overlapping chunks (temporal ensembling), which is the policy's; actions
whose slot has passed: they are left out, never made up for.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Write = Callable[[int, bytes], None]

SECOND_NS = 10**9


@dataclass(frozen=True)
class Chunk:
    """Actions as bytes; `start_ns` of the first slot, `measured_ns`: the stamp of all of them."""

    images: Sequence[bytes]
    start_ns: int
    every_ns: int
    measured_ns: int | None = None

    def slot(self, now_ns: int) -> int:
        """Which slot a time is in: below 0 before the first."""
        return (now_ns - self.start_ns) // self.every_ns

    def begin_ns(self, k: int) -> int:
        """When slot k begins."""
        return self.start_ns + k * self.every_ns

    def stamp_ns(self, k: int) -> int:
        """What action k says of when it was measured: by default the begin of its slot."""
        return self.begin_ns(k) if self.measured_ns is None else self.measured_ns


@dataclass
class _Playing:
    chunk: Chunk
    write: Write
    next: int = 0


class Player:
    """What is being played, by topic, and after the first chunk the thread that does it."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self._playing: dict[str, _Playing] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._ended = False

    def begin(self, topic: str, chunk: Chunk, write: Write) -> None:
        """Replaces what is played on a topic; what is due is written before this returns."""
        with self._changed:
            self._playing[topic] = _Playing(chunk, write)
            self.play(self._clock())
            if self._playing and self._thread is None and not self._ended:
                self._thread = threading.Thread(target=self._run, name="soter.remote", daemon=True)
                self._thread.start()
            self._changed.notify()

    def instead(self, topic: str, write: Callable[[], None]) -> None:
        """Ends what is played on a topic, and writes something else."""
        with self._changed:
            self._playing.pop(topic, None)
            write()

    def play(self, now_ns: int) -> int | None:
        """Writes what is due, and says when something is again; None: nothing is left."""
        with self._changed:
            for topic, p in list(self._playing.items()):
                k = p.chunk.slot(now_ns)
                if p.next <= k < len(p.chunk.images):
                    p.write(p.chunk.stamp_ns(k), p.chunk.images[k])
                p.next = max(p.next, k + 1)
                if p.next >= len(p.chunk.images):
                    del self._playing[topic]
            left = self._playing.values()
            return min((p.chunk.begin_ns(p.next) for p in left), default=None)

    def end(self) -> None:
        """Nothing more is written; waits for the thread."""
        with self._changed:
            self._ended = True
            self._playing.clear()
            self._changed.notify()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        with self._changed:
            while not self._ended:
                wake_ns = self.play(self._clock())
                left = None if wake_ns is None else max(0, wake_ns - self._clock()) / SECOND_NS
                self._changed.wait(left)
