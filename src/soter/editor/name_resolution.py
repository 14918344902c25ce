"""Finds what every name of a program means: the checker says it, of unfinished programs too.

Purpose: lists what the trees declare, and asks one run of the checker what it took each name for.
Paths that are only resolved in flat systems (`late`, `replace`), and names in a declaration that
the checker left, as a part of it is missing, are followed name by name, from what the checker knows
of the one before.
Non-goals: rules of names, reporting errors (`language/check/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostics, Span
from soter.editor.name_definitions import Definition, NameIndex
from soter.language.check.checker import Checker
from soter.language.check.scope import KINDS, Entry, FieldOf, Import, Meanings
from soter.language.load.loader import LoadedFile, LoadedProgram
from soter.language.model import typed
from soter.language.model.types import ArrayType, EnumType, ListType, RecordType
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.types import Type


Instances = dict[str, "tuple[Definition, Definition | None]"]
LOCALS: dict[type, str] = {
    tree.LocalVar: "variable",
    tree.PlantState: "state",
    tree.DisturbanceItem: "disturbance",
    tree.PlantLet: "let",
    tree.LetStmt: "let",
    tree.VarStmt: "variable",
    tree.ForRangeStmt: "loop variable",
    tree.ForEachStmt: "loop variable",
    tree.Repeated: "loop variable",
    tree.Clause: "clause",
    tree.MeasureItem: "measure",
    tree.View: "view",
    tree.Abstraction: "axis",
}
"""Syntax with a `name` that it declares -> the kind of what is declared."""
UNSEEN = {"clause", "measure", "view", "axis"}
"""Kinds of names that no expression can read."""


def index_of(loaded: LoadedProgram) -> NameIndex:
    """The index of names in all files of a program and in the prelude."""
    meant = Meanings()
    checker = Checker(loaded, Diagnostics(), meant)
    checker.check_program()
    members = Members(NameIndex((*loaded.files, *loaded.prelude)), checker, meant)
    members.index.members = members
    members.run()
    return members.index


class Members:
    """Makes the index in one pass over all trees; afterwards it finds names behind dots."""

    def __init__(self, index: NameIndex, checker: Checker, meant: Meanings) -> None:
        self.index = index
        self._checker = checker
        self._meant = meant
        scopes = [e for s in checker.names.scopes for e in s.entries.values()]
        entries = [*scopes, *checker.names.prelude.values()]
        self._entry_of = {id(e.decl): e for e in entries}
        self._of_symbol = {id(e.symbol): e for e in entries if e.symbol is not None}
        self._by_place: dict[tuple[int, int], Definition] = {}
        self._owner: Definition | None = None
        self._instances: Instances = {}
        self._axes: dict[str, Definition] = {}

    def run(self) -> None:
        """Enters all definitions, then notes all uses of names in the program's own files."""
        for file in self.index.files:
            self._enter_file(file)
        for fields, syntax in self._meant.records.values():
            for (_, t), name in zip(fields, _field_names(syntax), strict=False):  # type: ignore[call-overload]
                if (known := self._by_place.get(_place(name))) is not None:
                    known.of = known.of or t
        for file in self.index.files:
            for name, child in file.imports.items():
                self.index.top[id(file)][name].of = child
            for decl in () if file.prelude else file.file.declarations:
                self._owner = self._by_place[_place(decl.name)]
                self._instances = self._instances_nameable_in(decl, file)
                self._note_names_in(decl, file)

    # ------------------------------------------------------------ definitions

    def _enter_file(self, file: LoadedFile) -> None:
        names = self.index.top[id(file)] = {}
        self._owner = None
        for imported in file.file.imports:
            entered = self._definition(imported.name, "import", imported, file)
            names.setdefault(imported.name.text, entered)
        for decl in file.file.declarations:
            self._owner = None
            entered = self._definition(decl.name, KINDS[type(decl).__name__], decl, file)
            entry = self._entry_of.get(id(decl))
            entered.of = None if entry is None else _symbol_meaning(entry.symbol)
            if names.get(decl.name.text) is None or names[decl.name.text].kind == "import":
                names[decl.name.text] = entered
            self._owner = entered
            if not file.prelude or isinstance(decl, tree.TypeDecl):
                self._enter_declared_inside(decl, decl, file)

    def _definition(
        self, name: tree.Name, kind: str, node: object, file: LoadedFile, of: object = None
    ) -> Definition:
        """The definition at the place of a name; the first call for a place makes it."""
        known = self._by_place.get(_place(name))
        if known is None:
            known = Definition(name.text, kind, name.word, node, file, of, self._owner)
            self._by_place[_place(name)] = known
            self.index.note_use(known.span, known)
        return known

    def _enter_declared_inside(self, piece: Any, decl: tree.Decl, file: LoadedFile) -> None:  # noqa: ANN401
        """Enters the declarations in a piece of syntax inside the declaration `decl`."""
        if isinstance(piece, tuple):
            for part in piece:
                self._enter_declared_inside(part, decl, file)
            return
        if not hasattr(piece, "__dataclass_fields__") or isinstance(piece, (Span, tree.Name)):
            return
        if isinstance(piece, tree.FunDecl):
            for pair in piece.parameters:
                self._enter_local(pair[0], "argument", pair, file, decl.span.start, decl.span.end)
        elif isinstance(piece, tree.RecordTypeExpr):
            for pair in piece.fields:
                self._definition(pair[0], "field", pair, file)
        elif isinstance(piece, tree.EnumTypeExpr):
            for member in piece.members:
                self._definition(member, "member", decl, file)
        elif isinstance(piece, tree.Block):
            for s in piece.statements:
                if isinstance(s, (tree.LetStmt, tree.VarStmt)):
                    self._enter_local(s.name, LOCALS[type(s)], s, file, s.span.end, piece.span.end)
        elif isinstance(piece, (tree.ForRangeStmt, tree.ForEachStmt, tree.Repeated)):
            seen = piece.span if isinstance(piece, tree.Repeated) else piece.body.span
            self._enter_local(piece.name, LOCALS[type(piece)], piece, file, seen.start, seen.end)
        elif (kind := LOCALS.get(type(piece))) in UNSEEN:
            self._definition(piece.name, str(kind), piece, file)
        elif kind is not None:
            self._enter_local(piece.name, kind, piece, file, decl.span.start, decl.span.end)
        for part in piece.__dataclass_fields__:
            if not part.endswith("span"):
                self._enter_declared_inside(getattr(piece, part), decl, file)

    def _enter_local(
        self, name: tree.Name, kind: str, node: object, file: LoadedFile, start: int, end: int
    ) -> None:
        """Enters a local that is visible from `start` to `end`."""
        local = self._definition(name, kind, node, file)
        variable = self._meant.at.get(_place(name))
        local.of = variable.type if isinstance(variable, typed.Variable) else None
        self.index.reach.setdefault(id(name.span.source), []).append((start, end, local))

    # ------------------------------------------------------------ uses

    def _note_names_in(self, piece: Any, file: LoadedFile) -> None:  # noqa: ANN401 - any piece of syntax
        """Notes the meanings of the names in a piece of syntax."""
        if isinstance(piece, tuple):
            for part in piece:
                self._note_names_in(part, file)
        elif isinstance(piece, (tree.NameExpr, tree.FieldExpr, tree.IndexExpr)):
            self._note_expression(piece, file)
        elif isinstance(piece, tree.DottedPath):
            self._note_chain([(p, len(getattr(p, "indices", ()))) for p in piece.parts], file)
            self._note_names_in(
                tuple(i for p in piece.parts for i in getattr(p, "indices", ())), file
            )
        elif isinstance(piece, tree.Ref):
            names = [n for n in (piece.qualifier, piece.name) if n is not None]
            self._note_chain([(n, 0) for n in names], file)
        elif isinstance(piece, tree.Name):
            self._note_chain([(piece, 0)], file)
            self._note_names_in(getattr(piece, "indices", ()), file)
        elif isinstance(piece, tree.Instance):
            self._note_instance(piece, file)
        elif isinstance(piece, tree.RecordExpr):
            for name, value in piece.fields:
                found = self._meaning(name) or self._definition(name, "field", name, file)
                self.index.note_use(name.word, found)
                self._note_names_in(value, file)
        elif hasattr(piece, "__dataclass_fields__") and not isinstance(piece, Span):
            outer = self._axes
            if isinstance(piece, (tree.VerifyBlock, tree.View)):
                self._axes = self._axes_of(piece, file)
            for part in piece.__dataclass_fields__:
                if not part.endswith("span"):
                    self._note_names_in(getattr(piece, part), file)
            self._axes = outer

    def _note_expression(self, piece: tree.SyntaxExpr, file: LoadedFile) -> None:
        """Notes a chain of names, dots and brackets, and names within brackets."""
        names: list[tuple[tree.Name, int]] = []
        count = 0
        while isinstance(piece, (tree.FieldExpr, tree.IndexExpr)):
            if isinstance(piece, tree.FieldExpr):
                names.insert(0, (piece.field, count))
                count = 0
            else:
                self._note_names_in(piece.index, file)
                count += 1
            piece = piece.target
        if isinstance(piece, tree.NameExpr):
            self._note_chain([(piece.name, count), *names], file)
            return
        self._note_names_in(piece, file)
        for name, _ in names:
            self._note_chain([(name, 0)], file, first=False)

    def _note_instance(self, item: tree.Instance, file: LoadedFile) -> None:
        """Notes an instance's names; names set in its braces may mean instances inside it."""
        self._note_names_in((item.name, item.what, item.renames), file)
        declared = self._ref_definition(item.what, file)
        outer = self._instances
        self._instances = self._instances_inside(declared)
        self._note_names_in(item.sets, file)
        self._instances = outer
        self._note_names_in(tuple(s.value for s in item.sets), file)

    def _note_chain(
        self, names: list[tuple[tree.Name, int]], file: LoadedFile, *, first: bool = True
    ) -> None:
        """Notes the names of a path, each paired with its number of indices."""
        of: object = None
        for k, (name, indices) in enumerate(names):
            found = self._meaning(name)
            if found is None and k == 0 and first:
                found = self._nearest_definition(name, file)
            if found is None and k:
                found, of = self._member_named(of, name.text)
            else:
                of = None if found is None else found.of
            if found is not None:
                self.index.note_use(name.word, found)
            for _ in range(indices):
                of = of.element if isinstance(of, (ArrayType, ListType)) else of

    def _meaning(self, name: tree.Name) -> Definition | None:
        """The definition that the checker found for a name, or that the name declares; or None."""
        meaning = self._meant.at.get(_place(name))
        if isinstance(meaning, Entry):
            return self.index.top[id(meaning.scope.loaded)].get(meaning.decl.name.text)
        if isinstance(meaning, Import):
            return self.index.top[id(meaning.scope.loaded)].get(meaning.name)
        if isinstance(meaning, FieldOf):
            return self._field_definition(meaning.type, meaning.name)
        if isinstance(meaning, typed.Variable):
            return self._by_place.get((id(meaning.span.source), meaning.span.start))
        if meaning is not None:
            return self._symbol_definition(meaning)
        return self._by_place.get(_place(name))

    def _symbol_definition(self, symbol: object) -> Definition | None:
        """The definition of a symbol; None if it is not in the index."""
        entry = self._of_symbol.get(id(symbol))
        return None if entry is None else self._by_place.get(_place(entry.decl.name))

    def _field_definition(self, of: object, name: str) -> Definition | None:
        """The definition of a record's field or an enum's member; or None."""
        if isinstance(of, EnumType):
            entry = next(
                (e for e in self._entry_of.values() if e.symbol == of and e.kind == "type"), None
            )
            members = () if entry is None else _field_names(entry.decl)
            return next((self._by_place.get(_place(m)) for m in members if m.text == name), None)
        fields = of.fields if isinstance(of, RecordType) else ()
        known = self._meant.records.get(id(fields))
        if known is None:
            known = next((r for r in self._meant.records.values() if r[0] == fields), None)
        syntax = None if known is None else known[1]
        field = next((n for n in _field_names(syntax) if n.text == name), None)
        if field is None:
            return None
        if isinstance(syntax, tree.RecordExpr):  # declared where it is written
            t = dict(fields)[name]
            return self._definition(field, "field", field, self._file_of(field), t)
        return self._by_place.get(_place(field))

    def _file_of(self, name: tree.Name) -> LoadedFile:
        return next(f for f in self.index.files if f.source is name.span.source)

    def _nearest_definition(self, name: tree.Name, file: LoadedFile) -> Definition | None:
        """The local, axis, instance or declaration that a name may mean; or None."""
        local = self.index.locals_at(name.span.source, name.span.start).get(name.text)
        instance = self._instances.get(name.text, (None, None))[0]
        found = self._axes.get(name.text) or local or instance
        return (
            found
            or self._declared_name(name.text, file)
            or self._component_named(name.text, self._instances)
        )

    def _declared_name(self, name: str, file: LoadedFile) -> Definition | None:
        declared = self.index.declared_in(file).get(name)
        entry = self._checker.names.prelude.get(name)
        return declared or (None if entry is None else self._by_place.get(_place(entry.decl.name)))

    def _ref_definition(self, ref: tree.Ref, file: LoadedFile) -> Definition | None:
        if ref.qualifier is None:
            return self._meaning(ref.name) or self._declared_name(ref.name.text, file)
        return self._meaning(ref.name)

    # ------------------------------------------------------------ instances

    def _instances_inside(self, outer_: Definition | None) -> Instances:
        """The instances of a system, by name; {} for anything else."""
        if outer_ is None or not isinstance(outer_.node, tree.SystemDecl):
            return {}
        instances = self.index.instances.setdefault(id(outer_.node), {})
        outer, self._owner = self._owner, outer_
        for item in () if instances else _all_instances(outer_.node.instances):
            of = self._ref_definition(item.what, outer_.file)
            if item.kind is not None and of is not None:
                instances[item.name.text] = of, of
            elif item.kind is None and item.name.text in instances:
                self.index.note_use(item.name.word, instances[item.name.text][0])
            elif item.kind is None:
                instance = self._definition(item.name, "instance", item, outer_.file, of and of.of)
                instances[item.name.text] = instance, of
        self._owner = outer
        return instances

    def _instances_nameable_in(self, decl: tree.Decl, file: LoadedFile) -> Instances:
        """Instances that a declaration may name, of its system or of those with its module."""
        system = self._by_place[_place(decl.name)]
        if isinstance(decl, tree.SystemDecl):
            return self._instances_inside(system)
        if isinstance(decl, tree.TestDecl):
            return (
                self._instances_inside(self._ref_definition(decl.system, file))
                if decl.system is not None
                else {}
            )
        beside: Instances = {}
        if isinstance(decl, tree.RtaDecl):
            for home in self.index.files:
                for d in home.file.declarations:
                    if isinstance(d, tree.SystemDecl):
                        inside = self._instances_inside(self._by_place[_place(d.name)])
                        if any(declared is system for _, declared in inside.values()):
                            beside = {**inside, **beside}
        return beside

    def _component_named(self, name: str, instances: Instances) -> Definition | None:
        """A node in a module that its system knows by the node's name; or None."""
        for _, part in instances.values():
            found = None
            if part is not None and isinstance(part.node, tree.RtaDecl):
                found = self._controller_named(part, name)
            elif part is not None:
                found = self._component_named(name, self._instances_inside(part))
            if found is not None:
                return found
        return None

    def _controller_named(self, module: Definition, name: str) -> Definition | None:
        """The controller of a module (AC, SC or a plan) that has this name; or None."""
        assert isinstance(module.node, tree.RtaDecl)
        for ref in (module.node.ac, module.node.sc, *module.node.plans):
            if isinstance(ref, tree.Ref) and ref.name.text == name:
                return self._ref_definition(ref, module.file)
        return None

    def _axes_of(
        self, block: tree.VerifyBlock | tree.View, file: LoadedFile
    ) -> dict[str, Definition]:
        """By name: the axes that a block declares for states of its plants."""
        axes = {}
        for _, parts in block.abstracts:
            for part in parts:
                axis = self._definition(part.name, "axis", part, file)
                plant = self._ref_definition(part.plant, file)
                axis.of = None if plant is None else plant.of
                axes[part.name.text] = axis
        return axes

    # ------------------------------------------------------------ behind a dot

    def _member_named(self, of: object, name: str) -> tuple[Definition | None, object]:
        """A member's definition, or None, and its meaning: a type, a symbol or a file."""
        found: Definition | None = None
        if isinstance(of, LoadedFile):
            found = self.index.declared_in(of).get(name)
            found = None if found is None or found.kind == "import" else found
        elif isinstance(of, (RecordType, EnumType)):
            found = self._field_definition(of, name)
        elif isinstance(of, typed.PlantSymbol) and name == "truth":
            return None, of.truth
        elif isinstance(of, typed.PlantSymbol):
            driven = [t for t, _ in of.drives if t.name.rpartition(".")[2] == name]
            drawn = [d.variable.span for d in of.disturbances if d.variable.name == name]
            found = (
                self._symbol_definition(driven[0])
                if driven
                else self._field_definition(of.truth, name)
            )
            found = self._by_place[id(drawn[0].source), drawn[0].start] if drawn else found
        elif isinstance(of, typed.SystemSymbol):
            found = self._instances_inside(self._symbol_definition(of)).get(name, (None, None))[0]
            for topic in () if found is not None else self._checker.topics_of_system(of):
                if topic.name.rpartition(".")[2] == name:
                    found = self._symbol_definition(topic)
        elif isinstance(of, typed.ModuleSymbol):
            module = self._symbol_definition(of)
            found = None if module is None else self._controller_named(module, name)
        return found, None if found is None else found.of

    def meaning_of_member(self, of: object, name: str) -> object:
        """The meaning of the member with this name: a type, a symbol or a file."""
        return None if name == "]" else self._member_named(of, name)[1]

    def members_of(self, of: object) -> Iterator[tuple[str, str, str]]:
        """Yields name, detail and kind of every member of a type, a symbol or a file."""
        if isinstance(of, LoadedFile):
            for name, d in self.index.declared_in(of).items():
                if d.kind != "import":
                    yield name, d.kind, d.kind
        elif isinstance(of, RecordType):
            for name, t in of.fields:
                yield name, str(t), "field"
        elif isinstance(of, EnumType):
            for name in of.members:
                yield name, of.name, "member"
        elif isinstance(of, (ArrayType, ListType)):
            yield "len", "int", "len"
        elif isinstance(of, typed.PlantSymbol):
            yield "truth", f"the states of {of.name}", "field"
        elif isinstance(of, typed.SystemSymbol):
            for name, (d, _) in self._instances_inside(self._symbol_definition(of)).items():
                yield name, d.kind, "field"
        elif isinstance(of, typed.ModuleSymbol):
            for node in of.named_nodes:
                yield node.name.rpartition(".")[2], "controller", "field"


