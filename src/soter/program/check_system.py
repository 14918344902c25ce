"""Check systems and tests: instances, wiring, properties, overrides.

Purpose: `system` and `test` declarations -> symbols.
Non-goals: flattening and numbers (`elaborate.py`), running tests (`explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.check_expr import is_error
from soter.program.context import Context
from soter.program.scope import suggestion
from soter.program.types import (
    BOOL,
    DURATION,
    ArrayType,
    FloatType,
    ListType,
    RecordType,
    is_vector,
)
from soter.syntax import tree

if TYPE_CHECKING:
    from soter.diagnostics.span import Span
    from soter.program.checker import Checker
    from soter.program.scope import FileScope
    from soter.syntax import tree

INSTANTIABLE = {"plant", "node", "module", "system"}


class SystemChecker:
    """Checks systems and tests of one program."""

    def __init__(self, checker: Checker) -> None:
        self.checker = checker
        self.diagnostics = checker.diagnostics

    def signature(self, decl: tree.SystemDecl, scope: FileScope, full: str) -> object:
        """Instances only: what `other.truth` and sub-systems need."""
        instances: list[typed.InstanceSymbol] = []
        for item in decl.instances:
            entry = self.checker.names.find_ref(scope, item.what)
            what = self.checker.resolve(entry, item.what.span) if entry else None
            wanted = {item.kind} if item.kind else INSTANTIABLE
            if entry is not None and entry.kind not in wanted:
                expected = " or ".join(sorted(wanted))
                self.diagnostics.error(
                    "N003",
                    f"`{item.what.text}` is a {entry.kind}, not a {expected}",
                    item.what.span,
                )
                continue
            if what is None:
                continue
            first = next((i for i in instances if i.name == item.name.text), None)
            if first is not None:
                self.diagnostics.error(
                    "N002",
                    f"instance `{item.name.text}` is declared twice",
                    item.name.span,
                    also=((first.span, "first declared here"),),
                )
                continue
            assert isinstance(
                what,
                (typed.PlantSymbol, typed.NodeSymbol, typed.ModuleSymbol, typed.SystemSymbol),
            )
            renames = self._renames(item, scope)
            instances.append(typed.InstanceSymbol(item.name.text, what, renames, item.name.span))
        system = typed.SystemSymbol(
            full, decl.name.span, decl.default, tuple(instances), None, (), (), (), (), ()
        )
        self.checker.later(system, decl, scope)
        return system

    def _renames(
        self, item: tree.Instance, scope: FileScope
    ) -> dict[typed.TopicSymbol, typed.TopicSymbol]:
        renames: dict[typed.TopicSymbol, typed.TopicSymbol] = {}
        for inner_ref, outer_ref in item.renames:
            inner = self.checker.declarations.topic_ref(inner_ref, scope)
            outer = self.checker.declarations.topic_ref(outer_ref, scope)
            if inner is None or outer is None:
                continue
            if inner.type != outer.type:
                self.diagnostics.error(
                    "T001",
                    f"`{inner.name}` is `{inner.type}`, but `{outer.name}` is `{outer.type}`",
                    outer_ref.span,
                )
                continue
            if inner in renames:
                self.diagnostics.error(
                    "N002", f"`{inner_ref.text}` is renamed twice", inner_ref.span
                )
            renames[inner] = outer
        return renames

    def body(self, system: typed.SystemSymbol, decl: tree.SystemDecl, scope: FileScope) -> None:
        """Properties, overrides, inputs."""
        expressions = self.checker.expressions
        plain = Context(scope, f"system `{decl.name.text}`")
        if decl.until is not None:
            until = expressions.check(decl.until, plain, DURATION)
            system.until = None if is_error(until) else until
        instances = {i.name: i for i in system.instances}
        system.properties = tuple(
            p
            for item in decl.properties
            if (p := self._property(item, scope, instances, decl.name.text)) is not None
        )
        system.forces = tuple((f.module.text, f.to, f.span) for f in decl.forces)
        for force in decl.forces:
            if not isinstance(self._find(instances, force.module), typed.ModuleSymbol):
                self.diagnostics.error(
                    "M013",
                    f"`{force.module.text}` is not a module of this system",
                    force.module.span,
                    helps=suggestion(force.module.text, list(instances)),
                )
        system.replaces = tuple(self._replaces(decl.replaces, scope))
        system.sets = tuple(self._sets(decl, scope, plain))
        system.inputs = tuple(self._inputs(decl, scope, instances))

    def _find(
        self, instances: dict[str, typed.InstanceSymbol], path: tree.Path
    ) -> object:
        what: object = None
        for part in path.parts:
            instance = instances.get(part.text)
            if instance is None:
                return None
            what = instance.what
            instances = (
                {i.name: i for i in what.instances} if isinstance(what, typed.SystemSymbol) else {}
            )
        return what

    def _property(
        self,
        item: tree.Property,
        scope: FileScope,
        instances: dict[str, typed.InstanceSymbol],
        name: str,
    ) -> typed.PropertySymbol | None:
        context = Context(
            scope, f"a property of `{name}`", topics="any", has_time=True, has_modes=True,
            instances=instances,
        )
        expressions = self.checker.expressions
        premise = expressions.check(item.premise, context, BOOL) if item.premise else None
        condition = expressions.check(item.condition, context, BOOL)
        within = expressions.check(item.within, context, DURATION) if item.within else None
        if is_error(condition) or (premise is not None and is_error(premise)):
            return None
        return typed.PropertySymbol(
            item.kind, premise, condition, within, " ".join(item.condition.span.text.split()),
            item.span,
        )

    def _replaces(
        self, items: tuple[tree.Replace, ...], scope: FileScope
    ) -> list[tuple[str, typed.NodeSymbol | typed.PlantSymbol, Span]]:
        found: list[tuple[str, typed.NodeSymbol | typed.PlantSymbol, Span]] = []
        for item in items:
            entry = self.checker.names.find_ref(scope, item.by)
            symbol = self.checker.resolve(entry, item.by.span) if entry else None
            if isinstance(symbol, (typed.NodeSymbol, typed.PlantSymbol)):
                found.append((item.what.text, symbol, item.span))
            elif entry is not None and symbol is not None:
                self.diagnostics.error(
                    "N003", f"`{item.by.text}` is a {entry.kind}, not a node or plant", item.by.span
                )
        # a name that is only replaced counts as used
        for item in items:
            for part in item.what.parts:
                if part.text in scope.entries:
                    scope.entries[part.text].used = True
        return found

    def _sets(
        self, decl: tree.SystemDecl, scope: FileScope, context: Context
    ) -> list[tuple[typed.ParamSymbol, typed.Expr, Span]]:
        found: list[tuple[typed.ParamSymbol, typed.Expr, Span]] = []
        for item in decl.sets:
            entry = self.checker.names.find_ref(scope, item.param)
            symbol = self.checker.resolve(entry, item.param.span) if entry else None
            if entry is not None and entry.kind != "parameter":
                self.diagnostics.error(
                    "N003", f"`{item.param.text}` is a {entry.kind}, not a parameter",
                    item.param.span,
                )
            expected = symbol.type if isinstance(symbol, typed.ParamSymbol) else None
            value = self.checker.expressions.check(item.value, context, expected)
            if isinstance(symbol, typed.ParamSymbol) and not is_error(value):
                found.append((symbol, value, item.span))
        return found

    def _inputs(
        self,
        decl: tree.SystemDecl,
        scope: FileScope,
        instances: dict[str, typed.InstanceSymbol],
    ) -> list[typed.InputSymbol]:
        context = Context(scope, f"system `{decl.name.text}`", topics="any", instances=instances)
        found: list[typed.InputSymbol] = []
        for item in decl.inputs:
            every = self.checker.expressions.check(item.every, context, DURATION)
            expr = _path_expr(item.topic)
            read = self.checker.expressions.check(expr, context)
            if is_error(every, read):
                continue
            if not isinstance(read, typed.TopicRead) or not read.topic.input:
                self.diagnostics.error(
                    "M011", f"`{item.topic.text}` is not an `input topic`", item.topic.span
                )
                continue
            t = read.type
            if not isinstance(t, FloatType) and not is_vector(t) and _has_list(t):
                self.diagnostics.error("T018", f"`{t}` cannot be drawn", item.topic.span)
                continue
            found.append(typed.InputSymbol(item.topic.text, read.topic, every, item.span))
        return found

    # ------------------------------------------------------------ tests

    def test_signature(self, decl: tree.TestDecl, scope: FileScope, full: str) -> object:
        """A test and the system it names."""
        if decl.system is None:
            self.diagnostics.error(
                "M006", f"test `{decl.name.text}` names no system", decl.name.span
            )
            return None
        entry = self.checker.names.find_ref(scope, decl.system)
        system = self.checker.resolve(entry, decl.system.span) if entry else None
        if entry is not None and entry.kind != "system":
            self.diagnostics.error(
                "N003", f"`{decl.system.text}` is a {entry.kind}, not a system", decl.system.span
            )
        if not isinstance(system, typed.SystemSymbol):
            return None
        test = typed.TestSymbol(full, decl.name.span, system, (), None, None, ())
        self.checker.later(test, decl, scope)
        return test

    def test_body(self, test: typed.TestSymbol, decl: tree.TestDecl, scope: FileScope) -> None:
        """Properties, replacements, bounds."""
        context = Context(scope, f"test `{decl.name.text}`")
        instances = {i.name: i for i in test.system.instances}
        expressions = self.checker.expressions
        test.skew = expressions.check(decl.skew, context, DURATION) if decl.skew else None
        test.horizon = expressions.check(decl.horizon, context, DURATION) if decl.horizon else None
        test.replaces = tuple(self._replaces(decl.replaces, scope))
        test.properties = tuple(
            p
            for item in decl.properties
            if (p := self._property(item, scope, instances, decl.name.text)) is not None
        )


def _path_expr(path: tree.Path) -> tree.Expr:
    expr: tree.Expr = tree.NameExpr(path.parts[0].span, path.parts[0])
    for part in path.parts[1:]:
        expr = tree.FieldExpr(path.span, expr, part)
    return expr


def _has_list(t: object) -> bool:
    if isinstance(t, ListType):
        return True
    if isinstance(t, ArrayType):
        return _has_list(t.element)
    return isinstance(t, RecordType) and any(_has_list(f) for _, f in t.fields)
