"""Trains the network that balance.soter has for its SC, and writes it as ONNX.

    python examples/evidence/train_balance.py balance.onnx
    soter policy balance.onnx --within 1,8 -o examples/evidence/balance_net.soter

Purpose: layers of 2, 16, 16 and 1 numbers with ReLU between them, fitted to a clamped linear law by
Adam; the worst error and its root mean square are printed. Needs numpy and onnx.
Non-goals: a proof: `soter verify` follows the network that was written, whatever it was fitted to.
"""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIZES, STEPS, BATCH, RATE = (2, 16, 16, 1), 20_000, 512, 3e-3
RANGE = np.array([0.6, 2.0])  # rad and rad/s in which it is fitted


def law(x: np.ndarray) -> np.ndarray:
    """The torque (N m) for rows of angle and rate."""
    return np.clip(-12.0 * x[:, :1] - 3.0 * x[:, 1:], -2.0, 2.0)


def answers(x: np.ndarray, layers: list[np.ndarray]) -> list[np.ndarray]:
    """What each layer gives for rows of `x`, after its ReLU but for the last."""
    found = [x / RANGE]
    for k in range(3):
        y = found[-1] @ layers[k] + layers[3 + k]
        found.append(np.maximum(y, 0.0) if k < 2 else y)
    return found


def trained() -> list[np.ndarray]:
    """Three matrices and three biases."""
    draw = np.random.default_rng(1)
    layers = [draw.normal(0.0, (2.0 / a) ** 0.5, (a, b)) for a, b in pairwise(SIZES)]
    layers += [draw.normal(0.0, 0.3, SIZES[1]), np.zeros(SIZES[2]), np.zeros(SIZES[3])]
    mean, square = [0.0 * p for p in layers], [0.0 * p for p in layers]
    for n in range(STEPS):
        x = draw.uniform(-1.0, 1.0, (BATCH, 2)) * RANGE
        found = answers(x, layers)
        off = 2.0 * (found[3] - law(x)) / BATCH
        slopes = [np.zeros(0)] * 6
        for k in (2, 1, 0):
            slopes[k], slopes[3 + k] = found[k].T @ off, off.sum(0)
            off = (off @ layers[k].T) * (found[k] > 0.0)
        rate = RATE * 0.5 * (1.0 + np.cos(np.pi * n / STEPS))
        for k, slope in enumerate(slopes):
            mean[k] = 0.9 * mean[k] + 0.1 * slope
            square[k] = 0.999 * square[k] + 0.001 * slope**2
            unbiased = mean[k] / (1.0 - 0.9 ** (n + 1)), square[k] / (1.0 - 0.999 ** (n + 1))
            layers[k] = layers[k] - rate * unbiased[0] / (np.sqrt(unbiased[1]) + 1e-8)
    return layers


def write_onnx(layers: list[np.ndarray], name: str) -> None:
    """Writes the layers as ONNX; the range of the observations is part of the first."""
    layers = [layers[0] / RANGE[:, None], *layers[1:]]
    names = ["w0", "w1", "w2", "b0", "b1", "b2"]
    named = zip(names, layers, strict=True)
    tensors = [numpy_helper.from_array(p.astype(np.float32), n) for n, p in named]
    nodes, value = [], "obs"
    for k in range(3):
        out = "act" if k == 2 else f"a{k}"
        nodes.append(helper.make_node("Gemm", [value, f"w{k}", f"b{k}"], [out]))
        value = f"h{k}"
        if k < 2:
            nodes.append(helper.make_node("Relu", [out], [value]))
    ends = [
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, size])]
        for n, size in (("obs", 2), ("act", 1))
    ]
    graph = helper.make_graph(nodes, "balance", ends[0], ends[1], tensors)
    onnx.save(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), name
    )


if __name__ == "__main__":
    fitted = trained()
    asked = np.random.default_rng(2).uniform(-1.0, 1.0, (20_000, 2)) * RANGE
    error = np.abs(answers(asked, fitted)[3] - law(asked))
    print(f"worst {error.max():.3g} N m, root mean square {np.sqrt((error**2).mean()):.3g} N m")
    write_onnx(fitted, sys.argv[1])
