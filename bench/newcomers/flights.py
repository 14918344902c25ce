"""Flights of a robot against what may happen to it, in many starts at a time.

Purpose: `Robot`, its equations as numpy functions and functions of C (`equations.py` makes one),
and `leaves`: from how many states of a lattice some flight leaves `safe`; in C one after another,
as long as none has left. `left_by` flies the same in numpy, and a test compares both. A flight
begins with SC, or with AC at an end of its commands for the time that no DM can avoid (what it
reads is `max_age` old, and it acts once a period), then SC. Disturbances and errors stay at an end
or jump between the ends, readings are fresh or old.
Non-goals: Soter: nothing of it is imported, so that it is an oracle of its own.
"""

from __future__ import annotations

import ctypes
import itertools
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
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
    """`rates`, `sc` and `safe` once more, as functions of C."""


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


LEFT_BY = """
#include <math.h>
#include <stdlib.h>
#include <string.h>
#define abs fabs
#define max fmax
#define min fmin
static double clamp(double x, double low, double high) { return fmin(fmax(x, low), high); }
static double saturate(double x, double most) { return clamp(x, -most, most); }
static double wrap_angle(double angle) {
  double turn = 2 * M_PI, rest = fmod(angle + M_PI, turn);
  return (rest < 0 ? rest + turn : rest) - M_PI;
}
%s
void left_by(long count, long steps, long pieces, double dt, long old, long dead, long own,
             const double *ac, const double *start, const double *push, const double *error,
             unsigned char *left) {
  double past[old + 1][states_], commands[dead + 1][commands_];
  for (long n = 0; n < count; ++n)
    for (long m = 0; m < modes_ && !left[n]; ++m) {
      double x[states_], seen[states_], d[pushes_ + 1], r[states_], half[states_];
      memcpy(x, start + n * states_, sizeof x);
      for (long k = 0; k < steps && !left[n]; ++k) {
        memcpy(past[k %% (old + 1)], x, sizeof x);
        for (long i = 0; i < states_; ++i)
          seen[i] = past[(k > old ? k - old : 0) %% (old + 1)][i]
                    + error[(k * states_ + i) * modes_ + m];
        if (ac && k < own)
          memcpy(commands[k %% (dead + 1)], ac, sizeof commands[0]);
        else
          sc(seen, commands[k %% (dead + 1)]);
        const double *u = commands[(k > dead ? k - dead : 0) %% (dead + 1)];
        for (long i = 0; i < pushes_; ++i) d[i] = push[(k * pushes_ + i) * modes_ + m];
        if (maps_) {
          rates(x, u, d, r);
          memcpy(x, r, sizeof x);
        } else
          for (long piece = 0; piece < pieces; ++piece) {
            rates(x, u, d, r);
            for (long i = 0; i < states_; ++i) half[i] = x[i] + dt / 2 * r[i];
            rates(half, u, d, r);
            for (long i = 0; i < states_; ++i) x[i] += dt * r[i];
          }
        left[n] = !safe(x);
      }
    }
}
"""


def library(robot: Robot, folder: str) -> Callable[..., None]:
    """`left_by` of a robot, compiled."""
    sizes = {"states_": len(robot.low), "commands_": len(robot.ac[0])}
    sizes |= {"pushes_": len(robot.disturbed), "modes_": len(MODES), "maps_": int(robot.maps)}
    defined = "".join(f"enum {{ {name} = {value} }};\n" for name, value in sizes.items())
    source, binary = Path(folder) / "flights.c", Path(folder) / "flights.so"
    source.write_text(LEFT_BY % (defined + robot.in_c))
    command = ["cc", "-O2", "-shared", "-fPIC", "-o", str(binary), str(source), "-lm"]
    subprocess.run(command, check=True)
    left_by: Callable[..., None] = ctypes.CDLL(str(binary)).left_by
    return left_by


def jumping(robot: Robot) -> tuple[Array, Array]:
    """Disturbances and errors of every step in every mode, as `flights.left_by` draws them."""
    random = np.random.default_rng(7)
    middle, half = (
        np.array([(b + s * a) / 2 for a, b in robot.disturbed])[:, None] for s in (1, -1)
    )
    errors = np.array(robot.errors)[:, None]
    d_signs, e_signs = (np.ones((len(of), len(MODES))) for of in (half, errors))
    pushes, seen = [], []
    for _ in range(round(robot.until_s / robot.step_s)):
        d_signs = signs(MODES[:, 0], d_signs, random)
        e_signs = signs(MODES[:, 1], e_signs, random)
        pushes.append(middle + half * d_signs)
        seen.append(errors * e_signs)
    return np.array(pushes), np.array(seen)


def left_in_c(
    robot: Robot,
    start: Array,
    late: bool,
    ac: int,
    left_by: Callable[..., None],
    drawn: tuple[Array, Array],
) -> Booleans:
    """`flights.left_by`."""
    steps = round(robot.until_s / robot.step_s)
    ages = robot.age_s, robot.late_s
    old, dead = (round(age / robot.step_s) if late else 0 for age in ages)
    own = max(round((sum(ages) + robot.period_s) / robot.step_s), 1)
    starts = np.ascontiguousarray(start.T)
    left = np.zeros(len(starts), dtype=bool)
    held = np.array(robot.ac[ac], dtype=float)
    arrays = [ctypes.c_void_p(each.ctypes.data) for each in (held, starts, *drawn, left)]
    arrays[0] = arrays[0] if ac >= 0 else ctypes.c_void_p(None)
    counts = [ctypes.c_long(of) for of in (len(starts), steps, robot.pieces)]
    dt = ctypes.c_double(robot.step_s / robot.pieces)
    left_by(*counts, dt, *(ctypes.c_long(of) for of in (old, dead, own)), *arrays)
    return left


def leaves(robot: Robot, own_sets: bool) -> tuple[int, int]:
    """From how many starts some flight leaves `safe`, of how many; `own_sets`: AC begins each."""
    ends = zip(robot.low, robot.high, strict=True)
    start = lattice(robot, {1: 41, 2: 15, 3: 7, 4: 5}[sum(a < b for a, b in ends)])
    left = np.zeros(start.shape[1], dtype=bool)
    drawn = jumping(robot)
    with tempfile.TemporaryDirectory() as folder:
        left_by = library(robot, folder)
        for late, ac in itertools.product((True, False), range(-1 + own_sets, len(robot.ac))):
            rest = ~left
            left[rest] = left_in_c(robot, start[:, rest], late, ac, left_by, drawn)
    return int(left.sum()), left.size
