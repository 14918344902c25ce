"""Numbers that would leave the range of doubles where nobody computes them, or where one does.

A law is read once for the whole grid: what stands behind a condition is read there for states, too,
for which it never runs. That it stays a double is shown where it runs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import recheck
from soter.certificate.extras.prelude_functions import prelude_function
from soter.certificate.reading.symbolic_operations import Operations
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.terms import Terms
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
topic pos: float max_age 50ms;
topic u: float in [-1.0, 1.0] = 0.0;
fun squared(x: float): float { return x * x; }
fun law(x: float): float { return LAW; }
plant P period 10ms {
  reads u;
  drives pos = x;
  state x: float in [-0.05, 0.05];
  disturbance w: float in [-0.1, 0.1];
  der x = u + w;
}
node Any period 100ms { publishes u; step { publish u = choose { -1.0, 1.0 }; } }
node Safe period 100ms { subscribes pos; publishes u; step { publish u = law(pos); } }
rta M {
  ac Any; sc Safe; period 100ms;
  safe pos > -3.0 && pos < 3.0;
  verify { grid pos in [-3.0, 3.0] / 120; levels 2; }
}
system S default { p: P; module M; until 60s; }
"""
LAWS = {
    "exp": (
        "x > 0.0 ? (exp(-400.0 * x) - exp(-400.0 * x) < 1.0 ? -1.0 : 1.0) : 0.5",
        ("x > 0.0 ?", "x > -2.5 ?"),
    ),
    "a product": (
        "x > 0.0 ? -1.0 : 0.25 + 0.25 * min(exp(200.0 * x) * exp(210.0 * x), 1.0)",
        ("x > 0.0 ?", "x > 2.5 ?"),
    ),
    "a square": (
        "x > 0.0 ? -1.0 : 0.5 * min(squared(exp(230.0 * x)) + 1.0, 1.0)",
        ("> 0.0", "> 2.5"),
    ),
    "exp of exp": (
        "x < 0.5 ? (exp(exp(4.0 * x)) > 2.0 ? -0.5 * max(x, -1.0) : 0.5) : -1.0",
        ("x < 0.5", "x < 2.5"),
    ),
}
"""A law, and what to change so that a state of the same sets computes what is no double."""


def proved(tmp_path: Path, law: str) -> Path:
    path = tmp_path / "far.soter"
    path.write_text(PROGRAM.replace("LAW", law))
    (module,) = soter.load(path).verify(cert=tmp_path / "cert", refute=False).modules
    assert module.findings["P2a"].verdict == "proved"
    return tmp_path / "cert"


@pytest.mark.parametrize("name", LAWS)
def test_what_never_runs_is_no_number_that_leaves(tmp_path: Path, name: str) -> None:
    law, change = LAWS[name]
    folder = proved(tmp_path, law)
    report = recheck(folder)
    assert report.accepted, report.reason
    small_proofs.edit_program(folder, change)
    report = recheck(folder)
    assert not report.accepted


def test_an_infinite_number_that_is_only_compared_is_greater_than_any(tmp_path: Path) -> None:
    """`exp(-400.0 * x)` is infinite from x = -1.78 down, and more than 0 there."""
    folder = proved(tmp_path, "x > 0.0 ? (exp(-400.0 * x) > 0.0 ? -1.0 : 1.0) : 0.5")
    law = soter.load(tmp_path / "far.soter").function("law")
    assert [law(x) for x in (0.5, 1.5)] == [-1.0, -1.0]
    small_proofs.edit_program(folder, ("x > 0.0 ?", "x > -2.5 ?"))
    report = recheck(folder)
    assert report.accepted, report.reason


@pytest.mark.parametrize("ends", [(-1.0, 1.0), (0.5, 2.0), (1.7, 1.8), (-3.0, 3.0)])
def test_the_obligation_is_that_of_the_machine(ends: tuple[float, float]) -> None:
    """exp(400 x), read for x in [-3, 3], is a double on a box, or nobody says that it is."""
    terms = Terms()
    x = terms.add_input("state", "x", exact(-3.0), exact(3.0))
    value = prelude_function(
        Operations(terms, rounded=True), "exp", terms.combine(((exact(400.0), x),))
    )
    (index,) = x.terms
    assert terms.obligations == []
    decide = compile_truths(terms, [index], value.beyond, {})
    box = [(exact(ends[0]), exact(ends[1]))]
    certain = all(d == 2 for d in decide(form_of_box(box, symbols=False)))
    assert certain == (400.0 * ends[1] < 1023 * math.log(2.0))
    assert value.high > exact(2.0**1023)
