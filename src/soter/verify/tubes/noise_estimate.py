"""A linear estimate of the boxes around rest that SC leads back into, under noise.

Purpose: `noise_estimate` linearizes rates and SC in the middle of a box, and follows what errors,
disturbances, ages of reads and late commands do there: columns of x(t) = sum g_k e_k, |e_k| <= 1,
of which none is shortened. Each age, and each lateness, multiplies what is known of the rates, or
of how far a command is from the one before, by a number of its own in [-1, 1]. `boxes_back_soon`
solves for boxes into which SC leads back after few commands: a tube may show one of them.
Non-goals: proofs: the estimate uses rounded doubles, and leaves out the ends of commands. A tube
takes up more (`rest.soter`).
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import half_width, middle
from soter.verify.tubes.simulated_runs import has_known_operations, values_of_nodes

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.verify.tubes.expression_graph import Node
    from soter.verify.tubes.tube_check import TubeCheck

    Box = dict[int, Interval]
    Matrix = NDArray[np.float64]

HOLDS, PIECES, FINE = 300, 4, 1024
"""The most commands of SC that are followed; the parts of a command's time, each with other
disturbances; the steps in which a part is solved."""
SMALL = 1e-4
"""The step of a difference, as a share of the side of the box."""
FAR = 50.0
"""Beyond this share SC is taken not to hold its plant at all."""
SOON = 2, 3, 4, 6, 8, 12, 16, 24, 32
"""Numbers of commands after which a box may be back; tubes have not followed SC for many more."""
ROOM, SOLVED = 1.3, 0.01
"""The factor between a box and what has to fit into it; the share by which a solved box is off."""


class NoiseEstimate(NamedTuple):
    """The shares of a box's sides that noise takes up; `share` is the largest, of state `worst`.

    `on_time` is the largest share if no command were late, `young` if no read were old. `command`
    is SC's command at a corner of the box, as a share of the largest command. `back` is the number
    of commands of SC after which all of the box is back inside, 0: none of those followed.
    """

    worst: int
    share: float
    on_time: float
    young: float
    command: float
    back: int


def noise_estimate(check: TubeCheck, box: Mapping[int, Interval]) -> NoiseEstimate | None:
    """The estimate for a box; None: no derivative in its middle, or SC does not hold the plant."""
    if not has_known_operations(check):
        return None
    half = np.array([half_width(box[s]) if s in box else 0.0 for s in check.states])
    delay, late = _delays_of(check)
    with np.errstate(all="ignore"):
        loop = _linear_loop(check, box, half)
        delays = (delay, late), (delay, 0.0), (0.0, late)
        sides = np.where(half, half, np.inf)
        shares = [_noise_at_rest(check, loop, d) / sides for d in delays]
        most = _largest_commands(check)
        command = np.abs(loop[3]) @ half / most
        sizes = _sizes_after_commands(check, loop, delays[0], half, most)
        back = next((k for k, (x, _) in enumerate(sizes, 1) if (x <= sides).all()), 0)
    if not np.isfinite([*np.ravel(shares), *command]).all() or np.max(shares) > FAR:
        return None
    worst = check.states[int(shares[0].argmax())]
    share, on_time, young, at_corner = (float(x.max(initial=0.0)) for x in (*shares, command))
    return NoiseEstimate(worst, share, on_time, young, at_corner, back)


def boxes_back_soon(check: TubeCheck, box: Mapping[int, Interval]) -> Iterator[Box]:
    """Boxes around the middle of `box` that are back after few commands of SC, larger ones first.

    Each is `ROOM` times as wide as the range that then remains of it, with noise. No box results if
    `box` has no range for some state, or if SC would be at the ends of its commands.
    """
    if {*box} != {*check.states} or not has_known_operations(check):
        return
    half, most = np.array([half_width(box[s]) for s in check.states]), _largest_commands(check)
    with np.errstate(all="ignore"):
        loop = _linear_loop(check, box, half)
        noise = _noise_at_rest(check, loop, _delays_of(check))
        for count in SOON:
            sides, before = noise, np.zeros_like(noise)
            while np.isfinite(sides).all() and (sides <= FAR * noise).all():
                if np.allclose(sides, before, rtol=SOLVED, atol=0.0):
                    yield {
                        s: Interval(middle(box[s]) - r, middle(box[s]) + r)
                        for s, r in zip(check.states, map(float, sides), strict=True)
                    }
                    break
                sizes = _sizes_after_commands(check, loop, _delays_of(check), sides, most)
                states, commands = zip(*islice(sizes, count), strict=True)
                if len(states) < count or not (np.max(commands, axis=0) <= most).all():
                    break
                before, sides = sides, ROOM * states[-1]


def moves_quickly(check: TubeCheck) -> bool:
    """Whether states act on each other so quickly that one period of SC is long for them.

    This is so if 1 / period is below the largest eigenvalue of the absolute derivatives of rates at
    the start. There a step of second order over the whole period makes a tube much too wide.
    """
    if not has_known_operations(check):
        return False
    start = {s: check.problem.initial[s] for s in check.states}
    with np.errstate(all="ignore"):
        by_state = np.abs(_linear_loop(check, start, np.ones(len(start)))[0])
    if not np.isfinite(by_state).all():
        return False
    quickest = np.abs(np.linalg.eigvals(by_state)).max(initial=0.0)
    return bool(quickest * check.times.period * 1e-9 > 1.0)


def _delays_of(check: TubeCheck) -> tuple[float, float]:
    """The largest age of a read and the largest lateness of a command, in s."""
    return check.times.delay * 1e-9, check.times.jitter * 1e-9


def _largest_commands(check: TubeCheck) -> Matrix:
    """For each command half the width of its set, the largest distance from the middle."""
    return np.array([half_width(c) for c in check.problem.controls])


def _noise_at_rest(check: TubeCheck, loop: list[Matrix], delays: tuple[float, float]) -> Matrix:
    """How far from the middle each state may be after many commands that start there."""
    n, m = loop[1].shape
    *_, last = _sizes_after_commands(check, loop, delays, np.zeros(n), np.zeros(m))
    return last[0]


def _linear_loop(check: TubeCheck, box: Mapping[int, Interval], half: Matrix) -> list[Matrix]:
    """Derivatives of rates by states, by commands and by disturbances, and of SC by states."""
    at = {("x", s): middle(box[s]) if s in box else 0.0 for s in check.states}
    reads = {("y", s): x for (_, s), x in at.items()}
    reads |= {("l", k): middle(r) for k, r in enumerate(check.kept)}
    commands, law = _values_and_derivatives(check.law, reads, "y", half)
    winds = check.problem.disturbances
    at |= {("u", k): float(u) for k, u in enumerate(commands)}
    at |= {("w", k): middle(d) for k, d in enumerate(winds)}
    rates = [check.rates[s] for s in check.states]
    a, b, e = (_values_and_derivatives(rates, at, kind, half)[1] for kind in "xuw")
    return [a, b, e * [half_width(d) for d in winds], law]


def _values_and_derivatives(
    roots: Sequence[Node], at: Mapping[tuple[str, int], float], kind: str, half: Matrix
) -> tuple[Matrix, Matrix]:
    """The values of expressions, and their derivatives by inputs of one kind as differences."""
    keys = [key for key in at if key[0] == kind]
    sides = np.where(half, half, 1.0) if kind in "xy" else np.ones(len(keys))
    steps = np.hstack([np.zeros((len(keys), 1)), np.diag(sides), -np.diag(sides)]) * SMALL
    inputs = {key: np.full(steps.shape[1], x) for key, x in at.items()}
    inputs |= {key: inputs[key] + of for key, of in zip(keys, steps, strict=True)}
    values = np.array(values_of_nodes(roots, inputs, steps.shape[1]))
    more, less = np.split(values[:, 1:], 2, axis=1)
    return values[:, 0], (more - less) / (2.0 * SMALL * sides)


def _sizes_after_commands(
    check: TubeCheck,
    loop: list[Matrix],
    delays: tuple[float, float],
    sides: Matrix,
    commands: Matrix,
) -> Iterator[tuple[Matrix, Matrix]]:
    """The largest distances of states and of commands from the middle, after each command.

    Runs begin within `sides` of the middle, while any command within `commands` acts. `delays` has
    the largest age of a read and the largest lateness of a command, in s.
    """
    a, b, wind, law = loop
    delay, late = delays
    n, m = b.shape
    whole = np.zeros((n + m + wind.shape[1],) * 2)
    whole[:n] = np.hstack(loop[:3])
    step = np.eye(len(whole)) + whole * (check.times.period * 1e-9 / PIECES / FINE)
    by_state, by_command, by_wind, _ = np.split(
        np.linalg.matrix_power(step, FINE)[:n], [n, n + m, len(whole)], axis=1
    )
    x, u = np.split(np.diag([*sides, *commands]), [n])
    for _ in range(min(check.times.switches, HOLDS)):
        rates = a @ x + b @ u
        read = x - delay / 2 * rates + delay**2 / 8 * (a @ rates)
        ages = np.diag(delay / 2 * np.abs(law @ rates).sum(axis=1))
        answer = np.hstack([law @ read, ages, law * list(check.error_by_state().values())])
        apart = np.abs(answer - np.pad(u, ((0, 0), (0, m + n)))).sum(axis=1)
        x = np.hstack([np.pad(x, ((0, 0), (0, m + n))), b @ np.diag(late * apart)])
        u = np.pad(answer, ((0, 0), (0, m)))
        for _ in range(PIECES):
            x = np.hstack([by_state @ x + by_command @ u, by_wind])
            u = np.pad(u, ((0, 0), (0, wind.shape[1])))
        yield np.abs(x).sum(axis=1), np.abs(answer).sum(axis=1)
