"""K against what survives an adversary, of robots with three coupled states (and one of two).

    .venv/bin/python bench/verify/survivors.py [--states 400] [--chains 4]
        [--folder ../shared/robots] [--json FILE] [NAME ...]

States are drawn from all cells of C, evenly. Each is flown by SC against disturbances and errors at
their ends and reads that are fresh or old: first all of the modes of `bench/newcomers/flights.py`,
then schedules of ends that are piecewise constant, of which a piece is turned over as long as that
brings the flight closer to an end of C. What never leaves C in any of these flights *survives*.
*Share*: of those that survive, how many lie in K. K may be smaller for want of cells, the adversary
weaker than what may happen; so a share of 1 is not to be had, and *wrong*, states of K that do not
survive, has to be 0.
Purpose: how much the sets lose. K is that of the declared cells, or of half of them (decision 320).
Non-goals: computed levels; robots whose SC does not begin at once.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.newcomers.equations import robot_of  # noqa: E402 - needs the path
from bench.newcomers.flights import Array, Booleans, Robot, moved  # noqa: E402

from soter.language.front_end import check_file, system_of  # noqa: E402
from soter.report.terminal_tables import table  # noqa: E402
from soter.verify.claims.cells import smaller_cells  # noqa: E402
from soter.verify.enclose.compiled_enclosures import library_of  # noqa: E402
from soter.verify.grid.sets import GridGroup  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402

if TYPE_CHECKING:
    from soter.verify.problem.problem import Problem

PIECES, ROUNDS, UNTIL_S = 16, 60, 30.0
"""Pieces of a schedule, how often one is turned over, and the longest flight."""
ROBOTS = ("lift", "boat", "ground_avoidance", "dubins_polar")
CHAIN = """soter 1;
topic m: {{ p: float, v: float, a: float }} max_age {age}ms;
topic u: float in [-{most}, {most}] = 0.0;
plant Chain period 10ms {{
  reads u;
  drives m = {{ p: p, v: v, a: a }};
  state p: float = 0.0;
  state v: float = 0.0;
  state a: float = 0.0;
  disturbance w: float in [-{w}, {w}];
  der p = v;
  der v = a + w;
  der a = {lag} * (u - a);
  measured m.p within {error}, m.v within {error}, m.a within {error};
}}
node Policy period 20ms {{ publishes u; step {{ publish u = {most}; }} }}
node Home period 20ms {{
  subscribes m;
  publishes u;
  step {{ publish u = clamp(-{kp} * m.p - {kv} * m.v, -{most}, {most}); }}
}}
rta Held {{
  ac Policy;
  sc Home;
  period 40ms;
  safe abs(m.p) < 2.0;
  verify {{
    grid m.p in [-2.0, 2.0] / 32, m.v in [-{speed}, {speed}] / 32, m.a in [-{most}, {most}] / 16;
  }}
}}
system S default {{ r: Chain; module Held; }}
"""


@dataclass(frozen=True)
class Row:
    """Of a robot: states that were drawn, survive, lie in K, do both; cells; CPU seconds."""

    name: str
    drawn: int
    survive: int
    in_core: int
    both: int
    cells: int
    cpu_s: float

    @property
    def share(self) -> float:
        """Of those that survive, what is in K."""
        return self.both / self.survive if self.survive else 0.0


def chain(seed: int) -> str:
    """A mass behind a lag, drawn."""
    drawn = Random(seed)  # noqa: S311 - no secrets
    lag, most = round(drawn.uniform(3.0, 8.0), 2), drawn.choice((2.0, 4.0))
    kp = round(drawn.uniform(0.8, 2.0), 2)
    kv = round(drawn.uniform(1.2, 2.0) * kp**0.5, 2)
    w, error, age = drawn.choice((0.05, 0.2)), drawn.choice((0.01, 0.03)), drawn.choice((10, 40))
    return CHAIN.format(
        lag=lag, most=most, kp=kp, kv=kv, w=w, error=error, age=age, speed=most * 0.75
    )


# ---------------------------------------------------------------- the adversary


def flown(robot: Robot, start: Array, schedule: Array) -> Array:
    """How close to an end of C each flight comes, over its width; below 0: it leaves C.

    `start` (states, n); `schedule` (pieces, disturbances + errors + 1, n): -1 or 1, the last of the
    age of reads: 1 is as old as may be.
    """
    low, high = (np.array(ends)[:, None] for ends in (robot.low, robot.high))
    middle, half = (
        np.array([(a + s * b) / 2 for b, a in robot.disturbed])[:, None] for s in (1, -1)
    )
    errors, count = np.array(robot.errors)[:, None], len(robot.disturbed)
    old = round(robot.age_s / robot.step_s)
    steps = round(robot.until_s / robot.step_s)
    past, x = [start], start
    closest = np.full(start.shape[1], np.inf)
    with np.errstate(all="ignore"):
        for k in range(steps):
            ends = schedule[k * len(schedule) // steps]
            seen = np.where(ends[-1] > 0, past[0], past[-1]) + errors * ends[count:-1]
            x = moved(robot, x, robot.sc(seen), middle + half * ends[:count])
            room = np.minimum(x - low, high - x) / (high - low)
            closest = np.minimum(closest, np.where(robot.safe(x), room.min(axis=0), -1.0))
            x = np.clip(x, low - (high - low), high + (high - low))
            past = [*past[-old:], x] if old else [x]
    return np.where(np.isnan(closest), -1.0, closest)


def survive(robot: Robot, start: Array, chance: np.random.Generator) -> Booleans:
    """Which of the states (states, n) stay in C in every flight that is tried."""
    n, count = start.shape[1], len(robot.disturbed) + len(robot.errors)
    alive = np.ones(n, dtype=bool)
    best = np.full(n, np.inf)
    worst = np.ones((PIECES, count + 1, n))

    def tried(schedule: Array) -> None:
        left = np.flatnonzero(alive)
        closest = flown(robot, start[:, left], schedule[:, :, left])
        nearer = closest < best[left]
        worst[:, :, left[nearer]] = schedule[:, :, left[nearer]]
        best[left] = np.minimum(best[left], closest)
        alive[left[closest < 0.0]] = False

    for d, e, age in itertools.product((-1, 1, 0), (-1, 1, 0), (-1, 1)):
        drawn = chance.choice((-1.0, 1.0), size=worst.shape)
        of_each = [*[d] * len(robot.disturbed), *[e] * len(robot.errors), age]
        fixed = np.array(of_each, dtype=float)[None, :, None]
        tried(np.where(fixed == 0, drawn, fixed))
    for _ in range(ROUNDS):
        if not alive.any():
            break
        first, what = chance.integers(PIECES, size=n), chance.integers(count + 1, size=n)
        last = first + chance.integers(1, 5, size=n)
        piece = np.arange(PIECES)[:, None]
        turned = worst.copy()
        at = (piece >= first) & (piece < last)
        for k in range(count + 1):
            turned[:, k, :][at & (what == k)] *= -1
        tried(turned)
    return alive


# ---------------------------------------------------------------- K


def problem_of(text: str) -> Problem:
    """Of the module of a program."""
    flat = system_of(check_file("robot.soter", text), None)
    return extract(flat, flat.modules[0])


def kept(problem: Problem) -> tuple[GridGroup, Booleans]:
    """The engine and K; on half of the cells where it is empty."""
    for tried in (problem, smaller_cells(problem, list(problem.groups))):
        engine = GridGroup.of(library_of(tried)[0], tried, tried.groups[0])
        core = engine.core(engine.constraint()).cells
        if core.any():
            break
    return engine, np.asarray(core != 0)


def measured(name: str, text: str, states: int) -> Row:
    """One robot."""
    began, chance = time.process_time(), np.random.default_rng(0)
    engine, core = kept(problem_of(text))
    robot = robot_of(text, UNTIL_S, {})
    low, high = (np.array(ends)[:, None] for ends in (robot.low, robot.high))
    start = low + (high - low) * chance.random((len(robot.low), states))
    start = start[:, robot.safe(start)]
    at = tuple(
        np.searchsorted(edges, x, side="right") - 1
        for edges, x in zip(engine.edges, start, strict=True)
    )
    inside = core[at]
    alive = survive(robot, start, chance)
    return Row(
        name=name,
        drawn=start.shape[1],
        survive=int(alive.sum()),
        in_core=int(inside.sum()),
        both=int((alive & inside).sum()),
        cells=core.size,
        cpu_s=time.process_time() - began,
    )


def main(argv: list[str]) -> int:
    """0; 3 where a state of K does not survive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=400)
    parser.add_argument("--chains", type=int, default=4)
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("--json", type=Path)
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    asked = []
    for name in ROBOTS:
        if not options.names or name in options.names:
            at = options.folder / f"{name}.soter"
            at = at if at.exists() else options.folder.parent / "cases/verdicts" / at.name
            asked.append((name, at.read_text()))
    asked += [(f"chain {seed}", chain(seed)) for seed in range(options.chains)]
    found = [measured(name, text, options.states) for name, text in asked]
    shown = []
    for r in found:
        share = f"{r.share:.2f}" if r.in_core else "no K"
        wrong = r.in_core - r.both
        counts = r.cells, r.drawn, r.survive, r.in_core, wrong
        shown.append((r.name, *counts, share, f"{r.cpu_s:.0f}"))
    print(table(("robot", "cells", "drawn", "survive", "in K", "wrong", "share", "CPU s"), shown))
    with_core = [r.share for r in found if r.in_core]
    if with_core:
        print(f"\nleast {min(with_core):.2f}, mean {sum(with_core) / len(with_core):.2f}")
    if options.json:
        options.json.write_text(json.dumps([asdict(r) for r in found], indent=1))
    return 3 if any(r.in_core > r.both for r in found) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
