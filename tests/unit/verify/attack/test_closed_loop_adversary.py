"""The closed-loop adversary (`bench/adversary`): its loop, its holes, and that it fails.

Purpose: where nothing is late the adversary's loop moves as `soter run` does, bit for bit but for
rounding; lateness and latencies are what was declared; runs can be had again; a hole put back
is found, and a proved module is not broken.
Non-goals: the figures of the benchmark.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from bench.adversary.against_proofs import through
from bench.adversary.closed_loop import POLICY, Machine, attack
from bench.adversary.module_families import FAMILIES, module
from bench.adversary.proofs import armed, prove
from bench.adversary.prover_holes import HOLES
from bench.adversary.random_modules import Face, Module, PathNode, Times

import soter
from soter.language.front_end import check_file
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    Ints = npt.NDArray[np.int32]

PUSHES = {"ac": 3, "side": 1, "wind": 1}
"""AC always commands its upper bound, and no wind blows."""


def policy(**chosen: int) -> Ints:
    """Everything zero but what is chosen: on time, as the program says."""
    return np.array([chosen.get(n, 0) for n in POLICY], dtype=np.int32)


def cart(**times: int) -> Module:
    when = Times(**{"dm": 30, "sc": 20, "sensor": 1, "max_age": 1, **times})
    return Module(
        1,
        "cart",
        ((0.0, 1.0), (0.0, -0.5)),
        ((0.0,), (1.0,)),
        (((4.0, 3.0),),),
        (1.5,),
        (2.0,),
        (0.0, 0.0),
        (0.0, 0.0),
        (1.5, 3.0),
        when,
        (40, 40),
        ttf=(Face((1.0, 0.4), 0.2, 0.9), Face((0.0, 1.0), 0.0, 2.0)),
        safer=(Face((1.0, 0.4), 0.2, 0.6), Face((0.0, 1.0), 0.0, 1.5)),
    )


def ends(machine: Machine, ticks: list[int], chosen: Ints) -> list[tuple[float, ...]]:
    """States after so many ticks, from rest."""
    return [machine.run(chosen, 1, t, np.zeros(2)).x for t in ticks]


WAYS = {
    "direct": cart(),
    "out of step": cart(sc_phase=7),
    "a DM out of step": cart(dm=45),
    "through nodes": replace(
        cart(max_age=10),
        nodes=(PathNode(5, 2), PathNode(4, 3)),
        drivers=(PathNode(4, 1), PathNode(3, 2)),
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_where_nothing_is_late_it_moves_as_soter_run(tmp_path: Path, way: str) -> None:
    m = WAYS[way]
    path = tmp_path / "cart.soter"
    path.write_text(m.text)
    run = soter.load(str(path)).simulate(until="4s", seed=1)
    truth = run.array("p.truth")
    ticks = [1, 20, 200, 777, 1500, 3999]
    seen = ends(m.machine(), ticks, policy(**PUSHES, seen=1))  # nodes in order
    at = np.searchsorted(run.time_s(), np.array(ticks) * 1e-3 - 1e-9)
    assert np.abs(truth[at] - np.array(seen)).max() < 1e-9
    assert run.modules["M"].switches_to_sc > 2  # both modes were seen


def test_late_starts_and_latencies_are_those_declared() -> None:
    m = cart(late_dm=4, response_dm=3, late_sc=2, response_sc=1, acts=5, sensor=10, max_age=10)
    names = ("late_dm", "response_dm", "late_sc", "response_sc", "acts")
    m = replace(m, ttf=(Face((1.0, 0.0), 0.0, 0.0),))  # SC keeps control
    late = policy(**PUSHES, **dict.fromkeys(names, 1))
    told = m.machine().run(late, 1, 400, np.zeros(2), log=True).log
    dm = [t for t, what, _ in told if what.startswith("DM")]
    sc = [t for t, what, _ in told if what.startswith("SC")]
    acts = [t for t, what, _ in told if what.startswith("command")]
    assert dm == list(range(4, 400, 30))
    # every third release of SC falls on one of the DM, and waits for its verdict
    assert sc == [t + (7 if t % 60 == 0 else 2) for t in range(0, 400, 20)]
    assert acts[0] == sc[0] + 1 + 5
    ages = {v for _, what, v in told if what.startswith("SC")}
    assert ages == {7.0, 2.0}


def test_a_default_is_read_before_a_node_has_spoken() -> None:
    m = replace(cart(sensor=10, max_age=40), nodes=(PathNode(20, 5, 0, 3),))
    told = m.machine().run(policy(**PUSHES), 1, 60, np.zeros(2), log=True).log
    assert [v for _, what, v in told if what.startswith("SC")] == [-1.0, 20.0, 20.0]


def test_runs_can_be_had_again() -> None:
    m = module(3, "tank")
    machine = m.machine()
    rng = np.random.default_rng(0)
    random = rng.integers(0, 3, len(POLICY)).astype(np.int32)
    first, second = (machine.run(random, 5, 3000, np.zeros(m.n)) for _ in range(2))
    assert first == second


@all_rows("family", FAMILIES)
def test_modules_of_every_family_are_programs(family: str) -> None:
    for seed in range(4):
        drawn = module(seed, family)
        checked = check_file("m.soter", drawn.text)
        assert checked.ok, [d.message for d in checked.diagnostics.items]


def test_a_proved_module_is_not_broken() -> None:
    proof = prove(module(77, "tank"))
    assert proof.proved
    told = attack(armed(proof), proof.module, 2_000_000, 1)
    assert told.violations == 0
    assert told.closest > 0.5  # it came to the border


@pytest.mark.parametrize(
    "name", ["actuation latency is left out of H*", "R011 is not asked", "h_0 is zero"]
)
def test_a_hole_put_back_is_found(name: str) -> None:
    number = next(i for i, h in enumerate(HOLES) if h.name == name)
    finding = through(HOLES[number], number, 20_000_000)
    assert finding.found, finding
    assert finding.module is not None
    assert finding.attack is not None
    assert finding.attack.found is not None
    assert finding.attack.outcome is not None
    with HOLES[number].open():
        machine = armed(prove(finding.module, whole=False))
    again = finding.attack.found.again(machine, log=True)
    assert again.left
    assert again.at == finding.attack.outcome.at
    assert again.log[0][1] == "DM reads, verdict"  # it reads at 0, before SC
