"""All ratios of speed that people feel, beside their peers, in one short run.

    make bench-quick      (or: .venv/bin/python bench/quick.py [--only PART])

Purpose: a row a figure: what was measured, beside what, the target; some 15 seconds (45 where
nothing is compiled yet). Commands are whole processes, their processor time (median), so that
others on the machine matter less; steps and flights are processor time of this process, in turns
with what they are compared with. What takes minutes each has a command of its own and is named at
the end. Exit code 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import soter
from soter.campaign.batch_flights import Fleet
from soter.editor.documents import Overlay
from soter.gym import Protected, make_vec
from soter.gym.compiled_system import CompiledEnvironment, Roles
from soter.gym.environment_choices import ObservedPart
from soter.gym.vector import BatchedStates
from soter.language.elaborate.derived_systems import faultless
from soter.language.front_end import check_file
from soter.report.tables import table
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"
sys.path[:0] = [str(ROOT), str(EXAMPLES / "mountain_car")]
import cliff_env  # type: ignore[import-not-found]  # noqa: E402
from bench.tubes.check_cost import loop_s  # noqa: E402

DRONE = EXAMPLES / "drone"
CLIFF = EXAMPLES / "mountain_car" / "cliff.soter"
SECOND = 10**9
TURNS = 5
TARGET_S, LOOP_S = 60.0, 0.22
"""Of 104 hours of the drone, on a machine on which `loop_s` gives LOOP_S."""
BARE = """soter 1;
import "{cliff}" as cliff;
extern node Driver period 1s {{ publishes cliff.force; }}
system Bare default {{ car: cliff.MountainCar; node Driver; until 999s; }}
"""
NODES = 1000
SOTER = ("-m", "soter")
ELSEWHERE = """measured elsewhere, in minutes: `verify` and `recheck` of the examples
(bench/recheck/beside_verify.py), bytes of an install (bench/newcomers/from_wheel.py)"""


@dataclass(frozen=True)
class Row:
    """A figure in `unit`; `most`: whether the target is an upper bound."""

    name: str
    value: float
    unit: str
    target: float | None = None
    beside: str = ""
    most: bool = True

    @property
    def met(self) -> bool:
        """Whether it is what it is to be."""
        if self.target is None:
            return True
        return self.value <= self.target if self.most else self.value >= self.target


# ---------------------------------------------------------------- whole processes


def processor_s(*words: str, turns: int = TURNS, cache: str = "") -> float:
    """Processor seconds of `python WORDS`, the median of several behind one that warms.

    Of an installed package: Python stores what it compiled, whatever this shell says.
    """
    environment = {**os.environ, **({"SOTER_CACHE": cache} if cache else {})}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    times = []
    for _ in range(turns + (turns > 1)):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, *words],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            check=True,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return statistics.median(times[turns > 1 :])


def many_nodes(count: int) -> str:
    """A program of so many nodes, each behind the one before."""
    lines = ["soter 1;", "input topic t0: float in [-1.0, 1.0] = 0.0;"]
    for i in range(count):
        lines += [
            f"topic t{i + 1}: float in [-1.0, 1.0] = 0.0;",
            f"node N{i} period 10ms {{ subscribes t{i}; publishes t{i + 1}; var s: float;",
            f"  step {{ s = 0.9 * s + 0.1 * t{i}; publish t{i + 1} = clamp(s, -1.0, 1.0); }} }}",
        ]
    nodes = " ".join(f"node N{i};" for i in range(count))
    return "\n".join([*lines, f"system S {{ {nodes} input t0 every 10ms; until 1s; }}", ""])


def commands() -> Iterator[Row]:
    """The command line."""
    drone = str(DRONE / "motion_primitive.soter")
    yield Row("check of motion_primitive.soter", processor_s(*SOTER, "check", drone), "s", 0.35)
    cart = str(EXAMPLES / "wall" / "cart.soter")
    yield Row("run of cart.soter, compiled before", processor_s(*SOTER, "run", cart), "s", 0.4)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "many.soter"
        path.write_text(many_nodes(NODES), encoding="utf-8")
        first = processor_s(*SOTER, "run", str(path), turns=1, cache=str(Path(folder) / "cache"))
        yield Row(f"first run of a program of {NODES:,} nodes", first, "s", 4.0)


def keystrokes() -> Iterator[Row]:
    """What the server computes for a key in the corridor, with all its imports."""
    path = DRONE / "corridor.soter"
    text = path.read_text(encoding="utf-8")
    at, reading, times = text.index("return ", len(text) // 2) + 7, Overlay(lambda _: None), []
    for k in range(4 * TURNS + 1):
        typed = text[:at] + " + WALLS_"[: k % 9] + text[at:]
        began = time.process_time()
        check_file(str(path), typed, reading=reading)
        times.append(time.process_time() - began)
    yield Row(
        "diagnostics after a key, corridor.soter", 1e3 * statistics.median(times[1:]), "ms", 80.0
    )


# ---------------------------------------------------------------- learning


def one(env: Any) -> Callable[[], object]:  # noqa: ANN401 - an environment
    """A thousand steps of one environment."""
    action = np.array([0.1], dtype=np.float32)
    env.reset(seed=1)

    def step() -> None:
        for _ in range(1000):
            _, _, ended, cut, _ = env.step(action)
            if ended or cut:
                env.reset(seed=1)

    return step


def protected_worlds(count: int, actions: Any) -> Callable[[], object]:  # noqa: ANN401 - an array
    """A step of so many worlds behind the module."""
    env = make_vec(CLIFF, count, copy=False)
    env.reset(seed=1)
    return lambda: env.step(actions)


def bare_worlds(count: int, actions: Any) -> Callable[[], object]:  # noqa: ANN401 - an array
    """The plant of the program in the same loop, its command from outside, no module."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bare.soter"
        path.write_text(BARE.format(cliff=CLIFF), encoding="utf-8")
        flat = soter.load(path).flat()
    driver, car = flat.component("Driver"), flat.component("car")
    topic = car.scope.topics[car.plant.drives[0][0]]  # type: ignore[union-attr]
    made = CompiledEnvironment(flat, Roles(driver.index), {}, [ObservedPart(topic)])
    worlds, nobody = BatchedStates(made, count), np.zeros(count, dtype=bool)
    worlds.seeds[:] = np.arange(count)
    worlds.begin_episodes(np.ones(count, dtype=bool))
    return lambda: worlds.step(actions, nobody)


