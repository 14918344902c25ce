"""Makes the HTML report of a traced run.

Purpose: `report_page` collects signals of topics and plants, modes, decisions with reasons,
violations and assumptions, for any program; `report/html.py` writes one HTML file of them. For a
module with `rest` it shows the picture of where SC would lead.
Non-goals: scenes: an example with a scene fills the records of a report itself; the boxes of the
picture (`tube_looks.py`).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from soter.core.layout import field_name_of_group
from soter.diagram.svg import picture as draw
from soter.report.html import inline_document, require_report_package, write_html
from soter.report.run.record import (
    Chart,
    Decision,
    ModeBand,
    Picture,
    ReportPage,
    Series,
    Violation,
)
from soter.report.run.signals import SERIES_MAX, sorted_by_interest, value_series
from soter.report.run.where_sc_leads import LedLook, LedPicture
from soter.report.wording import count_text, prose
from soter.simulate import decisions
from soter.simulate.result_assumptions import run_assumptions
from soter.simulate.run_observer import decided_rows
from soter.simulate.tube_looks import compile_looks

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.language.model.system import Module
    from soter.simulate.result import Run
    from soter.simulate.tube_looks import TubeLooks


TIMES = "\N{MULTIPLICATION SIGN}"
LOOKS_MAX = 120
"""The most looks of a module on a page; looks that took control from AC come first."""
JUDGED = " (after the commands that might act at this look)"


def tube_pictures(run: Run) -> tuple[LedPicture, ...]:
    """Pictures of the tubes of modules with `rest`; () with `order any` or no C compiler."""
    looks = None if run.system.shuffled else compile_looks(run.system)
    if looks is None:
        return ()
    pictures = (_tube_picture(run, looks, m) for m in looks.modules)
    return tuple(p for p in pictures if p.looks)


def _tube_picture(run: Run, looks: TubeLooks, module: Module) -> LedPicture:
    trace = run.require_trace()
    mode, stale = (trace["modules"][name][:, module.index] for name in ("mode", "stale"))
    rows = np.flatnonzero(decided_rows(run.system, trace)[:, module.index] & (stale == 0))
    rows = rows[rows > 0]  # the values that a DM read come from two states
    lost = rows[(mode[rows - 1] == 1) & (mode[rows] == 0)][:LOOKS_MAX]
    even = np.linspace(0, len(rows) - 1, min(LOOKS_MAX, len(rows)) - len(lost)).astype(np.intp)
    drawn = []
    for row in np.union1d(rows[even], lost):
        states = trace[row - 1].tobytes(), trace[row].tobytes()
        look = looks.follow_tube(module.index, *states, judged=bool(mode[row - 1]))
        judged_note = JUDGED if module.shield is not None and mode[row - 1] else ""
        if len(look.boxes):
            time_s = float(trace["header"]["ct"][row]) / 1e9
            drawn.append(
                LedLook(time_s, look.boxes, prose(looks.failure_words(module, look) + judged_note))
            )
    return LedPicture(
        module.name, looks.names[module.index], looks.units[module.index], tuple(drawn), len(rows)
    )


SAMPLES_MAX = 20_000
"""Longer runs are thinned: a screen has a few thousand columns."""


def write_report(
    run: Run,
    path: str | Path,
    title: str,
    provenance: Mapping[str, str],
    *,
    self_contained: bool = False,
) -> Path:
    """Writes the report of a traced run, with its script if `self_contained`; raises D006."""
    run.require_trace()
    require_report_package()
    page = report_page(run, title, provenance)
    return write_html(page, path, self_contained=self_contained)


def inline_report(run: Run, title: str, provenance: Mapping[str, str]) -> str:
    """The report of a traced run as HTML text; "" if plotly is not installed."""
    if find_spec("plotly") is None:
        return ""
    return inline_document(report_page(run, title, provenance))


def report_page(run: Run, title: str, provenance: Mapping[str, str]) -> ReportPage:
    """The content of the report page of a run."""
    chart = run_chart(run)
    picture = Picture(draw(run.system), tube_pictures(run))
    return ReportPage(
        title,
        subtitle=f"system {run.system.name}, seed {run.seed}, {run.reached_s:g} s",
        charts=(chart,),
        notes=(*run.failures, *run.notes, *_signal_notes(run)),
        assumptions=tuple(run_assumptions(run.system, run.proofs)),
        provenance=dict(provenance),
        picture=picture,
        headline=_headline(run),
    )


def _headline(run: Run) -> str:
    """The headline: first externs that never answered, then modules whose rest is not shown.

    It says "system" and "this run", because a system may be called `Proved`.
    """
    count = count_text(run.violations, "violation")
    sentence = f"System {run.system.name}: {count} in this run."
    if unshown := " and ".join(m.name for m in run.system.modules if m.unshown):
        sentence = f"{unshown} flew by what is not shown of its rest. {sentence}"
    if not run.never_answered:
        return sentence
    names = " and ".join(run.never_answered)
    return f"{names} never answered: nothing of it was tried. {sentence}"


def _thinned_trace(run: Run) -> npt.NDArray[np.void]:
    """The trace of a short run, or every n-th state of a long run."""
    whole = run.require_trace()
    return whole[:: max(1, len(whole) // SAMPLES_MAX)]


def run_chart(run: Run) -> Chart:
    """The chart of all signals of a run, with no more points than a screen can show."""
    trace = _thinned_trace(run)
    step = max(1, len(run.require_trace()) // SAMPLES_MAX)
    time_s = trace["header"]["ct"] / 1e9
    bands = tuple(
        ModeBand(m.name, trace["modules"]["mode"][:, m.index] == 1, _share_text(run, m.name))
        for m in run.system.modules
    )
    return Chart(
        name=f"System {run.system.name}",
        title=f"System {run.system.name}",
        time_s=time_s,
        series=sorted_by_interest(run.system, _all_series(run, trace, step))[:SERIES_MAX],
        modes=bands,
        decisions=tuple(_report_decision(d) for d in run.decisions),
        violations=tuple(
            Violation(v.time_s, v.what, times=v.count)
            for v in run.violation_list
            if v.time_s is not None
        ),
        summary=_run_summary(run),
        properties=tuple(f"{p.kind} {p.text}" for p in run.system.properties),
    )


def _all_series(run: Run, trace: npt.NDArray[np.void], step: int) -> tuple[Series, ...]:
    return (
        *_margin_series(run, step),
        *_latch_series(run, trace),
        *_value_series(run, trace),
    )


def _signal_notes(run: Run) -> Iterator[str]:
    """Yields notes on what a drawn margin is, and on signals that are left out."""
    for m in run.system.modules:
        if m.looks > 1:
            yield f"margin of {m.name}: for how long AC surely keeps control from then on"
    trace = run.require_trace()[:1]
    count = len(_all_series(run, trace, len(run.require_trace())))
    if count > SERIES_MAX:
        yield (
            f"of {count} signals {SERIES_MAX} are drawn over time; a log has every topic "
            "(`soter run --log`)"
        )


def _share_text(run: Run, module: str) -> str:
    """A text that states AC's share of control and how often SC took over."""
    m = run.modules[module]
    return f"AC in control {m.ac_share:.1%}, SC took over {m.switches_to_sc} {TIMES}"


