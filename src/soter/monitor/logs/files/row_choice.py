"""Which rows of a log a mapping chooses by what stands in them.

Purpose: whether a cell is what a `where` says, however its file writes it; what stood there where
none was.
Non-goals: a choice by time (`LogMap.counts`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from soter.monitor.logs.files.log_columns import decimal_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

TRUTHS = {"true": True, "false": False}
CODE = re.compile(r"[+-]?0[0-9]")
"""What begins so is no number but a name that has figures."""
SHOWN = 5


class RowChoice:
    """The rows in which each of these columns has this text; `where`: by column."""

    def __init__(self, where: Mapping[str, str]) -> None:
        self.where = where
        self._seen: dict[str, dict[str, int]] = {name: {} for name in where}

    def takes(self, cell_of: Callable[[str], Any]) -> bool:
        """Whether a row is chosen; `cell_of`: what it has, by column."""
        for name, wanted in self.where.items():
            cell = cell_of(name)
            if not _is(cell, wanted):
                seen = self._seen[name]
                shown = _shown(cell)
                if shown in seen or len(seen) <= SHOWN:
                    seen[shown] = seen.get(shown, 0) + 1
                return False
        return True

    def __str__(self) -> str:
        return " and ".join(f"{k} = {v}" for k, v in self.where.items())

    @property
    def helps(self) -> list[str]:
        """Of columns that left rows out, what stood there instead."""
        told = []
        for name, seen in self._seen.items():
            values = [f"{value} ({n:,} times)" for value, n in [*seen.items()][:SHOWN]]
            more = ["others"] if len(seen) > SHOWN else []
            if seen:
                told.append(
                    f"`{name}` is not `{self.where[name][:40]}` but {', '.join(values + more)}: "
                    "say it in `where` as it stands there"
                )
        return told


def _is(cell: object, wanted: str) -> bool:
    """The same text, truth (`true`, `True`) or number (`1`, `1.0`)."""
    text, wanted = "" if cell is None else str(cell).strip(), wanted.strip()
    if text == wanted:
        return True
    if text.lower() in TRUTHS:
        return text.lower() == wanted.lower()
    if CODE.match(text) or CODE.match(wanted):
        return False
    number = decimal_of(text)
    return number is not None and number == decimal_of(wanted)


def _shown(cell: object) -> str:
    if cell is None or cell == "":
        return "empty"
    kind = "a text" if isinstance(cell, str) else "a number"
    kind = "a truth" if isinstance(cell, bool) else kind
    text = str(cell).lower() if isinstance(cell, bool) else str(cell).strip()
    return f"`{text[:40]}`, {kind if isinstance(cell, (str, bool, int, float)) else 'no text'}"
