"""Warns of runs about which a proof says nothing.

Purpose: a `SafetyWarning` each for agents that never get control, environments that are not the
plant of the proof, starts that the decision module does not vouch for, states that nobody
observes, and wrappers that change the numbers of observations or actions.
Non-goals: who asks, and what follows (`guard.py`, `plant_conformance.py`); mistakes, which are
errors (`environment_choices.py`).
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.gym.compiled_system import CompiledEnvironment
    from soter.language.model.system import Topic


CHANGED = {
    "NormalizeObservation": "observations",
    "RescaleObservation": "observations",
    "TransformObservation": "observations",
    "FrameStackObservation": "observations",
    "DelayObservation": "observations",
    "RescaleAction": "actions",
    "TransformAction": "actions",
    "StickyAction": "actions",
}
"""Wrappers that change the numbers of an environment, and which of its numbers they change."""
LEVEL = 4
"""Frames between a warning and the user's line that caused it."""


class SafetyWarning(UserWarning):
    """A warning about a run that a proof does not cover."""


def warn_of_wrappers(env: gymnasium.Env[Any, Any]) -> None:
    """Warns of wrappers around an environment that change its numbers."""
    while isinstance(env, gymnasium.Wrapper):
        name = type(env).__name__
        if name in CHANGED:
            warnings.warn(
                f"`{name}` changes the {CHANGED[name]} of the environment that the module sees: "
                "put it around the module, not inside, or give the functions that undo it",
                SafetyWarning,
                stacklevel=LEVEL,
            )
        env = env.env


def warn_of_no_control(made: CompiledEnvironment, stacklevel: int = LEVEL) -> None:
    """Warns, with the reason, if `ttf` and `safer` of the module could not be computed."""
    assert made.roles.module is not None
    module = made.system.modules[made.roles.module]
    if module.forced is None and module.symbol.ttf is None and module.symbol.safer is None:
        why = next(note for note in made.notes if note.startswith(f"{module.name}: "))
        warnings.warn(f"{why}: no action of the agent counts", SafetyWarning, stacklevel=stacklevel)


def warn_of_sc_alone(steps: int) -> None:
    """Warns of a measurement in which AC had control in none of the steps."""
    warnings.warn(
        f"AC had control in none of its {steps:,} steps: what is measured is the safe controller "
        "in this environment, not the agent",
        SafetyWarning,
        stacklevel=LEVEL - 1,
    )


def warn_of_narrow_space(space: spaces.Space[Any], reads: Sequence[Topic]) -> None:
    """Warns if the environment's action space is smaller than the value sets of the plant's topics.

    `reads`: the topics whose numbers are actions of `space`, in order. It compares no topic without
    a set, and no space other than a `Box` of the same size.
    """
    named = [(t.name, bound) for t in reads for bound in t.bounds]
    if not isinstance(space, spaces.Box) or space.low.size != len(named):
        return
    ends = []
    for (name, bound), low, high in zip(named, space.low.flat, space.high.flat, strict=True):
        if bound is None:
            continue
        least, most = np.array([bound.low, bound.high], low.dtype)
        if least < low or most > high:
            ends.append(f"`{name}` in [{bound.low}, {bound.high}] but [{low!s}, {high!s}]")
    if ends:
        warnings.warn(
            f"the program commands {', '.join(dict.fromkeys(ends))} is what the environment takes: "
            "where it clips or refuses the rest, SC is weaker there than in the proof",
            SafetyWarning,
            stacklevel=LEVEL,
        )


def warn_off_model(plant: str) -> None:
    """Warns of the first step that no declared disturbance of a plant explains."""
    warnings.warn(
        f"the environment did what plant `{plant}` of the program cannot: this step is outside of "
        'the proof. Later ones are told by `info["off_model"]` alone; soter.gym.conformance '
        "measures how many there are",
        SafetyWarning,
        stacklevel=LEVEL + 1,
    )


def warn_of_unseen(names: Sequence[str]) -> None:
    """Warns of states of the plant that `observe` does not give."""
    warnings.warn(
        f"`observe` gives no {', '.join(f'`{n}`' for n in names)}: the module goes on with what "
        "it was at the start, as if that had just been measured",
        SafetyWarning,
        stacklevel=LEVEL + 1,
    )


def warn_of_start(module: str) -> None:
    """Warns of a start at which the decision module keeps the agent from control."""
    warnings.warn(
        f"the episode starts where `ttf` of module `{module}` holds: the proof "
        "vouches for it only if the safe controller's own set contains it",
        SafetyWarning,
        stacklevel=LEVEL,
    )
