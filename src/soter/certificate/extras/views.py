"""A module that is proved in views, or on abstractions of its plants (`abstracts`), read again.

Purpose: `module_in_view` gives the module with those parts, `shown_part_of_enters` those of
`enters`; `why_views_leave_out` says what no view of a certificate shows; `without_ages` is `ttf`
without the parts that ask for an age.
`make_abstracted_system` makes the system of an abstraction; it is checked that the module is the
same there as in the system that flies, and reads what comes from the plants that are abstracted.
Non-goals: sharing code with `language/elaborate/views_for_proofs.py` and
`verify/problem/supported_constructs.py`, which the prover goes by.

A part is what must hold beside the others: of `safe` and `safer` as they are, of "not `ttf`". A
view shows a part if its plants drive every topic in it. Dropping a part of what the DM finds makes
the hypothesis of P3 weaker, so what is shown is shown of more states; a part of `safe` or of
`safer` that is dropped here must be shown elsewhere, or nothing is said about it.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.module_facts import DiffersError, Facts, driven_topics, topics_read
from soter.certificate.report import NotRecheckedError
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.derived_systems import without_held_topics
from soter.language.elaborate.flatten_system import flatten
from soter.language.elaborate.passes.flattening import Flattening
from soter.language.elaborate.views_for_proofs import start_of_proof_plant
from soter.language.model import typed
from soter.language.model.assumption_words import in_words
from soter.language.model.system import name_of_subsystem
from soter.language.model.tree_walk import nodes, rewritten, topic_reads
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from soter.certificate.report import Said
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Component, Module, System

    Part = tuple[typed.TypedExpr, bool]
    """An expression, and whether it must hold (True) or must not (False)."""


def module_in_view(module: Module, name: str) -> Module:
    """The module with the parts that view `name` shows; `NotRecheckedError` for no such view."""
    symbol = module.symbol
    named = [v for v in symbol.verify.views if v.name == name]
    if len(named) != 1:
        raise NotRecheckedError(f"module `{module.name}` has no view `{name}`")
    if symbol.ttf is None or symbol.safer is None:
        raise NotRecheckedError("predicates that are computed, in several views")
    block = named[0].block
    shown = _topics_driven_in_view(block)
    values = {
        **vars(symbol),
        "verify": block,
        "safe": _shown_conjunction(symbol.safe, shown, wanted=True),
        "safer": _shown_conjunction(symbol.safer, shown, wanted=True),
        "ttf": _negation(_shown_conjunction(symbol.ttf, shown, wanted=False)),
    }
    return dataclasses.replace(module, symbol=typed.ModuleSymbol(**values))


def shown_part_of_enters(
    symbol: typed.ModuleSymbol, block: typed.TypedVerifyBlock
) -> typed.TypedExpr | None:
    """The conjunction of the parts of `enters` that a view shows; None without `enters`.

    `enters` implies this conjunction; it is true if the view shows no part.
    """
    if symbol.verify.enters is None:
        return None
    return _shown_conjunction(symbol.verify.enters, _topics_driven_in_view(block), wanted=True)


def why_views_leave_out(symbol: typed.ModuleSymbol, views: Collection[str]) -> str:
    """Why these views of a module together do not show all of it; "" if they do."""
    for view in symbol.verify.views:
        if view.name not in views:
            return f"view `{view.name}` of module `{symbol.name}` is not there"
    every = [_topics_driven_in_view(view.block) for view in symbol.verify.views]
    for name, predicate in (("safe", symbol.safe), ("safer", symbol.safer)):
        if predicate is None:
            return f"module `{symbol.name}` has views and no `{name}`"
        for part in _needed_parts(predicate, wanted=True):
            if not any(_reads_shown(part, shown) for shown in every):
                return f"no view of module `{symbol.name}` shows a part of `{name}`"
    return ""


def without_ages(ttf: typed.TypedExpr) -> typed.TypedExpr:
    """`ttf` without the parts that read an age; unchanged if every part reads an age.

    "Not `ttf`" asks that all parts be false; with fewer parts it is weaker, so more must be shown.
    """
    parts = _needed_parts(ttf, wanted=False)
    rest = [p for p in parts if not any(isinstance(n, typed.AgeRead) for n in nodes([p[0]]))]
    return _join_parts("||", ttf.span, rest, wanted=False) if rest else ttf


def _topics_driven_in_view(block: typed.TypedVerifyBlock) -> set[typed.TopicSymbol]:
    return {topic for link in block.abstracts for topic, _ in link.plant.drives}


def _reads_shown(part: Part, shown: Collection[typed.TopicSymbol]) -> bool:
    return all(topic in shown for topic in topic_reads(part[0]))


def _needed_parts(e: typed.TypedExpr, *, wanted: bool) -> Iterator[Part]:
    """Yields the parts of `e`, with truths, that all must hold for `e` to have truth `wanted`."""
    if isinstance(e, typed.TypedUnary) and e.op == "!":
        yield from _needed_parts(e.operand, wanted=not wanted)
    elif isinstance(e, typed.TypedBinary) and e.op == ("&&" if wanted else "||"):
        yield from _needed_parts(e.left, wanted=wanted)
        yield from _needed_parts(e.right, wanted=wanted)
    elif isinstance(e, typed.TypedCall) and (body := _returned_expression(e)) is not None:
        parts = list(_needed_parts(body, wanted=wanted))
        yield from parts if len(parts) > 1 else [(e, wanted)]
    else:
        yield e, wanted


def _returned_expression(call: typed.TypedCall) -> typed.TypedExpr | None:
    """The expression that a call's function returns if it does only that; else None."""
    steps = call.fun.body or ()
    only = steps[0] if len(steps) == 1 else None
    if not isinstance(only, typed.TypedReturn):
        return None
    value = {id(p): a for p, a in zip(call.fun.parameters, call.arguments, strict=True)}

    def with_argument(e: Any) -> Any:  # noqa: ANN401 - any expression
        return value.get(id(e.variable), e) if isinstance(e, typed.VarRead) else e

    expansion: typed.TypedExpr = rewritten(only.value, with_argument)
    return expansion


