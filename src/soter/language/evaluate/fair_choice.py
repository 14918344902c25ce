"""Fair choices: every alternative within a bound, and not a choice more than that needs.

Purpose: which of n alternatives a `fair choose` may take next, so that each is taken at least
once in any 2n consecutive executions of that choice; both engines follow this rule.
Non-goals: who picks among the allowed ones.

`ages[i]` counts the executions since alternative i was last taken, 0 for all at the start. With
age a, alternative i has to come at the latest 2n - 1 - a executions after the next one. Taking
another one is allowed while every such deadline can still be kept, one alternative an execution
(earliest deadline first).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

MAX_FAIR = 64
"""Alternatives of a fair choice; 2 * 64 - 1 is the oldest age, which fits a byte."""


def taken(ages: Sequence[int], pick: int) -> tuple[int, ...]:
    """The ages after alternative `pick` was taken."""
    return tuple(0 if i == pick else age + 1 for i, age in enumerate(ages))


def allowed(ages: Sequence[int]) -> list[int]:
    """The alternatives that may be taken now, ascending; never empty from the start on."""
    return [i for i in range(len(ages)) if _can_be_kept(taken(ages, i), i)]


def _can_be_kept(ages: Sequence[int], pick: int) -> bool:
    """Whether for every s >= 0 at most s + 1 of the others have to be taken within s."""
    last = 2 * len(ages) - 1
    slack = sorted(last - age for i, age in enumerate(ages) if i != pick)
    return all(s >= place for place, s in enumerate(slack))
