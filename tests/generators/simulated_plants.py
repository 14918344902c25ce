"""Vehicles whose truth is known, and episodes of them, to be identified.

Purpose: `SimulatedPlant` draws a vehicle of one or two axes: what it is (drag, gain, how hard it is
pushed), the program that a newcomer would write of it, with other numbers, and episodes in which it
is commanded and pushed at random, each as hard as it happens to be. They are exact: commands and
pushes are held from one sample to the next.
Non-goals: robots that somebody would build.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.monitor.identification import Episode
from soter.simulate.run_log import RecordedRun

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

PERIOD_S, PERIOD_NS = 0.1, 100_000_000
PROGRAM = """soter 1;
param DRAG: float = 0.5 in [0.0, 10.0];
param GAIN: float = 1.0 in [0.0, 10.0];
{params}
type Seen = {{ {fields} }};
topic seen: Seen max_age 150ms;
topic force: float in [-1.0, 1.0] = 0.0;
plant Mass period 100ms {{
  reads force;
  drives seen = {{ {shown} }};
{states}
}}
node Fast period 100ms {{ subscribes seen; publishes force; step {{ publish force = 1.0; }} }}
node Calm period 100ms {{ subscribes seen; publishes force; step {{ publish force = 0.0; }} }}
rta Keeper {{
  ac Fast; sc Calm; period 100ms;
  safe abs(seen.v0) < 40.0;
  ttf abs(seen.v0) > 20.0;
  safer abs(seen.v0) < 10.0;
  verify {{ grid {grid}; late dm 0ms, sc 0ms; response dm 0ms, sc 0ms; acts within 0ms; }}
}}
system Flying default {{ m: Mass; module Keeper; until 10s; }}
"""


@dataclass
class SimulatedPlant:
    """v' = gain force - drag v + push - bend v |v| on each axis, |push| at most `push`.

    `bend`: a term that the program does not have. `noise`: how far a measurement is off, at most.
    """

    seed: int
    axes: int = 1
    bend: float = 0.0
    noise: float = 0.0
    harder: float = 1.0
    """How much harder new episodes are pushed, on average: more than 1 is another draw."""

    def __post_init__(self) -> None:
        """Draws the vehicle."""
        self.random = np.random.default_rng(self.seed)
        self.drag, self.gain = self.random.uniform(0.2, 2.0), self.random.uniform(0.5, 3.0)
        self.push = self.random.uniform(0.05, 1.0, self.axes)

    def program(self, most: float = 100.0) -> str:
        """The text of its program; `most`: the greatest push that it permits."""
        axes = range(self.axes)
        error = "param NOISE: float = 0.05 in [0.0, 1.0];" if self.noise else ""
        measured = ", ".join(f"seen.v{i} within NOISE" for i in axes)
        lines = [
            f"  state v{i}: float = 0.0;\n"
            f"  disturbance push{i}: float in [-PUSH{i}, PUSH{i}];\n"
            f"  der v{i} = GAIN * force - DRAG * v{i} + push{i};"
            for i in axes
        ] + [f"  measured {measured};"] * bool(self.noise)
        pushes = [f"param PUSH{i}: float = 0.1 in [0.0, {most}];" for i in axes]
        return PROGRAM.format(
            params="\n".join([*pushes, error]),
            fields=", ".join(f"v{i}: float" for i in axes),
            shown=", ".join(f"v{i}: v{i}" for i in axes),
            states="\n".join(lines),
            grid=", ".join(f"seen.v{i} in [-50.0, 50.0] / 100" for i in axes),
        )

    def flown(self, steps: int, force: float = 1.0) -> tuple[Floats, Floats]:
        """States (steps + 1, axes) and forces (steps + 1,) of an episode; at most so much force."""
        r = self.random
        hard = self.harder * r.uniform(0.3, 1.0)
        v = r.uniform(-1.0, 1.0, self.axes)
        states, forces = [v], []
        decay = np.exp(-self.drag * PERIOD_S)
        held = (1 - decay) / self.drag
        for _ in range(steps):
            u = r.uniform(-force, force) if force else 0.0
            push = hard * self.push * r.uniform(-1.0, 1.0, self.axes)
            v = decay * v + held * (self.gain * u + push - self.bend * v * np.abs(v))
            states.append(v)
            forces.append(u)
        return np.array(states), np.array([*forces, 0.0])

    def episode(self, steps: int, force: float = 1.0) -> Episode:
        """An episode as a record with its true states."""
        states, forces = self.flown(steps, force)
        times = [k * PERIOD_NS for k in range(len(forces))]
        topics = [
            {"seen": tuple(v), "force": float(u)}
            for v, u in zip(states.tolist(), forces, strict=True)
        ]
        truths = [{"m": tuple(v)} for v in states.tolist()]
        return Episode(
            "flight", RecordedRun(times, topics, truths, [{"seen", "force"}] * len(times))
        )

    def write(self, path: Path, steps: int, force: float = 1.0) -> Path:
        """An episode as a CSV of time, measurements and force; `mapping` reads it."""
        states, forces = self.flown(steps, force)
        seen = states + self.random.uniform(-self.noise, self.noise, states.shape)
        with path.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["t", *(f"v{i}" for i in range(self.axes)), "u"])
            times = np.arange(len(forces)) * PERIOD_S
            rows.writerows(np.c_[times, seen, forces].round(9).tolist())
        return path

    @property
    def mapping(self) -> dict[str, object]:
        """The mapping of what `write` writes."""
        fields = {f"v{i}": f"v{i}" for i in range(self.axes)}
        topics = {"seen": {"fields": fields}, "force": {"fields": {"value": "u"}}}
        return {"time": {"from": "t", "unit": "s"}, "topics": topics}
