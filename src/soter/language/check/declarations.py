"""Checks declarations: signatures first, bodies when every signature is known.

Purpose: sends each kind of declaration to its checker, and checks types, constants, parameters,
functions and topics itself.
Non-goals: name look-up order (`scope.py`), numbers (`system_numbers.py`), P1 (`wellformed.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from soter.diagnostics.fixes import exchange_bounds, replace
from soter.language.check import unknown_names
from soter.language.check.checker_interface import Context
from soter.language.check.dots_and_brackets import path_and_type
from soter.language.check.expression_base import CheckerPart, has_error, with_article
from soter.language.check.parts.module import ModuleChecker
from soter.language.check.parts.node import NodeChecker, binding_in_folder, check_binding
from soter.language.check.parts.plant import PlantChecker
from soter.language.check.parts.system import TestChecker
from soter.language.check.scope import FieldOf
from soter.language.check.statements import always_returns
from soter.language.model import typed
from soter.language.model.tree_walk import topics_of_instances
from soter.language.model.types import (
    DURATION,
    FLOAT,
    INT,
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    ErrorType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    is_vector_part,
    write_ns,
)
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.constants_and_types import ConstantChecker
    from soter.language.check.scope import Entry, FileScope
    from soter.language.model.types import Type, Value

MAX_MEMBERS = 65_536
"""Most members of an enum, which is stored in at most two bytes."""


class DeclChecker(CheckerPart):
    """Checks declarations of one program."""

    def __init__(self, shared: Shared, constants: ConstantChecker) -> None:
        super().__init__(shared)
        self.constants = constants
        self.nodes = NodeChecker(shared)
        self.modules = ModuleChecker(shared)
        self.plants = PlantChecker(shared)
        self.systems = TestChecker(shared)
        self._topics: dict[typed.SystemSymbol, list[typed.TopicSymbol]] = {}
        self._signatures: dict[type, Callable[[Any, FileScope, str], object]] = {
            tree.TypeDecl: self._type_symbol,
            tree.ConstDecl: self._const_symbol,
            tree.ParamDecl: self._param_symbol,
            tree.FunDecl: self._fun_symbol,
            tree.TopicDecl: self._topic_symbol,
            tree.NodeDecl: self.nodes.symbol_of,
            tree.RtaDecl: self.modules.symbol_of,
            tree.PlantDecl: self.plants.symbol_of,
            tree.SystemDecl: self.systems.symbol_of,
            tree.TestDecl: self.systems.test_symbol_of,
        }
        self._bodies: dict[type, Callable[[Any, Any, FileScope], None]] = {
            tree.NodeDecl: self.nodes.check_body,
            tree.RtaDecl: self.modules.check_body,
            tree.PlantDecl: self.plants.check_body,
            tree.SystemDecl: self.systems.check_body,
            tree.TestDecl: self.systems.check_test_body,
        }

    def checked_symbol(self, entry: Entry) -> object:
        """Gives the symbol of a declaration, or None if errors leave too little of it."""
        check = self._signatures.get(type(entry.decl))
        return None if check is None else check(entry.decl, entry.scope, entry.full_name)

    def check_body(self, symbol: object, decl: tree.Decl, scope: FileScope) -> None:
        """Checks the body of a declaration, which may mention all other declarations."""
        self._bodies[type(decl)](symbol, decl, scope)

    # ------------------------------------------------------------ types, constants, parameters

    def _type_symbol(self, decl: tree.TypeDecl, scope: FileScope, full_name: str) -> object:
        if isinstance(decl.type, tree.EnumTypeExpr):
            members: dict[str, Span] = {}
            for member in decl.type.members:
                self.shared.names.enter_if_new(member, members, "member")
            if len(members) > MAX_MEMBERS:
                self.diagnostics.error(
                    "T011",
                    "this enum is too large",
                    decl.name.span,
                    f"{len(members)} members, at most {MAX_MEMBERS} are possible",
                )
                return None
            return EnumType(full_name, tuple(members))
        t = self.shared.resolve_type(decl.type, scope, duration=True)
        if isinstance(t, RecordType):
            return RecordType(t.fields, full_name)
        return None if isinstance(t, ErrorType) else t

    def _const_symbol(self, decl: tree.ConstDecl, scope: FileScope, full_name: str) -> object:
        data = decl.data is not None
        t = self.shared.resolve_type(decl.type, scope, duration=True, table=data)
        subject = f"constant `{decl.name.text}`"
        value = None
        if decl.data is not None and not isinstance(t, (ErrorType, DurationType)):
            value = self.constants.value_of_data_file(decl, t, scope)
        elif decl.data is not None and isinstance(t, DurationType):
            self.diagnostics.error(
                "T018",
                "a data file holds no `duration`",
                decl.type.span,
                helps=("read a `float` of seconds",),
            )
        elif decl.value is not None:
            value = self.constants.declared_value(decl, scope, t, subject)
        if value is None or isinstance(t, ErrorType):
            return None
        return typed.ConstSymbol(full_name, decl.name.span, t, value)

    def _param_symbol(self, decl: tree.ParamDecl, scope: FileScope, full_name: str) -> object:
        t = self.shared.resolve_type(decl.type, scope, duration=True)
        subject = f"parameter `{decl.name.text}`"
        if not isinstance(t, (FloatType, IntType, DurationType, EnumType, BoolType, ErrorType)):
            self.diagnostics.error(
                "T018",
                f"a parameter is a single value, not {with_article(t)}",
                decl.type.span,
                notes=("it can be set on the command line: `--set NAME=VALUE`",),
                helps=("declare one parameter for each number",),
            )
            return None
        default = self._literal_of(decl.default, scope, t, subject)
        low, high = self._interval_ends(decl.interval, scope, t, subject) or (None, None)
        if default is None or isinstance(t, ErrorType):
            return None
        if isinstance(t, FloatType) and not math.isfinite(default.value):
            self.diagnostics.error(
                "V006", f"{subject} must be finite", default.span, f"this is {default.value!r}"
            )
            return None
        if low and high and not low.value <= default.value <= high.value:
            shown = [scalar_text(x.value, t) for x in (default, low, high)]
            self.diagnostics.error(
                "V007",
                f"{subject} is {shown[0]}, outside [{shown[1]}, {shown[2]}]",
                default.span,
                "its default",
                also=((decl.interval.span, "its range"),) if decl.interval else (),
            )
        return typed.ParamSymbol(full_name, decl.name.span, t, default, low, high)

    def _interval_ends(
        self, interval: tree.IntervalExpr | None, scope: FileScope, t: Type, subject: str
    ) -> tuple[typed.Literal, typed.Literal] | None:
        """Gives the ends of an interval of type `t`; None if it is absent or has errors."""
        if interval is None:
            return None
        if isinstance(t, (BoolType, EnumType)):
            message = f"{with_article(t)} has no order, so no interval"
            self.diagnostics.error("V004", message, interval.span)
            return None
        low = self._literal_of(interval.low, scope, t, subject)
        high = self._literal_of(interval.high, scope, t, subject)
        if low is None or high is None or not self._is_in_order(low, high, interval):
            return None
        return low, high

    def _is_in_order(self, low: typed.Literal, high: typed.Literal, at: tree.IntervalExpr) -> bool:
        """Whether an interval is not empty; reports V001 if it is."""
        if low.value <= high.value:
            return True
        shown = f"[{scalar_text(low.value, low.type)}, {scalar_text(high.value, high.type)}]"
        self.diagnostics.error(
            "V001",
            f"{shown} is empty",
            at.span,
            "the lower bound is above the upper one",
            helps=(exchange_bounds(at.low.span, at.high.span),),
        )
        return False

    def _literal_of(
        self, expr: tree.SyntaxExpr, scope: FileScope, t: Type, subject: str
    ) -> typed.Literal | None:
        value = self.shared.const_value(expr, scope, t, subject)
        return None if value is None else typed.Literal(t, expr.span, value)

    # ------------------------------------------------------------ functions

    def _fun_symbol(self, decl: tree.FunDecl, scope: FileScope, full_name: str) -> object:
        parameters: dict[str, typed.Variable] = {}
        for name, type_expr in decl.parameters:
            t = self.shared.resolve_type(type_expr, scope)
            if name.text in parameters:
                first = parameters[name.text].span
                self.shared.names.report_duplicate(name.text, name.span, first, "argument")
                parameters[f"{name.text} {name.span.start}"] = typed.Variable(
                    name.text, t, "parameter", name.span
                )
                continue
            parameters[name.text] = typed.Variable(name.text, t, "parameter", name.span)
            self.shared.names.note_meaning(name.span, parameters[name.text])
        result = self.shared.resolve_type(decl.result, scope)
        body: tuple[typed.TypedStmt, ...] | None = None if decl.extern else ()
        check_binding(decl.source, decl.source_span, self.diagnostics)
        fun = typed.FunSymbol(
            full_name,
            decl.name.span,
            parameters=tuple(parameters.values()),
            result=result,
            body=body,
            extern=decl.extern,
            source=binding_in_folder(decl.source, scope),
            prelude=scope.loaded.prelude,
        )
        if decl.body is not None:
            self.shared.calls.add_body(fun, decl, scope)
        return fun

    def check_fun_body(self, fun: typed.FunSymbol, decl: tree.FunDecl, scope: FileScope) -> None:
        """Checks a function's body and stores it in the symbol."""
        assert decl.body is not None
        context = Context(
            scope,
            f"function `{decl.name.text}`",
            result=fun.result,
            result_span=decl.result.span,
            broken=decl.name.text in scope.broken,
        )
        context.locals.append({p.name: p for p in fun.parameters})
        fun.body = self.shared.check_block(decl.body, context)
        if always_returns(fun.body) or decl.name.text in scope.broken:
            return
        self.diagnostics.error(
            "T005",
            f"`{decl.name.text}` may end without `return`",
            decl.name.span,
            also=((decl.result.span, "every path must give this"),),
            helps=("add a `return` at the end",),
        )

    # ------------------------------------------------------------ topics

    def _topic_symbol(self, decl: tree.TopicDecl, scope: FileScope, full_name: str) -> object:
        t = self.shared.resolve_type(decl.type, scope)
        context = Context(scope, f"the declaration of topic `{decl.name.text}`")
        values: dict[tuple[str, ...], typed.RangeSet] = {}
        if decl.values is not None and not isinstance(t, ErrorType):
            self._enter_value_set(decl.values, t, (), values, context)
        because = (decl.type.span, f"the topic is `{t}`")
        default = self.check_number_if_given(decl.default, context, t, "a default", because)
        max_age = self.check_number_if_given(decl.max_age, context, DURATION, "`max_age`")
        if isinstance(t, ErrorType):
            return None
        return typed.TopicSymbol(
            full_name,
            decl.name.span,
            t,
            input=decl.input,
            values=values,
            default=default,
            max_age=max_age,
            static=decl.static,
        )

    def _enter_value_set(
        self,
        values: tree.ValueSet,
        t: Type,
        path: tuple[str, ...],
        sets: dict[tuple[str, ...], typed.RangeSet],
        context: Context,
    ) -> None:
        if isinstance(values, tree.IntervalExpr):
            interval = self._range_set(values, t, context)
            if interval is not None:
                sets[path] = interval
            return
        if not isinstance(t, RecordType):
            self.diagnostics.error(
                "V004",
                f"`{t}` has no fields that could have sets of their own",
                values.span,
                helps=("give one interval: `in [-1.0, 1.0]`",) if common_number_type(t) else (),
            )
            return
        seen: dict[str, Span] = {}
        for name, inner in values.fields:
            index = t.index(name.text)
            if index is None:
                fields = [n for n, _ in t.fields]
                self.diagnostics.error(
                    "N004",
                    f"`{t}` has no field `{name.text}`",
                    name.span,
                    notes=(f"its fields are {', '.join(f'`{n}`' for n in fields)}",),
                    helps=self.diagnostics.did_you_mean(name.text, fields, name.span),
                )
            elif name.text in seen:
                self.diagnostics.error(
                    "N002",
                    f"the set of `{name.text}` is given twice",
                    name.span,
                    "again",
                    also=((seen[name.text], "the first time"),),
                )
            else:
                seen[name.text] = name.span
                self.shared.names.note_meaning(name.span, FieldOf(t, name.text))
                self._enter_value_set(inner, t.fields[index][1], (*path, name.text), sets, context)

    def _range_set(
        self, values: tree.IntervalExpr, t: Type, context: Context
    ) -> typed.RangeSet | None:
        scalar = common_number_type(t)
        if scalar is None and isinstance(values.low, tree.ErrorExpr):
            return None  # the parser has reported what is wrong with it
        if scalar is None:
            kinds = "numbers of one kind" if isinstance(t, RecordType) else "numbers"
            self.diagnostics.error(
                "V004",
                f"one interval does not fit `{t}`: it is not made of {kinds}",
                values.span,
                helps=("give a set to each field: `in { x in [0, 1], y in [-1, 1] }`",)
                if isinstance(t, RecordType)
                else (),
            )
            return None
        low = self.shared.check_number(values.low, context, scalar, "a bound")
        high = self.shared.check_number(values.high, context, scalar, "a bound")
        return None if has_error(low, high) else typed.RangeSet(low, high, values.span)

    def topic_of_ref(
        self,
        ref: tree.Ref,
        scope: FileScope,
        helps: tuple[Help, ...] = (),
        otherwise: tuple[Help, ...] = (),
    ) -> typed.TopicSymbol | None:
        """Gives the topic that a reference means; None after a reported error.

        The report has `helps` if the name is no topic, `otherwise` if no declaration has the name.
        """
        of = typed.TopicSymbol
        return self.referred_symbol(ref, scope, "topic", of, helps=helps, otherwise=otherwise)

    def topic_of_path(
        self, path: tree.DottedPath, scope: FileScope
    ) -> tuple[typed.TopicSymbol, tuple[str, ...], Type] | None:
        """Gives the topic of `topic.field...`, the path of the field and the field's type."""
        parts = list(path.parts)
        first = parts.pop(0)
        ref = tree.Ref(None, tree.Name(first.text, first.word), first.word)
        if first.text in scope.imports and first.text not in scope.entries and parts:
            ref = tree.Ref(
                first, tree.Name(parts[0].text, parts[0].word), first.span.to(parts[0].word)
            )
            first = parts.pop(0)
        helps, otherwise = ((), ()) if ref.qualifier else _no_topic_helps(path, scope)
        topic = self.topic_of_ref(ref, scope, helps, otherwise)
        if topic is None:
            return None
        below = path_and_type(self.shared, topic.type, (first, *parts), scope)
        return None if below is None else (topic, *below)

    # ------------------------------------------------------------ topics of systems

    def topics_of_system(self, system: typed.SystemSymbol) -> list[typed.TopicSymbol]:
        """Gives the topics that an instance of the system contains, but no topics wired to it."""
        if system not in self._topics:
            beside = topics_of_instances(system)
            self._topics[system] = [t for t in beside if t not in self.shared.stand_ins]
        return self._topics[system]


