"""The battery module: proved, confirmed, and not proved without its reserve; docks and ways."""

from __future__ import annotations

import importlib
import json
import math
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.drone.wrong_base import WRONG, Edit, laid_out, verdict

import soter
from examples_changed import changed
from soter.api import load

if TYPE_CHECKING:
    from collections.abc import Iterator

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
ALL = {"P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start"}


# ---------------------------------------------------------------- the proof


@pytest.mark.long
def test_the_battery_is_proved_and_confirmed(tmp_path: Path) -> None:
    program = load(DRONE / "battery.soter")
    report = program.verify(refute=False, cert=tmp_path / "cert")
    (module,) = report.modules
    assert module.verdict == "proved"
    recheck_report = soter.recheck(tmp_path / "cert")
    assert recheck_report.accepted
    assert {c for m in recheck_report.modules for c in m.confirmed} >= ALL


IN_THE_BENCH = ("no reserve", "cheap landing", "SC flies on", "slow start")
"""Of the wrong batteries that `bench/drone/wrong_stacks.py` flies, too."""
NOT_BY_THE_MODEL = (
    Edit("battery.soter", "ttf margin < E +", "ttf margin < 0.0 * E +"),
    Edit("battery.soter", "const TURN: float = 1.5;", "const TURN: float = 0.5;"),
    Edit("battery.soter", "safer margin > FULL;", "safer margin > 0.0;"),
)
"""No flight shows these: there is room in other constants. There is no proof all the same."""


@pytest.mark.parametrize(
    "edits",
    [
        *(w.edits for w in WRONG if w.kind == "battery" and w.name in IN_THE_BENCH),
        *((e,) for e in NOT_BY_THE_MODEL),
    ],
    ids=lambda edits: edits[0].new[:30],
)
def test_a_battery_without_reserve_is_not_proved(tmp_path: Path, edits: tuple[Edit, ...]) -> None:
    assert not verdict(laid_out(tmp_path, edits), ("battery.soter", "SafeBattery")).proved


# ---------------------------------------------------------------- what the proof assumes


def test_what_is_left_behaves_as_the_plant_of_the_proof(drone: Path) -> None:
    """m falls no faster than SPENT, and rises by GAIN at least once a landing was asked for."""
    changed(
        drone / "battery.soter",
        "node Land period",
        "input topic nerve: float in [-1.0, 3.0];\n"
        "node Fickle period 500ms {\n  subscribes nerve;\n  publishes go;\n"
        "  step { publish go = clamp(nerve, 0.0, 1.0); }\n}\nnode Land period",
    )
    changed(
        drone / "battery.soter",
        "  module SafeBattery;\n",
        "  module SafeBattery;\n  replace Onwards by Fickle;\n  input nerve every 17s;\n",
    )
    program = load(drone / "battery.soter")
    run = program.simulate(until=1500.0, seed=4)
    assert run.violations == 0
    known = {n: float(program.constant(n)) for n in ("DRAIN", "SPENT", "GAIN", "E", "TOP")}
    assert run.trace is not None
    step_s, topics = float(np.diff(run.time_s()).max()), run.trace["topics"]
    left, go, shown = topics["landing"]["left"], topics["go"], topics["margin"]
    m = run.trace["b"]["charge"] - known["DRAIN"] * left
    tick = 2.0 * known["DRAIN"] * 0.1  # `left` goes in steps of 100 ms
    assert np.abs(shown - m).max() <= known["E"]
    wide = round(5.0 / step_s)
    gained = m[wide:] - m[:-wide]
    assert gained.min() >= -known["SPENT"] * 5.0 - tick
    since = round(0.3 / step_s)
    landing = (go == 0.0) & (m <= known["TOP"])
    zero = np.convolve(landing, np.ones(wide + since), "valid") == wide + since
    assert zero.sum() > 1000
    assert (gained[since:][: zero.size][zero[: gained.size - since]]).min() >= (
        known["GAIN"] * 5.0 - tick
    )


# ---------------------------------------------------------------- docks


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """examples/drone/roadmap.py."""
    monkeypatch.syspath_prepend(str(DRONE))
    return importlib.import_module("roadmap")


def homes(room: Any, docks: list[Any], nodes: list[Any], metres: Any, hop: Any) -> list[float]:
    """From each node to a dock, by the file's lengths."""
    ends = [
        [math.dist(n, d) if room.shares_a_box((d, d), n) else math.inf for d in docks]
        for n in nodes
    ]
    return [
        min(
            (0.0 if i == j else metres[i][j]) + min(ends[j])
            for j in range(len(nodes))
            if i == j or hop[i][j] >= 0
        )
        for i in range(len(nodes))
    ]


def parts(cell: Any) -> Iterator[Any]:
    low, high = cell
    middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    for up in product((False, True), repeat=3):
        yield (
            tuple(m if u else a for u, m, a in zip(up, middle, low, strict=True)),
            tuple(b if u else m for u, m, b in zip(up, middle, high, strict=True)),
        )


def test_from_everywhere_a_dock_is_no_farther_than_a_landing_may_lead(script: Any) -> None:
    """Cell by cell, in parts where that is needed: the farthest corner, over a node in sight."""
    program = load(DRONE / "docks.soter")
    longest = float(program.constant("LONGEST"))
    room = script.inner_room()
    docks = [(float(d.x), float(d.y), float(d.z)) for d in program.constant("DOCK")]
    roadmap = json.loads((DRONE / "roadmap.json").read_text(encoding="utf-8"))
    nodes = [(n["x"], n["y"], n["z"]) for n in roadmap["nodes"]]
    ways = homes(room, docks, nodes, roadmap["metres"], roadmap["hop"])
    assert [h.metres for h in program.constant("HOMES")][: len(nodes)] == pytest.approx(ways)
    ends = [*zip(nodes, ways, strict=True), *((d, 0.0) for d in docks)]
    todo, farthest = [(c, 0) for c in script.cells_of(room)], 0.0
    while todo:
        cell, depth = todo.pop()
        corners = list(product(*zip(*cell, strict=True)))
        far = min(
            max(math.dist(c, p) for c in corners) + more
            for p, more in ends
            if room.shares_a_box(cell, p)
        )
        if far > longest:
            assert depth < 6, (cell, far)
            todo += [(part, depth + 1) for part in parts(cell)]
        else:
            farthest = max(farthest, far)
    assert farthest > 0.8 * longest  # or the bound is idle


@pytest.mark.parametrize(
    ("dock", "words"),
    [
        ("vec3(44.4, 26.0, 0.5)", "too near to a wall"),
        ("vec3(24.0, 30.0, 2.0)", "too near to a wall"),
        ("vec3(24.0, 18.0, 4.5)", "on a building"),
    ],
)
def test_a_dock_that_is_none_is_refused(drone: Path, dock: str, words: str) -> None:
    changed(drone / "docks.soter", "vec3(44.4, 26.0, POST)", dock)
    with pytest.raises(soter.SoterError, match=words):
        load(drone / "docks.soter").verify(refute=False)
