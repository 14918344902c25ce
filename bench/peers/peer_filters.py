"""Flights behind a filter of somebody else, in its own Python: a line of three numbers comes out.

    PEER/bin/python bench/peers/peer_filters.py WORLD exact|declared FLIGHTS SECONDS NAME [WHAT]

Purpose: beside_peers.py starts this file with the peer's interpreter, as JAX is heavy and versions
differ. Each function makes one filter as the peer's own documents use it.
Non-goals: needing anything of Soter.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from worlds import WORLDS, Filter, fly

if TYPE_CHECKING:
    from collections.abc import Callable


def zoo(name: str) -> Callable[[], Filter]:
    """A filter of run-time-assurance's zoo, docking on a line, as its own test makes it."""
    from run_time_assurance.zoo.integrators import integrator_1d  # noqa: PLC0415 - the peer's

    made = getattr(integrator_1d, f"Integrator1dDocking{name}RTA")()

    def begin() -> Filter:
        made.reset()
        return lambda state, wish: made.filter_control(state, 0.02, wish)

    return begin


class Line:
    """The craft on a line as a double integrator in a plane, for gatekeeper's `step`."""

    def step(self, state: Any, control: Any) -> Any:  # noqa: ANN401
        """20 ms."""
        x, v, u = state[0, 0], state[2, 0], control[0, 0]
        return np.array([[x + 0.02 * v + 0.0002 * u], [0.0], [v + 0.02 * u], [0.0]])


class Retreat:
    """The backup of gatekeeper: the safe controller of examples/migration/docking.soter."""

    def compute_control(self, state: Any, _: Any) -> Any:  # noqa: ANN401
        """Goes to where it waits."""
        push = np.clip(-0.3 * (state[0, 0] + 6.0) - 1.2 * state[2, 0], -1.0, 1.0)
        return np.array([push, 0.0])


class Dock:
    """Where the craft must not be."""

    def check_collision(self, position: Any, _: float) -> bool:  # noqa: ANN401
        """At or behind the dock."""
        return bool(position[0] >= 0.0)


def gatekeeper(folder: str) -> Callable[[], Filter]:
    """`shielding/gatekeeper.py` of safe_control: the wish for 100 ms, then the backup."""
    sys.path.insert(0, f"{folder}/shielding")
    from gatekeeper import Gatekeeper  # type: ignore[import-not-found]  # noqa: PLC0415

    def begin() -> Filter:
        wanted = np.zeros(2)
        keeper = Gatekeeper(
            Line(), {"model": "DoubleIntegrator2D", "radius": 0.0}, dt=0.02, backup_horizon=4.0,
            event_offset=0.02, nominal_horizon=0.1, horizon_discount=0.04,
        )  # fmt: skip
        keeper.visualize_backup = False
        keeper.set_nominal_controller(lambda _: wanted)
        keeper.set_backup_controller(Retreat())
        keeper.set_environment(Dock())

        def answer(state: Any, wish: Any) -> Any:  # noqa: ANN401
            wanted[0] = wish[0]
            return keeper.solve_control_problem(np.array([state[0], 0.0, state[1], 0.0]))[0]

        return answer

    return begin


def reachable(margin: float) -> Callable[[], Filter]:
    """A least restrictive filter over hj_reachability's value function, of the cart in the wind."""
    import hj_reachability as hj  # type: ignore[import-not-found]  # noqa: PLC0415
    import jax.numpy as jnp  # type: ignore[import-not-found]  # noqa: PLC0415

    class Cart(hj.ControlAndDisturbanceAffineDynamics):  # type: ignore[misc]
        def __init__(self) -> None:
            box = hj.sets.Box
            super().__init__(
                "max", "min", box(jnp.array([-3.0]), jnp.array([3.0])),
                box(jnp.array([-0.2]), jnp.array([0.2])),
            )  # fmt: skip

        def open_loop_dynamics(self, state: Any, _: float) -> Any:  # noqa: ANN401
            return jnp.array([state[1], 0.0])

        def control_jacobian(self, _s: Any, _t: float) -> Any:  # noqa: ANN401
            return jnp.array([[0.0], [1.0]])

        def disturbance_jacobian(self, _s: Any, _t: float) -> Any:  # noqa: ANN401
            return jnp.array([[0.0], [1.0]])

    ends = hj.sets.Box(np.array([-11.0, -8.0]), np.array([11.0, 8.0]))
    grid = hj.Grid.from_lattice_parameters_and_boundary_conditions(ends, (221, 161))
    start = 10.0 - jnp.abs(grid.states[..., 0])
    how = hj.SolverSettings.with_accuracy(
        "very_high", hamiltonian_postprocessor=hj.solver.backwards_reachable_tube
    )
    value = np.array(hj.step(how, Cart(), grid, 0.0, start, -6.0, progress_bar=False))
    slope = np.gradient(value, 16.0 / 160, axis=1)

    def at(table: Any, state: Any) -> float:  # noqa: ANN401
        i = np.clip((state[0] + 11.0) / 0.1, 0.0, 219.999)
        j = np.clip((state[1] + 8.0) / 0.1, 0.0, 159.999)
        a, b, p, q = int(i), int(j), i % 1.0, j % 1.0
        low = (1 - q) * table[a, b] + q * table[a, b + 1]
        high = (1 - q) * table[a + 1, b] + q * table[a + 1, b + 1]
        return float((1 - p) * low + p * high)

    def answer(state: Any, wish: Any) -> Any:  # noqa: ANN401
        if at(value, state) > margin:
            return wish
        return np.array([3.0 if at(slope, state) > 0.0 else -3.0])

    return lambda: answer


def main() -> None:
    """Fly."""
    world, how, flights, seconds, name, *rest = sys.argv[1:]
    if name == "gatekeeper":
        begin = gatekeeper(rest[0])
    elif name == "reachable":
        begin = reachable(float(rest[0]))
    else:
        begin = zoo(name)
    print(*fly(WORLDS[world](how == "exact"), begin, int(flights), float(seconds)))


if __name__ == "__main__":
    main()
