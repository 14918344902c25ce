"""A small network as Soter: constants and a function.

Purpose: a file that a program imports, so that what it answers is the same bits in interpreter and
C: float64, sums in the order in which they stand, weights exactly those of the file; bounds of
clips as people write them, so that what is clipped lies in a topic's set with the same bounds.
Non-goals: what float32 would have answered (`error_bound.py` says how far it can be).
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np

from soter.policy.network import Affine, Clipped, Elementwise, Relu, Standardised
from soter.policy.policy_errors import bad_policy

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt

    from soter.policy.network import Layer, Policy

WEIGHTS_MAX = 50_000
"""Weights of a network that is written: a step does two operations for each."""
COLUMNS = 96


def soter_source(policy: Policy, notes: Sequence[str]) -> str:
    """The text; `notes`: lines of its comment. SoterError X014 where it cannot be written.

    `fun act(x: float[inputs]): float[outputs]`, or of a choice its index as an `int in [0, n-1]`.
    """
    network = policy.network
    if network.weights > WEIGHTS_MAX:
        why = f"it has {network.weights:,} weights: up to {WEIGHTS_MAX:,} are written as tables"
        raise bad_policy(policy.path, why, "ask it in its own process: `extern` in the program")
    if policy.per_frame is not None:
        why = "it normalises frames before it stacks them, which is not written as a function"
        raise bad_policy(policy.path, why)
    constants: list[str] = []
    steps: list[str] = []
    size, at = network.inputs, "x"
    for number, layer in enumerate(network.layers, 1):
        made, body = _layer(layer, number, size, at)
        constants += made
        steps += body
        at = f"h{number}"
        size = layer.weight.shape[0] if isinstance(layer, Affine) else size
    result = f"int in [0, {size - 1}]" if network.choice else f"float[{size}]"
    lines = [
        *("// " + note if note else "//" for note in notes),
        "soter 1;",
        "",
        *constants,
        "",
        f"fun act(x: float[{network.inputs}]): {result} {{",
        *steps,
        *(_chosen(at, size) if network.choice else [f"  return {at};"]),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _chosen(at: str, size: int) -> Iterator[str]:
    yield f"  var best: int in [0, {size - 1}] = 0;"
    yield f"  for i in 1 .. {size} {{ if {at}[i] > {at}[best] {{ best = i; }} }}"
    yield "  return best;"


def _layer(layer: Layer, number: int, size: int, at: str) -> tuple[list[str], list[str]]:
    """Constants and statements: `h{number}` is made of `at`, which has `size` numbers."""
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
        names = (f"{letter}_MEAN", f"{letter}_DEVIATION")
        constants = [*_table(names[0], layer.mean), *_table(names[1], layer.deviation)]
        limit = _number(layer.limit)
        told = f"min(max(({at}[i] - {names[0]}[i]) / {names[1]}[i], -{limit}), {limit})"
    elif isinstance(layer, Elementwise):
        constants = _table(f"{letter}_OPERAND", layer.operand)
        told = f"{at}[i] {layer.operation} {letter}_OPERAND[i]"
    elif isinstance(layer, Clipped):
        low, high = (_finite(a) for a in layer.decimals)
        constants = [*_table(f"{letter}_LOW", low), *_table(f"{letter}_HIGH", high)]
        told = f"min(max({at}[i], {letter}_LOW[i]), {letter}_HIGH[i])"
    else:
        constants = []
        told = f"max({at}[i], 0.0)" if isinstance(layer, Relu) else f"tanh({at}[i])"
    return constants, [
        f"  var {here}: float[{size}] = {at};",
        f"  for i in 0 .. {size} {{ {here}[i] = {told}; }}",
    ]


def _finite(array: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Bounds that are none as the largest float64: no sum that is finite is beyond it."""
    return np.nan_to_num(array, posinf=sys.float_info.max, neginf=-sys.float_info.max)


def _number(value: float) -> str:
    """A float64 to the last bit, as the language writes it."""
    text = repr(float(value))
    return text if any(c in text for c in ".e") else f"{text}.0"


def _table(name: str, array: npt.NDArray[np.float32] | npt.NDArray[np.float64]) -> list[str]:
    """A constant: numbers of a vector, or rows of a matrix."""
    kind = "".join(f"[{n}]" for n in reversed(array.shape))
    if array.ndim == 1:
        return [f"const {name}: float{kind} = [", *_wrapped(map(_number, array.tolist())), "];"]
    lines = [f"const {name}: float{kind} = ["]
    for row in array.tolist():
        lines += ["  [", *("  " + line for line in _wrapped(map(_number, row))), "  ],"]
    return [*lines, "];"]


def _wrapped(words: Iterable[str]) -> Iterator[str]:
    line = " "
    for word in words:
        if len(line) + len(word) + 2 > COLUMNS:
            yield line
            line = " "
        line += f" {word},"
    yield line
