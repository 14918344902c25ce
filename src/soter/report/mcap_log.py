"""Writes a run as an MCAP log that standard tools read.

Purpose: the log has a channel for each topic under its full dotted name, one for modes, and one for
decisions of the DM with their reasons; messages are JSON, each channel has a JSON schema, and the
metadata says what was run. Log time and publish time are the run's virtual time in nanoseconds.
Non-goals: reading logs back; `soter monitor` does that with the stock reader.

Numbers: JSON has no NaN and no infinities. They are written as the strings "NaN", "Infinity"
and "-Infinity", as Protocol Buffers and OPC UA do; a field that may hold them is declared
`EXTENDED_NUMBER`. Finite floats are written with the fewest digits that give the same binary64
back, negative zero included. Topics never hold NaN (the language latches a step fault instead),
so they use `NUMBER`, which every viewer plots; some viewers refuse a schema with `anyOf`.
"""

from __future__ import annotations

import heapq
import json
import math
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from soter.diagnostics.diagnostic import SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.report.atomic_write import atomic_write
from soter.version import pip_command

if TYPE_CHECKING:
    import os
    from typing import IO

JsonSchema = Mapping[str, object]
Message = tuple[int, Mapping[str, object]]

MODES_TOPIC = "soter/modes"
DECISIONS_TOPIC = "soter/decisions"
METADATA_NAME = "soter"
END_NAME = "soter.end"
ABNORMALLY = "abnormally: "
"""How the text begins that says how a run ended which did not reach its end."""
CHUNK_BYTES = 256 * 1024
"""Bytes of a chunk before compression: a process that dies loses at most one chunk."""
MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
METADATA, FOOTER, DATA_END, MESSAGE_INDEX = 0x0C, 0x02, 0x0F, 0x07
"""Kinds of records of the format (https://mcap.dev/spec)."""
PROFILE = ""
"""No profile: MCAP's own are those of ROS."""

BOOLEAN: JsonSchema = {"type": "boolean"}
INTEGER: JsonSchema = {"type": "integer"}
NUMBER: JsonSchema = {"type": "number"}
STRING: JsonSchema = {"type": "string"}
EXTENDED_NUMBER: JsonSchema = {
    "anyOf": [{"type": "number"}, {"enum": ["NaN", "Infinity", "-Infinity"]}]
}


class LogError(SoterError):
    """Raised if a log cannot be written (D006, D007). An older file at the path stays unchanged."""


def enum_schema(names: Iterable[str]) -> JsonSchema:
    """The JSON schema of a string that must be one of `names`."""
    return {"type": "string", "enum": list(names)}


def array_schema(items: JsonSchema, length_max: int | None = None) -> JsonSchema:
    """The schema of an array of at most `length_max` items."""
    bound = {} if length_max is None else {"maxItems": length_max}
    return {"type": "array", "items": items, **bound}


def object_schema(fields: Mapping[str, JsonSchema], title: str = "") -> JsonSchema:
    """The schema of an object with exactly these fields; every message is such an object."""
    return {
        "type": "object",
        **({"title": title} if title else {}),
        "properties": dict(fields),
        "required": list(fields),
        "additionalProperties": False,
    }


MODES_SCHEMA = object_schema(
    {"module": STRING, "mode": enum_schema(["SC", "AC"])}, "who is in control of a module"
)
_DECISION = object_schema(
    {
        "module": STRING,
        "mode_before": enum_schema(["SC", "AC"]),
        "mode_after": enum_schema(["SC", "AC"]),
        "reason": STRING,
        "why": array_schema(STRING),
        "margin_s": NUMBER,
        # The names differ from module to module. `properties` stays for viewers that insist on it.
        "predicates": {
            "type": "object",
            "properties": {},
            "additionalProperties": {"anyOf": [BOOLEAN, EXTENDED_NUMBER]},
        },
    },
    "a step of a decision module",
)
DECISIONS_SCHEMA = {
    **_DECISION,
    "properties": {
        **cast("JsonSchema", _DECISION["properties"]),
        # Of modules with `rest`: topic to value and age, null where nothing was ever published.
        "reads": {"type": "object", "properties": {}},
        # Of modules with several plans: the node that SC follows from then on.
        "plan": STRING,
        # Against the clock: how long after its release the step began, and ended.
        "late_ns": INTEGER,
        "done_ns": INTEGER,
    },
}
"""The schema of decisions; `reads`, `plan`, `late_ns` and `done_ns` may be absent."""


