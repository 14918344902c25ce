"""Rows of text: what is changed in a right text, and what else is known of the change.

Purpose: `rows`, `edits_of`, `edited`. In a file `* NAME` begins a section, in which what stands
before its first row holds for all of them; `= NAME` begins a row. Lines say something by their
first word, which whoever reads them knows; every other line is an edit: `A => B`, `A +> B` and
`A <+ B` (B behind, or before, A), or the name of a group of edits with what stands in place of its
`$` (`$1`: the first word, `$2`: the others). `group NAME: EDIT` adds an edit to a group. A line
that is indented belongs to the one before.
Non-goals: what is changed, and whether anybody notices.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

Edit = tuple[str, str]
Groups = dict[str, list[str]]
Said = dict[str, list[str]]
"""What stands behind each first word; below an empty one the lines of edits."""
FORM = re.compile(r"(.*?) (=>|\+>|<\+) ?(.*)")


@dataclass(frozen=True)
class Row:
    """A row, and what is said in it or before the first one of its section."""

    section: str
    name: str
    said: Said

    def one(self, word: str) -> str:
        """What stands behind a word the last time; "" where nobody says it."""
        return self.said.get(word, [""])[-1]


def rows(path: Path, words: tuple[str, ...], groups: Groups) -> Iterator[Row]:
    """The rows of a file in their order; `groups` are those that are known before, and more."""
    text = re.sub(r"\n +", " ", path.read_text(encoding="utf-8"))
    for section in re.split(r"^\* ", text, flags=re.MULTILINE)[1:]:
        head, *parts = re.split(r"^= ", section, flags=re.MULTILINE)
        title, *lines = head.splitlines()
        usual = said_in(lines, words, groups)
        for part in parts:
            name, *lines = part.splitlines()
            yield Row(title, name, {**usual, **said_in(lines, words, groups)})


def said_in(lines: list[str], words: tuple[str, ...], groups: Groups) -> Said:
    """What lines say by their first words."""
    said: Said = {}
    for line in filter(None, lines):
        word, _, rest = line.partition(" ")
        if word == "group":
            group, _, edit = rest.partition(": ")
            groups.setdefault(group, []).append(edit)
        elif word in words:
            said.setdefault(word, []).append(rest)
        else:
            said.setdefault("", []).append(line)
    return said


def edits_of(line: str, groups: Groups) -> list[Edit]:
    """The edits that a line stands for."""
    made = FORM.fullmatch(line)
    if made is None:
        name, _, given = line.partition(" ")
        first, _, others = given.partition(" ")
        filled = [e.replace("$1", first).replace("$2", others) for e in groups[name]]
        return [edit for e in filled for edit in edits_of(e.replace("$", given), groups)]
    old, how, new = made.groups()
    return [(old, {"=>": new, "+>": f"{old} {new}", "<+": f"{new} {old}"}[how])]


def edited(text: str, edits: tuple[Edit, ...], most: float = 1) -> str:
    """`text` with every edit made, wherever lines end; each must fit, and not more often."""
    for old, new in edits:
        pattern = r"\s+".join(map(re.escape, old.split()))
        text, count = re.subn(pattern, lambda _, new=new: new, text)  # type: ignore[misc]
        assert 1 <= count <= most, (count, old)
    return text
