"""Drawn plants with a heading that nobody bounds: as programs, and as functions of numbers.

Purpose: modules whose proofs need an axis that wraps around; and an adversary that flies SC from
many states at once, in double precision, from headings many turns away.
Non-goals: reading programs: the functions are written beside the text that says the same.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

PI = math.pi
TEXT = """soter 1;
const PI: float = 3.141592653589793;
topic pose: {{ {fields} h: float }} max_age 60ms;
topic turn: float in [-1.0, 1.0] = 0.0;
plant Boat period 20ms {{
  reads turn;
  drives pose = {{ {drives} h: h }};
  {states}
  state h: float = {start!r};
  disturbance w: float in [{low!r}, {high!r}];
  {rates}
  der h = turn + {bend!r} * sin(h + {phase!r}) + w;
  measured {measured} pose.h within {error!r};
}}
node Sail period 50ms {{
  subscribes pose;
  publishes turn;
  step {{ publish turn = clamp(wrap_angle(0.5 - pose.h), -1.0, 1.0); }}
}}
node Home period 50ms {{
  subscribes pose;
  publishes turn;
  step {{ publish turn = clamp({gain!r} * {angle}, -1.0, 1.0); }}
}}
rta Fence {{
  ac Sail;
  sc Home;
  period 100ms;
  safe {safe};
  verify {{ levels 2; grid {axes} pose.h in [{ends}] / {cells}; }}
}}
system S {{ b: Boat; module Fence; until 60s; }}
"""


class Drawn:
    """A program, and what its plant, SC and `safe` compute of arrays: states are (n, runs)."""

    def __init__(self, seed: int) -> None:
        chance = np.random.default_rng(seed)
        numbers = {
            "phase": chance.uniform(-PI, PI),
            "bend": chance.uniform(-0.4, 0.4),
            "push": chance.uniform(0.02, 0.15),
            "error": chance.choice([0.0, 0.01, 0.04]),
            "gain": chance.uniform(1.0, 4.0),
            "away": chance.uniform(-PI, PI),
            "limit": chance.uniform(0.4, 0.9),
            "pull": chance.uniform(0.3, 1.5),
        }
        self.numbers = {k: round(float(v), 3) for k, v in numbers.items()}
        self.moves, self.by_sine, self.from_zero = (chance.random(3) < (0.5, 0.3, 0.3)).tolist()
        """A place moves with the heading, and is to stay within limits, else the heading is; SC
        goes by the sine of an angle; the axis is [0, 2 pi]."""

    @property
    def wanted(self) -> str:
        """The heading to which SC turns."""
        away = self.numbers["away"]
        return f"{away!r} + atan({self.numbers['pull']!r} * pose.x)" if self.moves else f"{away!r}"

    def text(self, cells: int, turns: int = 1) -> str:
        """The program; `turns`: how long the axis is, which wraps around where it is 1."""
        n, half = self.numbers, "0.0, 2.0 * PI" if self.from_zero else "-PI, PI"
        ends = half if turns == 1 else f"-{turns}.0 * PI, {turns}.0 * PI"
        angle = f"{'sin' if self.by_sine else 'wrap_angle'}({self.wanted} - pose.h)"
        moves = self.moves
        start = n["away"] % (2 * PI) if self.from_zero else n["away"]
        return TEXT.format(
            fields="x: float," if moves else "",
            drives="x: x," if moves else "",
            states="state x: float = 0.0;" if moves else "",
            rates=f"der x = cos(h - {n['away'] - PI / 2!r}) + 0.5 * w;" if moves else "",
            measured="pose.x within 0.02," if moves else "",
            axes="pose.x in [-3.0, 3.0] / 24," if moves else "",
            safe="abs(pose.x) < 3.0" if moves else f"cos(pose.h - {n['away']!r}) > -{n['limit']!r}",
            low=-n["push"],
            high=n["push"],
            start=start,
            angle=angle,
            ends=ends,
            cells=cells * turns,
            **{k: n[k] for k in ("bend", "phase", "error", "gain")},
        )

    def rate(self, x: Floats, u: Floats, w: Floats) -> Floats:
        """The derivative."""
        n, h = self.numbers, x[-1]
        turn = u + n["bend"] * np.sin(h + n["phase"]) + w
        if not self.moves:
            return np.asarray(turn[None])
        return np.stack([np.cos(h - (n["away"] - PI / 2)) + 0.5 * w, turn])

    def law(self, y: Floats) -> Floats:
        """What SC publishes."""
        n = self.numbers
        wanted = n["away"] + (np.arctan(n["pull"] * y[0]) if self.moves else 0.0)
        angle = wanted - y[-1]
        off = np.sin(angle) if self.by_sine else np.arctan2(np.sin(angle), np.cos(angle))
        return np.asarray(np.clip(n["gain"] * off, -1.0, 1.0))

    def safe(self, x: Floats) -> NDArray[np.bool_]:
        """Whether `safe` holds."""
        if self.moves:
            return np.asarray(np.abs(x[0]) < 3.0)
        return np.asarray(np.cos(x[-1] - self.numbers["away"]) > -self.numbers["limit"])

    def errors(self) -> Floats:
        """The largest error of each state, (n, 1)."""
        of = [0.02, self.numbers["error"]] if self.moves else [self.numbers["error"]]
        return np.array(of)[:, None]

    def flown(
        self, x: Floats, chance: np.random.Generator, holds: int, delay_s: float
    ) -> NDArray[np.bool_]:
        """Which of these states SC keeps safe, against errors, ages and pushes at their limits."""
        fine, past, parts = self.safe(x), [x], 10
        for _ in range(holds):
            back = int(chance.integers(0, int(delay_s * 1e3 / 5) + 1))
            seen = past[max(0, len(past) - 1 - back)]
            sides = chance.choice([-1.0, 1.0], size=x.shape)
            u = self.law(seen + sides * self.errors())
            w = self.numbers["push"] * chance.choice([-1.0, 1.0], size=x.shape[1])
            for _ in range(parts):
                x = x + 0.005 * self.rate(x + 0.0025 * self.rate(x, u, w), u, w)
                past.append(x)
                fine &= self.safe(x)
        return fine


def counted(drawn: Drawn, cells: int) -> list[str]:
    """The same program with one place each where somebody counts turns."""
    text, n = drawn.text(cells), drawn.numbers
    law = f"publish turn = clamp({n['gain']!r}"
    places = {
        law: f"publish turn = clamp(0.001 * pose.h + {n['gain']!r}",
        f"{drawn.wanted} - pose.h": f"{drawn.wanted} - 1.5 * pose.h",
        "  der h = turn": "  der h = turn - 0.001 * h",
        "  safe ": "  safe pose.h < 9.0 && ",
        "h: float }": "h: float } in { h in [-9.0, 9.0] }",
        "levels 2;": "levels 2; core pose.h < 9.0;",
    }
    assert all(text.count(old) == 1 for old in places)
    return [text.replace(old, new) for old, new in places.items()]
