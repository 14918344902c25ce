"""What declared execution times come to, on the terminal and in documents.

Purpose: `say_timing`, `TIMING`: one `TimingReport`.
Non-goals: the figures themselves (`soter.api.timing`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.api.timing import SwitchReport, ThreadRow, TimingReport
from soter.diagnostics.record_to_json import JsonObject, one_of
from soter.language.model.durations import show_ns

if TYPE_CHECKING:
    from soter.cli.terminal.console import Console

HEAD = ("thread", "every", "wcet", "jitter", "starts by", "ends by", "slack")


def say_timing(report: TimingReport, console: Console) -> None:
    """The thread as a table, then what it comes to, and P1c of every module."""
    console.say("")
    console.say(console.table(HEAD, [_row(r) for r in report.rows]))
    share = 100 * report.busy_ns / report.hyperperiod_ns
    bound = "" if report.exact else ", bounds only"
    lines = [f"the thread of `{report.system}` {_WORDS[report.verdict]}: {share:.1f}% busy{bound}"]
    if report.missing:
        lines.append(f"no `wcet` is said of {', '.join(report.missing)}, counted as nothing")
    if report.elsewhere:
        lines.append(f"in processes of their own: {', '.join(report.elsewhere)}")
    lines += [f"{s.module}: {s.text}" for s in report.switches]
    for line in lines:
        console.say(f"    {line}")


_WORDS = {
    "fits": "keeps its calendar",
    "misses": "does not keep its calendar",
    "undecided": "is undecided",
}


def _row(r: ThreadRow) -> list[str]:
    times = (r.wcet_ns, r.jitter_ns, r.start_ns, r.response_ns, r.slack_ns)
    return [r.name, show_ns(r.period_ns), *("?" if t is None else show_ns(t) for t in times)]


TIMING = JsonObject(
    TimingReport,
    "system verdict busy_ns hyperperiod_ns exact thread=rows elsewhere missing schedule switches",
    verdict=one_of(*_WORDS),
    thread=JsonObject(
        ThreadRow,
        "name period_ns wcet_ns jitter_ns start_ns response_ns deadline_ns slack_ns",
    ),
    switches=JsonObject(
        SwitchReport,
        "module verdict horizon_ns needed_ns slack_ns largest largest_ns text",
        verdict=one_of("holds", "fails", "undecided"),
    ),
)
"""For a document: docs/json.md."""
