"""Finds which declaration a name means, and reports names that mean nothing.

Purpose: keeps one table of names for each file, with one rule of look-up (own file, then prelude),
and guesses what an unknown name may have been meant to be.
Non-goals: what the declarations mean (the checkers).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING

from soter.diagnostics.fixes import replace
from soter.language.check import unknown_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.diagnostics.diagnostic import Diagnostics, Help, Span
    from soter.language.load.loader import LoadedFile
    from soter.language.syntax import tree

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
    "margin",
    "age",
)
EXAMPLES = {
    "topic": "topic {}: float;",
    "input topic": "input topic {}: float in [-1.0, 1.0];",
    "parameter": "param {}: float = 1.0;",
    "node": "node {} period 10ms {{ ... }}",
    "plant": "plant {} period 5ms {{ ... }}",
}
"""Kind of a declaration -> how a missing one would begin."""


@dataclass(eq=False)
class Entry:
    """A declared name, with its syntax, its file, and its symbol once it is resolved."""

    decl: tree.Decl
    scope: FileScope
    kind: str
    state: str = "new"
    """First "new", then "resolving", then "done"; if it is needed while "resolving": a cycle."""
    symbol: object = None
    used: bool = False

    @property
    def full_name(self) -> str:
        """Gives the name with the prefix of its file."""
        return self.scope.loaded.prefix + self.decl.name.text

    def helps_for_other_kind(self, wanted: str, span: Span) -> tuple[Help, ...]:
        """Gives helps for a use of this declaration at a place that needs the kind `wanted`."""
        decls = [e.decl for e in self.scope.entries.values()]
        return unknown_names.helps_for_other_kind(decls, self.decl, wanted, span)


@dataclass(eq=False)
class FileScope:
    """All names that one file declares, and the files that it imports."""

    loaded: LoadedFile
    entries: dict[str, Entry] = field(default_factory=dict)
    imports: dict[str, FileScope | None] = field(default_factory=dict)
    used_imports: set[str] = field(default_factory=set)
    broken: frozenset[str] = frozenset()
    """Names whose declarations the parser could not read: uses of them are not reported."""


@dataclass(eq=False)
class Meanings:
    """The meanings of names, by place, and the syntax of records' fields, for an editor."""

    at: dict[tuple[int, int], object] = field(default_factory=dict)
    """(source, start of the name) -> an `Entry`, `Import`, `FieldOf`, or typed symbol."""
    records: dict[int, tuple[object, object]] = field(default_factory=dict)
    """Identity of the fields of a record type -> these fields, and the syntax that has them."""


@dataclass(frozen=True)
class Import:
    """The meaning of a name that stands for an imported file."""

    scope: FileScope
    name: str


@dataclass(frozen=True, eq=False)
class FieldOf:
    """The meaning of a name that stands for a field of a record or a member of an enum."""

    type: object
    name: str


NO_VALUES = ("node", "plant", "module", "system", "test")


def _help_to_declare(decls: list[tree.Decl], kind: str, name: str) -> tuple[Help, ...]:
    """Gives a help that shows how to declare a name; () for kinds without an example."""
    undriven = kind == "topic" and not unknown_names.is_published_or_driven(decls, name)
    example = EXAMPLES.get("input topic" if undriven else kind)
    return (f"declare it: `{example.format(name)}`",) if example else ()


def _names_of_kind(scope: FileScope, kind: str, *, value: bool) -> Iterator[str]:
    """Yields the names in a file that can be used where a declaration of `kind` is needed."""
    for name, entry in scope.entries.items():
        if entry.kind == kind or (kind == "name" and not (value and entry.kind in NO_VALUES)):
            yield name


