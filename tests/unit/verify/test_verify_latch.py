"""Proofs of modules with a latch: all but P2b stays as it was, and P2b says what it rests on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from long_tests import some
from soter.api.program import load
from soter.api.rechecking import recheck
from soter.language.front_end import check_file, system_of
from soter.verify.deploy.dm_check import check_decisions
from soter.verify.refute import enter_refutations
from unit.certificate.small_proofs import edit_program, reseal

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

pytest.importorskip("flint")

CART = """soter 1;
topic pos: float in [-9.0, 9.0] max_age 20ms;
topic speed: float in [-1.0, 1.0] = 0.0;
input topic button: bool max_age 2s;
plant Cart period 10ms { reads speed; drives pos = x; state x: float; der x = speed; }
node Fast period 10ms { publishes speed; step { publish speed = 1.0; } }
node Back period 10ms {
  subscribes pos;
  publishes speed;
  step { publish speed = clamp(-pos, -1.0, 1.0); }
}
rta Guard {
  ac Fast;
  sc Back;
  period 20ms;
  safe abs(pos) < 2.0;
  ttf abs(pos) > 1.5;
  safer abs(pos) < 1.0;
  RETURNS
  verify { grid pos in [-2.0, 2.0] / 80; }
}
system Lane default { c: Cart; module Guard; input button every 100ms; until 1s; }
"""
PLANNER = """soter 1;
type Plan = enum { Hover, Around, ThroughBuilding };
topic candidate: Plan;
topic inForce: Plan;
input topic button: bool max_age 2s;
fun good(p: Plan): bool { return p != Plan.ThroughBuilding; }
node Any period 10ms { publishes candidate; step { publish candidate = choose Plan; } }
node Hold period 10ms { publishes candidate; step { publish candidate = Plan.Hover; } }
node Follower period 10ms {
  subscribes candidate;
  publishes inForce;
  var plan: Plan;
  step {
    if age(candidate) > seconds(30ms) { plan = candidate; }
    publish inForce = plan;
  }
}
rta Guard {
  ac Any;
  sc Hold;
  period 20ms;
  safe good(inForce);
  ttf !good(candidate);
  safer good(candidate);
  RETURNS
  verify { induction; lemma good(candidate) || age(candidate) <= seconds(30ms); }
}
system S default { node Follower; module Guard; input button every 100ms; until 1s; }
"""
AFTER, NEVER = "returns after button;", "returns never;"
ASSUMED = (
    "P2b: the operator acknowledges: a press of button is in force when `safer` holds; without "
    "one SC keeps control"
)
BOTH = pytest.mark.parametrize("text", [CART, PLANNER], ids=["by a grid", "by induction"])


def proved(tmp_path: Path, text: str, returns: str, *, refute: bool = False) -> ModuleResult:
    """The module of a program, verified; its certificate lies in `cert`."""
    pytest.importorskip("z3")
    program = tmp_path / "program.soter"
    program.write_text(text.replace("RETURNS", returns))
    (module,) = load(program).verify(cert=tmp_path / "cert", refute=refute).modules
    return module


def verdicts(module: ModuleResult) -> dict[str, str]:
    return {name: finding.verdict for name, finding in module.findings.items()}


@BOTH
def test_a_latch_changes_nothing_but_what_p2b_rests_on(tmp_path: Path, text: str) -> None:
    plain = proved(tmp_path, text, "")
    after = proved(tmp_path, text, AFTER)
    assert verdicts(after) == verdicts(plain)
    assert after.findings["P2b"].verdict == "proved"
    more = [a.text for a in after.assumptions if a not in plain.assumptions]
    assert more == [ASSUMED]
    assert after.findings["P2b"].text == plain.findings["P2b"].text + ", if it is acknowledged"


@BOTH
def test_what_never_returns_is_not_asked_to(tmp_path: Path, text: str) -> None:
    plain, never = proved(tmp_path, text, ""), proved(tmp_path, text, NEVER)
    assert never.findings["P2b"].verdict == "assumed"
    assert "not asked: `returns never`" in never.findings["P2b"].text
    assert verdicts(never) | {"P2b": "proved"} == verdicts(plain)
    assert ASSUMED not in [a.text for a in never.assumptions]


@BOTH
def test_the_certificate_is_accepted_with_the_same_assumption(tmp_path: Path, text: str) -> None:
    proved(tmp_path, text, AFTER)
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason
    (module,) = report.modules
    assert "P2b" in module.confirmed
    assert [a.key for a in module.assumptions if "acknowledged" in a.key] == ["acknowledged button"]


@BOTH
def test_a_certificate_that_claims_a_return_that_never_comes_is_rejected(
    tmp_path: Path, text: str
) -> None:
    proved(tmp_path, text, AFTER)
    manifest = edit_program(tmp_path / "cert", (AFTER, NEVER))
    reseal(tmp_path / "cert", manifest)
    report = recheck(tmp_path / "cert")
    assert not report.accepted
    assert "returns never" in report.reason


@BOTH
def test_without_that_claim_it_is_accepted(tmp_path: Path, text: str) -> None:
    proved(tmp_path, text, NEVER)
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason
    assert "P2b" not in report.modules[0].confirmed
    assert report.safe


@BOTH
def test_the_certificate_of_another_program_is_rejected(tmp_path: Path, text: str) -> None:
    """Of one without a latch, its program changed and its seal left."""
    proved(tmp_path, text, "")
    program = tmp_path / "cert" / "program" / "program.soter"
    program.write_text(program.read_text().replace("  verify {", f"  {AFTER}\n  verify {{"))
    assert not recheck(tmp_path / "cert").accepted


WRONG = {
    "a `ttf` that comes too late": ("ttf abs(pos) > 1.5", "ttf abs(pos) > 1.99", "P3"),
    "a `safer` outside": ("safer abs(pos) < 1.0", "safer abs(pos) < 2.5", "safer"),
    "an SC that runs away": ("clamp(-pos, -1.0, 1.0)", "1.0", "P2a"),
    "an SC that never comes back": ("clamp(-pos, -1.0, 1.0)", "0.0", "P2b"),
}


@pytest.mark.parametrize("returns", [AFTER, NEVER])
@pytest.mark.parametrize("what", some(sorted(WRONG), 4))
def test_what_is_wrong_is_not_proved_with_a_latch(tmp_path: Path, what: str, returns: str) -> None:
    old, new, claim = WRONG[what]
    assert old in CART
    module = proved(tmp_path, CART.replace(old, new), returns)
    assert module.findings[claim].verdict != "proved"


@pytest.mark.whole
def test_nobody_who_acknowledges_is_no_counterexample_of_the_way_back(tmp_path: Path) -> None:
    """A run in which nothing was pressed refutes nothing; one in which `safer` never holds does."""
    quiet = CART.replace(" input button every 100ms;", "")
    module = proved(tmp_path, quiet, AFTER)
    finding = module.findings["P2b"]
    finding.weaken_to("undecided", "told so")
    enter_refutations(module.problem, module)
    assert finding.verdict == "undecided"
    stays = quiet.replace("clamp(-pos, -1.0, 1.0)", "0.0")
    assert proved(tmp_path, stays, AFTER, refute=True).findings["P2b"].verdict == "refuted"


# ---------------------------------------------------------------- the compiled decision module

MUTANTS = {
    "nobody is asked": ("returns = soter_acknowledged(", "returns = true || soter_acknowledged("),
    "it looks while AC has control": ("m->mode == SOTER_SC)", "m->mode >= SOTER_SC)"),
    "the button is negated": ("s->topics.button,", "!s->topics.button,"),
    "another age is looked at": ("s->stamps[2], s", "s->stamps[1], s"),
    "a press counts for ever": (" 2000000000)", " INT64_C(2000000000000000))"),
    "a press counts too short": (" 2000000000)", " 1999999999)"),
    "a press is not used up": ("after == SOTER_AC ? SOTER_NEVER", "after == SOTER_AC ? 1"),
    "the takeover is not noted": ("SOTER_NEVER : s->header.ct", "SOTER_NEVER : 0"),
    "the latch is not asked": ("      returns);", "      (returns || true));"),
}


def mutated(returns: str, old: str, new: str) -> str:
    """The verdict on the DM of the cart whose C was changed."""
    checked = check_file("p.soter", CART.replace("RETURNS", returns))

    def change(source: str) -> str:
        assert old in source, source
        return source.replace(old, new)

    (check,) = check_decisions(system_of(checked, None), change=change)
    return check.verdict


@pytest.mark.parametrize("returns", [AFTER, NEVER])
def test_the_dm_of_a_latch_is_as_it_should_be(returns: str) -> None:
    assert mutated(returns, "clean", "clean") == "proved"


@pytest.mark.parametrize("what", MUTANTS)
def test_a_changed_latch_is_refuted(what: str) -> None:
    assert mutated(AFTER, *MUTANTS[what]) == "refuted"


@pytest.mark.parametrize(
    "change",
    [("Guard_latch == 0", "Guard_latch != 0"), ("Guard_latch = 1", "Guard_latch = 0")],
)
def test_a_changed_dm_that_returns_never_is_refuted(change: tuple[str, str]) -> None:
    assert mutated(NEVER, *change) == "refuted"
