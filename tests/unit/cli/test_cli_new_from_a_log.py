"""`soter new --from LOG`: what is found of a log, and that what is written of it can be used."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from generators.autopilot_logs import dataflash, flight, table, tlog, ulog, written
from soter.api import load
from soter.monitor.log_survey import Channel, LogSurvey, survey_of_logs
from soter.monitor.survey_drafts import mapping_of_log, program_head

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Soter = Callable[..., Any]

TOML: Any = import_module("tomllib" if find_spec("tomllib") else "tomli")
MODULE = """
node Fast period 10ms {{ publishes go; step {{ publish go = 1.0; }} }}
node Slow period 10ms {{ publishes go; step {{ publish go = 0.0; }} }}
topic go: float in [0.0, 1.0] = 0.0;
rta Guard {{ ac Fast; sc Slow; period 10ms;
  safe {topic}.{field} < 1.0; ttf {topic}.{field} > 0.9; safer {topic}.{field} < 0.5; }}
system Whole default {{ module Guard; until 1s; }}
"""
LOGS: list[tuple[str, Callable[..., bytes], str, str]] = [
    ("flight.ulg", ulog, "motion", "x"),
    ("flight.bin", dataflash, "POSE", "X"),
    ("flight.tlog", tlog, "LOCAL_POSITION_NED", "x"),
    ("flight.csv", table, "flight", "x"),
]


@pytest.mark.parametrize(("name", "made", "topic", "field"), LOGS, ids=[n for n, *_ in LOGS])
def test_a_program_made_of_a_log_is_sound_and_judges_it(
    soter: Soter, here: Path, name: str, made: Any, topic: str, field: str
) -> None:
    if name.endswith("tlog"):
        pytest.importorskip("pymavlink", reason="the extra `logs` is not installed")
    written(here / name, made(flight()))
    document = soter("new", "robot", "--from", name, "--json").document
    assert document["files"] == ["robot.soter", "robot.toml"]
    program = here / "robot" / "robot.soter"
    assert soter("fmt", "--check", str(program)).exit == 0
    checked = soter("check", str(program))
    assert (checked.exit, checked.err) == (0, "")
    text = program.read_text(encoding="utf-8")
    assert "40 messages, 100 Hz, gaps 10ms (half) to 10ms, at most 10ms old" in text
    assert f"topic {topic}: " in text
    assert " max_age 20ms;" in text
    program.write_text(text + MODULE.format(topic=topic, field=field), encoding="utf-8")
    judged = soter("monitor", str(program), name, "--map", "robot/robot.toml", "--json")
    assert judged.exit == 0
    assert judged.document["log"]["samples"][topic] == 40
    assert judged.document["log"]["modules"]["Guard"]["judged_share"] == 1.0


def test_ranges_gaps_and_ages_are_those_of_the_log(tmp_path: Path) -> None:
    rows = [row for k, row in enumerate(flight(100)) if k not in range(50, 62)]
    log = written(tmp_path / "a.csv", table(rows))
    found = survey_of_logs([log])
    text = program_head(found, "a.csv", "robot")
    assert "gaps 10ms (half) to 130ms, at most 130ms old since it was logged" in text
    assert "  x: float,  // 0 to 0.99\n" in text
    assert "  v: float,  // 0.125 to 0.125\n" in text
    assert found.time == ("t", "s")


def kinds(log: Path) -> dict[str, str]:
    """The type of each field that a log has, as a draft of it says."""
    lines = program_head(survey_of_logs([log]), log.name, "robot").splitlines()
    return dict(line.strip().partition(",  //")[0].split(": ") for line in lines if ",  //" in line)


def test_a_column_that_happens_to_be_whole_is_a_float_unless_it_counts(tmp_path: Path) -> None:
    """A second file, with 1.5 in it, is read by what was written of the first."""
    text = "t,x,speed_mm,mode,seq,raw_id,grid,ns,pos_n,state.x,mode_speed\n"
    rows = [f"{k},{k},{10 * k},{k % 2},{k},7,{k},{2**60 + k},{k},{k},{k}\n" for k in range(5)]
    found = kinds(written(tmp_path / "a.csv", (text + "".join(rows)).encode()))
    whole = {"mode", "seq", "raw_id", "ns"}
    assert {name for name, kind in found.items() if kind == "int"} == whole
    assert {kind for name, kind in found.items() if name not in whole} == {"float"}


def test_numbers_of_json_that_happen_to_be_whole_are_floats(tmp_path: Path) -> None:
    writers = pytest.importorskip("mcap.writer", reason="the extra `logs` is not installed")
    log = tmp_path / "a.mcap"
    with log.open("wb") as file:
        writer = writers.Writer(file)
        writer.start()
        schema = writer.register_schema("row", "jsonschema", b"{}")
        channel = writer.register_channel("/row", "json", schema)
        for k in range(3):
            writer.add_message(channel, 10**9 * k, b'{"x": %d, "count": 1, "on": true}' % k, k)
        writer.finish()
    assert kinds(log) == {"x": "float", "count": "int", "on": "bool"}


def test_whole_numbers_of_a_file_that_says_its_types_stay(tmp_path: Path) -> None:
    found = kinds(written(tmp_path / "a.ulg", ulog(flight(3))))
    assert (found["raw_0"], found["x"]) == ("int", "float")


def test_a_draft_asks_whether_what_is_called_so_is_an_angle(tmp_path: Path) -> None:
    log = written(tmp_path / "a.csv", b"t,yaw,x_heading,theta_1,draw\n0,1,2,3,4\n1,1,2,3,4\n")
    lines = program_head(survey_of_logs([log]), "a.csv", "robot").splitlines()
    asked = [line.split(":")[0].strip() for line in lines if "an angle?" in line]
    assert asked == ["yaw", "x_heading", "theta_1"]


@pytest.mark.parametrize(
    ("column", "first", "unit"),
    [
        ("timestamp", 1_700_000_000_000, "ms"),
        ("#timestamp [ns]", 0, "ns"),
        ("time_us", 0, "us"),
        ("Time (s)", 0, "s"),
        ("t", 1_700_000_000, "s"),
        ("TS_ms", 3_931_776, "ms"),
    ],
)
def test_the_time_of_a_csv_is_a_column_that_is_called_so_in_a_unit_that_fits(
    tmp_path: Path, column: str, first: int, unit: str
) -> None:
    rows = "".join(f"0.5,{first + k}\n" for k in range(3))
    found = survey_of_logs([written(tmp_path / "a.csv", f"x,{column}\n{rows}".encode())])
    assert found.time == (column, unit)


@pytest.mark.parametrize(("columns", "shown"), [("SP_PUMP,level", "SP_PUMP"), ("speed,x", "water")])
def test_a_draft_shows_the_column_that_is_called_as_a_command_is(
    soter: Soter, here: Path, columns: str, shown: str
) -> None:
    written(here / "a.csv", f"t,{columns},water\n0,1.5,2.5,3.5\n1,1.5,2.5,3.5\n".encode())
    assert soter("new", "robot", "--from", "a.csv").exit == 0
    assert f"# [topics.{shown}]" in (here / "robot" / "robot.toml").read_text(encoding="utf-8")


def test_runs_are_no_parts_of_one_log(soter: Soter, here: Path) -> None:
    for name in ("a.csv", "b.csv"):
        written(here / name, table(flight(), "t,x"))
    assert soter("new", "robot", "--from", "a.csv").exit == 0
    program, mapping = here / "robot" / "robot.soter", here / "robot" / "robot.toml"
    module = MODULE.format(topic="a", field="x")
    program.write_text(program.read_text(encoding="utf-8") + module, encoding="utf-8")
    text = mapping.read_text(encoding="utf-8").replace('channel = "a.csv"', "")
    mapping.write_text(text, encoding="utf-8")
    refused = soter("monitor", str(program), "a.csv", "b.csv", "--map", str(mapping))
    assert (refused.exit, "of several runs give one at a time" in refused.err) == (1, True)


def test_several_csvs_are_one_mapping(soter: Soter, here: Path) -> None:
    written(here / "pose.csv", table(flight(), "t,x"))
    written(here / "speed.csv", table(flight(), "t,v"))
    assert soter("new", "robot", "--from", "pose.csv", "--from", "speed.csv").exit == 0
    program = here / "robot" / "robot.soter"
    module = MODULE.format(topic="pose", field="x").replace("pose.x < 1.0", "speed.v < 1.0")
    program.write_text(program.read_text(encoding="utf-8") + module, encoding="utf-8")
    command = ["monitor", str(program), "pose.csv", "speed.csv", "--map", "robot/robot.toml"]
    assert soter(*command).exit == 0


def test_a_damaged_log_is_surveyed_where_that_is_asked_for_and_said(
    soter: Soter, here: Path
) -> None:
    written(here / "flight.ulg", ulog(flight())[:-20])
    refused = soter("new", "robot", "--from", "flight.ulg")
    assert refused.exit == 1
    assert "`--partial`" in refused.err
    assert not (here / "robot").exists()
    assert soter("new", "robot", "--from", "flight.ulg", "--partial").exit == 0
    text = (here / "robot" / "robot.soter").read_text(encoding="utf-8")
    assert "no verdict: the log is damaged" in text


def test_names_of_a_log_that_mean_something_in_soter_become_others(tmp_path: Path) -> None:
    data = b"t,in,in.,1st,a b\n" + b"".join(b"%d,1.5,2.5,3.5,4.5\n" % k for k in range(3))
    text = program_head(
        survey_of_logs([written(tmp_path / "topic.csv", data)]), "topic.csv", "robot"
    )
    program = written(tmp_path / "robot.soter", text.encode())
    assert load(program).check().warnings == ()
    for name in ("in_2: float", "in_3: float", "n1st: float", "a_b: float", "topic topic_2"):
        assert name in text


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1))
def test_whatever_a_channel_and_a_field_are_called_the_mapping_names_them(name: str) -> None:
    channel = Channel()
    channel.note_message(0, {name: 1.0})
    text = mapping_of_log(LogSurvey({name: channel}), "log")
    assert all(line.isprintable() for line in text.split("\n")), "no terminal acts upon it"
    (topic,) = TOML.loads(text)["topics"].values()
    assert topic["channel"] == name
    assert [*topic["fields"].values()] == channel.kept_fields


def judged_by_hand(soter: Soter, here: Path, time: str) -> str:
    """What `soter monitor` says of a.csv to a mapping that was written without a draft."""
    program = "soter 1;\ntype A = { x: float };\ninput topic a: A;\n"
    written(here / "p.soter", (program + MODULE.format(topic="a", field="x")).encode())
    mapping = f'[time]\nfrom = "{time}"\nunit = "s"\n[topics.a.fields]\nx = "x"\n'
    written(here / "p.toml", mapping.encode())
    return str(soter("monitor", "p.soter", "a.csv", "--map", "p.toml").err)


@pytest.mark.parametrize(
    ("cells", "samples"),
    [
        (lambda k: f"{k / 10}," if k % 5 else f"{k / 10},2.5", 20),
        (lambda k: f"{k / 10},nan" if k % 5 else f"{k / 10},2", 20),
        (lambda k: f",{k}" if k % 2 else f"{k},{k}.5", 50),
    ],
)
def test_the_samples_of_a_draft_are_those_that_its_mapping_takes(
    soter: Soter, here: Path, cells: Callable[[int], str], samples: int
) -> None:
    rows = "".join(f"{k * 0.02:.2f},{cells(k)}\n" for k in range(100))
    written(here / "a.csv", f"t,x,y\n{rows}".encode())
    assert soter("new", "robot", "--from", "a.csv").exit == 0
    program = here / "robot" / "robot.soter"
    text = program.read_text(encoding="utf-8")
    gap = 2000 // samples
    assert f"a.csv: {samples} samples in 100 messages, {1000 / gap:.3g} Hz, gaps {gap}ms" in text
    assert f"({100 - samples} times)" in text
    assert f"max_age {2 * gap}ms;" in text
    assert "Left out" not in text
    assert "  y: float," in text
    program.write_text(text + MODULE.format(topic="a", field="y"), encoding="utf-8")
    judged = soter("monitor", str(program), "a.csv", "--map", "robot/robot.toml", "--json")
    assert judged.document["log"]["samples"]["a"] == samples
    assert judged.document["log"]["modules"]["Guard"]["stale"] == 0


def test_what_is_a_text_or_no_number_in_every_row_has_no_place_in_type_or_mapping(
    soter: Soter, here: Path
) -> None:
    rows = "".join(f"{k},{k},{'-' if k == 2 else k},nan\n" for k in range(4))
    written(here / "a.csv", f"t,x,mixed,never\n{rows}".encode())
    assert soter("new", "robot", "--from", "a.csv").exit == 0
    text = (here / "robot" / "robot.soter").read_text(encoding="utf-8")
    assert "Left out, as no single number: mixed, never\n" in text
    assert "mixed:" not in text
    assert "mixed" not in (here / "robot" / "robot.toml").read_text(encoding="utf-8")


def test_a_log_whose_time_goes_back_is_drafted_and_said_to_be_refused(
    soter: Soter, here: Path
) -> None:
    log = written(here / "a.csv", b"t,x\n0,1\n1,1\n2,1\n0.5,1\n1.5,1\n2.5,1\n")
    text = program_head(survey_of_logs([log]), "a.csv", "robot")
    assert "Time goes back, first to 0.5 s (such messages: 1): `soter monitor` refuses" in text
    assert "gaps 1s (half) to 1s" in text
    assert "time goes back in line 5" in judged_by_hand(soter, here, "t")


def test_the_row_of_a_command_that_a_draft_shows_is_one_that_works(
    soter: Soter, here: Path
) -> None:
    rows = "".join(f"{k / 100},0.2,0.5\n" for k in range(40))
    written(here / "a.csv", f"t,x,go\n{rows}".encode())
    assert soter("new", "robot", "--from", "a.csv").exit == 0
    program, mapping = here / "robot" / "robot.soter", here / "robot" / "robot.toml"
    head, _, example = mapping.read_text(encoding="utf-8").partition("# A command that a node")
    own = example[example.index("# [") :].replace("# ", "")
    mapping.write_text(head.replace('\ngo = "go"\n', "\n") + own, encoding="utf-8")
    text = program.read_text(encoding="utf-8").replace("  go: float,", "  //")
    assert "`topic go: float in [LOW, HIGH] = 0.0;`" in example
    module = MODULE.format(topic="a", field="x").replace("a.x < 1.0", "a.x + go < 1.0")
    program.write_text(text + module, encoding="utf-8")
    judged = soter("monitor", str(program), "a.csv", "--map", str(mapping), "--json")
    assert judged.exit == 0, judged.out
    assert judged.document["log"]["samples"] == {"a": 40, "go": 40}


@pytest.mark.parametrize(
    ("data", "helped"),
    [
        ("time;x\n0,0;1,5\n", """sep=';').to_csv(NEW, index=False)"""),
        ("# stacker 12\ntime,x\n0,1\n", "grep -v '^#' FILE > NEW"),
        ("time,x\n2026-11-27T10:00:00.000,1\n", "pandas.to_datetime(table[T], utc=True)"),
        ('time,x\n"0,5",1\n', "numbers have a point"),
        ("0.0,1\n0.1,2\n", "its first line names its columns"),
    ],
)
def test_a_csv_that_is_written_otherwise_is_refused_with_a_remedy(
    soter: Soter, here: Path, data: str, helped: str
) -> None:
    written(here / "a.csv", data.encode())
    refused = soter("new", "robot", "--from", "a.csv")
    assert refused.exit == 1
    assert "D016" in refused.err
    assert helped in refused.err
    if "x" in data:
        assert helped in judged_by_hand(soter, here, "time")


@pytest.mark.parametrize("time", ["1e99", "1e9999999", "-9e18"])
def test_a_time_that_is_beyond_all_clocks_is_refused(soter: Soter, here: Path, time: str) -> None:
    written(here / "a.csv", f"time_s,x\n{time},1\n".encode())
    refused = soter("new", "robot", "--from", "a.csv")
    assert refused.exit == 1
    assert f"`{time}` in line 2 is no time" in refused.err


@pytest.mark.parametrize("data", [b"", b"t\n", b"a,b\n1,2\n", b"t,name\n0,x\n1,y\n"])
def test_a_log_without_times_or_numbers_is_told(soter: Soter, here: Path, data: bytes) -> None:
    written(here / "a.csv", data)
    refused = soter("new", "robot", "--from", "a.csv")
    assert refused.exit == 1
    assert "D016" in refused.err
