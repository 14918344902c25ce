"""Answers extern steps of a compiled program with Python callables.

Purpose: `ExternAnswers` reads inputs from a state, calls the extern, and writes the answer struct.
Every failure is the fault `extern`, never a traceback.
Non-goals: finding callables (`native/extern_bindings.py`), running them elsewhere (`workers/`).
"""

from __future__ import annotations

import traceback
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.codegen.externs import answer_fields
from soter.core.layout import decode_from, image_of_members, lay_out
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.model.values import ValueShapeError, inputs_to_python
from soter.native.cache import SOTER
from soter.report.wording import visible
from soter.semantics.externs import (
    Converted,
    Stop,
    convert_answer,
    error_message,
    step_function,
    visible_error,
)
from soter.semantics.publication_gate import check_of_topic, messages_of, with_rounded_ends

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.core.layout import Bytes, StateLayout
    from soter.language.model.system import Component, System
    from soter.language.model.typed import TopicSymbol
    from soter.language.model.types import Type, Value
    from soter.native.loaded_program import Library


OWN_FOLDER = str(SOTER)


@dataclass
class Tally:
    """Counts the steps of a Python extern, and those in which it published nothing."""

    steps: int = 0
    silent: int = 0

    def count_step(self, values: Sequence[Value | None]) -> None:
        """Counts a step that had no fault."""
        self.silent += all(v is None for v in values)


class ExternAnswers:
    """Answers the extern steps of one run by their Python callables."""

    def __init__(
        self, system: System, layout: StateLayout, library: Library, bound: Mapping[str, object]
    ) -> None:
        self.system = system
        self.layout = layout
        self.library = library
        self.failures: dict[str, str] = {}
        """The first failure of each extern, for the report."""
        self.steps = {
            x.index: step_function(bound[x.name]) for x in system.components if x.name in bound
        }
        self.tallies = {x.name: Tally() for x in system.components if x.name in bound}
        self.gates = {x.index: _Gate(system, x) for x in system.components if x.name in bound}

    def answer_step(self, state: Bytes, due: int) -> None:
        """Writes the answer of component `due`, for which the run waits; `state` (state_size,)."""
        component = self.system.components[due]
        self.tallies[component.name].steps += 1
        try:
            data = self._call_component(component, state)
        except Stop:
            raise
        except BaseException as error:  # noqa: BLE001 - whatever an extern does is its fault
            if component.name not in self.failures:
                self.failures[component.name] = failure_text(error)
            self.library.answer_extern(state, due, int(FaultKind.EXTERN), None)
            return
        self.library.answer_extern(state, due, 0, data)

    def _read_topic(
        self, component: Component, topic: TopicSymbol, raw: memoryview
    ) -> tuple[str, Type, Value]:
        index = component.scope.topics[topic]
        offset, t = self.layout.topic_offset(index), self.system.topics[index].type
        return topic.name.rpartition(".")[2], t, decode_from(raw, offset, t)

    def _call_component(self, component: Component, state: Bytes) -> bytes:
        raw = memoryview(state.data)
        if component.plant is not None:
            return self._call_plant(component, raw)
        node = component.node
        assert node is not None
        inputs = inputs_to_python(
            [self._read_topic(component, s.topic, raw) for s in node.subscribes]
        )
        shapes = node.answers
        values = convert_answer(shapes, self.steps[component.index](inputs))
        self.tallies[component.name].count_step(values)
        self.gates[component.index].note_refusal(values, self.failures)
        answered = {n: v for (n, _), v in zip(shapes, values, strict=True) if v is not None}
        present: dict[str, Value] = {f"has_{n}": n in answered for n, _ in shapes}
        return _encode(component, {**answered, **present})

    def _call_plant(self, component: Component, raw: memoryview) -> bytes:
        plant = component.plant
        assert plant is not None
        inputs = inputs_to_python([self._read_topic(component, t, raw) for t in plant.reads])
        old = [
            decode_from(raw, self.layout.member(component.index, i)[0], state.type)
            for i, state in enumerate(plant.states)
        ]
        shapes = [(state.name, state.type) for state in plant.states]
        inputs.state = inputs_to_python(
            [(n, t, value) for (n, t), value in zip(shapes, old, strict=True)]
        )
        new = convert_answer(shapes, self.steps[component.index](inputs))
        self.tallies[component.name].count_step(new)
        moved = [
            old_value if new_value is None else new_value
            for old_value, new_value in zip(old, new, strict=True)
        ]
        return _encode(component, {n: state for (n, _), state in zip(shapes, moved, strict=True)})


def _encode(component: Component, values: dict[str, Value]) -> bytes:
    return image_of_members(lay_out(answer_fields(component)), values)


