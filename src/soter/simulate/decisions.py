"""What the decision modules of a run saw and did, with reasons in words.

Purpose: `steps` gives every DM step of a trace, and `changes` every change of mode, as plain
records for logs, reports and terminals.
Non-goals: deciding (the generated DM did), drawing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from soter.semantics.configuration import ACKNOWLEDGED, OPEN, READY
from soter.simulate.explain_decision import DecisionReason, Explainer, TopicRead
from soter.simulate.led_looks import looks_of
from soter.simulate.run_observer import decided_at

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System
    from soter.simulate.run_observer import ModeChange

Mode = Literal["SC", "AC"]


@dataclass(frozen=True)
class PredicateValues:
    """The facts of a DM step; `clean_needed`: how many clean outputs AC owes after a gate fault.

    `latched`: why its latch, if it has one, lets AC have no control; "": it does.
    """

    ttf: bool
    safer: bool
    stale: bool
    gate_fault: bool
    clean_needed: int = 0
    latched: str = ""

    def predicates(self) -> dict[str, bool]:
        """The facts by name, as logs and reports show them."""
        return {
            "ttf": self.ttf,
            "safer": self.safer,
            "stale": self.stale,
            "gate_fault": self.gate_fault,
        }


@dataclass(frozen=True)
class DecisionStepRecord:
    """A DM step: when, whose, the modes before and after, what it saw, and why in words."""

    time_ns: int
    module: str
    before: Mode
    after: Mode
    saw: PredicateValues
    reason: str
    margin_s: float
    """margin(M) right after it."""
    why: DecisionReason | None = None
    """The values behind it; None where nothing changed, and where the states are not kept."""
    reads: tuple[TopicRead, ...] = ()
    """What the step read, of a module with `rest`: the estimate from which SC was followed."""

    @property
    def words(self) -> list[str]:
        """The reasons for the decision, one phrase each."""
        return [] if self.why is None else self.why.words(self.before, self.after)


class ObservedRun(Protocol):
    """What this file needs of a run (`result.Run`)."""

    system: System
    layout: StateLayout
    changes: list[ModeChange]


def changes(run: ObservedRun) -> list[DecisionStepRecord]:
    """The DM steps that changed a mode, in order of time.

    For modules with `rest` a step that took control from AC has the part of the tube that failed.
    """
    explainer = Explainer(run.system, run.layout)
    found = [of_change(run.system, change, explainer) for change in run.changes]
    for k, part in _failed_parts(run).items():
        why = found[k].why
        assert why is not None
        found[k] = replace(found[k], why=replace(why, led=part))
    return found


def _failed_parts(run: ObservedRun) -> dict[int, str]:
    """The failed parts of tubes, by number of the change; empty without a compiler of C."""
    rests = [m.index for m in run.system.modules if m.symbol.rest is not None]
    lost = [(k, c) for k, c in enumerate(run.changes) if c.to != "AC" and c.ttf and c.states]
    lost = [(k, c) for k, c in lost if c.module in rests]
    looks = looks_of(run.system) if lost else None
    told = {}
    for k, c in lost if looks is not None else ():
        assert looks is not None
        assert c.states is not None
        led = looks.of(c.module, *c.states, judged=True)
        if led.failed:
            told[k] = looks.told(run.system.modules[c.module], led)
    return told


def of_change(
    system: System, change: ModeChange, explainer: Explainer | None = None
) -> DecisionStepRecord:
    """The record of a change of mode with its reason; with an `explainer` also the values."""
    module = system.modules[change.module]
    saw = PredicateValues(change.ttf, change.safer, change.stale, change.gate_fault)
    after: Mode = "AC" if change.to == "AC" else "SC"
    before: Mode = "SC" if after == "AC" else "AC"
    why = None
    if explainer is not None and change.states is not None:
        why = explainer.of(change.module, *change.states)
    said = reason(before, after, saw)
    margin_s = _margin_s(module, after, saw)
    return DecisionStepRecord(
        change.time_ns, module.name, before, after, saw, said, margin_s=margin_s, why=why
    )


def steps(
    system: System,
    states: npt.NDArray[Any],
    earlier: Any = None,  # noqa: ANN401 - a state
    explainer: Explainer | None = None,
) -> Iterator[DecisionStepRecord]:
    """Every DM step of consecutive states, (n,), in order of time, ties by module.

    `earlier`: the state before the first, None at the start of a run. With an `explainer` a step
    that saw or did something else than the one before has the values, and one of a module with
    `rest` what it read.
    """
    due = decided_at(system, states)
    modules = states["modules"]
    times_ns = states["header"]["ct"]
    for row in np.flatnonzero(due.any(axis=1)):
        before = states[row - 1] if row else earlier
        for module in system.modules:
            if due[row, module.index]:
                seen = None if before is None else before["modules"]
                waits = _waits_for(module, states[row])
                decision = _step(modules[row], seen, module, int(times_ns[row]), waits)
                raw = None if before is None else before.tobytes()
                if explainer is not None and _is_new(modules[row], seen, module.index):
                    why = explainer.of(module.index, raw, states[row].tobytes())
                    decision = replace(decision, why=why)
                if explainer is not None and module.symbol.rest is not None:
                    read = explainer.reads(module.index, raw, states[row].tobytes())
                    decision = replace(decision, reads=read)
                yield decision


def margins(system: System, module: Module, states: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """margin(M) after every instant of a whole run, (n,), in s; `states` (n,) from its start."""
    now, of = states["header"]["ct"], states["modules"][:, module.index]
    due = decided_at(system, states)[:, module.index]
    last = np.maximum.accumulate(np.where(due, now, np.iinfo(np.int64).min // 2))
    unsafe = (of["ttf"] != 0) | (of["stale"] != 0) | (of["saw_gate_fault"] != 0)
    looks = np.where(unsafe, 0, np.where(of["safer"] != 0, module.looks, 1))
    left_ns = looks * module.period_ns - module.late_ns - (now - last)
    margin_s: npt.NDArray[np.float64] = np.where(of["mode"] != 0, np.maximum(left_ns, 0), 0) / 1e9
    return margin_s


def latched(module: Module, states: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Whether a module's latch lets AC have no control, (n,), after each of `states`, (n,)."""
    in_sc = states["modules"]["mode"][:, module.index] == 0
    if module.latch is None:
        return np.zeros_like(in_sc)
    held = states["topics"][f"{module.name}.latch"]
    waits: npt.NDArray[np.bool_] = held != (
        OPEN if module.acknowledgement is None else ACKNOWLEDGED
    )
    both: npt.NDArray[np.bool_] = in_sc & waits
    return both


