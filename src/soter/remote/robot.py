"""Connects a policy in Python to a robot, reads its topics and writes to them.

Purpose: `connect` gives a `Robot`, with `read`, `every`, `publish`, `publish_chunk`. A `Reading` is
the value of one topic with the time of its measurement, an `Observation` those of several. The
actions of a `Chunk` have slots of time, [start + k every, start + (k+1) every); a `Player` writes
each in its slot. A new chunk replaces the rest of the one before. After the last action nothing is
written: the age of the topic grows, and SC takes over.
Non-goals: layouts, sets, shared memory (`topics.py`); blending of overlapping chunks (temporal
ensembling), which is up to the policy; late actions: those whose slot has passed are left out.
Nothing here is guaranteed to be on time, and nothing on the robot waits for it.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.model.types import WrongTextError, duration_ns
from soter.remote.channel import Channel, compiled_library
from soter.remote.channels_json import find_topics

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from types import TracebackType

    from typing_extensions import Self

    from soter.remote.channels_json import Declared
    from soter.remote.topics import Topic, Topics

    Write = Callable[[int, bytes], None]


@dataclass(frozen=True)
class Reading:
    """A topic's newest value, its `stamp` of measurement (ns, CLOCK_MONOTONIC), and `age` in s."""

    value: Any
    stamp: int
    age: float


class Observation(dict[str, Any]):
    """The values of topics by name; `readings` has them with stamps and ages."""

    def __init__(self, readings: dict[str, Reading]) -> None:
        super().__init__({name: r.value for name, r in readings.items()})
        self.readings = readings

    @property
    def measured(self) -> int:
        """The stamp of the oldest value, which is the stamp for actions based on these values."""
        return min(r.stamp for r in self.readings.values())

    @property
    def age(self) -> float:
        """The age of the oldest value when it was read, in s."""
        return max(r.age for r in self.readings.values())


SECOND_NS = 10**9


@dataclass(frozen=True)
class Chunk:
    """Actions as bytes, one for each slot of time from `start_ns`; `measured_ns`: their stamp."""

    images: Sequence[bytes]
    start_ns: int
    every_ns: int
    measured_ns: int | None = None

    def slot(self, now_ns: int) -> int:
        """The number of the slot at time `now_ns`; below 0 before the first slot."""
        return (now_ns - self.start_ns) // self.every_ns

    def begin_ns(self, k: int) -> int:
        """The time at which slot k begins."""
        return self.start_ns + k * self.every_ns

    def stamp_ns(self, k: int) -> int:
        """The stamp of action k: `measured_ns`, or the beginning of its slot if this is None."""
        return self.begin_ns(k) if self.measured_ns is None else self.measured_ns


@dataclass
class _Playing:
    chunk: Chunk
    write: Write
    next: int = 0


