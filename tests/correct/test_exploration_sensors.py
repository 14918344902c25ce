"""What a lidar says that it may not: nothing of it frees a cell, and whoever sent it is named.

Purpose: scans that are no scans (too few or too many rays, values that are no numbers or out of
bounds, a pose that is none, none at all), by way of the door through which a driver's scans come
and in the mapper's own step. What is worse than declared and looks well (noise, mirrors, jumps)
stands in `test_exploration_flights.py`.
"""

from __future__ import annotations

from math import cos, inf, nan, pi
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from generators.exploration_mappers import EXAMPLES, Mappers
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.simulate.result import Run

    Driver = Callable[[int], dict[str, Any] | None]
    Flown = Callable[[Driver], Run]

RAYS, RANGE, NOTHING, COUNT = 180, 8.0, -1.0, 120
HOME = (1.2 + 12.0, 25.86 + 12.0, 0.0, 0.0)
"""The middle of the square, at rest."""
BAD = [nan, inf, -inf, 1e308, -1e308, -3.0, np.nextafter(RANGE, 9.0), 1e6]
PROGRAM = """soter 1;
import "{folder}/mapper.soter" as mapper;
import "{folder}/worlds.soter" as worlds;
extern node Driver period 50ms {{ publishes worlds.scan; }}
system Scans {{
  node Driver;
  node mapper.Mapper;
  set mapper.SILENCE = true;
  until 2s;
}}
"""


def scan(ranges: Any, at: tuple[float, ...] = HOME) -> dict[str, Any]:
    return {"ranges": ranges, "newest": 0, "at": at}


