"""Names: which declaration a name means, resolved on demand and once.

Purpose: one table a file, one look-up rule (own file, then prelude), cycles found on the way.
Non-goals: what the declarations mean; `Resolver` implementations in the checkers do that.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.program.loader import LoadedFile
    from soter.syntax import tree

KINDS = {
    "TypeDecl": "type",
    "ConstDecl": "constant",
    "ParamDecl": "parameter",
    "FunDecl": "function",
    "TopicDecl": "topic",
    "NodeDecl": "node",
    "RtaDecl": "module",
    "PlantDecl": "plant",
    "SystemDecl": "system",
    "TestDecl": "test",
}
ARTICLE = {"int": "an"}
BUILTIN_FUNCTIONS = (
    "sqrt",
    "floor",
    "abs",
    "min",
    "max",
    "dot",
    "norm",
    "saturate",
    "seconds",
    "mode",
    "age",
)


@dataclass(eq=False)
class Entry:
    """A declared name: its syntax, its file, and its symbol once resolved."""

    decl: tree.Decl
    scope: FileScope
    kind: str
    state: str = "new"
    """new -> resolving -> done; `resolving` met again is a cycle."""
    symbol: object = None
    used: bool = False

    @property
    def full_name(self) -> str:
        """Name with the prefix of its file."""
        return self.scope.loaded.prefix + self.decl.name.text


@dataclass(eq=False)
class FileScope:
    """All names one file declares, and the files it imports."""

    loaded: LoadedFile
    entries: dict[str, Entry] = field(default_factory=dict)
    imports: dict[str, FileScope | None] = field(default_factory=dict)
    used_imports: set[str] = field(default_factory=set)
    broken: frozenset[str] = frozenset()
    """Names whose declarations did not parse: using them is not reported again."""


class Names:
    """The scopes of a whole program."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self.diagnostics = diagnostics
        self.scopes: list[FileScope] = []
        self.prelude: dict[str, Entry] = {}
        self._by_file: dict[int, FileScope] = {}

    def add_file(self, loaded: LoadedFile) -> FileScope:
        """Enter every declaration of a file; a second declaration of a name is N002."""
        known = self._by_file.get(id(loaded))
        if known is not None:
            return known
        scope = FileScope(loaded, broken=loaded.file.broken)
        self._by_file[id(loaded)] = scope
        for decl in loaded.file.declarations:
            name = decl.name.text
            first = scope.entries.get(name)
            if first is not None:
                self.diagnostics.error(
                    "N002",
                    f"`{name}` is declared twice",
                    decl.name.span,
                    "declared again here",
                    also=((first.decl.name.span, "first declared here"),),
                )
                continue
            scope.entries[name] = Entry(decl, scope, KINDS[type(decl).__name__])
        if loaded.prelude:
            self.prelude.update(scope.entries)
        else:
            self.scopes.append(scope)
        for name, child in loaded.imports.items():
            scope.imports[name] = self.add_file(child) if child is not None else None
            if name in scope.entries:
                self.diagnostics.error(
                    "N002",
                    f"`{name}` is both an import and a declaration",
                    scope.entries[name].decl.name.span,
                )
        return scope

    def find(self, scope: FileScope, name: str) -> Entry | None:
        """The entry a bare name means in a file, or None; marks it used."""
        entry = scope.entries.get(name)
        if entry is None:
            entry = self.prelude.get(name)
        if entry is not None:
            entry.used = True
        return entry

    def find_ref(self, scope: FileScope, ref: tree.Ref) -> Entry | None:
        """The entry a reference means; reports N001/N006 and gives None when there is none."""
        if ref.qualifier is None:
            entry = self.find(scope, ref.name.text)
            if entry is None and ref.name.text not in scope.broken:
                self.unknown(scope, ref.name.text, ref.name.span)
            return entry
        return self.find_in_import(scope, ref.qualifier, ref.name)

    def find_in_import(
        self, scope: FileScope, qualifier: tree.Name, name: tree.Name
    ) -> Entry | None:
        """The entry `qualifier.name`; reports what is wrong."""
        if qualifier.text not in scope.imports:
            self.diagnostics.error(
                "N006",
                f"there is no import called `{qualifier.text}`",
                qualifier.span,
                helps=(f'add `import "{qualifier.text}.soter" as {qualifier.text};`',),
            )
            return None
        scope.used_imports.add(qualifier.text)
        child = scope.imports[qualifier.text]
        if child is None:
            return None
        entry = child.entries.get(name.text)
        if entry is None and name.text not in child.broken:
            self.diagnostics.error(
                "N001",
                f"`{qualifier.text}` declares no `{name.text}`",
                name.span,
                helps=suggestion(name.text, child.entries),
            )
        elif entry is not None:
            entry.used = True
        return entry

    def unknown(self, scope: FileScope, name: str, span: Span, more: tuple[str, ...] = ()) -> None:
        """Report an unknown name with the nearest known one."""
        candidates = (*more, *scope.entries, *self.prelude, *BUILTIN_FUNCTIONS)
        self.diagnostics.error(
            "N001", f"unknown name `{name}`", span, "not declared", helps=suggestion(name, candidates)
        )


def suggestion(name: str, candidates: object) -> tuple[str, ...]:
    """A help line naming the closest candidate, if any is close."""
    close = difflib.get_close_matches(name, list(candidates), n=1, cutoff=0.7)  # type: ignore[call-overload]
    return (f"did you mean `{close[0]}`?",) if close else ()
