"""Checks that RTA modules are well-formed (P1a, P1b), and systems that stand in the world.

Purpose: checks the paper's static conditions on (N_ac, N_sc, N_dm, Delta) on a module's declaration
and on a flattened system, in which every period is known. Finds which topics come from outside and
how late components may be. Checks that a system which `deploys` another one has the same modules,
nodes, parameters, periods and topics, so that the proof is about the same code.
Non-goals: P2a, P2b, P3 (`verify/`), P1c (the timing argument needs execution times); whether ages,
delays and errors from outside are covered (`verify/deploy/proof_transfer.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants_and_types import Calculator
from soter.language.model.types import show_ns, write_ns

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.model import typed
    from soter.language.model.system import Component, External, Module, System, Topic
    from soter.language.model.typed import ModuleSymbol, NodeSymbol


HELPS_MAX = 2
"""Most topics for which the report of P1b has a help each; for more it has one for all."""


def check_module_declaration(
    module: ModuleSymbol,
    diagnostics: Diagnostics,
    damaged: Collection[object] = (),
    others: Collection[NodeSymbol] = (),
) -> None:
    """Checks that AC is not SC, and that both have the same outputs (P1b) if none is `damaged`.

    `others`: the nodes of the program that are in no module, for the help.
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
    if ac in damaged or sc in damaged:
        return
    for node in module.controllers:
        refuse_bursts(module, node, at_ac if node is ac else at_sc, diagnostics)
    if set(ac.publishes) != set(sc.publishes) or not ac.publishes:
        _require_same_outputs(module, diagnostics, others)


def _require_same_outputs(
    module: ModuleSymbol, diagnostics: Diagnostics, others: Collection[NodeSymbol]
) -> None:
    """Reports P1b if AC and SC do not publish the same topics, or publish none."""
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
    helps = [_same_outputs_help(n, ac, sc, drivers) for n in only_ac]
    helps += [_same_outputs_help(n, sc, ac, drivers) for n in only_sc]
    diagnostics.error(
        "P1b",
        f"AC and SC of module `{module.name}` publish different topics",
        at_sc,
        f"publishes {_text_of_outputs(sc)}",
        also=((at_ac, f"publishes {_text_of_outputs(ac)}"),),
        notes=(rule, "; ".join(parts)),
        helps=tuple(helps) if len(helps) <= HELPS_MAX else ("let both publish the same topics",),
    )


def _same_outputs_help(
    topic: str, by: NodeSymbol, other: NodeSymbol, drivers: Mapping[str, str]
) -> str:
    driver = drivers.get(topic)
    if driver is not None:
        return f"leave `{topic}` out of `{by.name}`: `{driver}` publishes it"
    return f"let `{other.name}` publish `{topic}` too"


def refuse_bursts(
    module: ModuleSymbol, node: NodeSymbol, at: Span, diagnostics: Diagnostics
) -> None:
    """Reports M018 for a controller whose step may publish several messages."""
    for topic, limit in node.bursts.items():
        diagnostics.error(
            "M018",
            f"`{node.name}` may publish {limit} messages a step on `{topic.name}`, an output of "
            f"module `{module.name}`",
            at,
            notes=("of what a module publishes each step gives one value, which the gate judges",),
            helps=(f"publish `{topic.name}` without `[<={limit}]`",),
        )


def _text_of_outputs(node: NodeSymbol) -> str:
    return ", ".join(f"`{t.name}`" for t in node.publishes) or "nothing"


def check_periods(system: System, diagnostics: Diagnostics, unknown: Collection[str] = ()) -> None:
    """Checks P1a: neither AC nor SC of a module has a longer period than its DM (ruling 4).

    `unknown` names the components whose period has an error of its own.
    """
    for module in system.modules:
        if system.components[module.dm].name in unknown:
            continue
        for role, index in (("AC", module.ac), ("SC", module.sc)):
            node = system.components[index]
            if node.period_ns > module.period_ns and node.name not in unknown:
                _report_slow_node(module, role, node, diagnostics)


def _report_slow_node(module: Module, role: str, node: Component, diagnostics: Diagnostics) -> None:
    assert node.node is not None
    symbol = module.symbol
    replaced = node.node not in (symbol.ac, symbol.sc)
    at = symbol.ac_span if role == "AC" else symbol.sc_span
    period, delta = node.period_ns, module.period_ns
    steps = f"steps every {show_ns(period)}"
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
            f"set the node's period to {write_ns(delta)} or less, or raise Δ to {write_ns(period)}",
        ),
    )


DIFFERENCES_SHOWN = 8


