"""Logs that strangers recorded: every value that Soter reads, against the library of each format.

    .venv/bin/python bench/hostile/logs_of_strangers.py --data DIR

Purpose: DIR has folders `OWNER+NAME` of files of public repositories, none of which is kept here
(docs/real-logs.md says which). Each log is read twice: by Soter's readers, all channels and fields,
and by pyulog, pymavlink, mcap with its decoders of ROS, rosbags, or Python's csv; a value differs
where it is not the same, bit for bit. What Soter refuses is listed with its words; of what is cut
or damaged the part that `--partial` reads is compared, too.
Non-goals: logs of one's own making (`damaged_logs.py`).
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import math
import os
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(p) for p in (ROOT, ROOT / "tests") if str(p) not in sys.path]
os.environ.setdefault("MAVLINK20", "1")

from soter.diagnostics.diagnostic import SoterError  # noqa: E402 - needs the path
from soter.mapping.message_types import EMPTY_MEMBER  # noqa: E402 - the same
from soter.monitor.log_files.csv_log import csv_column_names, csv_rows  # noqa: E402 - the same
from soter.monitor.log_files.log_columns import FileFacts  # noqa: E402 - the same
from soter.monitor.log_files.read_columns import channel_messages  # noqa: E402 - the same
from soter.monitor.log_survey import EVERY  # noqa: E402 - the same

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

Message = tuple[str, dict[str, Any]]
"""Channel and numbers or texts by path."""


def flat(content: Any, path: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - any message
    """Every number and text of a message, whoever decoded it."""
    if hasattr(content, "tolist"):
        content = content.tolist()
    if isinstance(content, dict):
        members = [(str(k), v) for k, v in content.items()]
    elif isinstance(content, (list, tuple)):
        members = [(str(i), v) for i, v in enumerate(content)]
    elif hasattr(content, "__dataclass_fields__"):
        without = "__msgtype__", EMPTY_MEMBER
        names = [n for n in type(content).__dataclass_fields__ if n not in without]
        members = [(n, getattr(content, n)) for n in names]
    elif hasattr(content, "__slots__") and not isinstance(content, (str, bytes, int, float)):
        members = [(n.lstrip("_"), getattr(content, n)) for n in content.__slots__]
    else:
        yield path, content
        return
    for name, value in members:
        yield from flat(value, f"{path}.{name}" if path else name)


# ---------------------------------------------------------------- the libraries


def by_pyulog(path: Path) -> Iterator[Message]:
    """Topic by topic: the order between topics is the file's, which pyulog does not keep."""
    import pyulog  # noqa: PLC0415 - only where such a log is there

    with contextlib.redirect_stdout(io.StringIO()):
        log = pyulog.ULog(str(path))
    for data in log.data_list:
        name = f"{data.name}#{data.multi_id}" if data.multi_id else data.name
        columns = {k.replace("[", ".").replace("]", ""): v.tolist() for k, v in data.data.items()}
        for row in zip(*columns.values(), strict=True):
            yield name, dict(zip(columns, row, strict=True))


def by_dfreader(path: Path) -> Iterator[Message]:
    """Messages of ArduPilot; an instance is not a part of the name here."""
    from pymavlink import DFReader  # noqa: PLC0415 - the same

    text = path.read_bytes()[:2] != b"\xa3\x95"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        log = (DFReader.DFReader_text if text else DFReader.DFReader_binary)(str(path))
        log.rewind()
        while (message := log.recv_msg()) is not None:
            given = message.to_dict()
            yield given.pop("mavpackettype"), dict(flat(given))


def by_mavlogfile(path: Path) -> Iterator[Message]:
    """Messages of MAVLink that are whole and known."""
    from pymavlink import mavutil  # noqa: PLC0415 - the same

    mavutil.set_dialect("all")
    log = mavutil.mavlink_connection(str(path), dialect="all")
    while (message := log.recv_msg()) is not None:
        if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN"):
            yield message.get_type(), dict(flat(message.to_dict()))


