"""The log: read back with the stock reader, every message against its schema."""

from __future__ import annotations

import json
import math
import resource
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.report.mcap_log import (
    BOOLEAN,
    DECISIONS_TOPIC,
    EXTENDED_NUMBER,
    INTEGER,
    METADATA_NAME,
    MODES_TOPIC,
    NUMBER,
    DecisionStep,
    LogChannel,
    LogError,
    LogHeader,
    ModeRecord,
    array_schema,
    enum_schema,
    object_schema,
    to_json,
    write_mcap,
)
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

mcap_reader = pytest.importorskip("mcap.reader", reason="the extra `logs` is not installed")

VEC = object_schema({"x": NUMBER, "y": NUMBER, "z": NUMBER}, "Vec3")
STATE = object_schema(
    {
        "p": VEC,
        "armed": BOOLEAN,
        "count": INTEGER,
        "phase": enum_schema(["Idle", "Fly"]),
        "track": array_schema(NUMBER, 4),
        "margin": EXTENDED_NUMBER,
    }
)
HEADER = LogHeader("ab" * 32, "Protected", 7, "0.1.0", {"command": "soter run x.soter"})
MODES = (ModeRecord(0, "d.M", "SC"), ModeRecord(50_000_000, "d.M", "AC"))
DECISIONS = (
    DecisionStep(0, "d.M", "SC", "SC", "not in φ_safer", {"ttf": False, "slack": math.inf}),
    DecisionStep(
        time_ns=50_000_000,
        module="d.M",
        mode_before="SC",
        mode_after="AC",
        reason="in φ_safer",
        predicates={"safer": True, "slack": 0.25},
        why=("x = 0.25 > 0.0",),
        margin_s=0.1,
    ),
)


def state(k: int, margin: float = 0.5) -> dict[str, object]:
    """Return a value with every kind of field."""
    return {
        "p": {"x": 0.1 * k, "y": -0.0, "z": 1e-300},
        "armed": bool(k % 2),
        "count": 2**53 - k,
        "phase": "Fly",
        "track": [1.0, 2.5],
        "margin": margin,
    }


def channels() -> list[LogChannel]:
    """Return two topics at 100 Hz and 50 Hz."""
    return [
        LogChannel(
            "control", VEC, [(10_000_000 * k, {"x": k, "y": 0.5, "z": 0}) for k in range(50)]
        ),
        LogChannel("d.localPosition", STATE, ((20_000_000 * k, state(k)) for k in range(25))),
    ]


def read(path: Path) -> list[tuple[str, int, dict[str, Any], dict[str, Any]]]:
    """Return topic, time, message and schema of each message, in the order of the reader."""
    messages = []
    with path.open("rb") as stream:
        for schema, channel, message in mcap_reader.make_reader(stream).iter_messages():
            assert schema.encoding == "jsonschema"
            assert channel.message_encoding == "json"
            assert message.log_time == message.publish_time
            messages.append(
                (
                    channel.topic,
                    message.log_time,
                    json.loads(message.data, parse_constant=_refuse),
                    json.loads(schema.data),
                )
            )
    return messages


def _refuse(name: str) -> object:
    raise AssertionError(f"{name} is not JSON")


def conforms(value: object, schema: Mapping[str, Any]) -> bool:
    """Check a value against the part of JSON Schema that the logs use."""
    if "anyOf" in schema:
        return any(conforms(value, option) for option in schema["anyOf"])
    if "enum" in schema and value not in schema["enum"]:
        return False
    kind = schema.get("type")
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if kind == "object":
        if not isinstance(value, dict):
            return False
        known, other = schema["properties"], schema.get("additionalProperties", True)
        return set(schema.get("required", ())) <= set(value) and all(
            conforms(item, known[name]) if name in known else _allowed(item, other)
            for name, item in value.items()
        )
    if kind == "array":
        return isinstance(value, list) and (
            len(value) <= schema.get("maxItems", math.inf)
            and all(conforms(item, schema["items"]) for item in value)
        )
    return {
        "number": number,
        "integer": number and isinstance(value, int),
        "boolean": isinstance(value, bool),
        "string": isinstance(value, str),
        None: True,
    }[kind]


def _allowed(item: object, rule: bool | Mapping[str, Any]) -> bool:
    return rule if isinstance(rule, bool) else conforms(item, rule)


def test_the_small_check_refuses_what_it_should() -> None:
    good = state(1)
    assert conforms(good, STATE)
    assert conforms({**good, "margin": "NaN"}, STATE)
    for name, bad in (
        ("p", {"x": 1.0, "y": 2.0}),
        ("armed", 1),
        ("count", 1.5),
        ("phase", "Land"),
        ("track", [1.0] * 5),
        ("margin", "nan"),
        ("p", {"x": 1.0, "y": 2.0, "z": "NaN"}),
    ):
        assert not conforms({**good, name: bad}, STATE), name
    assert not conforms({**good, "more": 1}, STATE)


def test_the_stock_reader_reads_everything_back(tmp_path: Path) -> None:
    path = write_mcap(
        tmp_path / "run.mcap", channels(), modes=MODES, decisions=DECISIONS, header=HEADER
    )
    messages = read(path)
    assert len(messages) == 50 + 25 + 2 + 2
    for topic, _, message, schema in messages:
        assert conforms(message, schema), topic
    assert [time for _, time, _, _ in messages] == sorted(time for _, time, _, _ in messages)
    positions = [message for topic, _, message, _ in messages if topic == "d.localPosition"]
    assert positions == [state(k) for k in range(25)]
    assert math.copysign(1, positions[0]["p"]["y"]) == -1


