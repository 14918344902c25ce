"""Logs of PX4, ArduPilot and MAVLink, and several CSVs as one log.

The values are those that the formats' own libraries read; a file that is cut or damaged anywhere is
refused with the place, or read up to there where somebody asks for it.
"""

from __future__ import annotations

import struct
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import pytest

from generators.autopilot_logs import (
    FMTU,
    SAID,
    dataflash,
    dataflash_text,
    flight,
    table,
    tlog,
    ulog,
    written,
)
from soter.api import load
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError
from soter.monitor.log_files.log_columns import FileFacts, Wanted
from soter.monitor.log_files.read_columns import channel_messages

if TYPE_CHECKING:
    from collections.abc import Callable

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
MADE: dict[str, tuple[Callable[..., bytes], str, dict[str, Any]]] = {
    "flight.ulg": (ulog, "motion", {"x": "x", "v": "r.v"}),
    "flight.BIN": (dataflash, "POSE", {"x": "X", "v": "V"}),
    "flight.log": (dataflash_text, "POSE", {"x": "X", "v": "V"}),
    "flight.tlog": (tlog, "LOCAL_POSITION_NED", {"x": "x", "v": "vx"}),
}
"""By the name of a file: its bytes, and what the mapping says of it."""
NAMES = list(MADE)


@pytest.fixture(autouse=True)
def _pymavlink(request: pytest.FixtureRequest) -> None:
    if "tlog" in request.node.name:
        pytest.importorskip("pymavlink", reason="the extra `logs` is not installed")


def mapping(name: str, **more: Any) -> dict[str, Any]:
    _, channel, fields = MADE[name]
    topic = {"channel": channel, "fields": fields, **more}
    return {"system": "Protected", "topics": {"motion": topic}}


def judged(log: Path, name: str, **how: Any) -> Any:
    return load(CART).judge_log(log, mapping(name), **how)


def content(log: Path, channel: str, facts: FileFacts | None = None) -> list[tuple[int, Any]]:
    arrived = channel_messages(log, {channel: Wanted()}, facts or FileFacts())
    return [(now, content) for now, _, name, content in arrived if name == channel]


@pytest.mark.parametrize("name", NAMES)
def test_a_flight_is_judged_as_it_is_of_a_csv(tmp_path: Path, name: str) -> None:
    log = written(tmp_path / name, MADE[name][0](flight()))
    csv = written(tmp_path / "flight.csv", table(flight()))
    given = {"time": {"from": "t"}, "topics": {"motion": {"fields": {"x": "x", "v": "v"}}}}
    other = load(CART).judge_log(csv, given, system="Protected")
    judgement = judged(log, name)
    assert judgement.samples == other.samples == {"motion": 40}
    (module,), (of_csv,) = judgement.modules, other.modules
    assert (module.steps, module.ac, module.outside) == (of_csv.steps, of_csv.ac, of_csv.outside)
    assert module.margin is not None
    assert of_csv.margin is not None
    assert module.margin.distance == pytest.approx(of_csv.margin.distance, abs=1e-5)


def test_instances_are_channels_of_their_own(tmp_path: Path) -> None:
    for name, channel, field in (("flight.ulg", "motion", "x"), ("flight.BIN", "POSE", "X")):
        log = written(tmp_path / name, MADE[name][0](flight(3)))
        first, second = content(log, channel), content(log, f"{channel}#1")
        assert [c[field] + 1 for _, c in first] == [c[field] for _, c in second]
        assert first[0][0] == 5 * 10**9


def test_the_fields_of_a_ulog_are_those_of_pyulog(tmp_path: Path) -> None:
    pyulog = pytest.importorskip("pyulog")
    log, facts = written(tmp_path / "a.ulg", ulog(flight())), FileFacts()
    ours = content(log, "motion#1", facts)
    data = pyulog.ULog(str(log)).get_dataset("motion", 1).data
    assert [now for now, _ in ours] == (data["timestamp"] * 1000).tolist()
    assert [c["x"] for _, c in ours] == data["x"].tolist()
    assert [c["r"]["v"] for _, c in ours] == data["r.v"].tolist()
    assert [c["raw"][1] for _, c in ours] == data["raw[1]"].tolist()
    assert ours[0][1]["name"] == "ab"
    assert "could not keep up 1 times, for 7 ms" in " ".join(facts.notes)


