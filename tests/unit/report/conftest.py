"""A browser, and the sample records, shared, as building them takes most of a second."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import pytest

import browser

if TYPE_CHECKING:
    from collections.abc import Iterator

    from city_scene import Scene

    from soter.report.run.record import Flight, ReportPage

sample = importlib.import_module("report_sample")


@pytest.fixture
def page() -> Iterator[browser.Page]:
    """A page of a browser, or the test says that there is none."""
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    with browser.page() as opened:
        yield opened


@pytest.fixture(scope="session")
def city_page() -> ReportPage:
    page: ReportPage = sample.city_page()
    return page


@pytest.fixture(scope="session")
def cart_page() -> ReportPage:
    page: ReportPage = sample.cart_page()
    return page


@pytest.fixture(scope="session")
def scene(city_page: ReportPage) -> Scene:
    view: Any = city_page.scene
    scene: Scene = view.scene
    return scene


@pytest.fixture(scope="session")
def protected(city_page: ReportPage) -> Flight:
    """Return the arm both controllers fly."""
    return city_page.flights[1]
