"""The problem of the fail-safe law: the module with its law in the place of SC.

Purpose: `law_problem`: what the core K_fs of a declared law is computed from (docs/proof.md, "When
the trusted part stops"). The law is a constant for each output, so SC reads nothing there.
Non-goals: the sets (`verify/claims/failsafe_claim.py`), the lease (`verify/time/schedule.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.elaborate import derived_systems
from soter.language.model import typed

if TYPE_CHECKING:
    from soter.language.model.system import Component, Module, System


def under_law(flat: System, module: Module) -> tuple[System, Module]:
    """The flying system with the law in the place of SC, and the module there; it has no law.

    Periods, phases, lateness and latencies stay those of SC.
    """
    sc = flat.components[module.sc]
    made = derived_systems.with_components(flat, [_lawful(sc, module)])
    itself = replace(module, symbol=_ruled(module.symbol, made.components[module.sc]), law={})
    if module.whole is not None:
        itself.whole = _ruled(module.whole, made.components[module.sc])
    return derived_systems.with_module(made, itself), itself


def behind(flat: System, module: Module) -> str:
    """Why what the actuators hold is not what the module publishes; "" where it is.

    A node that reads the module's outputs stops with the trusted part, and what it would have made
    of the law nobody holds.
    """
    outputs = set(module.outputs)
    for c in flat.components:
        if c.node is None or c.index in (module.ac, module.sc):
            continue
        read = {c.scope.topics[s.topic] for s in c.node.subscribes}
        if outputs & (read | {flat.topics[i].queue_of for i in read}):
            return f"`{c.name}` reads what the module publishes: it would stop, too"
    return ""


def _lawful(sc: Component, module: Module) -> Component:
    assert sc.node is not None
    step = tuple(typed.TypedPublish(e.span, t, e) for t, e in module.symbol.failsafe.items())
    node = replace(sc.node.doing(step), takes=None)
    return replace(sc, node=node, initial=(), failsafe={}, binding=None)


def _ruled(symbol: typed.ModuleSymbol, sc: Component) -> typed.ModuleSymbol:
    assert sc.node is not None
    return replace(symbol, sc=sc.node, failsafe={})
