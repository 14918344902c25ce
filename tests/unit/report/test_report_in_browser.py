"""The report of a run as somebody opens it: on a phone, with the script beside it or missing."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from soter.campaign.page import write_page
from soter.report.proof_page import (
    R1,
    R4,
    ModuleProof,
    ProofPage,
    PropertyRow,
    RegionFigure,
    RegionSlice,
    write_proof,
)
from soter.simulate.run_report import report_page

if TYPE_CHECKING:
    from collections.abc import Callable

    import browser

HASH = "64e94e48e18f8e7a523192fd32eba788858b7f9257e2f21fe1d313150dbd6b1c"
CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
PHONE_PX = 420
READY = "document.querySelectorAll('#figure-chart-0 .main-svg').length > 0"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    program = soter.load(CART)
    path = tmp_path_factory.mktemp("reports") / "cart.html"
    return program.write_report(program.simulate(until="10s"), path)


def test_a_run_fits_a_phone(report: Path, page: browser.Page) -> None:
    page.size(PHONE_PX, 900)
    page.open(report.as_uri())
    page.wait(READY)
    assert page.value("document.documentElement.scrollWidth") <= PHONE_PX
    lengths = page.value("document.getElementById('figure-chart-0').data.map((t) => t.x.length)")
    assert min(lengths[-6:]) > 50  # every signal has its times, also where they are written once
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


MANY = """soter 1;
type P = { x: float unit "m", y: float unit "m", z: float unit "m" };
type Wheels = { left: float unit "rad/s", right: float unit "rad/s" };
type Mixed = { a: float unit "m", b: float unit "s", c: float, d: float };
topic late: float;
topic where: P;
plant Body period 10ms { drives where = p; state w: Wheels; state m: Mixed; state p: P;
  der w = { left: 1.0, right: 2.0 }; der m = { a: 1.0, b: 1.0, c: 1.0, d: 1.0 };
  der p = { x: 1.0, y: 2.0, z: 0.0 }; }
node N period 10ms { subscribes where; publishes late; step { publish late = where.x; } }
system S default { b: Body; node N; until 1s; always b.truth.p.x < 9.0; }
"""


def test_other_signals_are_folded_below_those_of_properties_and_drawn_when_opened(
    page: browser.Page, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    (tmp_path / "many.soter").write_text(MANY)
    program = soter.load(tmp_path / "many.soter")
    run = program.simulate()
    panels = list(dict.fromkeys(s.panel for s in report_page(run, "", {}).charts[0].series))
    assert panels == ["b.p", "b.w", "b.m.a", "b.m.b", "b.m.c", "b.m.d", "where", "late"]
    page.size(PHONE_PX, 900)
    page.open(program.write_report(run, tmp_path / "many.html").as_uri())
    page.wait(READY)
    texts = "document.querySelectorAll('#figure-chart-0{} .annotation-text')"
    names = f"[...{texts}].map((e) => e.textContent)"
    shown = page.value(names.format(""))
    assert "b.p / m  (dashed: b.p.y, dotted: b.p.z)" in shown
    assert "b.w / (rad/s)  (dashed: b.w.right)" in shown
    assert "late" not in shown
    assert page.value("document.querySelectorAll('details[open]').length") == 0
    folded = page.value("document.body.scrollHeight")
    page.value("document.querySelector('details').open = true")
    page.wait("document.querySelectorAll('#figure-chart-0-more .main-svg').length > 0")
    assert "late" in page.value(names.format("-more"))
    assert page.value("document.body.scrollHeight") > folded + 600
    drawn = "document.querySelector('#figure-chart-0-more .main-svg').getBoundingClientRect().width"
    assert 300 < page.value(drawn) <= PHONE_PX
    assert page.errors == []


def proof_page(folder: Path) -> Path:
    """A proof of three axes: of AC's are 4, 16 and 0 of the cells of three slices."""
    cells = np.full((3, 6, 6), R1, dtype=np.uint8)
    cells[0, :2, :2] = cells[1, :4, :4] = R4
    edges = np.linspace(-1.0, 1.0, 7)
    figure = RegionFigure(
        title="c.x and c.v",
        x_name="c.x",
        y_name="c.v",
        x_edges=edges,
        y_edges=edges,
        regions=cells[1],
        across="c.z",
        slices=tuple(RegionSlice(f"c.z at {k} m", part) for k, part in enumerate(cells)),
        shown=1,
    )
    rows = tuple(PropertyRow(f"P{k}", "words " * 20, "proved", HASH, 0.5) for k in range(3))
    module = ModuleProof("c.Safe", "proved", HASH, rows, (("H", "horizon", "1 s"),), (), (figure,))
    made = ProofPage("a proof", "c.Safe: proved", "", (module,), (HASH,), (), {"program": HASH})
    return write_proof(made, folder / "proof.html")


SHOWN = "[...document.querySelectorAll('.slice')].map((e) => getComputedStyle(e).display != 'none')"
WHERE = "document.querySelector('.slices output').textContent"
SLIDE = (
    "(() => { const m = document.querySelector('.slices input'); m.value = %s;"
    " m.dispatchEvent(new Event('input')); })()"
)


def test_a_slider_goes_through_the_third_axis_from_the_fullest_slice(
    page: browser.Page, tmp_path: Path
) -> None:
    path = proof_page(tmp_path)
    page.open(path.as_uri())
    page.wait(
        "document.querySelectorAll('.slice').length === 3 && document.readyState != 'loading'"
    )
    assert page.value(SHOWN) == [False, True, False]
    assert page.value("document.querySelector('.slices input').clientWidth") > 100
    page.value(SLIDE % 2)
    assert page.value(SHOWN) == [False, False, True]
    assert page.value(WHERE) == "c.z at 2 m"
    page.value(SLIDE % 0)
    assert page.value(SHOWN) == [True, False, False]
    assert page.errors == []


def test_without_a_script_the_fullest_slice_is_there_and_no_slider(
    page: browser.Page, tmp_path: Path
) -> None:
    path = proof_page(tmp_path)
    path.write_text(re.sub(r"<script>.*?</script>", "", path.read_text(), flags=re.DOTALL))
    page.open(path.as_uri())
    page.wait(
        "document.querySelectorAll('.slice').length === 3 && document.readyState != 'loading'"
    )
    assert page.value(SHOWN) == [False, True, False]
    assert page.value(WHERE) == "c.z at 1 m"
    assert page.value("document.querySelector('.slices input').clientWidth") == 0


def campaign_page(folder: Path) -> Path:
    program = soter.load(CART)
    flown = program.campaign("Protected", flights=3, until="5s", arms=("ac",), output=folder / "c")
    return write_page(flown, str(CART), folder / "campaign.html")


@pytest.mark.parametrize("make", [proof_page, campaign_page])
def test_hashes_break_and_tables_scroll_on_a_phone(
    make: Callable[[Path], Path], page: browser.Page, tmp_path: Path
) -> None:
    page.size(PHONE_PX, 900)
    page.open(make(tmp_path).as_uri())
    page.wait("document.querySelectorAll('table').length > 1 && document.readyState === 'complete'")
    assert page.value("document.documentElement.scrollWidth") <= PHONE_PX
    long = "[...document.querySelectorAll('td.long')].every((e) => e.clientWidth > 150)"
    assert page.value(long)
