"""Collects the mistakes of a mapping, so that all of them are told at once.

Purpose: `MappingProblems` asks small questions of tables that people wrote; it notes what is wrong,
and gives back a value with which reading can go on.
Non-goals: what the answers mean (`read_mapping.py`, `topic_mapping_parser.py`).
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
"""Larger scales and offsets are taken for slips."""


def wrong_mapping(problems: Iterable[str], file: Path | None = None) -> SoterError:
    """Gives SoterError D015, with a diagnostic for each mistake, which names the file."""
    notes = () if file is None else (f"in the mapping `{file}`",)
    return SoterError(tuple(Diagnostic("D015", p, notes=notes) for p in problems))


def unknown_name(kind: str, name: str, known: Iterable[str]) -> str:
    """Gives a sentence about a name that is not known, with a name close to it."""
    hint = nearest_or_all(name, known)
    return f"{kind} `{name}`: {hint}" if hint else f"{kind} `{name}`"


def is_number(value: object) -> bool:
    """Whether `value` is a finite number of at most 1e30: larger ones are slips."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    return -NUMBER_MAX <= value <= NUMBER_MAX  # NaN, too, is none


class MappingProblems:
    """Notes what is wrong so far, in `told`."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def add(self, text: str) -> None:
        """Notes a mistake."""
        self.told.append(text)

    def table(self, row: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
        """Gives the table under a key; an empty one if there is none, or after a note."""
        table = row.get(key, {})
        if not isinstance(table, dict):
            self.add(f"`{key}` of {where} is no table")
            return {}
        return table

    def texts(self, row: Mapping[str, Any], key: str, where: str) -> dict[str, str]:
        """Gives the table under a key with each value as text."""
        return {k: str(v) for k, v in self.table(row, key, where).items()}

    def name(self, row: Mapping[str, Any], key: str, where: str) -> str | None:
        """Gives the text under a key; None without one, or after a note."""
        text = row.get(key)
        if text is not None and not isinstance(text, str):
            self.add(f"`{key}` of {where} is no name: {text!r}")
            return None
        return text

    def note_unknown_keys(self, row: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
        """Notes every key that is not a known one."""
        for key in row:
            if key not in known:
                self.add(f"{where} says `{key}`: there are {', '.join(known)}")

    def duration(self, row: Mapping[str, Any], key: str, name: str) -> int:
        """Gives the time under a key in ns, above 0; notes a number without a unit."""
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
