"""Which vertex or multipliers the linear program solver returns decides no verdict."""

from __future__ import annotations

import os
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.verify.polytope import half_spaces
from soter.verify.polytope.half_spaces import Bounds, LinearProgram, Polytope
from soter.verify.polytope.matrices import Ball, exact
from soter.workers.solvers import new_highs

pytest.importorskip("highspy")


class Sloppy:
    """HiGHS, whose answers are spoiled until it is asked in a certain way."""

    def __init__(self, until: dict[str, object] | None, spoil: str) -> None:
        self._real = new_highs()
        self._spoil = spoil
        self._until = until
        self._asked: dict[str, object] = {}
        self._scratch = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)

    def setOptionValue(self, name: str, value: object) -> None:  # noqa: N802 - of the solver
        self._asked[name] = value
        self._real.setOptionValue(name, value)

    def clearSolver(self) -> None:  # noqa: N802 - of the solver
        self._scratch = True
        self._real.clearSolver()

    def run(self) -> None:
        good = {"scratch": self._scratch} if self._until is None else self._asked
        self._spoiled = not (self._until or {"scratch": True}).items() <= good.items()
        self._scratch = False
        self._real.run()

    def getModelStatus(self) -> Any:  # noqa: N802 - of the solver
        spoiled = self._spoiled and self._spoil == "status"
        return SimpleNamespace(name="kUnknown") if spoiled else self._real.getModelStatus()

    def getSolution(self) -> Any:  # noqa: N802 - of the solver
        solution = self._real.getSolution()
        factor = 0.999 if self._spoiled and self._spoil == "multipliers" else 1.0
        return SimpleNamespace(
            col_value=solution.col_value,
            row_dual=[factor * dual for dual in solution.row_dual],
        )


@pytest.mark.parametrize("spoil", ["status", "multipliers"])
@pytest.mark.parametrize(
    "until", [None, {"simplex_strategy": 4}, {"simplex_scale_strategy": 0}, {"solver": "ipm"}]
)
def test_a_solver_that_goes_astray_is_asked_in_another_way(
    monkeypatch: pytest.MonkeyPatch, until: dict[str, object] | None, spoil: str
) -> None:
    p = _octagon()
    rows = exact(np.random.default_rng(0).normal(size=(20, 2)))
    straight = Bounds(p).of(rows)
    monkeypatch.setattr(half_spaces, "require_highs", lambda: Sloppy(until, spoil))
    assert Bounds(p).of(rows) == pytest.approx(straight, rel=1e-8)
    program = LinearProgram(p)
    greatest = [program.greatest(row)[0] for row in rows.mid]
    assert greatest == pytest.approx(list(straight), rel=1e-8)


def test_no_way_shows_a_point_of_an_empty_set(monkeypatch: pytest.MonkeyPatch) -> None:
    p = _octagon().with_rows(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([-0.5, 0.4]))
    assert LinearProgram(p).empty
    monkeypatch.setattr(half_spaces, "require_highs", lambda: Sloppy({"solver": "ipm"}, "status"))
    assert LinearProgram(p).empty


def test_multipliers_that_stay_bad_bound_what_they_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong suggestion gives a useless bound, never a wrong one."""
    p, row = _octagon(), Ball(np.array([[1.0, 1.0]]), np.zeros((1, 2)))
    straight = Bounds(p).of(row)
    monkeypatch.setattr(
        half_spaces, "require_highs", lambda: Sloppy({"never": True}, "multipliers")
    )
    assert Bounds(p).of(row)[0] > straight[0] + 1e-4


def test_what_the_solver_prints_as_it_is_made_is_not_in_our_output(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Loud:
        def __init__(self) -> None:
            os.write(1, b"Running HiGHS\n")

        def setOptionValue(self, name: str, value: object) -> None:  # noqa: N802 - of the solver
            pass

    loud = ModuleType("highspy")
    loud.Highs = Loud  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "highspy", loud)
    sys.stdout.write("before, ")
    new_highs()
    sys.stdout.write("after")
    sys.stdout.flush()
    assert capfd.readouterr().out == "before, after"
    Loud()
    assert capfd.readouterr().out == "Running HiGHS\n"


def _octagon() -> Polytope:
    """A box whose four corners are cut."""
    rows = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    return Polytope(np.full(2, -2.0), np.full(2, 2.0), rows, np.array([3.0, 2.9, 2.8, 2.7]))
