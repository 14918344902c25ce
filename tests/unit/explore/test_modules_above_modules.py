"""Modules above modules in tests: every order and choice, and what the invariants are about."""

from __future__ import annotations

import pytest

from generators.explorer_agreement import compared, enumerated
from soter.diagnostics.diagnostic import SoterError
from unit.explore.random_walks import system_of_text

TOWER = """soter 1;
topic near: bool;
topic x: int in [0, 4] = 2;
topic u: int in [0, 2] = 1;
node Robot period 10ms {
  subscribes u; publishes x;
  var at: int in [0, 4] = 2;
  step { at = max(0, min(4, at + u - 1)); publish x = at; }
}
node Walker period 20ms { publishes near; step { publish near = choose bool; } }
node Any period 10ms { publishes u; step { publish u = choose { 0, 2 }; } }
node Home period 10ms {
  subscribes x; publishes u; step { publish u = x < 2 ? 2 : x > 2 ? 0 : 1; }
}
node Stop period 10ms { publishes u; step { publish u = 1; } }
rta Keep { ac Any; sc Home; period 10ms; safe x > 0 && x < 4; ttf x != 2; safer x == 2; }
rta Avoid { ac module Keep; sc Stop; period 20ms; safe SAFE; ttf near; safer !near; }
system S { node Robot; node Walker; module Avoid; }
test T { system S; TEST }
"""
TESTS = {
    "the modes": (
        "true",
        "horizon 20ms; never mode(Avoid) == Mode.SC && mode(Keep) == Mode.AC && x == 2;",
    ),
    "the robot": ("true", "horizon 10ms; skew 5ms; always x > 1;"),
    "lost decisions": ("true", "horizon 10ms; skip Avoid.Keep.dm; skip Avoid.dm; always x > 1;"),
    "a late SC below": (
        "true",
        "horizon 20ms; late Avoid.Keep.Home by 10ms; always x > 0 && x < 4;",
    ),
    "an overrun": ("true", "horizon 10ms; overrun Avoid.Keep.Home by 10ms; always x > 1;"),
    "the invariant": ("x < 4", "horizon 20ms; always invariant(Avoid);"),
    "the invariants": ("x < 3", "horizon 20ms; always invariants;"),
}


LARGE = ("the modes", "a late SC below", "the invariants")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] if n in LARGE else []) for n in TESTS]
)
@pytest.mark.long
@pytest.mark.long
@pytest.mark.long
def test_explorer_and_enumerator_agree_on_a_tower(name: str) -> None:
    safe, test = TESTS[name]
    s = enumerated(0, TOWER.replace("SAFE", safe).replace("TEST", test), 60_000)
    assert not compared(s, ("-O0",)).complaints


def test_the_mode_of_a_module_below_has_a_path() -> None:
    """Where a system is used twice its own name would mean two modules."""
    text = TOWER.replace("SAFE", "true").replace("system S {", "system One {")
    text = text.replace("test T {", "system S { for i in 0..2 { r[i]: One; } }\ntest T {")
    test = "horizon 10ms; never mode(r[1].Avoid.Keep) == Mode.AC && r[1].x == 2;"
    assert system_of_text(text.replace("TEST", test), "T").properties
    for wrong in ("r[1].Avoid.Avoid", "r[1].Keep", "r[1].Avoid.Keep.Keep", "Keep"):
        with pytest.raises(AssertionError, match=r"T002|M013"):
            system_of_text(text.replace("TEST", test.replace("r[1].Avoid.Keep", wrong)), "T")


def test_invariants_are_those_of_modules_below_none() -> None:
    system = system_of_text(
        TOWER.replace("SAFE", "true").replace("TEST", "horizon 20ms; always invariants;"), "T"
    )
    assert system.test is not None
    assert [t.text for t in system.test.timed] == ["invariant(Avoid)"]
    with pytest.raises(SoterError) as refused:
        enumerated(
            0,
            TOWER.replace("SAFE", "true").replace("TEST", "horizon 20ms; always invariant(Keep);"),
        )
    assert [d.code for d in refused.value.diagnostics] == ["M013"]
