"""The page of a verification says of a module what was shown of it, and no more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from soter.report.proof.page import proof_body
from soter.report.proof.record import R1, R3, R4, ModuleProof, ProofPage, RegionFigure
from soter.report.proof.regions import region_svg

EDGES = np.array([0.0, 1.0, 2.0, 3.0])
REGIONS = np.repeat(np.array([[R1], [R3], [R4]], dtype=np.uint8), 3, axis=1)
LETS_AC = np.array([[False] * 3, [False] * 3, [True] * 3])


def figure() -> RegionFigure:
    return RegionFigure("x and y", "x", "y", EDGES, EDGES, REGIONS, lets_ac=LETS_AC)


@pytest.mark.parametrize("switches", [True, False])
def test_the_dm_has_switched_only_where_ttf_and_p3_hold(switches: bool) -> None:
    m = ModuleProof("M", "proved", "", (), (), (), (figure(),), switches=switches)
    main = proof_body(ProofPage("p", "M: proved", "", (m,), (), ()))
    assert "core K: SC keeps C" in main
    assert ("the DM has switched to SC" in main) is switches


def test_the_border_of_ttf_lies_between_cells_that_differ() -> None:
    drawn = region_svg(figure())
    border = drawn.partition('class="border" d="')[2].partition('"')[0]
    assert border.count("M") == 3, "one side of each of three cells"
    assert len({piece.split(" ")[0] for piece in border.split("M")[1:]}) == 1, "at one x"
    assert 'class="border"' not in region_svg(replace(figure(), lets_ac=None))
