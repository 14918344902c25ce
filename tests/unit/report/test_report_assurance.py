"""The page of a safety case: a picture in which all of the argument stands, tables that fit."""

from __future__ import annotations

import re
from itertools import combinations
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

import browser
from soter.report.safety_case import (
    CaseNode,
    Definition,
    ExpandedPredicate,
    OpenItem,
    SafetyCase,
    Traceability,
    TracedItem,
    TracedProperty,
)
from soter.report.safety_case_page import BOX, LEGEND, argument_pictures, case_body, write_case

if TYPE_CHECKING:
    from pathlib import Path

SVG = "{http://www.w3.org/2000/svg}"
PARTS = ("P1a", "P1b", "P1c", "P2a", "P3", "ttf", "safer", "start")
PHONE_PX = 420


def case_of(modules: int) -> SafetyCase:
    """So many modules; of the second one goal has no evidence, of the third none was checked."""
    case = SafetyCase("Safety case of S", "s.soter", "ab" * 32, "S", {})
    top = case.add(CaseNode("G1", "goal", "System S keeps `Clear(m)` in every run"))
    way = case.add(CaseNode("S1", "strategy", "argument over every RTA module"), under=top)
    for k in range(1, modules + 1):
        module = case.add(CaseNode(f"G1.{k}", "goal", f"RTA module M{k} keeps `X`"), under=way)
        for name in PARTS:
            goal = case.add(
                CaseNode(f"G1.{k}.{name}", "goal", f"{name}: is to be shown"), under=module
            )
            if (k, name) == (2, "P1c"):
                continue
            leaf = CaseNode(f"Sn.{k}.{name}", "solution", "certificate, checked", path="proof")
            leaf.checked, leaf.sha256 = k != 3, "cd" * 32
            leaf.why = "" if leaf.checked else "the certificate is of `another` program"
            case.add(leaf, under=goal)
    case.add(CaseNode("A1", "assumption", "the wind is <weak>"), beside=top)
    case.add(CaseNode("C1", "context", "not covered: `always`"), beside=top)
    return case


def drawn(svg: str) -> ET.Element:
    return ET.fromstring(svg)  # noqa: S314 - of what was just drawn


@pytest.mark.parametrize("modules", [1, 3])
def test_every_goal_is_drawn_with_its_state_and_an_arrow_to_what_supports_it(modules: int) -> None:
    case = case_of(modules)
    drawings = [drawn(svg) for _, svg in argument_pictures(case)]
    assert len(drawings) == (1 if modules == 1 else 1 + modules)
    states: dict[str | None, str | None] = {}
    for svg in drawings:
        for link in svg.iter(f"{SVG}a"):
            group = link.find(f"{SVG}g")
            assert group is not None
            states.setdefault(link.get("href"), group.get("class"))
        wires = [p for p in svg.iter(f"{SVG}path") if p.get("class") == "wire"]
        assert wires
    for n in case.goals:
        assert states[f"#{n.id}"] == f"goal {case.status(n)}", n.id
    goals = [n for n in case.goals if not n.supported_by]
    diamonds = [sum(p.get("class") == "diamond" for p in d.iter(f"{SVG}path")) for d in drawings]
    assert sum(diamonds) == 2 * len(goals) == (0 if modules == 1 else 2)  # each, and its legend


@pytest.mark.parametrize("modules", [1, 3])
def test_a_legend_says_what_is_drawn_and_nothing_else(modules: int) -> None:
    said = []
    for _, svg in argument_pictures(case_of(modules)):
        legend = {t.text for t in drawn(svg).iter(f"{SVG}text") if t.get("class") == "legend"}
        shapes = set()
        for link in drawn(svg).iter(f"{SVG}a"):
            group = link.find(f"{SVG}g")
            assert group is not None
            shapes |= set((group.get("class") or "").split())
            shapes |= {p.get("class") or "" for p in group.iter(f"{SVG}path")}
        assert legend == {text for kind, text in LEGEND if kind in shapes}
        said.append(legend)
    assert ("undeveloped" in set().union(*said)) == (modules == 3)
    assert "supported \N{CHECK MARK}" in said[0]


