"""The glossary against the reference pages: it has the words that they lean on, page and all."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = (
    "language",
    "evidence",
    "semantics",
    "proof",
    "verification",
    "testing",
    "timing",
    "deploy",
    "monitor",
)
MANY = 4
"""Pages that lean on a word of the language, from which on it is no word of one page alone."""
ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \| \[\w+\]\(([\w-]+\.md)\) \|$")


def rows() -> list[tuple[str, ...]]:
    lines = (DOCS / "glossary.md").read_text(encoding="utf-8").splitlines()
    table = [line for line in lines if line.startswith("| ") and not line.startswith("| Soter |")]
    matches = [ROW.match(line) for line in table]
    assert all(matches), [line for line, m in zip(table, matches, strict=True) if not m]
    return [m.groups() for m in matches if m]


def prose(page: str) -> str:
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.sub(r"```.*?```", "", text, flags=re.DOTALL)


def test_every_word_of_the_language_that_many_pages_lean_on_is_explained() -> None:
    explained = {w for term, *_ in rows() for w in re.findall(r"`(\w+)`", term)}
    pages = [set(re.findall(r"`(\w+)`", prose(f"{page}.md"))) for page in PAGES]
    grammar = (DOCS / "grammar.ebnf").read_text(encoding="utf-8")
    words = {*re.findall(r"'([a-z_]+)'", grammar)}
    leaned = {w for w in words if sum(w in page for page in pages) >= MANY}
    assert leaned <= explained, leaned - explained


def test_the_page_that_an_entry_names_speaks_of_it() -> None:
    for term, _, _, page in rows():
        for word in term.replace("`", "").split(", "):
            assert re.search(rf"\b{re.escape(word)}(?!\w)", prose(page), re.IGNORECASE), (
                word,
                page,
            )


def test_a_word_has_one_entry() -> None:
    terms = [term for term, *_ in rows()]
    assert len(terms) == len({*terms}) >= 40
