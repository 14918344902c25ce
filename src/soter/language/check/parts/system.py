"""Check systems: instances, wiring, properties, overrides, inputs.

Purpose: `system` declarations -> symbols; `test_block.py` builds on it.
Non-goals: flattening and numbers (`elaborator.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.checker_interface import Context
from soter.language.check.expression_base import a_type, is_error, sound
from soter.language.check.expressions.field import find_instance
from soter.language.check.expressions.operators_and_choices import MAX_CHOICES
from soter.language.check.parts.instance_arrays import Unroller
from soter.language.check.parts.system_items import (
    SettingReader,
    Wires,
    campaigned,
    deployed_system,
    externals,
    mentioned,
)
from soter.language.check.unknown_names import is_driven
from soter.language.model import typed
from soter.language.model.types import BOOL, DURATION, has_list
from soter.language.syntax import tree
from soter.language.syntax.printer import print_expr

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope

    Replaced = tuple[str, typed.NodeSymbol | typed.PlantSymbol | typed.ByContract, Span]

INSTANTIABLE = ("plant", "node", "module", "system")


class SystemChecker:
    """Checks systems of one program, and what tests share with them."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared
        self.diagnostics = shared.diagnostics
        self.wires = Wires(shared)
        self.sets = SettingReader(shared)
        self.settings: dict[typed.InstanceSymbol, tuple[tree.SetParam, ...]] = {}
        """What the braces of an instance set."""

    # ------------------------------------------------------------ instances

    def signature(self, decl: tree.SystemDecl, scope: FileScope, full: str) -> typed.SystemSymbol:
        """Instances only: what `other.truth` and sub-systems need."""
        instances: dict[str, typed.InstanceSymbol] = {}
        lost: set[str] = set()
        mark = self.shared.mark()
        unroller = Unroller(self.shared, scope, f"system `{decl.name.text}`", instances)
        placed: list[tuple[typed.InstanceSymbol, tree.Instance, Mapping[str, int]]] = []
        for name, item, values in unroller.names(decl.instances):
            what = self._what(item, scope)
            if what is None:
                lost |= {name.text, item.name.text}
                continue
            if what in self.shared.damaged:
                self.shared.names.losses += 1
            first = instances.get(name.text)
            if first is not None:
                self._instance_twice(name, item, first)
                continue
            if name.text in scope.imports:
                self.diagnostics.warning(
                    "W017",
                    f"the instance `{name.text}` hides the import of the same name",
                    name.span,
                    notes=(f"`{name.text}.` names what is inside the instance here",),
                    helps=(f"give it another name, such as `{name.text}_2`",),
                )
            symbol = typed.InstanceSymbol(name.text, what, {}, {}, name.span)
            instances[name.text] = symbol
            placed.append((symbol, item, values))
        if unroller.too_many:
            lost |= {item.name.text for _, item, _ in placed}
            placed.clear()
            instances.clear()
        self._arrays_apart(instances)
        for symbol, item, values in placed:
            self._inside(symbol, unroller.filled(item, values), instances, scope)
        whole = self.shared.mark() == mark and decl.name.text not in scope.broken
        if whole and not instances:
            self.diagnostics.error(
                "M006",
                f"system `{decl.name.text}` has nothing in it",
                decl.name.span,
                helps=("add a plant, a node or a module: `c: Cart;`",),
            )
        system = typed.SystemSymbol(
            full,
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
        system.deploys = deployed_system(self.shared, decl, scope)
        self.shared.lost[system] = frozenset(lost)
        self.shared.later(system, decl, scope)
        return system

    def _what(
        self, item: tree.Instance, scope: FileScope
    ) -> typed.PlantSymbol | typed.NodeSymbol | typed.ModuleSymbol | typed.SystemSymbol | None:
        entry = self.shared.names.find_ref(scope, item.what, item.kind or "name")
        if entry is None:
            return None
        what = self.shared.resolve(entry, item.what.span)
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
        if isinstance(
            what,
            (
                typed.PlantSymbol,
                typed.NodeSymbol,
                typed.ModuleSymbol,
                typed.SystemSymbol,
            ),
        ):
            return what
        return None

    def _instance_twice(
        self, name: tree.Name, item: tree.Instance, first: typed.InstanceSymbol
    ) -> None:
        if first.span == name.span:  # the same line of a loop, again
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

    def _arrays_apart(self, instances: dict[str, typed.InstanceSymbol]) -> None:
        """N002 where `r` is an instance and an array, or an array of one index and of two."""
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

    def _inside(
        self,
        symbol: typed.InstanceSymbol,
        item: object,
        instances: dict[str, typed.InstanceSymbol],
        scope: FileScope,
    ) -> None:
        """The wires and settings of an instance, once all instances beside it are known."""
        if not isinstance(item, tree.Instance):
            return
        self._renames(symbol, item, instances, scope)
        self.settings[symbol] = item.sets

    def _renames(
        self,
        symbol: typed.InstanceSymbol,
        item: tree.Instance,
        instances: dict[str, typed.InstanceSymbol],
        scope: FileScope,
    ) -> None:
        """The wires of an instance, and where each inner topic is written."""
        renames, spans = symbol.renames, symbol.rename_spans
        for inner_ref, outer_ref in item.renames:
            if self.wires.is_parameter(inner_ref, outer_ref, scope):
                continue
            inner = self.shared.topic_ref(inner_ref, scope)
            outer = self.wires.end(outer_ref, instances, scope)
            if inner is None or outer is None:
                continue
            if self.wires.is_reversed(symbol.what, inner, outer):
                self.wires.backwards(inner_ref, outer_ref, outer)
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
                self._twice(f"`{inner_ref.text}` is wired twice", inner_ref.span, spans[inner])
            else:
                renames[inner] = outer
            spans.setdefault(inner, inner_ref.span)

    def _twice(self, message: str, again: Span, first: Span) -> None:
        self.diagnostics.error("N002", message, again, "again", also=((first, "the first time"),))

    # ------------------------------------------------------------ properties and overrides

    def body(self, system: typed.SystemSymbol, decl: tree.SystemDecl, scope: FileScope) -> None:
        """Properties, overrides, inputs."""
        where = f"system `{decl.name.text}`"
        instances = {i.name: i for i in system.instances}
        system.until = self.time(decl.until, Context(scope, where), "`until`")
        lost = self.shared.lost[system]
        context = self.inside(scope, decl.name.text, instances, lost)
        unroller = Unroller(self.shared, scope, where, instances)
        properties = [self.property(p, context) for p in unroller.items(decl.properties)]
        system.properties = tuple(p for p in properties if p is not None)
        self._forces(system, decl.name.text, unroller.items(decl.forces))
        system.replaces = tuple(self.replaces(unroller.items(decl.replaces), scope))
        system.inlines = tuple((i.what.text, i.what.span) for i in unroller.items(decl.inlines))
        inside = [(i.name, s) for i in system.instances for s in self.settings.get(i, ())]
        own = [("", s) for s in unroller.items(decl.sets)]
        system.sets = tuple(self.sets.all([*own, *inside], system, scope))
        system.inputs = tuple(self.inputs(unroller.items(decl.inputs), context))
        system.externals = externals(self.shared, decl, scope)
        campaigned(self.shared, system, decl, context, unroller.items(decl.faults))

    def time(
        self, expr: tree.SyntaxExpr | None, context: Context, what: str
    ) -> typed.TypedExpr | None:
        """A time, to be computed for each system."""
        return sound(self.shared.number(expr, context, DURATION, what)) if expr else None

    def _forces(
        self,
        system: typed.SystemSymbol,
        name: str,
        items: list[tree.Force],
    ) -> None:
        instances = system.by_name
        forces: dict[str, tuple[str, str, Span]] = {}
        for force in items:
            path = force.module.text
            what, depth = find_instance(instances, force.module.parts)
            whole = depth == len(force.module.parts)
            if path in forces:
                self._twice(f"`{path}` is forced twice", force.module.span, forces[path][2])
            elif whole and isinstance(what, typed.ModuleSymbol):
                forces[path] = (path, force.to, force.module.span)
            elif system in self.shared.damaged or what in self.shared.damaged:
                self.shared.names.losses += 1
            else:
                modules = [
                    n for n, i in instances.items() if isinstance(i.what, typed.ModuleSymbol)
                ]
                self.diagnostics.error(
                    "M013",
                    f"`{path}` is not a module of system `{name}`",
                    force.module.span,
                    notes=("only modules have a mode that can be forced",) if whole else (),
                    helps=_its_module(instances, path)
                    or self.diagnostics.did_you_mean(path, modules, force.module.span),
                )
        system.forces = tuple(forces.values())

    def inside(
        self,
        scope: FileScope,
        name: str,
        instances: dict[str, typed.InstanceSymbol],
        lost: frozenset[str],
    ) -> Context:
        """The place of a property or an input of the system or test called `name`."""
        return Context(
            scope,
            f"a property of `{name}`",
            topics="any",
            has_time=True,
            has_modes=True,
            instances=instances,
            broken=name in scope.broken,
            lost=lost,
        )

    def property(self, item: tree.PropertyItem, context: Context) -> typed.PropertySymbol | None:
        """A property that is an expression, or two."""
        if invariant_call(item, context) is not None:
            self._only_in_a_test(item)
            return None
        check = self.shared.check_expr
        premise = check(item.premise, context, BOOL) if item.premise else None
        condition = check(item.condition, context, BOOL)
        within = self.time(item.within, Context(context.scope, context.where), "`within`")
        if is_error(condition) or (premise is not None and is_error(premise)):
            return None
        read = print_expr if item.in_loop else source_line
        whole = _whole(item) if item.in_loop else ""
        asks = read(item.premise) if item.premise else ""
        parts = (item.kind, premise, condition, within, read(item.condition), item.span)
        return typed.PropertySymbol(*parts, whole=whole, asks=asks)

    def _only_in_a_test(self, item: tree.PropertyItem) -> None:
        self.diagnostics.error(
            "E012",
            f"`{source_line(item.condition)}` can only be asked by a test, with `always`",
            item.condition.span,
            notes=("it speaks about the time since the decision module last looked",),
            helps=("write it in a `test` block: `always invariant(M);`, `always invariants;`",),
        )

    def _by_contract(
        self, item: tree.Replace, replacements: list[Replaced], *, in_test: bool
    ) -> None:
        """`replace M by contract;`, of tests only."""
        if in_test:
            by = typed.ByContract("contract", item.by.span)
            replacements.append((item.what.text, by, item.what.span))
            return
        self.diagnostics.error(
            "E012",
            f"only a test can replace `{item.what.text}` by its contract",
            item.by.span,
            notes=("any value that a contract permits: a test tries them all, a run has none",),
            helps=("write it in a `test` block, or name a node",),
        )

    def replaces(
        self, items: list[tree.Replace], scope: FileScope, *, in_test: bool = False
    ) -> list[Replaced]:
        """`replace A by B;`: what stands in for what."""
        replacements: list[Replaced] = []
        for item in items:
            if item.by.text == "contract" and "contract" not in scope.entries:
                self._by_contract(item, replacements, in_test=in_test)
                mentioned(item.what, scope)
                continue
            entry = self.shared.names.find_ref(scope, item.by)
            symbol = self.shared.resolve(entry, item.by.span) if entry else None
            if isinstance(symbol, (typed.NodeSymbol, typed.PlantSymbol)):
                replacements.append((item.what.text, symbol, item.what.span))
            elif entry is not None and entry.kind not in {"node", "plant"}:
                self.diagnostics.error(
                    "N003",
                    f"`{item.by.text}` is a {entry.kind}, not a node or plant",
                    item.by.span,
                    also=((entry.decl.name.span, "declared here"),),
                )
            mentioned(item.what, scope)
        return replacements

    def inputs(self, items: list[tree.DriveInput], context: Context) -> list[typed.InputSymbol]:
        """`input t [in { values }] every d;`: each an input topic, and once."""
        input_by_topic: dict[typed.TopicSymbol, typed.InputSymbol] = {}
        for item in items:
            every = self.time(item.every, Context(context.scope, context.where), "`every`")
            name = item.topic.parts[0]
            if len(item.topic.parts) == 1 and name.text not in context.scope.entries:
                declared = f"declare it: `input topic {name.text}: float in [-1.0, 1.0];`"
                ref = tree.Ref(None, name, name.span)
                self.shared.names.find_ref(context.scope, ref, "topic", (declared,))
                continue
            read = self.shared.check_expr(path_expr(item.topic), context)
            if is_error(read):
                continue
            if item.values == ():
                self._no_values(item)
                continue
            values = self.values(item, read, context, "an input")
            if not isinstance(read, typed.TopicRead) or not read.topic.input:
                self._no_input(item, read, context.scope)
            elif read.topic in input_by_topic:
                first = input_by_topic[read.topic].span
                self._twice(f"`{item.topic.text}` is drawn twice", item.topic.span, first)
            elif not item.values and has_list(read.type):
                self.diagnostics.error(
                    "T018",
                    f"{a_type(read.type)} cannot be drawn: it has a list inside",
                    item.topic.span,
                    also=((read.topic.span, "declared here"),),
                    helps=("list the values to draw from: `in { ... }`",),
                )
            elif every is not None:
                input_by_topic[read.topic] = typed.InputSymbol(
                    item.topic.text, read.topic, every, item.topic.span, values
                )
        return list(input_by_topic.values())

    def values(
        self,
        item: tree.DriveInput | tree.StatedValues,
        read: typed.TypedExpr,
        context: Context,
        of: str,
    ) -> tuple[typed.TypedExpr, ...]:
        """The declared values `of` an input or a stand-in, numbers of the program."""
        place = Context(context.scope, f"the value of {of}")
        because = (item.topic.span, f"this is {a_type(read.type)}")
        number = self.shared.number
        values = [
            number(v, place, read.type, f"the value of {of}", because) for v in item.values or ()
        ]
        if len(values) > MAX_CHOICES:
            self.diagnostics.error(
                "E004",
                f"{of} of {len(values)} values is too wide",
                item.topic.span,
                f"at most {MAX_CHOICES} are possible",
                notes=("every value is a branch of every execution",),
            )
        return tuple(v for v in values if not is_error(v))

    def _no_values(self, item: tree.DriveInput) -> None:
        self.diagnostics.error(
            "E002",
            f"there is nothing that `{item.topic.text}` could be",
            item.span,
            "an empty choice",
            notes=("an input that changes has at least one value to change to",),
            helps=("list its values, or leave `in { }` out: then they are those of the topic",),
        )

    def _no_input(self, item: tree.DriveInput, read: typed.TypedExpr, scope: FileScope) -> None:
        topic = read.topic if isinstance(read, typed.TopicRead) else None
        name = item.topic.parts[-1].text
        help_ = f"declare it `input topic {name}`"
        if topic and is_driven([e.decl for e in scope.entries.values()], name):
            help_ = "leave this line out: a plant or a node of the program publishes it"
        self.diagnostics.error(
            "M011",
            f"`{item.topic.text}` is not an input topic",
            item.topic.span,
            also=((topic.span, "declared here"),) if topic else (),
            notes=("only topics of the environment are drawn",),
            helps=(help_,) if topic else (),
        )


def path_expr(path: tree.DottedPath) -> tree.SyntaxExpr:
    """The path as an expression."""
    first = path.parts[0]
    expr: tree.SyntaxExpr = tree.NameExpr(first.span, first)
    for part in path.parts[1:]:
        expr = tree.FieldExpr(first.span.to(part.span), expr, part)
    return expr


def _its_module(instances: dict[str, typed.InstanceSymbol], node: str) -> tuple[str, ...]:
    """A help line for a node where its module is meant."""
    for name, instance in instances.items():
        what = instance.what
        if isinstance(what, typed.ModuleSymbol) and node in (what.ac.name, what.sc.name):
            return (f"it is a node of module `{name}`",)
    return ()


def source_line(expr: tree.SyntaxExpr) -> str:
    """The text of an expression, on one line."""
    return " ".join(expr.span.text.split())


def _whole(item: tree.PropertyItem) -> str:
    """The property of a loop as it would be written outside of it."""
    within = f" within {source_line(item.within)}" if item.within is not None else ""
    if item.premise is not None:
        return f"{print_expr(item.premise)} leadsto {print_expr(item.condition)}{within}"
    return f"{item.kind} {print_expr(item.condition)}{within}"


def invariant_call(item: tree.PropertyItem, context: Context) -> tree.SyntaxExpr | None:
    """The condition where it is `invariant(M)` or `invariants`, and nobody declared that name."""
    e = item.condition
    if isinstance(e, tree.CallExpr) and isinstance(e.callee, tree.NameExpr):
        asked = e.callee.name.text == "invariant" and len(e.arguments) == 1
        name = "invariant"
    else:
        asked = isinstance(e, tree.NameExpr) and e.name.text == "invariants"
        name = "invariants"
    taken = name in context.scope.entries or name in (context.instances or {})
    return e if asked and not taken else None
