"""The error that the simulator's integration scheme adds to a linear flow.

Purpose: `scheme_error` gives a bound w for each state so that one step of the scheme is an exact
solution of x' in A x + B u + c + [-w, w]; proofs about programs that are simulated (or run) in this
way use it as a disturbance.
Non-goals: nonlinear flows, for which it is a printed assumption.

The state is that of all plants together: the scheme steps them at once, and only then is b, the
commands and disturbances of one step, constant. One step of a Runge-Kutta scheme of order p
(p stages, p <= 4) on x' = f = A x + b is x + h (1 + z/2! + ... + z^(p-1)/p!) f, z = h A; the exact
one is x + h phi(z) f with phi(z) = (e^z - 1) / z. A constant w_e explains the difference when
phi(z) w_e = T f, T = sum over k >= p of z^k / (k+1)!. Since 1 / phi = sum B_k z^k / k! with the
Bernoulli numbers B_0 = 1, B_1 = -1/2, |B_k| / k! <= 4 / (2 pi)^k, entry by entry
|w_e| <= (1 + |z|/2 + sum over k >= 2 of 4 (|z|/6.28)^k) (sum over k >= p of |z|^k / (k+1)!) |f|.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.enclose.compiled_enclosures import FORM
from soter.verify.problem.problem import ORDER

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.core.layout import Floats


UP = 1.0 + 1e-12
"""A factor that covers the rounding of the sums of nonnegative numbers in this file."""
UNIT = 2.0**-53
TERMS = 24
SIZES = (0.25, 0.5, 0.75, 0.95)
LINEAR = 2.0**-40
"""Remainders up to this share of a rate count as rounding: the flow is linear."""
ROOM = 1.01
STIFF = (
    "the error of the plant's scheme is not bounded: rate x step of {names} is {size:.3g}, at "
    "{step:.3g} s a step"
)
STIFF_HINT = "shorter steps of the plant, rate x step below 1: `substeps`, or a shorter period"


def scheme_weight(a: Floats, h: float, order: int = ORDER) -> Floats:
    """The matrix (n, n) that multiplies |f| in the bound in the head of this file; `order` is p.

    It is inf if the spectral radius of h |A| is near 1 or more, as no bound is then known. Tails
    are bounded with d > 0 and z d <= size d: then z^k <= size^k d (1 / d)^T, entry by entry.
    """
    z = np.abs(a) * h * UP
    scaled = _weights_of_rows(z)
    if scaled is None:
        return np.full_like(z, np.inf)
    d, size = scaled
    power, inverse, rest = np.eye(len(z)), np.eye(len(z)), np.zeros_like(z)
    factorial = 1.0
    for k in range(1, TERMS):
        power = power @ z
        factorial *= k
        inverse += power * (0.5 if k == 1 else 4.0 / 6.28**k)
        if k >= order:
            rest += power / (factorial * (k + 1))
    ends = np.outer(d, 1.0 / d) if power.any() else 0.0
    tail = 2.0 * size**TERMS / factorial * ends
    beyond = 5.0 * (size / 6.28) ** TERMS * ends
    return np.asarray(((inverse + beyond) @ (rest + tail) + 0.0) * UP)


def _weights_of_rows(z: Floats) -> tuple[Floats, float] | None:
    """Weights d > 0 (n,) and a size < 1 with z d <= size d, for z >= 0 (n, n); None if not found.

    The rows have different units and need weights: d solves (1 - z / s) d = 1 for an s of `SIZES`.
    """
    for s in SIZES:
        try:
            d = np.linalg.solve(np.eye(len(z)) - z / s, np.ones(len(z)))
        except np.linalg.LinAlgError:
            continue
        if np.all(np.isfinite(d)) and np.all(d > 0.5):
            size = float((z @ d / d).max(initial=0.0)) * UP
            if size < 1.0:
                return np.asarray(d, dtype=np.float64), size
    return None


def largest_rates(model: dict[str, Floats], states: Floats, commands: Floats) -> Floats:
    """Bounds of |x'| (n,) for |x| <= `states` (n,), |u| <= `commands` (m,), rounded to nearest."""
    moved = np.abs(model["A"]) @ states + np.abs(model["B"]) @ commands
    return np.asarray(moved + np.abs(model["c"]) + model["w"], dtype=np.float64)


def scheme_error(
    model: dict[str, Floats], states: Floats, commands: Floats, h: float, order: int = ORDER
) -> Floats:
    """A bound w (n,) on the error of one step of `h` seconds, with rounding, as an addition to x'.

    `states` (n,) and `commands` (m,) are the largest |x| and |u|; `model` covers all states.
    """
    f = largest_rates(model, states, commands)
    weight = scheme_weight(model["A"], h, order)
    scheme = np.where(weight > 0, weight, 0.0) @ f
    stages = 16 * (len(f) + model["B"].shape[1] + 8)
    rounding = stages * UNIT * (states / h + f)
    return np.asarray((scheme + rounding) * UP, dtype=np.float64)


