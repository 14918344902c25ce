"""Configurations of a compiled explorer, as tests read them and reach them.

Purpose: a `Decoder` turns what the explorer stored (`explore/engine/c/soter_explore.h`: state
struct, schedule) into the world and the canonical tuple of the brute-force enumerator.
`stored_configurations` gives what a search kept, `packed_bits` and `unpack_bits` go from a
configuration to its bits and back, `replay` runs a trace in C.
Non-goals: exploring, enumerating.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from generators.brute_force import Held, World
from soter.core.layout import (
    COMPONENT,
    MODULE,
    StateLayout,
    decode_from,
    size_of,
    state_layout,
)
from soter.explore.engine.explorer_library import array_pointer, array_to_steps, steps_to_array
from soter.explore.engine.shrink import Guided
from soter.explore.judge import INPUT
from soter.explore.trace import CHOOSE_STREAM_ENDING
from soter.language.model.types import MODE
from soter.semantics.configuration import Configuration
from soter.semantics.draws import fnv1a_64

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from generators.brute_force import BruteForce, Canonical
    from soter.core.layout import Bytes, Words
    from soter.explore.engine.explorer_library import Engine, RawStep
    from soter.explore.model.exploration_plan import ExplorationPlan
    from soter.language.model.system import Component, System
    from soter.language.model.types import Value

NO_VIOLATION = (0, 2**32 - 1)
NOTHING_OWED = 2**63 - 1
_COMPONENT = struct.Struct("<qIBBBBB7x")
_MODULE = struct.Struct("<qqIIIIBBBBBB2x")


class Decoder:
    """Reads the worlds of one test; `plan` says in which order the explorer has its actors."""

    def __init__(self, judge: BruteForce, plan: ExplorationPlan) -> None:
        self.judge = judge
        self.system: System = judge.system
        self.plan = plan
        self.layout: StateLayout = state_layout(self.system)
        components = len(self.system.components)
        place = {
            a.component if a.component is not None else components + (a.input or 0): i
            for i, a in enumerate(plan.actors)
        }
        self.order = [place[i] for i in range(len(plan.actors))]
        """Per actor of the enumerator the explorer's number of it."""

    def canonical(self, world: bytes) -> Canonical:
        """The canonical configuration of a world."""
        return self.judge.canonical(self.world(world))

    def world(self, world: bytes) -> World:
        """A world as the enumerator has it."""
        actors, modules = len(self.plan.actors), len(self.system.modules)
        timed = len(self.judge.plan.timed)
        at = _padded(self.layout.size)
        (now,) = struct.unpack_from("<q", world, at)
        at += 8
        due = struct.unpack_from(f"<{timed}q", world, at)
        at += 8 * timed
        verdict = struct.unpack_from(f"<{modules}q", world, at)
        at += 8 * modules
        done = struct.unpack_from(f"<{actors}I", world, at)
        lost = struct.unpack_from(f"<{actors}I", world, at + 4 * actors)
        at += 8 * actors
        acted = struct.unpack_from(f"<{modules}B", world, at)
        held = self._held(world, _padded(at + modules))
        return World(
            self._configuration(world, now),
            tuple(done[i] for i in self.order),
            tuple(lost[i] for i in self.order),
            tuple(held.get(i) for i in self.order),
            tuple(None if d == NOTHING_OWED else d for d in due),
            verdict,
            tuple(bool(a) for a in acted),
        )

    def _held(self, world: bytes, at: int) -> dict[int, Held]:
        held_by_actor = {}
        for i, a in enumerate(self.plan.actors):
            if not a.overrun_ns:
                continue
            since, mask = struct.unpack_from("<qQ", world, at)
            at += 16
            published = []
            for k, topic in enumerate(a.outputs):
                t = self.system.topics[topic].type
                if mask >> k & 1:
                    published.append((topic, decode_from(world, at, t)))
                at += _padded(size_of(t))
            if since >= 0:
                held_by_actor[i] = Held(since, tuple(sorted(published)))
        return held_by_actor

    def _configuration(self, world: bytes, now: int) -> Configuration:
        layout, system = self.layout, self.system
        components = [
            _COMPONENT.unpack_from(world, layout.component_offset + i * COMPONENT.size)
            for i in range(len(system.components))
        ]
        modules = [
            _MODULE.unpack_from(world, layout.module_offset + i * MODULE.size)
            for i in range(len(system.modules))
        ]
        modes = [m[6] for m in modules]
        assert all(mode < len(MODE.members) for mode in modes)
        return Configuration(
            L=tuple(self._locals(world, n, modes) for n in system.components),
            OE=tuple(bool(c[3]) for c in components),
            ct=now,
            FN=(),
            Topics=tuple(
                decode_from(world, layout.topic_offset(t.index), t.type) for t in system.topics
            ),
            stamps=struct.unpack_from(f"<{len(system.topics)}q", world, layout.stamp_offset),
            latched=tuple(bool(c[4]) for c in components),
            had_control=tuple(bool(c[5]) for c in components),
            gate_fault=tuple(bool(m[7]) for m in modules),
            clean_needed=tuple(m[5] for m in modules),
        )

    def _locals(self, world: bytes, n: Component, modes: list[int]) -> Value:
        if n.role == "dm":
            assert n.module is not None
            return modes[n.module]
        variables = n.node.locals if n.node else n.plant.states if n.plant else ()
        values = []
        for i in range(len(variables)):
            offset, t = self.layout.member(n.index, i)
            values.append(decode_from(world, offset, t))
        return tuple(values)


