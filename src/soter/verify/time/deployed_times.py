"""Whether the times of a proof hold in the thread of the trusted part: R033, R034.

Purpose: where a system declares execution times, the latest start and the longest step of every
component of a module against the lateness J and response R that its proof counts with; and the
times themselves, so that P1c can be said of what is deployed.
Non-goals: the analysis of the thread (`soter.timing`), who is on the way (`sc_chains.py`).

A component of the thread keeps J and R when its latest start is at most J after its release, and
its `wcet` at most R. SC may wait longer: until every DM released at or before it must have spoken
(docs/proof.md). A node that runs behind SC in the same instant has no times of its own in a proof:
what it publishes counts as SC's output, so it has to be there R_sc after the start of SC.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import gcd
from typing import TYPE_CHECKING

from soter.language.model.durations import show_ns, write_ns
from soter.language.model.system import holder_of
from soter.timing.trusted_thread import MISSES, in_thread, report_miss, timing_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.model.system import Component, Module, System
    from soter.timing.response_times import ScheduledStep
    from soter.timing.trusted_thread import Timing

Pair = tuple[int, int]
"""Lateness and response in ns."""


@dataclass(frozen=True)
class AssumedTimes:
    """The times that a proof of a module counts with.

    `nodes`: by full name, of those that are followed and stand in the thread; `in_step`: full names
    of nodes behind SC in its instant; `elsewhere`: of those that are followed in processes of their
    own, zero where one counts as a node behind SC in its instant.
    """

    dm: Pair
    sc: Pair
    nodes: dict[str, Pair] = field(default_factory=dict)
    in_step: tuple[str, ...] = ()
    elsewhere: dict[str, Pair] = field(default_factory=dict)


@dataclass(frozen=True)
class DeployedTimes:
    """The least times that a proof of a module may count with, as `AssumedTimes` has them.

    They mean nothing where `timing` has a miss.
    """

    timing: Timing
    dm: Pair
    sc: Pair
    nodes: dict[str, Pair]
    late_at: dict[str, int]
    """The release at which each starts so late: "dm", "sc" and names of nodes."""
    handed_over: int | None
    """From a release of the DM to the start of SC at its first release from then on, at most, where
    that is known; it has the verdict then, as the thread works in order."""


def deployed(flat: System, module: Module, assumed: AssumedTimes) -> DeployedTimes | None:
    """What the declared execution times of a system ask of a proof of a module of it.

    None where the thread declares none. J of SC is without its waiting for the DM, which may speak
    as late as `assumed` says, or as it does.
    """
    dm, sc = flat.components[module.dm], flat.components[module.sc]
    steps: list[ScheduledStep] = []
    timing = timing_of(flat, lambda c, step: steps.append(step) if c.index == sc.index else None)
    if timing is None:
        return None
    spoken = _needed(timing, dm)
    ready = max(sum(assumed.dm), sum(spoken))
    late, response = _needed(timing, sc)
    late_at = {"dm": _at(timing, dm), "sc": _at(timing, sc)}
    late_at |= {n: _at(timing, flat.component(n)) for n in assumed.nodes}
    if timing.exact and steps:
        worst = max(steps, key=lambda s: _late(s, dm, ready))
        late, late_at["sc"] = _late(worst, dm, ready), worst.release
    response = max([response, *(_behind(flat, sc, flat.component(n)) for n in assumed.in_step)])
    nodes = {n: _needed(timing, flat.component(n)) for n in assumed.nodes}
    handed_over = max((_waited(s, dm, sc) for s in steps), default=0) if timing.exact else None
    return DeployedTimes(timing, spoken, (late, response), nodes, late_at, handed_over)


def _waited(step: ScheduledStep, dm: Component, sc: Component) -> int:
    """From the first release of the DM after the step of SC before this one, to its start."""
    after = step.release - sc.period_ns
    first = after + 1 + (dm.phase_ns - after - 1) % dm.period_ns
    return step.start - first if first <= step.release else 0


def _needed(timing: Timing, c: Component) -> Pair:
    row = timing.row(c)
    assert row is not None
    return (0 if row.worst is None else row.worst.start), row.task.wcet


def _at(timing: Timing, c: Component) -> int:
    """The release of a component that starts latest."""
    row = timing.row(c)
    assert row is not None
    return 0 if row.worst is None else row.worst.at


def _late(step: ScheduledStep, dm: Component, ready: int) -> int:
    """How late SC starts for other reasons than that it waits for the DM."""
    due = step.release - (step.release - dm.phase_ns) % dm.period_ns
    waits = due >= dm.phase_ns and step.start <= due + ready
    return 0 if waits else step.start - step.release


def _behind(flat: System, sc: Component, node: Component) -> int:
    """From the start of SC to the end of a node that is released with it and comes after, at most.

    What may be released in that instant between them counts; what is left from before does not, as
    that is over when SC starts.
    """
    between = [
        c
        for c in flat.components
        if sc.index <= c.index <= node.index
        and in_thread(c)
        and (c.phase_ns - sc.phase_ns) % gcd(c.period_ns, sc.period_ns) == 0
    ]
    longest = rest = 0
    for c in reversed(between):
        rest += c.wcet_ns or 0
        longest = max(longest, rest + (0 if c is sc else c.jitter_ns))
    return longest


def check_deployed(
    flat: System, module: Module, assumed: AssumedTimes, diagnostics: Diagnostics
) -> list[str]:
    """R034 where the calendar cannot be kept, R033 where it does not keep the times of a proof.

    What a proof rests on here, in words; nothing where no execution times are declared.
    """
    _check_elsewhere(flat, module, assumed, diagnostics)
    deployment = deployed(flat, module, assumed)
    if deployment is None:
        return []
    timing = deployment.timing
    if timing.verdict == MISSES:
        report_miss(timing, diagnostics)
        return []
    if not timing.exact and any(r.worst is None for r in timing.rows):
        return _too_long(flat, module, diagnostics)
    pairs = {"dm": (assumed.dm, deployment.dm), "sc": (assumed.sc, deployment.sc)}
    pairs |= {n: (pair, deployment.nodes[n]) for n, pair in assumed.nodes.items()}
    at = deployment.late_at if timing.exact else {}
    if wrong := list(_beyond(pairs, at)):
        diagnostics.error(
            "R033",
            f"the thread of system `{flat.name}` does not keep the times of the proof of "
            f"`{module.name}`",
            _place(module),
            notes=(*wrong, *([] if timing.exact else ["these are bounds: docs/timing.md"])),
            helps=(f"write `{' '.join(_lines(flat, module, pairs))}`",),
        )
    missing = ", ".join(c.name for c in timing.missing)
    if missing:
        return [f"no `wcet` is said of {missing}: that the thread keeps these times is assumed"]
    one = "`wcet` and `jitter` hold, and one thread works in the deployed order"
    others = "extern nodes run elsewhere, unless they are `inline`"
    return [f"{one}; {others} (docs/timing.md)"]


def _place(module: Module) -> Span:
    """Where the times stand: of all views of a module, in one place."""
    symbol = module.whole or module.symbol
    return symbol.verify.span or symbol.span


def _too_long(flat: System, module: Module, diagnostics: Diagnostics) -> list[str]:
    diagnostics.error(
        "R033",
        f"whether the thread of system `{flat.name}` keeps the times of the proof of "
        f"`{module.name}` is not known",
        _place(module),
        notes=("its calendar has too many steps before it comes again, and is too full",),
        helps=("periods that are multiples of one another",),
    )
    return []


def _check_elsewhere(
    flat: System, module: Module, assumed: AssumedTimes, diagnostics: Diagnostics
) -> None:
    """R033 where a node in a process of its own says longer times than a proof counts with."""
    said = {n: flat.component(n) for n in assumed.elsewhere}
    pairs = {n: (assumed.elsewhere[n], (c.jitter_ns, c.wcet_ns or 0)) for n, c in said.items()}
    if wrong := list(_beyond(pairs, {})):
        diagnostics.error(
            "R033",
            f"nodes of system `{flat.name}` do not keep the times of the proof of `{module.name}`",
            _place(module),
            notes=(*wrong, "they run in processes of their own, and say these times themselves"),
            helps=(f"write `{' '.join(_lines(flat, module, pairs))}`",),
        )


def _beyond(pairs: dict[str, tuple[Pair, Pair]], late_at: dict[str, int]) -> Iterator[str]:
    """What is later or longer than a proof counts with, with the release where that is known."""
    for name, (assumed, needed) in pairs.items():
        who = {"dm": "the DM", "sc": "SC"}.get(name, f"`{name}`")
        if needed[0] > assumed[0]:
            when = f" at {show_ns(late_at[name])}" if name in late_at else ""
            yield (
                f"{who} may start {show_ns(needed[0])} after its release{when}, "
                f"the proof counts with {show_ns(assumed[0])}"
            )
        if needed[1] > assumed[1]:
            yield (
                f"{who} may take {show_ns(needed[1])} from its start, "
                f"the proof counts with {show_ns(assumed[1])}"
            )


def _lines(flat: System, module: Module, pairs: dict[str, tuple[Pair, Pair]]) -> list[str]:
    """`late` and `response` of a `verify` block with which the proof counts with enough."""
    home = holder_of(flat, module)
    lines = []
    for k, word in enumerate(("late", "response")):
        said = [
            f"{n.removeprefix(f'{home}.')} {write_ns(max(a[k], b[k]))}"
            for n, (a, b) in pairs.items()
            if max(a[k], b[k])
            and not (word == "response" and n not in ("dm", "sc") and flat.component(n).takes_ns)
        ]
        lines += [f"{word} {', '.join(said)};"] if said else []
    return lines
