# ruff: noqa: ANN401 - what a mutant changes may be a number, a name or a choice
"""Modules to mutate, each with a simulation of its own: text for Soter, NumPy for the falsifier.

Purpose: `BASES`; of each the program text as a function of numbers and choices that a mutant may
change (never a plant, a set, an error, an age or a period), and the same closed loop written again
in NumPy, hundreds of runs side by side, with stale readings and errors and disturbances at their
bounds. Nothing here comes from `soter`: it is what says independently that a mutant is bad.
Non-goals: deciding what `soter verify` says about them (`mutants.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable

Array = npt.NDArray[np.float64]
Params = dict[str, Any]


@dataclass(frozen=True)
class Loop:
    """What a closed loop needs: all functions take and give arrays over the runs.

    `step(x, u, w, h)` moves the true states (k, n) by h seconds (or one step of a map).
    """

    step: Callable[[Array, Array, Array, float], Array]
    safe: Callable[[Array], npt.NDArray[np.bool_]]
    law: Callable[[Array], Array]
    ttf: Callable[[Array], npt.NDArray[np.bool_]]
    safer: Callable[[Array], npt.NDArray[np.bool_]]
    start: Array
    spread: Array
    """Runs start within this of `start`."""
    control: float
    disturbance: Array
    """Bound of the disturbance: one, or one a state."""
    errors: Array
    tick_s: float
    """Time step of the simulation."""
    dm_ticks: int
    sc_ticks: int
    age_ticks: int
    """Readings are this old at most."""


@dataclass(frozen=True)
class Outcome:
    """What the falsifier saw."""

    escapes: int
    stuck: int
    """Runs that stayed under SC for the last half of the time."""
    runs: int


def attack(loop: Loop, runs: int, ticks: int, seed: int) -> Outcome:
    """Run the closed loop against pushing, waiting, switching controllers."""
    rng = np.random.default_rng(seed)
    k = len(loop.start)
    x = loop.start[:, None] + loop.spread[:, None] * rng.uniform(-1.0, 1.0, (k, runs))
    past = [x.copy() for _ in range(loop.age_ticks + 1)]
    push = np.where(rng.random(runs) < 0.5, -1.0, 1.0)
    hold = 2 ** rng.integers(0, 11, runs)
    hold[: runs // 3] = 2**40
    wait = rng.integers(0, max(ticks // 2, 1), runs)
    wait[: runs // 6] = 2**40
    wind = np.where(rng.random(runs) < 0.5, -1.0, 1.0)
    error_sign = np.where(rng.random((k, runs)) < 0.5, -1.0, 1.0)
    noisy = rng.random(runs) < 0.3
    age = np.where(rng.random(runs) < 0.5, loop.age_ticks, 0)
    pumping = runs // 8  # pushes whichever way the last state goes
    mode = np.zeros(runs, dtype=bool)
    escaped = np.zeros(runs, dtype=bool)
    last_ac = np.zeros(runs, dtype=np.int64)
    u_ac, u = np.zeros(runs), np.zeros(runs)
    for t in range(ticks):
        past[t % len(past)] = x
        old = past[(t - loop.age_ticks) % len(past)] if t >= loop.age_ticks else past[0]
        seen = np.where(age > 0, old, x)
        if t % min(loop.dm_ticks, loop.sc_ticks) == 0:
            flip = noisy & (rng.random(runs) < 0.5)
            error_sign = np.where(flip, -error_sign, error_sign)
            seen = seen + error_sign * loop.errors[:, None]
        if t % loop.dm_ticks == 0:
            mode = np.where(mode, ~loop.ttf(seen), loop.safer(seen))
        if t % loop.sc_ticks == 0:
            turned = (t // hold) % 2 == 1
            side = np.where(turned ^ (t >= wait), -push, push)
            side[:pumping] = np.where(seen[-1, :pumping] >= 0.0, 1.0, -1.0)
            u_ac = side * loop.control
            u = np.where(mode, u_ac, np.clip(loop.law(seen), -loop.control, loop.control))
        last_ac[mode] = t
        gusts = np.where(noisy & (rng.random(runs) < 0.02), -wind, wind)
        w = (
            gusts * loop.disturbance
            if loop.disturbance.ndim == 0
            else (loop.disturbance[:, None] * gusts)
        )
        x = loop.step(x, u, w, loop.tick_s)
        escaped |= ~loop.safe(x)
    stuck = (last_ac < ticks // 2) & ~escaped
    return Outcome(int(escaped.sum()), int(stuck.sum()), runs)


# ---------------------------------------------------------------- cart


CART = Template("""soter 1;

// A cart between two walls.

const A: float = 3.0;  // m/s^2
const WALL: float = 10.0;  // m

