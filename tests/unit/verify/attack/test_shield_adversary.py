"""The adversary against shields (`bench/adversary/against_shields.py`), and that it fails.

Purpose: modules with a shield are not left, and no command acts that was not judged; a shield that
is wrong in its gate, its prover, its DM or its tables is noticed by whoever has to.
Non-goals: the figures of the benchmark, all of its wrong shields.
"""

from __future__ import annotations

import numpy as np
import pytest
from bench.adversary import against_shields, wrong_shields
from bench.adversary.closed_loop import SLIPS, Run, attack
from bench.adversary.module_families import FAMILIES, of_commands
from bench.adversary.proofs import armed, prove
from bench.adversary.random_modules import Face, Module, PathNode, Times

STEPS = 4_000_000


@pytest.mark.parametrize("make", [wrong_shields.late_to_act, wrong_shields.two_axes])
def test_a_module_with_a_shield_is_not_left(make: object) -> None:
    proof = prove(make(np.random.default_rng(1)))  # type: ignore[operator]
    assert proof.proved
    told = attack(armed(proof), proof.module, STEPS, 1)
    assert told.violations == 0
    assert told.closest > 0.9  # it came to the border
    assert told.switches > 100


def test_what_a_node_with_sensors_passes_on_is_counted_until_it_does() -> None:
    """It runs in SC's instant: W holds a period of SC, and less of it is too little."""
    rng = np.random.default_rng([4, 1])
    proof = prove(of_commands(FAMILIES["sensing"](1, rng), rng))
    assert proof.proved, proof.why
    assert attack(armed(proof), proof.module, STEPS, 1).violations == 0
    short = armed(proof)
    short.c.acted -= proof.module.times.sc
    assert attack(short, proof.module, STEPS, 1).found is not None


@pytest.mark.parametrize("slip", SLIPS)
def test_a_gate_that_is_wrong_is_found(slip: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(against_shields, "SLIPS", {slip: SLIPS[slip]})
    assert [n.who for n in against_shields.of_gate(STEPS)] == ["adversary"]


@pytest.mark.parametrize(
    ("name", "who"),
    [("W without L", "adversary"), ("H less the DM's period", "adversary, re-checker")],
)
def test_a_slip_of_the_prover_is_found(
    name: str, who: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    slips = tuple(s for s in wrong_shields.OF_PROVER if s.name == name)
    monkeypatch.setattr(wrong_shields, "OF_PROVER", slips)
    assert [n.who for n in against_shields.of_prover(STEPS)] == [who]


def test_tables_and_programs_that_are_wrong_are_told() -> None:
    every = [*against_shields.of_dm(), *against_shields.refused()]
    assert len(every) == sum(
        len(x) for x in (wrong_shields.OF_DM, wrong_shields.OF_TABLES, wrong_shields.REFUSED)
    )
    assert not [n.name for n in every if not n.who]


def test_a_run_of_a_module_with_a_shield_can_be_had_again() -> None:
    drawn = wrong_shields.late_to_act(np.random.default_rng(1))
    machine = armed(prove(drawn))
    machine.c.slip = SLIPS["a command acts before it is judged"]
    found = attack(machine, drawn, STEPS, 3).found
    assert found is not None
    printed = eval(repr(found), {"Run": Run, "array": np.array, "int32": np.int32})  # noqa: S307
    assert printed.again(machine) == found.again(machine)
    names = {"Module": Module, "Times": Times, "PathNode": PathNode, "Face": Face}
    assert eval(repr(drawn), names).text == drawn.text  # noqa: S307 - text of our own
