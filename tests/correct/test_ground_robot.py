"""The ground robot: what is proved of it, a hall that does not know the proof, and bolder robots.

Purpose: examples/ros/ground_robot.soter is proved and deployed; the 2-D hall is no harder than the
plant of the proof says, step by step; a bolder module is refuted by the prover and collides.
Non-goals: the table of the page (`bench/ros/ground_robot.py`); ROS itself (`test_ros_nodes.py`).
"""

from __future__ import annotations

import itertools
import math
import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import soter
from soter.diagnostics.diagnostic import SoterError

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "ros"
ROBOT, HALL = EXAMPLES / "ground_robot.soter", EXAMPLES / "ground_robot_hall.soter"
SECTOR = 0.16  # rad: the page's, what may lie between two rays
SWEEP_S = 0.1


def changed(folder: Path, *pairs: tuple[str, str]) -> Path:
    """The robot with another text, and the hall that imports it."""
    text = ROBOT.read_text("utf-8")
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    (folder / ROBOT.name).write_text(text, encoding="utf-8")
    shutil.copy(HALL, folder)
    return folder / ROBOT.name


# ---------------------------------------------------------------- the proof


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    folder = tmp_path_factory.mktemp("proof") / "cert"
    return folder, soter.load(ROBOT).verify(refute=False, cert=folder)


def test_it_is_proved_and_somebody_else_agrees(certificate: tuple[Path, Any]) -> None:
    folder, report = certificate
    guard = report["Guard"]
    verdicts = {name: f.verdict for name, f in guard.findings.items()}
    assert verdicts.pop("P2b") == "assumed"  # `recover never`
    assert set(verdicts.values()) == {"proved"}, verdicts
    again = soter.recheck(folder)
    assert again.accepted, again.reason


FASTER = (
    ("const FASTEST: float = 0.22", "const FASTEST: float = 0.5"),
    ("const RADIUS: float = 0.13", "const RADIUS: float = 0.2"),
    ("const NOISE: float = 0.085", "const NOISE: float = 0.17"),
    ("const FAR: float = 0.45", "const FAR: float = 1.0"),
)


def test_a_faster_robot_is_proved_by_its_figures_alone(tmp_path: Path) -> None:
    """The table of docs/ground-robot.md, "Another robot"."""
    report = soter.load(changed(tmp_path, *FASTER)).verify(refute=False)
    assert report["Guard"].verdict == "proved"


@pytest.mark.parametrize(
    "change",
    [
        ("max_age 150ms;", "max_age 250ms;"),  # an older scan
        ("ttf room(nearest) < NEED", "ttf room(nearest) < ERROR + 0.06"),
        ("SLACK: float = ERROR + 0.185", "SLACK: float = ERROR + 0.14"),
        ("within ERROR,", "within ERROR + 0.01,"),
        ("toward * WORST", "toward * 1.2 * WORST"),  # a base that picks up speed more quickly
    ],
)
def test_a_change_for_the_worse_is_not_proved(tmp_path: Path, change: tuple[str, str]) -> None:
    report = soter.load(changed(tmp_path, change)).verify(refute=False)
    assert report["Guard"].verdict == "undecided"


# ---------------------------------------------------------------- on the robot


@pytest.mark.parametrize("name", ["ground_robot.toml", "ground_robot_stamped.toml"])
def test_the_package_of_ros1_inherits_the_proof(
    tmp_path: Path, name: str, certificate: tuple[Path, Any]
) -> None:
    pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
    built = soter.load(ROBOT).build(
        "ros1", tmp_path / "robot", system="Vehicle", mapping=EXAMPLES / name, cert=certificate[0]
    )
    (proofs, _) = built.inherits
    assert "P1c P2a P3 ttf safer start failsafe of `Proved`" in proofs
    topics = (tmp_path / "robot" / "src" / "ground_robot_topics.hpp").read_text("utf-8")
    assert "soter::nearest_distance(m, 0.45, 2U, &(*to).f_distance)" in topics or (
        "soter::nearest_distance(m, 0.45, 2U, &(*to).distance)" in topics
    )
    assert "return soter::last_ray_ns(m, soter::ns_of(m.header.stamp));" in topics
    assert ("TwistStamped" in topics) == ("stamped" in name)


