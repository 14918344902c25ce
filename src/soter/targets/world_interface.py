"""Writes how a program meets its world in real time: channels, leases, actuators.

Purpose: `WorldTables` has the tables by which the driver of `runtime/posix/` speaks with other
programs: a channel for each external topic, and one for the commands with leases of each module
with a fail-safe law; and the files of the actuators' program, `NAME_actuator`. Other programs learn
from `NAME_channels.h`, or from `channels.json` (`soter.remote`), of each topic its file, the number
of its layout, who writes it, how a value lies in memory and in which set it is.
Non-goals: the driver and the actuators (`runtime/posix/`), laws (`leases.py`), the
text of the tables (templates in `posix/`), channels of leases and of reports of the trusted part.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.codegen.c_names import field_name
from soter.core.layout import size_of
from soter.language.model.types import IntType, Type, leaves
from soter.native.shared_library import RUNTIME
from soter.targets import CHANNELS, CHANNELS_SCHEMA
from soter.targets.firmware_interface import described_type, short_topic_names
from soter.targets.late_limits import AgeLimit, age_limits
from soter.targets.leases import lease_names, lease_note, lease_times, modules_with_law
from soter.targets.package import PackageFile, filled_file

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.language.model.system import Bound, Module, System, Topic


FROM_OUTSIDE, HERE = "outside", "here"
OUTSIDE = ("soter_outside.h", "soter_outside.c")
ACTUATOR = ("soter_actuator.h", "soter_actuator.c", "soter_actuator_arm.c")
APP = ("soter_actuator_app.h", "soter_actuator_app.c")
STATUS_TEXT = ("soter_status_text.h", "soter_status_text.c")
"""Files by which the trusted part and the actuators report on themselves, and bridges, too."""
HEAD_BYTES = 24
"""Bytes of a command's head: its stamp, the end of its lease, and the latest begin with it."""


def _status_word_count(part: str) -> int:
    """How many words the trusted part's report has per module or lease, read from a C header."""
    header = (RUNTIME / "posix" / "soter_status.h").read_text(encoding="utf-8")
    return int(re.findall(rf"#define SOTER_STATUS_{part} (\d+)\n", header)[0])


def channel_document(system: System) -> dict[str, object]:
    """The content of `channels.json`: all topics with a channel; `set`: a pair a leaf, or None."""
    names = short_topic_names(system)
    return {
        "schema": CHANNELS_SCHEMA,
        "system": system.name,
        "topics": [
            {
                "name": t.name,
                "channel": names[t.index],
                "number": f"{topic_layout_number(t):#018x}",
                "published": FROM_OUTSIDE if t.driver == "input" else HERE,
                "max_age_ns": t.max_age_ns,
                "type": described_type(t.type),
                "set": [
                    _value_range(leaf, b)
                    for (_, leaf), b in zip(leaves(t.type), t.bounds, strict=True)
                ],
            }
            for t in _topics_with_channel(system)
        ],
    }


def channel_document_files(system: System) -> list[PackageFile]:
    """The file `channels.json`; no file if no topic has a channel."""
    document = channel_document(system)
    if not document["topics"]:
        return []
    return [PackageFile(CHANNELS, json.dumps(document, indent=1) + "\n")]


def topic_layout_number(topic: Topic) -> int:
    """The number that identifies the layout of a topic's value in the head of its channel."""
    return number_of_layout(described_type(topic.type))


def number_of_layout(layout: object) -> int:
    """The first 64 bits of the SHA-256 of a layout, which `described_type` gives."""
    text = json.dumps(layout, sort_keys=True, separators=(",", ":"))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


def lease_parts_taking_time(system: System, module: Module) -> list[str]:
    """The parts of a module's leases whose steps take time; any such part rules out leases."""
    of = {x.name: x for x in system.components}
    parts = [of[b.name] for b in lease_times(system, module).budgets]
    return [x.name for x in parts if x.held is not None]


def _topics_with_channel(system: System) -> list[Topic]:
    """The topics that meet the world, followed by the outputs of modules with leases."""
    by_lease = [
        i
        for m in modules_with_law(system)
        if not lease_parts_taking_time(system, m)
        for i in m.outputs
    ]
    outside = [e.topic for e in system.externals if e.topic not in by_lease]
    return [system.topics[i] for i in dict.fromkeys((*outside, *by_lease))]


def _value_range(t: Type, bound: Bound | None) -> list[float] | None:
    """The least and greatest value of a number, also limited by its type; None without bounds."""
    if not isinstance(t, IntType):
        return None if bound is None else [bound.low, bound.high]
    if bound is None:
        return [t.low, t.high]
    return [max(t.low, bound.low), min(t.high, bound.high)]


@dataclass(frozen=True)
class CommandedTopic:
    """An output of a module, with its field in the command and its member among the C topics."""

    topic: Topic
    field: str
    member: str


@dataclass(frozen=True)
class LeasedModule:
    """A module with a fail-safe law: its channel, and the components that its grant watches."""

    module: Module
    name: str
    """The beginning of its C names."""
    short: str
    """`name` without the program's prefix."""
    components: tuple[int, ...]
    ages: tuple[AgeLimit, ...]
    outputs: tuple[CommandedTopic, ...]
    head_bytes = HEAD_BYTES

    @property
    def channel(self) -> str:
        """The name of the channel for the module's commands, which differs from all topic names."""
        return f"{self.short}.lease"

    @property
    def number(self) -> int:
        """The number that identifies the layout of the channel's messages."""
        types = [described_type(o.topic.type) for o in self.outputs]
        return number_of_layout({"lease": self.channel, "head": HEAD_BYTES, "of": types})

    @property
    def message_words(self) -> int:
        """How many 8-byte words a message has; every output begins at a word."""
        return word_count(HEAD_BYTES) + sum(word_count(size_of(o.topic.type)) for o in self.outputs)


