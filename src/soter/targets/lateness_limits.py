"""How late a component may be in real time, and how old what is read: what proofs assume.

Purpose: `late`, `response` and `dropout` of `verify` blocks, for drivers and loops to judge by; and
how long after a fault of an AC in another process the first output of SC is there (`Takeover`).
Non-goals: whether they can be kept on a machine (response-time analysis).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lcm
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants import Calculator
from soter.language.model.durations import show_ns
from soter.targets.leases import on_the_way

if TYPE_CHECKING:
    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System

LATE_NS = 1_000_000
"""Where nothing is declared, or a fifth of the period if that is less."""
SHARE = 5


RELEASES_MAX = 100_000
"""So many releases of an AC are gone through; beyond, the sum of the periods is the bound."""


@dataclass(frozen=True)
class Takeover:
    """From a request that AC leaves without a right answer to the output of SC; times in ns.

    A request is made at a release of AC and its budget is a period: at the next release at the
    latest the driver sees that there is no answer. The DM decides at its next release from then
    on, SC steps at its own next one, the same instant included in either case (AC's answer is
    looked at first, then come DMs, then SCs). `turn`: the longest time from the request to that
    release of SC, over all releases of AC. `work`: how late SC's step and the decision before it
    may end.
    """

    module: str
    turn: int
    work: int

    @property
    def longest(self) -> int:
        """The bound, where nobody in the trusted thread is later than `work` says."""
        return self.turn + self.work

    @property
    def text(self) -> str:
        """In words."""
        return (
            f"{self.module}: the first output of SC comes at most {show_ns(self.longest)} after a "
            f"request that AC does not answer ({show_ns(self.turn)} until it is SC's turn, "
            f"{show_ns(self.work)} of work)"
        )


def takeovers(system: System) -> list[Takeover]:
    """The bound of every module whose AC is an extern node."""
    late, response = limits_of(system)
    bounds = []
    for m in system.modules:
        if not system.components[m.ac].extern:
            continue
        dm, sc, ac = (system.components[i] for i in (m.dm, m.sc, m.ac))
        work = max(late[sc.index], late[dm.index] + response[dm.index]) + response[sc.index]
        bounds.append(Takeover(m.name, longest_turn(ac, dm, sc), work))
    return bounds


def longest_turn(ac: Component, dm: Component, sc: Component) -> int:
    """From a release of AC to the release of SC that stands in for it, at most."""
    hyper = lcm(ac.period_ns, dm.period_ns, sc.period_ns)
    if hyper // ac.period_ns > RELEASES_MAX:
        first = max(dm.phase_ns, sc.phase_ns)
        return ac.period_ns + dm.period_ns + sc.period_ns + first
    end = max(ac.phase_ns, dm.phase_ns, sc.phase_ns) + 2 * hyper
    return max(
        _from(sc, _from(dm, release + ac.period_ns)) - release
        for release in range(ac.phase_ns, end, ac.period_ns)
    )


def _from(c: Component, time: int) -> int:
    """The first release at a time or after it."""
    return max(c.phase_ns, time + (c.phase_ns - time) % c.period_ns)


def limits_of(system: System) -> tuple[list[int], list[int]]:
    """Lateness and response of each component, ns; the least of all modules that declare one."""
    late = [min(LATE_NS, x.period_ns // SHARE) for x in system.components]
    response = list(late)
    declared: tuple[dict[int, int], dict[int, int]] = ({}, {})
    for module in system.modules:
        for times_by_component, what in zip(declared, ("late", "response"), strict=True):
            for index, ns in _of_module(system, module, what):
                times_by_component[index] = min(ns, times_by_component.get(index, ns))
    for index, ns in declared[0].items():
        late[index] = ns
    for index, ns in declared[1].items():
        response[index] = ns
    return late, response


@dataclass(frozen=True)
class AgeLimit:
    """How old a topic may be where a component reads it, ns: older no proof speaks of."""

    component: int
    topic: int
    most_ns: int


def ages_of(system: System, module: Module) -> tuple[AgeLimit, ...]:
    """Of topics with a `max_age` that SC and the nodes between sensors and module read.

    A sensor may be silent for `dropout` longer. What plants of the system drive is left out: it is
    as old as they say.
    """
    dropout = module.symbol.verify.dropout
    given = None
    if dropout is not None:
        given = Calculator(Diagnostics(), module.scope.params).value(dropout, "a time")
    longer = given if isinstance(given, int) else 0
    ages = []
    for x in (system.components[module.sc], *on_the_way(system, module)):
        read = () if x.node is None else (x.scope.topics[s.topic] for s in x.node.subscribes)
        topics = (system.topics[i] for i in read)
        ages += [
            AgeLimit(x.index, t.index, t.max_age_ns + longer)
            for t in topics
            if t.max_age_ns is not None and not t.driver.startswith("plant")
        ]
    return tuple(ages)


def _of_module(system: System, module: Module, what: str) -> list[tuple[int, int]]:
    verify = module.symbol.verify
    if verify is None:
        return []
    calculator = Calculator(Diagnostics(), module.scope.params)
    around = module.name.rpartition(".")[0]
    named: dict[str, typed.TypedExpr] = getattr(verify, f"{what}_of")
    given: list[tuple[int | None, typed.TypedExpr | None]] = [
        (module.dm, getattr(verify, f"{what}_dm")),
        (module.sc, getattr(verify, f"{what}_sc")),
        *((_index(system.components, around, name), e) for name, e in named.items()),
    ]
    times = []
    for index, expr in given:
        value = None if expr is None else calculator.value(expr, "a time")
        if index is not None and isinstance(value, int):
            times.append((index, value))
    return times


def _index(components: tuple[Component, ...], around: str, name: str) -> int | None:
    full = f"{around}.{name}" if around else name
    return next((x.index for x in components if x.name == full), None)
