"""Modules above each other: who has control through whom, read off the running system: an extra.

Purpose: `refuse_unproved_towers`: which module of a tower is followed here, and that all of its
controllers publish what it publishes; `slowest_below`: as often as P1a asks.
Non-goals: sharing code with `verify/problem/extract.py`, which the prover goes by; what a module
takes from the one above it (`module_above.py`).

To the theorem an AC is anything that publishes values of the declared sets, and what it publishes
once the DM says SC is dropped. A module in the place of AC is that: a controller of it has control
only while the mode of every module above it is AC (docs/semantics.md, Modules above modules), and
each of its steps checks its values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.terms.terms import NotRecheckedError
from soter.language.model.system import modules_above

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import Module, System


def refuse_unproved_towers(facts: Facts) -> None:
    """`NotRecheckedError` for a module of a tower that no theorem here is about."""
    system, module, symbol = facts.flying, facts.flying_module, facts.flying_module.symbol
    name = module.name
    for c in facts.commanding:
        assert c.node is not None
        if {c.scope.topics[t] for t in c.node.publishes} != set(module.outputs):
            raise NotRecheckedError(f"`{c.name}` does not publish what `{name}` does")
    uppers = modules_above(system, module.index)
    if len(uppers) > 1:
        raise NotRecheckedError(f"`{name}` stands below two other modules")
    for above in uppers:
        if above.forced is not None:
            raise NotRecheckedError(f"`{above.name}`, above `{name}`, is forced to {above.forced}")
        if symbol.verify.views or symbol.shield is not None or symbol.verify.enters is not None:
            raise NotRecheckedError(
                f"`{name}` stands below another module, and has views or a shield"
            )


def slowest_below(system: System, module: Module) -> int:
    """The longest period in ns of its SC and of all that stands in the place of its AC."""
    parts = {system.components[module.sc].period_ns, system.components[module.ac].period_ns}
    below = module.over
    while below is not None:
        m = system.modules[below]
        parts |= {system.components[i].period_ns for i in (m.dm, m.sc, m.ac)}
        below = m.over
    return max(parts)
