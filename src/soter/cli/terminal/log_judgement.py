"""What each module says to a log of somebody else, for people and as JSON.

Purpose: when it would have switched, how near it came, what is missing, what is taken for granted.
Non-goals: the judgement (`monitor/logs/`), the command (`cli/monitor.py`).
"""

from __future__ import annotations

import textwrap
from math import isfinite
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Severity
from soter.report.sections import PageSection

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.cli.terminal.console import Console
    from soter.monitor.logs.result import LogJudgement, ModuleOfLog, NearestMargin

WIDTH = 100
CHANGES_SHOWN = 12
BOUNDS_SHOWN = 12
HEAD = ("module", "AC", "first switch", "switches", "least to ttf", "least to bounds of safe")


def undecided(m: ModuleOfLog) -> Diagnostic:
    """D017, as a warning: other modules are decided."""
    notes = tuple(f"missing: {name}" for name in m.missing)
    message = f"the log does not decide module `{m.module}`"
    return Diagnostic("D017", message, notes=notes, severity=Severity.WARNING)


# ---------------------------------------------------------------- for people


def lines(j: LogJudgement, console: Console) -> Iterator[str]:
    """The judgement as text."""
    yield f"{_judged_on(j)}\n"
    yield console.table(HEAD, _rows(j))
    for m in j.modules:
        yield f"\n{m.module}"
        yield from _of_module(m)
    yield from _of_log(j)
    yield "\nassumptions"
    for text in j.assumptions:
        yield from _item(text)


def sections(j: LogJudgement) -> Iterator[PageSection]:
    """The same for a page."""
    yield PageSection("What was judged", (_judged_on(j),), HEAD, tuple(_rows(j)))
    for m in j.modules:
        yield PageSection(m.module, tuple(text.strip() for text in _of_module(m)))
    of_log = tuple(text.strip() for text in _of_log(j))
    if of_log:
        yield PageSection("The log", of_log)
    yield PageSection("What this rests on", tuple(j.assumptions))


def _judged_on(j: LogJudgement) -> str:
    samples = ", ".join(f"{name} ({n:,})" if n else name for name, n in j.samples.items())
    return f"{j.log}  judged on reads from {j.from_s:.3f} s to {j.to_s:.3f} s: {samples}"


def _rows(j: LogJudgement) -> list[tuple[str, ...]]:
    return [
        (
            m.module,
            f"{m.ac_share:.1%}",
            "none" if m.first_switch_s is None else f"{m.first_switch_s:.3f} s",
            f"{len(m.switches):,}",
            _near(m.margin),
            _near(m.clearance),
        )
        for m in j.modules
        if m.decided
    ]


def _of_module(m: ModuleOfLog) -> Iterator[str]:
    if not m.decided:
        yield "  undecided; the log does not give"
        for name in m.missing:
            yield from _item(name)
        return
    fresh = max(1, m.fresh)
    yield (
        f"  {m.steps:,} steps of the DM: {m.stale:,} with reads too old, ttf in {m.ttf:,}, "
        f"safer in {m.safer:,}, outside of safe in {m.outside:,} ({m.outside / fresh:.1%})"
    )
    if m.faults:
        yield f"  a predicate faulted {m.faults:,} times; that counts as unsafe"
    if m.blind:
        yield f"  `safe` is not judged; it reads {', '.join(m.blind)}"
    for change in m.changes[:CHANGES_SHOWN]:
        yield f"  {change.time_s:9.3f} s  {change.to}  {change.reason}"
    if len(m.changes) > CHANGES_SHOWN:
        yield f"  ... and {len(m.changes) - CHANGES_SHOWN:,} more changes"
    near = sorted(m.bounds.values(), key=lambda n: n.distance)
    if near:
        yield "  least distance of each comparison of ttf, in its own unit"
    for n in near[:BOUNDS_SHOWN]:
        yield f"  {n.distance:9.3f} at {n.time_s:.3f} s  {n.bound}"
    if len(near) > BOUNDS_SHOWN:
        yield f"  ... and {len(near) - BOUNDS_SHOWN:,} further away"


def _of_log(j: LogJudgement) -> Iterator[str]:
    for title, counts in (("left out", j.left_out), ("refused by the gate", j.refused)):
        for name, (count, first) in counts.items():
            yield f"\n{title}: {count:,} samples of {name}; the first: {first}"
    for name, told in j.faulted.items():
        yield f"\n{name} faulted and latched: {told}"
    if j.derived:
        yield "\nderived (error: half, 95 %, all of it below)"
    for how in dict.fromkeys(d.how for d in j.derived):
        yield from _item(how)
        for d in j.derived:
            if d.how == how:
                yield f"      {d.name}  {d.error[0]:.2g}, {d.error[1]:.2g}, {d.error[2]:.2g}"


def _item(text: str) -> Iterator[str]:
    yield textwrap.fill(text, WIDTH, initial_indent="  - ", subsequent_indent="    ")


def _near(n: NearestMargin | None) -> str:
    if n is None or not isfinite(n.distance):
        return ""
    return f"{n.distance:.3f} at {n.time_s:.3f} s"


# ---------------------------------------------------------------- for programs


def as_json(j: LogJudgement) -> dict[str, object]:
    """The judgement as the JSON document has it."""
    return {
        "path": j.log,
        "from_s": j.from_s,
        "to_s": j.to_s,
        "samples": j.samples,
        "nodes": list(j.nodes),
        "derived": [{"name": d.name, "how": d.how, "error": list(d.error)} for d in j.derived],
        "constants": list(j.constants),
        "left_out": {n: {"samples": c, "first": f} for n, (c, f) in j.left_out.items()},
        "refused": {n: {"samples": c, "first": f} for n, (c, f) in j.refused.items()},
        "faulted": j.faulted,
        "assumptions": j.assumptions,
        "modules": {m.module: _module(m) for m in j.modules},
    }


def _module(m: ModuleOfLog) -> dict[str, object]:
    return {
        "decided": m.decided,
        "missing": list(m.missing),
        "safe_missing": list(m.blind),
        "steps": m.steps,
        "ac_share": m.ac_share if m.decided else None,
        "first_switch_s": m.first_switch_s,
        "switches": len(m.switches),
        "changes": [{"time_s": c.time_s, "to": c.to, "reason": c.reason} for c in m.changes],
        "stale": m.stale,
        "ttf": m.ttf,
        "safer": m.safer,
        "outside": m.outside,
        "first_outside_s": m.first_outside_s,
        "faults": m.faults,
        "margin": _nearest(m.margin),
        "clearance": _nearest(m.clearance),
        "bounds": [_nearest(n) for n in m.bounds.values()],
    }


def _nearest(n: NearestMargin | None) -> dict[str, object] | None:
    if n is None:
        return None
    distance = n.distance if isfinite(n.distance) else None
    return {"distance": distance, "time_s": n.time_s, "bound": n.bound}
