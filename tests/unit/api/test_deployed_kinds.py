"""Proofs of every kind that a deployed system inherits: inductions, plants in steps."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.api.deploy.inheritance import FILE
from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.render import render_all

if TYPE_CHECKING:
    from pathlib import Path

BELT = """soter 1;
topic place: float in [-20.0, 20.0] max_age 50ms;
topic push: float in [-1.0, 1.0];
input topic goal: float in [-9.0, 9.0];
plant Belt period 100ms {
  reads push;
  drives place = x;
  state x: float in [-1.0, 1.0];
  disturbance slip: float in [-0.1, 0.1];
  next x = x + push + slip;
  measured place within 0.1;
}
node Fast period 100ms {
  subscribes goal;
  publishes push;
  step { publish push = clamp(goal, -1.0, 1.0); }
}
node Back period 100ms {
  subscribes place;
  publishes push;
  step { publish push = clamp(-0.5 * place, -1.0, 1.0); }
}
rta Keep {
  ac Fast;
  sc Back;
  period 200ms;
  safe abs(place) < 9.0;
  verify { grid place in [-10.0, 10.0] / 200; }
}
system Protected default { b: Belt; module Keep; input goal every 1s; until 10s; }
"""
LINE = """soter 1;
import "proved.soter" as p;
system Robot deploys p.Protected {
  external topic p.place every 100ms measured p.place within 0.1;
  external topic p.goal;
  external topic p.push;
  module p.Keep;
}
"""
PLANNER = """soter 1;
const SETTLED: duration = 30ms;
type Plan = enum { Hover, Around, ThroughBuilding };
topic candidate: Plan;
topic inForce: Plan;
topic level: float in [0.0, 5.0] max_age 50ms;
fun Fine(p: Plan): bool { return p != Plan.ThroughBuilding; }
plant Tank period 10ms {
  reads inForce;
  drives level = l;
  state l: float = 1.0;
  der l = inForce == Plan.Hover ? 0.0 : -0.1 * l;
}
node RRTStar period 10ms {
  publishes candidate;
  step { publish candidate = Plan.ThroughBuilding; }
}
node HoverPlan period 10ms {
  publishes candidate;
  step { publish candidate = Plan.Hover; }
}
node Follower period 10ms {
  subscribes candidate, level;
  publishes inForce;
  var plan: Plan;
  step {
    if age(candidate) > seconds(SETTLED) && level > 0.5 { plan = candidate; }
    publish inForce = plan;
  }
}
rta SafePlanner {
  ac RRTStar;
  sc HoverPlan;
  period 20ms;
  safe Fine(inForce);
  ttf !Fine(candidate);
  safer Fine(candidate);
  verify { induction; }
}
system Protected default { t: Tank; node Follower; module SafePlanner; until 160ms; }
"""
FLYER = """soter 1;
import "proved.soter" as p;
system Robot deploys p.Protected {
  external topic p.level;
  external topic p.inForce;
  node p.Follower;
  module p.SafePlanner;
}
"""


def placed(folder: Path, proved: str, world: str) -> None:
    (folder / "proved.soter").write_text(proved)
    (folder / "robot.soter").write_text(world)


def inherited(folder: Path) -> dict[str, Any]:
    """What is told of the only module, with a certificate that is made for it."""
    soter.load(folder / "proved.soter").verify(cert=folder / "cert")
    soter.load(folder / "robot.soter").build("c", folder / "out", cert=folder / "cert")
    (module,) = json.loads((folder / "out" / FILE).read_text())["modules"]
    assert isinstance(module, dict)
    return module


def refused(folder: Path) -> tuple[str, str]:
    with pytest.raises(SoterError) as caught:
        soter.load(folder / "robot.soter").build("c", folder / "out")
    return caught.value.diagnostics[0].code, render_all(caught.value.diagnostics)


# ---------------------------------------------------------------- steps


def test_a_proof_about_a_plant_that_moves_in_steps_is_carried_step_by_step(tmp_path: Path) -> None:
    placed(tmp_path, BELT, LINE)
    report = inherited(tmp_path)
    assert report["inherited"] is True
    assert {"P2a", "P2b", "P3", "ttf", "safer", "start"} <= set(report["confirmed"])
    assert report["missing"] == []
    (covered,) = report["covered"]
    assert "with each step of 100 ms" in covered
    assert "or stale (50 ms)" in covered
    told = " ".join(report["assumptions"])
    assert "go by turns" in told
    assert "between two steps nothing is claimed" in told


@pytest.mark.parametrize(
    "said", ["every 50ms ", "every 200ms ", "", "every 100ms delayed 1ms ", "every 99ms "]
)
def test_a_topic_that_does_not_come_with_each_step_is_refused(tmp_path: Path, said: str) -> None:
    placed(tmp_path, BELT, LINE.replace("every 100ms ", said))
    code, text = refused(tmp_path)
    assert code == "D019"
    assert "moves in steps" in text


def test_the_error_of_a_plant_that_moves_in_steps_is_asked_as_ever(tmp_path: Path) -> None:
    placed(tmp_path, BELT, LINE.replace("within 0.1", "within 0.2"))
    assert refused(tmp_path)[0] == "D019"


# ---------------------------------------------------------------- induction


def test_a_proof_by_induction_asks_nothing_of_what_comes_from_outside(tmp_path: Path) -> None:
    pytest.importorskip("z3")
    placed(tmp_path, PLANNER, FLYER)
    report = inherited(tmp_path)
    assert report["inherited"] is True
    assert {"P2a", "P3", "ttf", "safer", "start"} <= set(report["confirmed"])
    assert report["covered"] == ["p.level: any value of its set, of any age"]
    assert "Follower: in time, which SOTER_LATE does not tell" in report["assumptions"]


def test_an_induction_whose_outside_is_not_what_it_thinks_is_not_proved(tmp_path: Path) -> None:
    """What comes from outside is any value: SC that trusts it keeps nothing."""
    pytest.importorskip("z3")
    high = "plan = candidate; }\n    if level > 4.0 { plan = Plan.ThroughBuilding; }"
    text = PLANNER.replace("plan = candidate; }", high)
    assert text != PLANNER
    placed(tmp_path, text, FLYER)
    report = inherited(tmp_path)
    assert "P2a" in report["missing"]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("  external topic p.level;\n", "", "p.level"),
        ("  external topic p.inForce;\n", "", "nobody takes it out"),
    ],
)
def test_an_induction_about_other_parts_is_not_carried(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    assert old in FLYER
    placed(tmp_path, PLANNER, FLYER.replace(old, new))
    with pytest.raises(SoterError) as caught:
        soter.load(tmp_path / "robot.soter").build("c", tmp_path / "out")
    assert says in render_all(caught.value.diagnostics)
