"""A grid that ends where `safe` does not: said, measured on a wider one, and what mends it."""

from __future__ import annotations

import re

from unit.verify.diagnosis.tank_modules import cause, changed, explained, kinds

TTF = "ttf level < 0.25 || level > 1.75;"
SAFER = "safer level > 0.4 && level < 1.6;"
SAFE = "safe level > 0.2 && level < 1.8;"
OPEN = ((SAFE, "safe level > 0.2;"), (TTF, "ttf level < 0.3;"), (SAFER, "safer level > 0.4;"))
RATE = "pump - leak"


def test_a_plant_that_stops_where_the_grid_ends_is_told_how_to_say_so() -> None:
    joined = f"der h = h >= 1.8 && pump > leak ? 0.0 : {RATE};"
    module_result = explained(changed(*OPEN, (f"der h = {RATE};", joined)))
    why = cause(module_result, "ttf", "grid_end")
    assert "the grid ends at t.h = 1.8, where `safe` still holds" in why.text
    assert dict(why.numbers)["cells"] > 0
    assert "`min(rate, 0.0)`" in why.hint
    bounded = f"der h = h >= 1.8 ? min({RATE}, 0.0) : {RATE};"
    assert explained(changed(*OPEN, (f"der h = {RATE};", bounded))).verdict == "proved"


def test_a_grid_that_ends_too_soon_is_told_with_one_that_does() -> None:
    """It leaks more the higher it stands: beyond 1.9 the pump does not get it."""
    soon = (f"der h = {RATE};", "der h = pump - leak - 0.05 * (h - 0.5);")
    narrow = ("[0.2, 1.8] / 320", "[0.2, 2.3] / 420")
    module_result = explained(changed(*OPEN, soon, narrow))
    assert "cells fail" not in cause(module_result, "ttf", "grid_end").text
    grid = re.search(r"`(grid [^`]*;)`", cause(module_result, "ttf", "grid_end").hint)
    assert grid is not None
    wide = ("grid level in [0.2, 1.8] / 320;", grid[1])
    assert explained(changed(*OPEN, soon, wide)).verdict == "proved"


def test_an_end_that_is_one_of_safe_is_no_matter_of_the_grid() -> None:
    module_result = explained(changed((TTF, "ttf level < 0.232 || level > 1.768;")))
    assert module_result.findings["ttf"].verdict == "undecided"
    assert "grid_end" not in kinds(module_result, "ttf")


def test_where_ac_need_not_come_back_it_is_said_why_safer_is_asked_all_the_same() -> None:
    """`recover never` makes no proof of `safer` easier: the DM gives control where it holds."""
    wrong = (SAFER, "safer level > 0.2;"), (SAFE, "safe level > 0.2;")
    never = ("/ 320;", "/ 320; recover never;")
    for pairs in (wrong, (*wrong, never)):
        module_result = explained(changed(*pairs))
        assert module_result.findings["safer"].verdict == "undecided"
        assert ("asked_all_the_same" in kinds(module_result, "safer")) == (never in pairs)
        assert "asked_all_the_same" not in kinds(module_result, "ttf")
    why = cause(module_result, "safer", "asked_all_the_same").text
    assert "`recover never`" in why
    assert "wherever `safer` holds" in why
