"""Maps Gymnasium's arrays to a program's values, and back.

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
from soter.gym.environment_choices import wrong_choice
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
from soter.semantics.draws import value_of_leaves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from soter.diagnostics.diagnostic import SoterError
    from soter.gym.environment_choices import ObservedPart
    from soter.language.model.system import Bound, Component, System, Topic
    from soter.language.model.types import Type, Value

    Shapes = Sequence[tuple[str, Type]]


def named_state_types(plant: Component) -> list[tuple[str, Type]]:
    """The names and types of a plant's states."""
    assert plant.plant is not None
    return [(v.name, v.type) for v in plant.plant.states]


def topics_read(system: System, plant: Component) -> list[Topic]:
    """The topics that a plant reads, in declared order."""
    assert plant.plant is not None
    return [system.topics[plant.scope.topics[t]] for t in plant.plant.reads]


def topics_published(system: System, node: Component) -> list[Topic]:
    """The topics that a node publishes, in declared order."""
    assert node.node is not None
    return [system.topics[node.scope.topics[t]] for t in node.node.publishes]


NUMBERS = "biufO"
"""Kinds of NumPy's types whose values may be real numbers."""

# ---------------------------------------------------------------- values and flat arrays


def array_of_doubles(numbers: object, subject: str) -> npt.NDArray[np.float64]:
    """The numbers of an array, a list or another object that NumPy accepts, in the same shape.

    Raises SoterError U001 for text, complex numbers, mappings and numbers too large for a double.
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
    """Makes one value of each type from an array of just as many numbers; SoterError U001."""
    array = array_of_doubles(flat, subject)
    numbers = iter(array.reshape(-1).tolist())
    needed = sum(1 for _, t in shapes for _ in leaves(t))
    count = array.size
    if needed != count:
        raise wrong_count_error(shapes, count, subject)
    return [_value_from_numbers(t, numbers) for _, t in shapes]


def wrong_count_error(shapes: Shapes, count: int, subject: str) -> SoterError:
    """The SoterError U001 that says that an array has `count` numbers, but `shapes` need others."""
    names = ", ".join(f"`{n}`" for n, _ in shapes)
    needed = sum(1 for _, t in shapes for _ in leaves(t))
    message = f"{subject} has {count} numbers, but {names} {needed}"
    return wrong_choice(message, "give a function that maps them")


def wrong_structure_error(
    subject: str, shapes: Shapes, answer: object, error: ValueShapeError
) -> SoterError:
    """The SoterError U001 for a user's function that answers names or counts unlike `shapes`."""
    names = [n for n, _ in shapes]
    keys = answer if isinstance(answer, Mapping) else ()
    near = [h for key in keys if key not in names for h in did_you_mean(str(key), names)]
    return wrong_choice(f"{subject}: {error}", *near)


def _value_from_numbers(t: Type, numbers: Iterator[float]) -> Value:
    if has_list(t):
        raise _list_error(t)
    return value_of_leaves(t, (_leaf_value(leaf, next(numbers)) for _, leaf in leaves(t)))


def _leaf_value(t: Type, number: float) -> Value:
    return number if isinstance(t, FloatType) else from_python(t, _discrete_value(t, number))


def _discrete_value(t: Type, number: float) -> object:
    """The int, bool or enum with that number, for `from_python`; else the number unchanged."""
    if not math.isfinite(number) or number != int(number):
        return number
    if isinstance(t, EnumType):
        return t.members[int(number)] if 0 <= number < len(t.members) else number
    return bool(number) if isinstance(t, BoolType) else int(number)


def numbers_of_values(shapes: Shapes, values: Sequence[Value]) -> npt.NDArray[np.float64]:
    """The numbers of values, leaf by leaf, (leaves,); raises SoterError U001 for a list."""
    numbers: list[float] = []
    for (_, t), value in zip(shapes, values, strict=True):
        _append_numbers(t, value, numbers)
    return np.array(numbers)


def _append_numbers(t: Type, value: Value, into: list[float]) -> None:
    if isinstance(t, RecordType):
        for (_, f), part in zip(t.fields, value, strict=True):
            _append_numbers(f, part, into)
    elif isinstance(t, ArrayType):
        for part in value:
            _append_numbers(t.element, part, into)
    elif isinstance(t, ListType):
        raise _list_error(t)
    else:
        into.append(float(value))


def is_finite(value: Value) -> bool:
    """Whether no number of a value is NaN or infinite."""
    if isinstance(value, tuple):
        return all(is_finite(part) for part in value)
    return not isinstance(value, float) or math.isfinite(value)


def _list_error(t: Type) -> SoterError:
    return wrong_choice(f"a `{t}` has no fixed number of numbers", "give a function that maps it")


# ---------------------------------------------------------------- spaces


def _joint_discrete_space(each: list[spaces.Discrete[Any]]) -> spaces.Space[Any]:
    if len(each) == 1:
        return each[0]
    start = np.array([int(x.start) for x in each])
    return spaces.MultiDiscrete([int(x.n) for x in each], start=start)