def _no_topic_helps(
    path: tree.DottedPath, scope: FileScope
) -> tuple[tuple[Help, ...], tuple[Help, ...]]:
    """Gives `helps` and `otherwise` for `topic_of_ref`, if the path does not begin with a topic."""
    first = scope.entries.get(path.parts[0].text)
    if first is not None and first.kind == "topic":
        return (), ()
    decls = [e.decl for e in scope.entries.values()]
    driven = unknown_names.topic_of_truth(decls, list(path.parts)) if path.parts[1:] else None
    known = [d.name.text for d in decls if isinstance(d, tree.TopicDecl)]
    otherwise = (f"topics are {unknown_names.quoted_names(known)}",) if known else ()
    return (replace(path.span, driven[0]),) if driven is not None else (), otherwise


def scalar_text(value: Value, t: Type) -> str:
    """Gives a scalar as source text."""
    if isinstance(t, DurationType):
        return write_ns(value)
    return f"{value!r}" if not isinstance(value, bool) else str(value).lower()


def common_number_type(t: Type) -> Type | None:
    """Gives FLOAT if all numbers in a type are floats, INT if all are ints; None for a mixture."""
    if is_vector_part(t):
        return FLOAT
    if isinstance(t, IntType):
        return INT
    if isinstance(t, RecordType):
        kinds = {common_number_type(f) for f in {id(f): f for _, f in t.fields}.values()}
        return kinds.pop() if len(kinds) == 1 else None
    if isinstance(t, (ArrayType, ListType)):
        return common_number_type(t.element)
    return None