def test_modes_and_decisions_have_their_channels(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "run.mcap", [], modes=MODES, decisions=DECISIONS, header=HEADER)
    messages = read(path)
    assert [m for topic, _, m, _ in messages if topic == MODES_TOPIC] == [
        {"module": "d.M", "mode": "SC"},
        {"module": "d.M", "mode": "AC"},
    ]
    assert [m for topic, _, m, _ in messages if topic == DECISIONS_TOPIC] == [
        {
            "module": "d.M",
            "mode_before": "SC",
            "mode_after": "SC",
            "reason": "not in φ_safer",
            "why": [],
            "margin_s": 0.0,
            "predicates": {"ttf": False, "slack": "Infinity"},
        },
        {
            "module": "d.M",
            "mode_before": "SC",
            "mode_after": "AC",
            "reason": "in φ_safer",
            "why": ["x = 0.25 > 0.0"],
            "margin_s": 0.1,
            "predicates": {"safer": True, "slack": 0.25},
        },
    ]


def test_channels_without_messages_and_metadata_are_listed(tmp_path: Path) -> None:
    quiet = LogChannel("alarms", object_schema({"value": BOOLEAN}), ())
    path = write_mcap(tmp_path / "run.mcap", [*channels(), quiet], header=HEADER)
    with path.open("rb") as stream:
        reader = mcap_reader.make_reader(stream)
        summary = reader.get_summary()
        assert reader.get_header().library == "soter 0.1.0"
        assert {c.topic for c in summary.channels.values()} == {
            MODES_TOPIC,
            DECISIONS_TOPIC,
            "control",
            "d.localPosition",
            "alarms",
        }
        assert summary.statistics.message_count == 75
        assert summary.statistics.message_end_time == 490_000_000
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata == {
        METADATA_NAME: {
            "program_sha256": "ab" * 32,
            "system": "Protected",
            "seed": "7",
            "tool_version": "0.1.0",
            "command": "soter run x.soter",
        }
    }


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = (
        write_mcap(tmp_path / name, channels(), modes=MODES, decisions=DECISIONS, header=HEADER)
        for name in ("a.mcap", "b.mcap")
    )
    assert first.read_bytes() == second.read_bytes()


def test_equal_times_keep_the_order_of_the_channels(tmp_path: Path) -> None:
    path = write_mcap(
        tmp_path / "a.mcap", channels(), modes=MODES, decisions=DECISIONS, header=HEADER
    )
    assert [topic for topic, time, _, _ in read(path) if time == 0] == [
        MODES_TOPIC,
        DECISIONS_TOPIC,
        "control",
        "d.localPosition",
    ]


@all_rows(
    ("value", "text"),
    [
        (math.nan, '"NaN"'),
        (math.inf, '"Infinity"'),
        (-math.inf, '"-Infinity"'),
        (np.float64(-np.inf), '"-Infinity"'),
        (np.float32(np.nan), '"NaN"'),
        (0.1, "0.1"),
        (-0.0, "-0.0"),
        (5e-324, "5e-324"),
        (np.float64(0.1), "0.1"),
        (np.int64(3), "3"),
        (np.bool_(True), "true"),
        (np.asarray([1.0, math.nan]), '[1.0,"NaN"]'),
        ((1, [math.inf]), '[1,["Infinity"]]'),
    ],
)
def test_values_are_written_as_valid_json(value: object, text: str) -> None:
    assert to_json({"value": value}) == f'{{"value":{text}}}'.encode()


def test_a_value_nobody_can_log_is_refused() -> None:
    with pytest.raises(TypeError, match="cannot log a value of type object"):
        to_json({"value": object()})


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ([LogChannel("a", VEC, ()), LogChannel("a", VEC, ())], "a: two channels"),
        ([LogChannel(MODES_TOPIC, VEC, ())], "two channels"),
        ([LogChannel("a", NUMBER, ())], "a: the schema of a message"),
        ([LogChannel("a", VEC, [(5, {}), (4, {})])], "a: time runs back from 5 to 4 ns"),
        ([LogChannel("a", VEC, [(-1, {})])], "a: time runs back from 0 to -1 ns"),
    ],
)
def test_mistakes_of_the_caller_are_named(tmp_path: Path, bad: list[LogChannel], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        write_mcap(tmp_path / "a.mcap", bad, header=HEADER)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_the_old_log_alone(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "run.mcap", channels(), header=HEADER)
    before = path.read_bytes()
    noise = np.random.default_rng(1).random(20_000).tolist()
    flood = [LogChannel("a", object_schema({"v": NUMBER}), enumerate({"v": v} for v in noise))]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64 * 1024, hard))
    try:
        with pytest.raises(LogError, match=r"cannot write the log .*run\.mcap: file too large"):
            write_mcap(path, flood, header=HEADER)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_an_unwritable_path_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(LogError, match=r"cannot write the log .*file/run\.mcap: "):
        write_mcap(tmp_path / "file" / "run.mcap", channels(), header=HEADER)


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(LogError, match=r"pip install 'soter-rta\[logs\]'"):
        write_mcap(tmp_path / "run.mcap", channels(), header=HEADER)
    assert list(tmp_path.iterdir()) == []
