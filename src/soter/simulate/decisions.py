"""Makes a record of each DM step of a run: what it saw, what it did, why.

Purpose: `decision_steps` gives every DM step of a trace, and `change_records` every change of mode,
with its reason, as plain records for logs, reports and terminals.
Non-goals: deciding (the generated DM did), where SC would have led (`tube_looks.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from soter.semantics.latches import ACKNOWLEDGED, OPEN, READY
from soter.simulate.explain_decision import DecisionReason, Explainer, TopicRead
from soter.simulate.run_observer import decided_rows
from soter.simulate.tube_looks import compile_looks, followed_modules

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System
    from soter.simulate.run_observer import ModeChange

Mode = Literal["SC", "AC"]


@dataclass(frozen=True)
class PredicateValues:
    """The facts of a DM step. `clean_needed`: how many clean outputs AC owes after a gate fault.

    `latched`: why the module's latch keeps AC from control; "" if it does not.
    """

    ttf: bool
    safer: bool
    stale: bool
    gate_fault: bool
    clean_needed: int = 0
    latched: str = ""

    def predicates(self) -> dict[str, bool]:
        """The four predicates, under the names that logs and reports use."""
        return {
            "ttf": self.ttf,
            "safer": self.safer,
            "stale": self.stale,
            "gate_fault": self.gate_fault,
        }


@dataclass(frozen=True)
class DecisionStepRecord:
    """The record of a DM step: time, module, modes before and after, facts, reason in words."""

    time_ns: int
    module: str
    before: Mode
    after: Mode
    saw: PredicateValues
    reason: str
    margin_s: float
    """margin(M) right after the step: for how long AC surely keeps control."""
    why: DecisionReason | None = None
    """The values behind the reason; None if nothing changed or the states are not kept."""
    reads: tuple[TopicRead, ...] = ()
    """In a module with `rest` the topics that the step read, from which SC was followed."""
    plan: str = ""
    """The plan that SC follows from this step on; "" in a module with one plan."""

    @property
    def words(self) -> list[str]:
        """The reasons for the decision, one phrase each."""
        return [] if self.why is None else self.why.words(self.before, self.after)


def change_records(
    system: System, layout: StateLayout, changes: Sequence[ModeChange]
) -> list[DecisionStepRecord]:
    """The records of a run's `changes` of mode, in order of time.

    In modules with `rest`, a step that took control from AC names the part of the tube that failed.
    """
    explainer = Explainer(system, layout)
    found = [change_record(system, change, explainer) for change in changes]
    for k, part in _failed_tube_parts(system, changes).items():
        why = found[k].why
        assert why is not None
        found[k] = replace(found[k], why=replace(why, led=part))
    return found


def _failed_tube_parts(system: System, changes: Sequence[ModeChange]) -> dict[int, str]:
    """Maps each change (by index) to the failed part of the tube; {} without a C compiler."""
    rests, every = [m.index for m in followed_modules(system)], enumerate(changes)
    lost = [(k, c) for k, c in every if c.to != "AC" and c.ttf and c.states and c.module in rests]
    looks = compile_looks(system) if lost else None
    words_by_change = {}
    for k, c in lost if looks is not None else ():
        assert looks is not None
        assert c.states is not None
        led = looks.follow_tube(c.module, *c.states, judged=True)
        if led.failed:
            words_by_change[k] = looks.failure_words(system.modules[c.module], led)
    return words_by_change


def change_record(
    system: System, change: ModeChange, explainer: Explainer | None = None
) -> DecisionStepRecord:
    """The record of a change of mode, with its reason; `explainer` adds the deciding values."""
    module = system.modules[change.module]
    saw = PredicateValues(change.ttf, change.safer, change.stale, change.gate_fault)
    after: Mode = "AC" if change.to == "AC" else "SC"
    before: Mode = "SC" if after == "AC" else "AC"
    why = None
    if explainer is not None and change.states is not None:
        why = explainer.explain(change.module, *change.states)
    text = decision_reason(before, after, saw)
    margin_s = _margin_s(module, after, saw)
    return DecisionStepRecord(
        change.time_ns, module.name, before, after, saw, text, margin_s=margin_s, why=why
    )


def decision_steps(
    system: System,
    states: npt.NDArray[Any],
    earlier: Any = None,  # noqa: ANN401 - a state
    explainer: Explainer | None = None,
) -> Iterator[DecisionStepRecord]:
    """Yields every DM step of consecutive states, (n,), in order of time, then of modules.

    `earlier`: the state before the first one, None at a run's start. An `explainer` adds the values
    to each step whose facts or mode differ from those of the step before. It also adds the topics
    that were read to each step of a module with `rest`.
    """
    due = decided_rows(system, states)
    modules = states["modules"]
    times_ns = states["header"]["ct"]
    for row in np.flatnonzero(due.any(axis=1)):
        before = states[row - 1] if row else earlier
        for module in system.modules:
            if due[row, module.index]:
                seen = None if before is None else before["modules"]
                waits = _latch_wait_text(module, states[row])
                decision = _step_record(modules[row], seen, module, int(times_ns[row]), waits)
                raw = None if before is None else before.tobytes()
                if explainer is not None and _has_changed(modules[row], seen, module.index):
                    why = explainer.explain(module.index, raw, states[row].tobytes())
                    decision = replace(decision, why=why)
                if explainer is not None and module.symbol.rest is not None:
                    topics_read = explainer.topics_read(module.index, raw, states[row].tobytes())
                    decision = replace(decision, reads=topics_read)
                if module.plan is not None:
                    number = int(states["topics"][system.topics[module.plan].name][row])
                    decision = replace(decision, plan=module.symbol.plans[number].name)
                yield decision


def margins_s(system: System, module: Module, states: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """margin(M) in s after each of the `states`, (n,), which begin with the run."""
    now, rows = states["header"]["ct"], states["modules"][:, module.index]
    due = decided_rows(system, states)[:, module.index]
    last = np.maximum.accumulate(np.where(due, now, np.iinfo(np.int64).min // 2))
    unsafe = (rows["ttf"] != 0) | (rows["stale"] != 0) | (rows["saw_gate_fault"] != 0)
    looks = np.where(unsafe, 0, np.where(rows["safer"] != 0, module.looks, 1))
    left_ns = looks * module.period_ns - module.late_ns - (now - last)
    margin_s: npt.NDArray[np.float64] = np.where(rows["mode"] != 0, np.maximum(left_ns, 0), 0) / 1e9
    return margin_s


def latched_rows(module: Module, states: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Whether the module's latch keeps AC from control after each of n states: (n,)."""
    in_sc = states["modules"]["mode"][:, module.index] == 0
    if module.latch is None:
        return np.zeros_like(in_sc)
    held = states["topics"][f"{module.name}.latch"]
    waits: npt.NDArray[np.bool_] = held != (
        OPEN if module.acknowledgement is None else ACKNOWLEDGED
    )
    latched: npt.NDArray[np.bool_] = in_sc & waits
    return latched


