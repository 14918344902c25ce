"""Changes a module and its plants for proofs: views, disturbances from others, first states.

Purpose: `systems_by_view` splits a module. A view keeps the parts of `safe`, `ttf` and `safer` that
read topics of its plants only (proof-sets.md, Views). Each part of `safe` and `safer` must be in
some view (R023). A part of `ttf` in no view is left out, so that a proof is harder, but not wrong.
`with_influences_drawn` replaces each topic that a plant reads and the module does not publish by a
disturbance. `start_of_proof_plant` computes where an abstraction starts.
Non-goals: proofs; who keeps topics in their sets (`verify/scope.py`); initial states that are
drawn. The re-checker has its own views (`certificate/extras/views.py`), on purpose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.derived_systems import with_components, with_module
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.system import Bound, Disturbance
from soter.language.model.tree_walk import (
    conjuncts,
    disjuncts,
    joined,
    nodes,
    rewritten,
    topic_reads,
)
from soter.language.model.types import FLOAT, ArrayType, FloatType, RecordType, has_list, leaves
from soter.language.syntax.parsing.modules import VIEW_ITEMS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type, Value


Topics = frozenset[typed.TopicSymbol]


def systems_by_view(flat: System, module: Module) -> list[tuple[System, Module]]:
    """Gives (system, module) for each view of the module; the unchanged pair if it has no views.

    Raises SoterError R023 if the views together do not cover the module.
    """
    symbol = module.symbol
    if not symbol.verify.views:
        return [(flat, module)]
    _require_usable_views(symbol)
    return [_module_in_view(flat, module, view) for view in symbol.verify.views]


def refuse_views(module: Module) -> None:
    """Raises `SoterError` R023 for a module with views, as the caller needs one set of plants."""
    if not module.symbol.verify.views:
        return
    diagnostics = Diagnostics()
    names = ", ".join(f"`{v.name}`" for v in module.symbol.verify.views)
    diagnostics.error(
        "R023",
        f"module `{module.name}` is proved in views, and has no plants of its own",
        module.symbol.verify.span or module.symbol.span,
        notes=(f"its views are {names}; monitors and advice look at one set of plants",),
        helps=("`soter verify` takes them one by one",),
    )
    raise SoterError(diagnostics.items)


def topics_of_view(block: typed.TypedVerifyBlock) -> Topics:
    """Gives the topics that the plants of a view drive."""
    return frozenset(topic for link in block.abstracts for topic, _ in link.plant.drives)


def _module_in_view(flat: System, module: Module, view: typed.ViewSymbol) -> tuple[System, Module]:
    symbol, topics = module.symbol, topics_of_view(view.block)
    assert symbol.ttf is not None
    assert symbol.safer is not None
    enters = symbol.verify.enters
    if enters is not None:
        enters = joined("&&", _parts_that_read(conjuncts(enters), topics), enters.span)
    part = replace(
        symbol,
        verify=replace(view.block, enters=enters),
        safe=joined("&&", _parts_that_read(conjuncts(symbol.safe), topics), symbol.safe.span),
        ttf=joined("||", _parts_that_read(disjuncts(symbol.ttf), topics), symbol.ttf.span),
        safer=joined("&&", _parts_that_read(conjuncts(symbol.safer), topics), symbol.safer.span),
    )
    module_view = replace(module, symbol=part, view=view.name, whole=symbol)
    return with_module(flat, module_view), module_view


def _parts_that_read(parts: Iterable[typed.TypedExpr], topics: Topics) -> list[typed.TypedExpr]:
    return [e for e in parts if topics.issuperset(topic_reads(e))]


def _require_usable_views(symbol: typed.ModuleSymbol) -> None:
    """Raises R023 if views lack plants, predicates or parts, or if `verify` has other items."""
    diagnostics, verify = Diagnostics(), symbol.verify
    *methods, last = VIEW_ITEMS
    if verify.groups or verify.abstracts or verify.core or verify.induction or verify.commands:
        diagnostics.error(
            "R023",
            f"`verify` of module `{symbol.name}` has views, and a proof of its own",
            verify.span or symbol.span,
            helps=(f"put every `{'`, `'.join(methods)}` and `{last}` into a view",),
        )
    for view in verify.views:
        if not view.block.abstracts:
            diagnostics.error(
                "R023",
                f"view `{view.name}` has no plant",
                view.span,
                helps=("say which one: `abstracts d by m: Model = ...;`",),
            )
    for name, predicate in (("ttf", symbol.ttf), ("safer", symbol.safer)):
        if predicate is None:
            diagnostics.error(
                "R023",
                f"module `{symbol.name}` has views and no `{name}`",
                symbol.span,
                notes=("no predicates are computed for several views",),
                helps=(f"write `{name}`",),
            )
    _require_covered_parts(symbol, diagnostics)
    diagnostics.raise_errors()


def _require_covered_parts(symbol: typed.ModuleSymbol, diagnostics: Diagnostics) -> None:
    """Reports R023 for every part of `safe` and `safer` that no view keeps."""
    every = [topics_of_view(view.block) for view in symbol.verify.views]
    for name, predicate in (("safe", symbol.safe), ("safer", symbol.safer)):
        for part in conjuncts(predicate) if predicate is not None else ():
            if not any(_parts_that_read([part], topics) for topics in every):
                read = ", ".join(f"`{t.name}`" for t in dict.fromkeys(topic_reads(part)))
                diagnostics.error(
                    "R023",
                    f"no view speaks of this part of `{name}`",
                    part.span,
                    f"it reads {read}",
                    notes=("a view speaks of the topics that its plants drive, of all at once",),
                    helps=("write it as parts joined by `&&`, each about topics of one view",),
                )


@dataclass(frozen=True)
class Influence:
    """A number in another part's topic that moves a plant; `topic` and `leaf` are indices."""

    component: int
    topic: int
    leaf: int
    variable: typed.Variable
    low: float
    high: float

    def name_in_proofs(self, system: System) -> str:
        """Gives the name of the influence in proofs: `plant.topic.leaf`."""
        return f"{system.components[self.component].name}.{self.variable.name}"


