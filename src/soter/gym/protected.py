"""The Gymnasium environment that has a runtime-assurance module in front of it.

Purpose: what an agent answers is the output of the module's advanced controller; gate, decision
module, safe controller and every other node are the compiled program's, and what passes the gate
drives the environment (docs/gym.md).
Non-goals: reward shaping, vectorised environments, learning.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, SupportsFloat

import gymnasium

import soter.api
from soter.gym import mapping
from soter.gym.outside import chosen_module, chosen_plant, wrong_choice
from soter.gym.session import Session
from soter.program.flatten.derived import answered_outside
from soter.program.model.values import ValueShapeError, to_python
from soter.semantics.externs import converted

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from gymnasium import spaces

    from soter.program.model.types import Type, Value

SEED_END = 2**63


class Protected(gymnasium.Env[Any, Any]):
    """`env` with a program's module between it and the agent.

    `program`: a path or a loaded `soter.Program`. `system`: the one to take, by default the
    program's default. Its `plant` becomes `env`, the advanced controller of its `module` the
    agent; either may be left out where there is only one.

    `observe(observation)`: the plant's states, as an extern plant answers them (a mapping by
    name); by default the numbers of the observation in declared order. `act(action)`: the
    controller's outputs, as an extern node answers them (None: publishes nothing); by default
    the numbers of the action. `command(**topics)`: the action for `env` from what the plant
    reads, by keyword of the topic's last name, as externs receive it; by default its numbers.
    `action_space`: by default the value sets of the controller's outputs.

    `info`, after `reset` and `step`: `mode`, `ttf`, `safer`, `stale`, `switched` (what the
    decision module said of the observation that comes with it, and whether that changed the
    mode), `violations` (so far), and of the step just taken `taken_by` ("AC", "SC"; None after
    `reset`), `action_taken` (what `env` received) and `gate_fault` (the gate refused the agent's
    action). SoterError U001 for a wrong choice, and whatever the program raises.
    """

    def __init__(
        self,
        program: str | Path | soter.api.Program,
        env: gymnasium.Env[Any, Any],
        *,
        system: str | None = None,
        module: str | None = None,
        plant: str | None = None,
        observe: Callable[[Any], object] | None = None,
        act: Callable[[Any], object] | None = None,
        command: Callable[..., Any] | None = None,
        action_space: spaces.Space[Any] | None = None,
        params: Mapping[str, object] | None = None,
    ) -> None:
        loaded = program if isinstance(program, soter.api.Program) else soter.api.load(program)
        flat = loaded.flat(system, params)
        found = chosen_module(flat, module)
        body = chosen_plant(flat, plant)
        flat = answered_outside(flat, (found.ac, body.index))
        self.env = env
        self.session = Session(flat, found, body, loaded.bound)
        self.metadata = env.metadata
        self.render_mode = env.render_mode
        self.observation_space = env.observation_space
        outputs = mapping.topics_published(flat, self.session.agent)
        self.action_space = action_space or mapping.action_space(outputs)
        self._reads = mapping.topics_read(flat, self.session.plant)
        self._states = mapping.shapes_of_states(self.session.plant)
        self._outputs = [(t.name.rpartition(".")[2], t.type) for t in outputs]
        self._observe, self._act, self._command = observe, act, command
        self._last: Any = None
        self._over = True

    # ------------------------------------------------------------ Gymnasium

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; every draw of the program follows from the seed."""
        super().reset(seed=seed)
        observation, given = self.env.reset(seed=seed, options=options)
        own = int(self.np_random.integers(SEED_END))
        self.session.reset(own, self._states_of(observation))
        before = int(self.session.facts["mode"])
        if self.session.asked() is not self.session.agent:
            raise wrong_choice("the advanced controller has a phase: the plant would move first")
        self._last, self._over = observation, False
        return observation, {**given, **self._facts(before), **_taken(None, None, refused=False)}

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """One answer of the agent; `env` steps once for each release of the plant meanwhile."""
        if self._over:
            raise wrong_choice("the episode is over", "call reset() first")
        session = self.session
        before, faults = int(session.facts["mode"]), int(session.facts["gate_faults"])
        session.act(self._values_of(action))
        refused = int(session.facts["gate_faults"]) > faults
        reward, ended, cut = 0.0, False, False
        given: dict[str, Any] = {}
        taken: Any = None
        while session.asked() is not session.agent and not (ended or cut):
            taken = self._command_now()
            self._last, gained, ended, cut, given = self.env.step(taken)
            reward += float(gained)
            session.move(self._states_of(self._last))
        self._over = ended or cut
        step = _taken("AC" if before else "SC", taken, refused=refused)
        return self._last, reward, ended, cut, {**given, **self._facts(before), **step}

    def render(self) -> Any:  # noqa: ANN401 - whatever the environment renders
        """What the environment shows."""
        return self.env.render()

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    # ------------------------------------------------------------ mappings

    def _states_of(self, observation: Any) -> list[Value]:  # noqa: ANN401 - any observation
        """The plant's states; those that `observe` leaves out stay as they are."""
        if self._observe is None:
            return mapping.assembled(self._states, observation, "an observation")
        try:
            given = converted(self._states, self._observe(observation))
        except ValueShapeError as error:
            raise wrong_choice(f"`observe` gave no state of the plant: {error}") from error
        old = self.session.states()
        return [a if b is None else b for a, b in zip(old, given, strict=True)]

    def _values_of(self, action: Any) -> list[Value | None] | None:  # noqa: ANN401 - any action
        """What the agent publishes; None where its action is no value of the topics."""
        try:
            if self._act is None:
                return list(mapping.assembled(self._outputs, action, "an action"))
            return list(converted(self._outputs, self._act(action)))
        except ValueShapeError:
            return None

    def _command_now(self) -> Any:  # noqa: ANN401 - an action of the environment
        values = [self.session.topic(t.index) for t in self._reads]
        shapes: list[tuple[str, Type]] = [(t.name.rpartition(".")[2], t.type) for t in self._reads]
        if self._command is None:
            return mapping.as_action(self.env.action_space, mapping.flattened(shapes, values))
        named = {n: to_python(t, v) for (n, t), v in zip(shapes, values, strict=True)}
        return self._command(**named)

    def _facts(self, before: int) -> dict[str, Any]:
        facts = self.session.facts
        return {
            "mode": "AC" if facts["mode"] else "SC",
            "ttf": bool(facts["ttf"]),
            "safer": bool(facts["safer"]),
            "stale": bool(facts["stale"]),
            "switched": int(facts["mode"]) != before,
            "violations": self.session.violations(over=self._over),
        }


def _taken(by: str | None, action: Any, *, refused: bool) -> dict[str, Any]:  # noqa: ANN401
    return {"taken_by": by, "action_taken": action, "gate_fault": refused}


def make_protected(
    program: str | Path | soter.api.Program,
    env_id: str,
    *,
    make: Mapping[str, Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of Protected
) -> Protected:
    """`Protected` around `gymnasium.make(env_id, **make)`."""
    return Protected(program, gymnasium.make(env_id, **(make or {})), **options)
