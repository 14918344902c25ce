"""Tables of words and phrases that lie beside the code, each read when it is first asked for.

Purpose: one reader of what Soter says of mistakes; a right program asks for none of it.
Non-goals: what a phrase is (`foreign_phrases.py`).
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).parent


def toml_of(text: str) -> dict[str, Any]:
    """What a text in TOML says. Python 3.10 has no reader of its own."""
    toml = import_module("tomllib" if find_spec("tomllib") else "tomli")
    read: dict[str, Any] = toml.loads(text)
    return read


@cache
def word_table(name: str) -> dict[str, Any]:
    """The table of this name, in the order of its file."""
    return toml_of((_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def meaning(sort: str, word: str, body: str = "") -> str | None:
    """What a table of `words.toml` has for a word, in this body if it is about bodies."""
    return _meanings(sort, body).get(word)


@cache
def _meanings(sort: str, body: str) -> dict[str, str]:
    table = word_table("words")[sort]
    tables = [rows for bodies, rows in table.items() if body in bodies.split()] if body else [table]
    pairs = [
        (said, words) if isinstance(words, str) else words
        for rows in tables
        for said, words in rows.items()
    ]
    return {word: said for said, words in pairs for word in words.split()}
