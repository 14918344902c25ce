"""What of a grid of three axes a figure shows, and that the drawing is its cells."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.report.proof_page import (
    LEFT,
    R1,
    R2,
    R3,
    R4,
    R5,
    WIDTH,
    ModuleProof,
    ProofPage,
    RegionFigure,
    proof_body,
    region_svg,
)
from soter.verify.grid.set_figures import (
    SLICES_MAX,
    deepest_cell,
    figure_of_regions,
    place_that_shows_most,
)
from soter.verify.problem.problem import Axis, Group


def sets_of(cells: Any, units: tuple[str, ...]) -> Any:
    """Sets of a group whose regions are `cells`, over axes from 0 to 1."""
    axes = tuple(
        Axis(k, f"p.{'xyzw'[k]}", tuple(np.linspace(0.0, 1.0, n + 1)), unit=unit)
        for k, (n, unit) in enumerate(zip(cells.shape, units, strict=True))
    )
    return SimpleNamespace(
        group=Group(axes),
        allowed=cells >= R2,
        core=(cells >= R3).astype(np.uint8),
        free=cells >= R4,
        gives_back=cells == R5,
        lets_ac=cells >= R4,
    )


def test_of_three_axes_the_fullest_slice_is_shown_and_the_others_are_there() -> None:
    cells = np.full((4, 5, 7), R1, dtype=np.uint8)
    cells[:, :, 4] = R3  # much of the core, nothing of AC's
    cells[1:3, 1:3, 5] = R5
    drawn = figure_of_regions(sets_of(cells, ("m", "m/s", "rad")), "gear = 2")
    np.testing.assert_array_equal(drawn.regions, cells[:, :, 5])
    assert drawn.shown == 5
    assert drawn.across == "p.z"
    assert drawn.slices[5].where == "p.z in [0.7143, 0.8571] rad"
    assert [s.regions.tolist() for s in drawn.slices] == np.moveaxis(cells, 2, 0).tolist()
    for part in drawn.slices:
        assert part.lets_ac is not None
        np.testing.assert_array_equal(part.lets_ac, part.regions >= R4)
    assert (drawn.x_unit, drawn.y_unit, drawn.note) == ("m", "m/s", "gear = 2")


def test_a_slice_where_ac_gets_control_back_goes_before_a_fuller_one() -> None:
    cells = np.full((4, 4, 3), R2, dtype=np.uint8)
    cells[:, :, 2] = R4
    assert place_that_shows_most(cells) == (2,)
    cells[:2, :, 1] = R4
    cells[0, 0, 1] = R5
    assert place_that_shows_most(cells) == (1,)


def test_among_slices_as_full_as_each_other_it_is_the_middle_one() -> None:
    assert place_that_shows_most(np.full((3, 3, 9), R4, dtype=np.uint8)) == (4,)
    assert place_that_shows_most(np.full((3, 3), R4, dtype=np.uint8)) == ()


def test_of_four_axes_the_fourth_is_cut_where_the_slice_is_the_fullest() -> None:
    cells = np.full((2, 2, 3, 4), R2, dtype=np.uint8)
    cells[0, 0, 2, 3] = R4
    drawn = figure_of_regions(sets_of(cells, ("", "", "", "m")), "")
    assert drawn.regions[0, 0] == R4
    assert drawn.note == "p.w in [0.75, 1] m"


def test_of_a_long_third_axis_the_ends_and_the_fullest_slice_are_among_those_drawn() -> None:
    cells = np.full((2, 2, 200), R2, dtype=np.uint8)
    cells[:, :, 101] = R4
    drawn = figure_of_regions(sets_of(cells, ("", "", "")), "")
    assert len(drawn.slices) <= SLICES_MAX + 1
    assert drawn.slices[0].where.startswith("p.z in [0, ")
    assert drawn.slices[-1].where.endswith(", 1]")
    np.testing.assert_array_equal(drawn.slices[drawn.shown].regions, cells[:, :, 101])


def test_the_axes_say_their_units() -> None:
    cells = np.full((2, 2), R2, dtype=np.uint8)
    texts = re.findall(
        r'class="name"[^>]*>([^<]*)<',
        region_svg(figure_of_regions(sets_of(cells, ("m", "m/s")), "")),
    )
    assert texts == ["p.x / m", "p.y / (m/s)"]


@pytest.mark.parametrize("seed", range(5))
def test_the_rectangles_of_a_drawing_are_its_cells(seed: int) -> None:
    cells = np.random.default_rng(seed).integers(R1, R5, (9, 6), endpoint=True).astype(np.uint8)
    x, y = (np.arange(n + 1.0) for n in cells.shape)
    svg = region_svg(RegionFigure("", "x", "y", x, y, cells))
    painted = np.zeros_like(cells)
    width = (WIDTH - LEFT - 14.0) / len(cells)
    tall = [
        float(v) for v in re.findall(r'class="frame".*?y="([\d.]+)".*?height="([\d.]+)"', svg)[0]
    ]
    for code, path in re.findall(r'<path class="r(\d)" d="([^"]*)"', svg):
        for a, low, b, high in re.findall(r"M([\d.]+) ([\d.]+)H([\d.]+)V([\d.]+)H", path):
            columns = slice(round((float(a) - LEFT) / width), round((float(b) - LEFT) / width))
            unit = tall[1] / cells.shape[1]
            bottom, top = (round((tall[0] + tall[1] - float(v)) / unit) for v in (low, high))
            assert not painted[columns, bottom:top].any()  # none twice
            painted[columns, bottom:top] = int(code)
    np.testing.assert_array_equal(painted, cells)


# ---------------------------------------------------------------- the border of ttf

EDGES = np.array([0.0, 1.0, 2.0, 3.0])
THREE = np.repeat(np.array([[R1], [R3], [R4]], dtype=np.uint8), 3, axis=1)
LETS_AC = np.array([[False] * 3, [False] * 3, [True] * 3])


def with_border() -> RegionFigure:
    return RegionFigure("x and y", "x", "y", EDGES, EDGES, THREE, lets_ac=LETS_AC)


@pytest.mark.parametrize("switches", [True, False])
def test_the_dm_has_switched_only_where_ttf_and_p3_hold(switches: bool) -> None:
    m = ModuleProof("M", "proved", "", (), (), (), (with_border(),), switches=switches)
    main = proof_body(ProofPage("p", "M: proved", "", (m,), (), ()))
    assert "core K: SC keeps C" in main
    assert ("the DM has switched to SC" in main) is switches


def test_the_border_of_ttf_lies_between_cells_that_differ() -> None:
    drawn = region_svg(with_border())
    border = drawn.partition('class="border" d="')[2].partition('"')[0]
    assert border.count("M") == 3, "one side of each of three cells"
    assert len({piece.split(" ")[0] for piece in border.split("M")[1:]}) == 1, "at one x"
    assert 'class="border"' not in region_svg(replace(with_border(), lets_ac=None))


@pytest.mark.parametrize("shape", [(4, 40), (40, 4), (1, 9), (2, 2), (5, 3, 8)])
def test_the_deepest_cell_of_a_whole_grid_lies_in_its_middle(shape: tuple[int, ...]) -> None:
    part = sets_of(np.full(shape, R3), ("m",) * len(shape))
    part.edges = [np.array(axis.edges) for axis in part.group.axes]
    for state, at in deepest_cell(part).items():
        assert abs(at - 0.5) <= 1.0 / shape[state]
