"""Steps a compiled system until its agent or its plant has to answer.

Purpose: a `Session` steps the very C of a program instant by instant: the states of one plant and
the output of one advanced controller come from the caller, everything else is the program's.
Numbers go straight into arrays that the C reads (`..._numbers`), values of any type through Python.
`direct_calls` makes functions of an array that answer for the agent and for the plant without a
foreign-function interface (`c/soter_gym_python.c`): C reads the array where it lies, which takes a
third of a microsecond less a call than a copy by NumPy and a call by cffi.
Non-goals: Gymnasium (`guard.py`); several sessions share one compiled program, not a state.
"""

from __future__ import annotations

import ctypes
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.api.computed_ttf import compute_ttf
from soter.core.layout import decode_from, encode_into, image_of_members
from soter.gym.array_mapping import array_of_doubles
from soter.gym.compiled_system import (
    CompiledEnvironment,
    Roles,
    bindings_inside,
    kept_build,
    refuse_call,
    remove_idle_check,
)
from soter.gym.environment_choices import CAUSES, chosen_module, chosen_plant, system_with_errors
from soter.language.elaborate.derived_systems import with_unbound_externs
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.types import numbers_in
from soter.native.extern_bindings import bindings_with_objects
from soter.semantics.externs import reset_extern
from soter.simulate.externs.callables import load_callables
from soter.simulate.externs.python_answers import ExternAnswers
from soter.simulate.interrupt import StopRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    import numpy.typing as npt

    import soter.api
    from soter.core.layout import Bytes
    from soter.gym.plant_model import SessionPlant
    from soter.language.model.system import Component
    from soter.language.model.types import Value

    Call = Callable[[Any], int]


ONE_ARGUMENT = 0x0008
"""METH_O of Python's C interface: a function of one argument."""
NO_STATES = -1
"""`SOTER_NO_STATES`: the numbers are no state of the plant."""
SAME_BUT_MARGIN = -2
"""`SOTER_AS_TOLD`: the agent is due, and of `info` only the margin differs from the last step's."""
NO_NUMBERS = -3
"""`SOTER_NO_NUMBERS`: the argument is no array that C can read in place; nothing was done."""
NEEDED = {
    "int_of": "PyLong_FromLong",
    "address_of": "PyLong_AsVoidPtr",
    "buffer_of": "PyObject_GetBuffer",
    "buffer_release": "PyBuffer_Release",
    "clear_error": "PyErr_Clear",
}
"""`soter_python`: the functions of Python that C calls."""


class _Method(ctypes.Structure):
    """The record PyMethodDef of Python's stable ABI."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("call", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_METHODS: dict[int, _Method] = {}
"""Address of a C function -> its method record, which Python reads as long as it is used."""


def direct_calls(ffi: Any, lib: Any, outside: Any) -> tuple[Call, Call]:  # noqa: ANN401 - cffi
    """The two functions that answer for the agent and for the plant; they need `outside` alive.

    Each takes an array with one axis, of float32 or float64. It gives the index of the due
    component, or a negative number of `soter_gym.h`. For any other object it does nothing and gives
    NO_NUMBERS.
    """
    if sys.implementation.name != "cpython":
        return refuse_array, refuse_array
    calls = {
        name: ffi.cast("void *", ctypes.cast(getattr(ctypes.pythonapi, f), ctypes.c_void_p).value)
        for name, f in NEEDED.items()
    }
    lib.soter_python_given(ffi.new("soter_python *", calls))
    self_address = int(ffi.cast("uintptr_t", outside))
    act, move = (
        _python_function(name, int(ffi.cast("uintptr_t", ffi.addressof(lib, name))), self_address)
        for name in ("soter_python_act", "soter_python_move")
    )
    return act, move


def refuse_array(_: object) -> int:
    """Gives NO_NUMBERS, on a Python in which C cannot read arrays."""
    return NO_NUMBERS


def _python_function(name: str, address: int, self_address: int) -> Call:
    """Makes a Python function of the C function at `address`, which gets `self_address` first."""
    method = _METHODS.get(address)
    if method is None:
        method = _METHODS[address] = _Method(name.encode(), address, ONE_ARGUMENT, None)
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    made: Call = new(ctypes.addressof(method), self_address, None)
    return made


TOWARD_SC = CAUSES.index("toward sc")
"""The last value of `soter_cause`: a shield moved the action toward SC's."""


