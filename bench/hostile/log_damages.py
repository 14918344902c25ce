"""What happens to logs: eleven kinds of them, and 44 ways in which they are damaged.

Purpose: from a kind, a way and a seed to a log in a folder: disks, transfers, recorders that die,
tools that copy parts.
Non-goals: what is to come of it (`damaged_logs.py`).
"""

from __future__ import annotations

import gzip
import json
import shutil
import sqlite3
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(p) for p in (ROOT, ROOT / "tests") if str(p) not in sys.path]

from bench.hostile.log_records import (  # noqa: E402 - needs the path
    CHUNK1,
    CONNECTION1,
    as_mcap,
    inside,
    mcap_record,
    mcap_records,
    place_of,
    rewritten,
)
from mcap.records import Channel, Schema  # noqa: E402 - the same
from mcap.writer import Writer as McapWriter  # noqa: E402 - the same

from generators import autopilot_logs  # noqa: E402 - the same
from generators.robot_logs import (  # noqa: E402 - the same
    CHANNEL,
    MS,
    T0,
    TYPED,
    WRITERS,
    Recorded,
    odometry,
    whole,
)
from soter.report.mcap_reading import CHUNK, MESSAGE, STATISTICS  # noqa: E402 - the same

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

    from bench.hostile.log_records import Records

    Way = Callable[["Kind", Path, Random], Path | None]
    """From a kind and an empty folder to a damaged log; None where it has no such thing."""

BLOCK = 512
MESSAGES = 120
BEGAN_US = 7_200_000_000
"""How long an autopilot runs when the flight begins."""
Flight = list[Recorded]


def flight() -> Flight:
    """The cart goes to its wall and through it, then back; a message every 10 ms, 1 ms late."""
    told = []
    for k in range(MESSAGES):
        x = 10.4 - abs(10.4 - 0.11 * k)
        at = T0 + k * 10 * MS
        told.append(Recorded(at, odometry(at - MS, x, 11.0 if k < 95 else -11.0)))
    return told


# ---------------------------------------------------------------- eleven kinds


def gz(path: Path, recorded: Flight) -> None:
    """A CSV that is packed."""
    table = path.with_name("table.csv")
    WRITERS["flight.csv"](table, recorded)
    path.write_bytes(gzip.compress(table.read_bytes(), mtime=0))
    table.unlink()


def loose_mcap(path: Path, recorded: Flight) -> None:
    """An MCAP of JSON without chunks: no message has a checksum."""
    with path.open("wb") as file:
        writer: Any = McapWriter(file, use_chunking=False)
        writer.start()
        schema = writer.register_schema("odometry", "jsonschema", b"{}")
        channel = writer.register_channel(CHANNEL, "json", schema)
        for m in recorded:
            data = json.dumps(whole(m.type, m.content)).encode()
            writer.add_message(channel, m.arrival_ns, data, m.arrival_ns)
        writer.finish()


def by_autopilot(write: Callable[..., bytes]) -> Callable[[Path, Flight], None]:
    """What an autopilot or a ground station writes of a flight."""

    def written(path: Path, recorded: Flight) -> None:
        rows = [
            (
                (m.arrival_ns - T0) // 1000 + BEGAN_US,
                m.content["pose"]["pose"]["position"]["x"],
                m.content["twist"]["twist"]["linear"]["x"],
            )
            for m in recorded
        ]
        path.write_bytes(write(rows))

    return written


@dataclass(frozen=True)
class Kind:
    """A kind of log: its name as a file or folder, the file that holds its messages, a writer.

    `channel`, `x`, `v`: where the flight stands in it; "": as in messages of ROS.
    """

    name: str
    file: str
    write: Callable[[Path, Flight], None]
    channel: str = ""
    x: str = ""
    v: str = ""

    @property
    def topic(self) -> dict[str, Any]:
        """What a mapping says of the topic."""
        if not self.channel:
            return TYPED
        return {"channel": self.channel, "fields": {"x": self.x, "v": self.v}}

    def written(self, folder: Path, recorded: Flight) -> Path:
        """The log, in a folder of its own."""
        folder.mkdir(parents=True, exist_ok=True)
        self.write(folder / self.name, recorded)
        return folder / self.name

    def messages(self, log: Path) -> Path:
        """The file of a log that holds its messages."""
        return log / self.file if self.file else log


