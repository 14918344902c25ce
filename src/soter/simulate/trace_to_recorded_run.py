"""A traced run, or a log, as recorded values.

Purpose: what `monitor/model_membership.py` reads: topics and true states after every instant.
Non-goals: modes and decisions; logs that `soter run --log` did not write.
"""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from soter.core.layout import decode_from
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.language.load.bounded_read import opened
from soter.language.model.python_values import ValueShapeError, from_json
from soter.language.model.types import RecordType
from soter.report.mcap_log import METADATA_NAME
from soter.report.mcap_records import DamagedMcapError, McapRecords
from soter.report.recorded_values import RecordedRun
from soter.simulate.outputs.run_fields import truth_value
from soter.simulate.outputs.to_log import require_log_package

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.language.model.system import Component, System
    from soter.language.model.typed import TopicSymbol
    from soter.language.model.types import Type
    from soter.simulate.result import Run

MISSED = ("late", "skip", "wait", "overrun", "silent")
"""Faults with which a component may publish nothing when it is released."""


def recorded(run: Run) -> RecordedRun:
    """The values of a traced run."""
    trace = run.require_trace()
    record = RecordedRun([], [], [], [])
    plants = [c for c in run.system.components if c.plant is not None]
    places = [(t.name, run.layout.topic_offset(t.index), t.type) for t in run.system.topics]
    for row in trace:
        raw = memoryview(row.tobytes())
        record.times_ns.append(int(row["header"]["ct"]))
        record.topics.append({n: decode_from(raw, offset, t) for n, offset, t in places})
        record.truths.append({c.name: truth_value(run.layout, c, raw) for c in plants})
        stamps, now = row["stamps"], record.times_ns[-1]
        record.published.append({t.name for t in run.system.topics if stamps[t.index] == now})
    _begin(record, run.system)
    return record


def _begin(record: RecordedRun, system: System) -> None:
    """Take from what is said of the first instant the values that nobody published.

    A log has a first value of every topic, which may be its default.
    """
    if not record.published:
        return
    missed = {f.component for f in system.faults if f.kind in MISSED}
    published = {
        c.scope.topics[t]
        for c in system.components
        if c.index not in missed and (record.times_ns[0] - c.phase_ns) % c.period_ns == 0
        for t in _publishes(c)
    }
    record.published[0] &= {system.topics[i].name for i in published}


def _publishes(c: Component) -> list[TopicSymbol]:
    if c.plant is not None:
        return [t for t, _ in c.plant.drives]
    return list(c.node.publishes) if c.node is not None else []


def read_log(path: Path, system: System) -> RecordedRun:
    """The values of a log that `soter run --log` wrote of this system; SoterError D006."""
    require_log_package()
    types: dict[str, Type] = {t.name: t.type for t in system.topics}
    truths = {f"{c.name}.truth": c for c in system.components if c.plant is not None}
    types.update({name: c.plant.truth for name, c in truths.items() if c.plant is not None})
    record, since = RecordedRun([], [], [], []), set[str]()
    topics: dict[str, Any] = {t.name: t.default for t in system.topics}
    states: dict[str, Any] = {}
    for time_ns, channel, message in messages(path):
        t = types.get(channel)
        if t is None:
            continue
        try:
            given = message if isinstance(t, RecordType) else message["value"]
            value = from_json(t, given, channel)
        except (ValueShapeError, LookupError, TypeError) as error:
            raise unreadable(path, f"{error}; is it a log of `{system.name}`?") from error
        if not record.times_ns or time_ns > record.times_ns[-1]:
            _keep(record, topics, states, since)
            record.times_ns.append(time_ns)
            since = set()
        if channel in truths:
            states[truths[channel].name] = value
        else:
            topics[channel] = value
            since.add(channel)
    if not record.times_ns or len(states) < len(truths):
        raise unreadable(path, f"it holds no true states of `{system.name}`")
    _keep(record, topics, states, since)
    _begin(record, system)
    return record


def _keep(
    record: RecordedRun, topics: dict[str, Any], states: dict[str, Any], since: set[str]
) -> None:
    """What stood when the instant that was read last was over, and what was published in it."""
    if record.times_ns:
        record.published.append(since)
        record.topics.append(dict(topics))
        record.truths.append(dict(states))


@contextmanager
def _records(path: Path) -> Iterator[McapRecords]:
    """The records of a log; what cannot be opened or read, or is damaged, is SoterError D006."""
    try:
        with opened(path) as file:
            yield McapRecords(file)
    except OSError as error:
        raise unreadable(path, reason(error)) from error
    except SoterError:
        raise
    except DamagedMcapError as error:
        text = f"cannot read the log `{path}`: {error}"
        raise SoterError((Diagnostic("D006", text, helps=(error.remedy,)),)) from error
    except Exception as error:
        raise unreadable(path, damaged(error)) from error


def metadata(path: Path) -> dict[str, str]:
    """What a log says of its run, empty where it is none of `soter run`; SoterError D006."""
    with _records(path) as records:
        for _ in records.messages():
            if METADATA_NAME in records.metadata:
                break
        return records.metadata.get(METADATA_NAME, {})


def messages(path: Path) -> Iterator[tuple[int, str, Any]]:
    """Time (ns), channel and message of all that is in a log, in order; SoterError D006.

    What its checksums and counts say is compared with what stands there.
    """
    last_ns = 0
    with _records(path) as records:
        for channel, _, message in records.messages():
            if message.log_time < last_ns:
                told = (
                    f"time goes back from {last_ns / 1e9:.9g} s to {message.log_time / 1e9:.9g} s"
                )
                raise unreadable(path, f"{told} at a message of `{channel.topic}`")
            last_ns = message.log_time
            yield message.log_time, channel.topic, json.loads(message.data)


def damaged(error: Exception) -> str:
    """What is wrong with a log that the package `mcap` could not read, in words.

    It unpacks what stands there without a look at it: a damaged file makes it raise anything.
    """
    from mcap.exceptions import InvalidMagic, McapError  # noqa: PLC0415 - an extra

    told = isinstance(error, (McapError, ValueError)) and not isinstance(error, InvalidMagic)
    said = str(error)[:200] if told else ""
    return said or "it is no MCAP file, or damaged"


def unreadable(path: Path, why: str) -> SoterError:
    """Of a log that cannot be read as one of `soter run --log`."""
    helps = ("a log of somebody else, a CSV or a bag needs `--map FILE`: docs/real-logs.md",)
    return SoterError((Diagnostic("D006", f"cannot read the log `{path}`: {why}", helps=helps),))
