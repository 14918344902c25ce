"""Holds the layers of a small network, which answer in float32.

Purpose: the one form that files are read into, and that is run, bounded, and written as Soter or C.
Non-goals: files (`sb3_file.py`, `onnx_file.py`), convolutions, training.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Operation = Literal["+", "-", "*", "/"]
OPERATIONS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


@dataclass(frozen=True, eq=False)
class Standardised:
    """clip((x - mean) / deviation, -limit, limit) in float64, then rounded, like VecNormalize.

    All (n,); a number that is not normalised has mean 0, deviation 1 and an infinite limit.
    """

    mean: Doubles
    deviation: Doubles
    limit: Doubles


@dataclass(frozen=True)
class OneHot:
    """Replaces an int below `size` by `size` numbers, all 0 but a single 1; size 0 keeps it."""

    sizes: tuple[int, ...]

    @property
    def outputs(self) -> int:
        """How many numbers the layer gives."""
        return sum(size or 1 for size in self.sizes)


@dataclass(frozen=True, eq=False)
class Affine:
    """weight x + bias; weight (out, in), bias (out,)."""

    weight: Floats
    bias: Floats


@dataclass(frozen=True, eq=False)
class Elementwise:
    """x op operand, separately for each number; operand (n,)."""

    operation: Operation
    operand: Floats


@dataclass(frozen=True)
class Relu:
    """max(x, 0)."""


@dataclass(frozen=True)
class Tanh:
    """tanh(x)."""


@dataclass(frozen=True)
class Activation:
    """A function of `ACTIVATIONS`, applied to each number; it has the name used by torch."""

    name: str


@dataclass(frozen=True, eq=False)
class Lstm:
    """An LSTM cell whose n numbers last from step to step and are zero at an episode's start.

    weight (4 n, inputs + n) multiplies the input and the last answer; bias (4 n,). Both have the
    gates in the order in, forget, new, out.
    """

    weight: Floats
    bias: Floats

    @property
    def outputs(self) -> int:
        """How many numbers the layer keeps and gives."""
        return self.bias.size // 4


@dataclass(frozen=True, eq=False)
class Clipped:
    """min(max(x, low), high); low and high (n,), infinite where there is no bound."""

    low: Floats
    high: Floats

    @property
    def decimals(self) -> tuple[Doubles, Doubles]:
        """The bounds in short decimal form, (n,): 0.1 for the float32 number 0.100000001."""
        low, high = ([float(str(x)) for x in bound] for bound in (self.low, self.high))
        return np.array(low), np.array(high)


Layer = Standardised | OneHot | Affine | Elementwise | Relu | Tanh | Activation | Lstm | Clipped


@dataclass(frozen=True)
class Network:
    """Layers that are applied one after another to `inputs` numbers.

    `choices` are the sizes of groups of the last numbers. The answer is the index of the largest
    number in each group (the first, if equal). Without choices, the last numbers are the answer.
    """

    inputs: int
    layers: tuple[Layer, ...]
    choices: tuple[int, ...] = ()

    @property
    def outputs(self) -> int:
        """How many numbers the last layer gives."""
        sizes = [size for layer in self.layers if (size := _output_count(layer)) is not None]
        return sizes[-1] if sizes else self.inputs

    @property
    def answer_count(self) -> int:
        """How many numbers or indices the answer has."""
        return len(self.choices) or self.outputs

    @property
    def weight_count(self) -> int:
        """How many numbers the matrices have."""
        return sum(x.weight.size for x in self.layers if isinstance(x, (Affine, Lstm)))

    def choose_answer(self, last: Floats) -> list[float]:
        """The answer, made of the numbers of the last layer, (outputs,)."""
        if not self.choices:
            numbers: list[float] = last.tolist()
            return numbers
        ends = np.cumsum(self.choices)[:-1]
        return [int(group.argmax()) for group in np.split(last, ends)]


@dataclass(frozen=True)
class Policy:
    """What a file says of a policy.

    `facts`: what was read, as name and words. `assumed`: what is assumed as no file says it.
    `per_frame`: the layer that scales each frame before they are stacked. `box`: the least and the
    largest observation, (inputs,) each, where the file says finite ones. `keys`: of observations by
    name, the names in the order in which the network takes them, and how many numbers each has.
    `beside`: a file that was read though nobody named it. `shapes`: of observations that are a Box,
    by name, the axes of each; "" is the name of a single one. `acted`: the axes of an answer that
    is a Box or an array of ONNX, else ().
    """

    path: str
    network: Network
    facts: dict[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    per_frame: Standardised | None = None
    box: tuple[Doubles, Doubles] | None = None
    keys: tuple[tuple[str, int], ...] = ()
    beside: Path | None = None
    shapes: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    acted: tuple[int, ...] = ()


def _input_count(layer: Layer) -> int | None:
    """The number of inputs of a layer; None if any number is allowed."""
    if isinstance(layer, OneHot):
        return len(layer.sizes)
    if isinstance(layer, Lstm):
        return int(layer.weight.shape[1]) - layer.outputs
    arrays = [x for x in vars(layer).values() if isinstance(x, np.ndarray)]
    return int(arrays[0].shape[-1]) if arrays else None


def _output_count(layer: Layer) -> int | None:
    """The number of outputs of a layer; None if it equals the number of inputs."""
    if isinstance(layer, Affine):
        return int(layer.weight.shape[0])
    return layer.outputs if isinstance(layer, (OneHot, Lstm)) else _input_count(layer)


def numbers_text(count: int) -> str:
    """A count of numbers in words."""
    return f"{count} number{'s' * (count != 1)}"


def _problem_of_numbers(layer: Layer, arrays: list[Floats]) -> str:
    bounds = (layer.limit,) if isinstance(layer, Standardised) else ()
    finite = [a for a in arrays if all(a is not b for b in bounds)]
    if not all(np.isfinite(a).all() for a in finite) and not isinstance(layer, Clipped):
        return "holds a number that is not finite"
    if isinstance(layer, Standardised) and not (layer.deviation > 0.0).all():
        return "divides by a deviation that is not positive"
    if isinstance(layer, Elementwise) and layer.operation == "/" and (layer.operand == 0).any():
        return "divides by zero"
    if isinstance(layer, Clipped) and not (layer.low <= layer.high).all():
        return "clips to bounds that exclude each other"
    return ""


def network_problem(network: Network) -> str:
    """Why layers do not fit each other or have impossible numbers; "" if all is well."""
    size = network.inputs
    for number, layer in enumerate(network.layers, 1):
        arrays = [x for x in vars(layer).values() if isinstance(x, np.ndarray)]
        takes = _input_count(layer)
        if takes not in (None, size):
            return f"layer {number} takes {numbers_text(takes)}, and is given {size}"
        if wrong := _problem_of_numbers(layer, arrays):
            return f"layer {number} {wrong}"
        size = _output_count(layer) or size
    if network.choices and sum(network.choices) != size:
        chosen = f"{numbers_text(sum(network.choices))} to choose from"
        return f"its action space has {chosen}, its network {size}"
    return ""


# ---------------------------------------------------------------- in float32


def standardised_numbers(layer: Standardised, x: Doubles) -> Floats:
    """The observations, (..., n), after VecNormalize's scaling and clipping."""
    scaled = (x - layer.mean) / layer.deviation
    return np.clip(scaled, -layer.limit, layer.limit).astype(np.float32)


