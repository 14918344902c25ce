"""A traced run as the report that a person opens.

Purpose: signals of topics and plants, modes, decisions with reasons, violations and what the
result rests on, for any program; one file of HTML (`report/html.py` writes it).
Non-goals: geometry. An example that moves through a scene fills the records itself.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.lower.layout import group_field
from soter.program.model.types import BoolType, FloatType, IntType, RecordType
from soter.report.errors import ReportError
from soter.report.html import write_html
from soter.report.run.record import (
    Chart,
    Decision,
    ModeBand,
    ReportPage,
    Series,
    Threshold,
    Violation,
)
from soter.simulate import decisions
from soter.simulate.outputs.assumptions import of_run

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.program.model.types import Type
    from soter.simulate.result import Run

SERIES_MAX = 24
"""More signals than that nobody reads below each other."""
SAMPLES_MAX = 20_000
"""Longer runs are thinned: a screen has a few thousand columns."""
SIGNAL_SHARE_MIN = 20
"""A signal keeps at least this part of its panel's height."""
AXES = {"x", "y", "z"}


def require_report_package() -> None:
    """SoterError D007 where the package that draws reports is not installed."""
    if find_spec("plotly") is None:
        raise SoterError(
            (
                Diagnostic(
                    "D007",
                    "reports are drawn with the package `plotly`, which is not installed",
                    helps=("install it: pip install 'soter[report]'",),
                ),
            )
        )


def write_report(run: Run, path: str | Path, title: str, provenance: Mapping[str, str]) -> Path:
    """Write the report of a traced run; SoterError D006 where it cannot be written."""
    run.require_trace()
    require_report_package()
    try:
        return write_html(report_page(run, title, provenance), path)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error


def report_page(run: Run, title: str, provenance: Mapping[str, str]) -> ReportPage:
    """The page of one run."""
    chart = run_chart(run)
    return ReportPage(
        title,
        subtitle=f"system {run.system.name}, seed {run.seed}",
        charts=(chart,),
        assumptions=(*run.notes, *of_run(run.system, run.proofs)),
        provenance=dict(provenance),
    )


def run_chart(run: Run) -> Chart:
    """All signals of a run, thinned to what can be seen."""
    whole = run.require_trace()
    thin = max(1, len(whole) // SAMPLES_MAX)
    trace = whole[::thin]
    time_s = trace["header"]["ct"] / 1e9
    bands = tuple(
        ModeBand(m.name, trace["modules"]["mode"][:, m.index] == 1) for m in run.system.modules
    )
    return Chart(
        name=run.system.name,
        title=run.system.name,
        time_s=time_s,
        series=(*_margins(run, thin), *_series(run, trace))[:SERIES_MAX],
        modes=bands,
        decisions=tuple(_decision(d) for d in decisions.changes(run)),
        violations=tuple(
            Violation(v.time_s, v.what) for v in run.violation_list if v.time_s is not None
        ),
        summary=_summary(run),
    )


def _decision(d: decisions.Decided) -> Decision:
    return Decision(
        d.time_ns / 1e9, d.module, d.after, d.reason, d.saw.predicates(), why=tuple(d.words)
    )


def _summary(run: Run) -> dict[str, float | int | str]:
    found: dict[str, float | int | str] = {"violations": run.violations}
    modules = list(run.modules.values())
    if len(modules) == 1:
        found["ac_share"] = modules[0].ac_share
        found["switches_to_sc"] = modules[0].switches_to_sc
        found["switches_to_ac"] = modules[0].switches_to_ac
    return found


def _margins(run: Run, thin: int) -> Iterator[Series]:
    """For how long AC surely keeps control, of modules whose levels say more than the calendar."""
    for m in run.system.modules:
        if m.looks > 1:
            yield Series(f"margin({m.name})", "s", run.margin(m.name)[::thin], panel=m.name)


def _series(run: Run, trace: npt.NDArray[np.void]) -> Iterator[Series]:
    """Plants' true states first: they are what the properties speak of."""
    for group in run.layout.groups:
        x = run.system.components[group.owner] if group.owner >= 0 else None
        if x is None or x.plant is None:
            continue
        states = trace[group_field(group)]
        for v in x.plant.states:
            yield from _signals(f"{x.name}.{v.name}", v.type, states[v.name], ())
    for topic in run.system.topics:
        if topic.held:
            continue
        bounds = iter(topic.bounds)
        levels = next(bounds, None)
        marks: tuple[Threshold, ...] = ()
        if isinstance(topic.type, (FloatType, IntType)) and levels is not None:
            marks = (Threshold("least", levels.low), Threshold("greatest", levels.high))
        yield from _signals(topic.name, topic.type, trace["topics"][topic.name], marks)


def _in_sight(
    numbers: npt.NDArray[np.float64], marks: tuple[Threshold, ...]
) -> tuple[Threshold, ...]:
    """The levels, or none where with them the signal would be a flat line."""
    levels = [m.value for m in marks]
    if not marks or not numbers.size:
        return ()
    low, high = float(np.min(numbers)), float(np.max(numbers))
    whole = max(high, *levels) - min(low, *levels)
    return () if 0 < high - low < whole / SIGNAL_SHARE_MIN else marks


def _signals(
    name: str, t: Type, values: npt.NDArray[np.void], marks: tuple[Threshold, ...]
) -> Iterator[Series]:
    """The numbers and bools (0, 1) of a value; coordinates share a panel."""
    if isinstance(t, (FloatType, IntType, BoolType)):
        numbers = np.ascontiguousarray(values, dtype=np.float64)
        yield Series(name, "", numbers, panel=name, thresholds=_in_sight(numbers, marks))
    elif isinstance(t, RecordType):
        together = {n for n, _ in t.fields} <= AXES
        for n, f in t.fields:
            for series in _signals(f"{name}.{n}", f, values[n], ()):
                yield Series(series.name, "", series.values, name if together else series.panel)
