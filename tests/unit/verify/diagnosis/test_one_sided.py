"""`safe` bounds one side: the grid's other end is told as the wall, and what a wider grid gives."""

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


@pytest.fixture(scope="module")
def filling() -> ModuleResult:
    return explained(changed(*HALF))


def test_the_wall_is_named(filling: ModuleResult) -> None:
    finding = filling.findings["P2a"]
    assert finding.text == "K is empty: an end of the grid acts as a wall"
    assert finding.causes[0].kind == "one_sided"
    assert dict(finding.causes[0].numbers) == {"end": 1.8, "side": 1.0}


def test_the_run_passes_it_where_safe_holds(filling: ModuleResult) -> None:
    run = filling.findings["P2a"].leaving
    assert run is not None
    assert not run.safe
    assert run.states[-1][0] > 1.8
    check_run(run, (0.0, 0.02), 0.01, 3.0)


def test_the_wider_grid_gives_what_it_says(filling: ModuleResult) -> None:
    wider = explained(changed(*HALF, ("[0.2, 1.8] / 320", "[0.2, 3.4] / 640")))
    (part,) = wider.cases[0].groups
    share = (part.core > 0).sum() / part.allowed.sum()
    assert share > 0.9
    assert f"with a grid up to 3.4 K is {share:.1%} of C" in filling.findings["P2a"].causes[0].text


def test_bounds_on_both_sides_are_no_wall() -> None:
    weak = explained(changed(("0.5 * (1.0 - level)", "0.5 * (3.0 - level)")))
    assert "one_sided" not in [c.kind for c in weak.findings["P2a"].causes]
