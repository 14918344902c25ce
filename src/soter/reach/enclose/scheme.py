"""What the simulator's integration scheme adds to a linear flow.

Purpose: a bound w per state so that one step of the scheme is an exact solution of
x' in A x + B u + c + [-w, w], for proofs about programs that are simulated (or run) that way.
Non-goals: nonlinear flows, where it is a printed assumption.

The state is that of all plants together: the scheme steps them at once, and only then is b, the
commands and disturbances of one step, constant. One step of a Runge-Kutta scheme of order p
(p stages, p <= 4) on x' = f = A x + b is x + h (1 + z/2! + ... + z^(p-1)/p!) f, z = h A; the exact
one is x + h phi(z) f with phi(z) = (e^z - 1) / z. A constant w_e explains the difference when
phi(z) w_e = T f, T = sum over k >= p of z^k / (k+1)!. Since 1 / phi = sum B_k z^k / k! with the
Bernoulli numbers B_0 = 1, B_1 = -1/2, |B_k| / k! <= 4 / (2 pi)^k, entry by entry
|w_e| <= (1 + |z|/2 + sum over k >= 2 of 4 (|z|/6.28)^k) (sum over k >= p of |z|^k / (k+1)!) |f|.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

NS = 1e-9
ORDER = 4
UP = 1.0 + 1e-12
"""Makes up for every rounding of the few sums of nonnegative numbers here."""
UNIT = 2.0**-53
TERMS = 24


def scheme_weight(a: Floats, h: float, order: int = ORDER) -> Floats:
    """The matrix before |f| above, for `order` = p; shape (n, n).

    inf where h |A| is so large (row sums of 1 and more) that the bound says nothing.
    """
    z = np.abs(a) * h * UP
    size = float(z.sum(axis=1).max(initial=0.0))
    if not size < 1.0:
        return np.full_like(z, np.inf)
    power, inverse, rest = np.eye(len(z)), np.eye(len(z)), np.zeros_like(z)
    factorial = 1.0
    for k in range(1, TERMS):
        power = power @ z
        factorial *= k
        inverse += power * (0.5 if k == 1 else 4.0 / 6.28**k)
        if k >= order:
            rest += power / (factorial * (k + 1))
    tail = 2.0 * size**TERMS / factorial if power.any() else 0.0
    beyond = 5.0 * (size / 6.28) ** TERMS if power.any() else 0.0
    return ((inverse + beyond) @ (rest + tail) + 0.0) * UP


def largest_rates(model: dict[str, Floats], states: Floats, commands: Floats) -> Floats:
    """Bounds of |x'| (n,) for |x| <= `states` (n,), |u| <= `commands` (m,), but for rounding."""
    moved = np.abs(model["A"]) @ states + np.abs(model["B"]) @ commands
    return np.asarray(moved + np.abs(model["c"]) + model["w"], dtype=np.float64)


def scheme_error(
    model: dict[str, Floats], states: Floats, commands: Floats, h: float, order: int = ORDER
) -> Floats:
    """W per state (n,): scheme and rounding of one step of `h` seconds, as a disturbance of x'.

    `states`, `commands`: largest |x| and |u|, shapes (n,), (m,); `model`: of all states.
    """
    f = largest_rates(model, states, commands)
    weight = scheme_weight(model["A"], h, order)
    scheme = np.where(weight > 0, weight, 0.0) @ f
    stages = 16 * (len(f) + model["B"].shape[1] + 8)
    rounding = stages * UNIT * (states / h + f)
    return np.asarray((scheme + rounding) * UP, dtype=np.float64)
