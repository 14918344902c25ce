"""The timing report of a real-time run, for people.

Purpose: how late it was, what was missed, how workers fared, who took over and why.
Non-goals: the figures themselves (`runtime/posix/soter_posix_report.c`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.simulate.result import silence_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    Timing = dict[str, Any]

WIDTH = 34


def timing_lines(timing: Timing) -> list[str]:
    """Lines for the summary, from the driver's report (docs/json.md)."""
    return [
        *_head(timing),
        *_histograms(timing),
        *_workers(timing),
        *_takeovers(timing),
        *_leases(timing),
    ]


def _head(timing: Timing) -> Iterator[str]:
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
        yield from (f"    {words}" for words in silence_of(timing))
    yield from (f"  note: {text}" for text in timing["notes"])


def _histograms(timing: Timing) -> Iterator[str]:
    yield f"  {'lateness, µs':<{WIDTH}}{'p50':>9} {'p99':>9} {'p99.9':>9} {'max':>9}"
    yield _row("wake-up, nothing to do", timing["bare"])
    yield _row("instants", timing["wake"])
    for name, node in timing["nodes"].items():
        if not node["release"]["count"]:
            continue  # of a process of its own
        yield _row(f"{name} begins", node["release"])
        yield _row(f"{name} complete", node["completion"])
        late = [f"{node[k]} {k.replace('_', ' ')}" for k in _LATE if node[k]]
        if late:
            yield f"    {', '.join(late)}"


_LATE = ("released_late", "completed_late")


def _row(name: str, h: dict[str, Any]) -> str:
    figures = " ".join(f"{h[k] / 1e3:>9.1f}" for k in ("p50_ns", "p99_ns", "p999_ns", "max_ns"))
    return f"  {name:<{WIDTH}}{figures}"


def _workers(timing: Timing) -> Iterator[str]:
    for name, w in timing["workers"].items():
        yield (
            f"  worker {name}: {w['answered']} of {w['asked']} answered, {w['later']} of them "
            f"after the next instant, {w['missing']} missing, {w['failed']} failed; "
            f"{w['starts']} starts"
        )


def _takeovers(timing: Timing) -> Iterator[str]:
    for name, module in timing["modules"].items():
        causes = [f"{n} by {cause}" for cause, n in module["takeovers"].items() if n]
        if causes:
            yield f"  takeovers {name}: {', '.join(causes)}"


def _leases(timing: Timing) -> Iterator[str]:
    for name, of in timing["leases"].items():
        given = f"  leases {name}: {of['given']} given"
        ended = of["ended_ns"]
        yield given if ended is None else f"{given}, none from {ended / 1e9:g} s on: the law"
