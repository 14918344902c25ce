"""A grid that the prover made finer is said, with what the program wrote and what was used."""

from __future__ import annotations

import re

from unit.verify.diagnosis.tank_modules import changed, explained

BOLD = ("ttf level < 0.25 || level > 1.75;", "ttf level < 0.232 || level > 1.768;")


def test_a_refined_grid_is_a_note_with_both_numbers_of_cells() -> None:
    module_result = explained(changed(BOLD))
    (note,) = [n for n in module_result.notes if "refined" in n]
    axis, total = re.findall(r"([\d,]+) -> ([\d,]+)", note)
    assert axis == total  # one axis
    assert axis[0] == "320"
    assert int(axis[1].replace(",", "")) == module_result.cells > 320


def test_the_declared_grid_is_no_news() -> None:
    module_result = explained(changed())
    assert module_result.cells == 320
    assert not any("refined" in n for n in module_result.notes)
