"""A configuration: the paper's (L, OE, ct, FN, Topics).

Purpose: the whole state of a system as one immutable value: a rule makes a new one, so whoever
searches forks by keeping the old one.
Non-goals: what observers want to count (`record.py`), the bytes of a state (`core/layout.py`),
the hidden state of externs, which lives with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.language.model.types import Value

NEVER = -(2**62)
"""The stamp of a topic before its first publication; of a queue, always but for `LOST`."""

LOST = 0
"""The stamp of a queue with the policy `fault` that was full: its reader will fault."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """(L, OE, ct, FN, Topics) and what the gate and the timing rulings need.

    Indices are those of `System.components`, `.topics` and `.modules`.
    """

    L: tuple[Value, ...]
    """Per component: a node's locals, a plant's states (tuples), a DM's mode (of type MODE)."""
    OE: tuple[bool, ...]
    """Per component: whether its outputs are enabled. Only those of an AC and an SC change."""
    ct: int
    """The current time in ns; -1 before the first instant."""
    FN: tuple[int, ...]
    """Components that still have to fire at `ct`: a set, written in deployed order."""
    Topics: tuple[Value, ...]
    """The globally visible value of every topic."""
    stamps: tuple[int, ...]
    """Per topic: `ct` of its last publication, NEVER before the first."""
    latched: tuple[bool, ...]
    """Per component: trusted and faulted once; it only repeats its fail-safe values."""
    had_control: tuple[bool, ...]
    """Per component: OE at its last completed step (for `on takeover`)."""
    gate_fault: tuple[bool, ...]
    """Per module: the AC faulted while in control, and the DM has not seen it yet."""
    clean_needed: tuple[int, ...]
    """Per module: complete outputs the AC still owes before it may have control."""


def put(values: tuple[Value, ...], index: int, value: Value) -> tuple[Value, ...]:
    """`values[index -> value]`."""
    return (*values[:index], value, *values[index + 1 :])
