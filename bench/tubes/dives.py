"""Dives of JSBSim's F-16 with and without the module of examples/rest/dive.soter.

    .venv/bin/python bench/tubes/dives.py [--dives 200]

Purpose: the same pilots fly the aircraft of `jsbsim_f16.py` twice, once as they like and once with
the module before them, whose decisions are those of the compiled check: how many hit the ground,
how many were saved, how often the module took over where nobody would have hit; and in how many the
monitor said that the aircraft did what the program's plant cannot, told apart from saves.
Non-goals: the model (`identify_f16.py`); its bounds are of other flights than these.
"""

from __future__ import annotations

import argparse
import random
import sys
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bench.tubes.jsbsim_f16 import DIVE_S, Jet, Pilot  # noqa: E402

from soter.gym import Protected  # noqa: E402
from soter.gym.safety_warnings import SafetyWarning  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable

PROGRAM = ROOT / "examples" / "rest" / "dive.soter"
STEP_S, PERIODS = 0.1, 10
"""Of a pilot, and how many of the plant's periods that is."""
EXACT = 1e-8
"""How far references may be off: two Runge-Kutta steps of the autopilot to one of the plant."""


@dataclass(frozen=True)
class Dive:
    """What came of one; `lowest` in m, steps in those of the pilot."""

    hit: bool
    lowest: float
    steps: int
    in_ac: int = 0
    takeovers: int = 0
    alarms: int = 0


def pilot_of(seed: int) -> Pilot:
    """The same with and without the module."""
    return Pilot(random.Random(seed), Pilot.WAYS[seed % len(Pilot.WAYS)])  # noqa: S311 - no secret


def dived(seed: int, seen: Any, act: Callable[[Any], tuple[Any, bool, dict[str, Any]]]) -> Dive:  # noqa: ANN401
    """A dive; `act` gives what is seen next, whether it is over, and what the module says."""
    pilot, lowest, told = pilot_of(seed), float(seen[0]), Counter[str]()
    steps, over, mode = 0, False, "SC"
    while not over and steps < DIVE_S / STEP_S:
        seen, over, info = act(pilot.asks(seen))
        lowest = min(lowest, float(seen[0]))
        steps += 1
        told["in_ac"] += info.get("taken_by") == "AC"
        told["takeovers"] += mode == "AC" and info.get("mode") == "SC"
        told["alarms"] += bool(info.get("off_model"))
        mode = info.get("mode", mode)
    return Dive(over, lowest, steps, told["in_ac"], told["takeovers"], told["alarms"])


def alone(jet: Jet, seed: int) -> Dive:
    """As the pilot likes."""

    def act(command: tuple[float, float]) -> tuple[Any, bool, dict[str, Any]]:
        over = False
        for _ in range(PERIODS):
            if not over:
                seen, _, over, _, info = jet.step(command)
        return seen, over, info

    return dived(seed, jet.reset(seed=seed)[0], act)


def protected(env: Protected, seed: int) -> Dive:
    """With the module."""

    def act(command: tuple[float, float]) -> tuple[Any, bool, dict[str, Any]]:
        seen, _, over, _, info = env.step(command)
        return seen, over, info

    return dived(seed, env.reset(seed=seed)[0], act)


def behind_module(program: Path = PROGRAM) -> Protected:
    """The aircraft, whose estimates have the program's errors."""
    exact = dict.fromkeys(("path", "led", "follows", "bank"), EXACT)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SafetyWarning)
        return Protected(program, Jet(), measured=True, tolerance=exact)


def told(dives: list[tuple[int, Dive, Dive]]) -> list[str]:
    """A line a way of flying, and one of all."""
    lines = [
        "way    dives  hit alone  hit with it  saved  for nothing  AC      lowest  alarms",
        "-----  -----  ---------  -----------  -----  -----------  ------  ------  ------",
    ]
    for way in (*Pilot.WAYS, "all"):
        of = [(a, b) for s, a, b in dives if way in (Pilot.WAYS[s % len(Pilot.WAYS)], "all")]
        if not of:
            continue
        hit, still = (sum(d[k].hit for d in of) for k in range(2))
        saved = sum(a.hit and not b.hit for a, b in of)
        nothing = sum(not a.hit and b.takeovers > 0 for a, b in of)
        share = sum(b.in_ac for _, b in of) / sum(b.steps for _, b in of)
        lowest = min(b.lowest for _, b in of)
        alarms = sum(b.alarms > 0 for _, b in of)
        lines.append(f"{way:<5}  {len(of):>5}  {hit:>9}  {still:>11}  {saved:>5}  {nothing:>11}  "
                     f"{share:>6.1%}  {lowest:>4.0f} m  {alarms:>6}")  # fmt: skip
    return lines


def main(argv: list[str]) -> int:
    """0; 3 where a dive with the module hit the ground."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dives", type=int, default=200)
    options = parser.parse_args(argv)
    jet, env, dives = Jet(), behind_module(), []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SafetyWarning)
        for seed in range(1, 1 + options.dives):
            dives.append((seed, alone(jet, seed), protected(env, seed)))
            if len(dives) % 20 == 0:
                print(f"{len(dives)} dives", file=sys.stderr, flush=True)
    print("\n".join(told(dives)))
    steps = sum(b.steps for _, _, b in dives)
    off = [(s, b.alarms) for s, _, b in dives if b.alarms]
    print(f"\n{sum(n for _, n in off):,} of {steps:,} steps of 100 ms left the model's bounds"
          + (f", in dives {', '.join(str(s) for s, _ in off[:10])}" if off else ""))  # fmt: skip
    both = sum(a.hit and b.alarms > 0 for _, a, b in dives)
    print(f"alarms in dives that were saved, or hit: {both}; in others: {len(off) - both}")
    return 3 if any(b.hit for _, _, b in dives) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