type Motion = { x: float, v: float };

topic motion: Motion max_age 20ms;
topic accel: float in [-A, A] = 0.0;

plant Cart period 5ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.2, 0.2];
  der x = v;
  der v = accel + wind;
  measured motion.x within 0.02, motion.v within 0.05;
}

node Fast period 10ms {
  subscribes motion;
  publishes accel;
  step { publish accel = clamp(4.0 * (9.5 - motion.x) - 1.0 * motion.v, -A, A); }
}

node Careful period 10ms {
  subscribes motion;
  publishes accel;
  step {
    let wanted = clamp($GAIN * ($GOAL - $POSITION), -$CREEP, $CREEP);
    publish accel = clamp($SIGN * $KV * (wanted - $SPEED), -$FORCE, $FORCE);
  }
}

fun Clear(m: Motion): bool { return m.x < WALL && m.x > -WALL; }

fun Need(speed: float, tau: float): float {
  let v = $CLIP(speed, 0.0) + $EV;
  return v * v / (2.0 * $B) + $FACTOR * (v * tau + 0.5 * (A + 0.2) * tau * tau) + $EX;
}

fun Fits(m: Motion, tau: float): bool {
  return $RIGHT && $LEFT;
}

rta SafeCart {
  ac Fast;
  sc Careful;
  period 50ms;
  safe Clear(motion);
  ttf $TTF;
  safer $SAFER;
  verify { grid motion.x in [-10.0, 10.0] / 400, motion.v in [-10.5, 10.5] / 210; }
}

system Protected default { c: Cart; module SafeCart; until 30s; always Clear(c.truth); }
""")

CART_DEFAULTS: Params = {
    "GAIN": 0.5,
    "GOAL": 0.0,
    "CREEP": 2.0,
    "SIGN": 1.0,
    "KV": 3.0,
    "FORCE": 3.0,
    "EV": 0.05,
    "EX": 0.2,
    "B": 2.4,
    "FACTOR": 2.3,
    "TAU": 0.12,
    "TAU_SAFER": 0.3,
    "SWAP": False,
    "SIDES": "both",
    "TTF": "fits",
    "SAFER": "fits",
    "MIN_MAX": False,
    "NEED_SIGN": 1.0,
}


def cart_text(p: Params) -> str:
    """The program."""
    q = dict(p)
    q["POSITION"], q["SPEED"] = ("motion.v", "motion.x") if p["SWAP"] else ("motion.x", "motion.v")
    q["CLIP"] = "min" if p["MIN_MAX"] else "max"
    sign = "" if p["NEED_SIGN"] > 0 else "-"
    other = "-" if p["NEED_SIGN"] > 0 else ""
    q["RIGHT"] = f"WALL - m.x >= Need({sign}m.v, tau)" if p["SIDES"] != "left" else "true"
    q["LEFT"] = f"WALL + m.x >= Need({other}m.v, tau)" if p["SIDES"] != "right" else "true"
    q["TTF"] = {"fits": f"!Fits(motion, {p['TAU']!r})", "false": "false", "true": "true"}[p["TTF"]]
    q["SAFER"] = {
        "fits": f"Fits(motion, {p['TAU_SAFER']!r})",
        "true": "true",
        "clear": "Clear(motion)",
    }[p["SAFER"]]
    return CART.substitute(q)


def cart_loop(p: Params) -> Loop:
    """The closed loop."""

    def step(x: Array, u: Array, w: Array, h: float) -> Array:
        a = u + w
        return np.array([x[0] + x[1] * h + 0.5 * a * h * h, x[1] + a * h])

    def law(y: Array) -> Any:
        position, speed = (y[1], y[0]) if p["SWAP"] else (y[0], y[1])
        wanted = np.clip(p["GAIN"] * (p["GOAL"] - position), -p["CREEP"], p["CREEP"])
        return np.clip(p["SIGN"] * p["KV"] * (wanted - speed), -p["FORCE"], p["FORCE"])

    def need(speed: Array, tau: float) -> Any:
        v = (np.minimum if p["MIN_MAX"] else np.maximum)(speed, 0.0) + p["EV"]
        reach = v * tau + 0.5 * 3.2 * tau * tau
        return v * v / (2.0 * p["B"]) + p["FACTOR"] * reach + p["EX"]

    def fits(y: Array, tau: float) -> Any:
        right = 10.0 - y[0] >= need(p["NEED_SIGN"] * y[1], tau)
        left = 10.0 + y[0] >= need(-p["NEED_SIGN"] * y[1], tau)
        return {"both": right & left, "right": right, "left": left}[p["SIDES"]]

    return Loop(
        step=step,
        safe=lambda x: np.abs(x[0]) < 10.0,
        law=law,
        ttf=_ttf(p, fits),
        safer=_safer(p, fits, lambda y: np.abs(y[0]) < 10.0),
        start=np.zeros(2),
        spread=np.zeros(2),
        control=3.0,
        disturbance=np.array(0.2),
        errors=np.array([0.02, 0.05]),
        tick_s=0.005,
        dm_ticks=10,
        sc_ticks=2,
        age_ticks=4,
    )


def _ttf(p: Params, fits: Callable[[Array, float], Any]) -> Callable[[Array], Any]:
    if p["TTF"] == "fits":
        return lambda y: ~fits(y, p["TAU"])
    return lambda y: np.full(y.shape[1], p["TTF"] == "true")


def _safer(
    p: Params, fits: Callable[[Array, float], Any], clear: Callable[[Array], Any]
) -> Callable[[Array], Any]:
    if p["SAFER"] == "fits":
        return lambda y: fits(y, p["TAU_SAFER"])
    if p["SAFER"] == "clear":
        return clear
    return lambda y: np.full(y.shape[1], True)


# ---------------------------------------------------------------- tank


TANK = Template("""soter 1;