def test_scans_that_come_less_often_are_refused(tmp_path: Path) -> None:
    path = changed(
        tmp_path, ("nearest every 100ms delayed 30ms", "nearest every 200ms delayed 30ms")
    )
    with pytest.raises(SoterError, match="may be 247 ms old when SC reads it") as error:
        soter.load(path).build("posix", tmp_path / "robot", system="Vehicle")
    assert error.value.diagnostics[0].code == "D019"


# ---------------------------------------------------------------- the hall against the abstraction


@pytest.fixture(scope="module")
def hall() -> soter.Program:
    return soter.load(HALL)


def constant(hall: soter.Program, name: str) -> Any:
    return hall.constant(name)


def boxes(hall: soter.Program) -> np.ndarray[Any, Any]:
    """West, south, east, north of each (n, 4): the same numbers, and no code of the program."""
    return np.array([[b.low.x, b.low.y, b.high.x, b.high.y] for b in constant(hall, "BOXES")])


def distances(hall: soter.Program, x: Any, y: Any) -> Any:
    """From places (n,) to what is nearest."""
    west, east = constant(hall, "WEST"), constant(hall, "EAST")
    south, north = constant(hall, "SOUTH"), constant(hall, "NORTH")
    least = np.minimum.reduce([x - west, east - x, y - south, north - y])
    for w, s, e, n in boxes(hall):
        dx, dy = (
            np.maximum(np.maximum(w - x, x - e), 0.0),
            np.maximum(np.maximum(s - y, y - n), 0.0),
        )
        least = np.minimum(least, np.hypot(dx, dy))
    return least


RUNS = [*itertools.product(("Guarded", "Alone"), range(5))]


@pytest.fixture(scope="module")
def driven(hall: soter.Program) -> list[Any]:
    keep = ["car.place", "car.robot.drive", "car.echo", "car.robot.nearest"]
    return [
        hall.simulate(system=s, seed=7 + k, params={"KIND": k}, trace=keep, sha256=False)
        for s, k in RUNS
    ]


def robot(hall: soter.Program, name: str) -> float:
    return float(constant(hall, f"robot.{name}"))


def test_the_hall_is_no_harder_than_the_plant_of_the_proof(
    hall: soter.Program, driven: list[Any]
) -> None:
    """left' >= -WORST |u|, and the distance changes no faster than the robot moves."""
    worst, brake = robot(hall, "WORST"), robot(hall, "BRAKE")
    closest = 0.0
    for run in driven:
        steps = run.time_s() * 100.0
        at = np.isclose(steps, np.round(steps))  # the base's, each 10 ms
        place, told = run.topic("car.place")[at], run.topic("car.robot.drive")["v"][at]
        d, v = distances(hall, place["p"]["x"], place["p"]["y"]), place["v"]
        left = np.minimum(d, robot(hall, "FAR")) - v * v / (2.0 * brake) + robot(hall, "HALF")
        assert np.all(np.abs(np.diff(d)) <= 0.01 * np.maximum(np.abs(v[1:]), np.abs(v[:-1])) + 1e-9)
        loss = left[:-1] - left[1:]
        allowed = worst * 0.01 * np.abs(told[:-1])
        assert np.all(loss <= allowed + 1e-9), float(np.max(loss - allowed))
        rise = -loss[place["touched"][1:] == 0]  # what a wall stops has no way to a stop
        assert np.all(rise <= 0.01 * 3.0 * robot(hall, "FASTEST") + 1e-9)
        closest = max(closest, float(np.max(loss / (allowed + 1e-3))))
    assert closest > 0.5  # the bound is met: the hall tests it


def test_what_the_scanner_tells_is_within_the_declared_error(
    hall: soter.Program, driven: list[Any]
) -> None:
    """What is left of NOISE is for moving while the scanner turns."""
    far, grain = robot(hall, "FAR"), float(constant(hall, "GRAIN"))
    room = robot(hall, "NOISE") - robot(hall, "FASTEST") * SWEEP_S
    most = 0.0
    for run in driven:
        tenths = run.time_s() * 10.0
        at = np.flatnonzero(np.isclose(tenths, np.round(tenths)))
        place, echo = run.topic("car.place")[at], run.topic("car.echo")[at]
        d = np.minimum(distances(hall, place["p"]["x"], place["p"]["y"]), far)
        told = np.minimum(echo["ranges"].min(axis=1), far)
        assert np.all(told - d >= -grain - 1e-9)
        assert np.all(told - d <= room)
        most = max(most, float(np.max(told - d)))
    assert most > grain  # what lies between rays is seen in it


