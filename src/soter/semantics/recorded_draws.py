"""Draws that are written down, so that a run can be repeated from them.

Purpose: a `Recorder` notes what other draws choose, `RecordedDraws` draws it again.
Non-goals: files of choices (`verify/counterexample.py`).
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.language.model.types import BoolType, EnumType, FloatType, IntType

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Bound
    from soter.language.model.types import Type, Value
    from soter.semantics.draws import Draws

Choices = dict[str, list[tuple[int, "Value"]]]
"""By stream: (index, value), ascending; a value holds until the next index that is given."""


@dataclass(frozen=True)
class Recorder:
    """Records the choices of other draws in the order of a run, so indices never fall."""

    draws: Draws
    choices: Choices = field(default_factory=dict)

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """Gives the float that `draws` chooses, and records it."""
        value = self.draws.uniform(stream, index, low, high)
        self._note_choice(stream, index, value)
        return value

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """Gives the value that `draws` chooses, and records it."""
        value = self.draws.leaf_value(t, bound, stream, index)
        self._note_choice(stream, index, value)
        return value

    def choice(self, stream: str, index: int, count: int) -> int:
        """Gives the alternative that `draws` chooses, and records it."""
        pick = self.draws.choice(stream, index, count)
        self._note_choice(stream, index, pick)
        return pick

    def _note_choice(self, stream: str, index: int, value: Value) -> None:
        noted = self.choices.setdefault(stream, [])
        if not noted or noted[-1][1] != value:
            noted.append((index, value))


class ChoiceError(Exception):
    """Raised if a recorded choice is missing, or if the program does not allow it."""


@dataclass(frozen=True)
class RecordedDraws:
    """Replays recorded choices; raises ChoiceError for a choice outside its declared set."""

    choices: Mapping[str, list[tuple[int, Value]]]

    def _draw_at(self, stream: str, index: int) -> Value:
        noted = self.choices.get(stream, [])
        at = bisect_right(noted, index, key=lambda entry: entry[0]) - 1
        if at < 0:
            raise ChoiceError(f"no choice is given for `{stream}` at {index}")
        return noted[at][1]

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """Gives the recorded float."""
        value = self._draw_at(stream, index)
        if isinstance(value, bool) or not isinstance(value, float) or not low <= value <= high:
            raise ChoiceError(f"`{stream}` at {index}: {value} is not in [{low}, {high}]")
        return value

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """Gives the recorded value."""
        value = self._draw_at(stream, index)
        if isinstance(t, FloatType):
            assert bound is not None, f"{stream} is not bounded"
            return self.uniform(stream, index, bound.low, bound.high)
        if isinstance(t, BoolType):
            allowed = isinstance(value, bool)
        else:
            allowed = isinstance(value, int) and not isinstance(value, bool)
            if allowed and isinstance(t, EnumType):
                allowed = 0 <= value < len(t.members)
            elif allowed and isinstance(t, IntType):
                low, high = (t.low, t.high) if bound is None else (bound.low, bound.high)
                allowed = low <= value <= high
        if not allowed:
            raise ChoiceError(f"`{stream}` at {index}: {value} is no value of its set")
        return value

    def choice(self, stream: str, index: int, count: int) -> int:
        """Gives the recorded alternative."""
        value = self._draw_at(stream, index)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
            raise ChoiceError(f"`{stream}` at {index}: {value} is none of {count} alternatives")
        return value
