"""RRT* from OMPL as an extern node: the planner that nobody can certify.

Purpose: a plan for a request, from the real library. It is seeded by the run and the request's
number and stopped by iterations, so the same run gives the same plans. States and motions are
checked exactly, against buildings grown by the clearance that is asked for; OMPL's own check,
which samples a motion, is never used.
Non-goals: safety: the follower (planner.soter) trusts nothing that comes from here. Bugs can be
put in by name.

Without OMPL every step faults with a hint, and the module's SC, the roadmap, plans on.
"""

from __future__ import annotations

import bisect
import itertools
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

try:
    from ompl import base, geometric, util
except ImportError:  # no wheel for this machine, or not installed
    base = None

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Point = tuple[float, float, float]
    Span = tuple[Point, Point]
    Plan = list[Point]

CITY = Path(__file__).resolve().parent / "utopia.json"
SAME = 1e-9  # m: bending a height and back may cost a rounding
RADIUS, CEILING = 0.35, 6.0  # m, as in city.soter
TOUCH = (
    1e-10  # m: what lies on a wall, but for rounding, is outside of it; a request may start there
)
ITERATIONS = 500  # of RRT*; it goes on, so many more each time, until it has a plan
MOST = 8  # times
REACH = 8.0  # m: the longest branch of the tree
POINTS = 32  # the longest plan that can be published
COARSE = 2.0  # m between the samples of the bug CoarseResolution
STALE = 3.0  # m by which the bug StaleObstacle has every building in its old place
SHIFT = (1.0, -0.7, 0.0)  # m of the bug MissingFrameShift
ABSENT = "OMPL is not installed, so there is no RRT*: pip install 'soter-rta[demo]'"

# Bugs in the order of `Bug` in planner.soter.
BUGS = (
    "Unbroken",
    "NoEdgeCheck",
    "NoRecheckOnSmoothing",
    "CoarseResolution",
    "StaleObstacle",
    "MissingObstacle",
    "MissingFrameShift",
    "ApproximateAccepted",
    "NoInflation",
    "EmptyPlan",
    "NotANumber",
    "LatePlan",
    "DuplicatedPlan",
)


@dataclass(frozen=True)
class Room:
    """Where the planner believes that it may fly."""

    low: Point
    high: Point
    walls: tuple[Span, ...]

    def free(self, p: Point) -> bool:
        """Whether a point is in no wall."""
        return self.clear(p, p)

    def clear(self, p: Point, q: Point) -> bool:
        """Whether a segment meets no wall: slabs, exact but for rounding, far below TOUCH."""
        return _within(self, p, q) and not any(
            _crosses(p, q, low, high) for low, high in self._met(p, q)
        )

    def _met(self, p: Point, q: Point) -> list[Span]:
        """The walls that the box around a segment meets: most are out of the question at once."""
        (ax, ay, az), (bx, by, bz) = p, q
        ax, bx = (ax, bx) if ax < bx else (bx, ax)
        ay, by = (ay, by) if ay < by else (by, ay)
        az, bz = (az, bz) if az < bz else (bz, az)
        return [
            wall
            for wall in self.walls
            if bx >= wall[0][0]
            and ax <= wall[1][0]
            and by >= wall[0][1]
            and ay <= wall[1][1]
            and bz >= wall[0][2]
            and az <= wall[1][2]
        ]


def _within(room: Room, p: Point, q: Point) -> bool:
    return all(room.low[k] <= x[k] <= room.high[k] for x in (p, q) for k in range(3))


def _crosses(p: Point, q: Point, low: Point, high: Point) -> bool:
    first, last = 0.0, 1.0
    for k in range(3):
        a, b = p[k], q[k]
        if a != b:
            s, t = (low[k] - a) / (b - a), (high[k] - a) / (b - a)
            first, last = max(first, min(s, t)), min(last, max(s, t))
    return first <= last