def room(radius: float = 4.0) -> list[float]:
    return [radius] * RAYS


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Two seconds of what a driver says at each step, 50 ms apart."""
    path = tmp_path_factory.mktemp("scans") / "scans.soter"
    path.write_text(PROGRAM.format(folder=EXAMPLES / "exploration"), encoding="utf-8")
    program = soter.load(path)

    def run(driver: Driver) -> Run:
        steps = iter(range(10_000))
        program.bind("Driver", lambda _: driver(next(steps)))
        return program.simulate(seed=1, trace=["mapper.known", "mapper.doubt"], sha256=False)

    return run


def cells(run: Run) -> np.ndarray:
    """How many are known after every instant."""
    known: np.ndarray = np.asarray(run.topic("mapper.known"))
    counts: np.ndarray = known.sum(axis=1)
    return counts


@pytest.fixture(scope="module")
def with_a_ray_at_the_door(flown: Flown) -> int:
    """Cells that are known where one ray hit at once."""
    near = flown(lambda _: scan([0.0, *room()[1:]]))
    return int(cells(near)[-1])


@pytest.fixture(scope="module")
def at_home() -> int:
    """Cells that are known before the first scan."""
    return sum(soter.load(EXAMPLES / "exploration" / "grid.soter").constant("AT_START"))


# ---------------------------------------------------------------- at the door


def test_a_scan_frees_cells_and_one_that_is_not_there_none(flown: Flown, at_home: int) -> None:
    told = flown(lambda _: scan(room()))
    silent = flown(lambda _: None)
    assert cells(told)[-1] > at_home + 400
    assert cells(silent)[-1] == at_home
    assert any("Driver" in note for note in silent.notes)


def test_dropped_scans_cost_time_alone(flown: Flown, at_home: int) -> None:
    def sometimes(step: int) -> dict[str, Any] | None:
        return scan(room(3.0)) if step == 0 else scan(room(5.0)) if step > 30 else None

    run = flown(sometimes)
    known, time = cells(run), run.time_s()
    gap = known[(time > 0.3) & (time < 1.5)]
    assert len(set(gap.tolist())) == 1
    assert at_home < gap[0] < known[-1]
    assert run.violation_list == []


@pytest.mark.parametrize("count", [0, 1, RAYS - 1, RAYS + 1, 3600])
def test_too_few_and_too_many_rays_are_refused_and_named(
    flown: Flown, at_home: int, count: int
) -> None:
    run = flown(lambda _: scan([4.0] * count))
    assert cells(run)[-1] == at_home
    (said,) = run.extern_failures.values()
    assert str(count) in said
    assert str(RAYS) in said
    assert [v.kind for v in run.violation_list] == ["fault"]


@all_rows("bad", BAD)
@all_rows("everywhere", [True, False])
def test_a_range_that_is_none_frees_nothing_at_the_door(
    flown: Flown, with_a_ray_at_the_door: int, at_home: int, bad: float, everywhere: bool
) -> None:
    ranges = [bad] * RAYS if everywhere else [bad, *room()[1:]]
    run = flown(lambda _: scan(ranges))
    assert at_home <= cells(run)[-1] <= with_a_ray_at_the_door
    assert not run.topic("mapper.doubt")[-1]


@all_rows("k", range(4))
@all_rows("bad", [nan, inf, -inf, 1e300])
def test_of_a_pose_that_is_none_no_scan_is_taken(
    flown: Flown, at_home: int, bad: float, k: int
) -> None:
    at = tuple(bad if n == k else value for n, value in enumerate(HOME))
    run = flown(lambda _: scan(room(), at))
    assert cells(run)[-1] == at_home


# ---------------------------------------------------------------- in the mapper's own step


@pytest.fixture(scope="module")
def mappers(tmp_path_factory: pytest.TempPathFactory) -> Mappers:
    silence = (("param SILENCE: bool = false", "param SILENCE: bool = true"),)
    return Mappers({"as it is": (), "silence": silence}, tmp_path_factory.mktemp("sensors"))


@pytest.mark.parametrize("name", ["as it is", "silence"])
def test_a_ray_that_is_no_range_says_no_more_than_one_that_hit_at_once(
    mappers: Mappers, name: str
) -> None:
    draw = np.random.default_rng(5)
    nothing = np.zeros((COUNT, COUNT), dtype=bool)
    all_free = np.ones((COUNT, COUNT), dtype=bool)
    for _ in range(60):
        ranges = draw.uniform(1.0, RANGE, RAYS)
        ranges[draw.random(RAYS) < 0.2] = NOTHING
        where = draw.random(RAYS) < draw.choice([0.01, 0.3, 1.0])
        broken = np.where(where, draw.choice(BAD, RAYS), ranges)
        at_once = np.where(where, 0.0, ranges)
        pose = (*HOME[:2], *draw.uniform(-3.0, 3.0, 2))
        said, _ = mappers.step(name, broken, 3, pose, nothing)
        assert (said == mappers.step(name, at_once, 3, pose, nothing)[0]).all()
        doubts = [mappers.step(name, r, 3, pose, all_free)[1] for r in (broken, at_once)]
        assert doubts[0] == doubts[1], "what is no range contradicts nothing"


@all_rows("k", range(4))
@all_rows("bad", [nan, inf, -inf])
def test_the_mapper_takes_no_scan_from_nowhere(mappers: Mappers, bad: float, k: int) -> None:
    pose = tuple(bad if n == k else value for n, value in enumerate(HOME))
    nothing = np.zeros((COUNT, COUNT), dtype=bool)
    known, doubt = mappers.step("silence", np.full(RAYS, NOTHING), 0, pose, nothing)
    assert not known.any()
    assert not doubt


def test_a_hit_nearer_than_a_known_cell_contradicts_and_farther_does_not(mappers: Mappers) -> None:
    nothing = np.zeros((COUNT, COUNT), dtype=bool)
    known, _ = mappers.step("as it is", np.array(room(6.0)), 0, HOME, nothing)
    for noise, doubted in ((0.03, False), (0.3, False), (-3.0, True)):
        ranges = np.array(room(6.0))
        ranges[45] += noise * cos(pi / 90.0)
        assert mappers.step("as it is", ranges, 0, HOME, known)[1] == doubted
