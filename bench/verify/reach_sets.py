"""Times and tightness of the grid engine on problems with a known answer.

    .venv/bin/python bench/verify/reach_sets.py [--json FILE] [--no-peer]

- double integrator with walls, 401 x 401: cells of K against the cells wholly inside the exact
  kernel, |p| and |p + v |v| / (2 B)| <= wall, which no controller can exceed, sampled or not;
- K and S_0..S_2 of it, warm, beside `hj-reachability` (level sets; pip install
  'soter[bench-peers]') at its low accuracy: same grid, horizon and criterion (K: until no cell
  changes any more, looked at every quarter of a second of the flow; S: H* and twice the DM's
  period), compilation excluded, turn by turn in this process. What it calls safe is an
  approximation: counted, not trusted;
- the same cart with a lag between command and acceleration, 101 x 101 x 31, beside the same peer;
- mountain car 360 x 280: K with a table of commands for SC, R(1)..R(3), warm; every start
  certified.

Times are medians (and best) of several turns; ours on two threads, the peer on what it takes.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.front_end import check_file, system_of
from soter.verify.enclose.enclosure_code import generate_enclosures
from soter.verify.enclose.engine_library import ReachLibrary
from soter.verify.grid.policies import core_synthesis
from soter.verify.grid.sets import GridGroup, of_problem
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Callable

    import jax
    import numpy.typing as npt

    from soter.verify.problem.problem import Problem

    Bools = npt.NDArray[np.bool_]

ROOT = Path(__file__).resolve().parents[2]
MS = 1_000_000
WALL, BRAKE, LAG = 1.5, 3.0, 0.1
HORIZON_NS, PERIOD_NS = 100 * MS, 100 * MS
"""H and Delta: with SC in phase, no age, lateness or delay, H* = Delta."""
CHUNK_S, LONGEST_S = 0.25, 4.0
REPEATS = 15
TARGETS = {"cart": 100, "lagged": 20}
"""How many times as long the peer should take."""


def problem_of(file: str, system: str, *, synthesize: bool = False) -> tuple[Problem, ReachLibrary]:
    """The first module's problem and its compiled enclosures."""
    flat = system_of(check_file(str(ROOT / file)), system)
    problem = extract(flat, flat.modules[0], synthesize=synthesize)
    unit = generate_enclosures(problem.system, problem.core, problem.module, problem.quantities)
    return problem, ReachLibrary(unit.source)


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """A result and the wall seconds it took."""
    began = time.perf_counter()
    result = work()
    return result, time.perf_counter() - began


# ------------------------------------------------------------------ double integrator


def cart(file: str = "double_integrator.soter") -> GridGroup:
    """The engine for a cart, exact readings without delay."""
    problem, library = problem_of(f"bench/verify/{file}", "Walls")
    axes = [(a.state, a.edges) for a in problem.groups[0].axes]
    inputs = replace(of_problem(problem), delay_ns=0, plant_period_ns=0)
    return GridGroup(library, inputs, axes)


def sets_of(group: GridGroup) -> list[Bools]:
    """K, S_0, S_1, S_2 without measurement errors."""
    sets = [group.core(group.constraint(), patience=1).cells]
    sets.append(group.safe_for(HORIZON_NS, sets[0]))
    for _ in range(2):
        sets.append(group.safe_for(PERIOD_NS, sets[-1]))
    return sets


def wholly_inside(group: GridGroup) -> Bools:
    """Cells all of whose states can stop before the wall."""
    p, v = group.edges
    right = p[1:, None] + np.maximum(v[None, 1:], 0) ** 2 / (2 * BRAKE)
    left = p[:-1, None] - np.minimum(v[None, :-1], 0) ** 2 / (2 * BRAKE)
    return np.asarray((right <= WALL) & (left >= -WALL))


# ------------------------------------------------------------------ the peer


