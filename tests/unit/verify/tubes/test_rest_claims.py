"""What `soter verify` says of a module with `rest`, of right ones and of ones that are wrong."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import Program
from soter.certificate.rechecker import recheck
from soter.diagnostics.diagnostic import SoterError
from soter.verify.tubes.tube_levels import TubeLevels

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

FOLLOW = Path(__file__).parents[4] / "examples" / "evidence" / "follow.soter"
SENSED = FOLLOW.read_text(encoding="utf-8").replace(
    """  publishes levers;
  step { publish levers = { gas: 0.0, brake: 1.0 }; }""",
    """  subscribes sight;
  publishes levers;
  step { publish levers = { gas: 0.0, brake: clamp(1.0 + sight.v, 0.0, 1.0) }; }""",
)
"""SC brakes by what it sees."""


def verified(
    folder: Path, text: str, cert: Path | None = None, explain: bool | None = None
) -> ModuleResult:
    path = folder / "module.soter"
    path.write_text(text, encoding="utf-8")
    return (
        Program(str(path)).verify(refute=False, cert=cert, explain=explain, budget_s=0.0).modules[0]
    )


def test_a_rest_that_is_kept_is_proved_and_the_decisions_are_not(tmp_path: Path) -> None:
    for text in (FOLLOW.read_text(encoding="utf-8"), SENSED):
        m = verified(tmp_path, text)
        assert m.verdict == "assumed"
        said = {n: f.verdict for n, f in m.findings.items()}
        assert (said["P2a"], said["start"]) == ("proved", "proved")
        assert {said[n] for n in ("P3", "ttf", "safer", "P2b", "DM")} == {"assumed"}
        assert "tubes" in {a.key for a in m.assumptions}
        assert m.not_rechecked == ""


def test_a_start_is_not_claimed_where_rest_is_not_shown(tmp_path: Path) -> None:
    """How far it drifts is not: SC leads to rest, and nobody knows what it does there."""
    text = FOLLOW.read_text(encoding="utf-8").replace(*WRONG["it drifts farther"])
    m = verified(tmp_path, text, tmp_path / "proof")
    assert m.findings["start"].verdict == "undecided"
    assert m.findings["start"].text == m.findings["P2a"].text
    assert recheck(tmp_path / "proof").verdict != "rejected"


WRONG = {
    "SC accelerates": ("gas: 0.0, brake: 1.0 }; }", "gas: 1.0, brake: 0.0 }; }"),
    "SC leaves a little gas": ("gas: 0.0, brake: 1.0 }; }", "gas: 0.1, brake: 1.0 }; }"),
    "SC does nothing": ("gas: 0.0, brake: 1.0 }; }", "gas: 0.0, brake: 0.0 }; }"),
    "it drifts farther": ("param CREEP: float = 0.3", "param CREEP: float = 0.1"),
    "it drifts both ways": ("sight.gap by CREEP down", "sight.gap by CREEP"),
    "the one in front backs": ("front: float in [0.0", "front: float in [-0.1"),
    "it is pushed": (
        "BRAKE * levers.brake * v;",
        "BRAKE * levers.brake * v + 0.1 * (front - 15.0);",
    ),
    "no time to rest": ("within 5s", "within 40ms"),
    "the way is not named": (", sight.way by CREEP up within", " within"),
    "SC may publish too much": ("gas: 0.0, brake: 1.0 }; }", "gas: 0.0, brake: 1.5 }; }"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_of_rest_is_not_proved(tmp_path: Path, name: str) -> None:
    old, new = WRONG[name]
    text = FOLLOW.read_text(encoding="utf-8")
    assert text.count(old) == 1
    m = verified(tmp_path, text.replace(old, new))
    assert m.findings["P2a"].verdict == "undecided"
    assert m.verdict == "undecided"


@pytest.mark.parametrize("shield", ["", "shield; "])
def test_the_time_that_is_named_where_within_is_too_long_is_followed(
    tmp_path: Path, shield: str
) -> None:
    """Also by the check that flies, which judges commands besides."""
    text = FOLLOW.read_text(encoding="utf-8").replace("  rest abs(", f"  {shield}rest abs(")
    with pytest.raises(SoterError) as caught:
        verified(tmp_path, text.replace("within 5s", "within 2h"))
    named = re.search(r"`(within \S+)` at most", caught.value.diagnostics[0].helps[0])
    assert named is not None
    m: Any = verified(tmp_path, text.replace("within 5s", named[1]))
    assert m.verdict == "assumed"
    assert "good" in TubeLevels.of_check(m.check, m.claims.ways, None).functions_by_name


def test_reads_that_are_many_periods_old_are_named_where_they_make_it_long(tmp_path: Path) -> None:
    late = HELD.replace("within 2s;", "within 200s; verify { dropout 2s; }")
    with pytest.raises(SoterError) as caught:
        verified(tmp_path, late)
    assert "`dropout`" in caught.value.diagnostics[0].helps[1]


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
"""Nothing moves at rest: SC has to lead back, and nothing else is shown."""
NOT_KEPT = {
    "SC pushes the wrong way": ("-3.0 * seen", "3.0 * seen"),
    "SC does nothing": ("clamp(-3.0 * seen, -1.0, 1.0)", "0.0 * seen"),
    "SC looks elsewhere": ("-3.0 * seen", "-3.0 * (seen - 0.5)"),
    "the wind is stronger": ("wind: float in [-0.2, 0.2]", "wind: float in [-1.1, 1.1]"),
    "what is seen is too far off": ("seen within 0.02", "seen within 0.4"),
}


def test_a_rest_that_sc_leads_back_to_is_proved(tmp_path: Path) -> None:
    assert verified(tmp_path, HELD).findings["P2a"].verdict == "proved"


@pytest.mark.parametrize("name", NOT_KEPT)
def test_a_rest_that_sc_does_not_lead_back_to_is_not_proved(tmp_path: Path, name: str) -> None:
    old, new = NOT_KEPT[name]
    assert HELD.count(old) == 1
    finding = verified(tmp_path, HELD.replace(old, new)).findings["P2a"]
    assert finding.verdict == "undecided"
    assert "lead back" in finding.text
    assert "`acts within`" not in finding.hint
    late = HELD.replace(old, new).replace("within 2s;", "within 2s; verify { acts within 7ms; }")
    told = verified(tmp_path, late).findings["P2a"].hint
    if name == "SC looks elsewhere":  # then no quicker command helps, and the place is named
        assert "`rest` does not hold where SC brings the plant" in told
    elif name == "SC does nothing":
        assert told.startswith("SC does not move `seen`, which `rest` bounds")
    else:
        assert "`acts within`, now 7 ms" in told


@pytest.mark.parametrize(
    ("law", "rest", "safe", "said"),
    [
        ("0.0 * seen", "seen < 0.3", "seen < 1.0", "SC does not move `seen`"),
        ("0.1 * seen", "seen > -0.3", "seen > -1.0", "bound seen in `rest`"),
        ("0.0 * seen", "seen < 0.3", "abs(seen) < 1.0", "`rest` holds where `safe` does not"),
        ("0.1 * seen", "abs(seen) < 0.3", "abs(seen) < 1.0", "what disturbances do"),
    ],
)
def test_a_state_that_rest_leaves_without_an_end_is_told_to_be_bounded(
    tmp_path: Path, law: str, rest: str, safe: str, said: str
) -> None:
    old, _ = NOT_KEPT["SC does nothing"]
    text = HELD.replace(old, f"clamp({law}, -1.0, 1.0)").replace("abs(seen) < 0.3", rest)
    text = text.replace("abs(seen) < 1.0", safe)
    endless = text.replace(" in [-2.0, 2.0]", "")
    assert verified(tmp_path, endless).findings["P2a"].hint.startswith(said)
    assert not verified(tmp_path, text).findings["P2a"].hint.startswith("bound")


BESIDE = (
    ("topic push", "topic near: float max_age 20ms;\ntopic push"),
    ("plant Speed", ("plant Walker period 10ms { drives near = d; state d: float = 3.0;\n"
     "  disturbance walks: float in [-1.6, 1.6]; der d = walks; measured near within 0.05; }\n"
     "plant Speed")),
    ("p: Speed;", "p: Speed; w: Walker;"),
)  # fmt: skip


@pytest.mark.parametrize(
    ("safe", "push", "proved"),
    [
        ("near > 0.2 || abs(seen) < 0.5", "walks", True),
        ("near > 0.2 || abs(seen) < 0.5 && near > 0.1", "walks", False),
        ("near > 0.2 && abs(seen) < 1.0", "walks", False),
        ("near > 0.2 || abs(seen) < 0.5", "walks * d", False),
        ("near > 0.2 || abs(seen) < 0.2", "walks", False),
    ],
    ids=["not at rest", "at rest", "always", "it may end", "`rest` is wider than `safe`"],
)
def test_a_state_that_safe_does_not_need_at_rest_needs_no_bound(
    tmp_path: Path, safe: str, push: str, proved: bool
) -> None:
    text = HELD
    pushed = ("der d = walks", f"der d = {push}")
    for old, new in (*BESIDE, pushed, ("safe abs(seen) < 1.0", f"safe {safe}")):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    result = verified(tmp_path, text)
    assert [result.findings[n].verdict == "proved" for n in ("P2a", "start")] == [proved] * 2
    assert not proved or any("w.d" in a.text for a in result.added)


@pytest.mark.parametrize("near", ["", " in [-1e120, 1e120]", " in [-1e100, 1e120]"])
def test_what_is_proved_beside_a_state_without_end_is_never_rejected(
    tmp_path: Path, near: str
) -> None:
    text = HELD.replace("safe abs(seen) < 1.0", "safe near > 0.2 || abs(seen) < 0.5")
    for old, new in BESIDE:
        text = text.replace(old, new)
    wide = text.replace("near: float max", f"near: float{near} max")
    m = verified(tmp_path, wide, tmp_path / "proof")
    assert (m.findings["P2a"].verdict == "proved") == (not near)
    assert recheck(tmp_path / "proof").verdict != "rejected"


@pytest.mark.parametrize(
    ("safe", "proved"),
    [
        ("sqrt(seen) >= sqrt(seen)", False),
        ("sqrt(seen) - sqrt(seen) >= 0.0", False),
        ("0.0 * sqrt(seen) >= 0.0", False),
        ("0.0 * tan(10.0 * seen + 1.0) >= 0.0", False),
        ("1e250 * (seen + 1e60) - 1e250 * (seen + 1e60) >= 0.0", False),
        ("sqrt(seen + 2.0) >= sqrt(seen + 2.0)", True),
        ("0.0 * seen * seen >= 0.0", True),
        ("seen * seen - seen * seen >= 0.0", True),
    ],
)
def test_a_constant_stands_for_an_expression_only_where_that_is_a_finite_number(
    tmp_path: Path, safe: str, proved: bool
) -> None:
    """Else the program computes NaN, of which no comparison is true: `safe` does not hold."""
    text = HELD.replace("safe abs(seen) < 1.0", f"safe {safe} && abs(seen) < 1.0")
    assert (verified(tmp_path, text).findings["start"].verdict == "proved") == proved


def test_what_sc_reads_and_rest_hangs_on_needs_no_set_and_is_taken_to_have_an_end(
    tmp_path: Path,
) -> None:
    for text, names, wide in (
        (HELD, "p.v", ""),
        (HELD, "p.v", " in [-1e120, 1e120]"),
        (SENSED, "r.v", ""),
    ):
        unbounded = text.replace("float in [-2.0, 2.0]", f"float{wide}")
        unbounded = unbounded.replace("sight: Sight in { v in [-2.0, 40.0] }", "sight: Sight")
        assert unbounded != text
        m = verified(tmp_path, unbounded, tmp_path / "proof")
        assert m.findings["P2a"].verdict == m.findings["start"].verdict == "proved"
        (told,) = [a.text for a in m.assumptions if a.key == "far"]
        assert told == (
            f"states whose topics have no sets, or larger ones, stay below 1e+100: {names}"
        )
        report = recheck(tmp_path / "proof")
        assert report.accepted, report.reason
        again = [a.text for a in report.modules[0].assumptions]
        assert f"{names}, whose topic has no smaller set, stays below 1e+100" in again


def test_an_sc_that_reads_answers_on_all_that_it_may_read(tmp_path: Path) -> None:
    curved = HELD.replace("float in [-2.0, 2.0]", "float").replace(
        "-3.0 * seen", "-3.0 * sin(seen)"
    )
    finding = verified(tmp_path, curved).findings["P2a"]
    assert finding.hint.startswith("sets of what SC reads, as `seen in [-l, l]` in its topic; or")
    faulty = SENSED.replace("brake: clamp(", "brake: clamp(1.0 / sight.v + ")
    assert "may fault" in verified(tmp_path, faulty).findings["P2a"].text


def refused(folder: Path, text: str) -> str:
    """As `verify` refuses it; `check` warns of the same."""
    with pytest.raises(SoterError) as caught:
        verified(folder, text)
    assert caught.value.diagnostics[0].code == "R007"
    warned = Program(str(folder / "module.soter")).check().warnings
    assert caught.value.diagnostics[0].message in [w.message for w in warned if w.code == "R007"]
    return caught.value.diagnostics[0].message


def test_an_sc_that_the_theorem_does_not_have_is_refused(tmp_path: Path) -> None:
    """A topic of its own may be older than the estimate; an integral without a limit has no end."""
    topics = [f"topic {n}: float in [-2.0, 40.0] max_age 20ms;\n" for n in ("one", "two")]
    sees = SENSED.replace("topic levers:", "".join([*topics, "topic levers:"]))
    sees = sees.replace("  state gap:", "  drives one = v;\n  drives two = v;\n  state gap:")
    behind = ";\n  publishes levers;\n  step { publish"
    sees = sees.replace(f"  subscribes sight{behind}", f"  subscribes one, two{behind}")
    sees = sees.replace("clamp(1.0 + sight.v", "clamp(1.0 + one")
    assert "does not read" in refused(tmp_path, sees)
    step = "  publishes levers;\n  step { publish"
    keeps = FOLLOW.read_text(encoding="utf-8").replace(
        step,
        "  publishes levers;\n  var n: float = 0.0;\n  step { n = n + 0.1; publish",
    )
    assert "no bound is seen of `n`" in refused(tmp_path, keeps)
    jumps = SENSED.replace("BRAKE * levers.brake * v;", "BRAKE * levers.brake * wrap_angle(v);")
    assert "its rate jumps" in refused(tmp_path, jumps)


def test_more_than_a_step_can_follow_is_refused(tmp_path: Path) -> None:
    text = FOLLOW.read_text(encoding="utf-8").replace("within 5s", "within 500s")
    assert "10000 steps" in refused(tmp_path, text)


def test_flights_are_safe_and_the_same_in_both_engines(tmp_path: Path) -> None:
    """AC does whatever its draws say; the module is what keeps the train off the end."""
    path = tmp_path / "wild.soter"
    text = FOLLOW.read_text(encoding="utf-8").replace(
        "gas: clamp(wanted, 0.0, 1.0), brake: clamp(-wanted, 0.0, 1.0)",
        "gas: choose { 0.0, 1.0 }, brake: choose { 0.0, 0.05 }",
    )
    path.write_text(text, encoding="utf-8")
    program = Program(str(path))
    for seed in range(1, 5):
        run = program.simulate(until="30s", seed=seed)
        assert run.violations == 0
        assert 0.0 < run.modules["Follow"].ac_share < 1.0
    one, two = (program.simulate(until="1s", engine=e) for e in ("native", "interp"))
    assert one.trace_sha256 == two.trace_sha256


# ---------------------------------------------------------------- younger reads


SLED = """soter 1;
topic at: float max_age 500ms;
topic push: float in [-1.0, 1.0] = 0.0;
plant Sled period 10ms {
  reads push;
  drives at = x;
  state x: float = 0.0;
  disturbance wind: float in [-0.1, 0.1];
  der x = push + wind;
  measured at within 0.01;
}
node Go period 100ms { publishes push; step { publish push = 1.0; } }
node Back period 100ms {
  subscribes at; publishes push; step { publish push = clamp(-4.0 * at, -1.0, 1.0); } }