KINDS = {
    "CSV": Kind("flight.csv", "", WRITERS["flight.csv"]),
    "CSV, gzip": Kind("flight.csv.gz", "", gz),
    "MCAP, chunks": Kind("cdr.mcap", "", WRITERS["cdr.mcap"]),
    "MCAP, no chunks": Kind("loose.mcap", "", loose_mcap),
    "ROS 1": Kind("plain.bag", "", WRITERS["plain.bag"]),
    "ROS 2, SQLite": Kind("ros2_plain", "ros2_plain.db3", WRITERS["ros2_plain"]),
    "ROS 2, MCAP": Kind("ros2_mcap", "ros2_mcap.mcap", WRITERS["ros2_mcap"]),
    "ULog": Kind("px4.ulg", "", by_autopilot(autopilot_logs.ulog), "motion", "x", "r.v"),
    "DataFlash": Kind("ap.bin", "", by_autopilot(autopilot_logs.dataflash), "POSE", "X", "V"),
    "DataFlash, text": Kind(
        "ap.log", "", by_autopilot(autopilot_logs.dataflash_text), "POSE", "X", "V"
    ),
    "MAVLink": Kind(
        "gcs.tlog", "", by_autopilot(autopilot_logs.tlog), "LOCAL_POSITION_NED", "x", "vx"
    ),
}

# ---------------------------------------------------------------- 44 ways


def by_bytes(change: Callable[[bytes, Random], bytes]) -> Way:
    """What happens to the bytes of the file that holds the messages."""

    def way(kind: Kind, folder: Path, chance: Random) -> Path:
        log = kind.written(folder, flight())
        file = kind.messages(log)
        file.write_bytes(change(file.read_bytes(), chance))
        return log

    return way


def by_messages(change: Callable[[Flight], Flight]) -> Way:
    """What a recorder did while it wrote."""
    return lambda kind, folder, _: kind.written(folder, change(flight()))


def at(share: float, data: bytes) -> int:
    """A place in a file."""
    return int(share * len(data))


def overwritten(data: bytes, place: int, block: bytes) -> bytes:
    """The bytes with others in their place, as many as before."""
    return data[:place] + block[: len(data) - place] + data[place + len(block) :]


def swapped(data: bytes, a: int, b: int) -> bytes:
    """Two blocks in each other's place."""
    first, second = data[a : a + BLOCK], data[b : b + BLOCK]
    return overwritten(overwritten(data, a, second), b, first)


def flipped(data: bytes, place: int) -> bytes:
    """One bit of a file is another."""
    byte, bit = divmod(place, 8)
    return data[:byte] + bytes([data[byte] ^ 1 << bit]) + data[byte + 1 :]


def flip_at(share: float) -> Way:
    """A bit somewhere near a place."""

    def change(data: bytes, chance: Random) -> bytes:
        near = min(len(data) - 64, max(0, at(share, data) - 32))
        return flipped(data, 8 * near + chance.randrange(512))

    return by_bytes(change)


def without(data: bytes, chance: Random, most: int = 1) -> bytes:
    """Up to so many bytes are gone, somewhere."""
    place = chance.randrange(len(data))
    return data[:place] + data[place + chance.randint(1, most) :]


def one_more(data: bytes, chance: Random) -> bytes:
    """A byte more, somewhere, that stands elsewhere in the file."""
    place, other = chance.randrange(len(data)), chance.randrange(len(data))
    return data[:place] + data[other : other + 1] + data[place:]


