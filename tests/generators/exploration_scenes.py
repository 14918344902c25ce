"""Scenes that are as hard as what the mapper assumes lets them be, and scans of them that lie.

Purpose: obstacles with right angles that point at the sensor between two rays, a vehicle at speed,
and scans with every error at its bound, chosen so that each ray measures as much as it can.
Non-goals: judging a map (`exploration_referee.py`); the aim of a scene need not be right, only
its obstacles and errors have to be what is declared.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, floor, pi, sin, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from generators.exploration_referee import Grid, Obstacle, rectangle

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from random import Random

    from numpy.typing import NDArray

    from generators.exploration_referee import Point

    Array = NDArray[np.float64]

FACES = (45.0, 60.0, 72.0, 80.0, 85.0, 88.0, 89.0, 89.7, 90.0, 135.0, 180.0)
"""Degrees: where straight pieces touch the disc of a cone, on one side; finest where it is wide."""
LESS = 1e-9
"""m: what computing a distance may have added to it."""


def lidar_constants(known: Mapping[str, Any]) -> dict[str, Any]:
    """What worlds.soter declares of the lidar, by the names of fields of `Declared`: m, rad, s."""
    names = {
        "rays": "RAYS",
        "firings": "FIRINGS",
        "reach": "RANGE",
        "e_range": "ERROR_RANGE",
        "e_heading": "ERROR_HEADING",
        "nothing": "NOTHING",
        "never": "NEVER",
    }
    values = {field: known[f"worlds.{name}"] for field, name in names.items()}
    return values | {"fire": known["worlds.FIRE"] * 1e-9}


@dataclass(frozen=True)
class Declared:
    """What is declared of sensor, estimator and obstacles: m, rad, s, m/s, m/s^2."""

    rays: int
    firings: int
    turn: float
    fire: float
    reach: float
    e_range: float
    e_heading: float
    tilt: float
    e_p: float
    e_v: float
    pull: float
    thick: float
    nothing: float
    never: float

    @classmethod
    def of(cls, known: Mapping[str, Any], tilt: float, pull: float) -> Declared:
        """From the constants of worlds.soter and iris.soter."""
        return cls(
            turn=known["worlds.TURN"] * 1e-9,
            tilt=tilt,
            pull=pull,
            e_p=known["iris.ERROR_P"],
            e_v=known["iris.ERROR_V"],
            thick=known["worlds.THICK"],
            **lidar_constants(known),
        )


@dataclass
class Scene:
    """Where everything is: `pose` is the estimate x, y, vx, vy at the newest firing.

    `silence`: a ray that does not come back says that nothing is there.
    `room`: so many metres from `origin` there is a wall all around; 0.0: there is none.
    """

    pose: tuple[float, float, float, float]
    origin: Point
    obstacles: list[Obstacle]
    room: float
    newest: int
    silence: bool = False
    ranges: Array = field(default_factory=lambda: np.zeros(0))


# ------------------------------------------------------------------ obstacles


def _turned(points: Sequence[Point], at: Point, angle: float) -> tuple[Point, ...]:
    c, s = cos(angle), sin(angle)
    return tuple((at[0] + c * x - s * y, at[1] + s * x + c * y) for x, y in points)


def cone(tip: Point, angle: float, thick: float) -> Obstacle:
    """A right-angled tip before a disc of radius `thick`; `angle`: into which it widens."""
    middle = sqrt(2.0) * thick
    turns = [pi * f / 180.0 for f in (*FACES, *(360.0 - f for f in reversed(FACES[:-1])))]
    round_end = []
    for a, b in pairwise(turns):
        out, mid = thick / cos(0.5 * (b - a)), 0.5 * (a + b)
        round_end.append((middle - out * cos(mid), -out * sin(mid)))
    corners = _turned([(0.0, 0.0), *round_end], tip, angle)
    (inside,) = _turned([(middle, 0.0)], tip, angle)
    return Obstacle(corners, (inside,) * len(corners))


def block(tip: Point, angle: float, long: float, wide: float, thick: float) -> Obstacle:
    """A rectangle one corner of which is `tip`; its sides leave at `angle` and a right angle on."""
    frame = [(0.0, 0.0), (long, 0.0), (long, wide), (0.0, wide)]
    inner = [
        (x + (thick if x == 0.0 else -thick), y + (thick if y == 0.0 else -thick)) for x, y in frame
    ]
    return Obstacle(_turned(frame, tip, angle), _turned(inner, tip, angle))


def disc(near: Point, angle: float, radius: float, thick: float) -> Obstacle:
    """About a disc, whose nearest point in the direction `angle` is `near`."""
    out, count = radius / cos(pi / 24), 24
    middle = (near[0] + radius * cos(angle), near[1] + radius * sin(angle))
    turns = [angle + (k + 0.5) * 2.0 * pi / count for k in range(count)]
    rings = [
        tuple((middle[0] + r * cos(a), middle[1] + r * sin(a)) for a in turns)
        for r in (out, radius - thick)
    ]
    return Obstacle(rings[0], rings[1])


def wall(
    x: float, y: float, long: float, wide: float, c: float, s: float, thick: float
) -> Obstacle:
    """A wall as `worlds.Wall` has it."""
    ends = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    inner = [(a * (long - thick), b * (wide - thick)) for a, b in ends]
    middles = tuple((x + c * a - s * b, y + s * a + c * b) for a, b in inner)
    return Obstacle(tuple(rectangle(x, y, long, wide, c, s)), middles)


# ------------------------------------------------------------------ what rays may measure


def _along(obstacle: Obstacle, x: Array, y: Array, dx: Array, dy: Array) -> Array:
    """How far rays go before they meet a polygon, infinity: they do not; broadcast."""
    near, far = np.zeros(np.broadcast(x, dx).shape), np.full(np.broadcast(x, dx).shape, np.inf)
    corners = obstacle.corners
    for k, (bx, by) in enumerate(corners):
        ax, ay = corners[k - 1]
        nx, ny = by - ay, ax - bx  # outward, since corners are anticlockwise
        room = nx * (bx - x) + ny * (by - y)
        speed = nx * dx + ny * dy
        with np.errstate(divide="ignore", invalid="ignore"):
            t = room / speed
        near = np.where(speed < 0.0, np.maximum(near, t), near)
        far = np.where(speed > 0.0, np.minimum(far, t), far)
        far = np.where((speed == 0.0) & (room < 0.0), -1.0, far)
    return np.where(near <= far, near, np.inf)


def _to_room(x: Array, y: Array, dx: Array, dy: Array, radius: float) -> Array:
    along = x * dx + y * dy
    return -along + np.sqrt(np.maximum(along**2 + radius**2 - x**2 - y**2, 0.0))


def distances(scene: Scene, x: Array, y: Array, angle: Array) -> Array:
    """How far away the first obstacle is, from each place in each direction; m."""
    dx, dy = np.cos(angle), np.sin(angle)
    least = np.full(np.broadcast(x, dx).shape, np.inf)
    if scene.room > 0.0:
        least = _to_room(x - scene.origin[0], y - scene.origin[1], dx, dy, scene.room)
    for obstacle in scene.obstacles:
        least = np.minimum(least, _along(obstacle, x, y, dx, dy))
    return least


def _shift(d: Declared, v: Point, towards: Array, age: Array) -> tuple[Array, Array]:
    """How far a ray's origin may lie from where the vehicle was half a turn ago, by the estimate.

    p(age) = p - (v - e_v) age + a age^2 / 2 and the estimate is p + e_p, with v: all errors at
    their bounds, each as far as it goes in the direction `towards`.
    """
    c, s = np.cos(towards), np.sin(towards)
    mean = 0.5 * d.turn - age
    straight = 0.5 * d.pull * age**2
    sign_x, sign_y = np.where(c < 0.0, -1.0, 1.0), np.where(s < 0.0, -1.0, 1.0)
    error = d.e_p + d.e_v * age
    return v[0] * mean + error * sign_x + straight * c, v[1] * mean + error * sign_y + straight * s


def farthest_shift(d: Declared, v: Point) -> float:
    """The most that any ray's origin may be off, m."""
    angles = np.linspace(0.0, 2.0 * pi, 720, endpoint=False)
    most = 0.0
    for age in (0.0, d.turn):
        x, y = _shift(d, v, angles, np.full_like(angles, age))
        most = max(most, float(np.hypot(x, y).max()))
    return most


