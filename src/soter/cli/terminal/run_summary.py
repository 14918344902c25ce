"""The summary of a run, for a person at a terminal.

Purpose: `run_summary` prints the verdict first, then what went wrong, who was in control when, and
what the verdict rests on; for a run in real time also how late it was, which releases were missed,
how workers fared, and who took over and why.
Non-goals: figures for programs (`simulate/run_fields.py`); measuring real time
(`runtime/posix/soter_posix_report.c`).
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.load.named_files import CLIP, binding_of
from soter.report.tables import Entry, Styled, display_width, mode_timeline
from soter.report.wording import changed_parameters, visible
from soter.semantics.faults import begin_times
from soter.simulate.result import Run, silence_words
from soter.simulate.result_assumptions import run_assumptions
from soter.simulate.run_fields import component_faults

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.cli.terminal.console import Console

    Timing = dict[str, Any]


WIDTH = 34


def timing_lines(timing: Timing) -> list[str]:
    """Lines on a run in real time, from the driver's report (docs/json.md)."""
    return [
        *_timing_head_lines(timing),
        *_histogram_lines(timing),
        *_worker_lines(timing),
        *_takeover_lines(timing),
        *_lease_lines(timing),
    ]


def _timing_head_lines(timing: Timing) -> Iterator[str]:
    memory = "memory locked" if timing["locked"] else "memory not locked"
    core = f"processor {timing['core']}" if timing["core"] >= 0 else "not pinned"
    yield f"real time  policy {timing['policy']}, {memory}, {core}"
    faults = timing["page_faults"] + timing["major_page_faults"]
    yield (
        f"  {timing['instants']} instants, {timing['late_instants']} with misses, "
        f"{timing['late_untrusted_instants']} in which only plants or ACs were late"
    )
    yield (
        f"  {timing['misses']} misses ({timing['misses_allowed']} are allowed), "
        f"{faults} page faults, {timing['dropped']} records dropped"
    )
    silence, after = timing["silence_ns"] / 1e6, timing["silence_after_ns"] / 1e9
    yield f"  longest silence {silence:.1f} ms, after {after:.3f} s"
    if timing["misses"]:
        yield from (f"    {words}" for words in silence_words(timing))
    yield from (f"  note: {text}" for text in timing["notes"])


def _histogram_lines(timing: Timing) -> Iterator[str]:
    yield f"  {'lateness, µs':<{WIDTH}}{'p50':>9} {'p99':>9} {'p99.9':>9} {'max':>9}"
    yield _histogram_row("wake-up, nothing to do", timing["bare"])
    yield _histogram_row("instants", timing["wake"])
    for name, node in timing["nodes"].items():
        if not node["release"]["count"]:
            continue  # of a process of its own
        yield _histogram_row(f"{name} begins", node["release"])
        yield _histogram_row(f"{name} complete", node["completion"])
        if late := [f"{node[k]} {k.replace('_', ' ')}" for k in _LATE if node[k]]:
            yield f"    {', '.join(late)}"


_LATE = ("released_late", "completed_late")


def _histogram_row(name: str, h: dict[str, Any]) -> str:
    figures = " ".join(f"{h[k] / 1e3:>9.1f}" for k in ("p50_ns", "p99_ns", "p999_ns", "max_ns"))
    return f"  {name:<{WIDTH}}{figures}"


def _worker_lines(timing: Timing) -> Iterator[str]:
    for name, w in timing["workers"].items():
        yield (
            f"  worker {name}: {w['answered']} of {w['asked']} answered, {w['later']} of them "
            f"after the next instant, {w['missing']} missing, {w['failed']} failed; "
            f"{w['starts']} starts"
        )


def _takeover_lines(timing: Timing) -> Iterator[str]:
    for name, module in timing["modules"].items():
        if causes := [f"{n} by {cause}" for cause, n in module["takeovers"].items() if n]:
            yield f"  takeovers {name}: {', '.join(causes)}"


def _lease_lines(timing: Timing) -> Iterator[str]:
    for name, of in timing["leases"].items():
        text = f"  leases {name}: {of['given']} given"
        ended = of["ended_ns"]
        yield text if ended is None else f"{text}, none from {ended / 1e9:g} s on: the law"


TIMES = "\N{MULTIPLICATION SIGN}"
TIMELINE_MAX = 72
TIMELINE_MIN = 20
DECISIONS_MAX = 40
COLUMNS_A_TAKEOVER = 3
"""Columns that a timeline needs for each takeover; with fewer it is not drawn."""