class ReadyNetwork(NamedTuple):
    """A network ready for use: the caller writes an observation, `run` gives the last layer."""

    observation: Floats
    """(inputs,), for the caller to write."""
    run: Callable[[], Floats]
    """Gives (outputs,), which the next call overwrites."""
    reset: Callable[[], None]
    """Begins an episode: zeros all memory."""


def prepare_network(network: Network) -> ReadyNetwork:
    """The network with its arrays allocated, to be run in float32."""
    steps: list[Callable[[], object]] = []
    memory: list[Floats] = []
    before = _zeros_and_one(network.inputs)
    observation = before[:-1]
    for layer in network.layers:
        if isinstance(
            layer, Affine
        ):  # the bias is the weight of a one that stands after the numbers
            after = _zeros_and_one(len(layer.bias))
            weight = np.hstack([layer.weight, layer.bias[:, None]])
            steps.append(partial(weight.dot, before, after[:-1]))
        elif isinstance(layer, Lstm):
            after = _zeros_and_one(layer.outputs)
            memory += [kept := np.zeros(layer.outputs, np.float32), after[:-1]]
            steps.append(partial(_step_lstm, layer, before[:-1], kept, after[:-1]))
        else:
            after = before if steps else _zeros_and_one(network.inputs)
            if isinstance(layer, OneHot):
                after = _zeros_and_one(layer.outputs)
            steps += _elementwise_steps(layer, before[:-1], after[:-1])
        before = after
    answer = before[:-1]

    def run() -> Floats:
        for step in steps:
            step()
        return answer

    def reset() -> None:
        for numbers in memory:
            numbers[:] = 0.0

    return ReadyNetwork(observation, run, reset)


