"""What a person should know about a run although nothing failed.

Purpose: results that look fine and probably are not: externs that say nothing, `ttf` and `safer`
that hold together.
Non-goals: faults and violations, which are counted elsewhere; semantics: a note changes nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.simulate.run import Run

TOGETHER_MIN = 4
"""In so many decisions ttf and safer must have held together before it is worth a note."""


def notes_of(run: Run) -> list[str]:
    """One sentence each."""
    return [*run.computed, *_silent(run), *_together(run)]


def _silent(run: Run) -> Iterator[str]:
    """Externs without anything to say in more than half of their steps."""
    plants = {x.name for x in run.system.components if x.plant is not None}
    for name, tally in run.extern_tallies.items():
        if 2 * tally.silent > tally.steps:
            verb = "answered" if name in plants else "published"
            yield f"{name} {verb} nothing in {tally.silent} of {tally.steps} steps"


def _together(run: Run) -> Iterator[str]:
    """`ttf` says that φ_safe could be left, `safer` that there is room: hardly both."""
    for module, (steps, together) in zip(run.system.modules, run.decided, strict=False):
        if together >= TOGETHER_MIN:
            yield (
                f"{module.name}: ttf and safer held together in {together} of {steps} decisions: "
                "one of them is likely the wrong way round"
            )
