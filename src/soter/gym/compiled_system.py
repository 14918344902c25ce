"""Compiles a system in which a caller answers for the agent, once for all environments.

Purpose: a `CompiledEnvironment` has the library of a system, the C driver of `c/` on it, and where
numbers lie in a state; `kept_build` keeps it, so that the next environment only needs a
state.
Non-goals: states (`session.py`, `vector.py`), what numbers mean to Gymnasium (`array_mapping.py`).
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from soter.api.running import RecentlyUsed
from soter.campaign.batch_flights import BATCH
from soter.campaign.compiled_unit import generate_measured
from soter.codegen.externs import answer_fields
from soter.core.layout import lay_out, placed_leaves, scalar, state_dtype
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.gym.environment_choices import is_flat
from soter.language.model.typed import Literal
from soter.language.model.types import BOOL, BoolType, EnumType, FloatType, IntType
from soter.native.c_interface import address, declarations, interface, open_library
from soter.native.compiler import FAST, vector_flags
from soter.native.extern_bindings import Bindings, bind
from soter.native.kept_state import why_it_keeps_state
from soter.native.loaded_program import Library
from soter.native.shared_library import RUNTIME, library
from soter.simulate.externs.c_extern import linked_c_hash, linked_symbols
from soter.simulate.externs.callables import load_callables
from soter.simulate.interrupt import StopRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import soter.api
    from soter.codegen.unit import Unit
    from soter.gym.environment_choices import ObservedPart
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type

T = TypeVar("T")
FOLDER = Path(__file__).resolve().parent / "c"
ENGINE = (
    *(FOLDER / f"soter_gym{name}" for name in (".c", "_explain.c", "_python.c", ".h", "_leaves.h")),
    BATCH.with_suffix(".h"),
)
OPTIMISE = "-O3"
"""Learners take millions of steps: the kernel's small functions are worth inlining."""
NOBODY = 2**32 - 1
FLOAT_KIND, BOOL_KIND = 0, 1
INT_KINDS = {"b": 2, "B": 3, "h": 4, "H": 5, "i": 6, "I": 7, "q": 8}
_KEPT: RecentlyUsed[Any] = RecentlyUsed()
_LOCK = threading.RLock()


class MemoryLeaf(NamedTuple):
    """The offset of a number in memory, its `soter_leaf_kind`, and the range of an int or enum."""

    offset: int
    kind: int
    low: int = 0
    high: int = 0


def memory_leaves(t: Type, offset: int) -> Iterator[MemoryLeaf]:
    """The leaves of a value of type `t` at `offset`, in declared order."""
    return (_memory_leaf(leaf, at) for _, leaf, at in placed_leaves(t, offset))


def _memory_leaf(t: Type, offset: int) -> MemoryLeaf:
    if isinstance(t, FloatType):
        return MemoryLeaf(offset, FLOAT_KIND)
    if isinstance(t, BoolType):
        return MemoryLeaf(offset, BOOL_KIND)
    storage = scalar(t)
    assert storage is not None, t
    if isinstance(t, EnumType):
        return MemoryLeaf(offset, INT_KINDS[storage.format], 0, len(t.members) - 1)
    assert isinstance(t, IntType)
    return MemoryLeaf(offset, INT_KINDS[storage.format], t.low, t.high)


class LeafBuffer:
    """An array of leaves in C memory, as `soter_leaves` needs it; this object keeps it alive."""

    def __init__(self, ffi: Any, leaves: Sequence[MemoryLeaf], size: int = 0) -> None:  # noqa: ANN401 - cffi
        self.count = len(leaves)
        self.memory = ffi.new("soter_leaf[]", [tuple(leaf) for leaf in leaves] or 1)
        self.fields = {"at": self.memory, "count": len(leaves), "size": size}


@dataclass(frozen=True)
class Roles:
    """The indices of the agent, the module whose AC it is, and a plant that the caller moves."""

    agent: int
    module: int | None = None
    plant: int | None = None


