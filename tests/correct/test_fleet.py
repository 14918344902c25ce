"""examples/fleet: robots that are proved, leases that exclude, and one machine in trouble.

Purpose: the claims of docs/fleet.md: proof and recheck, every step against the proofs' plants,
the tests and proofs of what crosses, its bugs found, no collision and SC in time.
Non-goals: processes over DDS (`bench/fleet/dds_junction.py`).
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench.fleet import junction as bench
from bench.fleet.protocol_bugs import BUGS, Bug, counterexample_of

import soter
from soter.cli.main import main
from soter.verify.induction import prove_or_refute

FLEET = Path(__file__).resolve().parents[2] / "examples" / "fleet"
UNCLAIMED = {"P2b", "failsafe"}


@pytest.fixture(scope="module")
def junction() -> soter.Program:
    return soter.load(FLEET / "junction.soter")


# ---------------------------------------------------------------- one robot


def changed(folder: Path, name: str, old: str, new: str) -> Path:
    """The fleet in a new folder, one file of it with another text; its path."""
    shutil.copytree(FLEET, folder)
    text = (folder / name).read_text("utf-8")
    assert old in text, old
    (folder / name).write_text(text.replace(old, new), "utf-8")
    return folder / name


@pytest.mark.parametrize("i", range(bench.ROBOTS))
def test_each_robot_is_proved_and_rechecked_as_the_junction_has_it(i: int, tmp_path: Path) -> None:
    """Its own name, clock and start: no value of them is left to another proof."""
    own = {"reservation.ID": i, "reservation.OFFSET": 25 if i % 2 == 0 else -25}
    program = soter.load(FLEET / "robot.soter")
    report = program.verify(params={**own, "START": -2.0 - 0.5 * i}, cert=tmp_path / "cert")
    verdicts = {k: f.verdict for k, f in report["Guard"].findings.items()}
    assert report["Guard"].verdict == "proved"
    assert {k for k, v in verdicts.items() if v != "proved"} == UNCLAIMED
    assert soter.recheck(tmp_path / "cert").accepted


def test_a_robot_whose_dm_looks_too_late_is_not_proved(tmp_path: Path) -> None:
    path = changed(
        tmp_path / "late", "robot.soter", "const NEED: float = 0.36;", "const NEED: float = 0.15;"
    )
    report = soter.load(path).verify(refute=False)
    assert report["Guard"].findings["P3"].verdict == "undecided"


def _left(program: soter.Program, run: Any, i: int) -> tuple[Any, Any, Any]:
    """What is truly left after every instant, the deviation that acts, and `through`."""
    number = program.constant
    truth = run.truth(f"r[{i}].car.base")
    permit = run.topic(f"r[{i}].car.reservation.permit")
    speed = run.array(f"r[{i}].car.robot.speed") / number("robot.FASTEST")
    x, v, through = truth["x"], np.maximum(truth["v"], 0.0), permit["through"]
    offset = 25 if i % 2 == 0 else -25
    lasts = 0.001 * (permit["until"] - offset) - run.time_s()
    line = np.where(x > number("robot.LENGTH"), number("robot.LAP"), 0.0)
    room = line - x - v**2 / (2.0 * number("robot.BRAKE"))
    sure, gain = number("robot.SURE"), number("robot.GAIN")
    way = np.maximum(number("robot.LENGTH") + 2.0 * number("robot.NOISE_X") - x, 0.0)
    way = way + np.maximum(sure - v, 0.0) ** 2 / (2.0 * gain)
    out = (x > number("robot.LENGTH") + number("robot.NOISE_X")) | (x < -number("robot.NEAR") - 1)
    top = number("robot.TOP")
    left = np.where(through, np.where(out, top, sure * lasts - way), room)
    deviation = np.where(through, 1.0 - speed, speed)
    return np.clip(left, -top, top), deviation, through


@pytest.mark.parametrize("hurry", [True, False])
def test_a_robot_moves_as_the_plant_of_its_proof(junction: soter.Program, *, hurry: bool) -> None:
    """A command takes no more than COST of what is left, and what else changes gives."""
    cost = junction.constant("robot.COST") * junction.constant("robot.FASTEST")
    safe_from = junction.constant("robot.NEED") - junction.constant("robot.ERROR")
    fell = 0.0
    for seed in (1, 2, 3):
        run = junction.simulate(system="Junction", seed=seed, params={"HURRY": hurry}, sha256=False)
        at = np.flatnonzero(
            run.require_trace()["header"]["ct"] % 10_000_000 == 0
        )  # steps of the base
        for i in range(bench.ROBOTS):
            left, deviation, through = (a[at] for a in _left(junction, run, i))
            same = (through[1:] == through[:-1]) & (left[:-1] < junction.constant("robot.TOP"))
            lost = left[:-1] - left[1:]
            most = cost * np.maximum(deviation[1:], deviation[:-1]) * 0.01
            assert (lost[same] <= most[same] + 1e-4).all()
            assert (left[1:][~same] >= np.minimum(safe_from, left[:-1][~same])).all()
            assert (left > 0.0).all()
            fell = max(fell, float(lost.max()))
    assert fell > 0.001


# ---------------------------------------------------------------- what crosses


@pytest.mark.long
def test_leases_exclude_whatever_is_lost_late_or_out_of_order(tmp_path: Path) -> None:
    report = soter.load(FLEET / "reservation_test.soter").explore(
        memory="4G", horizon="600ms", output=tmp_path
    )
    assert {t.name: t.verdict for t in report.tests} == dict.fromkeys(
        ("Alike", "Behind", "Ahead", "Restarted", "TwoManagers", "FromStrangers"), "exhausted"
    )


@pytest.mark.long
@pytest.mark.parametrize("bug", BUGS, ids=lambda b: b.name)
def test_each_bug_of_the_protocol_has_a_shortest_run_that_shows_it(
    bug: Bug, tmp_path: Path
) -> None:
    counterexample = counterexample_of(bug, tmp_path / "wrong")
    assert counterexample.test
    assert counterexample.minimal


LEASES = ("reservation_proof.soter", "robot.Exclusion")
CLAIMS = ("claims_proof.soter", "a.Disjoint")
RESTARTS = ("Restarted", "TwoManagers")
"""Tests of what the proofs are not about: a manager that starts anew, and two of them."""


def _kept_at_all_times(folder: Path, program: str, module: str) -> str:
    """The verdict on what a module keeps, by induction over one hyperperiod."""
    report = soter.load(folder / program).verify(module=module, refute=False)
    return report[module].findings["P2a"].verdict


@pytest.fixture
def one_hyperperiod(monkeypatch: pytest.MonkeyPatch) -> None:
    """The proofs need no more; longer ones take a minute to fail."""
    monkeypatch.setattr(prove_or_refute, "DEPTHS", (1,))


@pytest.mark.usefixtures("one_hyperperiod")
@pytest.mark.parametrize(("program", "module"), [LEASES, CLAIMS])
def test_what_crosses_excludes_at_all_times(program: str, module: str) -> None:
    assert _kept_at_all_times(FLEET, program, module) == "proved"


@pytest.mark.long
@pytest.mark.usefixtures("one_hyperperiod")
@pytest.mark.parametrize("bug", [b for b in BUGS if b.test not in RESTARTS], ids=lambda b: b.name)
def test_no_bug_of_the_leases_is_proved(bug: Bug, tmp_path: Path) -> None:
    path = changed(tmp_path / "wrong", "reservation.soter", bug.right, bug.wrong)
    assert _kept_at_all_times(path.parent, *LEASES) == "undecided"


@pytest.mark.long
@pytest.mark.usefixtures("one_hyperperiod")
@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("now + reservation.E_CLOCK < (now", "now < (now"),
        ("&& m.sent >= now / SLOT * SLOT", ""),
        ("let knows = has_turn(ID, now) && is", "let knows = is"),
        (" && apart(w.lo, w.hi, heard.lo, heard.hi)", ""),
    ],
    ids=["E_CLOCK forgotten", "an old claim", "out of turn", "not looked at"],
)
def test_no_bug_of_the_claims_is_proved(right: str, wrong: str, tmp_path: Path) -> None:
    path = changed(tmp_path / "wrong", "drone.soter", right, wrong)
    assert _kept_at_all_times(path.parent, *CLAIMS) == "undecided"


@pytest.mark.parametrize(
    ("system", "map_"),
    [("Vehicle", "vehicle.toml"), ("Post", "post.toml"), ("Drone", "drone.toml")],
)
def test_a_machine_of_the_fleet_is_a_process_that_speaks_dds(
    system: str, map_: str, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags", reason="the extra is absent: soter-rta[logs]")
    out = tmp_path / "out"
    words = ["build", str(FLEET / "vehicle.soter"), "--system", system, "--target", "dds"]
    assert main([*words, "--map", str(FLEET / map_), "-o", str(out)]) == 0
    (idl,) = (out / "idl").glob("*.idl")
    text = idl.read_text("utf-8")
    crosses = ("Claim_",) if system == "Drone" else ("Grant_", "Request_")
    assert all(message in text for message in crosses)


# ---------------------------------------------------------------- all of them


@pytest.mark.parametrize("kind", bench.KINDS, ids=lambda k: k.name)
def test_nobody_collides_whatever_any_one_machine_does(
    kind: bench.Kind, junction: soter.Program
) -> None:
    bound_s = bench.bound_s(junction)
    assert bound_s == pytest.approx(0.56)  # docs/fleet.md
    for who in kind.machines:
        tally = bench.tallied(junction, kind, who, 2)
        assert tally.collisions == 0
        assert tally.never_sc == 0
        assert max(tally.to_sc_s, default=0.0) <= bound_s
        assert tally.over_bound == 0
        assert tally.lease_over == 0
        assert tally.crossings > 2
        silent = kind.what in {"Stopped", "Cut"}
        assert bool(tally.to_sc_s) == silent


def _kind(name: str) -> bench.Kind:
    (kind,) = (k for k in bench.KINDS if k.name == name)
    return kind


@pytest.mark.parametrize("name", ["clock 2 E_CLOCK behind", "clock jumps 2 E_CLOCK behind"])
def test_a_robots_clock_that_makes_leases_look_younger_is_noticed(
    name: str, junction: soter.Program
) -> None:
    assert bench.tallied(junction, _kind(name), 1, 3).noticed == 3


def test_a_lease_that_is_over_is_counted_where_a_wrong_clock_is_not_looked_for(
    tmp_path: Path,
) -> None:
    """It jumps by 10 s, messages of the future are taken, and a driver idles in the junction."""
    path = changed(
        tmp_path / "trusting",
        "reservation.soter",
        "{ return age_most(now, sent) < 0; }",
        "{ return false; }",
    )
    kind = replace(_kind("clock jumps 2 E_CLOCK behind"), clock_errors=-200, hurry=False)
    tally = bench.tallied(soter.load(path.parent / "junction.soter"), kind, 1, 20)
    assert tally.noticed == 0
    assert tally.lease_over > 0
    assert tally.neither == tally.lease_over


def test_robots_without_their_modules_collide(junction: soter.Program) -> None:
    run = junction.simulate(system="Unprotected", trace=False, sha256=False)
    assert run.violations > 0


def test_robots_that_do_not_ask_how_old_news_are_go_on_for_longer(tmp_path: Path) -> None:
    wanted = "const CONTACT: float = 0.5;"
    path = changed(tmp_path / "deaf", "robot.soter", wanted, "const CONTACT: float = 0.9;")
    program = soter.load(path.parent / "junction.soter")
    tally = bench.Tally(bench.bound_s(soter.load(bench.JUNCTION)))
    for seed in (1, 2, 3):
        bench.one_run(program, _kind("cut off suddenly"), bench.MANAGER, seed, tally)
    assert max(tally.to_sc_s) > tally.bound_s
    assert tally.over_bound == 3
    assert tally.neither == 3


def test_without_the_loop_somebody_drives_into_a_robot_that_died(tmp_path: Path) -> None:
    """What `occupied` is for: no lease speaks of a machine that is no more."""
    seen = "inside(at_0.x) || inside(at_1.x) || inside(at_2.x) || inside(at_3.x)"
    path = changed(tmp_path / "blind", "junction.soter", seen, "false")
    kind = _kind("stopped suddenly")
    assert bench.tallied(soter.load(path), kind, 3, 20).collisions > 0


def test_a_robot_that_hears_nobody_stays_before_the_line() -> None:
    run = soter.load(FLEET / "robot.soter").simulate(until="60s", params={"START": -1.0})
    assert run.truth("base")["x"].max() < 0.0
    assert (run.mode("Guard") == 0).all()


# ---------------------------------------------------------------- two drones


@pytest.mark.parametrize(("i", "start"), [(0, 5), (1, 25)])
def test_each_drone_is_proved_and_rechecked_with_its_fail_safe_law(
    i: int, start: int, tmp_path: Path
) -> None:
    program = soter.load(FLEET / "drone.soter")
    report = program.verify(params={"ID": i, "START": start}, cert=tmp_path / "cert")
    verdicts = {k: f.verdict for k, f in report["Keep"].findings.items()}
    assert {k for k, v in verdicts.items() if v != "proved"} == {"P2b"}  # `recover never`
    assert soter.recheck(tmp_path / "cert").accepted


def test_a_drone_whose_dm_looks_too_late_is_not_proved(tmp_path: Path) -> None:
    path = changed(
        tmp_path / "late", "drone.soter", "const NEED: float = 0.75;", "const NEED: float = 0.4;"
    )
    report = soter.load(path).verify(refute=False)
    assert report["Keep"].findings["P3"].verdict == "undecided"


def test_two_drones_stay_in_claims_that_are_apart() -> None:
    """Every step against the plant of the proof, too: a command takes no more than COST of it."""
    program = soter.load(FLEET / "drones.soter")
    number = program.constant
    drop = number("drone.COST") * 0.01
    changes = 0
    for seed in range(1, 6):
        run = program.simulate(system="Airspace", seed=seed, sha256=False)
        assert run.violations == 0
        at = np.flatnonzero(run.require_trace()["header"]["ct"] % 10_000_000 == 0)
        claims = [run.topic(f"d[{i}].craft.drone.claim")[at] for i in (0, 1)]
        apart = number("drone.APART")
        lo, hi = ([c[end][1:] for c in claims] for end in ("lo", "hi"))
        assert ((hi[0] + apart <= lo[1]) | (hi[1] + apart <= lo[0])).all()
        for i, claim in enumerate(claims):
            truth = run.truth(f"d[{i}].craft.body")
            x, v = truth["x"][at], truth["v"][at]
            u = np.abs(run.array(f"d[{i}].craft.drone.velocity")[at])
            assert ((claim["lo"] <= x) & (x <= claim["hi"]))[1:].all()
            way = np.minimum(claim["hi"] - x, x - claim["lo"]) - v**2 / 2.0 / number("drone.BRAKE")
            room = np.clip(way, -number("drone.TOP"), number("drone.TOP"))
            same = (claim["lo"][1:] == claim["lo"][:-1]) & (claim["hi"][1:] == claim["hi"][:-1])
            fell = (room[:-1] - room[1:])[same]
            assert (fell <= drop * np.maximum(u[1:], u[:-1])[same] + 1e-4).all()
            assert (room[1:][~same][1:] >= number("drone.TOP") - 0.001).all()
            changes += int((~same).sum()) - 1
    assert changes > 10


def test_drones_without_their_modules_meet() -> None:
    run = soter.load(FLEET / "drones.soter").simulate(
        system="Unprotected", trace=False, sha256=False
    )
    assert run.violations > 0


def test_a_drone_that_hears_nobody_keeps_its_claim() -> None:
    run = soter.load(FLEET / "drones.soter").simulate(params={"CUT_S": 0.0}, sha256=False)
    for i in (0, 1):
        claim = run.topic(f"d[{i}].craft.drone.claim")[1:]
        assert len(np.unique(claim[["lo", "hi"]])) == 1
