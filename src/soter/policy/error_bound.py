"""How far a network's float64 answer can be from its float32 one, whoever computes that.

Purpose: for observations in a box, a bound for each number that the last layer has: layer by layer
the rounding of float32 in *any* order of sums, fused or not, flushed to zero or not, and that of
float64 in the order that is written (docs/externs.md, "How far from float32").
Non-goals: what is not float32 (half precision, quantised weights); which action has the largest
number: it is the same where the two largest are further apart than both their bounds.

Both computations are compared with the exact one, of the weights as they stand in the file.
Bounds are computed in float64 and every layer's is enlarged by `SLACK`, far more than what its own
sums, all of numbers without sign, can have lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.policy.network import Affine, Clipped, Elementwise, Relu, Standardised, Tanh

if TYPE_CHECKING:
    from soter.policy.network import Doubles, Layer, Network

SINGLE, DOUBLE = 2.0**-24, 2.0**-53
"""Half a unit in the last place of 1."""
SINGLE_TINY, DOUBLE_TINY = 2.0**-126, 2.0**-1022
"""What an operation can lose below the normal numbers, where they are flushed to zero."""
SINGLE_LARGE = 2.0**127
TANH_SINGLE = 2.0**-21
"""Assumed of float32's tanh, absolute: onnxruntime's is within 2^-21.88, NumPy's within 2^-23.9."""
TANH_DOUBLE = 2.0**-51
"""Of the prelude's tanh, absolute: two units in the last place of numbers below 1."""
SLACK = 1.0 + 2.0**-30


@dataclass(frozen=True, eq=False)
class _Numbers:
    """Numbers of a layer: where the exact ones lie, and how far the two computed ones are."""

    low: Doubles
    high: Doubles
    single: Doubles
    double: Doubles

    @property
    def largest(self) -> Doubles:
        """The largest size of an exact number."""
        return np.maximum(np.abs(self.low), np.abs(self.high))


def error_bound(network: Network, low: Doubles, high: Doubles) -> Doubles:
    """|float64 - float32| at most, (outputs,); low, high: (inputs,), of what is observed.

    Infinite where numbers may be too large for float32. With low == high it is the bound of one
    observation. The float32 computation begins with the observation rounded to float32.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        x = _observed(low, high)
        for layer in network.layers:
            x = _passed(layer, x)
        bound = (x.single + x.double) * SLACK
    return np.where(np.isfinite(bound), bound, np.inf)


def _observed(low: Doubles, high: Doubles) -> _Numbers:
    largest = np.maximum(np.abs(low), np.abs(high))
    return _Numbers(low, high, _overflown(largest, SINGLE * largest + SINGLE_TINY), 0.0 * largest)


def _overflown(largest: Doubles, error: Doubles) -> Doubles:
    return np.where(largest + error < SINGLE_LARGE, error * SLACK, np.inf)


def _passed(layer: Layer, x: _Numbers) -> _Numbers:
    if isinstance(layer, Affine):
        return _affine(layer, x)
    if isinstance(layer, Tanh):
        return _tanh(x)
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
    return _standardised(layer, x) if isinstance(layer, Standardised) else _elementwise(layer, x)


def _gamma(roundings: int, unit: float) -> float:
    """What so many roundings can do to a product, relative to it."""
    return roundings * unit / (1.0 - roundings * unit)


def _affine(layer: Affine, x: _Numbers) -> _Numbers:
    weight, bias = layer.weight.astype(np.float64), layer.bias.astype(np.float64)
    sizes, count = np.abs(weight), layer.weight.shape[1] + 1
    positive, negative = np.maximum(weight, 0.0), np.minimum(weight, 0.0)
    low = positive @ x.low + negative @ x.high + bias
    high = positive @ x.high + negative @ x.low + bias
    error = []
    for before, unit, tiny in (
        (x.single, SINGLE, SINGLE_TINY),
        (x.double, DOUBLE, DOUBLE_TINY),
    ):
        summed = sizes @ (x.largest + before) + np.abs(bias)
        lost = _gamma(count, unit) * summed + 2.0 * count * tiny
        error.append((sizes @ before + lost) * SLACK)
    # the ends of the exact range, computed here, are widened by what their own sums can have lost
    own = _gamma(2 * count, DOUBLE) * (sizes @ x.largest + np.abs(bias)) + count * DOUBLE_TINY
    largest = sizes @ (x.largest + x.single) + np.abs(bias)
    return _Numbers(low - own, high + own, _overflown(largest, error[0]), error[1])


def _tanh(x: _Numbers) -> _Numbers:
    error = []
    for before, own in ((x.single, TANH_SINGLE), (x.double, TANH_DOUBLE)):
        nearest = np.maximum(np.maximum(x.low - before, -(x.high + before)), 0.0)
        steepest = 1.0 - np.tanh(nearest) ** 2 + TANH_DOUBLE
        error.append((np.minimum(steepest, 1.0) * before + own) * SLACK)
    low, high = np.tanh(x.low) - TANH_DOUBLE, np.tanh(x.high) + TANH_DOUBLE
    return _Numbers(low, high, error[0], error[1])


def _elementwise(layer: Elementwise, x: _Numbers) -> _Numbers:
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
    for before, unit, tiny in (
        (x.single, SINGLE, SINGLE_TINY),
        (x.double, DOUBLE, DOUBLE_TINY),
    ):
        size = np.abs(factor) * (x.largest + before) + np.abs(shift)
        error.append((np.abs(factor) * before + _gamma(1, unit) * size + tiny) * SLACK)
    own = 4.0 * DOUBLE * (np.abs(factor) * x.largest + np.abs(shift)) + DOUBLE_TINY
    size = np.abs(factor) * (x.largest + x.single) + np.abs(shift)
    return _Numbers(ends[0] - own, ends[1] + own, _overflown(size, error[0]), error[1])


def _standardised(layer: Standardised, x: _Numbers) -> _Numbers:
    """In float64 on both sides: the float32 one rounds what goes in and what comes out."""
    deviation, limit = layer.deviation, layer.limit
    error = []
    for before in (x.single, x.double):
        size = (x.largest + before + np.abs(layer.mean)) / deviation
        error.append(before / deviation + _gamma(2, DOUBLE) * size + DOUBLE_TINY)
    own = 4.0 * DOUBLE * (x.largest + np.abs(layer.mean)) / deviation + DOUBLE_TINY
    low = np.clip((x.low - layer.mean) / deviation - own, -limit, limit)
    high = np.clip((x.high - layer.mean) / deviation + own, -limit, limit)
    largest = np.maximum(np.abs(low), np.abs(high))
    single = error[0] + SINGLE * np.minimum(largest + error[0], limit) + SINGLE_TINY
    return _Numbers(low, high, single * SLACK, error[1] * SLACK)
