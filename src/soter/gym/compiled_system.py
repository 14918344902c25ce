"""A system with somebody outside, compiled once for all environments that step it.

Purpose: a `CompiledEnvironment` has the library of a system, the C driver of `c/` on it, and where
numbers lie in a state; `compiled` keeps it, so that the next environment only needs a state.
Non-goals: states (`session.py`, `vector.py`), what numbers mean to Gymnasium (`array_mapping.py`).
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from soter.campaign.batch_flights import BATCH
from soter.campaign.compiled_unit import generate_measured
from soter.codegen.externs import answer_fields
from soter.core.layout import arrange, state_dtype
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.gym.outside_roles import LeafBuffer, is_flat, places
from soter.language.model.typed import Literal
from soter.language.model.types import BOOL
from soter.native.bindings import Bindings, bind
from soter.native.c_interface import address, declarations, interface, opened
from soter.native.compiler import FAST, vector_flags
from soter.native.extern_memory import kept_by
from soter.native.loaded_program import Library
from soter.native.shared_library import RUNTIME, library
from soter.simulate.externs.c_extern import linked_content, linked_symbols
from soter.simulate.externs.callables import callables
from soter.simulate.interrupt import StopRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import soter.api
    from soter.codegen.unit import Unit
    from soter.gym.outside_roles import MemoryLeaf, ObservedPart
    from soter.language.model.system import Component, Module, System

T = TypeVar("T")
FOLDER = Path(__file__).resolve().parent / "c"
ENGINE = (
    *(FOLDER / f"soter_gym{name}" for name in (".c", "_explain.c", "_python.c", ".h", "_leaves.h")),
    BATCH.with_suffix(".h"),
)
OPTIMISE = "-O3"
"""Learners take millions of steps: the kernel's small functions are worth inlining."""
NOBODY = 2**32 - 1


@dataclass(frozen=True)
class Roles:
    """The indices of the agent outside, the module whose AC it is, and perhaps a plant outside."""

    agent: int
    module: int | None = None
    plant: int | None = None