// A tank that must neither run dry nor over.

const PUMP: float = 0.5;  // m/s of level
const FULL: float = 4.0;  // m

topic level: float max_age 40ms;
topic pump: float in [-PUMP, PUMP] = 0.0;

plant Tank period 20ms {
  reads pump;
  drives level = h;
  state h: float = 2.0;
  disturbance leak: float in [-0.1, 0.1];
  der h = pump + leak;
  measured level within 0.02;
}

node Greedy period 100ms {
  subscribes level;
  publishes pump;
  step { publish pump = clamp(2.0 * (3.99 - level), -PUMP, PUMP); }
}

node Steady period 100ms {
  subscribes level;
  publishes pump;
  step { publish pump = clamp($SIGN * $GAIN * ($GOAL - level), -$FORCE, $FORCE); }
}

fun Held(h: float): bool { return h > 0.0 && h < FULL; }

fun Fits(h: float, tau: float): bool {
  let reach = $RATE * tau + $EX;
  return $UPPER && $LOWER;
}

rta SafeTank {
  ac Greedy;
  sc Steady;
  period 200ms;
  safe Held(level);
  ttf $TTF;
  safer $SAFER;
  verify { grid level in [0.0, 4.0] / 800; }
}

system Protected default { t: Tank; module SafeTank; until 60s; always Held(t.truth.h); }
""")

TANK_DEFAULTS: Params = {
    "SIGN": 1.0,
    "GAIN": 1.0,
    "GOAL": 2.0,
    "FORCE": 0.4,
    "RATE": 0.6,
    "EX": 0.06,
    "TAU": 0.3,
    "TAU_SAFER": 1.0,
    "SIDES": "both",
    "TTF": "fits",
    "SAFER": "fits",
    "MIN_MAX": False,
}


def tank_text(p: Params) -> str:
    """The program."""
    q = dict(p)
    q["UPPER"] = "h + reach <= FULL" if p["SIDES"] != "lower" else "true"
    q["LOWER"] = "h - reach >= 0.0" if p["SIDES"] != "upper" else "true"
    if p["MIN_MAX"]:
        q["UPPER"], q["LOWER"] = "h - reach <= FULL", "h + reach >= 0.0"
    q["TTF"] = {"fits": f"!Fits(level, {p['TAU']!r})", "false": "false", "true": "true"}[p["TTF"]]
    q["SAFER"] = {
        "fits": f"Fits(level, {p['TAU_SAFER']!r})",
        "true": "true",
        "clear": "Held(level)",
    }[p["SAFER"]]
    return TANK.substitute(q)


def tank_loop(p: Params) -> Loop:
    """The closed loop."""

    def law(y: Array) -> Any:
        return np.clip(p["SIGN"] * p["GAIN"] * (p["GOAL"] - y[0]), -p["FORCE"], p["FORCE"])

    def fits(y: Array, tau: float) -> Any:
        reach = p["RATE"] * tau + p["EX"]
        if p["MIN_MAX"]:
            return (y[0] - reach <= 4.0) & (y[0] + reach >= 0.0)
        upper, lower = y[0] + reach <= 4.0, y[0] - reach >= 0.0
        return {"both": upper & lower, "upper": upper, "lower": lower}[p["SIDES"]]

    return Loop(
        step=lambda x, u, w, h: x + (u + w) * h,
        safe=lambda x: (x[0] > 0.0) & (x[0] < 4.0),
        law=law,
        ttf=_ttf(p, fits),
        safer=_safer(p, fits, lambda y: (y[0] > 0.0) & (y[0] < 4.0)),
        start=np.array([2.0]),
        spread=np.zeros(1),
        control=0.5,
        disturbance=np.array(0.1),
        errors=np.array([0.02]),
        tick_s=0.02,
        dm_ticks=10,
        sc_ticks=5,
        age_ticks=2,
    )


# ---------------------------------------------------------------- pendulum


PENDULUM = Template("""soter 1;

