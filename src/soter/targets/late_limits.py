"""Finds the times that proofs allow components: lateness, response, ages of their reads.

Purpose: `late_limits` and `age_limits` give drivers and loops `late`, `response` and `dropout` of
`verify` blocks to judge by.
Non-goals: the judging (`runtime/posix/`, `runtime/cortex_m/`); whether a machine can keep the times
(`soter.timing`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.check.constants_and_types import declared_ns
from soter.targets.leases import upstream_nodes

if TYPE_CHECKING:
    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System

LATE_NS = 1_000_000
"""The lateness of a component where none is declared; a fifth of its period if that is less."""
SHARE = 5


def late_limits(system: System) -> tuple[list[int], list[int]]:
    """Lateness and response of each component in ns, the least of all modules that declare one."""
    late = [min(LATE_NS, x.period_ns // SHARE) for x in system.components]
    response = list(late)
    for times, kind in ((late, "late"), (response, "response")):
        declared: dict[int, int] = {}
        for module in system.modules:
            for index, ns in _declared_times(system, module, kind):
                declared[index] = min(ns, declared.get(index, ns))
        for index, ns in declared.items():
            times[index] = ns
    return late, response


@dataclass(frozen=True)
class AgeLimit:
    """The greatest age, in ns, that a proof allows a topic when a component reads it."""

    component: int
    topic: int
    most_ns: int


def age_limits(system: System, module: Module) -> tuple[AgeLimit, ...]:
    """The age limits of topics with a `max_age` that SC, or a node before the module, reads.

    `dropout` makes each limit longer; `age` may make those of SC shorter. Topics that the system's
    plants drive have no limit, because the plants determine their ages.
    """
    longer = declared_ns(module, module.symbol.verify.dropout)
    age = module.symbol.verify.age
    ages = []
    for x in (system.components[module.sc], *upstream_nodes(system, module)):
        sc_ages = [declared_ns(module, age)] if age is not None and x.index == module.sc else []
        ages += [
            AgeLimit(x.index, t.index, min([t.max_age_ns, *sc_ages]) + longer)
            for t in (system.topics[i] for i in x.reads)
            if t.max_age_ns is not None and not t.driver.startswith("plant")
        ]
    return tuple(ages)


def _declared_times(system: System, module: Module, kind: str) -> list[tuple[int, int]]:
    verify = module.symbol.verify
    if verify is None:
        return []
    around = module.name.rpartition(".")[0]
    named: dict[str, typed.TypedExpr] = getattr(verify, f"{kind}_of")
    exprs: list[tuple[int | None, typed.TypedExpr | None]] = [
        (module.dm, getattr(verify, f"{kind}_dm")),
        (module.sc, getattr(verify, f"{kind}_sc")),
        *((_component_index(system.components, around, name), e) for name, e in named.items()),
    ]
    return [
        (index, declared_ns(module, expr))
        for index, expr in exprs
        if index is not None and expr is not None
    ]


def _component_index(components: tuple[Component, ...], around: str, name: str) -> int | None:
    full = f"{around}.{name}" if around else name
    return next((x.index for x in components if x.name == full), None)
