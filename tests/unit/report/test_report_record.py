"""Records refuse shapes that cannot be drawn, and say which field is wrong."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest
from city_scene import Scene

from soter.report.run.record import Cell, Comparison, ReportPage

if TYPE_CHECKING:
    from soter.report.run.record import Flight


@pytest.mark.parametrize("name", ["position", "in_control", "clearance_m", "speed"])
def test_a_flight_names_the_array_of_another_length(protected: Flight, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}: shape"):
        dataclasses.replace(protected, **{name: getattr(protected, name)[:-1]})


def test_time_must_not_run_backwards(protected: Flight) -> None:
    with pytest.raises(ValueError, match="must not run backwards"):
        dataclasses.replace(protected, time_s=protected.time_s[::-1])


def test_a_flight_needs_samples(protected: Flight) -> None:
    with pytest.raises(ValueError, match="N >= 1"):
        dataclasses.replace(protected, time_s=np.empty(0))


def test_a_flight_needs_a_scene(protected: Flight) -> None:
    with pytest.raises(ValueError, match="scene"):
        ReportPage(title="x", flights=(protected,))


def test_boxes_are_pairs_of_corners() -> None:
    with pytest.raises(ValueError, match=r"boxes: shape \(n, 2, 3\)"):
        Scene(lo=(0, 0, 0), hi=(1, 1, 1), boxes=np.zeros((4, 6)), ceiling_m=1)


def test_a_row_has_a_cell_for_each_column() -> None:
    with pytest.raises(ValueError, match="lap: 2 cells expected, found 1"):
        Comparison(columns=("a", "b"), rows=(("lap", (Cell("1 s"),)),))
