"""The picks of a trace, handed to the reference interpreter one step at a time.

Purpose: whatever a step asks (`semantics/answered_draws.py`) is answered from its own list, stream
by stream and in order; every question is kept with its answer as a person reads it.
Non-goals: what the alternatives of a question are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.explore.trace.trace import Choice
from soter.language.model.python_values import to_json
from soter.language.model.types import FloatType
from soter.semantics.answered_draws import AnsweredDraws

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Bound, System
    from soter.language.model.types import Type, Value


class WrongChoiceError(Exception):
    """A pick that answers nothing that the step asks; the message says why."""


class TraceDraws(AnsweredDraws):
    """Draws that the steps of a trace answer; the first alternative where a step says nothing."""

    def __init__(self, system: System, seed: int) -> None:
        super().__init__(system, self._pick, seed)
        self._given: dict[str, list[Choice]] = {}
        self._values: list[object] = []
        """What was taken, as JSON, in the order of `asked`; None where the stream does not tell."""

    def begin(self, choices: Iterable[Choice]) -> None:
        """A step begins, which has these picks."""
        self.asked.clear()
        self._values = []
        self._given = {}
        for choice in choices:
            self._given.setdefault(choice.stream, []).append(choice)

    def end(self) -> tuple[Choice, ...]:
        """The step is over: everything it asked. `WrongChoiceError` where picks are left over."""
        for stream, left in self._given.items():
            if left:
                raise WrongChoiceError(f"nothing asks for a choice from `{stream}`")
        pairs = zip(self.asked, self._values, strict=True)
        return tuple([Choice(a.stream, a.pick, a.count, value) for a, value in pairs])

    def tell(self, value: object) -> None:
        """The value, as JSON, that the last answer to `choice` stood for."""
        if self._values:
            self._values[-1] = value

    def _pick(self, stream: str, count: int) -> int:
        left = self._given.get(stream)
        if not left:
            return 0
        choice = left.pop(0)
        if choice.of != count:
            message = f"`{stream}` has {count} alternatives here, not {choice.of}"
            raise WrongChoiceError(message)
        return choice.pick

    # ------------------------------------------------------------ Draws

    def choice(self, stream: str, index: int, count: int) -> int:
        """One of `count` alternatives; what they stand for is not known here."""
        pick = super().choice(stream, index, count)
        self._keep(None)
        return pick

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A float of [low, high]."""
        value = super().uniform(stream, index, low, high)
        self._keep(value)
        return value

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A value of a scalar type within its bound."""
        value = super().leaf(t, bound, stream, index)
        if not isinstance(t, FloatType):  # which `uniform` has kept
            self._keep(to_json(t, value))
        return value

    def _keep(self, value: object) -> None:
        """Beside the question that was asked last, if one was."""
        if len(self.asked) > len(self._values):
            self._values.append(value)
