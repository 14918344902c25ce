"""A small network: its layers, and what it answers in float32.

Purpose: the one form that files are read into, that is run by NumPy, bounded and written as Soter.
Non-goals: files (`sb3_file.py`, `onnx_file.py`), convolutions, memory, training.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Operation = Literal["+", "-", "*", "/"]
OPERATIONS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


@dataclass(frozen=True, eq=False)
class Standardised:
    """clip((x - mean) / deviation, -limit, limit), in float64, then rounded: VecNormalize's."""

    mean: Doubles
    deviation: Doubles
    limit: float


@dataclass(frozen=True, eq=False)
class Affine:
    """weight x + bias; weight (out, in), bias (out,)."""

    weight: Floats
    bias: Floats


@dataclass(frozen=True, eq=False)
class Elementwise:
    """x op operand, number by number; operand (n,)."""

    operation: Operation
    operand: Floats


@dataclass(frozen=True)
class Relu:
    """max(x, 0)."""


@dataclass(frozen=True)
class Tanh:
    """tanh(x)."""


@dataclass(frozen=True, eq=False)
class Clipped:
    """min(max(x, low), high); low and high (n,), infinite where there is no bound."""

    low: Floats
    high: Floats

    @property
    def decimals(self) -> tuple[Doubles, Doubles]:
        """The bounds as people write them, (n,): 0.1 where float32 has 0.100000001."""
        low, high = ([float(str(x)) for x in bound] for bound in (self.low, self.high))
        return np.array(low), np.array(high)


Layer = Standardised | Affine | Elementwise | Relu | Tanh | Clipped


@dataclass(frozen=True)
class Network:
    """Layers one after the other, from `inputs` numbers.

    `choice`: the answer is the index of the largest number, the first of equal ones.
    """

    inputs: int
    layers: tuple[Layer, ...]
    choice: bool = False

    @property
    def outputs(self) -> int:
        """How many numbers the last layer has."""
        sizes = [size for layer in self.layers if (size := _size(layer)) is not None]
        return sizes[-1] if sizes else self.inputs

    @property
    def weights(self) -> int:
        """How many numbers its matrices have."""
        return sum(x.weight.size for x in self.layers if isinstance(x, Affine))


@dataclass(frozen=True)
class Policy:
    """What a file says of a policy.

    `facts`: what was read, in words, by what it is. `assumed`: what the file does not say.
    `per_frame`: what is done to each frame before frames are stacked. `box`: the least and the
    largest observation, (inputs,) each, where the file says finite ones.
    """

    path: str
    network: Network
    facts: dict[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    per_frame: Standardised | None = None
    box: tuple[Doubles, Doubles] | None = None


def _size(layer: Layer) -> int | None:
    if isinstance(layer, Affine):
        return int(layer.weight.shape[0])
    if isinstance(layer, Elementwise):
        return int(layer.operand.size)
    return int(layer.low.size) if isinstance(layer, Clipped) else None


def in_numbers(count: int) -> str:
    """How many numbers, in words."""
    return f"{count} number{'s' * (count != 1)}"


def _bad_numbers(layer: Layer, arrays: list[Floats]) -> str:
    if not all(np.isfinite(a).all() for a in arrays) and not isinstance(layer, Clipped):
        return "holds a number that is not finite"
    if isinstance(layer, Standardised) and not (layer.deviation > 0.0).all():
        return "divides by a deviation that is not positive"
    if isinstance(layer, Elementwise) and layer.operation == "/" and (layer.operand == 0).any():
        return "divides by zero"
    if isinstance(layer, Clipped) and not (layer.low <= layer.high).all():
        return "clips to bounds that exclude each other"
    return ""


def problem_of(network: Network) -> str:
    """Why layers do not fit each other or hold numbers that are none; "" where they do."""
    size = network.inputs
    for number, layer in enumerate(network.layers, 1):
        arrays = [x for x in vars(layer).values() if isinstance(x, np.ndarray)]
        takes = arrays[0].shape[-1] if arrays else size
        if takes != size:
            return f"layer {number} takes {in_numbers(takes)}, and is given {size}"
        if wrong := _bad_numbers(layer, arrays):
            return f"layer {number} {wrong}"
        size = _size(layer) or size
    return ""


# ---------------------------------------------------------------- in float32


def standardised(layer: Standardised, x: Doubles) -> Floats:
    """What VecNormalize makes of observations (..., n)."""
    scaled = (x - layer.mean) / layer.deviation
    return np.clip(scaled, -layer.limit, layer.limit).astype(np.float32)


def answering(network: Network) -> tuple[Floats, Callable[[], Floats]]:
    """Where an observation is written, (inputs,), and what asks the network about it.

    The answer is what the last layer says in float32, (outputs,); the next call overwrites it.
    """
    steps: list[Callable[[], object]] = []
    before = _with_one(network.inputs)
    observation = before[:-1]
    for layer in network.layers:
        if isinstance(
            layer, Affine
        ):  # the bias is the weight of a one that stands after the numbers
            after = _with_one(len(layer.bias))
            weight = np.hstack([layer.weight, layer.bias[:, None]])
            steps.append(partial(weight.dot, before, after[:-1]))
        else:
            after = before if steps else _with_one(network.inputs)
            steps += _in_place(layer, before[:-1], after[:-1])
        before = after
    answer = before[:-1]

    def run() -> Floats:
        for step in steps:
            step()
        return answer

    return observation, run


def _with_one(size: int) -> Floats:
    return np.append(np.zeros(size, np.float32), np.float32(1.0))


def _in_place(layer: Layer, x: Floats, out: Floats) -> list[Callable[[], object]]:
    """The steps of a layer that keeps the count of numbers."""
    if isinstance(layer, Tanh):
        return [partial(np.tanh, x, out=out)]
    if isinstance(layer, Relu):
        return [partial(np.maximum, x, np.zeros_like(x), out=out)]
    if isinstance(layer, Clipped):
        clipped = partial(np.minimum, out, layer.high, out=out)
        return [partial(np.maximum, x, layer.low, out=out), clipped]
    if isinstance(layer, Elementwise):
        return [partial(OPERATIONS[layer.operation], x, layer.operand, out=out)]
    assert isinstance(layer, Standardised)
    return [lambda: np.copyto(out, standardised(layer, x.astype(np.float64)))]


def answer(network: Network, observation: Floats) -> Floats:
    """What the last layer says in float32, (outputs,), of one observation (inputs,)."""
    given, run = answering(network)
    given[:] = observation
    return run()