@dataclass
class Peer:
    """hj-reachability on a cart."""

    grid: Any
    solve: Callable[[Any, str, float], Any]
    wall: Any

    def sets(self) -> list[Bools]:
        """What it takes for K, S_0, S_1, S_2, on as many nodes as there are cells."""
        values, at, before = self.wall, 0.0, None
        while at < LONGEST_S:
            values = self.solve(values, "max", CHUNK_S)
            at += CHUNK_S
            now = np.asarray(values) > 0
            if before is not None and np.array_equal(before, now):
                break
            before = now
        sets = [now]
        for t in (HORIZON_NS, PERIOD_NS, PERIOD_NS):
            values = self.solve(values, "min", t * 1e-9)
            sets.append(np.asarray(values) > 0)
        return sets


def peer_of(group: GridGroup) -> Peer | None:
    """The peer, compiled; None where it is not installed. With three axes the cart has a lag."""
    if importlib.util.find_spec("hj_reachability") is None:
        return None
    import hj_reachability as hj  # noqa: PLC0415 - optional
    import jax.numpy as jnp  # noqa: PLC0415 - optional

    lagged = len(group.shape) == 3

    class Cart(hj.ControlAndDisturbanceAffineDynamics):  # type: ignore[misc]
        def __init__(self, mode: str) -> None:
            none = hj.sets.Box(jnp.zeros(1), jnp.zeros(1))
            force = hj.sets.Box(jnp.array([-BRAKE]), jnp.array([BRAKE]))
            super().__init__(mode, "min", force, none)

        def open_loop_dynamics(self, x: jax.Array, _time: float) -> jax.Array:
            return jnp.array([x[1], x[2], -x[2] / LAG] if lagged else [x[1], 0.0])

        def control_jacobian(self, _x: jax.Array, _time: float) -> jax.Array:
            return jnp.array([[0.0], [0.0], [1.0 / LAG]] if lagged else [[0.0], [1.0]])

        def disturbance_jacobian(self, _x: jax.Array, _time: float) -> jax.Array:
            return jnp.zeros((len(group.shape), 1))

    ends = hj.sets.Box(*(np.array([e[k] for e in group.edges]) for k in (0, -1)))
    grid = hj.Grid.from_lattice_parameters_and_boundary_conditions(ends, group.shape)
    settings = hj.SolverSettings.with_accuracy(
        "low", hamiltonian_postprocessor=hj.solver.backwards_reachable_tube
    )
    carts = {mode: Cart(mode) for mode in ("max", "min")}

    def solve(values: jax.Array, mode: str, t: float) -> jax.Array:
        done = hj.step(settings, carts[mode], grid, 0.0, values, -t, progress_bar=False)
        done.block_until_ready()
        return jnp.asarray(done)

    peer = Peer(grid, solve, WALL - jnp.abs(grid.states[..., 0]))
    peer.sets()
    return peer


# ------------------------------------------------------------------ mountain car


def car() -> tuple[GridGroup, Problem]:
    """The engine for examples/mountain_car."""
    problem, library = problem_of("examples/mountain_car/cliff.soter", "Protected", synthesize=True)
    return GridGroup.of(library, problem, problem.groups[0]), problem


def car_sets(group: GridGroup, problem: Problem) -> list[Bools]:
    """K (with a table of commands) and R(1)..R(3)."""
    commands = [[u] for u in problem.commands[0]]
    core = core_synthesis(group, group.constraint(), commands).cells
    period = group.inputs.period_ns
    return [core, *(group.safe_for(k * period, core) for k in (1, 2, 3))]


def starts_in(group: GridGroup, problem: Problem, cells: Bools) -> bool:
    """Whether every initial state lies in the set."""
    at = []
    for axis, edges in zip(group.axes, group.edges, strict=True):
        low, high = problem.initial[axis].low, problem.initial[axis].high
        first = int(np.searchsorted(edges, low, side="right")) - 1
        last = max(first, int(np.searchsorted(edges, high, side="left")) - 1)
        at.append(slice(first, last + 1))
    return bool(cells[tuple(at)].all())


# ------------------------------------------------------------------ the table


