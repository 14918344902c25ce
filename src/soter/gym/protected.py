"""Environments of Gymnasium and Stable-Baselines3 that have a runtime-assurance module in front.

Purpose: in `Protected` (an environment) and `SafetyWrapper` (a wrapper) an agent's action is the
output of the module's advanced controller. Gate, decision module, safe controller and every other
node are the compiled program's; what passes the gate drives the environment (docs/gym.md).
`make_sb3_vec` gives many worlds as a `VecEnv`, so that PPO and its like learn over `make_vec`,
without a process or a Python step for each world.
Non-goals: how it is done (`guard.py`, `vector.py`), learning; Stable-Baselines3 itself, which is
imported only when it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode

from soter.gym.environment_choices import CAUSES, wrong_choice
from soter.gym.guard import EnvironmentGuard
from soter.gym.vector import FACTS, ProtectedVector

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import numpy.typing as npt

    import soter.api
    from soter.gym.session import Session

    Array = npt.NDArray[Any]


class Protected(gymnasium.Env[Any, Any]):
    """`env` with a program's module between it and the agent.

    `program`: a path or a loaded `soter.Program`. `system`: the one to take, by default the
    program's default. Its `plant` becomes `env`, the advanced controller of its `module` the agent;
    either may be left out where there is only one. `params`: as of `simulate`.

    `observe(observation)`: the plant's states, as an extern plant answers them (a mapping by name);
    by default the numbers of the observation in declared order. `act(action)`: the controller's
    outputs, as an extern node answers them (None: publishes nothing); by default the numbers of the
    action. `command(**topics)`: the action for `env` from what the plant reads, by keyword of the
    topic's last name, as externs receive it; by default its numbers. `action_space`: by default the
    value sets of the controller's outputs.

    `measured`: whether the program's errors of measurement are added to what `env` shows, or the
    names of topics on which they are; by default none is, as a sensor has errors of its own.
    `truncate_on_violation`: whether an episode ends with a violation. `info_keys`: which keys of
    the module `info` has, by default all; in vectors of processes each costs time.

    `info`: docs/gym.md. SoterError U001 for a wrong choice, and whatever the program raises.
    """

    def __init__(
        self,
        program: str | Path | soter.api.Program,
        env: gymnasium.Env[Any, Any],
        **options: Any,  # noqa: ANN401 - those of EnvironmentGuard
    ) -> None:
        self.env = env
        self.guard = EnvironmentGuard(program, env, **options)
        self.metadata = env.metadata
        self.render_mode = env.render_mode
        self.observation_space = env.observation_space
        self.action_space = self.guard.action_space

    @property
    def session(self) -> Session:
        """The compiled system and its state now."""
        return self.guard.session

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode, in which every draw of the program follows from the seed."""
        super().reset(seed=seed)
        return self.guard.reset(self.env, seed, options)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Answers for the agent, and steps `env` whenever the plant is due until the agent is."""
        return self.guard.step(self.env, action)

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Whether AC would now publish each action of a `Discrete` space unchanged, (n,)."""
        return self.guard.action_masks()

    def render(self) -> Any:  # noqa: ANN401 - whatever the environment renders
        """Gives the result of the environment's `render`."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()


class SafetyWrapper(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """`Protected` as a wrapper of Gymnasium, with `env` first and the same `options`.

    The wrapper may stand anywhere among wrappers; `unwrapped`, `get_wrapper_attr`, `spec` and
    copies work as in any wrapper. It sees what the wrappers inside it show, so put wrappers that
    change observations (normalise, stack) around it.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        program: str | Path | soter.api.Program,
        **options: Any,  # noqa: ANN401 - those of EnvironmentGuard
    ) -> None:
        RecordConstructorArgs.__init__(self, _disable_deepcopy=True, program=program, **options)
        gymnasium.Wrapper.__init__(self, env)
        self.guard = EnvironmentGuard(program, env, **options)
        self.action_space = self.guard.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode, in which every draw of the program follows from the seed."""
        return self.guard.reset(self.env, seed, options)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Answers for the agent, and steps `env` whenever the plant is due until the agent is."""
        return self.guard.step(self.env, action)

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Whether AC would now publish each action of a `Discrete` space unchanged, (n,)."""
        return self.guard.action_masks()


def make_protected(
    program: str | Path | soter.api.Program,
    env_id: str,
    *,
    make: Mapping[str, Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of Protected
) -> Protected:
    """Gives `Protected` around `gymnasium.make(env_id, **make)`."""
    return Protected(program, gymnasium.make(env_id, **(make or {})), **options)


MODES = {"mode": ("SC", "AC"), "taken_by": ("SC", "AC"), "cause": CAUSES, "next_cause": CAUSES}
"""The words that `info` of one world has for the numbers of many worlds, by key."""


def make_sb3_vec(
    program: str | Path | soter.api.Program,
    num_envs: int = 1,
    *,
    info_keys: Sequence[str] = ("cost", "intervened"),
    **options: Any,  # noqa: ANN401 - those of ProtectedVector
) -> Any:  # noqa: ANN401 - a `VecEnv`
    """Gives `ProtectedVector(program, num_envs, **options)` for Stable-Baselines3.

    `info_keys`: the keys of `info` that each world gets; each costs time. Numbers are float32.
    Raises ImportError if stable-baselines3 is missing, SoterError U001 for an unknown key, and the
    errors of `ProtectedVector`.
    """
    if "autoreset" in options:
        raise wrong_choice("Stable-Baselines3 begins an episode with the step that ends one")
    worlds = ProtectedVector(
        program, num_envs, autoreset=AutoresetMode.SAME_STEP, dtype=np.float32, **options
    )
    known = (*FACTS, "action_taken", "cost", "intervened", "action_requested")
    if unknown := [key for key in info_keys if key not in known]:
        raise wrong_choice(f"`info` has no `{unknown[0]}`", f"it has {', '.join(known)}")
    return _vec_env_class()(worlds, tuple(info_keys))


def _vec_env_class() -> Any:  # noqa: ANN401 - a class over one of the library's
    try:
        from stable_baselines3.common.vec_env.base_vec_env import VecEnv  # noqa: PLC0415 - theirs
    except ImportError as error:
        message = "make_sb3_vec needs stable-baselines3: pip install stable-baselines3"
        raise ImportError(message) from error

    class Sb3Worlds(_Worlds, VecEnv):  # type: ignore[misc] # it may be Any
        """A `VecEnv` whose worlds are stepped in one call."""

    return Sb3Worlds


class _Worlds:
    """Answers the calls of a `VecEnv` by a `ProtectedVector`."""

    def __init__(self, worlds: ProtectedVector, info_keys: tuple[str, ...]) -> None:
        self.worlds, self._info_keys = worlds, info_keys
        self._actions: Any = None
        space = worlds.single_action_space
        if isinstance(space, spaces.Box):
            space = spaces.Box(space.low, space.high, dtype=np.float32)
        super().__init__(worlds.num_envs, worlds.single_observation_space, space)  # type: ignore[call-arg]
        self._seeds: list[int | None]
        self.num_envs: int

    def reset(self) -> Array:
        """Begins an episode in every world, and gives observations (num_envs, numbers)."""
        seeds = [seed for seed in self._seeds if seed is not None]
        seen, info = self.worlds.reset(seed=seeds if len(seeds) == self.num_envs else None)
        self.reset_infos = self._info_by_world(info)
        self._reset_seeds()  # type: ignore[attr-defined] # of the VecEnv
        self._reset_options()  # type: ignore[attr-defined]
        return seen

    def step_async(self, actions: Any) -> None:  # noqa: ANN401 - arrays
        """Keeps the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        """Steps every world; one that ended has begun again, and its `info` has the last view."""
        seen, rewards, ended, cut, info = self.worlds.step(self._actions)
        over = ended | cut
        infos = self._info_by_world(info)
        for world in np.flatnonzero(over).tolist():
            infos[world] = self._info_by_world(info["final_info"], [world])[0]
            infos[world]["terminal_observation"] = info["final_obs"][world]
            infos[world]["TimeLimit.truncated"] = bool(cut[world] and not ended[world])
        return seen, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        """Does nothing, as no world has anything open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ANN401 - theirs
        """Gives an attribute once for each chosen world; all worlds have the same value."""
        return [getattr(self.worlds, attr_name)] * len(self._chosen_worlds(indices))

    def set_attr(self, attr_name: str, *_: Any, **__: Any) -> None:  # noqa: ANN401
        """Raises SoterError U001, as the worlds are not separate objects."""
        raise wrong_choice(f"`{attr_name}` of one world cannot be set: they are stepped together")

    def env_method(
        self,
        method_name: str,
        *_: Any,  # noqa: ANN401 - theirs
        indices: Any = None,  # noqa: ANN401
        **__: Any,  # noqa: ANN401
    ) -> list[Any]:
        """Calls `action_masks`, (n,) for each world; raises SoterError U001 for another method."""
        if method_name == "action_masks":
            return list(self.worlds.action_masks()[self._chosen_worlds(indices)])
        raise wrong_choice(f"`{method_name}` of one world cannot be called: there is no object")

    def env_is_wrapped(self, _wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ANN401
        """Gives False for each world, as none is wrapped."""
        return [False] * len(self._chosen_worlds(indices))

    def _chosen_worlds(self, indices: Any) -> list[int]:  # noqa: ANN401 - None, a number or several
        if indices is None:
            return list(range(self.num_envs))
        return [indices] if isinstance(indices, int) else list(indices)

    def _info_by_world(self, info: dict[str, Any], which: Sequence[int] | None = None) -> list[Any]:
        """The `info` of each world in `which`, with the chosen keys."""
        worlds = range(self.num_envs) if which is None else which
        keys = [key for key in self._info_keys if key in info]
        columns = [info[key].tolist() for key in keys]
        for place, key in enumerate(keys):
            if key in MODES:
                columns[place] = [MODES[key][int(x)] for x in columns[place]]
        return [dict(zip(keys, [c[k] for c in columns], strict=True)) for k in worlds]
