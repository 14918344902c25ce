"""What vehicles ask of the rules of rest: friction, several potentials, states beside the rest.

Each claim is confirmed of a small program, and not of one that differs where it matters.
"""

from __future__ import annotations

from math import nextafter
from typing import TYPE_CHECKING, Any

import pytest

from soter.api.program import load
from soter.certificate.rechecker import recheck
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import exact, greatest_below
from soter.certificate.tubes import tube_chains
from soter.certificate.tubes.check_rest import recheck_rest, tube_of_entry
from unit.certificate.tubes.rest_entries import entry, flat_of
from unit.certificate.tubes.test_forged_rest import DRIFTS, KEEPS, LEADS, changed, without

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

ROVER = """soter 1;
type Seen = { way: float, v: float, spin: float, front: float };
type Drive = { brake: float, spin: float };
topic seen: Seen in { v in [-2.0, 4.0], spin in [-1.0, 1.0], front in [-2.0, 47.0] } max_age 20ms;
topic drive: Drive in { brake in [0.0, 1.0], spin in [-1.0, 1.0] } = { brake: 1.0, spin: 0.0 };
node Ac period 20ms { publishes drive; step { publish drive = { brake: 0.0, spin: 0.5 }; } }
node Sc period 20ms { publishes drive; step { publish drive = { brake: 1.0, spin: 0.0 }; } }
rta Rover { ac Ac; sc Sc; period 20ms; safe seen.way < 100.0 && seen.front < 60.0;
  rest abs(seen.v) < 0.3 && abs(seen.spin) < 0.1 moves seen.way by 0.045 within 2s; }
plant Car period 10ms {
  reads drive; drives seen = { way: way, v: v, spin: spin, front: front };
  state way: float = 0.0; state v: float = 2.0; state spin: float = 0.0; state front: float = 1.0;
  disturbance grip: float in [0.9, 1.1];
  disturbance push: float in [0.0, 2.0]; disturbance hard: float in [0.0, 8.0];
  der way = v + spin;
  der v = -grip * 6.0 * drive.brake * v / (abs(v) + 0.1);
  der spin = (drive.spin - spin) / 0.2;
  der front = push * (1.0 - front / 45.0) - (0.1 + hard) * front / (abs(front) + 0.1);
  measured seen.v within 0.1, seen.front within 0.3;
}
system S default { p: Car; module Rover; until 1s; }
"""
HIGH = nextafter(46.7, 0.0)
"""47 less 0.3, which is no double; 46.7 and 0.3 are 47 once their sum is rounded."""
BOX = {"p.v": (-0.305, 0.305), "p.spin": (-0.101, 0.101), "p.front": (-1.7, HIGH)}


def rover(text: str = ROVER, **box: tuple[float, float]) -> tuple[System, dict[str, Any]]:
    flat = flat_of(text)
    own = BOX | {f"p.{name}": ends for name, ends in box.items()}
    return flat, entry(flat, own, own)


def test_friction_two_potentials_and_a_state_beside_them_are_confirmed() -> None:
    _, report = recheck_rest(*rover())
    assert report.lacks_flight_only
    assert report.confirmed == ["P1a", "P1b", "P2a", "start"]


def test_commands_of_a_vehicle_need_not_begin_together() -> None:
    late = ROVER.replace("within 2s; }", "within 2s; verify { acts within 1ms; } }")
    facts, report = recheck_rest(*rover(late))
    assert report.lacks_flight_only
    assert facts.jitter_ns
    assert not [a.key for a in report.assumptions if a.key.startswith("together")]