def turns_of(ways: dict[str, Callable[[], object]], turns: int = 3 * TURNS) -> dict[str, float]:
    """Processor seconds of a call of each, in turns, medians."""
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(turns):
        for name, call in ways.items():
            began = time.process_time()
            call()
            times[name].append(time.process_time() - began)
    return {name: statistics.median(t) for name, t in times.items()}


def learning() -> Iterator[Row]:
    """Steps of environments."""
    program = soter.load(CLIFF)
    protected = Protected(program, cliff_env.make())
    took = turns_of({"bare": one(cliff_env.make()), "protected": one(protected)})
    over = took["protected"] / took["bare"]
    beside = f"{1e3 * took['protected']:.2f} us beside {1e3 * took['bare']:.2f} us bare"
    yield Row("a protected Gymnasium step / a bare one", over, "x", 2.0, beside)
    count = 4096
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 1))
    took = turns_of(
        {
            "protected": protected_worlds(count, actions),
            "bare": bare_worlds(count, actions),
        }
    )
    beside = f"the same plant and loop, bare: {count / took['bare'] / 1e6:.1f} M"
    yield Row(
        "steps of ProtectedVector, 4,096 worlds",
        count / took["protected"] / 1e6,
        "M/s",
        5.0,
        beside,
        most=False,
    )
    yield first_environment()


def first_environment() -> Row:
    """Of a cart whose DM reads 1.6 million cells, in a process that has made another one before."""
    text = (EXAMPLES / "wall" / "cart.soter").read_text(encoding="utf-8")
    text = re.sub(r"\n  (ttf|safer) [^;]*;", "", text)
    text = text.replace("/ 400", "/ 1600").replace("/ 320", "/ 1000")
    times = []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(3):  # another path is another program to a process, and not to the cache
            path = Path(folder) / str(k) / "cart.soter"
            path.parent.mkdir()
            path.write_text(text, encoding="utf-8")
            program = soter.load(path)
            began = time.process_time()
            Protected(program, cart_environment())
            times.append(time.process_time() - began)
    return Row("first environment, 1.6 M cells, compiled before", min(times[1:]), "s", 0.1)


def cart_environment() -> Any:  # noqa: ANN401 - of the tests
    """A cart before a wall."""
    path = ROOT / "tests" / "unit" / "gym" / "gym_cart.py"
    spec = importlib.util.spec_from_file_location("gym_cart", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Cart()


# ---------------------------------------------------------------- flights


def flights() -> Iterator[Row]:
    """The stack and its laps, one core."""
    flat = soter.load(DRONE / "campaign.soter").flat()
    length_s, count = 600, 4
    fleet = Fleet(faultless(flat), length_s * SECOND)
    took = turns_of({"stack": lambda: fleet.fly(range(count), first_seed=1), "loop": loop_s}, TURNS)
    hours_s = 104 * 3600 / (count * length_s / took["stack"])
    goal = TARGET_S * took["loop"] / LOOP_S
    beside = (
        f"{count} flights of {length_s} s, scaled up; goal: {TARGET_S:g} s where "
        f"Python's loop, {took['loop']:.3f} s here, takes {LOOP_S:g} s"
    )
    yield Row("104 h of the surveillance drone, one core", hours_s, "s", goal, beside)
    protected = soter.load(DRONE / "motion_primitive.soter").flat("Protected")
    alone, together = NativeProgram(protected), Fleet(protected, 14 * SECOND)
    count = 100
    took = turns_of(
        {
            "alone": lambda: [alone.run(14 * SECOND, k) for k in range(count)],
            "together": lambda: together.fly(range(count), first_seed=1),
        },
        TURNS,
    )
    speed = {name: count * 14 / took[name] for name in took}
    beside = f"a lap by itself: {speed['alone']:,.0f} x"
    yield Row(
        "laps of the drone, times real time", speed["together"], "x", 25_000.0, beside, most=False
    )


def main() -> int:
    """Measure and print; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parts: dict[str, Callable[[], Iterator[Row]]] = {
        "commands": commands,
        "keys": keystrokes,
        "learning": learning,
        "flights": flights,
    }
    parser.add_argument("--only", choices=sorted(parts), help="one part of it")
    given = parser.parse_args()
    rows: list[Row] = []
    for name, part in parts.items():
        if given.only in (None, name):
            print(f"measuring {name} ...", file=sys.stderr, flush=True)
            rows += part()
    shown = [(r.name, f"{r.value:,.3g} {r.unit}", target_of(r), met_of(r), r.beside) for r in rows]
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors; times are of processors")
    print(table(("figure", "measured", "target", "", "beside"), shown, color=False))
    print(ELSEWHERE)
    return 0 if all(r.met for r in rows) else 1


def target_of(row: Row) -> str:
    """The target, as it is shown."""
    if row.target is None:
        return ""
    return f"{'<=' if row.most else '>='} {row.target:,g} {row.unit}"


def met_of(row: Row) -> str:
    """Whether it is what it is to be, in a word."""
    if row.target is None:
        return ""
    return "met" if row.met else "missed"


if __name__ == "__main__":
    sys.exit(main())
