"""The counts of a run: switches, faults, violations.

Purpose: a `Record` is told what each transition reports; no rule reads it.
Non-goals: what a transition reports (`configuration.py`), reports of runs (`simulate/result.py`).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.semantics.configuration import AC, NEVER, DecisionVerdict, StepOutcome

if TYPE_CHECKING:
    from collections.abc import Sequence

NAN_LOOKS_MAX = 2**16 - 1
"""The largest count of a module, which has two bytes of the state."""


@dataclass(slots=True)
class ModuleRecord:
    """The record of a module: the values that its last DM step read, and sums over the run."""

    mode: int
    ttf: bool = False
    safer: bool = False
    stale: bool = False
    gate_fault: bool = False
    switches_to_sc: int = 0
    switches_to_ac: int = 0
    gate_faults: int = 0
    nan_looks: int = 0
    """DM steps in which `ttf` or `safer` compared a NaN, up to `NAN_LOOKS_MAX`."""
    mode_since_ns: int = 0
    """`ct` when the mode last changed; 0 at the start."""
    ac_ns: int = 0
    """Time spent in AC before `mode_since_ns`."""


@dataclass(slots=True)
class ComponentRecord:
    """The step faults of a component; `last_fault` is a `FaultKind` code, 0 if it had no fault."""

    faults: int = 0
    last_fault: int = 0
    latched_ns: int = NEVER


@dataclass(slots=True)
class PropertyRecord:
    """One property: `active` while violated; how often that began; when it first did.

    A contract is judged when its node steps, everything else at the end of instants.
    """

    active: bool = False
    count: int = 0
    first_ns: int = NEVER
    contract: bool = False

    def note_truth(self, ct: int, *, violated: bool) -> None:
        """Notes whether the property is violated at `ct`."""
        if violated and not self.active:
            self.count += 1
            if self.first_ns == NEVER:
                self.first_ns = ct
        self.active = violated


@dataclass(slots=True)
class Record:
    """The records of a run, by the index of each module, component and property."""

    modules: list[ModuleRecord]
    components: list[ComponentRecord]
    properties: list[PropertyRecord] = field(default_factory=list)

    @property
    def violations(self) -> int:
        """Gives how often a violation began, plus the number of latched components."""
        latched = sum(c.latched_ns != NEVER for c in self.components)
        return sum(p.count for p in self.properties) + latched

    def copy(self) -> Record:
        """Gives a copy, with which a caller can fork a run."""
        return copy.deepcopy(self)

    def note_event(self, event: DecisionVerdict | StepOutcome, ct: int) -> None:
        """Adds the report of a transition at `ct` to the records."""
        if isinstance(event, DecisionVerdict):
            self._note_verdict(event, ct)
        else:
            self._note_outcome(event, ct)

    def note_properties(self, violated: Sequence[bool], ct: int) -> None:
        """Records, at the end of the instant `ct`, which properties are violated."""
        for record, now in zip(self.properties, violated, strict=True):
            if not record.contract:
                record.note_truth(ct, violated=now)

    def _note_verdict(self, verdict: DecisionVerdict, ct: int) -> None:
        module = self.modules[verdict.module]
        module.ttf, module.safer = verdict.ttf, verdict.safer
        module.stale, module.gate_fault = verdict.stale, verdict.gate_fault
        module.nan_looks = min(module.nan_looks + verdict.nan, NAN_LOOKS_MAX)
        if verdict.after == verdict.before:
            return
        if verdict.after == AC:
            module.switches_to_ac += 1
        else:
            module.switches_to_sc += 1
            module.ac_ns += ct - module.mode_since_ns
        module.mode, module.mode_since_ns = verdict.after, ct

    def _note_outcome(self, outcome: StepOutcome, ct: int) -> None:
        for index, violated in outcome.contract_violations.items():
            self.properties[index].note_truth(ct, violated=violated)
        if outcome.fault is None:
            return
        component = self.components[outcome.component]
        component.faults += 1
        component.last_fault = int(outcome.fault.kind)
        if outcome.latched:
            component.latched_ns = ct
        if outcome.module is not None:
            self.modules[outcome.module].gate_faults += 1
