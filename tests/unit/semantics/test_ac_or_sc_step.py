"""AC-or-SC-Step, clause by clause: latching, takeover, transaction, the gate, cleanliness."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from soter.language.evaluate.arithmetic import FaultKind
from soter.semantics.configuration import AC, NEVER, SC
from soter.semantics.rules import ac_or_sc_step

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.semantics.configuration import Configuration, StepOutcome
    from soter.semantics.interpreter import Interpreter

    Build = Callable[..., Interpreter]

MS = 1_000_000
DM, SAFE, ADVANCED = 0, 1, 2
X, U, V = 0, 1, 2

# x where the nodes of conftest.py ...
GOOD = 0.5  # AC publishes u and v
INCOMPLETE = -0.5  # AC publishes only u
OUTSIDE = 2.0  # AC publishes u = 2 outside [-1, 1]
SC_DIVIDES = -5.0  # SC divides by zero
SC_OUTSIDE = -4.95  # SC publishes v = 20 outside [0, 9]


def before_step(it: Interpreter, x: float = GOOD, mode: int = SC, **changes: Any) -> Configuration:
    """A configuration in which SC and AC are about to step, at 1 s."""
    c = it.initial()
    c = replace(
        c,
        ct=1000 * MS,
        FN=(SAFE, ADVANCED),
        L=(mode, *c.L[1:]),
        OE=(True, mode == SC, mode == AC),
        Topics=(x, *c.Topics[1:]),
    )
    return replace(c, **changes)


def step(it: Interpreter, c: Configuration, n: int) -> tuple[Configuration, StepOutcome]:
    after, outcome = ac_or_sc_step(it.machine, c, n)
    assert tuple(i for i in c.FN if i != n) == after.FN
    return replace(after, FN=c.FN), outcome


# ---------------------------------------------------------------- n1


def test_n1_an_enabled_node_publishes_with_stamp_ct(build: Build) -> None:
    it = build()
    c = before_step(it, GOOD, AC)
    after, outcome = step(it, c, ADVANCED)
    assert after.Topics == (GOOD, 0.5, 1.0)
    assert after.stamps == (NEVER, c.ct, c.ct)
    assert outcome.published == {U: 0.5, V: 1.0}


def test_n1_a_disabled_node_steps_and_publishes_nothing(build: Build) -> None:
    it = build()
    c = before_step(it, GOOD, SC)
    after, outcome = step(it, c, ADVANCED)
    assert (after.Topics, after.stamps) == (c.Topics, c.stamps)
    assert after.L[ADVANCED] == (1, 0)
    assert outcome.published == {}
    assert outcome.fault is None


def test_what_is_not_published_stays_with_its_stamp(build: Build) -> None:
    it = build()
    c = before_step(it, INCOMPLETE, AC, stamps=(1, 2, 3))
    after, _ = step(it, c, ADVANCED)
    assert after.Topics == (INCOMPLETE, -0.5, 0.0)
    assert after.stamps == (1, c.ct, 3)


# ---------------------------------------------------------------- 1: latched


def test_1_a_latched_node_runs_nothing_and_publishes_its_fail_safe_values(build: Build) -> None:
    it = build()
    c = before_step(it, GOOD, SC, latched=(False, True, False))
    after, outcome = step(it, c, SAFE)
    assert after.Topics == (GOOD, -1.0, 0.5)
    assert after.stamps == (NEVER, c.ct, c.ct)
    assert after.L == c.L
    assert after.had_control == c.had_control
    assert outcome.fault is None


def test_1_a_latched_node_without_control_publishes_nothing(build: Build) -> None:
    it = build()
    c = before_step(it, GOOD, AC, latched=(False, True, False))
    assert step(it, c, SAFE)[0] == c


# ---------------------------------------------------------------- 2: takeover


@pytest.mark.parametrize(
    ("mode", "had", "taken"), [(AC, False, 1), (AC, True, 0), (SC, False, 0), (SC, True, 0)]
)
def test_2_takeover_runs_when_control_is_new(
    build: Build, mode: int, had: bool, taken: int
) -> None:
    it = build()
    c = before_step(it, GOOD, mode, had_control=(False, False, had))
    after, _ = step(it, c, ADVANCED)
    assert after.L[ADVANCED] == (1, taken)
    assert after.had_control[ADVANCED] is (mode == AC)


def test_2_takeover_is_undone_with_its_step_and_runs_again(build: Build) -> None:
    it = build()
    c = before_step(it, OUTSIDE, AC)
    after, _ = step(it, c, ADVANCED)
    assert after.L == c.L
    assert after.had_control == c.had_control
    after, _ = step(it, replace(after, Topics=(GOOD, *after.Topics[1:])), ADVANCED)
    assert after.L[ADVANCED] == (1, 1)


# ---------------------------------------------------------------- 3: the step

ONE_NODE = """
input topic a: float; topic b: float; topic c: float;
node N period 10ms {{ subscribes a; publishes b, c; {items} step {{ {step} }} }}
system S {{ node N; until 1s; }}
"""


def one_node(build: Build, step: str, items: str = "") -> tuple[Interpreter, Configuration]:
    it = build(ONE_NODE.format(step=step, items=items))
    c = it.initial()
    return it, replace(c, ct=0, FN=(0,))


def test_3_the_last_publication_of_a_topic_counts(build: Build) -> None:
    it, c = one_node(build, "publish b = 1.0; publish c = 3.0; publish b = 2.0;")
    after, outcome = step(it, c, 0)
    assert after.Topics == (0.0, 2.0, 3.0)
    assert outcome.published == {1: 2.0, 2: 3.0}


def test_3_only_the_last_publication_is_checked(build: Build) -> None:
    it, c = one_node(build, "publish b = sqrt(-1.0); publish b = 2.0;")
    assert step(it, c, 0)[1].fault is None


def test_3_locals_are_kept_between_steps_and_lets_are_not(build: Build) -> None:
    it, c = one_node(build, "let d = n + 1; n = d; publish c = float(n);", "var n: int = 4;")
    c, _ = step(it, c, 0)
    c, _ = step(it, c, 0)
    assert c.L == ((6,),)
    assert c.Topics[2] == 6.0


def test_3_a_stored_nan_is_canonical_and_minus_zero_is_kept(build: Build) -> None:
    it, c = one_node(
        build,
        "n[0] = -sqrt(-1.0); n[1] = -0.0;",
        "var n: float[2];",
    )
    after, _ = step(it, c, 0)
    (stored,) = after.L[0]
    assert struct.pack("<d", stored[0]) == bytes.fromhex("000000000000f87f")
    assert math.copysign(1.0, stored[1]) == -1.0


def test_3_time_period_age_and_control_can_be_read(build: Build) -> None:
    it, c = one_node(
        build,
        "t = time; d = dt; g = age(a); ic = in_control;",
        "var t: float; var d: float; var g: float; var ic: bool;",
    )
    c = replace(c, ct=30 * MS, stamps=(10 * MS, NEVER, NEVER))
    after, _ = step(it, c, 0)
    assert after.L == ((0.03, 0.01, 0.02, True),)
    never, _ = step(it, replace(c, stamps=(NEVER,) * 3), 0)
    assert never.L[0][2] == float(30 * MS + 2**62) / 1e9


def test_3_a_node_reads_the_mode_of_a_module(build: Build) -> None:
    it = build(
        """input topic x: float in [-9.0, 9.0]; topic u: float in [-1.0, 1.0]; topic w: bool;
        node Ac period 10ms { subscribes x; publishes u;
            var held: int; step { if in_control { held = held + 1; } } }
        node Sc period 10ms { subscribes x; publishes u; step { } }
        node Watch period 10ms { publishes w; step { publish w = mode(M) == Mode.AC; } }
        rta M { ac Ac; sc Sc; period 10ms; safe true; ttf x > 5.0; safer x < 1.0; }
        system S { module M; node Watch; until 1s; }"""
    )
    c = it.instant(it.initial(), choose_input=lambda _: [(0, 2.0)])
    assert (c.Topics[2], c.L[2]) == (False, (0,))
    c = it.instant(c, choose_input=lambda _: [(0, 0.0)])
    assert (c.Topics[2], c.L[2]) == (True, (1,))


def test_3_a_long_chain_of_calls_needs_no_deep_stack_of_pythons_default(build: Build) -> None:
    chain = "".join(
        f"fun F{i}(x: float): float {{ return (F{i - 1}(x) + 1.0) * 1.0; }}\n"
        for i in range(1, 400)
    )
    it = build(
        f"""fun F0(x: float): float {{ return x; }}
        {chain} topic y: float;
        node N period 1ms {{ publishes y; step {{ publish y = F399(0.0); }} }}
        system S {{ node N; until 1ms; }}"""
    )
    assert it.run()[0].Topics == (399.0,)


# ---------------------------------------------------------------- 4: the checks


@pytest.mark.parametrize("mode", [AC, SC])
def test_4_publications_are_checked_whether_or_not_enabled(build: Build, mode: int) -> None:
    it = build()
    _, outcome = step(it, before_step(it, OUTSIDE, mode), ADVANCED)
    assert outcome.fault is not None
    assert outcome.fault.kind is FaultKind.RANGE
    assert outcome.module == 0


CHECKED = """
type P = {{ x: float, n: int }}; type Q = {{ m: int, n: int }};
topic a: float in [0.0, 1.0]; topic b: P in {{ x in [-1.0, 1.0], n in [0, 3] }};
topic c: float[2]; topic l: Q[<=3] in [0, 3];
node N period 10ms {{ publishes b, a, c, l; step {{ {step} }} }}
system S {{ node N; until 1s; }}
"""


@pytest.mark.parametrize(
    ("statements", "kind", "leaf"),
    [
        ("publish a = 1.5;", FaultKind.RANGE, "a"),
        ("publish a = sqrt(-1.0);", FaultKind.NONFINITE, "a"),
        ("publish a = 1e308 * 10.0;", FaultKind.NONFINITE, "a"),
        ("publish c = [0.0, -1e308 * 10.0];", FaultKind.NONFINITE, "c.[1]"),
        ("publish b = { x: 0.0, n: 4 };", FaultKind.RANGE, "b.n"),
        # in the order of `publishes`, not of the statements, leaves as declared
        ("publish a = 9.0; publish b = { n: 9, x: sqrt(-1.0) };", FaultKind.NONFINITE, "b.x"),
        ("publish a = sqrt(-1.0); publish b = { x: 0.0, n: 4 };", FaultKind.RANGE, "b.n"),
        ("publish l = [{ m: 0, n: 1 }, { m: 0, n: -1 }];", FaultKind.RANGE, "l.[].n"),
    ],
)
def test_4_the_first_bad_leaf_names_the_fault(
    build: Build, statements: str, kind: FaultKind, leaf: str
) -> None:
    it = build(CHECKED.format(step=statements))
    _, outcome = step(it, replace(it.initial(), ct=0, FN=(0,)), 0)
    assert outcome.fault is not None
    assert outcome.fault.kind is kind
    assert f"`{leaf}`" in outcome.fault.detail


@pytest.mark.parametrize(
    "statements",
    [
        "publish a = 1.0; publish b = { x: -1.0, n: 3 };",
        "publish a = -0.0;",
        "publish c = [1e308, -1e308];",
        "publish l = [];",
    ],
)
def test_4_bounds_belong_to_the_set(build: Build, statements: str) -> None:
    it = build(CHECKED.format(step=statements))
    assert step(it, replace(it.initial(), ct=0, FN=(0,)), 0)[1].fault is None


# ---------------------------------------------------------------- 5: faults


def test_5_a_fault_of_an_enabled_ac_latches_the_gate_fault_and_keeps_all_else(
    build: Build,
) -> None:
    it = build()
    c = before_step(it, OUTSIDE, AC)
    after, outcome = step(it, c, ADVANCED)
    assert after == replace(c, gate_fault=(True,), clean_needed=(2,))
    assert outcome.published == {}
    assert not outcome.latched


def test_5_a_fault_of_a_disabled_ac_only_costs_cleanliness(build: Build) -> None:
    it = build()
    c = before_step(it, OUTSIDE, SC, clean_needed=(1,))
    after, outcome = step(it, c, ADVANCED)
    assert after == replace(c, clean_needed=(2,))
    record = it.record()
    record.note_event(outcome, after.ct)
    assert record.modules[0].gate_faults == 1, "counted whether or not OE"
    assert (record.components[ADVANCED].faults, record.components[ADVANCED].last_fault) == (1, 8)
    assert record.violations == 0


@pytest.mark.parametrize(
    ("x", "kind"), [(SC_DIVIDES, FaultKind.DIVIDE), (SC_OUTSIDE, FaultKind.RANGE)]
)
def test_5_a_fault_of_a_trusted_node_latches_it_and_fails_safe(
    build: Build, x: float, kind: FaultKind
) -> None:
    it = build()
    c = before_step(it, x, SC)
    after, outcome = step(it, c, SAFE)
    assert outcome.fault is not None
    assert outcome.fault.kind is kind
    assert after.latched == (False, True, False)
    assert after.Topics == (x, -1.0, 0.5)
    assert after.stamps == (NEVER, c.ct, c.ct)
    assert after.L == c.L
    record = it.record()
    record.note_event(outcome, after.ct)
    assert record.violations == 1
    assert record.components[SAFE].latched_ns == c.ct


def test_5_a_disabled_trusted_node_is_latched_without_publishing(build: Build) -> None:
    it = build()
    c = before_step(it, SC_DIVIDES, AC)
    after, outcome = step(it, c, SAFE)
    assert after == replace(c, latched=(False, True, False))
    assert outcome.latched
    assert outcome.published == {}


def test_5_a_node_outside_every_module_is_trusted(build: Build) -> None:
    it, c = one_node(build, "publish c = 1.0; assert a > 0.0;", "failsafe b = 3.0;")
    after, outcome = step(it, c, 0)
    assert after.latched == (True,)
    assert after.Topics == (0.0, 3.0, 0.0), "only declared fail-safe values are published"
    assert outcome.latched


# ---------------------------------------------------------------- 6: cleanliness


@pytest.mark.parametrize("mode", [AC, SC])
@pytest.mark.parametrize(("owed", "left"), [(2, 1), (1, 0), (0, 0)])
def test_6_complete_outputs_earn_cleanliness_whether_or_not_enabled(
    build: Build, mode: int, owed: int, left: int
) -> None:
    it = build()
    c = before_step(it, GOOD, mode, clean_needed=(owed,))
    assert step(it, c, ADVANCED)[0].clean_needed == (left,)


def test_6_incomplete_outputs_earn_nothing(build: Build) -> None:
    it = build()
    c = before_step(it, INCOMPLETE, SC, clean_needed=(2,))
    assert step(it, c, ADVANCED)[0].clean_needed == (2,)


def test_6_outputs_of_sc_earn_nothing(build: Build) -> None:
    it = build()
    c = before_step(it, GOOD, SC, clean_needed=(2,))
    assert step(it, c, SAFE)[0].clean_needed == (2,)


def test_after_a_gate_fault_ac_returns_only_after_clean_fresh_outputs(build: Build) -> None:
    it = build()
    c, record, trace = it.initial(), it.record(), []
    for x in (GOOD, GOOD, OUTSIDE, GOOD, GOOD, GOOD, GOOD, GOOD, GOOD):
        c = it.instant(c, choose_input=lambda _, x=x: [(X, x)], record=record)  # type: ignore[misc]
        trace.append((c.ct // MS, c.L[DM], c.clean_needed[0], c.gate_fault[0], c.Topics[U]))
    assert trace == [
        (0, AC, 0, False, 0.5),
        (10, AC, 0, False, 0.5),
        (20, AC, 2, True, 0.5),  # refused: the last good value stays
        (30, AC, 1, True, 0.5),
        (40, SC, 0, False, 0.0),  # the DM sees the fault; AC steps cleanly while gated
        (50, SC, 0, False, 0.0),
        (60, AC, 0, False, 0.5),
        (70, AC, 0, False, 0.5),
        (80, AC, 0, False, 0.5),
    ]
    assert record.modules[0].gate_faults == 1
    assert record.modules[0].switches_to_sc == 1
