"""Well-formedness of RTA modules: P1a, P1b and what they presuppose.

Purpose: the paper's static conditions on (N_ac, N_sc, N_dm, Delta), checked on a flattened
system, where every period is known, and on the module's declaration.
Non-goals: P2a, P2b, P3 (`verify/`), P1c (the timing argument needs execution times).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.durations import show_ns, write_ns

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import ModuleSymbol, NodeSymbol


HELPS_MAX = 2
"""Of so many topics it is said what to do with each."""


def check_declaration(
    module: ModuleSymbol,
    diagnostics: Diagnostics,
    damaged: Collection[object] = (),
    others: Collection[NodeSymbol] = (),
) -> None:
    """AC != SC and P1b: O(N_ac) = O(N_sc); nothing about nodes that have errors of their own.

    `others`: the nodes of the program that no module has, for what is advised.
    """
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
    if ac in damaged or sc in damaged or set(module.below) & set(damaged):
        return
    _decided_by_itself(module, diagnostics)
    for below in module.below:
        if sc in below.own:
            _shared_sc(module, below, at_sc, diagnostics)
            return
    for node in module.own:
        check_messages(module, node, at_ac if node is ac else at_sc, diagnostics)
    if set(ac.publishes) != set(sc.publishes) or not ac.publishes:
        _different_outputs(module, diagnostics, others)


def _different_outputs(
    module: ModuleSymbol, diagnostics: Diagnostics, others: Collection[NodeSymbol]
) -> None:
    """P1b where AC and SC do not publish the same, or nothing."""
    ac, sc = module.ac, module.sc
    at_ac, at_sc = module.ac_span or module.span, module.sc_span or module.span
    ac_out, sc_out = set(ac.publishes), set(sc.publishes)
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
    drivers = {t.name: n.name for n in others for t in n.publishes}
    helps = [_same_outputs(n, ac, sc, drivers) for n in only_ac]
    helps += [_same_outputs(n, sc, ac, drivers) for n in only_sc]
    diagnostics.error(
        "P1b",
        f"AC and SC of module `{module.name}` publish different topics",
        at_sc,
        f"publishes {_listed(sc)}",
        also=((at_ac, f"publishes {_listed(ac)}"),),
        notes=(rule, "; ".join(parts)),
        helps=tuple(helps) if len(helps) <= HELPS_MAX else ("let both publish the same topics",),
    )


def _same_outputs(topic: str, by: NodeSymbol, other: NodeSymbol, drivers: Mapping[str, str]) -> str:
    """What to do about a topic that only one of the two publishes; a topic has one driver."""
    driver = drivers.get(topic)
    if driver is not None:
        return f"leave `{topic}` out of `{by.name}`: `{driver}` publishes it"
    return f"let `{other.name}` publish `{topic}` too"


def _decided_by_itself(module: ModuleSymbol, diagnostics: Diagnostics) -> None:
    """M019 where `ttf` and `safer` would have to be computed: only a proof could."""
    over = module.over
    if over is None:
        return
    for m in (module, over) if over.over is None else (module,):
        if m.rest is not None and m is module:
            continue  # `ac module` beside `rest`: told where it is declared
        if m.rest is not None:
            diagnostics.error(
                "M029",
                f"module `{m.name}` has `rest`, and stands in the place of an AC",
                module.ac_span or module.span,
                also=((m.rest.span, "`rest`"),),
                notes=("nothing is known yet of towers whose modules follow SC at run time",),
                helps=("give the module above an AC that is a node",),
            )
        elif m.ttf is None and m.safer is None:
            diagnostics.error(
                "M019",
                f"module `{m.name}` has no `ttf` and no `safer`, and nothing computes them here",
                module.ac_span or module.span,
                "a module in the place of AC" if m is module else f"`{m.name}` is below a module",
                also=((m.span, "declared here"),),
                notes=("they are computed for modules that can be proved where they stand",),
                helps=("write `ttf ...;` and `safer ...;`",),
            )


def _shared_sc(
    module: ModuleSymbol, below: ModuleSymbol, at: Span, diagnostics: Diagnostics
) -> None:
    diagnostics.error(
        "M002",
        f"`{module.sc.name}` is SC of module `{module.name}` and a controller of `{below.name}`",
        at,
        "the safe controller",
        also=((below.span, f"`{below.name}` stands in the place of AC"),),
        notes=("one node cannot have control in two ways",),
        helps=("give the module a safe controller of its own",),
    )


def check_messages(
    module: ModuleSymbol, node: NodeSymbol, at: Span, diagnostics: Diagnostics
) -> None:
    """M018 for a controller whose step may publish several messages."""
    for topic, limit in node.bursts.items():
        diagnostics.error(
            "M018",
            f"`{node.name}` may publish {limit} messages a step on `{topic.name}`, an output of "
            f"module `{module.name}`",
            at,
            notes=("of what a module publishes each step gives one value, which the gate judges",),
            helps=(f"publish `{topic.name}` without `[<={limit}]`",),
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
        if module.over is not None:
            _slower_below(system, module, diagnostics, unknown)
        own = (("AC", module.ac), ("SC", module.sc))
        for role, index in own if module.over is None else own[1:]:
            node = system.components[index]
            if node.period_ns > module.period_ns and node.name not in unknown:
                _slower(module, role, node, diagnostics)


def _slower_below(
    system: System, module: Module, diagnostics: Diagnostics, unknown: Collection[str]
) -> None:
    """P1a of a module in the place of AC: its decision module and controllers keep up."""
    assert module.over is not None
    below = system.modules[module.over]
    for index in (below.dm, below.ac, below.sc) if below.over is None else (below.dm, below.sc):
        c = system.components[index]
        if c.period_ns <= module.period_ns or c.name in unknown:
            continue
        what = f"`{c.node.name}`" if c.node is not None else f"the DM of `{below.symbol.name}`"
        diagnostics.error(
            "P1a",
            f"{what} is slower than the decision module of `{module.symbol.name}`",
            module.symbol.ac_span or module.symbol.span,
            f"{what} steps every {show_ns(c.period_ns)}",
            also=((module.symbol.period.span, f"samples every {show_ns(module.period_ns)}"),),
            notes=("P1a asks it of everything that stands in the place of AC",),
            helps=(f"raise this period to {write_ns(c.period_ns)} or more",),
        )


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