@pytest.mark.parametrize("name", ["flight.BIN", "flight.log"])
def test_the_messages_of_ardupilot_are_those_of_pymavlink(tmp_path: Path, name: str) -> None:
    reader = pytest.importorskip("pymavlink.DFReader")
    log = written(tmp_path / name, MADE[name][0](flight()))
    of_kind = reader.DFReader_text if name.endswith("log") else reader.DFReader_binary
    theirs = of_kind(str(log))
    read = []
    while (message := theirs.recv_match(type="POSE")) is not None:
        read.append({k: v for k, v in message.to_dict().items() if k != "mavpackettype"})
    theirs.data_map.close()
    theirs.filehandle.close()
    ours = [c for pair in zip(content(log, "POSE"), content(log, "POSE#1"), strict=True)
            for _, c in pair]  # fmt: skip
    assert ours == read
    assert ours[0]["Tilt"] == -12.34


def test_messages_of_a_tlog_say_whose_they_are_and_count_when_they_came(tmp_path: Path) -> None:
    log = written(tmp_path / "a.tlog", tlog(flight(2)))
    (now, first), _ = content(log, "LOCAL_POSITION_NED")
    assert now == (1_700_000_000_000_000 + 5_000_000) * 1000
    assert first["header"] == {"srcSystem": 1, "srcComponent": 1}
    given = mapping("flight.tlog") | {"time": {"from": "time_boot_ms", "unit": "ms"}}
    assert load(CART).judge_log(log, given).to_s == pytest.approx(0.01)


# ---------------------------------------------------------------- cut and damaged


def of_damage(log: Path, name: str) -> str:
    with pytest.raises(SoterError) as error:
        judged(log, name)
    (problem,) = error.value.diagnostics
    assert problem.code == "D016"
    return " ".join((problem.message, *problem.helps))


@pytest.mark.parametrize("name", ["flight.ulg", "flight.BIN", "flight.tlog"])
def test_a_file_that_is_cut_anywhere_is_whole_up_to_there_or_refused(
    tmp_path: Path, name: str
) -> None:
    data = MADE[name][0](flight(3))
    whole = content(written(tmp_path / name, data), MADE[name][1])
    refused = 0
    for end in range(len(data)):
        log, facts = written(tmp_path / name, data[:end]), FileFacts()
        found = facts.readable_rows(
            log, channel_messages(log, {MADE[name][1]: Wanted()}, facts), partial=True
        )
        try:
            read = [(now, c) for now, _, channel, c in found if channel == MADE[name][1]]
        except SoterError as error:
            refused += error.diagnostics[0].code == "D016"
            continue
        assert read == whole[: len(read)], end
        refused += facts.damage is not None
    messages = 14 + 2 * 3
    assert refused >= len(data) - messages


@pytest.mark.parametrize("name", NAMES)
def test_a_block_of_zeros_is_found_and_only_what_stands_before_it_is_read_where_asked(
    tmp_path: Path, name: str
) -> None:
    data = MADE[name][0](flight())
    half = len(data) // 2
    log = written(tmp_path / name, data[:half] + bytes(200) + data[half + 200 :])
    said = of_damage(log, name)
    assert "`--partial`" in said
    assert "at byte" in said or "line" in said
    (module,) = judged(log, name, partial=True).modules
    assert 0.3 < module.damage.share < 0.55
    assert module.steps > 0


def test_part_of_a_log_is_no_verdict(tmp_path: Path, capsys: Any) -> None:
    log = written(tmp_path / "flight.ulg", ulog(flight())[:-20])
    map_ = tmp_path / "map.toml"
    map_.write_text(
        '[topics.motion]\nchannel = "motion"\nfields = { x = "x", v = "r.v" }\n', encoding="utf-8"
    )
    command = ["monitor", str(CART), str(log), "--map", str(map_), "--system", "Protected"]
    assert main(command) == 1
    assert "has no end" in capsys.readouterr().err
    assert main([*command, "--partial"]) == 4
    said = capsys.readouterr().out
    assert "no verdict: the log is damaged, and 99." in said
    assert "of its bytes could be read" in said
    assert main([*command, "--partial", "--format", "junit"]) == 4
    assert "<error" in capsys.readouterr().out
    assert main([*command[:3], "--partial"]) == 2


