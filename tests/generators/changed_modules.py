"""Modules that are proved, and edits of SC, `ttf` or `safer` that make bad ones of them.

Non-goals: what `soter verify` says about them (`tests/unit/verify/attack`); more kinds of wrong
modules (`bench/wrong_modules`).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Base:
    """A program with one module; `wrong`: what is bad -> (text, what stands in its place), ..."""

    name: str
    module: str
    text: str
    wrong: dict[str, tuple[tuple[str, str], ...]]

    def changed(self, what: str) -> str:
        """The text of a wrong one."""
        text = self.text
        for old, new in self.wrong[what]:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        return text


CART = """soter 1;

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
    let wanted = clamp(0.5 * (0.0 - motion.x), -2.0, 2.0);
    publish accel = clamp(1.0 * 3.0 * (wanted - motion.v), -3.0, 3.0);
  }
}

fun Clear(m: Motion): bool { return m.x < WALL && m.x > -WALL; }

fun Need(speed: float, tau: float): float {
  let v = max(speed, 0.0) + 0.05;
  return v * v / (2.0 * 2.4) + 2.3 * (v * tau + 0.5 * (A + 0.2) * tau * tau) + 0.2;
}

fun Fits(m: Motion, tau: float): bool {
  return WALL - m.x >= Need(m.v, tau) && WALL + m.x >= Need(-m.v, tau);
}

rta SafeCart {
  ac Fast;
  sc Careful;
  period 50ms;
  safe Clear(motion);
  ttf !Fits(motion, 0.12);
  safer Fits(motion, 0.3);
  verify { grid motion.x in [-10.0, 10.0] / 400, motion.v in [-10.5, 10.5] / 210; }
}

system Protected default { c: Cart; module SafeCart; until 30s; always Clear(c.truth); }
"""

TANK = """soter 1;

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
  step { publish pump = clamp(1.0 * (2.0 - level), -0.4, 0.4); }
}

fun Held(h: float): bool { return h > 0.0 && h < FULL; }

fun Fits(h: float, tau: float): bool {
  let reach = 0.6 * tau + 0.06;
  return h + reach <= FULL && h - reach >= 0.0;
}

rta SafeTank {
  ac Greedy;
  sc Steady;
  period 200ms;
  safe Held(level);
  ttf !Fits(level, 0.3);
  safer Fits(level, 1.0);
  verify { grid level in [0.0, 4.0] / 800; }
}

system Protected default { t: Tank; module SafeTank; until 60s; always Held(t.truth.h); }
"""

PENDULUM = """soter 1;

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
    let wanted = -24.0 * (pole.angle - 0.0) - 8.0 * pole.rate;
    publish torque = clamp(1.0 * wanted, -8.0, 8.0);
  }
}

fun Up(p: Pole): bool { return p.angle < FALLEN && p.angle > -FALLEN; }

fun Need(rate: float, tau: float): float {
  let w = max(1.0 * rate + (TORQUE + 3.2) * tau, 0.0) + 0.02;
  return w * tau + w * w / (2.0 * 3.6) + 0.1;
}

fun Fits(p: Pole, tau: float): bool {
  return FALLEN - p.angle >= Need(p.rate, tau) && FALLEN + p.angle >= Need(-p.rate, tau);
}

rta SafePole {
  ac Wild;
  sc Balance;
  period 40ms;
  safe Up(pole);
  ttf !Fits(pole, 0.07);
  safer Fits(pole, 0.1);
  verify { grid pole.angle in [-0.8, 0.8] / 120, pole.rate in [-4.0, 4.0] / 120; }
}

system Protected default {
  p: Pendulum;
  module SafePole;
  until 20s;
  always Up({ angle: p.truth.th, rate: p.truth.om });
}
"""

LIFT = """soter 1;

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
    let wanted = clamp(0.2 * (0.0 - cage.z), -1.5, 1.5);
    publish winch = clamp(1.0 * (wanted - 0.8 * cage.v), -1.0, 1.0);
  }
}

fun Inside(c: Cage): bool { return c.z < TOP && c.z > -TOP; }

// How high the cage gets: `steps` more of anything, then braking.
fun Peak(z: float, v: float, steps: float): float {
  var at = z + 0.4;
  var speed = v + 0.07;
  for i in 0..6 {
    if float(i) < steps {
      at = at + max(speed, 0.0);
      speed = 0.8 * speed + 1.1;
    }
  }
  for i in 0..8 {
    at = at + max(speed, 0.0);
    speed = 0.8 * speed - 0.8;
  }
  return at;
}

fun Fits(c: Cage, steps: float): bool {
  return Peak(c.z, c.v, steps) <= TOP && Peak(-c.z, -c.v, steps) <= TOP;
}

rta SafeLift {
  ac Express;
  sc Homing;
  period 2s;
  safe Inside(cage);
  ttf !Fits(cage, 2.0);
  safer Fits(cage, 4.0);
  verify { grid cage.z in [-20.0, 20.0] / 400, cage.v in [-5.6, 5.6] / 224; }
}

system Protected default { l: Lift; module SafeLift; until 200s; always Inside(l.truth); }
"""

BASES = {
    b.name: b
    for b in (
        Base(
            "cart",
            "SafeCart",
            CART,
            {
                "SC with the wrong sign": (("clamp(1.0 * 3.0", "clamp(-3.0"),),
                "horizon of zero in ttf, no margin": (
                    ("tau) + 0.2;", "tau);"),
                    ("Fits(motion, 0.12)", "Fits(motion, 0.0)"),
                ),
                "SC hovers: it only brakes": (("clamp(0.5 * (0.0", "clamp(0.0 * (0.0"),),
            },
        ),
        Base(
            "tank",
            "SafeTank",
            TANK,
            {
                "ttf is constant false": (("!Fits(level, 0.3)", "false"),),
                "safer is constant true": (("safer Fits(level, 1.0)", "safer true"),),
                "SC with the wrong sign": (("(2.0 - level), -0.4", "(level - 2.0), -0.4"),),
                "horizon in the wrong unit": (("Fits(level, 0.3)", "Fits(level, 0.0003)"),),
                "SC weaker than the leak": (("-0.4, 0.4", "-0.08, 0.08"),),
                "SC rests where safer never holds": (
                    ("(2.0 - level), -0.4", "(3.6 - level), -0.4"),
                ),
                "ttf forgets the lower end": ((" && h - reach >= 0.0", ""),),
            },
        ),
        Base(
            "pendulum",
            "SafePole",
            PENDULUM,
            {
                "ttf takes degrees for radians": (("max(1.0 * rate", "max(0.0174533 * rate"),),
            },
        ),
        Base(
            "lift",
            "SafeLift",
            LIFT,
            {
                "2 Delta became Delta: one step too few": (
                    ("!Fits(cage, 2.0)", "!Fits(cage, 1.0)"),
                ),
            },
        ),
    )
}
