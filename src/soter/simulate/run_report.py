"""Makes the report of a traced run that a person opens.

Purpose: `report_page` collects signals of topics and plants, modes, decisions with reasons,
violations and assumptions, for any program; `report/html.py` writes one HTML file of them. For a
tower it shows which controller has control in every state, and how long each had it; for a module
with `rest`, the picture of where SC would lead.
Non-goals: geometry: an example that moves through a scene fills the records itself; the boxes of
that picture (`decisions.py`); what a module decides below one that is in SC.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from soter.core.layout import group_field
from soter.diagnostics.diagnostic import mistake
from soter.diagram.svg import picture as draw
from soter.language.evaluate.topic_ranges import limits
from soter.language.model import typed
from soter.language.model.system import modules_above, tower_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    FloatType,
    IntType,
    RecordType,
    leaf_name,
    leaves,
)
from soter.report.html import inline_document, write_html
from soter.report.run.live_diagram import LedLook, LedPicture
from soter.report.run.record import (
    Chart,
    Decision,
    ModeBand,
    Picture,
    ReportPage,
    Series,
    Threshold,
    Violation,
)
from soter.report.wording import count_text, prose
from soter.simulate import decisions
from soter.simulate.decisions import compile_looks
from soter.simulate.result_assumptions import run_assumptions
from soter.simulate.run_observer import decided_rows
from soter.simulate.run_on_diagram import replay_rows
from soter.version import pip_install

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.language.model.system import Module, System
    from soter.language.model.types import Type
    from soter.simulate.decisions import TubeLooks
    from soter.simulate.result import Run


TIMES = "\N{MULTIPLICATION SIGN}"


def towers(system: System) -> list[tuple[Module, ...]]:
    """Every tower of a system, its topmost module first."""
    return [
        tower_of(system, m.index)
        for m in system.modules
        if m.over is not None and not modules_above(system, m.index)
    ]


def controllers(system: System, tower: tuple[Module, ...]) -> list[str]:
    """The names of who may have control, from the topmost module's SC to the lowest one's AC."""
    return [system.components[i].name for i in (*(m.sc for m in tower), tower[-1].ac)]


def controller_levels(
    tower: tuple[Module, ...], trace: npt.NDArray[np.void]
) -> npt.NDArray[np.intp]:
    """For each state, (states,), the number of the one in `controllers` that has control."""
    modes = trace["modules"]["mode"][:, [m.index for m in tower]] == 1
    held: npt.NDArray[np.intp] = np.cumprod(modes, axis=1).sum(axis=1)
    return held


def control_shares(run: Run) -> list[str]:
    """A line for each tower: shares of the time, and how often each took or got control."""
    trace = run.require_trace()
    time_ns = trace["header"]["ct"].astype(np.float64)
    lasts = np.diff(time_ns, append=run.reached_s * 1e9)
    lines = []
    for tower in towers(run.system):
        held = controller_levels(tower, trace)
        begins = np.flatnonzero(np.diff(held, prepend=-1))
        parts = [
            f"{name} {lasts[held == number].sum() / max(lasts.sum(), 1.0):.1%} of the time, "
            f"{int((held[begins] == number).sum())} {TIMES}"
            for number, name in enumerate(controllers(run.system, tower))
        ]
        lines.append(f"Who had control in {tower[0].name}: {'; '.join(parts)}.")
    return lines


LOOKS_MAX = 120
"""The most looks of a module on one page; those that took control are among them."""
JUDGED = " (after the commands that might act at this look)"


def tube_pictures(run: Run) -> tuple[LedPicture, ...]:
    """The pictures of modules with `rest`; none if steps come in any order, or no C compiler is."""
    looks = None if run.system.shuffled else compile_looks(run.system)
    if looks is None:
        return ()
    pictures = (_led_picture(run, looks, m) for m in looks.modules)
    return tuple(p for p in pictures if p.looks)


def _led_picture(run: Run, looks: TubeLooks, module: Module) -> LedPicture:
    trace = run.require_trace()
    mode, stale = (trace["modules"][name][:, module.index] for name in ("mode", "stale"))
    rows = np.flatnonzero(decided_rows(run.system, trace)[:, module.index] & (stale == 0))
    rows = rows[rows > 0]  # what was read is of two states
    lost = rows[(mode[rows - 1] == 1) & (mode[rows] == 0)][:LOOKS_MAX]
    even = np.linspace(0, len(rows) - 1, min(LOOKS_MAX, len(rows)) - len(lost)).astype(np.intp)
    drawn = []
    for row in np.union1d(rows[even], lost):
        states = trace[row - 1].tobytes(), trace[row].tobytes()
        look = looks.follow(module.index, *states, judged=bool(mode[row - 1]))
        judged_note = JUDGED if module.shield is not None and mode[row - 1] else ""
        if len(look.boxes):
            time_s = float(trace["header"]["ct"][row]) / 1e9
            drawn.append(
                LedLook(time_s, look.boxes, prose(looks.failure_words(module, look) + judged_note))
            )
    return LedPicture(
        module.name, looks.names[module.index], looks.units[module.index], tuple(drawn), len(rows)
    )


SERIES_MAX = 24
"""The most signals that are drawn below each other."""
ELEMENTS_MAX = 7
"""Arrays that are longer are not drawn; an arm has this many joints."""
SAMPLES_MAX = 20_000
"""Longer runs are thinned: a screen has a few thousand columns."""
SIGNAL_SHARE_MIN = 20
"""A signal keeps at least one part in this many of its panel's height."""
AXES = {"x", "y", "z"}