def test_of_a_whole_log_partial_changes_nothing(tmp_path: Path) -> None:
    log = written(tmp_path / "flight.ulg", ulog(flight()))
    assert judged(log, "flight.ulg", partial=True) == judged(log, "flight.ulg")


def test_formats_that_contain_themselves_or_more_than_a_message_end(tmp_path: Path) -> None:
    head = b"ULog\x01\x12\x35\x01" + bytes(8)
    for text in (
        b"a:uint64_t timestamp;a b;",
        b"a:uint64_t timestamp;double[99999] b;",
        b"a:uint64_t timestamp;__import__('os') b;",
        b"a:int8_t timestamp;",
        b"a:int8_t x;",
    ):
        parts = [struct.pack("<HB", len(text), ord("F")) + text, b"\x04\x00A\0\0\0a"]
        log = written(tmp_path / "flight.ulg", head + b"".join(parts))
        assert "none that its formats allow" in of_damage(log, "flight.ulg")


def test_a_format_or_a_number_of_a_ulog_has_one_meaning(tmp_path: Path) -> None:
    data, other = ulog(flight()), ulog(flight()).replace(b"rate:float v;", b"rate:float w;")
    formats = other[16 + 43 : other.index(b"motion:") - 3]
    log = written(tmp_path / "flight.ulg", data + formats)
    assert "none that its formats allow" in of_damage(log, "flight.ulg")
    again = data + data[16 + 43 : data.index(b"motion:") - 3]
    assert judged(written(log, again), "flight.ulg").samples == {"motion": 40}
    number = struct.pack("<HBBH", 9, ord("A"), 0, 8) + b"motion"
    assert "none that its formats allow" in of_damage(written(log, data + number), "flight.ulg")


def test_a_message_of_mavlink_with_another_checksum_is_refused_where_it_is_asked_for(
    tmp_path: Path,
) -> None:
    data = bytearray(tlog(flight()))
    data[20] ^= 1
    log = written(tmp_path / "flight.tlog", bytes(data))
    assert "the `LOCAL_POSITION_NED` at byte 0 is damaged" in of_damage(log, "flight.tlog")


def of_other_dialect(number: int, seed: int) -> bytes:
    """A `LOCAL_POSITION_NED` with the number of another message, sealed as some dialect has it."""
    from pymavlink.generator.mavcrc import x25crc

    frame = tlog(flight(1))[8:40]
    frame = frame[:4] + b"\xff\x09" + frame[6:7] + number.to_bytes(3, "little") + frame[10:-2]
    crc = x25crc([*frame[1:], seed]).crc
    return struct.pack(">Q", 1_700_000_004_000_000) + frame + struct.pack("<H", crc)


@pytest.mark.parametrize("number", [5, 54321])
def test_messages_of_mavlink_that_nobody_knows_have_the_checksums_of_one_dialect(
    tmp_path: Path, number: int
) -> None:
    """tlog: 5 is `CHANGE_OPERATOR_CONTROL`, and no dialect has 54321."""
    log, facts = tmp_path / "flight.tlog", FileFacts()
    strange = of_other_dialect(number, 77)
    written(log, strange * 2 + tlog(flight()))
    assert len(content(log, "LOCAL_POSITION_NED", facts)) == 40
    assert "2 messages have the number of" in " ".join(facts.notes)
    damaged = strange[:30] + bytes([strange[30] ^ 4]) + strange[31:]
    for other in (damaged, of_other_dialect(number, 78)):
        written(log, strange + other + tlog(flight()))
        assert "is damaged" in of_damage(log, "flight.tlog")


def test_the_raw_stream_of_a_ground_station_has_no_times(tmp_path: Path) -> None:
    for name in ("flight.rlog", "FLIGHT.RLOG"):
        with pytest.raises(SoterError, match="nothing says when") as error:
            content(written(tmp_path / name, tlog(flight())), "HEARTBEAT")
        assert ".tlog" in error.value.diagnostics[0].helps[0]


# ---------------------------------------------------------------- garbage is no message


def with_message(kind: str, body: bytes) -> bytes:
    """A ULog with one more message, in its middle."""
    data, end = ulog(flight()), len(ulog(flight()[:20]))
    return data[:end] + struct.pack("<HB", len(body), ord(kind)) + body + data[end:]


