"""Collects the mistakes in a mapping, so that one error reports all of them.

Purpose: `MappingProblems` takes values out of tables that people wrote. It notes a wrong value, and
gives a valid one in its place, so that reading can go on.
Non-goals: what the values mean (`read_mapping.py`, `topic_mapping_parser.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.model.types import WrongTextError, duration_ns

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

NUMBER_MAX = 1e30
"""Larger scales and offsets are taken for typing mistakes."""


def wrong_mapping_error(problems: Iterable[str], file: Path | None = None) -> SoterError:
    """Gives SoterError D015 with a diagnostic for each mistake; each names the mapping's file."""
    notes = () if file is None else (f"in the mapping `{file}`",)
    return SoterError(tuple(Diagnostic("D015", p, notes=notes) for p in problems))


def unknown_name_message(kind: str, name: str, known: Iterable[str]) -> str:
    """Gives a message about an unknown name, with a similar known name if there is one."""
    hint = nearest_or_all(name, known)
    return f"{kind} `{name}`: {hint}" if hint else f"{kind} `{name}`"


def is_number(value: object) -> bool:
    """Whether `value` is a number with an absolute value of at most 1e30, and no bool."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    return -NUMBER_MAX <= value <= NUMBER_MAX  # NaN, too, is none


class MappingProblems:
    """Collects the mistakes in a mapping as texts, in `mistakes`."""

    def __init__(self) -> None:
        self.mistakes: list[str] = []

    def add(self, text: str) -> None:
        """Notes a mistake."""
        self.mistakes.append(text)

    def table(self, row: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
        """Gives the table under a key; {} if the key is missing, or is no table, which it notes."""
        table = row.get(key, {})
        if not isinstance(table, dict):
            self.add(f"`{key}` of {where} is no table")
            return {}
        return table

    def text_table(self, row: Mapping[str, Any], key: str, where: str) -> dict[str, str]:
        """Gives the table under a key with each value as text."""
        return {k: str(v) for k, v in self.table(row, key, where).items()}

    def text(self, row: Mapping[str, Any], key: str, where: str) -> str | None:
        """Gives the text under a key; None if the key is missing, or no text, which it notes."""
        text = row.get(key)
        if text is not None and not isinstance(text, str):
            self.add(f"`{key}` of {where} is no name: {text!r}")
            return None
        return text

    def note_unknown_keys(self, row: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
        """Notes every key of a table that is not in `known`."""
        for key in row:
            if key not in known:
                self.add(f"{where} says `{key}`: there are {', '.join(known)}")

    def positive_ns(self, row: Mapping[str, Any], key: str, name: str) -> int:
        """Gives the time under a key in ns; notes a missing, unitless or not positive time."""
        if key not in row or is_number(row[key]):
            bare = f"`{key}` of `{name}` is {row.get(key)} of what? It needs a unit"
            self.add(f'{bare if key in row else f"`{name}` needs a `{key}`"}, such as "0.5s"')
            return 1
        try:
            duration = duration_ns(row[key])
        except WrongTextError as error:
            self.add(f"`{key}` of `{name}`: {error}")
            return 1
        if duration <= 0:
            self.add(f"`{key}` of `{name}` is no time above 0")
        return duration