rta Keep {
  ac Go;
  sc Back;
  period 100ms;
  safe abs(at) < 3.0;
  rest abs(at) < 0.2 within 2s;
}
system S default { s: Sled; module Keep; until 2s; }
"""


def test_younger_reads_that_are_told_show_rest_when_they_are_written(tmp_path: Path) -> None:
    found = verified(tmp_path, SLED, explain=True).findings["P2a"]
    assert found.verdict == "undecided"
    told = re.search(r"`(verify { age \w+; })` \(tried: rest is shown\)", found.hint)
    assert told is not None
    again = verified(tmp_path, SLED.replace("within 2s;", f"within 2s; {told[1]}"))
    assert again.findings["P2a"].verdict == "proved"


def test_younger_reads_that_do_not_help_are_told_as_such(tmp_path: Path) -> None:
    """None are tried where a run that reads what is new is not back."""
    for old, new, outcome in (
        ("within 0.01", "within 0.25", ["(tried: not enough)"]),
        ("in [-0.1, 0.1]", "in [-2.0, 2.0]", []),
    ):
        found = verified(tmp_path, SLED.replace(old, new), explain=True).findings["P2a"]
        assert found.verdict == "undecided"
        assert re.findall(r"\(tried: [^)]*\)", found.hint) == outcome


def test_what_leads_out_of_rest_is_named_with_how_far(tmp_path: Path) -> None:
    """A sled that coasts in the wind: the tube of each part grows, and that is said."""
    found = verified(tmp_path, SLED, explain=False).findings["P2a"]
    told = re.search(r"on the way there it may be s\.x in \[(\S+), (\S+)\]", found.text)
    assert told is not None
    assert float(told[1]) < -0.2 < 0.2 < float(told[2])


def test_nothing_is_tried_where_nobody_asks_for_it(tmp_path: Path) -> None:
    found = verified(tmp_path, SLED, explain=False).findings["P2a"]
    assert found.verdict == "undecided"
    assert "(tried:" not in found.hint