# ---------------------------------------------------------------- topics from outside, lateness


def check_external_topics(system: System, read: set[int], diagnostics: Diagnostics) -> None:
    """Reports M024 for an external topic that no part uses, or that is declared wrongly."""
    for e in system.externals:
        topic = system.topics[e.topic]
        if topic.driver not in {"", "input"}:
            _check_outgoing_topic(system, e, diagnostics)
            continue
        if e.topic in read:
            continue
        diagnostics.error(
            "M024",
            f"no part of system `{system.name}` publishes or reads `{topic.name}`",
            e.span,
            also=((topic.symbol.span, "the topic"),),
            notes=("an external topic is where a system meets the world",),
            helps=("leave it out, or add the node or module that it belongs to",),
        )


def _check_outgoing_topic(system: System, e: External, diagnostics: Diagnostics) -> None:
    """Reports M024 for an outgoing topic with `every`, `delayed` or `measured`."""
    words_here = [
        word
        for word, is_declared in (
            ("every", e.every_ns is not None),
            ("delayed", e.delay_ns is not None),
            ("measured", any(x is not None for x in e.errors)),
        )
        if is_declared
    ]
    if not words_here:
        return
    topic = system.topics[e.topic]
    words = ", ".join(f"`{w}`" for w in words_here)
    diagnostics.error(
        "M024",
        f"`{topic.name}` does not come from outside: {topic.driver} publishes it",
        e.span,
        f"{words} said here",
        also=((topic.symbol.span, "the topic"),),
        notes=("`every`, `delayed` and `measured` are about what somebody outside publishes",),
        helps=(f"write `external topic {topic.symbol.name};`",),
    )


def topics_from_outside(system: System) -> tuple[External, ...]:
    """Gives the external topics that the world outside the system publishes."""
    return tuple(e for e in system.externals if system.topics[e.topic].driver == "input")


def allowed_lateness(system: System) -> dict[int, int]:
    """Gives component -> the ns by which it may start late, as `verify` blocks declare.

    The DM and SC of a module without such a declaration may not be late; other components are
    included if a block names them. Of several blocks the strictest counts.
    """
    lateness_by_component: dict[int, int] = {}
    for m in system.modules:
        block = m.symbol.verify
        prefix = m.name[: len(m.name) - len(m.name.rpartition(".")[2])]
        calculator = Calculator(Diagnostics(), m.scope.params)
        declared = [(m.dm, block.late_dm), (m.sc, block.late_sc)]
        names = {c.name: c.index for c in system.components}
        declared += [
            (names[prefix + n], e) for n, e in block.late_of.items() if prefix + n in names
        ]
        for index, expr in declared:
            late = 0 if expr is None else int(calculator.value(expr, "`late`") or 0)
            lateness_by_component[index] = min(late, lateness_by_component.get(index, late))
    return lateness_by_component


# ---------------------------------------------------------------- the system that is deployed


def check_deployed(here: System, symbol: typed.SystemSymbol, diagnostics: Diagnostics) -> None:
    """Reports M025 if `here` differs from the system that it deploys in more than plants."""
    model = here.proved
    if model is None or symbol.deploys is None:
        return
    differences = list(_all_differences(here, model))
    if not differences:
        return
    more = len(differences) - DIFFERENCES_SHOWN
    shown = differences[:DIFFERENCES_SHOWN] + ([f"and {more} more"] if more > 0 else [])
    diagnostics.error(
        "M025",
        f"system `{symbol.name}` is not `{model.name}` without its plants",
        symbol.span,
        also=((symbol.deploys.span, "said to be deployed"),),
        notes=tuple(shown),
        helps=(
            "let both have the same modules, nodes, parameters and topics",
            "what was proved holds for that system; verify a system like this one and deploy it",
        ),
    )


def _all_differences(here: System, model: System) -> Iterator[str]:
    yield from _unwanted_parts(here)
    yield from _differences_of_components(here, model)
    theirs = {m.name: m for m in model.modules}
    for m in here.modules:
        if m.name in theirs:
            yield from _differences_of_module(here, m, model, theirs[m.name])
    topics = {t.name: t for t in model.topics}
    for t in here.topics:
        if t.queue_of is None and not t.held and t.name in topics:
            yield from _differences_of_topic(t, topics[t.name])
    yield from _differences_outside(here, model)


