"""The words of the language: each stands in an example, and in one of the two circles.

The words are those of `docs/grammar.ebnf`, which says where the second circle begins; which of them
a program uses as words, and not as names, the parser says.
"""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING

import pytest

from generators.file_listing import files_below
from soter.diagnostics.diagnostic import Diagnostics, Source, Span
from soter.language.syntax.lexer import NAME
from soter.language.syntax.parsing.parser import parse_tokens
from unit.language.syntax.test_syntax_grammar import GRAMMAR, rules, texts_of

if TYPE_CHECKING:
    from collections.abc import Iterator

EXAMPLES = GRAMMAR.parents[1] / "examples"
CONTROLLER_LANGUAGE = (GRAMMAR.parent / "language.md").read_text(encoding="utf-8")
EVIDENCE = (GRAMMAR.parent / "evidence.md").read_text(encoding="utf-8")
WORDS_TO_LEARN = 80
HALF_AN_HOUR = 6_000
"""Words of a page that are read in it, at 200 a minute."""


def words_of_the_language() -> set[str]:
    return {t for rule in rules().values() for t in texts_of(rule) if t[0].isalpha()}


def circles() -> tuple[set[str], set[str]]:
    """The words of the rules before the second circle, and those that only rules of it have."""
    before, _ = GRAMMAR.read_text(encoding="utf-8").split("(* The second circle")
    first = {
        word
        for name, rule in rules().items()
        if re.search(rf"^{name} +=", before, re.MULTILINE)
        for word in texts_of(rule)
        if word[0].isalpha()
    }
    return first, words_of_the_language() - first


def words_shown(page: str) -> set[str]:
    """What the programs of a page use, and the single lines of it that could stand in one."""
    blocks = re.findall(r"^```soter[^\n]*\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    lines = re.findall(r"`((?:import|extern) [^`\n]*[^`.];)`", page)
    return set().union(*map(words_used, [*blocks, *(f"soter 1; {line}" for line in lines)]))


def places(node: object) -> Iterator[tuple[int, int]]:
    """Where the nodes of a tree stand: what stands there alone is a name, or a value."""
    if isinstance(node, tuple):
        for part in node:
            yield from places(part)
    elif dataclasses.is_dataclass(node) and not isinstance(node, (type, Span)):
        span = getattr(node, "span", None)
        if span is not None:
            yield span.start, span.end
        for f in dataclasses.fields(node):
            yield from places(getattr(node, f.name))


def words_used(text: str) -> set[str]:
    """Of a program: its reserved words, and all others that the tree has no name for."""
    file, parser = parse_tokens(Source("program.soter", text), Diagnostics())
    assert parser.problems == []
    named = set(places(file))
    tokens = parser.tokens
    used = {
        text
        for kind, text, start, end in zip(
            tokens.kinds, tokens.texts, tokens.starts, tokens.ends, strict=True
        )
        if kind != NAME or (start, end) not in named
    }
    called = re.findall(r"\balways\s+(invariants?)\s*[(;]", text)  # names to the parser
    return words_of_the_language() & {*used, *called}


def test_words_are_told_from_names() -> None:
    text = "soter 1;\ntopic to: float;\nnode late period 1s {\n  step { let at = 2.0; }\n}\n"
    assert words_used(text) == {"soter", "topic", "float", "node", "period", "step", "let"}
    asked = "soter 1; test late { system s; always invariant(at); horizon 1s; }"
    assert words_used(asked) == {"soter", "test", "system", "always", "invariant", "horizon"}


def test_every_word_of_the_language_stands_in_an_example() -> None:
    used: set[str] = set()
    for path in files_below(EXAMPLES, "*.soter"):
        used |= words_used(path.read_text(encoding="utf-8"))
    assert words_of_the_language() - used == set()


def test_the_controller_language_is_learned_in_half_an_hour() -> None:
    first, _ = circles()
    assert 50 < len(first) <= WORDS_TO_LEARN
    assert len(CONTROLLER_LANGUAGE.split()) <= HALF_AN_HOUR


def test_its_page_shows_its_words_and_none_of_the_evidence_clauses() -> None:
    first, _ = circles()
    assert words_shown(CONTROLLER_LANGUAGE) == first


def test_the_page_of_the_evidence_clauses_speaks_of_all_others_and_shows_them() -> None:
    _, second = circles()
    prose = re.sub(r"```.*?```", "", EVIDENCE, flags=re.DOTALL)
    spoken = [c for c in re.findall(r"`([^`]+)`", prose) if not c.startswith("soter ")]
    assert second - set(re.findall(r"[a-z_]\w*", " ".join(spoken))) == set()
    shown = words_shown(EVIDENCE)
    for link in re.findall(r"\]\(([^)]+\.soter)\)", EVIDENCE):
        shown |= words_used((GRAMMAR.parent / link).read_text(encoding="utf-8"))
    assert second - shown == set()


@pytest.mark.parametrize("page", ["first-hour", "prove-your-module", "find-the-bug"])
def test_a_tutorial_says_which_circle_it_needs_and_begins_with_the_first(page: str) -> None:
    text = (GRAMMAR.parent / f"{page}.md").read_text(encoding="utf-8")
    top = text.split("\n## ")[0]
    pages = [top.find(f"[{p}](") for p in ("controller language", "evidence clauses")]
    assert 0 < pages[0] < pages[1]
    programs = re.findall(r"^```soter[^\n]*\n(soter 1;.*?)^```", text, re.MULTILINE | re.DOTALL)
    for program in programs[:1]:
        assert words_used(program) <= circles()[0]
