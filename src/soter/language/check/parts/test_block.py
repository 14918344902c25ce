"""Check tests: the tested system, what stands in for its parts, times, faults, properties.

Purpose: `test` declarations -> `TestSymbol`.
Non-goals: flattening and numbers (`tests_and_faults/tested_system.py`), exploring (`explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.checker_interface import Context
from soter.language.check.expression_base import is_error, sound
from soter.language.check.expressions.field import find_instance
from soter.language.check.parts.instance_arrays import Unroller
from soter.language.check.parts.system import (
    SystemChecker,
    invariant_call,
    path_expr,
    source_line,
)
from soter.language.check.parts.system_items import mentioned
from soter.language.model import typed
from soter.language.model.types import INT
from soter.language.syntax import tree
from soter.language.syntax.printer import print_expr

if TYPE_CHECKING:
    from soter.language.check.scope import FileScope


class TestChecker(SystemChecker):
    """Checks systems and tests of one program."""

    __test__ = False  # not a test of pytest's

    def test_signature(
        self, decl: tree.TestDecl, scope: FileScope, full: str
    ) -> typed.TestSymbol | None:
        """A test and the system it names."""
        if decl.system is None:
            if decl.name.text not in scope.broken:
                self.diagnostics.error(
                    "M006",
                    f"test `{decl.name.text}` names no system",
                    decl.name.span,
                    helps=("add `system Name;`",),
                )
            return None
        entry = self.shared.names.find_ref(scope, decl.system)
        system = self.shared.resolve(entry, decl.system.span) if entry else None
        if entry is not None and entry.kind != "system":
            self.diagnostics.error(
                "N003",
                f"`{decl.system.text}` is a {entry.kind}, not a system",
                decl.system.span,
                also=((entry.decl.name.span, "declared here"),),
            )
        if not isinstance(system, typed.SystemSymbol):
            return None
        test = typed.TestSymbol(full, decl.name.span, system, (), None, None, ())
        self.shared.later(test, decl, scope)
        return test

    def test_body(self, test: typed.TestSymbol, decl: tree.TestDecl, scope: FileScope) -> None:
        """Properties, replacements, times, faults, inputs."""
        name = decl.name.text
        mark = self.shared.mark()
        context = Context(scope, f"test `{name}`")
        instances = test.system.by_name
        unroller = Unroller(self.shared, scope, f"test `{name}`", instances)
        test.skew = self.time(decl.skew, context, "`skew`")
        test.horizon = self.time(decl.horizon, context, "`horizon`")
        test.quantum = self.time(decl.quantum, context, "`quantum`")
        test.replaces = tuple(self.replaces(unroller.items(decl.replaces), scope, in_test=True))
        inside = self.inside(scope, name, instances, self.shared.lost[test.system])
        properties = [self._asked(p, inside, test) for p in unroller.items(decl.properties)]
        test.properties = tuple(p for p in properties if p is not None)
        test.faults = tuple(self._fault(f, context) for f in unroller.items(decl.faults))
        test.inputs = tuple(self.inputs(unroller.items(decl.inputs), inside))
        own = [("", s) for s in unroller.items(decl.sets)]
        test.order = decl.order
        stated = [self._stated(s, inside) for s in unroller.items(decl.stated)]
        test.stated = tuple(s for s in stated if s is not None)
        test.sets = tuple(self.sets.all(own, test.system, scope))
        if self.shared.mark() != mark or name in scope.broken:
            self.shared.damaged.add(test)

    def _fault(self, item: tree.TimingFaultItem, context: Context) -> typed.FaultSymbol:
        by = self.time(item.by, context, "`by`")
        at_most = item.at_most
        count = None
        if at_most is not None:
            count = sound(self.shared.number(at_most, context, INT, "`at most`"))
        mentioned(item.component, context.scope)
        return typed.FaultSymbol(item.kind, item.component.text, by, count, item.component.span)

    def _stated(self, item: tree.StatedValues, context: Context) -> typed.StatedSymbol | None:
        """Values of a topic, or of a field of one; what publishes it is for the elaborator."""
        mentioned(item.topic, context.scope)
        read = self.shared.check_expr(path_expr(item.topic), context)
        if is_error(read):
            return None
        target = read
        while isinstance(target, typed.TypedField):
            target = target.target
        if not isinstance(target, typed.TopicRead):
            self.diagnostics.error(
                "E020",
                f"`{item.topic.text}` is no topic, and no field of one",
                item.topic.span,
                notes=("values are stated of what is published",),
            )
            return None
        if not item.values:
            self.diagnostics.error(
                "E002",
                f"there is nothing that `{item.topic.text}` could be",
                item.span,
                "an empty choice",
                helps=("list values, or leave this line out",),
            )
            return None
        values = self.values(item, read, context, "a stand-in")
        text = f"{item.topic.text} in {{ {', '.join(print_expr(v) for v in item.values)} }}"
        return typed.StatedSymbol(item.kind, read, values, text, item.topic.span)

    # ------------------------------------------------------------ properties

    def _asked(
        self, item: tree.PropertyItem, context: Context, test: typed.TestSymbol
    ) -> typed.PropertySymbol | None:
        """A property, invariants by name included."""
        call = invariant_call(item, context)
        if call is None or item.kind != "always":
            return self.property(item, context)
        text = print_expr(call) if item.in_loop else source_line(call)
        if not isinstance(call, tree.CallExpr):
            return typed.PropertySymbol("invariant", None, None, None, text, item.span)
        path = self._module_path(call.arguments[0], context, test)
        if path is None:
            return None
        return typed.PropertySymbol("invariant", None, None, None, text, item.span, path)

    def _module_path(
        self, argument: tree.SyntaxExpr, context: Context, test: typed.TestSymbol
    ) -> str | None:
        """The instance path of the module that is meant, None after a report."""
        instances = context.instances or {}
        names = _names(argument)
        what, depth = find_instance(instances, names)
        if names and depth == len(names) and isinstance(what, typed.ModuleSymbol):
            return ".".join(n.text for n in names)
        damaged = self.shared.damaged
        if test.system in damaged or what in damaged or (names and names[0].text in context.lost):
            self.shared.names.losses += 1
            return None
        text = print_expr(argument)
        modules = [n for n, i in instances.items() if isinstance(i.what, typed.ModuleSymbol)]
        below = [m.name for i in instances.values() for m in getattr(i.what, "below", ())]
        note = "theorem 3.1 is about a module"
        if text in below:
            note = f"`{text}` is below a module, whose invariant holds whatever `{text}` does"
        self.diagnostics.error(
            "M013",
            f"`{text}` is not a module of system `{test.system.name}`",
            argument.span,
            notes=(note,),
            helps=self.diagnostics.did_you_mean(text, modules, argument.span),
        )
        return None


def _names(expr: tree.SyntaxExpr) -> list[tree.Name]:
    """The parts of a dotted path; none where the expression is something else."""
    if isinstance(expr, tree.NameExpr):
        return [expr.name]
    if isinstance(expr, tree.FieldExpr):
        before = _names(expr.target)
        return [*before, expr.field] if before else []
    return []
