"""The diagnostics of a check as a person wants to read them.

Purpose: in the order of the text, repetitions in one, nothing that an error may have caused.
Non-goals: rendering.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Label, Severity
from soter.diagnostics.fix import Fix

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.source import Source

HUSHED = {
    "W001", "W004", "W012", "W013", "W014", "W015", "W016", "W017", "W018", "W019", "W021",
    "W022", "W023", "W024", "W025", "W026", "W027", "W028", "W029", "W030", "W031", "W032", "W033",
    "W034", "W035", "W036",
}  # fmt: skip
"""Warnings of what is not there, or hardly meant: beside errors they are left out, as an error may
be what makes it look so."""
MERGED = {"N001", "N004", "N006", "M009", "M010"}
"""A name that is missing is one mistake, in however many places it is missed."""
ONCE = {"M003", "M004", "M005", "M013"}
"""What is wrong in a part is wrong in every system that has the part: said where it is shortest."""
PLACES_MAX = 5


def for_people(diagnostics: Diagnostics, sources: Sequence[Source]) -> Diagnostics:
    """By file in order of loading, then by position; errors before warnings at one place."""
    files = {id(source): i for i, source in enumerate(sources)}

    def place(d: Diagnostic) -> tuple[int, int, bool]:
        if d.primary is None:
            return (len(sources) if d.code == "S021" else -1), -1, False
        span = d.primary.span
        return files.get(id(span.source), -1), span.start, d.severity is not Severity.ERROR

    ordered = Diagnostics()
    for d in _merged(_once(sorted(diagnostics.items, key=place))):
        if d.severity is Severity.ERROR or not diagnostics.has_errors or d.code not in HUSHED:
            ordered.add(d)
    return ordered


def _once(items: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Of the same mistake at the same place the one with the shortest names."""
    kept: dict[object, Diagnostic] = {}
    for number, d in enumerate(items):
        key: object = number
        if d.code in ONCE and d.primary is not None:
            span = d.primary.span
            key = d.code, id(span.source), span.start, span.end
        other = kept.get(key)
        if other is None or len(d.message) < len(other.message):
            kept[key] = d
    return list(kept.values())


def _merged(items: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Repetitions of a message in one file become labels of the first."""
    groups: dict[object, list[Diagnostic]] = {}
    for number, d in enumerate(items):
        key: object = number
        if d.code in MERGED and d.primary is not None:
            key = d.code, d.message, id(d.primary.span.source)
        groups.setdefault(key, []).append(d)
    return [_one(group) for group in groups.values()]


def _one(group: list[Diagnostic]) -> Diagnostic:
    first, rest = group[0], group[1:]
    if not rest:
        return first
    places = [Label(d.primary.span, "and here") for d in rest if d.primary is not None]
    notes = first.notes
    if len(places) > PLACES_MAX:
        notes = (*notes, f"and in {len(places) - PLACES_MAX} more places")
    fixes = tuple(_together(fix, group) for fix in first.fixes)
    secondary = (*first.secondary, *places[:PLACES_MAX])
    return replace(first, secondary=secondary, notes=notes, fixes=fixes)


def _together(fix: Fix, group: list[Diagnostic]) -> Fix:
    """The edits of all who offer the same, each once."""
    edits = [e for d in group for f in d.fixes if f.title == fix.title for e in f.edits]
    return Fix(fix.title, tuple(dict.fromkeys(edits)))
