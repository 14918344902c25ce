"""What others do to a plant of a proof: any values of the declared sets of their topics.

Purpose: `moved_by_others`: a plant whose equations read topics that the module does not publish, as
a plant with a disturbance for every leaf of these topics (docs/proof.md, Composition).
Non-goals: who keeps these topics in their sets (`verify/scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

from soter.language.elaborate.derived_systems import with_components
from soter.language.model import typed
from soter.language.model.system import Bound, Disturbance
from soter.language.model.tree_walk import rewritten, topic_reads
from soter.language.model.types import (
    FLOAT,
    ArrayType,
    FloatType,
    RecordType,
    has_list,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type


@dataclass(frozen=True)
class Influence:
    """A leaf of a topic of others that moves a plant: `topic` and `leaf` are indices."""

    component: int
    topic: int
    leaf: int
    variable: typed.Variable
    low: float
    high: float

    def name(self, system: System) -> str:
        """As proofs call it: `plant.topic.leaf`."""
        return f"{system.components[self.component].name}.{self.variable.name}"


def foreign(c: Component, outputs: tuple[int, ...]) -> list[typed.TopicSymbol]:
    """Topics that the equations of a plant read and that are no outputs of the module."""
    assert c.plant is not None
    read = topic_reads(*_equations(c.plant))
    return [t for t in c.plant.reads if t in read and c.scope.topics[t] not in outputs]


def can_be_any(system: System, topic: int) -> bool:
    """Whether every leaf of a topic is a float in a declared set: else it is no disturbance."""
    there = system.topics[topic]
    leaf_bounds = zip(leaves(there.type), there.bounds, strict=True)
    floats = all(isinstance(t, FloatType) and isinstance(b, Bound) for (_, t), b in leaf_bounds)
    return floats and not has_list(there.type)


def moved_by_others(system: System, module: Module) -> tuple[System, tuple[Influence, ...]]:
    """With plants moved by any values of the declared sets where they read what others publish.

    Gives what moves them; a topic that is more than floats in a declared set stays as it is.
    """
    moved: list[Component] = []
    all_influences: list[Influence] = []
    for c in system.components:
        if c.plant is not None and not c.plant.extern:
            plant, influences = _moved_by_any(system, c, tuple(module.outputs))
            moved.append(plant)
            all_influences += influences
    return with_components(system, moved), tuple(all_influences)


def _moved_by_any(
    system: System, c: Component, outputs: tuple[int, ...]
) -> tuple[Component, tuple[Influence, ...]]:
    """A plant, moved by any values where it reads what others publish; and what moves it."""
    topics = [t for t in foreign(c, outputs) if can_be_any(system, c.scope.topics[t])]
    if not topics:
        return c, ()
    assert c.plant is not None
    plant, variables = _opened(c.plant, tuple(topics))
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
def _opened(
    plant: typed.PlantSymbol, topics: tuple[typed.TopicSymbol, ...]
) -> tuple[typed.PlantSymbol, Variables]:
    """The same symbol for the same plant and topics: symbols are compared by identity."""
    made: Variables = {}
    for topic in topics:
        names = [".".join((topic.name, *path)) for path, _ in leaves(topic.type)]
        made[topic] = tuple(typed.Variable(n, FLOAT, "disturbance", topic.span) for n in names)
    whole = {t: _value(t.type, iter(made[t]), t) for t in topics}

    def value(e: typed.TypedExpr) -> typed.TypedExpr:
        return _of_topics(e, whole)

    opened = replace(
        plant,
        reads=tuple(t for t in plant.reads if t not in whole),
        read_spans=(),
        lets=tuple((v, rewritten(e, value)) for v, e in plant.lets),
        der={v: rewritten(e, value) for v, e in plant.der.items()},
        next={v: rewritten(e, value) for v, e in plant.next.items()},
        drives=tuple((t, rewritten(e, value)) for t, e in plant.drives),
        disturbances=(*plant.disturbances, *_declared(made)),
    )
    return opened, made


def _declared(made: Variables) -> Iterator[typed.DisturbanceSymbol]:
    for topic, variables in made.items():
        for v in variables:
            zero = typed.Literal(FLOAT, topic.span, 0.0)
            yield typed.DisturbanceSymbol(v, zero, zero, None)  # its range stands in the component


def _value(t: Type, left: Iterator[typed.Variable], topic: typed.TopicSymbol) -> typed.TypedExpr:
    if isinstance(t, (RecordType, ArrayType)):
        return typed.Aggregate(t, topic.span, tuple(_value(p, left, topic) for p in _below(t)))
    return typed.VarRead(t, topic.span, next(left))


def _below(t: RecordType | ArrayType) -> list[Type]:
    return [f for _, f in t.fields] if isinstance(t, RecordType) else [t.element] * t.size


def _equations(plant: typed.PlantSymbol) -> list[typed.TypedExpr]:
    return [*(e for _, e in plant.lets), *plant.der.values(), *plant.next.values()]


def _of_topics(
    e: typed.TypedExpr, by: Mapping[typed.TopicSymbol, typed.TypedExpr]
) -> typed.TypedExpr:
    """A reading of a topic, or of a field of one: the value that stands for it."""
    if isinstance(e, typed.TopicRead):
        return by.get(e.topic, e)
    if (
        isinstance(e, typed.TypedField)
        and isinstance(e.target, typed.Aggregate)
        and _plain(e.target)
    ):
        return e.target.elements[e.index]
    return e


def _plain(e: typed.TypedExpr) -> bool:
    """Whether it is made of variables alone: what is left out of it cannot fault."""
    if isinstance(e, typed.Aggregate):
        return all(_plain(x) for x in e.elements)
    return isinstance(e, typed.VarRead)
