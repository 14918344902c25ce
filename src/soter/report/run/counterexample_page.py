"""A counterexample as a run on a page: signals, modes, and the instant that is violated.

Purpose: `counterexample_page` makes the page of a run from what the interpreter saw, instant by
instant. Time lines open at the instant that violates, where every panel has a mark.
Non-goals: replaying (`explore/replay.py`, `verify/counterexample.py`); the words of each step
(`report/sequence_view.py`), which callers hand on as a table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.report.run.record import Chart, Decision, ModeBand, Picture, ReportPage, Violation
from soter.report.run.signals import SERIES_MAX, record_array, value_series

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.system import System
    from soter.report.templates import PageSection


SHOWN = 40
"""Instants before the violation at which time lines open; the reader zooms out to the others."""
EDGE = 0.05
"""Part of the time shown that stays free behind the violation."""
AT_ONCE_S = 1e-3
"""Shown behind the violation where everything happens at one instant."""


class Instant(NamedTuple):
    """The topics, plant states (JSON values) and modes (AC, SC) that hold from `time_s` on."""

    time_s: float
    topics: Mapping[str, Any]
    truth: Mapping[str, Any]
    modes: Mapping[str, str]


class PageWords(NamedTuple):
    """The texts of a page from its heading to its grounds; `violated`: what failed."""

    title: str
    headline: str
    subtitle: str
    violated: str
    notes: tuple[str, ...]
    assumptions: tuple[str, ...]
    provenance: Mapping[str, str]
    sections: tuple[PageSection, ...]
    svg: str
    """The diagram of the system."""


def counterexample_page(
    system: System,
    words: PageWords,
    instants: Sequence[Instant],
    violated_s: float | None,
    decisions: tuple[Decision, ...] = (),
) -> ReportPage:
    """Makes the page; `violated_s` is the time of the violation, None if the run ends before it."""
    chart = _chart_of_run(system, words, instants, violated_s, decisions) if instants else None
    return ReportPage(
        words.title,
        subtitle=words.subtitle,
        headline=words.headline,
        charts=() if chart is None else (chart,),
        notes=(*words.notes, *_zoom_note(instants)),
        assumptions=words.assumptions,
        provenance=words.provenance,
        picture=Picture(words.svg),
        sections=words.sections,
    )


def _chart_of_run(
    system: System,
    words: PageWords,
    instants: Sequence[Instant],
    violated_s: float | None,
    decisions: tuple[Decision, ...],
) -> Chart:
    plants = {
        x.name: record_array(x.plant.truth, [i.truth[x.name] for i in instants])
        for x in system.components
        if x.plant is not None
    }
    topics = {
        t.name: record_array(t.type, [i.topics[t.name] for i in instants]) for t in system.topics
    }
    failed = () if violated_s is None else (Violation(violated_s, words.violated),)
    name = f"System {system.name}"
    return Chart(
        name=name,
        title=name,
        time_s=np.array([i.time_s for i in instants]),
        series=tuple(value_series(system, plants, topics))[:SERIES_MAX],
        modes=tuple(
            ModeBand(m.name, np.array([i.modes[m.name] == "AC" for i in instants]))
            for m in system.modules
        ),
        decisions=decisions,
        violations=failed,
        summary={"violations": len(failed)},
        properties=(words.violated,),
        opens=_first_shown_span([i.time_s for i in instants]),
    )


def _zoom_note(instants: Sequence[Instant]) -> tuple[str, ...]:
    """A note for the reader if the time lines first show only a part of the run; else ()."""
    several = len({i.time_s for i in instants}) > SHOWN
    text = (
        f"Time lines open at the last {SHOWN} instants; a double-click on one shows the whole run."
    )
    return (text,) if several else ()


def _first_shown_span(time_s: Sequence[float]) -> tuple[float, float]:
    """The start and the end, in s, of the time span that the time lines show at first."""
    different = sorted(set(time_s))[-SHOWN:]
    length = different[-1] - different[0]
    return different[0], different[-1] + (EDGE * length or AT_ONCE_S)
