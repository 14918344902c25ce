"""The report of a run as somebody opens it: on a phone, with the script beside it or missing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import soter

if TYPE_CHECKING:
    import browser

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


COVERED = """(() => {
  const boxes = [...document.querySelectorAll('.annotation-text, .xtick text, .ytick text')]
    .map((e) => [e.textContent, e.getBoundingClientRect()]).filter(([, b]) => b.width > 0);
  const wide = document.documentElement.clientWidth;
  const found = boxes.filter(([, b]) => b.left < 0 || b.right > wide + 1).map(([t]) => [t, 'cut']);
  boxes.forEach(([t, p], i) => boxes.slice(i + 1).forEach(([u, q]) => {
    const beside = p.left >= q.right - 2 || q.left >= p.right - 2;
    if (!beside && p.top < q.bottom - 3 && q.top < p.bottom - 3) found.push([t, u]);
  }));
  return [boxes.length, found];
})()"""
CUT = (
    "[...document.querySelectorAll('.events td')]"
    ".filter((e) => e.getBoundingClientRect().right > document.documentElement.clientWidth + 1)"
    ".length"
)


@pytest.mark.parametrize("wide", [PHONE_PX, 500])
def test_no_label_is_cut_or_covered_on_a_phone_and_decisions_are_read_whole(
    report: Path, page: browser.Page, wide: int
) -> None:
    page.size(wide, 900)
    page.open(report.as_uri())
    page.wait(READY)
    count, overlaps = page.value(COVERED)
    assert count > 10
    assert overlaps == []
    assert page.value("document.querySelectorAll('.events td').length") > 10
    assert page.value(CUT) == 0


def test_a_page_that_was_moved_alone_says_what_it_lacks(
    report: Path, page: browser.Page, tmp_path: Path
) -> None:
    alone = tmp_path / "alone.html"
    alone.write_bytes(report.read_bytes())
    page.open(alone.as_uri())
    page.wait("document.readyState === 'complete'")
    assert "soter-plotly" in page.value("document.getElementById('figure-chart-0').textContent")
    assert page.value(LIT) == ["SafeCart.Fast"]
