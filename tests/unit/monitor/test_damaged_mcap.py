"""MCAPs that contradict themselves: each is refused with the place, Soter's own as well.

Non-goals: what no checksum, count or index of the file covers (`bench/hostile/damaged_logs.py`).
"""

from __future__ import annotations

import random
import struct
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("mcap", reason="the extra `logs` is not installed")
pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.hostile.log_records import Records, as_mcap, mcap_record, mcap_records, place_of
from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, IndexType, Writer

from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.report.mcap_log import DATA_END, FOOTER, MAGIC, RECORD, mend_log
from soter.report.mcap_reading import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    MESSAGE,
    MESSAGE_INDEX,
    STATISTICS,
    DamagedMcapError,
    McapRecords,
)
from tables import all_rows

if TYPE_CHECKING:
    from soter.api import Program

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"


def log(path: Path, *, attached: bool = False, **how: Any) -> Path:
    """Ten messages on each of two channels, in several chunks unless `how` says otherwise."""
    with path.open("wb") as file:
        writer: Any = Writer(file, **{"chunk_size": 200, **how})
        writer.start()
        schema = writer.register_schema("m", "jsonschema", b"{}")
        ids = [writer.register_channel(name, "json", schema) for name in ("/a", "/b")]
        for k in range(10):
            for channel in ids:
                writer.add_message(channel, 100 * k, b'{"x": %d}' % k, 100 * k)
        if attached:
            writer.add_attachment(0, 0, "notes", "text/plain", b"nothing")
        writer.finish()
    return path


def read(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as file:
        return [(c.topic, m.log_time, m.data) for c, _, m in McapRecords(file).messages()]


KINDS: list[dict[str, Any]] = [
    {},
    {"compression": CompressionType.NONE},
    {"compression": CompressionType.LZ4, "enable_data_crcs": True},
    {"use_chunking": False},
    {"use_chunking": False, "use_statistics": False, "repeat_channels": False},
    {"enable_crcs": False, "index_types": IndexType.NONE, "use_summary_offsets": False},
    {"attached": True},
]


@pytest.mark.whole
@pytest.mark.parametrize("how", KINDS)
def test_a_file_that_is_whole_is_read_whole(tmp_path: Path, how: dict[str, Any]) -> None:
    found = read(log(tmp_path / "a.mcap", **how))
    assert found == [
        (topic, 100 * k, b'{"x": %d}' % k) for k in range(10) for topic in ("/a", "/b")
    ]


def with_bit(path: Path, place: int) -> Path:
    data = bytearray(path.read_bytes())
    data[place // 8] ^= 1 << place % 8
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("how", [{"enable_data_crcs": True}, {"use_chunking": False}])
def test_a_bit_of_what_a_checksum_covers_is_told(tmp_path: Path, how: dict[str, Any]) -> None:
    """With a checksum of all data every bit of the file is covered; without chunks, its summary."""
    path = log(tmp_path / "a.mcap", **how)
    whole = path.read_bytes()
    begin = 0
    if "use_chunking" in how:
        (begin,) = struct.unpack_from("<Q", whole, len(whole) - len(MAGIC) - 20)
    chance = random.Random(3)  # noqa: S311 - no secret
    for place in chance.sample(range(8 * begin, 8 * len(whole)), 200):
        path.write_bytes(whole)
        with pytest.raises(Exception) as error:  # noqa: PT011 - the package's own, too
            read(with_bit(path, place))
        assert str(error.value), place


def changed(name: str, records: Records) -> None:
    """One contradiction, which no checksum tells any more."""
    statistics, index, chunk = (
        place_of(records, STATISTICS),
        place_of(records, CHUNK_INDEX),
        place_of(records, CHUNK),
    )
    if name == "a chunk less":
        del records[chunk]
    elif name == "a chunk twice":
        records.insert(chunk, records[chunk])
    elif name == "a chunk less, nobody counts":
        del records[statistics], records[chunk]
    elif name == "a chunk without its index":
        del records[statistics], records[index - 1]
    elif name == "an index of another chunk":
        of_one = [i for i, (k, b) in enumerate(records) if k == MESSAGE_INDEX and b[0] == 1]
        records[of_one[0]] = records[of_one[-1]]
    elif name == "an index that leaves out a channel":
        del records[place_of(records, MESSAGE_INDEX)]
    elif name == "a schema of two meanings":
        records.insert(chunk + 1, mcap_record(Schema(1, b"[]", "jsonschema", "other")))
    elif name == "a channel of two meanings":
        records.insert(chunk + 1, mcap_record(Channel(2, "/c", "json", {}, 1)))
    elif name == "a channel of two meanings in the summary":
        records[place_of(records, CHANNEL, -1)] = mcap_record(Channel(2, "/c", "json", {}, 1))
    elif name == "a channel that is none":
        records.insert(chunk + 1, mcap_record(Message(7, 5, b"{}", 5, 0)))
    elif name == "no end of the data":
        del records[place_of(records, DATA_END)]
    elif name == "a message in the summary":
        records.insert(statistics, mcap_record(Message(1, 5, b"{}", 5, 0)))
    elif name == "a header less":
        del records[0]
    elif name == "a message more":
        records.insert(place_of(records, CHUNK, 1), mcap_record(Message(1, 5, b"{}", 5, 0)))


TOLD = {
    "a chunk less": "other messages of channel 1 than the chunk before it",
    "a chunk twice": "its statistics count 20 messages, and",
    "a chunk less, nobody counts": "other messages of channel 1 than the chunk before it",
    "a chunk without its index": "its index does not name all of its chunks",
    "an index of another chunk": "has other messages of channel 1 than the chunk before it",
    "an index that leaves out a channel": "leaves out channel 1",
    "a schema of two meanings": "schema 1 is `m`, and from byte",
    "a channel of two meanings": "channel 2 is `/b`, and from byte",
    "a channel of two meanings in the summary": "channel 2 is `/b`, and from byte",
    "a channel that is none": "is of channel 7, which is none",
    "no end of the data": "a record of kind 11 stands at byte",
    "a message in the summary": "a record of kind 5 stands at byte",
    "a header less": "its header does not stand at its beginning",
    "a message more": "its statistics count 20 messages, and 21 stand there",
}


@all_rows(("name", "told"), TOLD.items())
def test_what_contradicts_is_told_where_no_checksum_is(
    tmp_path: Path, name: str, told: str
) -> None:
    path = log(tmp_path / "a.mcap")
    records = mcap_records(path)
    assert len(read(as_mcap(path, records))) == 20, "without its checksums it is read"
    changed(name, records)
    with pytest.raises(DamagedMcapError) as error:
        read(as_mcap(path, records))
    assert told in str(error.value)


def test_counts_of_a_file_without_chunks_are_compared(tmp_path: Path) -> None:
    path = log(tmp_path / "a.mcap", use_chunking=False)
    records = mcap_records(path)
    del records[place_of(records, MESSAGE, 4)]
    with pytest.raises(DamagedMcapError, match="its statistics count 20 messages, and 19 stand"):
        read(as_mcap(path, records))


@pytest.mark.parametrize("bit", range(8))
def test_a_message_whose_kind_is_another_is_not_lost_in_silence(tmp_path: Path, bit: int) -> None:
    """In a file that has neither checksums nor counts."""
    path = log(tmp_path / "a.mcap", use_chunking=False, use_statistics=False)
    records = mcap_records(path)
    place = place_of(records, MESSAGE, 4)
    records[place] = MESSAGE ^ 1 << bit, records[place][1]
    with as_mcap(path, records).open("rb") as file:
        found = McapRecords(file)
        if bit == 7:
            assert len(list(found.messages())) == 19
            assert found.private == 1
            return
        with pytest.raises(DamagedMcapError):
            list(found.messages())


def test_two_files_one_behind_the_other_are_not_one(tmp_path: Path) -> None:
    path = log(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes() * 2)
    with pytest.raises(DamagedMcapError, match="more bytes stand behind its end"):
        read(path)


def test_an_attachment_has_a_checksum_of_its_own(tmp_path: Path) -> None:
    path = log(tmp_path / "a.mcap", attached=True)
    records = mcap_records(path)
    place = place_of(records, ATTACHMENT)
    records[place] = ATTACHMENT, records[place][1].replace(b"nothing", b"somethi")
    with pytest.raises(DamagedMcapError, match="the attachment at byte"):
        read(as_mcap(path, records))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.99])
