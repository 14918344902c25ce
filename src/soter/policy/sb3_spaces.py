"""Reads the spaces of what a policy observes or chooses, as Stable-Baselines3 saved them.

Purpose: an `ObservationLayout` does as `preprocess_obs` of Stable-Baselines3: numbers stay, a
choice among n becomes n numbers of which one is 1, and observations by name stand one after the
other. The bounds, choices and bits of a space serve actions, too.
Non-goals: images; what a network makes of them (`sb3_file.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.policy.network import OneHot
from soter.policy.pickle_data import Made, read_array
from soter.policy.policy_errors import bad_policy_error
from soter.policy.sb3_zip import EXPORT

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.policy.network import Doubles, Layer


NUMBERS_MAX, NAME_MAX = 1_000_000, 80


class ObservationLayout(NamedTuple):
    """The observations of a policy.

    `sizes`: for each number, the count of choices that it encodes, 0 for a plain number. `shown`:
    the space in words. `box`: the least and largest numbers, if finite. `keys`: the names of
    observations and their counts of numbers. `shapes`: the axes of each Box by name.
    """

    sizes: tuple[int, ...]
    shown: str
    box: tuple[Doubles, Doubles] | None = None
    keys: tuple[tuple[str, int], ...] = ()
    shapes: Mapping[str, tuple[int, ...]] = {}

    @property
    def layers(self) -> list[Layer]:
        """The layers that prepare an observation for the network."""
        return [OneHot(self.sizes)] if any(self.sizes) else []


def space_kind(space: Made) -> str:
    """The name of a space's class, such as `Box`."""
    return space.name.rpartition(".")[2]


def require_space(path: Path, space: object, which: str, kinds: Mapping[str, object]) -> Made:
    """The space, if it is of one of these kinds; else SoterError X014."""
    if not isinstance(space, Made) or not isinstance(space.state, dict):
        raise bad_policy_error(path, f"it does not say its {which}")
    if space_kind(space) not in kinds:
        why = f"its {which} is a `{space_kind(space)[:40]}`"
        raise bad_policy_error(path, why, f"what can be read: {', '.join(kinds)}")
    return space


def observation_layout(path: Path, space: object) -> ObservationLayout:
    """The layout of a policy's observations, from their space; raises X014 for other spaces."""
    made = require_space(path, space, "observation space", OBSERVED)
    return OBSERVED[space_kind(made)](path, made)


def _box_layout(path: Path, space: Made) -> ObservationLayout:
    shape = space_shape(path, space)
    low, high = box_bounds(path, space)
    if len(shape) == 3 and low.dtype == np.uint8:
        raise bad_policy_error(path, f"its observations are images of shape {shape}", EXPORT)
    if low.size != math.prod(shape):
        raise bad_policy_error(path, "the bounds of a Box are not one for each number")
    ends = low.astype(np.float64), high.astype(np.float64)
    hull = None
    if all(np.isfinite(end).all() for end in ends):
        # of stacked frames the space's bounds stand in another order
        hull = np.full(low.size, ends[0].min()), np.full(low.size, ends[1].max())
    return ObservationLayout((0,) * low.size, space_text(path, space), hull, shapes={"": shape})


def space_shape(path: Path, space: Made) -> tuple[int, ...]:
    """The axes of a Box; raises SoterError X014 if it has none."""
    shape = space.state.get("_shape")
    if not isinstance(shape, tuple) or not all(isinstance(n, int) and n > 0 for n in shape):
        raise bad_policy_error(path, f"a Box of it has the shape {shape!r:.60}")
    return shape


def _choice_layout(path: Path, space: Made) -> ObservationLayout:
    sizes = choice_counts(path, space)
    low, high = np.zeros(len(sizes)), np.array(sizes, np.float64) - 1.0
    return ObservationLayout(sizes, space_text(path, space), (low, high))


def _bits_layout(path: Path, space: Made) -> ObservationLayout:
    count, n = bit_count(path, space), space.state.get("n")
    shapes = {"": n} if isinstance(n, tuple) and len(n) > 1 else {}
    box = np.zeros(count), np.ones(count)
    return ObservationLayout((0,) * count, space_text(path, space), box, shapes=shapes)


