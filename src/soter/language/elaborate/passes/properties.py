"""Collects the properties by which runs of a flat system are judged.

Purpose: makes properties of systems and tests, contracts of nodes and modules, and measures of
campaigns, each with the scope of its names, and enters in scopes what `mode(M)` means.
Non-goals: judging (`semantics/`, `explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.passes.topics import topic_index_at
from soter.language.model import typed
from soter.language.model.system import Metric, Property, Scope, TimedProperty
from soter.language.model.tree_walk import margin_reads, mode_reads, nodes, topic_reads

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.elaborate.passes.flattening import Flattening, ReplacedModule, SubSystem
    from soter.language.model.system import Module

MAX_BINS = 1_000


def enter_modes_in_scopes(flat: Flattening) -> None:
    """Enters in the scope of each component the modules whose `mode(M)` its code reads."""
    prefixes = {p.name: p.prefix for p in flat.placed}
    beside: dict[tuple[str, object], list[Module]] = {}
    for m in flat.modules:
        beside.setdefault((prefixes[m.name], m.symbol), []).append(m)
    for component in flat.components:
        home: str = component.name
        code: tuple[object, ...] = ()
        if component.module is not None:
            module = flat.modules[component.module]
            home, code = module.name, module.symbol.expressions
        if (node := component.node) is not None:
            code = (*node.step, *(node.takeover or ()), *node.assumes, *node.guarantees)
        wanted = mode_reads(*code)
        margins = margin_reads(*code) if wanted else set()
        for symbol, read in wanted.items():
            candidates = beside.get((prefixes[home], symbol), [])
            if len(candidates) == 1:
                component.scope.modules[symbol] = candidates[0].index
                flat.margins += [candidates[0].index] if symbol in margins else []
            elif isinstance(symbol, typed.ModuleSymbol):
                _report_no_module(flat, symbol, len(candidates), read, f"beside `{component.name}`")


def _report_no_module(
    flat: Flattening, symbol: typed.ModuleSymbol, count: int, read: typed.TypedExpr, where: str
) -> None:
    if count == 0 and flat.partial:
        return
    gone = [g for g in flat.gone.values() if g.symbol is symbol]
    if count == 0 and gone:
        _report_mode_is_gone(flat, symbol.name, gone[0], read.span)
        return
    flat.diagnostics.error(
        "M013",
        f"there is no module `{symbol.name}` {where}"
        if count == 0
        else f"there are {count} modules `{symbol.name}` {where}, and it is not clear which "
        "one is meant",
        read.span,
        "its mode is read here",
        also=((flat.symbol.span, "in this system"),),
    )


def _report_mode_is_gone(flat: Flattening, name: str, gone: ReplacedModule, span: Span) -> None:
    """Reports E016 for code that reads the mode of a module that a test replaced."""
    flat.diagnostics.error(
        "E016",
        f"`{name}` is replaced as a whole: it has no decision module",
        span,
        "asked of it here",
        also=((gone.span, "replaced here"),),
        notes=("of what stands in its place nothing is known but what it publishes",),
        helps=("ask this in a test in which the module runs as it is",),
    )


def add_properties(flat: Flattening) -> None:
    """Adds the properties of the system and its parts, then the contracts; needs all modules."""
    for part in flat.parts:
        for item in part.system.properties:
            scope = _scope_of_names(flat, part, item.premise, item.condition)
            text = f"{item.text} in {part.prefix[:-1]}" if part.prefix else item.text
            _add_property(flat, item, scope, text)
    judged = flat.properties
    for c in flat.components:
        assumed, guaranteed = (c.node.assumes, c.node.guarantees) if c.node else ((), ())
        for k, expr in enumerate((*assumed, *guaranteed)):
            kind = "assumes" if k < len(assumed) else "guarantees"
            text = f"{' '.join(expr.span.text.split())} in {c.name}"
            judged.append(Property(len(judged), kind, expr, c.scope, text, expr.span, c.index))
    for module in flat.modules:  # their contracts are judged when a controller steps
        pair = [c for c in flat.components if c.module == module.index and c.role in {"ac", "sc"}]
        for clause in module.symbol.contract:
            for c in pair:
                text = f"{clause.name} of {module.name}: {clause.text} in {c.name}"
                parts = (clause.kind, clause.condition, module.scope, text, clause.span, c.index)
                judged.append(Property(len(judged), *parts))


def _add_property(flat: Flattening, item: typed.PropertySymbol, scope: Scope, text: str) -> None:
    """Adds a property to `properties` if its kind is `always` or `never`; ignores other kinds."""
    if item.kind in {"always", "never"} and item.condition is not None:
        index = len(flat.properties)
        flat.properties.append(Property(index, item.kind, item.condition, scope, text, item.span))


def _scope_of_names(
    flat: Flattening, part: SubSystem, *expressions: typed.TypedExpr | None
) -> Scope:
    """Gives the scope of a property or measure, with the meanings that names have in `part`."""
    scope = Scope({}, part.params)
    for topic, read in topic_reads(*expressions).items():
        scope.topics[topic] = topic_index_at(flat, part, topic)
        flat.property_reads.append((scope.topics[topic], read.span))
    for node in nodes(expressions):
        if isinstance(node, typed.TruthRead):
            scope.plants[node.instance] = flat.plants[part.prefix + node.instance]
    for module, mode in mode_reads(*expressions).items():
        if isinstance(module, str):
            name = part.prefix + module
            if name in flat.gone:
                _report_mode_is_gone(flat, name, flat.gone[name], mode.span)
            else:
                scope.modules[module] = next(m.index for m in flat.modules if m.name == name)
            continue
        candidates = [
            m for m in flat.modules if m.symbol is module and m.name.startswith(part.prefix)
        ]
        if len(candidates) == 1:
            scope.modules[module] = candidates[0].index
        else:
            _report_no_module(flat, module, len(candidates), mode, "in this system")
    flat.margins += [scope.modules[m] for m in margin_reads(*expressions) if m in scope.modules]
    return scope


def add_properties_of_test(flat: Flattening, test: typed.TestSymbol) -> None:
    """Adds the properties of a test to `properties` and `timed`; needs all modules and plants."""
    for item in test.properties:
        if item.kind == "invariant":
            _add_invariants(flat, item)
            continue
        scope = _scope_of_names(flat, flat.parts[0], item.premise, item.condition)
        if item.kind in {"always", "never"}:
            _add_property(flat, item, scope, item.text)
            continue
        flat.timed.append(
            TimedProperty(
                index=len(flat.timed),
                kind=item.kind,
                premise=item.premise,
                condition=item.condition,
                within_ns=flat.run_length_ns(item.within, "`within`") or 0,
                module=None,
                scope=scope,
                text=item.whole or item.span.text_on_one_line.rstrip("; "),
                span=item.span,
                asks=item.asks,
                promises=item.text,
            )
        )


def _add_invariants(flat: Flattening, item: typed.PropertySymbol) -> None:
    """Adds the invariant of Theorem 3.1 for one module, or for every module (Theorem 4.1)."""
    about = flat.modules
    if item.module is not None:
        gone = flat.gone.get(item.module)
        if gone is not None:
            _report_mode_is_gone(flat, item.module, gone, item.span)
            return
        about = [m for m in about if m.name == item.module]
    if not flat.modules and not flat.partial:
        flat.diagnostics.error(
            "M013",
            f"system `{flat.symbol.name}` has no module that could have an invariant",
            item.span,
            also=((flat.symbol.span, "in this system"),),
        )
    for module in about:
        text = f"invariant({module.name})"
        parts = (None, None, 0, module.index, module.scope, text, item.span)
        flat.timed.append(TimedProperty(len(flat.timed), "invariant", *parts))


def add_measures(flat: Flattening) -> None:
    """Adds `measures`, the numbers that campaigns report; needs all modules and plants."""
    for item in flat.symbol.measures:
        description = f"measure `{item.name}`"
        interval = flat.interval(item.low, item.high, item.low.span.to(item.high.span), description)
        bins = flat.count(item.bins, "the number of bins", 1, MAX_BINS)
        every = flat.duration_ns(item.every, f"`every` of {description}")
        scope = _scope_of_names(flat, flat.parts[0], item.value)
        if interval and bins and every:
            low, high = interval
            flat.measures.append(
                Metric(
                    name=item.name,
                    value=item.value,
                    scope=scope,
                    every_ns=every,
                    low=low,
                    high=high,
                    bins=bins,
                    span=item.span,
                )
            )