class CompiledEnvironment:
    """A compiled system, who is outside of it, and `soter_view` of both."""

    def __init__(
        self,
        system: System,
        roles: Roles,
        bound: Mapping[str, object],
        observed: Sequence[ObservedPart] = (),
        notes: Sequence[str] = (),
    ) -> None:
        """`observed`: what an observation is made of. SoterError as `bind` and the compiler.

        `bound` has whatever answers the other externs: what is outside is never called. `notes`:
        what was said as `ttf` and `safer` were computed.
        """
        self.system, self.roles, self.notes = system, roles, tuple(notes)
        outside = [i for i in (roles.agent, roles.plant) if i is not None]
        silent = {system.components[i].name: refuse_call for i in outside}
        self.bindings = bind(system, {**bound, **silent})
        core = self.bindings.core
        functions = [x for x in self.bindings.externs if x.kind == "function"]
        callables(Bindings(system, core, functions), "native", StopRequest())
        self.linked = any(text.startswith("c:") for text in self.bindings.texts().values())
        self.linked_content = linked_content(system, core)
        unit = generate_measured(system, core)
        self.layout = unit.layout
        self.dtype = state_dtype(self.layout)
        path = built(unit)
        _require_kept_nothing(unit)
        owners = linked_symbols(system, core)
        self.library = Library(path, unit.prefix, self.layout.size, owners)
        self.ffi = interface(
            declarations(RUNTIME / "soter.h"), declarations(FOLDER / "soter_gym.h")
        )
        self.lib = opened(self.ffi, path, owners)
        self.program = address(self.ffi, path, f"{unit.prefix}_program", "const soter_program *")
        self.answers = {c.index: arrange(answer_fields(c)) for c in system.components if c.extern}
        self.observed = tuple(observed)
        self.view = self._view()

    def _view(self) -> Any:  # noqa: ANN401 - cdata
        system, roles = self.system, self.roles
        agent = system.components[roles.agent]
        plant = None if roles.plant is None else system.components[roles.plant]
        self.moves_numbers = plant is not None and is_flat(self._states(plant))
        self.acts_numbers = is_flat(t for _, t in answer_fields(agent))
        self.commands_numbers = is_flat(system.topics[t].type for t in self._applied_topics())
        module = None if roles.module is None else system.modules[roles.module]
        self.given = self._buffers(agent, plant)
        return self.ffi.new(
            "soter_view *",
            {
                "program": self.program,
                "module": -1 if roles.module is None else roles.module,
                "looks": 0 if module is None else module.looks,
                "late_ns": 0 if module is None else module.late_ns,
                "agent": roles.agent,
                "plant": NOBODY if roles.plant is None else roles.plant,
                "answer_most": self.answer_most,
                "plain": self.lib.soter_is_plain(self.program),
                **{name: leaves.fields for name, leaves in self.given.items()},
            },
        )

    def _buffers(self, agent: Component, plant: Component | None) -> dict[str, LeafBuffer]:
        """Name of the driver in C -> the leaves that it reads or writes as an array of numbers."""
        sizes = {i: x.size for i, x in self.answers.items()}
        action, answer = self._answer(agent) if self.acts_numbers else ([], [])
        moved: list[MemoryLeaf] = []
        start: list[MemoryLeaf] = []
        if plant is not None and self.moves_numbers:
            (moved, _), start = self._answer(plant), self.truth(plant)
        applied = self._applied_topics() if self.commands_numbers else ()
        observed = [
            leaf
            for x in self.observed
            for leaf in (
                self.truth(self.system.components[x.index]) if x.truth else self.topic(x.index)
            )
        ]
        outputs, proposed = self._moved_parts()
        return {
            "action": LeafBuffer(self.ffi, action, sizes[agent.index]),
            "given": LeafBuffer(self.ffi, answer, sizes[agent.index]),
            "moved": LeafBuffer(self.ffi, moved, 0 if plant is None else sizes[plant.index]),
            "start": LeafBuffer(self.ffi, start),
            "observe": LeafBuffer(self.ffi, observed),
            "apply": LeafBuffer(self.ffi, [leaf for t in applied for leaf in self.topic(t)]),
            "outputs": LeafBuffer(self.ffi, outputs),
            "proposed": LeafBuffer(self.ffi, proposed),
        }

    def _moved_parts(self) -> tuple[list[MemoryLeaf], list[MemoryLeaf]]:
        """Of a module whose shield moves commands: what it publishes, and what its AC proposed."""
        if self.roles.module is None:
            return [], []
        module = self.system.modules[self.roles.module]
        if module.shield is None or module.shield.proposed is None:
            return [], []
        outputs = [leaf for t in module.outputs for leaf in self.topic(t)]
        return outputs, self.topic(module.shield.proposed)[: len(outputs)]

    @property
    def answer_most(self) -> int:
        """Bytes of the largest answer of an extern."""
        return max([8, *(x.size for x in self.answers.values())])

    @property
    def room(self) -> int:
        """Bytes that the driver needs beside a state."""
        return self.layout.size + self.answer_most

    def topic(self, index: int) -> list[MemoryLeaf]:
        """The leaves of a topic, in the state."""
        return list(places(self.system.topics[index].type, self.layout.topic_offset(index)))

    def truth(self, plant: Component) -> list[MemoryLeaf]:
        """The leaves of a plant's states, in the state."""
        members = [self.layout.member(plant.index, i) for i in range(len(self._states(plant)))]
        return [leaf for offset, t in members for leaf in places(t, offset)]

    @staticmethod
    def _states(plant: Component) -> list[Any]:
        assert plant.plant is not None
        return [v.type for v in plant.plant.states]

    def _applied_topics(self) -> Sequence[int]:
        """Topics: what a plant outside reads, else what the agent and its module publish."""
        if self.roles.plant is not None:
            plant = self.system.components[self.roles.plant]
            assert plant.plant is not None
            return plant.reads
        agent = self.system.components[self.roles.agent]
        assert agent.node is not None
        return agent.writes

    def _answer(self, component: Component) -> tuple[list[MemoryLeaf], list[MemoryLeaf]]:
        """The leaves of what an extern answers, and of what says that it was given."""
        members = sorted(self.answers[component.index].members, key=lambda m: m.index)
        count = len(members) if component.plant is not None else len(members) // 2
        values = [leaf for m in members[:count] for leaf in places(m.type, m.offset)]
        return values, [leaf for m in members[count:] for leaf in places(m.type, m.offset)]


