"""Check declarations: signatures first, bodies when every signature is known.

Purpose: one method a kind of declaration, syntax -> symbol.
Non-goals: name look-up order (`scope.py`), numbers (`elaborate.py`), P1 (`wellformed.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.check_expr import is_error
from soter.program.check_plant import PlantChecker
from soter.program.check_stmt import always_returns
from soter.program.check_system import SystemChecker
from soter.program.context import Context
from soter.program.types import (
    BOOL,
    DURATION,
    FLOAT,
    INT,
    ArrayType,
    DurationType,
    EnumType,
    ErrorType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.syntax import tree

if TYPE_CHECKING:
    from soter.diagnostics.span import Span
    from soter.program.checker import Checker
    from soter.program.scope import Entry, FileScope
    from soter.program.types import Type

BINDING_KINDS = ("python", "c")


class DeclChecker:
    """Checks declarations of one program."""

    def __init__(self, checker: Checker) -> None:
        self.checker = checker
        self.diagnostics = checker.diagnostics
        self.lazy_bodies: dict[typed.FunSymbol, tuple[tree.FunDecl, FileScope]] = {}
        self.plants = PlantChecker(checker)
        self.systems = SystemChecker(checker)

    def topics_of(self, system: typed.SystemSymbol) -> list[typed.TopicSymbol]:
        """All topics that the instances of a system mention, renames applied."""
        found: dict[typed.TopicSymbol, None] = {}
        for instance in system.instances:
            for topic in topics_of(instance.what, self):
                found.setdefault(instance.renames.get(topic, topic))
        return list(found)

    def symbol(self, entry: Entry) -> object:
        """The symbol of any declaration, or None when it is too broken."""
        decl, scope = entry.decl, entry.scope
        if isinstance(decl, tree.TypeDecl):
            return self._type(decl, scope, entry.full_name)
        if isinstance(decl, tree.ConstDecl):
            return self._const(decl, scope, entry.full_name)
        if isinstance(decl, tree.ParamDecl):
            return self._param(decl, scope, entry.full_name)
        if isinstance(decl, tree.FunDecl):
            return self._fun(decl, scope, entry.full_name)
        if isinstance(decl, tree.TopicDecl):
            return self._topic(decl, scope, entry.full_name)
        if isinstance(decl, tree.NodeDecl):
            return self._node(decl, scope, entry.full_name)
        if isinstance(decl, tree.RtaDecl):
            return self._rta(decl, scope, entry.full_name)
        if isinstance(decl, tree.PlantDecl):
            return self.plants.signature(decl, scope, entry.full_name)
        if isinstance(decl, tree.SystemDecl):
            return self.systems.signature(decl, scope, entry.full_name)
        if isinstance(decl, tree.TestDecl):
            return self.systems.test_signature(decl, scope, entry.full_name)
        return None

    def body(self, symbol: object, decl: tree.Decl, scope: FileScope) -> None:
        """The part of a declaration that may mention everything else."""
        if isinstance(symbol, typed.NodeSymbol) and isinstance(decl, tree.NodeDecl):
            self._node_body(symbol, decl, scope)
        elif isinstance(symbol, typed.ModuleSymbol) and isinstance(decl, tree.RtaDecl):
            self._rta_body(symbol, decl, scope)
        elif isinstance(symbol, typed.PlantSymbol) and isinstance(decl, tree.PlantDecl):
            self.plants.body(symbol, decl, scope)
        elif isinstance(symbol, typed.SystemSymbol) and isinstance(decl, tree.SystemDecl):
            self.systems.body(symbol, decl, scope)
        elif isinstance(symbol, typed.TestSymbol) and isinstance(decl, tree.TestDecl):
            self.systems.test_body(symbol, decl, scope)

    # ------------------------------------------------------------ types, constants, parameters

    def _type(self, decl: tree.TypeDecl, scope: FileScope, full: str) -> object:
        if isinstance(decl.type, tree.EnumTypeExpr):
            names = [m.text for m in decl.type.members]
            for i, member in enumerate(decl.type.members):
                if member.text in names[:i]:
                    self.diagnostics.error(
                        "N002", f"member `{member.text}` is declared twice", member.span
                    )
            return EnumType(full, tuple(dict.fromkeys(names)))
        t = self.checker.type_of(decl.type, scope)
        if isinstance(t, RecordType):
            return RecordType(t.fields, full)
        return t

    def _const(self, decl: tree.ConstDecl, scope: FileScope, full: str) -> object:
        t = self.checker.type_of(decl.type, scope)
        if isinstance(t, ErrorType):
            return None
        if decl.data is not None:
            value = self.checker.data(decl, t, scope)
        elif decl.value is not None:
            value = self.checker.constant(decl.value, scope, t, f"constant `{decl.name.text}`")
        else:
            return None
        if value is None:
            return None
        return typed.ConstSymbol(full, decl.name.span, t, value)

    def _param(self, decl: tree.ParamDecl, scope: FileScope, full: str) -> object:
        t = self.checker.type_of(decl.type, scope)
        if isinstance(t, ErrorType):
            return None
        if not isinstance(t, (FloatType, IntType, DurationType, EnumType)) and t is not BOOL:
            self.diagnostics.error(
                "T018", f"a parameter is a scalar, not `{t}`", decl.type.span
            )
            return None
        context = Context(scope, f"parameter `{decl.name.text}`", constant=True)
        default = self.checker.expressions.check(decl.default, context, t)
        low = high = None
        if decl.interval is not None:
            if not isinstance(t, (FloatType, IntType, DurationType)):
                self.diagnostics.error("V004", f"`{t}` has no order", decl.interval.span)
            else:
                low = self.checker.expressions.check(decl.interval.low, context, t)
                high = self.checker.expressions.check(decl.interval.high, context, t)
                if is_error(low, high):
                    low = high = None
        if is_error(default):
            return None
        return typed.ParamSymbol(full, decl.name.span, t, default, low, high)

    # ------------------------------------------------------------ functions

    def _fun(self, decl: tree.FunDecl, scope: FileScope, full: str) -> object:
        parameters = []
        seen: set[str] = set()
        for name, type_expr in decl.parameters:
            t = self.checker.type_of(type_expr, scope)
            if name.text in seen:
                self.diagnostics.error(
                    "N002", f"parameter `{name.text}` is declared twice", name.span
                )
            seen.add(name.text)
            if isinstance(t, DurationType):
                self.checker._no_duration(type_expr)  # noqa: SLF001 - same room
            parameters.append(typed.Variable(name.text, t, "parameter", name.span))
        result = self.checker.type_of(decl.result, scope)
        if isinstance(result, DurationType):
            self.checker._no_duration(decl.result)  # noqa: SLF001 - same room
        body: tuple[typed.Stmt, ...] | None = None if decl.extern else ()
        self.check_binding(decl.source, decl.source_span)
        fun = typed.FunSymbol(
            full, decl.name.span, tuple(parameters), result, body, decl.extern,
            self._located(decl.source, scope), scope.loaded.prelude,
        )
        if decl.body is not None:
            self.checker.defer_body(fun, decl, scope)
        return fun

    def fun_body(self, fun: typed.FunSymbol, decl: tree.FunDecl, scope: FileScope) -> None:
        """Check a function's body and store it in the symbol."""
        assert decl.body is not None
        context = Context(scope, f"function `{decl.name.text}`", result=fun.result)
        context.locals.append({p.name: p for p in fun.parameters})
        fun.body = self.checker.statements.block(decl.body, context)
        if not always_returns(fun.body) and not isinstance(fun.result, ErrorType):
            self.diagnostics.error(
                "T005",
                f"`{decl.name.text}` may end without `return`",
                decl.name.span,
                f"must give `{fun.result}` on every path",
            )

    def check_binding(self, source: str | None, span: Span | None) -> None:
        """X002 for a binding text that cannot be one."""
        if source is None:
            return
        parts = source.split(":")
        if len(parts) != 3 or parts[0] not in BINDING_KINDS or not all(parts):
            self.diagnostics.error(
                "X002",
                f"`{source}` is not a binding",
                span,
                helps=('write `"python:file.py:name"` or `"c:file.c:name"`',),
            )

    def _located(self, source: str | None, scope: FileScope) -> str | None:
        """A binding with its file made relative to the file that declares it."""
        if source is None or source.count(":") != 2:
            return source
        kind, file, name = source.split(":")
        return f"{kind}:{scope.loaded.path.parent / file}:{name}"

    # ------------------------------------------------------------ topics

    def _topic(self, decl: tree.TopicDecl, scope: FileScope, full: str) -> object:
        t = self.checker.type_of(decl.type, scope)
        if isinstance(t, ErrorType):
            return None
        if isinstance(t, DurationType):
            self.checker._no_duration(decl.type)  # noqa: SLF001 - same room
            return None
        context = Context(scope, f"topic `{decl.name.text}`", constant=False)
        values: dict[tuple[str, ...], typed.RangeSet] = {}
        if decl.values is not None:
            self._value_set(decl.values, t, (), values, context)
        default = (
            self.checker.expressions.check(decl.default, context, t) if decl.default else None
        )
        max_age = (
            self.checker.expressions.check(decl.max_age, context, DURATION)
            if decl.max_age
            else None
        )
        if default is not None and is_error(default):
            default = None
        if max_age is not None and is_error(max_age):
            max_age = None
        return typed.TopicSymbol(full, decl.name.span, t, decl.input, values, default, max_age)

    def _value_set(
        self,
        values: tree.ValueSet,
        t: Type,
        path: tuple[str, ...],
        out: dict[tuple[str, ...], typed.RangeSet],
        context: Context,
    ) -> None:
        if isinstance(values, tree.Interval):
            scalar = scalar_of(t)
            if scalar is None:
                self.diagnostics.error(
                    "V004",
                    f"`{t}` is not made of one kind of number: one interval does not fit it",
                    values.span,
                    helps=("give a set field by field: `in { x in [0, 1], y in [-1, 1] }`",)
                    if isinstance(t, RecordType)
                    else (),
                )
                return
            low = self.checker.expressions.check(values.low, context, scalar)
            high = self.checker.expressions.check(values.high, context, scalar)
            if not is_error(low, high):
                out[path] = typed.RangeSet(low, high, values.span)
            return
        if not isinstance(t, RecordType):
            self.diagnostics.error("V004", f"`{t}` has no fields", values.span)
            return
        seen: set[str] = set()
        for name, inner in values.fields:
            index = t.index(name.text)
            if index is None:
                self.diagnostics.error("N004", f"`{t}` has no field `{name.text}`", name.span)
                continue
            if name.text in seen:
                self.diagnostics.error(
                    "N002", f"the set of `{name.text}` is given twice", name.span
                )
                continue
            seen.add(name.text)
            self._value_set(inner, t.fields[index][1], (*path, name.text), out, context)

    # ------------------------------------------------------------ nodes

    def topic_ref(self, ref: tree.Ref, scope: FileScope) -> typed.TopicSymbol | None:
        """The topic a reference means, or None after a report."""
        entry = self.checker.names.find_ref(scope, ref)
        if entry is None:
            return None
        if entry.kind != "topic":
            self.diagnostics.error(
                "N003", f"`{ref.text}` is a {entry.kind}, not a topic", ref.span
            )
            return None
        symbol = self.checker.resolve(entry, ref.span)
        return symbol if isinstance(symbol, typed.TopicSymbol) else None

    def _node(self, decl: tree.NodeDecl, scope: FileScope, full: str) -> object:
        context = Context(scope, f"node `{decl.name.text}`")
        period = self.checker.expressions.check(decl.period, context, DURATION)
        phase = (
            self.checker.expressions.check(decl.phase, context, DURATION) if decl.phase else None
        )
        self.check_binding(decl.source, decl.source_span)
        subscribes: list[typed.Subscribed] = []
        for s in decl.subscribes:
            topic = self.topic_ref(s.topic, scope)
            if topic is None:
                continue
            if any(x.topic is topic for x in subscribes):
                self.diagnostics.error(
                    "N002", f"`{s.topic.text}` is subscribed twice", s.span
                )
                continue
            if s.queue is not None and s.queue < 1:
                self.diagnostics.error("T011", "a queue holds at least one message", s.span)
            if s.queue is not None:
                self.diagnostics.warning(
                    "W002",
                    "queues are read but not executed yet: this subscription holds the last value",
                    s.span,
                )
            subscribes.append(
                typed.Subscribed(topic, s.queue, s.policy or "drop_oldest", s.span)
            )
        publishes: list[typed.TopicSymbol] = []
        for ref in decl.publishes:
            topic = self.topic_ref(ref, scope)
            if topic is None:
                continue
            if topic in publishes:
                self.diagnostics.error("N002", f"`{ref.text}` is published twice", ref.span)
                continue
            if any(x.topic is topic for x in subscribes):
                both = next(x for x in subscribes if x.topic is topic)
                self.diagnostics.error(
                    "M001",
                    f"`{decl.name.text}` both subscribes to and publishes `{topic.name}`",
                    ref.span,
                    "published here",
                    also=((both.span, "subscribed here"),),
                    notes=("the paper's nodes have disjoint inputs and outputs",),
                    helps=("keep the value in a local `var` instead",),
                )
            if topic.input:
                self.diagnostics.error(
                    "M011",
                    f"`{topic.name}` is an input topic: only the environment sets it",
                    ref.span,
                    also=((topic.span, "declared `input` here"),),
                )
            publishes.append(topic)
        locals_, initial = self._locals(decl, scope, context)
        failsafe = self._failsafe(decl, scope, publishes, context)
        if is_error(period):
            period = typed.Literal(DURATION, decl.period.span, 0, "<error>")
        node = typed.NodeSymbol(
            full, decl.name.span, period, phase if phase and not is_error(phase) else None,
            decl.extern, self._located(decl.source, scope), tuple(subscribes), tuple(publishes),
            failsafe, tuple(locals_), tuple(initial), (), (), None, (),
        )
        self.checker.later(node, decl, scope)
        return node

    def _locals(
        self, decl: tree.NodeDecl, scope: FileScope, context: Context
    ) -> tuple[list[typed.Variable], list[typed.Expr | None]]:
        variables: list[typed.Variable] = []
        initial: list[typed.Expr | None] = []
        for local in decl.locals:
            t = self.checker.type_of(local.type, scope)
            if isinstance(t, DurationType):
                self.checker._no_duration(local.type)  # noqa: SLF001 - same room
            if any(v.name == local.name.text for v in variables):
                self.diagnostics.error(
                    "N002", f"`{local.name.text}` is declared twice", local.name.span
                )
                continue
            value = (
                self.checker.expressions.check(local.initial, context, t)
                if local.initial
                else None
            )
            variables.append(typed.Variable(local.name.text, t, "local", local.name.span))
            initial.append(None if value is None or is_error(value) else value)
        return variables, initial

    def _failsafe(
        self,
        decl: tree.NodeDecl,
        scope: FileScope,
        publishes: list[typed.TopicSymbol],
        context: Context,
    ) -> dict[typed.TopicSymbol, typed.Expr]:
        result: dict[typed.TopicSymbol, typed.Expr] = {}
        for ref, expr in decl.failsafe:
            topic = self.topic_ref(ref, scope)
            value = self.checker.expressions.check(expr, context, topic.type if topic else None)
            if topic is None or is_error(value):
                continue
            if topic not in publishes:
                self.diagnostics.error(
                    "M009", f"`{decl.name.text}` does not publish `{ref.text}`", ref.span
                )
                continue
            if topic in result:
                self.diagnostics.error(
                    "N002", f"the fail-safe value of `{ref.text}` is given twice", ref.span
                )
            result[topic] = value
        return result

    def _node_body(self, node: typed.NodeSymbol, decl: tree.NodeDecl, scope: FileScope) -> None:
        context = Context(
            scope,
            f"node `{decl.name.text}`",
            topics={s.topic for s in node.subscribes},
            has_time=True,
            has_period=True,
            has_modes=True,
            node=node,
        )
        frame = {v.name: v for v in node.locals}
        context.locals.append(frame)
        outputs: set[typed.TopicSymbol] = set(node.publishes)
        node.assumes = tuple(self.checker.expressions.check(e, context, BOOL) for e in decl.assumes)
        both = Context(
            scope, context.where, topics={*outputs, *(s.topic for s in node.subscribes)},
            has_time=True, has_period=True, has_modes=True, node=node, locals=[frame],
        )
        node.guarantees = tuple(
            self.checker.expressions.check(e, both, BOOL) for e in decl.guarantees
        )
        for expr in (*decl.assumes, *decl.guarantees):
            self.diagnostics.warning(
                "W003", "`assumes` and `guarantees` are checked for types only, not at run time yet",
                expr.span,
            )
        if decl.takeover is not None:
            reset = Context(
                scope, f"`on takeover` of `{decl.name.text}`",
                topics={s.topic for s in node.subscribes}, has_time=True, has_period=True,
                locals=[frame],
            )
            node.takeover = self.checker.statements.block(decl.takeover, reset)
        if decl.step is not None:
            node.step = self.checker.statements.block(decl.step, context)
            self._warn_node(node, decl, context)

    def _warn_node(self, node: typed.NodeSymbol, decl: tree.NodeDecl, context: Context) -> None:
        if context.scope.loaded.library:
            return
        published = self.checker.published.get(node, set())
        refs = {r.name.text: r for r in decl.publishes}
        for topic in node.publishes:
            if topic not in published and not decl.extern:
                ref = refs.get(topic.name.rsplit(".", 1)[-1])
                self.diagnostics.warning(
                    "W004",
                    f"`{decl.name.text}` never publishes `{topic.name}`",
                    ref.span if ref else decl.name.span,
                )
        for s in node.subscribes:
            read = s.topic in context.topics_read or decl.assumes or decl.guarantees
            if not read and not decl.extern:
                self.diagnostics.warning(
                    "W001", f"`{decl.name.text}` never reads `{s.topic.name}`", s.span
                )
        for v in node.locals:
            if not v.used and not v.name.startswith("_") and not decl.extern:
                self.diagnostics.warning("W001", f"`{v.name}` is never used", v.span)

    # ------------------------------------------------------------ modules

    def node_ref(self, ref: tree.Ref, scope: FileScope) -> typed.NodeSymbol | None:
        """The node a reference means, or None after a report."""
        entry = self.checker.names.find_ref(scope, ref)
        if entry is None:
            return None
        symbol = self.checker.resolve(entry, ref.span)
        if entry.kind != "node":
            self.diagnostics.error("N003", f"`{ref.text}` is a {entry.kind}, not a node", ref.span)
            return None
        return symbol if isinstance(symbol, typed.NodeSymbol) else None

    def _rta(self, decl: tree.RtaDecl, scope: FileScope, full: str) -> object:
        context = Context(scope, f"module `{decl.name.text}`")
        missing = [
            what
            for what, part in (
                ("ac", decl.ac),
                ("sc", decl.sc),
                ("period", decl.period),
                ("safe", decl.safe),
            )
            if part is None
        ]
        if missing:
            self.diagnostics.error(
                "M006",
                f"module `{decl.name.text}` lacks " + ", ".join(f"`{m}`" for m in missing),
                decl.name.span,
            )
        ac = self.node_ref(decl.ac, scope) if decl.ac else None
        sc = self.node_ref(decl.sc, scope) if decl.sc else None
        period = (
            self.checker.expressions.check(decl.period, context, DURATION) if decl.period else None
        )
        clean = self.checker.expressions.check(decl.clean, context, INT) if decl.clean else None
        if clean is not None and is_error(clean):
            clean = None
        if missing or ac is None or sc is None or period is None or decl.safe is None:
            return None
        if is_error(period):
            return None
        placeholder = typed.Literal(BOOL, decl.safe.span, True)  # noqa: FBT003
        module = typed.ModuleSymbol(
            full, decl.name.span, ac, sc, period, placeholder, None, None, clean, (), (), None, None
        )
        self.checker.later(module, decl, scope)
        return module

    def _rta_body(self, module: typed.ModuleSymbol, decl: tree.RtaDecl, scope: FileScope) -> None:
        assert decl.safe is not None
        expressions = self.checker.expressions
        context = Context(
            scope, f"module `{decl.name.text}`", topics="any", has_modes=True
        )
        module.safe = expressions.check(decl.safe, context, BOOL)
        context.topics_read = []
        module.ttf = expressions.check(decl.ttf, context, BOOL) if decl.ttf else None
        module.safer = expressions.check(decl.safer, context, BOOL) if decl.safer else None
        module.topics_read = tuple(context.topics_read)
        if (decl.ttf is None) != (decl.safer is None):
            what, other = ("ttf", "safer") if decl.ttf is None else ("safer", "ttf")
            self.diagnostics.error(
                "M006",
                f"module `{decl.name.text}` has `{other}` but no `{what}`",
                decl.name.span,
                helps=(f"write `{what}` too, or leave both out: then they are computed",),
            )
        verify = decl.verify
        if verify is None:
            return
        plain = Context(scope, "a `verify` block")
        module.horizon = (
            expressions.check(verify.horizon, plain, DURATION) if verify.horizon else None
        )
        module.levels = expressions.check(verify.levels, plain, INT) if verify.levels else None
        module.grid = tuple(
            axis for a in verify.grid if (axis := self._grid_axis(a, scope, plain)) is not None
        )
        module.abstracts = self._abstractions(verify, scope)

    def _grid_axis(
        self, axis: tree.GridAxis, scope: FileScope, context: Context
    ) -> typed.GridAxis | None:
        expressions = self.checker.expressions
        low = expressions.check(axis.interval.low, context, FLOAT)
        high = expressions.check(axis.interval.high, context, FLOAT)
        cells = expressions.check(axis.cells, context, INT)
        found = self.topic_path(axis.path, scope)
        if found is None or is_error(low, high, cells):
            return None
        topic, path, t = found
        if not isinstance(t, FloatType):
            self.diagnostics.error("T001", f"a grid axis is a `float`, not `{t}`", axis.path.span)
            return None
        return typed.GridAxis(topic, path, low, high, cells, axis.path.span)

    def topic_path(
        self, path: tree.Path, scope: FileScope
    ) -> tuple[typed.TopicSymbol, tuple[str, ...], Type] | None:
        """`topic.field...`: the topic, the path below it and the type there."""
        parts = list(path.parts)
        first = parts.pop(0)
        ref = tree.Ref(None, first, first.span)
        if first.text in scope.imports and parts:
            second = parts.pop(0)
            ref = tree.Ref(first, second, first.span.to(second.span))
        topic = self.topic_ref(ref, scope)
        if topic is None:
            return None
        t: Type = topic.type
        for part in parts:
            index = t.index(part.text) if isinstance(t, RecordType) else None
            if index is None:
                self.diagnostics.error("N004", f"`{t}` has no field `{part.text}`", part.span)
                return None
            assert isinstance(t, RecordType)
            t = t.fields[index][1]
        return topic, tuple(p.text for p in parts), t

    def _abstractions(
        self, verify: tree.VerifyBlock, scope: FileScope
    ) -> tuple[typed.AbstractionLink, ...]:
        links: list[typed.AbstractionLink] = []
        for instance, parts in verify.abstracts:
            for part in parts:
                entry = self.checker.names.find_ref(scope, part.plant)
                plant = self.checker.resolve(entry, part.plant.span) if entry else None
                if entry is not None and not isinstance(plant, typed.PlantSymbol):
                    self.diagnostics.error(
                        "N003", f"`{part.plant.text}` is not a plant", part.plant.span
                    )
                if isinstance(plant, typed.PlantSymbol):
                    links.append(
                        typed.AbstractionLink(
                            instance.text, part.name.text, plant, None, part.value.span
                        )
                    )
        return tuple(links)


def scalar_of(t: Type) -> Type | None:
    """The one kind of number a type is made of (FLOAT or INT), or None."""
    if isinstance(t, FloatType):
        return FLOAT
    if isinstance(t, IntType):
        return INT
    if isinstance(t, RecordType):
        kinds = {scalar_of(f) for _, f in t.fields}
        return kinds.pop() if len(kinds) == 1 else None
    if isinstance(t, (ArrayType, ListType)):
        return scalar_of(t.element)
    return None


def topics_of(what: object, checker: DeclChecker) -> list[typed.TopicSymbol]:
    """Topics one plant, node, module or system mentions in its signature."""
    if isinstance(what, typed.NodeSymbol):
        return [*(s.topic for s in what.subscribes), *what.publishes]
    if isinstance(what, typed.PlantSymbol):
        return [*what.reads, *(t for t, _ in what.drives)]
    if isinstance(what, typed.ModuleSymbol):
        return [*topics_of(what.ac, checker), *topics_of(what.sc, checker)]
    if isinstance(what, typed.SystemSymbol):
        return checker.topics_of(what)
    return []
