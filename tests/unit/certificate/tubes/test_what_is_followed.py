"""Programs with `rest` whose states are followed: each is seen and goes on where SC answers."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

from soter.certificate.report import NotRecheckedError
from soter.certificate.tubes.check_rest import recheck_rest
from soter.certificate.tubes.rest_claims import show_rule_2
from soter.certificate.tubes.rest_problem import read_rest_problem
from tables import all_rows
from unit.certificate.tubes.rest_entries import flat_of
from unit.certificate.tubes.test_forged_rest import BOX, HELD, PLAIN, TRAIN, WAYS, changed, held

AGE = "topic push", "topic also: float in [-2.0, 2.0] max_age 20ms;\ntopic push"
TWICE = AGE, ("drives seen = v;", "drives seen = v; drives also = clamp(v + v, -2.0, 2.0);")
SUM = AGE, ("drives seen = v;", "drives seen = v; drives also = z; state z: float; der z = v;")
SC_READS = ("subscribes seen; publishes push;\n", "subscribes seen, also; publishes push;\n")
MOVES = ("< 0.3 within", "< 0.3 moves also by 0.1 within")
RATE = "der v = push + wind;"


@all_rows(
    ("pairs", "why"),
    [
        ((("float = 0.0;", "float = 0.0; state on: bool;"), (RATE, "der v = on ? push : wind;")),
         "`rest` beside parameters of the plants"),
        (((RATE, "state z: float; der z = 0.0; der v = push + wind + sin(z);"),),
         "no topic that is read shows `p.z`"),
        (((RATE, f"state z: float; der z = z * z; {RATE}"),), "`p.z` is not followed, and may end"),
        (((RATE, f"state z: float; der z = z; {RATE}"),), ""),
        ((*TWICE, SC_READS, ("-3.0 * seen", "-3.0 * seen - also")),
         "SC sees the plant by `also`, which its DM does not read"),
        ((*TWICE, MOVES), "`also` moves, and is no state"),
        ((*SUM, MOVES), ""),
    ],
)  # fmt: skip
def test_what_is_followed_is_seen_and_goes_on(pairs: tuple[tuple[str, str], ...], why: str) -> None:
    flat = flat_of(changed(HELD, *pairs))
    with pytest.raises(NotRecheckedError, match=why) if why else nullcontext():
        read_rest_problem(flat, "Held")


@all_rows(("of", "value", "refused"), [("float", "1.0", False), ("bool", "true", True)])
def test_what_sc_reads_is_made_of_floats(of: str, value: str, refused: bool) -> None:
    text = HELD.replace("abs(seen)", "abs(seen.v)").replace("seen within", "seen.v within")
    seen = f"type Seen = {{ v: float, more: {of} }};\ntopic seen: Seen in {{ v in [-2.0, 2.0] }}"
    text = changed(
        text,
        ("topic seen: float in [-2.0, 2.0]", seen),
        ("drives seen = v", f"drives seen = {{ v: v, more: {value} }}"),
        ("-3.0 * seen", "-3.0 * seen.v"),
    )
    with pytest.raises(NotRecheckedError, match="no float") if refused else nullcontext():
        recheck_rest(*held(text))


OVER = "der gap = front - v", "der gap = front - v * sqrt(v - 1.0)"
WITHIN = "der gap = front - v", "der gap = front - v * sqrt(v + 1.0)"


@all_rows(
    ("text", "change", "why"),
    [
        (TRAIN, ("brake: clamp(1.0", "brake: clamp(sqrt(sight.v) + 1.0"), "at rest is not bounded"),
        (PLAIN, OVER, "a plant's equation is not defined everywhere at rest"),
        (PLAIN, WITHIN, ""),
    ],
)
def test_how_far_sc_moves_is_shown_where_it_answers_and_the_plant_goes_on(
    text: str, change: tuple[str, str], why: str
) -> None:
    problem = read_rest_problem(flat_of(changed(text, change)), "Follow")
    (v,) = problem.returning_states
    with pytest.raises(NotRecheckedError, match=why) if why else nullcontext():
        show_rule_2(problem, {v: BOX["r.v"]}, {v: WAYS["r.v"]})
