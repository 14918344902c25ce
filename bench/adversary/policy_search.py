"""Looking for a run that leaves C: policies of the adversary, and better ones from good ones.

Purpose: `attack(machine, module, steps, seed)`: runs from declared starts and from the border of
`not ttf`, with random policies and changes of those that came closest; the closest run, and the
first that leaves C, to be had again from its numbers.
Non-goals: proofs.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from bench.adversary.closed_loop import POLICY

if TYPE_CHECKING:
    import numpy.typing as npt
    from bench.adversary.closed_loop import Machine, Outcome
    from bench.adversary.random_modules import Module

    Array = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int32]
    Rng = np.random.Generator

ELITE = 10
LATENESS = (0, 1, 1, 2, 3, 4, 5, 5, 5, 6, 7)
CHOICES: dict[str, tuple[int, ...]] = {
    "gkind": (0, 0, 0, 1, 1, 2, 3),
    "gindex": tuple(range(12)),
    "wind": (0, 0, 0, 0, 1, 2, 3),
    "ac": (0, 0, 0, 1, 2, 3, 4),
    "err_ac": (0, 1, 1, 2, 3, 4, 5, 6),
    "err_sc": (0, 1, 2, 3, 3, 3, 4, 5, 6),
    "seen": (0, 0, 1, 2),
    "drop": (0, 1, 1, 2, 5, 6),
    "near": tuple(range(4, 17)),
    "side": (0, 1),
    "tries": (0, 1, 1, 1, 2, 2, 3, 3, 4, 5, 5, 5, 6),
    "oldest": (0, 1, 2),
    **{
        name: LATENESS for name in POLICY if name.startswith(("late", "response")) or name == "acts"
    },
}


@dataclass(frozen=True, eq=False)
class Run:
    """All that is needed to have a run again, as its `repr` is."""

    policy: Ints
    seed: int
    ticks: int
    x0: tuple[float, ...]
    t0: int = 0
    shown: tuple[float, ...] | None = None
    """Where AC starts in control: what the sensor publishes at `t0`."""
    held: tuple[float, ...] | None = None
    """And the command that acts then, of a module with a shield."""

    def again(self, machine: Machine, *, log: bool = False) -> Outcome:
        """Run it."""
        shown = None if self.shown is None else np.array(self.shown)
        held = None if self.held is None else np.array(self.held)
        told = (self.policy, self.seed, self.ticks, np.array(self.x0))
        return machine.run(*told, t0=self.t0, shown=shown, held=held, log=log)


@dataclass
class Attack:
    """What was tried on one module."""

    runs: int = 0
    steps: int = 0
    switches: int = 0
    closest: float = 0.0
    """The largest |x| relative to the border of C; above 1 it is outside."""
    closest_sc: float = 0.0
    """The same while SC was in control."""
    violations: int = 0
    """Runs that left C, or in which a command acted that was in no V of a shield."""
    found: Run | None = None
    declared: bool = True
    """Whether `found` starts where the program does, SC in control."""
    outcome: Outcome | None = None
    best: list[tuple[float, Run]] = field(default_factory=list)


def attack(
    machine: Machine,
    module: Module,
    steps: int,
    seed: int,
    *,
    runs: int = 0,
    stop: bool = True,
    border: bool = True,
) -> Attack:
    """At least so many steps and runs, unless a violation is found first (`stop`).

    `border`: also from where AC is in control at the border of `not ttf`, which is claimed as well.
    """
    rng = np.random.default_rng([77, seed])
    told = Attack()
    while told.steps < steps or told.runs < runs:
        run = _next(machine, module, told, rng, border=border)
        seen = run.again(machine)
        told.runs += 1
        told.steps += seen.steps
        told.switches += seen.switches
        told.closest = max(told.closest, seen.worst)
        told.closest_sc = max(told.closest_sc, seen.worst_sc)
        told.best.append((seen.worst_sc, run))
        told.best = sorted(told.best, key=lambda b: -b[0])[:ELITE]
        if seen.left or seen.forgot:
            told.violations += 1
            better = told.found is None or (run.shown is None and not told.declared)
            if better:
                told.found, told.outcome, told.declared = run, seen, run.shown is None
            if stop:
                break
    return told


def _next(machine: Machine, module: Module, told: Attack, rng: Rng, *, border: bool) -> Run:
    if told.best and rng.random() < 0.5:
        _, parent = told.best[int(rng.integers(0, len(told.best)))]
        policy = _changed(parent.policy, module, rng)
        if rng.random() < 0.6:  # the same start
            return replace(parent, policy=policy, seed=int(rng.integers(2**62)))
    else:
        policy = _policy(module, rng)
    return _started(machine, module, policy, rng, border=border)


def _policy(module: Module, rng: Rng) -> Ints:
    return np.array([_one(name, module, rng) for name in POLICY], dtype=np.int32)


def _one(name: str, module: Module, rng: Rng) -> int:
    if name in CHOICES:
        options = CHOICES[name]
        return options[int(rng.integers(0, len(options)))]
    if name == "pattern":
        return int(rng.integers(2, 12))
    # how long, in ticks, until the direction flips or is chosen otherwise; mostly never
    if rng.random() < 0.6:
        return 0
    long = 40 * module.times.dm if name == "gswitch" else 20 * module.times.sc
    return int(rng.integers(2, max(3, long)))


def _changed(policy: Ints, module: Module, rng: Rng) -> Ints:
    new_policy: Ints = policy.copy()
    for _ in range(int(rng.integers(1, 4))):
        k = int(rng.integers(0, len(POLICY)))
        new_policy[k] = _one(POLICY[k], module, rng)
    return new_policy


def _started(machine: Machine, module: Module, policy: Ints, rng: Rng, *, border: bool) -> Run:
    seed = int(rng.integers(2**62))
    seconds = float(rng.choice([1.0, 4.0, 12.0, 30.0]))
    ticks = int(seconds / (module.tick_us * 1e-6)) if not module.is_map else int(40 * seconds)
    ticks = max(ticks, 8 * module.times.dm)
    if border and not module.nodes and rng.random() < 0.5:
        there = _border(machine, module, rng)
        if there is not None:
            shown, x0, held = there
            t0 = int(rng.integers(0, 1000)) * module.times.sensor
            return Run(policy, seed, ticks, x0, t0, shown, held)
    half = np.array(module.starts)
    side = rng.choice([-1.0, 1.0], size=module.n)
    share = np.ones(module.n) if rng.random() < 0.5 else rng.random(module.n)
    return Run(policy, seed, ticks, tuple(float(v) for v in half * side * share))


def _border(
    machine: Machine, module: Module, rng: Rng
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...] | None] | None:
    """An estimate just inside `not ttf`, and a state in C that it may be the estimate of.

    And the command that is held, below a shield: one that is permitted there.
    """
    held = None
    if module.shield:
        held = rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], size=module.m) * np.array(module.control)

    def inside(y: Array) -> bool:
        return machine.level(y) > 0 if held is None else machine.permitted(y, held)

    way = rng.normal(size=module.n) * np.array(module.box)
    way /= np.max(np.abs(way) / np.array(module.box))
    low, high = 0.0, 1.0
    if not inside(low * way):
        return None
    for _ in range(30):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if inside(mid * way) else (low, mid)
    y = low * way
    x = y + rng.choice([-1.0, 0.0, 1.0], size=module.n) * np.array(module.error)
    if np.any(np.abs(x) >= np.array(module.box)):
        return None
    command = None if held is None else tuple(float(v) for v in held)
    return tuple(float(v) for v in y), tuple(float(v) for v in x), command
