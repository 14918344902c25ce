"""Known-free cells are free: the mapper against an exact referee, with every error at its bound.

Wrong mappers, each with one margin less, are caught by the same scenes; what no scene needs is
named in `SPARE`.
"""

from __future__ import annotations

import random
from collections import Counter
from fractions import Fraction
from math import pi, sqrt
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from generators.exploration_mappers import EXAMPLES, Mappers
from generators.exploration_referee import Grid, Obstacle, as_declared, met_cells, reaches
from generators.exploration_scenes import KINDS, Declared, Sampler
from long_tests import examples

if TYPE_CHECKING:
    from pathlib import Path

    from generators.exploration_referee import Cell
    from generators.exploration_scenes import Scene

    Edits = tuple[tuple[str, str], ...]

TILT = 0.02  # rad, docs/exploration.md
RIGHT, SILENT = "as it is", "silence counts"
ALL_OF_THEM = (RIGHT, SILENT)
SILENCE: Edits = (("param SILENCE: bool = false", "param SILENCE: bool = true"),)

SPREAD = "sin(0.5 * BETWEEN) + worlds.ERROR_HEADING"
FAR = "(away + HALF + ROOT * side) / (1.0 - ROOT * SPREAD) + MORE"
ERRORS = "ROOT * (iris.ERROR_P + iris.ERROR_V * turn)"
CAP = "min((worlds.THICK - side) / SPREAD, worlds.RANGE)"
FROM, TO = "int(floor(middle - half))", "int(floor(middle + half)) + 1"
LEAST, MOST = "-int(floor(half - middle))", "int(floor(middle + half))"
WINDOW = "(asin(reach / away) + MORE)"
HALF_RAY = ("/ BETWEEN + 0.5;", "/ BETWEEN;")
RANGES = "shortest(least, from, min(to - from + 1, RAYS)) > far"
MINIMUM = "return min(least[level * RAYS + a], least[level * RAYS + b]);"
LEARNED = "map[i * grid.N + j] = says_free(least, m.x - x, m.y - y, away, far);"
CORNERS = """fun before_rays(ranges: float[RAYS], dx: float, dy: float): bool {
  let k = int(floor(atan2(dy, dx) / BETWEEN)) + RAYS;
  let slack = hypot(dx, dy) * BETWEEN + worlds.ERROR_RANGE + iris.ERROR_P + grid.CELL;
  return hypot(dx, dy) < min(ranges[k % RAYS], ranges[(k + 1) % RAYS]) - slack;
}
fun by_corners(ranges: float[RAYS], dx: float, dy: float): bool {
  let h = 0.5 * grid.CELL;
  return before_rays(ranges, dx - h, dy - h) && before_rays(ranges, dx + h, dy - h)
      && before_rays(ranges, dx - h, dy + h) && before_rays(ranges, dx + h, dy + h);
}
fun says_free("""
"""The rule of an early sketch: a cell is free if its corners lie before the rays around them."""

