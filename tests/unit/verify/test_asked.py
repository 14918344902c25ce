"""What was asked is judged: the system that is meant, and P2b only where it is asked for."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify import refute as refutations
from soter.verify.command import verify
from soter.verify.problem.extract import extract
from soter.verify.refute import search_leaving_run
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from soter.verify.claims.results import VerifyReport

CART = """soter 1;
topic pos: float max_age 20ms;
topic speed: float in [-2.0, 2.0] = 0.0;
node Fast period 10ms { subscribes pos; publishes speed; step { publish speed = 2.0 - 0.0 * pos; } }
node Stop period 10ms { publishes speed; step { publish speed = 0.0; } }
rta Guard {
  ac Fast; sc Stop; period 20ms;
  safe pos < 1.0 && pos > -1.0; ttf abs(pos) > 0.5; safer abs(pos) < 0.4;
  verify { recover never; grid pos in [-1.2, 1.2] / 120; }
}
plant Cart period 10ms { reads speed; drives pos = x; state x: float; der x = speed; }
system Lane { c: Cart; module Guard; }
"""
TWO = "system Two { r[0]: Lane; r[1]: Lane; until 1s; }\n"
CONTROL = "system Control default { r[0]: Lane; r[1]: Lane; force r[1].Guard ac; until 1s; }\n"


def report_of(text: str, **options: str) -> VerifyReport:
    checked = check_file("asked.soter", text)
    assert checked.ok, checked.diagnostics.items
    return verify(checked, **options)  # type: ignore[arg-type]


def test_a_module_that_the_default_system_forces_sends_nobody_to_another_system() -> None:
    with pytest.raises(SoterError) as raised:
        report_of(CART + TWO + CONTROL)
    assert [d.code for d in raised.value.diagnostics] == ["R019"]
    assert "`r[1].Guard` is forced to AC in system `Control`" in str(
        raised.value.diagnostics[0].message
    )


def test_another_module_of_that_system_and_another_system_can_be_asked_for() -> None:
    one = report_of(CART + TWO + CONTROL, module="r[0].Guard")
    assert [(one.system, m.name) for m in one.modules] == [("Control", "r[0].Guard")]
    assert any("forced to AC" in text for text in one.coverage.rest)
    assert report_of(CART + TWO + CONTROL, system="Two").system == "Two"


def test_what_is_not_asked_is_never_refuted(monkeypatch: pytest.MonkeyPatch) -> None:
    """An SC that only stops, where no K is found: P2b is not asked all the same."""
    coasting = CART.replace(
        "drives pos = x; state x: float; der x = speed;",
        "drives pos = x; state x: float; state v: float; der x = v; der v = 40.0 * (speed - v);",
    ).replace("/ 120;", "/ 60, c.v in [-2.0, 2.0] / 8;")
    monkeypatch.setattr(
        refutations, "search_leaving_run", partial(search_leaving_run, budget_s=0.1)
    )
    flat = system_to_prove(check_file("asked.soter", coasting), "Lane")
    module_result = verify_module(extract(flat, flat.modules[0]), explain=False)
    assert module_result.findings["P2a"].verdict == "undecided"
    assert module_result.findings["P2b"].verdict == "assumed"
    assert "not asked" in module_result.findings["P2b"].text


def test_modules_that_can_be_proved_by_themselves_are_named() -> None:
    program = Path(__file__).resolve().parents[3] / "examples" / "fleet" / "claims_proof.soter"
    checked = check_file(str(program), program.read_text())
    with pytest.raises(SoterError) as refused:
        verify(checked)
    for diagnostic in refused.value.diagnostics:
        assert diagnostic.code == "R017"
        assert diagnostic.helps[-1] == "`--module` takes one by itself: a.Disjoint"
    with pytest.raises(SoterError) as refused:
        verify(checked, module="b.Keep")
    assert not any("--module" in str(h) for d in refused.value.diagnostics for h in d.helps)
