"""From Gymnasium's arrays to a program's values, and back.

Purpose: the mappings where a user gives none: an observation is the plant's states, an action the
advanced controller's outputs, a command what the plant reads, by leaf; and the spaces of these.
Non-goals: units, frames, images: whatever is not leaf by leaf is a function of the user's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from soter.diagnostics.similar_names import did_you_mean
from soter.gym.outside_roles import wrong_choice
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    has_list,
    leaves,
)
from soter.language.model.values import ValueShapeError, from_python
from soter.semantics.draws import assemble

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from soter.diagnostics.diagnostic import SoterError
    from soter.gym.outside_roles import ObservedPart
    from soter.language.model.system import Bound, Component, System, Topic
    from soter.language.model.types import Type, Value

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


NUMBERS = "biufO"
"""Kinds of NumPy's types whose values may be real numbers."""

# ---------------------------------------------------------------- values and flat arrays


def doubles(numbers: object, subject: str) -> npt.NDArray[np.float64]:
    """The numbers of an array, a list or whatever NumPy takes for one, in its shape.

    SoterError U001 for text, complex numbers, mappings, and what is too large for a double.
    """
    why = "it has other values than real numbers"
    try:
        array = np.asarray(numbers)
        if array.dtype.kind in NUMBERS:
            return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        why = str(error)
    message = f"{subject} is no array of numbers: {str(numbers)[:40]}"
    raise wrong_choice(message, why, "give a function that maps it")


def assemble_values(shapes: Shapes, flat: object, subject: str) -> list[Value]:
    """One value per shape from the numbers of an array; SoterError U001 also for another count."""
    array = doubles(flat, subject)
    numbers = iter(array.reshape(-1).tolist())
    needed = sum(1 for _, t in shapes for _ in leaves(t))
    count = array.size
    if needed != count:
        raise wrong_count(shapes, count, subject)
    return [_value(t, numbers) for _, t in shapes]


def wrong_count(shapes: Shapes, count: int, subject: str) -> SoterError:
    """SoterError U001: an array has `count` numbers, and the shapes have another count."""
    names = ", ".join(f"`{n}`" for n, _ in shapes)
    needed = sum(1 for _, t in shapes for _ in leaves(t))
    message = f"{subject} has {count} numbers, but {names} {needed}"
    return wrong_choice(message, "give a function that maps them")


def wrong_structure(
    subject: str, shapes: Shapes, answer: object, error: ValueShapeError
) -> SoterError:
    """U001: an answer of a function of the user's that has not the names and counts of shapes."""
    names = [n for n, _ in shapes]
    keys = answer if isinstance(answer, Mapping) else ()
    near = [h for key in keys if key not in names for h in did_you_mean(str(key), names)]
    return wrong_choice(f"{subject}: {error}", *near)


def _value(t: Type, numbers: Iterator[float]) -> Value:
    if has_list(t):
        raise _no_list(t)
    return assemble(t, (_leaf(leaf, next(numbers)) for _, leaf in leaves(t)))


def _leaf(t: Type, number: float) -> Value:
    return number if isinstance(t, FloatType) else from_python(t, _whole(t, number))


def _whole(t: Type, number: float) -> object:
    """An int, bool or enum as `from_python` takes it; anything else as it is, to be refused."""
    if not math.isfinite(number) or number != int(number):
        return number
    if isinstance(t, EnumType):
        return t.members[int(number)] if 0 <= number < len(t.members) else number
    return bool(number) if isinstance(t, BoolType) else int(number)


def flatten(shapes: Shapes, values: Sequence[Value]) -> npt.NDArray[np.float64]:
    """The numbers of values, leaf by leaf, (leaves,); SoterError U001 for a list."""
    numbers: list[float] = []
    for (_, t), value in zip(shapes, values, strict=True):
        _flatten(t, value, numbers)
    return np.array(numbers)


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


def is_finite(value: Value) -> bool:
    """Whether no number of a value is NaN or infinite."""
    if isinstance(value, tuple):
        return all(is_finite(part) for part in value)
    return not isinstance(value, float) or math.isfinite(value)


def _no_list(t: Type) -> SoterError:
    return wrong_choice(f"a `{t}` has no fixed number of numbers", "give a function that maps it")


# ---------------------------------------------------------------- spaces


def _discretes(each: list[spaces.Discrete[Any]]) -> spaces.Space[Any]:
    if len(each) == 1:
        return each[0]
    start = np.array([int(x.start) for x in each])
    return spaces.MultiDiscrete([int(x.n) for x in each], start=start)


def action_space(topics: Sequence[Topic]) -> spaces.Space[Any]:
    """Everything an agent may publish: a `Box` of floats, or for ints, bools and enums `Discrete`.

    Several of them are `MultiDiscrete`. SoterError U001 for a mixture, for floats without a set,
    and where no float32 lies in a set.
    """
    bounds = [b for t in topics for b in t.bounds]
    kinds = [k for t in topics for _, k in leaves(t.type)]
    names = ", ".join(f"`{t.name}`" for t in topics)
    if all(isinstance(k, FloatType) for k in kinds) and None not in bounds:
        return _box([b for b in bounds if b is not None], names)
    if kinds and not any(isinstance(k, FloatType) for k in kinds):
        return _discretes([_discrete(k, b) for k, b in zip(kinds, bounds, strict=True)])
    raise wrong_choice(
        f"{names} are neither floats in a set nor ints, bools and enums", "give action_space=..."
    )


