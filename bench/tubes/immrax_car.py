"""immrax asked about `turning_car.py`, in an interpreter that has immrax; `peers.py` calls it.

It prints a line a step of time: step in seconds, how near in metres, microseconds of a decision.
The embedding is followed by Euler's rule, whose own error is in no bound.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import immrax as irx
import jax
import jax.numpy as jnp
from turning_car import (  # type: ignore[import-not-found]
    CA,
    ERRORS,
    HALF,
    HORIZON_S,
    LENGTH,
    SPEED,
    STEER,
    grown,
    nearest,
)

STEPS = 8
ASKED = 200


class Car(irx.OpenLoopSystem):  # type: ignore[misc]
    """The car that rolls out."""

    def __init__(self) -> None:
        self.evolution, self.xlen = "continuous", 4

    def f(self, t: object, x: jax.Array) -> jax.Array:
        """The derivative of x, y, speed, heading."""
        del t
        _, _, v, heading = x.ravel()
        turns = v / LENGTH * math.tan(STEER)
        return jnp.array([v * jnp.cos(heading), v * jnp.sin(heading), -CA * v, turns])


def main() -> None:
    """A row a step."""
    jax.config.update("jax_enable_x64", True)
    embedded = irx.natemb(Car())
    boxes = jnp.array(grown())
    for k in range(STEPS):
        count = 10 * 2**k
        step = HORIZON_S / count

        def clear(x: jax.Array, step: float = step, count: int = count) -> jax.Array:
            at = jnp.concatenate([x - jnp.array(ERRORS), x + jnp.array(ERRORS)])

            def one(at: jax.Array, _: object) -> tuple[jax.Array, jax.Array]:
                then = at + step * embedded.E(0.0, at)
                low, high = jnp.minimum(at, then)[:2], jnp.maximum(at, then)[4:6]
                apart = (
                    (low[0] - HALF[0] >= boxes[:, 1])
                    | (high[0] + HALF[0] <= boxes[:, 0])
                    | (low[1] - HALF[1] >= boxes[:, 3])
                    | (high[1] + HALF[1] <= boxes[:, 2])
                )
                return then, jnp.all(apart)

            return jnp.all(jax.lax.scan(one, at, None, length=count)[1])

        compiled = jax.jit(clear)
        near = nearest(lambda x, of=compiled: bool(of(jnp.array(x))))
        x = jnp.array((-near - 0.01, 0.0, SPEED, 0.0))
        took = []
        for _ in range(ASKED):
            began = time.perf_counter()
            compiled(x).block_until_ready()
            took.append(time.perf_counter() - began)
        print(step, near, 1e6 * sorted(took)[ASKED // 2])


if __name__ == "__main__":
    main()