def room(clearance: Sequence[float], bug: str = "Unbroken") -> Room:
    """The city, with buildings grown by radius and clearance (m, an axis each)."""
    city = json.loads(CITY.read_text(encoding="utf-8"))
    wide = 0.0 if bug == "NoInflation" else 1.0
    more = [wide * (RADIUS + c) - TOUCH for c in clearance]
    shift = (STALE, 0.0, 0.0) if bug == "StaleObstacle" else (0.0, 0.0, 0.0)
    boxes = city["boxes"][:-3] if bug == "MissingObstacle" else city["boxes"]

    def corner(v: dict[str, float], sign: float) -> Point:
        x, y, z = (v[a] + s + sign * m for a, s, m in zip("xyz", shift, more, strict=True))
        return (x, y, z)

    size = {**city["size"], "z": CEILING}
    return Room(
        low=corner({"x": 0.0, "y": 0.0, "z": 0.0}, 1.0),
        high=corner(size, -1.0),
        walls=tuple((corner(b["low"], -1.0), corner(b["high"], 1.0)) for b in boxes),
    )


class Layers:
    """Heights as OMPL sees them: each layer between two planes of walls is as thick as any other.

    Above the walls there may be a hand's breadth: evenly drawn heights would seldom be there. Only
    the draws are bent; motions are straight in the city, and checked there.
    """

    def __init__(self, room: Room) -> None:
        low, high = room.low[2], room.high[2]
        tops = {z for a, b in room.walls for z in (a[2], b[2]) if low < z < high}
        self.planes = sorted({low, high, *tops})
        self.low, self.each = low, (high - low) / (len(self.planes) - 1)

    def city(self, s: Any) -> Point:  # noqa: ANN401 - a state of OMPL
        """Where a state is."""
        n = min(max(int((s[2] - self.low) / self.each), 0), len(self.planes) - 2)
        share = (s[2] - self.low) / self.each - n
        a, b = self.planes[n : n + 2]
        return (s[0], s[1], a + share * (b - a))

    def height(self, z: float) -> float:
        """The third number of a state at this height."""
        n = min(max(bisect.bisect_right(self.planes, z) - 1, 0), len(self.planes) - 2)
        a, b = self.planes[n : n + 2]
        return self.low + self.each * (n + (z - a) / (b - a))


def _motion_validator(info: Any, layers: Layers, clear: Callable[[Point, Point], bool]) -> Any:  # noqa: ANN401 - OMPL has no types
    class Exact(base.MotionValidator):  # type: ignore[misc, name-defined]
        """Asks `clear`, never samples."""

        def checkMotion(self, a: Any, b: Any, *_: Any) -> bool:  # noqa: ANN401, N802 - OMPL's name
            return clear(layers.city(a), layers.city(b))

    return Exact(info)


def sampled(room: Room) -> Callable[[Point, Point], bool]:
    """The bug CoarseResolution: points on a motion in place of the motion."""

    def clear(p: Point, q: Point) -> bool:
        n = max(1, math.ceil(math.dist(p, q) / COARSE))
        return all(room.free(_between(p, q, i / n)) for i in range(n + 1))

    return clear


def _between(p: Point, q: Point, t: float) -> Point:
    x, y, z = (a + t * (b - a) for a, b in zip(p, q, strict=True))
    return (x, y, z)


def rrt_star(
    room: Room,
    ends: tuple[Point, Point],
    seed: int,
    clear: Callable[[Point, Point], bool],
    approximate: bool = False,
    iterations: int = ITERATIONS,
) -> Plan:
    """A plan of OMPL's RRT*, ends included; empty: it found none. Seed 1 to 2^32 - 1."""
    if base is None:
        raise RuntimeError(ABSENT)
    util.setLogLevel(util.LogLevel.LOG_NONE)  # it warns of every seed after the first
    util.RNG.setSeed(seed)
    layers = Layers(room)
    space = base.RealVectorStateSpace(3)
    bounds = base.RealVectorBounds(3)
    for k in range(3):
        bounds.setLow(k, room.low[k])
        bounds.setHigh(k, room.high[k])
    space.setBounds(bounds)
    info = base.SpaceInformation(space)
    info.setStateValidityChecker(lambda s: room.free(layers.city(s)))
    info.setMotionValidator(_motion_validator(info, layers, clear))
    info.setup()
    states = [space.allocState() for _ in ends]
    for state, p in zip(states, ends, strict=True):
        state[0], state[1], state[2] = p[0], p[1], layers.height(p[2])
    problem = base.ProblemDefinition(info)
    problem.setStartAndGoalStates(*states, 1e-3)
    problem.setOptimizationObjective(base.PathLengthOptimizationObjective(info))
    planner = geometric.RRTstar(info)
    planner.setProblemDefinition(problem)
    planner.setRange(REACH)
    planner.setup()
    for _ in range(1 if approximate else MOST):  # it keeps its tree from one time to the next
        planner.solve(base.PlannerTerminationCondition(_after(iterations)))
        if problem.hasExactSolution():
            break
    path = problem.getSolutionPath()
    if path is None or not (approximate or problem.hasExactSolution()):
        return []
    points = [layers.city(path.getState(i)) for i in range(path.getStateCount())]
    return [next((e for e in ends if math.dist(e, p) < SAME), p) for p in points]