def _padded(size: int) -> int:
    return (size + 7) // 8 * 8


def replay(
    engine: Engine,
    steps: Sequence[RawStep],
    broken: tuple[int, int] | None = None,
    seed: int = 0,
) -> tuple[int, bool, npt.NDArray[np.uint8]]:
    """Runs steps in C: how many of them are possible, whether they end in `broken`, configurations.

    Nothing but `broken` ends the run. Configurations: (possible, configuration_size), the one after
    each step.
    """
    guided = Guided(engine, seed, broken or NO_VIOLATION)
    run = guided.execute_along(steps_to_array(steps), len(steps))
    made = array_to_steps(run.steps)
    possible = next(
        (i for i, (a, b) in enumerate(zip(made, steps, strict=False)) if a != b), len(made)
    )
    return possible, run.violates and possible == len(steps), run.configurations[:possible]


def asking_stream(actor: str) -> int:
    """The hash of the stream from which the steps of an actor ask for a choice."""
    return fnv1a_64(actor if actor.startswith(INPUT) else actor + CHOOSE_STREAM_ENDING)


def packed_bits(engine: Engine, configuration: Bytes) -> Words:
    """The bits of a configuration: (configuration_size,) -> (words,)."""
    words = np.zeros(engine.words, dtype=np.uint64)
    engine.model.pack(
        array_pointer(engine.ffi, "void *", configuration),
        array_pointer(engine.ffi, "uint64_t *", words),
    )
    return words


def unpack_bits(engine: Engine, words: Words, configuration: Bytes) -> None:
    """Unpacks bits, (words,), into a configuration that the engine has started before."""
    engine.model.unpack(
        array_pointer(engine.ffi, "uint64_t *", words),
        array_pointer(engine.ffi, "void *", configuration),
    )


def stored_configurations(engine: Engine) -> Bytes:
    """The configurations that the last search kept: (states, configuration_size)."""
    kept, count = engine._kept, 0
    if kept != engine.ffi.NULL:
        count = int(engine.lib.soter_explore_kept(engine.model, kept, engine.ffi.NULL))
    configurations = np.zeros((count, engine.configuration_size), dtype=np.uint8)
    if count:
        place = array_pointer(engine.ffi, "void *", configurations)
        engine.lib.soter_explore_kept(engine.model, kept, place)
    return configurations