class WorldTables:
    """The tables of a system that meets the world; `unit` is the system's C."""

    def __init__(self, system: System, unit: Unit) -> None:
        self.system = system
        self.unit = unit
        self.names = short_topic_names(system)
        self.lease_names = lease_names(system, unit.prefix)
        self.granted: list[LeasedModule] = []
        self.notes: list[str] = []
        for module in modules_with_law(system):
            self._add_lease_of_module(module)
        by_lease = {i for g in self.granted for i in g.module.outputs}
        self.topics = [system.topics[e.topic] for e in system.externals if e.topic not in by_lease]

    def _add_lease_of_module(self, module: Module) -> None:
        times = lease_times(self.system, module)
        index = {x.name: x.index for x in self.system.components}
        if slow := lease_parts_taking_time(self.system, module):
            self.notes.append(
                f"{module.name}: no leases in real time: a step of {', '.join(slow)} takes time"
            )
            return
        name = self.lease_names[module.index]
        granted = LeasedModule(
            module,
            name,
            name.removeprefix(f"{self.unit.prefix}_"),
            tuple(index[b.name] for b in times.budgets),
            age_limits(self.system, module),
            tuple(self._commanded_topic(self.system.topics[i]) for i in module.outputs),
        )
        self.granted.append(granted)
        self.notes.append(lease_note(module, times))

    def _commanded_topic(self, t: Topic) -> CommandedTopic:
        name = field_name(t.symbol.name.rpartition(".")[2])
        return CommandedTopic(t, name, self.unit.topics[t.index][1])

    # ------------------------------------------------------------ the driver's side

    @property
    def value_words(self) -> int:
        """How many 8-byte words the longest exchanged value has."""
        topics = (word_count(size_of(t.type)) for t in self.topics)
        return max([1, self.message_words, *topics])

    @property
    def message_words(self) -> int:
        """How many 8-byte words the longest message with a lease has."""
        return max((g.message_words for g in self.granted), default=0)

    @property
    def most_watched(self) -> int:
        """The largest number of components (DM, SC and nodes of a module) that a grant watches."""
        return max([1, *(len(g.components) for g in self.granted)])

    @property
    def moves_plants(self) -> bool:
        """Whether the system has plants, so that commands must return into the state."""
        return any(x.plant is not None for x in self.system.components)

    number = staticmethod(topic_layout_number)

    @property
    def status_number(self) -> int:
        """The number that identifies the layout of the trusted part's report."""
        modules = [m.name for m in self.system.modules]
        leases = [g.module.name for g in self.granted]
        return number_of_layout(
            {
                "status": [modules, leases, [self.names[t.index] for t in self.topics]],
                "words of a module": _status_word_count("MODULE"),
                "words of a lease": _status_word_count("LEASE"),
            }
        )

    @property
    def actuators_number(self) -> int:
        """The number that identifies the layout of the actuators' report."""
        return number_of_layout({"actuators": [g.module.name for g in self.granted]})

    def is_awaited(self, t: Topic) -> bool:
        """Whether the start waits for a topic: one that comes in, and that not only ACs read.

        An acknowledgement alone is not awaited: without one SC keeps control.
        """
        readers = {
            x.role for x in self.system.components if x.node is not None and t.index in x.reads
        }
        of_dms = any(t.index in m.inputs for m in self.system.modules)
        acknowledges = any(t.index == m.acknowledgement for m in self.system.modules)
        unasked = readers == {"ac"} or (acknowledges and readers <= {"ac"})
        return t.driver == "input" and (of_dms or not unasked)

    # ------------------------------------------------------------ the actuators

    def actuator_files(self) -> list[PackageFile]:
        """The files of the actuator program; no files if no module has a lease."""
        if not self.granted:
            return []
        files = (self._filled_file(n, n) for n in APP)
        return [*files, replace(self._filled_file("actuate.c", "actuate.c"), yours=True)]

    def _filled_file(self, path: str, template: str) -> PackageFile:
        of = {"world": self, "system": self.system, "prefix": self.unit.prefix}
        return filled_file(path, f"posix/{template}", **of)

    def actuator_sources(self) -> list[str]:
        """The C files of the actuator program."""
        law = f"{self.unit.prefix}_lease.c"
        return [
            *(n for n in (*ACTUATOR, *OUTSIDE, *STATUS_TEXT) if n.endswith(".c")),
            *(APP[1], "actuate.c", "soter_lease.c", law, "soter_channel.c", "soter_process.c"),
        ]

    # ------------------------------------------------------------ the other side

    @property
    def topics_with_channel(self) -> list[Topic]:
        """The topics that other programs publish or read."""
        topics = {t.index: t for t in self.topics}
        topics |= {o.topic.index: o.topic for g in self.granted for o in g.outputs}
        return [*topics.values()]

    def channel_files(self) -> list[PackageFile]:
        """The C header for other programs; no file if no topic has a channel."""
        name = f"{self.unit.prefix}_channels.h"
        return [self._filled_file(name, "channels.h")] if self.topics_with_channel else []


def word_count(size: int) -> int:
    """How many words of 8 bytes hold `size` bytes."""
    return (size + 7) // 8
