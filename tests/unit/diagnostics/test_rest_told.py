"""W022 of `rest`: what a run of SC, and values of topics, say of `rest`, `moves` and `within`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.fixes import apply_fix
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostic

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
TRAIN = """soter 1;
type Sight = { gap: float, way: float, v: float };
type Levers = { gas: float, brake: float };
topic sight: Sight in { v in [-2.0, 40.0] } max_age 20ms;
topic levers: Levers in [0.0, 1.0] = { gas: 0.0, brake: 1.0 };
node Cruise period 20ms { publishes levers; step { publish levers = { gas: 1.0, brake: 0.0 }; } }
node Brake period 50ms { publishes levers; step { publish levers = { gas: 0.0, brake: 1.0 }; } }
rta Follow {
  ac Cruise;
  sc Brake;
  period 100ms;
  safe sight.gap > 0.0 && sight.way < 400.0;
  rest abs(sight.v) < 0.3 moves sight.gap by 0.3 down, sight.way by 0.3 up within 5s;
}
plant Track period 10ms {
  reads levers;
  drives sight = { gap: gap, way: way, v: v };
  state gap: float = 60.0;
  state way: float = 0.0;
  state v: float = 10.0;
  disturbance front: float in [0.0, 30.0] hold 1s;
  der gap = front - v;
  der way = v;
  der v = 2.0 * levers.gas - 2.0 * levers.brake * v;
  measured sight.gap within 0.2, sight.way within 0.5, sight.v within 0.05;
}
system Line default { r: Track; module Follow; until 30s; always r.truth.gap > 0.0; }
"""
ANCHOR = """soter 1;
topic fix: { x: float, v: float } in { x in [-20.0, 20.0], v in [-5.0, 5.0] } max_age 50ms;
topic thrust: float in [-1.0, 1.0] = 0.0;
node Any period 50ms { publishes thrust; step { publish thrust = 1.0; } }
node Hold period 50ms { subscribes fix; publishes thrust;
  step { publish thrust = clamp(-0.3 * (fix.x - 2.0) - 1.5 * fix.v, -1.0, 1.0); } }
rta Stay {
  ac Any; sc Hold; period 50ms;
  safe abs(fix.x) < 8.0;
  rest abs(fix.x - 2.0) < 1.0 && abs(fix.v) < 0.5 within 20s;
}
plant Boat period 10ms { reads thrust; drives fix = { x: x, v: v };
  state x: float = 0.0; state v: float = 0.0;
  disturbance wind: float in [-0.02, 0.02]; der x = v; der v = thrust + wind; }
system Bay { b: Boat; module Stay; until 60s; }
"""
TROLLEY = """soter 1;
topic motion: { x: float, v: float, turns: float } in { v in [-2.5, 2.5] } max_age 40ms;
topic speed: float in [-1.5, 1.5] = 0.0;
input topic limit: float = 12.0 max_age 250ms static;
node Any period 40ms { publishes speed; step { publish speed = 1.5; } }
node Halt period 40ms { publishes speed; step { publish speed = 0.0; } }
rta Bridge {
  ac Any; sc Halt; period 80ms;
  safe motion.x > 0.0 && motion.x < limit;
  rest abs(motion.v) < 0.1 moves motion.x by 0.05 within 3s;
}
plant Trolley period 10ms { reads speed; drives motion = { x: x, v: v, turns: turns };
  state x: float = 3.0; state v: float = 0.0; state turns: float = 0.0;
  der x = v; der v = 4.0 * (speed - v); der turns = 2.0 + 0.01 * v; }