// A pole that must not fall: a nonlinear flow.

const TORQUE: float = 8.0;  // rad/s^2
const FALLEN: float = 0.8;  // rad

type Pole = { angle: float, rate: float };

topic pole: Pole max_age 15ms;
topic torque: float in [-TORQUE, TORQUE] = 0.0;

plant Pendulum period 10ms {
  reads torque;
  drives pole = { angle: th, rate: om };
  state th: float = 0.0;
  state om: float = 0.0;
  disturbance gust: float in [-0.3, 0.3];
  der th = om;
  der om = 4.0 * th * (1.0 - th * th / 6.0) - 0.2 * om * abs(om) + torque + gust;
  measured pole.angle within 0.005, pole.rate within 0.02;
}

node Wild period 20ms {
  subscribes pole;
  publishes torque;
  step { publish torque = clamp(20.0 * (0.78 - pole.angle) - 2.0 * pole.rate, -TORQUE, TORQUE); }
}

node Balance period 20ms {
  subscribes pole;
  publishes torque;
  step {
    let wanted = -$KP * (pole.$FIRST - $GOAL) - $KD * pole.$SECOND;
    publish torque = clamp($SIGN * wanted, -$FORCE, $FORCE);
  }
}

fun Up(p: Pole): bool { return p.angle < FALLEN && p.angle > -FALLEN; }

fun Need(rate: float, tau: float): float {
  let w = max($RATE_SCALE * rate + (TORQUE + 3.2) * tau, 0.0) + $EV;
  return w * tau + w * w / (2.0 * $B) + $EX;
}

fun Fits(p: Pole, tau: float): bool {
  return $RIGHT && $LEFT;
}

rta SafePole {
  ac Wild;
  sc Balance;
  period 40ms;
  safe Up(pole);
  ttf $TTF;
  safer $SAFER;
  verify { grid pole.angle in [-0.8, 0.8] / 120, pole.rate in [-4.0, 4.0] / 120; }
}

system Protected default {
  p: Pendulum;
  module SafePole;
  until 20s;
  always Up({ angle: p.truth.th, rate: p.truth.om });
}
""")

PENDULUM_DEFAULTS: Params = {
    "SIGN": 1.0,
    "KP": 24.0,
    "KD": 8.0,
    "GOAL": 0.0,
    "FORCE": 8.0,
    "FIRST": "angle",
    "SECOND": "rate",
    "EV": 0.02,
    "EX": 0.1,
    "B": 3.6,
    "RATE_SCALE": 1.0,
    "TAU": 0.07,
    "TAU_SAFER": 0.1,
    "SIDES": "both",
    "TTF": "fits",
    "SAFER": "fits",
}


def pendulum_text(p: Params) -> str:
    """The program."""
    q = dict(p)
    q["RIGHT"] = "FALLEN - p.angle >= Need(p.rate, tau)" if p["SIDES"] != "left" else "true"
    q["LEFT"] = "FALLEN + p.angle >= Need(-p.rate, tau)" if p["SIDES"] != "right" else "true"
    q["TTF"] = {"fits": f"!Fits(pole, {p['TAU']!r})", "false": "false", "true": "true"}[p["TTF"]]
    q["SAFER"] = {"fits": f"Fits(pole, {p['TAU_SAFER']!r})", "true": "true", "clear": "Up(pole)"}[
        p["SAFER"]
    ]
    return PENDULUM.substitute(q)


def pendulum_loop(p: Params) -> Loop:
    """The closed loop: two RK4 steps a tick."""

    def f(x: Array, a: Array) -> Array:
        th, om = x
        return np.array([om, 4.0 * th * (1.0 - th * th / 6.0) - 0.2 * om * np.abs(om) + a])

    def step(x: Array, u: Array, w: Array, h: float) -> Array:
        a = u + w
        for _ in range(2):
            g = 0.5 * h
            k1 = f(x, a)
            k2 = f(x + 0.5 * g * k1, a)
            k3 = f(x + 0.5 * g * k2, a)
            k4 = f(x + g * k3, a)
            x = x + g / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return np.clip(x, -50.0, 50.0)  # fallen long ago

    def law(y: Array) -> Any:
        first = y[0] if p["FIRST"] == "angle" else y[1]
        second = y[1] if p["SECOND"] == "rate" else y[0]
        u = p["SIGN"] * (-p["KP"] * (first - p["GOAL"]) - p["KD"] * second)
        return np.clip(u, -p["FORCE"], p["FORCE"])

    def need(rate: Array, tau: float) -> Any:
        w = np.maximum(p["RATE_SCALE"] * rate + 11.2 * tau, 0.0) + p["EV"]
        return w * tau + w * w / (2.0 * p["B"]) + p["EX"]

    def fits(y: Array, tau: float) -> Any:
        right, left = 0.8 - y[0] >= need(y[1], tau), 0.8 + y[0] >= need(-y[1], tau)
        return {"both": right & left, "right": right, "left": left}[p["SIDES"]]

    return Loop(
        step=step,
        safe=lambda x: np.abs(x[0]) < 0.8,
        law=law,
        ttf=_ttf(p, fits),
        safer=_safer(p, fits, lambda y: np.abs(y[0]) < 0.8),
        start=np.zeros(2),
        spread=np.zeros(2),
        control=8.0,
        disturbance=np.array(0.3),
        errors=np.array([0.005, 0.02]),
        tick_s=0.005,
        dm_ticks=8,
        sc_ticks=4,
        age_ticks=3,
    )


# ---------------------------------------------------------------- lift (a map)


LIFT = Template("""soter 1;