def _box(bounds: Sequence[Bound], names: str) -> spaces.Box:
    """The float32 numbers between bounds; SoterError U001 where there are none, with `names`."""
    low, high = np.array([b.low for b in bounds]), np.array([b.high for b in bounds])
    least, most = _inward(low, high), _inward(high, low)
    if (least < low).any() or (most > high).any() or (least > most).any():
        raise wrong_choice(f"no float32 lies in a set of {names}", "give action_space=...")
    return spaces.Box(least, most, dtype=np.float32)


def require_no_batch(space: spaces.Space[Any], action: Any) -> None:  # noqa: ANN401 - any action
    """SoterError U001 for an action with more axes than those of `space` have, such as (1, 1).

    A number stands for an array of one, and one of those for a number.
    """
    axes = doubles(action, "an action").ndim
    if axes > 1 and axes > len(space.shape or ()):
        expected = f"those of the space {space.shape}"
        message = f"an action has the shape {np.shape(action)}, and {expected}"
        raise wrong_choice(message, "take the row of one action out of a batch: `actions[0]`")


def observation_space(system: System, seen: Sequence[ObservedPart], dtype: Any) -> spaces.Box:  # noqa: ANN401
    """A `Box` of everything that topics and truths may hold; what has no bounds has none."""
    bounds: list[Bound | None] = []
    for x in seen:
        if x.truth:
            plant = system.components[x.index].plant
            assert plant is not None
            bounds += [None for v in plant.states for _ in leaves(v.type)]
        else:
            bounds += system.topics[x.index].bounds
    low = np.array([-np.inf if b is None else b.low for b in bounds], dtype=dtype)
    high = np.array([np.inf if b is None else b.high for b in bounds], dtype=dtype)
    return spaces.Box(low, high, dtype=dtype)


def _discrete(kind: Type, bound: Any) -> spaces.Discrete:  # noqa: ANN401 - Bound or None
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


def taker(space: spaces.Space[Any], count: int) -> Callable[[npt.NDArray[np.float64]], Any]:
    """A function that makes an element of an environment's action space of an array (count,).

    SoterError U001 for a space without a default, or one with another number of numbers; the
    function raises it for a fraction where whole numbers are wanted.
    """
    if isinstance(space, spaces.Discrete):
        _require_size(space, 1, count)
        return lambda numbers: _member(space, int(_whole_numbers(space, numbers)[0]))
    if isinstance(space, (spaces.MultiDiscrete, spaces.MultiBinary)):
        _require_size(space, int(np.prod(space.shape)), count)
        return lambda numbers: _member(
            space, _whole_numbers(space, numbers).astype(space.dtype).reshape(space.shape)
        )
    if not isinstance(space, spaces.Box):
        raise wrong_choice(
            f"an action space of type `{type(space).__name__}` has no default", "give command=..."
        )
    _require_size(space, int(np.prod(space.shape)), count)
    shape, dtype = space.shape, space.dtype
    if not np.issubdtype(dtype, np.floating):
        return lambda numbers: _whole_numbers(space, numbers).astype(dtype).reshape(shape)
    if shape == (count,):
        return lambda numbers: numbers.astype(dtype)
    return lambda numbers: numbers.astype(dtype).reshape(shape)


def as_action(space: spaces.Space[Any], numbers: npt.NDArray[np.float64]) -> Any:  # noqa: ANN401
    """Numbers (n,) as an element of an environment's action space; SoterError U001 as `taker`."""
    return taker(space, len(numbers))(numbers)


def _require_size(space: spaces.Space[Any], wanted: int, count: int) -> None:
    if wanted != count:
        message = f"the plant reads {count} numbers, but an action of the environment has {wanted}"
        raise wrong_choice(f"{message} (`{space}`)", "give command=...")


def _whole_numbers(
    space: spaces.Space[Any], numbers: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """The same numbers (n,); SoterError U001 where one of them is not whole."""
    if not (np.isfinite(numbers).all() and (np.floor(numbers) == numbers).all()):
        first = next(x for x in numbers.tolist() if not math.isfinite(x) or x != int(x))
        raise wrong_choice(
            f"{first!r} is no whole number, and the environment's actions are `{space}`",
            "let the plant read an int or an enum, or give command=...",
        )
    return numbers


def _member(space: spaces.Space[Any], action: Any) -> Any:  # noqa: ANN401 - an int or an array
    """The same action; SoterError U001 where it is none of the space."""
    if not space.contains(action):
        raise wrong_choice(
            f"{action} is no action of the environment's `{space}`", "give command=..."
        )
    return action
