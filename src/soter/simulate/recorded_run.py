"""What a run left behind as values: times, topics, true states; of a trace, or of a log.

Purpose: topics and true states after every instant, which `monitor/model_membership.py` reads: one
form of a traced run and of a log, for those who judge it afterwards.
Non-goals: modes and decisions; logs that `soter run --log` did not write.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.core.layout import decode_from
from soter.language.model.types import RecordType
from soter.language.model.values import ValueShapeError, from_json
from soter.report.mcap_reading import messages, require_log_package, unreadable
from soter.simulate.outputs.run_fields import truth_value

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import Component, System
    from soter.language.model.typed import TopicSymbol
    from soter.language.model.types import Type
    from soter.simulate.result import Run


@dataclass(frozen=True)
class RecordedRun:
    """After each instant: every topic by full name, every plant's true state by full name.

    `published`: the topics that were published at each instant.
    """

    times_ns: list[int]
    topics: list[dict[str, Any]]
    truths: list[dict[str, Any]]
    published: list[set[str]]


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
        value = logged_value(path, system, channel, t, message)
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


def logged_value(path: Path, system: System, channel: str, t: Type, message: Any) -> Any:  # noqa: ANN401
    """The value of a message of a log; SoterError D006."""
    try:
        return from_json(t, message if isinstance(t, RecordType) else message["value"], channel)
    except (ValueShapeError, LookupError, TypeError) as error:
        raise unreadable(path, f"{error}; is it a log of `{system.name}`?") from error


def _keep(
    record: RecordedRun, topics: dict[str, Any], states: dict[str, Any], since: set[str]
) -> None:
    """What stood when the instant that was read last was over, and what was published in it."""
    if record.times_ns:
        record.published.append(since)
        record.topics.append(dict(topics))
        record.truths.append(dict(states))
