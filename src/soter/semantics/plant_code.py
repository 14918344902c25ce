"""The code of a plant, compiled once.

Purpose: what a step of a plant looks things up in: its equations, what it drives, and where
measurement errors go.
Non-goals: stepping (`plants.py`), extern plants' callables (`externs.py`).
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.evaluate import vectors
from soter.language.model.tree_walk import chosen_lets, first_lets
from soter.language.model.types import leaves, positions
from soter.semantics.stored_values import storer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.evaluate.expressions import Compiled
    from soter.language.evaluate.statements import Evaluator
    from soter.language.model.system import Component, Topic
    from soter.language.model.typed import TypedExpr, Variable
    from soter.language.model.types import Type, Value
    from soter.semantics.externs import Move

    Named = tuple[tuple[Variable, Compiled], ...]


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """Componentwise work on one `der` state: `x + y` and `factor * x`."""

    add: Callable[[Value, Value], Value]
    scale: Callable[[float, Value], Value]


@dataclass(frozen=True, slots=True)
class ErrorStream:
    """A measurement error: position of its leaf in the topic's value, and its stream."""

    topic: int
    path: tuple[int, ...]
    bound: float
    stream: str


@dataclass(frozen=True, slots=True)
class PlantCode:
    """The code of a plant; `move` replaces the motion of an extern one.

    `first`: the lets that a step evaluates first of all; `chosen`: those that it does not evaluate
    again, as they choose.
    """

    component: Component
    states: tuple[Variable, ...]
    store: Callable[[tuple[Value, ...]], tuple[Value, ...]]
    first: Named
    chosen: frozenset[Variable]
    lets: Named
    der: Named
    next: Named
    arithmetic: tuple[Arithmetic, ...]
    method: str
    drives: tuple[tuple[int, Compiled], ...]
    readings: tuple[ErrorStream, ...]
    move: Move | None


def compile_plant(
    component: Component, evaluator: Evaluator, topics: Sequence[Topic], move: Move | None
) -> PlantCode:
    """The code of a plant instance. `der` and `next` keep the order the program wrote them in."""
    plant = component.plant
    assert plant is not None, component.name

    def named(pairs: Sequence[tuple[Variable, TypedExpr]]) -> Named:
        return tuple([(variable, evaluator.expression(e)) for variable, e in pairs])

    scope = component.scope.topics
    return PlantCode(
        component=component,
        states=plant.states,
        store=storer(v.type for v in plant.states),
        first=named(first_lets(plant)),
        chosen=frozenset(chosen_lets(plant)),
        lets=named(plant.lets),
        der=named(tuple(plant.der.items())),
        next=named(tuple(plant.next.items())),
        arithmetic=tuple([_arithmetic(v.type) for v in plant.der]),
        method=plant.method,
        drives=tuple([(scope[t], evaluator.expression(e)) for t, e in plant.drives]),
        readings=tuple(
            [
                ErrorStream(m.topic, _position(topics[m.topic].type, m.leaf), m.bound, m.stream)
                for m in component.measured
            ]
        ),
        move=move,
    )


def _arithmetic(t: Type) -> Arithmetic:
    zipped, each = vectors.zipper(t), vectors.mapper(t)
    return Arithmetic(
        add=lambda x, y: zipped(operator.add, x, y),
        scale=lambda factor, x: each(lambda component: factor * component, x),
    )


def _position(t: Type, leaf: int) -> tuple[int, ...]:
    """The positions, from the outside in, of the leaf with this number."""
    return tuple(positions(t, list(leaves(t))[leaf][0]))
