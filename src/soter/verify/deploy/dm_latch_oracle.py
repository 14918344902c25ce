"""The latch of a decision module, for its check.

Purpose: all that it may remember, with every class of press; what a look has to make of it,
written down here anew from docs/semantics.md (The latch); and where it lies in a state.
Non-goals: trying it (`dm_check.py`).
"""

from __future__ import annotations

import itertools
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from soter.verify.deploy.dm_test_inputs import AC

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System

NEVER = -(2**62)
WAITS, READY, ACKNOWLEDGED = range(3)
Held = tuple[int, int]
"""What it remembers: the value and the stamp of the topic that holds it."""


class Seen(NamedTuple):
    """What a DM finds: what it remembers, and the button with the time of its publication, ns."""

    held: Held
    pressed: bool = False
    stamp: int = NEVER


@dataclass(frozen=True)
class LatchBytes:
    """The latch of a module in a state: offsets in bytes; `button` None: `returns never`."""

    value: int
    since: int
    button: int | None
    stamp: int
    max_age: int

    @classmethod
    def of(cls, system: System, layout: StateLayout, module: Module) -> LatchBytes | None:
        """None where it has none."""
        if module.latch is None:
            return None
        button = module.acknowledgement
        return cls(
            layout.topic_offset(module.latch),
            layout.stamp_offset + 8 * module.latch,
            None if button is None else layout.topic_offset(button),
            0 if button is None else layout.stamp_offset + 8 * button,
            0 if button is None else system.topics[button].max_age_ns or 0,
        )

    def release(self, state: bytearray) -> None:
        """Nothing is in the way of AC: acknowledged now, or AC has never had control."""
        now = struct.unpack_from("<q", state, 0)[0]
        held = (0, NEVER) if self.button is None else (ACKNOWLEDGED, now)
        self.put(state, Seen(held))

    def put(self, state: bytearray, seen: Seen) -> None:
        """Write what a look finds."""
        struct.pack_into("<b", state, self.value, seen.held[0])
        struct.pack_into("<q", state, self.since, seen.held[1])
        if self.button is not None:
            struct.pack_into("<?", state, self.button, seen.pressed)
            struct.pack_into("<q", state, self.stamp, seen.stamp)

    def remembered(self, state: bytearray) -> Held:
        """What the DM has written."""
        value = struct.unpack_from("<b", state, self.value)[0]
        return int(value), int(struct.unpack_from("<q", state, self.since)[0])

    def every(self, now: int) -> Iterator[Seen]:
        """Every value, with every order of the times, and ages around the limit."""
        if self.button is None:
            yield from (Seen((value, NEVER)) for value in (0, 1))
            return
        ages = dict.fromkeys((0, 1, self.max_age, self.max_age + 1, 2 * self.max_age + 2))
        times = (NEVER, *(now - age for age in ages))
        for value, since, stamp in itertools.product((WAITS, READY, ACKNOWLEDGED), times, times):
            for pressed in (False, True):
                yield Seen((value, since), pressed, stamp)

    def looked(self, seen: Seen, now: int) -> tuple[Held, bool]:
        """What is remembered after a look in SC, and whether it lets AC have control."""
        value, since = seen.held
        if self.button is None:
            return seen.held, value == 0
        since = now if since == NEVER else since
        if value == ACKNOWLEDGED and now - since > self.max_age:
            value = WAITS
        new, old = seen.stamp > since, now - seen.stamp > self.max_age
        if new and value == WAITS and not seen.pressed:
            return (READY, seen.stamp), False
        if new and value == READY and seen.pressed:
            return (WAITS if old else ACKNOWLEDGED, seen.stamp), not old
        return (value, since), value == ACKNOWLEDGED

    def switched(self, mode: int, now: int) -> Held:
        """What is remembered after a switch to this mode."""
        if self.button is None:
            return 1, NEVER
        return WAITS, NEVER if mode == AC else now
