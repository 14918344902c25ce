"""Answer extern steps of a compiled program with Python callables.

Purpose: read inputs out of a state, call, write the answer struct; every mishap is the fault
`extern`, never a traceback.
Non-goals: finding callables (`bindings.py`), running them elsewhere (`workers/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.unit import answer_fields
from soter.lower.layout import arrange, decode_from, encode_into
from soter.program.arith import FaultKind
from soter.program.values import ValueShapeError, inputs_to_python, outputs_from_python
from soter.semantics.externs import step_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.lower.layout import StateLayout
    from soter.native.library import Bytes, Library
    from soter.program.system import Component, System
    from soter.program.typed import TopicSymbol
    from soter.program.types import Type, Value


class ExternAnswers:
    """The Python side of one run: which callable answers which component."""

    def __init__(
        self, system: System, layout: StateLayout, library: Library, bound: Mapping[str, object]
    ) -> None:
        self.system = system
        self.layout = layout
        self.library = library
        self.failures: dict[str, str] = {}
        """First failure of each extern, for the report."""
        self.steps = {x.index: step_of(bound[x.name]) for x in system.components if x.name in bound}

    def answer(self, state: Bytes, due: int) -> None:
        """Compute and give the answer that is due."""
        component = self.system.components[due]
        try:
            data = self._call(component, state)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - what an extern does is its fault
            self.failures.setdefault(component.name, described(error))
            self.library.answer(state, due, int(FaultKind.EXTERN), None)
            return
        self.library.answer(state, due, 0, data)

    def _topic(
        self, component: Component, topic: TopicSymbol, raw: memoryview
    ) -> tuple[str, Type, Value]:
        offset = self.layout.topic_offset(component.scope.topics[topic])
        return topic.name.rpartition(".")[2], topic.type, decode_from(raw, offset, topic.type)

    def _call(self, component: Component, state: Bytes) -> bytes:
        raw = memoryview(state.data)
        if component.plant is not None:
            return self._plant(component, raw)
        node = component.node
        assert node is not None
        inputs = inputs_to_python([self._topic(component, s.topic, raw) for s in node.subscribes])
        shapes = [(t.name.rpartition(".")[2], t.type) for t in node.publishes]
        values = outputs_from_python(shapes, self.steps[component.index](inputs))
        given = {n: v for (n, _), v in zip(shapes, values, strict=True) if v is not None}
        present: dict[str, Value] = {f"has_{n}": n in given for n, _ in shapes}
        return _encode(component, {**given, **present})

    def _plant(self, component: Component, raw: memoryview) -> bytes:
        plant = component.plant
        assert plant is not None
        inputs = inputs_to_python([self._topic(component, t, raw) for t in plant.reads])
        old = [
            decode_from(raw, self.layout.member(component.index, i)[0], v.type)
            for i, v in enumerate(plant.states)
        ]
        shapes = [(v.name, v.type) for v in plant.states]
        inputs.state = inputs_to_python(
            [(n, t, value) for (n, t), value in zip(shapes, old, strict=True)]
        )
        new = outputs_from_python(shapes, self.steps[component.index](inputs))
        moved = [a if b is None else b for a, b in zip(old, new, strict=True)]
        return _encode(component, {n: v for (n, _), v in zip(shapes, moved, strict=True)})


def _encode(component: Component, values: dict[str, Value]) -> bytes:
    layout = arrange(answer_fields(component))
    out = bytearray(max(layout.size, 1))
    for member in layout.members:
        if member.name in values:
            encode_into(out, member.offset, member.type, values[member.name])
    return bytes(out)


# ---------------------------------------------------------------- failures in words


class PlainError(Exception):
    """A failure whose message says all; its type is no news to a person."""


def described(error: BaseException) -> str:
    """A failure of an extern in one line."""
    text = " ".join(str(error).split())[:200]
    if isinstance(error, ValueShapeError):
        return f"its answer has the wrong shape: {text}"
    if isinstance(error, PlainError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def noting(
    system: System, bound: Mapping[str, object], failures: dict[str, str]
) -> dict[str, object]:
    """`bound` with the first failure of each noted, for an engine that only counts them."""
    found: dict[str, object] = {}
    components = {x.name: x for x in system.components}
    for name, target in bound.items():
        shapes = _shapes(components[name]) if name in components else None
        found[name] = _Noting(name, target, shapes, failures)
    return found


def _shapes(component: Component) -> list[tuple[str, Type]]:
    if component.plant is not None:
        return [(v.name, v.type) for v in component.plant.states]
    assert component.node is not None
    return [(t.name.rpartition(".")[2], t.type) for t in component.node.publishes]


class _Noting:
    def __init__(
        self,
        name: str,
        target: object,
        shapes: list[tuple[str, Type]] | None,
        failures: dict[str, str],
    ) -> None:
        self.name = name
        self.failures = failures
        self.shapes = shapes
        self._target = target
        self._step: Callable[..., object] = step_of(target)

    def step(self, *arguments: object) -> object:
        try:
            answer = self._step(*arguments)
            if self.shapes is not None:
                outputs_from_python(self.shapes, answer)
        except Exception as error:
            self.failures.setdefault(self.name, described(error))
            raise
        return answer

    def reset(self, seed: int) -> None:
        start = getattr(self._target, "reset", None)
        if callable(start):
            start(seed)
