"""Certificates of modules with `rest` that say what is false: none is accepted.

Of each it is known which part of the re-checker sees it: without that part it is accepted.
"""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.tubes import check_rest
from soter.certificate.tubes.check_rest import recheck_rest
from tables import all_rows
from unit.certificate.tubes.rest_entries import entry, flat_of

if TYPE_CHECKING:
    from collections.abc import Callable

PLAIN = (Path(__file__).parents[4] / "examples" / "evidence" / "follow.soter").read_text("utf-8")
PUBLISHES = "  publishes levers;\n  step { publish levers = { gas: 0.0, brake: "
READS = "  subscribes sight;\n" + PUBLISHES
SEES = PUBLISHES + "1.0 }; }", READS + "clamp(1.0 + sight.v, 0.0, 1.0) }; }"
LATE = (
    "within 5s;",
    "within 5s;\n  verify { late dm 3ms, sc 2ms; response dm 4ms, sc 1ms; acts within 5ms; }",
)
HELD = """soter 1;
topic seen: float in [-2.0, 2.0] max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;
node Ac period 20ms { publishes push; step { publish push = 1.0; } }
node Sc period 20ms { subscribes seen; publishes push;
  step { publish push = clamp(-3.0 * seen, -1.0, 1.0); } }
rta Held { ac Ac; sc Sc; period 20ms; safe abs(seen) < 1.0; rest abs(seen) < 0.3 within 2s; }
plant Speed period 10ms { reads push; drives seen = v; state v: float = 0.0;
  disturbance wind: float in [-0.2, 0.2]; der v = push + wind; measured seen within 0.02; }
system S default { p: Speed; module Held; until 1s; }
"""
BOX, WAYS = {"r.v": (-0.31, 0.31)}, {"r.v": (-0.4, 0.4)}


def changed(text: str, *pairs: tuple[str, str]) -> str:
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


TRAIN = changed(PLAIN, SEES, LATE, ("CREEP: float = 0.3", "CREEP: float = 0.5"))


def held(text: str = HELD) -> tuple[Any, dict[str, Any]]:
    flat = flat_of(text)
    return flat, entry(flat, {"p.v": (-0.305, 0.305)}, {"p.v": (-0.4, 0.4)})


def train(text: str = TRAIN) -> tuple[Any, dict[str, Any]]:
    flat = flat_of(text)
    return flat, entry(flat, BOX, WAYS)


def test_what_is_true_is_confirmed() -> None:
    for flat, made in (train(), train(PLAIN), held()):
        _, report = recheck_rest(flat, made)
        assert report.confirmed == ["P1a", "P1b", "P2a", "start"]
        assert report.lacks_flight_only
        assert report.missing == ["P3", "ttf", "safer"]
        assert "tubes" in {a.key for a in report.assumptions}
    assert all(made["times"][k] for _, made in [train()] for k in made["times"])


# ---------------------------------------------------------------- constants


def shorter(key: str) -> Callable[[dict[str, Any]], None]:
    def change(made: dict[str, Any]) -> None:
        made["times"][key] = made["times"][key] * 49 // 50

    return change


def nearer(kind: str, end: str) -> Callable[[dict[str, Any]], None]:
    def change(made: dict[str, Any]) -> None:
        of = next(x for x in made["inputs"] if x["kind"] == kind)
        low, high = (float.fromhex(of[k]) for k in ("low", "high"))
        by = 0.02 * (high - low)
        of[end] = (low + by if end == "low" else high - by).hex()

    return change


def put(*path: str, by: Any = None, value: Any = None) -> Callable[[dict[str, Any]], None]:
    """Another value at a place: `value`, or `by` of what is there."""

    def change(made: dict[str, Any]) -> None:
        *above, last = path
        for name in above:
            made = made[name]
        made[last] = value if by is None else by(made[last])

    return change


def scaled(text: str) -> str:
    return (0.98 * float.fromhex(text)).hex()


