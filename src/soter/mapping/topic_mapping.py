"""What a mapping says of the topics of a program: one file, read by `monitor` and by targets.

Purpose: `LogMap` and `TopicMap`, the records behind `--map`. Who reads them knows only leaves:
units, frames and vectors are factors and signs here. For a topic with several sources,
`SourcePromise` is what each promises, and `SourceTurns` the rule by which one of them is read,
which is that of `runtime/bridge/soter_sources.hpp`.
Non-goals: reading the file (`read_mapping.py`), the values of a log (`monitor/typed_samples.py`);
what a deploying system declares, and whether promises of sources fit (`targets/`).

The rule, of stamps in the order of arrival (docs/mapping.md, "Several sources", has the reason and
the bound): a sample has its turn if it was measured more than `after` later than the newest sample
that had a turn among the sources before its own; in its turn it is taken if it is newer than all
that was taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.system import Topic
    from soter.language.model.types import Value
    from soter.mapping.mavlink_dialects import MavlinkLink
    from soter.mapping.message_types import MessageType, StampSource


@dataclass(frozen=True)
class SourcePromise:
    """What a source promises, times in ns, and when it takes over.

    While it works it measures at least every `every_ns`, and a sample is there at most `delayed_ns`
    after it was measured. `errors`: how far a float leaf may be off, in the topic's unit; a leaf
    that is not there has none. `after_ns`: by how much its samples have to be younger than those of
    the sources before it; of the first source (`rank` 0) 0, which nothing asks for.
    """

    rank: int
    every_ns: int
    delayed_ns: int = 0
    errors: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    after_ns: int = 0

    @property
    def alone_ns(self) -> int:
        """Gives how old its newest sample may be, by `every_ns` and `delayed_ns`."""
        return self.every_ns + self.delayed_ns

    @property
    def oldest_ns(self) -> int:
        """Gives how old the topic may get while this source works, whatever others do."""
        return self.after_ns + self.alone_ns


class SourceTurns:
    """Decides which samples of several sources are taken; `after_ns`: of each source, by rank."""

    def __init__(self, after_ns: Sequence[int]) -> None:
        self.after_ns = tuple(after_ns)
        self.newest: list[int | None] = [None] * len(self.after_ns)
        """For each source the stamp of its newest sample whose turn it was."""

    def judge(self, rank: int, stamp_ns: int) -> Literal["taken", "waits", "older"]:
        """Gives what becomes of a sample of source `rank` that was measured at `stamp_ns`.

        `waits`: it is not its turn; `older`: it is, and something as new was taken before.
        """
        before = [s for s in self.newest[:rank] if s is not None]
        if before and stamp_ns <= max(before) + self.after_ns[rank]:
            return "waits"
        taken = max((s for s in self.newest if s is not None), default=None)
        newest = self.newest[rank]
        self.newest[rank] = stamp_ns if newest is None else max(newest, stamp_ns)
        return "taken" if taken is None or stamp_ns > taken else "older"


GAP_NS = 10**9
"""Between samples further apart nothing is interpolated, unless the mapping says otherwise."""

LOG_TIME, PUBLISH_TIME = "log_time", "publish_time"
"""Times that a log has of every message, as MCAP calls them."""

LeafPath = tuple[str, ...]


@dataclass(frozen=True)
class SignalSource:
    """`scale` * what stands in the column or field `name` + `offset`.

    Of a topic that goes out the field is (leaf - `offset`) / `scale`. `assumed_unit`: the one that
    the program declares, where nobody says the field's. `turn`: a whole one, of an angle.
    """

    name: str
    scale: float = 1.0
    offset: float = 0.0
    assumed_unit: str = field(default="", compare=False)
    turn: float = field(default=math.inf, compare=False)


@dataclass(frozen=True)
class ConstantSource:
    """A value that no message holds and that the mapping takes to be this."""

    value: Value


@dataclass(frozen=True)
class SlopeSource:
    """How fast another field of the topic changes, over the window that ends at each sample."""

    of: LeafPath
    window_ns: int


@dataclass(frozen=True)
class NearestSource:
    """How far away the nearest thing in a sensor_msgs/LaserScan is, or in which direction.

    `most`: what is farther counts as so far. `unseen`: so many rays in a row may have measured
    nothing; a message with more is not taken.
    """

    what: Literal["distance", "bearing"]
    most: float
    unseen: int


Leaf = SignalSource | ConstantSource | SlopeSource | NearestSource


@dataclass(frozen=True)
class QualityOfService:
    """How messages of a topic go, as a mapping says; None: by the middleware's convention.

    `depth`: of the history, 0 for all of it.
    """

    reliability: Literal["best_effort", "reliable"] | None = None
    durability: Literal["volatile", "transient_local"] | None = None
    depth: int | None = None


@dataclass(frozen=True)
class TopicMap:
    """A topic and where its leaves come from, or go, all of them, in declared order.

    `channel`: whose messages of a bag or an MCAP, or the topic of a middleware; of a CSV nothing.
    `linear`: floats go on along the line through the last two samples, for at most `gap_ns`.
    `message`: the type of its messages, where the mapping says. `stamp`: None counts ages from
    `delay_ns` before arrival, the longest that a message may have been on its way. `frame_id`:
    messages whose `header.frame_id` differs are not taken. `publisher`: the node that may publish,
    as written. `constants`: fields of a message that goes out, by path. `qos`: of a topic of DDS;
    others have none. `promise`: of one of several sources of the topic. `where`: rows of a log are
    its own where these columns, or fields, hold these texts. `clip`: who receives them clips them.
    """

    topic: Topic
    leaves: dict[LeafPath, Leaf]
    channel: str | None = None
    linear: bool = False
    gap_ns: int = GAP_NS
    message: MessageType | None = None
    stamp: StampSource | None = None
    delay_ns: int = 0
    frame_id: str | None = None
    publisher: str | None = None
    constants: Mapping[str, object] = field(default_factory=dict)
    qos: QualityOfService = QualityOfService()
    promise: SourcePromise | None = None
    where: Mapping[str, str] = field(default_factory=dict)
    clip: bool = False

    @property
    def names(self) -> list[str]:
        """Gives the columns or fields that the topic needs."""
        return list(
            dict.fromkeys(x.name for x in self.leaves.values() if isinstance(x, SignalSource))
        )

    @property
    def optional(self) -> frozenset[str]:
        """Gives those of `names` that are in a list of any length, and so may be absent."""
        message = self.message
        if message is None:
            return frozenset()
        return frozenset(n for n in self.names if message.field(n).through == "sequence")

    @property
    def assumed_units(self) -> list[str]:
        """Gives leaves in words, with the unit that is assumed because nobody says one."""
        return [
            f"`{self.name_of(p)}` in `{x.assumed_unit}`"
            for p, x in self.leaves.items()
            if isinstance(x, SignalSource) and x.assumed_unit
        ]

    def name_of(self, path: LeafPath) -> str:
        """Gives a leaf as people write it."""
        return ".".join((self.topic.name, *path))


@dataclass(frozen=True)
class LogMap:
    """A mapping that fits its system.

    `topics`: several that follow each other and are one topic are its sources, the preferred first.
    `time`: the column or field of time, LOG_TIME or PUBLISH_TIME, None for the log time of
    messages; `time_ns`: its unit. `where`: rows count where these columns hold these texts, and
    from `since_ns` to `until_ns` of the log's own time. `mavlink`: the link to an autopilot.
    """

    topics: tuple[TopicMap, ...]
    time: str | None = None
    time_ns: Fraction = Fraction(10**9)
    where: dict[str, str] = field(default_factory=dict)
    mavlink: MavlinkLink | None = None
    since_ns: int | None = None
    until_ns: int | None = None

    def counts(self, time_ns: int) -> bool:
        """Whether a value that was logged at `time_ns` lies in the chosen part of the log."""
        early = self.since_ns is not None and time_ns < self.since_ns
        return not early and (self.until_ns is None or time_ns <= self.until_ns)