WRONG: dict[str, Edits] = {
    "no angular error": ((SPREAD, "sin(0.5 * BETWEEN)"),),
    "no error of the origin in F": ((FAR, FAR.replace(" + ROOT * side", "")),),
    "no limit by THIN": ((CAP, "worlds.RANGE"),),
    "freed by four corners": (
        (LEARNED, "map[i * grid.N + j] = by_corners(scan.ranges, m.x - x, m.y - y);"),
        ("fun says_free(", CORNERS),
    ),
    "no root of two": ((FAR, FAR.replace("ROOT * ", "")),),
    "no root of two over the origin": ((FAR, FAR.replace("ROOT * side", "side")),),
    "no root of two over the angle": ((FAR, FAR.replace("ROOT * SPREAD", "SPREAD")),),
    "no angle in F": ((FAR, "away + HALF + ROOT * side + MORE"),),
    "no cell in F": ((FAR, FAR.replace("HALF + ", "")),),
    "half a side for half a diagonal": (("0.5 * ROOT * grid.CELL", "0.5 * grid.CELL"),),
    "no half ray in the angle": ((SPREAD, "worlds.ERROR_HEADING"),),
    "no error of the place": ((ERRORS, "ROOT * (iris.ERROR_V * turn)"),),
    "no error of the velocity": ((ERRORS, "ROOT * iris.ERROR_P"),),
    "errors of one axis": ((ERRORS, "(iris.ERROR_P + iris.ERROR_V * turn)"),),
    "no acceleration": (("0.5 * PULL * turn * turn", "0.0"),),
    "acceleration of one axis": (("PULL: float = sqrt(2.0) * ", "PULL: float = "),),
    "no speed": (("0.5 * turn * speed", "0.0"),),
    "origin at the newest ray": (
        ("let x = at.x - 0.5 * seconds(worlds.TURN) * at.vx", "let x = at.x"),
        ("let y = at.y - 0.5 * seconds(worlds.TURN) * at.vy", "let y = at.y"),
    ),
    "origin half a turn ahead": (
        ("let x = at.x - ", "let x = at.x + "),
        ("let y = at.y - ", "let y = at.y + "),
    ),
    "no error of the range": (("used - worlds.ERROR_RANGE", "used"),),
    "error of the range added": (("used - worlds.ERROR_RANGE", "used + worlds.ERROR_RANGE"),),
    "silence always counts": (("SILENCE && r == worlds.NOTHING", "r == worlds.NOTHING"),),
    "rays that were never sent count": (("SILENCE && r == worlds.NOTHING", "r == worlds.NEVER"),),
    "limit by twice THIN": ((CAP, CAP.replace("THICK", "THIN")),),
    "limit without the origin": ((CAP, CAP.replace(" - side", "")),),
    "limit of the cell, not of F": (("if far <= limit", "if away <= limit"),),
    "limit three in a hundred too far": (("if far <= limit", "if far <= 1.03 * limit"),),
    "window exact and without half a ray": (HALF_RAY, (FROM, LEAST), (TO, MOST)),
    "half the window": ((WINDOW, "(0.5 * asin(reach / away) + MORE)"),),
    "window of the cell alone": ((WINDOW, "(asin(min(1.0, HALF / away)) + MORE)"),),
    "window in front only": (
        ("if reach >= away {", "if false {"),
        (WINDOW, "(asin(min(reach / away, 1.0)) + MORE)"),
    ),
    "window from the middle on": ((FROM, "int(floor(middle))"),),
    "window up to the middle": ((TO, "int(floor(middle)) + 1"),),
    "the nearest ray": ((RANGES, "shortest(least, int(floor(middle + 0.5)), 1) > far"),),
    "the two rays around": ((RANGES, "shortest(least, int(floor(middle)), 2) > far"),),
    "window that does not wrap": (("(from % RAYS + RAYS) % RAYS", "max(from, 0) % RAYS"),),
    "table that does not wrap": (("(k + width) % RAYS]", "min(k + width, RAYS - 1)]"),),
    "the first power of two": ((MINIMUM, "return least[level * RAYS + a];"),),
    "the last power of two": ((MINIMUM, "return least[level * RAYS + b];"),),
    "table one level short": (
        ("if 2 * width <= count {", "if 2 * width <= count && l < LEVELS - 1 {"),
    ),
}
"""One margin less each; the first ones are tried always."""
QUICK = 2

SPARE: dict[str, Edits] = {
    # floor and the 1 after it widen the window by what half a ray asks for; either may go
    "window without half a ray": (HALF_RAY,),
    "window exact": ((FROM, LEAST), (TO, MOST)),
    # a ray that is nearly DELTA/2 + eta off runs only cos of that beside, which is less than LEVEL;
    # one that is less off runs into the disc
    "no tilt": (("max(LEVEL * (used", "max((used"),),
    # the root of two in F - A is more than a tip that points across the line of sight needs
    "window without arc sine": ((WINDOW, "(reach / away + MORE)"),),
    # rounding alone
    "no micrometre": (("const MORE: float = 0.000001", "const MORE: float = 0.0"),),
}
"""What no scene was found to need; docs/exploration.md derives all of it."""
MANY = 24
"""Variants in one library: a system has room for no more maps."""


