"""What is warned of without a proof: W022, a `ttf` that comes too late (one that meets `safe` in a
thin band does not); D019, a plant that flies less exactly than the one of the proof."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Any

import pytest

from soter.language.elaborate.lints import contradictory_predicates
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

TRACK = """soter 1;
param LIMIT: float = 10.0;
param MARGIN: float = {margin!r};
topic pos: float in [-20.0, 20.0] max_age 20ms;
topic speed: float in [-1.0, 1.0] max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms {{
  reads vel;
  drives pos = clamp(x, -20.0, 20.0);
  drives speed = vel;
  state x: float;
  der x = vel;
}}
node Fast period 10ms {{
  subscribes pos; publishes vel;
  step {{ publish vel = clamp(9.0 - pos, -1.0, 1.0); }}
}}
node Stop period 10ms {{ publishes vel; step {{ publish vel = 0.0; }} }}
rta Guard {{
  ac Fast; sc Stop; period 50ms;
  safe {safe};
  ttf {ttf};
  safer abs(pos) < 5.0;
}}
system Track {{ c: Cart; module Guard; until 10s; }}
"""


def _codes(tmp_path: Path, safe: str, ttf: str, margin: float = 0.1) -> list[str]:
    path = tmp_path / "track.soter"
    path.write_text(TRACK.format(safe=safe, ttf=ttf, margin=margin))
    codes = [d.code for d in check_file(str(path)).diagnostics.items]
    return [code for code in codes if code != "W001"]  # of what a predicate leaves out


@pytest.mark.parametrize(
    ("safe", "ttf"),
    [
        ("abs(pos) < LIMIT", "abs(pos) > LIMIT - MARGIN"),
        ("abs(pos) < LIMIT", "abs(pos) + MARGIN * abs(speed) > LIMIT"),
        ("abs(pos) < 10.0", "abs(pos) + 0.12 * abs(speed) > 10.0"),
        ("abs(pos) < LIMIT", "abs(pos) > LIMIT - MARGIN && speed > 0.9"),
        ("abs(pos) < LIMIT || speed == 0.0", "abs(pos) > LIMIT && abs(speed) < MARGIN"),
    ],
)
def test_predicates_that_meet_in_a_thin_band_are_not_warned_of(
    safe: str, ttf: str, tmp_path: Path
) -> None:
    assert _codes(tmp_path, safe, ttf) == []


@pytest.mark.parametrize("ttf", ["pos - pos > 0.5", "speed - pos - (speed - pos) < 0.5"])
def test_a_difference_of_one_expression_is_nothing(ttf: str, tmp_path: Path) -> None:
    assert _codes(tmp_path, "abs(pos) < LIMIT", ttf) == ["W022"]


def test_random_margins_are_not_warned_of_and_their_absence_is(tmp_path: Path) -> None:
    draw = random.Random(0)  # noqa: S311 - the same programs each time
    for _ in range(40):
        margin = 10 ** draw.uniform(-9, 0)
        radius = draw.choice(("abs(pos)", "sqrt(pos * pos + speed * speed)", "max(pos, -pos)"))
        safe, late = f"{radius} < LIMIT", f"{radius} >= LIMIT"
        assert _codes(tmp_path, safe, f"{radius} > LIMIT - MARGIN", margin) == [], margin
        assert _codes(tmp_path, safe, late, margin) == ["W022"]


def test_predicates_are_tried_once_for_all_systems_that_give_them_the_same_values(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []

    def count(system: System, *rest: Any) -> list[contradictory_predicates.Trial]:
        tried.append(system.name)
        return trials_of(system, *rest)

    trials_of = contradictory_predicates.trials_of_predicates
    monkeypatch.setattr(contradictory_predicates, "trials_of_predicates", count)
    safe, ttf = "abs(pos) < LIMIT", "abs(pos) > LIMIT - MARGIN"
    track = TRACK.format(safe=safe, ttf=ttf, margin=0.1)
    path = tmp_path / "track.soter"
    more = "system {0} {{ c: Cart; module Guard; until 5s; {1} }}\n"
    path.write_text(track + more.format("Again", "") + more.format("Wide", "set MARGIN = 6.0;"))
    warnings = check_file(str(path)).diagnostics.items
    assert tried == ["Track", "Wide"]
    assert [d.code for d in warnings] == ["W013"]  # both hold with the wide margin alone
    path.write_text(track + more.format("Again", ""))
    assert [d.code for d in check_file(str(path)).diagnostics.items] == []


CART = """soter 1;
topic pos: float in [-20.0, 20.0] max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms {{ reads vel; drives pos = x; state x: float = {start}; der x = vel; }}
node Fast period 10ms {{ publishes vel; step {{ publish vel = 1.0; }} }}
node Stop period 10ms {{ publishes vel; step {{ publish vel = 0.0; }} }}
"""
GATE = """topic gate: bool = false;
node Open period 10ms { publishes gate; step { publish gate = true; } }
node Shut period 10ms { publishes gate; step { publish gate = false; } }
rta Guard {
  ac Fast; sc Stop; period 50ms;
  safe abs(pos) < 10.0; ttf abs(pos) > 9.0 || gate; safer abs(pos) < 8.0 && !gate;
}
rta Gate {
  ac Open; sc Shut; period 50ms;
  safe abs(pos) < 11.0; ttf abs(pos) > 9.0; safer abs(pos) < 8.0;
}
system Track { c: Cart; module Guard; module Gate; until 10s; }
"""


def test_what_another_decision_module_reads_is_not_said_to_be_read_by_nothing(
    tmp_path: Path,
) -> None:
    path = tmp_path / "gate.soter"
    path.write_text(CART.format(start="0.0") + GATE)
    assert [d.code for d in check_file(str(path)).diagnostics.items] == []
    path.write_text(
        CART.format(start="0.0") + GATE.replace(" || gate", "").replace(" && !gate", "")
    )
    assert [d.code for d in check_file(str(path)).diagnostics.items] == ["W023"]


def test_a_value_that_its_topic_never_holds_is_not_said_to_be_its_first(tmp_path: Path) -> None:
    rest = GATE[GATE.index("rta Guard") : GATE.index("rta Gate")].replace(" || gate", "")
    rest = rest.replace(" && !gate", "") + "system Track { c: Cart; module Guard; until 10s; }"
    path = tmp_path / "track.soter"
    codes = []
    for start in ("15.0", "30.0"):  # at 30.0 the plant faults, and `pos` keeps its default
        path.write_text(CART.format(start=start) + rest)
        codes.append([d.code for d in check_file(str(path)).diagnostics.items])
    assert codes == [["W021"], []]


def test_a_proof_by_induction_is_not_told_to_leave_out_what_it_needs(tmp_path: Path) -> None:
    path = tmp_path / "plan.soter"
    path.write_text("""soter 1;