def by_mcap(path: Path) -> Iterator[Message]:
    """Messages of an MCAP, in the order of the file."""
    import json  # noqa: PLC0415 - the same

    from mcap.reader import NonSeekingReader  # noqa: PLC0415 - the same
    from mcap_ros1.decoder import DecoderFactory as Ros1  # noqa: PLC0415 - the same
    from mcap_ros2.decoder import DecoderFactory as Ros2  # noqa: PLC0415 - the same

    factories, decoders = (Ros1(), Ros2()), {}
    with path.open("rb") as file:
        for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.id not in decoders:
                with contextlib.redirect_stdout(io.StringIO()):  # it prints what it cannot read
                    made = [f.decoder_for(channel.message_encoding, schema) for f in factories]
                decoders[channel.id] = next((d for d in made if d is not None), json.loads)
            yield channel.topic, dict(flat(decoders[channel.id](message.data)))


def by_rosbags(path: Path) -> Iterator[Message]:
    """Messages of a bag, sorted by time as rosbags gives them; of one of MCAPs by mcap."""
    if mcaps := sorted(path.glob("*.mcap")):
        for part in mcaps:
            yield from by_mcap(part)
        return
    from rosbags.highlevel import AnyReader  # noqa: PLC0415 - the same
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - the same

    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        for connection, _, raw in reader.messages():
            content = reader.deserialize(raw, connection.msgtype)
            yield connection.topic, dict(flat(content))


def by_csv(path: Path) -> Iterator[Message]:
    """Rows as texts."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        for row in csv.DictReader(file):
            yield path.name, {k.strip(): v for k, v in row.items()}


# ---------------------------------------------------------------- Soter


def by_soter(path: Path, facts: FileFacts, *, partial: bool) -> Iterator[Message]:
    """The same from Soter's readers; SoterError."""
    if path.suffix.lower() == ".csv":
        head = csv_column_names(path)
        rows = csv_rows(path, head, head[0], facts)
        for _, _, cells in facts.readable_rows(path, rows, partial=partial):
            yield path.name, cells
        return
    messages = channel_messages(path, EVERY, facts)
    for _, _, name, content in facts.readable_rows(path, messages, partial=partial):
        if content is not None:
            yield name, dict(flat(content))


@dataclass(frozen=True)
class Kind:
    """A format: how its files are called, who reads it besides, what its messages are called."""

    name: str
    endings: tuple[str, ...]
    library: str
    read: Callable[[Path], Iterator[Message]]
    ours: Callable[[Message], Message] = lambda m: m


def _ulog(message: Message) -> Message:
    """A text is one number a letter to pyulog: what stands behind its end is not compared."""
    name, values = message
    return name, {k: v for k, v in values.items() if not isinstance(v, str)}


def _instance(message: Message) -> Message:
    return message[0].partition("#")[0], message[1]


def _mavlink(message: Message) -> Message:
    return message[0], {k: v for k, v in message[1].items() if not k.startswith("header.src")}


KINDS = (
    Kind("ULog", (".ulg",), "pyulog", by_pyulog, _ulog),
    Kind("DataFlash, binary", (".bin",), "pymavlink", by_dfreader, _instance),
    Kind("DataFlash, text", (".log",), "pymavlink", by_dfreader, _instance),
    Kind("MAVLink tlog", (".tlog",), "pymavlink", by_mavlogfile, _mavlink),
    Kind("MCAP", (".mcap",), "mcap, mcap-ros1/2-support", by_mcap),
    Kind("bag of ROS 1", (".bag",), "rosbags", by_rosbags),
    Kind("bag of ROS 2", (".db3",), "rosbags, mcap", by_rosbags),
    Kind("CSV", (".csv",), "csv", by_csv),
)


@dataclass
class Counted:
    """What became of the files of a format."""

    files: int = 0
    read: int = 0
    partly: int = 0
    refused: int = 0
    unread: int = 0
    messages: int = 0
    values: int = 0
    differ: int = 0
    words: list[str] = field(default_factory=list)


def same(a: object, b: object) -> bool:
    """The same value; a NaN is one."""
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b):
        return True
    if isinstance(b, (bytes, bytearray)) and isinstance(a, str):
        ended = bytes(b).partition(b"\0")[0]
        return a in (ended.decode("utf-8", "replace"), ended.decode("latin-1"))
    return a == b


def by_channel(messages: Iterator[Message]) -> dict[str, list[dict[str, Any]]]:
    """Messages of each channel, in order."""
    found: dict[str, list[dict[str, Any]]] = {}
    for name, values in messages:
        found.setdefault(name, []).append(values)
    return found