def _dict_layout(path: Path, space: Made) -> ObservationLayout:
    kept = space.state.get("spaces")
    inner = kept.items if isinstance(kept, Made) else kept  # an OrderedDict is made
    if not isinstance(inner, dict) or not inner:
        raise bad_policy_error(path, "its observations by name have no names")
    parts = {name: observation_layout(path, part) for name, part in inner.items()}
    if not all(name.isprintable() and len(name) <= NAME_MAX for name in inner):
        raise bad_policy_error(path, "a name of its observations is no name")
    if sum(len(part.sizes) for part in parts.values()) > NUMBERS_MAX:
        raise bad_policy_error(path, "it observes more numbers than are read")
    if nested := [name for name, part in parts.items() if part.keys]:
        raise bad_policy_error(path, f"its observation `{nested[0][:40]}` is by name again", EXPORT)
    return ObservationLayout(
        tuple(size for part in parts.values() for size in part.sizes),
        ", ".join(f"`{name}` {part.shown}" for name, part in parts.items()),
        _joined_box([part.box for part in parts.values()]),
        tuple((name, len(part.sizes)) for name, part in parts.items()),
        {name: part.shapes[""] for name, part in parts.items() if part.shapes},
    )


def _joined_box(boxes: list[tuple[Doubles, Doubles] | None]) -> tuple[Doubles, Doubles] | None:
    """The bounds of all numbers as one pair of arrays; None if any number has no bound."""
    known = [box for box in boxes if box is not None]
    if len(known) < len(boxes):
        return None
    low, high = (np.concatenate(ends) for ends in zip(*known, strict=True))
    return low, high


OBSERVED = {
    "Box": _box_layout,
    "Discrete": _choice_layout,
    "MultiDiscrete": _choice_layout,
    "MultiBinary": _bits_layout,
    "Dict": _dict_layout,
}


def box_bounds(path: Path, space: Made) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """The lower and the upper bound of each number of a Box, (n,); raises SoterError X014."""
    low, high = (read_array(space.state.get(k)).reshape(-1) for k in ("low", "high"))
    if low.shape != high.shape or not low.size:
        raise bad_policy_error(path, "the bounds of a Box are not one for each number")
    return low, high


def choice_counts(path: Path, space: Made) -> tuple[int, ...]:
    """The count of choices of a Discrete, or of each part of a MultiDiscrete; raises X014.

    Also raises X014 if the choices do not begin at 0.
    """
    if space_kind(space) == "Discrete":
        sizes, starts = [integer_setting(space, "n")], [integer_setting(space, "start", 0)]
    else:
        start = space.state.get("start")
        sizes = read_array(space.state.get("nvec")).reshape(-1).tolist()
        starts = [] if start is None else read_array(start).reshape(-1).tolist()
    if not all(isinstance(n, int) and n > 0 for n in sizes) or sum(sizes) > NUMBERS_MAX:
        raise bad_policy_error(path, "it does not say how many there are to choose from")
    if any(starts):
        raise bad_policy_error(path, "what it chooses from does not begin at 0", EXPORT)
    return tuple(sizes)


def bit_count(path: Path, space: Made) -> int:
    """How many bits a MultiBinary has; raises SoterError X014."""
    n = space.state.get("n")
    sizes = n if isinstance(n, tuple) else (integer_setting(space, "n"),)
    count = math.prod(x if isinstance(x, int) and x > 0 else 0 for x in sizes)
    if not 0 < count <= NUMBERS_MAX // 100:
        raise bad_policy_error(path, "it does not say how many bits it has, or too many")
    return count


def integer_setting(space: Made, which: str, default: int = -1) -> int:
    """The int in a setting (Python's in older files, NumPy's in newer ones); else `default`."""
    value = space.state.get(which, default)
    if isinstance(value, Made):
        numbers = read_array(value)
        value = int(numbers) if numbers.ndim == 0 and numbers.dtype.kind == "i" else default
    return value if isinstance(value, int) else default


def space_text(path: Path, space: Made) -> str:
    """A space in a few words, such as `Discrete(4)`."""
    kind = space_kind(space)
    if kind == "MultiBinary":
        return f"MultiBinary({bit_count(path, space)})"
    if kind != "Box":
        return f"{kind}({', '.join(map(str, choice_counts(path, space)))})"
    low, high = box_bounds(path, space)
    return f"Box of {low.size}: {', '.join(_interval_texts(low, high))}"


def _interval_texts(low: npt.NDArray[Any], high: npt.NDArray[Any]) -> Iterator[str]:
    for a, b in zip(low[:8], high[:8], strict=True):
        yield f"[{a:g}, {b:g}]"
    if low.size > 8:
        yield "..."