def _zeros_and_one(size: int) -> Floats:
    return np.append(np.zeros(size, np.float32), np.float32(1.0))


def _elementwise_steps(layer: Layer, x: Floats, out: Floats) -> list[Callable[[], object]]:
    """The steps of a layer that makes each number of one number of its input."""
    if isinstance(layer, Tanh):
        return [partial(np.tanh, x, out=out)]
    if isinstance(layer, Relu):
        return [partial(np.maximum, x, np.zeros_like(x), out=out)]
    if isinstance(layer, Clipped):
        clipped = partial(np.minimum, out, layer.high, out=out)
        return [partial(np.maximum, x, layer.low, out=out), clipped]
    if isinstance(layer, Elementwise):
        return [partial(OPERATIONS[layer.operation], x, layer.operand, out=out)]
    if isinstance(layer, Activation):
        activation = ACTIVATIONS[layer.name]
        return [lambda: np.copyto(out, activation(x))]
    if isinstance(layer, OneHot):
        return [partial(_write_one_hot, layer.sizes, x, out)]
    assert isinstance(layer, Standardised)
    return [lambda: np.copyto(out, standardised_numbers(layer, x.astype(np.float64)))]


def _write_one_hot(sizes: Sequence[int], x: Floats, out: Floats) -> None:
    out[:] = 0.0
    at = 0
    for number, size in zip(x.tolist(), sizes, strict=True):
        if not size:
            out[at] = number
        elif number == int(number) and 0 <= number < size:
            out[at + int(number)] = 1.0
        else:
            msg = f"it reads {number:g} where the policy takes a whole number below {size}"
            raise ValueError(msg)
        at += size or 1


def _sigmoid(x: Floats) -> Floats:
    half = np.float32(0.5)
    made: Floats = half + half * np.tanh(half * x)
    return made


def _step_lstm(layer: Lstm, x: Floats, kept: Floats, out: Floats) -> None:
    """Does one step of an LSTM: overwrites its memory `kept`, (n,), and its answer `out`, (n,)."""
    gates = layer.weight @ np.concatenate([x, out]) + layer.bias
    enter, forget, new, leave = gates.reshape(4, -1)
    kept[:] = _sigmoid(forget) * kept + _sigmoid(enter) * np.tanh(new)
    out[:] = _sigmoid(leave) * np.tanh(kept)


def _softplus(x: Floats) -> Floats:
    made: Floats = np.logaddexp(np.float32(0.0), x)
    return made


def _elu(x: Floats) -> Floats:
    return np.where(x > 0, x, np.expm1(np.minimum(x, np.float32(0.0))))


def _gelu(x: Floats) -> Floats:
    erf = [math.erf(y / math.sqrt(2.0)) for y in x.tolist()]
    return (0.5 * x * (1.0 + np.array(erf))).astype(np.float32)


SELU_ALPHA, SELU_SCALE = np.float32(1.6732632423543772), np.float32(1.0507009873554805)
ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "ELU": _elu,
    "GELU": _gelu,
    "LeakyReLU": lambda x: np.where(x > 0, x, np.float32(0.01) * x),
    "Mish": lambda x: x * np.tanh(_softplus(x)),
    "ReLU6": lambda x: np.clip(x, 0.0, 6.0),
    "SELU": lambda x: SELU_SCALE * np.where(x > 0, x, SELU_ALPHA * _elu(x)),
    "SiLU": lambda x: x * _sigmoid(x),
    "Sigmoid": _sigmoid,
    "Softplus": _softplus,
    "Softsign": lambda x: x / (np.float32(1.0) + np.abs(x)),
}
"""The activations by torch's name, with torch's default parameters."""


def last_layer_numbers(network: Network, observation: Floats) -> Floats:
    """The last layer's numbers in float32, (outputs,), for one observation (inputs,)."""
    asked = prepare_network(network)
    asked.observation[:] = observation
    return asked.run()
