"""What the simulator's integration scheme adds to a linear flow.

Purpose: a bound w per state so that one step of the scheme is an exact solution of
x' in A x + B u + c + [-w, w], for proofs about programs that are simulated (or run) that way.
Non-goals: nonlinear flows, where it is a printed assumption.

One step of a Runge-Kutta scheme of order p (p stages, p <= 4) on x' = f = A x + b with b
constant is x + h (1 + z/2! + ... + z^(p-1)/p!) f, z = h A; the exact one is x + h phi(z) f with
phi(z) = (e^z - 1) / z. A constant w_e explains the difference when phi(z) w_e = T f,
T = sum over k >= p of z^k / (k+1)!. Since 1 / phi = sum B_k z^k / k! (Bernoulli numbers,
|B_k| / k! <= 1 / k!), |w_e| <= e^|z| (sum over k >= p of |z|^k / (k+1)!) |f|, entry by entry.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

ORDER = 4
UP = 1.0 + 1e-12
"""Makes up for every rounding of the few sums of nonnegative numbers here."""
UNIT = 2.0**-53
TERMS = 24


def scheme_weight(a: Floats, h: float, order: int = ORDER) -> Floats:
    """e^|z| (sum over k >= `order` of |z|^k / (k+1)!) for z = h A, from above; shape (n, n).

    inf where h |A| is so large (row sums of 1 and more) that the bound says nothing.
    """
    z = np.abs(a) * h * UP
    size = float(z.sum(axis=1).max(initial=0.0))
    if not size < 1.0:
        return np.full_like(z, np.inf)
    power, exponential, rest = np.eye(len(z)), np.eye(len(z)), np.zeros_like(z)
    factorial = 1.0
    for k in range(1, TERMS):
        power = power @ z
        factorial *= k
        exponential += power / factorial
        if k >= order:
            rest += power / (factorial * (k + 1))
    tail = 2.0 * size**TERMS / factorial if power.any() else 0.0
    return ((exponential + tail) @ (rest + tail) + 0.0) * UP


def scheme_error(
    model: dict[str, Floats], states: Floats, commands: Floats, h: float, order: int = ORDER
) -> Floats:
    """W per state (n): scheme and rounding of one step of `h` seconds, as a disturbance of x'.

    `states`, `commands`: largest |x| and |u| of the group, shapes (n), (m); `model`: of the group.
    """
    f = (
        np.abs(model["A"]) @ states
        + np.abs(model["B"]) @ commands
        + np.abs(model["c"])
        + model["w"]
    )
    weight = scheme_weight(model["A"], h, order)
    scheme = np.where(weight > 0, weight, 0.0) @ f
    stages = 16 * (len(f) + model["B"].shape[1] + 8)
    rounding = stages * UNIT * (states / h + f)
    return np.asarray((scheme + rounding) * UP, dtype=np.float64)
