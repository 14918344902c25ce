"""Finds what every name of a program means, from its syntax trees alone.

Purpose: makes an index also of unfinished programs: names that it cannot resolve are left out. The
rules are those of `language/check/` (own file, then prelude; locals first); a test compares both.
Non-goals: reporting errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from soter.diagnostics.diagnostic import Span
from soter.editor.expression_names import Expressions, NameContext
from soter.editor.name_definitions import (
    Definition,
    NameIndex,
    PlantTruth,
    Shape,
    UndeclaredArray,
    UndeclaredRecord,
)
from soter.language.check.scope import KINDS
from soter.language.load.loader import LoadedFile, LoadedProgram
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


Instances = dict[str, "tuple[Definition, Definition | None]"]


def index_of(loaded: LoadedProgram) -> NameIndex:
    """The names of a program: of all its files, and what the prelude declares."""
    return _Resolver(NameIndex((*loaded.files, *loaded.prelude))).run()


class Members:
    """Finds members, the names after a dot, in a finished index."""

    def __init__(self, index: NameIndex) -> None:
        self._walker = _Resolver.over(index)

    def after(self, shape: Shape | None, name: str) -> Shape | None:
        """The shape of a member."""
        if shape is not None and name == "]":
            return None
        source = self._walker.index.files[0].source
        return self._walker.member(shape, tree.Name(name, Span(source, 0, 0)))

    def inside(self, shape: Shape | None) -> Iterator[tuple[str, str, str]]:
        """Yields name, detail and kind of every member."""
        if shape is None:
            return
        shape = self._walker.plain(shape)
        of = shape.of
        if isinstance(of, (PlantTruth, tree.Decl)):
            yield from self._declared_inside(of, shape.file)
        elif isinstance(of, LoadedFile):
            for name, d in self._walker.index.declared_in(of).items():
                if d.kind != "import":
                    yield name, d.kind, d.kind
        elif isinstance(of, tree.RecordTypeExpr):
            for own, type_ in of.fields:
                yield own.text, " ".join(type_.span.text.split()), "field"
        elif isinstance(of, UndeclaredRecord):
            for own, _ in of.fields:
                yield own.text, "field", "field"
        elif isinstance(of, (tree.ArrayTypeExpr, tree.ListTypeExpr, UndeclaredArray)):
            yield "len", "int", "len"

    def _declared_inside(
        self, of: PlantTruth | tree.Decl, file: LoadedFile
    ) -> Iterator[tuple[str, str, str]]:
        """Yields the members of a declaration."""
        if isinstance(of, tree.TypeDecl) and isinstance(of.type, tree.EnumTypeExpr):
            for own in of.type.members:
                yield own.text, of.name.text, "member"
        elif isinstance(of, PlantTruth):
            for state in of.plant.states:
                yield state.name.text, " ".join(state.type.span.text.split()), "state"
        elif isinstance(of, tree.PlantDecl):
            yield "truth", f"the states of {of.name.text}", "field"
        elif isinstance(of, tree.SystemDecl):
            for name, (d, _) in self._walker.instances_of(of, file).items():
                yield name, d.kind, "field"
        elif isinstance(of, tree.RtaDecl):
            for ref in (of.ac, of.sc):
                if isinstance(ref, tree.Ref):
                    yield ref.name.text, "controller", "field"


class _Resolver(Expressions):
    """One pass over all trees; declarations first, so that order does not matter."""

    def __init__(self, index: NameIndex) -> None:
        super().__init__(index)
        self.files = [f for f in index.files if not f.prelude]

    @classmethod
    def over(cls, index: NameIndex) -> _Resolver:
        """A resolver that only looks names up in a finished index."""
        made = cls(NameIndex(index.files, index.top, dict(index.instances)))
        for file in index.files:
            if file.prelude:
                made.prelude.update(index.declared_in(file))
        return made

    def run(self) -> NameIndex:
        for file in reversed(self.index.files):
            self._enter(file)
        for file in self.files:
            for name, child in file.imports.items():
                definition = self.index.top[id(file)].get(name)
                if definition is not None and child is not None:
                    definition.shape = Shape(child, file)
        for file in self.files:
            for decl in file.file.declarations:
                own = self.index.top[id(file)][decl.name.text]
                self.owner = own
                if own.span != decl.name.span:  # declared twice: the second one is looked at, too
                    self.definition(decl.name, KINDS[type(decl).__name__], decl, file)
                self._declaration(decl, NameContext(file))
        return self.index

    def _enter(self, file: LoadedFile) -> None:
        names = self.index.top[id(file)] = {}
        self.owner = None
        for imported in file.file.imports:
            names.setdefault(
                imported.name.text, self.definition(imported.name, "import", imported, file)
            )
        for decl in file.file.declarations:
            if decl.name.text in names and names[decl.name.text].kind != "import":
                continue
            names[decl.name.text] = self.definition(
                decl.name, KINDS[type(decl).__name__], decl, file, self._shape(decl, file)
            )
        if file.prelude:
            self.prelude.update(names)

    def _shape(self, decl: tree.Decl, file: LoadedFile) -> Shape:
        if isinstance(decl, (tree.ConstDecl, tree.ParamDecl, tree.TopicDecl)):
            return Shape(decl.type, file)
        return Shape(decl.result if isinstance(decl, tree.FunDecl) else decl, file)

    # ------------------------------------------------------------ declarations

    def _declaration(self, decl: tree.Decl, place: NameContext) -> None:
        method = self._DECLARATIONS.get(type(decl))
        if method is None:
            self.walk(decl, place)
        else:
            method(self, decl, place)

    def _typed(
        self, decl: tree.ConstDecl | tree.ParamDecl | tree.TopicDecl, place: NameContext
    ) -> None:
        """A constant, parameter or topic: its values have its type."""
        self.walk(decl.type, place)
        wanted = Shape(decl.type, place.file)
        for name in ("value", "default"):
            self.expression(getattr(decl, name, None), place, wanted)
        self.walk(getattr(decl, "interval", None), place)
        self.walk(getattr(decl, "max_age", None), place)
        if isinstance(decl, tree.TopicDecl) and decl.values is not None:
            self._values(decl.values, place, wanted)

    def _values(self, values: tree.ValueSet, place: NameContext, shape: Shape | None) -> None:
        if isinstance(values, tree.IntervalExpr):
            self.walk(values, place)
            return
        for name, inner in values.fields:
            self._values(inner, place, self.member(shape, name))

    def _fun(self, decl: tree.FunDecl, place: NameContext) -> None:
        frame: dict[str, Definition] = {}
        for name, type_ in decl.parameters:
            self.walk(type_, place)
            shape = Shape(type_, place.file)
            self._local(frame, name, "argument", (name, type_), place, shape, decl.span)
        self.walk(decl.result, place)
        self.walk(decl.body, place.inner(frame, result=Shape(decl.result, place.file)))

    def _node(self, decl: tree.NodeDecl, place: NameContext) -> None:
        self._law(decl.failsafe, place)
        frame: dict[str, Definition] = {}
        for local in decl.locals:
            self.walk(local.type, place)
            shape = Shape(local.type, place.file)
            self.expression(local.initial, place, shape)
            self._local(frame, local.name, "variable", local, place, shape, decl.span)
        self.walk((decl.takeover, decl.step), place.inner(frame))
        self.walk_but(decl, place, "failsafe", "locals", "takeover", "step")

    def _law(self, law: tuple[tuple[tree.Ref, tree.SyntaxExpr], ...], place: NameContext) -> None:
        for ref, value in law:
            self.expression(value, place, self.ref(ref, place))

    def _plant(self, decl: tree.PlantDecl, place: NameContext) -> None:
        self.walk((decl.period, decl.reads), place)
        frame: dict[str, Definition] = {}
        inner = place.inner(frame)
        for state in decl.states:
            self.walk((state.type, state.interval), place)
            shape = Shape(state.type, place.file)
            self.expression(state.initial, place, shape)
            self._local(frame, state.name, "state", state, place, shape, decl.span)
        for d in decl.disturbances:
            self.walk((d.type, d.interval, d.hold), place)
            shape = Shape(d.type, place.file)
            self._local(frame, d.name, "disturbance", d, place, shape, decl.span)
        for let in decl.lets:
            self.walk(let.type, place)
            wanted = None if let.type is None else Shape(let.type, place.file)
            value_shape = self.expression(let.value, inner, wanted)
            self._local(frame, let.name, "let", let, place, wanted or value_shape, decl.span)
        for rules in (decl.der, decl.next):
            for name, value in rules:
                own = frame.get(name.text)
                if own is not None:
                    self.index.note(name.span, own)
                self.expression(value, inner, own.shape if own is not None else None)
        for ref, drive in decl.drives:
            self.expression(drive, inner, self.ref(ref, place))
        self.walk(decl.measured, place)
        self.walk(decl.integrate[1] if decl.integrate else None, place)

    # ------------------------------------------------------------ modules

    def _rta(self, decl: tree.RtaDecl, place: NameContext) -> None:
        self._law(decl.failsafe, place)
        for clause in decl.contract:
            self.definition(clause.name, "clause", clause, place.file)
        self.walk_but(decl, place, "failsafe", "verify")
        if decl.verify is not None:
            self._verify(decl.verify, place.inside(self._beside(decl)))

    def _beside(self, module: tree.RtaDecl) -> Instances:
        """The instances of all systems that have the module."""
        all_instances: Instances = {}
        for file in self.files:
            for decl in file.file.declarations:
                if isinstance(decl, tree.SystemDecl):
                    instances = self.instances_of(decl, file)
                    if any(w is not None and w.node is module for _, w in instances.values()):
                        all_instances = {**instances, **all_instances}
        return all_instances

    def _verify(self, block: tree.VerifyBlock | tree.View, place: NameContext) -> None:
        axes: dict[str, Definition] = {}
        for instance, parts in block.abstracts:
            if (known := (place.instances or {}).get(instance.text)) is not None:
                self.index.note(instance.span, known[0])
            for part in parts:
                plant = self.ref(part.plant, place)
                axes[part.name.text] = self.definition(part.name, "axis", part, place.file, plant)
                self.expression(part.value, place, _truth(plant))
        for group in block.groups:
            for axis in group.axes:
                self._axis(axis, axes, place)
        if isinstance(block, tree.View):
            return
        for view in block.views:
            self.definition(view.name, "view", view, place.file)
            self._verify(view, place)
        self.walk_but(block, place, "groups", "abstracts", "views")

    def _axis(self, axis: tree.GridAxis, axes: dict[str, Definition], place: NameContext) -> None:
        first, *rest = axis.path.parts
        known = axes.get(first.text)
        is_declared = first.text in self.index.declared_in(place.file)
        if known is None and not is_declared:
            known = (place.instances or {}).get(first.text, (None, None))[0]
        if known is None:
            self.path(axis.path, NameContext(place.file) if is_declared else place)
        else:
            self.index.note(first.span, known)
            self.below(_truth(known.shape), rest, place)
        self.walk((axis.interval, axis.cells, axis.open), place)

    # ------------------------------------------------------------ systems and tests

    def _system(self, decl: tree.SystemDecl, place: NameContext) -> None:
        inside = place.inside(self.instances_of(decl, place.file))
        for measure in decl.measures:
            self.definition(measure.name, "measure", measure, place.file)
        self.walk(decl.deploys, place)
        self._all_items(decl, inside, "deploys")

    def _instance(self, item: tree.Instance, place: NameContext) -> None:
        self.element(item.name, place)
        self.ref(item.what, place)
        for inner, outer in item.renames:
            self.ref(inner, place)
            self.path(outer, place)
        for setting in item.sets:
            self._setting(setting, place, self.find(item.what, place))

    def _setting(
        self, item: tree.SetParam, place: NameContext, home: Definition | None = None
    ) -> None:
        """`set r[0].K = 3;`: an instance, and a parameter of this file or of an import."""
        parts = list(item.param.parts)
        inside = place.instances or {}
        if home is not None:
            is_system = isinstance(home.node, tree.SystemDecl)
            inside = self.instances_of(home.node, home.file) if is_system else {}  # type: ignore[arg-type]
        while len(parts) > 1 and parts[0].text in inside:
            instance, what = inside[parts[0].text]
            self.element(parts[0], place)
            self.index.note(parts[0].word, instance)
            parts.pop(0)
            is_system = what is not None and isinstance(what.node, tree.SystemDecl)
            inside = self.instances_of(what.node, what.file) if is_system else {}  # type: ignore[arg-type,union-attr]
        shape = None
        if len(parts) <= 2:
            first = parts[0] if len(parts) == 2 else None
            shape = self.ref(tree.Ref(first, parts[-1], item.param.span), place)
        self.expression(item.value, place, shape)

    def _test(self, decl: tree.TestDecl, place: NameContext) -> None:
        inside = place
        if decl.system is not None:
            self.ref(decl.system, place)
            system = self.find(decl.system, place)
            if system is not None and isinstance(system.node, tree.SystemDecl):
                inside = place.inside(self.instances_of(system.node, system.file))
        self._all_items(decl, inside, "system")

    def _all_items(self, decl: tree.Decl, place: NameContext, *done: str) -> None:
        """The items of a system or a test, but for what was looked at already."""
        for field in decl.__dataclass_fields__:
            items = getattr(decl, field)
            if isinstance(items, tuple):
                self._items(items, place, decl)
            elif field not in done:
                self.walk(items, place)

    def _items(self, items: tuple[object, ...], place: NameContext, decl: tree.Decl) -> None:
        """Items of a system or a test, loops included; instances were seen before."""
        for item in items:
            if isinstance(item, tree.Repeated):
                self.walk((item.low, item.high), place)
                frame: dict[str, Definition] = {}
                int_ = Shape("int", place.file)
                self._local(frame, item.name, "loop variable", item, place, int_, item.span)
                self._items(item.items, place.inner(frame), decl)
            elif isinstance(item, tree.SetParam):
                self._setting(item, place)
            elif isinstance(item, tree.Instance):
                self._instance(item, place)
            else:
                self.walk(item, place)

    def component(self, name: str, place: NameContext) -> Definition | None:
        """A node of a module of a system, which the system may call by the node's name alone."""
        for _, what in (place.instances or {}).values():
            if what is None:
                continue
            if isinstance(what.node, tree.RtaDecl):
                definition = self.controller(what.node, name, what.file)
            elif isinstance(what.node, tree.SystemDecl):
                below = place.inside(self.instances_of(what.node, what.file))
                definition = self.component(name, below)
            else:
                definition = None
            if definition is not None:
                return definition
        return None

    def instances_of(self, decl: tree.SystemDecl, file: LoadedFile) -> Instances:
        """The instances of a system by name. One that is named like what it is has no own name."""
        if (known := self.index.instances.get(id(decl))) is not None:
            return known
        instances: Instances = {}
        self.index.instances[id(decl)] = instances
        place = NameContext(file)
        outer, self.owner = self.owner, self.index.declared_in(file).get(decl.name.text)
        for item in _unrolled(decl.instances):
            what = self.find(item.what, place)
            if item.kind is not None and what is not None:
                instances[item.name.text] = what, what
            elif item.kind is None:
                shape = None if what is None else Shape(what.node, what.file)  # type: ignore[arg-type]
                if (first := instances.get(item.name.text)) is not None:
                    self.index.note(item.name.word, first[0])
                    continue
                own = self.definition(item.name, "instance", item, file, shape)
                instances[item.name.text] = own, what
        self.owner = outer
        return instances

    _DECLARATIONS: ClassVar[dict[type, Callable[[_Resolver, Any, NameContext], None]]] = {
        tree.ConstDecl: _typed,
        tree.ParamDecl: _typed,
        tree.TopicDecl: _typed,
        tree.FunDecl: _fun,
        tree.NodeDecl: _node,
        tree.PlantDecl: _plant,
        tree.RtaDecl: _rta,
        tree.SystemDecl: _system,
        tree.TestDecl: _test,
    }

    def _local(
        self,
        frame: dict[str, Definition],
        name: tree.Name,
        kind: str,
        node: object,
        place: NameContext,
        shape: Shape | None,
        seen_in: Span,
    ) -> None:
        definition = self.definition(name, kind, node, place.file, shape)
        frame[name.text] = definition
        self.seen(definition, seen_in.start, seen_in.end)


def _truth(shape: Shape | None) -> Shape | None:
    """The states of the plant that a shape is of."""
    if shape is None or not isinstance(shape.of, tree.PlantDecl):
        return None
    return Shape(PlantTruth(shape.of), shape.file)


def _unrolled(items: tuple[object, ...]) -> list[tree.Instance]:
    """The instances of a system, those in loops included."""
    instances: list[tree.Instance] = []
    for item in items:
        if isinstance(item, tree.Instance):
            instances.append(item)
        elif isinstance(item, tree.Repeated):
            instances += _unrolled(item.items)
    return instances
