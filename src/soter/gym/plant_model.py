"""Finds the disturbances of a program's plant that explain a step of an environment best.

Purpose: a `PlantModel` is a plant of a program, compiled alone with its disturbances as states; C
finds the disturbances. A `SessionPlant` is that model for one session.
Non-goals: who asks, and what follows (`guard.py`, `plant_conformance.py`); warnings
(`safety_warnings.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen.unit import generate
from soter.gym import compiled_system as compiled
from soter.gym.compiled_system import LeafBuffer, memory_leaves
from soter.gym.environment_choices import chosen_plant, wrong_choice
from soter.language.elaborate.derived_systems import bare_system, faultless, with_components
from soter.language.model.tree_walk import lets_that_choose
from soter.language.model.types import default_value, leaf_count, leaves

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    import soter.api
    from soter.gym.compiled_system import CompiledEnvironment
    from soter.language.model.system import Component, System

    Array = npt.NDArray[np.float64]


ABSOLUTE = 1e-9
SINGLE = 2.0 * float(np.finfo(np.float32).eps)
DOUBLE = 1e-12
"""The tolerances of a state: absolute; relative, if rounded to float32; relative otherwise."""


class PlantModel:
    """A plant of a system, compiled alone, of which `why_no_model` gives None."""

    def __init__(self, system: System, plant: Component) -> None:
        assert plant.plant is not None
        self.names = [
            ".".join((v.name, *path)) for v in plant.plant.states for path, _ in leaves(v.type)
        ]
        self.sizes = [leaf_count(v.type) for v in plant.plant.states]
        self.drawn = [s for d in plant.disturbances for s in d.streams]
        self.low = np.array([d.low for d in plant.disturbances for _ in d.streams])
        self.high = np.array([d.high for d in plant.disturbances for _ in d.streams])
        alone = _plant_alone(system, plant)
        unit = generate(alone)
        self.layout, (component,) = unit.layout, alone.components
        path = compiled.built_library(unit)
        self.ffi, self.lib, self.program = compiled.loaded_driver(path, unit.prefix)
        members = [self.layout.member(0, i) for i in range(len(component.plant.states))]  # type: ignore[union-attr]
        state_leaves = [leaf for offset, t in members for leaf in memory_leaves(t, offset)]
        self.states = LeafBuffer(self.ffi, state_leaves[: len(self.names)])
        self.disturbances = LeafBuffer(self.ffi, state_leaves[len(self.names) :])


def why_no_model(plant: Component) -> str | None:
    """The reason, in words, why no `PlantModel` can be made of a plant; None if one can be made."""
    assert plant.plant is not None
    if plant.plant.extern:
        return f"plant `{plant.name}` is extern in the program"
    if lets_that_choose(plant.plant):
        return f"plant `{plant.name}` chooses"
    return None


def make_plant_model(
    program: soter.api.Program,
    system: str | None,
    plant: str | None,
    params: Mapping[str, object] | None,
) -> PlantModel | None:
    """Makes the model of a program's plant, once; None if `why_no_model` gives a reason."""

    def make_model() -> PlantModel | str:
        flat = program.declared(system, params)
        body = chosen_plant(flat, plant)
        return why_no_model(body) or PlantModel(flat, body)

    model = compiled.kept_result(
        program, ("model", system, plant, repr(sorted((params or {}).items()))), make_model
    )
    return None if isinstance(model, str) else model