@dataclass(frozen=True)
class LogChannel:
    """One topic of the log.

    `name`: the full dotted name, such as `d.control`. `schema`: the JSON schema of an object.
    `messages`: pairs of virtual time in ns and value, in order of time. They are read only once, so
    a generator over a long trace need not be held in memory. NumPy scalars and arrays are fine.
    """

    name: str
    schema: JsonSchema
    messages: Iterable[Message]


@dataclass(frozen=True)
class ModeRecord:
    """The fact that `module` is in `mode` from `time_ns` on; each module has one at the start."""

    time_ns: int
    module: str
    mode: Literal["SC", "AC"]


@dataclass(frozen=True)
class DecisionStep:
    """A step of the DM of `module` at `time_ns`, with what it saw; the modes may be equal.

    `why`: the values that decided, one phrase each, if the decision differs from that of the step
    before; `margin_s`: how long AC surely keeps control. `reads`: for a module with `rest`, topic
    -> `value` and `age_ns` as read (None: never published). `plan`: of several plans the node that
    SC follows from then on. `look`: in real time, how long after its release the step began, and
    ended, in ns.
    """

    time_ns: int
    module: str
    mode_before: Literal["SC", "AC"]
    mode_after: Literal["SC", "AC"]
    reason: str = ""
    predicates: Mapping[str, bool | float] = field(default_factory=dict)
    why: Sequence[str] = ()
    margin_s: float = 0.0
    reads: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    plan: str = ""
    look: tuple[int, int] | None = None


@dataclass(frozen=True)
class LogHeader:
    """The metadata record `soter`, which describes the run; `more` holds further entries."""

    program_sha256: str
    system: str
    seed: int
    tool_version: str
    more: Mapping[str, str] = field(default_factory=dict)

    def metadata_entries(self) -> dict[str, str]:
        """All entries as strings, because the metadata of MCAP holds only strings."""
        return {
            "program_sha256": self.program_sha256,
            "system": self.system,
            "seed": str(self.seed),
            "tool_version": self.tool_version,
            **{name: str(value) for name, value in self.more.items()},
        }


def write_mcap(
    path: str | os.PathLike[str],
    channels: Sequence[LogChannel],
    *,
    modes: Iterable[ModeRecord] = (),
    decisions: Iterable[DecisionStep] = (),
    header: LogHeader,
) -> Path:
    """Writes a log to `path` and returns the path; the same input gives the same bytes.

    Messages are merged by time; at equal times they keep the order: modes, decisions, then
    `channels` as listed. Raises `LogError` if the extra `logs` is not installed or the file cannot
    be written; an older log at `path` is then untouched. Raises `ValueError` for mistakes of the
    caller: a channel name used twice, a schema that is not an object's, and times that are negative
    or run backwards.
    """
    everything = [
        LogChannel(MODES_TOPIC, MODES_SCHEMA, map(mode_message, modes)),
        LogChannel(DECISIONS_TOPIC, DECISIONS_SCHEMA, map(decision_message, decisions)),
        *channels,
    ]
    log = McapLog(path, [(c.name, c.schema) for c in everything], header)
    with log.dropped_on_error():
        log.add(everything)
    return log.close()