def _differences_of_components(here: System, model: System) -> Iterator[str]:
    mine = {c.name: c for c in here.components if c.plant is None}
    proved = {c.name: c for c in model.components if c.plant is None}
    for name in [*proved, *(n for n in mine if n not in proved)]:
        if name not in mine:
            yield f"`{name}` is missing"
        elif name not in proved:
            yield f"`{name}` is not part of `{model.name}`"
        else:
            yield from _differences_of_component(here, mine[name], model, proved[name])
    if mine.keys() == proved.keys() and list(mine) != list(proved):
        yield f"its parts step in another order: {', '.join(mine)}; there {', '.join(proved)}"


def _unwanted_parts(here: System) -> Iterator[str]:
    for c in here.components:
        if c.plant is not None:
            yield f"it has a plant, `{c.name}`: the world itself takes its place"
    for drive in here.inputs:
        yield f"it draws `{here.topics[drive.topic].name}`: somebody outside publishes it"
    if here.faults or here.shuffled:
        yield "it has `faults`, which only runs have"


def _topic_names(system: System, c: Component) -> dict[str, str]:
    return {t.name: system.topics[i].name for t, i in c.scope.topics.items()}


def _parameter_texts(c: Component | Module) -> dict[str, str]:
    return {p.name: repr(v) for p, v in c.scope.params.items()}


def _differences_of_component(
    here: System, mine: Component, model: System, proved: Component
) -> Iterator[str]:
    pairs = (
        ("another declaration", mine.node, proved.node),
        ("another role", mine.role, proved.role),
        ("another period", mine.period_ns, proved.period_ns),
        ("another phase", mine.phase_ns, proved.phase_ns),
        ("other times of a step", mine.takes_ns, proved.takes_ns),
        ("another thread (`inline`)", mine.inline, proved.inline),
        ("other first values", repr(mine.initial), repr(proved.initial)),
        ("other parameters", _parameter_texts(mine), _parameter_texts(proved)),
        ("other topics", _topic_names(here, mine), _topic_names(model, proved)),
        ("other fail-safe values", _failsafe_texts(here, mine), _failsafe_texts(model, proved)),
        ("other modes to read", _module_names(here, mine), _module_names(model, proved)),
    )
    yield from _differences_in(f"`{mine.name}`", pairs)


def _failsafe_texts(system: System, c: Component) -> dict[str, str]:
    return {system.topics[i].name: repr(v) for i, v in c.failsafe.items()}


def _module_names(system: System, c: Component) -> dict[str, str]:
    return {
        m if isinstance(m, str) else m.name: system.modules[i].name
        for m, i in c.scope.modules.items()
    }


def _differences_of_module(
    here: System, mine: Module, model: System, proved: Module
) -> Iterator[str]:
    def texts_around(m: Module) -> dict[str, str]:
        return {p.name: repr(v) for p, v in m.around.items()}

    def shield_cells(m: Module) -> int:
        return 0 if m.shield is None else m.shield.cells

    pairs = (
        ("another declaration", mine.symbol, proved.symbol),
        ("another period", mine.period_ns, proved.period_ns),
        ("another `clean`", mine.clean, proved.clean),
        ("another `shield`", shield_cells(mine), shield_cells(proved)),
        (
            "other parameters",
            (_parameter_texts(mine), texts_around(mine)),
            (_parameter_texts(proved), texts_around(proved)),
        ),
    )
    yield from _differences_in(f"module `{mine.name}`", pairs)
    for name, forced in ((here.name, mine.forced), (model.name, proved.forced)):
        if forced is not None:
            yield f"module `{mine.name}` is forced to {forced.upper()} in `{name}`"


def _differences_of_topic(mine: Topic, proved: Topic) -> Iterator[str]:
    pairs = (
        ("another declaration", mine.symbol, proved.symbol),
        ("another set", repr(mine.bounds), repr(proved.bounds)),
        ("another `max_age`", mine.max_age_ns, proved.max_age_ns),
        ("another first value", repr(mine.default), repr(proved.default)),
    )
    yield from _differences_in(f"topic `{mine.name}`", pairs)


def _differences_in(who: str, pairs: Sequence[tuple[str, object, object]]) -> Iterator[str]:
    for difference, a, b in pairs:
        if a != b:
            yield f"{who} has {difference} there"


def _differences_outside(here: System, model: System) -> Iterator[str]:
    """Yields a text for each topic from outside that no plant or input publishes in `model`."""
    proved = {t.name: t for t in model.topics}
    for e in topics_from_outside(here):
        name = here.topics[e.topic].name
        if name not in proved:
            yield f"topic `{name}` is not part of `{model.name}`"
        elif not (proved[name].driver == "input" or proved[name].driver.startswith("plant")):
            yield f"topic `{name}` is published by {proved[name].driver} there"
