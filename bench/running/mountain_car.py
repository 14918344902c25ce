"""The mountain car: is Gymnasium's the proved map, and what does the module do for its drivers.

Purpose: the mountain-car rows of issue 3's "Must reach" but the engine's times. `--conformance`
compares 10^6 steps of Gymnasium's MountainCarContinuous-v0 with the compiled Soter map; without it
every driver drives 10,000 episodes alone and behind SafeCar.
Non-goals: proofs (`soter verify`), training (examples/mountain_car/train.py).
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

import soter
from soter.native.extern_bindings import bind
from soter.native.loaded_program import RunStatus
from soter.report.tables import table
from soter.simulate.externs.callables import load_callables
from soter.simulate.externs.python_answers import ExternAnswers
from soter.simulate.interrupt import StopRequest
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from numpy.typing import NDArray

CAR = Path(__file__).resolve().parents[2] / "examples" / "mountain_car"
PROGRAM = CAR / "cliff.soter"
DRIVERS = {
    "bang-bang": ("AdvancedOnly", "Protected"),
    "random": ("RandomAdvanced", "RandomProtected"),
    "always left": ("AlwaysLeftAdvanced", "AlwaysLeftProtected"),
    "trained": ("LearnedAdvanced", "LearnedProtected"),
}
FIRST_SEED = 50_000
STEP_NS = 1_000_000_000
SLICE = 100
"""Steps between two looks at whether an episode is over."""


# ---------------------------------------------------------------- episodes


@dataclass(frozen=True)
class Episode:
    """One episode, until the flag, the cliff or 999 steps."""

    finished: bool
    fell: bool
    steps: int
    ac_steps: int
    takeovers: int
    """How often the DM took control from AC."""


class Driver:
    """A system of the program, ready for any number of episodes."""

    def __init__(self, system: str, path: Path = PROGRAM) -> None:
        bindings = bind(soter.load(path).flat(system), {})
        self._bound = load_callables(bindings, "native", StopRequest())
        self.program = NativeProgram(bindings.system, core=bindings.core)
        assert bindings.system.until_ns is not None
        self.until_ns = bindings.system.until_ns

    def drive(self, seed: int) -> Episode:
        """One episode. Whatever happens after the flag is not part of it."""
        p = self.program
        answers = ExternAnswers(p.system, p.layout, p.load().library, self._bound)
        state = p.load().library.new_state(seed)
        record = state.view(p.dtype)[0]
        episode = record["topics"]["episode"]
        limit_ns = 0
        while limit_ns < self.until_ns and not (episode["finished"] or episode["fell"]):
            limit_ns = min(limit_ns + SLICE * STEP_NS, self.until_ns)
            while True:
                status, _, due = p.load().library.run_until(state, limit_ns)
                if status is RunStatus.END:
                    break
                answers.answer_step(state, due)
        return Episode(
            bool(episode["finished"]),
            bool(episode["fell"]),
            int(episode["steps"]),
            int(episode["ac_steps"]),
            int(episode["takeovers"]),
        )


def drive(task: tuple[str, range]) -> list[Episode]:
    """Every seed of one chunk."""
    system, seeds = task
    driver = Driver(system)
    return [driver.drive(seed) for seed in seeds]


def campaign(pool: multiprocessing.pool.Pool, system: str, count: int) -> list[Episode]:
    """`count` episodes of a system, spread over the cores."""
    chunk = max(1, min(1000, count // (os.cpu_count() or 1)))
    ends = range(FIRST_SEED, FIRST_SEED + count, chunk)
    tasks = [(system, range(a, min(a + chunk, FIRST_SEED + count))) for a in ends]
    return [e for part in pool.map(drive, tasks, chunksize=1) for e in part]


def row(driver: str, arm: str, episodes: list[Episode]) -> tuple[str, ...]:
    """One line of the table. AC share: of all steps until flag or cliff."""
    n, steps = len(episodes), sum(e.steps for e in episodes)
    return (
        driver,
        arm,
        str(n),
        str(sum(e.fell for e in episodes)),
        f"{100 * sum(e.finished for e in episodes) / n:.1f} %",
        f"{steps / n:.0f}",
        f"{100 * sum(e.ac_steps for e in episodes) / steps:.1f} %",
        f"{sum(e.takeovers for e in episodes) / n:.2f}",
    )


def episodes_of_all(count: int, jobs: int) -> int:
    """Print every driver on both arms and the targets; how many were missed."""
    rows = []
    with multiprocessing.Pool(jobs) as pool:
        driven = {
            (name, arm): campaign(pool, system, count)
            for name, systems in DRIVERS.items()
            for arm, system in zip(("alone", "with RTA"), systems, strict=True)
        }
        driven["SC", "alone"] = campaign(pool, "SafeOnly", count)
    rows = [row(name, arm, episodes) for (name, arm), episodes in driven.items()]
    heads = ("driver", "arm", "episodes", "falls", "flag", "steps", "AC share", "takeovers")
    print(table(heads, rows))
    best = driven["bang-bang", "with RTA"]
    falls = sum(e.fell for (_, arm), d in driven.items() if arm == "with RTA" for e in d)
    share = sum(e.ac_steps for e in best) / sum(e.steps for e in best)
    flags = sum(e.finished for e in best) / len(best)
    takeovers = sum(e.takeovers for e in best) / len(best)
    return judge(
        (
            ("falls with RTA, all drivers", str(falls), "0", falls == 0),
            ("flag, bang-bang with RTA", f"{100 * flags:.1f} %", "100 %", flags == 1.0),
            ("AC share, the same", f"{100 * share:.1f} %", ">= 87 %", share >= 0.87),
            ("takeovers an episode", f"{takeovers:.2f}", "<= 1.9", takeovers <= 1.9),
        )
    )


def judge(targets: tuple[tuple[str, str, str, bool], ...]) -> int:
    """Print figures beside their targets; how many were missed."""
    print()
    lines = [(a, b, c, "ok" if met else "MISSED") for a, b, c, met in targets]
    print(table(("figure", "measured", "target", ""), lines))
    return sum(not met for *_, met in targets)


# ---------------------------------------------------------------- conformance


class ExactMap:
    """The compiled plant of cliff.soter, its rounding switched off: where a step leads."""

    def __init__(self, program: soter.Program) -> None:
        flat = program.flat("SafeOnly", {"ROUNDING": 0.0})
        self._native = NativeProgram(flat)
        self._state = self._native.load().library.new_state(0)
        record = self._native.dtype
        views = self._state.view(record)
        self._car, self._topics = views["car"], views["topics"]
        self._native.load().library.run_until(self._state, 0)
        self._now_ns = 0

    def step(self, x: float, v: float, force: float) -> tuple[float, float]:
        """The next x and v."""
        self._car["x"], self._car["v"], self._topics["force"] = x, v, force
        self._now_ns += STEP_NS
        self._native.load().library.run_until(self._state, self._now_ns)
        return float(self._car["x"][0]), float(self._car["v"][0])


@dataclass
class Conformed:
    """The largest rounding that explains the steps seen, in units of what is declared."""

    steps: int = 0
    exceeded: int = 0
    worst_x: float = 0.0
    worst_v: float = 0.0
    clipped: int = 0
    """Steps that ended at the right border or at the greatest speed: there, less is asked."""


def explained(
    tally: Conformed,
    exact: tuple[float, float],
    before: tuple[float, float, float],
    after: NDArray[np.float32],
    limits: dict[str, float],
) -> None:
    """Whether some rounding within the bounds leads from `before` (x, v, force) to `after` (x, v).

    `exact`: what the map gives without rounding. A clipped value only has to be reached.
    """
    x, v = float(after[0]), float(after[1])
    off_v = v - exact[1]
    if abs(exact[1]) == limits["V_MAX"]:
        tally.clipped += 1
        if abs(v) != limits["V_MAX"]:  # the map clipped, Gymnasium did not: ask before clipping
            slope = limits["SLOPE"] * math.cos(3.0 * before[0])
            off_v = v - (before[1] + limits["POWER"] * before[2] - slope)
    off_x = x - (before[0] + v)
    if x == limits["X_MAX"]:
        tally.clipped += 1
        off_x = max(0.0, off_x)
    share_x, share_v = abs(off_x) / limits["x"], abs(off_v) / limits["v"]
    tally.steps += 1
    tally.exceeded += share_x > 1.0 or share_v > 1.0
    tally.worst_x, tally.worst_v = max(tally.worst_x, share_x), max(tally.worst_v, share_v)


def throttle(rng: np.random.Generator, kind: int, v: float) -> float:
    """Three ways to drive, so that every part of the track is seen, fast and slow."""
    if kind == 0:
        return float(rng.uniform(-1.0, 1.0))
    pumped = 1.0 if v >= 0.0 else -1.0
    return pumped if kind == 1 else float(np.clip(pumped * rng.uniform(-0.5, 1.5), -1.0, 1.0))


def conform(count: int) -> Conformed:
    """`count` steps of gymnasium's own environment against the map, from everywhere."""
    program = soter.load(PROGRAM)
    limits = {n: float(program.constant(n)) for n in ("V_MAX", "X_MAX", "POWER", "SLOPE")}
    limits["x"] = float(program.constant("ULP_X"))
    limits["v"] = 2.0 * float(program.constant("ULP_V"))
    exact, tally, rng = ExactMap(program), Conformed(), np.random.default_rng(7)
    env: Any = gymnasium.make("MountainCarContinuous-v0").unwrapped
    env.min_position = -1.4  # the wall is what the cliff replaces
    env.reset(seed=0)
    left, kind = 0, 0
    for _ in range(count):
        if left == 0 or env.state[0] <= -1.2:
            start = [rng.uniform(-1.2, 0.6), rng.uniform(-0.07, 0.07)]
            env.state = np.array(start, dtype=np.float32)
            left, kind = 50, int(rng.integers(3))
        left -= 1
        before = env.state.copy()
        force = np.float32(throttle(rng, kind, float(before[1])))
        after, *_ = env.step(np.array([force]))
        at = (float(before[0]), float(before[1]), float(force))
        explained(tally, exact.step(*at), at, after, limits)
    return tally


def conformance(count: int) -> int:
    """Print how far Gymnasium's steps are from the map's; how many targets were missed."""
    tally = conform(count)
    print(f"{tally.steps:,} steps, {tally.clipped:,} of them at the border or the greatest speed")
    print(f"rounding needed: {tally.worst_x:.3f} of what is declared for x, ", end="")
    print(f"{tally.worst_v:.3f} for v")
    return judge((("steps outside", str(tally.exceeded), "0", tally.exceeded == 0),))


def main() -> int:
    """Read the command line, drive, print; exit code 1 when a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--conformance", action="store_true", help="Gymnasium against the map")
    parser.add_argument("--episodes", type=int, default=10_000, help="of each driver (10,000)")
    parser.add_argument("--steps", type=int, default=1_000_000, help="of --conformance (10^6)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (all cores)")
    chosen = parser.parse_args()
    if chosen.conformance:
        return 1 if conformance(chosen.steps) else 0
    return 1 if episodes_of_all(chosen.episodes, chosen.jobs) else 0


if __name__ == "__main__":
    sys.exit(main())
