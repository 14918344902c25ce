"""Docking in one, two and three directions: Soter's shields and run-time-assurance's filters.

    python -m venv PEER && PEER/bin/pip install run-time-assurance==1.18.6
    .venv/bin/python bench/running/docking_peer.py --peer PEER/bin/python [--flights N]

Purpose: the same craft, the same ACs, the same period: how much of the time all that acts is
AC's, and for how long a flight is outside of the constraint of their zoo, seen ten times a period.
Disturbances and errors are drawn within the bounds of the proofs; ours read what is measured,
theirs that and the truth. Exit code 1 where one of ours leaves the constraint, or where an AC that
respects it has a smaller share than theirs: on a line with a shield, else with one limit for all
directions (docking_together.soter). A limit for each direction (docking_orbit.soter) is told, too.
Non-goals: time (`simplex_peer.py`).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from soter.gym import Protected

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]
PERIOD, LOOKS = 0.1, 10
"""s; a period is seen so many times."""
N, MASS, V0 = 0.001027, 12.0, 0.2
LINE = "bench/adversary/docking.soter"
ORBIT = "bench/running/docking_orbit.soter"
TOGETHER = "bench/running/docking_together.soter"
ORDERS: dict[int, Callable[[Array], dict[str, Any]]] = {
    2: lambda u: {"asked": {"x": u[0], "y": u[1], "brake": 0.0}},
    3: lambda u: {"wished": {"x": u[0], "y": u[1], "z": u[2], "brake": 0.0}},
}
"""AC's outputs in TOGETHER: it never asks for `brake`, which is SC's."""
WAYPOINT_S = {1: 15.0, 2: 150.0, 3: 150.0}
PEER = """
import json, sys
import numpy as np
from run_time_assurance.zoo.cwh import docking_2d, docking_3d
from run_time_assurance.zoo.integrators import integrator_1d
made = {
    "explicit 1": lambda: integrator_1d.Integrator1dDockingExplicitSwitchingRTA(),
    "explicit 2": lambda: docking_2d.Docking2dExplicitSwitchingRTA(),
    "explicit 3": lambda: docking_3d.Docking3dExplicitSwitchingRTA(),
    "implicit 1": lambda: integrator_1d.Integrator1dDockingImplicitSwitchingRTA(),
    "implicit 2": lambda: docking_2d.Docking2dImplicitSwitchingRTA(integration_method="Euler"),
    "implicit 3": lambda: docking_3d.Docking3dImplicitSwitchingRTA(integration_method="Euler"),
}
for line in sys.stdin:
    asked = json.loads(line)
    if isinstance(asked, str):
        rta = made[asked]()
        rta.reset()
        print(json.dumps(getattr(rta, "v1", 0.0)), flush=True)
        continue
    state, wish = (np.array(x) for x in asked)
    u = rta.filter_control(state, 0.1, wish)
    print(json.dumps([[float(x) for x in np.atleast_1d(u)], bool(rta.intervening)]), flush=True)
"""


@dataclass(frozen=True)
class Task:
    """Directions; the greatest command in m/s^2, and how many of their units that is; v1 in 1/s."""

    directions: int
    greatest: float
    unit: float
    v1: float
    program: str
    system: str
    places: tuple[float, float]
    """In m: how near to the chief AC goes, and how far out it starts at most."""
    errors: tuple[float, float]
    """Of a place and a speed, in m and m/s."""
    push: float
    """The greatest disturbance, m/s^2."""
    below: float = 0.8
    """Of the limit, that an AC that respects it goes up to."""


TASKS = {
    1: Task(
        1, 1.0, 1.0, 0.0, "bench/adversary/docking.soter", "Loop", (0.6, 5.0), (0.01, 0.01), 0.02
    ),
    2: Task(2, 1 / MASS, MASS, 2 * N, ORBIT, "InPlaneOrbit", (0.0, 55.0), (0.05, 0.002), 0.0002),
    3: Task(3, 1 / MASS, MASS, 4 * N, ORBIT, "InSpaceOrbit", (0.0, 55.0), (0.05, 0.002), 0.0002),
}


# ---------------------------------------------------------------- the craft


def motion(task: Task) -> tuple[Array, Array]:
    """(A, B) of x' = A x + B u, positions first."""
    d = task.directions
    a, b = np.zeros((2 * d, 2 * d)), np.zeros((2 * d, d))
    a[:d, d:], b[d:] = np.eye(d), np.eye(d)
    if d > 1:
        a[d, 0], a[d, d + 1], a[d + 1, d] = 3 * N * N, 2 * N, -2 * N
    if d > 2:
        a[d + 2, 2] = -N * N
    return a, b


def held(task: Task, seconds: float) -> tuple[Array, Array]:
    """The exact step under a command that is held."""
    a, b = motion(task)
    n, m = b.shape
    both = np.zeros((n + m, n + m))
    both[:n, :n], both[:n, n:] = a * seconds, b * seconds
    term = total = np.eye(n + m)
    for k in range(1, 20):
        term = term @ both / k
        total = total + term
    return total[:n, :n], total[:n, n:]