topic plan: int in [0, 9];
topic flown: int in [0, 9];
node Any period 10ms { publishes plan; step { publish plan = choose [0, 9]; } }
node Stay period 10ms { publishes plan; step { publish plan = 0; } }
node Fly period 10ms { subscribes plan; publishes flown; step { publish flown = plan; } }
rta Guard {
  ac Any; sc Stay; period 20ms;
  safe flown < 5; ttf flown >= 5; safer flown < 5;
  verify { induction; }
}
system Flown { node Fly; module Guard; until 1s; }
""")
    (warning,) = check_file(str(path)).diagnostics.items
    assert warning.code == "W022"
    assert not any("leave both out" in help_ for help_ in warning.helps)  # R032 without them


ABSTRACTED = """soter 1;
param OFF: float = 0.5;
topic pose: {{ x: float, v: float }} max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;
node Fast period 10ms {{ subscribes pose; publishes push;
  step {{ publish push = clamp(9.0 - pose.x - pose.v, -1.0, 1.0); }} }}
node Stop period 10ms {{ subscribes pose; publishes push;
  step {{ publish push = clamp(-pose.x - pose.v, -1.0, 1.0); }} }}
plant Flies period 10ms {{ reads push; drives pose = {{ x: x, v: v }};
  state x: float; state v: float; der x = v; der v = push; {flies} }}
plant Proved period 10ms {{ reads push; drives pose = {{ x: x, v: v }};
  state x: float; state v: float; der x = v; der v = push; {proved} }}
rta Guard {{ ac Fast; sc Stop; period 50ms; safe abs(pose.x) < 10.0;
  verify {{ {view} abstracts f by p: Proved = {{ x: f.truth.x, v: f.truth.v }};
    grid pose.x in [-10.0, 10.0] / 20, pose.v in [-5.0, 5.0] / 20; {end} }} }}
system One {{ f: Flies; module Guard; }}
system Two {{ r: One; }}
"""
EXACT = {
    "measured pose.x within 2.0, pose.v within 0.1;": ["pose.x"],
    "measured pose within OFF;": ["pose.v"],
    "measured pose.v within 0.2;": ["pose.v"],
    "measured pose.x within 0.5, pose.v within 0.1;": [],
    "": [],
}


@pytest.mark.parametrize("view", [False, True])
@pytest.mark.parametrize("flies", EXACT)
def test_a_plant_that_flies_less_exactly_than_that_of_the_proof_is_warned_of(
    flies: str, view: bool, tmp_path: Path
) -> None:
    proved = "measured pose.x within 0.5, pose.v within 0.1;"
    around = {"view": "view all {", "end": "}"} if view else {"view": "", "end": ""}
    path = tmp_path / "abstracted.soter"
    path.write_text(ABSTRACTED.format(flies=flies, proved=proved, **around))
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics.items
    told = [d.message for d in checked.diagnostics.items if d.code == "D019"]
    assert len(told) == 2 * len(EXACT[flies]), "of each system"
    assert all(any(leaf in message for leaf in EXACT[flies]) for message in told)
