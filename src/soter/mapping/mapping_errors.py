"""The mistakes of a mapping, collected, so that all of them are told at once.

Purpose: small questions to tables that people wrote; what is wrong is noted and a value given back
that reading can go on with.
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
"""Scales and offsets beyond are none."""


def wrong_mapping(problems: Iterable[str], file: Path | None = None) -> SoterError:
    """D015, one diagnostic a mistake, each with the file that it is in."""
    notes = () if file is None else (f"in the mapping `{file}`",)
    return SoterError(tuple(Diagnostic("D015", p, notes=notes) for p in problems))


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """A sentence about a name that is not among the known ones."""
    hint = nearest_or_all(name, known)
    return f"{what} `{name}`: {hint}" if hint else f"{what} `{name}`"


def is_number(given: object) -> bool:
    """Whether it is a finite number, and none that nobody means."""
    if not isinstance(given, (int, float)) or isinstance(given, bool):
        return False
    return -NUMBER_MAX <= given <= NUMBER_MAX  # NaN, too, is none


class MappingProblems:
    """What is wrong so far, in `told`."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def add(self, text: str) -> None:
        """Note a mistake."""
        self.told.append(text)

    def table(self, given: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
        """The table under a key; empty where there is none."""
        table = given.get(key, {})
        if not isinstance(table, dict):
            self.add(f"`{key}` of {where} is no table")
            return {}
        return table

    def texts(self, given: Mapping[str, Any], key: str, where: str) -> dict[str, str]:
        """The same, of texts: a number is what it is written as."""
        return {k: str(v) for k, v in self.table(given, key, where).items()}

    def name(self, given: Mapping[str, Any], key: str, where: str) -> str | None:
        """The text under a key; None where there is none."""
        text = given.get(key)
        if text is not None and not isinstance(text, str):
            self.add(f"`{key}` of {where} is no name: {text!r}")
            return None
        return text

    def only(self, given: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
        """Note what is said and means nothing."""
        for key in given:
            if key not in known:
                self.add(f"{where} says `{key}`: there are {', '.join(known)}")

    def duration(self, given: Mapping[str, Any], key: str, name: str) -> int:
        """A length of time in ns, above 0."""
        if key not in given:
            self.add(f'`{name}` needs a `{key}`, such as "0.5s"')
            return 1
        try:
            duration = duration_ns(given[key])
        except WrongTextError as error:
            self.add(f"`{key}` of `{name}`: {error}")
            return 1
        if duration <= 0:
            self.add(f"`{key}` of `{name}` is no time above 0")
        return duration
