"""The sample records as fixtures; building them takes most of a second, so they are shared."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from soter.report.run.record import Flight, ReportPage, Scene

sample = importlib.import_module("report_sample")


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
    assert city_page.scene is not None
    return city_page.scene


@pytest.fixture(scope="session")
def protected(city_page: ReportPage) -> Flight:
    """Return the arm both controllers fly."""
    return city_page.flights[1]
