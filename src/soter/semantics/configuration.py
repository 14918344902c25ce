"""A configuration: the paper's (L, OE, ct, FN, Topics), who has control, and records beside it.

Purpose: the whole state of a system is one immutable value: a rule makes a new one, so that a
search keeps the old one. OE of every controller follows from the mode of its module (dm1 and dm2
of the paper's DM-Step); latches are moved here. Observers get what each transition reports, and the
sums over a run (`Record`): no rule reads any of this.
Non-goals: deciding a mode (`rules.py`), the bytes of a state (`core/layout.py`), the hidden state
of externs, which lives with them.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.evaluate.arithmetic import StepFault
    from soter.language.model.system import Module, System
    from soter.language.model.types import Value


NEVER = -(2**62)
"""The stamp of a topic before its first publication; of a queue, always but for `LOST`."""

LOST = 0
"""The stamp of a queue with the policy `fault` that was full: its reader will fault."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """(L, OE, ct, FN, Topics), and what the gate and the rulings on time need.

    Indices are those of `System.components`, `.topics` and `.modules`.
    """

    L: tuple[Value, ...]
    """Per component: a node's locals, a plant's states (tuples), a DM's mode (of type MODE)."""
    OE: tuple[bool, ...]
    """Per component: whether its outputs are enabled. Only those of an AC and an SC change."""
    ct: int
    """The current time in ns; -1 before the first instant."""
    FN: tuple[int, ...]
    """Components that still have to fire at `ct`: a set, written in deployed order."""
    Topics: tuple[Value, ...]
    """The globally visible value of every topic."""
    stamps: tuple[int, ...]
    """Per topic: `ct` of its last publication, NEVER before the first."""
    latched: tuple[bool, ...]
    """Per component: trusted and faulted once; it only repeats its fail-safe values."""
    had_control: tuple[bool, ...]
    """Per component: OE at its last completed step (for `on takeover`)."""
    gate_fault: tuple[bool, ...]
    """Per module: the AC faulted while in control, and the DM has not seen it yet."""
    clean_needed: tuple[int, ...]
    """Per module: complete outputs the AC still owes before it may have control."""


def with_value(values: tuple[Value, ...], index: int, value: Value) -> tuple[Value, ...]:
    """`values[index -> value]`."""
    return (*values[:index], value, *values[index + 1 :])


SC, AC = 0, 1
"""The members of `types.MODE`."""


@dataclass(frozen=True, slots=True)
class DecisionVerdict:
    """What a DM step saw and decided; `gate_fault` as it was before the step cleared it."""

    module: int
    ttf: bool
    safer: bool
    stale: bool
    gate_fault: bool
    before: int
    after: int
    nan: bool = False
    """Whether `ttf` or `safer` compared a NaN."""


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """What a plant's or node's step did.

    `published` holds what reached the topics, by topic index. `module` is set for a gate fault:
    the module whose AC it was. `latched` says that this step latched the component. `judged` has
    the contracts that were checked, by property index: whether each was violated. `bursts` has all
    messages of topics of which a step may publish several; `published` the last.
    """

    component: int
    published: Mapping[int, Value]
    fault: StepFault | None = None
    module: int | None = None
    latched: bool = False
    judged: Mapping[int, bool] = field(default_factory=dict)
    bursts: Mapping[int, tuple[Value, ...]] = field(default_factory=dict)

    @property
    def broken(self) -> tuple[int, ...]:
        """The contracts that this step violated, as property indices."""
        return tuple([i for i, violated in self.judged.items() if violated])


NAN_LOOKS_MAX = 2**16 - 1
"""The largest count of a module, which has two bytes of the state."""


@dataclass(slots=True)
class ModuleRecord:
    """One module: what the last DM step saw, and sums over the run."""

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
    """One component: its step faults. `last_fault` is a `FaultKind` code, 0 for none."""

    faults: int = 0
    last_fault: int = 0
    latched_ns: int = NEVER


@dataclass(slots=True)
class PropertyRecord:
    """One property: `active` while violated; `count` of onsets; time of the first.

    A contract is judged when its node steps, everything else at the end of instants.
    """

    active: bool = False
    count: int = 0
    first_ns: int = NEVER
    contract: bool = False

    def note(self, ct: int, *, violated: bool) -> None:
        """Note whether it is violated at `ct`."""
        if violated and not self.active:
            self.count += 1
            if self.first_ns == NEVER:
                self.first_ns = ct
        self.active = violated


