"""Prints how each module judges a log of another system, for people and as JSON.

Purpose: says when a module would have switched, how near it came, what is missing and assumed.
Non-goals: the judgement (`monitor/`), the command (`cli/monitor.py`).
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from soter.diagnostics.command_records import JsonObject, one_of
from soter.diagnostics.diagnostic import Diagnostic, Severity
from soter.diagnostics.render import safe
from soter.report.judged_curves import drawing_html
from soter.report.templates import PageSection

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.cli.terminal.console import Console
    from soter.monitor.log_judgement import LogJudgement, ModuleOfLog, NearestMargin
    from soter.monitor.typed_samples import DerivedValue

WIDTH = 100
CHANGES_SHOWN = 12
BOUNDS_SHOWN = 12
NOTHING = "nothing was judged, and that is no verdict"
NOT_READ = "that came too late, that the gate refused or no step read"
HEAD = (
    "module", "judged", "AC", "first switch", "switches", "least to ttf", "least to bounds of safe",
)  # fmt: skip
PAGE_HEAD = (
    "module",
    "judged",
    "time in AC",
    "first takeover by SC",
    "takeovers by SC",
    "least distance to `ttf`",
    "least distance to bounds of `safe`",
)
DISTANCES = (
    "Distances are those of comparisons in the predicates, each in its own unit; below 0 the "
    "comparison is on the other side."
)
ERRORS = "Errors of values that the log does not have, each in the unit of its value."
ERRORS_SHARES = ("half of errors below", "95 % below", "all below")
ERRORS_HEAD = ("value", *ERRORS_SHARES, "how")
BOUNDS_HEAD = ("least distance", "at", "comparison")


def undecided_warning(m: ModuleOfLog) -> Diagnostic:
    """The warning D017 for a module on which the log does not allow a verdict."""
    notes = tuple(f"missing: {name}" for name in m.missing)
    message = f"the log does not decide module `{m.module}`"
    return Diagnostic("D017", message, notes=notes, severity=Severity.WARNING)


# ---------------------------------------------------------------- for people


def judgement_lines(j: LogJudgement, console: Console) -> Iterator[str]:
    """Yields the lines of the judgement for the terminal."""
    yield f"{_judged_span_text(j)}\n"
    for m in j.modules:
        yield f"{m.module}: {verdict_line(m)}\n"
    yield console.table(HEAD, _module_rows(j))
    for m in j.modules:
        yield f"\n{m.module}"
        yield from _module_lines(m)
    yield from _log_lines(j)
    yield "\nassumptions"
    for text in j.assumptions:
        yield from _list_item_lines(text)


def judgement_sections(j: LogJudgement) -> Iterator[PageSection]:
    """Yields the sections of the page about the judgement."""
    yield PageSection(
        "What was judged", (_judged_span_text(j), DISTANCES), PAGE_HEAD, tuple(_module_rows(j))
    )
    for m in j.modules:
        yield from _module_sections(m)
    if lost := tuple(text.strip() for text in loss_lines(j)):
        yield PageSection("The log", lost)
    if j.derived:
        rows = tuple((d.name, *_error_texts(d), d.how) for d in j.derived)
        yield PageSection("What was derived", (ERRORS,), ERRORS_HEAD, rows)
    yield PageSection("What this rests on", tuple(j.assumptions))


def _module_sections(m: ModuleOfLog) -> Iterator[PageSection]:
    """Page sections of a module: outcome, changes of control, and the nearest values by bound."""
    drawn = ""
    if m.times is not None and m.decided:
        changes = [(m.times.begin_s, "SC"), *((c.time_s, c.to) for c in m.changes)]
        m.times.changes = () if m.unheard else changes
        drawn = drawing_html(m.times, "reads outside of `safe`")
    yield PageSection(m.module, tuple(text.strip() for text in _outcome_lines(m)), drawn=drawn)
    if not m.decided:
        return
    if m.changes:
        rows = tuple((f"{c.time_s:.3f} s", c.to, c.reason) for c in m.changes)
        yield PageSection(f"{m.module}: changes of control", (), ("time", "control", "why"), rows)
    if near := sorted(m.bounds.values(), key=lambda n: n.distance):
        rows = tuple((f"{n.distance:.3f}", f"{n.time_s:.3f} s", f"`{n.bound}`") for n in near)
        yield PageSection(f"{m.module}: comparisons of `ttf`", (), BOUNDS_HEAD, rows)


def _judged_span_text(j: LogJudgement) -> str:
    samples = ", ".join(f"{name} ({n:,})" if n else name for name, n in j.samples.items())
    return f"{j.log}  judged on reads from {j.from_s:.3f} s to {j.to_s:.3f} s: {samples}"


def _module_rows(j: LogJudgement) -> list[tuple[str, ...]]:
    return [
        (
            m.module,
            percent_text(m.judged_share),
            "" if m.unheard else f"{m.ac_share:.1%}",
            _first_switch_text(m),
            f"{len(m.switches):,}",
            _nearest_text(m.margin),
            _nearest_text(m.clearance),
        )
        for m in j.modules
        if m.decided
    ]


def _first_switch_text(m: ModuleOfLog) -> str:
    if m.first_switch_s is not None:
        return f"{m.first_switch_s:.3f} s"
    return "none" if m.judged and not m.unheard else "not judged"


def percent_text(x: float) -> str:
    """A share in percent; it is shown as 100 % only if it is 1, and as 0 % only if it is 0."""
    return f"{min(max(x, 0.001), 0.999) if 0.0 < x < 1.0 else x:.1%}"


def share_words(x: float) -> str:
    """The words " in ... of the log" for a headline if only a part was judged; "" for all."""
    return f" in {percent_text(x)} of the log" if x < 1.0 else ""


def verdict_line(m: ModuleOfLog) -> str:
    """The verdict on a module, in a line."""
    parts = [f"none of {m.asked:,} reads lay outside `safe`"]
    if m.outside:
        parts = [f"{m.outside:,} of {m.asked:,} reads lay outside `safe`"]
    if m.why_unjudged:
        parts = [*(parts if m.outside else ()), f"{NOTHING}: {m.why_unjudged}"]
    if m.outside_late:
        parts.append(f"{m.outside_late:,} {NOT_READ} lay outside `safe`")
    if m.first_outside_s is not None:
        parts.append(f"the first at {m.first_outside_s:.3f} s")
    if m.judged and m.judged_share < 1.0:
        parts.append(f"judged{share_words(m.judged_share)}")
    if m.last_heard:
        names = ", ".join(f"`{n}` after {t:.3f} s" for n, t in m.last_heard.items())
        parts.append(f"nothing was heard of {names}")
    if m.beyond_s > 0.0:
        parts.append(f"to the last row that counts, {m.beyond_s:.3f} s before the file ends")
    verdict = ", ".join(parts)
    return verdict if m.damage is None else f"{m.damage}: {verdict}"


def unheard_sentences(m: ModuleOfLog) -> tuple[str, ...]:
    """A sentence on what follows if the log lacks topics that give AC control; () otherwise."""
    if not m.unheard:
        return ()
    text = f"the log does not give {', '.join(m.unheard)}: for its DM nobody ever gave control back"
    return (f"{text}, so AC never has it, and when it would have switched is not judged",)


def _outcome_lines(m: ModuleOfLog) -> Iterator[str]:
    """Lines about all steps of a decision module, or about what the log lacks for a verdict."""
    if not m.decided:
        yield "  undecided; the log does not give"
        for name in m.missing:
            yield from _list_item_lines(name)
        return
    outside = f"{m.outside:,} ({m.outside / max(1, m.asked):.1%})"
    yield (
        f"  {m.steps:,} steps of the DM: {m.stale:,} with reads too old, ttf in {m.ttf:,}, "
        f"safer in {m.safer:,}, outside of safe in {outside}"
    )
    if m.nan_looks:
        yield f"  `ttf` or `safer` compared a NaN in {m.nan_looks:,} of them; that counts as danger"
    if m.silent:
        yield f"  {m.silent:,} with young reads that rest on what was too old, or silent"
    if m.waiting:
        yield f"  {m.waiting:,} more before all that it reads was there"
    if m.outside_late:
        yield f"  samples {NOT_READ} lay outside of safe {m.outside_late:,} times"
    for text in unheard_sentences(m):
        yield from _list_item_lines(text)
    if m.faults:
        yield f"  a predicate faulted {m.faults:,} times: the DM takes that for unsafe"
    if m.blind:
        yield f"  `safe` is not judged; it reads {', '.join(m.blind)}"


def _module_lines(m: ModuleOfLog) -> Iterator[str]:
    yield from _outcome_lines(m)
    if not m.decided:
        return
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


def loss_lines(j: LogJudgement) -> Iterator[str]:
    """Lines on samples that were not used, components with faults, and damage of the file."""
    texts = [*j.lost]
    for name, (count, first) in j.refused.items():
        texts.append(f"refused by the gate: {count:,} samples of {name}; the first: {first}")
    texts += [f"{name} faulted and latched: {why}" for name, why in j.faulted.items()]
    damages = sorted({m.damage.told for m in j.modules if m.damage})
    texts += [f"of the file: {text}" for text in (*damages, *j.notes)]
    yield from (f"\n{safe(text)}" for text in texts)


def _log_lines(j: LogJudgement) -> Iterator[str]:
    yield from loss_lines(j)
    if j.derived:
        yield "\nderived (error: half, 95 %, all of it below)"
    for how in dict.fromkeys(d.how for d in j.derived):
        yield from _list_item_lines(how)
        for d in j.derived:
            if d.how == how:
                yield f"      {d.name}  {', '.join(_error_texts(d))}"


def _error_texts(d: DerivedValue) -> tuple[str, ...]:
    """The errors of a derived value as text; "none", which is not 0, if none could be measured."""
    return ("none",) * len(ERRORS_SHARES) if d.error is None else tuple(f"{e:.2g}" for e in d.error)


def _list_item_lines(text: str) -> Iterator[str]:
    yield textwrap.fill(text, WIDTH, initial_indent="  - ", subsequent_indent="    ")


def _nearest_text(n: NearestMargin | None) -> str:
    if n is None or not isfinite(n.distance):
        return ""
    return f"{n.distance:.3f} at {n.time_s:.3f} s"


# ---------------------------------------------------------------- for programs


@dataclass(frozen=True)
class LostSamples:
    """How many samples of a topic were not used, and the first of them."""

    samples: int
    first: str


@dataclass(frozen=True)
class LeftOutSamples(LostSamples):
    """Samples that were left out; `reasons`: for each reason, their number and the first sample."""

    reasons: tuple[LostSamples, ...]


def _left_out_samples(j: LogJudgement) -> dict[str, LeftOutSamples]:
    return {
        name: LeftOutSamples(*x, tuple(LostSamples(*r) for r in j.reasons[name]))
        for name, x in j.left_out.items()
    }


def _refused_samples(j: LogJudgement) -> dict[str, LostSamples]:
    return {name: LostSamples(*x) for name, x in j.refused.items()}


def _modules_by_name(j: LogJudgement) -> dict[str, ModuleOfLog]:
    return {m.module: m for m in j.modules}


def _ac_share_or_none(m: ModuleOfLog) -> float | None:
    return m.ac_share if m.decided and not m.unheard else None


def _switch_count(m: ModuleOfLog) -> int:
    return len(m.switches)


def _bound_margins(m: ModuleOfLog) -> list[NearestMargin]:
    return list(m.bounds.values())


def _finite_distance(n: NearestMargin) -> float | None:
    return n.distance if isfinite(n.distance) else None


RESULT, COLUMNS = "soter.monitor.log_judgement", "soter.monitor.log_files.log_columns"
LOST = JsonObject(LostSamples, "samples first", named="samples_lost")
LEFT_OUT = JsonObject(
    LeftOutSamples, "samples first reasons", named="samples_left_out", reasons=LOST
)
DAMAGE = JsonObject(f"{COLUMNS}.Damage", "told share", named="damage")
NEAREST = JsonObject(
    f"{RESULT}.NearestMargin",
    "distance time_s bound",
    {"distance": _finite_distance},
    named="nearest",
)
FOREIGN_LOG = JsonObject(
    f"{RESULT}.LogJudgement",
    "path=log from_s to_s samples nodes derived constants left_out refused far_stamps faulted "
    "notes assumptions modules",
    {"left_out": _left_out_samples, "refused": _refused_samples, "modules": _modules_by_name},
    named="foreign_log",
    derived=JsonObject("soter.monitor.typed_samples.DerivedValue", "name how error"),
    left_out=LEFT_OUT,
    refused=LOST,
    far_stamps=JsonObject(f"{COLUMNS}.FarStamps", "samples offset_s length_s"),
    modules=JsonObject(
        f"{RESULT}.ModuleOfLog",
        "decided judged judged_share missing safe_missing=blind press_missing=unheard waiting "
        "steps ac_share first_switch_s switches changes stale silent last_heard ttf safer outside "
        "outside_late first_outside_s nan_looks faults margin clearance bounds damage",
        {"ac_share": _ac_share_or_none, "switches": _switch_count, "bounds": _bound_margins},
        changes=JsonObject(f"{RESULT}.LoggedModeChange", "time_s to reason", to=one_of("AC", "SC")),
        margin=NEAREST,
        clearance=NEAREST,
        bounds=NEAREST,
        damage=DAMAGE,
    ),
)
"""The judgement as the document of `soter monitor` has it (docs/json.md)."""
