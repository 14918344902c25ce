"""Finds the stale reads of a decision module, and why they were stale.

Purpose: `stale_reads` names each topic that a step of a DM found older than its `max_age`, or of
another instant than one that it reads together with it.
Non-goals: whether a step was stale, as its DM notes (`semantics/rules.py`, `codegen/decisions.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.read_together import allowed_stamp_differences
from soter.semantics.configuration import NEVER

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Module, System


@dataclass(frozen=True)
class Stale:
    """A topic that was too old for a DM step; `age_s` is None if it was never published.

    `beside`: a topic of a later instant that was read with it; "" if it exceeds `max_age` itself.
    """

    topic: str
    age_s: float | None
    max_age_s: float
    beside: str = ""

    def __str__(self) -> str:
        age = "never published" if self.age_s is None else f"{self.age_s:.6g} s old"
        if self.beside:
            return f"{self.topic} is {age}, and {self.beside} is of another instant"
        return f"{self.topic} is {age}, max_age {self.max_age_s:.6g} s"


def stale_reads(
    system: System, module: Module, stamps: Sequence[int], time_ns: int
) -> Iterator[Stale]:
    """Yields the topics that a DM step at `time_ns` finds stale; `stamps` has all stamps in ns."""

    def stale_topic(index: int, max_age_ns: int, beside: str = "") -> Stale:
        age_s = None if stamps[index] == NEVER else (time_ns - stamps[index]) / 1e9
        return Stale(system.topics[index].name, age_s, max_age_ns / 1e9, beside)

    ages = {i: system.topics[i].max_age_ns for i in module.inputs}
    limits = {i: most for i, most in ages.items() if most is not None}
    old = {i for i, most in limits.items() if time_ns - stamps[i] > most}
    yield from (stale_topic(i, limits[i]) for i in limits if i in old)
    for one, other, most in allowed_stamp_differences(system, module.inputs):
        older, newer = sorted((one, other), key=lambda i: stamps[i])
        if older not in old and stamps[newer] - stamps[older] > most:
            old.add(older)
            yield stale_topic(older, limits[older], system.topics[newer].name)