def run_summary(run: Run, path: str, console: Console, *, why: bool = False) -> str:
    """The summary of a run as text; with `why` also each change of mode, with the values then."""
    sections = [
        [
            _headline(run, path, console),
            *_parameter_lines(run, console),
            *_verdict_lines(run, console),
        ],
        list(_violation_lines(run, console)),
        list(_fault_lines(run, console)),
        _declared_fault_lines(run, console),
        timing_lines(run.timing) if run.timing else [],
        [f"{console.paint('yellow', 'note')}  {text}" for text in run.notes],
        _module_lines(run, console),
        list(_timeline_lines(run, console)),
        list(_decision_lines(run, console)) if why else [],
        list(_proof_lines(run, console)),
    ]
    return "\n\n".join("\n".join(lines) for lines in sections if lines)


def _headline(run: Run, path: str, console: Console) -> str:
    speed = run.reached_s / run.wall_s if run.wall_s > 0 else 0.0
    how = f"{run.engine}, {_time_text(run.wall_s)}"
    if run.lag_s_max is None and run.engine != "recorded":
        how += f" ({_factor_text(speed)} {TIMES} real time)"
    how += ", in real time" if run.timing else ", paced" if run.lag_s_max is not None else ""
    facts = f"{visible(path)}  {run.system.name}, seed {run.seed}, {run.duration_s:g} s  {how}"
    return console.paint("muted", facts)


def _parameter_lines(run: Run, console: Console) -> Iterator[str]:
    """A line with the parameters that do not have their default values."""
    if changes := changed_parameters(run.system):
        texts = [
            f"{name} = {value} (default {default})" for name, (value, default) in changes.items()
        ]
        yield console.paint("muted", f"params  {', '.join(texts)}")


def _verdict_lines(run: Run, console: Console) -> list[str]:
    lines = []
    if run.interrupted:
        at = f"stopped at {run.reached_s:.3f} s of {run.duration_s:g} s"
        so_far = "" if run.violations else ", no violation until then"
        lines.append(f"{console.paint('yellow', 'INTERRUPTED')}  {at}{so_far}")
    if run.cut:
        lines.append(
            f"{console.paint('yellow', 'CUT')}  read up to {run.reached_s:.9g} s: {run.cut}"
        )
    properties = len(run.system.properties)
    if run.violations:
        count = f"{run.violations} violation{'s' if run.violations > 1 else ''}"
        lines.append(f"{console.paint('red', 'VIOLATED')}  {count}")
    elif run.interrupted or run.cut:
        pass
    elif properties == 0:
        lines.append(f"{console.paint('yellow', 'NOTHING ASKED')}  the system states no property")
    else:
        noun = "the property holds" if properties == 1 else f"all {properties} properties hold"
        lines.append(f"{console.paint('green', 'no violation in this run')}  {noun}")
    lines += _reservation_lines(run, console)
    return lines


def _reservation_lines(run: Run, console: Console) -> Iterator[str]:
    """Lines on all that limits the verdict: unproved modules, lateness, externs without answers."""
    for m in run.system.modules:
        if m.unshown:
            text = f"`{m.name}` flew by what is not shown of its rest: {m.unshown}"
            yield f"{console.paint('yellow', 'NOT SHOWN')}  {text}"
    if run.late:
        yield f"{console.paint('yellow', 'LATE')}  the trusted part was: see the note"
    for name, steps in run.never_answered.items():
        word = console.paint("yellow", "NEVER ANSWERED")
        yield f"{word}  `{name}` failed in each of {steps} steps: nothing of it was tried"
    if run.lag_s_max is not None and not run.timing:
        late = f"no instant was more than {_time_text(run.lag_s_max)} late"
        why = f" ({run.paced})" if run.paced else ""
        yield f"paced by the virtual-time driver, not the real-time runtime{why}: {late}"


def _violation_lines(run: Run, console: Console) -> Iterator[str]:
    cross = "x" if console.ascii_only else TIMES
    for v in run.violation_list:
        first = "" if v.time_s is None else f"at {v.time_s:.3f} s"
        often = f", the first of {v.count} times" if v.count > 1 else ""
        where = f"{v.span.source.name}:{v.span.line}" if v.span is not None else ""
        yield f"  {console.paint('red', cross)} {v.what}"
        yield console.paint("muted", f"    {first}{often}  {where}".rstrip())


def _fault_lines(run: Run, console: Console) -> Iterator[str]:
    """Lines for step faults of each component, with the message of an extern."""
    faults = component_faults(run)
    if not faults:
        return
    yield "step faults"
    for name, of in faults.items():
        since = "" if of.first_s is None else f", the first at {of.first_s:.3f} s"
        message = run.extern_failures.get(name)
        yield f"  {name}: {of.count} {TIMES} `{of.last}`{since}"
        if message:
            yield console.paint("muted", f"    {message}")
        binding = binding_of(run.externs.get(name, ""))
        if of.last == "range" and binding and binding.kind == "onnx" and not binding.is_clipped:
            clipped = f"{binding}{',' if binding.name else ':'}{CLIP}"
            yield console.paint("muted", f"    `{clipped}` puts answers at the ends of their sets")


