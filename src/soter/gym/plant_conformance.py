"""Measures whether an environment does what the plant of a proof can do.

Purpose: `conformance` drives a protected environment, and asks of each of its steps which declared
disturbances explain it; a step that none explains is outside of the proof.
Non-goals: proofs that it always will; logs of robots (`soter monitor`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.gym.environment_choices import wrong_choice
from soter.gym.safety_warnings import warn_of_sc_alone

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from soter.gym.plant_model import SessionPlant
    from soter.gym.protected import Protected, SafetyWrapper
    from soter.gym.session import Session


NEAR_TURN = 0.02
"""An angle wrapped around if a difference is this near to a whole number of turns, in turns."""


@dataclass(frozen=True)
class Conformance:
    """The comparison of `steps` steps of an environment with the program's plant.

    `inside`: number of steps that disturbances within their bounds explain. `used`: by disturbance,
    the largest part of its bounds that a step needed (1: a bound). `worst`: the step with the
    largest residual, relative to what is tolerated. `not_observed`: states that `observe` never
    gave, which were not compared. `ac_share`: the share of the agent's steps in which AC had
    control; only in these it explored. By state: `residual`: the largest difference that the best
    disturbances leave; `undisturbed`: the largest difference from the plant with every disturbance
    at its middle; `wrapped`: number of steps that are not inside and are near a whole number of
    turns (2 pi) off the undisturbed plant, as after an angle wrapped.
    """

    steps: int
    inside: int
    residual: dict[str, float]
    undisturbed: dict[str, float]
    used: dict[str, float]
    worst: dict[str, Any] = field(default_factory=dict)
    wrapped: dict[str, int] = field(default_factory=dict)
    not_observed: tuple[str, ...] = ()
    ac_share: float | None = None

    @property
    def share(self) -> float:
        """The share of the steps that disturbances within their bounds explain."""
        return self.inside / self.steps

    def __str__(self) -> str:
        lines = [f"{self.inside:,} of {self.steps:,} steps ({self.share:.4%}) are explained"]
        if self.ac_share is not None:
            lines.append(f"  AC had control in {self.ac_share:.1%} of its steps")
        for name, value in self.residual.items():
            if name in self.not_observed:
                lines.append(f"  {name}: not observed")
                continue
            lines.append(
                f"  {name}: residual {value:.3g}, undisturbed {self.undisturbed[name]:.3g}"
            )
        lines += [f"  {name}: {part:.1%} of its bounds" for name, part in self.used.items()]
        for name, often in self.wrapped.items():
            lines.append(
                f"  help: {name} is about a multiple of 2 pi off in {often:,} of the "
                f"{self.steps - self.inside:,} steps that are not explained: an angle that wraps "
                "around? Let `observe` unwrap it (docs/gym.md)"
            )
        return "\n".join(lines)


class _Tally:
    """Sums up the judgements of the model over all steps."""

    def __init__(self, session_plant: SessionPlant) -> None:
        model = session_plant.model
        self.steps, self.inside, self.most = 0, 0, -1.0
        self.residual, self.undisturbed = (np.zeros(len(model.names)) for _ in range(2))
        self.used = np.zeros(len(model.drawn))
        self.half = np.maximum((model.high - model.low) / 2.0, np.finfo(float).tiny)
        self.middle = model.low + (model.high - model.low) / 2.0
        self.worst: dict[str, Any] = {}
        self.wrapped = np.zeros(len(model.names), dtype=np.int64)
        self.observed = np.zeros(len(model.names), dtype=bool)

    def count_step(self, session_plant: SessionPlant, session: Session) -> None:
        """Counts a step, which ended at the numbers that `session` was given."""
        left = np.abs(session_plant.residual)
        self.steps += 1
        self.observed |= session_plant.observed
        self.inside += session_plant.explained
        if not session_plant.explained:
            self.wrapped += _are_near_turns(session_plant.undisturbed) & np.isfinite(
                session_plant.tolerance
            )
        self.residual = np.maximum(self.residual, left)
        self.undisturbed = np.maximum(self.undisturbed, np.abs(session_plant.undisturbed))
        self.used = np.maximum(self.used, np.abs(session_plant.chosen - self.middle) / self.half)
        allowed = session_plant.tolerance + session_plant.pointer.relative * np.abs(session.moved)
        part = float(np.max(left / np.maximum(allowed, np.finfo(float).tiny)))
        if not part <= self.most:
            self.most = part
            self.worst = {
                "from": session_plant.origin.tolist(),
                "to": session.moved.tolist(),
                "command": session.command.tolist(),
                "residual": session_plant.residual.tolist(),
            }


def _are_near_turns(off: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Whether each difference (n,), in rad, is near a multiple of a full turn other than 0."""
    turns = np.where(np.isfinite(off), off, 0.0) / (2.0 * np.pi)
    whole = np.round(turns)
    near: npt.NDArray[np.bool_] = (whole != 0.0) & (np.abs(turns - whole) <= NEAR_TURN)
    return near


def conformance(
    env: Protected | SafetyWrapper,
    n: int = 1000,
    *,
    seed: int = 0,
    policy: Callable[[Any], Any] | None = None,
) -> Conformance:
    """Drives `env` for at least `n` steps of its plant, and compares each with the program's plant.

    `policy` gives the action for an observation; by default actions are drawn from the action
    space. A step is inside if disturbances within their bounds bring the program's plant to it,
    within the `tolerance` of `env`. Warns (SafetyWarning) if AC had control in no step. Raises
    SoterError U001 if the program's plant has no model.
    """
    if n < 1:
        raise wrong_choice(f"there cannot be {n} steps", "n is 1 or more")
    guard = getattr(env, "guard", None)
    if guard is None:
        raise wrong_choice(
            f"`{type(env).__name__}` is not protected by a program",
            "give Protected(program, env) or SafetyWrapper(env, program)",
        )
    if guard.plant_model is None:
        raise wrong_choice(
            "there is no model of the plant to compare with",
            "the plant has to be Soter's, without `choose`, and `alarm` not False",
        )
    tally = _Tally(guard.plant_model)
    session = guard.session

    def count_judged(session_plant: SessionPlant) -> None:
        tally.count_step(session_plant, session)

    guard.after_judged_step = count_judged
    try:
        env.action_space.seed(seed)
        observation, _ = env.reset(seed=seed)
        agent_steps, driven = 0, 0
        while tally.steps < n:
            action = env.action_space.sample() if policy is None else policy(observation)
            observation, _, ended, cut, _ = env.step(action)
            seen = session.seen
            agent_steps, driven = agent_steps + 1, driven + bool(seen.steps and seen.taken_by)
            if ended or cut:
                observation, _ = env.reset()
    finally:
        guard.after_judged_step = None
    if not driven:
        warn_of_sc_alone(agent_steps)
    model = guard.plant_model.model
    return Conformance(
        steps=tally.steps,
        inside=tally.inside,
        residual=dict(zip(model.names, tally.residual.tolist(), strict=True)),
        undisturbed=dict(zip(model.names, tally.undisturbed.tolist(), strict=True)),
        used=dict(zip(model.drawn, tally.used.tolist(), strict=True)),
        worst=tally.worst,
        wrapped={n: k for n, k in zip(model.names, tally.wrapped.tolist(), strict=True) if k},
        not_observed=tuple(n for n, o in zip(model.names, tally.observed, strict=True) if not o),
        ac_share=driven / agent_steps,
    )
