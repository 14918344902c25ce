"""How much of a box around rest noise takes up under SC: an estimate, for people.

Purpose: `noise_estimate` linearizes rates and SC in the middle of a box, and follows what errors,
disturbances, ages of reads and late commands do there: columns of x(t) = sum g_k e_k, |e_k| <= 1,
of which none is shortened. Each age, and each lateness, multiplies what is known of the rates, or
of how far a command is from the one before, by a number of its own in [-1, 1].
Non-goals: showing anything: the estimate has doubles, no ends of commands, and nothing of what
commands did before SC's first one. A tube takes up more (`rest.soter`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from soter.verify.tubes.expression_graph import half_width, middle
from soter.verify.tubes.leading_back import has_known_operations, values_of_nodes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from soter.verify.problem.problem import Interval
    from soter.verify.tubes.expression_graph import Node
    from soter.verify.tubes.tube_check import TubeCheck

    Matrix = NDArray[np.float64]

HOLDS, PIECES, FINE = 300, 4, 1024
"""SC's commands that are followed, at most; parts of a hold, each with disturbances of its own; and
steps in which a part is solved."""
SMALL = 1e-4
"""The step of a difference, as a share of the side of the box."""
FAR = 50.0
"""A share beyond which SC does not hold its plant at all."""


class NoiseEstimate(NamedTuple):
    """Shares of the sides of a box that noise takes up: `share` of `worst`, the state with most.

    `on_time`: the largest share if no command were late; `young`: if no read were old. `command`:
    what SC commands at a corner of the box, as a share of the largest command.
    """

    worst: int
    share: float
    on_time: float
    young: float
    command: float


def noise_estimate(check: TubeCheck, box: Mapping[int, Interval]) -> NoiseEstimate | None:
    """The estimate for a box; None where rates have no derivative in its middle, or SC no hold."""
    if not has_known_operations(check):
        return None
    half = np.array([half_width(box[s]) if s in box else 0.0 for s in check.states])
    late, delay = (x * 1e-9 for x in (check.times.jitter, check.times.delay))
    with np.errstate(all="ignore"):
        loop = _linear_loop(check, box, half)
        times = (delay, late), (delay, 0.0), (0.0, late)
        shares = [_noise_at_rest(check, loop, *t) / np.where(half, half, np.inf) for t in times]
        most = [half_width(c) for c in check.problem.controls]
        command = np.abs(loop[3]) @ half / most
    if not np.isfinite([*np.ravel(shares), *command]).all() or np.max(shares) > FAR:
        return None
    worst = check.states[int(shares[0].argmax())]
    return NoiseEstimate(worst, *(float(x.max(initial=0.0)) for x in (*shares, command)))


def _linear_loop(check: TubeCheck, box: Mapping[int, Interval], half: Matrix) -> list[Matrix]:
    """The derivatives of rates by states, commands and disturbances, and of SC by states."""
    at = {("x", s): middle(box[s]) if s in box else 0.0 for s in check.states}
    reads = {("y", s): x for (_, s), x in at.items()}
    reads |= {("l", k): middle(r) for k, r in enumerate(check.kept)}
    commands, law = _tangent(check.law, reads, "y", half)
    winds = check.problem.disturbances
    at |= {("u", k): float(u) for k, u in enumerate(commands)}
    at |= {("w", k): middle(d) for k, d in enumerate(winds)}
    rates = [check.rates[s] for s in check.states]
    a, b, e = (_tangent(rates, at, kind, half)[1] for kind in "xuw")
    return [a, b, e * [half_width(d) for d in winds], law]


def _tangent(
    roots: Sequence[Node], at: Mapping[tuple[str, int], float], kind: str, half: Matrix
) -> tuple[Matrix, Matrix]:
    """Values of expressions, and their derivatives by inputs of a kind; steps as sides are wide."""
    keys = [key for key in at if key[0] == kind]
    sides = np.where(half, half, 1.0) if kind in "xy" else np.ones(len(keys))
    steps = np.hstack([np.zeros((len(keys), 1)), np.diag(sides), -np.diag(sides)]) * SMALL
    inputs = {key: np.full(steps.shape[1], x) for key, x in at.items()}
    inputs |= {key: inputs[key] + of for key, of in zip(keys, steps, strict=True)}
    values = np.array(values_of_nodes(roots, inputs, steps.shape[1]))
    more, less = np.split(values[:, 1:], 2, axis=1)
    return values[:, 0], (more - less) / (2.0 * SMALL * sides)


def _noise_at_rest(check: TubeCheck, loop: list[Matrix], delay: float, late: float) -> Matrix:
    """How far from the middle each state may be after many commands, if it began there."""
    a, b, wind, law = loop
    n, m = b.shape
    whole = np.zeros((n + m + wind.shape[1],) * 2)
    whole[:n] = np.hstack(loop[:3])
    step = np.eye(len(whole)) + whole * (check.times.period * 1e-9 / PIECES / FINE)
    by_state, by_command, by_wind, _ = np.split(
        np.linalg.matrix_power(step, FINE)[:n], [n, n + m, len(whole)], axis=1
    )
    x, u = np.zeros((n, 0)), np.zeros((m, 0))
    for _ in range(min(check.times.switches, HOLDS)):
        rates = a @ x + b @ u
        read = x - delay / 2 * rates + delay**2 / 8 * (a @ rates)
        ages = np.diag(delay / 2 * np.abs(law @ rates).sum(axis=1))
        answer = np.hstack([law @ read, ages, law * list(check.errors().values())])
        apart = np.abs(answer - np.pad(u, ((0, 0), (0, m + n)))).sum(axis=1)
        x = np.hstack([np.pad(x, ((0, 0), (0, m + n))), b @ np.diag(late * apart)])
        u = np.pad(answer, ((0, 0), (0, m)))
        for _ in range(PIECES):
            x = np.hstack([by_state @ x + by_command @ u, by_wind])
            u = np.pad(u, ((0, 0), (0, wind.shape[1])))
    sizes: Matrix = np.abs(x).sum(axis=1)
    return sizes
