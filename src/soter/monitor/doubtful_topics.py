"""Names the measured topics of a log that are in doubt; none is an error.

Purpose: `doubt_notes` tells of topics that repeat one value to their end, and of a pace of samples
so unlike the program's that the unit of their time is in doubt.
Non-goals: topics that fell silent (`topics_heard.py`).
"""

from __future__ import annotations

from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING

from soter.language.elaborate.passes.read_ages import PUBLICATIONS, is_measured, least_age_ns
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import System
    from soter.monitor.typed_samples import TopicSamples


STUCK, STUCK_SHARE = 20, 0.1
"""How many last samples, and which share of all, must be one value for a note of doubt."""
ANOTHER_PACE = 300.0
"""A pace that differs by this factor is in doubt: units of time differ by 1,000, rates less."""


def doubt_notes(system: System, samples: Iterable[TopicSamples]) -> list[str]:
    """Sentences for people about the doubtful topics of a log."""
    texts = []
    for s in samples:
        if not s.is_constant and is_measured(system, s.topic.index):
            texts += [text for text in (_stuck_note(s), _pace_note(system, s)) if text]
    return texts


def _stuck_note(s: TopicSamples) -> str:
    count, last = 0, s.values[-1]
    for value in reversed(s.values):
        if value != last:
            break
        count += 1
    if count < max(STUCK, STUCK_SHARE * len(s.values)):
        return ""
    first_s = s.times_ns[-count] / 1e9
    return (
        f"the last {count:,} of {len(s.values):,} samples of `{s.topic.name}` are one value, from "
        f"{first_s:.3f} s on: it stood still, or what measured it was stuck"
    )


def _pace_note(system: System, s: TopicSamples) -> str:
    gaps = [b - a for a, b in pairwise(s.times_ns) if b > a]
    least_ns = least_age_ns(system, s.topic.index)
    if not gaps or least_ns is None:
        return ""
    here, announced = median(gaps), least_ns / PUBLICATIONS
    if 1.0 / ANOTHER_PACE < here / announced < ANOTHER_PACE:
        return ""
    return (
        f"samples of `{s.topic.name}` come every {show_ns(round(here))}, those of the program "
        f"every {show_ns(round(announced))}: is `unit` of `time` right?"
    )
