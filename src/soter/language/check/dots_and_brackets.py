"""Checks dots and brackets, in expressions and in paths such as `j.q[0]`.

Purpose: checks fields and elements in expressions; and the parts after the name of a topic or of a
plant in axes, `measured`, `commands` and `moves`: fields, and elements of arrays by constant
indices.
Non-goals: what the first name means (`scope.py`, `declarations.py`, `verify_block.py`); elements
of lists in paths, as these may not exist.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import insert, replace
from soter.language.check import unknown_names
from soter.language.check.checker_interface import SPECIALS
from soter.language.check.expression_base import ExprBase, error_expr, has_error
from soter.language.check.scope import BUILTIN_FUNCTIONS, FieldOf
from soter.language.model import typed
from soter.language.model.types import (
    INT,
    MODE,
    ArrayType,
    EnumType,
    ErrorType,
    ListType,
    RecordType,
)
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Diagnostics, Help
    from soter.language.check.checker_interface import Context, Shared
    from soter.language.check.scope import Entry, FileScope
    from soter.language.model.types import Type


NAMES_SHOWN = 12


def names_of_chain(expr: tree.SyntaxExpr) -> list[tree.Name] | None:
    """Gives the names of a dotted chain `a.b.c`; None for any other expression."""
    names: list[tree.Name] = []
    while isinstance(expr, tree.FieldExpr):
        names.append(expr.field)
        expr = expr.target
    if not isinstance(expr, tree.NameExpr):
        return None
    names.append(expr.name)
    names.reverse()
    return names


def quoted(names: list[str] | tuple[str, ...]) -> str:
    """Gives the first few names in backticks, as text, and the count of the others."""
    shown = ", ".join(f"`{n}`" for n in names[:NAMES_SHOWN])
    return shown + (f" and {len(names) - NAMES_SHOWN} more" if len(names) > NAMES_SHOWN else "")


class FieldChecker(ExprBase):
    """Checks dots and brackets; it is one of the base classes of the expression checker."""

    def entry_value(self, entry: Entry, span: Span, context: Context) -> typed.TypedExpr:
        """Gives the typed expression for a declaration that is used as a value."""
        raise NotImplementedError

    def topic_read(self, topic: typed.TopicSymbol, span: Span, context: Context) -> typed.TypedExpr:
        """Gives the typed read of a topic; reports an error if this place may not read it."""
        raise NotImplementedError

    # ------------------------------------------------------------ dots

    def check_field(
        self, expr: tree.FieldExpr, context: Context, _: Type | None
    ) -> typed.TypedExpr:
        """Checks `target.field` in all its meanings."""
        names = names_of_chain(expr)
        if names is not None and names[0].text in context.lost:
            return self.lost_expr(expr.span)
        if names is not None and context.find_local(names[0].text) is None:
            if context.instances is not None and names[0].text in context.instances:
                return self._check_below_instance(expr.span, names, context)
            if self._is_unknown_name(names[0].text, context):
                helps = unknown_names.helps_for_foreign_qualifier(names[0], names[1])
                helps = helps or self._helps_with_measured_topic(expr, names, context)
                self.report_unknown(names[0], context, dotted=not helps, helps=helps)
                return error_expr(expr.span)
            typed_expr = self._constant_length(expr, names, context)
            typed_expr = typed_expr or self._check_member_or_import(expr, names, context)
            if typed_expr is not None:
                return typed_expr
        target = self.check_in_place(expr.target, context)
        if has_error(target):
            return error_expr(expr.span)
        return self._check_dot(target, expr.field, expr.span)

    def _helps_with_measured_topic(
        self, expr: tree.FieldExpr, names: list[tree.Name], context: Context
    ) -> tuple[Help, ...]:
        """Gives helps for `c.truth.x` outside a system: the topic that publishes the state `x`."""
        decls = [e.decl for e in context.scope.entries.values()]
        if context.instances is not None and names[1].text == "truth":
            plants = [
                n for n, i in context.instances.items() if isinstance(i.what, typed.PlantSymbol)
            ]
            return (replace(names[0].span, plants[0]),) if len(plants) == 1 else ()
        meant = unknown_names.topic_of_truth(decls, names)
        if meant is None or context.instances is not None or context.constant:
            return ()
        driven, plant = meant
        entry = context.scope.entries.get(driven.partition(".")[0])
        topics = context.topics
        title = f"it is the state of plant `{plant.name.text}`, which is measured as `{driven}`"
        if context.result is not None:
            return (f"{title}: pass that as an argument",)
        readable = topics == "any" or (topics and entry is not None and entry.symbol in topics)
        return (replace(expr.span, driven, title),) if readable else (title,)

    def _is_unknown_name(self, name: str, context: Context) -> bool:
        scope = context.scope
        return not (
            name in scope.entries
            or name in scope.imports
            or name in self.names.prelude
            or name in SPECIALS
            or name in BUILTIN_FUNCTIONS
            or name == "Mode"
            or (context.hidden is not None and context.hidden.find_local(name) is not None)
        )

    def _constant_length(
        self, expr: tree.FieldExpr, names: list[tree.Name], context: Context
    ) -> typed.TypedExpr | None:
        """Gives the length `xs.len` of an array in a constant; None for other expressions."""
        if context.hidden is None or expr.field.text != "len":
            return None
        local = context.hidden.find_local(names[0].text)
        t: Type | None = local.type if local is not None else None
        for name in names[1:-1]:
            t = dict(t.fields).get(name.text) if isinstance(t, RecordType) else None
        if local is None or not isinstance(t, ArrayType):
            return None
        local.used = True
        return typed.Literal(INT, expr.span, t.size)

    def _check_member_or_import(
        self, expr: tree.FieldExpr, names: list[tree.Name], context: Context
    ) -> typed.TypedExpr | None:
        """Gives `Enum.member`, `file.name`, `file.Enum.member` typed; None for a value's field."""
        scope, first = context.scope, names[0].text
        if first in scope.imports and first not in scope.entries:
            if len(names) == 2:
                entry = self.names.find_in_import(scope, names[0], names[1])
                at = expr.span
                return error_expr(at) if not entry else self.entry_value(entry, at, context)
            child = scope.imports[first]
            entry = child.entries.get(names[1].text) if child is not None else None
            if len(names) == 3 and entry is not None and entry.kind == "type":
                self.names.find_in_import(scope, names[0], names[1])
                t = self.shared.resolve(entry, expr.target.span)
                return self._check_member(t, names[2], expr.span)
            return None
        if len(names) != 2:
            return None
        entry = scope.entries.get(first) or self.names.prelude.get(first)
        if entry is not None and entry.kind == "type":
            entry.used = True
            self.names.note_meaning(names[0].span, entry)
            helps = self.value_helps(names[0], context)
            t = self.shared.resolve(entry, names[0].span)
            return self._check_member(t, names[1], expr.span, helps)
        return (
            self._check_member(MODE, names[1], expr.span)
            if entry is None and first == "Mode"
            else None
        )

    def _check_dot(self, target: typed.TypedExpr, name: tree.Name, span: Span) -> typed.TypedExpr:
        """Checks a field of a record, or `len` of a list or an array."""
        t = target.type
        helps: tuple[Help, ...] = ()
        notes: tuple[str, ...] = ()
        if isinstance(t, RecordType):
            index = t.index(name.text)
            if index is not None:
                self.names.note_meaning(name.span, FieldOf(t, name.text))
                return typed.TypedField(t.fields[index][1], span, target, index)
            fields = [n for n, _ in t.fields]
            notes = (f"its fields are {quoted(fields)}",)
            helps = self.diagnostics.did_you_mean(name.text, fields, name.span)
            stamped = name.text in {"header", "stamp", "timestamp"}
            if stamped and isinstance(target, typed.TopicRead):
                helps = (f"how old it is, in s: `age({target.span.text})`",)
        elif isinstance(t, (ListType, ArrayType)):
            if name.text == "len":
                if isinstance(t, ArrayType):
                    return typed.Literal(INT, span, t.size)
                return typed.TypedLength(INT, span, target)
            if name.text in {"length", "size", "count"}:
                helps = (replace(name.span, "len", "its length is `.len`"),)
        return self.refuse(
            "N004",
            f"`{t}` has no field `{name.text}`",
            name.span,
            notes=notes,
            helps=helps,
            whole=span,
        )

    def _check_member(
        self, t: object, name: tree.Name, span: Span, helps: tuple[Help, ...] = ()
    ) -> typed.TypedExpr:
        if t is None or isinstance(t, ErrorType):
            return error_expr(span)
        if not isinstance(t, EnumType):
            self.diagnostics.error(
                "N003",
                f"`{t}` is a type, not a value",
                span,
                notes=("only the members of an enum are written `Type.member`",),
                helps=helps,
            )
        elif name.text in t.members:
            self.names.note_meaning(name.span, FieldOf(t, name.text))
            return typed.Literal(t, span, t.members.index(name.text), f"{t.name}.{name.text}")
        else:
            self.diagnostics.error(
                "N004",
                f"`{t}` has no member `{name.text}`",
                name.span,
                notes=(f"its members are {quoted(t.members)}",),
                helps=self.diagnostics.did_you_mean(name.text, t.members, name.span),
            )
        return error_expr(span)

    # ------------------------------------------------------------ below an instance of a system

    def _check_below_instance(
        self, span: Span, names: list[tree.Name], context: Context
    ) -> typed.TypedExpr:
        """Checks `plant.truth...`, `sub.topic...`, `sub.plant.truth...` inside a system."""
        assert context.instances is not None
        symbol, depth = find_instance(context.instances, names)
        prefix, rest = names[:depth], names[depth:]
        path = ".".join(n.text for n in prefix)
        if not rest:
            return self.refuse_instance(symbol, path, span)
        if isinstance(symbol, typed.PlantSymbol) and rest[0].text == "truth":
            if symbol in self.shared.damaged and symbol.truth.index(rest[-1].text) is None:
                return self.lost_expr(span)
            value: typed.TypedExpr = typed.TruthRead(symbol.truth, span, path)
            return self._check_fields(value, rest[1:], span)
        if isinstance(symbol, typed.SystemSymbol):
            topic = self._topic_inside(symbol, [n.text for n in prefix], rest[0])
            if topic is not None:
                value = self.topic_read(topic, span, context)
                return value if has_error(value) else self._check_fields(value, rest[1:], span)
        if symbol in self.shared.damaged:
            return self.lost_expr(span)
        self._report_no_part(symbol, path, rest[0], names[0], context)
        return error_expr(span)

    def refuse_instance(self, symbol: object, path: str, span: Span) -> typed.TypedExpr:
        """Reports N003 for an instance that is used as a value."""
        helps: tuple[str, ...] = ()
        if isinstance(symbol, typed.PlantSymbol):
            helps = (f"the plant's state is `{path}.truth`",)
        elif isinstance(symbol, typed.ModuleSymbol):
            helps = (f"the module's mode is `mode({path})`",)
        return self.refuse("N003", f"`{path}` is an instance, not a value", span, helps=helps)

    def _report_no_part(
        self, symbol: object, path: str, name: tree.Name, first: tree.Name, context: Context
    ) -> None:
        """Reports N004 for a name that an instance does not have, perhaps a topic beside it."""
        helps: tuple[Help, ...] = ()
        beside = context.scope.entries.get(name.text)
        if beside is not None and beside.kind == "topic":
            before = Span(first.span.source, first.span.start, name.span.start)
            title = f"`{name.text}` is a topic of the file: write `{name.text}` alone"
            helps = (replace(before, "", title),)
        elif isinstance(symbol, typed.PlantSymbol):
            states = [n for n, _ in symbol.truth.fields]
            helps = (
                insert(name.span, "truth.", f"write `{path}.truth.{name.text}`")
                if name.text in states
                else f"the plant's state is `{path}.truth`",
            )
        elif isinstance(symbol, typed.SystemSymbol):
            topics = [t.name.rsplit(".", 1)[-1] for t in self.shared.topics_of_system(symbol)]
            helps = self.diagnostics.did_you_mean(
                name.text, [*topics, *(i.name for i in symbol.instances)], name.span
            )
        elif isinstance(symbol, typed.ModuleSymbol):
            helps = (f"the module's mode is `mode({path})`",)
        elif isinstance(symbol, typed.NodeSymbol):
            helps = ("read a topic it publishes: locals of a node are its own",)
        self.diagnostics.error(
            "N004", f"`{path}` has no `{name.text}` that could be read", name.span, helps=helps
        )

    def _topic_inside(
        self, system: typed.SystemSymbol, prefix: list[str], name: tree.Name
    ) -> typed.TopicSymbol | None:
        """Gives the symbol of the topic `name` of a sub-system; None if it has no such topic."""
        for topic in self.shared.topics_of_system(system):
            if topic.name.rsplit(".", 1)[-1] == name.text:
                self.names.note_meaning(name.span, topic)
                return self.shared.topic_of_instance(system, prefix, topic, name.span)
        return None

    def _check_fields(
        self, value: typed.TypedExpr, names: list[tree.Name], span: Span
    ) -> typed.TypedExpr:
        for name in names:
            if has_error(value):
                return value
            value = self._check_dot(value, name, span)
        return value

    # ------------------------------------------------------------ brackets

    def check_index(
        self, expr: tree.IndexExpr, context: Context, _: Type | None
    ) -> typed.TypedExpr:
        """Checks `target[index]`."""
        target = self.check_in_place(expr.target, context)
        index = self.check(expr.index, context, INT)
        if has_error(target, index):
            return error_expr(expr.span)
        if not isinstance(target.type, (ArrayType, ListType)):
            return self.refuse(
                "T002",
                f"`{target.type}` cannot be indexed",
                expr.target.span,
                f"this is `{target.type}`",
                notes=("only arrays and lists have elements",),
                helps=index_help(target.type, expr.span, expr.target.span.text, index),
                whole=expr.span,
            )
        may_be_in_range(self.diagnostics, target.type, index, expr.target.span.text)
        return typed.Index(target.type.element, expr.span, target, index)