def _after(iterations: int) -> Callable[[], bool]:
    """True from so many questions on: RRT* asks once an iteration, and no clock is read."""
    asked = itertools.count(1)
    return lambda: next(asked) > iterations


def smoothed(plan: Plan, clear: Callable[[Point, Point], bool]) -> Plan:
    """The plan without points that it can do without: from each one on to the last that it sees."""
    kept = plan[:1]
    at = 0
    while at < len(plan) - 1:
        at = next((j for j in range(len(plan) - 1, at + 1, -1) if clear(plan[at], plan[j])), at + 1)
        kept.append(plan[at])
    return kept


class RRTStar:
    """The node: answers each new request once. A request is that of planner.soter."""

    def __init__(self) -> None:
        self.reset(1)

    def reset(self, seed: int) -> None:
        """Forget; plans depend on `seed` and the number of the request."""
        self.seed = seed
        self.answered = -1
        self.last: Plan = []

    def step(self, inputs: Any) -> dict[str, Any] | None:  # noqa: ANN401 - soter's record
        """The next plan, or nothing where there is no new request, or no plan."""
        if base is None:
            raise RuntimeError(ABSENT)
        request = inputs.request
        if request.number == self.answered:
            return None
        self.answered = request.number
        plan = self.plan(
            (request.start.x, request.start.y, request.start.z),
            (request.goal.x, request.goal.y, request.goal.z),
            (request.clearance.x, request.clearance.y, request.clearance.z),
            request.bug,
        )
        if plan is None or len(plan) > POINTS:
            return None
        return {"candidate": plan}

    def plan(self, start: Point, goal: Point, clearance: Point, bug: str) -> Plan | None:
        """A plan with a bug in it, or `Unbroken`; None: no plan was found."""
        believed = room(clearance, bug)
        clear = believed.clear
        if bug == "NoEdgeCheck":
            clear = _everything
        if bug == "CoarseResolution":
            clear = sampled(believed)
        seed = (self.seed * 1_000_003 + self.answered * 7919) % (2**32 - 1) + 1
        approximate = bug == "ApproximateAccepted"
        plan = rrt_star(
            believed,
            (start, goal),
            seed,
            clear,
            approximate,
            ITERATIONS // 8 if approximate else ITERATIONS,
        )
        plan = smoothed(plan, _every_second() if bug == "NoRecheckOnSmoothing" else clear)
        return self._published(plan, bug)

    def _published(self, plan: Plan, bug: str) -> Plan | None:
        before, self.last = self.last, plan or self.last
        if bug == "MissingFrameShift":
            return [_shifted(p) for p in plan] or None
        if bug == "EmptyPlan":
            return []
        if bug == "NotANumber" and plan:
            return [*plan[:-1], (math.nan, plan[-1][1], plan[-1][2])]
        if bug == "LatePlan":
            return before or None
        if bug == "DuplicatedPlan":
            return [*plan, *plan] or None
        return plan or None


def _everything(p: Point, q: Point) -> bool:  # noqa: ARG001 - the bug is that nobody looks
    return True


def _every_second() -> Callable[[Point, Point], bool]:
    """Smoothing that believes every second shortcut."""
    asked = 0

    def clear(p: Point, q: Point) -> bool:  # noqa: ARG001 - the bug is that nobody looks
        nonlocal asked
        asked += 1
        return asked % 2 == 0

    return clear


def _shifted(p: Point) -> Point:
    return (p[0] + SHIFT[0], p[1] + SHIFT[1], p[2] + SHIFT[2])