TIME = struct.pack("<Q", 5_000_000)
NO_MESSAGES = (
    ("\x93", b"a kind that ULog has not"), ("X", b"\0"), ("b", bytes(40)),
    ("I", b"\x10char[3] sys_name" + b"PX44"), ("I", b"\x10char[3] sys_name" + b"PX"),
    ("I", b"\x0ffloat MPC_XY_Z1"), ("I", b"\x09quad NAME" + bytes(4)), ("I", b"\xff"),
    ("I", bytes(9)),
    ("M", b"\2\x0cchar[2] perfok"), ("M", b"\0\x0cchar[2] perfo\0k"), ("M", b"\0"),
    ("P", b"\x0ffloat MPC_XY_Z1" + bytes(8)), ("P", b"\x0ffloat MPC_XY\0Z1" + bytes(4)),
    ("Q", b"\x90\x0dint32_t MAV_1" + bytes(4)), ("Q", b"\1\x0dint32_t MAV_1" + bytes(3)),
    ("L", b"9" + TIME + b"text"), ("L", b"6" + TIME[:5]), ("L", b"6" + TIME + b"te\0xt"),
    ("C", b"4\0\0" + TIME + b"\x01\x02"), ("S", bytes(8)), ("S", b"\x2f\x73"),
    ("O", bytes(3)), ("R", b"\x07"), ("R", b"\x63\0"), ("B", bytes(40)), ("D", b"\x07\0"),
    ("F", b"other:uint64_t timestamp;\xff\x01"), ("F", b"other"), ("F", b"x:float;"),
    ("A", b"\0\x30\0nobody"), ("A", b"\0"),
)  # fmt: skip
"""Kind and body of what is no message of a ULog, whatever it is taken for."""


@pytest.mark.parametrize(("kind", "body"), NO_MESSAGES, ids=lambda x: repr(x)[:20])
def test_what_is_no_message_of_a_ulog_is_refused(tmp_path: Path, kind: str, body: bytes) -> None:
    log = written(tmp_path / "flight.ulg", with_message(kind, body))
    said = of_damage(log, "flight.ulg")
    assert "none that its formats allow" in said
    assert f"at byte {len(ulog(flight()[:20])):,}" in said


def test_messages_of_every_kind_that_ulog_has_are_read_over(tmp_path: Path) -> None:
    fine = (
        ("I", b"\x0euint32_t ver_x" + bytes(4)), ("M", b"\1\x0cchar[2] perf" + b"ok"),
        ("M", b"\1\x0cchar[2] perf" + b"longer: 12\n"), ("M", b"\1\x0cuint8_t[9] m" + bytes(3)),
        ("P", b"\x0ffloat MPC_XY_Z1" + bytes(4)), ("Q", b"\2\x0dint32_t MAV_1" + bytes(4)),
        ("L", b"3" + TIME + "größer\t\n".encode()), ("L", b"0" + TIME),
        ("C", b"7\1\0" + TIME + b"text"), ("O", b"\1\0"), ("F", b"a/b-c:d-e[2] x;"),
    )  # fmt: skip
    for kind, body in fine:
        log = written(tmp_path / "flight.ulg", with_message(kind, body))
        assert len(content(log, "motion")) == 40, kind
    ended = ulog(flight()) + b"\x02\x00R\x08\x00"
    assert len(content(written(tmp_path / "flight.ulg", ended), "motion")) == 40


@pytest.mark.parametrize("name", ["flight.ulg", "flight.BIN", "flight.tlog"])
def test_a_byte_that_is_missing_or_one_more_anywhere_is_refused_or_changes_nothing(
    tmp_path: Path, name: str
) -> None:
    make, channel, _ = MADE[name]
    data = make(flight(3))
    whole, refused = content(written(tmp_path / name, data), channel), 0
    for at in range(Random(name).randrange(17), len(data), 17):  # noqa: S311 - a test
        for damaged in (data[:at] + data[at + 1 :], data[:at] + b"\x5a" + data[at:]):
            try:
                assert content(written(tmp_path / name, damaged), channel) == whole, at
            except SoterError as error:
                refused += error.diagnostics[0].code == "D016"
    assert refused >= 2 * len(data) // 17 - 3


