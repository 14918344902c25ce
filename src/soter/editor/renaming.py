"""Renames what a name means, wherever it stands.

Purpose: `uses_of` finds all places of a definition, `rename_spans` where to write another name, in
all files. A rename is tried before it is offered: afterwards every name must mean what it meant,
and the checker must say what it said.
Non-goals: which files there are (`server.py` asks `documents.py`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, Edit, Fix, Source, Span
from soter.diagnostics.fixes import apply_fix
from soter.editor.name_resolution import index_of
from soter.editor.protocol_conversions import path_of_span
from soter.language.front_end import check_file
from soter.language.load.loader import PRELUDE_DIR, SourceAccess, load
from soter.language.syntax.lexer import RESERVED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from soter.editor.name_definitions import Definition, NameIndex, Use
    from soter.language.model.types import Type, Value
    from soter.language.syntax import tree

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
Place = tuple["Path", int]
_Program = tuple["NameIndex", "dict[tuple[str, Place], str]"]
"""The names of a program, and the checker's messages by code and place."""


class RefusedError(Exception):
    """Raised if a rename is not possible; the text says why."""


def uses_of(definition: Definition, indices: Iterable[NameIndex]) -> list[Use]:
    """All places of a definition in some programs, in order, and each only once."""
    use_by_place: dict[Place, Use] = {}
    for index in indices:
        for use in index.uses_of(definition.key):
            use_by_place.setdefault((path_of_span(use.span), use.span.start), use)
    return [use_by_place[place] for place in sorted(use_by_place)]


def require_name(definition: Definition, name: str) -> None:
    """Raises RefusedError if this name is not possible for the kind of the definition."""
    if not NAME.fullmatch(name):
        raise RefusedError(f"`{name}` is no name: letters, digits and `_`, not a digit first")
    if name in RESERVED:
        raise RefusedError(f"`{name}` is a word of the language")
    if PRELUDE_DIR in path_of_span(definition.span).parents:
        raise RefusedError(f"`{definition.name}` belongs to the prelude")


def rename_spans(
    definition: Definition, name: str, programs: Iterable[Path], reading: SourceAccess
) -> list[Span]:
    """The spans in all files to overwrite with `name`; RefusedError if a meaning changes."""
    require_name(definition, name)
    mains = list(programs)
    before = {path: _names_and_messages(path, reading) for path in mains}
    uses = uses_of(definition, [b[0] for b in before.values()])
    edits = tuple(Edit(use.span, name) for use in uses)
    texts = {
        path_of_span(Edit(use.span, name).span).resolve(): text
        for source, text in apply_fix(Fix("", edits)).items()
        for use in uses
        if use.span.source is source
    }
    moved = _PlaceAfterRename(uses, len(name) - len(definition.name))
    after = _RenamedFiles(reading, texts)
    for path in mains:
        _require_same_meaning(
            before[path], _names_and_messages(path, after), moved, definition, name
        )
    return [use.span for use in uses]


def _names_and_messages(path: Path, reading: SourceAccess) -> _Program:
    """The names of a program with their meanings, and the messages of the checker."""
    loaded = load(str(path), Diagnostics(), None, reading)
    if loaded is None:
        raise RefusedError(f"cannot read `{path}`")
    found = check_file(str(path), reading=reading).diagnostics.items
    found_at: dict[tuple[str, tuple[Path, int]], str] = {}
    for d in found:
        span = None if d.primary is None else d.primary.span
        at = (path, -1) if span is None else (path_of_span(span), span.start)
        found_at[d.code, at] = d.message
    return index_of(loaded), found_at


class _PlaceAfterRename:
    """Maps a place in the old texts to its place after the rename."""

    def __init__(self, uses: list[Use], longer: int) -> None:
        self._longer = longer
        self._starts: dict[Path, list[int]] = {}
        for use in uses:
            self._starts.setdefault(path_of_span(use.span), []).append(use.span.start)

    def __call__(self, place: Place) -> Place:
        path, start = place
        return path, start + self._longer * sum(s < start for s in self._starts.get(path, ()))


class _RenamedFiles(SourceAccess):
    """Reads files with the contents that they will have after the rename."""

    def __init__(self, reading: SourceAccess, texts: dict[Path, str]) -> None:
        self._reading = reading
        self._texts = texts

    def text_of(
        self, path: Path, shown: str, diagnostics: Diagnostics, span: Span | None = None
    ) -> str | None:
        """The new text of a file that changes; the present text of any other file."""
        text = self._texts.get(path.resolve())
        return text if text is not None else self._reading.text_of(path, shown, diagnostics, span)

    def parse(self, shown: str, text: str, diagnostics: Diagnostics) -> tuple[Source, tree.File]:
        """The syntax tree of a text; unchanged texts are not parsed again."""
        return self._reading.parse(shown, text, diagnostics)

    def data_value(self, path: Path, t: Type, tell: Callable[[str], None]) -> tuple[Value, bytes]:
        """The value of a data file, which a rename does not change."""
        return self._reading.data_value(path, t, tell)


def _require_same_meaning(
    before: _Program, after: _Program, moved: _PlaceAfterRename, definition: Definition, name: str
) -> None:
    """Raises RefusedError unless both programs mean the same, apart from the name."""
    was, messages = before
    is_, says = after
    meant = {
        moved((path_of_span(u.span), u.span.start)): moved(u.definition.key)
        for file in was.files
        for u in was.uses_in(file.source)
    }
    means = {
        (path_of_span(u.span), u.span.start): u.definition.key
        for file in is_.files
        for u in is_.uses_in(file.source)
    }
    for place, key in means.items():
        if meant.get(place) != key:
            raise RefusedError(f"`{name}` would mean something else in {place[0].name}")
    if len(meant) != len(means):
        raise RefusedError(f"`{name}` would hide `{definition.name}` or another name")
    old = {(code, moved(place)) for code, place in messages}
    new = [message for at, message in says.items() if at not in old]
    if new or len(old) != len(says):
        change = new[0] if new else "less than before"
        raise RefusedError(f"with `{name}` the checker would say: {change}")
