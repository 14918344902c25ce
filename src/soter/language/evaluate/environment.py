"""The `Environment` that code reads while it is evaluated, and the rule of fair choices.

Purpose: separates the meaning of code (`statements.py`) from its callers: the checker evaluates
constants in an empty environment, the interpreter gives it a configuration. `allowed_picks`
computes which of n alternatives a `fair choose` may take next, so that each is taken at least once
in any 2n consecutive executions of that choice; both engines follow this rule.
Non-goals: compile-time meaning of names: that is the scope the evaluator was made for; who picks
among the allowed alternatives.

`ages[i]` counts the executions since alternative i was last taken, 0 for all at the start. With
age a, alternative i has to come at the latest 2n - 1 - a executions after the next one. Taking
another one is allowed while every such deadline can still be kept, one alternative an execution
(earliest deadline first).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.typed import Variable
    from soter.language.model.types import Value


class BudgetExceeded(Exception):  # noqa: N818  not an error: the limit was asked for
    """An error for a constant that takes more operations than the evaluator's budget."""


def _refuse_choice(count: int) -> int:
    """Raises RuntimeError; the default for `choose`, which only steps of nodes and plants use."""
    msg = f"nobody chooses between {count} alternatives here"
    raise RuntimeError(msg)


class Environment:
    """The values that code can read, and the publications of a step.

    `variables` maps variables, by identity, to values. `topics` and `stamps` are indexed by topic,
    and have the values from before the step. `mode(module index)`, `margin_ns(module index)` and
    `truth(component index)` read the configuration. `published` collects the published values by
    topic index, for a burst a tuple of all messages. `choose(count)` answers a `choose` with a
    number from 0 to count - 1. A constant that reads nothing needs no argument.
    """

    __slots__ = (
        "choose",
        "in_control",
        "margin_ns",
        "mode",
        "period_ns",
        "published",
        "stamps",
        "time_ns",
        "topics",
        "truth",
        "variables",
    )

    def __init__(
        self,
        variables: dict[Variable, Value] | None = None,
        *,
        topics: Sequence[Value] = (),
        stamps: Sequence[int] = (),
        time_ns: int = 0,
        period_ns: int = 0,
        in_control: bool = True,
        mode: Callable[[int], int] | None = None,
        truth: Callable[[int], Value] | None = None,
        choose: Callable[[int], int] | None = None,
        margin_ns: Callable[[int], int] | None = None,
    ) -> None:
        self.variables = {} if variables is None else variables
        self.topics = topics
        self.stamps = stamps
        self.time_ns = time_ns
        self.period_ns = period_ns
        self.in_control = in_control
        self.mode = mode
        self.margin_ns = margin_ns
        self.truth = truth
        self.choose = _refuse_choice if choose is None else choose
        self.published: dict[int, Value] = {}


MAX_FAIR = 64
"""Most alternatives of a fair choice; 2 * 64 - 1 is the greatest age, which fits a byte."""


def ages_after(ages: Sequence[int], pick: int) -> tuple[int, ...]:
    """Gives the ages of all alternatives after `pick` was taken."""
    return tuple(0 if i == pick else age + 1 for i, age in enumerate(ages))


def allowed_picks(ages: Sequence[int]) -> list[int]:
    """Gives the alternatives that may be taken now, in ascending order; always at least one."""
    return [i for i in range(len(ages)) if _can_keep_deadlines(ages_after(ages, i), i)]


def _can_keep_deadlines(ages: Sequence[int], pick: int) -> bool:
    """Whether every alternative but `pick` can still be taken before its deadline."""
    last = 2 * len(ages) - 1
    slack = sorted(last - age for i, age in enumerate(ages) if i != pick)
    return all(s >= place for place, s in enumerate(slack))