def may_be_in_range(
    diagnostics: Diagnostics, t: ArrayType | ListType, index: typed.TypedExpr, target: str
) -> bool:
    """Whether a literal index of `target` may be right; reports T017 if it never can."""
    if not isinstance(index, typed.Literal):
        return True
    limit = t.size if isinstance(t, ArrayType) else t.capacity
    if 0 <= index.value < limit:
        return True
    diagnostics.error(
        "T017",
        f"index {index.value} is outside `{t}`",
        index.span,
        f"0 to {limit - 1} are possible" if limit > 1 else "only 0 is possible",
        helps=_past_end_help(t, index, target),
    )
    return False


def index_help(t: Type, span: Span, target: str, index: typed.TypedExpr) -> tuple[Help, ...]:
    """Gives the help `p.x` for `p[0]` at `span`; `target` is the text before the brackets."""
    if not isinstance(t, RecordType):
        return ()
    names = [name for name, _ in t.fields]
    if isinstance(index, typed.Literal) and 0 <= index.value < len(names):
        return (replace(span, f"{target}.{names[index.value]}"),)
    return (f"its fields are {quoted(names)}",)


def _past_end_help(t: ArrayType | ListType, index: typed.Literal, target: str) -> tuple[Help, ...]:
    """Gives help for an index out of range: `xs[xs.len - 1]` for `xs[-1]`, or the last index."""
    if index.value >= 0:
        last = t.size - 1 if isinstance(t, ArrayType) else t.capacity - 1
        title = f"indices begin at 0: the last one is `{last}`"
        return (replace(index.span, f"{last}", title),) if index.value == last + 1 else ()
    if isinstance(t, ListType):
        return (replace(index.span, f"{target}.len - {-index.value}"),)
    from_zero = t.size + index.value
    return (replace(index.span, f"{from_zero}"),) if from_zero >= 0 else ()


