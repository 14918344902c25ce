"""RRTConnect from OMPL in the known map, as an extern node: a planner that nobody can certify.

Purpose: a way from cell to cell through what is known to be free, from the real library; lengths
are sides of cells, counted from the corner of the map. It is seeded by the run and the request's
number and stopped by iterations, so the same run gives the same ways.
Non-goals: where to fly (`Chooser`), boxes (`Boxed`), safety: mapper.soter trusts nothing that
comes from here.

Without OMPL every step faults with a hint.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np

try:
    from ompl import base, geometric, util
except ImportError:  # no wheel for this machine, or not installed
    base = None

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Point = tuple[float, float]
    Cells = NDArray[np.bool_]

STEP = 0.25  # between two places of a motion that are looked at
ITERATIONS = 4000
REACH = 15.0  # the longest branch of a tree
POINTS = 32  # the longest plan that can be published
ABSENT = "OMPL is not installed, so there is no RRTConnect: pip install 'soter-rta[demo]'"


def places(known: Cells, room: int) -> Cells:
    """Cells with `room` known ones on each side, diagonally too; known: (n, n)."""
    n, w = len(known), 2 * room + 1
    sums = np.pad(known.astype(np.int64).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    fits = np.zeros_like(known)
    counts = sums[w:, w:] - sums[:-w, w:] - sums[w:, :-w] + sums[:-w, :-w]
    fits[room : n - room, room : n - room] = counts == w * w
    return fits


class Room:
    """Where the planner believes that the middle of the vehicle may be; fits: (n, n)."""

    def __init__(self, fits: Cells) -> None:
        self.fits = fits
        self.side = len(fits)

    def clear(self, a: Point, b: Point) -> bool:
        """Whether it may be at all places of a motion, at most STEP apart."""
        count = math.ceil(math.dist(a, b) / STEP) + 1
        i, j = (np.linspace(*ends, count).astype(int) for ends in zip(a, b, strict=True))
        at = np.clip(i, 0, self.side - 1), np.clip(j, 0, self.side - 1)
        return bool(self.fits[at].all())


def _motion_validator(info: Any, room: Room) -> Any:  # noqa: ANN401 - OMPL has no types
    class Looked(base.MotionValidator):  # type: ignore[misc, name-defined]
        """Asks the room."""

        def checkMotion(self, a: Any, b: Any, *_: Any) -> bool:  # noqa: ANN401, N802 - OMPL's name
            return room.clear((a[0], a[1]), (b[0], b[1]))

    return Looked(info)


def _after(iterations: int) -> Callable[[], bool]:
    """True from so many questions on: no clock is read."""
    asked = itertools.count(1)
    return lambda: next(asked) > iterations


def rrt_connect(room: Room, ends: tuple[Point, Point], seed: int) -> list[Point]:
    """A way of OMPL's, ends included, shortened; empty: it found none. Seed 1 to 2^32 - 1."""
    if base is None:
        raise RuntimeError(ABSENT)
    util.setLogLevel(util.LogLevel.LOG_NONE)  # it warns of every seed after the first
    util.RNG.setSeed(seed)
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for k in range(2):
        bounds.setLow(k, 0.0)
        bounds.setHigh(k, room.side)
    space.setBounds(bounds)
    info = base.SpaceInformation(space)
    info.setStateValidityChecker(lambda s: room.clear((s[0], s[1]), (s[0], s[1])))
    info.setMotionValidator(_motion_validator(info, room))
    info.setup()
    states = [space.allocState() for _ in ends]
    for state, p in zip(states, ends, strict=True):
        state[0], state[1] = p
    problem = base.ProblemDefinition(info)
    problem.setStartAndGoalStates(*states, 1e-3)
    planner = geometric.RRTConnect(info)
    planner.setProblemDefinition(problem)
    planner.setRange(REACH)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(_after(ITERATIONS)))
    if not problem.hasExactSolution():
        return []
    path = problem.getSolutionPath()
    geometric.PathSimplifier(info).reduceVertices(path)
    return [(path.getState(i)[0], path.getState(i)[1]) for i in range(path.getStateCount())]


class RRTConnect:
    """The node: answers each new request once. Request and plan are those of rrt_connect.soter."""

    def __init__(self) -> None:
        self.reset(1)

    def reset(self, seed: int) -> None:
        """Forget; ways depend on `seed` and the number of the request."""
        self.seed = seed
        self.answered = 0

    def step(self, inputs: Any) -> dict[str, Any] | None:  # noqa: ANN401 - soter's record
        """The next plan, or nothing where there is no new request, or no way."""
        if base is None:
            raise RuntimeError(ABSENT)
        request = inputs.request
        if request.number == self.answered:
            return None
        self.answered = request.number
        known = np.array(inputs.known, dtype=bool)
        side = math.isqrt(len(known))
        room = Room(places(known.reshape(side, side), request.room))
        start, goal = ((c // side + 0.5, c % side + 0.5) for c in (request.start, request.goal))
        seed = (self.seed * 1_000_003 + self.answered * 7919) % (2**32 - 1) + 1
        points = rrt_connect(room, (start, goal), seed)
        if not points or len(points) > POINTS:
            return None
        return {"plan": {"number": request.number, "points": points}}
