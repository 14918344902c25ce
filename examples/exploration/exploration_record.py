"""What a vehicle in an unknown space knew when, read off a run while it goes on.

Purpose: `fly` runs a system that has a map of known-free cells, and gives back when each cell
became known, the flight, and what it was let through. A trace would take 10 MB a second: `Watch`
sees every state, as a log does, and keeps little.
Non-goals: drawing (`exploration_page.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import soter
from soter.report.run.record import Decision

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
NEVER = np.iinfo(np.uint32).max
"""In place of a time: the cell did not become known."""
STEP_NS = 50_000_000
"""Of the flight, besides every change of mode."""
NEEDED = ("known", "walls", "flown", "way", "body")
"""Topics that are read, by their own names."""


@dataclass(frozen=True)
class Grid:
    """Where the cells lie: cell (i, j) of `count` x `count` has the number i count + j; in m."""

    count: int
    cell: float
    x0: float
    y0: float
    home: tuple[float, float]

    @property
    def side(self) -> float:
        """Of the square, m."""
        return self.count * self.cell

    @staticmethod
    def of_example() -> Grid:
        """The grid of grid.soter."""
        constant = soter.load(str(HERE / "grid.soter")).constant
        cell, x0, y0 = (float(constant(name)) for name in ("CELL", "X0", "Y0"))
        start = constant("START")
        return Grid(int(constant("N")), cell, x0, y0, (float(start.x), float(start.y)))


@dataclass(frozen=True)
class Boxes:
    """Rectangles that counted from `time_s` on; (k, 4): least x and y, greatest x and y, m."""

    time_s: float
    corners: NDArray[np.float64]


@dataclass(frozen=True)
class Tour:
    """Goals in their order, (k, 2) in m; from when on which was next, (s, number); the reached."""

    goals: NDArray[np.float64]
    next_goal: tuple[tuple[float, int], ...]
    reached: tuple[bool, ...]


class Watch:
    """Sees every state of a run: `log=Watch(topics)`, own name to full name of each topic."""

    problem = None

    def __init__(self, topics: dict[str, str], cells: int) -> None:
        self.known_ms = np.full(cells, NEVER, dtype=np.uint32)
        self.forgotten = False
        self.flown: list[Boxes] = []
        self.corridors: list[Boxes] = []
        self.next_goal: list[tuple[float, int]] = []
        self._topics = topics
        self._samples: list[dict[str, NDArray[Any]]] = []
        self._last: NDArray[Any] | None = None

    def begin(self, *_: object) -> None:
        """Nothing has to be opened."""

    def see(self, states: NDArray[Any], _changes: Sequence[object]) -> None:
        """The next states, (n,)."""
        first = self._last is None
        rows = states if first else np.concatenate([self._last, states])
        self._last = states[-1:].copy()
        self._see_cells(rows)
        self._see_boxes(rows, first=first)
        mode = rows["modules"]["mode"][:, 0]
        changed = np.concatenate([[False], mode[1:] != mode[:-1]])
        new = np.arange(len(rows)) >= (0 if first else 1)
        chosen = rows[new & (changed | (rows["header"]["ct"] % STEP_NS == 0))]
        self._samples.append(self._sampled(chosen))

    def end(self, _run: object, _why: str) -> None:
        """Keep the last state, too."""
        if self._last is not None:
            self._samples.append(self._sampled(self._last))

    def end_by(self, error: BaseException) -> None:
        """Nothing is to be kept."""

    def column(self, name: str) -> NDArray[Any]:
        """What was sampled, (n,) or (n, 2)."""
        return np.concatenate([part[name] for part in self._samples])

    def _topic(self, states: NDArray[Any], own_name: str) -> NDArray[Any]:
        values: NDArray[Any] = states["topics"][self._topics[own_name]]
        return values

    def _see_cells(self, rows: NDArray[Any]) -> None:
        known = self._topic(rows, "known") != 0
        self.forgotten |= bool((known[:-1] & ~known[1:]).any())
        new = np.flatnonzero(known[-1] & (self.known_ms == NEVER))
        first_row = known[:, new].argmax(axis=0)
        self.known_ms[new] = rows["header"]["ct"][first_row] // 1_000_000

    def _see_boxes(self, rows: NDArray[Any], *, first: bool) -> None:
        time_s = rows["header"]["ct"] / 1e9
        flown = corners(self._topic(rows, "flown")["block"])
        for i in _changed(flown, first=first):
            self.flown.append(Boxes(float(time_s[i]), flown[i : i + 1]))
        way = self._topic(rows, "way")
        for i in _changed(way["number"][:, np.newaxis], first=first):
            blocks = way["corridor"]["blocks"][i]
            boxes = corners(blocks["items"][: int(blocks["len"])])
            self.corridors.append(Boxes(float(time_s[i]), boxes))
        if "tour" in self._topics:
            number = self._topic(rows, "tour")["number"]
            for i in _changed(number[:, np.newaxis], first=first):
                self.next_goal.append((float(time_s[i]), int(number[i])))

    def _sampled(self, states: NDArray[Any]) -> dict[str, NDArray[Any]]:
        body = self._topic(states, "body")
        velocity = [body["v"][axis] for axis in "xyz"]
        return {
            "time_s": states["header"]["ct"] / 1e9,
            "position": np.stack([body["p"]["x"], body["p"]["y"]], axis=-1),
            "speed": np.linalg.norm(velocity, axis=0),
            "in_control": states["modules"]["mode"][:, 0] == 1,
        }


def _changed(rows: NDArray[Any], *, first: bool) -> list[int]:
    """Rows (n, k) that differ from the one before, and row 0 of the `first` ones."""
    changed = (np.flatnonzero((rows[1:] != rows[:-1]).any(axis=1)) + 1).tolist()
    return [0, *changed] if first else changed


def corners(blocks: NDArray[Any]) -> NDArray[np.float64]:
    """Boxes (k,) seen from above, (k, 4): least x and y, greatest x and y."""
    low, high = blocks["low"], blocks["high"]
    return np.stack([low["x"], low["y"], high["x"], high["y"]], axis=-1)


@dataclass(frozen=True)
class Exploration:
    """A run in an unknown space. (n,) are the samples: every 50 ms and where the mode changed."""

    program: soter.Program
    run: soter.Run
    grid: Grid
    topics: dict[str, str]
    known_ms: NDArray[np.uint32]
    """(count^2,): when each cell became known, `NEVER` where it did not."""
    time_s: NDArray[np.float64]
    position: NDArray[np.float64]
    speed: NDArray[np.float64]
    in_control: NDArray[np.bool_]
    flown: tuple[Boxes, ...]
    """The box in force, from each change on."""
    corridors: tuple[Boxes, ...]
    """What the surveyor let through, from each change on."""
    tour: Tour | None

    @property
    def module(self) -> soter.simulate.result.ModuleSummary:
        """What the only module did."""
        return next(iter(self.run.modules.values()))

    def last(self, topic: str) -> Any:  # noqa: ANN401 - a value of the program
        """The value of a topic, by its own name, at the end."""
        return self.run.final["topics"][self.topics[topic]]

    def share_known(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Which part of all cells was known at each time, (n,)."""
        known_s = np.sort(self.known_ms[self.known_ms != NEVER]) / 1000.0
        return np.searchsorted(known_s, time_s + 1e-9, side="right") / len(self.known_ms)

    def walls(self) -> NDArray[np.float64]:
        """The outlines of the walls, which no node reads: (k, 4, 2)."""
        walls = self.last("walls")
        w = walls["items"][: int(walls["len"])]
        along = np.stack([w["c"], w["s"]], axis=-1) * w["long"][:, np.newaxis]
        across = np.stack([-w["s"], w["c"]], axis=-1) * w["wide"][:, np.newaxis]
        middle = np.stack([w["x"], w["y"]], axis=-1)
        ends = (along + across, across - along, -along - across, along - across)
        return np.stack([middle + end for end in ends], axis=1)

    def decisions(self) -> tuple[Decision, ...]:
        """Every change of mode."""
        return tuple(
            Decision(d.time_ns / 1e9, d.module, d.after, d.reason, d.saw.predicates())
            for d in self.run.decisions
        )