def topics_of_others(c: Component, outputs: tuple[int, ...]) -> list[typed.TopicSymbol]:
    """Gives the topics that the plant's equations read but the module does not publish."""
    assert c.plant is not None
    lets = (e for _, e in c.plant.lets)
    read = topic_reads(*lets, *c.plant.der.values(), *c.plant.next.values())
    return [t for t in c.plant.reads if t in read and c.scope.topics[t] not in outputs]


def can_be_drawn(system: System, topic: int) -> bool:
    """Whether every leaf of a topic is a float in a declared set, as a disturbance must be."""
    flat = system.topics[topic]
    leaf_bounds = zip(leaves(flat.type), flat.bounds, strict=True)
    floats = all(isinstance(t, FloatType) and isinstance(b, Bound) for (_, t), b in leaf_bounds)
    return floats and not has_list(flat.type)


def with_influences_drawn(system: System, module: Module) -> tuple[System, tuple[Influence, ...]]:
    """Gives the system with disturbances for topics of others, where it can, and their leaves."""
    moved: list[Component] = []
    all_influences: list[Influence] = []
    for c in system.components:
        if c.plant is not None and not c.plant.extern:
            plant, influences = _with_drawn_topics(system, c, tuple(module.outputs))
            moved.append(plant)
            all_influences += influences
    return with_components(system, moved), tuple(all_influences)


def _with_drawn_topics(
    system: System, c: Component, outputs: tuple[int, ...]
) -> tuple[Component, tuple[Influence, ...]]:
    """Gives plant `c` with disturbances for topics of others, and these topics' leaves."""
    topics = [t for t in topics_of_others(c, outputs) if can_be_drawn(system, c.scope.topics[t])]
    if not topics:
        return c, ()
    assert c.plant is not None
    plant, variables = _with_disturbances_for(c.plant, tuple(topics))
    drawn, influences = [], []
    for topic in topics:
        index = c.scope.topics[topic]
        bounds = zip(variables[topic], system.topics[index].bounds, strict=True)
        for leaf, (variable, b) in enumerate(bounds):
            assert b is not None
            streams = (f"{c.name}.{variable.name}",)
            drawn.append(Disturbance(variable, b.low, b.high, 0, streams))
            influences.append(Influence(c.index, index, leaf, variable, b.low, b.high))
    moved = replace(c, plant=plant, disturbances=(*c.disturbances, *drawn))
    return moved, tuple(influences)


Variables = dict[typed.TopicSymbol, tuple[typed.Variable, ...]]


