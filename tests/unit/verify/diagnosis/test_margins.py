"""Claims that fail beside a K: where SC brings the tank, computed by hand as well."""

from __future__ import annotations

import re

import numpy as np
import pytest

from unit.verify.diagnosis.tank_modules import cause, changed, explained, law


def test_where_sc_settles_outside_safer_is_computed_by_hand_too() -> None:
    module_result = explained(changed(("0.5 * (1.0 - level)", "0.5 * (1.7 - level)")))
    assert module_result.findings["P2b"].verdict == "undecided"
    text = cause(module_result, "P2b", "stays_away").text
    x = 1.0
    for _ in range(20_000):
        x += 0.1 * (law(x, 1.7) - 0.01)
    assert f"comes to rest at t.h = {x:.5g}" in text


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
