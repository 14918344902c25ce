"""A start that is not proved: which state, how far the set reaches, and a line that mends it."""

from __future__ import annotations

import re

import pytest

from unit.verify.diagnosis.tank_modules import cause, changed, explained
from unit.verify.diagnosis.test_way_back import FINE, LIFT

HEIGHT, SPEED = "state h: float = 5.0;", "state v: float = 0.0;"


def test_the_state_its_value_and_the_nearest_bound_are_named() -> None:
    module_result = explained(
        changed(
            (HEIGHT, "state h: float = 9.9;"), (SPEED, "state v: float = 1.5;"), FINE, text=LIFT
        )
    )
    assert module_result.findings["start"].verdict == "undecided"
    why = cause(module_result, "start", "start_not_in_core")
    assert "e.h starts at 9.9" in why.text
    numbers = dict(why.numbers)
    # braking from 1.5 with less than 2 takes more than 0.56, so with less room no start is proved
    assert numbers["high"] < 10.0 - 1.5**2 / (2 * 2.0)
    line = re.search(r"`(state h: float = [\d.]+;)`", module_result.findings["start"].hint)
    assert line is not None
    mended = changed((HEIGHT, line[1]), (SPEED, "state v: float = 1.5;"), FINE, text=LIFT)
    assert explained(mended).findings["start"].verdict == "proved"


@pytest.mark.long
def test_a_start_outside_the_grid_is_told_from_one_where_safe_is_false() -> None:
    beyond = explained(changed((HEIGHT, "state h: float = 12.0;"), text=LIFT))
    assert "`safe` is false there" in cause(beyond, "start", "start_outside").text
    assert "a `safe` that holds at the start" in beyond.findings["start"].hint
    fast = explained(changed((SPEED, "state v: float = 3.5;"), text=LIFT))
    why = cause(fast, "start", "start_outside")
    assert "e.v starts at 3.5, outside the grid, which is e.v in [-3, 3]" in why.text
    assert "`safe`" not in why.text
    assert "a `grid` that holds the start" in fast.findings["start"].hint


def test_a_start_that_sc_meets_too_late_is_told_where_it_would_be_in_time() -> None:
    late = (
        ("float = 1.0", "float = 1.794"),
        ("/ 320;", "/ 320; late dm 0s, sc 0s; response dm 0s, sc 0s; acts within 45ms;"),
        ("ttf level < 0.25 || level > 1.75;", "ttf level < 0.35 || level > 1.65;"),
    )
    module_result = explained(changed(*late))
    high = dict(cause(module_result, "start", "start_late").numbers)["high"]
    assert high < 1.794
    line = re.search(r"`state h: float = ([\d.]+);`", module_result.findings["start"].hint)
    assert line is not None
    mended = explained(changed(("float = 1.0", f"float = {line[1]}"), *late[1:]))
    assert mended.findings["start"].verdict == "proved"
