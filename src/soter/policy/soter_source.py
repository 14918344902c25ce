"""Writes a small network as Soter; bounds how far its float64 answer is from the float32 one.

Purpose: `soter_source` writes a file that a program imports, with constants and a function whose
answer is the same bits in interpreter and C: float64, sums in the order in which they stand,
weights exactly those of the file; bounds of clips as people write them, so that what is clipped
lies in a topic's set with the same bounds. `error_bound` gives, for observations in a box, a bound
for each number of the last layer: layer by layer the rounding of float32 in *any* order of sums,
fused or not, flushed to zero or not, and that of float64 in the order that is written
(docs/externs.md, "How far from float32").
Non-goals: what float32 would have answered; what is not float32 (half precision, quantised
weights); which action has the largest number: it is the same where the two largest are further
apart than both their bounds.

Both computations are compared with the exact one, of the weights as they stand in the file.
Bounds are computed in float64 and every layer's is enlarged by `SLACK`, far more than what its own
sums, all of non-negative numbers, can have lost.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.policy.network import (
    Activation,
    Affine,
    Clipped,
    Elementwise,
    Lstm,
    OneHot,
    Relu,
    Standardised,
    Tanh,
)
from soter.policy.policy_errors import bad_policy_error

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt

    from soter.policy.network import Doubles, Layer, Network, Policy


SINGLE, DOUBLE = 2.0**-24, 2.0**-53
"""Half a unit in the last place of 1."""
SINGLE_TINY, DOUBLE_TINY = 2.0**-126, 2.0**-1022
"""What an operation can lose where results below the normal numbers are flushed to zero."""
SINGLE_LARGE = 2.0**127
TANH_SINGLE = 2.0**-21
"""Assumed of float32's tanh, absolute: onnxruntime's is within 2^-21.88, NumPy's within 2^-23.9."""
TANH_DOUBLE = 2.0**-51
"""The absolute error of the prelude's tanh: two units in the last place of numbers below 1."""
SLACK = 1.0 + 2.0**-30


@dataclass(frozen=True, eq=False)
class _Numbers:
    """Bounds of a layer's exact numbers, and the errors of float32 (`single`) and of float64."""

    low: Doubles
    high: Doubles
    single: Doubles
    double: Doubles

    @property
    def largest(self) -> Doubles:
        """The largest magnitude of each exact number."""
        return np.maximum(np.abs(self.low), np.abs(self.high))


