"""Modules above each other: who has control through whom, read off the running system.

Purpose: `tower_of`, `above_of`, `refuse_unproved_towers`: which module of a tower is followed here,
and that all of its controllers publish what it publishes, as often as P1a asks.
Non-goals: sharing code with `verify/problem/extract.py`, which the prover goes by.

To the theorem an AC is anything that publishes values of the declared sets, and what it publishes
once the DM says SC is dropped. A module in the place of AC is that: a controller of it has control
only while the mode of every module above it is AC (docs/semantics.md, Modules above modules), and
each of its steps checks its values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.terms.terms import NotRecheckedError

if TYPE_CHECKING:
    from soter.language.model.system import Component, Module, System


def tower_of(system: System, module: Module) -> list[Module]:
    """All modules of the tower that one stands in, in the order of the system."""
    linked = {module.index}
    for _ in system.modules:
        for m in system.modules:
            if m.over is not None and {m.index, m.over} & linked:
                linked |= {m.index, m.over}
    return [m for m in system.modules if m.index in linked]


def refuse_unproved_towers(system: System, module: Module) -> None:
    """`NotRecheckedError` for a module of a tower that no theorem here is about."""
    if len(tower_of(system, module)) == 1:
        return
    for c in commanding(system, module):
        assert c.node is not None
        if {c.scope.topics[t] for t in c.node.publishes} != set(module.outputs):
            raise NotRecheckedError(f"`{c.name}` does not publish what `{module.name}` does")
    above = above_of(system, module)
    if above is None:
        return
    name, symbol = module.name, module.symbol
    if above_of(system, above) is not None:
        raise NotRecheckedError(f"`{name}` stands below two other modules")
    if above.forced is not None:
        raise NotRecheckedError(f"`{above.name}`, above `{name}`, is forced to {above.forced}")
    if symbol.verify.views or symbol.shield is not None or symbol.verify.enters is not None:
        raise NotRecheckedError(f"`{name}` stands below another module, and has views or a shield")


def above_of(system: System, module: Module) -> Module | None:
    """The module whose AC is this one; None: nobody's is."""
    return next((m for m in system.modules if m.over == module.index), None)


def commanding(system: System, module: Module) -> list[Component]:
    """The controllers of all modules of a tower."""
    return [
        c
        for m in tower_of(system, module)
        for c in system.components
        if c.module == m.index and c.role in ("ac", "sc")
    ]


def slowest_below(system: System, module: Module) -> int:
    """The longest period in ns of its SC and of all that stands in the place of its AC."""
    parts = {system.components[module.sc].period_ns, system.components[module.ac].period_ns}
    below = module.over
    while below is not None:
        m = system.modules[below]
        parts |= {system.components[i].period_ns for i in (m.dm, m.sc, m.ac)}
        below = m.over
    return max(parts)
