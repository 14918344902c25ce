"""A rover among people, and what is wrong with it in many ways.

Purpose: the program of `examples/exploration/people.soter` cut down to its proof, and edits of it
none of which may be proved: what each makes wrong is its name. A plant whose far states end
otherwise than its near ones.
Non-goals: judging them.
"""

from __future__ import annotations

from dataclasses import dataclass

PASSIVE = """soter 1;
const A: float = 2.5;
const FAST: float = 1.5;
const W: float = 1.0;
const REST: float = 0.15;
const SLOPE: float = 0.05;
topic seen: { gap: float, v: float } max_age 50ms;
topic accel: float in [-A, A] = 0.0;
plant Somebody period 50ms {
  reads accel;
  drives seen = { gap: min(gap, 8.0), v: v };
  state gap: float in [3.0, 20.0];
  state v: float = 0.0;
  disturbance slope: float in [-SLOPE, SLOPE];
  disturbance walks: float in [-W, W];
  der gap = walks - v;
  der v = accel + slope;
  measured seen.gap within 0.05, seen.v within 0.01;
}
node Hurry period 50ms { publishes accel; step { publish accel = A; } }
node Brake period 50ms {
  subscribes seen;
  publishes accel;
  step { publish accel = clamp(-4.0 * seen.v, -A, A); }
}
const LOOK: float = 0.11;
fun need(v: float): float {
  let s = max(v, 0.0) + A * LOOK;
  return s * (LOOK + 0.1) + s * s / (2.0 * A) + W * (LOOK + 0.4 + s / A) + 0.12;
}
rta Passive {
  ac Hurry;
  sc Brake;
  period 50ms;
  safe seen.gap > 0.0 || abs(seen.v) < REST;
  ttf seen.gap < need(seen.v) || abs(seen.v) > FAST;
  safer seen.gap > need(seen.v) + 0.1 && abs(seen.v) < 0.9 * FAST;
  verify {
    grid one.gap in [0.0, 5.0] / 100 open, seen.v in [-2.2, 2.2] / 220;
    late dm 200us, sc 200us;
    response dm 500us, sc 500us;
    acts within 1ms;
    recover never;
  }
}
system Proved { one: Somebody; module Passive; until 5s; }
"""

FALLING = """soter 1;
topic seen: { x: float, v: float } max_age 100ms;
topic u: float in [0.0, 0.001] = 0.0;
plant P period 100ms {
  reads u;
  drives seen = { x: x, v: v };
  state x: float;
  state v: float;
  der x = -8.0;
  der v = 3.5 - v + u;
}
node Fast period 100ms { publishes u; step { publish u = 0.001; } }
node Slow period 100ms { publishes u; step { publish u = 0.0; } }
rta M {
  ac Fast;
  sc Slow;
  period 100ms;
  safe seen.x < 5.0 || seen.v < 3.0;
  ttf true;
  safer false;
  verify { grid seen.x in [0.0, 5.0] / 10 open, seen.v in [-1.0, 4.0] / 50; recover never; }
}
system S { p: P; module M; }
"""
"""Below 5 it may be as fast as it likes, above up to 3. It comes down at 8: from 10 within 1.3 s,
when v is below 3. Who is above 20 is not down in time."""


@dataclass(frozen=True)
class WrongRover:
    """`edits`: pairs of what stands in `PASSIVE` and what is written in its place."""

    name: str
    edits: tuple[tuple[str, str], ...]
    same_shape: bool = True
    """Its states and grid are those of `PASSIVE`, so that tables of that fit it."""

    reads_the_place: bool = False
    """SC or the plant goes by a state whose axis has no ends: it is refused."""

    @property
    def text(self) -> str:
        """The wrong program."""
        text = PASSIVE
        for old, new in self.edits:
            assert old in text, old
            text = text.replace(old, new)
        return text