class Names:
    """The scopes of a whole program.

    `losses` counts uses of declarations that are missing because of a reported error; if it grows,
    the checker knows that its result is incomplete. `meanings` has the meaning of each name, if an
    editor asks.
    """

    def __init__(self, diagnostics: Diagnostics, meanings: Meanings | None = None) -> None:
        self.diagnostics = diagnostics
        self.meanings = meanings
        self.scopes: list[FileScope] = []
        self.prelude: dict[str, Entry] = {}
        self.losses = 0
        self._by_file: dict[int, FileScope] = {}
        self._missing: set[tuple[object, ...]] = set()

    def note_meaning(self, span: Span, meaning: object) -> None:
        """Records the meaning of the name at a place, unless it has one already."""
        if self.meanings is not None and meaning is not None:
            self.meanings.at.setdefault((id(span.source), span.start), meaning)

    def note_syntax_of_fields(self, fields: object, syntax: object) -> None:
        """Records which syntax declares the fields of a record type."""
        if self.meanings is not None:
            self.meanings.records[id(fields)] = fields, syntax

    # ------------------------------------------------------------ entering

    def add_program(self, main: LoadedFile) -> FileScope:
        """Enters the declarations of a file and all its imports; returns the file's scope."""
        scope = self._file_scope(main)
        waiting = [main]
        entered = {id(main)}
        while waiting:
            loaded = waiting.pop(0)
            file_scope = self._file_scope(loaded)
            for name, child in loaded.imports.items():
                file_scope.imports[name] = self._file_scope(child) if child is not None else None
                if child is not None and id(child) not in entered:
                    entered.add(id(child))
                    waiting.append(child)
                if name in file_scope.entries:
                    self._report_import_and_declaration(file_scope, name)
        return scope

    def add_prelude(self, loaded: LoadedFile) -> None:
        """Enters the declarations of a prelude file, which every file sees."""
        self.prelude.update(self._file_scope(loaded).entries)

    def _file_scope(self, loaded: LoadedFile) -> FileScope:
        known = self._by_file.get(id(loaded))
        if known is not None:
            return known
        scope = FileScope(loaded, broken=loaded.file.broken)
        self._by_file[id(loaded)] = scope
        if not loaded.prelude:
            self.scopes.append(scope)
        for decl in loaded.file.declarations:
            name = decl.name.text
            first = scope.entries.get(name)
            if first is None:
                scope.entries[name] = Entry(decl, scope, KINDS[type(decl).__name__])
            else:
                self.report_duplicate(name, decl.name.span, first.decl.name.span)
        return scope

    def _report_import_and_declaration(self, scope: FileScope, name: str) -> None:
        imported = next(i for i in scope.loaded.file.imports if i.name.text == name)
        self.diagnostics.error(
            "N002",
            f"`{name}` is both an import and a {scope.entries[name].kind}",
            scope.entries[name].decl.name.span,
            "declared here",
            also=((imported.name.span, "imported here"),),
            helps=("import the file under another name",),
        )

    def report_duplicate(self, name: str, again: Span, first: Span, kind_word: str = "") -> None:
        """Reports N002 for one name of two things; `kind_word` says which kind of things."""
        kind = f"{kind_word} " if kind_word else ""
        self.diagnostics.error(
            "N002",
            f"{kind}`{name}` is declared twice",
            again,
            "declared again here",
            also=((first, "first declared here"),),
        )

    def enter_if_new(self, name: tree.Name, seen: dict[str, Span], kind: str = "") -> bool:
        """Enters `name` in `seen`; if it is there already, reports N002 and returns False."""
        first = seen.setdefault(name.text, name.span)
        if first is not name.span:
            self.report_duplicate(name.text, name.span, first, kind)
        return first is name.span

    def report_repeated(self, message: str, again: Span, first: Span) -> None:
        """Reports N002, with both places, for a clause that may be written only once."""
        self.diagnostics.error("N002", message, again, "again", also=((first, "the first time"),))

    # ------------------------------------------------------------ looking up

    def find_entry(self, scope: FileScope, name: str, span: Span | None = None) -> Entry | None:
        """Gives the entry that an unqualified name means, and marks it as used; or None."""
        entry = scope.entries.get(name) or self.prelude.get(name)
        if entry is not None:
            entry.used = True
            if span is not None:
                self.note_meaning(span, entry)
        return entry

    def find_ref(
        self,
        scope: FileScope,
        ref: tree.Ref,
        wanted: str = "name",
        otherwise: tuple[Help, ...] = (),
    ) -> Entry | None:
        """Gives the entry that a reference means; None after reporting N001 or N006.

        `wanted` is the kind of declaration that is needed; `otherwise` as in `report_unknown`.
        """
        if ref.qualifier is not None:
            return self.find_in_import(scope, ref.qualifier, ref.name, wanted)
        name = ref.name.text
        entry = self.find_entry(scope, name, ref.name.span)
        if entry is None and (id(scope), name) in self._missing:
            self.losses += 1
        elif entry is None:
            self.report_unknown(scope, name, ref.name.span, kind=wanted, otherwise=otherwise)
            self._missing.add((id(scope), name))
        return entry

    def find_in_import(
        self, scope: FileScope, qualifier: tree.Name, name: tree.Name, wanted: str = "name"
    ) -> Entry | None:
        """Gives the entry that `qualifier.name` means; None after a reported error."""
        if qualifier.text not in scope.imports:
            if not self._report_library(scope, qualifier, name, wanted):
                self._report_no_import(scope, qualifier, name)
            return None
        scope.used_imports.add(qualifier.text)
        self.note_meaning(qualifier.span, Import(scope, qualifier.text))
        child = scope.imports[qualifier.text]
        entry = child.entries.get(name.text) if child is not None else None
        if child is None or (entry is None and name.text in child.broken):
            self.losses += 1
            return None
        if entry is None:
            self.diagnostics.error(
                "N001",
                f"`{qualifier.text}` declares no `{name.text}`",
                name.span,
                f"not in `{child.loaded.source.name}`",
                helps=self.diagnostics.did_you_mean(name.text, child.entries, name.span)
                or self._help_without_qualifier(scope, qualifier, name),
            )
            return None
        entry.used = True
        self.note_meaning(name.span, entry)
        return entry

    # ------------------------------------------------------------ reports and helps

    @staticmethod
    def _help_without_qualifier(
        scope: FileScope, qualifier: tree.Name, name: tree.Name
    ) -> tuple[Help, ...]:
        """Gives a help that drops the qualifier, if this file declares the name; else ()."""
        if name.text not in scope.entries:
            return ()
        span = qualifier.span.to(name.span)
        return (replace(span, name.text, f"this file declares it: `{name.text}`"),)

    def _report_library(
        self, scope: FileScope, qualifier: tree.Name, name: tree.Name, wanted: str
    ) -> bool:
        """Reports N006 for a name like `math.sin` that the prelude has; gives False for others."""
        helps = unknown_names.library_helps(qualifier, name, wanted)
        if helps is None or qualifier.text in scope.entries or qualifier.text in scope.broken:
            return False
        self.diagnostics.error(
            "N006",
            f"there is no `{qualifier.text}.{name.text}`",
            qualifier.span.to(name.span),
            notes=("the functions and types of the prelude need no import",),
            helps=helps,
        )
        return True

    def _report_no_import(self, scope: FileScope, qualifier: tree.Name, member: tree.Name) -> None:
        name = qualifier.text
        if name in scope.broken or (id(scope), name) in self._missing:
            self.losses += 1
            return
        entry = scope.entries.get(name)
        if entry is not None and entry.kind == "topic":
            self.diagnostics.error(
                "N006",
                f"a topic is named as a whole: `{name}`",
                qualifier.span.to(member.span),
                "a part of it",
                also=((entry.decl.name.span, "declared here"),),
                helps=unknown_names.whole_topic_helps(
                    (e.decl for e in scope.entries.values()),
                    entry.decl,
                    qualifier.span.to(member.span),
                ),
            )
            return
        if entry is not None:
            self.diagnostics.error(
                "N006",
                f"`{name}` is a {entry.kind}, not an imported file",
                qualifier.span,
                also=((entry.decl.name.span, "declared here"),),
                notes=("before a dot a reference names an import",),
                helps=self._help_without_qualifier(scope, qualifier, member),
            )
            return
        self._missing.add((id(scope), name))
        decls = [e.decl for e in scope.entries.values()]
        meant = next((m for m in unknown_names.meanings(decls, name) if not m.weak), None)
        if meant is not None:
            self.diagnostics.error(
                "N006",
                f"`{name}` is {meant.subject}, not an imported file",
                qualifier.span,
                also=((meant.span, "declared here"),),
                helps=self._help_without_qualifier(scope, qualifier, member) or (meant.help,),
            )
            return
        near = self.diagnostics.did_you_mean(name, scope.imports, qualifier.span)
        self.diagnostics.error(
            "N006",
            f"there is no import called `{name}`",
            qualifier.span,
            "not imported",
            notes=() if near else ('a file is imported by `import "file.soter" as name;`',),
            helps=near,
        )

    def report_unknown(
        self,
        scope: FileScope,
        name: str,
        span: Span,
        more: Iterable[str] = (),
        kind: str = "name",
        where: str = "",
        *,
        dotted: bool = False,
        helps: tuple[Help, ...] = (),
        otherwise: tuple[Help, ...] = (),
        also: tuple[tuple[Span, str], ...] = (),
        among: Iterable[str] | None = None,
    ) -> None:
        """Reports N001 for a name without a meaning here; `more` are locals that may be meant.

        `among`: the only names that are correct here. `helps` come before all guesses, `otherwise`
        if no name is close. A missing declaration is reported once, and so is a name before a dot
        (`dotted`), for which an import may be missing.
        """
        known = {(id(scope), name), (id(scope), name, where)} & self._missing
        if name in scope.broken or known:
            self.losses += 1
            return
        if dotted:
            self._missing.add((id(scope), name))
        decls = [e.decl for e in scope.entries.values()]
        if self.diagnostics.may_look_at(len(decls)):
            elsewhere = () if also else tuple(unknown_names.meanings(decls, name))
            meant = next((m for m in elsewhere if not m.weak), None)
            if meant is not None:
                also, helps = ((meant.span, meant.subject),), helps or (meant.help,)
            if not helps:
                near = among or chain(more, _names_of_kind(scope, kind, value=bool(where)))
                guesses = self._guessed_helps(scope, name, span, kind, near, anything=among is None)
                helps = next(filter(None, guesses), otherwise)
            if not helps and elsewhere:
                also, helps = ((elsewhere[0].span, elsewhere[0].subject),), (elsewhere[0].help,)
            helps = helps or _help_to_declare(decls, kind, name)
        self.diagnostics.error(
            "N001", f"unknown {kind} `{name}`", span, "not declared", also=also, helps=helps
        )

    def _guessed_helps(
        self,
        scope: FileScope,
        name: str,
        span: Span,
        kind: str,
        near: Iterable[str],
        *,
        anything: bool,
    ) -> Iterator[tuple[Help, ...]]:
        """Yields helps with names that may have been meant, the likeliest first.

        `anything`: functions of the prelude are correct here, too.
        """
        if kind == "type":
            yield unknown_names.type_helps(name, span)
        elif kind == "name":
            yield unknown_names.value_helps((e.decl for e in scope.entries.values()), name, span)
        yield self.diagnostics.did_you_mean(name, near, span)
        yield self._import_helps(scope, name, span)
        if anything and kind != "type":
            public = (n for n in chain(self.prelude, BUILTIN_FUNCTIONS) if not n.startswith("_"))
            yield self.diagnostics.did_you_mean(name, public, span)
        if name in scope.imports:
            yield (f"it is an imported file: write `{name}.` and the name it declares",)

    def _import_helps(self, scope: FileScope, name: str, span: Span) -> tuple[Help, ...]:
        """Gives a help for a name that an imported file declares; () if none does."""
        for qualifier, child in scope.imports.items():
            if child is not None and name in child.entries:
                scope.used_imports.add(qualifier)
                near = f"{qualifier}.{name}"
                return (replace(span, near, f"did you mean `{near}`?"),)
        return ()

    def is_first_miss(self, scope: FileScope, name: str, where: str) -> bool:
        """Whether this is the first use of a missing name at a place; counts others as losses."""
        key = (id(scope), name, where)
        if key in self._missing:
            self.losses += 1
            return False
        self._missing.add(key)
        return True