@dataclass(frozen=True)
class SchemeSolution:
    """Whether the steps of the simulator are solutions of a group's model.

    `error`: they are if this much (n,) is added to the rates of its states; None: that is not
    shown. `stiff`: why not, in words, where the flow is linear and only the step is too long.
    """

    error: Floats | None = None
    stiff: str = ""


@dataclass(frozen=True)
class SimulatedFlow:
    """The rates of a problem and the steps in which the simulator integrates them.

    `rates(low, high)` gives forms (states, 4 + inputs) of all rates over ranges of all inputs, and
    each input's radius; None if a fault is possible. `steps` has for each state the step in s (0 if
    commands do not fit it), the order of the scheme and the number of the plant.
    """

    rates: Callable[[Floats, Floats], tuple[Floats, Floats] | None]
    names: tuple[str, ...]
    steps: tuple[tuple[float, int, int], ...]
    controls: int


def scheme_solution(
    flow: SimulatedFlow, low: Floats, high: Floats, group_states: Sequence[int]
) -> SchemeSolution:
    """Tests whether the simulator's steps solve the model of a group's states, with what error.

    Inputs lie in [low, high], (inputs,). States that move the group's states are integrated with
    them, so their rates count. Stages may leave the ranges; the flow must be linear there, too.
    """
    n = len(flow.names)
    inside = _linear_model(flow, low, high, group_states)
    if inside is None:
        return SchemeSolution()
    states, model = inside
    if not all(flow.steps[s][0] > 0.0 for s in states):
        return SchemeSolution()
    errors = np.zeros(n)
    for plant in dict.fromkeys(flow.steps[s][2] for s in states):
        at = [s for s in states if flow.steps[s][2] == plant]
        others = [s for s in states if s not in at]
        step, order, _ = flow.steps[at[0]]
        a = model["A"][np.ix_(at, at)]
        if model["A"][np.ix_(at, others)].any():
            return SchemeSolution()  # plants read no states of each other
        z = np.abs(a) * step
        weight = scheme_weight(a, step, order)
        if not np.all(np.isfinite(weight)):
            return SchemeSolution(stiff=_too_fast_in_words([flow.names[s] for s in at], z, step))
        part = _submodel(model, at)
        largest = np.maximum(np.abs(low), np.abs(high))
        bounds = largest[at], largest[n : n + flow.controls]
        beyond = _stage_distance(z, step * largest_rates(part, *bounds))
        wider = low.copy(), high.copy()
        wider[0][at] -= beyond
        wider[1][at] += beyond
        wider_model = _linear_model(flow, *wider, at)
        if wider_model is None:
            return SchemeSolution()
        moved = _submodel(wider_model[1], at)
        if np.any(step * largest_rates(moved, bounds[0] + beyond, bounds[1]) > beyond):
            return SchemeSolution()
        errors[at] = scheme_error(part, *bounds, step, order)
    return SchemeSolution(errors[list(group_states)])


def _too_fast_in_words(names: Sequence[str], z: Floats, step: float) -> str:
    """A sentence that names the states whose rates are too fast for the step."""
    every = range(len(z))
    alone = [k for k in every if z[k, k] >= SIZES[-1]] or [*every]
    size = float(np.abs(np.linalg.eigvals(z)).max())
    return STIFF.format(names=", ".join(names[k] for k in alone), size=size, step=step)


def _stage_distance(z: Floats, first: Floats) -> Floats:
    """The largest distance of the stages of a step from its start: the sum of all z^k `first`."""
    total, term = first.copy(), first.copy()
    for _ in range(TERMS * 20):
        term = z @ term
        total += term
        if np.all(term <= total * UNIT):
            break
    return np.asarray(total * ROOM)


def _submodel(model: dict[str, Floats], at: list[int]) -> dict[str, Floats]:
    """The part of a model for the states `at`; these depend on no other states."""
    return {k: v[at] if k != "A" else v[np.ix_(at, at)] for k, v in model.items()}


def _linear_model(
    flow: SimulatedFlow, low: Floats, high: Floats, group_states: Sequence[int]
) -> tuple[list[int], dict[str, Floats]] | None:
    """The states on which a group's states depend, and the linear model of all states and controls.

    Returns None if the rate of one of these states is not linear.
    """
    bounds = flow.rates(low, high)
    if bounds is None:
        return None
    rates, radius = bounds
    n = len(flow.names)
    moving = n + flow.controls
    size = np.abs(rates[:, 2]) + np.abs(rates[:, FORM:]).sum(axis=1)
    slopes = rates[:, FORM : FORM + moving] / np.where(radius[:moving] > 0, radius[:moving], 1.0)
    todo, states = list(group_states), set()
    while todo:
        s = todo.pop()
        if s in states:
            continue
        states.add(s)
        if not rates[s, 3] <= LINEAR * size[s] + 1e-250:
            return None
        todo += [int(k) for k in np.flatnonzero(slopes[s, :n])]
    middle = low[:moving] / 2 + high[:moving] / 2
    return sorted(states), {
        "A": slopes[:, :n],
        "B": slopes[:, n:],
        "c": rates[:, 2] - slopes @ middle,
        "w": np.abs(rates[:, FORM + moving :]).sum(axis=1) + rates[:, 3],
    }