class McapLog:
    """A log that grows during its run; the file gets its final path when it is closed.

    The file is written in chunks. If the process dies, `mend_log` makes a valid log of the chunks
    that were written. Raises the same errors as `write_mcap`.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        channels: Sequence[tuple[str, JsonSchema]],
        header: LogHeader,
    ) -> None:
        _check_channels(channels)
        self.path = Path(path)
        self._names = [name for name, _ in channels]
        self._sequences = [0] * len(channels)
        self._last_ns = [0] * len(channels)
        self._file = ExitStack()
        with self.dropped_on_error():
            self._stream = self._file.enter_context(atomic_write(self.path))
            self._writer, self._ids = _open_writer(self._stream, channels, header)
            self._stream.flush()

    @contextmanager
    def dropped_on_error(self) -> Iterator[None]:
        """Drops the file if the block fails, and turns an OSError into a `LogError`."""
        try:
            yield
        except BaseException as error:
            with suppress(OSError):  # after a failed write, closing fails as well
                self._file.__exit__(type(error), error, error.__traceback__)
            if isinstance(error, OSError):
                message = f"cannot write the log {self.path}: {reason(error)}"
                raise LogError(mistake("D006", message)) from error
            raise

    def add(self, channels: Iterable[LogChannel]) -> None:
        """Writes the messages of all channels by time; raises ValueError if time runs backwards."""
        with self.dropped_on_error():
            for time_ns, index, message in _merged_messages([c.messages for c in channels]):
                if time_ns < self._last_ns[index]:
                    name, last_ns = self._names[index], self._last_ns[index]
                    raise ValueError(f"{name}: time runs back from {last_ns} to {time_ns} ns")
                self._last_ns[index] = int(time_ns)
                self._writer.add_message(
                    channel_id=self._ids[index],
                    log_time=int(time_ns),
                    publish_time=int(time_ns),
                    sequence=self._sequences[index],
                    data=to_json(message),
                )
                self._sequences[index] += 1
            self._stream.flush()

    def close(self, end: Mapping[str, str] | None = None) -> Path:
        """Writes how the run ended as metadata, finishes the file and gives it its path."""
        with self.dropped_on_error():
            if end is not None:
                self._writer.add_metadata(END_NAME, dict(end))
            self._writer.finish()
            self._file.close()
        return self.path


def to_json(message: Mapping[str, object]) -> bytes:
    """A message as JSON text in UTF-8, with NaN and infinities as strings."""
    try:
        text = json.dumps(message, allow_nan=False, separators=(",", ":"), default=_plain_json)
    except ValueError:
        # Only now is the message walked through: nearly all hold finite numbers only.
        text = json.dumps(_spelled_numbers(message), allow_nan=False, separators=(",", ":"))
    return text.encode()


def _open_writer(
    stream: IO[bytes], channels: Sequence[tuple[str, JsonSchema]], header: LogHeader
) -> tuple[Any, list[int]]:
    """A writer that has written header, metadata, schemas and channels; and the channels' ids."""
    try:
        from mcap.writer import CompressionType, Writer  # noqa: PLC0415 - an extra
    except ImportError as error:
        message = f"logs are written with mcap, which is not installed: {pip_command('logs')}"
        raise LogError(mistake("D007", message)) from error
    writer = Writer(
        stream,
        chunk_size=CHUNK_BYTES,
        compression=CompressionType.ZSTD,
        enable_crcs=True,
        enable_data_crcs=True,
    )
    writer.start(profile=PROFILE, library=f"soter {header.tool_version}")
    writer.add_metadata(METADATA_NAME, header.metadata_entries())
    ids: list[int] = []
    for name, of in channels:
        schema = json.dumps({"$schema": SCHEMA_DIALECT, **of}).encode()
        schema_id = writer.register_schema(name, "jsonschema", schema)
        ids.append(writer.register_channel(name, "json", schema_id))
    return writer, ids


