"""Many worlds of a program as a `VecEnv` of Stable-Baselines3.

Purpose: `make_sb3_vec`: PPO and its like learn over `make_vec` without a process or a Python step
for each world (docs/gym.md).
Non-goals: Stable-Baselines3 itself, which is asked for only here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from soter.gym.outside_roles import wrong_choice
from soter.gym.vector import CAUSES, FACTS, ProtectedVector

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt

    import soter.api

    Array = npt.NDArray[Any]

MODES = {"mode": ("SC", "AC"), "taken_by": ("SC", "AC"), "cause": CAUSES, "next_cause": CAUSES}
"""Of numbers in the `info` of many worlds the words that one world has."""


def make_sb3_vec(
    program: str | Path | soter.api.Program,
    num_envs: int = 1,
    *,
    info_keys: Sequence[str] = ("cost", "intervened"),
    **options: Any,  # noqa: ANN401 - those of ProtectedVector
) -> Any:  # noqa: ANN401 - a `VecEnv`
    """`ProtectedVector(program, num_envs, **options)` for Stable-Baselines3.

    `info_keys`: what of `info` each world is told: it costs time for each. Numbers are float32.
    ImportError without stable-baselines3; SoterError as of `ProtectedVector`, U001 for a key that
    there is not.
    """
    if "autoreset" in options:
        raise wrong_choice("Stable-Baselines3 begins an episode with the step that ends one")
    worlds = ProtectedVector(
        program, num_envs, autoreset=AutoresetMode.SAME_STEP, dtype=np.float32, **options
    )
    known = (*FACTS, "action_taken", "cost", "intervened", "action_requested")
    if unknown := [key for key in info_keys if key not in known]:
        raise wrong_choice(f"`info` has no `{unknown[0]}`", f"it has {', '.join(known)}")
    return _class()(worlds, tuple(info_keys))


def _class() -> Any:  # noqa: ANN401 - a class over one of the library's
    try:
        from stable_baselines3.common.vec_env.base_vec_env import VecEnv  # noqa: PLC0415 - theirs
    except ImportError as error:
        message = "make_sb3_vec needs stable-baselines3: pip install stable-baselines3"
        raise ImportError(message) from error

    class Sb3Worlds(_Worlds, VecEnv):  # type: ignore[misc] # it may be Any
        """Of worlds that are stepped in one call."""

    return Sb3Worlds


class _Worlds:
    """What a `VecEnv` is asked for, answered by a `ProtectedVector`."""

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
        """Begin an episode in every world, (num_envs, numbers)."""
        seeds = [seed for seed in self._seeds if seed is not None]
        seen, info = self.worlds.reset(seed=seeds if len(seeds) == self.num_envs else None)
        self.reset_infos = self._infos(info)
        self._reset_seeds()  # type: ignore[attr-defined] # of the VecEnv
        self._reset_options()  # type: ignore[attr-defined]
        return seen

    def step_async(self, actions: Any) -> None:  # noqa: ANN401 - arrays
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        """Step every world; one that ended has begun again, and says what it showed last."""
        seen, rewards, ended, cut, info = self.worlds.step(self._actions)
        over = ended | cut
        told = self._infos(info)
        for world in np.flatnonzero(over).tolist():
            told[world] = self._infos(info["final_info"], [world])[0]
            told[world]["terminal_observation"] = info["final_obs"][world]
            told[world]["TimeLimit.truncated"] = bool(cut[world] and not ended[world])
        return seen, rewards.astype(np.float32), over, told

    def close(self) -> None:
        """Nothing is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ANN401 - theirs
        """The same for all worlds."""
        return [getattr(self.worlds, attr_name)] * len(self._which(indices))

    def set_attr(self, attr_name: str, *_: Any, **__: Any) -> None:  # noqa: ANN401
        """SoterError U001: no world is an object of its own."""
        raise wrong_choice(f"`{attr_name}` of one world cannot be set: they are stepped together")

    def env_method(self, method_name: str, *_: Any, **__: Any) -> list[Any]:  # noqa: ANN401
        """SoterError U001: as above."""
        raise wrong_choice(f"`{method_name}` of one world cannot be called: there is no object")

    def env_is_wrapped(self, _wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ANN401
        """No world is."""
        return [False] * len(self._which(indices))

    def _which(self, indices: Any) -> list[int]:  # noqa: ANN401 - None, a number or several
        if indices is None:
            return list(range(self.num_envs))
        return [indices] if isinstance(indices, int) else list(indices)

    def _infos(self, info: dict[str, Any], which: Sequence[int] | None = None) -> list[Any]:
        """What each world is told."""
        worlds = range(self.num_envs) if which is None else which
        keys = [key for key in self._info_keys if key in info]
        columns = [info[key].tolist() for key in keys]
        for place, key in enumerate(keys):
            if key in MODES:
                columns[place] = [MODES[key][int(x)] for x in columns[place]]
        return [dict(zip(keys, [c[k] for c in columns], strict=True)) for k in worlds]