def _waits_for(module: Module, state: Any) -> str:  # noqa: ANN401 - a state
    """What the latch of a module waits for after an instant; "" where AC may have control."""
    if module.latch is None or not latched(module, state.reshape(1))[0]:
        return ""
    if not module.symbol.acknowledgements:
        return "latched: it returns never"
    name = module.symbol.acknowledgements[0].name
    released = int(state["topics"][f"{module.name}.latch"]) == READY
    return f"latched: waits for {name} to be {'' if released else 'released and '}pressed"


def _step(
    modules: Any,  # noqa: ANN401 - rows of modules
    before: Any,  # noqa: ANN401
    module: Module,
    time_ns: int,
    waits: str,
) -> DecisionStepRecord:
    """The record of a DM step; AC's owed outputs are those before it, as AC steps after the DM."""
    now = modules[module.index]
    earlier = None if before is None else before[module.index]
    was_ac = module.forced == "ac" if earlier is None else bool(earlier["mode"])
    saw = PredicateValues(
        bool(now["ttf"]),
        bool(now["safer"]),
        bool(now["stale"]),
        bool(now["saw_gate_fault"]),
        0 if earlier is None else int(earlier["clean_needed"]),
        waits,
    )
    was: Mode = "AC" if was_ac else "SC"
    after: Mode = "AC" if now["mode"] else "SC"
    why = "the system forces this mode" if module.forced else reason(was, after, saw)
    return DecisionStepRecord(
        time_ns, module.name, was, after, saw, why, _margin_s(module, after, saw)
    )


def _margin_s(module: Module, after: Mode, saw: PredicateValues) -> float:
    """For how long AC surely keeps control from this step on."""
    unsafe = saw.ttf or saw.stale or saw.gate_fault
    looks = module.looks_left(unsafe=unsafe, safer=saw.safer)
    return module.margin_ns(looks, 0) / 1e9 if after == "AC" else 0.0


def _is_new(now: Any, before: Any, module: int) -> bool:  # noqa: ANN401 - rows of modules
    """Whether a step saw or did something else than the one before."""
    told = ["mode", "ttf", "safer", "stale", "saw_gate_fault"]
    return before is None or bool(now[module][told] != before[module][told])


def reason(before: Mode, after: Mode, saw: PredicateValues) -> str:
    """Words on why a DM step decided as it did; "" where there is nothing to say."""
    if after == "SC":
        return " and ".join(_against(saw, staying=before == "SC"))
    return "safer: far enough inside φ_safe" if before == "SC" else ""


def _against(saw: PredicateValues, *, staying: bool) -> Iterator[str]:
    """The reasons against AC having control, in words."""
    if saw.ttf and not staying:
        yield "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that)"
    if saw.stale:
        yield "stale: an input is older than its max_age"
    if saw.gate_fault and not staying:
        yield "gate fault: an output of AC was refused"
    if staying and not saw.safer:
        yield "not safer yet"
    if staying and saw.clean_needed:
        yield f"AC owes {saw.clean_needed} clean outputs"
    if staying and saw.latched:
        yield saw.latched
