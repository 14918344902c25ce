"""How long a proof will take is said where it is long, and only where somebody waits."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from soter.cli.terminal.console import Console, ProgressBar
from soter.diagnostics.current_phase import listening_to_phases
from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.deploy import missing_predicates
from soter.verify.grid.grid_refinement import announce_work, cell_count
from unit.verify.diagnosis.tank_modules import TANK, changed
from unit.verify.diagnosis.test_tried_remedies import PREDICATES

if TYPE_CHECKING:
    from soter.verify.problem.problem import Problem

SECONDS_A_CELL = 1e-3


@pytest.fixture
def problem() -> Problem:
    checked = check_file("tank.soter", changed(("/ 320", "/ 60_000"), text=TANK))
    (one,) = problems_of(modules_of(checked, None, None, {}))
    return one


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that only `settle` moves: so much a cell."""
    now = [0.0]
    monkeypatch.setattr("soter.verify.grid.grid_refinement.time.process_time", lambda: now[0])
    return now


def announced(problem: Problem, clock: list[float], a_cell: float) -> list[str]:
    lines: list[str] = []

    def settle(small: Problem, _: tuple[int, ...]) -> None:
        clock[0] += a_cell * cell_count(small)

    with listening_to_phases(lambda *_: None, lines.append):
        announce_work(problem, settle)
    return lines


def test_what_grows_with_the_cells_is_estimated_so(problem: Problem, clock: list[float]) -> None:
    (line,) = announced(problem, clock, SECONDS_A_CELL)
    assert line == "SafeTank: 1 axis of 60000 cells: about 60 s of processor time"
    (line,) = announced(problem, clock, 4 * SECONDS_A_CELL)
    assert line.endswith("about 4 min of processor time")


def test_what_is_short_is_not_said(problem: Problem, clock: list[float]) -> None:
    assert announced(problem, clock, SECONDS_A_CELL / 10) == []


def test_what_computes_tables_before_it_flies_says_how_long(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a proof does: the same two tries, on the problem whose sets are computed."""
    checked = check_file("tank.soter", changed(*PREDICATES, ("/ 320", "/ 60_000"), text=TANK))
    (open_problem,) = problems_of(modules_of(checked, None, None, {}))
    began = []

    none = SimpleNamespace(proof=None, cells=None)
    sets = SimpleNamespace(proofs=[])
    empty = SimpleNamespace(failures_of=lambda _: [none], failures=[], sets=sets)

    def case(_library: object, small: Problem, _: object) -> SimpleNamespace:
        began.append(cell_count(small))
        clock[0] += SECONDS_A_CELL * cell_count(small)
        return empty

    monkeypatch.setattr(missing_predicates, "_case_with_levels", case)
    monkeypatch.setattr(missing_predicates, "_cached_sets", lambda *_: None)
    lines: list[str] = []
    with listening_to_phases(lambda *_: None, lines.append):
        missing_predicates.find_sets(open_problem)
    assert lines == ["SafeTank: 1 axis of 60000 cells: about 60 s of processor time"]
    assert began == [1500, 6000, 60_000]


def test_nothing_is_tried_where_nobody_waits(problem: Problem) -> None:
    tries: list[Problem] = []
    announce_work(problem, lambda small, _: tries.append(small))
    assert tries == []


def test_a_log_has_the_line(problem: Problem, clock: list[float]) -> None:
    console = Console(json=False)
    console.err = err = io.StringIO()
    with ProgressBar(console):
        announce_work(
            problem,
            lambda small, _: clock.__setitem__(0, clock[0] + SECONDS_A_CELL * cell_count(small)),
        )
    assert (
        "soter: SafeTank: 1 axis of 60000 cells: about 60 s of processor time\n" in err.getvalue()
    )
