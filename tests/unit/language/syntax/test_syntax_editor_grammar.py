"""The editor grammar is well-formed and knows the words of the language."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from soter.language.syntax.lexer import RESERVED

ROOT = Path(__file__).parents[4]
GRAMMAR = json.loads((ROOT / "editors" / "soter.tmLanguage.json").read_text(encoding="utf-8"))


def patterns(node: Any) -> list[dict[str, Any]]:
    """Every pattern of the grammar, however deep."""
    nodes: list[dict[str, Any]] = []
    if isinstance(node, dict):
        if {"match", "begin", "include"} & node.keys():
            nodes.append(node)
        for value in node.values():
            nodes += patterns(value)
    elif isinstance(node, list):
        for value in node:
            nodes += patterns(value)
    return nodes


def test_every_expression_compiles_and_every_include_exists() -> None:
    for pattern in patterns(GRAMMAR):
        for key in ("match", "begin", "end"):
            if key in pattern:
                re.compile(pattern[key])
        if "include" in pattern:
            assert pattern["include"].removeprefix("#") in GRAMMAR["repository"]


def coloured_words() -> set[str]:
    """Every word that stands in an expression of the grammar."""
    expressions = " ".join(p["match"] for p in patterns(GRAMMAR) if "match" in p)
    return set(re.findall(r"[a-z_]+", re.sub(r"\\.", " ", expressions)))


def test_every_reserved_word_is_coloured() -> None:
    assert RESERVED - coloured_words() - {"soter"} == set()


def test_every_contextual_word_of_the_printed_grammar_is_coloured() -> None:
    text = (ROOT / "docs" / "grammar.ebnf").read_text(encoding="utf-8")
    text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)
    plain = {"rk4", "euler", "fault", "by", "per"}  # too much like a name to colour
    quoted = set(re.findall(r"'([a-z_0-9]+)'", text))
    assert quoted - RESERVED - plain - coloured_words() == set()
