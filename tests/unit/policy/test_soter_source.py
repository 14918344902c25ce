"""A network as Soter: the same bits in interpreter, C, and sums that are done by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from policy_files import FILES  # type: ignore[import-not-found]
from test_error_bound import in_declared_order, network_of  # type: ignore[import-not-found]

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.policy.network import Affine, Network, Policy, Tanh
from soter.policy.sb3_file import read_sb3
from soter.policy.soter_source import WEIGHTS_MAX, soter_source

if TYPE_CHECKING:
    from pathlib import Path

    from soter.api.program import Program

STEPS = 40
PROGRAM = """soter 1;
import "net.soter" as net;
topic obs: float[{n}];
topic out: {result};
plant World period 10ms {{
  drives obs = o;
  state o: float[{n}];
{draws}
  next o = [{drawn}];
}}
node N period 10ms {{ subscribes obs; publishes out; step {{ publish out = net.act(obs); }} }}
system S {{ w: World; node N; until {until}ms; }}
"""


def program_of(folder: Path, policy: Policy, size: float) -> Program:
    """A system that asks the function about observations that are drawn."""
    n = policy.network.inputs
    outputs = policy.network.outputs
    (folder / "net.soter").write_text(soter_source(policy, ["a network"]), encoding="utf-8")
    text = PROGRAM.format(
        n=n,
        result=f"int in [0, {outputs - 1}]" if policy.network.choices else f"float[{outputs}]",
        draws="\n".join(f"  disturbance d{i}: float in [-{size}, {size}];" for i in range(n)),
        drawn=", ".join(f"d{i}" for i in range(n)),
        until=10 * STEPS,
    )
    (folder / "p.soter").write_text(text, encoding="utf-8")
    return soter.load(folder / "p.soter")


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_both_engines_answer_the_same_bits(tmp_path: Path, seed: int) -> None:
    network = network_of(seed)
    program = program_of(tmp_path, Policy("net", network), 5.0)
    runs = [program.simulate(engine=engine) for engine in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    seen = runs[0].array("obs").reshape(-1, network.inputs)
    answered = runs[0].array("out").reshape(-1, network.outputs)
    no_tanh = not any(isinstance(layer, Tanh) for layer in network.layers)
    for x, y in zip(seen, answered, strict=True):
        wanted = in_declared_order(network, x)
        if no_tanh:
            assert (wanted == y).all()
        else:  # libm's tanh is not the prelude's
            assert np.allclose(wanted, y, rtol=0.0, atol=1e-12)
    assert np.ptp(answered) > 0.0


def test_sums_are_those_that_are_done_by_hand(tmp_path: Path) -> None:
    """Without tanh to the last bit."""
    network = network_of(3)
    layers = tuple(x for x in network.layers if not isinstance(x, Tanh))
    plain = Network(network.inputs, layers)
    run = program_of(tmp_path, Policy("net", plain), 5.0).simulate()
    seen = run.array("obs").reshape(-1, plain.inputs)
    for x, y in zip(seen, run.array("out").reshape(-1, plain.outputs), strict=True):
        assert in_declared_order(plain, x).tolist() == y.tolist()


def test_a_choice_is_the_index_of_the_largest(tmp_path: Path) -> None:
    policy = read_sb3(FILES / "dqn.zip")
    run = program_of(tmp_path, policy, 5.0).simulate()
    seen = run.array("obs").reshape(-1, policy.network.inputs)
    chosen = [int(in_declared_order(policy.network, x).argmax()) for x in seen]
    assert run.topic("out").tolist() == chosen
    assert len(set(chosen)) > 1


def test_what_is_too_large_or_no_function_is_refused() -> None:
    weight = np.ones((WEIGHTS_MAX + 1, 1), np.float32)
    large = Network(1, (Affine(weight, np.zeros(WEIGHTS_MAX + 1, np.float32)),))
    frames = read_sb3(FILES / "a2c_of_frames.zip", FILES / "a2c_vecnormalize.pkl")
    for policy, said in ((Policy("p", large), "50,001 weights"), (frames, "before it stacks them")):
        with pytest.raises(SoterError) as caught:
            soter_source(policy, [])
        (problem,) = caught.value.diagnostics
        assert problem.code == "X014"
        assert said in problem.message
