"""Spaces of Gymnasium as a saved policy says them: how many numbers, and how they are prepared.

Purpose: what `preprocess_obs` of Stable-Baselines3 does to observations: numbers as they are, one
number out of several as so many of which one is 1, observations by name one after the other.
Non-goals: images.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.policy.network import OneHot
from soter.policy.pickle_data import Made, array_of
from soter.policy.policy_errors import bad_policy

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.policy.network import Doubles, Layer

NUMBERS_MAX, NAME_MAX = 1_000_000, 80
EXPORT = "export it as ONNX: `soter explain X014` has the lines"


class Observed(NamedTuple):
    """What a policy observes.

    `sizes`: of each number, how many it may be, 0 where it is taken as it is. `box`: the least
    and the largest number, where they are finite. `keys`: name and count of those by name.
    """

    sizes: tuple[int, ...]
    shown: str
    box: tuple[Doubles, Doubles] | None = None
    keys: tuple[tuple[str, int], ...] = ()

    @property
    def layers(self) -> list[Layer]:
        """What prepares it for the network."""
        return [OneHot(self.sizes)] if any(self.sizes) else []


def kind_of(space: Made) -> str:
    """The name of its class."""
    return space.name.rpartition(".")[2]


def space_of(path: Path, space: object, which: str, kinds: Mapping[str, object]) -> Made:
    """A space of one of these kinds; SoterError X014."""
    if not isinstance(space, Made) or not isinstance(space.state, dict):
        raise bad_policy(path, f"it does not say its {which}")
    if kind_of(space) not in kinds:
        why = f"its {which} is a `{kind_of(space)[:40]}`"
        raise bad_policy(path, why, f"what can be read: {', '.join(kinds)}")
    return space


def observed(path: Path, space: object) -> Observed:
    """What an observation space says; SoterError X014."""
    made = space_of(path, space, "observation space", OBSERVED)
    return OBSERVED[kind_of(made)](path, made)


def _box(path: Path, space: Made) -> Observed:
    shape = _shape(path, space)
    low, high = bounds(path, space)
    if len(shape) == 3 and low.dtype == np.uint8:
        raise bad_policy(path, f"its observations are images of shape {shape}", EXPORT)
    if low.size != math.prod(shape):
        raise bad_policy(path, "the bounds of a Box are not one for each number")
    ends = low.astype(np.float64), high.astype(np.float64)
    hull = None
    if all(np.isfinite(end).all() for end in ends):
        # of stacked frames the space's bounds stand in another order
        hull = np.full(low.size, ends[0].min()), np.full(low.size, ends[1].max())
    return Observed((0,) * low.size, shown(path, space), hull)


def _shape(path: Path, space: Made) -> tuple[int, ...]:
    shape = space.state.get("_shape")
    if not isinstance(shape, tuple) or not all(isinstance(n, int) and n > 0 for n in shape):
        raise bad_policy(path, f"its observations have the shape {shape!r:.60}")
    return shape


def _one_of(path: Path, space: Made) -> Observed:
    sizes = sizes_of(path, space)
    low, high = np.zeros(len(sizes)), np.array(sizes, np.float64) - 1.0
    return Observed(sizes, shown(path, space), (low, high))


def _bits(path: Path, space: Made) -> Observed:
    count = bits(path, space)
    return Observed((0,) * count, shown(path, space), (np.zeros(count), np.ones(count)))


def _by_name(path: Path, space: Made) -> Observed:
    kept = space.state.get("spaces")
    inner = kept.items if isinstance(kept, Made) else kept  # an OrderedDict is made
    if not isinstance(inner, dict) or not inner:
        raise bad_policy(path, "its observations by name have no names")
    parts = {name: observed(path, part) for name, part in inner.items()}
    if not all(name.isprintable() and len(name) <= NAME_MAX for name in inner):
        raise bad_policy(path, "a name of its observations is no name")
    if sum(len(part.sizes) for part in parts.values()) > NUMBERS_MAX:
        raise bad_policy(path, "it observes more numbers than are read")
    if nested := [name for name, part in parts.items() if part.keys]:
        raise bad_policy(path, f"its observation `{nested[0][:40]}` is by name again", EXPORT)
    return Observed(
        tuple(size for part in parts.values() for size in part.sizes),
        ", ".join(f"`{name}` {part.shown}" for name, part in parts.items()),
        _together([part.box for part in parts.values()]),
        tuple((name, len(part.sizes)) for name, part in parts.items()),
    )


def _together(boxes: list[tuple[Doubles, Doubles] | None]) -> tuple[Doubles, Doubles] | None:
    """The ends of all numbers; None where some have none."""
    known = [box for box in boxes if box is not None]
    if len(known) < len(boxes):
        return None
    low, high = (np.concatenate(ends) for ends in zip(*known, strict=True))
    return low, high


OBSERVED = {
    "Box": _box,
    "Discrete": _one_of,
    "MultiDiscrete": _one_of,
    "MultiBinary": _bits,
    "Dict": _by_name,
}


def bounds(path: Path, space: Made) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """The least and the largest number of each, (n,), of a Box of any; SoterError X014."""
    low, high = (array_of(space.state.get(k)).reshape(-1) for k in ("low", "high"))
    if low.shape != high.shape or not low.size:
        raise bad_policy(path, "the bounds of a Box are not one for each number")
    return low, high


def sizes_of(path: Path, space: Made) -> tuple[int, ...]:
    """How many there are to choose from, of a Discrete or a MultiDiscrete; SoterError X014.

    They begin at 0.
    """
    if kind_of(space) == "Discrete":
        sizes, starts = [whole(space, "n")], [whole(space, "start", 0)]
    else:
        start = space.state.get("start")
        sizes = array_of(space.state.get("nvec")).reshape(-1).tolist()
        starts = [] if start is None else array_of(start).reshape(-1).tolist()
    if not all(isinstance(n, int) and n > 0 for n in sizes) or sum(sizes) > NUMBERS_MAX:
        raise bad_policy(path, "it does not say how many there are to choose from")
    if any(starts):
        raise bad_policy(path, "what it chooses from does not begin at 0")
    return tuple(sizes)


def bits(path: Path, space: Made) -> int:
    """How many bits a MultiBinary has; SoterError X014."""
    n = space.state.get("n")
    sizes = n if isinstance(n, tuple) else (whole(space, "n"),)
    count = math.prod(x if isinstance(x, int) and x > 0 else 0 for x in sizes)
    if not 0 < count <= NUMBERS_MAX // 100:
        raise bad_policy(path, "it does not say how many bits it has, or too many")
    return count


def whole(space: Made, which: str, default: int = -1) -> int:
    """An int of a Discrete, which older files have as Python's and newer ones as NumPy's."""
    value = space.state.get(which, default)
    if isinstance(value, Made):
        numbers = array_of(value)
        value = int(numbers) if numbers.ndim == 0 and numbers.dtype.kind == "i" else default
    return value if isinstance(value, int) else default


def shown(path: Path, space: Made) -> str:
    """A space in a few words."""
    kind = kind_of(space)
    if kind == "MultiBinary":
        return f"MultiBinary({bits(path, space)})"
    if kind != "Box":
        return f"{kind}({', '.join(map(str, sizes_of(path, space)))})"
    low, high = bounds(path, space)
    return f"Box of {low.size}: {', '.join(_intervals(low, high))}"


def _intervals(low: npt.NDArray[Any], high: npt.NDArray[Any]) -> Iterator[str]:
    for a, b in zip(low[:8], high[:8], strict=True):
        yield f"[{a:g}, {b:g}]"
    if low.size > 8:
        yield "..."