def cast(hall: soter.Program, x: float, y: float, angles: Any) -> Any:
    """Ranges of rays (n,) by walking: slower, and nothing of the program's."""
    far = np.linspace(0.0, 1.2, 2401)
    px, py = x + np.outer(np.cos(angles), far), y + np.outer(np.sin(angles), far)
    hit = distances(hall, px, py) <= 0.0
    return np.where(hit.any(axis=1), far[hit.argmax(axis=1)], 1.2)


def test_what_lies_between_two_rays_is_bounded(hall: soter.Program) -> None:
    """docs/ground-robot.md, "Between two rays": least <= d / (cos g - sin(g / 2))."""
    draw = random.Random(5)  # noqa: S311 - places
    rays, far = int(constant(hall, "RAYS")), robot(hall, "FAR")
    assert 2.0 * math.pi / rays <= SECTOR
    factor = 1.0 / (math.cos(SECTOR) - math.sin(SECTOR / 2.0))
    least_m = (
        robot(hall, "NOISE") - robot(hall, "FASTEST") * SWEEP_S - float(constant(hall, "GRAIN"))
    )
    assert far * (factor - 1.0) <= least_m
    worst, tried = 0.0, 0
    while tried < 400:
        x, y = draw.uniform(-3.0, 3.0), draw.uniform(-2.0, 2.0)
        d = float(distances(hall, np.array(x), np.array(y)))
        if not robot(hall, "RADIUS") <= d <= far:
            continue
        tried += 1
        angles = draw.uniform(0.0, SECTOR) + 2.0 * math.pi / rays * np.arange(rays)
        least = float(cast(hall, x, y, angles).min())
        assert d - 1e-9 <= least <= d * factor + 0.001
        worst = max(worst, least / d)
    assert worst > 1.0 + 0.3 * (factor - 1.0)  # corners between two rays were met


def test_the_programs_rays_are_those(hall: soter.Program) -> None:
    for x, y, angle in [(0.0, 0.0, 0.0), (0.9, 0.4, -1.2), (-2.0, -0.5, 2.5), (2.9, 1.9, 0.7)]:
        told = hall.function("range")({"x": x, "y": y}, angle)
        walked = float(cast(hall, x, y, np.array([angle]))[0])
        assert min(told, 1.2) == pytest.approx(walked, abs=0.001)


# ---------------------------------------------------------------- with the proof, and without


def account(program: soter.Program, system: str, kind: int, **more: Any) -> Any:
    run = program.simulate(
        system=system, seed=11 + kind, params={"KIND": kind, **more}, trace=["who.account"]
    )
    return run.topic("who.account")[-1]


@pytest.mark.parametrize("kind", range(5))
def test_nothing_is_touched_and_nobody_waits_long(hall: soter.Program, kind: int) -> None:
    told = account(hall, "Guarded", kind)
    assert told["touches"] == 0
    assert told["least"] > 0.0
    assert told["driven"] > 4.0
    assert told["stuck"] < 2.0  # of 60 s


def test_the_same_wishes_collide_without_the_module(hall: soter.Program) -> None:
    assert account(hall, "Alone", 0)["touches"] > 0


def test_a_zone_without_timing_does_not_let_go(hall: soter.Program) -> None:
    assert account(hall, "Zoned", 0)["stuck"] > 10.0


def test_a_module_that_looks_less_far_ahead_collides(tmp_path: Path) -> None:
    """So the test above can fail: the hall finds what the prover refuses."""
    bold = ("room(nearest) < NEED", "room(nearest) < -0.02")
    back = ("room(nearest) > NEED + 0.02", "room(nearest) > 0.0")
    changed(tmp_path, bold, back)
    assert account(soter.load(tmp_path / HALL.name), "Guarded", 0)["touches"] > 0
