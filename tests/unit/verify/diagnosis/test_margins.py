"""By how much claims fail: a program changed by just that much is proved, by less it is not."""

from __future__ import annotations

import re

import numpy as np
import pytest

from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from unit.verify.diagnosis.tank_modules import cause, changed, explained, kinds, law
from unit.verify.test_verify import changed as cart

TTF = "ttf level < 0.25 || level > 1.75;"
BOLD = "ttf level < 0.232 || level > 1.768;"


@pytest.fixture(scope="module")
def bold() -> ModuleResult:
    return explained(changed((TTF, BOLD)))


def test_ttf_has_the_numbers_from_which_on_it_would_have_to_hold(bold: ModuleResult) -> None:
    numbers = dict(cause(bold, "ttf", "border").numbers)
    below, above = numbers["below"], numbers["above"]
    assert 0.232 < below < 0.25
    assert 1.75 < above < 1.768
    good = changed((TTF, f"ttf level < {below!r} || level > {above!r};"))
    assert explained(good).findings["ttf"].verdict == "proved"
    for less in ((below - 0.006, above), (below, above + 0.006)):
        short = changed((TTF, f"ttf level < {less[0]!r} || level > {less[1]!r};"))
        assert explained(short).findings["ttf"].verdict == "undecided"


def test_the_horizon_is_told_for_which_ttf_would_do(bold: ModuleResult) -> None:
    numbers = dict(cause(bold, "ttf", "horizon").numbers)
    assert 0.0 < numbers["holds_for_s"] < numbers["horizon_s"] == 0.2
    grid = "verify { grid level in [0.2, 1.8] / 320;"
    us = round(numbers["holds_for_s"] * 1e6)
    short = explained(changed((TTF, BOLD), (grid, f"{grid} horizon {us}us;")))
    assert short.findings["ttf"].verdict == "proved"
    assert short.findings["P1c"].verdict == "undecided"


def test_ttf_outside_k_is_no_question_of_time() -> None:
    module_result = explained(changed((TTF, "ttf level < 0.15;")))
    assert "outside_core" in kinds(module_result, "ttf")
    assert "horizon" not in kinds(module_result, "ttf")


def test_where_sc_settles_outside_safer_is_computed_by_hand_too() -> None:
    module_result = explained(changed(("0.5 * (1.0 - level)", "0.5 * (1.7 - level)")))
    assert module_result.findings["P2b"].verdict == "undecided"
    text = cause(module_result, "P2b", "stays_away").text
    x = 1.0
    for _ in range(20_000):
        x += 0.1 * (law(x, 1.7) - 0.01)
    assert f"comes to rest at t.h = {x:.5g}" in text
    wider = dict(cause(module_result, "P2b", "safer_wider").numbers)["t.h"]
    assert 1.6 + wider > x > 1.6
    more = changed(
        ("0.5 * (1.0 - level)", "0.5 * (1.7 - level)"),
        ("safer level > 0.4 && level < 1.6", f"safer level > 0.4 && level < {1.6 + wider}"),
    )
    assert explained(more).findings["P2b"].verdict == "proved"


def test_a_start_that_is_not_in_k_is_told_from_one_that_is_too_late() -> None:
    outside = explained(changed(("float = 1.0", "float = 1.7999")))
    assert kinds(outside, "start") == ["start_not_in_core"]
    late = changed(
        ("float = 1.0", "float = 1.794"),
        ("/ 320;", "/ 320; late dm 0s, sc 0s; response dm 0s, sc 0s; acts within 45ms;"),
        (TTF, "ttf level < 0.35 || level > 1.65;"),
    )
    module_result = explained(late)
    assert module_result.findings["start"].verdict == "undecided"
    assert kinds(module_result, "start") == ["start_late"]
    numbers = dict(cause(module_result, "start", "start_late").numbers)
    assert 0.0 <= numbers["in_time_s"] < numbers["acts_s"]
    assert 1.794 + 0.1 * numbers["in_time_s"] < 1.8  # the pump fills by 0.1 a second
    assert 1.794 + 0.1 * numbers["acts_s"] > 1.795


def test_the_way_back_that_is_not_found_is_followed() -> None:
    """Above 0.9 SC only makes up for the mean leak: undisturbed the level stays where it is."""
    law_ = "level < 0.9 ? clamp(0.5 * (0.75 - level), -0.1, 0.1) : (level > 1.7 ? -0.1 : 0.01)"
    stands = (
        ("clamp(0.5 * (1.0 - level), -0.1, 0.1)", law_),
        ("safer level > 0.4 && level < 1.6", "safer level > 0.6 && level < 0.9"),
    )
    module_result = explained(changed(*stands))
    assert module_result.findings["P2a"].verdict == "proved"
    assert module_result.findings["P2b"].verdict == "undecided"
    text = cause(module_result, "P2b", "stays_away").text
    begun, reached = re.findall(r"t\.h = ([\d.]+)", text)
    assert 0.9 < float(begun) < 1.8
    assert float(reached) == pytest.approx(float(begun), abs=1e-3)
    (part,) = module_result.cases[0].groups
    assert part.rank is not None
    at = int(np.searchsorted(part.edges[0], float(begun))) - 1
    assert part.core[at]
    assert not part.rank[at]  # one of the cells from which no way back was found


@pytest.mark.long
def test_a_predicate_of_two_states_has_a_distance_along_one_axis() -> None:
    bold = cart(("+ 0.8", "+ 0.0"), ("ttf Room(motion, 0.12)", "ttf Room(motion, 0.06)"))
    module_result = explained(bold)
    assert module_result.findings["ttf"].verdict == "undecided"
    numbers = dict(cause(module_result, "ttf", "sooner").numbers)
    leaves = ["motion.x", "motion.v"]
    axis = leaves[round(numbers["axis"])]

    def moved(by: float) -> str:
        x, v = (f"{leaf} + {by!r}" if leaf == axis else leaf for leaf in leaves)
        return f"Room({{ x: {x}, v: {v} }}, 0.06) < 0.0 || abs({v}) > FAST"

    more = " || ".join(moved(s * numbers["margin"] * 1.000001) for s in (-1, 1))
    good = changed(("ttf Room", f"ttf {more} || Room"), text=bold)
    assert explained(good).findings["ttf"].verdict == "proved"
