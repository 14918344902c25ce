"""Between Gymnasium's arrays and a program's values.

Purpose: the default mappings: an observation is the plant's states, an action is the advanced
controller's outputs, a command is what the plant reads; leaf by leaf, in declared order.
Non-goals: units, frames, images: whatever is not leaf by leaf is a function of the user's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from soter.gym.outside import wrong_choice
from soter.program.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)
from soter.program.model.values import from_python

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from soter.diagnostics.diagnostic import SoterError
    from soter.program.model.system import Component, System, Topic
    from soter.program.model.types import Type, Value

    Shapes = Sequence[tuple[str, Type]]


def shapes_of_states(plant: Component) -> list[tuple[str, Type]]:
    """Names and types of a plant's states."""
    assert plant.plant is not None
    return [(v.name, v.type) for v in plant.plant.states]


def topics_read(system: System, plant: Component) -> list[Topic]:
    """The topics a plant reads, in declared order."""
    assert plant.plant is not None
    return [system.topics[plant.scope.topics[t]] for t in plant.plant.reads]


def topics_published(system: System, node: Component) -> list[Topic]:
    """The topics a node publishes, in declared order."""
    assert node.node is not None
    return [system.topics[node.scope.topics[t]] for t in node.node.publishes]


# ---------------------------------------------------------------- values and flat arrays


def assembled(shapes: Shapes, flat: object, what: str) -> list[Value]:
    """One value per shape from the numbers of an array; SoterError U001 for another count."""
    numbers = iter(np.asarray(flat, dtype=np.float64).reshape(-1).tolist())
    needed = sum(1 for _, t in shapes for _ in leaves(t))
    found = np.asarray(flat).size
    if needed != found:
        names = ", ".join(f"`{n}`" for n, _ in shapes)
        raise wrong_choice(
            f"{what} has {found} numbers, but {names} {needed}", "give a function that maps them"
        )
    return [_value(t, numbers) for _, t in shapes]


def _value(t: Type, numbers: Iterator[float]) -> Value:
    if isinstance(t, RecordType):
        return tuple(_value(f, numbers) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(_value(t.element, numbers) for _ in range(t.size))
    if isinstance(t, ListType):
        raise _no_list(t)
    number = next(numbers)
    if isinstance(t, FloatType):
        return number
    return from_python(t, _whole(t, number))


def _whole(t: Type, number: float) -> object:
    """An int, bool or enum as `from_python` takes it; anything else as it is, to be refused."""
    if not math.isfinite(number) or number != int(number):
        return number
    if isinstance(t, EnumType):
        return t.members[int(number)] if 0 <= number < len(t.members) else number
    return bool(number) if isinstance(t, BoolType) else int(number)


def flattened(shapes: Shapes, values: Sequence[Value]) -> npt.NDArray[np.float64]:
    """The numbers of values, leaf by leaf, (leaves,); SoterError U001 for a list."""
    found: list[float] = []
    for (_, t), value in zip(shapes, values, strict=True):
        _flatten(t, value, found)
    return np.array(found)


def _flatten(t: Type, value: Value, into: list[float]) -> None:
    if isinstance(t, RecordType):
        for (_, f), part in zip(t.fields, value, strict=True):
            _flatten(f, part, into)
    elif isinstance(t, ArrayType):
        for part in value:
            _flatten(t.element, part, into)
    elif isinstance(t, ListType):
        raise _no_list(t)
    else:
        into.append(float(value))


def _no_list(t: Type) -> SoterError:
    return wrong_choice(f"a `{t}` has no fixed number of numbers", "give a function that maps it")


# ---------------------------------------------------------------- spaces


def action_space(topics: Sequence[Topic]) -> spaces.Space[Any]:
    """Everything an agent may publish: a `Box` of floats, or `Discrete` for one int or enum.

    SoterError U001 where it is neither, or where no float32 lies in a set.
    """
    bounds = [b for t in topics for b in t.bounds]
    kinds = [k for t in topics for _, k in leaves(t.type)]
    if all(isinstance(k, FloatType) for k in kinds) and None not in bounds:
        low = np.array([b.low for b in bounds if b is not None])
        high = np.array([b.high for b in bounds if b is not None])
        least, most = _inward(low, high), _inward(high, low)
        if (least < low).any() or (most > high).any() or (least > most).any():
            names = ", ".join(f"`{t.name}`" for t in topics)
            raise wrong_choice(f"no float32 lies in a set of {names}", "give action_space=...")
        return spaces.Box(least, most, dtype=np.float32)
    if len(kinds) == 1:
        return _discrete(kinds[0], bounds[0])
    names = ", ".join(f"`{t.name}`" for t in topics)
    raise wrong_choice(f"{names} are neither floats nor one int or enum", "give action_space=...")


def _discrete(kind: Type, bound: Any) -> spaces.Space[Any]:  # noqa: ANN401 - Bound or None
    if isinstance(kind, EnumType):
        return spaces.Discrete(len(kind.members))
    if isinstance(kind, BoolType):
        return spaces.Discrete(2)
    assert isinstance(kind, IntType)
    low, high = (bound.low, bound.high) if bound is not None else (kind.low, kind.high)
    return spaces.Discrete(int(high - low + 1), start=int(low))


def _inward(
    edge: npt.NDArray[np.float64], other: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Bounds as float32 that do not leave the set: rounded towards the other side."""
    rounded = edge.astype(np.float32)
    outside = np.where(edge < other, rounded < edge, rounded > edge)
    return np.where(outside, np.nextafter(rounded, other.astype(np.float32)), rounded)


def as_action(space: spaces.Space[Any], numbers: npt.NDArray[np.float64]) -> Any:  # noqa: ANN401
    """Numbers (n,) as an element of an environment's action space.

    SoterError U001 for a space that is neither a `Box` nor `Discrete`.
    """
    if isinstance(space, spaces.Discrete):
        return int(numbers[0])
    if isinstance(space, spaces.Box):
        return numbers.astype(space.dtype).reshape(space.shape)
    raise wrong_choice(
        f"an action space of type `{type(space).__name__}` has no default", "give command=..."
    )
