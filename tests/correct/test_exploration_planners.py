"""Planners of others in unknown space: OMPL's, a learned one; what they may do is judged as ever.

Purpose: that they explore, that equal seeds give equal flights, that the exploration goes on where
they fault or are not there.
Non-goals: figures (`bench/exploration/worlds.py`).
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import processes
import soter

if TYPE_CHECKING:
    from soter.simulate.result import Run

FOLDER = Path(__file__).parents[2] / "examples" / "exploration"
SIDE = 40


@cache
def program(name: str) -> soter.Program:
    return soter.load(FOLDER / name)


@cache
def answering() -> soter.Program:
    """One whose planner is bound to something else, again and again."""
    return soter.load(FOLDER / "rrt_connect.soter")


def topic(run: Run, name: str) -> Any:
    topics = run.final["topics"]
    (full_name,) = [n for n in topics.dtype.names if f".{n}".endswith(f".{name}")]
    return topics[full_name]


# ---------------------------------------------------------------- OMPL


@pytest.fixture
def rrt(monkeypatch: pytest.MonkeyPatch) -> Any:
    """examples/exploration/rrt_connect.py, where OMPL is there."""
    pytest.importorskip("ompl", reason="the planner is OMPL's")
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("rrt_connect")


def around_a_wall() -> np.ndarray:
    known = np.ones((SIDE, SIDE), dtype=bool)
    known[18:22, : SIDE - 9] = False
    return known


def asked(known: np.ndarray, number: int = 1) -> Any:
    request = SimpleNamespace(number=number, start=5 * SIDE + 5, goal=33 * SIDE + 5, room=3)
    return SimpleNamespace(known=known.ravel().tolist(), request=request)


def test_a_way_leads_from_start_to_goal_over_places_with_room(rrt: Any) -> None:
    known = around_a_wall()
    fits = rrt.places(known, 3)
    for i, j in np.argwhere(fits):
        assert known[i - 3 : i + 4, j - 3 : j + 4].all()
    assert fits.sum() == sum(
        known[i - 3 : i + 4, j - 3 : j + 4].all()
        for i in range(3, SIDE - 3)
        for j in range(3, SIDE - 3)
    )
    for number in range(1, 11):
        plan = rrt.RRTConnect().step(asked(known, number))["plan"]
        assert plan["number"] == number
        points = plan["points"]
        assert (points[0], points[-1]) == ((5.5, 5.5), (33.5, 5.5))
        assert max(y for _, y in points) > SIDE - 9, "the wall is closed before that"
        for a, b in pairwise(points):
            for share in np.linspace(0.0, 1.0, 400):
                x, y = (p + share * (q - p) for p, q in zip(a, b, strict=True))
                assert fits[int(x - 0.3) : int(x + 0.3) + 1, int(y)].any()


def test_the_same_request_gives_the_same_way_and_is_answered_once(rrt: Any) -> None:
    first, again = rrt.RRTConnect(), rrt.RRTConnect()
    assert first.step(asked(around_a_wall())) == again.step(asked(around_a_wall()))
    assert first.step(asked(around_a_wall())) is None
    others = [p.step(asked(around_a_wall(), n))["plan"] for p, n in ((first, 2), (again, 3))]
    assert others[0]["points"] != others[1]["points"]


def test_where_there_is_no_way_nothing_is_published(
    rrt: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rrt, "ITERATIONS", 200)
    known = around_a_wall()
    known[18:22] = False
    assert rrt.RRTConnect().step(asked(known)) is None


def test_it_explores_and_equal_seeds_give_equal_flights(rrt: Any) -> None:
    assert rrt.base is not None
    flights = [
        program("rrt_connect.soter").simulate(until="20s", seed=2, trace=False) for _ in range(2)
    ]
    assert flights[0].trace_sha256 == flights[1].trace_sha256
    assert flights[0].violation_list == []
    assert flights[0].modules["AnyWay"].ac_share > 0.9
    assert topic(flights[0], "known").sum() > 3000


@pytest.mark.parametrize(
    "answer",
    [
        {"number": 1, "points": [(60.0, 60.0)] * 33},
        {"number": 1, "points": [(float("nan"), 60.0)] * 2},
        {"number": 1, "points": [(60.0, 500.0)] * 2},
        {"number": 1, "points": [(60.0, 60.0), (0.0, 0.0), (120.0, 120.0)]},
        {"number": 1_000_000_000, "points": []},
        "nonsense",
        None,
    ],
)
def test_whatever_the_planner_answers_the_exploration_goes_on(answer: Any) -> None:
    answering().bind("RRTConnect", lambda _: {"plan": answer})
    run = answering().simulate(until="20s", seed=2, trace=False, sha256=False)
    assert run.violation_list == []
    assert topic(run, "known").sum() > 3000


def test_without_ompl_the_exploration_goes_on_and_the_run_says_why(tmp_path: Path) -> None:
    (tmp_path / "ompl").mkdir()
    (tmp_path / "ompl" / "__init__.py").write_text("raise ImportError('none here')\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-m", "soter", "run", str(FOLDER / "rrt_connect.soter")]
    done = processes.run(
        [*command, "--until", "20s", "--seed", "2"],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "pip install 'soter-rta[demo]'" in done.stdout
    assert "NEVER ANSWERED" in done.stdout


# ---------------------------------------------------------------- a learned one


@pytest.fixture
def learning(monkeypatch: pytest.MonkeyPatch) -> Any:
    """examples/exploration/learned_train.py."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("learned_train")