// A lift cage in whole seconds: a map.

const TOP: float = 20.0;  // m

type Cage = { z: float, v: float };

topic cage: Cage max_age 500ms;
topic winch: float in [-1.0, 1.0] = 0.0;

plant Lift period 1s {
  reads winch;
  drives cage = { z: z, v: v };
  state z: float = 0.0;
  state v: float = 0.0;
  disturbance load: float in [-0.1, 0.1];
  next z = z + v;
  next v = 0.8 * v + winch + load;
  measured cage.z within 0.05, cage.v within 0.02;
}

node Express period 1s {
  subscribes cage;
  publishes winch;
  step { publish winch = clamp(0.5 * (19.9 - cage.z) - cage.v, -1.0, 1.0); }
}

node Homing period 1s {
  subscribes cage;
  publishes winch;
  step {
    let wanted = clamp($GAIN * ($GOAL - cage.z), -$CREEP, $CREEP);
    publish winch = clamp($SIGN * (wanted - $KV * cage.v), -$FORCE, $FORCE);
  }
}

fun Inside(c: Cage): bool { return c.z < TOP && c.z > -TOP; }

// How high the cage gets: `steps` more of anything, then braking.
fun Peak(z: float, v: float, steps: float): float {
  var at = z + $EX;
  var speed = v + $EV;
  for i in 0..6 {
    if float(i) < steps {
      at = at + max(speed, 0.0);
      speed = 0.8 * speed + $REACH;
    }
  }
  for i in 0..8 {
    at = at + max(speed, 0.0);
    speed = 0.8 * speed - $B;
  }
  return at;
}

fun Fits(c: Cage, steps: float): bool {
  return $UPPER && $LOWER;
}

rta SafeLift {
  ac Express;
  sc Homing;
  period 2s;
  safe Inside(cage);
  ttf $TTF;
  safer $SAFER;
  verify { grid cage.z in [-20.0, 20.0] / 400, cage.v in [-5.6, 5.6] / 224; }
}

system Protected default { l: Lift; module SafeLift; until 200s; always Inside(l.truth); }
""")

LIFT_DEFAULTS: Params = {
    "GAIN": 0.2,
    "GOAL": 0.0,
    "CREEP": 1.5,
    "SIGN": 1.0,
    "KV": 0.8,
    "FORCE": 1.0,
    "EX": 0.4,
    "EV": 0.07,
    "REACH": 1.1,
    "B": 0.8,
    "TAU": 2.0,
    "TAU_SAFER": 4.0,
    "SIDES": "both",
    "TTF": "fits",
    "SAFER": "fits",
}


def lift_text(p: Params) -> str:
    """The program."""
    q = dict(p)
    q["UPPER"] = "Peak(c.z, c.v, steps) <= TOP" if p["SIDES"] != "lower" else "true"
    q["LOWER"] = "Peak(-c.z, -c.v, steps) <= TOP" if p["SIDES"] != "upper" else "true"
    q["TTF"] = {"fits": f"!Fits(cage, {p['TAU']!r})", "false": "false", "true": "true"}[p["TTF"]]
    q["SAFER"] = {
        "fits": f"Fits(cage, {p['TAU_SAFER']!r})",
        "true": "true",
        "clear": "Inside(cage)",
    }[p["SAFER"]]
    return LIFT.substitute(q)


def lift_loop(p: Params) -> Loop:
    """The closed loop."""

    def law(y: Array) -> Any:
        wanted = np.clip(p["GAIN"] * (p["GOAL"] - y[0]), -p["CREEP"], p["CREEP"])
        return np.clip(p["SIGN"] * (wanted - p["KV"] * y[1]), -p["FORCE"], p["FORCE"])

    def peak(z: Array, v: Array, steps: float) -> Any:
        at, speed = z + p["EX"], v + p["EV"]
        for i in range(6):
            if i < steps:
                at, speed = at + np.maximum(speed, 0.0), 0.8 * speed + p["REACH"]
        for _ in range(8):
            at, speed = at + np.maximum(speed, 0.0), 0.8 * speed - p["B"]
        return at

    def fits(y: Array, steps: float) -> Any:
        upper, lower = peak(y[0], y[1], steps) <= 20.0, peak(-y[0], -y[1], steps) <= 20.0
        return {"both": upper & lower, "upper": upper, "lower": lower}[p["SIDES"]]

    return Loop(
        step=lambda x, u, w, _h: np.clip(np.array([x[0] + x[1], 0.8 * x[1] + u + w]), -1e3, 1e3),
        safe=lambda x: np.abs(x[0]) < 20.0,
        law=law,
        ttf=_ttf(p, fits),
        safer=_safer(p, fits, lambda y: np.abs(y[0]) < 20.0),
        start=np.zeros(2),
        spread=np.zeros(2),
        control=1.0,
        disturbance=np.array(0.1),
        errors=np.array([0.05, 0.02]),
        tick_s=1.0,
        dm_ticks=2,
        sc_ticks=1,
        age_ticks=0,
    )


# ---------------------------------------------------------------- mountain car (a map)


CAR = Template("""soter 1;

