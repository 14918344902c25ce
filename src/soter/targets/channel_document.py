"""`channels.json`: the channels of a system, for programs that are no C.

Purpose: topic by topic the name of its file, the number of its layout, who writes it, how a value
lies in memory and in which set it is: what `NAME_channels.h` says in C. `soter.remote` reads it.
Non-goals: channels of leases and of what the trusted part says of itself, which are the actuators'.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

from soter.language.model.types import IntType, leaves
from soter.targets.firmware import described, topic_names
from soter.targets.leases_and_lateness import lease_times, leased
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from soter.language.model.system import Bound, Module, System, Topic
    from soter.language.model.types import Type

CHANNELS = "channels.json"
SCHEMA = 1
OUTSIDE, HERE = "outside", "here"


def channel_document(system: System) -> dict[str, object]:
    """All channels of topics; `set` has a pair for each leaf of the type, or None."""
    names = topic_names(system)
    return {
        "schema": SCHEMA,
        "system": system.name,
        "topics": [
            {
                "name": t.name,
                "channel": names[t.index],
                "number": f"{layout_number(t):#018x}",
                "published": OUTSIDE if t.driver == "input" else HERE,
                "max_age_ns": t.max_age_ns,
                "type": described(t.type),
                "set": [
                    _ends(leaf, b) for (_, leaf), b in zip(leaves(t.type), t.bounds, strict=True)
                ],
            }
            for t in _topics(system)
        ],
    }


def channel_document_files(system: System) -> list[PackageFile]:
    """The file; none where nothing is open."""
    document = channel_document(system)
    if not document["topics"]:
        return []
    return [PackageFile(CHANNELS, json.dumps(document, indent=1) + "\n")]


def layout_number(topic: Topic) -> int:
    """Of the layout of a topic's value: what the head of its channel says."""
    return number_of_layout(described(topic.type))


def number_of_layout(what: object) -> int:
    """64 bits of the SHA-256 of what `described` says."""
    text = json.dumps(what, sort_keys=True, separators=(",", ":"))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


def lasting(system: System, module: Module) -> list[str]:
    """Parts that a module's leases wait for and whose steps take time: it has no leases then."""
    of = {x.name: x for x in system.components}
    parts = [of[b.name] for b in lease_times(system, module).budgets]
    return [x.name for x in parts if x.held is not None]


def _topics(system: System) -> list[Topic]:
    """Those of the world, then outputs that are given with a lease."""
    by_lease = [i for m in leased(system) if not lasting(system, m) for i in m.outputs]
    outside = [e.topic for e in system.externals if e.topic not in by_lease]
    return [system.topics[i] for i in dict.fromkeys((*outside, *by_lease))]


def _ends(t: Type, bound: Bound | None) -> list[float] | None:
    """The least and the greatest value of a number, its type's range included."""
    if not isinstance(t, IntType):
        return None if bound is None else [bound.low, bound.high]
    if bound is None:
        return [t.low, t.high]
    return [max(t.low, bound.low), min(t.high, bound.high)]
