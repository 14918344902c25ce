"""The flights of `flights.py` in C, one after another, as long as none has left `safe`.

Purpose: `leaves`: from how many states of a lattice some flight leaves `safe`. The equations are
those of the program's text (`equations.py`), flown as `flights.left_by` flies them; a test compares
both.
Non-goals: Soter: nothing of it is imported or linked.
"""

from __future__ import annotations

import ctypes
import itertools
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from bench.newcomers.flights import MODES, Robot, lattice, signs

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.newcomers.flights import Array, Booleans

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