def require_report_package() -> None:
    """`SoterError` D007 where the package that draws reports is not installed."""
    if find_spec("plotly") is None:
        raise mistake(
            "D007",
            "reports are drawn with the package `plotly`, which is not installed",
            f"install it: {pip_install('report')}",
        )


def write_report(
    run: Run,
    path: str | Path,
    title: str,
    provenance: Mapping[str, str],
    *,
    self_contained: bool = False,
) -> Path:
    """Writes the report of a traced run; `SoterError` D006 where it cannot be written.

    With `self_contained` it needs no script beside it.
    """
    run.require_trace()
    require_report_package()
    page = report_page(run, title, provenance)
    return write_html(page, path, self_contained=self_contained)


def inline_report(run: Run, title: str, provenance: Mapping[str, str]) -> str:
    """The report of a traced run as one HTML text; "" where reports cannot be drawn here."""
    if find_spec("plotly") is None:
        return ""
    return inline_document(report_page(run, title, provenance))


def report_page(run: Run, title: str, provenance: Mapping[str, str]) -> ReportPage:
    """The page of one run."""
    chart = run_chart(run)
    live = replay_rows(run, _thin_trace(run))
    picture = Picture(draw(run.system, live=True), live, tube_pictures(run))
    return ReportPage(
        title,
        subtitle=f"system {run.system.name}, seed {run.seed}, {run.reached_s:g} s",
        charts=(chart,),
        notes=(*run.failures, *run.notes, *control_shares(run), *_signal_notes(run)),
        assumptions=tuple(run_assumptions(run.system, run.proofs)),
        provenance=dict(provenance),
        picture=picture,
        headline=_headline(run),
    )


def _headline(run: Run) -> str:
    """The headline: first that an extern never answered, then what is not shown of a rest.

    It says that it is a system, and one run, as a system may be called `Proved`.
    """
    count = count_text(run.violations, "violation")
    sentence = f"System {run.system.name}: {count} in this run."
    if unshown := " and ".join(m.name for m in run.system.modules if m.unshown):
        sentence = f"{unshown} flew by what is not shown of its rest. {sentence}"
    if not run.never_answered:
        return sentence
    names = " and ".join(run.never_answered)
    return f"{names} never answered: nothing of it was tried. {sentence}"


