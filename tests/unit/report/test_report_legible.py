"""Every kind of page, at two widths and in the dark: nothing on it hinders reading."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from html import unescape
from typing import TYPE_CHECKING

import numpy as np
import pytest

import browser
import legibility
import soter
from soter.report.html import write_document, write_html
from soter.report.judged_curves import JudgedTimes, drawing_html
from soter.report.proof_page import (
    R2,
    R4,
    R5,
    AdvicePage,
    Line,
    ModuleProof,
    ProofPage,
    RegionFigure,
    advice_main,
    write_proof,
)
from soter.report.safety_case_page import write_case
from soter.report.templates import PageSection, sections_main

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.report.run.record import ReportPage

case_of = importlib.import_module("test_report_assurance").case_of
in_browser = importlib.import_module("test_report_in_browser")
CART = in_browser.CART
LATE = CART.parents[1] / "testing" / "late_sc.soter"
HASH = "64e94e48e18f8e7a523192fd32eba788858b7f9257e2f21fe1d313150dbd6b1c"
WINDOWS = ((1300, "light"), (1300, "dark"), (420, "light"))
DRAWN = (
    "document.readyState === 'complete' && [...document.querySelectorAll('.plot')]"
    ".filter((e) => e.offsetParent).every((e) => e.querySelector('.main-svg, canvas'))"
)


@pytest.fixture(scope="module")
def page() -> Iterator[browser.Page]:
    """One browser for all of them: each test opens a page of its own."""
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    with browser.page() as opened:
        yield opened


def run_page(folder: Path) -> Path:
    program = soter.load(CART)
    return program.write_report(program.simulate("Unprotected", until="10s"), folder / "run.html")


def trace_page(folder: Path) -> Path:
    """More steps than there is room for: the table opens at the one that violates."""
    program = soter.load(LATE)
    (result,) = program.explore(test="Late", output=folder, html=True).tests
    assert result.page is not None
    return result.page


def case_page(folder: Path) -> Path:
    return write_case(case_of(3), folder / "case.html")


def advice(best_ms: float | None) -> AdvicePage:
    periods = (10.0, 20.0, 50.0, 200.0)
    names = ("K", "S_0 (m = 2)", "S_1 (m = 3)", "S_2 (m = 4)", "S_4 (m = 6)")
    lines = tuple(
        Line(n, tuple((x, 0.8 - 0.1 * k) for x in periods), (True, True, True, False))
        for k, n in enumerate(names)
    )
    head = ("period", "SC", "H*", *names, "P1c", "P2b", "verifies", "why not")
    why = "`ttf` may be false on 1832 cells from which AC could leave K within H"
    cells = ("10 ms", "34 ms", *["79.6%"] * len(names), "yes", "m = 2, m = 3", "no", why)
    table = tuple((f"{x:g} ms", *cells) for x in periods)
    return AdvicePage(
        "SafeCart", "none verifies", lines, head, table, ("shares: K",), best_ms, "cart.soter"
    )


def advice_page(folder: Path) -> Path:
    return write_document("advice", advice_main([advice(50.0)]), folder / "advice.html")


def told_page(folder: Path) -> Path:
    rows = ((HASH, "-10.487", "room - line.T * v - E_Q " * 4), (HASH, "0.5", "x"))
    section = PageSection("What was judged", (HASH * 2,), ("`hash`", "at", "comparison"), rows)
    main = sections_main("a page", "0 of 3 reads lay outside `safe`", "bad", [section])
    return write_document("a page", main, folder / "told.html")


def judged_page(folder: Path) -> Path:
    """A log with alarms, and with a name that is longer than a phone is wide."""
    times = JudgedTimes(0.0, 600.0, changes=[(0.0, "SC"), (30.0, "AC"), (400.0, "SC")])
    long = ("Up(t.height - p.z, -v.z, tau): room - line.T * v", "m/s", f"`{HASH * 2}`")
    for k in range(6_000):
        value = float(np.sin(k / 300)) * 12_345.678
        times.note_value(long, k / 10, value, (-10_000.0, 9_000.0), alarm=True)
        times.alarms[times.column_at(k / 10)] += value > 9_000.0
    section = PageSection(
        "What was judged", (), drawn=drawing_html(times, "reads outside of `safe`")
    )
    main = sections_main("a log", "1,000 alarms", "bad", [section])
    return write_document("a log", main, folder / "judged.html")


MADE = (
    judged_page,
    run_page,
    in_browser.proof_page,
    in_browser.campaign_page,
    trace_page,
    case_page,
    advice_page,
    told_page,
)


def stumbled(path: Path, page: browser.Page) -> dict[tuple[int, str], list[str]]:
    """What hinders in each window, of those in which something does."""
    found = {}
    for wide, scheme in WINDOWS:
        page.scheme(scheme)
        page.size(wide, 900)
        page.open(path.as_uri())
        page.wait(DRAWN)
        hindering = legibility.hindrances(page)
        if hindering:
            found[wide, scheme] = hindering
    return found


@pytest.mark.parametrize("make", MADE)
def test_nothing_on_a_page_hinders_reading(
    make: Callable[[Path], Path], page: browser.Page, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    assert stumbled(make(tmp_path), page) == {}


def test_nothing_on_a_page_of_a_flight_hinders_reading(
    city_page: ReportPage, page: browser.Page, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    assert stumbled(write_html(city_page, tmp_path / "city.html"), page) == {}


LETTERS = "a word that is read"
DARK_BOX = (
    '<svg width="300" height="30"><rect width="300" height="30" fill="#111"/>'
    '<text y="20">{}</text></svg>'
)
FAR_RIGHT = (
    '<div style="overflow-x: auto"><svg width="3000" height="30">'
    '<text x="2000" y="20">{}</text></svg></div>'
)


@pytest.mark.parametrize(
    ("inside", "hindrance"),
    [
        (f'<p style="width: 1400px">{LETTERS * 9}</p>', "page: "),
        (f'<p style="color: #999">{LETTERS}</p>', "contrast 2.8: "),
        (f'<p style="opacity: 0.42">{LETTERS}</p>', "contrast "),
        (f'<p style="font-size: 8px">{LETTERS}</p>', "8.0 px: "),
        (f'<p style="width: 40px; overflow: hidden; white-space: nowrap">{LETTERS}</p>', "cut: "),
        (f'<svg width="50" height="20"><text y="15">{LETTERS}</text></svg>', "cut: "),
        (
            f'<svg width="200" viewBox="0 0 1000 100"><text y="50">{LETTERS}</text></svg>',
            "3.2 px: ",
        ),
        (DARK_BOX.format(LETTERS), "contrast 1."),
        (FAR_RIGHT.format(LETTERS), "out of sight: "),
    ],
)
def test_each_hindrance_is_seen(
    inside: str, hindrance: str, page: browser.Page, tmp_path: Path
) -> None:
    path = tmp_path / "page.html"
    path.write_text(f'<body style="background: #fff; font-size: 16px">{inside}</body>')
    page.size(1300, 900)
    page.open(path.as_uri())
    page.wait("document.readyState === 'complete'")
    told = legibility.hindrances(page)
    assert any(t.startswith(hindrance) for t in told), told


# ---------------------------------------------------------------- what a page says


def words(path: Path) -> str:
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", path.read_text("utf-8"))).split())


def test_a_run_names_what_was_watched_and_how_often_it_failed(tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    program = soter.load(CART)
    run = program.simulate("Unprotected", until="15s")
    said = words(program.write_report(run, tmp_path / "run.html"))
    assert "✕ violated always Clear(c.truth)" in said
    (violation,) = run.violation_list
    assert violation.count > 1
    assert f" {violation.time_s:.3f} System Unprotected" in said
    assert f"always Clear(c.truth), the first of {violation.count} times" in said
    notes, rests_on = said.split("Notes")[1].split("What this rests on")
    assert run.notes
    assert all(note.replace("`", "") in notes for note in run.notes)
    assert "0.02 m of motion.x, 0.05 m/s of motion.v" in rests_on
    run = program.simulate(until="15s")
    safe = words(program.write_report(run, tmp_path / "safe.html"))
    module = run.modules["SafeCart"]
    assert f"control: {module.switches_to_sc + module.switches_to_ac} steps in all." in safe
    assert "✓ held always Clear(c.truth)" in safe


def test_a_diagram_covers_no_shadow_of_what_scrolls(page: browser.Page, tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    page.size(420, 900)
    page.open(run_page(tmp_path).as_uri())
    page.wait(DRAWN)
    assert page.value("document.querySelectorAll('.program .scroll .back').length") == 1
    assert (
        page.value("getComputedStyle(document.querySelector('.program svg .back')).fill") == "none"
    )


def axis(name: str, regions: list[int], lets_ac: list[bool] | None = None) -> RegionFigure:
    """A group of one axis from -1 to 1 m."""
    return RegionFigure(
        title=name,
        x_name=name,
        y_name="",
        x_edges=np.linspace(-1.0, 1.0, len(regions) + 1),
        y_edges=np.array([0.0, 1.0]),
        regions=np.array([regions], dtype=np.uint8).T,
        x_unit="m",
        lets_ac=None if lets_ac is None else np.array([lets_ac]).T,
    )


def test_an_axis_that_lies_in_one_region_is_a_sentence(tmp_path: Path) -> None:
    figures = (
        axis("c.a", [R5] * 4, [True] * 4),
        axis("c.b", [R4, R5, R5, R4]),
        axis("c.d", [R5] * 4),
        axis("c.e", [R5] * 4, [False, True, True, False]),  # the border of `ttf` is drawn
        axis("c.f", [R2] * 4),
    )
    module = ModuleProof("M", "proved", "", (), (), (), figures)
    made = ProofPage("p", "M: proved", "", (module,), ("the wind",), ())
    made = replace(made, not_covered=("System Other",))
    path = write_proof(made, tmp_path / "proof.html")
    assert path.read_text("utf-8").count('<svg class="regions"') == 2
    said = words(path).replace("\N{MINUS SIGN}", "-")
    axes = "R5 from end to end, so without a figure: c.a in [-1, 1] m; c.d in [-1, 1] m."
    assert axes in said
    assert "R2 from end to end, so without a figure: c.f in [-1, 1] m." in said
    rests_on, rest = said.split("What this rests on")[1].split("Not covered")
    assert (rests_on.strip(), rest.split()[:2]) == ("the wind", ["System", "Other"])


def test_advice_draws_where_the_program_verifies_apart_from_what_is_computed() -> None:
    drawn = advice_main([advice(50.0)])
    assert drawn.count('class="best"') == 1
    assert 'class="best"' not in advice_main([advice(None)])
    assert drawn.count("class=ring") == 5  # the last period of each curve
    assert "<code>ttf</code> may be false" in drawn
    assert "What the decision period costs: cart.soter" in drawn


def test_a_long_name_of_a_signal_is_shown_without_its_first_parts_on_a_phone(
    cart_page: ReportPage, page: browser.Page, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    (chart, *_) = cart_page.charts
    far, wide = ("vehicle.front_left." * 4 + name for name in ("way", "room"))
    series = (
        replace(chart.series[0], name=far, panel=far),
        replace(chart.series[1], name=wide, panel=wide, values=1e5 * chart.series[1].values),
    )
    path = write_html(
        replace(cart_page, charts=(replace(chart, series=series),)), tmp_path / "a.html"
    )
    assert stumbled(path, page) == {}
    names = "[...document.querySelectorAll('.annotation text')].map((e) => e.textContent).join(' ')"
    assert re.search(r"…(vehicle\.|front_left\.)*way / ", page.value(names))
    page.size(1300, 900)
    page.open(path.as_uri())
    page.wait(DRAWN)
    assert far in page.value(names)


def decided(page: ReportPage, count: int) -> ReportPage:
    (chart, *_) = page.charts
    return replace(page, charts=(replace(chart, decisions=(chart.decisions[0],) * count),))


def test_few_decisions_are_seen_whole_and_many_scroll(
    cart_page: ReportPage, page: browser.Page, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    table = "document.querySelector('.events').parentElement"
    for count, scrolls in ((12, False), (60, True)):
        path = write_html(decided(cart_page, count), tmp_path / f"{count}.html")
        for width in (420, 1300):
            page.size(width, 900)
            page.open(path.as_uri())
            page.wait(DRAWN)
            assert page.value(f"{table}.scrollHeight > {table}.clientHeight + 1") is scrolls


def test_a_drawing_that_nearly_fits_a_phone_is_made_to_fit(
    page: browser.Page, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    drawing = "document.querySelector('.program .scroll svg')"
    page.size(420, 900)
    page.open(run_page(tmp_path).as_uri())
    page.wait(DRAWN)
    wide = page.value(f"{drawing}.viewBox.baseVal.width")
    assert page.value(f"{drawing}.clientWidth") < wide < 450
    assert page.value(f"{drawing}.parentElement.scrollWidth <= {drawing}.parentElement.clientWidth")
    page.size(1300, 900)
    assert page.value(f"{drawing}.clientWidth") == wide


def test_a_table_with_long_cells_says_its_heads_on_a_phone(
    page: browser.Page, tmp_path: Path
) -> None:
    page.size(420, 900)
    page.open(told_page(tmp_path).as_uri())
    page.wait("document.readyState === 'complete'")
    before = (
        "[...document.querySelectorAll('td')].map((e) => getComputedStyle(e, '::before').content)"
    )
    assert page.value(before)[:3] == ['"hash: "', '"at: "', '"comparison: "']
    page.size(1300, 900)
    assert set(page.value(before)) == {"none"}