TIMES = (
    "Delta_ns", "delta_ns", "J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns",
    "A_ns", "A_sc_ns", "H_star_ns", "H_ns", "d_ns", "j_ns", "h0_ns",
)  # fmt: skip
CONSTANTS: dict[str, Callable[[dict[str, Any]], None]] = {
    **{f"{key} is shorter": shorter(key) for key in TIMES},
    "alpha is later": put("rest", "alpha_ns", by=lambda x: x * 51 // 50),
    "alpha is earlier": put("rest", "alpha_ns", by=lambda x: x * 49 // 50),
    "alpha follows another H": lambda made: (
        made["times"].update(H_ns=made["times"]["H_ns"] + 2_000_000)
        or made["rest"].update(alpha_ns=made["rest"]["alpha_ns"] + 10_000_000)
    ),
    "one more switch": put("rest", "switches", by=lambda x: x + 1),
    "half the switches": put("rest", "switches", by=lambda x: x // 2),
    "a truth is no number": put("rest", "switches", value=True),
    "more time to rest": put("rest", "within_ns", by=lambda x: x * 51 // 50),
    "E is smaller": put("rest", "reads", "sight.v", "within", by=scaled),
    "E of what SC does not read is smaller": put("rest", "reads", "sight.gap", "within", by=scaled),
    "E is larger": put("rest", "reads", "sight.v", "within", value=(0.06).hex()),
    "a leaf shows another state": put("rest", "reads", "sight.gap", "state", value="r.way"),
    "a state is not followed": lambda made: made["rest"]["reads"].pop("sight.way"),
    "a disturbance is smaller": nearer("disturbance", "high"),
    "a command is smaller": nearer("control", "high"),
    "an error is smaller": nearer("error", "low"),
    "an input less": lambda made: made["inputs"].pop(),
    "a drift is smaller": put("rest", "moves", "r.gap", by=lambda x: [scaled(x[0]), x[1]]),
    "a drift has the other side": put("rest", "moves", "r.gap", by=lambda x: x[::-1]),
    "a drift has both sides": put("rest", "moves", "r.gap", by=lambda x: [x[0], x[0]]),
    "a drift is left out": lambda made: made["rest"]["moves"].pop("r.way"),
    "a state of the box less": lambda made: made["rest"]["box"].clear(),
    "a way of another state": put("rest", "ways", "r.gap", value=["0x0.0p+0", "0x1.0p+0"]),
    "another plant": put("plants", value=["q"]),
    "P3 is proved": put("claims", "P3", value="proved"),
    "ttf is proved": put("claims", "ttf", value="proved"),
    "P2b is proved": put("claims", "P2b", value="proved"),
    "P1c is proved": put("claims", "P1c", value="proved"),
    "a law is proved": put("claims", "failsafe", value="proved"),
    "a time to return": put("recover_ns", value=10**9),
    "a start without rest": put("claims", "P2a", value="undecided"),
    "one field more": put("rest", "sure", value=True),
    "no box": lambda made: made["rest"].pop("box"),
}


@pytest.fixture(scope="module")
def right() -> tuple[Any, dict[str, Any]]:
    return train()


@all_rows("name", CONSTANTS)
def test_other_constants_than_those_of_the_program_are_seen(
    name: str, right: tuple[Any, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is followed: the constants alone are refused."""
    monkeypatch.setattr(check_rest, "_claim_checks", lambda *_: ())
    flat, made = right[0], deepcopy(right[1])
    recheck_rest(flat, made)
    if name == "P1c is proved":  # all times are declared
        flat, made = train(PLAIN)
    if name == "a start without rest":
        monkeypatch.undo()
    CONSTANTS[name](made)
    with pytest.raises((RejectedError, NotRecheckedError)):
        recheck_rest(flat, made)


def test_older_reads_than_there_are_may_be_claimed(right: tuple[Any, dict[str, Any]]) -> None:
    """A claim about more schedules; of much older ones it is too much, and asked of those alone."""
    made = deepcopy(right[1])
    made["times"]["d_ns"] += 4_000_000
    _, report = recheck_rest(right[0], made)
    assert report.times["d_ns"] in (made["times"]["d_ns"], right[1]["times"]["d_ns"])


# ---------------------------------------------------------------- what is shown

ANSWERS, KEEPS, DRIFTS = ("show_answers",), ("show_rule_1",), ("show_rule_2",)
LEADS = (*KEEPS, *DRIFTS)
ALL = (*ANSWERS, *LEADS)
"""Parts of the re-checker that see something; what SC does not answer has no chain either."""
PROGRAMS: dict[str, tuple[tuple[str, ...], str, tuple[str, str]]] = {
    "SC accelerates": (LEADS, PLAIN, ("gas: 0.0, brake: 1.0 }; }", "gas: 1.0, brake: 0.0 }; }")),
    "SC leaves a little gas": (
        LEADS, PLAIN, ("gas: 0.0, brake: 1.0 }; }", "gas: 0.4, brake: 1.0 }; }"),
    ),
    "SC does nothing": (DRIFTS, PLAIN, ("brake: 1.0 }; }", "brake: 0.0 }; }")),
    "it drifts farther": (DRIFTS, PLAIN, ("CREEP: float = 0.3", "CREEP: float = 0.14")),
    "it drifts both ways": (DRIFTS, PLAIN, ("sight.gap by CREEP down", "sight.gap by CREEP")),
    "the one in front backs": (DRIFTS, PLAIN, ("front: float in [0.0", "front: float in [-0.1")),
    "it is pushed": (
        DRIFTS, PLAIN, ("BRAKE * levers.brake * v;", "BRAKE * levers.brake * v + 0.01 * front;"),
    ),
    "the brake is weaker": (DRIFTS, PLAIN, ("BRAKE: float = 2.0", "BRAKE: float = 0.9")),
    "SC publishes too much": (
        ALL, PLAIN, ("gas: 0.0, brake: 1.0 }; }", "gas: 0.0, brake: 1.5 }; }"),
    ),
    "SC faults on its set": (
        ALL, TRAIN, ("brake: clamp(1.0", "brake: clamp(0.0 / (sight.v - 39.99) + 1.0"),
    ),
    "SC asserts": (
        ALL, TRAIN, ("  step { publish levers = { gas: 0.0",
                         "  step { assert sight.v < 39.99; publish levers = { gas: 0.0"),
    ),
    "SC has the wrong sign": (KEEPS, HELD, ("-3.0 * seen", "3.0 * seen")),
    "SC does nothing about wind": (KEEPS, HELD, ("-3.0 * seen", "-0.0 * seen")),
    "SC looks elsewhere": (KEEPS, HELD, ("-3.0 * seen", "-3.0 * (seen - 0.35)")),
    "the wind is stronger": (KEEPS, HELD, ("in [-0.2, 0.2]", "in [-1.1, 1.1]")),
    "errors are larger": (KEEPS, HELD, ("seen within 0.02", "seen within 0.25")),
    "rest is wider": (KEEPS, HELD, ("abs(seen) < 0.3", "abs(seen) < 0.31")),
    "rest holds nowhere": (KEEPS, HELD, ("abs(seen) < 0.3", "abs(seen) < 0.3 && seen > 0.31")),
}  # fmt: skip


def without(parts: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """A re-checker that lacks these parts."""
    for part in parts:
        monkeypatch.setattr(check_rest, part, lambda *_: None)


@all_rows("name", PROGRAMS)
def test_rest_is_not_confirmed_of_programs_that_do_not_keep_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All constants are those of the wrong program."""
    parts, text, change = PROGRAMS[name]
    flat, made = (held if text is HELD else train)(changed(text, change))
    made["claims"]["start"] = "undecided"
    with pytest.raises((RejectedError, NotRecheckedError)):
        recheck_rest(flat, made)
    without(parts, monkeypatch)
    _, report = recheck_rest(flat, made)
    assert "P2a" in report.confirmed


def test_a_topic_of_sc_needs_no_set_if_its_state_stays_below_a_bound() -> None:
    """The state may be anything up to that bound, and SC answers all of it."""
    flat, made = train(changed(TRAIN, ("sight: Sight in { v in [-2.0, 40.0] }", "sight: Sight")))
    made["claims"]["start"] = "undecided"
    _, report = recheck_rest(flat, made)
    assert "P2a" in report.confirmed
    assert any("r.v, whose topic has no smaller set" in a.text for a in report.assumptions)


LANE = """soter 1;
type Pose = { y: float, psi: float };
topic pose: Pose in { y in [-3.0, 3.0], psi in [-0.5, 0.5] } max_age 20ms;
topic turn: float in [-0.5, 0.5] = 0.0;
node Ac period 50ms { publishes turn; step { publish turn = 0.5; } }
node Sc period 50ms { subscribes pose; publishes turn;
  step { publish turn = clamp(-0.1 * pose.y - 2.0 * pose.psi, -0.5, 0.5); } }
rta Lane { ac Ac; sc Sc; period 100ms; safe abs(pose.y) < 1.75;
  rest abs(pose.y) < 0.9 && abs(pose.psi) < 0.15 within 4s;
  verify { late dm 1ms, sc 1ms; response dm 1ms, sc 1ms; acts within 3ms; } }
plant Car period 10ms { reads turn; drives pose = { y: y, psi: psi };
  state y: float = 0.0; state psi: float = 0.0;
  disturbance wind: float in [-0.02, 0.02]; disturbance slide: float in [-0.05, 0.05];
  der y = 10.0 * sin(psi) + slide; der psi = turn + wind;
  measured pose.y within 0.05, pose.psi within 0.01; }
system S default { p: Car; module Lane; until 10s; }
"""
AROUND = {"p.y": (-0.91, 0.91), "p.psi": (-0.151, 0.151)}


SETS: dict[str, tuple[type[Exception], dict[str, Any], dict[str, Any]]] = {
    "the box is too small": (NotRecheckedError, {"p.v": (-0.29, 0.305)}, {"p.v": (-0.4, 0.4)}),
    "SC comes out of the ways": (NotRecheckedError, AROUND, AROUND | {"p.psi": (-0.4, 0.4)}),
    "ways within the box": (RejectedError, {"p.v": (-0.305, 0.305)}, {"p.v": (-0.3, 0.4)}),
    "a box upside down": (RejectedError, {"p.v": (0.305, -0.305)}, {"p.v": (-0.4, 0.4)}),
    "ways beyond the set": (RejectedError, {"p.v": (-0.305, 0.305)}, {"p.v": (-2.5, 0.4)}),
}
"""What is not shown is not re-checked; what is false is rejected."""


@pytest.mark.parametrize("name", SETS)
def test_other_sets_are_not_confirmed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    why, box, ways = SETS[name]
    flat = flat_of(LANE if box is AROUND else HELD)
    made = entry(flat, box, ways)
    made["claims"]["start"] = "undecided"
    with pytest.raises(why):
        recheck_rest(flat, made)
    without(KEEPS, monkeypatch)
    recheck_rest(flat, made)


def test_a_rest_of_two_states_is_confirmed() -> None:
    flat = flat_of(LANE)
    ways = {"p.y": (-1.74, 1.74), "p.psi": (-0.2, 0.2)}
    _, report = recheck_rest(flat, entry(flat, AROUND, ways))
    assert report.lacks_flight_only


def test_a_wider_box_needs_a_longer_drift() -> None:
    flat = flat_of(PLAIN)
    with pytest.raises(NotRecheckedError, match="how far SC moves"):
        recheck_rest(flat, entry(flat, {"r.v": (-1.0, 1.0)}, {"r.v": (-1.1, 1.1)}))


STARTS = {
    "too near": ("gap: float = 60.0", "gap: float = 0.1"),
    "too far": ("way: float = 0.0;", "way: float = 398.0;"),
    "too little time": ("within 5s", "within 1s"),
}


@pytest.mark.parametrize("name", STARTS)
def test_a_start_from_which_sc_does_not_come_to_rest_is_not_confirmed(name: str) -> None:
    flat, made = train(changed(PLAIN, STARTS[name]))
    with pytest.raises(NotRecheckedError, match="start"):
        recheck_rest(flat, made)
    made["claims"]["start"] = "undecided"
    _, report = recheck_rest(flat, made)
    assert not report.lacks_flight_only


TOPICS = "".join(f"topic {n}: float in [-40.0, 40.0] max_age 20ms;\n" for n in ("own", "two"))
REFUSED = {
    "SC sees what its DM does not": (
        ("topic levers:", f"{TOPICS}topic levers:"),
        ("  state gap:", "  drives own = v;\n  drives two = v;\n  state gap:"),
        ("  subscribes sight;\n  publishes levers;\n  step { publish levers = { gas: 0.0",
         "  subscribes own, two;\n  publishes levers;\n  step { publish levers = { gas: 0.0"),
        ("clamp(1.0 + sight.v", "clamp(1.0 + own + 0.0 * two"),
    ),
    "SC keeps a list": (
        (PUBLISHES, "  var n: float[<=3];\n" + PUBLISHES.replace("{ pub", "{ n = [1.0]; pub")),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_the_theorem_does_not_have_is_not_rechecked(name: str) -> None:
    right = train()[1]
    with pytest.raises(NotRecheckedError):
        recheck_rest(flat_of(changed(TRAIN, *REFUSED[name])), right)


def test_an_entry_for_another_module_is_not_confirmed() -> None:
    """One that says `rest` where there is none."""
    _, made = train(PLAIN)
    clause = next(x.strip() for x in PLAIN.splitlines() if x.startswith("  rest "))
    plain = changed(PLAIN, (clause, "ttf true; safer false;"))
    with pytest.raises(RejectedError, match="no `rest`"):
        recheck_rest(flat_of(plain), made)


JUDGED = changed(HELD, (" rest abs(seen)", " shield; rest abs(seen)"))
SHIELD = {
    "any may act for too short a time": ("any_command_ns", -1),
    "a command counts for too short a time": ("acted_ns", -1),
    "cells are wider": ("cells", -1),
    "cells are narrower": ("cells", 1),
}


@pytest.mark.parametrize("name", SHIELD)
def test_how_commands_are_judged_is_held_to_the_program(name: str) -> None:
    flat, given = held(JUDGED)
    recheck_rest(flat, deepcopy(given))
    key, by = SHIELD[name]
    given["rest"]["shield"][key] += by
    with pytest.raises(RejectedError, match=key):
        recheck_rest(flat, given)


def test_a_shield_is_in_the_certificate_where_the_program_has_one() -> None:
    flat, given = held(JUDGED)
    shield = given["rest"].pop("shield")
    assert shield == {"cells": 64, "any_command_ns": 0, "acted_ns": 40_000_000}
    with pytest.raises((RejectedError, LookupError)):
        recheck_rest(flat, given)
    given["rest"]["shield"] = {"cells": 64}
    with pytest.raises(RejectedError, match="how commands are judged"):
        recheck_rest(flat, given)
    flat, given = held()
    given["rest"]["shield"] = shield
    with pytest.raises(RejectedError):
        recheck_rest(flat, given)


def test_longer_times_of_a_shield_are_sound() -> None:
    flat, given = held(JUDGED)
    given["rest"]["shield"]["any_command_ns"] += 1
    recheck_rest(flat, given)


BESIDE = changed(
    HELD,
    ("topic push", "topic near: float max_age 20ms;\ntopic push"),
    ("plant Speed", ("plant Walker period 10ms { drives near = d; state d: float = 3.0;\n"
     "  disturbance walks: float in [-1.6, 1.6]; der d = walks; measured near within 0.05; }\n"
     "plant Speed")),
    ("p: Speed;", "p: Speed; w: Walker;"),
    ("safe abs(seen) < 1.0", "safe near > 0.2 || abs(seen) < 0.5"),
)  # fmt: skip
"""Who walks beside it may walk for ever: `safe` asks nothing of them at rest."""
FREE = {
    "its rate reads it": ("der d = walks", "der d = walks * d"),
    "a set bounds it": ("near: float max", "near: float in [-9.0, 9.0] max"),
    "safe needs it at rest": ("< 0.5", "< 0.5 && near > 0.1"),
}


def free(text: str, *names: str) -> tuple[Any, dict[str, Any]]:
    flat, made = held(text)
    made["rest"]["moves"].update({key: [None, None] for key in names})
    return flat, made


def test_of_a_state_that_safe_does_not_need_at_rest_nothing_is_claimed() -> None:
    flat, made = free(BESIDE, "w.d")
    _, report = recheck_rest(flat, made)
    assert report.confirmed == ["P1a", "P1b", "P2a", "start"]
    assert "w.d" in next(a.text for a in report.assumptions if a.key == "far w.d")
    with pytest.raises(RejectedError):
        recheck_rest(*free(BESIDE))  # neither named nor in the box
    both = free(BESIDE, "w.d", "p.v")
    both[1]["rest"].update(box={}, ways={})
    with pytest.raises(RejectedError):
        recheck_rest(*both)


@pytest.mark.parametrize("name", FREE)
def test_where_something_is_needed_of_a_state_claiming_nothing_is_not_enough(name: str) -> None:
    old, new = FREE[name]
    with pytest.raises((RejectedError, NotRecheckedError)):
        recheck_rest(*free(changed(BESIDE, (old, new)), "w.d"))


def test_where_rest_reads_a_state_only_as_it_is_read_here_nothing_is_rejected() -> None:
    """Whoever sees that `rest` does not depend on it claims nothing of it, and is right."""
    text = changed(BESIDE, ("rest abs(seen) < 0.3", "rest abs(seen) < min(max(near, 0.3), 0.3)"))
    with pytest.raises(NotRecheckedError, match="read at rest"):
        recheck_rest(*free(text, "w.d"))
