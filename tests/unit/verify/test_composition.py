"""Modules together: what moves a plant of one is what another one guarantees."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.api import load
from soter.certificate.reading.problem import read_facts
from soter.certificate.rechecker import recheck
from soter.cli.main import main
from soter.language.front_end import check_file, system_of
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.problem.problem import assumption_texts
from soter.verify.proof_report import proof_page
from soter.verify.scope import composed_assumptions_of, coverage_of

if TYPE_CHECKING:
    from soter.verify.claims.results import VerifyReport

CONVOY = Path(__file__).resolve().parents[3] / "examples" / "generality" / "convoy.soter"
TEXT = CONVOY.read_text()
SAFE = "safe speed > SLOW && speed < FAST && lead >= SLOW && lead <= FAST;"
PUBLISHED = ("SafeLead", "published")
"""Nothing else says it: its plant stops where it would publish more, and C is no more than that."""
KEPT = ("SafeLead", "guaranteed")
COUPLED = """soter 1;
topic x: float in [-4.0, 4.0] max_age 20ms;
topic y: float in [-4.0, 4.0] max_age 20ms;
topic pull: float in [-0.5, 0.5];
topic push: float in [-0.5, 0.5];
topic u: float in [-1.0, 1.0];
topic w: float in [-1.0, 1.0];
plant X period 10ms {
  reads u, push; drives x = p; drives pull = 0.2 * p; state p: float; der p = u + push;
}
plant Y period 10ms {
  reads w, pull; drives y = p; drives push = 0.2 * p; state p: float; der p = w + pull;
}
node FastX period 20ms { publishes u; step { publish u = 1.0; } }
node SlowX period 20ms {
  subscribes x; publishes u; step { publish u = clamp(-2.0 * x, -1.0, 1.0); }
}
node FastY period 20ms { publishes w; step { publish w = 1.0; } }
node SlowY period 20ms {
  subscribes y; publishes w; step { publish w = clamp(-2.0 * y, -1.0, 1.0); }
}
rta KeepX {
  ac FastX; sc SlowX; period 20ms;
  safe x < 2.0 && x > -2.0 && pull <= 0.5 && pull >= -0.5;
  ttf abs(x) > 1.6; safer abs(x) < 1.3;
  verify { grid x in [-2.0, 2.0] / 100; }
}
rta KeepY {
  ac FastY; sc SlowY; period 20ms;
  safe y < 2.0 && y > -2.0 && push <= 0.5 && push >= -0.5;
  ttf abs(y) > 1.6; safer abs(y) < 1.3;
  verify { grid y in [-2.0, 2.0] / 100; }
}
system S { a: X; b: Y; module KeepX; module KeepY; until 20s; always a.truth.p < 2.0; }
"""
"""Each moves the other: neither keeps its set without what the other one guarantees."""


def verified(tmp_path: Path, text: str, module: str | None = None) -> VerifyReport:
    path = tmp_path / "program.soter"
    path.write_text(text)
    return load(path).verify(module, str(tmp_path / "cert"), refute=False)


def kept_by(tmp_path: Path, text: str) -> tuple[str, str]:
    """Who keeps `lead`, and how: without proofs."""
    path = tmp_path / "program.soter"
    path.write_text(text)
    checked = check_file(str(path))
    chosen = modules_of(checked, None, None, {})
    guarantees = coverage_of(checked, chosen, problems_of(chosen), {}).guarantees
    return next((g.by, g.how) for g in guarantees if g.what.startswith("b.lead"))


def whose(report: VerifyReport, what: str) -> tuple[str, bool]:
    return next((t.why, t.open) for t in composed_assumptions_of(report) if t.what.startswith(what))


@pytest.mark.long
def test_the_convoy_is_proved_and_rechecked(tmp_path: Path) -> None:
    report = verified(tmp_path, TEXT)
    assert (report.verdict, report.together) == ("proved", "proved")
    assert whose(report, "b.lead in [2, 12]") == ("`safe` of SafeLead: proved", False)
    said = [a for a in assumption_texts(report["SafeGap"].assumptions) if "b.lead" in a]
    assert len(said) == 1
    assert said[0].startswith("what others publish and what moves these plants stays in its")
    report_page = proof_page(report)
    assert report_page.together == "proved"
    assert ("b.lead in [2, 12]", False) in [(t.what, t.open) for t in report_page.taken]
    checked = recheck(tmp_path / "cert")
    assert checked.accepted, checked.reason
    assert checked.safe
    assert said[0] in checked.assumptions


@pytest.mark.long
def test_modules_may_lean_on_each_other(tmp_path: Path) -> None:
    report = verified(tmp_path, COUPLED)
    assert (report.verdict, report.together) == ("proved", "proved")
    assert whose(report, "a.push") == ("`safe` of KeepY: proved", False)
    assert whose(report, "b.pull") == ("`safe` of KeepX: proved", False)
    assert recheck(tmp_path / "cert").safe


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (SAFE.replace(" && lead >= SLOW", ""), PUBLISHED),
        (SAFE.replace("lead >= SLOW", "lead >= SLOW - 0.1"), PUBLISHED),
        (SAFE.replace("lead >= SLOW", "(lead >= SLOW || speed < FAST)"), PUBLISHED),
        (SAFE.replace("lead >= SLOW", "!(lead <= SLOW)"), PUBLISHED),
        (SAFE.replace("lead <= FAST", "lead <= FAST + 0.1"), PUBLISHED),
        (SAFE.replace("lead >= SLOW", "SLOW <= lead"), KEPT),
        (SAFE.replace("lead >= SLOW", "lead > SLOW"), KEPT),
    ],
)
def test_only_what_safe_says_by_itself_is_guaranteed(
    tmp_path: Path, wrong: str, why: tuple[str, str]
) -> None:
    assert SAFE in TEXT
    assert kept_by(tmp_path, TEXT.replace(SAFE, wrong)) == why


def test_an_error_of_what_is_published_counts(tmp_path: Path) -> None:
    text = TEXT.replace("measured speed within 0.05;", "measured lead within 0.01;")
    assert kept_by(tmp_path, text) == PUBLISHED


def test_of_what_one_plant_publishes_all_modules_say_the_same(tmp_path: Path) -> None:
    """`pull` is read by the other plant alone: KeepX proves it, and is named to KeepY."""
    unsaid = COUPLED.replace(" && pull <= 0.5 && pull >= -0.5", "")
    unsaid = unsaid.replace("ttf abs(x) > 1.6; safer abs(x) < 1.3;", "")
    report = verified(tmp_path, unsaid.replace("pull = 0.2 * p", "pull = 0.4 * p"))
    assert (report.verdict, report.together) == ("proved", "proved")
    assert whose(report, "b.pull") == ("its plant can publish no more, by KeepX: proved", False)
    (core,) = report["KeepX"].cases[0].proofs
    kept = core.found.core > 0
    ends = core.engine.edges[0][[kept.argmax(), len(kept) - kept[::-1].argmax()]]
    assert 0.0 < 0.4 * max(abs(ends)) <= 0.5
    wider = report["KeepX"].notes
    assert any("`pull` takes only [-0.5, 0.5]" in n for n in wider)
    alone = verified(tmp_path, unsaid, "KeepY")
    assert whose(alone, "b.pull")[1]


@pytest.mark.long
def test_a_guarantee_that_is_not_proved_leaves_the_conjunction_open(tmp_path: Path) -> None:
    text = TEXT.replace("publish first = clamp(6.0 - speed,", "publish first = clamp(20.0 - speed,")
    report = verified(tmp_path, text)
    assert report["SafeLead"].verdict == "undecided"
    assert report["SafeGap"].verdict == "proved"
    assert report.together == "undecided"
    assert whose(report, "b.lead") == ("`safe` of SafeLead: undecided", True)
    alone = verified(tmp_path, text, "SafeGap")
    assert (alone.verdict, alone.together) == ("proved", "assumed")
    assert whose(alone, "b.lead") == ("`safe` of SafeLead: not verified here", True)


@pytest.mark.long
def test_a_weaker_guarantee_proves_less(tmp_path: Path) -> None:
    report = verified(tmp_path, TEXT.replace("SLOW: float = 2.0", "SLOW: float = 0.9"))
    assert report["SafeLead"].verdict == "proved"
    assert report["SafeGap"].verdict == "undecided"
    assert report.together == "undecided"


def test_what_a_node_publishes_is_enforced(tmp_path: Path) -> None:
    text = TEXT.replace("  drives lead = v;\n", "").replace(
        "system Protected",
        "node Wild period 50ms { subscribes speed; publishes lead; "
        "step { publish lead = speed > 5.0 ? SLOW : FAST; } }\nsystem Protected",
    )
    text = text.replace("  b: Follow;\n", "  b: Follow;\n  node Wild;\n")
    text = text.replace(" && lead >= SLOW && lead <= FAST", "")
    assert kept_by(tmp_path, text) == ("node `Wild`", "enforced")


@pytest.mark.long
def test_the_terminal_shows_who_keeps_what(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(CONVOY)]) == 0
    out = capsys.readouterr().out
    assert "assumed, for as long as the trusted part runs" in out
    assert "at all times" not in out
    assert "all of them together (Theorem 4.1)  PROVED" in out
    assert "`safe` of SafeLead: proved" in out


@pytest.mark.long
def test_prover_and_rechecker_name_the_same_influences_by_themselves(tmp_path: Path) -> None:
    text = COUPLED.replace(
        "topic pull: float in [-0.5, 0.5];",
        "type F = { a: float, b: float };\ntopic pull: F in { a in [-0.5, 0.5], b in [0.0, 0.0] };",
    )
    text = text.replace("drives pull = 0.2 * p;", "drives pull = { a: 0.2 * p, b: 0.0 };")
    text = text.replace("w + pull;", "w + pull.a + pull.b;").replace("&& pull <=", "&& pull.a <=")
    text = text.replace("pull >= -0.5", "pull.a >= -0.5 && pull.b >= 0.0 && pull.b <= 0.0")
    report = verified(tmp_path, text)
    assert report.together == "proved"
    path = tmp_path / "program.soter"
    flat = system_of(check_file(str(path)), "S")
    for name in ("KeepX", "KeepY"):
        facts = read_facts(flat, name)
        problem = report[name].problem
        own = [(d.name, d.low, d.high) for d in facts.disturbances]
        pairs = zip(problem.quantities.disturbances, problem.disturbances, strict=True)
        assert own == [(d.name, r.low, r.high) for d, r in pairs]
    assert [d.name for d in read_facts(flat, "KeepY").disturbances] == ["b.pull.a", "b.pull.b"]
