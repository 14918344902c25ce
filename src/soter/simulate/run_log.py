"""Writes a run as an MCAP log, and reads a log or a trace into values by instant.

Purpose: a `RunLog` has a channel for each topic and each plant's true state, for modes, and for
every DM step with its reason, all in virtual time (`report/mcap_log.py` writes the file);
`read_log` reads it. A `RecordedRun` has topics and true states after every instant, in one form for
a traced run and for its log, so that both can be checked later (`monitor/model_membership.py`).
Non-goals: reading logs that `soter run --log` did not write; locals of nodes, which are private.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.core.layout import NEVER, decode_from
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.language.model.values import ValueShapeError, from_json, to_json
from soter.report.atomic_write import unfinished_files
from soter.report.mcap_log import (
    ABNORMALLY,
    BOOLEAN,
    DECISIONS_SCHEMA,
    DECISIONS_TOPIC,
    INTEGER,
    MODES_SCHEMA,
    MODES_TOPIC,
    NUMBER,
    DecisionStep,
    LogChannel,
    LogError,
    LogHeader,
    McapLog,
    ModeRecord,
    array_schema,
    decision_message,
    enum_schema,
    mode_message,
    object_schema,
)
from soter.report.mcap_reading import log_messages, require_log_package, unreadable_error
from soter.report.wording import changed_parameters
from soter.simulate import decisions
from soter.simulate.explain_decision import Explainer
from soter.simulate.run_fields import truth_value

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import numpy.typing as npt

    from soter.core.layout import StateLayout
    from soter.diagnostics.diagnostic import SoterError
    from soter.language.model.system import Component, System, Topic
    from soter.language.model.typed import TopicSymbol
    from soter.language.model.types import Type
    from soter.report.mcap_log import JsonSchema, Message
    from soter.simulate.flight_recording import StepLateness
    from soter.simulate.result import Run
    from soter.simulate.run_observer import ModeChange as ChangeSeen


def write_log(run: Run, path: str | Path, version: str) -> Path:
    """Writes the log of a traced run to `path`; raises `SoterError` D006 if that fails."""
    trace = run.require_trace()
    log = RunLog(Path(path), version)
    log.begin(run.system, run.layout, run.seed, run.engine, run.externs)
    log.see(trace, run.changes)
    log.end(run, "interrupted" if run.interrupted else "")
    if log.problem is not None:
        raise log.problem
    return Path(path)


class RunLog:
    """The log of a run, written during the run in blocks of states.

    `path`: the file, or a function from the system to it. The methods raise no errors: `problem` is
    the SoterError D006 if the log could not be written. `unfinished`: unfinished logs in the same
    folder, from earlier runs whose processes died.
    """

    def __init__(self, path: Path | Callable[[System], Path], version: str) -> None:
        require_log_package()
        self.path = path
        self.problem: SoterError | None = None
        self.unfinished: list[Path] = []
        self._version = version
        self._log: McapLog | None = None
        self._earlier: npt.NDArray[Any] | None = None

    def begin(
        self,
        system: System,
        layout: StateLayout,
        seed: int,
        engine: str,
        externs: Mapping[str, str],
    ) -> None:
        """Prepares the log of a run; the file is opened when the first states arrive."""
        self._system, self._layout = system, layout
        self._explainer = Explainer(system, layout)
        self.path = self.path(system) if callable(self.path) else self.path
        self.path = self.path.absolute()  # an extern may change the folder
        self.unfinished = unfinished_files(self.path)
        plants = [component for component in system.components if component.plant is not None]
        self._channels = [
            (MODES_TOPIC, MODES_SCHEMA),
            (DECISIONS_TOPIC, DECISIONS_SCHEMA),
            *((topic.name, _message_schema(topic.type)) for topic in _logged_topics(system)),
            *(
                (f"{component.name}.truth", _schema(component.plant.truth))
                for component in plants
                if component.plant
            ),
        ]
        self._header = LogHeader(
            system.program.sha256,
            system.name,
            seed,
            self._version,
            {
                "engine": engine,
                **{f"param {name}": text for name, (text, _) in changed_parameters(system).items()},
                **{f"extern {name}": text for name, text in externs.items()},
            },
        )

    def see(
        self,
        states: npt.NDArray[Any],
        changes: Sequence[ChangeSeen],
        looks: StepLateness = MappingProxyType({}),
    ) -> None:
        """Logs the next states, (n,), their changes of mode, and the lateness of DMs (`looks`)."""
        if self.problem is None:
            with self._noting_problem():
                self._open_log().add(self._block_channels(states, changes, looks))
                self._earlier = states[-1:].copy()

    def end(self, run: Run | None, why: str) -> None:
        """Ends the log of a run; `why` is the reason if the run stopped early, else ""."""
        if self.problem is None:
            hash_ = run.trace_sha256 if run is not None else None
            ended = f"{ABNORMALLY}{why}" if why else "at its end"
            with self._noting_problem():
                self._open_log().close({"ended": ended, "trace_sha256": hash_ or ""})

    def end_by(self, error: BaseException) -> None:
        """Ends the log of a run that raised an error; a log without states is not written."""
        if self._log is not None:
            self.end(None, type(error).__name__)

    def _open_log(self) -> McapLog:
        if self._log is None:
            assert isinstance(self.path, Path)
            self._log = McapLog(self.path, self._channels, self._header)
        return self._log

    @contextmanager
    def _noting_problem(self) -> Iterator[None]:
        try:
            yield
        except LogError as error:
            self.problem = error
        except BaseException:
            self._log = None  # without `close`, the file is discarded
            raise

    # ------------------------------------------------------------ messages of a block

    def _block_channels(
        self, states: npt.NDArray[Any], changes: Sequence[ChangeSeen], looks: StepLateness
    ) -> Iterator[LogChannel]:
        """Yields the messages that these states add to each channel, in the order of channels."""
        earlier = None if self._earlier is None else self._earlier[0]
        steps = decisions.decision_steps(self._system, states, earlier, self._explainer)
        messages = [
            map(mode_message, self._mode_records(changes)),
            (decision_message(_log_step(d, looks.get((d.time_ns, d.module)))) for d in steps),
            *(self._topic_messages(states, t) for t in _logged_topics(self._system)),
            *(self._true_states(states, x) for x in self._system.components if x.plant is not None),
        ]
        for (name, schema), channel_messages in zip(self._channels, messages, strict=True):
            yield LogChannel(name, schema, channel_messages)

    def _topic_messages(self, states: npt.NDArray[Any], topic: Topic) -> Iterator[Message]:
        """Yields the messages of a topic: its first value, then every publication."""
        offset, stamps = self._layout.topic_offset(topic.index), states["stamps"][:, topic.index]
        published = stamps == states["header"]["ct"]
        if topic.index in {e.topic for e in self._system.externals}:  # stamped as it was measured
            earlier = NEVER if self._earlier is None else self._earlier[0]["stamps"][topic.index]
            published |= np.diff(stamps, prepend=earlier) != 0
        for time_ns, raw in self._chosen_states(states, published):
            value = to_json(topic.type, decode_from(raw, offset, topic.type))
            yield time_ns, _topic_message(topic.type, value)

    def _true_states(self, states: npt.NDArray[Any], plant: Component) -> Iterator[Message]:
        """Yields the messages of a plant's true state, after each of its releases."""
        assert plant.plant is not None
        truth = plant.plant.truth
        released = (states["header"]["ct"] - plant.phase_ns) % plant.period_ns == 0
        for time_ns, raw in self._chosen_states(states, released):
            value = to_json(truth, truth_value(self._layout, plant, raw))
            yield time_ns, value

    def _chosen_states(
        self, states: npt.NDArray[Any], chosen: npt.NDArray[np.bool_]
    ) -> Iterator[tuple[int, memoryview]]:
        """Yields time and bytes of all chosen states and of the run's first state."""
        chosen = chosen.copy()
        chosen[:1] |= self._earlier is None
        for row in np.flatnonzero(chosen):
            yield int(states["header"]["ct"][row]), memoryview(states[row].tobytes())

    def _mode_records(self, changes: Sequence[ChangeSeen]) -> Iterator[ModeRecord]:
        if self._earlier is None:
            for m in self._system.modules:
                yield ModeRecord(0, m.name, "AC" if m.forced == "ac" else "SC")
        for change in changes:
            d = decisions.change_record(self._system, change)
            yield ModeRecord(d.time_ns, d.module, d.after)