def _shown_conjunction(
    e: typed.TypedExpr, shown: set[typed.TopicSymbol], *, wanted: bool
) -> typed.TypedExpr:
    """The conjunction of the shown parts of `e`; true if it has none."""
    shown_parts = [part for part in _needed_parts(e, wanted=wanted) if _reads_shown(part, shown)]
    return _join_parts("&&", e.span, shown_parts, wanted=True)


def _join_parts(op: str, span: Span, parts: Sequence[Part], *, wanted: bool) -> typed.TypedExpr:
    """The parts joined by `op`; negates each part whose truth is not `wanted`."""
    joined: typed.TypedExpr = typed.Literal(BOOL, span, value=op == "&&")
    for e, truth in parts:
        joined = typed.TypedBinary(BOOL, span, op, joined, e if truth == wanted else _negation(e))
    return joined


def _negation(e: typed.TypedExpr) -> typed.TypedExpr:
    return typed.TypedUnary(BOOL, e.span, "!", e)


# ---------------------------------------------------------------- the system of the proof


def make_abstracted_system(
    system: System, module: Module
) -> tuple[System, Module, tuple[Component, ...]]:
    """Makes the system to prove in, the module in that system, and its plants.

    Raises SoterError if a system of the module and its `abstracts` plants cannot be elaborated.
    """
    symbol = module.symbol
    ac, sc = (system.components[i].node for i in (module.ac, module.sc))
    assert ac is not None
    assert sc is not None
    parts: list[tuple[str, Any]] = [(link.name, link.plant) for link in symbol.verify.abstracts]
    parts.append((symbol.name, _with_controllers(symbol, ac, sc)))
    instances = tuple(typed.InstanceSymbol(n, plant, {}, {}, symbol.span) for n, plant in parts)
    made = typed.SystemSymbol(
        name="recheck",
        span=symbol.span,
        default=False,
        instances=instances,
        sets=_sets_for_plants(module, instances),
    )
    diagnostics = Diagnostics()
    around = {p.name: v for p, v in module.around.items()}
    flattening = Flattening(system.program, made, around, diagnostics)
    flattening.partial = True
    flattened = flatten(flattening)
    if flattened is None or diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    flattened = without_held_topics(flattened)
    plants = tuple(c for c in flattened.components if c.role == "plant")
    return flattened, flattened.modules[0], plants


