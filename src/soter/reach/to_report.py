"""A verification as a page that can be filed.

Purpose: results -> `report/proof.py`: properties, times, shares, the paper's regions R1 to R5 of
every group, assumptions, the trusted base, hashes.
Non-goals: the page's looks (`report/proof_page.py`).
"""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np

from soter.native.compiler import find
from soter.program.durations import show_ns
from soter.reach.leaving_figures import leaving_figures
from soter.reach.polytope_claims import inner_point
from soter.reach.regions import regions
from soter.reach.results import NO_CORE
from soter.report.proof import (
    R1,
    R2,
    R3,
    R4,
    R5,
    ModuleProof,
    ProofPage,
    PropertyRow,
    RegionFigure,
)
from soter.report.proof_page import write_proof

if TYPE_CHECKING:
    from pathlib import Path

    from soter.reach.results import (
        CaseSets,
        GroupSets,
        ModuleResult,
        PolytopePart,
        VerifyReport,
    )

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
    "DM": "the generated C of the decision module switches as docs/semantics.md says",
}
TRUSTED = (
    "Soter's front end and Core: both the proof and the code that flies come from them",
    "the enclosures and the set engine; `soter recheck` checks certificates without them",
    "the C compiler, the operating system and the hardware that run both",
)
SHARES = {
    "core": "core K, of the grid's volume",
    "free": "R(H): AC may have control here",
    "lets_ac": "`ttf` may be false: AC keeps control",
    "gives_back": "`safer` may be true: AC gets control back",
}


PIXELS = 160
"""Points a side of a polytope's figure."""


def write_report(found: VerifyReport, path: Path) -> Path:
    """Write the page."""
    return write_proof(page(found), path)