def _log_step(d: decisions.DecisionStepRecord, look: tuple[int, int] | None) -> DecisionStep:
    return DecisionStep(
        time_ns=d.time_ns,
        module=d.module,
        mode_before=d.before,
        mode_after=d.after,
        reason=d.reason,
        predicates=d.saw.predicates(),
        why=d.words,
        margin_s=d.margin_s,
        look=look,
        plan=d.plan,
        reads={r.topic: {"value": to_json(r.type, r.value), "age_ns": r.age_ns} for r in d.reads},
    )


# ---------------------------------------------------------------- schemas


def _topic_message(t: Type, value: object) -> Mapping[str, object]:
    """The message for a value of a topic, which is always a JSON object."""
    return value if isinstance(t, RecordType) else {"value": value}  # type: ignore[return-value]


def _message_schema(t: Type) -> JsonSchema:
    return _schema(t) if isinstance(t, RecordType) else object_schema({"value": _schema(t)}, str(t))


def _schema(t: Type) -> JsonSchema:
    if isinstance(t, RecordType):
        return object_schema({n: _schema(f) for n, f in t.fields}, t.name or "")
    if isinstance(t, (ArrayType, ListType)):
        length = t.size if isinstance(t, ArrayType) else t.capacity
        return array_schema(_schema(t.element), length)
    if isinstance(t, EnumType):
        return enum_schema(t.members)
    scalars: dict[type, JsonSchema] = {FloatType: NUMBER, IntType: INTEGER, BoolType: BOOLEAN}
    unit = t.unit if isinstance(t, (FloatType, IntType)) else ""
    return {**scalars[type(t)], "unit": unit} if unit else scalars[type(t)]