def main() -> None:
    """Measure and print; `--json` also writes the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--no-peer", action="store_true")
    arguments = parser.parse_args()
    group = cart()
    peers = not arguments.no_peer
    sets, of_cart = beside(group, peers, REPEATS, "cart")
    _, of_lagged = beside(cart("lagged_integrator.soter"), peers, 5, "lagged")
    exact = wholly_inside(group)
    track, problem = car()
    regions: list[Bools] = []
    car_times: list[float] = []
    for _ in range(REPEATS):
        regions, seconds = timed(lambda: car_sets(track, problem))
        car_times.append(seconds)
    figures: dict[str, Any] = {
        "cart_tightness": float((sets[0] & exact).sum() / exact.sum()),
        "cart_cells_outside_the_kernel": int((sets[0] & ~exact).sum()),
        **of_cart,
        **of_lagged,
        "car_shares": shares(regions),
        "car_s": statistics.median(car_times),
        "car_best_s": min(car_times),
        "car_starts_certified": starts_in(track, problem, regions[-1]),
    }
    tell(figures)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")


def beside(
    group: GridGroup, peers: bool, turns: int, name: str
) -> tuple[list[Bools], dict[str, Any]]:
    """The sets of a cart, and its figures beside the peer's, turn by turn."""
    peer = peer_of(group) if peers else None
    mine: list[float] = []
    theirs: list[float] = []
    sets: list[Bools] = []
    peer_sets: list[Bools] = []
    for turn in range(turns):
        sets, seconds = timed(lambda: sets_of(group))
        mine.append(seconds)
        if peer is not None and turn % 3 == 0:
            peer_sets, seconds = timed(peer.sets)
            theirs.append(seconds)
    figures: dict[str, Any] = {
        f"{name}_shares": shares(sets),
        f"{name}_s": statistics.median(mine),
        f"{name}_best_s": min(mine),
    }
    if theirs:
        figures |= {
            f"{name}_peer_s": statistics.median(theirs),
            f"{name}_peer_best_s": min(theirs),
            f"{name}_peer_shares": shares(peer_sets),
            f"{name}_ratio": statistics.median(theirs) / statistics.median(mine),
            f"{name}_ratio_of_best": min(theirs) / min(mine),
        }
    return sets, figures


def shares(sets: list[Bools]) -> list[float]:
    """Of the grid, one a set."""
    return [float(s.mean()) for s in sets]


def tell(figures: dict[str, Any]) -> None:
    """The figures beside their targets."""

    def listed(name: str) -> str:
        return ", ".join(f"{x:.3f}" for x in figures[name])

    def times(name: str) -> str:
        median, best = figures[f"{name}_s"], figures[f"{name}_best_s"]
        return f"{1e3 * median:.1f} ms median, {1e3 * best:.1f} ms best"

    def compared(name: str) -> None:
        if f"{name}_ratio" not in figures:
            print("  hj-reachability is not installed (or --no-peer): no comparison")
            return
        print(f"  hj-reachability, low accuracy: {listed(f'{name}_peer_shares')} of its nodes")
        print(f"  its time {times(f'{name}_peer')}")
        print(
            f"  ratio of medians {figures[f'{name}_ratio']:.0f}, of best"
            f" {figures[f'{name}_ratio_of_best']:.0f} (target >= {TARGETS[name]})"
        )

    print(f"cart 401 x 401: K, S_0, S_1, S_2 cover {listed('cart_shares')} of the grid")
    print(
        f"  tightness {figures['cart_tightness']:.4f} of the cells wholly inside the exact kernel"
        f" (target >= 0.97); {figures['cart_cells_outside_the_kernel']} cells not wholly inside"
    )
    print(f"  time {times('cart')}")
    compared("cart")
    print(f"lagged cart 101 x 101 x 31: the same sets cover {listed('lagged_shares')} of the grid")
    print(f"  time {times('lagged')}")
    compared("lagged")
    print(f"mountain car 360 x 280: K, R(1), R(2), R(3) cover {listed('car_shares')} of the grid")
    print(
        f"  time {times('car')} (target <= 100 ms);"
        f" every start certified: {figures['car_starts_certified']}"
    )


if __name__ == "__main__":
    main()