system Hall { t: Trolley; module Bridge; until 20s; }
"""
"""It stands at the start: what is wrong shows only after AC has moved it."""
REST = "rest abs(sight.v) < 0.3 moves sight.gap by 0.3 down, sight.way by 0.3 up within 5s;"
SPEED, HELD = "abs(sight.v) < 0.3", "abs(fix.x - 2.0) < 1.0 && abs(fix.v) < 0.5"
SLIPS = {
    "holds always": (TRAIN, SPEED, "abs(sight.v) < 90.0", "abs(sight.v) < 90.0", "bound `sight.v`"),
    "wrong way": (TRAIN, SPEED, "abs(sight.v) > 0.3", "abs(sight.v) > 0.3", "abs(sight.v) <= 0.3"),
    "negated": (TRAIN, SPEED, "!(abs(sight.v) < 0.3)", "!(abs(sight.v) < 0.3)", SPEED),
    "one side the wrong way": (TRAIN, SPEED, "sight.v > 0.3", "sight.v > 0.3", "sight.v <= 0.3"),
    "never reached": (TRAIN, SPEED, "sight.v < -1.0", "sight.v < -1.0", "let `rest` hold there"),
    "passed": (TRAIN, SPEED, "abs(sight.v - 5.0) < 0.3", "abs(sight.v - 5.0) < 0.3", "SC go on"),
    "equality": (TRAIN, SPEED, "sight.v == 0.0", "sight.v == 0.0", "how near"),
    "SC goes on": (TRAIN, "gas: 0.0, brake: 1.0 }; }", "gas: 0.9, brake: 0.9 }; }", SPEED, "SC go"),
    "no moves": (
        TRAIN,
        REST,
        f"rest {SPEED} within 5s;",
        "rest",
        "sight.gap by .* down, sight.way",
    ),
    "one left out": (TRAIN, ", sight.way by 0.3 up", "", "rest", "sight.way by .* up"),
    "up for down": (TRAIN, "0.3 down", "0.3 up", "sight.gap", "sight.gap by 0.3 down"),
    "too little": (TRAIN, "way by 0.3", "way by 0.003", "sight.way", "sight.way by 0.[4-6] up"),
    "too short": (TRAIN, "within 5s", "within 500ms", "500ms", "`within 2.625s`"),
    "shorter than a period": (TRAIN, "within 5s", "within 5ms", "5ms", "`within 2.625s`"),
    "or for and": (ANCHOR, "1.0 && abs", "1.0 || abs", "abs(fix.x - 2.0) < 1.0 ||", " && "),
    "another place": (ANCHOR, "abs(fix.x - 2.0) <", "abs(fix.x + 2.0) <", "abs(fix.x + 2", "there"),
    "wider than safe": (ANCHOR, "2.0) < 1.0", "2.0) < 9.0", "abs(fix.x - 2.0) < 9.0", "`safe`"),
    "standing, too short": (TROLLEY, "within 3s", "within 100ms", "100ms", "`within 540ms`"),
    "standing, equality": (TROLLEY, "abs(motion.v) < 0.1", "motion.v == 0.0", "motion.v", "near"),
    "standing, one side": (TROLLEY, "abs(motion.v) < 0.1", "motion.v < 0.1", "motion.v <", "abs"),
    "standing, too little": (TROLLEY, "by 0.05", "by 0.005", "motion.x", "motion.x by 0.1"),
    "moves for ever": (TROLLEY, " by 0.05", " by 0.05, motion.turns by 1.0", "motion.turns", "out"),
    "safe asks it": (TROLLEY, "< limit", "< limit && motion.turns < 500.0", "motion.x >", "stops"),
    "nothing free": (TROLLEY, "= 12.0 max", "= 0.0 max", "motion.x >", "default of `limit`"),
    "SC leads away": (ANCHOR, "-0.3 *", "0.3 *", "Hold", "sign of SC"),
}


def _told(tmp_path: Path, text: str) -> list[Diagnostic]:
    path = tmp_path / "robot.soter"
    path.write_text(text, encoding="utf-8")
    return [d for d in check_file(str(path)).diagnostics.items if d.code != "W001"]


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_of_rest_is_told_in_its_place_with_what_mends_it(tmp_path: Path, name: str) -> None:
    text, old, new, at, remedy = SLIPS[name]
    assert text.count(old) == 1
    (told,) = _told(tmp_path, text.replace(old, new))
    assert told.code == "W022"
    assert told.primary is not None
    assert told.primary.span.text.startswith(at)
    (help_,) = told.helps
    assert re.search(remedy.replace("(", r"\(").replace(")", r"\)"), help_)
    for fix in told.fixes:
        ((_, mended),) = apply_fix(fix).items()
        assert _told(tmp_path, mended) == []


@pytest.mark.parametrize("text", [TRAIN, ANCHOR, TROLLEY])
def test_nothing_is_said_where_sc_comes_to_rest(tmp_path: Path, text: str) -> None:
    assert _told(tmp_path, text) == []


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("rest/*.soter")), ids=lambda p: p.stem)
def test_nothing_is_said_of_the_robots_of_the_examples(path: Path) -> None:
    assert [d for d in check_file(str(path)).diagnostics.items if d.code == "W022"] == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("der v = 2.0", "der v = 1.0 / (v - v) + 2.0"),
        ("der v = 2.0", "der v = exp(100.0 * v) + 2.0"),
        ("der v = 2.0", "der v = sqrt(v - 100.0) + 2.0"),
        (
            "step { publish levers = { gas: 0.0",
            "var n: float = 0.0; step { publish levers = { gas: n",
        ),
    ],
)
def test_a_run_that_cannot_be_followed_says_nothing(tmp_path: Path, old: str, new: str) -> None:
    assert TRAIN.count(old) == 1
    slip = (
        TRAIN.replace(old, new).replace(SPEED, "sight.v < -1.0").replace("within 5s", "within 5ms")
    )
    assert "W022" not in [d.code for d in _told(tmp_path, slip)]


def test_a_plant_that_takes_long_to_compute_is_not_followed(tmp_path: Path) -> None:
    slow = "fun slow(x: float): float { var y = x; for i in 0..N { y = y + 1e-9; } return y; }"
    slip = TRAIN.replace("within 5s", "within 5ms").replace("der way = v;", "der way = slow(v);")
    for rounds, codes in ((10, ["W022"]), (5000, [])):
        text = slip.replace("soter 1;", f"soter 1; {slow.replace('N', str(rounds))}")
        assert [d.code for d in _told(tmp_path, text)] == codes