def action_space(topics: Sequence[Topic]) -> spaces.Space[Any]:
    """The space of all values that an agent may publish: a `Box` for floats, else a `Discrete`.

    Several ints, bools and enums make a `MultiDiscrete`. Raises SoterError U001 for a mixture, for
    floats without a set, and for a set that contains no float32.
    """
    bounds = [b for t in topics for b in t.bounds]
    kinds = [k for t in topics for _, k in leaves(t.type)]
    names = ", ".join(f"`{t.name}`" for t in topics)
    if all(isinstance(k, FloatType) for k in kinds) and None not in bounds:
        return _box_space([b for b in bounds if b is not None], names)
    if kinds and not any(isinstance(k, FloatType) for k in kinds):
        return _joint_discrete_space(
            [_leaf_space(k, b) for k, b in zip(kinds, bounds, strict=True)]
        )
    raise wrong_choice(
        f"{names} are neither floats in a set nor ints, bools and enums", "give action_space=..."
    )


def _box_space(bounds: Sequence[Bound], names: str) -> spaces.Box:
    """A box of the float32 numbers in all bounds; SoterError U001 with `names` if there is none."""
    low, high = np.array([b.low for b in bounds]), np.array([b.high for b in bounds])
    least, most = _rounded_inward(low, high), _rounded_inward(high, low)
    if (least < low).any() or (most > high).any() or (least > most).any():
        raise wrong_choice(f"no float32 lies in a set of {names}", "give action_space=...")
    return spaces.Box(least, most, dtype=np.float32)


def require_no_batch(space: spaces.Space[Any], action: Any) -> None:  # noqa: ANN401 - any action
    """Raises SoterError U001 for an action with several axes, if `space` has fewer axes."""
    axes = array_of_doubles(action, "an action").ndim
    if axes > 1 and axes > len(space.shape or ()):
        expected = f"those of the space {space.shape}"
        message = f"an action has the shape {np.shape(action)}, and {expected}"
        raise wrong_choice(message, "take the row of one action out of a batch: `actions[0]`")


def observation_space(system: System, seen: Sequence[ObservedPart], dtype: Any) -> spaces.Box:  # noqa: ANN401
    """A `Box` with the bounds of all observed topics; true states have no bounds."""
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


def _leaf_space(kind: Type, bound: Any) -> spaces.Discrete:  # noqa: ANN401 - Bound or None
    if isinstance(kind, EnumType):
        return spaces.Discrete(len(kind.members))
    if isinstance(kind, BoolType):
        return spaces.Discrete(2)
    assert isinstance(kind, IntType)
    low, high = (bound.low, bound.high) if bound is not None else (kind.low, kind.high)
    return spaces.Discrete(int(high - low + 1), start=int(low))


def _rounded_inward(
    edge: npt.NDArray[np.float64], other: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Bounds as float32, (n,), rounded towards `other` so that none leaves the set."""
    rounded = edge.astype(np.float32)
    outside = np.where(edge < other, rounded < edge, rounded > edge)
    return np.where(outside, np.nextafter(rounded, other.astype(np.float32)), rounded)


def action_maker(space: spaces.Space[Any], count: int) -> Callable[[npt.NDArray[np.float64]], Any]:
    """The function that makes an action of an environment's space from an array (count,).

    Raises SoterError U001 for a space without a default, or with another count of numbers. The
    function raises it for a fraction if the space has whole numbers only.
    """
    if isinstance(space, spaces.Discrete):
        _require_size(space, 1, count)
        return lambda numbers: _require_member(space, int(_require_whole(space, numbers)[0]))
    if isinstance(space, (spaces.MultiDiscrete, spaces.MultiBinary)):
        _require_size(space, int(np.prod(space.shape)), count)
        return lambda numbers: _require_member(
            space, _require_whole(space, numbers).astype(space.dtype).reshape(space.shape)
        )
    if not isinstance(space, spaces.Box):
        raise wrong_choice(
            f"an action space of type `{type(space).__name__}` has no default", "give command=..."
        )
    _require_size(space, int(np.prod(space.shape)), count)
    shape, dtype = space.shape, space.dtype
    if not np.issubdtype(dtype, np.floating):
        return lambda numbers: _require_whole(space, numbers).astype(dtype).reshape(shape)
    if shape == (count,):
        return lambda numbers: numbers.astype(dtype)
    return lambda numbers: numbers.astype(dtype).reshape(shape)


def _require_size(space: spaces.Space[Any], wanted: int, count: int) -> None:
    if wanted != count:
        message = f"the plant reads {count} numbers, but an action of the environment has {wanted}"
        raise wrong_choice(f"{message} (`{space}`)", "give command=...")


def _require_whole(
    space: spaces.Space[Any], numbers: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Gives the same numbers (n,); raises SoterError U001 if any of them is not whole."""
    if not (np.isfinite(numbers).all() and (np.floor(numbers) == numbers).all()):
        first = next(x for x in numbers.tolist() if not math.isfinite(x) or x != int(x))
        raise wrong_choice(
            f"{first!r} is no whole number, and the environment's actions are `{space}`",
            "let the plant read an int or an enum, or give command=...",
        )
    return numbers


def _require_member(space: spaces.Space[Any], action: Any) -> Any:  # noqa: ANN401 - an int or an array
    """Gives the same action; raises SoterError U001 if the space does not contain it."""
    if not space.contains(action):
        raise wrong_choice(
            f"{action} is no action of the environment's `{space}`", "give command=..."
        )
    return action