def _latch_wait_text(module: Module, state: Any) -> str:  # noqa: ANN401 - a state
    """Describes what a module's latch waits for; "" if the latch does not keep AC out."""
    if module.latch is None or not latched_rows(module, state.reshape(1))[0]:
        return ""
    if not module.symbol.acknowledgements:
        return "latched: it returns never"
    name = module.symbol.acknowledgements[0].name
    released = int(state["topics"][f"{module.name}.latch"]) == READY
    return f"latched: waits for {name} to be {'' if released else 'released and '}pressed"


def _step_record(
    modules: Any,  # noqa: ANN401 - rows of modules
    before: Any,  # noqa: ANN401
    module: Module,
    time_ns: int,
    waits: str,
) -> DecisionStepRecord:
    """The record of a DM step; owed outputs are those before it, because AC steps after its DM."""
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
    why = "the system forces this mode" if module.forced else decision_reason(was, after, saw)
    return DecisionStepRecord(
        time_ns, module.name, was, after, saw, why, _margin_s(module, after, saw)
    )


def _margin_s(module: Module, after: Mode, saw: PredicateValues) -> float:
    """How many seconds AC surely keeps control from this step on, called margin(M)."""
    unsafe = saw.ttf or saw.stale or saw.gate_fault
    looks = module.periods_left(unsafe=unsafe, safer=saw.safer)
    return module.margin_ns(looks, 0) / 1e9 if after == "AC" else 0.0


def _has_changed(now: Any, before: Any, module: int) -> bool:  # noqa: ANN401 - rows of modules
    """Whether the facts or the mode of a step differ from those of the step before."""
    facts = ["mode", "ttf", "safer", "stale", "saw_gate_fault"]
    return before is None or bool(now[module][facts] != before[module][facts])


def decision_reason(before: Mode, after: Mode, saw: PredicateValues) -> str:
    """The reason for a DM step's decision in words; "" if AC simply stays."""
    if after == "SC":
        return " and ".join(_reasons_against_ac(saw, staying=before == "SC"))
    return "safer: far enough inside φ_safe" if before == "SC" else ""


def _reasons_against_ac(saw: PredicateValues, *, staying: bool) -> Iterator[str]:
    """Yields, in words, each fact that keeps AC from control."""
    if saw.ttf and not staying:
        yield "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that)"
    if saw.stale:
        yield "stale: an input is older than its max_age, or inputs are of different instants"
    if saw.gate_fault and not staying:
        yield "gate fault: an output of AC was refused"
    if staying and not saw.safer:
        yield "not safer yet"
    if staying and saw.clean_needed:
        yield f"AC owes {saw.clean_needed} clean outputs"
    if staying and saw.latched:
        yield saw.latched