// The car of examples/mountain_car/cliff.soter, with SC, ttf and safer written by hand.

const POWER: float = 0.0015;
const SLOPE: float = 0.0025;
const V_MAX: float = 0.07000000029802322;
const X_MAX: float = 0.6000000238418579;
const CLIFF: float = -1.2;

type Car = { x: float, v: float };

topic car: Car max_age 500ms;
topic force: float in [-1.0, 1.0] = 0.0;

plant MountainCar period 1s {
  reads force;
  drives car = { x: x, v: v };
  state x: float in [-0.6, -0.4];
  state v: float = 0.0;
  disturbance rounding_x: float in [-1.1920928955078125e-7, 1.1920928955078125e-7];
  disturbance rounding_v: float in [-1.4901161193847656e-8, 1.4901161193847656e-8];
  let pushed = v + POWER * force - SLOPE * cos(3.0 * x) + rounding_v;
  let moved = clamp(pushed, -V_MAX, V_MAX);
  next v = moved;
  next x = min(x + moved + rounding_x, X_MAX);
}

node BangBang period 1s {
  subscribes car;
  publishes force;
  step { publish force = car.v >= 0.0 ? 1.0 : -1.0; }
}

node Brake period 1s {
  subscribes car;
  publishes force;
  step { publish force = clamp(-$SIGN * $GAIN * (car.$WHAT - $GOAL), -$FORCE, $FORCE); }
}

fun OnTrack(c: Car): bool { return c.x > CLIFF; }

// Height over the valley that full throttle to the right cannot take away, and speed.
fun Energy(x: float, v: float): float {
  return $KINETIC * v * v + $HILL * sin(3.0 * x) - $THROTTLE * x;
}

fun Fits(c: Car, steps: float): bool {
  let v = abs(c.v) + 0.004 * steps;
  return c.x + 0.08 * steps < $HIGH
      && Energy(c.x, c.v) + 0.003 * steps * v + $MARGIN < Energy(CLIFF, 0.0);
}

rta SafeCar {
  ac BangBang;
  sc Brake;
  period 1s;
  safe OnTrack(car);
  ttf $TTF;
  safer $SAFER;
  verify { grid car.x in [CLIFF, X_MAX] / 360, car.v in [-V_MAX, V_MAX] / 280; }
}

