"""Protected steps a second: many worlds in one call, one world, and what both are compared with.

    .venv/bin/python bench/running/gym_steps.py [--worlds N] [--seconds S]

The mountain car of examples/mountain_car, one core. In turns, medians: `ProtectedVector`, whose
worlds are the compiled program with its plant; the same plant in the same C loop with nobody in
front of it; the map of Gymnasium's car over NumPy arrays; Gymnasium's own vector of its car. Then a
step of one environment with a module in front, bare, and as it was without the fast way (functions
in Python for what goes in and out); Gymnasium's `AsyncVectorEnv` of both, wall time; and how long
environments take to make. Exit code 1 where a target is missed. Beside AFRL's filter:
bench/running/simplex_peer.py.
"""

from __future__ import annotations

import argparse
import functools
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

import soter
from soter.gym import Protected, make_vec
from soter.gym.batched_states import BatchedStates
from soter.gym.compiled_system import CompiledEnvironment, Roles
from soter.gym.memory_offsets import ObservedPart

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
CAR = ROOT / "examples" / "mountain_car"
sys.path.insert(0, str(CAR))
import cliff_env  # type: ignore[import-not-found]  # noqa: E402

VECTOR_TARGET = 5e6
STEP_TARGET = 2.0
ASYNC_TARGET = 1.5
ASYNC = 4
MAKE_TARGET_S = 0.1
ROUNDS = 7
BARE = """soter 1;
import "{cliff}" as cliff;
extern node Driver period 1s {{ publishes cliff.force; }}
system Bare default {{ car: cliff.MountainCar; node Driver; until 999s; }}
"""


def rate(step: Callable[[], object], steps: int, seconds: float) -> float:
    """Steps a second of calls that make so many each, for about so long."""
    step()
    began, calls = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        step()
        calls += 1
    return calls * steps / (time.perf_counter() - began)


def bare_worlds(count: int, actions: Array) -> Callable[[], object]:
    """The plant of the program in the same loop, its command from outside, no module."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bare.soter"
        path.write_text(BARE.format(cliff=CAR / "cliff.soter"))
        flat = soter.load(path).flat()
    driver, car = flat.component("Driver"), flat.component("car")
    topic = car.scope.topics[car.plant.drives[0][0]]  # type: ignore[union-attr]
    made = CompiledEnvironment(flat, Roles(driver.index), {}, [ObservedPart(topic)])
    worlds, nobody = BatchedStates(made, count), np.zeros(count, dtype=bool)
    worlds.seeds[:] = np.arange(count)
    worlds.begin(np.ones(count, dtype=bool))
    return lambda: worlds.step(actions, nobody)


def numpy_car(count: int, actions: Array) -> Callable[[], object]:
    """The car's map over arrays (count,)."""
    rng = np.random.default_rng(1)
    place, speed = rng.uniform(-0.6, -0.4, count), np.zeros(count)
    force = actions[:, 0]

    def step() -> None:
        nonlocal place, speed
        pushed = speed + 0.0015 * force - 0.0025 * np.cos(3.0 * place)
        speed = np.clip(pushed, -0.07, 0.07)
        place = np.minimum(place + speed, 0.6)

    return step


def protected_worlds(count: int, actions: Array, *, copy: bool) -> Callable[[], object]:
    env = make_vec(CAR / "cliff.soter", count, copy=copy)
    env.reset(seed=1)
    return lambda: env.step(actions)


def gymnasiums(count: int, actions: Array) -> Callable[[], object]:
    env = gymnasium.make_vec("MountainCarContinuous-v0", count, vectorization_mode="sync")
    env.reset(seed=1)
    given = actions[:count].astype(np.float32)
    return lambda: env.step(given)


def one(env: gymnasium.Env[Any, Any]) -> Callable[[], object]:
    """A thousand steps of one environment."""
    action = np.array([0.1], dtype=np.float32)
    env.reset(seed=1)

    def step() -> None:
        for _ in range(1000):
            _, _, ended, cut, _ = env.step(action)
            if ended or cut:
                env.reset(seed=1)

    return step


def medians(ways: dict[str, tuple[Callable[[], object], int]], seconds: float) -> dict[str, float]:
    """Steps a second of each, in turns."""
    rates_by_way: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, (step, steps) in ways.items():
            rates_by_way[name].append(rate(step, steps, seconds))
    return {name: statistics.median(values) for name, values in rates_by_way.items()}


