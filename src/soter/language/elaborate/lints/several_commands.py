"""Whether a shield has a group that several commands move.

Purpose: W033, as no table is computed for such a group, and so AC never gets control.
Non-goals: a verdict: commands that only a proof finds in a group are told by `soter verify`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.types import ArrayType, RecordType, leaf_name, positions

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Module, System

    Path = tuple[str, ...]
    Leaf = tuple[typed.PlantSymbol, typed.TypedExpr, Path]

WHOLE = RecordType, ArrayType
"""Of their parts each is followed for itself."""


def doubt_shield(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """W033 for each declared group of a module with a shield."""
    symbol = module.symbol
    if symbol.shield is None:
        return
    plants = [link.plant for link in symbol.verify.abstracts]
    plants = plants or [c.plant for c in system.components if c.plant is not None]
    outputs = {*symbol.ac.publishes, *symbol.sc.publishes}
    for group in symbol.verify.groups:
        moved = [leaf for axis in group.axes for leaf in _rates(axis, plants)]
        found = dict.fromkeys(u for p, e, path in moved for u in _felt(p, e, path, outputs))
        if len(found) > 1:
            diagnostics.warning(
                "W033",
                f"the shield of module `{symbol.name}` judges one command of a group, and "
                f"{' and '.join(f'`{u}`' for u in found)} move this one",
                group.span,
                also=((symbol.shield.span, "the shield"),),
                notes=("nothing is permitted there: AC never gets control",),
                helps=("a `grid` line for the states of each command, or leave `shield` out",),
            )


def _rates(axis: typed.TypedGridAxis, plants: Sequence[typed.PlantSymbol]) -> Iterator[Leaf]:
    """What moves the state that an axis names: the rate or the next value, and its part."""
    if axis.plant is not None:
        found = [
            (axis.plant, v, axis.path[1:]) for v in axis.plant.states if v.name == axis.path[0]
        ]
    else:
        driven = [(p, e) for p in plants for t, e in p.drives if t is axis.topic]
        found = [(p, *at) for p, e in driven if (at := _state(p, e, axis.path)) is not None]
    for plant, state, path in found:
        rate = plant.der.get(state, plant.next.get(state))
        if rate is not None:
            yield plant, rate, path


def _state(
    plant: typed.PlantSymbol, e: typed.TypedExpr, path: Path
) -> tuple[typed.Variable, Path] | None:
    """The state, and its part, that a part of an expression is."""
    if isinstance(e, typed.VarRead):
        given = dict(plant.lets).get(e.variable)
        return (e.variable, path) if given is None else _state(plant, given, path)
    inner = _part(e, path)
    return None if inner is None else _state(plant, *inner)


def _part(e: typed.TypedExpr, path: Path) -> tuple[typed.TypedExpr, Path] | None:
    """Where a part of a field, an element, a record or an array comes from."""
    if isinstance(e, typed.TypedField) and isinstance(e.target.type, RecordType):
        return e.target, (e.target.type.fields[e.index][0], *path)
    if isinstance(e, typed.Index) and isinstance(e.index, typed.Literal):
        return e.target, (f"[{e.index.value}]", *path)
    if isinstance(e, typed.Aggregate) and isinstance(e.type, WHOLE) and path:
        at = positions(e.type, path[:1])[0]
        order = e.order or tuple(range(len(e.elements)))
        return e.elements[order.index(at)], path[1:]
    return None


def _felt(
    plant: typed.PlantSymbol,
    e: typed.TypedExpr,
    path: Path,
    outputs: Iterable[typed.TopicSymbol],
) -> Iterator[str]:
    """The numbers of a command that a part of an expression certainly reads."""
    parts: list[tuple[typed.TypedExpr, Path]] = []
    inner = _part(e, path)
    if isinstance(e, typed.TopicRead):
        if e.topic in outputs:
            yield leaf_name(e.topic.name, path)
    elif inner is not None:
        parts = [inner]
    elif isinstance(e, typed.VarRead):
        given = dict(plant.lets).get(e.variable)
        parts = [] if given is None else [(given, path)]
    elif isinstance(e, (typed.Vector, typed.TypedBinary)):
        parts = [(x, path if isinstance(x.type, WHOLE) else ()) for x in (e.left, e.right)]
    elif isinstance(e, typed.TypedUnary):
        parts = [(e.operand, path)]
    elif isinstance(e, (typed.Builtin, typed.TypedCall)) and not path:
        parts = [(x, ()) for x in e.arguments if not isinstance(x.type, WHOLE)]
    for x, there in parts:
        yield from _felt(plant, x, there, outputs)