class Session:
    """One run: call `reset`, then in turns `run_until_due` and the answer of the due component."""

    def __init__(self, made: CompiledEnvironment, bound: Mapping[str, object]) -> None:
        """`bound` answers the externs except agent and plant; raises errors as `callables` does."""
        roles = made.roles
        assert roles.module is not None
        assert roles.plant is not None
        self.compiled, self.system, self.layout = made, made.system, made.layout
        self.module = self.system.modules[roles.module]
        self.plant = self.system.components[roles.plant]
        self.agent = self.system.components[roles.agent]
        silent = {c.name: refuse_call for c in (self.plant, self.agent)}
        bindings = bindings_with_objects(made.bindings, {**bound, **silent})
        self._bound = load_callables(bindings, "native", StopRequest())
        self.is_compiled = self._bound.keys() == silent.keys()
        """Whether no other extern is answered by Python."""
        self._outside = (roles.plant, roles.agent)
        self.state: Bytes = np.zeros(self.layout.size, dtype=np.uint8)
        self.record: Any = self.state.view(made.dtype)[0]
        """The state, decoded (docs/python.md, the trace)."""
        self._allocate_arrays()
        self._reset_state(0)

    def _allocate_arrays(self) -> None:
        ffi, view = self.compiled.ffi, self.compiled.view
        lib = self._lib = self.compiled.lib
        self._go = lib.soter_outside_go
        self._room = np.zeros(-(-self.compiled.driver_bytes // 8), dtype=np.int64)
        self.action = np.zeros(int(view.action.count))
        """The agent's answer, in numbers."""
        self.moved = np.zeros(int(view.moved.count))
        """The plant's states, in numbers."""
        self.command = np.zeros(int(view.apply.count))
        """The values that the plant read when it was last due, in numbers."""
        self.seen = ffi.new("soter_facts *")
        """`soter_facts`, as of when the plant or the agent was last due."""
        self.seen_bytes = ffi.buffer(self.seen)
        o = self.outside = ffi.new("soter_outside *")
        """`soter_outside`."""
        o.view, o.facts, o.looks = view, self.seen, not self.compiled.linked
        o.state = ffi.cast("uint8_t *", self.state.ctypes.data)
        o.room = ffi.cast("uint8_t *", self._room.ctypes.data)
        for name in ("action", "command"):
            setattr(o, name, ffi.cast("double *", getattr(self, name).ctypes.data))
        o.states = ffi.cast("double *", self.moved.ctypes.data)
        self.act_directly, self.move_directly = direct_calls(ffi, lib, o)
        """Answer with an array, if C reads it (`direct_calls`): where no other extern is due."""

    def _reset_state(self, seed: int) -> None:
        self._answers = ExternAnswers(self.system, self.layout, self.compiled.library, self._bound)
        self.state[:] = self.compiled.library.new_state(seed)
        self.seen_bytes[:] = bytes(len(self.seen_bytes))

    # ------------------------------------------------------------ stepping

    def reset(self, seed: int, states: Sequence[Value]) -> None:
        """Starts a run; the plant publishes `states` at its first release."""
        self.start(seed)
        self.start_at_values(states)

    def start(self, seed: int) -> None:
        """Starts a run, with the plant's states as the program has them."""
        for name, extern in self._bound.items():
            reset_extern(name, extern, seed)
        self._reset_state(seed)

    def start_at_numbers(self) -> bool:
        """Sets the plant's first states to `moved`; returns False if `moved` is no valid state."""
        return int(self._lib.soter_outside_place(self.outside)) == 0

    def run_until_due(self) -> int:
        """Runs until the plant or the agent has to answer, and gives the index of that one."""
        return self._run_past_externs(self._go(self.outside))

    def act_with_numbers(self) -> int:
        """Answers for the agent with `action`, and runs until the next answer is due."""
        return self._run_past_externs(self._lib.soter_outside_act(self.outside))

    def move_to_numbers(self) -> int:
        """Answers for the plant with `moved`, and runs on; NO_STATES if these are no states."""
        due: int = self._lib.soter_outside_move(self.outside)
        return due if due < 0 else self._run_past_externs(due)

    def _run_past_externs(self, due: int) -> int:
        while due not in self._outside:
            self._answers.answer_step(self.state, due)
            due = self._go(self.outside)
        return due

    def rounded_command(self) -> npt.NDArray[np.float32]:
        """An array (n,) into which C, from now on, also writes `command`, in single precision."""
        self._rounded = np.zeros(len(self.command), dtype=np.float32)
        self.outside.single = self.compiled.ffi.cast("float *", self._rounded.ctypes.data)
        return self._rounded

    def attach_model(self, model: SessionPlant) -> None:
        """Sets the model that judges each `move_to_numbers` and each `judge_move`."""
        self._model = model
        self.outside.model = model.pointer

    def judge_move(self) -> None:
        """Lets the model judge the step of the due plant to the states `moved`."""
        self._lib.soter_outside_judge(self.outside)

    def move_to_values(self, states: Sequence[Value]) -> None:
        """Answers for the plant with the values `states`."""
        names = [v.name for v in self.plant.plant.states]  # type: ignore[union-attr]
        self._give_answer(self.state, self.plant, dict(zip(names, states, strict=True)))

    def act_with_values(self, values: Sequence[Value | None] | None) -> None:
        """Answers for the agent; a value None publishes nothing, `values=None` is a step fault."""
        facts, seen = self.facts, self.seen
        faults, seen.taken_by = int(facts["gate_faults"]), int(facts["mode"])
        self._give_agent_answer(self.state, values)
        seen.gate_fault = int(facts["gate_faults"]) > faults
        seen.moved = (
            bool(seen.taken_by)
            and not seen.gate_fault
            and self._has_shield_moved(self.state, values)
        )
        seen.cause = seen.next_cause or int(seen.gate_fault) or TOWARD_SC * int(seen.moved)
        seen.off_model = 0
        seen.steps += 1

    def would_publish(self, values: Sequence[Value | None] | None) -> bool:
        """Whether the due agent, if it were in control, would publish these values unchanged.

        The answer is tried on a copy of the state. Neither the gate may refuse the values nor the
        shield move them.
        """
        copy = self.state.copy()
        record = copy.view(self.compiled.dtype)[0]
        record["components"][self.agent.index]["oe"] = 1
        faults = int(record["modules"][self.module.index]["gate_faults"])
        self._give_agent_answer(copy, values)
        refused = int(record["modules"][self.module.index]["gate_faults"]) > faults
        return not refused and not self._has_shield_moved(copy, values)

    def _give_agent_answer(self, state: Bytes, values: Sequence[Value | None] | None) -> None:
        """Gives the agent's answer to C, on this state; None for `values` is a step fault."""
        if values is None:
            answer = (int(FaultKind.EXTERN), None)
            self.compiled.library.answer_extern(state, self.agent.index, *answer)
        else:
            self._give_answer(state, self.agent, self._answer_members(values))

    def _has_shield_moved(self, state: Bytes, values: Sequence[Value | None] | None) -> bool:
        """Whether the shield moved the values that the agent has just published."""
        shield = self.module.shield
        if shield is None or shield.proposed is None or values is None or None in values:
            return False
        raw = memoryview(state.data)
        published, proposed = (
            [x for i in topics for x in numbers_in(self._topic_value_in(raw, i))]
            for topics in (self.module.outputs, (shield.proposed,))
        )
        return published != proposed[: len(published)]

    def _answer_members(self, values: Sequence[Value | None]) -> dict[str, Value]:
        assert self.agent.node is not None
        short = [t.name.rpartition(".")[2] for t in self.agent.node.publishes]
        answered = {n: v for n, v in zip(short, values, strict=True) if v is not None}
        return {**answered, **{f"has_{n}": n in answered for n in short}}

    def _give_answer(self, state: Bytes, component: Component, values: Mapping[str, Value]) -> None:
        answer = image_of_members(self.compiled.answers[component.index], values)
        self.compiled.library.answer_extern(state, component.index, 0, answer)

    def start_at_values(self, states: Sequence[Value]) -> None:
        """Sets the plant's first states to values."""
        raw = bytearray(self.state.tobytes())
        for i, value in enumerate(states):
            offset, t = self.layout.member(self.plant.index, i)
            encode_into(raw, offset, t, value)
        self.state[:] = np.frombuffer(bytes(raw), dtype=np.uint8)

    # ------------------------------------------------------------ facts

    @property
    def facts(self) -> Any:  # noqa: ANN401 - a NumPy record
        """The module's record, with the fields mode, ttf, safer, stale, gate_faults and others."""
        return self.record["modules"][self.module.index]

    def plant_states(self) -> list[Value]:
        """The values of the plant's states."""
        raw = memoryview(self.state.data)
        assert self.plant.plant is not None
        places = [self.layout.member(self.plant.index, i) for i in range(len(self.plant.initial))]
        return [decode_from(raw, offset, t) for offset, t in places]

    def topic_value(self, index: int) -> Value:
        """The value that a topic holds."""
        return self._topic_value_in(memoryview(self.state.data), index)

    def _topic_value_in(self, raw: memoryview, index: int) -> Value:
        offset = self.layout.topic_offset(index)
        return decode_from(raw, offset, self.system.topics[index].type)

    def violation_count(self, *, over: bool = False) -> int:
        """Counts onsets of violated properties and latched components, this instant included.

        While the instant waits for the agent, a copy of the state is run to the end of the instant,
        and externs publish nothing. Linked C may have its own memory, which a copy would disturb;
        then this instant counts only if the run is `over`.
        """
        if self.compiled.linked and not over:
            return int(self.record["header"]["violations"])
        return int(self._lib.soter_outside_violations(self.outside))

    # ------------------------------------------------------------ copies

    def saved_state(self) -> tuple[bytes, bytes]:
        """The state and the facts, for `restore_state` of a session of the same system."""
        return self.state.tobytes(), bytes(self.seen_bytes)

    def restore_state(self, saved: tuple[bytes, bytes]) -> None:
        """Restores the state and the facts from a result of `saved_state`."""
        self.state[:] = np.frombuffer(saved[0], dtype=np.uint8)
        self.seen_bytes[:] = saved[1]


def copy_numbers(answer: object, into: npt.NDArray[np.float64], subject: str) -> int | None:
    """Copies numbers into `into` (n,); gives their count if it is not n, else None; raises U001."""
    array = array_of_doubles(answer, subject)
    if array.shape != into.shape:
        if array.size != into.size:
            return int(array.size)
        array = array.reshape(-1)
    into[:] = array
    return None


def one_world_environment(
    program: soter.api.Program,
    system: str | None,
    module: str | None,
    plant: str | None,
    params: Mapping[str, object] | None,
    measured: bool | Collection[str],
) -> CompiledEnvironment:
    """Compiles a system in which a caller answers for agent and plant; raises SoterError U001."""
    errors = measured if isinstance(measured, bool) else tuple(sorted(measured))

    def make_environment() -> CompiledEnvironment:
        flat = program.declared(system, params)
        flat_module, body = chosen_module(flat, module), chosen_plant(flat, plant)
        outside = (flat_module.ac, body.index)
        remove_idle_check(flat_module)
        notes = compute_ttf(flat, bound=bindings_inside(flat, outside, program.bound))
        flat = system_with_errors(flat, body, errors)
        flat = with_unbound_externs(flat, outside)
        return CompiledEnvironment(
            flat, Roles(flat_module.ac, flat_module.index, body.index), program.bound, notes=notes
        )

    key = ("outside", system, module, plant, repr(sorted((params or {}).items())), errors)
    return kept_build(program, key, make_environment)
