"""RRT* as an extern: exact checks, one plan a seed, bugs that show; and without OMPL."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import processes
import soter
from generators.drone_covering import Onboard

if TYPE_CHECKING:
    from collections.abc import Sequence

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
START, GOAL = (6.0, 28.0, 2.0), (31.0, 45.0, 2.5)


@pytest.fixture(scope="module")
def onboard(tmp_path_factory: pytest.TempPathFactory) -> Onboard:
    return Onboard(DRONE, tmp_path_factory.mktemp("covering"))


@pytest.fixture
def rrt(monkeypatch: pytest.MonkeyPatch) -> Any:
    """examples/drone/rrt_star.py, where OMPL is there."""
    pytest.importorskip("ompl", reason="the planner is OMPL's")
    monkeypatch.syspath_prepend(str(DRONE))
    return importlib.import_module("rrt_star")


@pytest.fixture
def clearance(onboard: Onboard) -> tuple[float, float, float]:
    x, y, z = onboard.constants["CLEARANCE"]
    return (x, y, z)


def planned(rrt: Any, clearance: Sequence[float], bug: str = "Unbroken", number: int = 1) -> Any:
    planner = rrt.RRTStar()
    planner.answered = number
    return planner.plan(START, GOAL, clearance, bug)


# ---------------------------------------------------------------- the planner


def test_the_same_seed_gives_the_same_plan_and_another_another(rrt: Any, clearance: Any) -> None:
    first, other, again = (planned(rrt, clearance, number=n) for n in (1, 2, 1))
    assert first == again
    assert first != other
    assert first[0] == START
    assert first[-1] == GOAL


def test_a_plan_is_covered(rrt: Any, clearance: Any, onboard: Onboard) -> None:
    plans = [planned(rrt, clearance, number=n) for n in range(20)]
    answers = onboard.cover(plans, [(START, GOAL)] * 20)
    assert {a.verdict for a in answers} == {"Covered"}


def test_the_planner_and_the_program_see_the_same_walls(
    rrt: Any, clearance: Any, onboard: Onboard
) -> None:
    room = rrt.room(clearance)
    known = onboard.constants
    assert np.allclose(room.walls, known["THICK"], rtol=0.0, atol=1e-9)
    assert np.allclose((room.low, room.high), known["INNER"], rtol=0.0, atol=1e-9)


def test_a_motion_is_checked_between_its_ends(rrt: Any, clearance: Any) -> None:
    room = rrt.room(clearance)
    west, east = (25.0, 22.0, 2.0), (32.0, 22.0, 2.0)  # a wall 1 m thick lies between them
    assert room.free(west)
    assert room.free(east)
    assert not room.clear(west, east)
    assert not room.clear(east, west)
    assert room.clear(west, west)


def test_heights_are_bent_and_straightened_again(rrt: Any, clearance: Any) -> None:
    layers = rrt.Layers(rrt.room(clearance))
    assert len(layers.planes) > 2
    for z in np.linspace(layers.planes[0], layers.planes[-1], 101):
        height = layers.height(float(z))
        assert layers.planes[0] - 1e-12 <= height <= layers.planes[-1] + 1e-12
        assert abs(layers.city((1.0, 2.0, height))[2] - z) < 1e-12


def test_the_bugs_are_those_of_the_program(rrt: Any) -> None:
    request: Any = soter.load(DRONE / "planner.soter").check()
    assert request.systems
    text = (DRONE / "planner.soter").read_text(encoding="utf-8")
    members = text.split("type Bug = enum {")[1].split("}")[0]
    assert tuple(m.strip() for m in members.split(",")) == rrt.BUGS


@pytest.mark.parametrize(
    ("bug", "reasons"),
    [
        ("NoEdgeCheck", {"InBuilding", "TooNarrow"}),
        ("NoRecheckOnSmoothing", {"InBuilding", "TooNarrow"}),
        ("CoarseResolution", {"InBuilding", "TooNarrow"}),
        ("StaleObstacle", {"InBuilding", "TooNarrow", "OutsideMap"}),
        ("MissingObstacle", {"InBuilding", "TooNarrow"}),
        ("MissingFrameShift", {"InBuilding", "TooNarrow", "OutsideMap", "Elsewhere"}),
        ("ApproximateAccepted", {"Elsewhere"}),
        ("NoInflation", {"InBuilding", "TooNarrow", "OutsideMap"}),
        ("EmptyPlan", {"Empty"}),
        ("NotANumber", {"NotFinite"}),
        ("DuplicatedPlan", {"InBuilding", "TooNarrow", "TooLong"}),
    ],
)
def test_each_bug_shows_and_is_refused(
    rrt: Any, clearance: Any, onboard: Onboard, bug: str, reasons: set[str]
) -> None:
    """A bug that never shows would be no test of who refuses it."""
    candidates = [planned(rrt, clearance, bug, number) for number in range(40)]
    plans = [p for p in candidates if p is not None and len(p) <= onboard.points]
    assert plans
    refused = {a.verdict for a in onboard.cover(plans, [(START, GOAL)] * len(plans))} - {"Covered"}
    assert refused
    assert refused <= reasons


def test_a_late_plan_is_one_for_the_request_before(rrt: Any, clearance: Any) -> None:
    planner = rrt.RRTStar()

    def request(number: int, goal: tuple[float, ...], bug: str) -> SimpleNamespace:
        def vec(p: Sequence[float]) -> SimpleNamespace:
            return SimpleNamespace(**dict(zip("xyz", p, strict=True)))

        asked = {"start": vec(START), "goal": vec(goal), "clearance": vec(clearance)}
        return SimpleNamespace(request=SimpleNamespace(number=number, bug=bug, **asked))

    first = planner.step(request(1, GOAL, "Unbroken"))["candidate"]
    assert planner.step(request(1, GOAL, "Unbroken")) is None  # once for each request
    late = planner.step(request(2, (47.0, 3.0, 2.0), "LatePlan"))["candidate"]
    assert late == first


# ---------------------------------------------------------------- the module


def test_the_module_flies_only_corridors_that_are_sound_whatever_the_bugs(rrt: Any) -> None:
    run = soter.load(DRONE / "planner.soter").simulate("Broken", until="40s", seed=3)
    assert rrt.base is not None
    assert run.violations == 0
    force = run.topic("inForce")
    assert force["adopted"][-1] > 15
    assert run.modules["SafePlanner"].switches_to_sc > 5


def test_the_same_seed_gives_the_same_run(rrt: Any) -> None:
    program = soter.load(DRONE / "planner.soter")
    assert rrt.base is not None
    first, again = (program.simulate(until="15s", seed=5).trace_sha256 for _ in range(2))
    assert first == again


@pytest.mark.parametrize(
    "answer",
    [
        {"candidate": [(2.0, 2.0, 2.0)] * 33},
        {"candidate": [(float("inf"), 2.0, 2.0)] * 2},
        {"candidate": [(1e9, 2.0, 2.0)] * 2},
        {"candidate": [(2.0, 2.0)]},
        {"candidate": []},
        {"candidate": [(35.0, 30.0, 2.0)] * 2},
        None,
    ],
)
def test_whatever_the_planner_publishes_the_roadmap_plans_on(answer: Any) -> None:
    program = soter.load(DRONE / "planner.soter").bind("RRTStar", lambda _: answer)
    run = program.simulate(until="20s", seed=1)
    assert run.violations == 0
    assert run.topic("inForce")["adopted"][-1] > 5


def test_without_ompl_the_roadmap_plans_and_the_run_says_why(tmp_path: Path) -> None:
    (tmp_path / "ompl").mkdir()
    (tmp_path / "ompl" / "__init__.py").write_text("raise ImportError('none here')\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    script = (
        "import soter, sys\n"
        "run = soter.load(sys.argv[1]).simulate(until='20s', seed=1)\n"
        "force = run.topic('inForce')\n"
        "share = run.modules['SafePlanner'].ac_share\n"
        "print(run.violations, force['adopted'][-1], force['refused'][-1], share)\n"
        "print(run)\n"
        "print(run.extern_failures)\n"
    )
    done = processes.run(
        [sys.executable, "-c", script, str(DRONE / "planner.soter")],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    violations, adopted, refused, share = done.stdout.splitlines()[0].split()
    assert (violations, refused, float(share)) == ("0", "0", 0.0)
    assert int(adopted) > 5
    assert "OMPL is not installed" in done.stdout
    assert "soter-rta[demo]" in done.stdout
