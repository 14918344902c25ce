"""The run that leaves, drawn: what the page shows is where the run is."""

from __future__ import annotations

import re

import numpy as np
import pytest

from soter.report.proof_page import R1, R2, region_svg
from soter.verify.claims.results import LeavingRun
from soter.verify.proof_report import leaving_figures
from unit.verify.diagnosis.tank_modules import changed, explained
from unit.verify.diagnosis.test_one_sided import HALF


@pytest.mark.whole
def test_the_axis_over_time_begins_inside_c_and_ends_outside() -> None:
    module_result = explained(changed(*HALF))  # C reaches to the end of the grid by which it leaves
    run = module_result.findings["P2a"].leaving
    assert isinstance(run, LeavingRun)
    (figure,) = leaving_figures(module_result, run)
    assert figure.trajectory is not None
    assert figure.trajectory.leaves

    def region(t: float, x: float) -> int:
        i = int(np.searchsorted(figure.x_edges, t, side="right")) - 1
        j = int(np.searchsorted(figure.y_edges, x, side="right")) - 1
        return int(figure.regions[min(i, len(figure.regions) - 1), j])

    x, y = figure.trajectory.x, figure.trajectory.y
    assert region(x[0], y[0]) == R2
    assert region(x[-1], y[-1]) == R1
    assert [region(t, v) for t, v in zip(x, y, strict=True)].count(R1) <= 3
    svg = region_svg(figure)
    begin = re.search(r'<circle class="begin" cx="([\d.]+)" cy="([\d.]+)"', svg)
    left = re.search(r'<path class="left" d="M([\d.]+) ([\d.]+)', svg)
    assert begin is not None
    assert left is not None
    assert float(left[1]) > float(begin[1])  # later
    assert float(left[2]) < float(begin[2])  # higher


def test_a_plane_is_drawn_where_the_group_has_two_axes() -> None:
    from unit.verify.test_verify import changed as cart
    from unit.verify.test_verify import result_of

    module_result = result_of(cart())
    states = np.array([[0.0, 0.0], [5.0, 6.0], [10.2, 7.0]])
    run = LeavingRun(
        names=("c.x", "c.v"),
        time_s=np.array([0.0, 1.0, 2.0]),
        states=states,
        axis="c.x",
        side=1,
        safe=True,
        start="the middle",
        chosen=(),
    )
    over_time, plane = leaving_figures(module_result, run)
    assert over_time.regions.shape == (1, len(over_time.y_edges) - 1)
    assert plane.regions.shape == (len(plane.x_edges) - 1, len(plane.y_edges) - 1)
    assert (plane.x_name, plane.y_name) == ("c.x", "c.v")
    (part,) = module_result.cases[0].groups
    inside = plane.regions[1:-1, 1:-1] > R1
    assert np.array_equal(inside, part.allowed)