def outside(task: Task, state: Array) -> bool:
    """Whether the constraint of their zoo is broken."""
    d = task.directions
    if d == 1:
        return bool(state[0] > 0.0)
    r, v = np.linalg.norm(state[:d]), np.linalg.norm(state[d:])
    return bool(v > V0 + task.v1 * r)


class Craft(gymnasium.Env[Any, Any]):
    """The craft: state and command in m, m/s, m/s^2; counts at how many looks it was outside."""

    def __init__(self, task: Task) -> None:
        n, u = 2 * task.directions, task.greatest
        self.task, self.step_matrices = task, held(task, PERIOD / LOOKS)
        self.action_space = gymnasium.spaces.Box(-u, u, (task.directions,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (n,), np.float64)
        self.state, self.left = np.zeros(n), 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:  # noqa: ANN401
        """At rest, somewhere."""
        super().reset(seed=seed, options=options)
        d, (_, far) = self.task.directions, self.task.places
        self.state, self.left = np.zeros(2 * d), 0
        self.state[:d] = self.np_random.uniform(-far, far, d) if d > 1 else -far
        return self.state.copy(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """A period."""
        a, b = self.step_matrices
        u = np.clip(np.asarray(action, dtype=np.float64), -self.task.greatest, self.task.greatest)
        push = self.np_random.uniform(-self.task.push, self.task.push, self.task.directions)
        for _ in range(LOOKS):
            self.state = a @ self.state + b @ (u + push)
            self.left += outside(self.task, self.state)
        return self.state.copy(), 0.0, False, False, {}


# ---------------------------------------------------------------- ACs


def towards(task: Task, goal: Array, state: Array, limit: Array) -> Array:
    """A command for a speed along each direction: below its limit, and so that it can stop."""
    d, u = task.directions, task.greatest
    left = goal - state[:d]
    wanted = np.sign(left) * np.minimum(limit, np.sqrt(1.2 * u * np.abs(left)))
    return np.asarray(np.clip(5.0 * (wanted - state[d:]), -u, u))


def each(task: Task, r: Array) -> Array:
    """The limit of each direction alone; on a line there is none."""
    if task.directions == 1:
        return np.full(1, np.inf)
    return np.asarray(V0 / np.sqrt(task.directions) + task.v1 * np.abs(r))


def together(task: Task, goal: Array, r: Array) -> Array:
    """The limit of all directions, on the straight way to the goal."""
    way = np.abs(goal - r)
    speed = V0 + task.v1 * np.linalg.norm(r)
    return np.asarray(speed * way / max(float(np.linalg.norm(way)), 1e-9))


EACH, ALL = "ours, each direction, shield 8", "ours, all directions, speed"
AGENTS = ("near-optimal", "on a straight line", "pushes", "anything")
"""Below the limit of each direction, below that of all together; the last two know none."""


def wish(task: Task, name: str, state: Array, goal: Array, rng: np.random.Generator) -> Array:
    """What an AC would do."""
    d, u = task.directions, task.greatest
    if name == "near-optimal":
        return towards(task, goal, state, task.below * each(task, state[:d]))
    if name == "on a straight line":
        return towards(task, goal, state, task.below * together(task, goal, state[:d]))
    if name == "pushes":
        return u * np.where(goal > state[:d], 1.0, -1.0)
    return rng.uniform(-u, u, d)


def goals(task: Task, rng: np.random.Generator) -> Iterator[Array]:
    """There and back."""
    near, far = task.places
    while True:
        if task.directions == 1:
            yield np.array([-near])
            yield np.array([-far])
        else:
            yield np.zeros(task.directions)
            yield rng.uniform(-far, far, task.directions)


# ---------------------------------------------------------------- who decides


class Theirs:
    """One of their filters, in a process of its own."""

    def __init__(
        self, peer: subprocess.Popen[str], kind: str, task: Task, *, measured: bool
    ) -> None:
        self.peer, self.kind, self.task, self.measured = peer, kind, task, measured
        self.craft = Craft(task)

    def fly(self, seed: int) -> tuple[Array, Callable[[Array], tuple[Array, bool]]]:
        """A state, and what a wish makes of it: (the next state, whether AC's command acted)."""
        v1 = self._asked(f"{self.kind} {self.task.directions}")
        assert abs(v1 - self.task.v1) < 1e-12, "their constraint is another one"
        state, _ = self.craft.reset(seed=seed)
        at = [state]
        rng = np.random.default_rng([seed, 1])
        errors = np.repeat(self.task.errors, self.task.directions) * self.measured

        def step(wish: Array) -> tuple[Array, bool]:
            seen = at[0] + rng.uniform(-errors, errors)
            u, theirs = self._asked([list(seen), list(wish * self.task.unit)])
            at[0], *_ = self.craft.step(np.array(u) / self.task.unit)
            return at[0], not theirs

        return state, step

    def _asked(self, what: object) -> Any:  # noqa: ANN401
        assert self.peer.stdin is not None
        assert self.peer.stdout is not None
        self.peer.stdin.write(json.dumps(what) + "\n")
        self.peer.stdin.flush()
        return json.loads(self.peer.stdout.readline())


class Ours:
    """A module in front of the craft; it reads what is measured."""

    def __init__(self, craft: Craft, env: Protected) -> None:
        self.craft, self.env = craft, env

    @classmethod
    def of_each(cls, task: Task, folder: Path, *, shield: bool) -> Ours:
        """A limit for each direction, with a shield or without."""
        text = (ROOT / task.program).read_text("utf-8").replace("  shield 8;\n", "")
        if shield:
            text = text.replace("  verify {", "  shield 8;\n  verify {")
        text = text.replace("plant Line period 50ms", "plant Line period 100ms")
        path = folder / f"{task.system}_{shield}.soter"
        path.write_text(text, "utf-8")
        craft = Craft(task)
        return cls(craft, Protected(path, craft, system=task.system, measured=True))

    @classmethod
    def of_all(cls, task: Task, *, grid: bool = False) -> Ours:
        """One limit for all directions: of the speed, or of the velocity on a grid."""
        craft = Craft(task)
        how: dict[str, Any] = {"system": "InPlaneOnGrid" if grid else task.system}
        if not grid:
            how |= {"act": ORDERS[task.directions], "action_space": craft.action_space}
        return cls(craft, Protected(ROOT / TOGETHER, craft, measured=True, **how))

    def fly(self, seed: int) -> tuple[Array, Callable[[Array], tuple[Array, bool]]]:
        """As `Theirs.fly`."""
        state, _ = self.env.reset(seed=seed)

        def step(wish: Array) -> tuple[Array, bool]:
            after, _, _, _, info = self.env.step(wish)
            return after, not info["intervened"]

        return state, step


def flown(
    who: Theirs | Ours, task: Task, name: str, flights: int, seconds: float
) -> tuple[float, float, int]:
    """(share of AC, share of looks outside of the constraint, flights that were there)."""
    count = round(seconds / PERIOD)
    steps = counted = lost = gone = 0
    for seed in range(flights):
        rng = np.random.default_rng([seed, task.directions])
        state, step = who.fly(seed)
        ways = goals(task, rng)
        goal = next(ways)
        for k in range(count):
            if k and k % round(WAYPOINT_S[task.directions] / PERIOD) == 0:
                goal = next(ways)
            state, mine = step(wish(task, name, state, goal, rng))
            counted += mine
        steps += count
        lost += who.craft.left
        gone += who.craft.left > 0
    return counted / steps, lost / (steps * LOOKS), gone


def main() -> int:
    """Fly; 1 where something is missed, 2 without the peer."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--peer", default=sys.executable, help="a Python with run-time-assurance")
    parser.add_argument("--flights", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--directions", type=int, nargs="*", default=[1, 2, 3])
    parser.add_argument("--below", type=float, default=0.8, help="how near an AC comes to a limit")
    parser.add_argument("--implicit", action="store_true", help="their slower filters, too")
    said = parser.parse_args()
    there = [said.peer, "-c", "import run_time_assurance"]
    if subprocess.run(there, capture_output=True, check=False).returncode:
        print(f"`{said.peer}` has no run-time-assurance: see --help of this file")
        return 2
    print("| directions | AC | filter | AC's share | time outside | flights outside |")
    print("|---|---|---|---|---|---|")
    missed = 0
    how: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen([said.peer, "-c", PEER], **how) as peer,
    ):
        for d in said.directions:
            missed += _directions(replace(TASKS[d], below=said.below), Path(folder), peer, said)
        assert peer.stdin is not None
        peer.stdin.close()
    print(f"{missed} missed")
    return 1 if missed else 0


def _directions(
    task: Task, folder: Path, peer: subprocess.Popen[str], said: argparse.Namespace
) -> int:
    """A line for every AC and filter; how many of ours are worse than theirs."""
    kinds = ["explicit", *(["implicit"] if said.implicit else [])]
    others: dict[str, Theirs | Ours] = {
        f"theirs, {k}, {'measured' if m else 'the truth'}": Theirs(peer, k, task, measured=m)
        for k in kinds
        for m in (False, True)
    }
    ours = {
        "ours, each direction, state alone": Ours.of_each(task, folder, shield=False),
        EACH: Ours.of_each(task, folder, shield=True),
    }
    if task.directions > 1:
        ours[ALL] = Ours.of_all(task)
    if task.directions == 2:
        ours["ours, all directions, grid"] = Ours.of_all(task, grid=True)
    kept = {ALL, "ours, all directions, grid"} if task.directions > 1 else {EACH}
    missed = 0
    for name in (a for a in AGENTS if task.directions > 1 or a != AGENTS[1]):
        best = 0.0
        for filtered, who in (others | ours).items():
            share, lost, gone = flown(who, task, name, said.flights, said.seconds)
            print(
                f"| {task.directions} | {name} | {filtered} | {share:.2%} | {lost:.3%} "
                f"| {gone} of {said.flights} |",
                flush=True,
            )
            if isinstance(who, Theirs):
                best = max(best, share)
            else:
                missed += bool(gone) or (filtered in kept and name in AGENTS[:2] and share < best)
    return missed


if __name__ == "__main__":
    sys.exit(main())
