"""A replayed trace on the page of runs.

Purpose: `trace_page` hands what the interpreter saw to `report/run/counterexample_page.py`, with
the steps in the words of `trace_view.py` as a table.
Non-goals: running anything (`replay.py`), the words of a step (`report/sequence_view.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagram.svg import picture
from soter.explore.trace import START
from soter.report.run.counterexample_page import Instant, PageWords, counterexample_page
from soter.report.run.record import Decision
from soter.report.sequence_view import HEADERS, duration_text, explanation, table_rows
from soter.report.templates import PageSection
from soter.report.wording import visible

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.explore.replay import Replayed, ReplayedStep
    from soter.report.run.record import ReportPage
    from soter.report.sequence_view import SequenceView

SEEN = ("ttf", "safer", "stale", "gate_fault")


def trace_page(replay: Replayed, view: SequenceView) -> ReportPage:
    """The page of a trace; `view` describes the same trace in words."""
    facts = {
        "program": view.program,
        "program sha256": view.program_sha256,
        "system": view.system,
        "test": view.test,
        "seed": str(view.seed),
        "soter": view.tool_version,
        **view.provenance,
    }
    table = tuple(
        (
            *(number.text, duration_text(step.time_ns), *(cell.text for cell in rest)),
            ": ".join(filter(None, (mark.text, visible(step.note)))),
        )
        for step, (number, _, *rest, mark) in zip(
            view.steps, table_rows(view, cell_max=_CELL_MAX), strict=True
        )
    )
    run = PageWords(
        title=" · ".join(map(visible, filter(None, (view.program, view.system, view.test)))),
        headline=visible(view.verdict),
        subtitle=" ".join(filter(None, (f"{visible(view.property_text)}.", explanation(view)))),
        violated=replay.trace.broken.text,
        notes=tuple(filter(None, [visible(view.remark)])),
        assumptions=tuple(map(visible, view.assumptions)),
        provenance={visible(name): visible(value) for name, value in facts.items() if value},
        sections=(PageSection("Every step", (), (*HEADERS[:-1], "note"), table, len(table) - 1),),
        svg=picture(replay.system),
    )
    violated_s = replay.steps[-1].time_ns / 1e9 if replay.reproduced else None
    return counterexample_page(
        replay.system, run, list(_instants(replay)), violated_s, tuple(_decisions(replay))
    )


_CELL_MAX = 10**6
"""The most characters of a cell of the page: so many that none is shortened."""


def _instants(replay: Replayed) -> Iterator[Instant]:
    """Yields the first and last instant, and each at which time may pass or a property fails."""
    for step in replay.steps:
        if step.observable or step.violated or step.kind == START or step is replay.steps[-1]:
            yield Instant(_time_s(step), step.topics, step.truth, step.modes)


def _decisions(replay: Replayed) -> Iterator[Decision]:
    for step in replay.steps:
        if step.switch is not None and step.decided is not None:
            saw = {name: bool(step.decided[name]) for name in SEEN}
            reason = ", ".join(name.replace("_", " ") for name, holds in saw.items() if holds)
            to = "AC" if step.switch[2] == "AC" else "SC"
            yield Decision(_time_s(step), step.switch[0], to, reason, saw)  # type: ignore[arg-type]


def _time_s(step: ReplayedStep) -> float:
    return max(step.time_ns, 0) / 1e9
