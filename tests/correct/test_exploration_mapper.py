"""Known-free cells are free: the mapper against an exact referee, with every error at its bound.

Wrong mappers, each with one margin less, are caught by the same scenes; what no scene needs is
named in `SPARE`.
"""

from __future__ import annotations

import random
from collections import Counter
from fractions import Fraction
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest

import soter
from generators.exploration_mappers import EXAMPLES
from generators.exploration_margins import (
    ALL_OF_THEM,
    QUICK,
    RIGHT,
    SILENCE,
    SILENT,
    SPARE,
    WRONG,
    Court,
    courts_of,
)
from generators.exploration_referee import Grid, Obstacle, as_declared, met_cells, reaches
from generators.exploration_scenes import KINDS
from long_tests import examples, seed_of, seeds


@pytest.fixture(scope="module")
def court(tmp_path_factory: pytest.TempPathFactory) -> Court:
    first = dict(list(WRONG.items())[:QUICK])
    return Court({RIGHT: (), SILENT: SILENCE, **first}, tmp_path_factory.mktemp("right"))


@pytest.fixture(scope="module")
def courts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Court]:
    """Every wrong mapper by name."""
    return courts_of({**WRONG, **SPARE}, lambda: tmp_path_factory.mktemp("wrong"))


# ---------------------------------------------------------------- what is freed


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.random
def test_every_freed_cell_is_free(court: Court, kind: str) -> None:
    freed: Counter[str] = Counter()
    for number in seeds(examples(25)):
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
@pytest.mark.random
def test_within_what_is_declared_nothing_contradicts_a_true_map(court: Court, kind: str) -> None:
    count = court.grid.count
    everything = {(i, j) for i in range(count) for j in range(count)}
    for number in seeds(examples(8)):
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
    draw = random.Random(seed_of(7))  # noqa: S311 - draws, not secrets
    for _ in range(examples(60)):
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
