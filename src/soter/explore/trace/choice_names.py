"""What a pick of `choose` stands for, in the words of the program.

Purpose: from the number of an alternative to the `choose` expression that asked and its value,
where the program determines them without being run.
Non-goals: guessing: where it may be one of several choices that differ, nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.python_values import to_json
from soter.language.model.tree_walk import nodes, plant_code
from soter.language.model.types import BoolType

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.explore.trace.trace import Choice
    from soter.language.model.system import Component, System

ENDING = ".choose"
_CLOSED = (
    typed.Literal,
    typed.ParamRead,
    typed.TypedUnary,
    typed.TypedBinary,
    typed.Vector,
    typed.Aggregate,
    typed.Narrow,
)


@dataclass(frozen=True)
class _ChoiceSite:
    """A `choose` of a component."""

    expr: typed.TypedChoose
    component: Component

    def may_ask(self, count: int) -> bool:
        """Whether it can have so many alternatives; a fair one sometimes has fewer."""
        return count == self.expr.count or (self.expr.ages is not None and count < self.expr.count)

    def value(self, pick: int, count: int) -> object:
        """The value as JSON, None where it is not known."""
        if count != self.expr.count:
            return None
        if not self.expr.options:
            number = self.expr.low + pick
            value = bool(number) if isinstance(self.expr.type, BoolType) else number
            return to_json(self.expr.type, value)
        option = self.expr.options[pick]
        if not all(isinstance(part, _CLOSED) for part in nodes([option])):
            return None
        constant = Evaluator.of(self.component.scope).expression(option)(Environment())
        return to_json(option.type, constant)


class ChoiceWords:
    """Of one system; `choices` of a step come back with values, `what` says who asked."""

    def __init__(self, system: System) -> None:
        self._asked = {
            c.name + ENDING: [
                _ChoiceSite(e, c) for e in nodes(_code(c)) if isinstance(e, typed.TypedChoose)
            ]
            for c in system.components
        }

    def complete(self, choice: Choice) -> Choice:
        """The same with its value, where it had none and the program tells it."""
        one = self._one(choice)
        if choice.value is not None or one is None:
            return choice
        return replace(choice, value=one.value(choice.pick, choice.of))

    def what(self, choice: Choice) -> str:
        """The source's words, or the name of the stream."""
        one = self._one(choice)
        return choice.stream if one is None else _words(one)

    def _one(self, choice: Choice) -> _ChoiceSite | None:
        """Who asked; of several the first, where they ask in the same words for the same values."""
        fitting = [a for a in self._asked.get(choice.stream, ()) if a.may_ask(choice.of)]
        told = {(_words(a), str(a.value(choice.pick, choice.of))) for a in fitting}
        return fitting[0] if len(told) == 1 else None


def _words(asked: _ChoiceSite) -> str:
    """The source's words on one line."""
    return " ".join(asked.expr.span.text.split())


def _code(component: Component) -> Iterable[object]:
    """What a step of it evaluates."""
    if component.plant is not None:
        return plant_code(component.plant)
    return () if component.node is None else component.node.step