def vectors(count: int, seconds: float) -> bool:
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 1))
    few = min(count, 64)
    speeds = medians(
        {
            "protected, arrays of its own": (protected_worlds(count, actions, copy=False), count),
            "protected, copies": (protected_worlds(count, actions, copy=True), count),
            "the same plant and loop, bare": (bare_worlds(count, actions), count),
            "NumPy's map of the car, bare": (numpy_car(count, actions), count),
            f"Gymnasium's own, {few} in sync": (gymnasiums(few, actions), few),
        },
        seconds,
    )
    ours = speeds["protected, arrays of its own"]
    print(f"{count:,} worlds, steps a second, and beside protected ones (median of {ROUNDS}):")
    for name, value in speeds.items():
        print(f"  {name:32s} {value / 1e6:8.3f} M   x {value / ours:6.2f}")
    print(f"  target >= {VECTOR_TARGET / 1e6:g} M protected steps a second")
    return ours >= VECTOR_TARGET


def singles(seconds: float) -> bool:
    program = soter.load(CAR / "cliff.soter")
    through_python = Protected(
        program,
        cliff_env.make(),
        observe=lambda o: {"x": o[0], "v": o[1]},
        act=lambda a: {"force": float(a[0])},
        command=lambda force: np.array([force], dtype=np.float32),
    )
    ways = {
        "bare": cliff_env.make(),
        "protected": Protected(program, cliff_env.make()),
        "protected, no alarm": Protected(program, cliff_env.make(), alarm=False),
        "protected, through functions": through_python,
    }
    speeds = medians({name: (one(env), 1000) for name, env in ways.items()}, seconds)
    costs = {name: 1e6 / value for name, value in speeds.items()}
    print(f"one environment, us a step (median of {ROUNDS}):")
    for name, cost in costs.items():
        over = cost - costs["bare"]
        print(f"  {name:32s} {cost:8.2f}   over bare {over:6.2f}   x {cost / costs['bare']:5.2f}")
    ratio = costs["protected"] / costs["bare"]
    print(f"  target: protected / bare <= {STEP_TARGET:g}")
    return ratio <= STEP_TARGET


def protected_car(**options: Any) -> gymnasium.Env[Any, Any]:  # noqa: ANN401 - of Protected
    """A car behind the module, as a process of a vector makes it."""
    return Protected(CAR / "cliff.soter", cliff_env.make(), **options)


Vectors = gymnasium.vector.AsyncVectorEnv | gymnasium.vector.SyncVectorEnv


def of_gymnasium(seconds: float, kind: type[Vectors]) -> float:
    """Protected / bare: Gymnasium's own vectors of cars.

    Of those that show the keys of `info` that learners read, not all 16.
    """
    learning = functools.partial(protected_car, info_keys=("cost", "intervened", "cause", "margin"))
    made = {
        "bare": cliff_env.make,
        "protected": learning,
        "protected, all keys of info": protected_car,
    }
    actions = np.full((ASYNC, 1), 0.1, dtype=np.float32)
    envs = {n: kind([make] * ASYNC) for n, make in made.items()}
    try:
        for env in envs.values():
            env.reset(seed=1)
        ways: dict[str, tuple[Callable[[], object], int]] = {
            n: (functools.partial(env.step, actions), ASYNC) for n, env in envs.items()
        }
        speeds = medians(ways, seconds)
    finally:
        for env in envs.values():
            env.close()
    print(f"{kind.__name__} of {ASYNC}, us a step of all of them (median of {ROUNDS}):")
    for name, value in speeds.items():
        print(f"  {name:32s} {ASYNC * 1e6 / value:8.1f}   x {speeds['bare'] / value:5.2f}")
    return speeds["bare"] / speeds["protected"]


def asynchronous(seconds: float) -> bool:
    """Vectors of processes, which have a target, and of environments in this one."""
    ratio = of_gymnasium(seconds, gymnasium.vector.AsyncVectorEnv)
    print(f"  target: protected / bare <= {ASYNC_TARGET:g}")
    of_gymnasium(seconds, gymnasium.vector.SyncVectorEnv)
    return ratio <= ASYNC_TARGET


def construction() -> bool:
    """Seconds to make environments of a program that was loaded."""
    program = soter.load(CAR / "cliff.soter")
    times = []
    for make in (
        lambda: Protected(program, cliff_env.make()),
        lambda: [Protected(program, cliff_env.make()) for _ in range(64)],
        lambda: Protected(CAR / "cliff.soter", cliff_env.make()),
        lambda: make_vec(program, 4096),
    ):
        make()
        began = time.perf_counter()
        make()
        times.append(time.perf_counter() - began)
    names = ("one", "64 of them", "one of a path", "4,096 worlds")
    print("making them once the program is compiled, ms:")
    for name, seconds in zip(names, times, strict=True):
        print(f"  {name:32s} {seconds * 1e3:8.2f}")
    print(f"  target: one <= {MAKE_TARGET_S * 1e3:g}")
    return times[0] <= MAKE_TARGET_S


def main() -> int:
    """Measure all; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--seconds", type=float, default=0.3)
    given = parser.parse_args()
    met = [
        vectors(given.worlds, given.seconds),
        singles(given.seconds),
        asynchronous(given.seconds),
        construction(),
    ]
    print("every target is met" if all(met) else "MISSED: a target")
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