def _sets_for_plants(
    module: Module, instances: tuple[typed.InstanceSymbol, ...]
) -> tuple[typed.SetSymbol, ...]:
    """The module's parameter values that its system does not have, as `set`s for each plant.

    The topics belong to the surrounding system, so they keep that system's parameters.
    """
    sets = [(p, v) for p, v in module.scope.params.items() if repr(module.around[p]) != repr(v)]
    return tuple(typed.SetSymbol(i.name, p, v, i.span) for i in instances for p, v in sets)


def _with_controllers(
    symbol: typed.ModuleSymbol, ac: typed.NodeSymbol, sc: typed.NodeSymbol
) -> typed.ModuleSymbol:
    if symbol.ac is ac and symbol.sc is sc:
        return symbol
    return typed.ModuleSymbol(**{**vars(symbol), "ac": ac, "sc": sc})


def states_at_start(facts: Facts, name: str) -> Sequence[Any] | None:
    """The states of an abstracting plant at the start of a run, by its map; None if unknown."""
    for link in facts.symbol.verify.abstracts:
        if link.name == name:
            return start_of_proof_plant(facts.flying, facts.flying_module, link)
    return None


def require_same_as_flown(facts: Facts) -> None:
    """Raises NotRecheckedError if the proved system has other topics or periods than flown."""
    system, flying = facts.system, facts.flying
    module, running = facts.module, facts.flying_module
    pairs = [(module.scope, running.scope)]
    for part in ("dm", "ac", "sc"):
        a = system.components[getattr(module, part)]
        b = flying.components[getattr(running, part)]
        if (a.period_ns, a.phase_ns) != (b.period_ns, b.phase_ns) or a.node is not b.node:
            raise NotRecheckedError(f"`{b.name}` is another one where the module is proved")
        shown, flown = ({p: repr(v) for p, v in x.scope.params.items()} for x in (a, b))
        if shown != flown:
            raise NotRecheckedError(f"`{b.name}` has other parameters where the module is proved")
        pairs.append((a.scope, b.scope))
    for proved, runs in pairs:
        for symbol, index in proved.topics.items():
            if symbol not in runs.topics:
                raise NotRecheckedError(f"`{symbol.name}` is no topic of `{flying.name}`")
            at = runs.topics[symbol]
            one, other = system.topics[index], flying.topics[at]
            its, ours = ((t.bounds, t.max_age_ns, repr(t.default)) for t in (one, other))
            if its != ours:
                raise NotRecheckedError(
                    f"`{other.name}` has another set, default or `max_age` than `{one.name}`"
                )
            if facts.running.setdefault(index, at) != at:
                raise NotRecheckedError(f"`{one.name}` stands for two topics of `{flying.name}`")
    if {facts.running[i] for i in module.outputs} != set(running.outputs):
        raise NotRecheckedError("the module has other outputs where it is proved")


def require_abstracted_sensors(facts: Facts, topics: set[int]) -> None:
    """Raises DiffersError if a topic does not come from the real plant of its abstraction."""
    outer = name_of_subsystem(facts.flying_module)
    driven = driven_topics(facts)
    for index in topics:
        model = driven[index][0].name
        real = next(n.instance for n in facts.symbol.verify.abstracts if n.name == model)
        real = f"{outer}.{real}" if outer else real
        paths = facts.ways.ways_to(facts.running[index])
        if not any(p.sensor.name == real for p in paths):
            name = facts.system.topics[index].name
            raise DiffersError(f"`{name}` is said to show `{real}`, which is not behind it")


def conformance_assumptions(facts: Facts) -> Said:
    """The assumptions that the vehicle behaves like the plants that abstract it."""
    for link in facts.symbol.verify.abstracts:
        known = start_of_proof_plant(facts.flying, facts.flying_module, link) is not None
        begins = f"the start of {link.instance}" if known else f"the initial states of {link.name}"
        text = in_words("conforms", link.instance, link.name, link.plant.name, begins)
        yield f"conforms {link.instance} {link.name}", text


def assumptions_on_topics_of_safe(facts: Facts) -> Said:
    """Yields the assumptions on topics that only `safe` reads and that the proof's plants drive."""
    read = {i for of in topics_read(facts) for i in of}
    driven = driven_topics(facts)
    for symbol in topic_reads(facts.symbol.safe):
        index = facts.module.scope.topics.get(symbol, -1)
        if index in driven and index not in read:
            name, plant = facts.system.topics[index].name, driven[index][0].name
            yield f"judged {name} {plant}", in_words("judged", name, plant)
