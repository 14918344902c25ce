"""Writes a replayed trace as an MCAP log.

Purpose: the log has every step as a message of `soter/steps`, every value that reached its topic
under the topic's name, modes and decisions as in the log of a run; the same tools read both.
Non-goals: structured values (a topic whose values are all numbers, or all truth values, is logged
as such, so that viewers plot it, any other as text); the page (`run/counterexample_page.py`),
replaying.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from soter.report.mcap_log import (
    BOOLEAN,
    INTEGER,
    NUMBER,
    STRING,
    DecisionStep,
    JsonSchema,
    LogChannel,
    LogHeader,
    Message,
    ModeRecord,
    array_schema,
    object_schema,
    write_mcap,
)
from soter.report.sequence_view import Mode, SequenceStep, SequenceView, late_ns, reaching_values
from soter.report.wording import visible

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator
    from pathlib import Path


STEPS_TOPIC = "soter/steps"
STEPS_SCHEMA = object_schema(
    {
        "step": INTEGER,
        "lane": STRING,
        "kind": STRING,
        "late_ns": INTEGER,
        "choices": array_schema(
            object_schema({"what": STRING, "value": STRING, "default": BOOLEAN})
        ),
        "published": array_schema(object_schema({"topic": STRING, "value": STRING})),
        "gated": BOOLEAN,
        "fault": STRING,
        "dropped": array_schema(STRING),
        "observable": BOOLEAN,
        "violates": BOOLEAN,
        "note": STRING,
    },
    "a step of a replayed trace; `fault` is empty where there was none",
)
NUMERIC = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
TRUTH = {"true": True, "false": False}


def write_log(view: SequenceView, path: str | os.PathLike[str]) -> Path:
    """Writes the trace to `path` and returns the path; the same view gives the same bytes.

    Raises the errors of `mcap_log.write_mcap`: `SoterError` D006, D007, and `ValueError` for times
    that are negative or run backwards.
    """
    header = LogHeader(
        program_sha256=view.program_sha256,
        system=view.system,
        seed=view.seed,
        tool_version=view.tool_version,
        more={
            "program": visible(view.program),
            "test": visible(view.test),
            "property": visible(view.property_text),
            "verdict": visible(view.verdict),
            **{visible(name): visible(value) for name, value in view.provenance.items()},
        },
    )
    channels = [
        LogChannel(STEPS_TOPIC, STEPS_SCHEMA, [_step_message(step) for step in view.steps]),
        *_topic_channels(view),
    ]
    return write_mcap(
        path, channels, modes=_mode_changes(view), decisions=_dm_steps(view), header=header
    )


def _step_message(step: SequenceStep) -> Message:
    return step.time_ns, {
        "step": step.number,
        "lane": step.lane,
        "kind": step.kind,
        "late_ns": late_ns(step),
        "choices": [
            {"what": pick.what, "value": pick.value, "default": pick.default}
            for pick in step.choices
        ],
        "published": [{"topic": p.topic, "value": p.value} for p in step.published],
        "gated": step.gated,
        "fault": step.fault or "",
        "dropped": list(step.dropped),
        "observable": step.observable,
        "violates": step.violates,
        "note": step.note,
    }


def _topic_channels(view: SequenceView) -> Iterator[LogChannel]:
    """Yields a channel for each topic in `topics`, then for each other topic that got a value."""
    values: dict[str, list[tuple[SequenceStep, str]]] = {name: [] for name in view.topics}
    for step in view.steps:
        for published in reaching_values(step):
            values.setdefault(published.topic, []).append((step, published.value))
    for name, taken in values.items():
        schema, read = _typed_values([value for _, value in taken])
        messages = [
            (step.time_ns, {"value": made, "step": step.number})
            for (step, _), made in zip(taken, read, strict=True)
        ]
        yield LogChannel(name, object_schema({"value": schema, "step": INTEGER}), messages)


def _typed_values(texts: list[str]) -> tuple[JsonSchema, list[bool] | list[float] | list[str]]:
    """Parses a topic's texts as booleans or numbers if all allow it; else keeps them as texts."""
    if texts and all(text in TRUTH for text in texts):
        return BOOLEAN, [TRUTH[text] for text in texts]
    if texts and all(NUMERIC.fullmatch(text) for text in texts):
        numbers = [float(text) for text in texts]
        if all(map(math.isfinite, numbers)):
            return NUMBER, numbers
    return STRING, texts


def _mode_changes(view: SequenceView) -> list[ModeRecord]:
    """The changes of mode of all modules, in order of time."""
    times_ns = {step.number: step.time_ns for step in view.steps}
    changes = [
        (number, ModeRecord(times_ns.get(number, 0), each.module, mode))
        for each in view.modes
        for number, mode in each.modes
    ]
    return [change for _, change in sorted(changes, key=lambda item: item[0])]


def _dm_steps(view: SequenceView) -> Iterator[DecisionStep]:
    """Yields every step of a DM that was made, with the modes before and after it."""
    modules = {lane.name: lane.module for lane in view.lanes if lane.role == "dm"}
    for step in view.steps:
        module = modules.get(step.lane)
        if module is None or step.kind == "lost":
            continue
        before, after = modes_around(view, module, step)
        if before is not None and after is not None:
            yield DecisionStep(step.time_ns, module, before, after, step.note)


def modes_around(
    view: SequenceView, module: str, step: SequenceStep
) -> tuple[Mode | None, Mode | None]:
    """The modes of a module before and after a step; None if the view does not record them."""
    if step.switch is not None and step.switch.module == module:
        return step.switch.before, step.switch.after
    modes = next((each.modes for each in view.modes if each.module == module), ())
    mode = next((mode for number, mode in reversed(modes) if number <= step.number), None)
    return mode, mode
