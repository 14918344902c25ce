"""Numbers of a stranger that no type holds: 400 or 5,000 digits, exponents that no memory holds.

Each ends with a code, or is no number of a sample, in every place of a log and of its mapping.
Non-goals: numbers in programs (`tests/unit/language`), in what commands of Soter write
(`bench/hostile/bad_input.py`).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from mcap.writer import Writer as McapWriter

from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.monitor.log_survey import survey_of_logs
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.api import Program

PROGRAM = """soter 1;
type Row = { x: float, n: int in [0, 9], on: bool };
topic row: Row;
topic go: float in [-1.0, 1.0];
node A period 10ms { publishes go; step { publish go = 0.0; } }
node B period 10ms { publishes go; step { publish go = 0.1; } }
rta M { ac A; sc B; period 100ms; safe row.x < 9.0; ttf row.x > 5.0; safer row.x < 4.0; }
plant P period 10ms { reads go; drives row = { x: x, n: 0, on: true }; state x: float; der x = go; }
system S { p: P; module M; until 1s; }
"""
NUMBERS = [
    *("9" * 400, "-" + "9" * 400, "9" * 5000, "0." + "1" * 5000, "1e400", "-1e400"),
    *("1e99999999", "-1e99999999", "1e-99999999", "0e99999999", "NaN", "Infinity"),
]
PLACES = ["x", "n", "on", "time.sec", "time.nanosec", "us"]


def mcap(path: Path, place: str, number: str) -> None:
    """A log of JSON in which a number stands in one place of one message, as it is written."""
    with path.open("wb") as file:
        writer: Any = McapWriter(file)
        writer.start()
        schema = writer.register_schema("row", "jsonschema", b"{}")
        channel = writer.register_channel("/row", "json", schema)
        for k in range(20):
            stamp = {"sec": 1 + k, "nanosec": 5}
            row = {"x": 0.1 * k, "n": k % 9, "on": k % 2, "time": stamp, "us": 10**6 * k + 10}
            text = json.dumps(row)
            if k == 10:
                key = place.rpartition(".")[2]
                was = json.dumps((stamp | row)[key])
                assert f'"{key}": {was}' in text
                text = text.replace(f'"{key}": {was}', f'"{key}": {number}')
            at = 10**9 * (k + 1)
            writer.add_message(channel, at, text.encode(), at)
        writer.finish()


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Program:
    path = tmp_path_factory.mktemp("program") / "p.soter"
    path.write_text(PROGRAM)
    return load(path)


def code_of(run: Callable[..., object], *given: object) -> str:
    """The code with which it ends, "" where it is judged; any other error is raised."""
    try:
        run(*given)
    except SoterError as error:
        return error.diagnostics[0].code
    return ""


FIELDS = {"x": "x", "n": "n", "on": "on"}
TIMES: list[dict[str, Any]] = [
    {},
    {"time": {"from": "us", "unit": "us"}},
    {"time": {"from": "time"}},
]
STAMPS: list[dict[str, Any]] = [{}, {"stamp": "time"}, {"stamp": {"from": "us", "unit": "us"}}]


@all_rows("place", PLACES)
def test_a_number_of_a_message_that_no_type_holds_is_no_sample_or_has_a_code(
    place: str, tmp_path: Path, program: Program
) -> None:
    for k, number in enumerate(NUMBERS):
        log = tmp_path / f"{k}.mcap"
        mcap(log, place, number)
        topics = {"row": {"channel": "/row", "fields": FIELDS, **STAMPS[k % 3]}}
        given = {"system": "S", "topics": topics, **TIMES[k // 3 % 3]}
        assert code_of(program.judge_log, log, given) in ("", "D016"), (number[:12], given)
        assert code_of(survey_of_logs, [log]) in ("", "D016"), number[:12]


@all_rows("column", ["t", "x", "n", "on", "us"])
def test_a_number_of_a_table_that_no_type_holds_is_no_sample_or_has_a_code(
    column: str, tmp_path: Path, program: Program
) -> None:
    before = ["t,x,n,on,us", "0.1,0,0,0,1000", "0.2,0,0,0,2000"]
    for k, number in enumerate(NUMBERS):
        row = {"t": "0.5", "x": "1.0", "n": "1", "on": "1", "us": "400000", column: number}
        log = tmp_path / "log.csv"
        log.write_text("\n".join([*before, ",".join(row.values()), "9.0,0,0,0,8000000", ""]))
        topics = {"row": {"fields": FIELDS, **STAMPS[::2][k % 2]}}
        given = {"system": "S", "time": {"from": "t"}, "topics": topics}
        assert code_of(program.judge_log, log, given) in ("", "D016"), (number[:12], given)
        assert code_of(survey_of_logs, [log]) in ("", "D016"), number[:12]


KEYS: list[tuple[str, ...]] = [
    ("time", "since"), ("time", "until"), ("time", "scale"), ("topics", "row", "gap"),
    ("topics", "row", "fields", "x", "scale"), ("topics", "row", "fields", "x", "offset"),
    ("topics", "row", "fields", "x", "constant"), ("topics", "row", "fields", "x", "slope"),
    ("topics", "row", "fields", "n", "constant"), ("topics", "row", "clip"),
    ("topics", "row", "qos", "depth"), ("topics", "row", "set", "k"), ("where", "n"),
    ("topics", "row", "where", "n"), ("topics", "row", "stamp", "unit"), ("mavlink", "delay"),
    ("mavlink", "system"), ("mavlink", "resend"), ("topics", "row", "every"),
]  # fmt: skip


@all_rows("path", KEYS)
def test_a_number_of_a_mapping_that_no_type_holds_has_a_code(
    path: tuple[str, ...], tmp_path: Path, program: Program
) -> None:
    log, file = tmp_path / "log.csv", tmp_path / "map.json"
    log.write_text("t,x,n,on\n" + "".join(f"{k},0,0,0\n" for k in range(3)))
    for k, number in enumerate(NUMBERS):
        text = number if (k + KEYS.index(path)) % 2 else f'"{number}"'
        x = {"from": "x"} if path[-1] not in ("constant", "slope") else {}
        fields: dict[str, Any] = {**FIELDS, "x": x}
        given: dict[str, Any] = {"time": {"from": "t"}, "topics": {"row": {"fields": fields}}}
        table = given
        for key in path[:-1]:
            here = table.get(key)
            table[key] = here if isinstance(here, dict) else {}
            table = table[key]
        table[path[-1]] = "@"
        file.write_text(json.dumps({"system": "S", **given}).replace('"@"', text))
        code = code_of(program.judge_log, log, file)
        assert code in ("", "D015", "D016", "D017"), (path, text[:20])
