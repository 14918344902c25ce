"""The page of a campaign: its charts are its figures, and its command flies the same again."""

from __future__ import annotations

import html
import re
import shlex
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter import load
from soter.campaign.page import Bars, Histogram, make_page, page_body
from soter.cli.main import main
from soter.cli.terminal.command_outcome import FINE, VIOLATED

if TYPE_CHECKING:
    from soter.campaign.result import Campaign

WALK = """soter 1;
param PUSH: float = 0.5;
topic u: float in [-1.0, 1.0];
plant Car period 10ms { reads u; state x: float unit "m" = 0.0; der x = u; }
node Driver period 100ms { publishes u; step { publish u = choose [0, 1] == 0 ? PUSH : -PUSH; } }
system Road {
  car: Car; node Driver; until 2s; always abs(car.truth.x) < 0.4;
  measure away = car.truth.x in [-0.5, 0.5] / 10 every 100ms;
}
"""
CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Path]:
    path = tmp_path_factory.mktemp("walk") / "a walk.soter"
    path.write_text(WALK)
    campaign = load(path).campaign(
        "Road", {"PUSH": 0.75}, flights=30, seed=7, until="3s", output=path.parent / "c"
    )
    return campaign, path


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("cart") / "c"
    return load(CART).campaign(
        "Protected", flights=6, until="10s", arms=("ac",), saves="1s", output=folder
    )


def commands(page: str) -> list[list[str]]:
    """The commands of a page."""
    codes = re.findall(r"<code>(soter .*?)</code>", page)
    return [shlex.split(html.unescape(code)) for code in codes]


def test_the_command_under_again_flies_the_same_flights(
    walk: tuple[Campaign, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign, path = walk
    again = commands(page_body(make_page(campaign, str(path))))[-2]
    assert again[:3] == ["soter", "campaign", str(path)]
    code = main([*again[1:-1], "-o", str(tmp_path / "again")])
    assert code == (VIOLATED if campaign.result.violations else FINE)
    assert campaign.result.digest in capsys.readouterr().out


def test_the_command_under_again_has_the_arms_and_the_saves(cart: Campaign) -> None:
    again = commands(page_body(make_page(cart, str(CART))))[-2]
    asked = dict(pairwise(again))
    assert (asked["--arms"], asked["--saves"]) == ("ac", "1s")


def test_the_charts_are_the_figures_of_the_flights(cart: Campaign) -> None:
    control, takeovers, arms = make_page(cart, str(CART)).charts
    assert isinstance(control, Bars)
    assert control.rows[0][1] == cart.result.modules[0].ac_share
    assert isinstance(takeovers, Histogram)
    flown = sum(k * n for k, n in enumerate(takeovers.bins[1:-1]))
    assert flown == cart.result.modules[0].disengagements > 0
    assert sum(takeovers.bins) == cart.result.flights
    assert isinstance(arms, Bars)
    assert [(name, text) for name, _, text in arms.rows] == [("ours", "0 of 6"), ("ac", "6 of 6")]
    drawn = page_body(make_page(cart, str(CART)))
    assert 'height="14"' in drawn
    assert 'width="476.00"' in drawn  # the arm whose every flight is violated


def test_the_page_names_what_flights_were_judged_by_and_bounds_in_their_units(
    walk: tuple[Campaign, Path],
) -> None:
    campaign, path = walk
    drawn = page_body(make_page(campaign, str(path)))
    assert "<code>always abs(car.truth.x) &lt; 0.4</code>" in drawn
    low, high = campaign.result.per_flight
    assert 0.0 < low < high < 1.0
    assert f"{100 * low:.3g} to {100 * high:.3g} % of flights violated" in drawn


def test_ac_has_its_own_colour_in_the_chart_of_control_alone(cart: Campaign) -> None:
    charts = [c for c in make_page(cart, str(CART)).charts if isinstance(c, Bars)]
    assert [c.kind for c in charts] == ["ac", "bad"]


def test_a_measure_has_the_unit_of_what_it_measures(walk: tuple[Campaign, Path]) -> None:
    page = make_page(walk[0], str(walk[1]))
    (away,) = page.histograms
    assert away.x_name == "away / m"
    assert re.fullmatch(r"mean \S+ m, least \S+ m, most \S+ m.*", away.caption)
    assert ">away / m</text>" in page_body(page)


def test_the_headline_has_the_hours_that_were_flown(cart: Campaign) -> None:
    """A minute was 0.0 h, and four minutes 0.1 h."""
    made = make_page(cart, str(CART))
    assert made.headline.endswith(" in 0.02 h")
    assert "0.02 h in 6 flights" in page_body(made)
