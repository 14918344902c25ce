"""DM-Step: what the decision module sees, what it decides, what it sets."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import pytest

from soter.semantics.configuration import AC, NEVER, SC, DecisionVerdict
from soter.semantics.rules import dm_step

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.semantics.configuration import Configuration
    from soter.semantics.interpreter import Interpreter

    Build = Callable[..., Interpreter]

MS = 1_000_000
DM, SAFE, ADVANCED = 0, 1, 2
X = 0

# x where the predicates of the module in conftest.py are ...
FINE = 0.0  # ttf false, safer true
UNCLEAR = 30.5  # ttf false, safer false
DANGER = 60.0  # ttf true, safer true: 1/(60-30) < 1
TTF_FAULTS = 40.0  # ttf divides by zero, safer true
SAFER_FAULTS = 30.0  # ttf false, safer divides by zero


def before_dm(
    it: Interpreter,
    *,
    x: float = FINE,
    mode: int = SC,
    age_ns: int = 0,
    gate_fault: bool = False,
    clean_needed: int = 0,
) -> Configuration:
    """A configuration in which the DM is about to fire, at 1 s."""
    c = it.initial()
    ct = 1000 * MS
    return replace(
        c,
        ct=ct,
        FN=(DM, SAFE),
        L=(mode, *c.L[1:]),
        OE=(True, mode == SC, mode == AC),
        Topics=(x, *c.Topics[1:]),
        stamps=(NEVER if age_ns < 0 else ct - age_ns, *c.stamps[1:]),
        gate_fault=(gate_fault,),
        clean_needed=(clean_needed,),
    )


@pytest.mark.parametrize(
    ("x", "age_ms", "gate_fault"),
    list(product([FINE, UNCLEAR, DANGER, TTF_FAULTS, SAFER_FAULTS], [0, 51], [False, True])),
)
def test_mode_ac_is_left_for_ttf_stale_or_gate_fault_and_nothing_else(
    build: Build, x: float, age_ms: int, gate_fault: bool
) -> None:
    it = build()
    c = before_dm(it, x=x, mode=AC, age_ns=age_ms * MS, gate_fault=gate_fault)
    after, verdict = dm_step(it.machine, c, DM)
    leave = x in (DANGER, TTF_FAULTS) or age_ms > 50 or gate_fault
    assert after.L[DM] == (SC if leave else AC)
    assert (verdict.before, verdict.after) == (AC, after.L[DM])


@pytest.mark.parametrize(
    ("x", "age_ms", "gate_fault", "clean_needed"),
    list(
        product([FINE, UNCLEAR, DANGER, TTF_FAULTS, SAFER_FAULTS], [0, 51], [False, True], [0, 1])
    ),
)
def test_mode_sc_is_left_for_safer_and_fresh_and_clean(
    build: Build, x: float, age_ms: int, gate_fault: bool, clean_needed: int
) -> None:
    it = build()
    c = before_dm(
        it,
        x=x,
        mode=SC,
        age_ns=age_ms * MS,
        gate_fault=gate_fault,
        clean_needed=clean_needed,
    )
    after, _ = dm_step(it.machine, c, DM)
    leave = x in (FINE, DANGER, TTF_FAULTS) and age_ms <= 50 and clean_needed == 0
    assert after.L[DM] == (AC if leave else SC)


@pytest.mark.parametrize(("x", "mode"), list(product([FINE, UNCLEAR, DANGER], [AC, SC])))
def test_dm1_dm2_outputs_follow_the_new_mode_and_nothing_else_changes(
    build: Build, x: float, mode: int
) -> None:
    it = build()
    c = before_dm(it, x=x, mode=mode, gate_fault=True, clean_needed=1)
    after, _ = dm_step(it.machine, c, DM)
    en = after.L[DM] == AC
    assert (True, not en, en) == after.OE
    assert after.FN == (SAFE,)
    assert after.L[1:] == c.L[1:]
    assert after.gate_fault == (False,), "gate_fault is cleared"
    rest = ("ct", "Topics", "stamps", "latched", "had_control", "clean_needed")
    assert all(getattr(after, name) == getattr(c, name) for name in rest)


@pytest.mark.parametrize(
    ("x", "ttf", "safer"),
    [
        (FINE, False, True),
        (UNCLEAR, False, False),
        (DANGER, True, True),
        (TTF_FAULTS, True, True),
        (SAFER_FAULTS, False, False),
    ],
)
def test_a_fault_in_ttf_is_true_and_in_safer_false(
    build: Build, x: float, ttf: bool, safer: bool
) -> None:
    it = build()
    _, verdict = dm_step(it.machine, before_dm(it, x=x), DM)
    assert (verdict.ttf, verdict.safer) == (ttf, safer)


@pytest.mark.parametrize(("age_ns", "stale"), [(0, False), (50 * MS, False), (50 * MS + 1, True)])
def test_a_read_is_stale_beyond_max_age(build: Build, age_ns: int, stale: bool) -> None:
    it = build()
    _, verdict = dm_step(it.machine, before_dm(it, age_ns=age_ns), DM)
    assert verdict.stale is stale


def test_a_topic_never_published_is_stale(build: Build) -> None:
    it = build()
    _, verdict = dm_step(it.machine, before_dm(it, age_ns=-1), DM)
    assert verdict.stale is True


@pytest.mark.parametrize("x", [FINE, DANGER])
@pytest.mark.parametrize(("system", "mode"), [("ForcedAc", AC), ("ForcedSc", SC)])
def test_a_forced_module_keeps_mode_and_outputs_but_evaluates(
    build: Build, system: str, mode: int, x: float
) -> None:
    it = build(system=system)
    c = before_dm(it, x=x, mode=mode, gate_fault=True)
    after, verdict = dm_step(it.machine, c, DM)
    assert (after.L, after.OE) == (c.L, c.OE)
    assert after.gate_fault == (False,)
    assert verdict == DecisionVerdict(
        0, ttf=x == DANGER, safer=True, stale=False, gate_fault=True, before=mode, after=mode
    )


def test_without_predicates_unknown_is_unsafe(build: Build) -> None:
    it = build(
        """input topic x: float in [-1.0, 1.0]; topic u: float in [-1.0, 1.0];
        node Ac period 10ms { subscribes x; publishes u; step { } }
        node Sc period 10ms { subscribes x; publishes u; step { } }
        rta M { ac Ac; sc Sc; period 10ms; safe x < 1.0; verify { grid x in [-1.0, 1.0] / 4; } }
        system S { module M; until 1s; }"""
    )
    c, record = it.run(50 * MS)
    assert c.L[DM] == SC
    assert (record.modules[0].ttf, record.modules[0].safer) == (True, False)


# ---------------------------------------------------------------- what the record keeps


def test_the_record_counts_switches_and_time_in_ac(build: Build) -> None:
    it = build()
    c, record = it.initial(), it.record()
    for x in [FINE] * 4 + [DANGER] + [FINE] * 4:  # every 10 ms; the DM decides every 20 ms
        c = it.instant(c, choose_input=lambda _, x=x: [(X, x)], record=record)  # type: ignore[misc]
    module = record.modules[0]
    # to AC at 0, to SC at 40 (where AC is refused, too), and back at 80 after two clean outputs
    assert (module.switches_to_ac, module.switches_to_sc) == (2, 1)
    assert (module.mode, module.mode_since_ns, module.ac_ns) == (AC, 80 * MS, 40 * MS)
    assert (module.ttf, module.safer, module.stale, module.gate_fault) == (
        False,
        True,
        False,
        False,
    )
    assert module.gate_faults == 1


def test_a_record_is_copied_whole(build: Build) -> None:
    it = build()
    record = it.record()
    fork = record.copy()
    it.instant(it.initial(), choose_input=lambda _: [(X, FINE)], record=fork)
    assert fork != record
    assert record == it.record()
