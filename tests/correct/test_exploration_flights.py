"""The drone in unknown space: who means ill touches nothing, and what is wrong with a sensor shows.

Purpose: short flights of `examples/exploration`, with and without what is assumed of sensors; the
paper's goals. That known cells are free is held in `test_exploration_mapper.py`.
Non-goals: figures (`bench/exploration/worlds.py`).
"""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import soter

if TYPE_CHECKING:
    from soter.simulate.result import Run

FOLDER = Path(__file__).parents[2] / "examples" / "exploration"
ADVERSARIES = "exploration_adversaries.soter"
WORLDS = (2, 5)
"""Seeds: rooms, and rooms with furniture."""


@cache
def program(name: str) -> soter.Program:
    return soter.load(FOLDER / name)


def flown(name: str, system: str, seed: int, until: str, **params: Any) -> Run:
    values = {key.replace("__", "."): value for key, value in params.items()}
    return program(name).simulate(
        system, until=until, seed=seed, params=values, trace=False, sha256=False
    )


def topic(run: Run, name: str) -> Any:
    topics = run.final["topics"]
    (full_name,) = [n for n in topics.dtype.names if f".{n}".endswith(f".{name}")]
    return topics[full_name]


@pytest.mark.parametrize("seed", WORLDS)
@pytest.mark.parametrize(
    "system",
    ["Ramming", *(pytest.param(s, marks=pytest.mark.long) for s in ("Jerking", "Bugs"))],
)
def test_whoever_flies_stays_in_boxes_that_are_known_to_be_free(system: str, seed: int) -> None:
    run = flown(ADVERSARIES, system, seed, "60s")
    assert run.violation_list == []
    assert topic(run, "known").sum() > 1000


@pytest.mark.parametrize("seed", WORLDS)
def test_the_same_without_a_decision_module_collides(seed: int) -> None:
    run = flown(ADVERSARIES, "BareRamming", seed, "60s")
    assert any("Collides" in v.what for v in run.violation_list)
    assert any("Contains" in v.what for v in run.violation_list)


@pytest.mark.long
def test_a_stop_zone_without_timing_collides() -> None:
    run = flown(ADVERSARIES, "StopZone", 2, "60s")
    assert any("Collides" in v.what for v in run.violation_list)


@pytest.mark.long
@pytest.mark.parametrize(("bug", "least"), [("IntoUnknown", 50), ("IgnoresMap", 100)])
def test_boxes_that_nobody_saw_to_be_free_are_refused(bug: str, least: int) -> None:
    run = flown(ADVERSARIES, "Bugs", 2, "60s", BUG=bug)
    assert topic(run, "survey")["refused"] >= least
    assert run.violation_list == []


@pytest.mark.long
@pytest.mark.parametrize(
    "wrong",
    [{"worlds__JUMP": 1.0}, {"worlds__NOISE": 20.0}],
    ids=["the estimate jumps", "noise is twenty times what is declared"],
)
def test_scans_that_contradict_what_is_known_end_the_exploration(wrong: dict[str, Any]) -> None:
    run = flown("exploration.soter", "Explore", 2, "60s", **wrong)
    assert topic(run, "doubt")
    assert topic(run, "way")["careful"]
    assert topic(run, "way")["stay"]
    assert int(run.final["modules"]["mode"][0]) == 0, "SC alone flies from then on"


@pytest.mark.long
def test_nothing_is_doubted_where_everything_is_as_declared() -> None:
    assert not topic(flown("exploration.soter", "Explore", 2, "60s"), "doubt")


@pytest.mark.long
def test_with_mirrors_only_those_collide_who_take_silence_for_free() -> None:
    trusting = flown("exploration.soter", "Explore", 5, "60s", worlds__MIRRORS=True)
    careful = flown(
        "exploration.soter", "Explore", 5, "60s", worlds__MIRRORS=True, mapper__SILENCE=False
    )
    assert any("Collides" in v.what for v in trusting.violation_list)
    assert careful.violation_list == []


def test_of_the_papers_goals_those_within_the_wall_are_reached() -> None:
    run = program("paper.soter").simulate(trace=False, sha256=False)
    assert run.violation_list == []
    tour = topic(run, "tour")
    assert int(tour["number"]) == 10
    assert [k + 1 for k in range(10) if not tour["reached"][k]] == [3, 6, 9]


def changed(work: Path, file: str, old: str, new: str) -> Path:
    """A copy of the examples with one line of a file of theirs in other words."""
    for name in ("drone", "exploration"):
        shutil.copytree(FOLDER.parent / name, work / name)
    path = work / "exploration" / file
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path.parent


def test_goals_in_walls_and_out_of_the_map_are_given_up(tmp_path: Path) -> None:
    first = "place(16.0, 12.0), place(15.5, 16.5), place(12.0, 20.5), place(10.5, 16.5),"
    bad = "place(5.2, 11.0), place(-30.0, 12.0), place(0.0, 1.0e30), place(16.0, 12.0),"
    folder = changed(tmp_path, "paper.soter", first, bad)
    run = soter.load(folder / "paper.soter").simulate(until="60s", trace=False, sha256=False)
    assert run.violation_list == []
    tour = topic(run, "tour")
    assert int(tour["number"]) >= 4
    assert [bool(reached) for reached in tour["reached"][:4]] == [False, False, False, True]


def test_a_start_that_is_not_known_to_be_free_is_refused_by_the_compiler(tmp_path: Path) -> None:
    small = "const HOME: float = 0.8;  // m, half of its side"
    folder = changed(tmp_path, "grid.soter", small.replace("0.8", "2.0"), small)
    with pytest.raises(soter.SoterError) as refused:
        soter.load(folder / "exploration.soter").simulate(until="1s")
    assert "what is flown first lies at home" in str(refused.value)


def test_boxes_of_an_old_map_are_still_free(tmp_path: Path) -> None:
    """Cells only grow: an old map costs time and no wall is touched."""
    later = changed(
        tmp_path, "exploration_adversaries.soter", "STALE: int = 240", "STALE: int = 20"
    )
    run = soter.load(later / ADVERSARIES).simulate(
        "Bugs", until="60s", seed=2, params={"BUG": "StaleMap"}, trace=False, sha256=False
    )
    assert run.violation_list == []
    assert topic(run, "survey")["refused"] == 0
    assert topic(run, "survey")["adopted"] > 100


@pytest.mark.long
def test_both_engines_explore_alike() -> None:
    runs = [
        program("exploration.soter").simulate(until="0.4s", engine=engine)
        for engine in ("native", "interp")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
