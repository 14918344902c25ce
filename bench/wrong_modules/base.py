"""What a wrong module is, and the handful of right ones that it is made from.

Purpose: `Wrong`, `Base`; the control arms: small programs that are proved on coarse
grids, and rightly so. A wrong module is one of them with a few lines changed.
Non-goals: the wrong modules themselves (`verdicts.py`, `timing.py`), running anything
(`verdicts.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.rows import edited

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.rows import Edit


@dataclass(frozen=True)
class Base:
    """A program that is proved: the control arm."""

    name: str
    text: str


@dataclass(frozen=True)
class Shown:
    """A demonstration that the module is wrong.

    `command`: words of `soter` after the file's name, `run` or `test` first; it must end with exit
    code 3, violated. `edits`: made in the program before that: AC may be anything, so another AC
    may stand there, or properties and tests. `loop`: a simulation of its own, which gives the
    time in s of the violation or None.
    """

    command: tuple[str, ...] = ()
    edits: tuple[Edit, ...] = ()
    loop: Callable[[], float | None] | None = None


@dataclass(frozen=True)
class Wrong:
    """A module that must not be called proved without a word about what is wrong with it.

    `named`: regular expressions, one of which must be found in what `soter verify` prints if the
    verdict is *proved*; none: it must not be proved. `codes`: diagnostics other than R... that are
    an answer. `shown`: None where the argument in `why` is all there is.
    """

    kind: str
    name: str
    base: Base
    edits: tuple[Edit, ...]
    why: str
    shown: Shown | None = None
    named: tuple[str, ...] = ()
    codes: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    """Of `soter verify`: none, but where there is a second module that has no proof."""

    @property
    def text(self) -> str:
        """The program."""
        return edited(self.base.text, self.edits)


# ---------------------------------------------------------------- control arms

KEEP = """node Fast period 50ms {
  subscribes pos;
  publishes push;
  step { publish push = pos >= 0.0 ? 1.0 : -1.0; }
}
node Careful period 50ms {
  subscribes pos;
  publishes push;
  step { publish push = clamp(-4.0 * pos, -1.0, 1.0); }
}
rta Keep {
  ac Fast;
  sc Careful;
  period 50ms;
  safe abs(pos) < 1.0;
  ttf abs(pos) > 0.7;
  safer abs(pos) < 0.5;
"""
"""AC, SC and the head of the module of the first three."""
PROMPT = """    late dm 0ms, sc 0ms;
    response dm 0ms, sc 0ms;
    acts within 0ms;
  }
}
"""
"""The end of a module in which nothing is late."""

LINE = Base(
    "line",
    """soter 1;

topic pos: float max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;

plant Line period 10ms {
  reads push;
  drives pos = x;
  state x: float = 0.0;
  der x = push;
}
"""
    + KEEP
    + """  verify {
    grid pos in [-1.0, 1.0] / 80;
"""
    + PROMPT
    + """system World default { p: Line; module Keep; until 10s; always abs(p.truth.x) < 1.0; }
""",
)

SIGHT = Base(
    "sight",
    """soter 1;

topic raw: float max_age 20ms;
topic pos: float max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;

plant Body period 10ms {
  reads push;
  drives raw = x;
  state x: float = 0.0;
  der x = push;
}
plant Model period 10ms {
  reads push;
  drives pos = x;
  state x: float = 0.0;
  der x = push;
  measured pos within 0.02;
}
node Scope period 10ms {
  subscribes raw;
  publishes pos;
  step { publish pos = raw; }
}
"""
    + KEEP
    + """  verify {
    abstracts b by m: Model = { x: b.truth.x };
    grid pos in [-1.0, 1.0] / 80;
"""
    + PROMPT
    + """system World default {
  b: Body;
  node Scope;
  module Keep;
  until 10s;
  always abs(b.truth.x) < 1.0;
}
""",
)

MAP = Base(
    "map",
    """soter 1;

topic pos: float max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;

plant Steps period 50ms {
  reads push;
  drives pos = x;
  state x: float = 0.0;
  next x = x + 0.05 * push;
}
"""
    + KEEP
    + """  verify { grid pos in [-1.0, 1.0] / 80; }
}
system World default { p: Steps; module Keep; until 10s; always abs(p.truth.x) < 1.0; }
""",
)

CART = Base(
    "cart",
    """soter 1;

type Motion = { x: float, v: float };
topic motion: Motion max_age 20ms;
topic accel: float in [-2.0, 2.0] = 0.0;

plant Cart period 10ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  der x = v;
  der v = accel;
}
node Fast period 50ms {
  subscribes motion;
  publishes accel;
  step { publish accel = 2.0; }
}
node Careful period 50ms {
  subscribes motion;
  publishes accel;
  step {
    let wanted = clamp(-0.5 * motion.x, -1.0, 1.0);
    publish accel = clamp(4.0 * (wanted - motion.v), -2.0, 2.0);
  }
}
fun Fits(m: Motion, tau: float): bool {
  let v = abs(m.v) + 2.0 * tau;
  return abs(m.x) + abs(m.v) * tau + tau * tau + v * v / 3.0 < 3.6;
}
rta Keep {
  ac Fast;
  sc Careful;
  period 100ms;
  safe abs(motion.x) < 4.0;
  ttf !Fits(motion, 0.3);
  safer Fits(motion, 0.5) && abs(motion.v) < 1.5;
  verify {
    grid motion.x in [-4.0, 4.0] / 100, motion.v in [-4.0, 4.0] / 80;
"""
    + PROMPT
    + """system World default { c: Cart; module Keep; until 20s; always abs(c.truth.x) < 4.0; }
""",
)


RING = Base(
    "ring",
    """soter 1;

type Y = { a: float, b: float };
topic y: Y max_age 1ms;
topic push: float in [-1.0, 1.0] = 0.0;

plant Ring period 1ms {
  reads push;
  drives y = { a: a, b: b };
  state a: float = 0.0;
  state b: float = 0.0;
  der a = 30.0 * b;
  der b = -30.0 * a + push;
}
node Fast period 50ms {
  subscribes y;
  publishes push;
  step { publish push = y.b >= 0.0 ? 1.0 : -1.0; }
}
node Careful period 50ms {
  subscribes y;
  publishes push;
  step { publish push = clamp(-1.375 * y.a - 3.756 * y.b, -1.0, 1.0); }
}
rta Keep {
  ac Fast;
  sc Careful;
  period 100ms;
  safe abs(y.a) < 0.67 && abs(y.b) < 0.67;
  ttf y.a * y.a + y.b * y.b > 0.0015;
  safer y.a * y.a + y.b * y.b < 0.0008;
  verify {
    grid y.a in [-0.67, 0.67] / 100, y.b in [-0.67, 0.67] / 100;
"""
    + PROMPT
    + """system World default {
  r: Ring;
  module Keep;
  until 10s;
  always abs(r.truth.a) < 0.67 && abs(r.truth.b) < 0.67;
}
""",
)

BASES = (LINE, SIGHT, MAP, CART, RING)