OTHERS: dict[str, tuple[tuple[str, ...], tuple[str, str]]] = {
    "both together drift farther": (DRIFTS, ("by 0.045", "by 0.04")),
    "the brake lets go": (DRIFTS, ("brake: 1.0, spin: 0.0 }; } }", "brake: 0.0, spin: 0.0 }; } }")),
    "the brake drives": (LEADS, ("-grip * 6.0", "grip * 6.0")),
    "v is pushed": (LEADS, ("(abs(v) + 0.1);", "(abs(v) + 0.1) + 5.0 * (1.0 - grip);")),
    "v is pushed hard": (LEADS, ("(abs(v) + 0.1);", "(abs(v) + 0.1) + 50.0 * (1.0 - grip);")),
    "v turns it": (LEADS, ("/ 0.2;", "/ 0.2 + 3.0 * v;")),
    "SC turns it": (LEADS, ("brake: 1.0, spin: 0.0 }; } }", "brake: 1.0, spin: 0.3 }; } }")),
    "the other one leaves": (KEEPS, ("front / 45.0", "front / 55.0")),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_nothing_is_confirmed_where_it_is_otherwise(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts, change = OTHERS[name]
    flat, made = rover(changed(ROVER, change))
    made["claims"]["start"] = "undecided"
    with pytest.raises(NotRecheckedError, match="P2a"):
        recheck_rest(flat, made)
    without(parts, monkeypatch)
    assert "P2a" in recheck_rest(flat, made)[1].confirmed


@pytest.mark.parametrize("ends", [(-1.7, nextafter(HIGH, 0.0)), (nextafter(-1.7, 0.0), HIGH)])
def test_a_box_is_all_that_can_be_published(ends: tuple[float, float]) -> None:
    flat, made = rover(front=ends)
    with pytest.raises(NotRecheckedError, match=r"by p\.front"):
        recheck_rest(flat, made)


def test_what_a_tube_stays_in_is_what_rest_starts_from() -> None:
    """A double of which no more than rounding makes a number that can be published is not in C."""
    tube = tube_of_entry(*rover())
    beyond = greatest_below(47.0, 0.3)
    assert beyond > HIGH
    for front, there in ((HIGH, True), (beyond, False), (-1.7, True), (-1.75, False)):
        box = [(exact(0.0),) * 2, (exact(0.0),) * 2, (exact(0.0),) * 2, (exact(front),) * 2]
        assert tube.is_within_c(box) == there


def test_a_start_needs_the_ends_that_no_run_crosses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one that may stop at once the tube has less and less from below, but for the set."""
    fast = ("[0.0, 8.0]", "[0.0, 80.0]"), ("front: float = 1.0", "front: float = 20.0")
    flat, made = rover(changed(ROVER, *fast))
    assert tube_of_entry(flat, made).why_starts_not_good() is None
    none = [(False, False)] * 4
    monkeypatch.setattr(tube_chains, "uncrossed_ends", lambda *_: none)
    assert "out of C" in (tube_of_entry(flat, made).why_starts_not_good() or "")


TWO_WHEELS = """soter 1;
type P = { x: float, h: float, v: float };
type Cmd = { v: float, w: float };
topic p: P max_age 50ms;
topic cmd: Cmd in { v in [0.0, 1.5], w in [-1.5, 1.5] };
plant Jackal period 10ms { reads cmd; drives p = { x: x, h: h, v: v };
  state x: float = 0.0; state h: float = 0.0; state v: float = 0.0;
  disturbance slip: float in [-0.05, 0.05];
  der x = v * cos(h); der h = cmd.w + slip;
  der v = clamp(8.0 * (cmd.v - v), -1.5, 1.5);
  measured p.x within 0.03, p.h within 0.02, p.v within 0.03; }
node Go period 20ms { publishes cmd; step { publish cmd = { v: 1.5, w: 0.2 }; } }
node Stop period 20ms { publishes cmd; step { publish cmd = { v: 0.0, w: 0.0 }; } }
rta Walls { ac Go; sc Stop; period 40ms; safe abs(p.x) < 5.0;
  rest abs(p.v) < 0.1 moves p.x by 0.013 within 2s; }
system S default { j: Jackal; module Walls; until 1s; }
"""
"""A servo that saturates, and a heading that slips for ever and is read by a cosine alone."""


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        (None, "proved"),
        (("by 0.013", "by 0.012"), "undecided"),
        (("8.0 * (cmd.v - v)", "8.0 * (cmd.v + 0.05 - v)"), "undecided"),
        (("8.0 * (cmd.v - v)", "8.0 * (v - cmd.v)"), "undecided"),
        (("der x = v * cos(h)", "der x = v * (1.0 + cos(h))"), "undecided"),
        (("der x = v * cos(h)", "der x = v * cos(h) + 0.001 * h"), "undecided"),
    ],
    ids=["as it is", "less far", "it creeps", "the servo drives", "it moves twice", "h moves it"],
)
def test_a_servo_that_saturates_stops_a_robot_that_turns_for_ever(
    tmp_path: Path, change: tuple[str, str] | None, verdict: str
) -> None:
    text = TWO_WHEELS if change is None else changed(TWO_WHEELS, change)
    (tmp_path / "robot.soter").write_text(text)
    found = load(tmp_path / "robot.soter").verify(refute=False, cert=tmp_path / "cert")
    assert found.modules[0].findings["P2a"].verdict == verdict
    report = recheck(tmp_path / "cert")
    assert ("P2a" in report.modules[0].confirmed) == (verdict == "proved")


STOPS = """soter 1;
topic seen: { gap: float, v: float } max_age 60ms;
topic accel: float in [-6.0, 2.0] = 0.0;
plant Car period 10ms { reads accel; drives seen = { gap: gap, v: v };
  state gap: float = 80.0; state v: float = 10.0;
  disturbance grip: float in [-0.5, 0.5];
  der gap = -v;
  der v = v > 0.0 || accel > 0.0 ? accel + grip : 0.0;
  measured seen.gap within 0.3, seen.v within 0.1; }
node Drive period 20ms { subscribes seen; publishes accel; step { publish accel = 1.0; } }
node Brake period 20ms { publishes accel; step { publish accel = -6.0; } }
rta Aeb { ac Drive; sc Brake; period 40ms; safe seen.gap > 0.0;
  rest abs(seen.v) < 0.1 moves seen.gap by 0.0019 down within 4s; }
system S default { c: Car; module Aeb; until 30s; }
"""
"""0.1^2 / 5.5 is 0.00182: twice as far as it goes."""


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        (None, "proved"),
        (("by 0.0019 down", "by 0.0017 down"), "undecided"),
        (("by 0.0019 down", "by 0.0019"), "undecided"),
        (("der gap = -v;", "der gap = -abs(v);"), "undecided"),
        (("der gap = -v;", "der gap = -v - 0.001;"), "undecided"),
        (("v > 0.0 || accel", "v > -0.05 || accel"), "proved"),
        (("accel + grip : 0.0", "accel + grip : -0.01"), "undecided"),
        (("accel + grip : 0.0", "accel + grip : 0.01"), "proved"),
        (("publish accel = -6.0", "publish accel = 0.5"), "undecided"),
    ],
    ids=["as it is", "less far", "up, too", "backwards, too", "it is driven", "it rolls back",
         "it rolls back slowly", "it creeps", "it drives on"],
)  # fmt: skip
def test_a_car_that_stops_by_a_branch_is_at_rest(
    tmp_path: Path, change: tuple[str, str] | None, verdict: str
) -> None:
    (tmp_path / "car.soter").write_text(STOPS if change is None else changed(STOPS, change))
    found = load(tmp_path / "car.soter").verify(refute=False, budget_s=0.0)
    assert found.modules[0].findings["P2a"].verdict == verdict
    if change is None:
        assert found.modules[0].findings["start"].verdict == "proved"


PUSHED = """soter 1;
type S = { z: float, v: float };
topic seen: S in { v in [-2.0, 2.0] } max_age 40ms;
topic push: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms { reads push; drives seen = { z: z, v: v };
  state z: float = 0.0; state v: float = 0.0;
  disturbance w: float in [-1.0, 1.0];
  der z = RATE;
  der v = push - 4.0 * v; }
node Go period 20ms { subscribes seen; publishes push; step { publish push = 1.0; } }
node Stop period 20ms { subscribes seen; publishes push; step { publish push = 0.0; } }
rta M { ac Go; sc Stop; period 40ms; safe seen.z < 100.0;
  rest abs(seen.v) < 0.5 moves seen.z by 0.3 up within 2s; }
system T default { c: Cart; module M; until 1s; }
"""


@pytest.mark.parametrize(
    ("rate", "verdict"),
    [
        ("v + w - 1.0", "proved"),
        ("v + (w > 0.0 ? w - 5.0 : w - 1.0)", "proved"),
        ("v + (w > 0.0 ? w - 5.0 : w + 3.0)", "undecided"),
        ("v + w + (w > 0.5 ? -5.0 : 0.0)", "undecided"),
        ("v + (abs(w) > 0.9 ? -2.0 * w - 3.0 : -2.0 * w)", "undecided"),
        ("v + (w > v - 1.0 ? w - 5.0 : w + 1.5)", "undecided"),
    ],
)
def test_a_disturbance_on_which_a_branch_hangs_is_not_put_to_one_end(
    tmp_path: Path, rate: str, verdict: str
) -> None:
    """With w = 0 for ever z grows at 3, at 0 with w = 0.5, and so on: at the ends of w it falls."""
    (tmp_path / "cart.soter").write_text(PUSHED.replace("RATE", rate))
    found = load(tmp_path / "cart.soter").verify(refute=False, budget_s=0.0)
    assert found.modules[0].findings["P2a"].verdict == verdict


CHARGER = """soter 1;
topic cell: { z: float, v: float } max_age 1s;
topic amp: float in [0.0, 5.0] = 0.0;
plant Cell period 500ms { reads amp; drives cell = { z: z, v: v };
  state z: float = 0.2; state v: float = 0.0;
  der z = amp / 9000.0; der v = (0.03 * amp - v) / 30.0;
  measured cell.z within 0.01, cell.v within 0.005; }
node Fast period 1s { publishes amp; step { publish amp = 5.0; } }
node Cut period 1s { publishes amp; step { publish amp = 0.0; } }
rta Charge { ac Fast; sc Cut; period 1s; safe 3.4 + 0.75 * cell.z + cell.v < MOST;
  rest abs(cell.v) < 0.03 moves cell.z by 0.0001 up within 300s; }
system S default { c: Cell; module Charge; until 3600s; }
"""


@pytest.mark.parametrize(("most", "accepted"), [(4.15, True), (3.58, False)])
def test_a_sum_with_what_may_fall_without_end_is_asked_far_out_by_parts(
    tmp_path: Path, most: float, accepted: bool
) -> None:
    """Of all z up to 0.2001 a sum rounds by more than 1 as far out as 1e100, and not near 0.2."""
    (tmp_path / "cell.soter").write_text(CHARGER.replace("MOST", str(most)))
    load(tmp_path / "cell.soter").verify(refute=False, cert=tmp_path / "cert", budget_s=0.0)
    assert ("start" in recheck(tmp_path / "cert").modules[0].confirmed) == accepted
