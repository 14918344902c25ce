"""Inductions against systematic testing: nothing is proved that has a run which violates it.

The explorer knows nothing of the relation: it runs the compiled steps, and a violation of its is
replayed by the reference interpreter. Programs are drawn by chance
(`generators/induction_planners.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.induction_planners import planner
from long_tests import examples, seeds
from soter.explore.command import TraceHeader, explore_test
from soter.explore.results import EXHAUSTED, VIOLATED
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of
from soter.verify.induction.problem import extract_induction
from soter.verify.induction.prove_or_refute import (
    prove_by_induction,
    system_as_test,
    system_with_any_ac,
)

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("z3")

PLANNERS = examples(16)
"""Without lateness; with it there are twice as many, of which few are clean."""
HORIZON_NS = {False: 120_000_000, True: 60_000_000}
OPTIONS = SearchOptions(time=30, minimise=0, memory=2**29)


def compared(seed: int, folder: Path, *, late: bool) -> tuple[str, str]:
    """What the induction says, what the explorer says up to a horizon."""
    path = folder / f"{seed}.soter"
    path.write_text(planner(seed, late=late))
    checked = check_file(str(path))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None, {}, exact=False)
    problem = extract_induction(flat, flat.modules[0])
    induction = prove_by_induction(problem)
    asked = system_as_test(problem, system_with_any_ac(problem), HORIZON_NS[late])
    explored = explore_test(asked, OPTIONS, TraceHeader(str(path), {})).verdict
    return "proved" if induction.proved else induction.about or "open", explored


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.random
def test_nothing_is_proved_that_a_run_violates(tmp_path: Path, *, late: bool) -> None:
    numbers = seeds(1000, 1000 + (2 * PLANNERS if late else PLANNERS))
    verdicts = [compared(seed, tmp_path, late=late) for seed in numbers]
    assert ("proved", VIOLATED) not in verdicts
    clean = [said for said, explored in verdicts if explored == EXHAUSTED]
    violated = [said for said, explored in verdicts if explored == VIOLATED]
    assert clean.count("proved") >= len(clean) // 2 > 0
    assert "open" not in violated