def compare(kind: Kind, path: Path, counted: Counted) -> None:
    """Read a log twice, and count."""
    facts, shown = FileFacts(), str(path.name)
    counted.files += 1
    try:
        ours = by_channel(map(kind.ours, by_soter(path, facts, partial=True)))
    except SoterError as error:
        counted.refused += 1
        told = str(error).partition("cannot be used: ")[2] or str(error)
        helps = "".join(f"\n      {h}" for d in error.diagnostics for h in d.helps[:1])
        counted.words.append(f"{shown}: refused: {told[:150]}{helps[:160]}")
        return
    whole = facts.damage is None
    counted.read, counted.partly = counted.read + whole, counted.partly + (not whole)
    if facts.damage is not None:
        counted.words.append(f"{shown}: in part: {facts.damage.told.partition(': ')[2][:150]}")
    counted.words += [f"{shown}: {note}" for note in facts.notes if "left out" in note]
    try:
        theirs = by_channel(kind.read(path))
        if ours and not theirs:
            raise ValueError("it gives no message")  # noqa: TRY301 - as if it had
    except Exception as error:  # noqa: BLE001 - whatever a library raises
        counted.unread += 1
        counted.words.append(f"{shown}: {kind.library} does not read it: {str(error)[:80]}")
        return
    lost = " ".join(note for note in facts.notes if "left out" in note)
    if lost:
        theirs = {k: v for k, v in theirs.items() if k in ours}
    for name in sorted({*ours, *theirs}) if whole else sorted(ours):
        mine, other = ours.get(name, []), theirs.get(name, [])
        if len(mine) != len(other) and (whole or len(mine) > len(other)):
            counted.differ += abs(len(mine) - len(other))
            counted.words.append(f"{shown}: `{name}` {len(mine)} messages, and {len(other)}")
        counted.messages += len(mine)
        for a, b in zip(mine, other, strict=False):
            for key, value in a.items():
                counted.values += 1
                wrong = key not in b or not same(value, b[key])
                counted.differ += wrong
                if wrong and counted.differ < 20:
                    there = b.get(key, "nothing")
                    counted.words.append(f"{shown}: `{name}.{key}` {value!r:.40}, {there!r:.40}")


def main() -> int:
    """Read all; 0 where no value differs."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folders OWNER+NAME of logs")
    parser.add_argument("--largest", type=int, default=4, help="MB of a file; larger are left out")
    args = parser.parse_args()
    counts = {kind.name: Counted() for kind in KINDS}
    repositories: Counter[str] = Counter()
    folders = {p.parent for p in args.data.rglob("metadata.yaml")}
    for path in sorted({*args.data.rglob("*"), *folders}):
        kind = next((k for k in KINDS if path.suffix.lower() in k.endings), None)
        if path in folders:
            kind = next(k for k in KINDS if k.name == "bag of ROS 2")
        elif kind is None or not path.is_file() or path.parent in folders:
            continue
        if path.stat().st_size > args.largest * 10**6:
            continue
        repositories[path.relative_to(args.data).parts[0].replace("+", "/")] += 1
        compare(kind, path, counts[kind.name])
    head = (
        "format",
        "files",
        "read",
        "in part",
        "refused",
        "messages",
        "values",
        "differ",
        "against",
    )
    row = "{:<18} {:>6} {:>6} {:>8} {:>8} {:>10} {:>12} {:>7}  {}"
    print(row.format(*head))
    for kind in KINDS:
        c = counts[kind.name]
        figures = (c.files, c.read, c.partly, c.refused, f"{c.messages:,}", f"{c.values:,}")
        print(row.format(kind.name, *figures, f"{c.differ:,}", kind.library))
    for kind in KINDS:
        if counts[kind.name].words:
            print(f"\n{kind.name}")
        for told in counts[kind.name].words:
            print(f"  {told}")
    names = ", ".join(f"{name} ({n})" for name, n in sorted(repositories.items()))
    print(f"\nfrom {names}")
    files, formats = (
        sum(c.files for c in counts.values()),
        sum(c.files > 0 for c in counts.values()),
    )
    values = sum(c.values for c in counts.values())
    differ = sum(c.differ for c in counts.values())
    print(f"\n{files} logs of {formats} formats, {values:,} values, {differ:,} differ, target 0")
    return int(differ > 0)


if __name__ == "__main__":
    sys.exit(main())
