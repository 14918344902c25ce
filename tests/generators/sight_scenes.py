"""A rover's lidar among people, with every error at its bound, chosen so that each ray says most.

Purpose: what is declared of sensor, rover and people in `examples/exploration/sight.soter`, taken
to its bounds: people between two rays, who walk while the lidar turns, behind things or not; and
the places where, by a given scan, somebody could be.
Non-goals: judging (`sight_referee.py`). What is aimed at need not be hit, only errors be declared.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import cos, hypot, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from generators.exploration_scenes import lidar_constants

if TYPE_CHECKING:
    from collections.abc import Mapping
    from random import Random

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

LESS = 1e-9
"""m: what computing a distance may have added to it."""


@dataclass(frozen=True)
class Declared:
    """m, s, rad, m/s, m/s^2; the box is 2 `long` by 2 `wide`, the lidar in its middle."""

    rays: int
    firings: int
    fire: float
    reach: float
    nothing: float
    never: float
    e_range: float
    e_heading: float
    e_speed: float
    pull: float
    walks: float
    late: float
    new: float
    oldest: float
    thick: float
    long: float
    wide: float

    @classmethod
    def of(cls, known: Mapping[str, Any]) -> Declared:
        """From the constants of sight.soter, people.soter and worlds.soter."""
        return cls(
            e_speed=known["sight0.ERROR_SPEED"],
            pull=known["people.A"] + known["people.SLOPE"],
            walks=known["people.W"],
            late=known["sight0.LATE"],
            new=known["sight0.NEW"],
            oldest=known["sight0.OLDEST"],
            thick=0.1,
            long=0.4,
            wide=0.3,
            **lidar_constants(known),
        )

    def directions(self) -> Array:
        """Of the rays, nominally, rad: counted from behind by the right."""
        return np.asarray(2.0 * pi / self.rays * (np.arange(self.rays) + 0.5) - pi, np.float64)


@dataclass(frozen=True)
class Walk:
    """A disc: where its middle is at `LATE`, and its velocity before and after `turns` (s)."""

    x: float
    y: float
    before: tuple[float, float] = (0.0, 0.0)
    after: tuple[float, float] = (0.0, 0.0)
    turns: float = 0.0
    radius: float = 0.1

    def at(self, t: Array, late: float) -> tuple[Array, Array]:
        """Its middle at times up to `late`."""
        second, first = np.maximum(t, self.turns) - late, np.minimum(t - self.turns, 0.0)
        return (
            self.x + self.after[0] * second + self.before[0] * first,
            self.y + self.after[1] * second + self.before[1] * first,
        )


@dataclass(frozen=True)
class Aim:
    """A rover and somebody: speeds in m/s, times in s, `newest` a firing, angles in rad.

    gap: from the box, m; angle: where they are, from the lidar. toward, away: into which directions
    they walk before and after `turns`; walks: how fast, of the most.
    """

    v: float
    pull: float
    age: float
    error: float
    old: float
    newest: int
    gap: float
    angle: float
    before: float
    after: float
    turns: float
    walks: float


@dataclass
class Scene:
    """Time 0 is when the node reads; `v` the speed then, `told` what it is told of it."""

    v: float
    pull: float
    told: float
    old: float
    newest: int
    people: list[Walk] = field(default_factory=list)
    things: list[Walk] = field(default_factory=list)
    ranges: Array = field(default_factory=lambda: np.zeros(0))
    headings: Array = field(default_factory=lambda: np.zeros(0))

    def x(self, t: Array | float) -> Any:
        """Where the rover's middle is."""
        return self.v * t + 0.5 * self.pull * t * t

    def times(self, d: Declared) -> Array:
        """When each ray leaves."""
        firing = np.arange(d.rays) // (d.rays // d.firings)
        older = (self.newest - firing) % d.firings
        return np.asarray(-self.old - d.fire * older, np.float64)


def _hits(x: Array, y: Array, dx: Array, dy: Array, disc: Walk, at: tuple[Array, Array]) -> Array:
    """How far rays go before they meet a disc, infinity: they do not."""
    qx, qy = at[0] - x, at[1] - y
    along, aside = qx * dx + qy * dy, qy * dx - qx * dy
    half = disc.radius**2 - aside**2
    inside = qx**2 + qy**2 <= disc.radius**2
    meets = (half >= 0.0) & (along > 0.0)
    far = np.where(meets, along - np.sqrt(np.maximum(half, 0.0)), np.inf)
    return np.where(inside, 0.0, far)


