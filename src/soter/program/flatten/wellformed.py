"""Well-formedness of RTA modules: P1a, P1b and what they presuppose.

Purpose: the paper's static conditions on (N_ac, N_sc, N_dm, Delta), checked on a flattened
system, where every period is known, and on the module's declaration.
Non-goals: P2a, P2b, P3 (`reach/`), P1c (the timing argument needs execution times).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program.model.durations import show_ns, write_ns

if TYPE_CHECKING:
    from collections.abc import Collection

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.program.model.system import Component, Module, System
    from soter.program.model.typed import ModuleSymbol, NodeSymbol


def check_declaration(
    module: ModuleSymbol, diagnostics: Diagnostics, damaged: Collection[object] = ()
) -> None:
    """AC != SC and P1b: O(N_ac) = O(N_sc); nothing about nodes that have errors of their own."""
    ac, sc = module.ac, module.sc
    at_ac, at_sc = module.ac_span or module.span, module.sc_span or module.span
    if ac is sc:
        diagnostics.error(
            "M002",
            f"`{ac.name}` is both AC and SC of module `{module.name}`",
            at_sc,
            "the safe controller",
            also=((at_ac, "the advanced controller"),),
            notes=("the decision module would switch between a node and itself",),
            helps=("give the module a safe controller of its own",),
        )
        return
    if ac in damaged or sc in damaged:
        return
    ac_out, sc_out = set(ac.publishes), set(sc.publishes)
    if ac_out == sc_out and ac_out:
        return
    rule = "P1b needs O(AC) = O(SC), so that a switch replaces every output"
    if not ac_out and not sc_out:
        diagnostics.error(
            "P1b",
            f"AC and SC of module `{module.name}` publish nothing",
            module.span,
            also=((at_ac, "publishes nothing"), (at_sc, "publishes nothing")),
            notes=("what is not published cannot be switched",),
            helps=("let both publish the same topics",),
        )
        return
    only_ac = sorted(t.name for t in ac_out - sc_out)
    only_sc = sorted(t.name for t in sc_out - ac_out)
    parts = [f"only `{ac.name}` publishes `{n}`" for n in only_ac]
    parts += [f"only `{sc.name}` publishes `{n}`" for n in only_sc]
    helps = [f"let `{sc.name}` publish `{n}` too" for n in only_ac]
    helps += [f"let `{ac.name}` publish `{n}` too" for n in only_sc]
    diagnostics.error(
        "P1b",
        f"AC and SC of module `{module.name}` publish different topics",
        at_sc,
        f"publishes {_listed(sc)}",
        also=((at_ac, f"publishes {_listed(ac)}"),),
        notes=(rule, "; ".join(parts)),
        helps=(helps[0],) if len(helps) == 1 else ("let both publish the same topics",),
    )


def _listed(node: NodeSymbol) -> str:
    return ", ".join(f"`{t.name}`" for t in node.publishes) or "nothing"


def check_periods(system: System, diagnostics: Diagnostics, unknown: Collection[str] = ()) -> None:
    """P1a: delta(N_ac) <= Delta and delta(N_sc) <= Delta (ruling 4).

    `unknown` names the components whose period has an error of its own.
    """
    for module in system.modules:
        if system.components[module.dm].name in unknown:
            continue
        for role, index in (("AC", module.ac), ("SC", module.sc)):
            node = system.components[index]
            if node.period_ns > module.period_ns and node.name not in unknown:
                _slower(module, role, node, diagnostics)


def _slower(module: Module, role: str, node: Component, diagnostics: Diagnostics) -> None:
    assert node.node is not None
    symbol = module.symbol
    replaced = node.node not in (symbol.ac, symbol.sc)
    at = symbol.ac_span if role == "AC" else symbol.sc_span
    own, delta = node.period_ns, module.period_ns
    steps = f"steps every {show_ns(own)}"
    why = (
        "a switch could come too late: P1a needs period(SC) <= Δ"
        if role == "SC"
        else "P1a needs period(AC) <= Δ: the decision module judges what AC does now"
    )
    diagnostics.error(
        "P1a",
        f"`{node.node.name}` is slower than its decision module",
        at or symbol.span,
        f"replaced; it {steps}" if replaced else steps,
        also=((symbol.period.span, f"the decision module samples every {show_ns(delta)}"),),
        notes=(why,),
        helps=(
            f"set the node's period to {write_ns(delta)} or less, or raise Δ to {write_ns(own)}",
        ),
    )
