"""A start that is not proved: the nearest one that is was tried, and is told as a line."""

from __future__ import annotations

import re

import pytest

from unit.verify.diagnosis.tank_modules import changed, explained
from unit.verify.diagnosis.test_way_back import FINE, LIFT

HEIGHT, SPEED = "state h: float = 5.0;", "state v: float = 0.0;"
LATE = (
    ("/ 320;", "/ 320; late dm 0s, sc 0s; response dm 0s, sc 0s; acts within 45ms;"),
    ("ttf level < 0.25 || level > 1.75;", "ttf level < 0.35 || level > 1.65;"),
)


def told(hint: str) -> str:
    """The line of the plant, which is said to be tried."""
    line = re.match(r"`(state \w+: float = [\d.]+;)` in the plant \(tried: every claim", hint)
    assert line is not None, hint
    return line[1]


def test_one_state_is_moved_where_that_is_enough() -> None:
    moving = (SPEED, "state v: float = 1.5;"), FINE
    high = explained(changed((HEIGHT, "state h: float = 9.9;"), *moving, text=LIFT))
    assert high.findings["start"].verdict == "undecided"
    line = told(high.findings["start"].hint)
    # braking from 1.5 with less than 2 takes more than 0.56, so with less room no start is proved
    assert float(line.split()[-1][:-1]) < 10.0 - 1.5**2 / (2 * 2.0)
    assert explained(changed((HEIGHT, line), *moving, text=LIFT)).verdict == "proved"


@pytest.mark.parametrize("start", ["1.7999", "1.794", "2.5"], ids=["not in K", "late", "outside"])
def test_a_start_that_is_told_is_proved(start: str) -> None:
    finding = explained(changed(("float = 1.0", f"float = {start}"), *LATE)).findings["start"]
    assert finding.verdict == "undecided"
    line = told(finding.hint)
    assert float(line.split()[-1][:-1]) < float(start)
    mended = explained(changed(("state h: float = 1.0;", line), *LATE))
    assert mended.findings["start"].verdict == "proved"
