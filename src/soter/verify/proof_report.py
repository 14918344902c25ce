"""Makes the record of a page that can be filed (`report/proof_page.py`) from the prover's results.

Purpose: `proof_page` makes the record of results: properties, times, shares, the paper's regions R1
to R5 of every group, assumptions, the trusted base, hashes. `leaving_figures` draws the run of the
model that leaves C soonest: over time, along the axis by which it leaves, and in the plane of two
axes of its group. Both show C at the cells in which the run starts.
Non-goals: the page's looks (`report/proof_page.py`); finding the run (`diagnosis/model_runs.py`).
"""

from __future__ import annotations

import platform
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.assumption_words import numbered_assumptions
from soter.language.model.types import show_ns
from soter.native.compiler import compiler_version, find_compiler
from soter.report.proof_page import (
    R1,
    R2,
    ModuleProof,
    ProofPage,
    PropertyRow,
    RegionFigure,
    TakenRow,
    Trajectory,
    proof_document,
    write_proof,
)
from soter.verify.claims.results import ASSUMED, NO_CORE, PROVED, REGIONS_SHOWN
from soter.verify.grid.set_figures import region_of_each_cell
from soter.verify.problem.problem import NODES, TUBES, assumption_texts
from soter.verify.scope import composed_assumptions_of
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from soter.core.layout import Floats
    from soter.verify.claims.results import (
        CaseSets,
        GroupSets,
        LeavingRun,
        ModuleResult,
        VerifyReport,
    )


ROOM = 0.06
"""The margin beyond the grid that is drawn, as a share of the grid; the run ends there."""


def leaving_figures(m: ModuleResult, run: LeavingRun | None) -> Iterator[RegionFigure]:
    """Figures of a run that leaves: over time, and over two states if its group has two."""
    if run is None:
        return
    axis = run.names.index(run.axis)
    sets = next(
        (
            g
            for c in m.cases
            if c.parameter == run.parameter
            for g in c.groups
            if axis in {a.state for a in g.group.axes}
        ),
        None,
    )
    if sets is None:
        extent = m.problem.states[axis]
        edges, inside = np.array([extent.low, extent.high]), np.array([R2], dtype=np.uint8)
    else:
        k = [a.state for a in sets.group.axes].index(axis)
        edges = np.asarray(sets.group.axes[k].edges)
        inside = np.moveaxis(region_of_each_cell(sets), k, 0)
        inside = _slice_through(inside, 1, _start_indices(sets, run, (k,)))
    edges, inside = _cells_with_margin(edges, inside)
    end = float(run.time_s[-1])
    time = np.array([0.0, end * (1 + ROOM)])
    states = np.clip(run.states[:, axis], edges[0], edges[-1])
    none = np.zeros(len(states), dtype=np.bool_)
    drawn = Trajectory(run.time_s, states, none, leaves=True)
    yield RegionFigure(
        title=f"{run.axis} over time",
        x_name="time",
        x_unit="s",
        y_name=run.axis,
        y_unit=m.problem.quantities.states[axis].unit,
        x_edges=time,
        y_edges=edges,
        regions=inside[None, :],
        note="",
        trajectory=drawn,
    )
    if sets is not None and len(sets.group.axes) > 1:
        yield _figure_of_plane(sets, run, axis)


def _start_indices(sets: GroupSets, run: LeavingRun, without: tuple[int, ...]) -> tuple[int, ...]:
    """The indices of the start's cell along the axes that are not in `without`."""
    indices = []
    for k, a in enumerate(sets.group.axes):
        if k not in without:
            i = int(np.searchsorted(a.edges, run.states[0][a.state], side="right")) - 1
            indices.append(min(max(i, 0), len(a.edges) - 2))
    return tuple(indices)


def _slice_through(cells: NDArray[np.uint8], axis: int, at: tuple[int, ...]) -> NDArray[np.uint8]:
    """The cells at the indices `at` of the axes from `axis` on."""
    for i in at:
        cells = np.take(cells, i, axis=axis)
    return cells