def measure(d: Declared, scene: Scene) -> None:
    """Sets what each ray says, and which error of its direction lets it say most."""
    t = scene.times(d)
    x, y = scene.x(t), np.zeros(d.rays)
    best, which = np.full(d.rays, -np.inf), np.zeros(d.rays)
    for error in (0.0, -d.e_heading, d.e_heading):
        a = d.directions() + error
        far = np.full(d.rays, np.inf)
        for disc in (*scene.people, *scene.things):
            far = np.minimum(far, _hits(x, y, np.cos(a), np.sin(a), disc, disc.at(t, d.late)))
        which = np.where(far > best, error, which)
        best = np.maximum(best, far)
    told = np.minimum(best + d.e_range - LESS, d.reach)
    scene.headings = which
    scene.ranges = np.where(best > d.reach, d.nothing, told)


class Sampler:
    """Scenes by chance."""

    def __init__(self, declared: Declared) -> None:
        self.declared = declared

    def aim(self, draw: Random) -> Aim:
        """A rover that drives and is told how fast, and somebody who is near."""
        d = self.declared
        old = draw.choice([0.0, 0.001, draw.uniform(0.0, d.oldest), d.oldest])
        middle = -old - 0.5 * d.fire * (d.firings - 1)
        newest = draw.choice([d.firings - 1, draw.randrange(d.firings)])
        seam = (
            newest + 1
        ) * 2.0 * pi / d.firings - pi  # where the newest rays are beside the oldest
        angle = draw.choice([self._angle(draw), self._angle(draw), seam])
        aside = draw.choice([-0.5, 0.5]) * pi
        turn = draw.choice([angle, angle + pi, angle + aside, draw.uniform(0.0, 2.0 * pi)])
        return Aim(
            v=draw.choice([0.0, 1.2, 1.5, draw.uniform(-2.2, 2.2)]),
            pull=draw.choice([-d.pull, 0.0, d.pull]),
            age=draw.choice([0.0, d.new]),
            error=draw.choice([-1.0, 0.0, 1.0]) * d.e_speed,
            old=old,
            newest=newest,
            gap=draw.choice([draw.uniform(0.02, 1.0), draw.uniform(0.02, 5.0)]),
            angle=angle,
            before=turn,
            after=draw.choice([turn, turn + pi, draw.uniform(0.0, 2.0 * pi)]),
            turns=draw.choice([middle, draw.uniform(middle, d.late)]),
            walks=draw.choice([0.0, 1.0, 1.0, 1.0]),
        )

    def beside(self, draw: Random, aim: Aim, scale: float) -> Aim:
        """Nearly the same, `scale` of 1 being much."""
        d = self.declared
        wander = {
            "v": draw.gauss(0.0, 0.5 * scale),
            "gap": draw.gauss(0.0, scale),
            "angle": draw.gauss(0.0, 0.2 * scale),
            "before": draw.gauss(0.0, 2.0 * scale),
            "after": draw.gauss(0.0, 2.0 * scale),
            "turns": draw.gauss(0.0, 0.02 * scale),
        }
        some = draw.sample(list(wander), draw.randint(1, 3))
        new = replace(aim, **{name: getattr(aim, name) + wander[name] for name in some})
        if draw.random() < 0.1:
            other = self.aim(draw)
            new = replace(new, pull=other.pull, error=other.error, age=other.age)
        low = -new.old - d.fire * d.firings
        return replace(
            new,
            v=min(max(new.v, -2.2), 2.2),
            gap=min(max(new.gap, 0.02), 5.0),
            turns=min(max(new.turns, low), d.late),
        )

    def empty(self, aim: Aim) -> Scene:
        """The rover alone."""
        told = aim.v - aim.pull * aim.age + aim.error
        return Scene(aim.v, aim.pull, told, aim.old, aim.newest)

    def walk(self, scene: Scene, aim: Aim) -> Walk:
        """Who is `gap` from the box in a direction, however they got there."""
        d = self.declared
        low, high = 0.0, 20.0
        at, c, s = scene.x(d.late), cos(aim.angle), sin(aim.angle)
        for _ in range(50):
            far = 0.5 * (low + high)
            ex, ey = max(abs(far * c - at) - d.long, 0.0), max(abs(far * s) - d.wide, 0.0)
            low, high = (far, high) if hypot(ex, ey) < aim.gap + d.thick else (low, far)
        w = aim.walks * d.walks
        before, after = ((w * cos(a), w * sin(a)) for a in (aim.before, aim.after))
        return Walk(high * c, high * s, before, after, aim.turns, d.thick)

    def aimed(self, aim: Aim) -> Scene:
        """Nobody else is there."""
        scene = self.empty(aim)
        scene.people.append(self.walk(scene, aim))
        measure(self.declared, scene)
        return scene

    def _angle(self, draw: Random) -> float:
        """Between two rays, if nothing moves; or anywhere."""
        between = 2.0 * pi / self.declared.rays
        aside = draw.choice([0.0, draw.uniform(-0.5, 0.5), draw.uniform(-0.1, 0.1)])
        return (draw.randrange(self.declared.rays) + aside) * between - pi

    def _lost(self, draw: Random, scene: Scene) -> None:
        """Some rays are dropped: here and there, or neighbours."""
        d, kind = self.declared, draw.randrange(4)
        lost = np.zeros(d.rays, dtype=bool)
        if kind == 0:
            lost = np.array([draw.random() < 0.05 for _ in range(d.rays)])
        elif kind == 1:
            for walk in scene.people or scene.things:
                at = int((np.arctan2(walk.y, walk.x) + pi) / (2.0 * pi) * d.rays)
                count = draw.randint(1, 6)
                first = at - draw.randint(0, count)
                lost[np.arange(first, first + count) % d.rays] = True
        says = draw.choice([d.never, float("nan"), d.reach + 1e-3, float("inf")])
        scene.ranges = np.where(lost, says, scene.ranges)

    def _things(self, draw: Random) -> list[Walk]:
        found = []
        for _ in range(draw.randint(1, 5)):
            far, radius = draw.uniform(1.0, 6.0), draw.uniform(0.05, 0.5)
            angle = draw.uniform(-pi, pi)
            found.append(Walk(far * cos(angle), far * sin(angle), radius=radius))
        return found

    def with_people(self, draw: Random) -> Scene:
        """One or two are there, perhaps behind things, and every ray says as much as it can."""
        scene = self.empty(self.aim(draw))
        for _ in range(draw.randint(1, 2)):
            aim = replace(self.aim(draw), old=scene.old)
            scene.people.append(self.walk(scene, aim))
        if draw.random() < 0.3:
            scene.things += self._things(draw)
        measure(self.declared, scene)
        self._lost(draw, scene)
        return scene

    def in_black(self, draw: Random) -> Scene:
        """Of some rays that hit somebody nothing comes back."""
        scene = self.with_people(draw)
        black = np.array([draw.random() < 0.9 for _ in scene.ranges]) & (scene.ranges < 5.0)
        says = draw.choice([self.declared.nothing, self.declared.never])
        black |= scene.ranges == self.declared.nothing
        scene.ranges = np.where(black, says, scene.ranges)
        return scene

    def with_things(self, draw: Random) -> Scene:
        """Things alone: behind them, and between rays, somebody could be."""
        scene = self.empty(self.aim(draw))
        scene.things += self._things(draw)
        measure(self.declared, scene)
        self._lost(draw, scene)
        return scene

    def unseen(self, draw: Random, scene: Scene, gap: float, count: int) -> list[Walk]:
        """People nearer than `gap` whom the scan does not rule out, of `count` that are tried."""
        found = []
        for _ in range(count):
            less = draw.choice([1e-6, 1e-3, 1e-2, draw.uniform(0.0, gap)])
            if gap - less > 0.0:
                walk = self.walk(scene, replace(self.aim(draw), old=scene.old, gap=gap - less))
                if self.fits(scene, walk):
                    found.append(walk)
        return found

    def fits(self, scene: Scene, walk: Walk) -> bool:
        """Whether each ray may have said what it did, with somebody there."""
        d, seen, t = self.declared, scene.ranges, scene.times(self.declared)
        says = (seen >= 0.0) & (seen <= d.reach) | (seen == d.nothing)
        free = np.where(seen == d.nothing, d.reach, seen - d.e_range)
        fine = ~says
        for error in (0.0, -d.e_heading, d.e_heading):
            a = d.directions() + error
            x, y = scene.x(t), np.zeros(d.rays)
            far = _hits(x, y, np.cos(a), np.sin(a), walk, walk.at(t, d.late))
            fine |= far >= free
        return bool(fine.all())
