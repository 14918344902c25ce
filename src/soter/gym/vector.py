"""Steps thousands of worlds of a program, with a module in front, in one call.

Purpose: in a `ProtectedVector` (`make_vec`) the plant of the program is the environment, and the
agent answers for the advanced controller of all worlds with one array (docs/gym.md).
`BatchedStates` is the memory of the worlds, and calls `soter_worlds` of C, which steps them.
Non-goals: plants that live in Python (`protected.py`); learning.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import soter.api
from soter.api.computed_ttf import compute_ttf
from soter.gym import array_mapping
from soter.gym.compiled_system import (
    CompiledEnvironment,
    Roles,
    bindings_inside,
    kept_build,
    remove_idle_check,
)
from soter.gym.environment_choices import (
    CAUSES,  # noqa: F401 - docs/gym.md names it here
    chosen_module,
    observed_parts,
    require_no_shared_extern,
    wrong_choice,
)
from soter.gym.safety_warnings import warn_of_no_control
from soter.language.elaborate.derived_systems import with_unbound_externs
from soter.simulate.run_options import seed_value

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    import numpy.typing as npt

    Array = npt.NDArray[Any]
    Judge = Callable[[Array, Array, Array], Array]


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
    """The states of `count` worlds, and the arrays that C fills when it steps them."""

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
        self._room = np.zeros(-(-made.driver_bytes // 8), dtype=np.int64)
        self._begin = np.zeros(count, dtype=np.uint8)
        self._turn = 0
        self.begun = False
        self._worlds = made.ffi.new("soter_worlds *")
        w = self._worlds
        w.view, w.count, w.stride = view, count, count
        w.states = self._pointer(self.states, "uint8_t *")
        w.begin = self._pointer(self._begin, "uint8_t *")
        w.seeds = self._pointer(self.seeds, "uint64_t *")
        w.facts = self._pointer(self.facts, "soter_facts *")
        w.applied = self._pointer(self.applied, "double *")
        w.room = self._pointer(self._room, "uint8_t *")

    def _pointer(self, array: Array, type_: str) -> Any:  # noqa: ANN401 - cdata
        return self.compiled.ffi.cast(type_, array.ctypes.data)

    @property
    def observations(self) -> Array:
        """The last observations of the worlds, (count, numbers)."""
        return self._both[self._turn]

    def begin_episodes(self, which: Array) -> None:
        """Begins an episode in each world that the mask `which` (count,) selects."""
        self._begin[:] = which
        self._worlds.observations = self._pointer(self.observations, "double *")
        done = self.compiled.lib.soter_worlds_begin(self._worlds)
        assert done == self.count, "nobody else is outside"
        self.begun = True

    def step(self, actions: Array, begin: Array) -> Array:
        """Steps worlds, or begins those of `begin` (count,); gives the old observations, (n, m)."""
        before = self.observations
        self._turn = 1 - self._turn
        self._begin[:] = begin
        w = self._worlds
        w.observations = self._pointer(self.observations, "double *")
        w.actions = self._pointer(actions, "double *")
        done = self.compiled.lib.soter_worlds_step(w)
        assert done == self.count, "nobody else is outside"
        return before

    def publishable_masks(self, answers: Array) -> Array:
        """Whether each agent would publish each of `answers` (n, numbers) unchanged, (count, n)."""
        found = np.zeros((self.count, len(answers)), dtype=np.uint8)
        arrays = self._pointer(answers, "double *"), len(answers), self._pointer(found, "uint8_t *")
        self.compiled.lib.soter_worlds_mask(self._worlds, *arrays)
        return found.astype(np.bool_)


def many_worlds_environment(
    program: soter.api.Program,
    system: str | None,
    module: str | None,
    params: Mapping[str, object] | None,
    observe: tuple[str, ...] | None,
) -> CompiledEnvironment:
    """Compiles a system in which a caller answers for the agent alone; SoterError U001 or U003."""

    def make_environment() -> CompiledEnvironment:
        flat = program.declared(system, params)
        flat_module = chosen_module(flat, module)
        remove_idle_check(flat_module)
        notes = compute_ttf(flat, bound=bindings_inside(flat, (flat_module.ac,), program.bound))
        seen = observed_parts(flat, flat.components[flat_module.ac], observe)
        flat = with_unbound_externs(flat, (flat_module.ac,))
        require_no_shared_extern(flat, flat_module.ac)
        return CompiledEnvironment(
            flat, Roles(flat_module.ac, flat_module.index), program.bound, seen, notes
        )

    key = ("vector", system, module, repr(sorted((params or {}).items())), observe)
    return kept_build(program, key, make_environment)


ENDS = (None, "terminate", "truncate")
SEED_BITS = 2**64 - 1


class ProtectedVector(VectorEnv[Any, Any, Any]):
    """`num_envs` worlds of a program, in each of which the agent is the AC of a module.

    `program`, `system`, `module`, `params`: as in `Protected`. `observe`: the names of the parts of
    an observation: topics (`"car"`) and true states of plants (`"car.truth"`). By default these are
    the topics that the advanced controller reads, or if it reads none, the states of all plants.

    `actions`: the rows (n, numbers) among which the agent chooses; the space is then `Discrete(n)`,
    and an action is the number of a row. By default the space is that of the published values.

    `reward(observation, action, next)`, `terminate(observation, action, next)`: functions from
    arrays (num_envs, numbers) to (num_envs,); `action` is the value that the module published, from
    the agent or SC. The default reward is 0. `on_violation`: `"terminate"` or `"truncate"` an
    episode in which a property is violated. `max_steps`: the number of agent steps after which an
    episode is truncated (0: never). By default an episode is truncated at the agent's last release
    up to the system's `until`, or at the next release that is not lost.

    `autoreset`: Gymnasium's `AutoresetMode`. Equal seeds give equal episodes: the first one of
    world k is that of `simulate(seed=seed + k)`, the j-th after it has `seed + k + j * num_envs`.
    `copy`: if False, later steps overwrite the arrays (the next but one). Raises SoterError U001
    for a wrong choice, U003 for a program that needs foreign Python or C, and the program's errors.
    """

    def __init__(
        self,
        program: str | Path | soter.api.Program,
        num_envs: int,
        *,
        system: str | None = None,
        module: str | None = None,
        params: Mapping[str, object] | None = None,
        observe: Sequence[str] | None = None,
        actions: Any = None,  # noqa: ANN401 - whatever NumPy takes
        reward: Judge | None = None,
        terminate: Judge | None = None,
        on_violation: str | None = None,
        max_steps: int | None = None,
        autoreset: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        dtype: Any = np.float64,  # noqa: ANN401 - whatever NumPy takes
        copy: bool = True,
    ) -> None:
        self.autoreset = _checked_autoreset(num_envs, on_violation, max_steps, autoreset, dtype)
        loaded = program if isinstance(program, soter.api.Program) else soter.api.load(program)
        made = many_worlds_environment(
            loaded, system, module, params, None if observe is None else tuple(observe)
        )
        warn_of_no_control(made, stacklevel=3)
        self.compiled = made
        self.num_envs = num_envs
        self.metadata = {"autoreset_mode": self.autoreset, "render_modes": []}
        self._reward, self._terminate, self._on_violation = reward, terminate, on_violation
        self._max_steps = max_steps or 0
        self._end_ns = _last_release_ns(made) if max_steps is None else None
        self._copy = copy
        agent = made.system.components[made.roles.agent]
        outputs = array_mapping.topics_published(made.system, agent)
        self.worlds = BatchedStates(made, num_envs)
        self._choices = None if actions is None else self._checked_action_rows(actions, None)
        self.single_action_space = (
            array_mapping.action_space(outputs)
            if self._choices is None
            else spaces.Discrete(len(self._choices))
        )
        self.single_observation_space = array_mapping.observation_space(
            made.system, made.observed, dtype
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._dtype = np.dtype(dtype)
        self._over = np.ones(num_envs, dtype=bool)
        self._violations_before = np.zeros(num_envs, dtype=np.uint32)
        self._cost = np.zeros(num_envs)

    # ------------------------------------------------------------ Gymnasium

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begins an episode in every world, or in the worlds of `options["reset_mask"]`.

        Gives observations (num_envs, numbers). Without `seed`, each world continues with its next
        seed.
        """
        mask = _reset_mask(options, self.num_envs)
        worlds = self.worlds
        if seed is not None:
            worlds.seeds[mask] = self._world_seeds(seed)[mask]
            if isinstance(seed, int):
                super().reset(seed=seed)
        elif not worlds.begun:
            first = int(self.np_random.integers(2**63))
            worlds.seeds[:] = self._world_seeds(first)
        if not worlds.begun and not mask.all():
            raise wrong_choice("no world has begun an episode yet", "reset all of them first")
        worlds.begin_episodes(mask)
        self._over[mask] = False
        self._violations_before[mask] = worlds.facts["violations"][mask]
        self._cost = np.zeros(self.num_envs)
        return self._shown_observations(), self._step_info()

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:  # noqa: ANN401
        """Steps every world with its action, (num_envs,) or (num_envs, numbers).

        Gives observations (num_envs, numbers), and rewards, terminations and truncations
        (num_envs,). A world whose episode is over begins the next episode as `autoreset` says.
        """
        worlds = self.worlds
        if not worlds.begun:
            raise wrong_choice("no episode has begun", "call reset() first")
        again = self._over
        if self.autoreset is AutoresetMode.DISABLED and again.any():
            raise wrong_choice(
                f"the episode of world {int(again.argmax())} is over",
                'call reset(options={"reset_mask": mask}) first',
            )
        asked = self._checked_action_rows(self._rows_of_actions(actions), self.num_envs)
        before = worlds.step(asked, again)
        self._violations_before[again] = worlds.facts["violations"][again]
        self._cost = (worlds.facts["violations"] - self._violations_before).astype(np.float64)
        rewards, ended, cut = self._rewards_and_ends(before)
        if again.any():
            rewards[again] = 0.0
            ended[again] = cut[again] = False
        self._over = ended | cut
        info: dict[str, Any] = {}
        if self.autoreset is AutoresetMode.SAME_STEP and self._over.any():
            info = {
                "final_obs": self._shown_observations(keep=True),
                "final_info": self._step_info(asked, keep=True),
                "_final_obs": self._over.copy(),
                "_final_info": self._over.copy(),
            }
            worlds.begin_episodes(self._over)
            self._over = np.zeros(self.num_envs, dtype=bool)
        self._violations_before[:] = worlds.facts["violations"]
        return self._shown_observations(), rewards, ended, cut, {**self._step_info(asked), **info}

    # ------------------------------------------------------------ arrays

    def _world_seeds(self, seed: int | Sequence[int]) -> npt.NDArray[np.uint64]:
        """The seeds of all worlds, (num_envs,)."""
        if isinstance(seed, (int, np.integer)):
            first = seed_value(int(seed))
            seeds = [(first + k) & SEED_BITS for k in range(self.num_envs)]
        elif isinstance(seed, Iterable) and not isinstance(seed, (str, dict)):
            seeds = [seed_value(s) for s in seed]
        else:
            message = f"`seed` cannot be {str(seed)[:40]!r}"
            raise wrong_choice(message, "give a whole number, or one for each world")
        if len(seeds) != self.num_envs:
            message = f"there are {len(seeds)} seeds for {self.num_envs} worlds"
            raise wrong_choice(message, "give one seed, or one for each world")
        return np.array(seeds, dtype=np.uint64)

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Whether AC would publish each `Discrete` action unchanged, (num_envs, n); raises U001."""
        space = self.single_action_space
        if not isinstance(space, spaces.Discrete):
            raise wrong_choice(
                f"only a `Discrete` action space has a mask, and it is {space}",
                "make_vec(..., actions=...) says which commands the agent chooses among",
            )
        choices = self._choices
        if choices is None:
            choices = int(space.start) + np.arange(int(space.n), dtype=np.float64)[:, None]
        masks = self.worlds.publishable_masks(choices)
        masks[self._over] = False  # their agents have nothing to answer
        return masks

    def _rows_of_actions(self, actions: Any) -> Any:  # noqa: ANN401 - NumPy, torch, lists
        """The rows of `actions=` with these indices; the actions themselves without `actions=`."""
        if self._choices is None:
            return actions
        rows = np.asarray(actions)
        inside = rows.shape == (self.num_envs,) and np.issubdtype(rows.dtype, np.integer)
        if not inside or rows.min() < 0 or rows.max() >= len(self._choices):
            message = f"actions are no {self.num_envs} numbers of the {len(self._choices)} rows"
            raise wrong_choice(message, "one whole number a world, from 0 on")
        return self._choices[rows]

    def _checked_action_rows(self, actions: Any, count: int | None) -> Array:  # noqa: ANN401 - NumPy, torch, lists
        """The actions as doubles, (count, numbers); if `count` is None, any number of rows."""
        array = actions.detach().cpu() if hasattr(actions, "detach") else actions
        rows = array_mapping.array_of_doubles(array, "an array of actions")
        needed = self.worlds.action_numbers
        if rows.ndim == 1 and needed == 1:
            rows = rows[:, None]
        if count is None:
            count = max(1, len(rows)) if rows.ndim else 1
        if rows.shape != (count, needed):
            raise wrong_choice(
                f"actions have the shape {np.shape(actions)}, not {(count, needed)}",
                "one row a world, one number for each that its advanced controller publishes",
            )
        return np.ascontiguousarray(rows)

    def _shown_observations(self, *, keep: bool = False) -> Array:
        """The observations of all worlds, (num_envs, numbers), as the caller's dtype."""
        observations = self.worlds.observations
        if self._dtype != np.float64:
            return observations.astype(self._dtype)
        return observations.copy() if self._copy or keep else observations

    def _rewards_and_ends(self, before: Array) -> tuple[Array, Array, Array]:
        """Rewards, terminations and truncations, (num_envs,), of a step from `before` (n, m)."""
        worlds, n = self.worlds, self.num_envs
        facts, seen = worlds.facts, (before, worlds.applied, worlds.observations)
        rewards = (
            np.zeros(n)
            if self._reward is None
            else _checked_column(self._reward(*seen), n, "reward")
        )
        ended = np.zeros(n, dtype=bool)
        if self._terminate is not None:
            ended = _checked_column(self._terminate(*seen), n, "terminate").astype(bool)
        cut = np.zeros(n, dtype=bool)
        if self._max_steps:
            cut = facts["steps"] >= self._max_steps
        if self._end_ns is not None:
            cut = facts["time"] >= self._end_ns
        if self._on_violation is not None:
            violated = self._cost > 0.0
            ended, cut = (
                (ended | violated, cut)
                if self._on_violation == "terminate"
                else (ended, cut | violated)
            )
        return rewards, ended, cut

    def _step_info(self, asked: Array | None = None, *, keep: bool = False) -> dict[str, Any]:
        facts = self.worlds.facts
        applied = self.worlds.applied
        if self._copy or keep:
            facts, applied = facts.copy(), applied.copy()
        info = {name: facts[name] for name in FACTS}
        info["action_taken"] = applied
        info["cost"] = self._cost
        if asked is not None:
            info["intervened"] = ~facts["taken_by"] | facts["gate_fault"] | facts["moved"]
            info["action_requested"] = asked
        return info


