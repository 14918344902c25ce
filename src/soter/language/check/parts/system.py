"""Checks systems and tests: instances, wires, properties, overrides, inputs, times, faults.

Purpose: `SystemChecker` turns `system` declarations into `SystemSymbol`s, and `TestChecker` `test`
declarations into `TestSymbol`s.
Non-goals: items that both share (`system_items.py`); flattening and numbers (`flatten_system.py`,
`language/elaborate/tested_system.py`); exploring (`explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.checker_interface import Context
from soter.language.check.dots_and_brackets import find_instance, names_of_chain
from soter.language.check.expression_base import has_error
from soter.language.check.parts.instances import Unroller, Wires
from soter.language.check.parts.system_items import (
    ItemChecker,
    check_externals,
    enter_measures_and_faults,
    invariant_call,
    mark_path_used,
    path_expr,
)
from soter.language.model import typed
from soter.language.model.types import INT
from soter.language.syntax import tree
from soter.language.syntax.printer import expression_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope

INSTANTIABLE = ("plant", "node", "module", "system")


class SystemChecker(ItemChecker):
    """Checks systems of one program."""

    def __init__(self, shared: Shared) -> None:
        super().__init__(shared)
        self.wires = Wires(shared)
        self.settings: dict[typed.InstanceSymbol, tuple[tree.SetParam, ...]] = {}
        """Instance -> the `set` items in its braces."""

    # ------------------------------------------------------------ instances

    def symbol_of(
        self, decl: tree.SystemDecl, scope: FileScope, full_name: str
    ) -> typed.SystemSymbol:
        """Gives the symbol of a system, with its instances checked so that others may name them."""
        instances: dict[str, typed.InstanceSymbol] = {}
        lost: set[str] = set()
        mark = self.shared.damage_counts()
        unroller = Unroller(self.shared, scope, f"system `{decl.name.text}`", instances)
        placed: list[tuple[typed.InstanceSymbol, tree.Instance, Mapping[str, int]]] = []
        for name, item, values in unroller.named_instances(decl.instances):
            made_of = self._declaration_of_instance(item, scope)
            if made_of is None:
                lost |= {name.text, item.name.text}
                continue
            if made_of in self.shared.damaged:
                self.shared.names.losses += 1
            first = instances.get(name.text)
            if first is not None:
                self._report_instance_twice(name, item, first)
                continue
            if name.text in scope.imports:
                self.diagnostics.warning(
                    "W017",
                    f"the instance `{name.text}` hides the import of the same name",
                    name.span,
                    notes=(f"`{name.text}.` names what is inside the instance here",),
                    helps=(f"give it another name, such as `{name.text}_2`",),
                )
            symbol = typed.InstanceSymbol(name.text, made_of, {}, {}, name.span)
            instances[name.text] = symbol
            placed.append((symbol, item, values))
        if unroller.has_too_many_items:
            lost |= {item.name.text for _, item, _ in placed}
            placed.clear()
            instances.clear()
        self._require_distinct_arrays(instances)
        for symbol, item, values in placed:
            filled = unroller.unrolled_item(item, values)
            if isinstance(filled, tree.Instance):
                self._check_wires(symbol, filled, instances, scope)
                self.settings[symbol] = filled.sets
        whole = self.shared.damage_counts() == mark and decl.name.text not in scope.broken
        if whole and not instances:
            self.diagnostics.error(
                "M006",
                f"system `{decl.name.text}` has nothing in it",
                decl.name.span,
                helps=("add a plant, a node or a module: `c: Cart;`",),
            )
        system = typed.SystemSymbol(
            full_name,
            decl.name.span,
            default=decl.default,
            instances=tuple(instances.values()),
            until=None,
            properties=(),
            forces=(),
            replaces=(),
            sets=(),
            inputs=(),
        )
        if decl.deploys is not None:
            notes = ("`deploys` names the system in which the modules were proved",)
            of = typed.SystemSymbol
            system.deploys = self.referred_symbol(decl.deploys, scope, "system", of, notes=notes)
        self.shared.lost[system] = frozenset(lost)
        self.shared.check_body_later(system, decl, scope)
        return system

    def _declaration_of_instance(
        self, item: tree.Instance, scope: FileScope
    ) -> typed.PlantSymbol | typed.NodeSymbol | typed.ModuleSymbol | typed.SystemSymbol | None:
        entry = self.shared.names.find_ref(scope, item.what, item.kind or "name")
        if entry is None:
            return None
        subject = self.shared.resolve(entry, item.what.span)
        wanted = (item.kind,) if item.kind else INSTANTIABLE
        if entry.kind not in wanted:
            expected = ", ".join(wanted[:-1]) + " or " + wanted[-1] if wanted[1:] else wanted[0]
            helps: tuple[str, ...] = ()
            if entry.kind in {"node", "module"}:
                helps = (f"write `{entry.kind} {item.what.text};`",)
            elif entry.kind in INSTANTIABLE:
                helps = (f"write `name: {item.what.text};`",)
            self.diagnostics.error(
                "N003",
                f"`{item.what.text}` is a {entry.kind}, not a {expected}",
                item.what.span,
                also=((entry.decl.name.span, "declared here"),),
                helps=helps,
            )
            return None
        kinds = (typed.PlantSymbol, typed.NodeSymbol, typed.ModuleSymbol, typed.SystemSymbol)
        return subject if isinstance(subject, kinds) else None

    def _report_instance_twice(
        self, name: tree.Name, item: tree.Instance, first: typed.InstanceSymbol
    ) -> None:
        if first.span == name.span:  # one line of a loop that made the name twice
            also: tuple[tuple[Span, str], ...] = ()
            helps = (f"give every round its own: `{item.name.text}[i]: {item.what.text};`",)
        else:
            also = ((first.span, "first declared here"),)
            helps = (f"give it a name of its own: `{item.name.text}_2: {item.what.text};`",)
        self.diagnostics.error(
            "N002",
            f"instance `{name.text}` is declared twice",
            name.span,
            "declared again here" if also else "declared in every round of the loop",
            also=also,
            helps=helps,
        )

    def _require_distinct_arrays(self, instances: dict[str, typed.InstanceSymbol]) -> None:
        """Reports N002 if `r` is an instance and an array, or an array of one index and of two."""
        seen: dict[str, tuple[int, typed.InstanceSymbol]] = {}
        for name, instance in instances.items():
            base, count = name.partition("[")[0], name.count("[")
            other, first = seen.setdefault(base, (count, instance))
            if other != count:
                self.diagnostics.error(
                    "N002",
                    f"`{first.name}` and `{name}` are two kinds of things called `{base}`",
                    instance.span,
                    also=((first.span, "the first one"),),
                    notes=("the elements of an array all have the same number of indices",),
                )

    def _check_wires(
        self,
        symbol: typed.InstanceSymbol,
        item: tree.Instance,
        instances: dict[str, typed.InstanceSymbol],
        scope: FileScope,
    ) -> None:
        """Checks the wires of an instance, and enters them in its symbol, with their places."""
        renames, spans = symbol.renames, symbol.rename_spans
        for inner_ref, outer_ref in item.renames:
            if self.wires.names_parameter(inner_ref, outer_ref, scope):
                continue
            inner = self.shared.topic_of_ref(inner_ref, scope)
            outer = self.wires.topic_at_far_end(outer_ref, instances, scope)
            if inner is None or outer is None:
                continue
            if self.wires.is_reversed_wire(symbol.what, inner, outer):
                self.wires.report_reversed_wire(inner_ref, outer_ref, outer)
                continue
            if inner.type != outer.type:
                self.diagnostics.error(
                    "T001",
                    f"`{inner_ref.text}` is `{inner.type}`, but `{outer_ref.text}` is "
                    f"`{outer.type}`",
                    outer_ref.span,
                    also=((inner.span, f"`{inner.type}`"), (outer.span, f"`{outer.type}`")),
                    notes=("wired topics are one topic, so they have one type",),
                )
            elif inner in renames:
                self.shared.names.report_repeated(
                    f"`{inner_ref.text}` is wired twice", inner_ref.span, spans[inner]
                )
            else:
                renames[inner] = outer
            spans.setdefault(inner, inner_ref.span)

    # ------------------------------------------------------------ properties and overrides

    def check_body(
        self, system: typed.SystemSymbol, decl: tree.SystemDecl, scope: FileScope
    ) -> None:
        """Checks properties, overrides, inputs and the other items."""
        where = f"system `{decl.name.text}`"
        instances = {i.name: i for i in system.instances}
        system.until = self.check_time(decl.until, Context(scope, where), "`until`")
        lost = self.shared.lost[system]
        context = self.property_context(scope, decl.name.text, instances, lost)
        unroll = Unroller(self.shared, scope, where, instances).unroll
        properties = [self.check_property(p, context) for p in unroll(decl.properties)]
        system.properties = tuple(p for p in properties if p is not None)
        self._enter_forces(system, decl.name.text, unroll(decl.forces))
        system.replaces = tuple(self.check_replacements(unroll(decl.replaces), scope))
        system.inlines = tuple((i.what.text, i.what.span) for i in unroll(decl.inlines))
        inside = [(i.name, s) for i in system.instances for s in self.settings.get(i, ())]
        pairs = [("", s) for s in unroll(decl.sets)]
        system.sets = tuple(self.sets.check_settings([*pairs, *inside], system, scope))
        system.inputs = tuple(self.check_inputs(unroll(decl.inputs), context))
        system.externals = check_externals(self, decl, scope)
        enter_measures_and_faults(self.shared, system, decl, context, unroll(decl.faults))

    def _enter_forces(self, system: typed.SystemSymbol, name: str, items: list[tree.Force]) -> None:
        instances = system.by_name
        forces: dict[str, tuple[str, str, Span]] = {}
        for force in items:
            path = force.module.text
            symbol, depth = find_instance(instances, force.module.parts)
            is_instance = depth == len(force.module.parts)
            if path in forces:
                self.shared.names.report_repeated(
                    f"`{path}` is forced twice", force.module.span, forces[path][2]
                )
            elif is_instance and isinstance(symbol, typed.ModuleSymbol):
                forces[path] = (path, force.to, force.module.span)
            elif system in self.shared.damaged or symbol in self.shared.damaged:
                self.shared.names.losses += 1
            else:
                modules = [
                    n for n, i in instances.items() if isinstance(i.what, typed.ModuleSymbol)
                ]
                self.diagnostics.error(
                    "M013",
                    f"`{path}` is not a module of system `{name}`",
                    force.module.span,
                    notes=("only modules have a mode that can be forced",) if is_instance else (),
                    helps=_module_helps(instances, path)
                    or self.diagnostics.did_you_mean(path, modules, force.module.span),
                )
        system.forces = tuple(forces.values())


def _module_helps(instances: dict[str, typed.InstanceSymbol], node: str) -> tuple[str, ...]:
    """Gives, for the name of a node, a help that names the module to which the node belongs."""
    for name, instance in instances.items():
        symbol = instance.what
        if isinstance(symbol, typed.ModuleSymbol) and node in [n.name for n in symbol.named_nodes]:
            return (f"it is a node of module `{name}`",)
    return ()


class TestChecker(SystemChecker):
    """Checks the systems and tests of one program, in one class because they share items."""

    __test__ = False  # pytest must not collect this class

    def test_symbol_of(
        self, decl: tree.TestDecl, scope: FileScope, full_name: str
    ) -> typed.TestSymbol | None:
        """Gives the symbol of a test with the system it names; None after a reported error."""
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
        test = typed.TestSymbol(full_name, decl.name.span, system, (), None, None, ())
        self.shared.check_body_later(test, decl, scope)
        return test

    def check_test_body(
        self, test: typed.TestSymbol, decl: tree.TestDecl, scope: FileScope
    ) -> None:
        """Checks properties, replacements, times, faults and inputs."""
        name = decl.name.text
        mark = self.shared.damage_counts()
        context = Context(scope, f"test `{name}`")
        instances = test.system.by_name
        unroll = Unroller(self.shared, scope, f"test `{name}`", instances).unroll
        test.skew = self.check_time(decl.skew, context, "`skew`")
        test.horizon = self.check_time(decl.horizon, context, "`horizon`")
        test.quantum = self.check_time(decl.quantum, context, "`quantum`")
        test.replaces = tuple(self.check_replacements(unroll(decl.replaces), scope, in_test=True))
        inside = self.property_context(scope, name, instances, self.shared.lost[test.system])
        properties = [self._test_property(p, inside, test) for p in unroll(decl.properties)]
        test.properties = tuple(p for p in properties if p is not None)
        test.faults = tuple(self._check_fault(f, context) for f in unroll(decl.faults))
        test.inputs = tuple(self.check_inputs(unroll(decl.inputs), inside))
        pairs = [("", s) for s in unroll(decl.sets)]
        test.order = decl.order
        stated = [self._check_stated(s, inside) for s in unroll(decl.stated)]
        test.stated = tuple(s for s in stated if s is not None)
        test.sets = tuple(self.sets.check_settings(pairs, test.system, scope))
        if self.shared.damage_counts() != mark or name in scope.broken:
            self.shared.damaged.add(test)

    def _check_fault(self, item: tree.TimingFaultItem, context: Context) -> typed.FaultSymbol:
        by = self.check_time(item.by, context, "`by`")
        count = self.check_number_if_given(item.at_most, context, INT, "`at most`")
        mark_path_used(item.component, context.scope)
        return typed.FaultSymbol(item.kind, item.component.text, by, count, item.component.span)

    def _check_stated(self, item: tree.StatedValues, context: Context) -> typed.StatedSymbol | None:
        """Checks values that a test states for a topic or field, but not yet who publishes it."""
        mark_path_used(item.topic, context.scope)
        read = self.shared.check_expr(path_expr(item.topic), context)
        if has_error(read):
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
        values = self.check_values(item, read, context, "a stand-in")
        text = f"{item.topic.text} in {{ {', '.join(expression_text(v) for v in item.values)} }}"
        return typed.StatedSymbol(item.kind, read, values, text, item.topic.span)

    # ------------------------------------------------------------ properties

    def _test_property(
        self, item: tree.PropertyItem, context: Context, test: typed.TestSymbol
    ) -> typed.PropertySymbol | None:
        """Checks a property of a test, also `invariant(M)` and `invariants`."""
        call = invariant_call(item, context)
        if call is None or item.kind != "always":
            return self.check_property(item, context)
        text = expression_text(call) if item.in_loop else call.span.text_on_one_line
        if not isinstance(call, tree.CallExpr):
            return typed.PropertySymbol("invariant", None, None, None, text, item.span)
        path = self._module_path(call.arguments[0], context, test)
        if path is None:
            return None
        return typed.PropertySymbol("invariant", None, None, None, text, item.span, path)

    def _module_path(
        self, argument: tree.SyntaxExpr, context: Context, test: typed.TestSymbol
    ) -> str | None:
        """Gives the instance path of the module that an argument means; None after an error."""
        instances = context.instances or {}
        names = names_of_chain(argument) or []
        symbol, depth = find_instance(instances, names)
        if names and depth == len(names) and isinstance(symbol, typed.ModuleSymbol):
            return ".".join(n.text for n in names)
        damaged = self.shared.damaged
        if test.system in damaged or symbol in damaged or (names and names[0].text in context.lost):
            self.shared.names.losses += 1
            return None
        text = expression_text(argument)
        modules = [n for n, i in instances.items() if isinstance(i.what, typed.ModuleSymbol)]
        self.diagnostics.error(
            "M013",
            f"`{text}` is not a module of system `{test.system.name}`",
            argument.span,
            notes=("theorem 3.1 is about a module",),
            helps=self.diagnostics.did_you_mean(text, modules, argument.span),
        )
        return None
