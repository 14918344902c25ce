"""Whether the model explains a log of somebody else: by what was published, not by what changed.

Non-goals: the model monitor on logs of its own (`tests/correct/test_model_monitor.py`).
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest

from generators.robot_logs import CART
from soter.api import load
from soter.api.monitoring import log_explained
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.monitor.model_membership import Judgement

SHUTTLE = CART.parent / "shuttle.soter"
Row = dict[str, float | str]
ROWS, EVERY_S = 200, 0.005


def drive(**changed: Callable[[int, float], float | str]) -> list[Row]:
    """One second at 1 m/s, or what `changed` makes of row k and the value it would have."""
    rows: list[Row] = []
    for k in range(ROWS):
        given = {"t": round(EVERY_S * k, 6), "x": EVERY_S * k, "u": 1.0, "y": EVERY_S * k}
        rows.append({n: changed[n](k, v) if n in changed else v for n, v in given.items()})
    return rows


def explained(folder: Path, rows: list[Row], program: Path = SHUTTLE) -> Judgement:
    log = folder / "drive.csv"
    log.write_text("t,x,u,y\n" + "\n".join(",".join(map(str, r.values())) for r in rows) + "\n")
    topics = {"position": {"fields": {"value": "x"}}, "speed": {"fields": {"value": "u"}}}
    if "topic other" in program.read_text():
        topics["other"] = {"fields": {"value": "y"}}
    mapping = {"time": {"from": "t"}, "topics": topics}
    (folder / "map.json").write_text(json.dumps({"system": "Track", **mapping}))
    (found,) = log_explained(load(program).flat, log, mapping, system="Track")
    return found


def test_a_unit_that_nobody_says_is_told_beside_the_alarms_that_it_may_be(tmp_path: Path) -> None:
    found = explained(tmp_path, drive(x=lambda _, v: 1e3 * v))
    assert found.alarms > 0
    assert found.notes[-1].endswith(" is taken: `position` in `m`, `speed` in `m/s`")


@pytest.mark.parametrize(("first", "last"), [(60, 140), (0, ROWS), (150, ROWS)])
def test_a_sensor_that_repeats_its_last_value_is_an_alarm(
    tmp_path: Path, first: int, last: int
) -> None:
    found = explained(tmp_path, drive(x=lambda k, v: EVERY_S * first if first <= k < last else v))
    assert found.steps == ROWS - 1
    assert found.alarms > 0
    assert found.first_alarm_s == pytest.approx(EVERY_S * first + 0.045, abs=0.006)


@pytest.mark.parametrize("begin", [0, 100])
def test_a_robot_that_stands_still_is_judged_and_explained(tmp_path: Path, begin: int) -> None:
    still = drive(x=lambda _, v: min(v, EVERY_S * begin), u=lambda k, v: 0.0 if k >= begin else v)
    found = explained(tmp_path, still)
    assert (found.steps, found.alarms, found.judged_share) == (ROWS - 1, 0, 1.0)


@pytest.mark.parametrize(
    ("name", "first", "last", "steps"),
    [("x", 50, 150, 99), ("x", 150, ROWS, 149), ("u", 50, 150, 199)],
)
def test_silence_of_a_sensor_or_of_commands_is_not_judged(
    tmp_path: Path, name: str, first: int, last: int, steps: int
) -> None:
    found = explained(tmp_path, drive(**{name: lambda k, v: "" if first <= k < last else v}))
    assert (found.steps, found.alarms) == (steps, 0)
    assert found.judged_share == pytest.approx(1 - (last - first) / ROWS, abs=0.06)


def test_a_sensor_that_is_always_too_old_is_no_verdict(tmp_path: Path) -> None:
    """An alarm across a silence is one; that there was none says nothing."""
    found = explained(tmp_path, drive(x=lambda k, v: "" if k % 40 else v))
    assert (found.steps, found.alarms, found.judged_share, found.judged) == (4, 0, 0.0, False)
    thrown = explained(tmp_path, drive(x=lambda k, _: "" if k % 40 else 5.0 * (k == 120)))
    assert thrown.alarms > 0
    assert thrown.judged


def test_rows_of_one_time_are_told_wherever_the_judgement_is(tmp_path: Path, capsys: Any) -> None:
    rows = drive(t=lambda k, _: round(EVERY_S * (k - k % 2), 6))
    told = "of the file: 100 of 200 have the time of the one before them and count in the order"
    assert [n[: len(told)] for n in explained(tmp_path, rows).notes[:-1]] == [told]
    arguments = ["monitor", str(SHUTTLE), str(tmp_path / "drive.csv"), "--estimates"]
    arguments += ["--map", str(tmp_path / "map.json")]
    main(arguments)
    assert told in capsys.readouterr().out
    main([*arguments, "--json"])
    notes = json.loads(capsys.readouterr().out)["modules"]["Guard"]["notes"]
    assert notes[0].startswith(told)
    main([*arguments, "--format", "junit"])
    text = "".join(ET.fromstring(capsys.readouterr().out).itertext())  # noqa: S314 - our own
    assert told in text


def two_sensors(folder: Path, seen: str) -> Path:
    """A shuttle that moves along y, too, at the same speed; `seen`: what `other` shows."""
    text = SHUTTLE.read_text()
    topic = "topic position: float"
    text = text.replace(topic, f'topic other: float unit "m" in [-50.0, 50.0];\n{topic}')
    text = text.replace(
        "drives position = x;\n",
        f'drives position = x; drives other = {seen};\n  state y: float unit "m" = 0.0;\n',
    ).replace("der x = speed;", "der x = speed; der y = speed; measured other within 0.02;")
    path = folder / "two.soter"
    path.write_text(text)
    return path


def test_a_sensor_that_is_slower_than_another_is_judged_when_it_speaks(tmp_path: Path) -> None:
    slow: dict[str, Any] = {"y": lambda k, v: "" if k % 40 else v}
    program = two_sensors(tmp_path, "y")
    assert explained(tmp_path, drive(**slow), program).alarms == 0
    wrong: dict[str, Any] = {"y": lambda k, v: "" if k % 40 else v + 0.2 * (k > 100)}
    found = explained(tmp_path, drive(**wrong), program)
    assert (found.alarms, found.first_alarm_s, found.alarm_states) == (1, 0.6, {"c.y": 1})


def test_a_state_that_no_sensor_shows_hides_no_alarm(tmp_path: Path) -> None:
    program = two_sensors(tmp_path, "x")
    bounds = "grid position in [-WALL, WALL] / 400;"
    text = program.read_text().replace(bounds, f"{bounds} grid c.y in [-WALL, WALL] / 10;")
    program.write_text(text)
    both: dict[str, Any] = {"x": lambda k, v: v + 0.2 * (k > 100)}
    found = explained(tmp_path, drive(**both, y=both["x"]), program)
    assert (found.alarms > 0, list(found.alarm_states)) == (True, ["c.x"])


def test_a_command_that_is_a_field_of_another_topic_is_missed_with_what_to_do(
    tmp_path: Path,
) -> None:
    topics = {"position": {"fields": {"value": "x"}}}
    log = tmp_path / "drive.csv"
    log.write_text("t,x,u\n0,0,1\n1,1,1\n")
    with pytest.raises(SoterError) as error:
        log_explained(load(SHUTTLE).flat, log, {"time": {"from": "t"}, "topics": topics})
    (problem,) = error.value.diagnostics
    assert (problem.code, problem.notes) == ("D017", ("missing: speed",))
    assert "a topic of its own in the mapping" in problem.helps[0]


# ---------------------------------------------------------------- sets


def test_commands_outside_of_their_set_are_no_run_of_the_model(tmp_path: Path) -> None:
    """It moves as it is told, at 500 m/s of a declared +-1."""
    place = {"x": lambda k, _: 0.2 + EVERY_S * (k > 10) * 5.0, "u": lambda k, _: 500.0 * (k == 10)}
    found = explained(tmp_path, drive(**place))
    assert found.alarm_states["speed, outside of its set"] == 1
    assert found.first_alarm_s == pytest.approx(0.05)
    assert any(note.startswith("outside of its set: 1 samples of speed") for note in found.notes)
    inside = explained(tmp_path, drive())
    assert (inside.alarms, [n for n in inside.notes if "set" in n]) == (0, [])


def test_who_commands_faster_than_the_set_explains_nothing(tmp_path: Path, capsys: Any) -> None:
    explained(tmp_path, drive(x=lambda k, _: 2.0 * EVERY_S * k, u=lambda _k, _: 2.0))
    arguments = ["monitor", str(SHUTTLE), str(tmp_path / "drive.csv"), "--estimates"]
    assert main([*arguments, "--map", str(tmp_path / "map.json")]) == 3
    assert "200 samples of speed" in capsys.readouterr().out


def test_a_measurement_outside_of_its_set_is_not_taken(tmp_path: Path) -> None:
    found = explained(tmp_path, drive(x=lambda k, v: 51.0 if k % 3 == 2 else v))
    assert (found.alarms, found.steps) == (0, ROWS - 1 - ROWS // 3)
    assert any(
        note.startswith("outside of its set: 66 samples of position") for note in found.notes
    )
    nothing = explained(tmp_path, drive(x=lambda _k, _: 51.0))
    assert (nothing.steps, nothing.judged) == (0, False)


def clipped(folder: Path, rows: list[Row]) -> Judgement:
    explained(folder, rows)
    given = json.loads((folder / "map.json").read_text())
    given["topics"]["speed"]["clip"] = True
    (found,) = log_explained(load(SHUTTLE).flat, folder / "drive.csv", given)
    return found


def test_a_drive_that_clips_its_commands_says_so_in_the_mapping(tmp_path: Path) -> None:
    found = clipped(tmp_path, drive(u=lambda k, v: 500.0 if k % 2 else v))
    assert found.alarms == 0
    assert "clipped to its set: 100 samples of speed" in found.notes
    assert "clipped" not in " ".join(clipped(tmp_path, drive()).notes)


def test_an_angle_is_explained_across_the_end_of_its_turn(tmp_path: Path) -> None:
    text = SHUTTLE.read_text().replace(
        'topic position: float unit "m"', 'topic position: float unit "rad"'
    )
    program = tmp_path / "turning.soter"
    program.write_text(text)
    place = drive(x=lambda k, _: (3.0 + EVERY_S * k + math.pi) % math.tau - math.pi)
    found = explained(tmp_path, place, program)
    assert (found.alarms, found.steps) == (0, ROWS - 1)
