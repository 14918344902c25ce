"""Mappers with one margin less, and the court that tries them: scenes, and an exact referee.

Purpose: what is taken from the text of mapper.soter (`WRONG`), what no scene needs (`SPARE`), and
`Court`, which tells cells that are freed from cells that are free.
Non-goals: scenes (`exploration_scenes.py`), the referee (`exploration_referee.py`).
"""

from __future__ import annotations

import random
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from generators.exploration_mappers import Mappers
from generators.exploration_referee import Grid, as_declared, met_cells, reaches
from generators.exploration_scenes import KINDS, Declared, Sampler

if TYPE_CHECKING:
    from collections.abc import Callable
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
        self.grid = Grid.of(known.__getitem__)
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


def courts_of(wrong: dict[str, Edits], folder: Callable[[], Path]) -> dict[str, Court]:
    """Mappers by name, in as many libraries as that takes; each has a folder of its own."""
    named, courts = list(wrong.items()), {}
    for k in range(0, len(named), MANY):
        some_of_them = {RIGHT: (), **dict(named[k : k + MANY])}
        courts.update(dict.fromkeys(some_of_them, Court(some_of_them, folder())))
    return courts