def _place(name: tree.Name) -> tuple[int, int]:
    return id(name.span.source), name.span.start


def _symbol_meaning(symbol: object) -> object:
    """The meaning of a declared name: the type of a value; else the symbol itself."""
    if isinstance(symbol, (typed.ConstSymbol, typed.ParamSymbol, typed.TopicSymbol)):
        t: Type = symbol.type
        return t
    return symbol.result if isinstance(symbol, typed.FunSymbol) else symbol


def _field_names(syntax: object) -> list[tree.Name]:
    """The names that a piece of syntax declares as fields, members or states."""
    if isinstance(syntax, tree.TypeDecl):
        return list(syntax.type.members) if isinstance(syntax.type, tree.EnumTypeExpr) else []
    if isinstance(syntax, (tree.RecordTypeExpr, tree.RecordExpr)):
        return [name for name, _ in syntax.fields]
    return [s.name for s in syntax.states] if isinstance(syntax, tree.PlantDecl) else []


def _all_instances(items: tuple[object, ...]) -> list[tree.Instance]:
    """The instances of a system, including those in loops."""
    instances: list[tree.Instance] = []
    for item in items:
        if isinstance(item, tree.Instance):
            instances.append(item)
        elif isinstance(item, tree.Repeated):
            instances += _all_instances(item.items)
    return instances
