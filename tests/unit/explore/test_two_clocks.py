"""Several times that are compared at once: the grid is fine enough, or nothing is called clean."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

import pytest

from generators.brute_force import enumerate_all
from long_tests import examples, seeds
from soter.explore.command import TraceHeader, explore_test
from soter.explore.search_options import SearchOptions
from soter.language.elaborate.distinguishable_values import FINEST
from soter.language.elaborate.time_grid import quantum_of, times_read
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from soter.explore.results import TestResult

PROGRAMS = examples(16)
MS = 1_000_000

PROGRAM = """soter 1;
topic x: bool = false;
topic y: bool = false;
topic z: bool = false;
node A period 20ms {{ publishes x; step {{ publish x = true; }} }}
node B period 20ms {{ publishes y; step {{ publish y = true; }} }}
node C period 20ms {{ subscribes x, y; publishes z; step {{ publish z = {step}; }} }}
system S {{ node A; node B; node C; until 1s; }}
test T {{ system S; {late} horizon {horizon}ms; {quantum}never {never}; }}
"""
LATE = "late A by 5ms; late B by 5ms; late C by 5ms;"
ALL = "x && y && z && "


def text(
    never: str, *, step: str = "true", late: str = LATE, horizon: int = 19, quantum: str = ""
) -> str:
    return PROGRAM.format(never=never, step=step, late=late, horizon=horizon, quantum=quantum)


def found(source: str) -> TestResult:
    checked = check_file("small.soter", source)
    return explore_test(
        system_of_test(checked, "T"), SearchOptions(minimise=0), TraceHeader("small.soter", {})
    )


def is_violated(source: str) -> bool:
    """By the enumerator, which shares no code with the search."""
    flat = system_of_test(check_file("small.soter", source), "T")
    return enumerate_all(flat).verdict == "violated"


APART = {
    "two ages apart": ALL + "age(y) > 0.0 && age(x) > age(y) && age(x) < 0.005",
    "a difference of ages": ALL + "age(y) > 0.0 && age(x) - age(y) > 0.0 && age(x) < 0.005",
    "two ages and the time": ALL
    + "age(y) > 0.0 && age(x) > age(y) && time < 0.005 && time > age(x)",
}


@pytest.mark.parametrize("never", APART.values(), ids=list(APART))
def test_two_clocks_that_lie_apart_between_two_thresholds(never: str) -> None:
    """On half of what the times have in common they were clean."""
    coarse = text(never, quantum="quantum 2500us; ")
    assert not is_violated(coarse)
    assert found(text(never)).verdict == "violated"


def comparing(seed: int, quantum: str = "") -> str:
    """A random property that compares the ages of topics, and the time."""
    dice = Random(seed)  # noqa: S311 - the same programs every time are wanted
    clocks = ["age(x)", "age(y)", "time", "age(z)"][: dice.choice((2, 3, 4))]
    compared = []
    for _ in range(dice.choice((2, 3, 4))):
        one, other = dice.sample(clocks, 2)
        against = dice.choice((other, "0.0", "0.005", "0.005", "0.01"))
        compared.append(f"{one} {dice.choice('<>')} {against}")
    late = dice.choice((LATE, LATE, LATE.replace("late B by 5ms;", ""), "skew 5ms;"))
    return text(ALL + " && ".join(compared), late=late, quantum=quantum)


@pytest.mark.parametrize("chunk", range(4))
@pytest.mark.random
def test_a_finer_grid_finds_no_more(chunk: int) -> None:
    verdicts = []
    for seed in seeds(chunk, PROGRAMS, 4):
        own = comparing(seed)
        flat = system_of_test(check_file("small.soter", own), "T")
        assert times_read(flat).together <= FINEST
        violated = is_violated(own)
        verdicts.append(violated)
        if not violated:
            quantum = quantum_of(flat)
            for parts in (2, 5):
                finer = comparing(seed, f"quantum {quantum // parts}ns; ")
                assert not is_violated(finer), (seed, parts, own)
    assert len(verdicts) >= 1


def test_they_are_of_both_kinds() -> None:
    assert {is_violated(comparing(seed)) for seed in range(12)} == {True, False}


def test_where_steps_compare_again_and_again_no_grid_is_called_fine_enough() -> None:
    """A chain of strict comparisons is as long as there are steps."""
    source = text("z && !z", step="age(x) > 0.003 && age(y) < 0.004", horizon=100)
    result = found(source)
    assert (result.verdict, result.bound) == ("bound", "grid")
    assert any(line.startswith("more times are compared") for line in result.assumptions)
    declared = source.replace("never", "quantum 1ms; never")
    assert found(declared).bound != "grid", "who declares a grid takes it for granted"


AGAIN = """soter 1;
topic t: int in [0, 1] = 0;
topic bad: bool = false;
node M period 40ms { publishes t; step { publish t = 1; } }
node N period 10ms phase 5ms {
  subscribes t; publishes bad;
  var early: bool = false;
  step {
    if age(t) > 0.015 && early { publish bad = true; }
    early = age(t) < 0.005;
  }
}
system S { node M; node N; until 1s; }
test T { system S; skew 1ms; horizon 18ms; QUANTUM never bad; }
"""


def test_one_clock_that_two_steps_compare() -> None:
    """t < 5 ms old at 5 ms, and > 15 ms old at 16 ms: it came between the milliseconds."""
    assert not is_violated(AGAIN.replace("QUANTUM", "quantum 1ms;"))
    assert is_violated(AGAIN.replace("QUANTUM", "quantum 500us;"))
    assert found(AGAIN.replace("QUANTUM", "")).verdict == "violated"


def test_who_is_on_time_needs_no_finer_grid() -> None:
    """Of one clock that is compared with constants half a grid is enough, as ever."""
    alone = text("z && age(x) > 0.003 && age(x) < 0.004", late="late C by 5ms;")
    flat = system_of_test(check_file("small.soter", alone), "T")
    assert quantum_of(flat) == MS // 2


BEFORE_THE_END = """soter 1;
topic x: bool = false;
topic z: bool = false;
node P period 5ms { publishes x; step { publish x = true; } }
node Q period 50ms { publishes z; step { publish z = true; } }
system S { node P; node Q; never age(x) > 0.004; }
test T { system S; horizon 20ms; late Q by 5ms; }
"""
"""Seen only between 4 and 5 ms: at 5 ms P has to step before anything can be seen."""
IN_THE_LAST_PART = """soter 1;
topic u: int in [0, 1] = 0;
topic w: bool = false;
node Fast period 20ms { publishes u; step { publish u = 1; } }
node Slow period 20ms { publishes u; step { publish u = 0; } }
node W period 20ms {
  publishes w;
  var n: int in [0, 9] = 0;
  step { n = min(n + 1, 9); publish w = n == 2; }
}
rta M { ac Fast; sc Slow; period 20ms; safe true; ttf w; safer !w; }
system S { node W; module M; }
test T { system S; horizon 100ms; skew 2ms; always invariant(M); }
"""
"""SC comes 2 ms too late; at 2 ms it has to come before anything can be seen."""
ON_TIME = (
    "soter 1;"
    + "".join(
        f"topic {t}: bool;\n"
        f"node {t.upper()} period 20ms {{ publishes {t}; step {{ publish {t} = true; }} }}\n"
        for t in "abcd"
    )
    + """topic z: bool;
