"""Resolves names in expressions, types and statements, and finds the shapes of expressions.

Purpose: walks over any piece of syntax once, notes what each name means, and returns the shape of
an expression (`name_definitions.py`), as far as the text shows it.
Non-goals: declarations (`name_resolution.py`); numbers, conversions and errors (`language/check/`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

from soter.diagnostics.diagnostic import Span
from soter.editor.name_definitions import (
    Definition,
    NameIndex,
    PlantTruth,
    Shape,
    UndeclaredArray,
    UndeclaredRecord,
)
from soter.language.check.field import flat_names
from soter.language.load.loader import LoadedFile
from soter.language.syntax import tree

if TYPE_CHECKING:
    Instances = dict[str, tuple[Definition, Definition | None]]


_Method = Callable[["Expressions", Any, "NameContext", "Shape | None"], "Shape | None"]

FIRST = {"abs", "min", "max", "saturate"}
"""Builtin functions whose result has the shape of their first argument; others give numbers."""
RESULTS = {"mode": "Mode", "int": "int"}
BOOLEAN = {"<", "<=", ">", ">=", "==", "!=", "&&", "||"}


@dataclass(frozen=True)
class NameContext:
    """Where an expression stands: its file, visible locals, the instances of a system."""

    file: LoadedFile
    frames: tuple[dict[str, Definition], ...] = ()
    instances: Instances | None = None
    result: Shape | None = field(default=None)
    """The shape of the function's result."""

    def inner(self, frame: dict[str, Definition], result: Shape | None = None) -> NameContext:
        """The same place with one more frame of locals."""
        return replace(self, frames=(*self.frames, frame), result=result or self.result)

    def inside(self, instances: Instances) -> NameContext:
        """The same place inside a system."""
        return replace(self, instances=instances)

    def local(self, name: str) -> Definition | None:
        """The innermost local of that name."""
        return next((f[name] for f in reversed(self.frames) if name in f), None)


