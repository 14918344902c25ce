"""What a plant cannot publish is nothing that a proof may keep: there it stops."""

from __future__ import annotations

import pytest

from unit.reach_undecided.tanks import TANK, changed, explained

COARSE = ("[0.2, 1.8] / 320", "[0.2, 1.8] / 80")
SET = "topic level: float max_age"


@pytest.mark.parametrize(
    ("declared", "proved"),
    [
        ("float in [0.0, 2.0]", True),
        ("float in [0.19, 1.81]", True),  # K, and an error of 0.01 on either side
        ("float in [0.5, 2.0]", False),
        ("float in [0.0, 1.5]", False),
        ("float in [0.25, 1.75]", False),
    ],
)
def test_a_set_that_estimates_of_k_may_leave_is_not_proved(declared: str, proved: bool) -> None:
    computed = changed(
        COARSE,
        ("  ttf level < 0.25 || level > 1.75;\n", ""),
        ("  safer level > 0.4 && level < 1.6;\n", ""),
    )
    assert explained(computed).verdict == "proved"
    found = explained(changed((SET, f"topic level: {declared} = 1.0 max_age"), text=computed))
    assert (found.verdict == "proved") == proved, found.findings["P2a"].text
    if not proved:
        assert "`level` takes only [" in found.findings["P2a"].text
        assert "wider set of `level`" in found.findings["P2a"].hint


def test_without_a_set_nothing_is_asked() -> None:
    assert explained(TANK).verdict == "proved"
