"""Figures of the pages are made again by a command, and a figure without one is refused.

The comparison is tried on outputs in which one figure is another one; the tables, blocks and
sentences of docs/ have to be in bench/made_again_sections.py.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench import made_again  # noqa: E402 - needs the path
from bench.made_again_compare import compared, numbers_in, sampled, stood  # noqa: E402
from bench.made_again_sections import EXCEPT, PAGES, SMALL, Small  # noqa: E402
from bench.run_all import BENCHMARKS  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCS = ROOT / "docs"
NOT_ASKED = {"benchmarks.md", "decisions.md"}
"""The first is asked section by section; the second is a diary."""
NUMBERS_OF_A_BLOCK = 4
"""A block without a language that has fewer numbers is a drawing or a formula."""
SCRIPT = re.compile(r"bench/[\w/]+\.py")
DAGGER = "†"


def tables(text: str) -> Iterator[str]:
    """The first row with words of every table that has a figure outside of code."""
    rows: list[str] = []
    for line in [*re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S).splitlines(), ""]:
        if line.startswith("|"):
            rows.append(line)
            continue
        if any(numbers_in(row) for row in rows[2:]):
            yield rows[0] if re.search(r"\w", rows[0]) else rows[2]
        rows = []


def blocks(text: str) -> Iterator[str]:
    """Every block without a language that has many numbers."""
    for found in made_again.BLOCK.finditer(text):
        if not found[1] and len(numbers_in(found[2])) >= NUMBERS_OF_A_BLOCK:
            yield "```" + found[2].lstrip("\n").split("\n")[0]


def sentences(text: str) -> Iterator[str]:
    """Every paragraph that has figures and a mark of them, or names a benchmark."""
    text = re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)
    text = re.sub(r"^(\||#|    ).*$", "", text, flags=re.M)
    for paragraph in re.split(r"\n\s*\n|\n(?=- |\d+\. )", text):
        if (SCRIPT.search(paragraph) or DAGGER in paragraph) and numbers_in(paragraph):
            yield paragraph


def without_a_maker(page: str, text: str) -> Iterator[str]:
    """What of a page no section makes and no exception names.

    A paragraph that names a benchmark is known where a section of its page is of that benchmark.
    """
    made = [m.where for m in PAGES if m.page == page]
    scripts = " ".join(s.command for s in made_again.sections(small=False) if s.page == page)
    excepted = [where for name, where in EXCEPT if name == page]
    for start in (*tables(text), *blocks(text)):
        if not any(start.startswith(x) for x in (*made, *excepted)) and "*" not in made:
            yield start
    for paragraph in sentences(text):
        known = any(re.search(w, paragraph) for w in made if w[0] not in "|`*")
        known |= any(x in scripts for x in SCRIPT.findall(paragraph))
        if not known and not any(x in paragraph for x in excepted) and "*" not in made:
            yield paragraph.strip()


PAGES_ASKED = sorted(p.name for p in DOCS.glob("*.md") if p.name not in NOT_ASKED)


@pytest.mark.whole
@pytest.mark.parametrize("page", PAGES_ASKED)
def test_a_figure_of_a_page_has_a_command_that_makes_it_or_a_reason(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    assert list(without_a_maker(page, text)) == []


def test_a_figure_without_a_maker_is_seen() -> None:
    """One that is added to a page: a table, a block, a sentence, and one with a mark of a test."""
    page = "fleet.md"
    text = (DOCS / page).read_text(encoding="utf-8")
    added = (
        "| robots | collisions |\n|---|---|\n| 4 | 0 |\n",
        "```\n$ soter run x.soter\n4 robots, 0 collisions, 12.5 s, 3\n```\n",
        "`bench/fleet/other.py` counted 14 collisions.\n",
        "The gap is 29 mm †.\n",
    )
    for more in added:
        assert len(list(without_a_maker(page, f"{text}\n{more}"))) == 1, more
    assert not list(without_a_maker(page, f"{text}\n| word | meaning |\n|---|---|\n| a | `3` |\n"))


def test_every_section_and_exception_is_of_something_that_there_is() -> None:
    assert set(SMALL) == {b.name for b in BENCHMARKS}
    for m in PAGES:
        page = (DOCS / m.page).read_text(encoding="utf-8")
        assert list(made_again.said(m, page)), (m.page, m.where)
        assert m.command[1:] in SMALL or not m.command.startswith("@"), m.command
    for (name, where), why in EXCEPT.items():
        page = (DOCS / name).read_text(encoding="utf-8")
        start = where.removeprefix("```")
        assert start in page, (name, where)
        for path in re.findall(r"tests/[\w/.]+\w", why):
            assert (ROOT / path).exists(), why
    scripts = [x.split()[0] for x in commands() if x.split()[0].endswith(".py")]
    assert [x for x in scripts if not (ROOT / x).exists()] == []


def commands() -> Iterator[str]:
    for small in (False, True):
        yield from (s.command for s in made_again.sections(small=small))