def page(found: VerifyReport) -> ProofPage:
    """The page as data."""
    names = ", ".join(m.name for m in found.modules) or "no module"
    assumptions = dict.fromkeys(a for m in found.modules for a in m.problem.assumptions)
    under = f", under {len(assumptions)} assumptions" if found.verdict == "proved" else ""
    taken = {n for m in found.modules for n, f in m.findings.items() if f.verdict == "assumed"}
    under += f" ({', '.join(sorted(taken))} assumed)" if under and taken else ""
    return ProofPage(
        f"Verification of {found.path}",
        f"{names}: {found.verdict}{_but(found)}{under}",
        f"system {found.system}, {found.seconds:.1f} s",
        tuple(_module(m) for m in found.modules),
        tuple(assumptions),
        TRUSTED,
        {
            "command": found.command,
            "program": found.path,
            "program sha256": found.program_sha256,
            "soter": version("soter"),
            "C compiler": find().identity,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
    )


def _but(found: VerifyReport) -> str:
    """What the headline of a proof must not leave out."""
    little = [m for m in found.modules if m.headline != m.verdict and m.vacuity is not None]
    if found.verdict not in ("proved", "assumed") or not little:
        return ""
    several = len(found.modules) > 1
    said = [
        f"{m.name}: {m.vacuity.text}" if several else m.vacuity.text for m in little if m.vacuity
    ]
    return f", but {'; '.join(said)}"


def _module(m: ModuleResult) -> ModuleProof:
    rows = tuple(
        PropertyRow(name, MEANINGS.get(name, ""), f.verdict, f.method, f.seconds, f.text)
        for name, f in m.findings.items()
    )
    runs = [f.counterexample for f in m.findings.values() if f.counterexample is not None]
    undecided = [
        ": ".join(filter(None, (name, f.text, *map(str, f.regions[:3]), f.hint)))
        for name, f in m.findings.items()
        if f.verdict == "undecided" and f.text != NO_CORE
    ]
    undecided += [c.text for n, f in m.findings.items() if n != "P3" for c in f.causes]
    leaving = next((f.leaving for f in m.findings.values() if f.leaving is not None), None)
    return ModuleProof(
        m.name,
        m.verdict,
        f"{len(m.problem.assumptions)} assumptions, {m.cells:,} cells, {m.seconds:.1f} s"
        + (f"; {m.at_the_start}" if m.at_the_start else ""),
        rows,
        _times(m),
        tuple((SHARES[k], f"{v:.1%}") for k, v in m.shares.items() if k in SHARES),
        tuple(f for case in m.cases[:1] for f in _figures(m, case)),
        tuple(line for run in runs for line in str(run).splitlines()),
        tuple(undecided),
        m.vacuity.text if m.headline != m.verdict and m.vacuity is not None else "",
        tuple(leaving_figures(m, leaving)) if leaving is not None else (),
        str(leaving) if leaving is not None else "",
    )


def _times(m: ModuleResult) -> tuple[tuple[str, str, str], ...]:
    t = m.problem.times
    found = [
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
    return tuple((symbol, meaning, show_ns(ns)) for symbol, meaning, ns in found)


# ---------------------------------------------------------------- regions


def _figures(m: ModuleResult, case: CaseSets) -> list[RegionFigure]:
    names = [p.name for p in m.problem.parameters]
    note = ", ".join(f"{n} = {v}" for n, v in zip(names, case.parameter, strict=True))
    figures = [_figure(s, note) for s in case.groups]
    for part in case.polytopes:
        figures += _slice(part, note)
    return figures


def _slice(part: PolytopePart, note: str) -> list[RegionFigure]:
    """A polytope's regions over its first two states, the others in the middle of K."""
    sets, axes = part.sets, part.group.axes
    if sets is None or (centre := inner_point(sets.core)) is None:
        return []
    edges = [np.linspace(a.edges[0], a.edges[-1], PIXELS + 1) for a in axes[:2]]
    middles = [(e[:-1] + e[1:]) / 2 for e in edges]
    points = np.tile(centre, (PIXELS ** len(edges), 1))
    for k, values in enumerate(np.meshgrid(*middles, indexing="ij")):
        points[:, k] = values.ravel()
    found = np.full(len(points), R1, dtype=np.uint8)
    low, high = np.array(part.limits).T
    found[((points >= low) & (points <= high)).all(axis=1)] = R2
    for region, p in ((R3, sets.core), (R4, sets.free)):
        found[p.contains(points)] = region
    if sets.allowed:
        found[sets.free.contains(points) & sets.safer.contains(points)] = R5
    cuts = [f"{a.name} = {x:.4g}" for a, x in zip(axes[2:], centre[2:], strict=True)]
    text = "; ".join(filter(None, (note, ", ".join(cuts), "drawn from half-spaces, by points")))
    regions = found.reshape([PIXELS] * len(edges))
    if len(axes) == 1:
        y = np.array([0.0, 1.0])
        return [RegionFigure(axes[0].name, axes[0].name, "", edges[0], y, regions[:, None], text)]
    title = f"{axes[0].name} and {axes[1].name}"
    return [RegionFigure(title, axes[0].name, axes[1].name, edges[0], edges[1], regions, text)]


def _figure(sets: GroupSets, note: str) -> RegionFigure:
    """The first two axes; further ones are cut where the state is nearest to the middle."""
    axes = sets.group.axes
    found = regions(sets)
    cuts: list[str] = []
    for k, axis in enumerate(axes[2:]):
        edges = np.asarray(axis.edges)
        middle = int(np.argmin(np.abs((edges[:-1] + edges[1:]) / 2.0)))
        found = np.take(found, [middle], axis=2).reshape(*found.shape[:2], *found.shape[3:])
        cuts.append(f"{axes[2 + k].name} in [{edges[middle]:.4g}, {edges[middle + 1]:.4g}]")
    text = "; ".join(filter(None, (note, ", ".join(cuts))))
    x = np.asarray(axes[0].edges)
    if len(axes) == 1:
        return RegionFigure(
            axes[0].name, axes[0].name, "", x, np.array([0.0, 1.0]), found[:, None], text
        )
    y = np.asarray(axes[1].edges)
    title = f"{axes[0].name} and {axes[1].name}"
    return RegionFigure(title, axes[0].name, axes[1].name, x, y, found, text)
