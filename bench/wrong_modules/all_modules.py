"""All wrong modules: rows of text, and those of `timing.py`.

Purpose: `WRONG`. Beside what bench/rows.py says of the texts: `on` is the right module, `why` what
is wrong; `?` is one of `Wrong.named` ("-": none), `$` the command that shows it ("-": nothing
does), `~` an edit before that, `codes` and `options` are those of `Wrong`; a section is a kind.
Non-goals: running anything (`verdicts.py`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bench.rows import Edit, Groups, edits_of, rows
from bench.wrong_modules.base import BASES, Shown, Wrong
from bench.wrong_modules.timing import TIMING

if TYPE_CHECKING:
    from bench.rows import Row

HERE = Path(__file__).parent
FILES = ("groups.txt", "controllers.txt", "paths.txt", "systems.txt")
WORDS = ("on", "why", "?", "$", "~", "codes", "options")
GROUPS: Groups = {}


def wrong_of(row: Row) -> Wrong:
    """The module of a row: of `line`, and a run violates, where it says nothing else."""

    def edits(word: str) -> tuple[Edit, ...]:
        return tuple(edit for line in row.said.get(word, ()) for edit in edits_of(line, GROUPS))

    (base,) = (b for b in BASES if b.name == (row.one("on") or "line"))
    command = row.one("$") or "run"
    return Wrong(
        row.section,
        row.name,
        base,
        edits(""),
        row.one("why"),
        None if command == "-" else Shown(tuple(command.split()), edits("~")),
        tuple(regex for regex in row.said.get("?", ()) if regex != "-"),
        tuple(row.one("codes").split()),
        tuple(row.one("options").split()),
    )


OF_TEXTS = [wrong_of(row) for name in FILES for row in rows(HERE / name, WORDS, GROUPS)]
WRONG = (*TIMING, *OF_TEXTS)