# ---------------------------------------------------------------- failures in words


class PlainError(Exception):
    """A failure whose text users see without the type of the exception."""


class MisuseError(PlainError):
    """Raised if an extern's code does not fit its call; users see `SAID_MAX` characters of text."""


SAID_MAX = 600


class _Gate:
    """Notes leaf, value and bound of an output that the gate refuses; states hold only the kind."""

    def __init__(self, system: System, component: Component) -> None:
        self.name = component.name
        self.span = component.span
        written = [] if component.node is None else component.writes
        self.checks = [(system.topics[t], check_of_topic(system.topics[t])) for t in written]
        bursts = component.node.bursts if component.node is not None else ()
        self.bursts = [component.scope.topics[t] for t in bursts]

    def note_refusal(self, values: Sequence[Value | None], failures: dict[str, str]) -> None:
        """Notes the first value that is outside the set of its topic."""
        if self.name in failures:
            return
        for (topic, check), value in zip(self.checks, values, strict=False):
            try:
                for message in (
                    () if value is None else messages_of(topic.index, value, self.bursts)
                ):
                    check(with_rounded_ends(topic, message), self.span)
            except StepFault as fault:
                failures[self.name] = fault.detail
                return


def failure_text(error: BaseException, *, place: bool = True) -> str:
    """Describes an extern's failure; `place` adds the file and line of the user's code."""
    if isinstance(error, ValueShapeError):
        return visible(f"its answer has the wrong shape: {error_message(error)}")
    if isinstance(error, MisuseError):
        return visible(str(error)[:SAID_MAX])
    if isinstance(error, PlainError):
        return visible(error_message(error))
    where = _failure_place(error) if place else ""
    return f"{visible_error(error)} ({visible(where)})" if where else visible_error(error)


def _failure_place(error: BaseException) -> str:
    """The file and line of the innermost call in the user's file; "" if unknown."""
    frames = [
        (frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not frame.f_code.co_filename.startswith((OWN_FOLDER, "<frozen"))
    ]
    if not frames:
        return ""
    home = frames[0][0]
    line = next(n for file, n in reversed(frames) if file == home)
    path = Path(home)
    with suppress(ValueError, OSError):
        path = path.relative_to(Path.cwd())
    return f"{path}:{line}"


def callables_with_notes(
    system: System, bound: Mapping[str, object], failures: dict[str, str], tallies: dict[str, Tally]
) -> dict[str, object]:
    """Wraps the callables in `bound`, so that they note first failures and silent steps.

    Silent steps are noted only for Python, because only the native engine could see those of C.
    """
    wrapper_by_name: dict[str, object] = {}
    components = {x.name: x for x in system.components}
    for name, target in bound.items():
        component = components.get(name)
        if component is None:
            wrapper_by_name[name] = _FailureNotes(name, target, failures)
            continue
        tally = Tally()
        if not getattr(target, "linked", False):
            tallies[name] = tally
        gate = _Gate(system, component)
        wrapper_by_name[name] = _ComponentNotes(
            name, target, failures, _answer_shapes(component), tally, gate
        )
    return wrapper_by_name


def _answer_shapes(component: Component) -> list[tuple[str, Type]]:
    if component.plant is not None:
        return [(v.name, v.type) for v in component.plant.states]
    assert component.node is not None
    return component.node.answers


class _FailureNotes:
    def __init__(self, name: str, target: object, failures: dict[str, str]) -> None:
        self.name = name
        self.failures = failures
        self._target = target
        self._step: Callable[..., object] = step_function(target)

    def step(self, *arguments: object) -> object:
        try:
            answer = self._check_answer(self._step(*arguments))
        except Stop:
            raise
        except BaseException as error:
            if self.name not in self.failures:
                self.failures[self.name] = failure_text(error)
            raise
        return answer

    def _check_answer(self, answer: object) -> object:
        """Returns the answer unchanged, because the interpreter checks the answers of functions."""
        return answer

    def reset(self, seed: int) -> None:
        start = getattr(self._target, "reset", None)
        if callable(start):
            start(seed)


class _ComponentNotes(_FailureNotes):
    def __init__(
        self,
        name: str,
        target: object,
        failures: dict[str, str],
        shapes: list[tuple[str, Type]],
        tally: Tally,
        gate: _Gate,
    ) -> None:
        super().__init__(name, target, failures)
        self.shapes = shapes
        self.tally = tally
        self.gate = gate

    def step(self, *arguments: object) -> object:
        self.tally.steps += 1
        return super().step(*arguments)

    def _check_answer(self, answer: object) -> object:
        values = Converted(convert_answer(self.shapes, answer))
        self.tally.count_step(values)
        self.gate.note_refusal(values, self.failures)
        return values
