"""What a run left behind, as values: times, topics, true states.

Purpose: the common form of a traced run and of a log, for those who judge it afterwards.
Non-goals: where it comes from (`simulate/trace_to_recorded_run.py`), judging
(`monitor/model_membership.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RecordedRun:
    """After each instant: every topic by full name, every plant's true state by full name.

    `published`: the topics that were published at each instant.
    """

    times_ns: list[int]
    topics: list[dict[str, Any]]
    truths: list[dict[str, Any]]
    published: list[set[str]]
