"""What the decision modules of a run saw and did, with reasons in words.

Purpose: every DM step of a trace, and every change of mode, as plain records for logs, reports
and terminals.
Non-goals: deciding (the generated DM did), drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.program.system import Module
    from soter.simulate.run import Run

Mode = Literal["SC", "AC"]


@dataclass(frozen=True)
class Saw:
    """The predicates of a DM step; `clean_needed`: outputs AC still owes after a gate fault."""

    ttf: bool
    safer: bool
    stale: bool
    gate_fault: bool
    clean_needed: int = 0

    def predicates(self) -> dict[str, bool]:
        """Name to value, as logs and reports show them."""
        return {
            "ttf": self.ttf,
            "safer": self.safer,
            "stale": self.stale,
            "gate_fault": self.gate_fault,
        }


@dataclass(frozen=True)
class Decided:
    """A DM step: when, whose, the modes before and after, what it saw, and why in words."""

    time_ns: int
    module: str
    before: Mode
    after: Mode
    saw: Saw
    reason: str


def changes(run: Run) -> list[Decided]:
    """The DM steps that changed a mode, in order of time."""
    found = []
    for change in run.changes:
        module = run.system.modules[change.module]
        saw = Saw(change.ttf, change.safer, change.stale, change.gate_fault)
        before, after = _modes(change.to == "AC")
        found.append(
            Decided(change.time_ns, module.name, before, after, saw, reason(before, after, saw))
        )
    return found


def steps(run: Run) -> Iterator[Decided]:
    """Every DM step of a traced run, in order of time, ties by module."""
    trace = run.require_trace()
    times_ns = trace["header"]["ct"]
    periods = {m.period_ns for m in run.system.modules}
    due = np.zeros(len(times_ns), dtype=np.bool_)
    for period_ns in periods:
        due |= times_ns % period_ns == 0
    for row in np.flatnonzero(due):
        for module in run.system.modules:
            if int(times_ns[row]) % module.period_ns == 0:
                yield _step(trace["modules"], int(row), module, int(times_ns[row]))


def _step(modules: Any, row: int, module: Module, time_ns: int) -> Decided:  # noqa: ANN401
    """The DM step of an instant. Debts of AC are as they were before it: AC steps after DM."""
    now = modules[row, module.index]
    earlier = modules[row - 1, module.index] if row else None
    was_ac = module.forced == "ac" if earlier is None else bool(earlier["mode"])
    saw = Saw(
        bool(now["ttf"]),
        bool(now["safer"]),
        bool(now["stale"]),
        bool(now["saw_gate_fault"]),
        0 if earlier is None else int(earlier["clean_needed"]),
    )
    before: Mode = "AC" if was_ac else "SC"
    after: Mode = "AC" if now["mode"] else "SC"
    why = "the system forces this mode" if module.forced else reason(before, after, saw)
    return Decided(time_ns, module.name, before, after, saw, why)


def _modes(to_ac: bool) -> tuple[Mode, Mode]:
    return ("SC", "AC") if to_ac else ("AC", "SC")


def reason(before: Mode, after: Mode, saw: Saw) -> str:
    """Why a DM step decided as it did; "" where there is nothing to say."""
    if after == "SC":
        return " and ".join(_against(saw, staying=before == "SC"))
    return "safer: far enough inside φ_safe" if before == "SC" else ""


def _against(saw: Saw, *, staying: bool) -> Iterator[str]:
    """What speaks against AC."""
    if saw.ttf and not staying:
        yield "ttf: φ_safe could be left within 2Δ"
    if saw.stale:
        yield "stale: an input is older than its max_age"
    if saw.gate_fault and not staying:
        yield "gate fault: an output of AC was refused"
    if staying and not saw.safer:
        yield "not safer yet"
    if staying and saw.clean_needed:
        yield f"AC owes {saw.clean_needed} clean outputs"