def error_bound(network: Network, low: Doubles, high: Doubles) -> Doubles:
    """A bound of |float64 - float32|, (outputs,), for observations in [low, high], (inputs,).

    The bound is infinite if numbers may be too large for float32, or if a layer cannot be written
    in Soter (`unwritable_part`). With low == high, it is the bound for one observation. The float32
    computation begins with the observation rounded to float32.
    """
    if unwritable_part(network):
        return np.full(network.outputs, np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        x = _observation_error(low, high)
        for layer in network.layers:
            x = _layer_error(layer, x)
        bound = (x.single + x.double) * SLACK
    return np.where(np.isfinite(bound), bound, np.inf)


def _observation_error(low: Doubles, high: Doubles) -> _Numbers:
    largest = np.maximum(np.abs(low), np.abs(high))
    return _Numbers(low, high, _bound(largest, SINGLE * largest + SINGLE_TINY), 0.0 * largest)


def _bound(largest: Doubles, error: Doubles) -> Doubles:
    """The error with slack, infinite where a number may be too large for float32."""
    return np.where(largest + error < SINGLE_LARGE, error * SLACK, np.inf)


def _layer_error(layer: Layer, x: _Numbers) -> _Numbers:
    if isinstance(layer, Affine):
        return _affine_error(layer, x)
    if isinstance(layer, Tanh):
        return _tanh_error(x)
    if isinstance(layer, Relu):
        return _Numbers(np.maximum(x.low, 0.0), np.maximum(x.high, 0.0), x.single, x.double)
    if isinstance(layer, Clipped):
        low, high = layer.low.astype(np.float64), layer.high.astype(np.float64)
        ends = np.clip(x.low, low, high), np.clip(x.high, low, high)
        finite = np.isfinite(low), np.isfinite(high)
        moved = [
            np.where(f, np.abs(a - b), 0.0)
            for f, a, b in zip(finite, layer.decimals, (low, high), strict=True)
        ]
        return _Numbers(ends[0], ends[1], x.single, x.double + np.maximum(*moved))
    if isinstance(layer, Standardised):
        return _standardised_error(layer, x)
    assert isinstance(layer, Elementwise)  # others are not written (`unwritable_part`)
    return _elementwise_error(layer, x)


def _round_off(roundings: int, unit: float) -> float:
    """The largest relative error of a product after this many roundings."""
    return roundings * unit / (1.0 - roundings * unit)


def _affine_error(layer: Affine, x: _Numbers) -> _Numbers:
    weight, bias = layer.weight.astype(np.float64), layer.bias.astype(np.float64)
    sizes, count = np.abs(weight), layer.weight.shape[1] + 1
    positive, negative = np.maximum(weight, 0.0), np.minimum(weight, 0.0)
    low = positive @ x.low + negative @ x.high + bias
    high = positive @ x.high + negative @ x.low + bias
    error = []
    for before, unit, tiny in ((x.single, SINGLE, SINGLE_TINY), (x.double, DOUBLE, DOUBLE_TINY)):
        summed = sizes @ (x.largest + before) + np.abs(bias)
        lost = _round_off(count, unit) * summed + 2.0 * count * tiny
        error.append((sizes @ before + lost) * SLACK)
    # the ends of the exact range, computed here, are widened by what their own sums can have lost
    rounding = (
        _round_off(2 * count, DOUBLE) * (sizes @ x.largest + np.abs(bias)) + count * DOUBLE_TINY
    )
    largest = sizes @ (x.largest + x.single) + np.abs(bias)
    return _Numbers(low - rounding, high + rounding, _bound(largest, error[0]), error[1])


def _tanh_error(x: _Numbers) -> _Numbers:
    error = []
    for before, rounding in ((x.single, TANH_SINGLE), (x.double, TANH_DOUBLE)):
        nearest = np.maximum(np.maximum(x.low - before, -(x.high + before)), 0.0)
        steepest = 1.0 - np.tanh(nearest) ** 2 + TANH_DOUBLE
        error.append((np.minimum(steepest, 1.0) * before + rounding) * SLACK)
    low, high = np.tanh(x.low) - TANH_DOUBLE, np.tanh(x.high) + TANH_DOUBLE
    return _Numbers(low, high, error[0], error[1])


def _elementwise_error(layer: Elementwise, x: _Numbers) -> _Numbers:
    operand = layer.operand.astype(np.float64)
    if layer.operation in "+-":
        shift = operand if layer.operation == "+" else -operand
        ends, factor = (x.low + shift, x.high + shift), np.ones_like(operand)
    else:
        factor = operand if layer.operation == "*" else 1.0 / operand
        ends = (
            np.minimum(x.low * factor, x.high * factor),
            np.maximum(x.low * factor, x.high * factor),
        )
        shift = np.zeros_like(operand)
    error = []
    for before, unit, tiny in ((x.single, SINGLE, SINGLE_TINY), (x.double, DOUBLE, DOUBLE_TINY)):
        size = np.abs(factor) * (x.largest + before) + np.abs(shift)
        error.append((np.abs(factor) * before + _round_off(1, unit) * size + tiny) * SLACK)
    rounding = 4.0 * DOUBLE * (np.abs(factor) * x.largest + np.abs(shift)) + DOUBLE_TINY
    size = np.abs(factor) * (x.largest + x.single) + np.abs(shift)
    return _Numbers(ends[0] - rounding, ends[1] + rounding, _bound(size, error[0]), error[1])


def _standardised_error(layer: Standardised, x: _Numbers) -> _Numbers:
    """The errors of a layer that both compute in float64; one begins and ends in float32."""
    deviation, limit = layer.deviation, layer.limit
    error = []
    for before in (x.single, x.double):
        size = (x.largest + before + np.abs(layer.mean)) / deviation
        error.append(before / deviation + _round_off(2, DOUBLE) * size + DOUBLE_TINY)
    rounding = 4.0 * DOUBLE * (x.largest + np.abs(layer.mean)) / deviation + DOUBLE_TINY
    low = np.clip((x.low - layer.mean) / deviation - rounding, -limit, limit)
    high = np.clip((x.high - layer.mean) / deviation + rounding, -limit, limit)
    largest = np.maximum(np.abs(low), np.abs(high))
    single = error[0] + SINGLE * np.minimum(largest + error[0], limit) + SINGLE_TINY
    return _Numbers(low, high, single * SLACK, error[1] * SLACK)


WEIGHTS_MAX = 50_000
"""Weights of a network that is written, at most: a step does two operations for each."""
COLUMNS = 96


def unwritable_part(network: Network) -> str:
    """The part of a network that cannot be written in Soter, in words; "" if it all can."""
    if any(isinstance(layer, Lstm) for layer in network.layers):
        return "memory (an LSTM)"
    if names := [layer.name for layer in network.layers if isinstance(layer, Activation)]:
        return f"the activation {names[0]}"
    if any(isinstance(layer, OneHot) for layer in network.layers):
        return "observations of which each is one out of several"
    return "more than one choice" if len(network.choices) > 1 else ""


def soter_source(policy: Policy, notes: Sequence[str]) -> str:
    """The policy in Soter, with comment lines `notes`; raises X014 if it cannot be written.

    It has `fun act(x: float[inputs]): float[outputs]`; a choice gives an `int in [0, n-1]`.
    """
    network = policy.network
    ask = "ask it in its own process: `extern` in the program"
    if unwritten := unwritable_part(network):
        raise bad_policy_error(policy.path, f"it has {unwritten}, not written as a function", ask)
    if network.weight_count > WEIGHTS_MAX:
        why = (
            f"it has {network.weight_count:,} weights: up to {WEIGHTS_MAX:,} are written as tables"
        )
        raise bad_policy_error(policy.path, why, ask)
    if policy.per_frame is not None:
        why = "it normalises frames before it stacks them, which is not written as a function"
        raise bad_policy_error(policy.path, why)
    constants: list[str] = []
    steps: list[str] = []
    size, at = network.inputs, "x"
    for number, layer in enumerate(network.layers, 1):
        made, body = _layer_code(layer, number, size, at)
        constants += made
        steps += body
        at = f"h{number}"
        size = layer.weight.shape[0] if isinstance(layer, Affine) else size
    result = f"int in [0, {size - 1}]" if network.choices else f"float[{size}]"
    lines = [
        *("// " + note if note else "//" for note in notes),
        "soter 1;",
        "",
        *constants,
        "",
        f"fun act(x: float[{network.inputs}]): {result} {{",
        *steps,
        *(_choice_code(at, size) if network.choices else [f"  return {at};"]),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _choice_code(at: str, size: int) -> Iterator[str]:
    yield f"  var best: int in [0, {size - 1}] = 0;"
    yield f"  for i in 1 .. {size} {{ if {at}[i] > {at}[best] {{ best = i; }} }}"
    yield "  return best;"


def _layer_code(layer: Layer, number: int, size: int, at: str) -> tuple[list[str], list[str]]:
    """Constants and statements that compute `h{number}` from `at`, which has `size` numbers."""
    here, letter = f"h{number}", f"L{number}"
    if isinstance(layer, Affine):
        rows = layer.weight.shape[0]
        constants = [
            *_table(f"{letter}_WEIGHT", layer.weight),
            *_table(f"{letter}_BIAS", layer.bias),
        ]
        return constants, [
            f"  var {here}: float[{rows}] = {letter}_BIAS;",
            f"  for i in 0 .. {rows} {{",
            f"    var sum = {letter}_BIAS[i];",
            f"    for j in 0 .. {size} {{ sum = sum + {letter}_WEIGHT[i][j] * {at}[j]; }}",
            f"    {here}[i] = sum;",
            "  }",
        ]
    if isinstance(layer, Standardised):
        names = (f"{letter}_MEAN", f"{letter}_DEVIATION", f"{letter}_LIMIT")
        parts = (layer.mean, layer.deviation, _finite_bounds(layer.limit))
        constants = [line for n, part in zip(names, parts, strict=True) for line in _table(n, part)]
        limit = f"{names[2]}[i]"
        value = f"min(max(({at}[i] - {names[0]}[i]) / {names[1]}[i], -{limit}), {limit})"
    elif isinstance(layer, Elementwise):
        constants = _table(f"{letter}_OPERAND", layer.operand)
        value = f"{at}[i] {layer.operation} {letter}_OPERAND[i]"
    elif isinstance(layer, Clipped):
        low, high = (_finite_bounds(a) for a in layer.decimals)
        constants = [*_table(f"{letter}_LOW", low), *_table(f"{letter}_HIGH", high)]
        value = f"min(max({at}[i], {letter}_LOW[i]), {letter}_HIGH[i])"
    else:
        constants = []
        value = f"max({at}[i], 0.0)" if isinstance(layer, Relu) else f"tanh({at}[i])"
    return constants, [
        f"  var {here}: float[{size}] = {at};",
        f"  for i in 0 .. {size} {{ {here}[i] = {value}; }}",
    ]


def _finite_bounds(array: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The array with its infinite bounds replaced by the largest float64."""
    return np.nan_to_num(array, posinf=sys.float_info.max, neginf=-sys.float_info.max)


def _soter_number(value: float) -> str:
    """A float64 as the language writes it, exact to the last bit."""
    text = repr(float(value))
    return text if any(c in text for c in ".e") else f"{text}.0"


def _table(name: str, array: npt.NDArray[np.float32] | npt.NDArray[np.float64]) -> list[str]:
    """The lines of a constant vector or matrix."""
    kind = "".join(f"[{n}]" for n in reversed(array.shape))
    if array.ndim == 1:
        return [
            f"const {name}: float{kind} = [",
            *_wrapped_lines(map(_soter_number, array.tolist())),
            "];",
        ]
    lines = [f"const {name}: float{kind} = ["]
    for row in array.tolist():
        lines += ["  [", *("  " + line for line in _wrapped_lines(map(_soter_number, row))), "  ],"]
    return [*lines, "];"]


def _wrapped_lines(words: Iterable[str]) -> Iterator[str]:
    line = " "
    for word in words:
        if len(line) + len(word) + 2 > COLUMNS:
            yield line
            line = " "
        line += f" {word},"
    yield line
