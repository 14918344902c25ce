"""The columns of a log, from a CSV or an MCAP.

Purpose: times in ns and cells, row by row, of what a mapping asks for; whatever cannot be read is
D016 and says where.
Non-goals: what the cells mean (`samples.py`), messages that are not JSON (D016 names them).
"""

from __future__ import annotations

import csv
import io
import json
import zlib
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import IO, TYPE_CHECKING, Any, BinaryIO

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.near import nearest_or_all
from soter.diagnostics.os_error_text import reason
from soter.language.load.bounded_read import opened
from soter.monitor.logs.bounded_gzip import BoundedGzip
from soter.simulate.outputs.to_log import require_log_package
from soter.simulate.recorded_run import damaged

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from soter.mapping.topic_mapping import LogMap

CELL_MAX = 1 << 20
"""Characters of a cell; a log has no longer ones."""
LINE_MAX = 1 << 24
"""Characters of a line."""


@dataclass
class Columns:
    """Rows of a CSV, or messages of a channel: `cells[name][i]` belongs to `times_ns[i]`.

    A cell is a text, or what JSON has; None where it is not there. `where[i]`: for people.
    """

    times_ns: list[int] = field(default_factory=list)
    cells: dict[str, list[Any]] = field(default_factory=dict)
    where: list[str] = field(default_factory=list)


def is_table(path: Path) -> bool:
    """Whether a log is a CSV, by its name."""
    return path.name.lower().endswith((".csv", ".csv.gz"))


def unusable(path: Path, why: str, *helps: str) -> SoterError:
    """D016."""
    text = f"the log `{path}` cannot be used: {why}"
    return SoterError((Diagnostic("D016", text, helps=tuple(h for h in helps if h)),))


def read_columns(path: Path, mapping: LogMap) -> dict[str | None, Columns]:
    """What each channel of a mapping holds; a CSV is the one channel None. SoterError D016."""
    wanted: dict[str | None, list[str]] = {}
    table = is_table(path)
    for t in mapping.topics:
        key = None if table else t.channel
        if t.names:
            wanted[key] = [*wanted.get(key, []), *t.names]
    wanted = {k: list(dict.fromkeys(names)) for k, names in wanted.items()}
    if not wanted:
        raise unusable(path, "its mapping asks for no column of it: everything is constant")
    return _read_csv(path, mapping, wanted[None]) if table else _read_mcap(path, mapping, wanted)


def _add(
    path: Path,
    into: Columns,
    time_ns: int,
    cells: Mapping[str, Any],
    where: Callable[[int], str],
    at: int,
) -> None:
    """A row; D016 where time does not move on."""
    if into.times_ns and time_ns <= into.times_ns[-1]:
        kind = "stands still" if time_ns == into.times_ns[-1] else "goes back"
        raise unusable(
            path,
            f"time {kind} in {where(at)}, from {into.times_ns[-1] / 1e9:.9g} s to "
            f"{time_ns / 1e9:.9g} s",
            "`where` chooses the rows of one flight; `time` its column and unit",
        )
    into.times_ns.append(time_ns)
    into.where.append(where(at))
    for name, column in into.cells.items():
        column.append(cells[name])


def _moment(path: Path, given: object, unit_ns: Fraction, where: str) -> int:
    """A time in ns, exactly as it is written."""
    try:
        number = Decimal(str(given).strip())
    except InvalidOperation:
        number = Decimal("nan")
    if isinstance(given, bool) or not number.is_finite() or abs(number.adjusted()) > 40:
        raise unusable(path, f"`{str(given)[:40]}` in {where} is no time")
    return round(Fraction(number) * unit_ns)


# ---------------------------------------------------------------- CSV


def _read_csv(path: Path, mapping: LogMap, names: list[str]) -> dict[str | None, Columns]:
    if mapping.time is None:
        help_ = 'say it in the mapping: [time] from = "t", unit = "s"'
        raise unusable(path, "nobody says which column is the time", help_)
    columns = Columns(cells={name: [] for name in names})
    needed = dict.fromkeys([mapping.time, *mapping.where, *names])
    for line, row in _rows(path, list(needed)):
        if any(row[k].strip() != v for k, v in mapping.where.items()):
            continue
        now = _moment(path, row[mapping.time], mapping.time_ns, f"line {line}")
        cells = {n: row[n] for n in names}
        _add(path, columns, now, cells, lambda at: f"line {at}", line)
    if not columns.times_ns:
        chosen = " and ".join(f"{k} = {v}" for k, v in mapping.where.items())
        raise unusable(path, f"no row has {chosen}" if chosen else "it has no rows")
    return {None: columns}


