"""The report of a run as somebody opens it: on a phone, with the script beside it or missing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import browser
import soter

if TYPE_CHECKING:
    from collections.abc import Iterator

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
PHONE_PX = 420
READY = "document.querySelectorAll('#figure-chart-0 .main-svg').length > 0"
LIT = "[...document.querySelectorAll('.on')].map((e) => e.dataset.component)"
MOVE = (
    "(() => { const m = document.getElementById('moment'); m.value = %s;"
    " m.dispatchEvent(new Event('input')); })()"
)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    program = soter.load(CART)
    path = tmp_path_factory.mktemp("reports") / "cart.html"
    return program.write_report(program.simulate(until="10s"), path)


@pytest.fixture
def page() -> Iterator[browser.Page]:
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    with browser.page() as opened:
        yield opened


def test_a_run_fits_a_phone_and_its_diagram_follows_the_slider(
    report: Path, page: browser.Page
) -> None:
    page.size(PHONE_PX, 900)
    page.open(report.as_uri())
    page.wait(READY)
    assert page.value("document.documentElement.scrollWidth") <= PHONE_PX
    lengths = page.value("document.getElementById('figure-chart-0').data.map((t) => t.x.length)")
    assert min(lengths[-6:]) > 50  # every signal has its times, also where they are written once
    assert page.value(LIT) == ["SafeCart.Fast"]
    page.value(MOVE % 2)
    assert page.value(LIT) == ["SafeCart.Careful"]
    assert page.value("document.querySelector('.player output').textContent") == "2.000 s"
    assert {r.split(":")[0] for r in page.requests} <= {"file", "data", "blob"}
    assert page.errors == []


def test_a_page_that_was_moved_alone_says_what_it_lacks(
    report: Path, page: browser.Page, tmp_path: Path
) -> None:
    alone = tmp_path / "alone.html"
    alone.write_bytes(report.read_bytes())
    page.open(alone.as_uri())
    page.wait("document.readyState === 'complete'")
    assert "soter-plotly" in page.value("document.getElementById('figure-chart-0').textContent")
    assert page.value(LIT) == ["SafeCart.Fast"]