system Protected default {
  car: MountainCar;
  module SafeCar;
  until 1000s;
  always OnTrack(car.truth);
}
""")

CAR_DEFAULTS: Params = {
    "SIGN": 1.0,
    "GAIN": 100.0,
    "WHAT": "v",
    "GOAL": 0.0,
    "FORCE": 1.0,
    "KINETIC": 0.5,
    "HILL": 0.0025 / 3.0,
    "THROTTLE": 0.0015,
    "MARGIN": 0.0003,
    "HIGH": -0.05,
    "TAU": 1.0,
    "TAU_SAFER": 3.0,
    "TTF": "fits",
    "SAFER": "fits",
}


def car_text(p: Params) -> str:
    """The program."""
    q = dict(p)
    q["TTF"] = {"fits": f"!Fits(car, {p['TAU']!r})", "false": "false", "true": "true"}[p["TTF"]]
    q["SAFER"] = {
        "fits": f"Fits(car, {p['TAU_SAFER']!r})",
        "true": "true",
        "clear": "OnTrack(car)",
    }[p["SAFER"]]
    return CAR.substitute(q)


def car_loop(p: Params) -> Loop:
    """The closed loop."""

    def step(x: Array, u: Array, w: Array, _h: float) -> Array:
        pushed = x[1] + 0.0015 * u - 0.0025 * np.cos(3.0 * x[0]) + w[1]
        moved = np.clip(pushed, -0.07000000029802322, 0.07000000029802322)
        return np.array([np.clip(x[0] + moved + w[0], -50.0, 0.6000000238418579), moved])

    def law(y: Array) -> Any:
        what = y[1] if p["WHAT"] == "v" else y[0]
        return np.clip(-p["SIGN"] * p["GAIN"] * (what - p["GOAL"]), -p["FORCE"], p["FORCE"])

    def energy(x: Array, v: Array) -> Any:
        return p["KINETIC"] * v * v + p["HILL"] * np.sin(3.0 * x) - p["THROTTLE"] * x

    def fits(y: Array, steps: float) -> Any:
        v = np.abs(y[1]) + 0.004 * steps
        at_cliff = energy(np.array(-1.2), np.array(0.0))
        low = energy(y[0], y[1]) + 0.003 * steps * v + p["MARGIN"] < at_cliff
        return low & (y[0] + 0.08 * steps < p["HIGH"])

    return Loop(
        step=step,
        safe=lambda x: x[0] > -1.2,
        law=law,
        ttf=_ttf(p, fits),
        safer=_safer(p, fits, lambda y: y[0] > -1.2),
        start=np.array([-0.5, 0.0]),
        spread=np.array([0.1, 0.0]),
        control=1.0,
        disturbance=np.array([1.1920928955078125e-7, 1.4901161193847656e-8]),
        errors=np.zeros(2),
        tick_s=1.0,
        dm_ticks=1,
        sc_ticks=1,
        age_ticks=0,
    )


# ---------------------------------------------------------------- all


@dataclass(frozen=True)
class Base:
    """A module with its mutants: (name, what is changed)."""

    name: str
    module: str
    defaults: Params
    text: Callable[[Params], str]
    loop: Callable[[Params], Loop]
    ticks: int
    """How long the falsifier runs."""
    mutants: tuple[tuple[str, Params], ...]

    def attack(self, p: Params, runs: int, seed: int) -> Outcome:
        """What its simulation comes to."""
        return attack(self.loop(p), runs, self.ticks, seed)


SHARED: tuple[tuple[str, Params], ...] = (
    ("ttf is constant false", {"TTF": "false"}),
    ("safer is constant true", {"SAFER": "true"}),
    ("safer is only safe", {"SAFER": "clear"}),
    ("SC with the wrong sign", {"SIGN": -1.0}),
)

BASES: tuple[Base, ...] = (
    Base(
        "cart",
        "SafeCart",
        CART_DEFAULTS,
        cart_text,
        cart_loop,
        12_000,
        (
            *SHARED,
            ("horizon of zero in ttf, no margin", {"TAU": 0.0, "EX": 0.0}),
            ("horizon halved, margins gone", {"TAU": 0.06, "FACTOR": 1.0, "EX": 0.0, "EV": 0.0}),
            ("horizon in the wrong unit, small margin", {"TAU": 0.12e-3, "EX": 0.02}),
            ("ttf brakes with twice what there is", {"B": 5.0}),
            ("ttf brakes with 3.2 and forgets that AC accelerates", {"B": 3.2, "FACTOR": 1.0}),
            ("ttf forgets braking", {"B": 1e9}),
            ("ttf forgets the distance of the reaction", {"FACTOR": 0.0, "EX": 0.0}),
            ("ttf watches the right wall only", {"SIDES": "right"}),
            ("ttf watches the left wall only", {"SIDES": "left"}),
            ("min for max in Need", {"MIN_MAX": True}),
            ("sign of the speed in Need", {"NEED_SIGN": -1.0}),
            ("no errors, no horizon", {"EV": 0.0, "EX": 0.0, "TAU": 0.02}),
            ("SC brakes with a third", {"FORCE": 1.0}),
            ("SC brakes with half", {"FORCE": 1.5}),
            ("SC weaker than the wind", {"FORCE": 0.15}),
            ("SC hovers: it only brakes", {"GAIN": 0.0}),
            ("SC is too soft", {"KV": 0.3}),
            ("SC goes to the other wall", {"GOAL": -10.5}),
            ("SC goes to the wall", {"GOAL": 10.5}),
            ("SC waits where safer never holds", {"GOAL": 9.0, "TAU_SAFER": 0.7}),
            ("safer never holds", {"TAU_SAFER": 3.0}),
        ),
    ),
    Base(
        "tank",
        "SafeTank",
        TANK_DEFAULTS,
        tank_text,
        tank_loop,
        10_000,
        (
            *SHARED,
            ("horizon of zero in ttf", {"TAU": 0.0}),
            ("horizon of a third", {"TAU": 0.1, "EX": 0.02}),
            ("horizon in the wrong unit", {"TAU": 0.3e-3}),
            ("ttf forgets leak and half the pump", {"RATE": 0.25, "EX": 0.0}),
            ("ttf forgets the lower end", {"SIDES": "upper"}),
            ("ttf forgets the upper end", {"SIDES": "lower"}),
            ("minus for plus in ttf", {"MIN_MAX": True}),
            ("SC weaker than the leak", {"FORCE": 0.08}),
            ("SC far too soft", {"GAIN": 0.02}),
            ("SC rests above the rim", {"GOAL": 4.3}),
            ("SC rests below the floor", {"GOAL": -0.3}),
            ("SC rests where safer never holds", {"GOAL": 3.6}),
            ("SC does nothing", {"GAIN": 0.0}),
            ("safer never holds", {"TAU_SAFER": 5.0}),
        ),
    ),
    Base(
        "pendulum",
        "SafePole",
        PENDULUM_DEFAULTS,
        pendulum_text,
        pendulum_loop,
        8_000,
        (
            *SHARED,
            ("horizon of zero in ttf", {"TAU": 0.0}),
            ("horizon of a third, no margin", {"TAU": 0.02, "EX": 0.0}),
            ("horizon in the wrong unit", {"TAU": 0.07e-3}),
            ("ttf brakes with three times what there is", {"B": 14.0, "EX": 0.0}),
            ("ttf takes degrees for radians", {"RATE_SCALE": 0.0174533}),
            ("ttf forgets the left side", {"SIDES": "right"}),
            ("ttf forgets the right side", {"SIDES": "left"}),
            ("SC weaker than gravity at the border", {"FORCE": 2.6}),
            ("SC with 40 % of the torque", {"FORCE": 3.2}),
            ("SC that drives instead of damping", {"KD": -3.0}),
            ("SC without stiffness", {"KP": 0.0}),
            ("SC below the gain gravity needs", {"KP": 2.0}),
            ("SC mixes up angle and rate", {"FIRST": "rate", "SECOND": "angle", "KD": 3.0}),
            ("SC leans to the border", {"GOAL": 0.85}),
            ("SC leans where safer never holds", {"GOAL": 0.62}),
            ("SC leans to the other border", {"GOAL": -0.85}),
            ("safer never holds", {"TAU_SAFER": 0.4}),
        ),
    ),
    Base(
        "lift",
        "SafeLift",
        LIFT_DEFAULTS,
        lift_text,
        lift_loop,
        2_000,
        (
            *SHARED,
            ("2 Delta became Delta: one step too few", {"TAU": 1.0}),
            ("horizon of zero in ttf", {"TAU": 0.0}),
            ("ttf forgets what AC may do", {"REACH": 0.0}),
            ("ttf brakes with twice what there is", {"B": 2.0}),
            ("ttf forgets the lower end", {"SIDES": "upper"}),
            ("ttf forgets the upper end", {"SIDES": "lower"}),
            ("SC brakes with a third", {"FORCE": 0.33}),
            ("SC weaker than the load", {"FORCE": 0.08}),
            ("SC goes to the bottom", {"GOAL": -20.5}),
            ("SC goes to the top", {"GOAL": 20.5}),
            ("SC waits where safer never holds", {"GOAL": 17.5}),
            ("SC does nothing but brake", {"GAIN": 0.0}),
            ("safer never holds", {"TAU_SAFER": 6.0, "EX": 9.0}),
        ),
    ),
    Base(
        "car",
        "SafeCar",
        CAR_DEFAULTS,
        car_text,
        car_loop,
        3_000,
        (
            *SHARED,
            ("ttf forgets what AC adds", {"TAU": 0.0, "MARGIN": -0.0002}),
            ("ttf turns the hill over", {"HILL": -0.0025 / 3.0}),
            ("ttf counts half the speed", {"KINETIC": 0.125}),
            ("ttf counts twice the throttle", {"THROTTLE": 0.003}),
            ("SC with a third of the throttle", {"FORCE": 0.33}),
            ("SC does nothing", {"GAIN": 0.0}),
            ("SC steers to the middle by position", {"WHAT": "x", "GOAL": -1.3}),
            ("SC pulls left", {"GOAL": -0.07}),
            ("safer never holds", {"TAU_SAFER": 40.0}),
        ),
    ),
)
