"""Answers of an extern that says `clip = True`: numbers are put at the ends of their topics' sets.

Purpose: as `clip=True` of `soter.remote`, for a node that is asked: what is too large becomes the
largest that the topic takes, and no step fault. What is no finite number is refused as ever.
Non-goals: shapes and names, which stay the extern's own mistakes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from soter.language.model.values import widened
from soter.semantics.externs import Converted, converted, step_of
from soter.semantics.publication_gate import clipped
from soter.simulate.externs.python_extern import FilePolicy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Bound, Component, System
    from soter.language.model.types import Type


class Answered(NamedTuple):
    """What a node answers: name and type of what a step gives, and the set of a message."""

    name: str
    given: Type
    type: Type
    bounds: tuple[Bound | None, ...]
    burst: bool


def answered(system: System, component: Component) -> tuple[Answered, ...]:
    """What an extern node answers, in order."""
    node = component.node
    assert node is not None
    topics = [system.topics[component.scope.topics[t]] for t in node.publishes]
    return tuple(
        Answered(name, given, topic.type, tuple(topic.bounds), symbol in node.bursts)
        for (name, given), topic, symbol in zip(node.answers, topics, node.publishes, strict=True)
    )


def clipping(target: object, answers: Sequence[Answered]) -> object:
    """The same, or where it has an attribute `clip` that is True, what clips its answers."""
    return _Clipping(target, answers) if getattr(target, "clip", False) is True else target


class _Clipping(FilePolicy):
    def __init__(self, target: object, answers: Sequence[Answered]) -> None:
        self._step, self._answers = step_of(target), answers
        self._shapes = [(x.name, widened(x.given)) for x in answers]
        self._reset = getattr(target, "reset", None)
        self.assumed = target.assumed if isinstance(target, FilePolicy) else ()

    def reset(self, seed: int) -> None:
        """Start afresh where the extern can."""
        if callable(self._reset):
            self._reset(seed)

    def step(self, *arguments: Any) -> Converted:  # noqa: ANN401 - whatever the extern takes
        """Its answer, inside of the sets."""
        values = converted(self._shapes, self._step(*arguments))
        return Converted(
            None
            if value is None
            else tuple([clipped(x.type, x.bounds, message) for message in value])
            if x.burst
            else clipped(x.type, x.bounds, value)
            for x, value in zip(self._answers, values, strict=True)
        )
