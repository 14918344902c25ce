"""A compiled system that stops where somebody outside has to answer.

Purpose: step the very C of a program instant by instant: the state of one plant and the output
of one advanced controller come from the caller, everything else is the program's.
Non-goals: Gymnasium (`protected.py`); several sessions share one compiled program, not a state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.interface import answer_fields
from soter.lower.layout import arrange, decode_from, encode_into
from soter.native.library import RunStatus
from soter.program.meaning.arith import FaultKind
from soter.semantics.externs import reset
from soter.simulate.externs.bindings import bind, callables
from soter.simulate.externs.externs import ExternAnswers
from soter.simulate.interrupt import StopRequest
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.native.library import Bytes
    from soter.program.model.system import Component, Module, System
    from soter.program.model.types import Value

FAR_NS = 2**62
"""No run gets there: the session ends before its clock does."""


class Session:
    """One run: `reset`, then again and again `asked`, and `act` or `move` as it says."""

    def __init__(
        self,
        system: System,
        module: Module,
        plant: Component,
        bound: Mapping[str, object],
    ) -> None:
        self.system = system
        self.module = module
        self.plant = system.components[plant.index]
        self.agent = system.components[module.ac]
        silent = {c.name: _never_asked for c in (self.plant, self.agent)}
        bindings = bind(system, {**bound, **silent})
        self._bound = callables(bindings, "native", StopRequest())
        self._linked = any(text.startswith("c:") for text in bindings.texts().values())
        self._program = NativeProgram(system, core=bindings.core)
        self.layout = self._program.layout
        externs = [c for c in system.components if c.extern]
        self._answer_layouts = {c.index: arrange(answer_fields(c)) for c in externs}
        self._begin(0)

    def _begin(self, seed: int) -> None:
        self._answers = self._fresh_answers()
        self.state: Bytes = self._program.library.new_state(seed)
        self.record: Any = self.state.view(self._program.dtype)[0]
        """The state, decoded (docs/python.md, the trace)."""

    def _fresh_answers(self) -> ExternAnswers:
        return ExternAnswers(self.system, self.layout, self._program.library, self._bound)

    # ------------------------------------------------------------ stepping

    def reset(self, seed: int, states: Sequence[Value]) -> None:
        """Start; the plant publishes `states` at its first release."""
        for name, extern in self._bound.items():
            reset(name, extern, seed)
        self._begin(seed)
        self._write_states(states)

    def asked(self) -> Component:
        """Run until the plant or the agent has to answer, and say which."""
        while True:
            status, _, due = self._program.library.run(self.state, FAR_NS)
            assert status is RunStatus.EXTERN
            if due in (self.plant.index, self.agent.index):
                return self.system.components[due]
            self._answers.answer(self.state, due)

    def move(self, states: Sequence[Value]) -> None:
        """Answer for the plant."""
        names = [v.name for v in self.plant.plant.states]  # type: ignore[union-attr]
        self._give(self.state, self.plant, dict(zip(names, states, strict=True)))

    def act(self, values: Sequence[Value | None] | None) -> None:
        """Answer for the agent: a value for each output, None where it publishes nothing.

        None in place of all: there is no usable answer, a step fault of the agent.
        """
        if values is None:
            self._program.library.answer(self.state, self.agent.index, int(FaultKind.EXTERN), None)
            return
        self._give(self.state, self.agent, self._outputs(values))

    def _outputs(self, values: Sequence[Value | None]) -> dict[str, Value]:
        assert self.agent.node is not None
        short = [t.name.rpartition(".")[2] for t in self.agent.node.publishes]
        given = {n: v for n, v in zip(short, values, strict=True) if v is not None}
        return {**given, **{f"has_{n}": n in given for n in short}}

    def _give(self, state: Bytes, component: Component, values: Mapping[str, Value]) -> None:
        layout = self._answer_layouts[component.index]
        out = bytearray(max(layout.size, 1))
        for member in layout.members:
            if member.name in values:
                encode_into(out, member.offset, member.type, values[member.name])
        self._program.library.answer(state, component.index, 0, bytes(out))

    def _write_states(self, states: Sequence[Value]) -> None:
        raw = bytearray(self.state.tobytes())
        for i, value in enumerate(states):
            offset, t = self.layout.member(self.plant.index, i)
            encode_into(raw, offset, t, value)
        self.state[:] = np.frombuffer(bytes(raw), dtype=np.uint8)

    # ------------------------------------------------------------ facts

    @property
    def facts(self) -> Any:  # noqa: ANN401 - a NumPy record
        """The module's record: mode, ttf, safer, stale, gate_faults, ..."""
        return self.record["modules"][self.module.index]

    def states(self) -> list[Value]:
        """The plant's states."""
        raw = memoryview(self.state.data)
        assert self.plant.plant is not None
        places = [self.layout.member(self.plant.index, i) for i in range(len(self.plant.initial))]
        return [decode_from(raw, offset, t) for offset, t in places]

    def topic(self, index: int) -> Value:
        """The value that a topic holds."""
        offset = self.layout.topic_offset(index)
        return decode_from(memoryview(self.state.data), offset, self.system.topics[index].type)

    def violations(self, *, over: bool = False) -> int:
        """Onsets of violated properties and latched components, this instant included.

        Where the instant still waits for the agent, a copy of the state goes on to its end with
        nothing published by externs. Linked C may have a memory of its own, which a copy would
        disturb: then this instant is included only when the run is `over`.
        """
        if self._linked and not over:
            return int(self.record["header"]["violations"])
        copy = self.state.copy()
        now_ns = int(self.record["header"]["ct"])
        while True:
            status, _, due = self._program.library.run(copy, now_ns)
            if status is not RunStatus.EXTERN:
                return int(copy.view(self._program.dtype)[0]["header"]["violations"])
            self._give(copy, self.system.components[due], {})


def _never_asked(*_: object) -> None:
    raise AssertionError("a session answers for its plant and its agent itself")