def find_instance(
    instances: dict[str, typed.InstanceSymbol], names: list[tree.Name] | tuple[tree.Name, ...]
) -> tuple[object, int]:
    """The declaration of the longest prefix that is an instance, and its length; or (None, 0)."""
    symbol: object = None
    depth = 0
    for name in names:
        instance = instances.get(name.text)
        if instance is None:
            break
        depth += 1
        symbol = instance.what
        if not isinstance(symbol, typed.SystemSymbol):
            break
        instances = symbol.by_name
    return symbol, depth


def path_and_type(
    shared: Shared,
    root: Type,
    parts: Sequence[tree.Name],
    scope: FileScope,
    plant: typed.PlantSymbol | None = None,
) -> tuple[tuple[str, ...], Type] | None:
    """Gives the path of `parts` below type `root`, and the type there; None after an error.

    `plant` is the plant whose state has type `root`; None if `root` is the type of a topic.
    """
    t, path, whole = root, [], parts[0].span.to(parts[-1].span)
    for part in parts:
        if part is not parts[0]:
            field = _field_type(shared, t, part, plant if t is root else None)
            if field is None:
                return None
            t = field
            path.append(part.text)
        for index in part.indices if isinstance(part, tree.ElementName) else ():
            number = _index_value(shared, t, index, whole, scope)
            if number is None:
                return None
            assert isinstance(t, ArrayType)
            t = t.element
            path.append(f"[{number}]")
    return tuple(path), t