def topics_of(program: soter.Program, system: str | None) -> dict[str, str]:
    """Own name to full name of each topic of a system; SoterError where there is none."""
    return {t.name.rsplit(".", 1)[-1]: t.name for t in program.flat(system).topics}


def fly(program: soter.Program, system: str | None, *, seed: int, until: str | None) -> Exploration:
    """Run a system of `program` whose topics include `NEEDED`.

    `until` is as `soter run` takes it, such as 120s. Raises SoterError for what cannot be
    run, RuntimeError where a known cell was forgotten.
    """
    topics, grid = topics_of(program, system), Grid.of_example()
    watch: Any = Watch(topics, grid.count**2)
    run = program.simulate(system, seed=seed, until=until, trace=False, sha256=False, log=watch)
    if watch.forgotten:
        raise RuntimeError("a cell that was known became unknown: the map does not only grow")
    tour = _tour(topics, run, watch) if "tour" in topics else None
    return Exploration(
        program,
        run,
        grid,
        topics,
        watch.known_ms,
        time_s=watch.column("time_s"),
        position=watch.column("position"),
        speed=watch.column("speed"),
        in_control=watch.column("in_control"),
        flown=tuple(watch.flown),
        corridors=tuple(watch.corridors),
        tour=tour,
    )


def _tour(topics: dict[str, str], run: soter.Run, watch: Watch) -> Tour:
    """The goals of paper.soter, which stand beside its topic `tour`."""
    constant = soter.load(str(HERE / "paper.soter")).constant
    goals = np.array([[g.x, g.y] for g in constant("GOALS")])
    reached = run.final["topics"][topics["tour"]]["reached"]
    return Tour(goals, tuple(watch.next_goal), tuple(bool(r) for r in reached))