def _checked_autoreset(
    num_envs: int,
    on_violation: str | None,
    max_steps: int | None,
    autoreset: AutoresetMode | str,
    dtype: Any,  # noqa: ANN401 - whatever NumPy takes
) -> AutoresetMode:
    """The chosen autoreset mode; raises SoterError U001 if any of these choices is wrong."""
    if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
        raise wrong_choice(f"there cannot be {num_envs!r} worlds", "num_envs is 1 or more")
    if on_violation not in ENDS:
        raise wrong_choice(
            f"`on_violation` cannot be {on_violation!r}", "'terminate', 'truncate' or None"
        )
    if max_steps is not None and (not isinstance(max_steps, int) or max_steps < 0):
        raise wrong_choice(f"an episode cannot last {max_steps!r} steps", "0: without an end")
    if not np.issubdtype(np.dtype(dtype), np.floating):
        raise wrong_choice(f"observations cannot be {dtype!r}", "np.float64 or np.float32")
    try:
        return AutoresetMode(autoreset)
    except ValueError as error:
        known = ", ".join(f"`{m.value}`" for m in AutoresetMode)
        raise wrong_choice(f"`autoreset` cannot be {autoreset!r}", f"there are {known}") from error


def _last_release_ns(made: CompiledEnvironment) -> int | None:
    """The agent's last release up to the system's end, at least its second; None without an end."""
    agent, until = made.system.components[made.roles.agent], made.system.until_ns
    if until is None:
        return None
    return agent.phase_ns + max(1, (until - agent.phase_ns) // agent.period_ns) * agent.period_ns


def _reset_mask(options: dict[str, Any] | None, count: int) -> npt.NDArray[np.bool_]:
    """The mask of the worlds to reset, (count,), by default all; raises SoterError U001."""
    if options is None or "reset_mask" not in options:
        return np.ones(count, dtype=bool)
    mask = np.asarray(options["reset_mask"])
    if mask.shape != (count,) or mask.dtype != np.bool_:
        raise wrong_choice("`reset_mask` is no array of a bool for each world")
    return mask


def _checked_column(values: Any, count: int, name: str) -> Array:  # noqa: ANN401 - what a function gave
    """The result of the user's function `name`, one number a world, (count,); SoterError U001."""
    column = np.asarray(values)
    if column.shape != (count,):
        raise wrong_choice(f"`{name}` gave the shape {column.shape}, not {(count,)}")
    return column.astype(np.float64)


def make_vec(
    program: str | Path | soter.api.Program,
    num_envs: int = 1,
    **options: Any,  # noqa: ANN401 - those of ProtectedVector
) -> ProtectedVector:
    """Gives `ProtectedVector(program, num_envs, **options)`."""
    return ProtectedVector(program, num_envs, **options)
