"""The index of names: what each name means at each place; it answers every request about names.

Purpose: holds definitions, their uses in all files of a program, which locals are visible where,
and what a name stands for (what may follow a dot), as the checker found it.
Non-goals: finding them out (`name_resolution.py`, `language/check/`).
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from soter.editor.protocol_conversions import path_of_span

if TYPE_CHECKING:
    from pathlib import Path

    from soter.diagnostics.diagnostic import Source, Span
    from soter.language.load.loader import LoadedFile


@dataclass(eq=False)
class Definition:
    """A named part of a program; `node` is the syntax that declares it."""

    name: str
    kind: str
    span: Span
    """Where the name is declared."""
    node: object
    file: LoadedFile
    of: object = None
    """What it stands for: a type, the symbol of a plant, node, module or system, or a file."""
    owner: Definition | None = None
    """The declaration that contains this one; or None."""

    @property
    def key(self) -> tuple[Path, int]:
        """The place of the declaration, the same for two parses of the same text."""
        return path_of_span(self.span), self.span.start


@dataclass(frozen=True)
class Use:
    """A place where a name is written; its declaration is one, too."""

    span: Span
    definition: Definition

    @property
    def is_declaration(self) -> bool:
        """Whether this use is the declaration itself."""
        return self.span == self.definition.span


@dataclass(eq=False)
class NameIndex:
    """All names of a program. `top`: declarations by file; `reach`: where locals are visible."""

    files: tuple[LoadedFile, ...]
    top: dict[int, dict[str, Definition]] = field(default_factory=dict)
    instances: dict[int, dict[str, tuple[Definition, Definition | None]]] = field(
        default_factory=dict
    )
    """System declaration -> its instances by name, each with what it is an instance of."""
    reach: dict[int, list[tuple[int, int, Definition]]] = field(default_factory=dict)
    """Source -> (start, end, local) of the text in which each local is visible."""
    members: Any = None
    """Who finds names after a dot: a `Members` (`name_resolution.py`), which knows this class."""
    _uses: dict[int, dict[tuple[int, int], Use]] = field(default_factory=dict)
    _starts: dict[int, list[tuple[int, int]]] = field(default_factory=dict)

    def note_use(self, span: Span, definition: Definition) -> None:
        """Notes the meaning of a name at a place; the first meaning noted there stays."""
        self._uses.setdefault(id(span.source), {}).setdefault(
            (span.start, span.end), Use(span, definition)
        )

    def uses_in(self, source: Source) -> list[Use]:
        """The uses of names in a file, in order."""
        use_by_place = self._uses.get(id(source), {})
        return [use_by_place[place] for place in sorted(use_by_place)]

    def use_at(self, source: Source, offset: int) -> Use | None:
        """The use of a name that contains an offset or ends at it; or None."""
        use_by_place = self._uses.get(id(source), {})
        places = self._starts.get(id(source))
        if places is None:
            places = self._starts[id(source)] = sorted(use_by_place)
        i = bisect_right(places, (offset, len(source.text) + 1)) - 1
        if i >= 0 and places[i][0] <= offset <= places[i][1]:
            return use_by_place[places[i]]
        return None

    def uses_of(self, key: tuple[Path, int]) -> list[Use]:
        """All places with the name of a definition, including its declaration."""
        return [
            use
            for file in self.files
            for use in self.uses_in(file.source)
            if use.definition.key == key
        ]

    def locals_at(self, source: Source, offset: int) -> dict[str, Definition]:
        """By name: the locals visible at an offset; for equal names, the innermost local."""
        seen = [r for r in self.reach.get(id(source), []) if r[0] <= offset <= r[1]]
        return {d.name: d for _, _, d in sorted(seen, key=lambda r: r[0])}

    def declared_in(self, file: LoadedFile) -> dict[str, Definition]:
        """By name: the declarations and imports of a file."""
        return self.top.get(id(file), {})