def _measured(d: Declared, far: Array) -> Array:
    tilted = far / cos(d.tilt)
    return np.where(tilted > d.reach, d.nothing, np.minimum(tilted + d.e_range - LESS, d.reach))


def _most(d: Declared, choices: Array) -> Array:
    """Of what each ray may find, choices along axis 1, the most that comes back, if any does."""
    back = np.where(choices / cos(d.tilt) <= d.reach, choices, -np.inf).max(axis=1)
    most: Array = np.where(np.isfinite(back), back, choices.max(axis=1))
    return most


def each_for_itself(d: Declared, scene: Scene) -> Array:
    """Every ray picks its origin, direction and error: what the lemma allows."""
    rho = farthest_shift(d, scene.pose[2:])
    nominal = 2.0 * pi / d.rays * np.arange(d.rays)[:, None, None]
    turns = np.array([0.5 * pi, -0.5 * pi, pi, 0.0, 0.75 * pi, -0.75 * pi])[None, :, None]
    heading = d.e_heading * np.array([-1.0, 0.0, 1.0])[None, None, :]
    angle = nominal + heading + 0.0 * turns
    out = angle + turns
    x, y = scene.origin[0] + rho * np.cos(out), scene.origin[1] + rho * np.sin(out)
    return _measured(d, _most(d, distances(scene, x, y, angle).reshape(d.rays, -1)))