@lru_cache(maxsize=256)
def _with_disturbances_for(
    plant: typed.PlantSymbol, topics: tuple[typed.TopicSymbol, ...]
) -> tuple[typed.PlantSymbol, Variables]:
    """Gives the plant with disturbances in place of `topics`, and these disturbances, cached."""
    made: Variables = {}
    for topic in topics:
        names = [".".join((topic.name, *path)) for path, _ in leaves(topic.type)]
        made[topic] = tuple(typed.Variable(n, FLOAT, "disturbance", topic.span) for n in names)
    value_by_topic = {t: _value_of_variables(t.type, iter(made[t]), t) for t in topics}

    def replaced(e: typed.TypedExpr) -> typed.TypedExpr:
        return _with_topic_replaced(e, value_by_topic)

    opened = replace(
        plant,
        reads=tuple(t for t in plant.reads if t not in value_by_topic),
        read_spans=(),
        lets=tuple((v, rewritten(e, replaced)) for v, e in plant.lets),
        der={v: rewritten(e, replaced) for v, e in plant.der.items()},
        next={v: rewritten(e, replaced) for v, e in plant.next.items()},
        drives=tuple((t, rewritten(e, replaced)) for t, e in plant.drives),
        disturbances=(*plant.disturbances, *_disturbance_symbols(made)),
    )
    return opened, made


def _disturbance_symbols(made: Variables) -> Iterator[typed.DisturbanceSymbol]:
    for topic, variables in made.items():
        for v in variables:
            zero = typed.Literal(FLOAT, topic.span, 0.0)
            yield typed.DisturbanceSymbol(v, zero, zero, None)  # the component has its range


def _value_of_variables(
    t: Type, left: Iterator[typed.Variable], topic: typed.TopicSymbol
) -> typed.TypedExpr:
    if isinstance(t, (RecordType, ArrayType)):
        return typed.Aggregate(
            t, topic.span, tuple(_value_of_variables(p, left, topic) for p in _part_types(t))
        )
    return typed.VarRead(t, topic.span, next(left))


def _part_types(t: RecordType | ArrayType) -> list[Type]:
    return [f for _, f in t.fields] if isinstance(t, RecordType) else [t.element] * t.size


def _with_topic_replaced(
    e: typed.TypedExpr, by: Mapping[typed.TopicSymbol, typed.TypedExpr]
) -> typed.TypedExpr:
    """Gives the value in `by` for a read of a topic or of its field; else `e` unchanged."""
    if isinstance(e, typed.TopicRead):
        return by.get(e.topic, e)
    if (
        isinstance(e, typed.TypedField)
        and isinstance(e.target, typed.Aggregate)
        and _is_made_of_variables(e.target)
    ):
        return e.target.elements[e.index]
    return e


def _is_made_of_variables(e: typed.TypedExpr) -> bool:
    """Whether `e` consists of variables only, so that omitting a part of it hides no step fault."""
    if isinstance(e, typed.Aggregate):
        return all(_is_made_of_variables(x) for x in e.elements)
    return isinstance(e, typed.VarRead)


def start_of_proof_plant(
    flat: System, module: Module, link: typed.AbstractionLink
) -> tuple[Value, ...] | None:
    """Gives the values of the states of the proof's plant when the flying system starts.

    Topics have their defaults. None if there is no map, if a flying plant's state is drawn, or if
    the map reads ages, times or modes, which do not exist yet.
    """
    name = ".".join((*module.name.split(".")[:-1], link.instance))
    plants = [c for c in flat.components if c.name == name and c.plant is not None]
    if link.value is None or not plants or plants[0].extern:
        return None
    (c,) = plants
    late = (typed.AgeRead, typed.TimeRead, typed.ModeRead, typed.MarginRead)
    if any(r is not None for r in c.initial_range) or any(
        isinstance(n, late) for n in nodes([link.value])
    ):
        return None
    topics: dict[typed.TopicSymbol, int] = {}
    for other in flat.components:
        topics.update(other.scope.topics)
    topics.update(module.scope.topics)
    evaluator = Evaluator(module.scope.params, topics=topics, plants={link.instance: c.index})
    defaults = [t.default for t in flat.topics]
    env = Environment(topics=defaults, truth=lambda _: c.initial)
    try:
        value = evaluator.compiled(link.value)(env)
    except StepFault:
        return None
    assert isinstance(value, tuple)
    return value
