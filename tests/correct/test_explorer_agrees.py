"""Small random programs: the explorer and the brute-force enumerator say the same.

The enumerator walks over the reference interpreter and knows nothing of the explorer; see
tests/generators/brute_force.py. More programs: `make soak`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.brute_force import BruteForce, TooLargeError
from generators.explorer_agreement import compared, enumerated, small
from generators.lasting_step_programs import lasting_program
from generators.programs_apart import program_apart
from generators.programs_in_instants import program_in_instants, program_joined
from generators.small_fleets import small_fleet
from long_tests import examples, seeds

if TYPE_CHECKING:
    from collections.abc import Callable

CHUNKS = 6
PROGRAMS = examples(12)
INSTANTS = examples(6)
ONES_APART = examples(6)
FAST = ("-O0",)
APART = (48, 212, 269, 304)
"""Programs that a wrong reduction of ours got wrong."""
BROKEN = (108, 20076)
"""A contract is broken where others move in the same instant; two properties fail at once."""


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_explorer_and_enumerator_agree(chunk: int) -> None:
    for seed in seeds(chunk, PROGRAMS, CHUNKS):
        s = small(seed)
        if s is None:
            continue
        told = compared(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])


@pytest.mark.parametrize("seed", BROKEN)
def test_they_agree_on_what_is_violated_first_and_with_what(seed: int) -> None:
    s = small(seed)
    assert s is not None
    assert not compared(s, FAST).complaints, s.text


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_they_agree_on_steps_that_take_time(chunk: int) -> None:
    tried = 0
    wanted = seeds(chunk, PROGRAMS, CHUNKS)
    for seed in [*wanted, *seeds(PROGRAMS + chunk, 5_000, CHUNKS)]:
        if tried and seed not in wanted:
            break  # few programs have such a node: go on until one of them was compared
        s = small(seed, make=lasting_program)
        if s is None or "takes" not in s.text:
            continue
        tried += 1
        told = compared(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])
    assert tried


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_they_agree_on_parts_that_share_only_time(chunk: int) -> None:
    for seed in (*seeds(chunk, ONES_APART, CHUNKS), *APART[chunk::CHUNKS]):
        s = small(seed, make=program_apart)
        if s is None:
            continue
        told = compared(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_they_agree_on_instances_with_parameters_and_wires(chunk: int) -> None:
    for seed in seeds(chunk, PROGRAMS, CHUNKS):
        s = small(seed, make=small_fleet)
        if s is None:
            continue
        told = compared(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])


@pytest.mark.parametrize("make", [program_in_instants, program_joined])
@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_they_agree_where_actors_fall_into_groups_within_an_instant(
    chunk: int, make: Callable[[int], str]
) -> None:
    for seed in seeds(chunk, INSTANTS, CHUNKS):
        s = small(seed, make=make)
        if s is None:
            continue
        told = compared(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_they_agree_on_latches(chunk: int) -> None:
    tried = 0
    wanted = seeds(chunk, PROGRAMS, CHUNKS)
    for seed in [*wanted, *seeds(PROGRAMS + chunk, 5_000, CHUNKS)]:
        if tried and seed not in wanted:
            break  # not every program has a latch: go on until one of them was compared
        s = small(seed)
        if s is None or "returns " not in s.text:
            continue
        tried += 1
        told = compared(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])
    assert tried


@pytest.mark.parametrize(("returns", "unpressed"), [("after button", False), ("never", True)])
def test_they_agree_on_how_ac_gets_control_with_a_latch(returns: str, *, unpressed: bool) -> None:
    text = LATCHED.replace("RETURNS", returns)
    s = enumerated(0, text)
    assert not compared(s, FAST).complaints
    assert set(s.found.least) == {("property", 0)}, "AC gets control"
    for shown in ("false", "true"):
        s = enumerated(0, text.replace("choose bool", shown))
        assert not compared(s, FAST).complaints
        assert bool(s.found.least) == unpressed, "nobody presses, or the button sticks"


LATCHED = """soter 1;
topic u : int in [0, 1];
topic far : bool max_age 20ms;
topic button : bool max_age 20ms;
plant P period 10ms { reads u; drives far = s; state s: bool = true; next s = u == 0; }
plant Panel period 10ms { drives button = b; state b: bool; next b = choose bool; }
node A period 10ms { publishes u; step { publish u = 1; } }
node C period 10ms { publishes u; step { publish u = 0; } }
rta M { ac A; sc C; period 10ms; safe true; ttf !far; safer far; returns RETURNS; }
system S { p: P; panel: Panel; module M; }
test T { system S; horizon 30ms; never mode(M) == Mode.AC; }
"""

CLOCK = """
topic z : bool;
plant Clock period 10ms { drives z = s; state s: bool; next s = !s; }
"""
"""A part of the system that shares nothing with the others but time."""

LATER = """soter 1;
type Small = int in [0, 2];
topic x : bool;
topic y : Small;
node A period 40ms phase 10ms { publishes x; step { publish x = true; } }
node B period 40ms { subscribes x; publishes y; step { publish y = x ? 1 : 2; } }
system S { node A; node B; q: Clock; }
"""

SHARING_TIME = {
    "a moment that another part's step hides": LATER
    + "test T { system S; horizon 30ms; late B by 20ms;"
    " always z || !z; eventually (x && y == 0) || y == 2 within 30ms; }",
    "a moment that another part's step hides, owed": LATER
    + "test T { system S; horizon 30ms; late B by 20ms;"
    " always z || !z; x leadsto (x && y == 0) || y == 2 within 10ms; }",
    "a bound that passes while only another part moves": """soter 1;
topic x : bool;
topic go : bool = true;
node A period 20ms { publishes x; step { publish x = true; } }
node C period 20ms { publishes x; step { publish x = false; } }
rta M { ac A; sc C; period 20ms; safe go || !go; ttf !go; safer go; }
plant K period 20ms { drives go = s; state s: bool = true; next s = s; }
system S { module M; k: K; q: Clock; always z || !z; }
test T { system S; horizon 60ms; late M.dm by 35ms; always invariant(M); }
""",
    "a property that becomes false by time alone": """soter 1;
topic x : bool;
node A period 40ms { publishes x; step { publish x = true; } }
system S { node A; q: Clock; always z || !z; }
test T { system S; horizon 30ms; always !x || time < 0.015; }
""",
}


@pytest.mark.parametrize("name", SHARING_TIME)
def test_parts_of_a_system_share_time(name: str) -> None:
    """Violated only because a plant that shares nothing else lets time pass, or holds it."""
    s = enumerated(0, SHARING_TIME[name] + CLOCK)
    assert s.found.verdict == "violated"
    assert not compared(s, FAST).complaints


@pytest.mark.long
def test_what_is_compared_determines_the_future() -> None:
    """Telling worlds apart by everything the interpreter knows finds nothing more."""
    for seed in range(40):
        s = small(seed, 1_500)
        if s is None:
            continue
        try:
            whole = BruteForce(s.system, whole=True).run(8_000)
        except TooLargeError:
            continue
        assert whole.configurations == s.found.configurations, s.text
        assert whole.observed == s.found.observed, s.text
        assert whole.least == s.found.least, s.text
