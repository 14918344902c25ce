"""A configuration: the paper's (L, OE, ct, FN, Topics), with what the rulings beyond it need.

Purpose: the whole state of a system is one immutable value: a rule makes a new one, so that a
search keeps the old one. OE of every controller follows from the mode of its module (dm1 and dm2
of the paper's DM-Step). Observers get a report of each transition, which no rule reads.
Non-goals: deciding a mode (`rules.py`), latches (`latches.py`), sums over a run (`run_record.py`),
the bytes of a state (`core/layout.py`), the hidden state of externs, which lives with them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
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
    """Per component: whether it is trusted and has faulted: it only repeats fail-safe values."""
    had_control: tuple[bool, ...]
    """Per component: OE at its last complete step, which `on takeover` needs."""
    gate_fault: tuple[bool, ...]
    """Per module: whether AC faulted in control, and the DM has not seen that yet."""
    clean_needed: tuple[int, ...]
    """Per module: how many clean steps AC must still make before it may have control."""


def with_value(values: tuple[Value, ...], index: int, value: Value) -> tuple[Value, ...]:
    """Gives a copy of `values` that has `value` at `index`."""
    return (*values[:index], value, *values[index + 1 :])


SC, AC = 0, 1
"""The members of `types.MODE`."""


@dataclass(frozen=True, slots=True)
class DecisionVerdict:
    """The values that a DM step read and decided; `gate_fault` is from before the step."""

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
    """The report of a step of a plant or node.

    `published` maps topic indices to the values that reached the topics. `module` is set for a gate
    fault: the module of the faulty AC. `latched`: whether this step latched the component. `bursts`
    has all messages of topics of which a step may publish several; `published` has the last.
    """

    component: int
    published: Mapping[int, Value]
    fault: StepFault | None = None
    module: int | None = None
    latched: bool = False
    contract_violations: Mapping[int, bool] = field(default_factory=dict)
    """Of each contract that was checked, by property index: whether it was violated."""
    bursts: Mapping[int, tuple[Value, ...]] = field(default_factory=dict)

    @property
    def violated(self) -> tuple[int, ...]:
        """Gives the indices of the contract properties that this step violated."""
        return tuple([i for i, violated in self.contract_violations.items() if violated])


def enabled_outputs(oe: Sequence[bool], module: Module, mode: int) -> tuple[bool, ...]:
    """Gives `oe` (whose outputs are enabled) as it becomes when a module enters this mode."""
    flags = list(oe)
    flags[module.sc] = mode == SC
    flags[module.ac] = mode == AC
    return tuple(flags)


def enabled_at_first(system: System, modes: Sequence[int]) -> tuple[bool, ...]:
    """Gives OE at the start, in these modes; outputs of all but controllers are enabled."""
    oe: tuple[bool, ...] = (True,) * len(system.components)
    for module, mode in zip(system.modules, modes, strict=True):
        oe = enabled_outputs(oe, module, mode)
    return oe
