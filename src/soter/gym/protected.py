"""The Gymnasium environments that have a runtime-assurance module in front of them.

Purpose: what an agent answers is the output of the module's advanced controller; gate, decision
module, safe controller and every other node are the compiled program's, and what passes the gate
drives the environment (docs/gym.md). `Protected` is an environment, `SafetyWrapper` a wrapper.
Non-goals: how it is done (`guard.py`), vectorised environments (`vector.py`), learning.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, SupportsFloat

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from soter.gym.guard import EnvironmentGuard

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    import soter.api
    from soter.gym.session import Session


class Protected(gymnasium.Env[Any, Any]):
    """`env` with a program's module between it and the agent.

    `program`: a path or a loaded `soter.Program`. `system`: the one to take, by default the
    program's default. Its `plant` becomes `env`, the advanced controller of its `module` the
    agent; either may be left out where there is only one. `params`: as of `simulate`.

    `observe(observation)`: the plant's states, as an extern plant answers them (a mapping by
    name); by default the numbers of the observation in declared order. `act(action)`: the
    controller's outputs, as an extern node answers them (None: publishes nothing); by default
    the numbers of the action. `command(**topics)`: the action for `env` from what the plant
    reads, by keyword of the topic's last name, as externs receive it; by default its numbers.
    `action_space`: by default the value sets of the controller's outputs.

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
        **options: Any,  # noqa: ANN401 - those of Guard
    ) -> None:
        self.env = env
        self.guard = EnvironmentGuard(program, env, **options)
        self.metadata = env.metadata
        self.render_mode = env.render_mode
        self.observation_space = env.observation_space
        self.action_space = self.guard.action_space

    @property
    def session(self) -> Session:
        """The compiled system, as it stands."""
        return self.guard.session

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; every draw of the program follows from the seed."""
        super().reset(seed=seed)
        return self.guard.reset(self.env, seed, options)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """One answer of the agent; `env` steps once for each release of the plant meanwhile."""
        return self.guard.step(self.env, action)

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Which actions of a `Discrete` space would be published as they are now, (n,)."""
        return self.guard.action_masks()

    def render(self) -> Any:  # noqa: ANN401 - whatever the environment renders
        """What the environment shows."""
        return self.env.render()

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


class SafetyWrapper(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """`Protected` as a wrapper of Gymnasium's: `env` first, `options` as there.

    It may stand anywhere among wrappers; `unwrapped`, `get_wrapper_attr`, `spec` and copies are as
    of any. It sees what the wrappers inside of it show: put those that change observations
    (normalise, stack) around it, not inside.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        program: str | Path | soter.api.Program,
        **options: Any,  # noqa: ANN401 - those of Guard
    ) -> None:
        RecordConstructorArgs.__init__(self, _disable_deepcopy=True, program=program, **options)
        gymnasium.Wrapper.__init__(self, env)
        self.guard = EnvironmentGuard(program, env, **options)
        self.action_space = self.guard.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; every draw of the program follows from the seed."""
        return self.guard.reset(self.env, seed, options)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """One answer of the agent; `env` steps once for each release of the plant meanwhile."""
        return self.guard.step(self.env, action)

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Which actions of a `Discrete` space would be published as they are now, (n,)."""
        return self.guard.action_masks()


def make_protected(
    program: str | Path | soter.api.Program,
    env_id: str,
    *,
    make: Mapping[str, Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of Protected
) -> Protected:
    """`Protected` around `gymnasium.make(env_id, **make)`."""
    return Protected(program, gymnasium.make(env_id, **(make or {})), **options)
