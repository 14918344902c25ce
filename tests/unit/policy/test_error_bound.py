"""No float32 computation, in whatever order of sums, is further from float64 than is said."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from policy_files import FILES, random_layers  # type: ignore[import-not-found]

from soter.policy.network import (
    Affine,
    Clipped,
    Elementwise,
    Network,
    Relu,
    Standardised,
    Tanh,
    last_layer_numbers,
)
from soter.policy.sb3_file import read_sb3
from soter.policy.soter_source import error_bound
from tables import all_rows

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.policy.network import Layer

    Floats = npt.NDArray[np.float32]


def in_any_order(network: Network, x: Floats, rng: np.random.Generator) -> Floats:
    """The network in float32, each sum in an order of its own, bias somewhere in it."""
    for layer in network.layers:
        if not isinstance(layer, Affine):
            x = last_layer_numbers(Network(x.size, (layer,)), x)
            continue
        rows = []
        for row, bias in zip(layer.weight, layer.bias, strict=True):
            parts = rng.permutation(np.append(row * x, bias))
            total = np.float32(0.0)
            for part in parts:
                total = np.float32(total + part)
            rows.append(total)
        x = np.array(rows, np.float32)
    return x


def in_declared_order(network: Network, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The network in float64, as the function that is written does it."""
    for layer in network.layers:
        if isinstance(layer, Affine):
            sums = layer.bias.astype(np.float64)
            for j in range(x.size):
                sums = sums + layer.weight[:, j].astype(np.float64) * x[j]
            x = sums
        elif isinstance(layer, Standardised):
            scaled = (x - layer.mean) / layer.deviation
            x = np.clip(scaled, -layer.limit, layer.limit)
        elif isinstance(layer, Elementwise):
            x = {
                "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide
            }[layer.operation](x, layer.operand.astype(np.float64))  # fmt: skip
        elif isinstance(layer, Clipped):
            x = np.clip(x, *layer.decimals)
        else:
            x = np.maximum(x, 0.0) if isinstance(layer, Relu) else np.tanh(x)
    return x


def network_of(seed: int) -> Network:
    """Layers of every kind, of random sizes."""
    rng = np.random.default_rng(seed)
    sizes = [int(n) for n in rng.integers(1, 40, 4)]
    layers: list[Layer] = []
    if seed % 3 == 0:
        mean, deviation = rng.normal(size=sizes[0]), rng.uniform(0.1, 3.0, sizes[0])
        layers.append(Standardised(mean, deviation, np.full_like(mean, 2.0)))
    for weight, bias in random_layers(seed, *sizes):
        layers += [Affine(weight * np.float32(rng.uniform(0.2, 6.0)), bias)]
        layers.append((Tanh(), Relu())[int(rng.integers(2))])
        operand = rng.uniform(0.5, 2.0, len(bias)).astype(np.float32)
        layers.append(Elementwise("+-*/"[int(rng.integers(4))], operand))  # type: ignore[arg-type]
    bounds = np.full(sizes[-1], 2.3, np.float32)
    return Network(sizes[0], (*layers, Clipped(-bounds, bounds)))


@all_rows("seed", range(40))
def test_the_bound_holds_for_any_order_of_sums(seed: int) -> None:
    network, rng = network_of(seed), np.random.default_rng(seed)
    low = np.full(network.inputs, -5.0)
    over_box = error_bound(network, low, -low)
    for _ in range(10):
        x = rng.uniform(low, -low)
        distance = np.abs(
            in_any_order(network, x.astype(np.float32), rng) - in_declared_order(network, x)
        )
        here = error_bound(network, x, x)
        assert (distance <= here).all()
        assert (here <= over_box).all()


def test_the_bound_of_one_sum_is_what_can_happen() -> None:
    """Halves of a unit that are all lost in float32: the bound is near, not just far above."""
    count = 1000
    weight = np.full((1, count), 1.0 + 2.0**-23, np.float32)
    network = Network(count, (Affine(weight, np.ones(1, np.float32)),))
    x = np.full(count, 1.0)
    exact = count * Fraction(1.0 + 2.0**-23) + 1
    single = np.float32(1.0)
    for part in weight[0] * x.astype(np.float32):
        single = np.float32(single + part)
    bound = float(error_bound(network, x, x)[0])
    distance = abs(float(Fraction(float(single)) - exact))
    assert distance <= bound
    assert bound < 2.0 * count * 2.0**-24 * float(exact)


def test_observations_too_large_for_float32_have_no_bound() -> None:
    network = Network(1, (Affine(np.ones((1, 1), np.float32), np.zeros(1, np.float32)),))
    assert error_bound(network, np.array([0.0]), np.array([1e39])).tolist() == [math.inf]
    assert np.isfinite(error_bound(network, np.array([0.0]), np.array([1e37]))).all()


def test_what_float32_tanh_is_assumed_to_do_numpy_does() -> None:
    bits = np.arange(0, 0x7F800000, 4099, dtype=np.uint32)
    x = bits.view(np.float32)
    assert np.abs(np.tanh(x).astype(np.float64) - np.tanh(x.astype(np.float64))).max() < 2.0**-21


def test_what_float32_tanh_is_assumed_to_do_onnxruntime_does() -> None:
    runtime = pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")
    helper = pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]").helper
    values = [helper.make_tensor_value_info(n, 1, [None]) for n in "xy"]
    graph = helper.make_graph([helper.make_node("Tanh", ["x"], ["y"])], "t", *[[v] for v in values])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    session = runtime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    x = np.arange(0, 0x7F800000, 4099, dtype=np.uint32).view(np.float32)
    (y,) = session.run(None, {"x": x})
    assert np.abs(y.astype(np.float64) - np.tanh(x.astype(np.float64))).max() < 2.0**-21


@pytest.mark.parametrize("name", ["ppo.zip", "sac.zip", "td3.zip", "dqn.zip", "a2c_of_frames.zip"])
def test_policies_of_stable_baselines_are_within_their_bound(name: str) -> None:
    policy = read_sb3(FILES / name)
    assert policy.box is not None
    rng, network = np.random.default_rng(1), policy.network
    over_box = error_bound(network, *policy.box)
    assert over_box.max() < 1e-3
    for _ in range(200):
        x = rng.uniform(*policy.box)
        distance = np.abs(
            last_layer_numbers(network, x.astype(np.float32)) - in_declared_order(network, x)
        )
        assert (distance <= error_bound(network, x, x)).all()
        assert (distance <= over_box).all()
