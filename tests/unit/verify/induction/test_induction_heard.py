"""Inductions beside plants: nodes that hear them are left out, and say anything at any time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.api.program import load
from soter.certificate.rechecker import recheck
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

pytest.importorskip("z3")

PROGRAM = """soter 1;
type Plan = enum { Hover, Around, ThroughBuilding };
topic place: float;
topic wish: Plan;
topic candidate: Plan;
topic inForce: Plan;
fun PhiPlan(p: Plan): bool { return p != Plan.ThroughBuilding; }
fun Best(p: Plan): Plan { return PhiPlan(p) ? p : Plan.Hover; }
plant Vehicle period 10ms {
  drives place = p; state p: float; disturbance w: float in [-1.0, 1.0]; der p = w;
}
node Dispatch period 10ms {
  subscribes place;
  publishes wish;
  step { publish wish = place > 0.0 ? Plan.Hover : Plan.Around; }
}
node RRTStar period 10ms { publishes candidate; step { publish candidate = choose Plan; } }
node Known period 10ms {
  subscribes wish;
  publishes candidate;
  step { publish candidate = Best(wish); }
}
node Follower period 10ms {
  subscribes candidate, wish;
  publishes inForce;
  var plan: Plan;
  step {
    if PhiPlan(candidate) { plan = candidate; }
    publish inForce = plan;
  }
}
rta SafePlanner {
  ac RRTStar;
  sc Known;
  period 20ms;
  safe PhiPlan(inForce);
  ttf !PhiPlan(candidate);
  safer candidate == Best(wish);
  verify { induction; }
}
system S { v: Vehicle; node Dispatch; node Follower; module SafePlanner; until 160ms; }
"""
OTHER_SOURCE = ("if PhiPlan(candidate) { plan = candidate; }", "plan = wish;")
MOVES = (
    ("var plan: Plan;", "var plan: Plan; var seen: Plan; var known: bool;"),
    (
        OTHER_SOURCE[0],
        """plan = known && wish != seen ? Plan.ThroughBuilding : Plan.Hover;
    seen = wish; known = true;""",
    ),
)
LEMMA = ("induction;", "induction; lemma PhiPlan(wish);")
QUEUED = (
    ("topic wish: Plan;", "topic wish: Plan;\ntopic near: bool;"),
    (
        "node Dispatch period 10ms {\n  subscribes place;",
        """node Sensor period 10ms {
  subscribes place; publishes near; step { publish near = place > 0.0; } }
node Dispatch period 10ms {\n  subscribes near queue 2 drop_oldest; var is: bool;""",
    ),
    ("step { publish wish = place > 0.0 ?", "step { for n in near { is = n; } publish wish = is ?"),
    ("node Dispatch;", "node Sensor; node Dispatch;"),
)
ALONE = (("subscribes place;\n", ""), ("place > 0.0 ? Plan.Hover : Plan.Around", "Plan.Around"))


def verified(tmp_path: Path, *changes: tuple[str, str]) -> ModuleResult:
    text = PROGRAM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "p.soter").write_text(text)
    report = load(tmp_path / "p.soter").verify(cert=str(tmp_path / "cert"), refute=False)
    return report["SafePlanner"]


def test_what_hears_a_plant_says_anything_and_stands_still_for_progress(tmp_path: Path) -> None:
    module_result = verified(tmp_path)
    assert module_result.findings["P2a"].verdict == "proved"
    assert module_result.findings["P2b"].verdict == "assumed"
    assert "while wish stays as it is" in module_result.findings["P2b"].text
    said = "\n".join(assumption_texts(module_result.assumptions))
    assert "wish: any value of its set at any time (published by Dispatch, which hears" in said
    assert "for P2b alone: wish stays as it is" in said
    checked = recheck(tmp_path / "cert")
    assert checked.accepted, checked.reason


def test_what_hears_a_plant_through_a_queue_hears_it(tmp_path: Path) -> None:
    module_result = verified(tmp_path, *QUEUED)
    said = "\n".join(assumption_texts(module_result.assumptions))
    assert "wish: any value of its set at any time (published by Dispatch, which hears" in said
    assert recheck(tmp_path / "cert").accepted


def test_what_does_not_is_followed(tmp_path: Path) -> None:
    module_result = verified(tmp_path, *ALONE)
    assert module_result.findings["P2b"].verdict == "proved"
    assert not any("stays as it is" in a for a in assumption_texts(module_result.assumptions))


def test_safety_never_rests_on_its_standing_still(tmp_path: Path) -> None:
    module_result = verified(tmp_path, OTHER_SOURCE)
    assert module_result.findings["P2a"].verdict == "undecided"
    assert module_result.verdict == "undecided"


def test_safety_fails_where_it_holds_only_of_what_stands_still(tmp_path: Path) -> None:
    module_result = verified(tmp_path, *MOVES)
    assert module_result.findings["P2a"].verdict == "undecided"


@pytest.mark.long
def test_a_lemma_about_it_has_it_followed(tmp_path: Path) -> None:
    module_result = verified(tmp_path, OTHER_SOURCE, LEMMA)
    assert module_result.findings["P2a"].verdict == "proved"
    assert recheck(tmp_path / "cert").accepted
