"""Tables of words and phrases that lie beside the code, each read when it is first asked for.

Purpose: one reader of what Soter says of mistakes; a right program asks for none of it.
Non-goals: what a table means (`foreign_phrases.py`, `foreign_words.py`, `clause_words.py`).
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).parent


@cache
def word_table(name: str) -> dict[str, Any]:
    """The table of this name, in the order of its file."""
    toml = import_module("tomllib" if find_spec("tomllib") else "tomli")
    table: dict[str, Any] = toml.loads((_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    return table
