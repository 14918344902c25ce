"""What a mapping says of the topics of a program: one file, read by `monitor` and by targets.

Purpose: the records behind `--map`. Whoever reads them knows only leaves: units, frames and vectors
are factors and signs here.
Non-goals: reading the file (`read_mapping.py`), the values of a log (`monitor/logs/`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Topic
    from soter.language.model.types import Value
    from soter.mapping.mavlink_link import MavlinkLink
    from soter.mapping.message_types import MessageType
    from soter.mapping.stamp_source import StampSource
    from soter.mapping.topic_sources import SourcePromise

GAP_NS = 10**9
"""Between samples further apart nothing is interpolated, unless the mapping says otherwise."""

LOG_TIME, PUBLISH_TIME = "log_time", "publish_time"
"""Times that a log has of every message, as MCAP calls them."""

LeafPath = tuple[str, ...]


@dataclass(frozen=True)
class SignalSource:
    """`scale` * what stands in the column or field `name` + `offset`.

    Of a topic that goes out the field is (leaf - `offset`) / `scale`. `assumed_unit`: the one that
    the program declares, where nobody says the field's.
    """

    name: str
    scale: float = 1.0
    offset: float = 0.0
    assumed_unit: str = field(default="", compare=False)


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
    """Of a sensor_msgs/LaserScan: how far away what is nearest is, or in which direction.

    `most`: what is farther counts as so far. `unseen`: so many rays in a row may have measured
    nothing; a message with more is not taken.
    """

    what: Literal["distance", "bearing"]
    most: float
    unseen: int


Leaf = SignalSource | ConstantSource | SlopeSource | NearestSource


@dataclass(frozen=True)
class QualityOfService:
    """What a mapping says of how messages go; None is what the middleware's convention is.

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
    its own where these columns, or fields, hold these texts.
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

    @property
    def names(self) -> list[str]:
        """The columns or fields that it needs."""
        return list(
            dict.fromkeys(x.name for x in self.leaves.values() if isinstance(x, SignalSource))
        )

    @property
    def optional(self) -> frozenset[str]:
        """Of `names`, those that go through a list of any length: they may be absent."""
        message = self.message
        if message is None:
            return frozenset()
        return frozenset(n for n in self.names if message.field(n).through == "sequence")

    @property
    def assumed_units(self) -> list[str]:
        """The leaves that are taken to be in the program's unit, as people write them."""
        return [
            f"`{self.name_of(p)}` in `{x.assumed_unit}`"
            for p, x in self.leaves.items()
            if isinstance(x, SignalSource) and x.assumed_unit
        ]

    def name_of(self, path: LeafPath) -> str:
        """A leaf as people write it."""
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
        """Whether what was logged at a time is a part of what was chosen."""
        early = self.since_ns is not None and time_ns < self.since_ns
        return not early and (self.until_ns is None or time_ns <= self.until_ns)
