"""What `where` takes: texts, truths and numbers as files write them, and what it says of none.

Non-goals: a choice by time (`test_times_of_logs.py`).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("mcap", reason="the extra `logs` is not installed")

from mcap.writer import Writer as McapWriter

from generators.robot_logs import CART, MS, T0
from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.monitor.log_files.log_columns import RowChoice

if TYPE_CHECKING:
    from pathlib import Path

    from soter.monitor.log_judgement import LogJudgement

Cells = list[object]
FIELDS = {"x": "x", "v": "v"}


@pytest.fixture(params=["log.mcap", "log.csv"])
def kind(request: Any) -> str:
    return str(request.param)


def log_of(folder: Path, kind: str, cells: Cells) -> Path:
    """Ten messages or rows for each cell of the column `valid`."""
    path = folder / kind
    messages = [
        {"x": 0.001 * k, "v": 0.1, "valid": cells[k % len(cells)]} for k in range(10 * len(cells))
    ]
    if kind.endswith(".csv"):
        rows = [f"{k / 100},{m['x']},{m['v']},{m['valid']}" for k, m in enumerate(messages)]
        path.write_text("\n".join(("t,x,v,valid", *rows, "")))
        return path
    with path.open("wb") as file:
        writer: Any = McapWriter(file)
        writer.start()
        schema = writer.register_schema("m", "jsonschema", b"{}")
        channel = writer.register_channel("/odom", "json", schema)
        for k, m in enumerate(messages):
            at = T0 + k * 10 * MS
            writer.add_message(channel, at, json.dumps(m).encode(), at)
        writer.finish()
    return path


def judged(log: Path, where: dict[str, Any], *, of_all: bool = False) -> LogJudgement:
    topic: dict[str, Any] = {"channel": "/odom", "fields": FIELDS}
    given: dict[str, Any] = {"topics": {"motion": topic}, "time": {}}
    (given if of_all else topic)["where"] = where
    if log.suffix == ".csv":
        given["time"] = {"from": "t"}
    else:
        del given["time"]
    return load(CART).judge_log(log, given, system="Protected")


CASES: list[tuple[Cells, object]] = [
    ([True, False], "true"),
    ([True, False], True),
    ([True, False], "True"),
    ([0, 1], 0),
    ([0.0, 1.0], "0"),
    ([0, 1], "0.0"),
    ([2.5, 3.5], 2.5),
    (["one", "two"], "one"),
    (["07", "7"], "07"),
]


@pytest.mark.parametrize("of_all", [False, True])
@pytest.mark.parametrize(("cells", "wanted"), CASES)
def test_a_value_is_chosen_however_its_file_writes_it(
    tmp_path: Path, kind: str, cells: Cells, wanted: object, *, of_all: bool
) -> None:
    log = log_of(tmp_path, kind, cells)
    assert judged(log, {"valid": wanted}, of_all=of_all).samples["motion"] == 10


@pytest.mark.parametrize("of_all", [False, True])
@pytest.mark.parametrize(
    ("cells", "wanted", "told"),
    [
        ([True], "yes", "`valid` is not `yes` but `true`, a "),
        ([1, 2], True, "`valid` is not `True` but `1`, a "),
        (["on", "off"], "true", "`valid` is not `true` but `on`, a text (10 times), `off`, a text"),
        (["07"], "7", "`valid` is not `7` but `07`, a text (10 times)"),
    ],
)
def test_where_nothing_is_chosen_what_stood_there_is_told(
    tmp_path: Path, kind: str, cells: Cells, wanted: object, told: str, *, of_all: bool
) -> None:
    with pytest.raises(SoterError) as error:
        judged(log_of(tmp_path, kind, cells), {"valid": wanted}, of_all=of_all)
    (problem,) = error.value.diagnostics
    assert problem.code == "D016"
    said = " ".join(problem.helps).lower()
    assert told.lower() in said
    assert "say it in `where` as it stands there" in said


def test_no_more_than_a_few_values_are_told() -> None:
    choice = RowChoice({"id": "0"})
    assert not any(choice.chooses(lambda _, k=k: k) for k in range(1, 10_000))  # type: ignore[misc]
    (told,) = choice.seen_values
    assert told.count("a number") == 5
    assert "others" in told
    assert len(told) < 250


def test_an_empty_cell_is_no_value() -> None:
    choice = RowChoice({"id": "None"})
    assert not choice.chooses(lambda _: None)
    assert "`id` is not `None` but empty" in choice.seen_values[0]
