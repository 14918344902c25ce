"""JSBSim's F-16 behind an autopilot, as a Gymnasium environment.

Purpose: `F16`, which is what the plant of examples/rest/dive.soter stands for: JSBSim's aircraft
with its own flight control system, and around it an autopilot that is asked for how fast the flight
path turns up and for a bank. Its path reference goes through two lags, in place of the short
period, and the aircraft is led along it by load factor. `Jet` is that as an environment, and a
`Pilot` flies it at the ground.
Non-goals: how far the model is off (`identify_f16.py`), dives with a module (`dives.py`).

`pip install 'soter-rta[simulators]'`. What JSBSim keeps (engine, surfaces) is its own, so no copy
goes on.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import gymnasium
import jsbsim
import numpy as np
from gymnasium import spaces

if TYPE_CHECKING:
    import random

os.environ.setdefault("JSBSIM_DEBUG", "0")  # no banner for each aircraft
FOOT = 0.3048
G = 9.81
STEP_S = 0.005
"""Of JSBSim, and of the autopilot."""
PERIOD_S, STEPS = 0.01, 2
"""Of the plant of the program."""
LAG, ROLLS = 0.5, 1.0
"""As in the program."""
PUSH, PULL, BANK = 0.06, 0.12, 0.8
"""The ends of what may be asked: rad/s down and up, rad."""
STEEPEST, HIGHEST = -0.75, 0.4
"""Paths beyond which no pilot here asks for more."""
CRUISE = 200.0
"""m/s, which throttle and speed brake hold."""
DIVE_S = 30.0
"""How long one is flown."""


@dataclass(frozen=True)
class Asked:
    """Where the autopilot's references are: path, behind one lag and behind two, and bank."""

    path: float
    led: float
    follows: float
    bank: float

    def rates(self, turn: float, bank: float) -> tuple[float, float, float, float]:
        """How they move, as the program says it."""
        led = (self.path - self.led) / LAG
        return turn, led, (self.led - self.follows) / LAG, (bank - self.bank) / ROLLS

    def later(self, turn: float, bank: float) -> Asked:
        """After a step of the autopilot: Runge-Kutta of order 4."""

        def at(k: tuple[float, ...], s: float) -> Asked:
            path, led, follows, roll = k
            return Asked(
                self.path + s * path,
                self.led + s * led,
                self.follows + s * follows,
                self.bank + s * roll,
            )

        k1 = self.rates(turn, bank)
        k2 = at(k1, 0.5 * STEP_S).rates(turn, bank)
        k3 = at(k2, 0.5 * STEP_S).rates(turn, bank)
        k4 = at(k3, STEP_S).rates(turn, bank)
        mean = tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        return at(mean, STEP_S)


def within(x: float, low: float, high: float) -> float:
    """The nearest number that is."""
    return max(low, min(high, x))


class F16:
    """The aircraft, in flight at a height (m) and speed (m/s), level."""

    def __init__(self, height: float, speed: float) -> None:
        f = self.jet = jsbsim.FGFDMExec(None)
        f.set_debug_level(0)
        f.load_model("f16")
        f.set_dt(STEP_S)
        f["ic/h-sl-ft"], f["ic/vt-fps"] = height / FOOT, speed / FOOT
        f["ic/alpha-deg"], f["ic/gamma-deg"] = 2.5, 0.0
        f.run_ic()
        f["propulsion/set-running"] = -1
        f["gear/gear-cmd-norm"] = f["gear/gear-pos-norm"] = 0.0
        self.asked = Asked(0.0, 0.0, 0.0, 0.0)
        self.trim = 0.0

    def seen(self) -> list[float]:
        """Height, speed, and the references: the states of the program's plant."""
        f, a = self.jet, self.asked
        height, speed = f["position/h-sl-ft"] * FOOT, f["velocities/vt-fps"] * FOOT
        return [height, speed, a.path, a.led, a.follows, a.bank]

    def fly(self, turn: float, bank: float) -> None:
        """A period of the plant."""
        for _ in range(STEPS):
            self._step(turn, bank)

    def _step(self, turn: float, bank: float) -> None:
        f, a = self.jet, self.asked
        _, led, follows, roll = a.rates(turn, bank)
        self.asked = a.later(turn, bank)
        speed, phi = f["velocities/vt-fps"] * FOOT, f["attitude/phi-rad"]
        path = f["flight-path/gamma-rad"]
        wanted = speed / G * (follows + 1.5 * (self.asked.follows - path)) + math.cos(path)
        load = within(wanted / max(0.3, math.cos(phi)), -1.0, 6.0)
        off = load - f["accelerations/Nz"]
        self.trim = within(self.trim + off * STEP_S, -1.0, 1.0)
        ahead = 0.1 * speed / G * (led - follows) / LAG
        f["fcs/elevator-cmd-norm"] = within(-(0.6 * off + self.trim + ahead), -1.0, 1.0)
        rate = roll + 1.5 * (self.asked.bank - phi)
        stick = 0.25 * (rate - f["velocities/p-rad_sec"]) + 0.3 * rate
        f["fcs/aileron-cmd-norm"] = within(stick, -1.0, 1.0)
        f["fcs/throttle-cmd-norm"] = within(0.75 + 0.05 * (CRUISE - speed), 0.0, 1.0)
        f["fcs/speedbrake-cmd-norm"] = within(0.1 * (speed - CRUISE - 5.0), 0.0, 1.0)
        f.run()