WRONG_ROVERS = (
    WrongRover(
        "people run, and ttf counts with people who walk",
        (("walks: float in [-W, W]", "walks: float in [-2.0 * W, 2.0 * W]"),),
    ),
    WrongRover(
        "at rest is less than the error and the slope",
        (("REST: float = 0.15", "REST: float = 0.04"),),
    ),
    WrongRover(
        "a slope on which SC does not stand", (("SLOPE: float = 0.05", "SLOPE: float = 0.8"),)
    ),
    WrongRover("SC creeps on", (("-4.0 * seen.v", "-4.0 * (seen.v - 0.2)"),)),
    WrongRover("SC creeps back", (("-4.0 * seen.v", "-4.0 * (seen.v + 0.2)"),)),
    WrongRover(
        "SC brakes too little",
        (("clamp(-4.0 * seen.v, -A, A)", "clamp(-4.0 * seen.v, -0.5, 0.5)"),),
    ),
    WrongRover("SC stops too late", (("-4.0 * seen.v", "-0.7 * seen.v"),)),
    WrongRover("SC brakes until it is going back", (("clamp(-4.0 * seen.v, -A, A)", "-A"),)),
    WrongRover("SC speeds up", (("-4.0 * seen.v", "4.0 * seen.v"),)),
    WrongRover("SC does nothing", (("clamp(-4.0 * seen.v, -A, A)", "0.0"),)),
    WrongRover(
        "DM and SC are later than ttf allows for",
        (("late dm 200us, sc 200us", "late dm 20ms, sc 20ms"),),
    ),
    WrongRover(
        "commands act later than ttf allows for", (("acts within 1ms", "acts within 20ms"),)
    ),
    WrongRover(
        "ttf without the time until SC acts", (("LOOK: float = 0.11", "LOOK: float = 0.0"),)
    ),
    WrongRover("ttf without what people walk", (("W * (LOOK + 0.4 + s / A)", "0.0"),)),
    WrongRover("ttf without the way to a stop", (("s * s / (2.0 * A)", "0.0"),)),
    WrongRover(
        "ttf is one distance at all speeds",
        (("ttf seen.gap < need(seen.v)", "ttf seen.gap < 1.2"),),
    ),
    WrongRover("ttf knows of no speed that is too high", ((" || abs(seen.v) > FAST", ""),)),
    WrongRover(
        "safer gives back too near",
        (("safer seen.gap > need(seen.v) + 0.1", "safer seen.gap > 0.3"),),
    ),
    WrongRover("safe without at rest", ((" || abs(seen.v) < REST", ""),)),
    WrongRover(
        "the speed is off by more than at rest", (("seen.v within 0.01", "seen.v within 0.2"),)
    ),
    WrongRover(
        "the distance is off by more than ttf allows for",
        (("seen.gap within 0.05", "seen.gap within 0.4"),),
    ),
    WrongRover("reads are older than ttf allows for", (("max_age 50ms", "max_age 150ms"),)),
    WrongRover("a sensor that is silent", (("recover never;", "recover never; dropout 200ms;"),)),
    WrongRover("the DM looks too seldom", (("  period 50ms;\n  safe", "  period 250ms;\n  safe"),)),
    WrongRover(
        "it starts too fast",
        (
            ("gap: float in [3.0, 20.0]", "gap: float in [0.5, 20.0]"),
            ("state v: float = 0.0", "state v: float = 2.0"),
        ),
    ),
    WrongRover(
        "what is published has ends that the plant passes",
        (("gap: float, v: float } max", "gap: float, v: float } in { gap in [-2.0, 9.0] } max"),),
    ),
    WrongRover(
        "people who gather speed",
        (
            ("state v: float = 0.0;", "state v: float = 0.0;\n  state pace: float = 0.0;"),
            ("der gap = walks - v", "der pace = walks;\n  der gap = pace - v"),
            ("/ 220;", "/ 110, one.pace in [-1.0, 1.0] / 4;"),
        ),
        same_shape=False,
    ),
    WrongRover(
        "an SC that goes by where people are",
        (("-4.0 * seen.v", "seen.gap > 1.0 ? -seen.v : -4.0 * seen.v"),),
        reads_the_place=True,
    ),
    WrongRover(
        "an SC that speeds up where nobody is near",
        (
            ("gap: min(gap, 8.0)", "gap: gap"),
            ("clamp(-4.0 * seen.v, -A, A)", "seen.gap > 50.0 ? 1.0 : clamp(-4.0 * seen.v, -A, A)"),
        ),
        reads_the_place=True,
    ),
    WrongRover(
        "people who go by where the rover is",
        (("walks - v", "walks * max(1.0, 3.0 - gap) - v"),),
        reads_the_place=True,
    ),
)
"""Each leaves `safe`, or loses what the proof rests on."""
