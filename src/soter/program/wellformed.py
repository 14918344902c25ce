"""Well-formedness of RTA modules: P1a, P1b and what they presuppose.

Purpose: the paper's static conditions on (N_ac, N_sc, N_dm, Delta), checked on a flattened
system, where every period is known, and on the module's declaration.
Non-goals: P2a, P2b, P3 (`reach/`), P1c (the timing argument needs execution times).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program.elaborate import show_ns

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.program.system import Component, Module, System
    from soter.program.typed import ModuleSymbol


def check_declaration(module: ModuleSymbol, diagnostics: Diagnostics) -> None:
    """AC != SC and P1b: O(N_ac) = O(N_sc)."""
    ac, sc = module.ac, module.sc
    if ac is sc:
        diagnostics.error(
            "M002",
            f"`{ac.name}` is both AC and SC of module `{module.name}`",
            module.span,
            notes=("the decision module would switch between a node and itself",),
            helps=("give the module a safe controller of its own",),
        )
        return
    ac_out, sc_out = set(ac.publishes), set(sc.publishes)
    if ac_out != sc_out:
        only_ac = sorted(t.name for t in ac_out - sc_out)
        only_sc = sorted(t.name for t in sc_out - ac_out)
        parts = [f"only `{ac.name}` publishes `{n}`" for n in only_ac]
        parts += [f"only `{sc.name}` publishes `{n}`" for n in only_sc]
        diagnostics.error(
            "P1b",
            f"AC and SC of module `{module.name}` publish different topics",
            module.span,
            also=(
                (ac.span, "AC publishes " + (", ".join(f"`{t.name}`" for t in ac.publishes) or "nothing")),
                (sc.span, "SC publishes " + (", ".join(f"`{t.name}`" for t in sc.publishes) or "nothing")),
            ),
            notes=("; ".join(parts), "P1b needs O(N_ac) = O(N_sc), so that a switch replaces every output"),
            helps=("let both publish the same topics",),
        )
    elif not ac_out:
        diagnostics.error(
            "P1b", f"AC and SC of module `{module.name}` publish nothing", module.span
        )


def check_periods(system: System, diagnostics: Diagnostics) -> None:
    """P1a: delta(N_ac) <= Delta and delta(N_sc) <= Delta (ruling 4)."""
    for module in system.modules:
        for role, index in (("AC", module.ac), ("SC", module.sc)):
            node = system.components[index]
            if node.period_ns > module.period_ns:
                _slower(module, role, node, diagnostics)


def _slower(module: Module, role: str, node: Component, diagnostics: Diagnostics) -> None:
    assert node.node is not None
    why = (
        "a switch could come too late: P1a needs period(SC) <= Δ"
        if role == "SC"
        else "P1a needs period(AC) <= Δ"
    )
    own, delta = show_ns(node.period_ns), show_ns(module.period_ns)
    diagnostics.error(
        "P1a",
        f"`{node.node.name}` is slower than its decision module",
        node.node.period.span,
        f"steps every {own}",
        also=((module.symbol.period.span, f"the decision module samples every {delta}"),),
        notes=(why,),
        helps=(f"set the node's period to {delta} or less, or raise Δ to {own}",),
    )