def weights() -> np.ndarray:
    """Those that are shipped, (neurons, sights + 1)."""
    told = json.loads((FOLDER / "learned.json").read_text(encoding="utf-8"))
    return np.column_stack([told["hidden"], told["output"]])


def test_the_network_that_flies_is_the_one_that_was_trained(learning: Any) -> None:
    shipped = weights()
    assert shipped.shape == (learning.NEURONS, learning.SIGHTS + 1)
    how: dict[str, Any] = {"until": "15s", "seed": 2, "sha256": False}
    flying = program("exploration_adversaries.soter").simulate(
        "Learned", trace=["e.learned.choice"], **how
    )
    taught = soter.load(FOLDER / "learned.soter").bind("Pupil", learning.Pupil(shipped))
    school = taught.simulate("School", trace=["e.choice"], **how)
    assert school.extern_failures == {}
    choices = flying.topic("e.learned.choice")
    assert (choices == school.topic("e.choice")).all()
    assert len(set(choices.tolist())) > 5
    wrong = learning.Pupil(np.column_stack([shipped[:, :-1], -shipped[:, -1]]))
    other = taught.bind("Pupil", wrong).simulate("School", trace=["e.choice"], **how)
    assert (choices != other.topic("e.choice")).any()


@pytest.mark.parametrize("seed", [1, 5])
def test_what_was_learned_touches_nothing_behind_the_module_and_a_wall_alone(seed: int) -> None:
    flights = [
        program("exploration_adversaries.soter").simulate(
            system, until="60s", seed=seed, trace=False, sha256=False
        )
        for system in ("Learned", "BareLearned")
    ]
    assert flights[0].violation_list == []
    assert topic(flights[0], "known").sum() > 4000
    assert any("Collides" in v.what for v in flights[1].violation_list)


def test_equal_seeds_train_equal_weights(
    learning: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in (("CANDIDATES", 3), ("BEST", 2), ("WORLDS", 1)):
        monkeypatch.setattr(learning, name, value)
    one, again, other = (learning.train(seed, rounds=1, workers=1) for seed in (1, 1, 2))
    assert (one == again).all()
    assert (one != other).any()
    learning.write(one, "a table", tmp_path / "learned.json")
    told = json.loads((tmp_path / "learned.json").read_text(encoding="utf-8"))
    assert (np.column_stack([told["hidden"], told["output"]]) == one).all()