node R period 20ms phase 5ms {
  subscribes a, b, c, d;
  publishes z;
  step {
    publish z = a && b && c && d && age(a) > age(b) && age(b) > age(c) && age(c) > age(d);
  }
}
system S { node A; node B; node C; node D; node R; never z; }
test T { system S; horizon 19ms; late A by 5ms; late B by 5ms; late C by 5ms; late D by 5ms; }
"""
)
"""Who compares is never late; what is compared are four times that are."""
TOO_COARSE = {
    "seen before a window ends": BEFORE_THE_END,
    "an invariant": IN_THE_LAST_PART,
    "ages that a step on time compares": ON_TIME,
}


@pytest.mark.whole
@pytest.mark.parametrize("source", TOO_COARSE.values(), ids=list(TOO_COARSE))
def test_where_a_grid_once_was_too_coarse(source: str) -> None:
    flat = system_of_test(check_file("small.soter", source), "T")
    assert enumerate_all(flat).verdict == "violated"
    assert found(source).verdict == "violated"


def test_what_never_comes_is_looked_at_in_every_configuration() -> None:
    """That no age grows to 9 ms is a chain of strict comparisons, one of each publication."""
    source = """soter 1;
topic x: bool;
topic z: bool;
node X period 20ms { publishes x; step { publish x = true; } }
node Z period 20ms phase 10ms { publishes z; step { publish z = true; } }
system S { node X; node Z; }
test T {
  system S;
  horizon 79ms;
  skew 8ms;
  eventually x && z && (age(x) >= 0.009 || age(z) >= 0.009) within 79ms;
}
"""
    result = found(source)
    assert (result.verdict, result.bound) == ("bound", "grid")
    assert found(source.replace("skew", "quantum 125us; skew")).verdict == "violated"
