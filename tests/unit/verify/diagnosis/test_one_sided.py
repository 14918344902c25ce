"""`safe` bounds one side: runs leave by the grid's other end, and a longer axis is tried."""

from __future__ import annotations

import pytest

from soter.verify.claims.results import ModuleResult  # noqa: TC001 - pytest reads annotations
from unit.verify.diagnosis.tank_modules import changed, check_run, explained

HALF = (
    ("safe level > 0.2 && level < 1.8", "safe level > 0.2"),
    ("0.5 * (1.0 - level)", "0.5 * (3.0 - level)"),
    ("ttf level < 0.25 || level > 1.75", "ttf level < 0.25"),
    ("safer level > 0.4 && level < 1.6", "safer level > 0.4"),
)
PREDICATES = ((2, "ttf"), (3, "safer"))


@pytest.fixture(scope="module")
def filling() -> ModuleResult:
    return explained(changed(*HALF))


def test_it_is_said_that_safe_still_holds_where_the_run_leaves(filling: ModuleResult) -> None:
    finding = filling.findings["P2a"]
    assert finding.text.startswith("K is empty: under SC a run of the model leaves the grid where")
    assert "at t.h = 1.8" in finding.causes[0].text


def test_the_run_passes_it_where_safe_holds(filling: ModuleResult) -> None:
    run = filling.findings["P2a"].leaving
    assert run is not None
    assert not run.safe
    assert run.states[-1][0] > 1.8
    check_run(run, (0.0, 0.02), 0.01, 3.0)


def test_the_longer_axis_that_is_told_was_tried(filling: ModuleResult) -> None:
    said = filling.findings["P2a"].hint
    grid = "grid t.h in [0.2, 3.4] / 640;"
    more = "; and neither `ttf` nor `safer`: left out, both are computed"
    assert said == f"a longer axis: `{grid}`{more} (tried: every claim is proved)"
    longer = ("grid level in [0.2, 1.8] / 320;", grid)
    left_out = tuple((f"  {name} {HALF[k][1].partition(' ')[2]};\n", "") for k, name in PREDICATES)
    assert explained(changed(*HALF, longer, *left_out)).verdict == "proved"
