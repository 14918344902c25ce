"""How large the seeded bugs of `falsify.py` are: by directed schedules, written by hand.

    .venv/bin/python bench/testing/falsify_directed.py [--only TEXT] [--check] [--json FILE]

The rule stands in `falsify_models.py`. Per bug: its size, and the steps of the shortest
directed execution that shows it. `--check`: the programs with bugs of size 0, which no directed
schedule violates. Nothing of `falsify` is run, nor of any other strategy: the engine follows the
schedule (`explore/engine/guided_execution.py`).
Purpose: sizes that do not depend on what is measured. Non-goals: the measurement.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(p) for p in (ROOT,) if str(p) not in sys.path]

from bench.testing.falsify_models import BUGS, Bug  # noqa: E402 - needs the path

import soter  # noqa: E402 - after the path
from soter.explore.engine.explorer_library import Engine  # noqa: E402 - the same
from soter.explore.engine.guided_execution import BIRTH, NOBODY, STEP  # noqa: E402 - the same
from soter.language.front_end import system_of_test  # noqa: E402 - the same
from soter.semantics.random.random_draws import fnv  # noqa: E402 - the same

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from soter.language.model.system import System

EXAMPLES = ROOT / "examples"
SIZES = Path(__file__).with_name("falsify_sizes.json")
RATIO = 1.1
PARTS = 4
"""Of a rung of the coarse ladder."""
RUNGS = 60
GRID = 12
"""Times of each of two switches."""
MIDDLE, LOW, HIGH = range(3)
"""Alternatives of a float in an interval (docs/testing.md)."""


@dataclass(frozen=True)
class Border:
    """A border of a subject: the axis (of AC's choices, in their order) and the side of it.

    `towards`, `away`, `coast`: AC's alternatives on this axis. `pushes`: streams of disturbances,
    `shows`: streams of measurement errors on this axis.
    """

    axis: int
    high: bool
    towards: int
    away: int
    coast: int
    pushes: tuple[str, ...]
    shows: tuple[str, ...]


def _borders(
    axes: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...], up: int, down: int, rest: int
) -> tuple[Border, ...]:
    return tuple(
        Border(i, high, up if high else down, down if high else up, rest, pushes, shows)
        for i, (pushes, shows) in enumerate(axes)
        for high in (True, False)
    )


def _drone(axis: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return (f"t.d.{axis}",), (f"t.drone.tubeState.p.{axis}", f"t.drone.tubeState.v.{axis}")


BORDERS = {
    "cart": _borders(((("c.wind",), ("c.cart.motion.x", "c.cart.motion.v")),), 0, 1, 1),
    "pendulum": _borders(((("p.wind",), ("p.arm.arm.angle", "p.arm.arm.rate")),), 1, 2, 0),
    "rendezvous": _borders(
        tuple(
            (("c.push",), (f"c.orbit.relative.{a}", f"c.orbit.relative.v{a}")) for a in ("x", "y")
        ),
        1,
        2,
        0,
    ),
    "drone": _borders(tuple(_drone(a) for a in ("x", "y", "z")), 1, 2, 0),
}
AXES = {"cart": 1, "pendulum": 1, "rendezvous": 2, "drone": 3}
WAYS = {"cart": 2, "pendulum": 3, "rendezvous": 3, "drone": 3}
"""Alternatives of AC on each axis."""


@dataclass(frozen=True)
class World:
    """What the world does throughout: the border, who pushes and who shows what.

    `pushes`: disturbances push towards the border; `shows`: of each measurement error whether it
    shows the state further from the border than it is.
    """

    border: Border
    pushes: bool
    shows: tuple[bool, ...]
    plant_last: bool


@dataclass(frozen=True)
class Schedule:
    """AC's alternatives on the axis, one for each of its releases.

    Whoever may be late is punctual before its release `late`, and then as late as possible.
    """

    world: World
    moves: tuple[int, ...]
    late: int = 0


def worlds(borders: Sequence[Border]) -> Iterator[World]:
    """All of them, those that look worst first."""
    for pushes in (True, False):
        for number in range(4):
            for border in borders:
                shows = (not number & 1, not number & 2)[: len(border.shows)]
                for plant_last in (False, True):
                    yield World(border, pushes, shows, plant_last)


def courses(border: Border, n: int) -> Iterator[tuple[int, ...]]:
    """What AC does at its n releases: one switch at any time, two on a grid, or to and fro."""
    to = border.towards
    for first in (border.away, to):
        for one in range(n if first != to else 1):
            yield (first,) * one + (to,) * (n - one)
        for second in sorted({border.coast, border.away} - {first}):
            for i in range(1, GRID):
                for k in range(i + 1, GRID):
                    one, two = i * n // GRID, k * n // GRID
                    yield (first,) * one + (second,) * (two - one) + (to,) * (n - two)
        other = border.away if first == to else to
        for half in range(1, n // 3):
            yield tuple(first if i // half % 2 == 0 else other for i in range(n))


def schedules(borders: Sequence[Border], n: int, late: int) -> Iterator[Schedule]:
    """The family; n releases of AC before the horizon, `late` of who may be late, 0: nobody."""
    if not late:
        for world in worlds(borders):
            for moves in courses(world.border, n):
                yield Schedule(world, moves)
        return
    for border in borders:
        world = World(border, pushes=True, shows=(True,) * len(border.shows), plant_last=False)
        for since in range(late):
            for first in (border.away, border.coast):
                for i in range(GRID):
                    one = i * n // GRID
                    moves = (first,) * one + (border.towards,) * (n - one)
                    yield Schedule(world, moves, since)


class Course:
    """One program with a bug of some size, and the directed schedules of it."""

    def __init__(self, system: System, subject: str) -> None:
        self.engine = Engine(system)
        self.subject = subject
        (prop,) = [p for p in system.properties if p.component is None]
        self._actors = self.engine.actors
        (self._ac,) = [i for i, a in enumerate(self._actors) if a.name.endswith(".Anything")]
        (self._plant,) = [
            i
            for i, a in enumerate(self._actors)
            if a.component is not None and system.components[a.component].plant is not None
        ]
        assert system.test is not None
        self._horizon = system.test.horizon_ns
        self.releases = self._count(self._ac)
        late = [i for i, a in enumerate(self._actors) if a.window_ns]
        assert len(late) <= 1, late
        self._tardy = late[0] if late else None
        self.late = 0 if self._tardy is None else self._count(self._tardy)
        rows = [
            (a.phase_ns + k * a.period_ns, i)
            for i, a in enumerate(self._actors)
            for k in range(self._count(i))
        ]
        self._calendar = np.array(rows, dtype=np.int64)
        """(steps, 2): release in ns, actor."""
        n = len(rows) + 1
        self._wish, self._made = np.zeros(n, dtype=STEP), np.zeros(n, dtype=STEP)
        self._unusual = np.zeros(n, dtype=np.uint32)
        self._ordered: tuple[bool, int] | None = None
        self._worldly: World | None = None
        ffi = self.engine.ffi
        self._guide = ffi.new(
            "soter_guide *",
            {
                "seed": 1,
                "wanted": {"what": 0, "index": prop.index},
                "wish": ffi.cast("soter_trace_step *", self._wish.ctypes.data),
                "length": n,
                "limit": n,
                "made": ffi.cast("soter_trace_step *", self._made.ctypes.data),
                "unusual": ffi.cast("uint32_t *", self._unusual.ctypes.data),
            },
        )

    def _count(self, actor: int) -> int:
        a = self._actors[actor]
        return (self._horizon - a.phase_ns) // a.period_ns + 1

    def _order(self, plant_last: bool, late: int) -> None:
        """All steps in their order, no choice made."""
        release, actor = self._calendar[:, 0], self._calendar[:, 1]
        time = release.copy()
        if self._tardy is not None:
            a = self._actors[self._tardy]
            number = (release - a.phase_ns) // a.period_ns
            time[(actor == self._tardy) & (number >= late)] += a.window_ns
        order = np.lexsort((actor, (actor == self._plant) & plant_last, time))
        wish = self._wish
        wish["choices"] = 0
        wish[0]["actor"], wish[0]["kind"], wish[0]["release"] = NOBODY, BIRTH, -1
        wish["actor"][1:], wish["release"][1:] = actor[order], release[order]
        wish["time"][1:] = time[order]
        self._ac_rows = np.flatnonzero(wish["actor"] == self._ac)
        ac = self._actors[self._ac]
        for axis in range(AXES[self.subject]):
            self._answer(self._ac_rows, axis, ac.name + ".choose", WAYS[self.subject], 0)
        wish["choices"][self._ac_rows] = AXES[self.subject]

    def _answer(
        self, rows: npt.NDArray[np.intp], number: int, stream: str, count: int, pick: int
    ) -> None:
        choice = self._wish["choice"]
        choice["stream"][rows, number] = fnv(stream)
        choice["count"][rows, number] = count
        choice["pick"][rows, number] = pick

    def _set_world(self, world: World) -> None:
        """What the plant answers: disturbances first, then errors, as it asks."""
        rows = np.flatnonzero(self._wish["actor"] == self._plant)
        border = world.border
        there, back = (HIGH, LOW) if border.high else (LOW, HIGH)
        picks = [(n, there if world.pushes else back) for n in border.pushes]
        shown = zip(border.shows, world.shows, strict=True)
        picks += [(n, back if far else there) for n, far in shown]
        for i, (name, pick) in enumerate(picks):
            self._answer(rows, i, name, 3, pick)
        self._wish["choices"][rows] = len(picks)

    def run(self, s: Schedule) -> int:
        """Steps of its execution, the start aside, to the violation; 0: there is none."""
        if (s.world.plant_last, s.late) != self._ordered:
            self._order(s.world.plant_last, s.late)
            self._ordered, self._worldly = (s.world.plant_last, s.late), None
        if s.world != self._worldly:
            self._set_world(s.world)
            self._worldly = s.world
        axis = s.world.border.axis
        self._wish["choice"]["pick"][self._ac_rows, axis] = s.moves
        violates = self.engine.ffi.new("bool *")
        lib = self.engine.lib
        made = int(lib.soter_explore_guided(self.engine.model, self._guide, violates))
        return made - 1 if violates[0] else 0

    def close(self) -> None:
        """Give its memory back."""
        self.engine.close()


def written(bug: Bug, size: float, folder: Path) -> Path:
    """The program with a bug of this size and its test; the file of the test."""
    subject = bug.subject
    source = EXAMPLES / subject.file
    shutil.copytree(source.parent, folder, dirs_exist_ok=True)
    text, test = source.read_text(encoding="utf-8"), subject.test
    for old, new in subject.changes:
        text = _changed(text, old, new)
    if bug.in_test:
        test = _changed(test, bug.old, bug.of_size(size)) if size > 0.0 else test
    else:
        text = _changed(text, bug.old, bug.of_size(size))
    (folder / source.name).write_text(text, encoding="utf-8")
    place = folder / "bug.soter"
    place.write_text(test, encoding="utf-8")
    return place


def _changed(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"{text.count(old)} times {old!r}"
    return text.replace(old, new)


def course(bug: Bug, size: float) -> Course:
    """The bug of this size, ready to run."""
    with tempfile.TemporaryDirectory() as folder:
        program = soter.load(written(bug, size, Path(folder)))
        return Course(system_of_test(program._checked, "Bug", {}), bug.subject.name)  # noqa: SLF001


def violating(
    bug: Bug, size: float, borders: Sequence[Border], first: Schedule | None
) -> Schedule | None:
    """A schedule that violates the property, `first` tried first; None: none does."""
    on = course(bug, size)
    try:
        if first is not None and on.run(first):
            return first
        return next((s for s in schedules(borders, on.releases, on.late) if on.run(s)), None)
    finally:
        on.close()


def shortest(bug: Bug, size: float, borders: Sequence[Border]) -> tuple[int, float]:
    """Steps of the shortest directed execution to a violation; the share of schedules with one."""
    on = course(bug, size)
    try:
        lengths = [on.run(s) for s in schedules(borders, on.releases, on.late)]
    finally:
        on.close()
    return min(n for n in lengths if n), sum(n > 0 for n in lengths) / len(lengths)


def descend(
    bug: Bug, size: float, ratio: float, borders: Sequence[Border]
) -> tuple[list[float], Schedule]:
    """The sizes from `size` on, divided by `ratio` each time, until none is violated."""
    sizes: list[float] = []
    last: Schedule | None = None
    for _ in range(RUNGS):
        schedule = violating(bug, size, borders, last)
        if schedule is None:
            assert last is not None, f"{bug.name}: not violated at {size}"
            return sizes, last
        last = schedule
        sizes.append(size)
        size /= ratio
    msg = f"{bug.name}: violated at every size"
    raise AssertionError(msg)


def sized(bug: Bug) -> dict[str, object]:
    """The size of a bug, by the rule, and the steps of the shortest directed execution."""
    coarse, last = descend(bug, bug.largest, RATIO, BORDERS[bug.subject.name])
    borders = [last.world.border]
    fine, _ = descend(bug, coarse[-1], RATIO ** (1 / PARTS), borders)
    least = fine[-1]
    size = least * RATIO ** (1 / PARTS)
    steps, share = shortest(bug, size, borders)
    return {"size": size, "least": least, "written": bug.of_size(size).strip(),
            "directed_steps": steps, "share_of_schedules": share}  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Write the sizes; with `--check` 0 if nothing is violated without bugs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="programs and kinds of bugs with this text")
    parser.add_argument("--check", action="store_true", help="bugs of size 0")
    parser.add_argument("--json", type=Path, default=SIZES)
    args = parser.parse_args(argv)
    known = json.loads(args.json.read_text(encoding="utf-8")) if args.json.exists() else {}
    wrong = 0
    for bug in BUGS:
        if args.only not in bug.name:
            continue
        if args.check:
            none = violating(bug, 0.0, BORDERS[bug.subject.name], None) is None
            wrong += not none
            print(
                f"{bug.name:<44} {'clean' if none else 'VIOLATED'} by directed schedules",
                flush=True,
            )
            continue
        known[bug.name] = sized(bug)
        print(f"{bug.name:<44} {known[bug.name]}", flush=True)
        args.json.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
