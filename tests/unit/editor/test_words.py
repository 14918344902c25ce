"""The words that the editor knows are those of the grammar."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from soter.editor import language_words

GRAMMAR = (Path(__file__).resolve().parents[3] / "docs" / "grammar.ebnf").read_text(
    encoding="utf-8"
)
RULES = dict(re.findall(r"^(\w+) +=(.*?) ;$", GRAMMAR, re.MULTILINE | re.DOTALL))
QUOTED = re.compile(r"'([a-z_0-9]+)'")
ITEMS = {
    "node": ("nodeitem", "nodeclause"),
    "rta": ("rtaitem", "rtaclause"),
    "verify": ("verifyitem", "viewitem"),
    "view": ("viewitem",),
    "plant": ("plantitem",),
    "faults": ("fault",),
    "block": ("statement",),
}


def test_every_word_of_the_grammar_has_a_meaning_and_no_other() -> None:
    grammar = {w for rule in RULES.values() for w in QUOTED.findall(rule)}
    assert grammar - set(language_words.WORDS) == set()
    by_note = {"while", "drop_oldest", "drop_newest", "fault", "contract", "substeps"}
    assert set(language_words.WORDS) - grammar - by_note == set()


def alternatives(rule: str) -> list[str]:
    """The parts between the `|` that stand in no bracket and no quotes."""
    parts, depth = [""], 0
    for sign in re.findall(r"'[^']*'|.", rule.replace("\n", " ")):
        depth += (sign in "([{") - (sign in ")]}") if len(sign) == 1 else 0
        if sign == "|" and depth == 0:
            parts.append("")
        else:
            parts[-1] += sign
    return parts


@pytest.mark.parametrize("place", ITEMS)
def test_what_can_begin_an_item_is_offered_there(place: str) -> None:
    choices = [a for rule in ITEMS[place] for a in alternatives(RULES[rule])]
    first = set()
    for alternative in choices:
        start = re.match(r" *\(?((?: *\|? *'[a-z_]+')+)", alternative)
        if start is not None:
            group = QUOTED.findall(start[1])
            first |= set(group if "|" in start[1] else group[:1])
    offered = {w.split()[0] for w in language_words.PLACES[place]}
    assert first == offered


def test_declarations_are_offered_at_the_top_of_a_file() -> None:
    offered = {w.split()[0] for w in language_words.PLACES["file"]}
    names = re.findall(r"\b(\w+)\b", RULES["declaration"])
    meant = {n for n in names if not n.startswith("extern")}
    assert offered == meant | {"import", "extern", "input"}


def test_each_meaning_is_a_sentence() -> None:
    for table in (language_words.WORDS, language_words.BUILTINS, language_words.SPECIALS):
        for word, meaning in table.items():
            assert meaning.endswith("."), word
            assert len(meaning) < 200, word