def _declared_fault_lines(run: Run, console: Console) -> list[str]:
    """A table of the effects that the system's `faults` had in this run."""
    rows: dict[tuple[str, int], tuple[str, ...]] = {}
    until_ns = round(run.reached_s * 1e9)
    for f in run.system.faults:
        key = (f.text, f.component if f.stream and f.slot_ns == 0 else -1)
        if f.on is not None or key in rows:
            continue
        when = begin_times(f, run.system.components[f.component], run.seed, until_ns)
        always = f.kind == "late" and f.slot_ns == 0
        times = "every release" if always else str(len(when))
        first = f"{when[0] / 1e9:.3f} s" if when else ""
        rows[key] = (f.text, times, first, "inside" if f.inside else "outside")
    if run.system.shuffled:
        rows["order any", -1] = ("order any", "every instant", "", "outside")
    if not rows:
        return []
    heads = ("went wrong on purpose", "times", "first at", "proofs")
    return [console.table(heads, list(rows.values()))]


def _module_lines(run: Run, console: Console) -> list[str]:
    if not run.modules:
        return []
    rows: list[list[Entry]] = []
    for name, m in run.modules.items():
        faults: Entry = Styled(str(m.gate_faults), "bad" if m.gate_faults else "plain")
        share = f"{100 * m.ac_share:.1f} %"
        rows.append([name, share, m.switches_to_ac, m.switches_to_sc, faults])
    arrow = "->" if console.ascii_only else "→"
    headers = ("module", "AC share", f"SC{arrow}AC", f"AC{arrow}SC", "gate faults")
    return [console.table(headers, rows)]


def _decision_lines(run: Run, console: Console) -> Iterator[str]:
    """Lines for each change of mode, up to `DECISIONS_MAX`, with its reason."""
    decisions = run.decisions
    arrow = "->" if console.ascii_only else "→"
    if decisions:
        yield "decisions"
    for d in decisions[:DECISIONS_MAX]:
        yield f"  {d.time_ns / 1e9:9.3f} s  {d.module}  {d.before}{arrow}{d.after}  {d.reason}"
        for text in d.words:
            yield console.paint("muted", f"{'':15}{text}")
    if len(decisions) > DECISIONS_MAX:
        yield console.paint("muted", f"  and {len(decisions) - DECISIONS_MAX} more: --json, --log")


def _timeline_lines(run: Run, console: Console) -> Iterator[str]:
    names = [m.name for m in run.system.modules]
    if not names or run.reached_s <= 0:
        return
    label = max(display_width(n) for n in names)
    columns = shutil.get_terminal_size((100, 24)).columns
    width = max(TIMELINE_MIN, min(columns - label - 3, TIMELINE_MAX))
    for index, name in enumerate(names):
        time_s, in_control = _mode_changes(run, index)
        if run.modules[name].switches_to_sc > width // COLUMNS_A_TAKEOVER:
            yield f"{name}{' ' * (label - display_width(name))}  too many takeovers to draw"
            continue
        bar = mode_timeline(time_s, in_control, width, ascii_only=console.ascii_only)
        yield f"{name}{' ' * (label - display_width(name))}  {bar}"
    end = f"{run.reached_s:g} s"
    yield console.paint("muted", f"{' ' * label}  0{end.rjust(width - 1)}")


def _mode_changes(run: Run, module: int) -> tuple[np.ndarray, np.ndarray]:
    """Times in s of start, changes and end, and whether AC is in control from each: (n,), (n,)."""
    forced_ac = run.system.modules[module].forced == "ac"
    changes = [(c.time_ns / 1e9, c.to == "AC") for c in run.changes if c.module == module]
    points = [(0.0, forced_ac), *changes]
    points.append((run.reached_s, points[-1][1]))
    return np.array([t for t, _ in points]), np.array([ac for _, ac in points])


def _proof_lines(run: Run, console: Console) -> Iterator[str]:
    if lines := run_assumptions(run.system, run.proofs):
        yield "rests on"
        for line in lines:
            yield console.paint("muted", f"  {line}")


def _time_text(seconds: float) -> str:
    if seconds < 1e-3:
        return f"{seconds * 1e6:.0f} µs"
    return f"{seconds * 1e3:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"


def _factor_text(x: float) -> str:
    return f"{float(f'{x:.2g}'):,.0f}" if x >= 10 else f"{x:.1f}"
