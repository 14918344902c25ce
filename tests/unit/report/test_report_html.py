"""The report: one file, nothing from outside, nothing lost, nothing taken for markup."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from city_view import CityView

import processes
from soter.diagnostics.diagnostic import SoterError
from soter.report.html import BESIDE, POLICY, html_document, write_html
from soter.report.run.page import page_headline, value_text
from soter.report.run.record import Decision, ReportPage, Violation
from soter.report.wording import prose

if TYPE_CHECKING:
    from city_scene import Scene

    from soter.report.run.record import Flight

ROOT = Path(__file__).parents[3]
SIZE_MAX_BYTES = 8_000_000
PAGE_MAX_BYTES = 300_000
"""Beside a script that is shared."""


class Outline(HTMLParser):
    """Elements, their attributes and the texts of a document."""

    def __init__(self, document: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.open: list[str] = []
        self.feed(document)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def attributes(self, name: str) -> list[str]:
        """Return every value of one attribute."""
        return [value for _, attrs in self.tags if (value := attrs.get(name)) is not None]


def figures_in(document: str) -> list[dict[str, Any]]:
    """Return the figures a document carries."""
    match = re.search(r'id="figures">(.*?)</script>', document, re.DOTALL)
    assert match is not None
    figures: list[dict[str, Any]] = json.loads(match[1])
    return figures


def test_one_file_holds_everything(city_page: ReportPage, tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    path = write_html(city_page, tmp_path / "deep" / "city.html", self_contained=True)
    assert list(path.parent.iterdir()) == [path]
    assert path.stat().st_size < SIZE_MAX_BYTES
    assert "Plotly" in path.read_text(encoding="utf-8")


def test_pages_of_a_folder_share_one_script(
    city_page: ReportPage, cart_page: ReportPage, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    first, second = (
        write_html(page, tmp_path / name)
        for page, name in ((city_page, "city.html"), (cart_page, "cart.html"))
    )
    (script,) = set(tmp_path.iterdir()) - {first, second}
    for path in (first, second):
        outline = Outline(path.read_text(encoding="utf-8"))
        assert outline.attributes("src") == [script.name]
        policy = [a["content"] for tag, a in outline.tags if "http-equiv" in a]
        assert policy == [BESIDE]
    assert "http" not in BESIDE
    assert second.stat().st_size < PAGE_MAX_BYTES
    before = script.stat().st_mtime_ns
    write_html(cart_page, second)
    assert script.stat().st_mtime_ns == before  # it was there
    script.write_text("half of it")
    write_html(cart_page, second)
    assert script.stat().st_size > SIZE_MAX_BYTES / 10


@pytest.mark.parametrize("name", ["city_page", "cart_page"])
def test_nothing_comes_from_the_network(name: str, request: pytest.FixtureRequest) -> None:
    outline = Outline(html_document(request.getfixturevalue(name), ""))
    assert outline.attributes("src") == []
    assert outline.attributes("href") == []
    assert not any("url(" in text or "@import" in text for text in outline.texts)
    policy = [a["content"] for tag, a in outline.tags if "http-equiv" in a]
    assert policy == [POLICY]
    assert "http" not in POLICY
    assert "default-src 'none'" in POLICY


@pytest.mark.parametrize("name", ["city_page", "cart_page"])
def test_every_figure_has_its_place(name: str, request: pytest.FixtureRequest) -> None:
    document = html_document(request.getfixturevalue(name), "")
    places = [i for i in Outline(document).attributes("id") if i.startswith("figure-")]
    assert places == [f"figure-{figure['key']}" for figure in figures_in(document)]
    assert len(places) == len(set(places)) > 1


def test_the_same_page_gives_the_same_bytes(city_page: ReportPage) -> None:
    assert html_document(city_page, "") == html_document(city_page, "")


def test_switches_name_groups_that_exist(city_page: ReportPage) -> None:
    document = html_document(city_page, "")
    switched = set(Outline(document).attributes("data-group"))
    drawn = {trace.get("group") for figure in figures_in(document) for trace in figure["data"]}
    assert switched == drawn - {None}


def test_text_from_outside_is_never_markup(protected: Flight, scene: Scene) -> None:
    evil = "</script><script>alert(1)</script><b>&\u2028"
    flight = dataclasses.replace(
        protected,
        name=evil,
        title=evil,
        decisions=(Decision(1.0, evil, "SC", evil, {evil: True}),),
        violations=(Violation(1.0, evil),),
        summary={"lap_s": evil, evil: evil},
    )
    page = ReportPage(
        title=evil,
        subtitle=evil,
        headline=evil,
        scene=CityView(
            dataclasses.replace(scene, note=evil, credit=evil, goals=((evil, (1, 1, 1)),))
        ),
        flights=(flight,),
        assumptions=(evil,),
        provenance={evil: evil},
    )
    document = html_document(page, "")
    assert "<script>alert" not in document
    assert [tag for tag, _ in Outline(document).tags].count("script") == 3
    assert "b" not in {tag for tag, _ in Outline(document).tags}
    figures_in(document)


def test_the_reader_finds_result_paper_grounds_and_provenance(city_page: ReportPage) -> None:
    text = " ".join(Outline(html_document(city_page, "")).texts)
    for words in (
        "RTA-protected: no violation, 12.6 s a lap.",
        "Beside the paper",
        "paper 14 s",
        "What this rests on",
        "Wind stays within",
        "Provenance",
        "9f2c41d07be5",
        "Decisions of the DM",
        "NoCollision(d.truth)",
    ):
        assert words in text


def test_a_bare_page_is_a_page() -> None:
    document = html_document(ReportPage(title="empty"), "")
    assert Outline(document).texts.count("empty") == 2
    assert figures_in(document) == []


def test_a_missing_extra_is_named(
    city_page: ReportPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(SoterError, match=r"pip install 'soter-rta\[report\]'"):
        write_html(city_page, tmp_path / "city.html")
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_path_is_named(cart_page: ReportPage, tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    (tmp_path / "file").write_text("")
    with pytest.raises(SoterError, match=r"cannot write the report .*file/cart\.html: "):
        write_html(cart_page, tmp_path / "file" / "cart.html")


def test_the_headline_is_the_result(city_page: ReportPage, cart_page: ReportPage) -> None:
    assert page_headline(city_page) == [
        "RTA-protected: no violation, 12.6 s a lap.",
        "AC alone: 2 violations, 10.6 s a lap.",
    ]
    assert page_headline(cart_page) == ["Protected: no violation.", "Unprotected: 2 violations."]
    assert page_headline(dataclasses.replace(cart_page, headline="Mine.")) == ["Mine."]


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("lap_s", 12.345, "12.3 s"),
        ("ac_share", 0.9634, "96.3 %"),
        ("min_clearance_m", -0.126, "−0.13 m"),  # noqa: RUF001 - a minus sign is meant
        ("switches_to_sc", 4, "4 ×"),  # noqa: RUF001 - a multiplication sign is meant
        ("goal_reached", True, "yes"),
        ("flown_km", 1505.2, "1.51e+03 km"),
        ("planner", "RRT*", "RRT*"),
    ],
)
def test_figures_are_written_with_their_unit(key: str, value: float | str, text: str) -> None:
    assert value_text(key, value) == text


def test_the_papers_symbols_get_their_subscripts() -> None:
    assert prose("φ_safer ⊂ φ_safe, ttf_2Δ < 1") == (
        "φ<sub>safer</sub> ⊂ φ<sub>safe</sub>, ttf<sub>2Δ</sub> &lt; 1"
    )


def test_the_assets_are_packaged() -> None:
    # setuptools takes only what pyproject.toml names; an installed report needs its style
    assert "report/assets/*" in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("name", ["city_page", "cart_page"])
def test_a_browser_draws_every_figure(
    name: str, alone: bool, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("no chromium on this machine")
    page: ReportPage = request.getfixturevalue(name)
    path = write_html(page, tmp_path / "report.html", self_contained=alone)
    flags = "--headless --no-sandbox --disable-gpu --enable-unsafe-swiftshader --disable-quic "
    flags += "--no-first-run --disable-background-networking --disable-component-update "
    flags += "--disable-sync --enable-logging=stderr --virtual-time-budget=10000 --dump-dom"
    result = processes.run(
        [browser, *flags.split(), f"--user-data-dir={tmp_path / 'profile'}", path.as_uri()],
        capture_output=True,
        text=True,
        check=True,
    )
    figures = figures_in(html_document(page, ""))
    assert result.stdout.count('class="main-svg"') >= len(figures)
    assert not re.search(r"CONSOLE.*(Uncaught|Error|Refused)", result.stderr)