def test_what_a_crash_cut_begins_as_a_message_of_its_topic(tmp_path: Path) -> None:
    data, log = ulog(flight()), tmp_path / "flight.ulg"
    head = struct.pack("<8x8s3Q", b"\1", len(data) - 20, 0, 0)
    begun = data[:19] + head + data[59:-20]
    rest = data[len(ulog(flight()[:39])) :]
    facts = FileFacts()
    assert len(content(written(log, begun + rest), "motion#1", facts)) == 40
    assert "was cut at byte" in " ".join(facts.notes)
    at = len(ulog(flight()[:30]))
    for broken in (begun[:at] + begun[at + 1 :], begun[: at + 3] + b"\x44" + begun[at + 3 :]):
        with pytest.raises(SoterError, match="D016"):
            content(written(log, broken + rest), "motion")


def test_two_numbers_of_one_instance_are_told_as_its_writers(tmp_path: Path) -> None:
    data, facts = ulog(flight()), FileFacts()
    mixed = data.replace(b"A\1\x08\0motion", b"A\0\x08\0motion")
    log = written(tmp_path / "flight.ulg", mixed)
    assert len(content(log, "motion", facts)) == 80
    assert "`motion` has 2 writers" in " ".join(facts.notes)


POSE_LINE = "POSE, 5200000, 0, 0.2, 0.125, -12.34"
LINES = (
    ("a lost line end", POSE_LINE + ", " + POSE_LINE),
    ("a decimal comma", "POSE, 5200000, 0, 0,2, 0.125, -12.34"),
    ("a cell too few", "POSE, 5200000, 0, 0.2, 0.125"),
    ("a name that nobody has", "POSF, 5200000, 0, 0.2, 0.125, -12.34"),
    ("a name that is lost", ", 5200000, 0, 0.2, 0.125, -12.34"),
    ("a number in no byte", "POSE, 5200000, 256, 0.2, 0.125, -12.34"),
    ("a number below 0", "POSE, -5200000, 0, 0.2, 0.125, -12.34"),
    ("5,000 digits", f"POSE, {'9' * 5000}, 0, 0.2, 0.125, -12.34"),
    ("a text and the next line", "MSG, 5200000, Ready" + POSE_LINE),
    ("a text with a comma and the next line", "MSG, 5200000, by 255, READY" + POSE_LINE),
    ("a text that is too long", "MSG, 5200000, " + "x" * 65),
)


@pytest.mark.parametrize("line", [line for _, line in LINES], ids=[name for name, _ in LINES])
def test_a_line_that_its_format_does_not_allow_is_refused(tmp_path: Path, line: str) -> None:
    text = dataflash_text(flight()).decode()
    before, after = text[: text.index("POSE, 5200000, 0")], text[text.index("POSE, 5200000, 1") :]
    good = written(tmp_path / "flight.log", (before + POSE_LINE + "\n" + after).encode())
    assert len(content(good, "POSE")) == 40
    log = written(tmp_path / "flight.log", (before + line + "\n" + after).encode())
    assert f"line {before.count(chr(10)) + 1} is" in of_damage(log, "flight.log")


def test_a_last_line_of_a_dataflash_text_has_an_end(tmp_path: Path) -> None:
    log = written(tmp_path / "flight.log", dataflash_text(flight())[:-3])
    assert "has no end" in of_damage(log, "flight.log")


def test_a_text_that_stands_last_keeps_its_commas(tmp_path: Path) -> None:
    log = written(tmp_path / "flight.log", dataflash_text(flight()))
    assert {c["Message"] for _, c in content(log, "MSG")} == {SAID}


# ---------------------------------------------------------------- what holds for the whole log


def late_units(data: bytes) -> bytes:
    """The log with its `FMTU` at its end."""
    text = data.startswith(b"FMT")
    begin = data.index(b"FMTU, 5" if text else b"\xa3\x95\x82")
    end = data.index(b"\n", begin) + 1 if text else begin + FMTU[1]
    return data[:begin] + data[end:] + data[begin:end]


@pytest.mark.parametrize("name", ["flight.BIN", "flight.log"])
def test_a_description_holds_for_messages_before_it(tmp_path: Path, name: str) -> None:
    data = MADE[name][0](flight())
    first = content(written(tmp_path / name, data), "POSE#1")
    assert content(written(tmp_path / name, late_units(data)), "POSE#1") == first
    assert len(content(written(tmp_path / name, late_units(data)), "POSE")) == 40


