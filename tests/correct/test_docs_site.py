"""The site of the docs: it builds, every link leads somewhere, and it says where one does not."""

from __future__ import annotations

import re
import shlex
import sys
from contextlib import suppress
from html import unescape
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import browser
import legibility
import processes
from json_documents import MADE
from soter.cli.main import COMMANDS, command_parser
from soter.cli.terminal.command_line import HelpWantedError
from tables import all_rows

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TERMINALS = ("", "sh", "console", "text")


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Any:
    pytest.importorskip("markdown_it", reason="the extra `docs` is not installed")
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    return import_module("build_site")


@pytest.fixture
def copied(tmp_path: Path, site: Any) -> Any:
    """A tiny repository with every page of the menu, and nothing in them."""
    for _, _, pages in site.NAV:
        for name, _ in pages:
            path = tmp_path / (name if name == "README.md" else f"docs/{name}")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("# A page\n")
    return site.Site(tmp_path, tmp_path / "out")


def test_the_schemas_are_those_of_the_records(monkeypatch: pytest.MonkeyPatch) -> None:
    """`python docs/site/json_schemas.py` writes them; `json_documents.py` holds documents to it."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    schemas = import_module("json_schemas")
    folder = ROOT / "docs" / "schemas"
    texts = schemas.texts()
    assert {n: (folder / n).read_text(encoding="utf-8") for n in texts} == texts
    assert set(MADE) == set(schemas.DOCUMENTS)
    page = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    assert {p.name for p in folder.iterdir()} == set(re.findall(r"schemas/(\w+\.json)", page))
    named = {m for p in folder.iterdir() for m in re.findall(r'"\$ref": "(.*?)"', p.read_text())}
    assert named <= {p.name for p in folder.iterdir()}


def test_the_card_of_the_language_is_what_the_tables_of_the_language_say(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`python docs/site/language_card.py` writes it; every word of the first circle is on it."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    card = import_module("language_card")
    page = (ROOT / "docs" / "language-card.md").read_text(encoding="utf-8")
    assert card.page() == page
    items = {w for m in re.findall(r"`([^`\n]+)`", page) for w in re.findall(r"\w+", m)}
    assert card.first_circle() - items == set()


def test_figures_of_the_page_on_tool_qualification_are_those_of_the_benchmarks() -> None:
    """The last column of its table, and what else it quotes, are lines of docs/benchmarks/."""
    docs = ROOT / "docs"
    outputs = (docs / "benchmarks").glob("*.txt")
    benchmarks = "\n".join(path.read_text(encoding="utf-8") for path in outputs)
    page = (docs / "tool-qualification.md").read_text(encoding="utf-8")
    tried, others = page.split("## What was tried")[1].split("## What was not tried")
    rows = [re.split(r"(?<!\\)\|", line) for line in tried.splitlines() if line.startswith("| ")]
    quotes = [re.findall(r"`([^`]+)`", row[3]) for row in rows[1:]]
    assert len(quotes) > 15
    assert all(quotes)
    said = [q for row in quotes for q in row]
    said += [q for q in re.findall(r"`([^`\n]+)`", others.split("## ")[0]) if " " in q]
    assert [q for q in said if q.replace("\\|", "|") not in benchmarks] == []


def test_the_site_builds_and_every_link_of_what_it_wrote_leads_somewhere(tmp_path: Path) -> None:
    pytest.importorskip("markdown_it", reason="the extra `docs` is not installed")
    line = [sys.executable, str(ROOT / "docs/site/build_site.py"), "-o", str(tmp_path)]
    done = processes.run([*line, "--no-playground"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    written = sorted(tmp_path.rglob("*.html"))
    names = {p.name for p in written}
    assert {"language.html", "start.html", "codes.html", "index.html", "proof.html"} <= names
    broken = []
    for page in written:
        for link in re.findall(r'(?:href|src)="([^"]+)"', page.read_text(encoding="utf-8")):
            path, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:", link):
                continue
            target = (page.parent / path) if path else page
            text = target.read_text(encoding="utf-8") if target.suffix == ".html" else ""
            if not target.exists() or (anchor and f'id="{anchor}"' not in text):
                broken.append(f"{page.name}: {link}")
    assert broken == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[x](none.md)", "python.md: `none.md` leads nowhere"),
        ("[x](../../outside)", "python.md: `../../outside` leads nowhere"),
        ("[x](proof.md#none)", "python.md: `proof.md#none`: there is no such heading"),
        ("[x](#none)", "python.md: `#none`: there is no such heading"),
        ("![x](img/none.svg)", "python.md: `img/none.svg` leads nowhere"),
        ("[x](proof.md#a-page) [y](#a-page)", ""),
    ],
)
def test_a_link_that_leads_nowhere_is_named(copied: Any, text: str, problem: str) -> None:
    (copied.root / "docs" / "python.md").write_text(f"# A page\n\n{text}\n")
    copied._collect()
    for page in copied.pages.values():
        copied._render(page)
    for page in copied.pages.values():
        copied._check_anchors(page)
    assert copied.problems == ([problem] if problem else [])


def test_a_page_that_is_not_in_the_menu_is_named(copied: Any) -> None:
    (copied.root / "docs" / "forgotten.md").write_text("# Forgotten\n")
    copied.build()
    assert copied.problems == ["site_menu.py: forgotten.md is not in the menu"]
    assert not copied.output.exists()


def commands_of(text: str) -> list[str]:
    """Command lines of `soter` in blocks for a terminal, remarks behind them left out."""
    lines: list[str] = []
    inside: str | None = None
    for line in re.sub(r"\s*\\\n\s*", " ", text).splitlines():
        if line.startswith("```"):
            inside = None if inside is not None else line[3:]
        elif (
            inside in TERMINALS
            and re.match(r"(\$ )?soter [a-z]+(\s|$)", line)
            and "..." not in line
        ):
            lines.append(line.removeprefix("$ "))
    return [re.split(r"\s{2,}|\s#|[|>;&]", line)[0].strip() for line in lines]


@all_rows("path", PAGES, ids=lambda p: p.name)
def test_every_command_line_of_a_page_is_one(path: Path) -> None:
    wrong = []
    for line in commands_of(path.read_text(encoding="utf-8")):
        _, name, *rest = shlex.split(line)
        if name not in COMMANDS:
            wrong.append(f"{line}: no command")
            continue
        try:
            with suppress(HelpWantedError):
                command_parser(name).parse_args(rest)
        except Exception as error:  # noqa: BLE001 - whatever is wrong with it
            wrong.append(f"{line}: {error}")
    assert wrong == []


def test_command_lines_are_found() -> None:
    page = "```sh\nsoter run a.soter   # runs\n$ soter check b.soter | jq\n```\n"
    page += "```soter\nsoter fmt\n```\nsoter explain\n```\nsoter run \\\n b.soter\n```\n"
    assert commands_of(page) == ["soter run a.soter", "soter check b.soter", "soter run b.soter"]
    total = sum(len(commands_of(p.read_text(encoding="utf-8"))) for p in PAGES)
    assert total >= 50


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site without a playground, once for those that read it."""
    pytest.importorskip("markdown_it", reason="the extra `docs` is not installed")
    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(ROOT / "docs" / "site"))
        whole = import_module("build_site").Site(ROOT, folder)
        whole.build()
    assert whole.problems == []
    return folder