class Court:
    """Mappers that are tried on scenes, and what the referee finds."""

    def __init__(self, variants: dict[str, Edits], work: Path) -> None:
        self.mappers = Mappers(variants, work)
        known = self.mappers.constants
        pull = sqrt(2.0) * (known["corridor.U"] + known["corridor.D"])
        self.declared = Declared.of(known, TILT, pull)
        names = ("X0", "Y0", "CELL", "N")
        self.grid = Grid(*(known[f"grid.{name}"] for name in names))
        self.sampler = Sampler(self.declared, self.grid)

    def scene(self, kind: str, number: int) -> Scene:
        draw = random.Random(f"{kind} {number}")  # noqa: S311 - draws, not secrets
        scene = self.sampler.scene(draw, kind)
        assert all(as_declared(o, self.declared.thick) for o in scene.obstacles), (kind, number)
        return scene

    def freed(self, name: str, scene: Scene) -> set[Cell]:
        nothing = np.zeros((self.grid.count, self.grid.count), dtype=bool)
        cells, doubt = self.mappers.step(name, scene.ranges, scene.newest, scene.pose, nothing)
        assert not doubt
        return {(int(i), int(j)) for i, j in np.argwhere(cells)}

    def taken(self, scene: Scene, among: set[Cell]) -> set[Cell]:
        """Of these cells those that meet an obstacle."""
        met = {c for c in among if scene.room and reaches(self.grid, c, scene.origin, scene.room)}
        for obstacle in scene.obstacles:
            met |= met_cells(self.grid, obstacle.corners, among.__contains__)
        return met

    def first_lie(self, name: str, count: int) -> tuple[str, int] | None:
        """The first scene of which a wrong mapper frees a cell that is not free."""
        for number in range(count):
            for kind in KINDS:
                scene = self.scene(kind, number)
                right = self.freed(RIGHT, scene)
                if self.taken(scene, self.freed(name, scene) - right):
                    return kind, number
        return None


@pytest.fixture(scope="module")
def court(tmp_path_factory: pytest.TempPathFactory) -> Court:
    first = dict(list(WRONG.items())[:QUICK])
    return Court({RIGHT: (), SILENT: SILENCE, **first}, tmp_path_factory.mktemp("right"))


@pytest.fixture(scope="module")
def courts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Court]:
    """Every wrong mapper by name, in as many libraries as that takes."""
    wrong, found = list({**WRONG, **SPARE}.items()), {}
    for k in range(0, len(wrong), MANY):
        some_of_them = {RIGHT: (), **dict(wrong[k : k + MANY])}
        court = Court(some_of_them, tmp_path_factory.mktemp("wrong"))
        found.update(dict.fromkeys(some_of_them, court))
    return found


# ---------------------------------------------------------------- what is freed


@pytest.mark.parametrize("kind", KINDS)
def test_every_freed_cell_is_free(court: Court, kind: str) -> None:
    freed: Counter[str] = Counter()
    for number in range(examples("SOTER_SCENES", quick=25, long=6000)):
        scene = court.scene(kind, number)
        for name in ALL_OF_THEM if scene.silence else (RIGHT,):
            cells = court.freed(name, scene)
            freed[name] += len(cells)
            assert court.taken(scene, cells) == set(), (number, name)
    assert freed[RIGHT] > 300, "a mapper that frees nothing is right, too"
    assert freed[SILENT] > 0


@pytest.mark.parametrize("name", list(WRONG)[:QUICK])
def test_a_wrong_mapper_frees_what_is_not_free(court: Court, name: str) -> None:
    assert court.first_lie(name, 100) is not None


@pytest.mark.long
@pytest.mark.parametrize("name", WRONG)
def test_each_margin_is_needed(courts: dict[str, Court], name: str) -> None:
    assert courts[name].first_lie(name, 2000) is not None


@pytest.mark.long
@pytest.mark.parametrize("name", SPARE)
def test_a_margin_that_is_said_to_be_spare_is(courts: dict[str, Court], name: str) -> None:
    assert courts[name].first_lie(name, 300) is None


# ---------------------------------------------------------------- doubt