def _require_kept_nothing(unit: Unit) -> None:
    """SoterError X008 for C that may keep something: nobody can reset it, and worlds share it."""
    why = kept_by(unit)
    if why:
        message = f"an environment cannot have C that may keep something: {why}"
        note = "it is reset, and worlds of a vector are stepped by turns; what C keeps is neither"
        helps = (
            "what a node keeps is a `var` of it, which lies in the state: a reset begins it anew",
            "of a function it belongs into the result, and comes back as an argument",
            "or bind Python that has a `reset`: each reset of the environment calls it",
            "`soter run` and `soter campaign` fly it as it is",
        )
        raise SoterError((Diagnostic("X008", message, notes=(note,), helps=helps),))


def built(unit: Unit) -> Path:
    """The library of a unit with `ENGINE`, for this machine alone."""
    return library(unit, OPTIMISE, (*FAST, *vector_flags()), ENGINE)


def driver(path: Path, prefix: str) -> tuple[Any, Any, Any]:
    """(cffi, functions, program) of a library that was built with `ENGINE`."""
    ffi = interface(declarations(RUNTIME / "soter.h"), declarations(FOLDER / "soter_gym.h"))
    program = address(ffi, path, f"{prefix}_program", "const soter_program *")
    return ffi, opened(ffi, path), program


def answered_around(
    system: System, outside: Sequence[int], bound: Mapping[str, object]
) -> dict[str, object]:
    """Extern -> what answers it; a component outside is never called, nor is a file of it read."""
    externs = [x for x in (system.components[i] for i in outside) if x.extern]
    return {**bound, **{x.name: refuse_call for x in externs}}


def remove_idle_check(module: Module) -> None:
    """Spares a module with `rest` that is forced to AC the check in flight, in place.

    Nothing follows from what it says, unless somebody reads the module's `margin`.
    """
    if module.forced == "ac" and module.symbol.rest is not None and module.looked is None:
        ttf, safer = (Literal(BOOL, module.symbol.span, x) for x in (False, True))
        module.symbol = replace(module.symbol, ttf=ttf, safer=safer)


def refuse_call(*_: object) -> None:
    """Stands for a component outside where externs are bound; it is never called."""
    raise AssertionError("an environment answers for its plant and its agent itself")


# ---------------------------------------------------------------- kept

_KEPT: OrderedDict[tuple[object, ...], Any] = OrderedDict()
_LOCK = threading.RLock()
KEPT_MAX = 16
"""How many compiled choices are kept; the one that was asked for longest ago goes first."""


def compiled(
    program: soter.api.Program, key: tuple[object, ...], make: Callable[[], CompiledEnvironment]
) -> CompiledEnvironment:
    """The result of `make`, kept for this program and key while its bindings stay as they were.

    C files of externs are looked at again. Python objects that are bound do not matter: `make` is
    given those of the first call, and nobody calls them there.
    """
    texts = [(n, t if isinstance(t, str) else None) for n, t in program.bound.items()]
    whole = (*key, *texts)
    with _LOCK:
        build = kept(program, whole, make)
        if build.linked and build.linked_content != linked_content(
            build.system, build.bindings.core
        ):
            build = kept(program, whole, make, again=True)
    return build


def kept(
    program: soter.api.Program,
    key: tuple[object, ...],
    make: Callable[[], T],
    *,
    again: bool = False,
) -> T:
    """The result of `make`, kept for this key and a program of the same path and content."""
    whole = (Path(program.path).resolve(), program.sha256, key)
    with _LOCK:
        entry: T | None = None if again else _KEPT.get(whole)
        if entry is None:
            entry = _KEPT[whole] = make()
        _KEPT.move_to_end(whole)
        while len(_KEPT) > KEPT_MAX:
            _KEPT.popitem(last=False)
        return entry
