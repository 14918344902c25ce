"""Puts a module between an agent and an environment, for both classes of Gymnasium that do so.

Purpose: `Protected` and `SafetyWrapper` hand each `reset` and `step` to an `EnvironmentGuard`. It
carries actions, commands and observations between agent, compiled module and environment, and makes
`info`. Arrays that no function of the user's maps go straight to C.
Non-goals: classes of Gymnasium (`protected.py`), many worlds in one call (`vector.py`).
"""

from __future__ import annotations

import copy
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding

import soter.api
from soter.gym import array_mapping
from soter.gym.environment_choices import chosen_plant, ordered_info_keys, wrong_choice
from soter.gym.plant_model import SessionPlant, make_plant_model, tolerances, why_no_model
from soter.gym.safety_warnings import (
    warn_of_narrow_space,
    warn_of_no_control,
    warn_of_start,
    warn_of_unseen,
    warn_of_wrappers,
    warn_off_model,
)
from soter.gym.session import (
    NO_NUMBERS,
    NO_STATES,
    SAME_BUT_MARGIN,
    Session,
    copy_numbers,
    one_world_environment,
)
from soter.gym.step_info import flag_info, refusal_cause
from soter.language.model.values import ValueShapeError, ValueStructureError, to_python
from soter.semantics.externs import convert_answer

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.diagnostics.diagnostic import SoterError
    from soter.gym.compiled_system import CompiledEnvironment
    from soter.language.model.system import Bound
    from soter.language.model.types import Type, Value

SEED_END = 2**63

NOT_COPIED = (
    "session",
    "plant_model",
    "after_judged_step",
    "_make_next_command",
    "program",
    "_topics_read",
    "_state_types",
    "_output_types",
)
"""Attributes that a copy makes anew, or has as None (`after_judged_step`)."""