def end_of_line_lost(data: bytes, chance: Random) -> bytes:
    """The end of a line is gone: of what is no text, a byte that looks so."""
    places = [k for k, byte in enumerate(data) if byte in b"\n"] or [len(data) // 2]
    place = chance.choice(places)
    return data[:place] + data[place + 1 :]


def as_text(data: bytes, _: Random) -> bytes:
    """Read as if it were a text of one byte a letter, and written as UTF-8."""
    return data.decode("latin-1").encode("utf-8")


def behind(kind: Kind, folder: Path, _: Random) -> Path:
    """Another flight behind it, as `cat a b` gives it."""
    log = kind.written(folder, flight())
    other = kind.written(folder / "other", moved(flight(), 0, 3600 * 1000))
    file = kind.messages(log)
    file.write_bytes(file.read_bytes() + kind.messages(other).read_bytes())
    return log


def half_of_other(kind: Kind, folder: Path, _: Random) -> Path:
    """The second half is that of another flight: a download that went on with another file."""
    log = kind.written(folder, flight())
    calm = [Recorded(m.arrival_ns, odometry(m.arrival_ns - MS, 1.0, 0.0)) for m in flight()]
    other = kind.messages(kind.written(folder / "other", calm)).read_bytes()
    file = kind.messages(log)
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2] + other[len(data) // 2 :])
    return log


def moved(recorded: Flight, begin: int, by_ms: int) -> Flight:
    """From a message on the recorder's clock shows another time."""
    return [
        m if k < begin else Recorded(m.arrival_ns + by_ms * MS, m.content)
        for k, m in enumerate(recorded)
    ]


def pairs(recorded: Flight) -> Flight:
    """Every second message has the time of the one before it."""
    return [Recorded(recorded[k - k % 2].arrival_ns, m.content) for k, m in enumerate(recorded)]


def exchanged(recorded: Flight) -> Flight:
    """Two messages in each other's place."""
    return [*recorded[:50], recorded[51], recorded[50], *recorded[52:]]


def by_parts(
    mcap: Callable[[Records], None] | None = None,
    bag: Callable[[list[Any]], None] | None = None,
    sql: str = "",
) -> Way:
    """What happens to records of an MCAP or of a bag of ROS 1, and to the tables of SQLite."""

    def way(kind: Kind, folder: Path, _: Random) -> Path | None:
        log = kind.written(folder, flight())
        file = kind.messages(log)
        if file.suffix == ".mcap" and mcap is not None:
            records = mcap_records(file)
            mcap(records)
            as_mcap(file, records)
        elif file.suffix == ".bag" and bag is not None:
            rewritten(log, bag)
        elif file.suffix == ".db3" and sql:
            _sql(file, sql)
        else:
            return None
        return log

    return way


def data_of(records: Records) -> list[int]:
    """Which records of an MCAP hold messages."""
    return [i for i, (k, _) in enumerate(records) if k in (CHUNK, MESSAGE)]


def channel_again(records: Records) -> None:
    """The id of a channel means another one from the middle on."""
    middle = data_of(records)
    channel = mcap_record(Channel(1, "/camera/odom", "json", {}, 1))
    records.insert(middle[len(middle) // 2], channel)


def other_topic(parts: list[Any]) -> None:
    """The connection in a chunk is of another topic than in the index."""
    place = next(k for k, part in enumerate(parts) if part[0] == CONNECTION1)
    kind, header, content = parts[place]
    parts[place] = kind, {**header, "topic": b"/camera/odom"}, content


def schema_again(records: Records) -> None:
    """The id of a schema means another one from the end of the data on."""
    schema = mcap_record(Schema(1, b"float64 x\n", "ros2msg", "robot/msg/Other"))
    records.insert(data_of(records)[-1], schema)


def last_gone(records: Records) -> None:
    """The last record with messages is lost."""
    del records[data_of(records)[-1]]


def last_lost(parts: list[Any]) -> None:
    """The last message of a chunk is gone."""
    del parts[-1]


def other_count(records: Records) -> None:
    """The statistics of an MCAP count 200 messages."""
    place = place_of(records, STATISTICS)
    records[place] = STATISTICS, (200).to_bytes(8, "little") + records[place][1][8:]


def one_chunk_less(records: list[Any]) -> None:
    """The head of a bag of ROS 1 counts fewer chunks, and the index has fewer."""
    header = records[0][1]
    n = int.from_bytes(header["chunk_count"], "little")
    header["chunk_count"] = (n - 1).to_bytes(4, "little")
    del records[-1]


def uncounted(kind: Kind, folder: Path, chance: Random) -> Path | None:
    """What counts its messages says another number: of a bag of ROS 2 its metadata."""
    if not kind.file:
        return by_parts(other_count, one_chunk_less)(kind, folder, chance)
    log = kind.written(folder, flight())
    metadata = log / "metadata.yaml"
    text = metadata.read_text().replace(f"message_count: {MESSAGES}", "message_count: 200")
    metadata.write_text(text)
    return log


def chunk_again(records: Records) -> None:
    """A chunk of an MCAP stands there twice."""
    place = data_of(records)[0]
    records.insert(place, records[place])


def chunk1_again(records: list[Any]) -> None:
    """A chunk of a bag of ROS 1 stands there twice."""
    place = next(i for i, r in enumerate(records) if r[0] == CHUNK1)
    records.insert(place, records[place])


def lost_beside(kind: Kind, folder: Path, _: Random) -> Path | None:
    """The last part of the messages lies in another file, which nobody names."""
    if not kind.file:
        return None
    log = kind.written(folder, flight()[:80])
    other = kind.written(folder / "other", flight()[80:])
    end = kind.messages(other).suffix
    shutil.copy(kind.messages(other), log / f"{kind.name}_1{end}")
    return log


def in_wal(kind: Kind, folder: Path, _: Random) -> Path | None:
    """The last part of the messages is still in SQLite's own log."""
    if not kind.file.endswith(".db3"):
        return None
    log = kind.written(folder, flight()[:80])
    rest = kind.written(folder / "other", flight()[80:])
    live = folder / "live.db3"
    shutil.copy(kind.messages(log), live)
    connection = sqlite3.connect(live)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("ATTACH ? AS rest", (str(kind.messages(rest)),))
    more = "INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp, data"
    connection.execute(f"{more} FROM rest.messages")
    connection.commit()
    shutil.copy(live, kind.messages(log))
    shutil.copy(f"{live}-wal", f"{kind.messages(log)}-wal")
    connection.close()
    (log / "metadata.yaml").unlink()
    return kind.messages(log)


def _sql(file: Path, sql: str) -> None:
    connection = sqlite3.connect(file)
    connection.executescript(sql)
    connection.close()


CHUNK_TWICE = by_parts(chunk_again, chunk1_again)
WAYS: dict[str, Way] = {
    "cut at a quarter": by_bytes(lambda d, _: d[: at(0.25, d)]),
    "cut at three quarters": by_bytes(lambda d, _: d[: at(0.75, d)]),
    "the last byte is missing": by_bytes(lambda d, _: d[:-1]),
    "the last 100 bytes are missing": by_bytes(lambda d, _: d[:-100]),
    "the first 100 bytes are missing": by_bytes(lambda d, _: d[100:]),
    "a block of zeros at 30 %": by_bytes(lambda d, _: overwritten(d, at(0.3, d), bytes(BLOCK))),
    "a block of zeros at 60 %": by_bytes(lambda d, _: overwritten(d, at(0.6, d), bytes(BLOCK))),
    "a block of noise at 50 %": by_bytes(lambda d, c: overwritten(d, at(0.5, d), c.randbytes(512))),
    "a block is missing at 30 %": by_bytes(lambda d, _: d[: at(0.3, d)] + d[at(0.3, d) + BLOCK :]),
    "a block is missing at 70 %": by_bytes(lambda d, _: d[: at(0.7, d)] + d[at(0.7, d) + BLOCK :]),
    "a block stands there twice": by_bytes(lambda d, _: d[: at(0.5, d) + BLOCK] + d[at(0.5, d) :]),
    "two blocks are exchanged": by_bytes(lambda d, _: swapped(d, at(0.3, d), at(0.7, d))),
    "the last fifth is zeros": by_bytes(lambda d, _: d[: at(0.8, d)] + bytes(len(d) - at(0.8, d))),
    "zeros behind its end": by_bytes(lambda d, _: d + bytes(BLOCK)),
    "noise behind its end": by_bytes(lambda d, c: d + c.randbytes(BLOCK)),
    "the file twice": by_bytes(lambda d, _: d + d),
    "another log behind it": behind,
    "half of another log": half_of_other,
    "ends of lines as in Windows": by_bytes(lambda d, _: d.replace(b"\n", b"\r\n")),
    "ends of lines are gone": by_bytes(lambda d, _: bytes(b for b in d if b not in b"\r\n")),
    "seven bits of a byte": by_bytes(lambda d, _: bytes(b & 127 for b in d)),
    "Latin-1 as UTF-8": by_bytes(as_text),
    "every 4,096th byte is missing": by_bytes(
        lambda d, _: b"".join(d[k : k + 4095] for k in range(0, len(d), 4096))
    ),
    "a bit of its beginning": flip_at(0.0),
    "a bit at 20 %": flip_at(0.2),
    "a bit at 40 %": flip_at(0.4),
    "a bit at 60 %": flip_at(0.6),
    "a bit at 80 %": flip_at(0.8),
    "a bit of its end": flip_at(1.0),
    "a byte is missing": by_bytes(without),
    "up to 64 bytes are missing": by_bytes(partial(without, most=64)),
    "a byte more": by_bytes(one_more),
    "the end of a line is lost": by_bytes(end_of_line_lost),
    "it is empty": by_bytes(lambda _d, _c: b""),
    "the clock set back 0.45 s": by_messages(partial(moved, begin=60, by_ms=-450)),
    "the clock set back an hour": by_messages(partial(moved, begin=60, by_ms=-3_600_000)),
    "the clock set back at the end": by_messages(partial(moved, begin=MESSAGES - 1, by_ms=-200)),
    "two messages are exchanged": by_messages(exchanged),
    "equal times, two and two": by_messages(pairs),
    "an id with two meanings": by_parts(channel_again, lambda r: inside(r, other_topic)),
    "a schema with two meanings": by_parts(schema_again),
    "messages lost, counts as before": by_parts(
        last_gone, lambda r: inside(r, last_lost), "DELETE FROM messages WHERE id > 80"
    ),
    "a count that is another": uncounted,
    "a part in a file beside it": lambda *a: in_wal(*a) or lost_beside(*a) or CHUNK_TWICE(*a),
}
"""What happens to a log, by name: disks, transfers, recorders that die, tools that copy parts."""