class Player:
    """Writes the actions of a chunk for each topic; the first chunk starts a thread for that."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self._playing: dict[str, _Playing] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._ended = False

    def begin_chunk(self, topic: str, chunk: Chunk, write: Write) -> None:
        """Replaces the chunk of a topic; writes actions that are due before it returns."""
        with self._changed:
            self._playing[topic] = _Playing(chunk, write)
            self.write_due_actions(self._clock())
            if self._playing and self._thread is None and not self._ended:
                self._thread = threading.Thread(
                    target=self._play_until_ended, name="soter.remote", daemon=True
                )
                self._thread.start()
            self._changed.notify()

    def write_instead(self, topic: str, write: Callable[[], None]) -> None:
        """Ends the chunk of a topic, then calls `write`, which writes another value."""
        with self._changed:
            self._playing.pop(topic, None)
            write()

    def write_due_actions(self, now_ns: int) -> int | None:
        """Writes the actions that are due; gives the time of the next one, None if none is left."""
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

    def end_all(self) -> None:
        """Ends all chunks, and waits for the thread."""
        with self._changed:
            self._ended = True
            self._playing.clear()
            self._changed.notify()
        if self._thread is not None:
            self._thread.join()

    def _play_until_ended(self) -> None:
        with self._changed:
            while not self._ended:
                wake_ns = self.write_due_actions(self._clock())
                left = None if wake_ns is None else max(0, wake_ns - self._clock()) / SECOND_NS
                self._changed.wait(left)


SLICE_NS = 50_000_000
"""How long `every` waits, in ns, before it checks whether the connection was closed."""


def connect(
    program: str | Path | Declared, *, channels: str | Path, system: str | None = None
) -> Robot:
    """Connects to a robot whose trusted part has its channels in the folder `channels`.

    `program`: a file, a program from `soter.load`, the folder of a built package, or its
    `channels.json`. `system` names a system; default: the only one, or the `default`. Raises
    SoterError X013, U002 and errors of the program, and X004, X005 if C cannot be compiled here.
    """
    topics = find_topics(program, system)
    folder = Path(channels)
    if not folder.is_dir():
        start = f"make it, and start the robot with `--channels {folder}`"
        message = f"there is no folder `{folder}`: {start}"
        raise SoterError((Diagnostic("X013", message),))
    compiled_library()  # now, so that the first action need not wait
    return Robot(topics, folder)


class Robot:
    """A connection to a robot, for a `with` block; several threads may call its methods."""

    def __init__(self, topics: Topics, folder: Path) -> None:
        self._topics = topics
        self._folder = folder
        self._lock = Lock()
        self._closed = False
        self._written: dict[str, Channel] = {}
        self._read: dict[str, Channel] = {}
        self._newest: dict[str, tuple[int, bytes]] = {}
        self._player = Player(time.monotonic_ns)

    def __repr__(self) -> str:
        return f"<soter.remote.Robot {self._topics.system} in {self._folder}>"

    @property
    def topics(self) -> dict[str, Topic]:
        """Every topic with a channel, by name: its type, its set (`ends`), who may write it."""
        return {t.name: t for t in self._topics.all}

    # ------------------------------------------------------------ reading

    def read(self, topic: str) -> Reading | None:
        """The newest value, whether or not it was read before; None before the first."""
        t = self._topics.topic_named(topic)
        with self._lock:
            if t.name not in self._read:
                self._read[t.name] = self._open_topic(t, writes=False)
            fresh = self._read[t.name].read()
            if fresh is not None:
                self._newest[t.name] = fresh
            newest = self._newest.get(t.name)
        return None if newest is None else _reading(t, newest)

    def every(self, *topics: str, timeout: float | str | None = None) -> Iterator[Observation]:
        """Yields an observation after each new value of the first topic, from this call on.

        The other topics have their newest values; the first observation waits until each has a
        value. A policy that is slower than its sensor misses values but never falls behind. Raises
        TimeoutError if the first topic gets no value for `timeout` (`"1s"`, or seconds); raises
        SoterError U001, X013.
        """
        wanted = {name: self._topics.topic_named(name) for name in topics}
        if not wanted:
            raise SoterError((Diagnostic("U001", "`every` needs the name of a topic"),))
        limit_ns = None if timeout is None else _positive_ns("timeout", timeout)
        channels = {name: self._open_topic(t, writes=False) for name, t in wanted.items()}
        channels[topics[0]].read()  # skip a value that was written before this call
        return self._observations(wanted, channels, limit_ns)

    def _observations(
        self, wanted: dict[str, Topic], channels: dict[str, Channel], limit_ns: int | None
    ) -> Iterator[Observation]:
        first = next(iter(channels))
        newest: dict[str, tuple[int, bytes]] = {}
        heard_ns, due = time.monotonic_ns(), False
        slice_ns = SLICE_NS if limit_ns is None else min(SLICE_NS, limit_ns)
        try:
            while not self._closed:
                fresh = {n: v for n, c in channels.items() if (v := c.read()) is not None}
                newest |= fresh
                due = due or first in fresh
                if due and channels.keys() == newest.keys():
                    yield Observation({n: _reading(t, newest[n]) for n, t in wanted.items()})
                    heard_ns, due = time.monotonic_ns(), False
                elif limit_ns is not None and time.monotonic_ns() - heard_ns > limit_ns:
                    silent = next((n for n in wanted if n not in newest), first)
                    raise TimeoutError(f"nobody wrote `{silent}` for {limit_ns / SECOND_NS} s")
                else:
                    channels[first].wait(slice_ns)
        finally:
            for channel in channels.values():
                channel.close()

    # ------------------------------------------------------------ publishing

    def publish(
        self, topic: str, value: object, *, measured: int | None = None, clip: bool = False
    ) -> None:
        """Writes a value; ends a chunk that is being played on this topic.

        `measured` is the time of measurement behind the value, in ns on CLOCK_MONOTONIC (`stamp` of
        a `Reading`, `measured` of an `Observation`); default: now. `clip`: moves numbers outside of
        the topic's set to its ends. Raises SoterError U012 if the topic cannot take the value, or
        if it was measured in the future; nothing is written then.
        """
        t = self._topics.writable_topic(topic)
        image, writer = t.image(value, clip=clip), self._writer(t)
        now_ns = time.monotonic_ns()
        stamp = now_ns if measured is None else _past_time_ns(measured, now_ns)
        self._player.write_instead(t.name, partial(writer.write, stamp, image))

    def publish_chunk(
        self,
        topic: str,
        actions: Any,  # noqa: ANN401 - a sequence or array, an action a row
        *,
        every: float | str,
        start: int | None = None,
        measured: int | None = None,
        clip: bool = False,
    ) -> Chunk:
        """Writes `actions[k]` at `start + k every` in a thread; replaces a chunk.

        After the last action, or if `actions` is empty, the topic stays silent and its age grows.
        `start` is in ns on CLOCK_MONOTONIC, by default now; if it is the observation's time, late
        actions are left out. Action k is stamped with its time, or with `measured` if set. Raises
        SoterError as in `publish`, for any action: the chunk before then continues. The result's
        `slot(stamp)` is the k of a stamp, such as a stamp that the robot reports.
        """
        t = self._topics.writable_topic(topic)
        every_ns = _positive_ns("every", every)
        rows = actions.tolist() if hasattr(actions, "tolist") else actions
        if not isinstance(rows, (list, tuple)):
            message = (
                f"{t.name}: expected a sequence of actions, found a `{type(actions).__name__}`"
            )
            raise SoterError((Diagnostic("U012", message),))
        images = [t.image(a, clip=clip, path=f"{t.name} {k}") for k, a in enumerate(rows)]
        writer = self._writer(t)
        now_ns = time.monotonic_ns()
        stamp = None if measured is None else _past_time_ns(measured, now_ns)
        first_ns = now_ns if start is None else _time_ns("start", start)
        chunk = Chunk(images, first_ns, every_ns, stamp)
        self._player.begin_chunk(t.name, chunk, writer.write)
        return chunk

    # ------------------------------------------------------------ end

    def close(self) -> None:
        """Ends chunks and closes channels; written values stay, and grow old."""
        self._closed = True
        self._player.end_all()
        with self._lock:
            for channel in (*self._written.values(), *self._read.values()):
                channel.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # ------------------------------------------------------------ channels

    def _writer(self, t: Topic) -> Channel:
        with self._lock:
            if t.name not in self._written:
                self._written[t.name] = self._open_topic(t, writes=True)
            return self._written[t.name]

    def _open_topic(self, t: Topic, *, writes: bool) -> Channel:
        if self._closed:
            raise ValueError("the connection is closed")
        return Channel(self._folder, t.channel, t.number, t.size, writes=writes)


def _reading(t: Topic, newest: tuple[int, bytes]) -> Reading:
    stamp, image = newest
    return Reading(t.value(image), stamp, (time.monotonic_ns() - stamp) / SECOND_NS)


def _positive_ns(option: str, value: float | str) -> int:
    try:
        ns = duration_ns(value)
    except WrongTextError as error:
        message = f"`{option}` cannot be `{str(value)[:40]}`: {error}"
        raise SoterError((Diagnostic("U001", message),)) from error
    if ns <= 0:
        raise SoterError((Diagnostic("U001", f"`{option}` has to be longer than nothing"),))
    return ns


def _time_ns(option: str, value: object) -> int:
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        message = f"`{option}` is a time in ns as `time.monotonic_ns()` gives it, not {value!r}"
        raise SoterError((Diagnostic("U001", message),))
    return int(value.__index__())


def _past_time_ns(measured: object, now_ns: int) -> int:
    stamp = _time_ns("measured", measured)
    if stamp > now_ns or stamp < 0:
        late = f"{(stamp - now_ns) / SECOND_NS:.3f} s from now"
        message = f"nothing was measured {late}: times are those of `time.monotonic_ns()`"
        raise SoterError((Diagnostic("U012", message),))
    return stamp