class EnvironmentGuard:
    """Steps one environment behind one module for one agent; has the parameters of `Protected`."""

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
        measured: bool | Collection[str] = False,
        truncate_on_violation: bool = False,
        alarm: bool | None = None,
        tolerance: float | Mapping[str, float] | None = None,
        info_keys: Collection[str] | None = None,
    ) -> None:
        loaded = program if isinstance(program, soter.api.Program) else soter.api.load(program)
        if not isinstance(getattr(env, "unwrapped", None), gymnasium.Env):
            raise wrong_choice(
                f"`{env!r}` is no environment",
                "give an object of Gymnasium's; `make_protected` takes a name",
            )
        self.program = loaded
        self.choice = (system, module, plant, params, measured)
        self._info_keys = None if info_keys is None else ordered_info_keys(info_keys)
        self._observe, self._act, self._command = observe, act, command
        self._truncates_on_violation, self._alarm, self._tolerance = (
            truncate_on_violation,
            alarm,
            tolerance,
        )
        self._observation_dtype = env.observation_space.dtype
        self.after_judged_step: Callable[[SessionPlant], None] | None = None
        """A function that is called after each step that the model judged."""
        self._seed_generator: np.random.Generator | None = None
        self._last_observation: Any = None
        self._state_values: list[Value] = []
        self._episode_is_over = True
        self._has_warned_of_unseen = False
        self._has_warned_off_model = False
        self._violations_before = 0
        self._compile_choices(env.action_space)
        if observe is None:
            warn_of_wrappers(env)
        warn_of_no_control(self.session.compiled)
        if command is None:
            warn_of_narrow_space(env.action_space, self._topics_read)
        outputs = array_mapping.topics_published(self.session.system, self.session.agent)
        self.action_space = action_space or array_mapping.action_space(outputs)
        self._has_masks = isinstance(self.action_space, spaces.Discrete)

    def _compile_choices(self, space: spaces.Space[Any]) -> None:
        """Compiles the chosen system and prepares arrays; `space` is the space of env's actions."""
        self._env_action_space = space
        made = one_world_environment(self.program, *self.choice)
        session = self.session = Session(made, self.program.bound)
        outputs = array_mapping.topics_published(made.system, session.agent)
        self._topics_read = array_mapping.topics_read(made.system, session.plant)
        self._state_types = array_mapping.named_state_types(session.plant)
        self._output_types = [(t.name.rpartition(".")[2], t.type) for t in outputs]
        self._observations_are_numbers = self._observe is None and made.moves_numbers
        self._actions_are_numbers = self._act is None and made.acts_numbers
        self.plant_model = self._judging_model(made)
        self._plant_index = session.plant.index
        self._calls_c_directly = (
            session.is_compiled and self._observations_are_numbers and self._actions_are_numbers
        )
        self._info_by_flags: dict[int, dict[str, Any]] = {}
        self._repeated_info: dict[str, Any] = {}
        self._may_repeat_info = not made.linked and session.module.shield is None
        self._make_next_command = None
        if self._command is None and made.commands_numbers:
            self._make_next_command = self._command_source(space)

    def _command_source(self, space: spaces.Space[Any]) -> Callable[[], Any]:
        """The function that makes the environment's next action; raises SoterError U001."""
        session = self.session
        next_command = array_mapping.action_maker(space, len(session.command))
        if isinstance(space, spaces.Box) and space.shape == session.command.shape:
            bounds = [b for t in self._topics_read for b in t.bounds]
            if space.dtype == np.float64:
                return session.command.copy
            if space.dtype == np.float32 and all(b and fits_float32(b) for b in bounds):
                return session.rounded_command().copy
        return partial(next_command, session.command)

    def _judging_model(self, made: CompiledEnvironment) -> SessionPlant | None:
        """The model that judges the environment's steps, or None; raises SoterError U001."""
        system, _, plant, params, _ = self.choice
        model = None
        if self._alarm is not False and made.moves_numbers:
            model = make_plant_model(self.program, system, plant, params)
        if model is None:
            if self._alarm:
                flat = self.program.flat(system, params)
                reason = why_no_model(chosen_plant(flat, plant)) or "its states have lists"
                raise wrong_choice(f"there is no model to compare with: {reason}", "alarm=False")
            return None
        tolerance = tolerances(model, self._observation_dtype, self._tolerance)
        session_plant = SessionPlant(model, made, *tolerance)
        self.session.attach_model(session_plant)
        return session_plant

    # ------------------------------------------------------------ episodes

    def reset(
        self, env: gymnasium.Env[Any, Any], seed: int | None, options: dict[str, Any] | None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode, whose draws all follow from the seed; raises SoterError U001."""
        if seed is not None or self._seed_generator is None:
            self._seed_generator, _ = seeding.np_random(seed)
        observation, env_info = env.reset(seed=seed, options=options)
        session = self.session
        session.outside.told = 0
        session.start(int(self._seed_generator.integers(SEED_END)))
        if not self._observations_are_numbers:
            self._state_values = self._plant_states(observation)
            session.start_at_values(self._state_values)
        elif not (self._observation_numbers(observation) and session.start_at_numbers()):
            raise self._no_states_error(observation)
        if broken := self._states_not_finite():
            names = ", ".join(f"`{n}`" for n in broken)
            raise wrong_choice(f"an episode cannot start where {names} is NaN or infinite")
        before = int(session.facts["mode"])
        if session.run_until_due() != session.agent.index:
            raise wrong_choice("the advanced controller has a phase: the plant would move first")
        self._last_observation, self._episode_is_over = observation, False
        self._violations_before = 0
        info = self._info_of_step(env_info, None, None) | {
            "switched": bool(session.seen.mode != before)
        }
        self._violations_before = info["violations"]
        if session.seen.ttf:
            warn_of_start(session.module.name)
        return observation, self._wanted_info(info, env_info)

    def step(
        self,
        env: gymnasium.Env[Any, Any],
        action: Any,  # noqa: ANN401 - any action
    ) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Answers for the agent, and steps `env` whenever the plant is due until the agent is.

        C reads the arrays of the agent and of `env` in place, if it can (`act_directly` and
        `move_directly`); other values go through Python. If C finds that a step differs from the
        last one only in the margin, the last `info` is copied. Raises SoterError U001 before the
        first episode, after the end of an episode, and for numbers that do not fit.
        """
        if self._episode_is_over:
            begun = self._last_observation is not None
            message = "the episode is over" if begun else "no episode has begun"
            raise wrong_choice(message, "call reset() first")
        session, make_command = self.session, self._make_next_command
        direct, plant = self._calls_c_directly, self._plant_index
        due = session.act_directly(action) if direct else NO_NUMBERS
        if due == NO_NUMBERS:
            due = self._give_action(action)
        reward, ended, cut = 0.0, False, False
        env_info: dict[str, Any] = {}
        taken: Any = None
        while due == plant and not (ended or cut):
            taken = self._current_command(env) if make_command is None else make_command()
            last, gained, ended, cut, env_info = env.step(taken)
            self._last_observation = last
            reward += float(gained)
            due = session.move_directly(last) if direct else NO_NUMBERS
            if due == NO_NUMBERS:
                due = self._give_observation(last)
            elif due == NO_STATES or self.after_judged_step is not None:
                self._note_judged_step(last, due)
        if due == SAME_BUT_MARGIN:
            self._episode_is_over = ended or cut
            info = self._repeated_info.copy()
            info["margin"] = session.outside.margin_ns / 1e9
            info["action_taken"], info["action_requested"] = taken, action
            for key in env_info:
                if key not in info:
                    info[key] = env_info[key]
            wanted = info if self._info_keys is None else self._wanted_info(info, env_info)
            return last, reward, ended, cut, wanted
        broken = self._states_not_finite() if session.outside.latched else []
        cut = cut or bool(broken)
        self._episode_is_over = ended or cut
        info = self._info_of_step(env_info, action, taken)
        if broken:
            info |= {"off_model": True, "not_finite": broken}
        if self._truncates_on_violation and info["cost"]:
            cut = self._episode_is_over = True
        self._remember_step(info)
        return self._last_observation, reward, ended, cut, self._wanted_info(info, env_info)

    def _remember_step(self, info: dict[str, Any]) -> None:
        """Keeps what C compares the next step with; warns of the first step off the model."""
        session = self.session
        self._violations_before = info["violations"]
        if info["off_model"] and not self._has_warned_off_model:
            if self.after_judged_step is None:
                self._has_warned_off_model = True
                warn_off_model(session.plant.name)
        elif self._may_repeat_info and info["cause"] != "gate":
            self._repeated_info = self._repeatable_info(info["violations"])

    # ------------------------------------------------------------ the agent's answer

    def _give_action(self, action: Any) -> int:  # noqa: ANN401 - any action
        """Gives the agent's action to the module; returns the index of the next due component."""
        session = self.session
        if self._act is None and getattr(action, "shape", ()) != session.action.shape:
            array_mapping.require_no_batch(self.action_space, action)
        if not self._actions_are_numbers:
            session.act_with_values(self._action_values(action))
            return session.run_until_due()
        count = copy_numbers(action, session.action, "an action")
        if count is not None:
            raise array_mapping.wrong_count_error(self._output_types, count, "an action")
        return session.act_with_numbers()

    def _action_values(self, action: Any) -> list[Value | None] | None:  # noqa: ANN401 - any action
        """The values of the agent's topics for an action; None if the topics cannot have them."""
        try:
            if self._act is None:
                return list(array_mapping.assemble_values(self._output_types, action, "an action"))
            answer = self._act(action)
            return list(convert_answer(self._output_types, answer))
        except ValueStructureError as error:
            message = "`act` gave no outputs of the controller"
            raise array_mapping.wrong_structure_error(
                message, self._output_types, answer, error
            ) from error
        except ValueShapeError:
            return None

    # ------------------------------------------------------------ the environment's

    def _give_observation(self, observation: Any) -> int:  # noqa: ANN401 - any observation
        """Gives an observation to the module; returns the index of the next due component."""
        session = self.session
        if not self._observations_are_numbers:
            states = self._state_values = self._plant_states(observation)
            if self.plant_model is not None:
                session.moved[:] = array_mapping.numbers_of_values(self._state_types, states)
                session.judge_move()
                self._note_judged_step(observation, session.plant.index)
            session.move_to_values(states)
            return session.run_until_due()
        due = session.move_to_numbers() if self._observation_numbers(observation) else NO_STATES
        self._note_judged_step(observation, due)
        return due

    def _states_not_finite(self) -> list[str]:
        """The names of the states that the environment showed as NaN or infinite."""
        values = self._state_values
        if self._observations_are_numbers:
            values = array_mapping.assemble_values(
                self._state_types, self.session.moved, "an observation"
            )
        named = zip(self._state_types, values, strict=True)
        return [n for (n, _), value in named if not array_mapping.is_finite(value)]

    def _note_judged_step(self, observation: Any, due: int) -> None:  # noqa: ANN401 - any observation
        """Calls `after_judged_step` if set; SoterError U001 if the observation was no state."""
        if due == NO_STATES:
            raise self._no_states_error(observation)
        if self.after_judged_step is not None and self.plant_model is not None:
            self.after_judged_step(self.plant_model)

    def _observation_numbers(self, observation: Any) -> bool:  # noqa: ANN401 - any observation
        return copy_numbers(observation, self.session.moved, "an observation") is None

    def _no_states_error(self, observation: Any) -> SoterError:  # noqa: ANN401 - any observation
        """The SoterError that says why an observation is no state of the plant."""
        count = copy_numbers(observation, self.session.moved, "an observation")
        if count is not None:
            return array_mapping.wrong_count_error(self._state_types, count, "an observation")
        try:
            array_mapping.assemble_values(self._state_types, observation, "an observation")
        except ValueShapeError as error:
            return wrong_choice(f"an observation is no state of the plant: {error}")
        raise AssertionError(observation)

    def _plant_states(self, observation: Any) -> list[Value]:  # noqa: ANN401 - any observation
        """The plant's states from an observation; states that `observe` omits keep their values."""
        if self._observe is None:
            return array_mapping.assemble_values(self._state_types, observation, "an observation")
        try:
            answer = self._observe(observation)
            states = convert_answer(self._state_types, answer)
        except ValueShapeError as error:
            message = "`observe` gave no state of the plant"
            raise array_mapping.wrong_structure_error(
                message, self._state_types, answer, error
            ) from error
        old = self.session.plant_states()
        unseen = [n for (n, _), v in zip(self._state_types, states, strict=True) if v is None]
        if unseen and not self._has_warned_of_unseen:
            self._has_warned_of_unseen = True
            warn_of_unseen(unseen)
        if self.plant_model is not None:
            self.plant_model.compare_only([v is not None for v in states])
        return [a if b is None else b for a, b in zip(old, states, strict=True)]

    def _current_command(self, env: gymnasium.Env[Any, Any]) -> Any:  # noqa: ANN401 - an action of it
        values = [self.session.topic_value(t.index) for t in self._topics_read]
        shapes: list[tuple[str, Type]] = [
            (t.name.rpartition(".")[2], t.type) for t in self._topics_read
        ]
        if self._command is None:
            numbers = array_mapping.numbers_of_values(shapes, values)
            return array_mapping.action_maker(env.action_space, len(numbers))(numbers)
        named = {n: to_python(t, v) for (n, t), v in zip(shapes, values, strict=True)}
        return self._command(**named)

    # ------------------------------------------------------------ info and masks

    def _info_of_step(
        self,
        env_info: dict[str, Any],
        action: Any,  # noqa: ANN401 - any action
        taken: Any,  # noqa: ANN401 - any action of the environment
    ) -> dict[str, Any]:
        """The environment's `env_info`, together with the module's facts after a step."""
        session = self.session
        outside, violations = session.outside, session.seen.violations
        if self._episode_is_over and session.compiled.linked:
            violations = session.violation_count(over=True)
        known = self._info_by_flags.get(outside.flags)
        if known is None:
            known = self._info_by_flags[outside.flags] = flag_info(
                session, session.seen.taken_by, has_model=self.plant_model is not None
            )
        info = {**env_info, **known} if env_info else known.copy()
        info["margin"] = outside.margin_ns / 1e9
        info["violations"] = violations
        info["action_taken"] = taken
        info["action_requested"] = action
        info["cost"] = float(violations - self._violations_before)
        if info["cause"] == "gate":
            info["cause"] = refusal_cause(session)
        if self._has_masks and session.module.shield is not None:
            info["action_mask"] = self.action_masks().astype(np.int8)
        return info

    def _wanted_info(self, info: dict[str, Any], env: dict[str, Any]) -> dict[str, Any]:
        """The keys of `info` that the caller wants, and all keys of the environment's `env`."""
        keys = self._info_keys
        if keys is None:
            return info
        return {**env, **{key: info[key] for key in keys if key in info}}

    def _repeatable_info(self, violations: int) -> dict[str, Any]:
        """The `info` for later steps that differ only in the margin; tells C what to compare."""
        outside = self.session.outside
        self.session.compiled.lib.soter_outside_tell(outside)
        known = self._info_by_flags[outside.flags]
        return {**known, "violations": violations, "cost": 0.0}

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Whether AC in control would publish each `Discrete` action unmoved, (n,); U001."""
        space = self.action_space
        if not isinstance(space, spaces.Discrete):
            raise wrong_choice("only a `Discrete` action space has a mask", f"it is {space}")
        if self._episode_is_over:  # the agent has nothing to answer
            return np.zeros(int(space.n), dtype=np.bool_)
        actions = range(int(space.start), int(space.start) + int(space.n))
        return np.array([self.session.would_publish(self._action_values(a)) for a in actions])

    # ------------------------------------------------------------ copies

    def __getstate__(self) -> dict[str, Any]:
        """Gives all attributes except the compiled program, which `__setstate__` loads again."""
        if not self.session.is_compiled:
            raise wrong_choice(
                "an environment with externs in Python has no copy",
                "their memory is their own: make another environment",
            )
        state = {k: v for k, v in vars(self).items() if k not in NOT_COPIED}
        program = self.program
        state["_named"] = (program.path, program.sha256, dict(program.bound))
        state["_saved"] = self.session.saved_state()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        path, sha256, bound = state.pop("_named")
        program = soter.api.load(path)
        if program.sha256 != sha256:
            raise wrong_choice(f"`{path}` is another program than the one that was pickled")
        for name, target in bound.items():
            program.bind(name, target)
        self._restore_session(program, state)

    def _restore_session(self, program: soter.api.Program, state: dict[str, Any]) -> None:
        saved = state.pop("_saved")
        vars(self).update(state)
        self.program, self.after_judged_step = program, None
        self._compile_choices(self._env_action_space)
        self.session.restore_state(saved)

    def __deepcopy__(self, memo: dict[int, Any]) -> EnvironmentGuard:
        """Gives a guard of the same program with a separate copy of the state."""
        state = self.__getstate__()
        del state["_named"]
        made = EnvironmentGuard.__new__(EnvironmentGuard)
        made._restore_session(self.program, copy.deepcopy(state, memo))  # noqa: SLF001 - its own class
        return made


def fits_float32(bound: Bound) -> bool:
    """Whether all numbers between two bounds stay finite when rounded to float32."""
    return max(abs(bound.low), abs(bound.high)) <= float(np.finfo(np.float32).max)