needs_browser = pytest.mark.skipif(browser.chromium() is None, reason="no chromium here")


def looked_for(page: browser.Page, words: str) -> list[str]:
    """Where the search leads, the best first."""
    page.value(f"document.getElementById('find').value = {words!r}")
    page.value("document.getElementById('find').dispatchEvent(new Event('input'))")
    page.wait("typeof PAGES !== 'undefined'")
    addresses: list[str] = page.value("[...document.querySelectorAll('#found a')].map(a => a.href)")
    return [address.rpartition("/")[2] for address in addresses]


@needs_browser
def test_the_search_finds_headings_and_what_stands_below_them(made: Path) -> None:
    hearsay = "accepted by nobody but a farrier"
    search = made / "search.js"
    begin, rest = search.read_text(encoding="utf-8").split("[", 1)
    search.write_text(f'{begin}[["A", "a.html#b", "C", "It was {hearsay}."], {rest}')
    with browser.page() as page:
        page.open((made / "index.html").as_uri())
        page.wait("document.readyState === 'complete'")
        assert page.value("typeof PAGES") == "undefined"
        assert looked_for(page, "rta modules")[0] == "language.html#7-rta-modules"
        assert looked_for(page, "FARRIER nobody") == ["a.html#b"]
        assert hearsay in page.value("document.getElementById('found').textContent")
        assert looked_for(page, "V002")[0] == "codes.html#V002"
        assert looked_for(page, "(* qqqq") == []
        assert {r.split(":")[0] for r in page.requests} == {"file"}
        assert page.errors == []