def test_a_file_that_is_cut_says_so(tmp_path: Path, share: float) -> None:
    path = log(tmp_path / "a.mcap", use_chunking=False)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DamagedMcapError, match="its end is missing"):
        read(path)


# ---------------------------------------------------------------- Soter's own


@cache
def cart() -> Program:
    return load(CART)


def verdict(path: Path) -> str:
    try:
        return repr(cart().monitor(path, system="Protected"))
    except SoterError as error:
        return error.diagnostics[0].code


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "run.mcap"
    cart().simulate(system="Protected", seed=5, until="300ms", log=path)
    return path


def test_every_bit_of_a_log_of_soter_is_covered(own: Path, tmp_path: Path) -> None:
    path, whole = tmp_path / "run.mcap", own.read_bytes()
    chance = random.Random(11)  # noqa: S311 - no secret
    for place in chance.sample(range(8 * len(whole)), 60):
        path.write_bytes(whole)
        assert verdict(with_bit(path, place)) == "D006", place


def test_a_log_that_a_dead_process_left_has_its_checksums_too(own: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    records = mcap_records(own)
    end = place_of(records, DATA_END)
    whole = b"".join(RECORD.pack(k, len(body)) + body for k, body in records[:end])
    path.write_bytes(MAGIC + whole + RECORD.pack(CHUNK, 1000) + b"cut")
    assert mend_log(path)
    assert verdict(path) == verdict(own) != "D006"
    left = path.read_bytes()
    name = left.index(b"soter.end")
    for byte in (name, left.index(b"program_sha256") + 20, len(left) - len(MAGIC) - 1):
        path.write_bytes(left)
        assert verdict(with_bit(path, 8 * byte)) == "D006"


def test_time_that_goes_back_in_a_log_of_soter_is_told(own: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    records = mcap_records(own)
    chunk = place_of(records, CHUNK)
    assert sum(k == CHUNK for k, _ in records) == 1
    again = [records[0], records[chunk], records[chunk], (DATA_END, b""), (FOOTER, b"")]
    with pytest.raises(SoterError) as error:
        cart().monitor(as_mcap(path, again), system="Protected")
    assert "time goes back from 0.3 s to 0 s" in str(error.value.diagnostics[0].message)
