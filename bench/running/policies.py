"""What a learned policy costs as a node, beside onnxruntime, and how far the exported C is from it.

    python bench/running/policies.py [-n 100000] [--json FILE]

Purpose: five policies, two ONNX files and three of Stable-Baselines3; of the latter onnxruntime is
given the same network as ONNX. In us an observation, the quickest of 500 parts: onnxruntime's own
`session.run`, the node in the process of the engine and in one of its own, on another core (beside
a constant's way there and back and the node's time: `ratio`), and the function in C
that `soter policy -o` writes. Then the largest distance of that C's answers from onnxruntime's
float32 ones over all observations, and the bound that is computed for the box that they are drawn
from. Of a choice (DQN) the indices are compared, as C has no more; `close` counts observations
whose two largest numbers are nearer than twice the bound.
Non-goals: large networks; how good the policies are; steps that wait for a processor.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

import soter
from soter.diagnostics.source import Source
from soter.diagnostics.span import Span
from soter.language.model.binding_text import BindingText
from soter.language.model.types import FloatType, IntType
from soter.policy.error_bound import error_bound
from soter.policy.network import Affine, Clipped, Elementwise, Network, Policy, Relu, Tanh
from soter.policy.onnx_graph import read_onnx
from soter.policy.sb3_file import read_sb3
from soter.policy.soter_source import soter_source
from soter.simulate.externs.isolated_extern import ProcessExtern
from soter.simulate.externs.policy_extern import load_policy
from soter.simulate.interrupt import StopRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[2]
FILES = ROOT / "tests" / "unit" / "policy" / "files"
PARTS = 500
"""Parts that are timed: the quickest says what is done, the others who else was at it."""
CORES = sorted(os.sched_getaffinity(0))
REPEATS = 7
"""Runs that are timed with and without the function, in turn."""
OPERATORS = {"+": "Add", "-": "Sub", "*": "Mul", "/": "Div"}
PROGRAM = """soter 1;
import "net.soter" as net;
topic obs: float[{n}];
topic out: {result};
plant World period 10ms {{
  drives obs = o;
  state o: float[{n}] = [{zeros}];
{draws}
  next o = [{drawn}];
}}
node Asked period 10ms {{
  subscribes obs; publishes out;
  step {{ publish out = net.act(obs); }}
}}
node Idle period 10ms {{ subscribes obs; publishes out; step {{ publish out = {nothing}; }} }}
system With default {{ w: World; node Asked; until {until}ms; }}
system Without {{ w: World; node Idle; until {until}ms; }}
"""


@dataclass
class Subject:
    """A policy: its file as a node names it, and the box that observations are drawn from."""

    name: str
    binding: BindingText
    policy: Policy
    size: float


def subjects(folder: Path) -> list[Subject]:
    """The five."""
    made = []
    for name, sizes, layer in (
        ("onnx, tanh 64 64", (4, 64, 64, 2), Tanh()),
        ("onnx, relu 128 128", (6, 128, 128, 1), Relu()),
    ):
        rng = np.random.default_rng(len(name))
        layers: list[Any] = []
        for before, after in pairwise(sizes):
            weight = (rng.normal(size=(after, before)) / np.sqrt(before)).astype(np.float32)
            bias = (0.1 * rng.normal(size=after)).astype(np.float32)
            layers += [*([layer] if layers else []), Affine(weight, bias)]
        path = folder / f"{sizes[1]}.onnx"
        path.write_bytes(as_onnx(Network(sizes[0], tuple(layers))))
        made.append(Subject(name, BindingText("onnx", str(path), ""), read_onnx(path), 5.0))
    for name, path, size in (
        ("sb3 PPO, relu 8 8", FILES / "ppo.zip", 1.2),
        ("sb3 SAC, relu 16 16", ROOT / "examples" / "wall" / "rush.zip", 12.0),
        ("sb3 DQN, relu 8 8", FILES / "dqn.zip", 5.0),
    ):
        made.append(Subject(name, BindingText("sb3", str(path), ""), read_sb3(path), size))
    return made


def as_onnx(network: Network) -> bytes:
    """The network as an ONNX file; of a choice its numbers."""
    at, nodes, constants, size = "obs", [], [], network.inputs

    def constant(name: str, array: npt.NDArray[Any]) -> str:
        constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    for k, layer in enumerate(network.layers):
        if isinstance(layer, Affine):
            more = [constant(f"W{k}", layer.weight), constant(f"B{k}", layer.bias)]
            nodes.append(helper.make_node("Gemm", [at, *more], [f"h{k}"], transB=1))
            size = len(layer.bias)
        elif isinstance(layer, Elementwise):
            more = [constant(f"C{k}", layer.operand)]
            nodes.append(helper.make_node(OPERATORS[layer.operation], [at, *more], [f"h{k}"]))
        elif isinstance(layer, Clipped):
            assert np.ptp(layer.low) == np.ptp(layer.high) == 0.0
            ends = (layer.low[0], layer.high[0])
            more = [
                constant(f"{n}{k}", np.array(v)) for n, v in zip(("lo", "hi"), ends, strict=True)
            ]
            nodes.append(helper.make_node("Clip", [at, *more], [f"h{k}"]))
        else:
            nodes.append(
                helper.make_node("Tanh" if isinstance(layer, Tanh) else "Relu", [at], [f"h{k}"])
            )
        at = f"h{k}"
    values = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, n])
        for name, n in (("obs", network.inputs), (at, size))
    ]
    graph = helper.make_graph(nodes, "policy", values[:1], values[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    data: bytes = model.SerializeToString()
    return data


# ---------------------------------------------------------------- times


def quickest_us(
    ways: dict[str, tuple[Callable[[Any], object], Callable[[Any], list[Any]]]],
    seen: npt.NDArray[np.float64],
) -> dict[str, float]:
    """Times in us a call of each way: the quickest of `PARTS` parts, those of all ways in turn.

    A way is what is called, and what makes its arguments of the observations of a part.
    """
    best = dict.fromkeys(ways, float("inf"))
    for part in np.array_split(seen, PARTS):
        for name, (step, made_of) in ways.items():
            given = made_of(part)
            begin = time.perf_counter()
            for x in given:
                step(x)
            best[name] = min(best[name], (time.perf_counter() - begin) / len(given) * 1e6)
    return best


def asked(subject: Subject, seen: npt.NDArray[np.float64]) -> dict[str, float]:
    """Times of onnxruntime, the node here, in a process of its own, and of a constant there."""
    network = subject.policy.network
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        as_onnx(network), options, providers=["CPUExecutionProvider"]
    )
    names = [f"x{i}" for i in range(network.inputs)]
    reads = [(n, FloatType()) for n in names]
    answers: list[tuple[str, Any]] = [(f"y{i}", FloatType()) for i in range(network.outputs)]
    if network.choice:
        answers = [("y0", IntType(0, network.outputs - 1))]
    constant = dict.fromkeys(dict(answers), 0)
    loads: tuple[Callable[[], Any], ...] = (
        lambda: load_policy(subject.binding, reads, answers, None),
        lambda: lambda _: constant,
    )
    nowhere = Span(Source("", ""), 0, 0)
    workers = [ProcessExtern("Learned", x, answers, nowhere, StopRequest()) for x in loads]
    with core_of_its_own():
        for worker in workers:
            worker.reset(1)

    def rows(part: npt.NDArray[np.float64]) -> list[Any]:
        return list(part.astype(np.float32)[:, None, :])

    def inputs(part: npt.NDArray[np.float64]) -> list[Any]:
        return [SimpleNamespace(**dict(zip(names, x, strict=True))) for x in part.tolist()]

    os.sched_setaffinity(0, CORES[:1])
    times = quickest_us(
        {
            "onnxruntime": (lambda x: session.run(None, {"obs": x}), rows),
            "in_process": (loads[0]().step, inputs),
            "worker": (workers[0].step, inputs),
            "round_trip": (workers[1].step, inputs),
        },
        seen,
    )
    os.sched_setaffinity(0, CORES)
    for worker in workers:
        worker.close()
    return times


@contextmanager
def core_of_its_own() -> Iterator[None]:
    """Processes that begin here run on the last core, and whoever asks them on the first.

    A way from core to core takes twice as long as one on a core, and the system moves processes as
    it likes: it would be compared with itself on other cores.
    """
    os.sched_setaffinity(0, CORES[-1:])
    try:
        yield
    finally:
        os.sched_setaffinity(0, CORES)


# ---------------------------------------------------------------- the exported C


def exported(subject: Subject, folder: Path, count: int) -> tuple[Any, Any, float]:
    """What the C saw and answered, and us a call: with the function less without it."""
    network = subject.policy.network
    (folder / "net.soter").write_text(soter_source(subject.policy, ["a network"]), encoding="utf-8")
    n, outputs = network.inputs, network.outputs
    result = f"int in [0, {outputs - 1}]" if network.choice else f"float[{outputs}]"
    text = PROGRAM.format(
        n=n,
        result=result,
        nothing="0" if network.choice else f"[{', '.join(['0.0'] * outputs)}]",
        zeros=", ".join(["0.0"] * n),
        draws="\n".join(
            f"  disturbance d{i}: float in [-{subject.size}, {subject.size}];" for i in range(n)
        ),
        drawn=", ".join(f"d{i}" for i in range(n)),
        until=10 * (count - 1),
    )
    (folder / "p.soter").write_text(text, encoding="utf-8")
    program = soter.load(folder / "p.soter")
    run = program.simulate("With")
    times = {"With": float("inf"), "Without": float("inf")}
    for _ in range(REPEATS):
        for system, best in times.items():
            wall_s = program.simulate(system, trace=False, sha256=False).wall_s
            times[system] = min(best, wall_s)
    answered = run.array("out").reshape(count, -1)
    return (
        run.array("obs").reshape(count, n),
        answered,
        (times["With"] - times["Without"]) / count * 1e6,
    )


def distances(subject: Subject, seen: Any, answered: Any) -> dict[str, float]:  # noqa: ANN401 - arrays
    """From onnxruntime's float32, over all observations."""
    network = subject.policy.network
    session = onnxruntime.InferenceSession(as_onnx(network), providers=["CPUExecutionProvider"])
    single = np.concatenate(
        [session.run(None, {"obs": x[None, :]})[0] for x in seen.astype(np.float32)]
    )
    box = np.full(network.inputs, subject.size)
    bound = error_bound(replace(network, choice=False), -box, box)
    if network.choice:
        ordered = np.sort(single, axis=1)
        close = ordered[:, -1] - ordered[:, -2] <= 2.0 * bound.max()
        wrong = (single.argmax(axis=1) != answered[:, 0]) & ~close
        return {
            "distance": float(wrong.sum()),
            "bound": float(bound.max()),
            "close": int(close.sum()),
        }
    distance = np.abs(answered - single)
    assert (distance <= bound).all()
    return {"distance": float(distance.max()), "bound": float(bound.max()), "close": 0}


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description="Learned policies as nodes.")
    parser.add_argument("-n", type=int, default=100_000, help="observations of each (100,000)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    result = {}
    print(
        f"{'us an observation':<22}{'onnxruntime':>12}{'node':>8}{'ratio':>7}{'worker':>8}"
        f"{'of it round trip':>18}{'ratio':>7}{'C':>7}{'distance':>11}{'bound':>10}{'close':>7}"
    )
    with tempfile.TemporaryDirectory() as name:
        for subject in subjects(Path(name)):
            seen, answered, in_c = exported(subject, Path(name), options.n)
            row = {**asked(subject, seen), "c": in_c, **distances(subject, seen, answered)}
            result[subject.name] = row
            wrong = (
                f"{row['distance']:.0f} wrong"
                if subject.policy.network.choice
                else f"{row['distance']:.1e}"
            )
            print(
                f"{subject.name:<22}{row['onnxruntime']:>12.2f}{row['in_process']:>8.2f}"
                f"{row['in_process'] / row['onnxruntime']:>7.2f}{row['worker']:>8.1f}"
                f"{row['round_trip']:>18.1f}"
                f"{row['worker'] / (row['in_process'] + row['round_trip']):>7.2f}"
                f"{row['c']:>7.2f}{wrong:>11}{row['bound']:>10.1e}{row['close']:>7}",
                flush=True,
            )
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