class Expressions:
    """The part of the resolver for everything below declarations."""

    def __init__(self, index: NameIndex) -> None:
        self.index = index
        self.prelude: dict[str, Definition] = {}
        self.owner: Definition | None = None
        self._by_name: dict[int, Definition] = {}

    # ------------------------------------------------------------ definitions

    def definition(
        self,
        name: tree.Name,
        kind: str,
        node: object,
        file: LoadedFile,
        shape: Shape | None = None,
    ) -> Definition:
        """The definition that stands at a name; the same one whenever it is asked for."""
        known = self._by_name.get(id(name))
        if known is None:
            known = Definition(name.text, kind, name.word, node, file, shape, self.owner)
            self._by_name[id(name)] = known
        self.index.note(known.span, known)
        return known

    def seen(self, definition: Definition, start: int, end: int) -> None:
        """Notes that a local is visible from `start` to `end`."""
        self.index.reach.setdefault(id(definition.span.source), []).append((start, end, definition))

    # ------------------------------------------------------------ names

    def find(self, ref: tree.Ref, place: NameContext) -> Definition | None:
        """The meaning of a reference."""
        names = self.index.declared_in(place.file)
        if ref.qualifier is None:
            return names.get(ref.name.text) or self.prelude.get(ref.name.text)
        imported = names.get(ref.qualifier.text)
        child = None if imported is None or imported.shape is None else imported.shape.of
        found = self.index.declared_in(child) if isinstance(child, LoadedFile) else {}
        return found.get(ref.name.text)

    def ref(self, ref: tree.Ref, place: NameContext) -> Shape | None:
        """Note a reference; the shape of what it means."""
        if ref.qualifier is not None:
            imported = self.index.declared_in(place.file).get(ref.qualifier.text)
            if imported is not None:
                self.index.note(ref.qualifier.span, imported)
        definition = self.find(ref, place)
        if definition is None:
            return None
        self.index.note(ref.name.span, definition)
        return definition.shape

    def name(self, name: tree.Name, place: NameContext) -> Shape | None:
        """Note the first name of a path or an expression: a local, an instance, a declaration."""
        self.element(name, place)
        definition = place.local(name.text)
        if definition is None and name.text in (place.instances or {}):
            assert place.instances is not None
            definition, what = place.instances[name.text]
            self.index.note(name.word, definition)
            return None if what is None else Shape(what.node, what.file)  # type: ignore[arg-type]
        if definition is None:
            definition = self.find(tree.Ref(None, name, name.span), place)
            definition = definition or self.component(name.text, place)
        if definition is None:
            return Shape("Mode", place.file) if name.text == "Mode" else None
        self.index.note(name.word, definition)
        return definition.shape

    def element(self, name: tree.Name, place: NameContext) -> None:
        """The indices of `r[i]` in a path."""
        if isinstance(name, tree.ElementName):
            self.walk(name.indices, place)

    def path(self, path: tree.DottedPath, place: NameContext) -> Shape | None:
        """Note a dotted path; the shape of its end."""
        first, *rest = path.parts
        return self.below(self.elements(self.name(first, place), first), rest, place)

    def below(
        self, shape: Shape | None, parts: Sequence[tree.Name], place: NameContext
    ) -> Shape | None:
        """Note the names of a path behind its first; the shape of its end."""
        for part in parts:
            self.element(part, place)
            shape = self.elements(self.member(shape, part), part)
        return shape

    def elements(self, shape: Shape | None, name: tree.Name) -> Shape | None:
        """The shape of what the indices behind a name lead to."""
        for _ in name.indices if isinstance(name, tree.ElementName) else ():
            shape = self._inside_of(shape)
        return shape

    # ------------------------------------------------------------ behind a dot

    def member(self, shape: Shape | None, name: tree.Name) -> Shape | None:
        """Note a name behind a dot; the shape of what it means."""
        if shape is None:
            return None
        of, file = self.plain(shape).of, self.plain(shape).file
        definition: Definition | None = None
        if isinstance(of, LoadedFile):
            definition = self._of_import(of, name.text)
        elif isinstance(of, (tree.RecordTypeExpr, UndeclaredRecord, tree.TypeDecl, PlantTruth)):
            kind, parts = _parts(of, file)
            definition = self._part(parts, kind, name.text, file)
        elif isinstance(of, tree.PlantDecl):
            if name.text == "truth":
                return Shape(PlantTruth(of), file)
            driven = [self.find(r, NameContext(file)) for r, _ in of.drives if r.text == name.text]
            drawn = [(d.name, d, Shape(d.type, file)) for d in of.disturbances]
            other = self._part(drawn, "disturbance", name.text, file)
            definition = (*driven, other)[0]
        elif isinstance(of, tree.RtaDecl):
            definition = self.controller(of, name.text, file)
        elif isinstance(of, tree.SystemDecl):
            definition = self._inside_system(of, name.text, file)
        elif name.text == "len":
            return Shape("int", file)
        if definition is None:
            return None
        self.index.note(name.word, definition)
        return definition.shape

    def _of_import(self, file: LoadedFile, name: str) -> Definition | None:
        """What another file declares; its own imports are not reached by way of it."""
        definition = self.index.declared_in(file).get(name)
        return None if definition is None or definition.kind == "import" else definition

    def plain(self, shape: Shape) -> Shape:
        """The shape behind the names of types."""
        for _ in range(64):
            if isinstance(shape.of, tree.UnitTypeExpr):
                shape = Shape(shape.of.base, shape.file)
                continue
            if not isinstance(shape.of, tree.NamedType):
                break
            definition = self.find(shape.of.ref, NameContext(shape.file))
            if definition is None or not isinstance(definition.node, tree.TypeDecl):
                return Shape("Mode" if shape.of.ref.text == "Mode" else "", shape.file)
            if isinstance(definition.node.type, tree.EnumTypeExpr):
                return Shape("enum", definition.file)
            shape = Shape(definition.node.type, definition.file)
        return shape

    def _part(
        self,
        parts: Sequence[tuple[tree.Name, object, Shape | None]],
        kind: str,
        name: str,
        file: LoadedFile,
    ) -> Definition | None:
        """The part of that name; `parts`: name, the syntax that declares it, and its shape."""
        for own, node, shape in parts:
            if own.text == name:
                return self.definition(own, kind, node, file, shape)
        return None

    def controller(self, of: tree.RtaDecl, name: str, file: LoadedFile) -> Definition | None:
        """`M.Fast`: a node of a module."""
        for ref in (of.ac, of.sc):
            if isinstance(ref, tree.Ref) and ref.name.text == name:
                return self.find(ref, NameContext(file))
        return None

    def component(self, name: str, place: NameContext) -> Definition | None:
        """A node of a module of a system, which the system may call by the node's name alone."""
        raise NotImplementedError

    def _inside_system(self, of: tree.SystemDecl, name: str, file: LoadedFile) -> Definition | None:
        """An instance of a sub-system, or a topic that stands beside its instances."""
        if (known := self.instances_of(of, file).get(name)) is not None:
            return known[0]
        homes = [self.index.declared_in(file)]
        homes += [self.index.declared_in(f) for f in file.imports.values() if f is not None]
        return next((h[name] for h in homes if name in h and h[name].kind == "topic"), None)

    def instances_of(self, decl: tree.SystemDecl, file: LoadedFile) -> Instances:
        """The instances of a system by name."""
        raise NotImplementedError

    # ------------------------------------------------------------ any piece of syntax

    def walk(self, piece: object, place: NameContext) -> None:
        """Note all names below a piece of syntax."""
        if isinstance(piece, (tuple, list)):
            for part in piece:
                self.walk(part, place)
        elif isinstance(piece, tree.SyntaxExpr):
            self.expression(piece, place)
        elif isinstance(piece, tree.Ref):
            self.ref(piece, place)
        elif isinstance(piece, tree.DottedPath):
            self.path(piece, place)
        elif isinstance(piece, tree.Block):
            self._block(piece, place)
        elif isinstance(piece, tree.RecordTypeExpr):
            for name, type_ in piece.fields:
                shape = Shape(type_, place.file)
                self.definition(name, "field", (name, type_), place.file, shape)
                self.walk(type_, place)
        elif isinstance(piece, tree.TypeDecl) and isinstance(piece.type, tree.EnumTypeExpr):
            for name in piece.type.members:
                self.definition(name, "member", piece, place.file, Shape("enum", place.file))
        elif hasattr(piece, "__dataclass_fields__") and not isinstance(piece, (Span, tree.Name)):
            self.walk_but(piece, place)

    def walk_but(self, piece: Any, place: NameContext, *done: str) -> None:  # noqa: ANN401 - a node
        """Note all names below the parts of a piece of syntax, but for what was looked at."""
        for part in piece.__dataclass_fields__:
            if part not in done and not part.endswith("span"):
                self.walk(getattr(piece, part), place)

    def _block(self, block: tree.Block, place: NameContext) -> None:
        frame: dict[str, Definition] = {}
        inner = place.inner(frame)
        for s in block.statements:
            if isinstance(s, (tree.LetStmt, tree.VarStmt)):
                self.walk(s.type, inner)
                wanted = None if s.type is None else Shape(s.type, place.file)
                shape = self.expression(s.value, inner, wanted)
                kind = "let" if isinstance(s, tree.LetStmt) else "variable"
                own = self.definition(s.name, kind, s, place.file, wanted or shape)
                frame[s.name.text] = own
                self.seen(own, s.span.end, block.span.end)
            else:
                self._statement(s, inner)

    def _statement(self, s: tree.SyntaxStmt, place: NameContext) -> None:
        if isinstance(s, tree.AssignStmt):
            self.expression(s.value, place, self.expression(s.place, place))
        elif isinstance(s, tree.PushStmt):
            self.expression(s.value, place, self._inside_of(self.expression(s.place, place)))
        elif isinstance(s, tree.PublishStmt):
            self.expression(s.value, place, self.ref(s.topic, place))
        elif isinstance(s, tree.ReturnStmt):
            self.expression(s.value, place, place.result)
        elif isinstance(s, tree.ForRangeStmt):
            self.walk((s.low, s.high), place)
            self._loop(s, Shape("int", place.file), place)
        elif isinstance(s, tree.ForEachStmt):
            self._loop(s, self._inside_of(self.expression(s.sequence, place)), place)
        else:
            self.walk_but(s, place)

    def _loop(
        self, s: tree.ForRangeStmt | tree.ForEachStmt, shape: Shape | None, place: NameContext
    ) -> None:
        own = self.definition(s.name, "loop variable", s, place.file, shape)
        self.seen(own, s.body.span.start, s.body.span.end)
        self._block(s.body, place.inner({s.name.text: own}))

    def _inside_of(self, shape: Shape | None) -> Shape | None:
        """The shape of the elements of a sequence."""
        if shape is None:
            return None
        plain = self.plain(shape)
        if isinstance(plain.of, (tree.ArrayTypeExpr, tree.ListTypeExpr)):
            return Shape(plain.of.element, plain.file)
        if isinstance(plain.of, UndeclaredArray):
            return plain.of.element
        return plain if isinstance(plain.of, tree.Decl) else None  # an array of instances

    # ------------------------------------------------------------ expressions

    def expression(
        self, expr: tree.SyntaxExpr | None, place: NameContext, wanted: Shape | None = None
    ) -> Shape | None:
        """Note the names of an expression; its shape. `wanted`: what is expected there."""
        if expr is None:
            return None
        method = self._EXPRESSIONS.get(type(expr))
        return None if method is None else method(self, expr, place, wanted)

    def _literal(self, expr: tree.SyntaxExpr, place: NameContext, _: Shape | None) -> Shape | None:
        return Shape(_LITERALS[type(expr)], place.file)

    def _name(self, expr: tree.NameExpr, place: NameContext, _: Shape | None) -> Shape | None:
        return self.name(expr.name, place)

    def _dot(self, expr: tree.FieldExpr, place: NameContext, _: Shape | None) -> Shape | None:
        if (names := flat_names(expr)) is not None:
            return self.path(tree.DottedPath(tuple(names), expr.span), place)
        return self.member(self.expression(expr.target, place), expr.field)

    def _index(self, expr: tree.IndexExpr, place: NameContext, _: Shape | None) -> Shape | None:
        self.expression(expr.index, place)
        return self._inside_of(self.expression(expr.target, place))

    def _call(self, expr: tree.CallExpr, place: NameContext, wanted: Shape | None) -> Shape | None:
        names = flat_names(expr.callee)
        definition: Definition | None = None
        if names is not None and len(names) <= 2:
            first = names[0] if len(names) == 2 else None
            ref = tree.Ref(first, names[-1], expr.callee.span)
            self.ref(ref, place)
            definition = self.find(ref, place)
        if definition is not None and isinstance(definition.node, tree.FunDecl):
            types: list[Shape | None] = [
                Shape(t, definition.file) for _, t in definition.node.parameters
            ]
            types += [None] * len(expr.arguments)
            for argument, shape in zip(expr.arguments, types, strict=False):
                self.expression(argument, place, shape)
            return definition.shape
        shapes = [self.expression(a, place, wanted) for a in expr.arguments]
        builtin = names[0].text if names else ""
        if builtin in FIRST and shapes:
            return shapes[0]
        return Shape(RESULTS.get(builtin, "float"), place.file)

    def _unary(
        self, expr: tree.UnaryExpr, place: NameContext, wanted: Shape | None
    ) -> Shape | None:
        return self.expression(expr.operand, place, wanted)

    def _binary(
        self, expr: tree.BinaryExpr, place: NameContext, wanted: Shape | None
    ) -> Shape | None:
        is_test = expr.op in BOOLEAN
        left = self.expression(expr.left, place, None if is_test else wanted)
        right = self.expression(expr.right, place, left if is_test else wanted)
        if is_test:
            return Shape("bool", place.file)
        return right if left is None or self._is_number(left) else left

    def _is_number(self, shape: Shape) -> bool:
        of = self.plain(shape).of
        return isinstance(of, (str, tree.BuiltinType, tree.RangedIntType))

    def _conditional(
        self, expr: tree.ConditionalExpr, place: NameContext, wanted: Shape | None
    ) -> Shape | None:
        self.expression(expr.condition, place)
        then = self.expression(expr.then, place, wanted)
        otherwise = self.expression(expr.otherwise, place, wanted or then)
        return then or otherwise

    def _record(
        self, expr: tree.RecordExpr, place: NameContext, wanted: Shape | None
    ) -> Shape | None:
        if wanted is None:
            return self._undeclared_record(expr, place)
        for name, value in expr.fields:
            self.expression(value, place, self.member(wanted, name))
        return wanted

    def _undeclared_record(self, expr: tree.RecordExpr, place: NameContext) -> Shape:
        """`let p = { x: 1.0 };`: each field is declared where it is written."""
        fields = tuple((name, self.expression(value, place)) for name, value in expr.fields)
        for name, shape in fields:
            self.definition(name, "field", name, place.file, shape)
        return Shape(UndeclaredRecord(fields), place.file)

    def _list(self, expr: tree.ListExpr, place: NameContext, wanted: Shape | None) -> Shape | None:
        """`let all = [a, b];`: where no type is asked for, its elements are as the first one."""
        inside = self._inside_of(wanted)
        shapes = [self.expression(element, place, inside) for element in expr.elements]
        element_shape = next((s for s in shapes if s is not None), None)
        if wanted is not None or element_shape is None:
            return wanted
        return Shape(UndeclaredArray(element_shape, len(shapes)), place.file)

    def _choose(
        self, expr: tree.ChooseExpr, place: NameContext, wanted: Shape | None
    ) -> Shape | None:
        self.walk((expr.type, expr.interval), place)
        shapes = [self.expression(option, place, wanted) for option in expr.options]
        if expr.type is not None:
            return Shape(expr.type, place.file)
        return wanted or next(iter(shapes), None)

    _EXPRESSIONS: ClassVar[dict[type, _Method]] = {
        tree.IntLit: _literal,
        tree.FloatLit: _literal,
        tree.DurationLit: _literal,
        tree.BoolLit: _literal,
        tree.NameExpr: _name,
        tree.FieldExpr: _dot,
        tree.IndexExpr: _index,
        tree.CallExpr: _call,
        tree.UnaryExpr: _unary,
        tree.BinaryExpr: _binary,
        tree.ConditionalExpr: _conditional,
        tree.RecordExpr: _record,
        tree.ListExpr: _list,
        tree.ChooseExpr: _choose,
    }


def _parts(
    of: tree.RecordTypeExpr | UndeclaredRecord | tree.TypeDecl | PlantTruth, file: LoadedFile
) -> tuple[str, list[tuple[tree.Name, object, Shape | None]]]:
    """The kind of the named parts of a thing, and for each its name, syntax and shape."""
    if isinstance(of, tree.RecordTypeExpr):
        return "field", [(own, (own, type_), Shape(type_, file)) for own, type_ in of.fields]
    if isinstance(of, UndeclaredRecord):
        return "field", [(own, own, shape) for own, shape in of.fields]
    if isinstance(of, PlantTruth):
        return "state", [(s.name, s, Shape(s.type, file)) for s in of.plant.states]
    members = of.type.members if isinstance(of.type, tree.EnumTypeExpr) else ()
    return "member", [(own, of, Shape("enum", file)) for own in members]


_LITERALS: dict[type, str] = {
    tree.IntLit: "int",
    tree.FloatLit: "float",
    tree.DurationLit: "duration",
    tree.BoolLit: "bool",
}