def _logged_topics(system: System) -> list[Topic]:
    """The topics to log: all except those that hold values for later publication."""
    return [t for t in system.topics if not t.held]


@dataclass(frozen=True)
class RecordedRun:
    """The topics and the plants' true states after each instant of a run, by full names.

    `published`: the topics that were published at each instant. `before`: the topics before the
    first instant, if this is a part of a record; None means their defaults. `modes`: time in s,
    module and new mode of each known change; the first entry of a module is its mode at the start.
    """

    times_ns: list[int]
    topics: list[dict[str, Any]]
    truths: list[dict[str, Any]]
    published: list[set[str]]
    before: dict[str, Any] | None = None
    modes: list[tuple[float, str, str]] = field(default_factory=list)


MISSED = ("late", "skip", "wait", "overrun", "silent")
"""The kinds of faults with which a component may publish nothing at its release."""


def record_of_trace(run: Run) -> RecordedRun:
    """The recorded values of a traced run."""
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
    for m in run.system.modules:
        record.modes.append((0.0, m.name, "AC" if m.forced == "ac" else "SC"))
    record.modes.extend((d.time_ns / 1e9, d.module, d.after) for d in run.decisions)
    _drop_unpublished(record, run.system)
    return record


def _drop_unpublished(record: RecordedRun, system: System) -> None:
    """Removes from the first set in `published` the topics that no component published then.

    A log has a first value of every topic, which may be only a default.
    """
    if not record.published:
        return
    missed = {f.component for f in system.faults if f.kind in MISSED}
    published = {
        c.scope.topics[t]
        for c in system.components
        if c.index not in missed and (record.times_ns[0] - c.phase_ns) % c.period_ns == 0
        for t in _published_topics(c)
    }
    record.published[0] &= {system.topics[i].name for i in published}


def _published_topics(c: Component) -> list[TopicSymbol]:
    if c.plant is not None:
        return [t for t, _ in c.plant.drives]
    return list(c.node.publishes) if c.node is not None else []


def read_log(path: Path, system: System) -> RecordedRun:
    """Reads a log of this system that `soter run --log` wrote; raises `SoterError` D006."""
    require_log_package()
    types: dict[str, Type] = {t.name: t.type for t in system.topics}
    truths = {f"{c.name}.truth": c for c in system.components if c.plant is not None}
    types.update({name: c.plant.truth for name, c in truths.items() if c.plant is not None})
    record, fresh = RecordedRun([], [], [], []), set[str]()
    topics: dict[str, Any] = {t.name: t.default for t in system.topics}
    states: dict[str, Any] = {}
    for time_ns, channel, message in log_messages(path):
        t = types.get(channel)
        if channel == MODES_TOPIC:
            record.modes.append((time_ns / 1e9, message["module"], message["mode"]))
        if t is None:
            continue
        value = _logged_value(path, system, channel, t, message)
        if not record.times_ns or time_ns > record.times_ns[-1]:
            _add_instant(record, topics, states, fresh)
            record.times_ns.append(time_ns)
            fresh = set()
        if channel in truths:
            states[truths[channel].name] = value
        else:
            topics[channel] = value
            fresh.add(channel)
    if not record.times_ns or len(states) < len(truths):
        raise unreadable_error(path, f"it holds no true states of `{system.name}`")
    _add_instant(record, topics, states, fresh)
    _drop_unpublished(record, system)
    return record


def _logged_value(path: Path, system: System, channel: str, t: Type, message: Any) -> Any:  # noqa: ANN401
    """The value in a log message; raises `SoterError` D006 for a message without it."""
    try:
        return from_json(t, message if isinstance(t, RecordType) else message["value"], channel)
    except (ValueShapeError, LookupError, TypeError) as error:
        raise unreadable_error(path, f"{error}; is it a log of `{system.name}`?") from error


def _add_instant(
    record: RecordedRun, topics: dict[str, Any], states: dict[str, Any], fresh: set[str]
) -> None:
    """Adds to the record the values and publications of the instant that was last read."""
    if record.times_ns:
        record.published.append(fresh)
        record.topics.append(dict(topics))
        record.truths.append(dict(states))