def _cells_with_margin(edges: Floats, cells: NDArray[np.uint8]) -> tuple[Floats, NDArray[np.uint8]]:
    """Edges and cells with a margin outside the grid, along the first axis."""
    room = ROOM * (edges[-1] - edges[0])
    outside = np.full((1, *cells.shape[1:]), R1, dtype=np.uint8)
    wider = np.concatenate([[edges[0] - room], edges, [edges[-1] + room]])
    return wider, np.concatenate([outside, cells, outside])


def _figure_of_plane(sets: GroupSets, run: LeavingRun, axis: int) -> RegionFigure:
    """The figure over the axis by which the run leaves and the first other axis of its group."""
    axes = sets.group.axes
    k = [a.state for a in axes].index(axis)
    other = 0 if k else 1
    first, second = sorted((k, other))
    cells = np.moveaxis(region_of_each_cell(sets), (first, second), (0, 1))
    cells = _slice_through(cells, 2, _start_indices(sets, run, (first, second)))
    x, cells = _cells_with_margin(np.asarray(axes[first].edges), cells)
    y, turned = _cells_with_margin(np.asarray(axes[second].edges), cells.T)
    xs = np.clip(run.states[:, axes[first].state], x[0], x[-1])
    ys = np.clip(run.states[:, axes[second].state], y[0], y[-1])
    none = np.zeros(len(xs), dtype=np.bool_)
    names = axes[first].name, axes[second].name
    title, drawn = f"{names[0]} and {names[1]}", Trajectory(xs, ys, none, leaves=True)
    return RegionFigure(
        title, *names, x, y, turned.T, trajectory=drawn, x_unit=axes[first].unit,
        y_unit=axes[second].unit,
    )  # fmt: skip


HOLDING = (PROVED, ASSUMED)
MEANINGS = {
    "P1a": "AC and SC step at least as often as the decision module",
    "P1b": "AC and SC publish the same topics",
    "P1c": "SC's first output acts before the time that AC may use up has passed: H ≥ H*",
    "P2a": "from every state of the core K, SC keeps the constraint C for ever",
    "P2b": "from every state of K, SC reaches a time at which the DM gives control back",
    "P3": "when AC has control, the state stays in K for H, whatever is published",
    "ttf": "whenever `ttf` may be false, the state lies in R(H)",
    "safer": "whenever `safer` may be true, the state lies in R(H)",
    "start": "the declared initial states are among those for which all this holds",
    "failsafe": "once the lease has ended the fail-safe law keeps the constraint C for ever",
    "DM": "the generated C of the decision module switches as docs/semantics.md says: "
    "checked for all facts, tried on inputs",
}
OF_SETS = "the enclosures and the set engine; `soter recheck` checks certificates without them"
OF_INDUCTION = "z3, and how Core is read for it; `soter recheck` asks z3, too, but reads Core anew"
OF_TUBES = (
    "how SC is followed (`verify/tubes/`), which also decides in flight: tested, and checked by "
    "nobody else"
)
TRUSTED = {NODES: OF_INDUCTION, TUBES: OF_TUBES}
BY_INDUCTION = {
    "P1c": "every order of steps that the times allow is part of the proof",
    "P2a": "`safe` holds for ever, whatever AC publishes of its declared sets",
    "P2b": "where SC has control, a time comes at which the DM gives it back",
    "P3": "when AC has control, `safe` holds until the DM and SC have answered",
    "ttf": "whenever the DM leaves AC in control, `safe` goes on holding",
    "safer": "whenever the DM gives AC control, `safe` goes on holding",
}
BY_TUBES = {
    "P2a": "from wherever `rest` holds SC keeps `safe` for ever, and moves what it may",
    "P2b": "SC comes to rest, and a time comes at which the DM gives control back",
    "P3": "when AC has control, SC could still lead from the state to rest, `safe` all the way",
    "ttf": "whenever `ttf` may be false, it could for H longer",
    "safer": "whenever `safer` may be true, it could for H longer",
    "start": "from the declared initial states SC leads to rest, `safe` all the way",
}
OTHERWISE = {NODES: BY_INDUCTION, TUBES: BY_TUBES}
"""The words that differ for proofs without sets of states, by kind of problem."""
SHARES = {
    "core": "core K, of the grid's volume",
    "free": "R(H): AC may have control here",
    "lets_ac": "`ttf` may be false: AC keeps control",
    "gives_back": "`safer` may be true: AC gets control back",
    "estimates": "S_0, of the estimates, which leave AC in control",
}