def hint_to_one_number(t: Type, path: tree.DottedPath) -> str:
    """Gives a help text on how to name a single number in `path`, whose type is `t`."""
    if not isinstance(t, ArrayType):
        return "name one of its fields"
    return f"name one of its elements, `{path.span.text}[0]` to `{path.span.text}[{t.size - 1}]`"


def _field_type(
    shared: Shared, t: Type, part: tree.Name, plant: typed.PlantSymbol | None
) -> Type | None:
    at = t.index(part.text) if isinstance(t, RecordType) else None
    if isinstance(t, RecordType) and at is not None:
        shared.names.note_meaning(part.word, FieldOf(t, part.text))
        return t.fields[at][1]
    if plant in shared.damaged:
        return None
    names = [n for n, _ in t.fields] if isinstance(t, RecordType) else []
    known = ", ".join(f"`{n}`" for n in names)
    kind, whose = ("field", "its fields") if plant is None else ("state", "there")
    shared.diagnostics.error(
        "N004",
        f"`{t if plant is None else plant.name}` has no {kind} `{part.text}`",
        part.word,
        notes=(f"{whose} are {known}",) if names else (),
        helps=shared.diagnostics.did_you_mean(part.text, names, part.word),
    )
    return None


def _index_value(
    shared: Shared, t: Type, index: tree.SyntaxExpr, path: Span, scope: FileScope
) -> int | None:
    """Gives the value of an index in a path; None after a reported error."""
    value = shared.const_value(index, scope, INT, "the index of an element")
    if not isinstance(value, int) or isinstance(t, ErrorType):
        return None
    number = typed.Literal(INT, index.span, value, str(value))
    target = index.span.source.text[path.start : index.span.start].rstrip(" \t\n[")
    if isinstance(t, ArrayType):
        return value if may_be_in_range(shared.diagnostics, t, number, target) else None
    is_list = isinstance(t, ListType)
    ends = not index.span.source.text[index.span.end : path.end].strip(" \t\n]")
    shared.diagnostics.error(
        "T002",
        f"no element of `{t}` can be named here" if is_list else f"`{t}` cannot be indexed",
        index.span,
        notes=(
            "which elements a list has is known at run time only"
            if is_list
            else "only arrays have elements",
        ),
        helps=index_help(t, path, target, number) if ends else (),
    )
    return None