@pytest.mark.parametrize("kind", KINDS)
def test_within_what_is_declared_nothing_contradicts_a_true_map(court: Court, kind: str) -> None:
    count = court.grid.count
    everything = {(i, j) for i in range(count) for j in range(count)}
    for number in range(examples("SOTER_DOUBTS", quick=8, long=1500)):
        scene = court.scene(kind, number)
        free = np.ones((count, count), dtype=bool)
        for i, j in court.taken(scene, everything):
            free[i, j] = False
        assert not court.mappers.step(RIGHT, scene.ranges, scene.newest, scene.pose, free)[1]


def test_a_ray_that_ends_among_free_cells_contradicts(court: Court) -> None:
    count, x, y = court.grid.count, court.grid.x0 + 12.0, court.grid.y0 + 12.0
    ranges, free = (
        np.full(court.declared.rays, court.declared.nothing),
        np.ones((count, count), bool),
    )
    ranges[7] = 5.0
    assert court.mappers.step(RIGHT, ranges, 9, (x, y, 0.0, 0.0), free)[1]


# ---------------------------------------------------------------- the referee


def test_the_referee_counts_a_touch_and_no_less() -> None:
    grid = Grid(0.0, 0.0, 0.25, 8)
    assert met_cells(grid, [(0.5, 0.5), (1.0, 0.5), (1.0, 1.0)], lambda _: True) == {
        *((i, j) for i in range(1, 5) for j in range(1, 5) if j <= i + 1)
    }
    beside = np.nextafter(0.5, 1.0)
    met = met_cells(grid, [(beside, beside), (1.0, beside), (1.0, 0.9)], lambda _: True)
    assert min(met) == (2, 2)
    assert reaches(grid, (2, 3), (0.0, 0.0), 1.25)
    assert not reaches(grid, (2, 3), (0.0, 0.0), float(np.nextafter(1.25, 2.0)))


@pytest.mark.parametrize(
    ("width", "angle", "fine"), [(0.6, 0.5, True), (0.59, 0.5, False), (0.6, 0.45, False)]
)
def test_the_referee_knows_what_is_too_thin_or_too_sharp(
    width: float, angle: float, fine: bool
) -> None:
    turn = angle * pi
    c, s = float(np.cos(turn)), float(np.sin(turn))
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0 + width * c, width * s), (width * c, width * s))
    inner = tuple((0.3 if x < 0.7 else x - 0.3, 0.3 if y < 0.3 else y - 0.3) for x, y in corners)
    assert as_declared(Obstacle(corners, inner), 0.3) == fine


# ---------------------------------------------------------------- boxes


def test_a_box_of_known_cells_keeps_the_vehicle_over_them() -> None:
    program = soter.load(EXAMPLES / "exploration" / "grid.soter")
    under, over = program.function("under"), program.function("over")
    names = ("X0", "Y0", "CELL", "N")
    grid = Grid(*(program.constant(name) for name in names))
    radius = Fraction(program.constant("city.RADIUS"))
    draw = random.Random(7)  # noqa: S311 - draws, not secrets
    for _ in range(examples("SOTER_BOXES", quick=60, long=3000)):
        i0, j0 = draw.randrange(grid.count - 12), draw.randrange(grid.count - 12)
        asked = SimpleNamespace(
            i0=i0, j0=j0, i1=i0 + draw.randint(4, 11), j1=j0 + draw.randint(4, 11)
        )
        box = over(asked, SimpleNamespace(x=0.0, y=0.0))
        more = draw.choice([0.0, 1e-7, 2e-6, 4e-6, draw.uniform(-0.5, 0.5)])
        box.low.x, box.high.y = box.low.x - more, box.high.y + more
        low = [Fraction(box.low.x) - radius, Fraction(box.low.y) - radius]
        high = [Fraction(box.high.x) + radius, Fraction(box.high.y) + radius]
        r = under(box)
        if more == 0.0:
            assert r == asked
        for k, (least, most, start) in enumerate(((r.i0, r.i1, grid.x0), (r.j0, r.j1, grid.y0))):
            first, last = (Fraction(start) + n * Fraction(grid.cell) for n in (least, most + 1))
            assert least < 0 or first < low[k]
            assert most >= grid.count or last > high[k]