def _rows(path: Path, needed: list[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Line and the cells that are needed of each row."""
    try:
        with opened(path) as data, _text(path, data) as file:
            reader = csv.reader(_lines(file))
            head = [h.strip() for h in next(reader, [])]
            if not head:
                raise unusable(path, "it is empty")
            places = {name: _place(path, head, name) for name in needed}
            for row in reader:
                if not row:
                    continue
                if len(row) != len(head):
                    text = f"line {reader.line_num} has {len(row)} cells, the head {len(head)}"
                    raise unusable(path, text)
                yield reader.line_num, {name: row[at] for name, at in places.items()}
    except OSError as error:
        raise unusable(path, reason(error)) from error
    except (UnicodeDecodeError, csv.Error, EOFError, zlib.error) as error:
        raise unusable(path, f"it is no CSV: {error}") from error


def _text(path: Path, data: BinaryIO) -> IO[str]:
    """The text of a CSV file, packed by gzip or not; closing it may leave `data` open."""
    csv.field_size_limit(CELL_MAX)
    if path.name.lower().endswith(".gz"):
        unpacked = io.BufferedReader(BoundedGzip(data))
        return io.TextIOWrapper(unpacked, encoding="utf-8-sig", newline="")
    return io.TextIOWrapper(data, encoding="utf-8-sig", newline="")


def _lines(file: IO[str]) -> Iterator[str]:
    """Its lines; csv.Error where one is longer than any can be."""
    while line := file.readline(LINE_MAX + 1):
        if len(line) > LINE_MAX:
            raise csv.Error(f"a line has more than {LINE_MAX} letters")
        yield line


def _place(path: Path, head: list[str], name: str) -> int:
    if head.count(name) == 1:
        return head.index(name)
    if name in head:
        raise unusable(path, f"two columns are called `{name}`")
    raise unusable(path, f"it has no column `{name}`", nearest_or_all(name, head))


# ---------------------------------------------------------------- MCAP


def _read_mcap(
    path: Path, mapping: LogMap, wanted: dict[str | None, list[str]]
) -> dict[str | None, Columns]:
    if None in wanted:
        lost = next(t.topic.name for t in mapping.topics if t.names and t.channel is None)
        raise unusable(path, f"the mapping of `{lost}` names no `channel`")
    columns_by_channel = {
        key: Columns(cells={n: [] for n in names}) for key, names in wanted.items()
    }
    there: dict[str, int] = {}
    for time_ns, channel, message in _messages(path, set(wanted), there):
        at = there[channel]
        where = f"message {at} of `{channel}`"
        if any(str(_inside(path, message, k, where)) != v for k, v in mapping.where.items()):
            continue
        now = time_ns
        if mapping.time is not None:
            now = _moment(path, _inside(path, message, mapping.time, where), mapping.time_ns, where)
        cells = {n: _inside(path, message, n, where) for n in wanted[channel]}
        into = columns_by_channel[channel]
        _add(path, into, now, cells, lambda at, c=channel: f"message {at} of `{c}`", at)  # type: ignore[misc]
    for key, columns in columns_by_channel.items():
        if not columns.times_ns:
            help_ = nearest_or_all(str(key), there)
            raise unusable(path, f"no message that counts stands on `{key}`", help_)
    return columns_by_channel


def _messages(
    path: Path, channels: set[str | None], there: dict[str, int]
) -> Iterator[tuple[int, str, Any]]:
    """Log time, channel and content; `there` counts the messages of every channel."""
    require_log_package()
    from mcap.reader import make_reader  # noqa: PLC0415 - an extra

    other = ""
    try:
        with opened(path) as file:
            for _, channel, message in make_reader(file).iter_messages():
                there[channel.topic] = there.get(channel.topic, 0) + 1
                if channel.topic not in channels:
                    continue
                if channel.message_encoding != "json":
                    other = f"messages of `{channel.topic}` are `{channel.message_encoding}`"
                    break
                yield message.log_time, channel.topic, json.loads(message.data)
    except OSError as error:
        raise unusable(path, reason(error)) from error
    except Exception as error:
        raise unusable(path, damaged(error)) from error
    if other:
        raise unusable(path, f"{other}, not json", "write them as JSON, or as CSV")


def _inside(path: Path, message: Any, name: str, where: str) -> Any:  # noqa: ANN401 - JSON
    """The field of a message: `position.x`, `q.0`."""
    current = message
    for part in name.split("."):
        if isinstance(current, list) and part.isdigit() and int(part) < len(current):
            current = current[int(part)]
        elif isinstance(current, dict) and part in current:
            current = current[part]
        else:
            known = current if isinstance(current, dict) else ()
            raise unusable(path, f"{where} has no `{name}`", nearest_or_all(part, known))
    return current