@dataclass(slots=True)
class Record:
    """The sums over a run, by module, component and property index."""

    modules: list[ModuleRecord]
    components: list[ComponentRecord]
    properties: list[PropertyRecord] = field(default_factory=list)

    @property
    def violations(self) -> int:
        """Onsets of violated properties, and latched components."""
        latched = sum(c.latched_ns != NEVER for c in self.components)
        return sum(p.count for p in self.properties) + latched

    def copy(self) -> Record:
        """A record to fork a run with."""
        return copy.deepcopy(self)

    def note(self, event: DecisionVerdict | StepOutcome, ct: int) -> None:
        """Add what a transition at `ct` reports."""
        if isinstance(event, DecisionVerdict):
            self._note_verdict(event, ct)
        else:
            self._note_outcome(event, ct)

    def note_properties(self, violated: Sequence[bool], ct: int) -> None:
        """Add the properties' values at the end of the instant `ct`."""
        for record, now in zip(self.properties, violated, strict=True):
            if not record.contract:
                record.note(ct, violated=now)

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
        for index, violated in outcome.judged.items():
            self.properties[index].note(ct, violated=violated)
        if outcome.fault is None:
            return
        component = self.components[outcome.component]
        component.faults += 1
        component.last_fault = int(outcome.fault.kind)
        if outcome.latched:
            component.latched_ns = ct
        if outcome.module is not None:
            self.modules[outcome.module].gate_faults += 1


WAITS, READY, ACKNOWLEDGED = 0, 1, 2
OPEN, CLOSED = 0, 1


def enabled_outputs(oe: Sequence[bool], module: Module, mode: int) -> tuple[bool, ...]:
    """Gives OE, which outputs are enabled, after the mode of a module was decided."""
    flags = list(oe)
    flags[module.sc] = mode == SC
    flags[module.ac] = mode == AC
    return tuple(flags)


def enabled_at_first(system: System, modes: Sequence[int]) -> tuple[bool, ...]:
    """Gives OE at the start; every component that is no controller has its outputs enabled."""
    oe: tuple[bool, ...] = (True,) * len(system.components)
    for module, mode in zip(system.modules, modes, strict=True):
        oe = enabled_outputs(oe, module, mode)
    return oe


# ---------------------------------------------------------------- latches


def latch_seen(
    system: System, c: Configuration, module: Module, mode: int
) -> tuple[Configuration, bool]:
    """Gives the configuration after a DM looks at its latch, and whether AC may have control.

    An acknowledgement is a press after a release, both published after the takeover. A press that
    is older than the `max_age` of its topic when the DM reads it does not count, and is spent.
    """
    if module.latch is None or mode != SC:
        return c, True
    if module.acknowledgement is None:
        return c, c.Topics[module.latch] == OPEN
    max_age = system.topics[module.acknowledgement].max_age_ns
    assert max_age is not None, "M028"
    held, since = c.Topics[module.latch], c.stamps[module.latch]
    pressed, stamp = c.Topics[module.acknowledgement], c.stamps[module.acknowledgement]
    if since == NEVER:  # the first look of this start: only what comes after it counts
        since = c.ct
    if held == ACKNOWLEDGED and c.ct - since > max_age:
        held = WAITS
    if stamp > since and held == WAITS and not pressed:
        held, since = READY, stamp
    elif stamp > since and held == READY and pressed:
        held, since = ACKNOWLEDGED if c.ct - stamp <= max_age else WAITS, stamp
    return _remember_latch(c, module.latch, held, since), held == ACKNOWLEDGED


def latch_switched(c: Configuration, module: Module, after: int) -> Configuration:
    """Gives the latch after a change of mode: a takeover sets it and spends the acknowledgement."""
    if module.latch is None:
        return c
    if module.acknowledgement is None:
        return _remember_latch(c, module.latch, CLOSED, NEVER)
    return _remember_latch(c, module.latch, WAITS, NEVER if after == AC else c.ct)


def plan_chosen(c: Configuration, module: Module, after: int, plan: int | None) -> Configuration:
    """Stores the plan that was found good with a verdict "AC", which SC follows from then on."""
    if after != AC or plan is None or module.plan is None or module.forced is not None:
        return c
    return replace(c, Topics=with_value(c.Topics, module.plan, plan))


def _remember_latch(c: Configuration, latch: int, held: int, since: int) -> Configuration:
    topics = with_value(c.Topics, latch, held)
    return replace(c, Topics=topics, stamps=with_value(c.stamps, latch, since))
