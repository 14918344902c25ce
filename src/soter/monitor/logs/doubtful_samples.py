"""What of the samples of a log may be no measurement, or at another pace than they say.

Purpose: measured topics that repeat one value to their end, and samples so much more often or more
rarely than the program's that the unit of their time is in doubt: told, and no error.
Non-goals: stamps against the log's clock (`typed_samples.py`), silence (`silent_topics.py`).
"""

from __future__ import annotations

from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING

from soter.language.model.durations import show_ns
from soter.language.model.least_ages import PUBLICATIONS, is_measured, least_age_ns

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import System
    from soter.monitor.logs.typed_samples import TopicSamples

STUCK, STUCK_SHARE = 20, 0.1
"""So many samples, and such a share of all, are one value before it is told."""
ANOTHER_PACE = 300.0
"""A pace that differs so many times: units of time differ 1,000 times, rates of logs do not."""


def doubts(system: System, samples: Iterable[TopicSamples]) -> list[str]:
    """What people are told, topic by topic."""
    told = []
    for s in samples:
        if not s.always and is_measured(system, s.topic.index):
            told += [text for text in (_stuck(s), _pace(system, s)) if text]
    return told


def _stuck(s: TopicSamples) -> str:
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


def _pace(system: System, s: TopicSamples) -> str:
    gaps = [b - a for a, b in pairwise(s.times_ns) if b > a]
    least_ns = least_age_ns(system, s.topic.index)
    if not gaps or least_ns is None:
        return ""
    here, there = median(gaps), least_ns / PUBLICATIONS
    if 1.0 / ANOTHER_PACE < here / there < ANOTHER_PACE:
        return ""
    return (
        f"samples of `{s.topic.name}` come every {show_ns(round(here))}, those of the program "
        f"every {show_ns(round(there))}: is `unit` of `time` right?"
    )
