"""The scalars that a verification problem is about, by name.

Purpose: which leaf of a plant or topic each input of the dynamics is, in order.
Non-goals: ranges (`problem.py`), finding them (`inputs.py`), C (`verify/enclose/`).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Leaf:
    """One scalar leaf: of a plant state or disturbance (`owner` = component) or of a topic.

    `member` is the state's or disturbance's name, "" for a topic; `path` the field path below.
    """

    owner: int
    member: str
    path: tuple[str, ...]
    name: str
    """Full name for people: `tube.q3.x`, `control.y`."""
    unit: str = ""
    """As it is declared."""


@dataclass(frozen=True)
class Quantities:
    """The inputs of the emitted functions, in order (docs/verification.md, section 1)."""

    states: tuple[Leaf, ...]
    controls: tuple[Leaf, ...]
    disturbances: tuple[Leaf, ...]
    errors: tuple[Leaf, ...]
    others: tuple[Leaf, ...]
    parameters: tuple[Leaf, ...]
    """Discrete plant states without dynamics: `param[]`, not forms."""
    turning: frozenset[int] = frozenset()
    """States of axes that wrap: they are read modulo a full turn (`enclose/periodic_states.py`)."""

    @property
    def inputs(self) -> tuple[Leaf, ...]:
        """Everything that is a form, in order."""
        return self.states + self.controls + self.disturbances + self.errors + self.others
