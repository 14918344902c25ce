"""The records of a mapping of a program's topics, which `monitor` and the targets read.

Purpose: `LogMap` and `TopicMap` are the records behind `--map`. They know only leaves: units,
frames and vectors have become factors and signs. For a topic with several sources, a
`SourcePromise` is what one source promises, and `SourceTurns` the rule that chooses the source to
read; `runtime/bridge/soter_sources.hpp` has the same rule.
Non-goals: reading the file (`read_mapping.py`); the values of a log (`monitor/typed_samples.py`);
what a deployed system declares, and whether promises of sources fit (`targets/`).

The rule compares stamps in order of arrival; docs/mapping.md, "Several sources", has its reason
and its bound. A sample has its turn if it was measured more than `after` later than the newest
sample that had a turn among the sources before its own. A sample that has its turn is taken if it
is newer than every sample that was taken.
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
    """The promise of one source of a topic, and when the source takes over; times in ns.

    While a source works, it measures at least every `every_ns`, and its samples arrive at most
    `delayed_ns` after their measurement. `errors` has the greatest error of float leaves, in the
    topic's unit. A sample is taken only if it is by more than `after_ns` newer than all samples of
    the sources before it (not used for the first source, `rank` 0).
    """

    rank: int
    every_ns: int
    delayed_ns: int = 0
    errors: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    after_ns: int = 0

    @property
    def own_age_max_ns(self) -> int:
        """Gives the greatest age of its newest sample while it works: `every_ns` + `delayed_ns`."""
        return self.every_ns + self.delayed_ns

    @property
    def age_max_ns(self) -> int:
        """Gives the greatest age of the topic while this source works, even if no other does."""
        return self.after_ns + self.own_age_max_ns


class SourceTurns:
    """Decides which samples of several sources are taken, by an `after_ns` for each rank."""

    def __init__(self, after_ns: Sequence[int]) -> None:
        self.after_ns = tuple(after_ns)
        self.newest: list[int | None] = [None] * len(self.after_ns)
        """For each source the stamp of its newest sample that had a turn; None before the first."""

    def judge(self, rank: int, stamp_ns: int) -> Literal["taken", "waits", "older"]:
        """Decides whether a sample of source `rank`, measured at `stamp_ns`, is taken.

        `waits`: it is not the source's turn. `older`: a sample as new or newer was taken before.
        """
        before = [s for s in self.newest[:rank] if s is not None]
        if before and stamp_ns <= max(before) + self.after_ns[rank]:
            return "waits"
        taken = max((s for s in self.newest if s is not None), default=None)
        newest = self.newest[rank]
        self.newest[rank] = stamp_ns if newest is None else max(newest, stamp_ns)
        return "taken" if taken is None or stamp_ns > taken else "older"


GAP_NS = 10**9
"""The longest gap between samples that is interpolated, unless the mapping says another."""

LOG_TIME, PUBLISH_TIME = "log_time", "publish_time"
"""The two times that a log has for each message, by their names in MCAP."""

LeafPath = tuple[str, ...]


@dataclass(frozen=True)
class SignalSource:
    """A leaf that is `scale` * the value of the column or field `name` + `offset`.

    For a topic that is sent, the field is (leaf - `offset`) / `scale`. `assumed_unit` is the unit
    in the program if the field's unit is unknown. `turn` is a full turn in the leaf's unit.
    """

    name: str
    scale: float = 1.0
    offset: float = 0.0
    assumed_unit: str = field(default="", compare=False)
    turn: float = field(default=math.inf, compare=False)


@dataclass(frozen=True)
class ConstantSource:
    """A leaf that no message holds: the mapping gives it this constant value."""

    value: Value


@dataclass(frozen=True)
class SlopeSource:
    """A leaf that is the rate of change of leaf `of`, over the window that ends at each sample."""

    of: LeafPath
    window_ns: int


@dataclass(frozen=True)
class NearestSource:
    """A leaf with the distance or bearing of the nearest object in a sensor_msgs/LaserScan.

    Objects farther than `most` count as this far. `unseen` is how many neighbouring rays may have
    measured nothing; messages with more are not taken.
    """

    quantity: Literal["distance", "bearing"]
    most: float
    unseen: int


Leaf = SignalSource | ConstantSource | SlopeSource | NearestSource


@dataclass(frozen=True)
class QualityOfService:
    """The quality of service of a topic in DDS; None means the default of the middleware.

    `depth` is the number of messages that the history keeps, 0 for all.
    """

    reliability: Literal["best_effort", "reliable"] | None = None
    durability: Literal["volatile", "transient_local"] | None = None
    depth: int | None = None


@dataclass(frozen=True)
class TopicMap:
    """A topic with the sources of all its leaves, or their targets, in declared order.

    `channel`: the channel of a bag or an MCAP, or the topic of a middleware; None for a CSV.
    `linear`: floats continue along the line through the last two samples, for at most `gap_ns`.
    `message`: the message type, or None. If `stamp` is None, ages count from `delay_ns` before
    arrival, the longest time that a message may take. `frame_id`: messages with another
    `header.frame_id` are not taken. `publisher`: the only node that may publish. `constants`:
    constant fields of a sent message, by path. `qos`: only for DDS. `promise`: only for one of
    several sources. `where`: rows of a log belong to the topic if these columns or fields hold
    these texts. `clip`: the receiver clips the values.
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
        """Gives the names of the columns or fields that the leaves are read from."""
        return list(
            dict.fromkeys(x.name for x in self.leaves.values() if isinstance(x, SignalSource))
        )

    @property
    def optional(self) -> frozenset[str]:
        """Gives the `names` whose fields lie in a list of any length, and so may be absent."""
        message = self.message
        if message is None:
            return frozenset()
        return frozenset(n for n in self.names if message.field_at(n).through == "sequence")

    @property
    def assumed_units(self) -> list[str]:
        """Gives a text for each leaf whose unit is assumed: neither field nor mapping names one."""
        return [
            f"`{self.leaf_name(p)}` in `{x.assumed_unit}`"
            for p, x in self.leaves.items()
            if isinstance(x, SignalSource) and x.assumed_unit
        ]

    def leaf_name(self, path: LeafPath) -> str:
        """Gives the dotted name of a leaf: the topic's name, then the leaf's path."""
        return ".".join((self.topic.name, *path))


@dataclass(frozen=True)
class LogMap:
    """A mapping that was checked against its system.

    `topics`: consecutive records of the same topic are its sources, the preferred source first.
    `time`: the column or field with the time, LOG_TIME or PUBLISH_TIME; None for messages' log
    time. `time_ns`: the unit of time. A row counts only if the columns in `where` hold these texts,
    and if its time is from `since_ns` to `until_ns`. `mavlink`: the link to an autopilot.
    """

    topics: tuple[TopicMap, ...]
    time: str | None = None
    time_ns: Fraction = Fraction(10**9)
    where: dict[str, str] = field(default_factory=dict)
    mavlink: MavlinkLink | None = None
    since_ns: int | None = None
    until_ns: int | None = None

    def covers(self, time_ns: int) -> bool:
        """Whether a time of the log lies in its chosen part, `since_ns` to `until_ns`."""
        early = self.since_ns is not None and time_ns < self.since_ns
        return not early and (self.until_ns is None or time_ns <= self.until_ns)
