"""The memory of many worlds, and the call that steps them.

Purpose: `BatchedStates`, the Python face of `soter_worlds`; `prepared`: a system of a program of
which only an agent is outside.
Non-goals: rewards, ends of episodes, Gymnasium (`vector.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.api.arguments import complete
from soter.gym.compiled_system import CompiledEnvironment, Roles, compiled
from soter.gym.outside_roles import chosen_module, observed_parts, without_python
from soter.language.elaborate.derived_systems import answered_outside

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    import soter.api

    Array = npt.NDArray[Any]

FACTS_DTYPE = np.dtype(
    [
        ("time", "<i8"),
        ("violations", "<u4"),
        ("steps", "<u4"),
        *(
            (n, "?")
            for n in ("mode", "ttf", "safer", "stale", "switched", "taken_by", "gate_fault")
        ),
        ("cause", "u1"),
        ("next_cause", "u1"),
        ("off_model", "?"),
        ("moved", "?"),
        ("reserved", "u1", (5,)),
    ]
)
"""`soter_facts`."""
FACTS = tuple(n for n in FACTS_DTYPE.names or () if n not in ("reserved", "off_model"))


class BatchedStates:
    """States of `count` worlds and everything that comes out of a step."""

    def __init__(self, made: CompiledEnvironment, count: int) -> None:
        self.compiled, self.count = made, count
        view = made.view
        size = made.layout.size
        assert FACTS_DTYPE.itemsize == made.ffi.sizeof("soter_facts")
        self.action_numbers = int(view.action.count)
        self.states = np.zeros((count, size), dtype=np.uint8)
        self.seeds = np.zeros(count, dtype=np.uint64)
        self.facts = np.zeros(count, dtype=FACTS_DTYPE)
        self.applied = np.zeros((count, int(view.apply.count)))
        self._both = [np.zeros((count, int(view.observe.count))) for _ in range(2)]
        self._room = np.zeros(-(-made.room // 8), dtype=np.int64)
        self._begin = np.zeros(count, dtype=np.uint8)
        self._turn = 0
        self.begun = False
        self._worlds = made.ffi.new("soter_worlds *")
        w = self._worlds
        w.view, w.count, w.stride = view, count, count
        w.states = self._at(self.states, "uint8_t *")
        w.begin = self._at(self._begin, "uint8_t *")
        w.seeds = self._at(self.seeds, "uint64_t *")
        w.facts = self._at(self.facts, "soter_facts *")
        w.applied = self._at(self.applied, "double *")
        w.room = self._at(self._room, "uint8_t *")

    def _at(self, array: Array, type_: str) -> Any:  # noqa: ANN401 - cdata
        """Where an array (n,) or (n, m) lies."""
        return self.compiled.ffi.cast(type_, array.ctypes.data)

    @property
    def observations(self) -> Array:
        """What the worlds showed last, (count, numbers)."""
        return self._both[self._turn]

    def begin(self, which: Array) -> None:
        """Begin an episode in the worlds of a mask (count,)."""
        self._begin[:] = which
        self._worlds.observations = self._at(self.observations, "double *")
        done = self.compiled.lib.soter_worlds_begin(self._worlds)
        assert done == self.count, "nobody else is outside"
        self.begun = True

    def step(self, actions: Array, begin: Array) -> Array:
        """Step with `actions` (count, numbers) all worlds but those that `begin` (count,).

        Gives what they showed before, (count, numbers).
        """
        before = self.observations
        self._turn = 1 - self._turn
        self._begin[:] = begin
        w = self._worlds
        w.observations = self._at(self.observations, "double *")
        w.actions = self._at(actions, "double *")
        done = self.compiled.lib.soter_worlds_step(w)
        assert done == self.count, "nobody else is outside"
        return before


def prepared(
    program: soter.api.Program,
    system: str | None,
    module: str | None,
    params: Mapping[str, object] | None,
    observe: tuple[str, ...] | None,
) -> CompiledEnvironment:
    """A system of which the AC of a module is outside, and nobody else; SoterError U001, U003."""

    def make() -> CompiledEnvironment:
        flat = program.declared(system, params)
        notes = complete(flat)
        flat_module = chosen_module(flat, module)
        seen = observed_parts(flat, flat.components[flat_module.ac], observe)
        flat = answered_outside(flat, (flat_module.ac,))
        without_python(flat, flat_module.ac)
        return CompiledEnvironment(
            flat, Roles(flat_module.ac, flat_module.index), program.bound, seen, notes
        )

    key = ("vector", system, module, repr(sorted((params or {}).items())), observe)
    return compiled(program, key, make)