class Jet(gymnasium.Env[Any, Any]):
    """The aircraft from the seed's start; an episode ends where it hits the ground, at 0."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(-np.inf, np.inf, (6,), np.float64)
        low, high = np.array([-PUSH, -BANK]), np.array([PULL, BANK])
        self.action_space = spaces.Box(low, high, dtype=np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Level, somewhere between 1,500 and 2,500 m."""
        super().reset(seed=seed)
        assert options is None or not options
        self.f16 = F16(self.np_random.uniform(1500.0, 2500.0), self.np_random.uniform(195.0, 205.0))
        return np.array(self.f16.seen()), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """A period of the plant."""
        self.f16.fly(float(action[0]), float(action[1]))
        seen = np.array(self.f16.seen())
        return seen, 0.0, bool(seen[0] <= 0.0), False, {}


# ---------------------------------------------------------------- who flies


def recover(seen: Any) -> tuple[float, float]:  # noqa: ANN401
    """The safe controller of the program."""
    return within(0.25 - seen[2], -0.05, 0.1), 0.0


@dataclass(frozen=True)
class Plan:
    """What a pilot is after."""

    path: float = 0.0
    bank: float = 0.0
    pull: float = PULL


class Pilot:
    """One of four ways to fly.

    `aims` at the ground and never pulls up; means to pull up but `late`; `any` command, for a while
    each; goes down and flies level `low`, at some hundred metres.
    """

    WAYS = ("aims", "late", "any", "low")

    def __init__(self, draw: random.Random, way: str) -> None:
        self.draw, self.way = draw, way
        bank, pull = draw.uniform(-BANK, BANK), draw.uniform(0.05, PULL)
        self.plan = Plan(draw.uniform(-0.7, -0.3), bank, pull)
        self.height = draw.uniform(50.0, 400.0) if way == "late" else draw.uniform(250.0, 700.0)
        self.turn = 0.0

    def asks(self, seen: Any) -> tuple[float, float]:  # noqa: ANN401
        """A command, every 100 ms."""
        height, path, draw = float(seen[0]), float(seen[2]), self.draw
        if self.way == "any":
            if draw.random() < 0.15:
                self.turn = draw.choice([-PUSH, PULL, draw.uniform(-PUSH, PULL)])
                bank = draw.choice([-BANK, BANK, draw.uniform(-BANK, BANK)])
                self.plan = replace(self.plan, bank=bank)
            turn = self.turn if STEEPEST < path < HIGHEST else -PUSH if path > 0.0 else PULL
            return turn, self.plan.bank
        wanted, fastest = self.plan.path, PULL
        if self.way == "aims" and draw.random() < 0.03:
            self.plan = Plan(draw.uniform(-0.7, -0.3), draw.uniform(-BANK, BANK))
        if self.way == "late" and height < self.height:
            wanted, fastest = 0.1, self.plan.pull
        if self.way == "low":
            wanted = within((self.height - height) / 1500.0, -0.4, 0.1)
        return within(wanted - path, -PUSH, fastest), self.plan.bank