def write_report(report: VerifyReport, path: Path) -> Path:
    """Writes the page of a report; raises `SoterError` D006 if it cannot be written."""
    return write_proof(proof_page(report), path)


def page_text(report: VerifyReport) -> str:
    """The page as one HTML text."""
    return proof_document(proof_page(report))


def proof_page(report: VerifyReport) -> ProofPage:
    """The data of a report's page."""
    names = ", ".join(_module_names(report)) or "no module"
    assumptions = assumption_texts(a for m in report.modules for a in m.assumptions)
    under = f", under {len(assumptions)} assumptions" if report.verdict == "proved" else ""
    taken = {n for m in report.modules for n in m.assumed}
    under += f" ({', '.join(sorted(taken))} assumed)" if under and taken else ""
    return ProofPage(
        f"Verification of {report.path}",
        f"{names}: {report.verdict}{_vacuity_clause(report)}{under}",
        f"system {report.system}, verified in {report.seconds:.1f} s",
        tuple(_module_proof(m) for m in report.modules),
        tuple(f"{number}: {text}" for text, number in numbered_assumptions(assumptions).items()),
        _trusted_base(report),
        not_covered=tuple(report.coverage.rest),
        provenance={
            "command": report.command,
            "program": report.path,
            "program sha256": report.program_sha256,
            "soter": VERSION,
            "C compiler": compiler_version(find_compiler()),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        together=report.together if report.composed else "",
        taken=tuple(
            TakenRow(t.module, t.what, t.why, t.open) for t in composed_assumptions_of(report)
        ),
    )


def _module_names(report: VerifyReport) -> list[str]:
    """The names of the modules; a module that is proved in views is named once."""
    views = Counter(m.name.removesuffix(f" as {m.problem.view}") for m in report.modules)
    viewed = any(m.problem.view for m in report.modules)
    return [f"{name} in {n} views" if viewed and n > 1 else name for name, n in views.items()]


def _trusted_base(report: VerifyReport) -> tuple[str, ...]:
    engines = dict.fromkeys(TRUSTED.get(m.problem.kind, OF_SETS) for m in report.modules)
    return (
        "Soter's front end and Core: both the proof and the code that flies come from them",
        *engines,
        "the C compiler, the operating system and the hardware that run both",
    )


def _vacuity_clause(report: VerifyReport) -> str:
    """A clause for the headline on modules with vacuous proofs; "" without such modules."""
    held = [m for m in report.modules if m.verdict in HOLDING]
    little = [m for m in held if m.vacuity is not None]
    if report.verdict not in ("proved", "assumed") or not little:
        return ""
    several = len(report.modules) > 1
    texts = [
        f"{m.name}: {m.vacuity.text}" if several else m.vacuity.text for m in little if m.vacuity
    ]
    return f", but {'; '.join(texts)}"


def _module_proof(m: ModuleResult) -> ModuleProof:
    meanings = {**MEANINGS, **OTHERWISE.get(m.problem.kind, {})}
    methods = {n: "none" if f.verdict == ASSUMED else f.method for n, f in m.findings.items()}
    rows = tuple(
        PropertyRow(name, meanings.get(name, ""), f.verdict, methods[name], f.seconds, f.text)
        for name, f in m.findings.items()
    )
    runs = filter(None, (f.counterexample for f in m.findings.values()))
    run_texts = dict.fromkeys(map(str, runs))  # one run may refute several
    leaving = next(filter(None, (f.leaving for f in m.findings.values())), None)
    return ModuleProof(
        name=m.name,
        verdict=m.verdict,
        headline=_headline(m),
        properties=rows,
        times=_time_rows(m),
        shares=tuple((SHARES[k], f"{v:.1%}") for k, v in m.shares.items() if k in SHARES),
        figures=tuple(f for case in m.cases[:1] for f in _region_figures(m, case)),
        counterexample=tuple(line for run in run_texts for line in run.splitlines()),
        open=tuple(_open_properties(m)),
        switches=all(f.holds for n, f in m.findings.items() if n in ("ttf", "P3")),
        but=m.vacuity.text if m.verdict in HOLDING and m.vacuity else "",
        leaving=tuple(leaving_figures(m, leaving)),
        leaving_text=str(leaving or ""),
    )


def _headline(m: ModuleResult) -> str:
    lines = "".join(f"; {line}" for line in (m.at_the_start, *m.notes) if line)
    safe = m.problem.module.symbol.safe.span.text_on_one_line
    head = f"{_safety_in_words(m)} `{safe}`{m.verdict_note}; {len(m.assumptions)} assumptions, "
    cells = f"{m.cells:,} cells, " if m.cells else ""
    return f"{head}{cells}{m.seconds:.1f} s{lines}"


def _safety_in_words(m: ModuleResult) -> str:
    """The words on whether `safe` is kept, without regard to P2b and the fail-safe law."""
    shown = all(f.holds for n, f in m.findings.items() if n not in ("P2b", "failsafe"))
    return "keeps" if shown else "not shown: that it keeps"


def _open_properties(m: ModuleResult) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Each property that is not shown, with lines of reasons and advice as in the terminal."""
    texts_told = [NO_CORE]
    for name in ("P2a", "ttf", "safer", *m.findings):
        f = m.findings[name]
        if f.holds or f.text in texts_told:
            continue
        texts_told.append(f.text)  # P3 fails like one of `ttf` and `safer`
        lines = [f"where: {region}" for region in f.regions[:REGIONS_SHOWN]]
        rest = len(f.regions) - REGIONS_SHOWN
        lines += [f"and {rest} more such places"] if rest > 0 else []
        lines += [f"why: {c.text}" for c in f.causes]
        lines += [f"tried: {text}" for text in f.tried]
        lines += [f"help: {f.hint}"] if f.hint else []
        lines += [f"costs: {f.cost}"] if f.cost is not None else []
        if lines:
            yield f"{name} is {f.verdict}: {f.text}", tuple(lines)


def _time_rows(m: ModuleResult) -> tuple[tuple[str, str, str], ...]:
    t = m.problem.times
    if m.problem.kind == NODES:
        return (
            ("Δ", "period of the DM", show_ns(t.delta_dm)),
            ("δ", "period of SC", show_ns(t.delta_sc)),
        )
    rows = [
        ("Δ", "period of the DM", t.delta_dm),
        ("δ", "period of SC", t.delta_sc),
        ("A", "age of what the DM reads, enforced", t.age_dm),
        ("A_sc", "age of what SC reads, assumed", t.age_sc),
        ("J_dm, J_sc", "lateness", max(t.late_dm, t.late_sc)),
        ("R_dm, R_sc", "response", max(t.response_dm, t.response_sc)),
        ("L", "until a command acts", t.acts),
        ("H", "horizon", t.horizon_ns),
        ("H*", "needed", t.h_star),
    ]
    return tuple((symbol, meaning, show_ns(ns)) for symbol, meaning, ns in rows)


def _region_figures(m: ModuleResult, case: CaseSets) -> list[RegionFigure]:
    names = [p.name for p in m.problem.parameters]
    note = ", ".join(f"{n} = {v}" for n, v in zip(names, case.parameter, strict=True))
    if len(m.cases) > 1:
        note += f", the first of {len(m.cases)} values of parameters; the others are not drawn"
    return [f for proof in case.proofs for f in proof.region_figures(note)]