class CompiledEnvironment:
    """A compiled system, the parts that a caller answers for, and `soter_view` of both."""

    def __init__(
        self,
        system: System,
        roles: Roles,
        bound: Mapping[str, object],
        observed: Sequence[ObservedPart] = (),
        notes: Sequence[str] = (),
    ) -> None:
        """`observed`: the parts of an observation. Raises SoterError as `bind` and the compiler do.

        `bound` answers the other externs; the agent and plant of `roles` are never called. `notes`:
        remarks from the computation of `ttf` and `safer`.
        """
        self.system, self.roles, self.notes = system, roles, tuple(notes)
        outside = [i for i in (roles.agent, roles.plant) if i is not None]
        silent = {system.components[i].name: refuse_call for i in outside}
        self.bindings = bind(system, {**bound, **silent})
        core = self.bindings.core
        functions = [x for x in self.bindings.externs if x.kind == "function"]
        load_callables(Bindings(system, core, functions), "native", StopRequest())
        self.linked = any(text.startswith("c:") for text in self.bindings.binding_texts().values())
        self.linked_c_hash = linked_c_hash(system, core)
        unit = generate_measured(system, core)
        self.layout = unit.layout
        self.dtype = state_dtype(self.layout)
        path = built_library(unit)
        _require_no_kept_state(unit)
        owners = linked_symbols(system, core)
        self.library = Library(path, unit.prefix, self.layout.size, owners)
        self.ffi, self.lib, self.program = loaded_driver(path, unit.prefix, owners)
        self.answers = {c.index: lay_out(answer_fields(c)) for c in system.components if c.extern}
        self.observed = tuple(observed)
        self.view = self._c_view()

    def _c_view(self) -> Any:  # noqa: ANN401 - cdata
        system, roles = self.system, self.roles
        agent = system.components[roles.agent]
        plant = None if roles.plant is None else system.components[roles.plant]
        self.moves_numbers = plant is not None and is_flat(self._state_types(plant))
        self.acts_numbers = is_flat(t for _, t in answer_fields(agent))
        self.commands_numbers = is_flat(system.topics[t].type for t in self._applied_topics())
        module = None if roles.module is None else system.modules[roles.module]
        self.buffers = self._leaf_buffers(agent, plant)
        return self.ffi.new(
            "soter_view *",
            {
                "program": self.program,
                "module": -1 if roles.module is None else roles.module,
                "looks": 0 if module is None else module.looks,
                "late_ns": 0 if module is None else module.late_ns,
                "agent": roles.agent,
                "plant": NOBODY if roles.plant is None else roles.plant,
                "answer_most": self.largest_answer_bytes,
                "plain": self.lib.soter_is_plain(self.program),
                **{name: leaves.fields for name, leaves in self.buffers.items()},
            },
        )

    def _leaf_buffers(self, agent: Component, plant: Component | None) -> dict[str, LeafBuffer]:
        """The leaves of each array of numbers, by the name that the array has in the C driver."""
        sizes = {i: x.size for i, x in self.answers.items()}
        action, answer = self._answer_leaves(agent) if self.acts_numbers else ([], [])
        moved: list[MemoryLeaf] = []
        start: list[MemoryLeaf] = []
        if plant is not None and self.moves_numbers:
            (moved, _), start = self._answer_leaves(plant), self.truth_leaves(plant)
        applied = self._applied_topics() if self.commands_numbers else ()
        observed = [
            leaf
            for x in self.observed
            for leaf in (
                self.truth_leaves(self.system.components[x.index])
                if x.truth
                else self.topic_leaves(x.index)
            )
        ]
        outputs, proposed = self._shield_leaves()
        return {
            "action": LeafBuffer(self.ffi, action, sizes[agent.index]),
            "given": LeafBuffer(self.ffi, answer, sizes[agent.index]),
            "moved": LeafBuffer(self.ffi, moved, 0 if plant is None else sizes[plant.index]),
            "start": LeafBuffer(self.ffi, start),
            "observe": LeafBuffer(self.ffi, observed),
            "apply": LeafBuffer(self.ffi, [leaf for t in applied for leaf in self.topic_leaves(t)]),
            "outputs": LeafBuffer(self.ffi, outputs),
            "proposed": LeafBuffer(self.ffi, proposed),
        }

    def _shield_leaves(self) -> tuple[list[MemoryLeaf], list[MemoryLeaf]]:
        """The leaves that the module publishes and those that AC proposed; [] without a shield."""
        if self.roles.module is None:
            return [], []
        module = self.system.modules[self.roles.module]
        if module.shield is None or module.shield.proposed is None:
            return [], []
        outputs = [leaf for t in module.outputs for leaf in self.topic_leaves(t)]
        return outputs, self.topic_leaves(module.shield.proposed)[: len(outputs)]

    @property
    def largest_answer_bytes(self) -> int:
        """The bytes of the largest answer of an extern."""
        return max([8, *(x.size for x in self.answers.values())])

    @property
    def driver_bytes(self) -> int:
        """The bytes of scratch memory that the driver needs."""
        return self.layout.size + self.largest_answer_bytes

    def topic_leaves(self, index: int) -> list[MemoryLeaf]:
        """The leaves of a topic in the memory of a state."""
        return list(memory_leaves(self.system.topics[index].type, self.layout.topic_offset(index)))

    def truth_leaves(self, plant: Component) -> list[MemoryLeaf]:
        """The leaves of a plant's true states in the memory of a state."""
        members = [self.layout.member(plant.index, i) for i in range(len(self._state_types(plant)))]
        return [leaf for offset, t in members for leaf in memory_leaves(t, offset)]

    @staticmethod
    def _state_types(plant: Component) -> list[Any]:
        assert plant.plant is not None
        return [v.type for v in plant.plant.states]

    def _applied_topics(self) -> Sequence[int]:
        """The topics that the caller's plant reads; without a plant, those the agent publishes."""
        if self.roles.plant is not None:
            plant = self.system.components[self.roles.plant]
            assert plant.plant is not None
            return plant.reads
        agent = self.system.components[self.roles.agent]
        assert agent.node is not None
        return agent.writes

    def _answer_leaves(self, component: Component) -> tuple[list[MemoryLeaf], list[MemoryLeaf]]:
        """The leaves of an extern's answer, and the flags that say which outputs it published."""
        members = sorted(self.answers[component.index].members, key=lambda m: m.index)
        count = len(members) if component.plant is not None else len(members) // 2
        values = [leaf for m in members[:count] for leaf in memory_leaves(m.type, m.offset)]
        return values, [leaf for m in members[count:] for leaf in memory_leaves(m.type, m.offset)]


