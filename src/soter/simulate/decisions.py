"""What the decision modules of a run saw and did, with reasons in words.

Purpose: every DM step of a trace, and every change of mode, as plain records for logs, reports
and terminals.
Non-goals: deciding (the generated DM did), drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from soter.simulate.due import decided_at

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from soter.program.model.system import Module, System
    from soter.simulate.observe import ModeChange
    from soter.simulate.result import Run

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
    return [of_change(run.system, change) for change in run.changes]


def of_change(system: System, change: ModeChange) -> Decided:
    """A change of mode, with its reason."""
    module = system.modules[change.module]
    saw = Saw(change.ttf, change.safer, change.stale, change.gate_fault)
    before, after = _modes(change.to == "AC")
    return Decided(change.time_ns, module.name, before, after, saw, reason(before, after, saw))


def steps(system: System, states: npt.NDArray[Any], earlier: Any = None) -> Iterator[Decided]:  # noqa: ANN401 - a row of modules
    """Every DM step of states that follow each other, (n,), in order of time, ties by module.

    `earlier`: the modules' records of the state before the first, None at the start of a run.
    """
    due = decided_at(system, states)
    modules = states["modules"]
    times_ns = states["header"]["ct"]
    for row in np.flatnonzero(due.any(axis=1)):
        before = modules[row - 1] if row else earlier
        for module in system.modules:
            if due[row, module.index]:
                yield _step(modules[row], before, module, int(times_ns[row]))


def _step(modules: Any, before: Any, module: Module, time_ns: int) -> Decided:  # noqa: ANN401
    """The DM step of an instant. Debts of AC are as they were before it: AC steps after DM."""
    now = modules[module.index]
    earlier = None if before is None else before[module.index]
    was_ac = module.forced == "ac" if earlier is None else bool(earlier["mode"])
    saw = Saw(
        bool(now["ttf"]),
        bool(now["safer"]),
        bool(now["stale"]),
        bool(now["saw_gate_fault"]),
        0 if earlier is None else int(earlier["clean_needed"]),
    )
    was: Mode = "AC" if was_ac else "SC"
    after: Mode = "AC" if now["mode"] else "SC"
    why = "the system forces this mode" if module.forced else reason(was, after, saw)
    return Decided(time_ns, module.name, was, after, saw, why)


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
