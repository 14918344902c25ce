"""Steps that Python code takes: extern nodes and extern plants.

Purpose: turns the callables that a user binds into steps like any other, so that no rule knows
the difference. Whatever goes wrong in them is a step fault (`FaultKind.EXTERN`), never a traceback.
Non-goals: finding the callable of a `from "python:..."` (the api does), separate processes
(`workers/`). An extern may keep state of its own; a fork of a configuration does not copy it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.model.values import inputs_to_python, outputs_from_python
from soter.report.wording import visible
from soter.semantics.publication_gate import with_rounded_ends

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.evaluate.environment import Environment
    from soter.language.evaluate.statements import Executed
    from soter.language.model.system import Component, Topic
    from soter.language.model.typed import TopicSymbol
    from soter.language.model.types import Type, Value

    Step = Callable[[Any], object]
    Move = Callable[[Environment, tuple[Value, ...]], tuple[Value, ...]]


MESSAGE_MAX = 200
"""Characters of an exception's message that are kept."""


class Stop(BaseException):
    """Raised by Ctrl-C while an extern runs; the only exception that becomes no step fault."""


class Converted(tuple):  # type: ignore[type-arg] # noqa: SLOT001 - a plain tuple with a name
    """A converted answer of an extern: one Soter value or None for each output, in order.

    A driver that converts an answer before the step does passes it on in this form, so that the
    extern's code (`__float__`, `get`, a property) runs only once.
    """


class UnboundExternError(Exception):
    """Raised if the externs in `names` are bound to nothing."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__("nothing is bound to " + ", ".join(f"`{n}`" for n in names))
        self.names = tuple(names)


class ExternResetError(Exception):
    """Raised if the `reset` of the extern `name` fails; the cause is chained."""

    def __init__(self, name: str, error: BaseException) -> None:
        super().__init__(f"`{name}` could not be reset: {visible_error(error)}")
        self.name = name


def error_message(error: BaseException) -> str:
    """Gives the message of an extern's exception on one line, even if its `str` method fails."""
    try:
        text = str(error)
    except Stop:
        raise
    except BaseException:  # noqa: BLE001 - whatever an extern does is its fault
        return "its message cannot be read"
    return " ".join(text.split())[:MESSAGE_MAX]


def visible_error(error: BaseException) -> str:
    """Gives the kind and message of an extern's exception, with invisible characters escaped."""
    text, kind = error_message(error), type(error).__name__
    return visible(f"{kind}: {text}" if text else kind)


def step_function(bound: object) -> Step:
    """Gives the `step` method of an object, or the object; TypeError if neither is callable."""
    step = getattr(bound, "step", bound)
    if not callable(step):
        msg = f"a `{type(bound).__name__}` is not callable and has no `step`"
        raise TypeError(msg)
    return step


def reset_extern(name: str, bound: object, seed: int) -> None:
    """Calls the `reset` of a bound object if it exists; raises ExternResetError if that fails."""
    start = getattr(bound, "reset", None)
    if callable(start):
        try:
            start(seed)
        except Stop:
            raise
        except BaseException as error:
            raise ExternResetError(name, error) from error


def extern_node(topics: Sequence[Topic], component: Component, step: Step) -> Executed:
    """Gives an extern node's step: it gets inputs by short name, and its answer is published."""
    assert component.node is not None
    scope = component.scope.topics
    reads = []
    for s in component.node.subscribes:  # a queue is a list of what the topic holds
        name, _, index = _short_topic(s.topic, scope)
        reads.append((name, topics[index].type, index))
    writes = [(scope[topic], topic in component.node.bursts) for topic in component.node.publishes]
    shapes = component.node.answers

    def run_extern_step(env: Environment) -> None:
        inputs = inputs_to_python([(name, t, env.topics[i]) for name, t, i in reads])
        answers = convert_answer(shapes, step(inputs))
        for (index, burst), value in zip(writes, answers, strict=True):
            if value is not None and not (burst and not value):  # no message is no publication
                ends = [with_rounded_ends(topics[index], m) for m in (value if burst else (value,))]
                env.published[index] = tuple(ends) if burst else ends[0]

    return _step_with_guard(component, run_extern_step)


def extern_plant(component: Component, step: Step) -> Move:
    """Gives an extern plant's motion, which also gets `inputs.state`; missing states stay."""
    assert component.plant is not None
    scope = component.scope.topics
    reads = [_short_topic(topic, scope) for topic in component.plant.reads]
    shapes = [(v.name, v.type) for v in component.plant.states]

    def moved_states(env: Environment, states: tuple[Value, ...]) -> tuple[Value, ...]:
        inputs = inputs_to_python([(name, t, env.topics[i]) for name, t, i in reads])
        named = zip(shapes, states, strict=True)
        inputs.state = inputs_to_python([(name, t, value) for (name, t), value in named])
        answers = convert_answer(shapes, step(inputs))
        return tuple(
            [old if new is None else new for old, new in zip(states, answers, strict=True)]
        )

    return _step_with_guard(component, moved_states)


def convert_answer(shapes: Sequence[tuple[str, Type]], answer: object) -> Sequence[Value | None]:
    """Gives the values of an answer in the order of `shapes`, pairs of name and type."""
    return answer if isinstance(answer, Converted) else outputs_from_python(shapes, answer)


def _short_topic(topic: TopicSymbol, scope: dict[TopicSymbol, int]) -> tuple[str, Type, int]:
    """Gives a topic's name as declared, its type, and the index of the topic wired to it."""
    return topic.name.rpartition(".")[2], topic.type, scope[topic]


def _step_with_guard(component: Component, run: Callable[..., Any]) -> Callable[..., Any]:
    def step_or_fault(*arguments: object) -> object:
        try:
            return run(*arguments)
        except Stop:
            raise
        except BaseException as error:
            detail = f"`{component.name}`: {visible_error(error)}"
            raise StepFault(FaultKind.EXTERN, component.span, detail) from error

    return step_or_fault
