"""A module between an agent and an environment, for both classes of Gymnasium that have one.

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
from soter.gym.session import NO_NUMBERS, Session, copy_numbers, one_world_environment
from soter.language.evaluate.arithmetic import FaultKind
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
CAUSES = (None, "gate", "stale", "ttf", "recovering", "forced", "toward sc")
"""Why the agent's action did not count, or was changed; the index is `soter_cause` of C."""
AS_TOLD = -2
"""`SOTER_AS_TOLD`: the agent is due, and of `info` only the margin differs from the last step's."""
NO_STATES = -1
"""`SOTER_NO_STATES`: what was given is no state of the plant."""

NOT_COPIED = (
    "session",
    "asked",
    "judged",
    "_next_command",
    "program",
    "_reads",
    "_states",
    "_outputs",
    "_single",
)


class EnvironmentGuard:
    """Steps one environment behind one module for one agent; parameters as of `Protected`."""

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
        self._cuts, self._alarm, self._tolerance = truncate_on_violation, alarm, tolerance
        self._observed = env.observation_space.dtype
        self.judged: Callable[[SessionPlant], None] | None = None
        """A function that is called after each step that the model judged."""
        self._numbered: np.random.Generator | None = None
        self._last: Any = None
        self._values: list[Value] = []
        self._over = True
        self._unseen = False
        self._off_model = False
        self._violations = 0
        self._compile_choices(env.action_space)
        if observe is None:
            warn_of_wrappers(env)
        warn_of_no_control(self.session.compiled)
        if command is None:
            warn_of_narrow_space(env.action_space, self._reads)
        outputs = array_mapping.topics_published(self.session.system, self.session.agent)
        self.action_space = action_space or array_mapping.action_space(outputs)
        self._masks = isinstance(self.action_space, spaces.Discrete)

    def _compile_choices(self, space: spaces.Space[Any]) -> None:
        """Compiles the chosen system and prepares arrays; `space` has the env's actions."""
        self._space = space
        made = one_world_environment(self.program, *self.choice)
        session = self.session = Session(made, self.program.bound)
        outputs = array_mapping.topics_published(made.system, session.agent)
        self._reads = array_mapping.topics_read(made.system, session.plant)
        self._states = array_mapping.named_state_types(session.plant)
        self._outputs = [(t.name.rpartition(".")[2], t.type) for t in outputs]
        self._moves_numbers = self._observe is None and made.moves_numbers
        self._acts_numbers = self._act is None and made.acts_numbers
        self.asked = self._step_model(made)
        self._plant = session.plant.index
        self._direct = session.alone and self._moves_numbers and self._acts_numbers
        self._info_by_flags: dict[int, dict[str, Any]] = {}
        self._repeated_info: dict[str, Any] = {}
        self._repeats = not made.linked and session.module.shield is None
        self._next_command = None
        if self._command is None and made.commands_numbers:
            self._next_command = self._command_source(space)

    def _command_source(self, space: spaces.Space[Any]) -> Callable[[], Any]:
        """Gives the function that makes the environment's next action; SoterError U001."""
        session = self.session
        next_command = array_mapping.action_maker(space, len(session.command))
        if isinstance(space, spaces.Box) and space.shape == session.command.shape:
            bounds = [b for t in self._reads for b in t.bounds]
            if space.dtype == np.float64:
                return session.command.copy
            if space.dtype == np.float32 and all(b and is_single(b) for b in bounds):
                return session.rounded_command().copy
        return partial(next_command, session.command)

    def _step_model(self, made: CompiledEnvironment) -> SessionPlant | None:
        """Gives the model that judges the environment's steps, or None; SoterError U001."""
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
        asked = SessionPlant(model, made, *tolerances(model, self._observed, self._tolerance))
        self.session.attach_model(asked)
        return asked

    # ------------------------------------------------------------ episodes

    def reset(
        self, env: gymnasium.Env[Any, Any], seed: int | None, options: dict[str, Any] | None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode; every draw of the program follows from the seed. SoterError U001."""
        if seed is not None or self._numbered is None:
            self._numbered, _ = seeding.np_random(seed)
        observation, env_info = env.reset(seed=seed, options=options)
        session = self.session
        session.outside.told = 0
        session.start(int(self._numbered.integers(SEED_END)))
        if not self._moves_numbers:
            self._values = self._plant_states(observation)
            session.place_values(self._values)
        elif not (self._observation_numbers(observation) and session.place_numbers()):
            raise self._no_states_error(observation)
        if broken := self._states_not_finite():
            names = ", ".join(f"`{n}`" for n in broken)
            raise wrong_choice(f"an episode cannot start where {names} is NaN or infinite")
        before = int(session.facts["mode"])
        if session.run_until_due() != session.agent.index:
            raise wrong_choice("the advanced controller has a phase: the plant would move first")
        self._last, self._over = observation, False
        self._violations = 0
        info = self._info_of_step(env_info, None, None) | {
            "switched": bool(session.seen.mode != before)
        }
        self._violations = info["violations"]
        if session.seen.ttf:
            warn_of_start(session.module.name)
        return observation, self._wanted_info(info, env_info)

    def step(
        self,
        env: gymnasium.Env[Any, Any],
        action: Any,  # noqa: ANN401 - any action
    ) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Answers for the agent, and steps `env` whenever the plant is due until the agent is.

        SoterError U001 where no episode has begun or it is over, or where numbers do not fit.
        """
        if self._over:
            begun = self._last is not None
            message = "the episode is over" if begun else "no episode has begun"
            raise wrong_choice(message, "call reset() first")
        session, next_command, direct = self.session, self._next_command, self._direct
        plant = self._plant
        due = session.act_directly(action) if direct else NO_NUMBERS
        if due == NO_NUMBERS:
            due = self._give_action(action)
        reward, ended, cut = 0.0, False, False
        env_info: dict[str, Any] = {}
        taken: Any = None
        while due == plant and not (ended or cut):
            taken = self._current_command(env) if next_command is None else next_command()
            last, gained, ended, cut, env_info = env.step(taken)
            self._last = last
            reward += float(gained)
            due = session.move_directly(last) if direct else NO_NUMBERS
            if due == NO_NUMBERS:
                due = self._give_observation(last)
            elif due == NO_STATES or self.judged is not None:
                self._note_judged(last, due)
        if due == AS_TOLD:
            self._over = ended or cut
            info = self._repeated_info.copy()
            info["margin"] = session.outside.margin_ns / 1e9
            info["action_taken"], info["action_requested"] = taken, action
            for key in env_info:
                if key not in info:
                    info[key] = env_info[key]
            asked_for = info if self._info_keys is None else self._wanted_info(info, env_info)
            return last, reward, ended, cut, asked_for
        broken = self._states_not_finite() if session.outside.latched else []
        cut = cut or bool(broken)
        self._over = ended or cut
        info = self._info_of_step(env_info, action, taken)
        if broken:
            info |= {"off_model": True, "not_finite": broken}
        if self._cuts and info["cost"]:
            cut = self._over = True
        self._note_step(info)
        return self._last, reward, ended, cut, self._wanted_info(info, env_info)

    def _note_step(self, info: dict[str, Any]) -> None:
        """Keeps what C compares the next step with; warns of the first step off the model."""
        session = self.session
        self._violations = info["violations"]
        if info["off_model"] and not self._off_model:
            if self.judged is None:
                self._off_model = True
                warn_off_model(session.plant.name)
        elif self._repeats and info["cause"] != "gate":
            self._repeated_info = self._repeatable_info(info["violations"])

    # ------------------------------------------------------------ the agent's answer

    def _give_action(self, action: Any) -> int:  # noqa: ANN401 - any action
        """Gives the agent's action to the module; returns the component that is due then."""
        session = self.session
        if self._act is None and getattr(action, "shape", ()) != session.action.shape:
            array_mapping.require_no_batch(self.action_space, action)
        if not self._acts_numbers:
            session.act_with_values(self._action_values(action))
            return session.run_until_due()
        count = copy_numbers(action, session.action, "an action")
        if count is not None:
            raise array_mapping.wrong_count(self._outputs, count, "an action")
        return session.act_numbers()

    def _action_values(self, action: Any) -> list[Value | None] | None:  # noqa: ANN401 - any action
        """The values of the agent's topics for an action; None where it is no value of them."""
        try:
            if self._act is None:
                return list(array_mapping.assemble_values(self._outputs, action, "an action"))
            answer = self._act(action)
            return list(convert_answer(self._outputs, answer))
        except ValueStructureError as error:
            message = "`act` gave no outputs of the controller"
            raise array_mapping.wrong_structure(message, self._outputs, answer, error) from error
        except ValueShapeError:
            return None

    # ------------------------------------------------------------ the environment's

    def _give_observation(self, observation: Any) -> int:  # noqa: ANN401 - any observation
        """Gives an observation to the module; returns the component that is due then."""
        session = self.session
        if not self._moves_numbers:
            states = self._values = self._plant_states(observation)
            if self.asked is not None:
                session.moved[:] = array_mapping.numbers_of_values(self._states, states)
                session.judge_move()
                self._note_judged(observation, session.plant.index)
            session.move_to_values(states)
            return session.run_until_due()
        due = session.move_numbers() if self._observation_numbers(observation) else NO_STATES
        self._note_judged(observation, due)
        return due

    def _states_not_finite(self) -> list[str]:
        """Names the states that the environment showed as NaN or infinite."""
        values = self._values
        if self._moves_numbers:
            values = array_mapping.assemble_values(
                self._states, self.session.moved, "an observation"
            )
        named = zip(self._states, values, strict=True)
        return [n for (n, _), value in named if not array_mapping.is_finite(value)]

    def _note_judged(self, observation: Any, due: int) -> None:  # noqa: ANN401 - any observation
        """Passes the judged step to `judged`; SoterError U001 if the observation was no state."""
        if due == NO_STATES:
            raise self._no_states_error(observation)
        if self.judged is not None and self.asked is not None:
            self.judged(self.asked)

    def _observation_numbers(self, observation: Any) -> bool:  # noqa: ANN401 - any observation
        return copy_numbers(observation, self.session.moved, "an observation") is None

    def _no_states_error(self, observation: Any) -> SoterError:  # noqa: ANN401 - any observation
        """Gives the SoterError that says why an observation is no state of the plant."""
        count = copy_numbers(observation, self.session.moved, "an observation")
        if count is not None:
            return array_mapping.wrong_count(self._states, count, "an observation")
        try:
            array_mapping.assemble_values(self._states, observation, "an observation")
        except ValueShapeError as error:
            return wrong_choice(f"an observation is no state of the plant: {error}")
        raise AssertionError(observation)

    def _plant_states(self, observation: Any) -> list[Value]:  # noqa: ANN401 - any observation
        """The plant's states by an observation; what `observe` leaves out keeps its value."""
        if self._observe is None:
            return array_mapping.assemble_values(self._states, observation, "an observation")
        try:
            answer = self._observe(observation)
            states = convert_answer(self._states, answer)
        except ValueShapeError as error:
            message = "`observe` gave no state of the plant"
            raise array_mapping.wrong_structure(message, self._states, answer, error) from error
        old = self.session.plant_states()
        unseen = [n for (n, _), v in zip(self._states, states, strict=True) if v is None]
        if unseen and not self._unseen:
            self._unseen = True
            warn_of_unseen(unseen)
        if self.asked is not None:
            self.asked.compare_only([v is not None for v in states])
        return [a if b is None else b for a, b in zip(old, states, strict=True)]

    def _current_command(self, env: gymnasium.Env[Any, Any]) -> Any:  # noqa: ANN401 - an action of it
        values = [self.session.topic_value(t.index) for t in self._reads]
        shapes: list[tuple[str, Type]] = [(t.name.rpartition(".")[2], t.type) for t in self._reads]
        if self._command is None:
            return array_mapping.action_from_numbers(
                env.action_space, array_mapping.numbers_of_values(shapes, values)
            )
        named = {n: to_python(t, v) for (n, t), v in zip(shapes, values, strict=True)}
        return self._command(**named)

    # ------------------------------------------------------------ what is told

    def _info_of_step(
        self,
        env_info: dict[str, Any],
        action: Any,  # noqa: ANN401 - any action
        taken: Any,  # noqa: ANN401 - any action of the environment
    ) -> dict[str, Any]:
        """Joins `env_info` of the environment with what is known of the module after a step."""
        session = self.session
        outside, violations = session.outside, session.seen.violations
        if self._over and session.compiled.linked:
            violations = session.violation_count(over=True)
        known = self._info_by_flags.get(outside.flags)
        if known is None:
            known = self._info_by_flags[outside.flags] = self._flag_info(session.seen.taken_by)
        info = {**env_info, **known} if env_info else known.copy()
        info["margin"] = outside.margin_ns / 1e9
        info["violations"] = violations
        info["action_taken"] = taken
        info["action_requested"] = action
        info["cost"] = float(violations - self._violations)
        if info["cause"] == "gate":
            info["cause"] = self._refusal_cause()
        if self._masks and session.module.shield is not None:
            info["action_mask"] = self.action_masks().astype(np.int8)
        return info

    def _wanted_info(self, info: dict[str, Any], env: dict[str, Any]) -> dict[str, Any]:
        """The keys of `info` that the caller wants, and all that the environment gave in `env`."""
        keys = self._info_keys
        if keys is None:
            return info
        return {**env, **{key: info[key] for key in keys if key in info}}

    def _repeatable_info(self, violations: int) -> dict[str, Any]:
        """The `info` of a step that changes only the margin; C is told what to compare with it."""
        outside = self.session.outside
        self.session.compiled.lib.soter_outside_tell(outside)
        known = self._info_by_flags[outside.flags]
        return {**known, "violations": violations, "cost": 0.0}

    def _flag_info(self, before: int) -> dict[str, Any]:
        """The part of `info` that follows from flags; `before` is the mode before the step."""
        seen = self.session.seen
        mode, stepped, gate_fault = seen.mode, seen.steps > 0, bool(seen.gate_fault)
        counted = bool(seen.taken_by) and not gate_fault and not seen.moved
        return {
            "mode": "AC" if mode else "SC",
            "ttf": bool(seen.ttf),
            "safer": bool(seen.safer),
            "stale": bool(seen.stale),
            "switched": mode != before,
            "taken_by": ("AC" if seen.taken_by else "SC") if stepped else None,
            "gate_fault": gate_fault,
            "intervened": stepped and not counted,
            "cause": CAUSES[seen.cause],
            "off_model": None if self.asked is None else bool(seen.off_model),
        }

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Whether AC in control would publish each `Discrete` action unmoved, (n,); U001."""
        space = self.action_space
        if not isinstance(space, spaces.Discrete):
            raise wrong_choice("only a `Discrete` action space has a mask", f"it is {space}")
        if self._over:  # nobody is asked
            return np.zeros(int(space.n), dtype=np.bool_)
        actions = range(int(space.start), int(space.start) + int(space.n))
        return np.array([self.session.would_publish(self._action_values(a)) for a in actions])

    def _refusal_cause(self) -> str:
        """The cause of the last refusal: "shield" where a shield forbade it, else "gate"."""
        if self.session.module.shield is None:
            return "gate"
        agent = self.session.record["components"][self.session.agent.index]
        return "shield" if agent["last_fault"] == FaultKind.SHIELD else "gate"

    # ------------------------------------------------------------ copies

    def __getstate__(self) -> dict[str, Any]:
        """Gives all attributes but the compiled program, which `__setstate__` loads again."""
        if not self.session.alone:
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
        self.program, self.judged = program, None
        self._compile_choices(self._space)
        self.session.restore_state(saved)

    def __deepcopy__(self, memo: dict[int, Any]) -> EnvironmentGuard:
        """A guard of the same program with a state of its own."""
        state = self.__getstate__()
        del state["_named"]
        made = EnvironmentGuard.__new__(EnvironmentGuard)
        made._restore_session(self.program, copy.deepcopy(state, memo))  # noqa: SLF001 - its own class
        return made


def is_single(bound: Bound) -> bool:
    """Whether all numbers between two bounds stay finite when they are rounded to float32."""
    return max(abs(bound.low), abs(bound.high)) <= float(np.finfo(np.float32).max)