def test_the_front_page_has_three_doors_the_contents_and_what_soter_is_not(
    made: Path, site: Any
) -> None:
    front = (made / "index.html").read_text(encoding="utf-8")
    main = front.split("<main>")[1].split("</main>")[0]
    for door in ("robotics-engineers", "learning-researchers", "safety-engineers"):
        assert f'href="for-{door}.html"' in main
    assert 'id="find"' in front
    assert all(f">{menu}</a>" in unescape(front) for _, _, pages in site.NAV for _, menu in pages)
    assert site.NOT_MADE in main
    assert site.PLACE not in main
    for word in ("planner", "certified", "real-time"):
        assert word in main.split('id="what-soter-is-not"')[1]


@needs_browser
def test_no_page_of_the_site_is_wider_than_a_phone(made: Path) -> None:
    wider = []
    with browser.page() as page:
        page.size(420, 900)
        for path in sorted(made.glob("*.html")):
            page.open(path.as_uri())
            page.wait("document.readyState === 'complete'")
            if page.value("document.documentElement.scrollWidth > innerWidth"):
                wider.append(path.name)
            if path.name == "benchmarks.html":
                stacked = "[...document.querySelectorAll('.stacks')]"
                assert page.value(f"{stacked}.length > 0")
                assert not page.value(f"{stacked}.some((e) => e.scrollWidth > e.clientWidth)")
    assert wider == []


@needs_browser
@pytest.mark.parametrize("width", [420, 1300])
def test_nothing_hinders_reading_what_people_open_first(made: Path, width: int) -> None:
    told = {}
    with browser.page() as page:
        for path in [made / "index.html", *sorted(made.glob("for-*.html"))]:
            page.size(width, 900)
            page.open(path.as_uri())
            page.wait("document.readyState === 'complete'")
            told[path.name] = legibility.hindrances(page)
    assert told == {name: [] for name in told}
    assert len(told) == 4


def test_the_picture_of_the_front_is_what_the_runs_give(monkeypatch: pytest.MonkeyPatch) -> None:
    """`python docs/site/front_picture.py` draws it."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    front_picture = import_module("front_picture")
    assert front_picture.PICTURE.read_text(encoding="utf-8") == front_picture.drawn()


@needs_browser
@pytest.mark.parametrize("width", [420, 1300])
def test_a_picture_code_and_how_to_install_stand_on_the_first_screen(
    made: Path, width: int
) -> None:
    shown = "['main img', 'main pre:not(.sh)', 'main pre.sh'].map((s) => document.querySelector(s)"
    with browser.page() as page:
        for name in ("index.html", "start.html"):
            page.size(width, 900)
            page.open((made / name).as_uri())
            page.wait("document.readyState === 'complete'")
            ends = page.value(f"{shown}.getBoundingClientRect().bottom)")
            assert 0 < min(ends) < max(ends) < 900
            assert not page.value(f"{shown}).some((e) => e.scrollWidth > e.clientWidth)")