def mend_log(path: Path) -> bool:
    """Completes the log that a dead process left; False if it is no MCAP file; raises `OSError`."""
    with path.open("r+b") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return False
        end = size = path.stat().st_size
        at = len(MAGIC)
        while at + RECORD.size <= size:
            stream.seek(at)
            kind, length = RECORD.unpack(stream.read(RECORD.size))
            # of the indices behind a chunk either all are there, or none may stay
            end, at = at if kind != MESSAGE_INDEX else end, at + RECORD.size + length
            if kind in (DATA_END, FOOTER) or at > size:
                break
            end = at if kind != MESSAGE_INDEX else end
        stream.seek(end)
        stream.truncate()
        name, key, value = (
            _length_and_text(s) for s in (END_NAME, "ended", f"{ABNORMALLY}the process died")
        )
        entries = struct.pack("<I", len(key) + len(value)) + key + value
        stream.write(RECORD.pack(METADATA, len(name) + len(entries)) + name + entries)
        stream.write(RECORD.pack(DATA_END, 4) + struct.pack("<I", crc_between(stream)))
        footer = RECORD.pack(FOOTER, 20) + bytes(16)
        stream.write(footer + struct.pack("<I", zlib.crc32(footer)) + MAGIC)
    return True


def crc_between(stream: IO[bytes], begin: int = 0, end: int | None = None) -> int:
    """The CRC-32 of a file from byte `begin` to byte `end`, by default to its end."""
    stream.seek(begin)
    crc, left = 0, None if end is None else end - begin
    while part := stream.read(CHUNK_BYTES if left is None else min(CHUNK_BYTES, left)):
        crc, left = zlib.crc32(part, crc), None if left is None else left - len(part)
    return crc


def _length_and_text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode("ascii")


SCHEMA_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def _merged_messages(
    channels: Sequence[Iterable[Message]],
) -> Iterator[tuple[int, int, Mapping[str, object]]]:
    """Yields messages of all channels by time: time in ns, index of the channel, message."""

    def stamped(
        index: int, messages: Iterable[Message]
    ) -> Iterator[tuple[int, int, Mapping[str, object]]]:
        for time_ns, message in messages:
            yield time_ns, index, message

    streams = [stamped(index, messages) for index, messages in enumerate(channels)]
    return heapq.merge(*streams, key=lambda item: item[:2])


def _check_channels(channels: Sequence[tuple[str, JsonSchema]]) -> None:
    """Raises `ValueError` for names used twice and for schemas that viewers cannot read."""
    names = [name for name, _ in channels]
    for name, schema in channels:
        if names.count(name) > 1:
            raise ValueError(f"{name}: two channels of this name")
        if schema.get("type") != "object" or "properties" not in schema:
            raise ValueError(f"{name}: the schema of a message must be an object's")


def mode_message(change: ModeRecord) -> Message:
    """The message for a change of mode."""
    return change.time_ns, {"module": change.module, "mode": change.mode}


def decision_message(step: DecisionStep) -> Message:
    """The message for a step of a decision module."""
    return step.time_ns, {
        "module": step.module,
        "mode_before": step.mode_before,
        "mode_after": step.mode_after,
        "reason": step.reason,
        "why": list(step.why),
        "margin_s": step.margin_s,
        "predicates": step.predicates,
        **({"reads": step.reads} if step.reads else {}),
        **({"plan": step.plan} if step.plan else {}),
        **(dict(zip(("late_ns", "done_ns"), step.look, strict=True)) if step.look else {}),
    }


def _plain_json(value: object) -> object:
    """Converts an object that the JSON writer does not know to a JSON value."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"cannot log a value of type {type(value).__name__}")


def _spelled_numbers(value: object) -> object:
    """A copy of a message in which NaN and infinities are texts."""
    if isinstance(value, (np.generic, np.ndarray)):
        return _spelled_numbers(_plain_json(value))
    if isinstance(value, float) and not math.isfinite(value):
        if math.isnan(value):
            return "NaN"
        return "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, Mapping):
        return {name: _spelled_numbers(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_spelled_numbers(item) for item in value]
    return value