def one_vehicle(d: Declared, scene: Scene, towards: float) -> Array:
    """One flight: the errors of the estimate and the acceleration are the same for all rays."""
    firing = np.arange(d.rays) // (d.rays // d.firings)
    age = np.asarray(d.fire * ((scene.newest - firing) % d.firings), dtype=np.float64)
    x, y = _shift(d, scene.pose[2:], np.full(d.rays, towards), age)
    nominal = 2.0 * pi / d.rays * np.arange(d.rays)[:, None]
    angle = nominal + d.e_heading * np.array([[-1.0, 0.0, 1.0]])
    ox, oy = scene.origin[0] + x[:, None], scene.origin[1] + y[:, None]
    return _measured(d, _most(d, distances(scene, ox, oy, angle)))


# ------------------------------------------------------------------ scenes


@dataclass(frozen=True)
class Sampler:
    """Draws scenes; `grid`: where cells lie. `speed`: the fastest, m/s."""

    declared: Declared
    grid: Grid
    speed: float = 5.6

    def scene(self, draw: Random, kind: str) -> Scene:
        """A scene and its scan. `kind`: one of KINDS."""
        scene = KINDS[kind](self, draw)
        d = self.declared
        scene.silence = draw.random() < 0.2
        if scene.silence:
            scene.room = 0.0
        if draw.random() < 0.75:
            scene.ranges = each_for_itself(d, scene)
        else:
            scene.ranges = one_vehicle(d, scene, draw.uniform(0.0, 2.0 * pi))
        if not scene.silence and draw.random() < 0.3:
            self._silence(draw, scene)
        return scene

    def _silence(self, draw: Random, scene: Scene) -> None:
        """Obstacles that nothing comes back from, or rays that were not sent yet."""
        d = self.declared
        there = Scene(scene.pose, scene.origin, scene.obstacles, 0.0, scene.newest)
        lost = np.isfinite(each_for_itself(d, there)) & (each_for_itself(d, there) != d.nothing)
        scene.ranges = np.where(lost, draw.choice([d.nothing, d.never]), scene.ranges)

    def _placed(self, draw: Random, origin: Point, v: Point) -> Scene:
        back = 0.5 * self.declared.turn
        pose = (origin[0] + back * v[0], origin[1] + back * v[1], v[0], v[1])
        room = draw.choice([0.98 * self.declared.reach, draw.uniform(3.0, 7.9)])
        return Scene(pose, origin, [], room, draw.randrange(self.declared.firings))

    def _middle(self) -> Point:
        half = 0.5 * self.grid.count * self.grid.cell
        return self.grid.x0 + half, self.grid.y0 + half

    def _shape(self, draw: Random, tip: Point, angle: float) -> Obstacle:
        thick = self.declared.thick
        kind = draw.randrange(4)
        if kind == 0:
            return disc(tip, angle, draw.choice([thick, draw.uniform(thick, 1.0)]), thick)
        if kind == 1:
            long = draw.choice([2.0 * thick, draw.uniform(2.0 * thick, 4.0)])
            sharp = draw.choice([0.25 * pi, draw.uniform(0.0, 0.5 * pi)])
            return block(tip, angle - sharp, long, 2.0 * thick, thick)
        return cone(tip, angle, thick)

    def _velocity(self, draw: Random) -> Point:
        speed = draw.choice([0.0, self.speed, draw.uniform(0.0, self.speed)])
        angle = draw.choice([0.25 * pi * draw.randrange(8), draw.uniform(0.0, 2.0 * pi)])
        return speed * cos(angle), speed * sin(angle)

    def anywhere(self, draw: Random) -> Scene:
        """Some obstacles of any kind, their tips at any angle, in any direction."""
        x, y = self._middle()
        origin = (x + draw.uniform(-0.5, 0.5), y + draw.uniform(-0.5, 0.5))
        scene = self._placed(draw, origin, self._velocity(draw))
        clear = 0.02 + farthest_shift(self.declared, scene.pose[2:])
        for _ in range(draw.randint(1, 4)):
            bearing = draw.choice([draw.uniform(-pi, pi), draw.gauss(0.0, 0.1)])
            away = clear + draw.choice([draw.uniform(0.0, 0.5), draw.uniform(0.0, 7.5)])
            tip = (origin[0] + away * cos(bearing), origin[1] + away * sin(bearing))
            angle = bearing + draw.choice([0.0, draw.uniform(-1.5, 1.5)])
            scene.obstacles.append(self._shape(draw, tip, angle))
        return scene

    def _speed_for(self, draw: Random, beside: float) -> float:
        """At which a ray may pass as far beside its place as `beside`, diagonally, m."""
        d = self.declared
        rest = sqrt(2.0) * (d.e_p + d.e_v * d.turn) + 0.5 * d.pull * d.turn**2
        speed = (beside - rest) / (0.5 * d.turn)
        return speed if 0.0 <= speed <= self.speed else draw.uniform(0.0, self.speed)

    def at_the_cap(self, draw: Random) -> Scene:
        """A cone's tip in the far corner of a cell, between two rays, as far as cells are freed.

        The tip points at the sensor along a diagonal of the cell, and the vehicle is as fast as
        cells so far away allow: there the bounds are all but met.
        """
        d, half = self.declared, self.grid.cell * sqrt(0.5)
        spread = sin(pi / d.rays) + d.e_heading
        share = draw.choice(
            [1.0 - 1e-7, 1.0 - 1e-4, draw.uniform(1.0, 1.02), draw.uniform(0.9, 1.2)]
        )
        bound = draw.choice([d.reach - 2.0 * d.e_range, draw.uniform(1.0, d.reach)])
        rho = max(share * d.thick - spread * bound, 0.0)
        speed = self._speed_for(draw, rho)
        v = draw.choice([-1.0, 1.0]) * speed * sqrt(0.5)
        quadrant = draw.randrange(4)
        bearing = 0.25 * pi + 0.5 * pi * quadrant
        velocity = (v, -v) if quadrant % 2 == 0 else (v, v)
        rho = farthest_shift(d, velocity)
        away = bound - sqrt(2.0) * (spread * bound + rho) - half - 2e-6
        i, j = (self.grid.count // 2 + draw.randint(-3, 3) for _ in range(2))
        x0, y0 = (float(c) for c in self.grid.corner(i, j))
        middle = (x0 + 0.5 * self.grid.cell, y0 + 0.5 * self.grid.cell)
        origin = (middle[0] - away * cos(bearing), middle[1] - away * sin(bearing))
        scene = self._placed(draw, origin, velocity)
        scene.room = min(bound + 0.3, 0.995 * d.reach)
        tip = (middle[0] + (half - LESS) * cos(bearing), middle[1] + (half - LESS) * sin(bearing))
        scene.obstacles.append(cone(tip, bearing, d.thick))
        return scene

    def beside_the_window(self, draw: Random) -> Scene:
        """A tip that points across the line of sight and touches a cell in its side's corner."""
        d, half = self.declared, self.grid.cell * sqrt(0.5)
        velocity = (0.0, 0.0) if draw.random() < 0.5 else self._velocity(draw)
        bearing = 0.25 * pi + 0.5 * pi * draw.randrange(4) + draw.uniform(-0.04, 0.04)
        away = draw.choice(
            [draw.uniform(6.8, 7.4), draw.uniform(0.05, 1.5), draw.uniform(1.5, 7.0)]
        )
        i, j = (self.grid.count // 2 + draw.randint(-3, 3) for _ in range(2))
        x0, y0 = (float(c) for c in self.grid.corner(i, j))
        x, y = x0 + 0.5 * self.grid.cell, y0 + 0.5 * self.grid.cell
        scene = self._placed(draw, (x - away * cos(bearing), y - away * sin(bearing)), velocity)
        side = bearing + draw.choice([-0.5, 0.5]) * pi
        corner = 0.25 * pi + 0.5 * pi * floor(2.0 * side / pi)
        tip = (x + (half - LESS) * cos(corner), y + (half - LESS) * sin(corner))
        lean = draw.choice([0.0, 0.25 * pi, draw.uniform(-0.5, 0.8)])
        towards = side + lean if sin(side - bearing) < 0.0 else side - lean
        thing = cone(tip, towards, d.thick)
        if draw.random() < 0.3:
            thing = self._shape(draw, tip, towards)
        scene.obstacles.append(thing)
        scene.room = 0.99 * d.reach
        return scene

    def around_the_vehicle(self, draw: Random) -> Scene:
        """Tips all around, as near as the vehicle comes to a wall, and nearer."""
        x, y = self._middle()
        origin = (x + draw.uniform(-0.1, 0.1), y + draw.uniform(-0.1, 0.1))
        scene = self._placed(
            draw, origin, self._velocity(draw) if draw.random() < 0.7 else (0.0, 0.0)
        )
        rho = farthest_shift(self.declared, scene.pose[2:])
        for _ in range(draw.randint(1, 3)):
            bearing = draw.uniform(-pi, pi)
            away = rho + draw.choice([1e-3, draw.uniform(0.0, 0.6)])
            tip = (origin[0] + away * cos(bearing), origin[1] + away * sin(bearing))
            scene.obstacles.append(self._shape(draw, tip, bearing))
        return scene


KINDS: dict[str, Callable[[Sampler, Random], Scene]] = {
    "anywhere": Sampler.anywhere,
    "at the cap": Sampler.at_the_cap,
    "beside the window": Sampler.beside_the_window,
    "around the vehicle": Sampler.around_the_vehicle,
}