def _require_no_kept_state(unit: Unit) -> None:
    """Raises SoterError X008 for linked C code that may keep a state that a reset cannot clear."""
    why = why_it_keeps_state(unit)
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


def built_library(unit: Unit) -> Path:
    """Builds the library of a unit, including the C files of `ENGINE`, for this machine only."""
    return library(unit, OPTIMISE, (*FAST, *vector_flags()), ENGINE)


def loaded_driver(
    path: Path, prefix: str, owners: Mapping[str, str] | None = None
) -> tuple[Any, Any, Any]:
    """Gives cffi, the functions and the program of a library that was built with `ENGINE`.

    `owners` are the C files that should define the functions of bindings, for the error X004.
    """
    ffi = interface(declarations(RUNTIME / "soter.h"), declarations(FOLDER / "soter_gym.h"))
    lib = open_library(ffi, path, owners)
    program = address(ffi, path, f"{prefix}_program", "const soter_program *")
    return ffi, lib, program


def bindings_inside(
    system: System, outside: Sequence[int], bound: Mapping[str, object]
) -> dict[str, object]:
    """The bindings `bound`, but `refuse_call` for externs `outside`, whose files are not read."""
    externs = [x for x in (system.components[i] for i in outside) if x.extern]
    return {**bound, **{x.name: refuse_call for x in externs}}


def remove_idle_check(module: Module) -> None:
    """Replaces in place the flight check of a module forced to AC if nobody reads its `margin`."""
    if module.forced == "ac" and module.symbol.rest is not None and module.looked is None:
        ttf, safer = (Literal(BOOL, module.symbol.span, x) for x in (False, True))
        module.symbol = replace(module.symbol, ttf=ttf, safer=safer)


def refuse_call(*_: object) -> None:
    """Takes the place of an extern that the caller answers for; it is never called."""
    raise AssertionError("an environment answers for its plant and its agent itself")


def kept_build(
    program: soter.api.Program, key: tuple[object, ...], make: Callable[[], CompiledEnvironment]
) -> CompiledEnvironment:
    """Gives the result of `make`, cached for the program and key until its bindings change.

    Changed C files of externs cause a new build. Bound Python objects do not matter: `make` gets
    those of the first call, and nobody calls them there.
    """
    texts = [(n, t if isinstance(t, str) else None) for n, t in program.bound.items()]
    full_key = (*key, *texts)
    with _LOCK:
        build = kept_result(program, full_key, make)
        if build.linked and build.linked_c_hash != linked_c_hash(build.system, build.bindings.core):
            build = kept_result(program, full_key, make, again=True)
    return build


def kept_result(
    program: soter.api.Program,
    key: tuple[object, ...],
    make: Callable[[], T],
    *,
    again: bool = False,
) -> T:
    """Gives the result of `make`, cached for the key and all programs of equal path and content."""
    full_key = (Path(program.path).resolve(), program.sha256, key)
    with _LOCK:
        entry: T = _KEPT.get_or_make(full_key, make, again=again)
        return entry