def _report_decision(d: decisions.DecisionStepRecord) -> Decision:
    return Decision(
        d.time_ns / 1e9, d.module, d.after, d.reason, d.saw.predicates(), why=tuple(d.words)
    )


def _run_summary(run: Run) -> dict[str, float | int | str]:
    summary: dict[str, float | int | str] = {"violations": run.violations}
    modules = list(run.modules.values())
    if len(modules) == 1:
        summary["ac_share"] = modules[0].ac_share
        summary["switches_to_sc"] = modules[0].switches_to_sc
        summary["switches_to_ac"] = modules[0].switches_to_ac
    return summary


def _margin_series(run: Run, step: int) -> Iterator[Series]:
    """Yields the margin over time of each module that looks ahead more than one period."""
    for m in run.system.modules:
        if m.looks > 1:
            yield Series(
                f"margin({m.name})", "s", run.margin(m.name)[::step], panel=f"margin of {m.name}"
            )


def _latch_series(run: Run, trace: npt.NDArray[np.void]) -> Iterator[Series]:
    """Yields a series for each module with a latch: 1 while the latch keeps AC out, else 0."""
    for m in run.system.modules:
        if m.latch is not None:
            latched = decisions.latched_rows(m, trace).astype(float)
            yield Series(f"latched({m.name})", "", latched, panel=f"latch of {m.name}", held=True)


def _value_series(run: Run, trace: npt.NDArray[np.void]) -> Iterator[Series]:
    """Yields the signals of all topics and plants."""
    owned = [(g, run.system.components[g.owner]) for g in run.layout.groups if g.owner >= 0]
    plants = {x.name: trace[field_name_of_group(g)] for g, x in owned if x.plant is not None}
    topics = {topic.name: trace["topics"][topic.name] for topic in run.system.topics}
    return value_series(run.system, plants, topics)