@pytest.mark.parametrize("modules", [1, 2, 3, 12])
def test_no_box_covers_another(modules: int) -> None:
    for _, svg in argument_pictures(case_of(modules)):
        boxes = []
        for group in drawn(svg).iter(f"{SVG}g"):
            path = group.find(f"{SVG}path")
            if (group.get("class") or "").startswith("goal ") and path is not None:
                x, y, right, _, low = map(float, re.findall(r"-?[\d.]+", path.get("d") or "")[:5])
                assert right - x == pytest.approx(BOX, abs=0.2)
                boxes.append((x, y, right, low))
        assert boxes
        for a, b in combinations(boxes, 2):
            assert a[2] < b[0] or b[2] < a[0] or a[3] < b[1] or b[3] < a[1], (a, b)


def test_texts_are_set_and_every_link_leads_somewhere() -> None:
    page = case_body(case_of(3))
    assert "<code>Clear(m)</code>" in page
    assert "`" not in re.sub(r"<title>.*?</title>|aria-label=\"[^\"]*\"", "", page)
    assert "&lt;weak&gt;" in page
    anchors = set(re.findall(r'id="([^"]+)"', page))
    links = set(re.findall(r'href="#([^"]+)"', page))
    assert links
    assert links <= anchors
    assert "the certificate is of <code>another</code> program" in page


def board_case() -> SafetyCase:
    """With a long hash, an open hazard and predicates with long names."""
    case = case_of(3)
    long = "distance_of_the_nearest_obstacle_ahead"
    definitions = (Definition("Need", f"max({long}, 0.0) / " + " / ".join([long] * 6)),)
    case.predicates = (
        ExpandedPredicate("M1", "ttf", f"Need({long}) < 0.0", "Need < 0.0", definitions),
        ExpandedPredicate("M1", "safer", ""),
    )
    case.provenance = {"Soter": f"1, SHA-256 {'ef' * 32}", "certificate": f"SHA-256 {'cd' * 32}"}
    item = TracedItem("hazard", "H<1>", "it strikes", ("M1.safe",), ("M1.safe",), "open")
    behind = TracedProperty("M1.safe", "proof", "undeveloped", "G1.1", hazards=("H<1>",))
    said = f"always {long} > 0.0"
    flown = TracedProperty(said, "flights", "not flown")
    proved = TracedProperty("M2.safe", "proof", "supported", "G1.2")
    shown = TracedItem("hazard", "H2", "it falls", (said,), ("M2.safe", said), "supported")
    unowned = OpenItem("assumption", "A1", "no owner")
    case.plants = {"m: Cart": (f"der x = {long} < v",), "w: Wind": ()}
    case.refuted = ["the certificate is rejected: `SEAL` does not fit"]
    unclosed = OpenItem("hazard", "H<1>", "undeveloped: `M1.safe`")
    case.traceability = Traceability(
        "h.csv", "ab" * 32, (item, shown), (behind, proved, flown), (unclosed, unowned)
    )
    return case


def test_what_a_board_asks_stands_on_the_page_and_its_links_lead_somewhere() -> None:
    page = case_body(board_case())
    lead = page.partition("</header>")[0]
    assert "the certificate is rejected: <code>SEAL</code> does not fit" in lead
    assert page.count("with 1 assumption open; flights are missing") == 1, "H2 alone is supported"
    assert "der x = distance_of_the_nearest_obstacle_ahead &lt; v" in page
    assert page.count("extern: the program has no equations of it") == 1
    for text in ("H&lt;1&gt;", "undeveloped, by proof", "Need &lt; 0.0", "computes it", "1 hazard"):
        assert text in page
    anchors = set(re.findall(r'id="([^"]+)"', page))
    assert set(re.findall(r'href="#([^"]+)"', page)) <= anchors


def test_versions_and_hashes_are_repeated_on_every_printed_page(tmp_path: Path) -> None:
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    path = write_case(board_case(), tmp_path / "index.html")
    style = "getComputedStyle(document.querySelector('{}')).display"
    with browser.page() as page:
        page.open(path.as_uri())
        page.wait("document.querySelector('.foot') !== null")
        assert page.value(style.format(".foot")) == "none"
        page.media("print")
        assert page.value(style.format(".foot")) == "table-footer-group"
        assert page.value(style.format("main")) == "table"
        foot = page.value("document.querySelector('main > .foot').textContent")
    assert "cd" * 32 in foot
    assert "ef" * 32 in foot


def test_it_fits_a_phone(tmp_path: Path) -> None:
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    path = write_case(board_case(), tmp_path / "index.html")
    with browser.page() as page:
        page.size(PHONE_PX, 900)
        page.open(path.as_uri())
        page.wait("document.readyState === 'complete' && document.querySelector('.gsn') !== null")
        assert page.value("document.documentElement.scrollWidth") <= PHONE_PX
        assert page.errors == []