def test_a_format_of_a_text_holds_for_lines_before_it(tmp_path: Path) -> None:
    lines = dataflash_text(flight()).splitlines(keepends=True)
    moved = [lines[0], *lines[2:], lines[1]]
    assert len(content(written(tmp_path / "flight.log", b"".join(moved)), "POSE")) == 40


@pytest.mark.parametrize("name", ["flight.BIN", "flight.log"])
def test_a_number_of_dataflash_has_one_format_and_one_instance(tmp_path: Path, name: str) -> None:
    data, log = MADE[name][0](flight()), tmp_path / name
    for a, b in ((b"TimeUS,I,X,V,Tilt", b"TimeUS,I,V,X,Tilt"), (b"s#mnd", b"#smnd")):
        other = data.replace(a, b)
        assert content(written(log, data + data), "POSE"), "the same again is no contradiction"
        with pytest.raises(SoterError, match="D016"):
            content(written(log, data + other), "POSE")


def test_a_name_of_a_dataflash_text_has_one_format(tmp_path: Path) -> None:
    again = b"FMT, 140, 25, POSE, Qdd, TimeUS,X,V\n"
    log = written(tmp_path / "flight.log", dataflash_text(flight()) + again)
    assert "what one before it does not" in of_damage(log, "flight.log")


@pytest.mark.parametrize("name", ["flight.BIN", "flight.log"])
def test_messages_that_say_no_time_of_their_own_are_told(tmp_path: Path, name: str) -> None:
    data, facts = MADE[name][0](flight()), FileFacts()
    content(written(tmp_path / name, data), "POSE", facts)
    assert facts.notes == []
    other = data.replace(b"TimeUS,I,X", b"TimeUT,I,X")
    content(written(tmp_path / name, other), "POSE", facts)
    assert facts.notes == ["`POSE` says no time: that of the message before it counts"]


# ---------------------------------------------------------------- several CSVs


def two(tmp_path: Path) -> list[Path]:
    rows = flight()
    return [
        written(tmp_path / "12_pose.csv", table(rows, "t,x")),
        written(tmp_path / "12_speed.csv", table(rows[::2], "t,v")),
    ]


COMMAND = {"channel": "*_speed.csv", "fields": {"value": "v"}}
BOTH: dict[str, Any] = {
    "system": "Protected",
    "time": {"from": "t"},
    "topics": {
        "motion": {"channel": "*_pose.csv", "fields": {"x": "x", "v": {"constant": 0.125}}},
        "accel": COMMAND,
    },
}


def test_several_csvs_are_one_log(tmp_path: Path) -> None:
    judgement = load(CART).judge_log(two(tmp_path), BOTH)
    assert judgement.samples == {"motion": 40, "accel": 20}
    assert judgement.log == f"{tmp_path / '12_pose.csv'}, {tmp_path / '12_speed.csv'}"
    assert judgement.to_s == pytest.approx(0.39)


def test_a_mapping_that_names_no_file_of_several_or_two_is_told(tmp_path: Path) -> None:
    logs = two(tmp_path)
    for channel in ("*.csv", "speed.csv", None):
        topics = {**BOTH["topics"], "accel": {"fields": {"value": "v"}}}
        if channel:
            topics["accel"]["channel"] = channel
        with pytest.raises(SoterError, match=r"12_pose\.csv") as error:
            load(CART).judge_log(logs, {**BOTH, "topics": topics})
        assert error.value.diagnostics[0].code == "D016"


def test_files_of_different_clocks_are_no_log(tmp_path: Path) -> None:
    later = [(now + 10**9, x, v) for now, x, v in flight()]
    logs = [two(tmp_path)[0], written(tmp_path / "12_speed.csv", table(later, "t,v"))]
    with pytest.raises(SoterError, match="when another one has ended"):
        load(CART).judge_log(logs, BOTH)


def test_of_several_files_each_is_a_csv(tmp_path: Path) -> None:
    logs = [two(tmp_path)[0], written(tmp_path / "12_speed.ulg", ulog(flight()))]
    with pytest.raises(SoterError, match="each is a CSV"):
        load(CART).judge_log(logs, BOTH)
