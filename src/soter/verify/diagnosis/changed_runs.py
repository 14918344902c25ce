"""Looks for one change with which a run of the model that leaves C stays inside.

Purpose: `changes_that_keep_c` changes one thing of SC, of the world or of the ages at a time, and
follows the run that leaves C again. If it stays in C, other runs from the same start are followed,
too. So the advice names a cause and its size, and says that the change was tried.
Non-goals: verdicts: these are runs of the model, and nothing is proved of the changed module (of
some changes `tried_remedies.py` asks the proof, too); two changes together.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.types import show_ns
from soter.verify.diagnosis.model_runs import NS, PointModel, StepFaultError, run_of_sc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.core.layout import Floats
    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern

    EndsWell = Callable[[PointModel, Pattern], bool]


LONGER, HOLDS = 5.0, 1000
"""How many times as long as the run that leaves C a changed run is followed, and for how many
periods of SC at least."""
NARROWER = {0.5: "half as wide", 0.25: "a quarter as wide", 0.0625: "a sixteenth as wide"}
OF = {"disturbances": "a disturbance", "errors": "an error of"}
STRONGER = {
    2.0: "twice as strong",
    4.0: "four times as strong",
    16.0: "sixteen times as strong",
    0.5: "half as strong",
}
OLD = (
    "commands that act sooner: SC answers states up to {} old (`max_age`, `dropout`, `acts within`)"
)
MARGIN = 1.25
"""The factor by which a strength or a width that is advised may be missed, and still helps."""
LOOKS, SAME = 50, 1e-9
"""The number of states in which SC is evaluated, and the variation of equal answers."""
FAR = 1e6
"""The distance from a run up to which states are drawn where the grid has no end."""
MOST = 2
"""The most changes that one advice names."""
KEEPS = "(tried in runs of the model: none leaves C within {:.4g} s)"
KEEPS_CALM = "(tried in runs of the model that nothing disturbs: none leaves C within {:.4g} s)"
RETURNS = "(tried in runs of the model: all end where `safer` holds then)"


class _ChangedModel(PointModel):
    """A model whose SC reads changed states (`reads`) or publishes changed commands (`sends`)."""

    def __init__(
        self,
        model: PointModel,
        reads: Callable[[Floats], Floats] = np.copy,
        sends: Callable[[Floats], Floats] = np.copy,
    ) -> None:
        self.__dict__.update(vars(model))
        self._reads, self._sends = reads, sends

    def law(self, x: Floats, errors: Floats, others: Floats) -> Floats:
        """The commands of the changed SC; the arrays are those of `PointModel.law`."""
        return self._sends(super().law(self._reads(x), errors, others))


@dataclass(frozen=True)
class Change:
    """A change: the advice to make it, and the worlds in which all runs must end well.

    A world is a model, and a function that changes a run's pattern for that model.
    """

    advice: str
    worlds: tuple[tuple[PointModel, Callable[[Pattern], Pattern]], ...]


def constant_command(model: PointModel, trace: ModelTrace) -> Floats | None:
    """The command, (controls,), that SC publishes whatever it reads; None if it varies.

    SC is evaluated in states of a run, and in others that are drawn from the grid.
    """
    still = np.zeros(len(model.problem.errors)), np.zeros(len(model.problem.others))
    passed = np.array(trace.states)[np.linspace(0, len(trace.states) - 1, LOOKS).astype(int)]
    ends = np.clip([model.low, model.high], passed.min(axis=0) - FAR, passed.max(axis=0) + FAR)
    drawn = ends[0] + np.random.default_rng(0).random((LOOKS, len(ends[0]))) * (ends[1] - ends[0])
    with suppress(StepFaultError):
        sent = np.array([model.law(x, *still) for x in (*passed, *drawn)])
        return sent[0] if np.ptp(sent, axis=0).max(initial=0.0) <= SAME else None
    return None


def changes(model: PointModel, *, constant: bool = False) -> Iterator[list[Change]]:
    """Yields the changes to try, as a list for each changed thing, with the least change first.

    `constant`: SC always publishes one value, so that no sign of it can be wrong.
    """
    q = model.problem.quantities
    old = OLD.format(show_ns(model.inputs.delay_ns))
    yield [Change(old, ((model, lambda p: replace(p, late=False)),))]
    ends = list(zip(q.controls, model.forms.whole[model.controls], strict=True))
    for k, (leaf, (low, high)) in () if constant else enumerate(ends):
        about = _middle(low, high)
        turned = partial(_copy_with_scaled_value, k, -1.0, about, low, high)
        world = _ChangedModel(model, sends=turned), _unchanged_pattern
        yield [Change(f"an SC that publishes `{leaf.name}` {_sign_text(about)}", (world,))]
    for k, leaf in () if constant else enumerate(q.states):
        about = _middle(model.low[k], model.high[k])
        turned = partial(_copy_with_scaled_value, k, -1.0, about, -np.inf, np.inf)
        world = _ChangedModel(model, reads=turned), _unchanged_pattern
        yield [Change(f"an SC that answers `{leaf.name}` {_sign_text(about)}", (world,))]
    for k, (leaf, (low, high)) in enumerate(ends):
        yield [
            Change(
                f"an SC whose `{leaf.name}` is {text}",
                tuple(
                    (
                        _ChangedModel(
                            model, sends=partial(_copy_with_scaled_value, k, by, 0.0, low, high)
                        ),
                        _unchanged_pattern,
                    )
                    for by in (times, times / MARGIN)
                ),
            )
            for times, text in STRONGER.items()
        ]
    for part, leaves in (("disturbances", q.disturbances), ("errors", q.errors)):
        for k, leaf in enumerate(leaves):
            yield [
                Change(
                    f"{OF[part]} `{leaf.name}` {text}",
                    tuple(
                        (model, partial(_narrowed_pattern, part, k, by))
                        for by in (times, times * MARGIN)
                    ),
                )
                for times, text in NARROWER.items()
            ]


def _unchanged_pattern(pattern: Pattern) -> Pattern:
    return pattern


def _middle(low: float, high: float) -> float:
    """The value at which a sign changes: 0 if that lies inside of a range, or the middle."""
    return 0.0 if low < 0.0 < high else low / 2 + high / 2


def _sign_text(about: float) -> str:
    """The words for a sign that was changed at this value."""
    return "with the other sign" if about == 0.0 else f"mirrored at {about:.4g}"


def _copy_with_scaled_value(
    index: int, times: float, about: float, low: float, high: float, values: Floats
) -> Floats:
    """A copy of `values` in which one value is `times` as far from `about`, within its range."""
    values = np.copy(values)
    values[index] = np.clip(about + times * (values[index] - about), low, high)
    return values


def _narrowed_pattern(part: str, index: int, times: float, pattern: Pattern) -> Pattern:
    """A copy of a pattern with one disturbance or error scaled towards the middle."""
    signs = np.copy(getattr(pattern, part))
    signs[index] *= times
    if part == "errors":
        return replace(pattern, errors=signs)
    return replace(pattern, disturbances=signs)


def changes_that_bring_back(
    model: PointModel, first: Pattern, others: Sequence[Pattern], returns: EndsWell
) -> str:
    """Describes the changes after which runs end where the DM gives control back; "" if none.

    `returns`: whether a run of a model with a pattern ends so; `first`: a pattern whose unchanged
    run does not.
    """
    return _changes_in_words(_changes_that_help(model, first, returns, others), RETURNS)


def changes_that_keep_c(
    model: PointModel, left: ModelTrace, others: Sequence[Pattern], go_on: Callable[[], bool]
) -> str:
    """Describes the changes with which no run leaves C from the start of `left`; "" if none.

    `left`: a run that leaves C. If it is undisturbed, the patterns `others` are not tried.
    """
    until_s = max(LONGER * left.times[-1], HOLDS * model.inputs.period_ns * NS)

    def stays_in_c(changed: PointModel, pattern: Pattern) -> bool:
        if not go_on():
            return False
        trace = run_of_sc(changed, left.states[0], pattern, until_s, go_on)
        return not trace.left and trace.times[-1] >= until_s * (1.0 - 1e-9)

    calm, constant = not left.pattern.is_disturbed, constant_command(model, left) is not None
    helps = _changes_that_help(
        model, left.pattern, stays_in_c, [] if calm else others, constant=constant
    )
    return _changes_in_words(helps, (KEEPS_CALM if calm else KEEPS).format(until_s))


def _changes_that_help(
    model: PointModel,
    first: Pattern,
    well: EndsWell,
    others: Sequence[Pattern],
    *,
    constant: bool = False,
) -> Iterator[str]:
    """Yields the advice of each change with which runs of all these patterns end well."""
    for steps in changes(model, constant=constant):
        for change in steps:
            if all(well(m, of(p)) for p in (first, *others) for m, of in change.worlds):
                yield change.advice
                break


def _changes_in_words(found: Iterator[str], tried: str) -> str:
    text = "; or ".join(islice(found, MOST))
    return f"{text} {tried}" if text else ""
