"""Configuration, Environment-Input, Discrete-Time-Progress-Step and the order of an instant."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.language.front_end import check_file, system_of
from soter.semantics.configuration import AC, NEVER, SC
from soter.semantics.draws import draw_float
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import discrete_time_progress_step, environment_input

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.run_record import Record

    Build = Callable[..., Interpreter]

MS = 1_000_000
DM, SAFE, ADVANCED = 0, 1, 2
X, U, V = 0, 1, 2


# ---------------------------------------------------------------- the initial configuration


def test_the_start_is_safe_and_just_before_zero(build: Build) -> None:
    c = build().initial()
    assert c.ct == -1
    assert c.FN == ()
    assert c.L == (SC, (0,), (0, 0))
    assert c.OE == (True, True, False)
    assert c.Topics == (0.0, 0.0, 0.0)
    assert c.stamps == (NEVER,) * 3
    assert c.latched == c.had_control == (False,) * 3
    assert c.gate_fault == (False,)
    assert c.clean_needed == (0,)


def test_a_system_that_forces_ac_starts_with_enables_swapped(build: Build) -> None:
    c = build(system="ForcedAc").initial()
    assert c.L[DM] == AC
    assert c.OE == (True, False, True)
    assert build(system="ForcedSc").initial().OE == (True, True, False)


def test_initial_values_are_the_written_ones(build: Build) -> None:
    it = build(
        """topic y: int in [3, 5];
        topic z: bool = true;
        node N period 1ms { publishes y, z; var a: int = 7; var b: int in [4, 6]; step { } }
        system S { node N; until 1s; }"""
    )
    c = it.initial()
    assert c.Topics == (3, True)
    assert c.L == ((7, 4),)


# ---------------------------------------------------------------- Environment-Input


def test_an_input_changes_its_topic_and_stamp_and_nothing_else(build: Build) -> None:
    it = build()
    before = it.instant(it.initial())
    after = environment_input(it.machine, before, X, 12.5)
    assert after.Topics == (12.5, *before.Topics[1:])
    assert after.stamps == (before.ct, *before.stamps[1:])
    rest = ("L", "OE", "ct", "FN", "latched", "had_control", "gate_fault", "clean_needed")
    assert all(getattr(after, name) == getattr(before, name) for name in rest)


INPUTS = """
input topic x: float in [-2.0, 3.0];
topic y: float;
node N period 10ms { subscribes x; publishes y; step { publish y = x; } }
system S { node N; input x every 4ms; until 20ms; }
"""


def test_a_driven_input_changes_at_every_multiple_before_all_else(build: Build) -> None:
    seen = []

    def observe(c: Configuration, _: Record) -> None:
        seen.append((c.ct, c.Topics, c.stamps))

    build(INPUTS, seed=9).run(observe=observe)
    assert [ct for ct, _, _ in seen] == [t * MS for t in (0, 4, 8, 10, 12, 16, 20)]
    for ct, (x, y), (x_stamp, y_stamp) in seen:
        index = ct // (4 * MS)
        assert x == draw_float(9, "input.x", index, -2.0, 3.0)
        assert x_stamp == index * 4 * MS
        read = ct // (10 * MS) * 10 * MS
        assert y == draw_float(9, "input.x", read // (4 * MS), -2.0, 3.0)
        assert y_stamp == read


def test_the_choice_of_inputs_is_a_function_passed_in(build: Build) -> None:
    it = build(INPUTS)
    c = it.instant(it.initial(), choose_input=lambda _: [(0, 1.25)])
    assert c.Topics == (1.25, 1.25)
    assert it.instant(c, choose_input=lambda _: []).Topics == (1.25, 1.25)


# ---------------------------------------------------------------- Discrete-Time-Progress-Step


def test_dt1_time_progresses_only_when_nothing_is_left_to_fire(build: Build) -> None:
    it = build()
    c = discrete_time_progress_step(it.machine, it.initial())
    assert c.FN == (DM, SAFE, ADVANCED)
    with pytest.raises(AssertionError, match="dt1"):
        discrete_time_progress_step(it.machine, c)


def test_dt2_the_first_instant_is_zero_and_time_goes_to_the_next_release(build: Build) -> None:
    it = build()
    c = it.instant(it.initial())
    assert c.ct == 0
    c = it.instant(c)
    assert c.ct == 10 * MS
    assert discrete_time_progress_step(it.machine, c).ct == 20 * MS


def test_dt3_components_are_released_at_phase_plus_multiples_of_period(build: Build) -> None:
    it = build(
        """topic a: int; topic b: int;
        node A period 6ms phase 2ms { publishes a; step { } }
        node B period 4ms { publishes b; step { } }
        system S { node A; node B; until 20ms; }"""
    )
    c, released = it.initial(), []
    while c.ct < 20 * MS:
        c = discrete_time_progress_step(it.machine, c)
        released.append((c.ct // MS, c.FN))
        while c.FN:
            c, _ = it.fire(c, c.FN[0])
    assert released == [
        (0, (1,)), (2, (0,)), (4, (1,)), (8, (0, 1)), (12, (1,)), (14, (0,)), (16, (1,)),
        (20, (0, 1)),
    ]  # fmt: skip


@settings(max_examples=30)
@given(
    calendar=st.lists(
        st.integers(1, 9).flatmap(lambda p: st.tuples(st.just(p), st.integers(0, p - 1))),
        min_size=1,
        max_size=4,
    )
)
def test_the_calendar_against_brute_force(calendar: list[tuple[int, int]]) -> None:
    nodes = [
        f"topic t{i}: int; node N{i} period {p}ms phase {q}ms {{ publishes t{i}; step {{ }} }}"
        for i, (p, q) in enumerate(calendar)
    ]
    members = " ".join(f"node N{i};" for i in range(len(calendar)))
    text = "soter 1;\n" + "\n".join(nodes) + f"\nsystem S {{ {members} until 40ms; }}"
    it = Interpreter(system_of(check_file("test.soter", text), None))
    c, nodes_by_time = it.initial(), {}
    while c.ct < 40 * MS:
        c = discrete_time_progress_step(it.machine, c)
        nodes_by_time[c.ct] = c.FN
        while c.FN:
            c, _ = it.fire(c, c.FN[-1])
    for ms in range(41):
        expected = tuple(i for i, (p, q) in enumerate(calendar) if ms >= q and (ms - q) % p == 0)
        assert nodes_by_time.get(ms * MS, ()) == expected


# ---------------------------------------------------------------- order within an instant

ORDERS = """
input topic x: float in [-100.0, 100.0];
topic u: float in [-1.0, 1.0];
node Ac period 10ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Sc period 10ms { subscribes x; publishes u; step { publish u = -1.0; } }
rta M { ac Ac; sc Sc; period 10ms; safe true; ttf x > 50.0; safer x < 10.0; }
system S { module M; until 1s; }
"""


def test_deployed_order_is_plants_dms_scs_and_the_rest(build: Build) -> None:
    it = build(
        """topic s: float; topic u: float in [-1.0, 1.0]; topic w: float; topic r: float;
        node Late period 10ms { publishes w; step { } }
        node Ac period 10ms { subscribes s; publishes u; step { } }
        node Sc period 10ms { subscribes s; publishes u; step { } }
        rta M { ac Ac; sc Sc; period 10ms; safe true; ttf s > 1.0; safer s < 1.0; }
        plant P period 10ms { reads u; drives s = p; state p: float; der p = u; }
        node Later period 10ms { publishes r; step { } }
        system S { node Late; module M; p: P; node Later; until 1s; }"""
    )
    order = [c.name for c in it.system.components]
    assert order == ["p", "M.dm", "M.Sc", "Late", "M.Ac", "Later"]
    c = discrete_time_progress_step(it.machine, it.initial())
    assert c.FN == (0, 1, 2, 3, 4, 5)


def test_in_deployed_order_sc_acts_in_the_instant_of_the_switch(build: Build) -> None:
    it = build(ORDERS)
    c = it.instant(it.initial())
    c = it.instant(c)
    assert (c.L[DM], c.Topics[U]) == (AC, 1.0)
    c = it.instant(c, choose_input=lambda _: [(X, 60.0)])
    assert (c.L[DM], c.Topics[U]) == (SC, -1.0)


def test_another_choice_of_the_next_node_loses_a_period_of_sc(build: Build) -> None:
    # THEORY ruling 5: FN is a set; if SC fires before the DM, its output is dropped
    it = build(ORDERS)
    c = it.instant(it.instant(it.initial()))

    def nodes_first(c: Configuration) -> int:
        return c.FN[-1]

    def inputs(_: Configuration) -> list[tuple[int, Value]]:
        return [(X, 60.0)]

    c = it.instant(c, nodes_first, inputs)
    assert (c.L[DM], c.Topics[U]) == (SC, 1.0)


def test_every_order_of_an_instant_can_be_enumerated_from_one_configuration(build: Build) -> None:
    it = build(ORDERS)
    start = discrete_time_progress_step(it.machine, it.initial())
    ends = set()

    def explore(c: Configuration) -> None:
        if not it.enabled(c):
            ends.add((c.L, c.OE, c.Topics))
        for n in it.enabled(c):
            explore(it.fire(c, n)[0])

    explore(start)
    # the DM hands over to AC: AC steps after it (1), only SC before it (-1), or neither acts (0)
    assert {topics[U] for _, _, topics in ends} == {1.0, -1.0, 0.0}
    assert it.enabled(start) == (DM, SAFE, ADVANCED)


def test_a_component_fires_once_an_instant(build: Build) -> None:
    it = build()
    c = discrete_time_progress_step(it.machine, it.initial())
    c, _ = it.fire(c, SAFE)
    with pytest.raises(AssertionError, match="once an instant"):
        it.fire(c, SAFE)


# ---------------------------------------------------------------- runs


def test_a_run_ends_with_the_instant_at_until(build: Build) -> None:
    it = build()
    assert it.run(20 * MS)[0].ct == 20 * MS
    assert it.run(29 * MS)[0].ct == 20 * MS
    assert it.run()[0].ct == 1000 * MS
    assert it.run(0)[0].ct == 0


def test_two_runs_of_one_seed_are_the_same_run(build: Build) -> None:
    one, two = (build(INPUTS, seed=4).run()[0] for _ in range(2))
    assert one == two
    assert build(INPUTS, seed=5).run()[0] != one


def test_a_fork_does_not_disturb_the_original(build: Build) -> None:
    it = build()
    start = it.instant(it.initial())
    left = it.instant(start, choose_input=lambda _: [(X, 60.0)])
    assert it.instant(start) != left
    assert it.instant(start, choose_input=lambda _: [(X, 60.0)]) == left
