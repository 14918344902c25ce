"""Flights of a robot against what may happen to it, in many starts at a time.

Purpose: `Robot`, its equations as numpy functions (`equations.py` makes one), and `leaves`: from
how many states of a lattice some flight leaves `safe`. A flight begins with SC, or with AC at an
end of its commands for the time that no DM can avoid (what it reads is `max_age` old, and it acts
once a period), then SC. Disturbances and errors stay at an end or jump between the ends, readings
are fresh or old.
Non-goals: Soter: nothing of it is imported, so that it is an oracle of its own.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

Array = np.ndarray[Any, np.dtype[np.float64]]
Booleans = np.ndarray[Any, np.dtype[np.bool_]]
DROPPED_EVERY = 20
"""Steps of SC."""
MODES: Array = np.array(list(itertools.product((0.0, 1.0, 2.0), repeat=2)))
"""Of disturbances and of errors, for `signs`."""


@dataclass(frozen=True)
class Robot:
    """A plant, its SC and the bounds of both; states, commands, disturbances are rows of arrays."""

    low: tuple[float, ...]
    """Of each state, where the lattice of starts begins; in the units of the program."""
    high: tuple[float, ...]
    safe: Callable[[Array], Booleans]
    """Of states, shape (states, n): whether each is safe."""
    rates: Callable[[Array, Array, Array], Array]
    """Of states, commands and disturbances: the derivatives, or the next states if `maps`."""
    sc: Callable[[Array], Array]
    """Of what is measured: the commands, shape (commands, n)."""
    ac: tuple[tuple[float, ...], ...]
    """Commands that AC may hold."""
    disturbed: tuple[tuple[float, float], ...]
    errors: tuple[float, ...]
    age_s: float
    period_s: float
    """Of the DM."""
    step_s: float
    """Of SC, and of the simulation's hold."""
    until_s: float
    pieces: int
    """Steps of integration in a step of SC."""
    late_s: float
    """How late a command acts, at most."""
    maps: bool
    in_c: str
    """`rates`, `sc` and `safe` once more, as functions of C (`flights_in_c.py`)."""


def lattice(robot: Robot, points: int) -> Array:
    """States at even distances, the ends among them, those in `safe`."""
    ends = zip(robot.low, robot.high, strict=True)
    axes = [np.linspace(a, b, points if a < b else 1) for a, b in ends]
    states = np.array([c.ravel() for c in np.meshgrid(*axes, indexing="ij")])
    return states[:, robot.safe(states)]


def signs(mode: Array, held: Array, random: np.random.Generator) -> Array:
    """-1 or 1 of each bounded thing, in each mode: all low, all high, or jumping (`held`)."""
    jumps = random.random(held.shape) < 0.05
    return np.where(mode < 2, 2.0 * mode - 1.0, np.where(jumps, -held, held))


def moved(robot: Robot, x: Array, u: Array, d: Array) -> Array:
    """The states a step of SC later, by the midpoint rule."""
    if robot.maps:
        return robot.rates(x, u, d)
    dt = robot.step_s / robot.pieces
    for _ in range(robot.pieces):
        x = x + dt * robot.rates(x + dt / 2 * robot.rates(x, u, d), u, d)
    return x


def left_by(robot: Robot, start: Array, late: bool, ac: int) -> Booleans:
    """Which of the starts leave `safe` in some flight; `ac` < 0: SC at once.

    `late`: what is read is as old, and commands act as late, as they may. In one mode all flights
    jump at the same times. Flights of a start that has left are dropped now and then.
    """
    random = np.random.default_rng(7)
    d_mode, e_mode = MODES.T
    mode, flight = (at.ravel() for at in np.indices((len(d_mode), start.shape[1])))
    middle, half = (
        np.array([(b + s * a) / 2 for a, b in robot.disturbed])[:, None] for s in (1, -1)
    )
    errors = np.array(robot.errors)[:, None]
    d_signs, e_signs = (np.ones((len(of), len(d_mode))) for of in (half, errors))
    old = round(robot.age_s / robot.step_s) if late else 0
    dead = round(robot.late_s / robot.step_s) if late else 0
    own = max(round((robot.age_s + robot.late_s + robot.period_s) / robot.step_s), 1)
    x = start[:, flight]
    past, commands = [x], list[Array]()
    left = np.zeros(start.shape[1], dtype=bool)
    with np.errstate(all="ignore"):
        for k in range(round(robot.until_s / robot.step_s)):
            d_signs = signs(d_mode, d_signs, random)
            e_signs = signs(e_mode, e_signs, random)
            seen = past[max(len(past) - 1 - old, 0)] + (errors * e_signs)[:, mode]
            held = np.array(robot.ac[ac])[:, None].repeat(len(mode), axis=1)
            commands.append(held if ac >= 0 and k < own else robot.sc(seen))
            u = commands[max(len(commands) - 1 - dead, 0)]
            x = moved(robot, x, u, (middle + half * d_signs)[:, mode])
            past.append(x)
            del past[: max(len(past) - 1 - old, 0)], commands[: max(len(commands) - 1 - dead, 0)]
            left[flight[~robot.safe(x)]] = True
            if k % DROPPED_EVERY == 0:
                if left.all():
                    break
                on = ~left[flight]
                mode, flight, x = mode[on], flight[on], x[:, on]
                past, commands = ([each[:, on] for each in one] for one in (past, commands))
    return left
