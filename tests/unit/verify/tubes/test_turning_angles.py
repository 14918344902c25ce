"""Angles that need not come back at rest: each condition of "An angle that turns" is asked for.

A condition that is left out makes one of these programs proved, and each of them is wrong.
"""

from __future__ import annotations

import random
from fractions import Fraction
from pathlib import Path

import pytest
from bench.tubes.tube_module import Loop, module_of

from long_tests import examples, seed_of
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.rest_claims import RestClaims, show_rest_claims
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.turns import A_TURN
from tables import all_rows
from unit.certificate.tubes.test_forged_rest import changed
from unit.verify.tubes.test_rest_claims import verified

BOAT = Path(__file__).with_name("turning_boat.soter").read_text(encoding="utf-8")
SC = "let u = clamp(-2.0 * fix.x, -0.9, 0.9);"
AHEAD, RATE = "ahead: u * cos(fix.h)", "der x = way.ahead * cos(h) - way.abeam * sin(h) + east;"
SAFE, REST = "safe abs(fix.x) + 0.2 * abs(cos(fix.h)) < 2.0;", "rest abs(fix.x) < 0.4 within"


def check_of(text: str) -> TubeCheck:
    flat = system_to_prove(check_file("boat.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def turning(text: str) -> bool:
    return bool(check_of(text).turning)


def shown(text: str) -> RestClaims:
    return show_rest_claims(check_of(text))


READ_MODULO_TURNS = {
    "as it is": (AHEAD, AHEAD),
    "the other way round": (AHEAD, "ahead: u * cos(-fix.h)"),
    "beside another state": (AHEAD, "ahead: u * cos(0.1 * fix.x - fix.h)"),
    "wrapped": (AHEAD, "ahead: u * 0.1 * wrap_angle(fix.h - 1.0)"),
    "twice": (AHEAD, "ahead: u * cos(fix.h + sin(fix.h))"),
    "in a branch": (AHEAD, "ahead: cos(fix.h) > 0.5 ? u : 0.5 * u"),
    "by rest": (REST, "rest abs(fix.x) < 0.4 && cos(fix.h) < 2.0 within"),
    "in a tangent": (RATE, RATE.replace("+ east", "+ east + tan(0.01 * sin(h))")),
}
COUNTED = {
    "cancelled": (AHEAD, "ahead: fix.h + 1.0e-13 > fix.h ? u : 0.9"),
    "cancelled in an angle": (AHEAD, "ahead: u * sin(1.0e12 * ((fix.h + 0.3) - fix.h))"),
    "cancelled by rest": (REST, "rest abs(fix.x) < 0.4 && fix.h + 1.0e-13 > fix.h within"),
    "half of it by SC": (AHEAD, "ahead: u * cos(0.5 * fix.h)"),
    "twice of it by SC": (AHEAD, "ahead: u * cos(fix.h + fix.h)"),
    "with another state as its factor": (AHEAD, "ahead: u * cos(fix.h * fix.x)"),
    "wrapped twice": (AHEAD, "ahead: u * 0.1 * wrap_angle(2.0 * fix.h)"),
    "as it is": (AHEAD, "ahead: clamp(u + 0.001 * fix.h, -1.0, 1.0)"),
    "in a limit": (AHEAD, "ahead: u * cos(clamp(fix.h, -9.0, 9.0))"),
    "by a branch": (AHEAD, "ahead: fix.h > 9.0 ? 0.0 : u * cos(fix.h)"),
    "half of it by a plant": (RATE, RATE.replace("cos(h)", "cos(0.5 * h)")),
    "as it is by a plant": (RATE, RATE.replace("+ east", "+ east + 1e-9 * h")),
    "of a plant that counts": ("der h = 0.3;", "der h = 0.3 - 1e-9 * h;"),
    "by safe": (SAFE, SAFE.replace("< 2.0", "< 2.0 && fix.h < 1e3")),
    "half of it by safe": (SAFE, SAFE.replace("cos(fix.h)", "cos(0.5 * fix.h)")),
    "by rest": (REST, "rest abs(fix.x) < 0.4 && abs(fix.h) < 9.0 within"),
    "by moves": ("within 1s", "moves fix.h by 1.0 within 1s"),
    "by a set": ("topic fix: Fix max_age", "topic fix: Fix in { h in [-9e4, 9e4] } max_age"),
    "in many sums": (AHEAD, f"ahead: u * cos(fix.h{' + 0.1' * 8})"),
}


@all_rows("name", READ_MODULO_TURNS)
def test_an_angle_that_all_reads_modulo_a_turn_may_turn(name: str) -> None:
    assert turning(changed(BOAT, READ_MODULO_TURNS[name]))


@all_rows("name", COUNTED)
def test_whoever_counts_turns_makes_an_angle_come_back(name: str) -> None:
    assert not turning(changed(BOAT, COUNTED[name]))


def test_another_topic_with_a_set_counts_turns() -> None:
    """Where a plant can publish no more its run would end, and nothing be said of it."""
    more = ("topic way:", "topic other: float in [-1e6, 1e6];\ntopic way:")
    drives = ("  drives fix", "  drives other = h + 1.0;\n  drives fix")
    assert not turning(changed(BOAT, more, drives))


ROLLS = """soter 1;
topic p: { x: float, h: float } max_age 20ms;
topic u: float in [-1.0, 1.0] = 0.0;
node Go period 50ms { publishes u; step { publish u = 1.0; } }
node Stop period 100ms { publishes u; step { publish u = 0.0; } }
rta M { ac Go; sc Stop; period 100ms;
  safe abs(p.x) + 0.1 * cos(p.h) < 3.0; rest abs(p.x) < 1.0 within 1s; }
plant P period 10ms { reads u; drives p = { x: x, h: h };
  state x: float = 0.0; state h: float = 0.0;
  der x = RATE; der h = 0.3; }
system S default { p: P; module M; until 1s; }
"""


@pytest.mark.parametrize(
    ("rate", "kept"),
    [
        ("-x + 0.1 * cos(h)", True),
        ("-x * (1.3 + cos(h))", True),
        ("-x * (0.3 + cos(h))", False),
        # on [-pi, pi] it is positive, and 2000 times as far is where turns go on
        ("-x * (0.3 + cos(0.5 * h))", False),
    ],
)
def test_rest_is_shown_where_it_holds_of_all_headings(rate: str, kept: bool) -> None:
    assert (shown(ROLLS.replace("RATE", rate)).kept == "") == kept


SEAM = (
    ("RATE", "-x + 2e6 * max(0.0, -cos(h) - 0.9999988)"),
    ("der h = 0.3;", "der h = -0.1 * sin(h);"),
)
"""Pushed only between 3.1401 and 3.1431, from where all but one heading turns away."""


def test_rest_is_asked_of_the_headings_between_both_ends_of_a_turn() -> None:
    assert Fraction(A_TURN.high) - Fraction(A_TURN.low) > TURN
    assert shown(changed(ROLLS, ("RATE", "-x"), SEAM[1])).kept == ""
    assert shown(changed(ROLLS, *SEAM)).kept


def test_a_rate_that_wraps_an_angle_is_refused() -> None:
    """It jumps by a turn: no solution there is the only one."""
    with pytest.raises(SoterError, match="R007"):
        turning(ROLLS.replace("RATE", "-x").replace("h = 0.3;", "h = 0.3 - wrap_angle(h);"))


@pytest.mark.parametrize(
    ("law", "kept"),
    [
        (AHEAD, True),
        pytest.param("ahead: u * cos(fix.h + 0.3)", True, marks=pytest.mark.long),
        # it pushes away where the heading is near pi
        ("ahead: u * cos(fix.h) * (cos(fix.h) > -0.7 ? 1.0 : -1.0)", False),
        # any heading may be read
        ("ahead: u", False),
    ],
)
def test_an_sc_that_reads_the_heading_holds_its_place(law: str, kept: bool) -> None:
    """Where the heading is read is followed: as any function it would hold no place."""
    assert (shown(changed(BOAT, (AHEAD, law))).kept == "") == kept


BODY = "0.5 * abs(sin(p.h)) + 0.3 * abs(cos(p.h))"
"""How far corners of 1 m by 0.6 m reach to the side: 0.3 m at heading 0, 0.58 m elsewhere."""


@all_rows(
    ("middle", "body", "safe"),
    [(2.55, "0.1 * cos(p.h)", True), (2.55, BODY, False), (2.0, BODY, True)],
)
def test_what_rests_is_safe_however_far_it_turns(middle: float, body: str, safe: bool) -> None:
    """All that the DM looks at is at heading 0, where it is safe."""
    near = ("p.x) < 1.0", f"p.x - {middle}) < 0.1"), ("RATE", "0.0"), ("0.1 * cos(p.h)", body)
    check = check_of(changed(ROLLS, *near))
    ways = {0: Interval(middle - 0.1, middle + 0.1), 1: check.rooms[1]}
    there, caller = ([middle, 0.0], [middle, 0.0]), Caller(check.offline_text(ways))
    assert caller.returns_true("surely_rests", there)
    assert caller.returns_true("stays_safe", there) == safe


def test_it_is_said_how_far_an_angle_is_assumed_to_turn(tmp_path: Path) -> None:
    module = verified(tmp_path, ROLLS.replace("RATE", "-x"))
    said = [a.text for a in module.assumptions if a.key == "turns"]
    assert said == [
        "p.h stays within 16,384 rad of 0: it is read modulo a full turn, and need not come back"
    ]


LAW = "0.9 * sin(H - 0.7 + 0.3 * X)", "0.2 * wrap_angle(0.9 - H)"
TURN = 2 * Fraction(884279719003555, 281474976710656) + Fraction(2, 8165619676597685)
"""Of pi the nearest double and what it lacks."""


def test_what_sc_computes_many_turns_further_is_in_the_forms_of_a_turn() -> None:
    """Sums of large numbers are rounded by more."""
    ahead, abeam = (e.replace("H", "fix.h").replace("X", "fix.x") for e in LAW)
    pairs = (AHEAD, f"ahead: {ahead}"), ("abeam: -u * sin(fix.h)", f"abeam: {abeam}")
    forms = Caller(check_of(changed(BOAT, *pairs)).offline_text({}))
    body = ", ".join(e.replace("H", "h").replace("X", "x") for e in LAW)
    program = Caller(f"fun law(x: float, h: float): float[2] {{ return [{body}]; }}")
    drawn = random.Random(1)  # noqa: S311 - drawn examples
    for _ in range(300):
        x, far = drawn.uniform(-0.4, 0.4), drawn.choice((-1, 1)) * drawn.uniform(1.5e4, 2.0**14)
        near = float(Fraction(far) - TURN * round(far / TURN))
        read = forms.result("f_number", x), forms.result("f_range", near - 1e-15, near + 1e-15)
        for u, form in zip(program.result("law", x, far), forms.result("law", read), strict=True):
            assert form[2] <= u <= form[3] <= form[2] + 1e-8


def drawn_boat(number: int) -> str:
    """Another boat: how SC turns what it wants into its own directions, and what turns it."""
    r = random.Random(number)  # noqa: S311 - drawn examples
    off, sign = round(r.uniform(-3.0, 3.0), 2), r.choice(("", "-"))
    seen, true = (f"{sign}{h} + {off}" for h in ("fix.h", "h"))
    times = f"late sc {r.choice((0, 2))}ms; acts within {r.choice((0, 3))}ms;"
    gain, turned = r.choice((1.5, 2.0, 2.5)), r.choice((-1.0, -0.2, 0.1, 0.6))
    return changed(
        BOAT,
        ("-2.0 * fix.x", f"-{gain} * fix.x"),
        ("cos(fix.h), abeam: -u * sin(fix.h)", f"cos({seen}), abeam: -u * sin({seen})"),
        ("way.ahead * cos(h) - way.abeam * sin(h)",
         f"way.ahead * cos({true}) - way.abeam * sin({true})"),
        ("max_age 20ms", f"max_age {r.choice((0, 20, 40))}ms"),
        ("der h = 0.3", f"der h = {turned} + {r.choice(('east', '0.1 * way.ahead', '0.1 * x'))}"),
        ("h: float = 0.0;", f"h: float = {round(r.uniform(-9.0, 9.0), 2)};"),
        ("x) < 0.4", f"x) < {r.choice((0.4, 0.6))}"),
        ("  safe", f"  verify {{ {times} }}\n  safe"),
    )  # fmt: skip


@pytest.mark.parametrize("number", range(examples(2)))
@pytest.mark.random
def test_drawn_boats_stay_in_their_tubes_and_at_rest(number: int) -> None:
    """From headings within 50 rad of the start."""
    module = module_of("boat.soter", drawn_boat(seed_of(number)), claimed=number % 2 == 0)
    assert module.check.turning
    told = Loop(module, "-O1").run("contain", number, 3_000, 0)
    assert told.outside == 0
    assert not (module.kept and told.violated)
