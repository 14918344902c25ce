"""Outlines, solids and the window they are shown in."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from city_scene import Tube
from city_shapes import (
    box_rings,
    height_levels,
    loft_edges,
    loft_mesh,
    tube_outline,
    tube_rings,
    window,
)

if TYPE_CHECKING:
    from city_scene import Scene

    from soter.report.run.record import ReportPage

BOX = np.asarray([[0.0, 0, 0], [2, 3, 4]])


def area(outline: np.ndarray) -> float:
    """Signed area of a closed outline, positive where it turns counter-clockwise."""
    x, y = outline[:, 0], outline[:, 1]
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2)


@pytest.mark.parametrize("end", [(10.0, 0, 2), (0.0, 10, 2), (-6.0, 8, 2), (6.0, -8, 2)])
def test_a_tube_from_above_is_a_box_in_its_own_frame(end: tuple[float, float, float]) -> None:
    tube = Tube((0, 0, 2), end, 1.5, 1.0, 0.5)
    # C: |across| <= r and -r <= along <= L + r
    assert area(tube_outline(tube, tube.half_width_m)) == pytest.approx(-(10 + 3) * 3)


def test_a_tube_may_change_its_width() -> None:
    tube = Tube((0, 0, 2), (10, 0, 2), np.asarray([1.0, 2.0, 1.0]), 0.5, 0.2)
    outline = tube_outline(tube, tube.half_width_m)
    assert outline[:, 1].max() == 2.0
    assert outline[:, 0].min() == -1.0
    assert outline[:, 0].max() == 11.0


def test_a_rising_tube_is_a_square_from_above_and_turns_like_the_others() -> None:
    tube = Tube((1, 2, 0), (1, 2, 5), 1.5, 1.0, 0.5)
    assert area(tube_outline(tube, 1.5)) == pytest.approx(-9.0)
    assert np.isfinite(tube_rings(tube, 1.5)).all()


@pytest.mark.parametrize(
    "rings",
    [box_rings(BOX), tube_rings(Tube((0, 0, 1), (5, 5, 3), np.asarray([1.0, 2, 1]), 1, 1), 1.0)],
)
def test_a_solid_is_closed_and_faces_one_way(rings: np.ndarray) -> None:
    vertices, triangles = loft_mesh([rings])
    edges = Counter(
        (a, b) for t in triangles.tolist() for a, b in zip(t, [*t[1:], t[0]], strict=True)
    )
    assert len(vertices) == rings.shape[0] * 4
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def test_the_edges_of_a_box_are_twelve() -> None:
    points = loft_edges([box_rings(BOX)])
    drawn = ~np.isnan(points[:-1]).any(axis=1) & ~np.isnan(points[1:]).any(axis=1)
    assert int(drawn.sum()) == 12


def test_shades_rise_with_height() -> None:
    boxes = np.stack([BOX * [1, 1, top / 4] for top in (2.0, 3.0, 7.0)])
    assert height_levels(boxes).tolist() == [0, 1, 4]
    assert height_levels(boxes[:1]).tolist() == [4]
    assert height_levels(np.empty((0, 2, 3))).tolist() == []


def test_the_window_holds_flights_goals_and_tubes(city_page: ReportPage, scene: Scene) -> None:
    shown = window(scene, city_page.flights)
    everything = np.concatenate(
        [
            *(flight.position[:, :2] for flight in city_page.flights),
            *(tube_outline(tube, tube.half_width_m) for tube in scene.tubes),
            np.asarray([position[:2] for _, position in scene.goals]),
        ]
    )
    assert (everything > [shown.x_min, shown.y_min]).all()
    assert (everything < [shown.x_max, shown.y_max]).all()
    assert 1 / 2 - 1e-9 <= shown.height / shown.width <= 3 / 2 + 1e-9
