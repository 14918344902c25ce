"""A traced run as an MCAP log.

Purpose: one channel a topic, one a plant's true state, modes, and every DM step with its reason,
all in virtual time (`report/mcap_log.py` writes the file).
Non-goals: reading logs; locals of nodes, which are nobody's interface.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.lower.layout import decode_from
from soter.program.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.program.values import to_json
from soter.report.errors import LogError
from soter.report.mcap_log import (
    BOOLEAN,
    INTEGER,
    NUMBER,
    Channel,
    DecisionStep,
    LogHeader,
    ModeChange,
    array_schema,
    enum_schema,
    object_schema,
    write_mcap,
)
from soter.simulate import decisions
from soter.simulate.figures import truth_value
from soter.simulate.params import changed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.program.system import Component, Topic
    from soter.program.types import Type
    from soter.report.mcap_log import JsonSchema, Message
    from soter.simulate.run import Run


def require_log_package() -> None:
    """SoterError D007 where the package that writes logs is not installed."""
    if find_spec("mcap") is None:
        raise SoterError(
            (
                Diagnostic(
                    "D007",
                    "logs are written with the package `mcap`, which is not installed",
                    helps=("install it: pip install 'soter[log]'",),
                ),
            )
        )


def write_log(run: Run, path: str | Path, version: str) -> Path:
    """Write the log of a traced run to `path`; SoterError D006 where it cannot be written."""
    run.require_trace()
    require_log_package()
    channels = [_topic(run, t) for t in run.system.topics]
    channels += [_truth(run, x) for x in run.system.components if x.plant is not None]
    header = LogHeader(
        run.system.program.sha256,
        run.system.name,
        run.seed,
        version,
        {
            "engine": run.engine,
            "trace_sha256": run.trace_sha256 or "",
            **{f"param {name}": text for name, (text, _) in changed(run.system).items()},
            **{f"extern {name}": text for name, text in run.externs.items()},
        },
    )
    try:
        return write_mcap(
            path, channels, modes=_modes(run), decisions=_decisions(run), header=header
        )
    except LogError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error


# ---------------------------------------------------------------- channels


def _topic(run: Run, topic: Topic) -> Channel:
    """The first value, and then every publication."""
    assert run.trace is not None
    offset = run.layout.topic_offset(topic.index)
    published = run.trace["stamps"][:, topic.index] == run.trace["header"]["ct"]

    def messages() -> Iterator[Message]:
        for time_ns, raw in _rows(run, published):
            yield (
                time_ns,
                _message(topic.type, to_json(topic.type, decode_from(raw, offset, topic.type))),
            )

    return Channel(topic.name, _message_schema(topic.type), messages())


def _truth(run: Run, plant: Component) -> Channel:
    """The true state after every release of a plant."""
    assert run.trace is not None
    assert plant.plant is not None
    truth = plant.plant.truth
    times_ns = run.trace["header"]["ct"]
    released = (times_ns - plant.phase_ns) % plant.period_ns == 0

    def messages() -> Iterator[Message]:
        for time_ns, raw in _rows(run, released):
            yield time_ns, to_json(truth, truth_value(run, plant, raw))

    return Channel(f"{plant.name}.truth", _schema(truth), messages())


def _rows(run: Run, chosen: npt.NDArray[np.bool_]) -> Iterator[tuple[int, memoryview]]:
    """Time and image of the first state and of all chosen ones."""
    assert run.trace is not None
    chosen = chosen.copy()
    chosen[:1] = True
    times_ns = run.trace["header"]["ct"]
    for row in np.flatnonzero(chosen):
        yield int(times_ns[row]), memoryview(run.trace[row].tobytes())


def _modes(run: Run) -> Iterator[ModeChange]:
    for m in run.system.modules:
        yield ModeChange(0, m.name, "AC" if m.forced == "ac" else "SC")
    for d in decisions.changes(run):
        yield ModeChange(d.time_ns, d.module, d.after)


def _decisions(run: Run) -> Iterator[DecisionStep]:
    for d in decisions.steps(run):
        yield DecisionStep(d.time_ns, d.module, d.before, d.after, d.reason, d.saw.predicates())


# ---------------------------------------------------------------- schemas


def _message(t: Type, value: object) -> Mapping[str, object]:
    """A message is always an object."""
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
    return scalars[type(t)]