class SessionPlant:
    """A `PlantModel` with separate memory, which explains the steps of one session."""

    def __init__(
        self, model: PlantModel, made: CompiledEnvironment, tolerance: Array, relative: float
    ) -> None:
        """`tolerance`: the absolute tolerance of each state (states,); infinite if not compared."""
        self.model = model
        states, drawn = len(model.names), len(model.drawn)
        self.state = np.zeros(-(-model.layout.size // 8), dtype=np.int64)
        self.tolerance = np.ascontiguousarray(tolerance, dtype=np.float64)
        self._all_tolerances = self.tolerance.copy()
        self.observed = np.ones(states, dtype=bool)
        """Which numbers of the states the environment gave in the last step, (states,)."""
        self.origin, self.residual, self.undisturbed = (np.zeros(states) for _ in range(3))
        self.chosen = np.zeros(drawn)
        self._work = np.zeros(states * (drawn + 1))
        ffi = model.ffi
        m = self.pointer = ffi.new("soter_model *")
        here, full = model.layout.groups[0], made.layout.groups[0]
        assert here.struct.size == full.struct.size
        m.program, m.world, m.relative = model.program, made.program, relative
        m.topics_size, m.topics_from, m.topics_at = (here.struct.size, full.offset, here.offset)
        m.states, m.drawn = model.states.fields, model.disturbances.fields
        m.state = ffi.cast("uint8_t *", self.state.ctypes.data)
        model.lib.soter_start(model.program, m.state, 0)
        m.low, m.high = self._pointer(model.low), self._pointer(model.high)
        m.tolerance, m.chosen = (self._pointer(self.tolerance), self._pointer(self.chosen))
        m.origin = self._pointer(self.origin)
        m.residual, m.undisturbed = self._pointer(self.residual), self._pointer(self.undisturbed)
        m.work = self._pointer(self._work)

    @property
    def explained(self) -> bool:
        """Whether disturbances within their bounds explain the last step that was judged."""
        return bool(self.pointer.explained)

    def compare_only(self, wanted: Sequence[bool]) -> None:
        """Compares only the states of the plant whose entry in `wanted` is true."""
        self.observed = np.repeat(wanted, self.model.sizes)
        self.tolerance[:] = np.where(self.observed, self._all_tolerances, np.inf)

    def _pointer(self, array: Array) -> Any:  # noqa: ANN401 - cdata
        return self.model.ffi.cast("double *", array.ctypes.data)


def tolerances(
    model: PlantModel,
    observed: np.dtype[Any] | None,
    absolute: float | Mapping[str, float] | None = None,
) -> tuple[Array, float]:
    """The absolute tolerance of each state, (states,), and the relative one for dtype `observed`.

    If the user sets `absolute`, the relative tolerance is 0. Raises SoterError U001.
    """
    absolute_tolerances = np.full(len(model.names), ABSOLUTE)
    named = absolute if isinstance(absolute, Mapping) else dict.fromkeys(model.names, absolute)
    for name, value in named.items():
        if name not in model.names:
            states = ", ".join(f"`{n}`" for n in model.names)
            raise wrong_choice(f"the plant has no state `{name}`", f"there are {states}")
        if value is not None:
            if not value >= 0.0:
                raise wrong_choice(f"a tolerance cannot be {value!r}", "0 or more")
            absolute_tolerances[model.names.index(name)] = value
    if absolute is not None:
        return absolute_tolerances, 0.0
    single = observed is not None and np.issubdtype(observed, np.floating) and observed.itemsize < 8
    return absolute_tolerances, SINGLE if single else DOUBLE


def _plant_alone(system: System, plant: Component) -> System:
    """The plant without errors and faults; its disturbances become states with fixed values."""
    symbol = plant.plant
    assert symbol is not None
    drawn = tuple(d.variable for d in plant.disturbances)
    nothing = (None,) * len(drawn)
    states = replace(
        symbol,
        states=(*symbol.states, *drawn),
        initial=(*symbol.initial, *nothing),
        initial_range=(*symbol.initial_range, *nothing),
        disturbances=(),
        measured=(),
    )
    changed = replace(
        plant,
        plant=states,
        initial=(*plant.initial, *(default_value(v.type) for v in drawn)),
        initial_range=(*plant.initial_range, *nothing),
        disturbances=(),
        measured=(),
    )
    return faultless(bare_system(with_components(system, (changed,)), [plant.index]))