def _thin_trace(run: Run) -> npt.NDArray[np.void]:
    """The trace; for long runs every n-th state of it."""
    whole = run.require_trace()
    return whole[:: max(1, len(whole) // SAMPLES_MAX)]


def run_chart(run: Run) -> Chart:
    """All signals of a run, thinned to what can be seen."""
    trace = _thin_trace(run)
    thin = max(1, len(run.require_trace()) // SAMPLES_MAX)
    time_s = trace["header"]["ct"] / 1e9
    bands = tuple(
        ModeBand(m.name, trace["modules"]["mode"][:, m.index] == 1, _share_text(run, m.name))
        for m in run.system.modules
    )
    return Chart(
        name=f"System {run.system.name}",
        title=f"System {run.system.name}",
        time_s=time_s,
        series=_all_series(run, trace, thin)[:SERIES_MAX],
        modes=bands,
        decisions=tuple(_decision(d) for d in run.decisions),
        violations=tuple(
            Violation(v.time_s, v.what, times=v.count)
            for v in run.violation_list
            if v.time_s is not None
        ),
        summary=_summary(run),
        properties=tuple(f"{p.kind} {p.text}" for p in run.system.properties),
    )


def _all_series(run: Run, trace: npt.NDArray[np.void], thin: int) -> tuple[Series, ...]:
    return (
        *_control_series(run, trace),
        *_margin_series(run, thin),
        *_latch_series(run, trace),
        *_value_series(run, trace),
    )


def _signal_notes(run: Run) -> Iterator[str]:
    """Notes on what a margin is, if one is drawn, and on signals that are left out."""
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
    """Words on what one of several modules did."""
    m = run.modules[module]
    return f"AC in control {m.ac_share:.1%}, SC took over {m.switches_to_sc} {TIMES}"


def _decision(d: decisions.DecisionStepRecord) -> Decision:
    return Decision(
        d.time_ns / 1e9, d.module, d.after, d.reason, d.saw.predicates(), why=tuple(d.words)
    )


def _summary(run: Run) -> dict[str, float | int | str]:
    summary: dict[str, float | int | str] = {"violations": run.violations}
    modules = list(run.modules.values())
    if len(modules) == 1:
        summary["ac_share"] = modules[0].ac_share
        summary["switches_to_sc"] = modules[0].switches_to_sc
        summary["switches_to_ac"] = modules[0].switches_to_ac
    return summary


def _control_series(run: Run, trace: npt.NDArray[np.void]) -> Iterator[Series]:
    """The signal of who has control in each tower, by number: 0 is the topmost module's SC."""
    for tower in towers(run.system):
        names = controllers(run.system, tower)
        who = ", ".join(f"{k}: {name}" for k, name in enumerate(names))
        held = controller_levels(tower, trace).astype(float)
        name = f"control({tower[0].name})"
        yield Series(name, "", held, panel=f"who has control ({who})", held=True)


def _margin_series(run: Run, thin: int) -> Iterator[Series]:
    """The signal of margins, for modules whose levels say more than the calendar."""
    for m in run.system.modules:
        if m.looks > 1:
            yield Series(
                f"margin({m.name})", "s", run.margin(m.name)[::thin], panel=f"margin of {m.name}"
            )


def _latch_series(run: Run, trace: npt.NDArray[np.void]) -> Iterator[Series]:
    """The signal of latches: 1 where SC has control and no acknowledgement is in force, else 0."""
    for m in run.system.modules:
        if m.latch is not None:
            latched = decisions.latch_rows(m, trace).astype(float)
            yield Series(f"latched({m.name})", "", latched, panel=f"latch of {m.name}", held=True)


def _value_series(run: Run, trace: npt.NDArray[np.void]) -> Iterator[Series]:
    """All signals; plants' true states come first, as the properties are about them."""
    demanded = _limits_by_signal(run.system)
    measured = _measured_states(run.system)
    compared = frozenset(measured.values())
    for group in run.layout.groups:
        component = run.system.components[group.owner] if group.owner >= 0 else None
        if component is None or component.plant is None:
            continue
        states = trace[group_field(group)]
        for state in component.plant.states:
            for each in _signals(
                f"{component.name}.{state.name}", state.type, states[state.name], ()
            ):
                own = replace(each, panel=each.name) if each.name in compared else each
                yield _with_limits(own, demanded)
    for topic in run.system.topics:
        if topic.held:
            continue
        bounds = iter(topic.bounds)
        levels = next(bounds, None)
        marks: tuple[Threshold, ...] = ()
        if isinstance(topic.type, (FloatType, IntType)) and levels is not None:
            marks = (
                Threshold("least declared", levels.low),
                Threshold("greatest declared", levels.high),
            )
        for each in _signals(topic.name, topic.type, trace["topics"][topic.name], marks):
            truth = measured.get(each.name)
            held = replace(each, held=True, panel=each.panel if truth is None else truth)
            yield _with_limits(held, demanded)


def _limits_by_signal(system: System) -> dict[str, list[Threshold]]:
    """The limits of each signal; a level that several properties demand is drawn once."""
    thresholds_by_signal: dict[str, list[Threshold]] = {}
    for limit in limits(system):
        levels = thresholds_by_signal.setdefault(limit.signal, [])
        same = [i for i, t in enumerate(levels) if t.value == limit.value]
        for i in same:
            if limit.by not in levels[i].label.split(", "):
                levels[i] = Threshold(f"{levels[i].label}, {limit.by}", limit.value)
        if not same:
            levels.append(Threshold(limit.by, limit.value))
    return thresholds_by_signal


def _with_limits(series: Series, demanded: Mapping[str, list[Threshold]]) -> Series:
    """A signal with its limits that are in sight, beside its declared set."""
    marks = _visible_levels(series.values, tuple(demanded.get(series.name, ())))
    return replace(series, thresholds=(*series.thresholds, *marks)) if marks else series


def _measured_states(system: System) -> dict[str, str]:
    """For each signal of a topic the true state that it is, or that it measures."""
    state_by_signal: dict[str, str] = {}
    for x in system.components:
        if x.plant is None:
            continue
        own = {v: f"{x.name}.{v.name}" for v in x.plant.states}
        for topic, value in x.plant.drives:
            name = system.topics[x.scope.topics[topic]].name
            state_by_signal |= dict(_equal_states(name, value, own))
    return state_by_signal


def _equal_states(
    name: str, e: typed.TypedExpr, own: Mapping[typed.Variable, str]
) -> Iterator[tuple[str, str]]:
    """Pairs of a driven signal and the plant's state that it equals, leaf by leaf."""
    if isinstance(e, typed.VarRead) and e.variable in own:
        for path, _ in leaves(e.type):
            yield leaf_name(name, path), leaf_name(own[e.variable], path)
    elif isinstance(e, typed.Aggregate) and isinstance(e.type, RecordType):
        order = e.order or range(len(e.elements))
        for i, part in zip(order, e.elements, strict=True):
            yield from _equal_states(f"{name}.{e.type.fields[i][0]}", part, own)
    elif isinstance(e, typed.Aggregate) and isinstance(e.type, ArrayType):
        for i, part in enumerate(e.elements):
            yield from _equal_states(f"{name}[{i}]", part, own)


def _visible_levels(
    numbers: npt.NDArray[np.float64], marks: tuple[Threshold, ...]
) -> tuple[Threshold, ...]:
    """The levels to draw; none where with them the signal would look like a flat line."""
    levels = [m.value for m in marks]
    if not marks or not numbers.size:
        return ()
    low, high = float(np.min(numbers)), float(np.max(numbers))
    whole = max(high, *levels) - min(low, *levels)
    return () if 0 < high - low < whole / SIGNAL_SHARE_MIN else marks


def _signals(
    name: str, t: Type, values: npt.NDArray[np.void], marks: tuple[Threshold, ...]
) -> Iterator[Series]:
    """The signals of a value: its numbers and bools (0, 1); coordinates share a panel."""
    if isinstance(t, (FloatType, IntType, BoolType)):
        unit = "" if isinstance(t, BoolType) else t.unit
        numbers = np.ascontiguousarray(values, dtype=np.float64)
        limits_in_sight, held = _visible_levels(numbers, marks), not isinstance(t, FloatType)
        yield Series(name, unit, numbers, panel=name, thresholds=limits_in_sight, held=held)
    elif isinstance(t, RecordType):
        together = {name_ for name_, _ in t.fields} <= AXES
        for name_, field_type in t.fields:
            for series in _signals(f"{name}.{name_}", field_type, values[name_], ()):
                yield replace(series, panel=name) if together else series
    elif isinstance(t, ArrayType) and t.size <= ELEMENTS_MAX:
        for index in range(t.size):
            for series in _signals(f"{name}[{index}]", t.element, values[:, index], ()):
                yield replace(series, panel=series.panel.replace(f"[{index}]", "", 1))
