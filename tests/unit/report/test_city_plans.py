"""Plans on the map: drawn with their arm, told apart when refused, switched by the reader."""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from city_map import city_map
from city_scene import PLAN_GROUP, REFUSED_GROUP, plans_group
from city_solid import city_solid

from soter.report.html import html_document
from soter.report.run.figure_parts import group_of_arm
from soter.report.run.record import ReportPage, Way

if TYPE_CHECKING:
    from city_scene import Scene

    from soter.report.run.record import Flight, Json

PLAN = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 3.0], [7.0, 5.0, 2.0]])


@pytest.fixture
def planned(city_page: ReportPage) -> ReportPage:
    """The city's page, its first arm with a plan in force and a refused one."""
    ways = (Way(PLAN, "plan 1"), Way(PLAN[::-1] + 1.0, "Elsewhere <5>", refused=True))
    first = dataclasses.replace(city_page.flights[0], ways=ways)
    return dataclasses.replace(city_page, flights=(first, *city_page.flights[1:]))


def of_group(data: tuple[Json, ...], flight: Flight, *, refused: bool) -> list[Json]:
    return [t for t in data if t.get("group") == plans_group(flight.name, refused=refused)]


def switches(page: ReportPage) -> set[str]:
    return set(re.findall(r'<button type="button" data-group="([^"]+)"', html_document(page, "")))


@pytest.mark.parametrize("draw", [city_map, city_solid])
def test_plans_are_drawn_point_by_point_and_refused_ones_in_red(
    scene: Scene, planned: ReportPage, draw: object
) -> None:
    data = draw(scene, planned.flights).data  # type: ignore[operator]
    (plan,) = of_group(data, planned.flights[0], refused=False)
    (refused,) = of_group(data, planned.flights[0], refused=True)
    assert plan["x"] == [1.0, 4.0, 7.0]
    assert refused["y"] == [6.0, 6.0, 3.0]
    assert refused["line"]["color"] == "@takeover" != plan["line"]["color"]  # type: ignore[index]


def test_on_the_map_every_point_tells_of_its_own_plan(scene: Scene, city_page: ReportPage) -> None:
    ways = (Way(PLAN, "plan <1>"), Way(PLAN[:2], "plan 2"))
    flight = dataclasses.replace(city_page.flights[0], ways=ways)
    (plans,) = of_group(city_map(scene, [flight]).data, flight, refused=False)
    assert plans["x"] == [1.0, 4.0, 7.0, None, 1.0, 4.0]
    assert plans["text"] == ["plan &lt;1&gt;"] * 4 + ["plan 2"] * 2


def test_plans_go_with_their_arm_and_can_be_switched_off_together(planned: ReportPage) -> None:
    groups = plans_group(planned.flights[0].name, refused=False).split(" ")
    assert groups == [group_of_arm(planned.flights[0].name), PLAN_GROUP]
    assert {PLAN_GROUP, REFUSED_GROUP} <= switches(planned)


def test_a_name_of_two_words_is_one_group() -> None:
    assert len(plans_group("SC alone", refused=True).split(" ")) == 2


def test_no_switch_for_plans_that_nobody_made(city_page: ReportPage) -> None:
    assert not switches(city_page) & {PLAN_GROUP, REFUSED_GROUP}


def test_of_two_missions_with_plans_the_first_is_shown(planned: ReportPage) -> None:
    mixed = [f for f in planned.flights if 0 < f.in_control.mean() < 1]
    twice = (
        dataclasses.replace(mixed[0], ways=planned.flights[0].ways),
        dataclasses.replace(mixed[0], name="Other", ways=planned.flights[0].ways),
    )
    document = html_document(dataclasses.replace(planned, flights=twice), "")
    assert f'data-group="{group_of_arm(mixed[0].name)}" aria-pressed="true"' in document
    assert 'data-group="arm:Other" aria-pressed="false"' in document


def test_a_plan_is_points_in_space() -> None:
    with pytest.raises(ValueError, match="points"):
        Way(PLAN[:, :2], "flat")
