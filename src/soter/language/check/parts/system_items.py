"""Checks items that systems and tests share, topics of the outside, and what campaigns read.

Purpose: `ItemChecker` checks properties, `replace` and inputs. `SettingChecker` checks `set` of the
system, of an instance by its path, and in an instance's braces. Functions check `external topic`,
`measure` and `faults { ... }`. Names in paths count as used.
Non-goals: which of two settings counts, numbers (`language/elaborate/`); instances (`system.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fixes import replace
from soter.language.check.checker_interface import Context
from soter.language.check.dots_and_brackets import find_instance
from soter.language.check.expression_base import CheckerPart, has_error, unless_error, with_article
from soter.language.check.operators_and_choices import MAX_CHOICES
from soter.language.check.unknown_names import is_published_or_driven
from soter.language.model import typed
from soter.language.model.types import BOOL, DURATION, FLOAT, INT, has_list, is_vector_part
from soter.language.syntax import tree
from soter.language.syntax.printer import expression_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope
    from soter.language.model.types import Type

    Replaced = tuple[str, typed.NodeSymbol | typed.PlantSymbol | typed.ByContract, Span]


class SettingChecker(CheckerPart):
    """Checks the `set` items of systems and tests."""

    def check_settings(
        self,
        items: Iterable[tuple[str, tree.SetParam]],
        system: typed.SystemSymbol,
        scope: FileScope,
    ) -> list[typed.SetSymbol]:
        """Checks `set` items, each with the instance whose braces have it, or ""; reports N002."""
        setting_by_key: dict[tuple[str, typed.ParamSymbol], typed.SetSymbol] = {}
        for home, item in items:
            symbol = self._check_setting(home, item, system, scope)
            if symbol is None:
                continue
            key = symbol.path, symbol.param
            first = setting_by_key.setdefault(key, symbol)
            if first is not symbol:
                name = f"{symbol.path}.{item.param.parts[-1].text}".lstrip(".")
                self.shared.names.report_repeated(f"`{name}` is set twice", symbol.span, first.span)
        return list(setting_by_key.values())

    def _check_setting(
        self, home: str, item: tree.SetParam, system: typed.SystemSymbol, scope: FileScope
    ) -> typed.SetSymbol | None:
        names = item.param.parts
        inside = system.by_name
        if home:
            symbol = inside[home].what
            inside = symbol.by_name if isinstance(symbol, typed.SystemSymbol) else {}
        depth = 0
        if not (names[0].text in scope.imports and names[0].text not in inside):
            _, depth = find_instance(inside, names[:-1])
        path = ".".join([*filter(None, [home]), *(n.text for n in names[:depth])])
        rest = names[depth:]
        if len(rest) > 2 or (len(rest) == 2 and rest[0].text not in scope.imports):
            self._report_no_instance(item, rest[0], system, inside)
            return None
        ref = tree.Ref(
            rest[0] if len(rest) == 2 else None, rest[-1], rest[0].span.to(rest[-1].span)
        )
        param = self.referred_symbol(ref, scope, "parameter", typed.ParamSymbol)
        if param is None:
            return None
        value = self.shared.const_value(item.value, scope, param.type, f"the value of `{ref.text}`")
        if value is None:
            return None
        return typed.SetSymbol(path, param, value, item.param.span)

    def _report_no_instance(
        self,
        item: tree.SetParam,
        name: tree.Name,
        system: typed.SystemSymbol,
        inside: Mapping[str, typed.InstanceSymbol],
    ) -> None:
        if system in self.shared.damaged or name.text in self.shared.lost.get(system, ()):
            self.shared.names.losses += 1
            return
        self.diagnostics.error(
            "M013",
            f"there is no instance `{name.text}` whose parameter could be set",
            item.param.span,
            helps=_instance_helps(name, inside)
            or self.diagnostics.did_you_mean(name.text, inside, name.span),
        )


def _instance_helps(
    name: tree.Name, inside: Mapping[str, typed.InstanceSymbol]
) -> tuple[Help, ...]:
    """Gives a help with the instances of `name` if it is a declaration and no instance; else ()."""
    paths = [p for p, i in inside.items() if i.what.name.rpartition(".")[2] == name.text]
    if not paths:
        return ()
    last = f" to `{paths[-1]}`" if len(paths) > 1 else ""
    helps = replace(name.span, paths[0], f"name an instance of it: `{paths[0]}`{last}")
    return (helps,)


def enter_measures_and_faults(
    shared: Shared,
    system: typed.SystemSymbol,
    decl: tree.SystemDecl,
    inside: Context,
    faults: list[tree.SystemFault],
) -> None:
    """Fills in a system's checked measures and faults; `inside` is the context of properties."""
    system.measures = tuple(_check_measures(shared, decl.measures, inside))
    place = Context(inside.scope, f"the faults of `{decl.name.text}`")
    system.faults = tuple(_check_fault(shared, f, place) for f in faults)


def _check_measures(
    shared: Shared, items: tuple[tree.MeasureItem, ...], context: Context
) -> Iterator[typed.MeasureSymbol]:
    """Yields the checked measures, which must be numbers with different names."""
    seen: dict[str, Span] = {}
    place = Context(context.scope, "a measure")
    number = shared.check_number
    for item in items:
        first = seen.setdefault(item.name.text, item.name.span)
        if first is not item.name.span:
            message = f"measure `{item.name.text}` is said twice"
            shared.names.report_repeated(message, item.name.span, first)
        value = shared.check_expr(item.value, context, FLOAT)
        parts = (
            number(item.interval.low, place, FLOAT, "the range of a histogram"),
            number(item.interval.high, place, FLOAT, "the range of a histogram"),
            number(item.bins, place, INT, "the number of bins"),
            number(item.every, place, DURATION, "`every`"),
        )
        if not any(has_error(e) for e in (value, *parts)):
            yield typed.MeasureSymbol(item.name.text, value, *parts, item.span)


def _check_fault(
    shared: Shared, item: tree.SystemFault, context: Context
) -> typed.SystemFaultSymbol:
    wanted = DURATION if item.kind in {"late", "overrun"} else FLOAT

    def checked(e: tree.SyntaxExpr | None, subject: str, t: Type) -> typed.TypedExpr | None:
        return None if e is None else unless_error(shared.check_number(e, context, t, subject))

    if item.target is not None:
        mark_path_used(item.target, context.scope)
    amounts = [checked(e, f"`{item.kind}`", wanted) for e in item.by]
    return typed.SystemFaultSymbol(
        kind=item.kind,
        path=item.target.text if item.target is not None else "",
        by=tuple(e for e in amounts if e is not None),
        rate=checked(item.rate, "how often", FLOAT),
        per=checked(item.per, "`per`", DURATION),
        lasts=checked(item.lasts, "`for`", DURATION),
        text=item.span.text_on_one_line.rstrip(" ;"),
        span=item.span,
    )


def mark_path_used(path: tree.DottedPath, scope: FileScope) -> None:
    """Marks as used the names of a path to something that a test replaces or disturbs."""
    for part in path.parts:
        if part.text in scope.entries:
            scope.entries[part.text].used = True
        elif part.text in scope.imports:
            scope.used_imports.add(part.text)


class ItemChecker(CheckerPart):
    """Checks what systems and tests share: properties, replacements, inputs, settings."""

    def __init__(self, shared: Shared) -> None:
        super().__init__(shared)
        self.sets = SettingChecker(shared)

    def check_time(
        self, expr: tree.SyntaxExpr | None, context: Context, subject: str
    ) -> typed.TypedExpr | None:
        """Gives the typed expression of a time, computed per system; None if `expr` is None."""
        return self.check_number_if_given(expr, context, DURATION, subject)

    def property_context(
        self,
        scope: FileScope,
        name: str,
        instances: dict[str, typed.InstanceSymbol],
        lost: frozenset[str],
    ) -> Context:
        """Gives the context for properties and inputs of the system or test called `name`."""
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

    def check_property(
        self, item: tree.PropertyItem, context: Context
    ) -> typed.PropertySymbol | None:
        """Checks a property that consists of one or two expressions."""
        if invariant_call(item, context) is not None:
            span = item.condition.span
            self.diagnostics.error(
                "E012",
                f"`{span.text_on_one_line}` can only be asked by a test, with `always`",
                span,
                notes=("it speaks about the time since the decision module last looked",),
                helps=("write it in a `test` block: `always invariant(M);`, `always invariants;`",),
            )
            return None
        check = self.shared.check_expr
        premise = check(item.premise, context, BOOL) if item.premise else None
        condition = check(item.condition, context, BOOL)
        within = self.check_time(item.within, Context(context.scope, context.where), "`within`")
        if has_error(condition) or (premise is not None and has_error(premise)):
            return None
        read = expression_text if item.in_loop else lambda e: e.span.text_on_one_line
        text = _property_text(item) if item.in_loop else ""
        asks = read(item.premise) if item.premise else ""
        parts = (item.kind, premise, condition, within, read(item.condition), item.span)
        return typed.PropertySymbol(*parts, whole=text, asks=asks)

    def _enter_contract_as_replacement(
        self, item: tree.Replace, replacements: list[Replaced], *, in_test: bool
    ) -> None:
        """Checks `replace M by contract;` and stores it; reports E012 outside of a test."""
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

    def check_replacements(
        self, items: list[tree.Replace], scope: FileScope, *, in_test: bool = False
    ) -> list[Replaced]:
        """Checks `replace A by B;` items; gives the old part, the new part and the place."""
        replacements: list[Replaced] = []
        for item in items:
            if item.by.text == "contract" and "contract" not in scope.entries:
                self._enter_contract_as_replacement(item, replacements, in_test=in_test)
                mark_path_used(item.what, scope)
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
            mark_path_used(item.what, scope)
        return replacements

    def check_inputs(
        self, items: list[tree.DriveInput], context: Context
    ) -> list[typed.InputSymbol]:
        """Checks items `input t [in { values }] every d;`; each names a different input topic."""
        input_by_topic: dict[typed.TopicSymbol, typed.InputSymbol] = {}
        for item in items:
            every = self.check_time(item.every, Context(context.scope, context.where), "`every`")
            name = item.topic.parts[0]
            if len(item.topic.parts) == 1 and name.text not in context.scope.entries:
                declared = f"declare it: `input topic {name.text}: float in [-1.0, 1.0];`"
                ref = tree.Ref(None, name, name.span)
                self.shared.names.find_ref(context.scope, ref, "topic", (declared,))
                continue
            read = self.shared.check_expr(path_expr(item.topic), context)
            if has_error(read):
                continue
            if item.values == ():
                self._report_no_values(item)
                continue
            values = self.check_values(item, read, context, "an input")
            if not isinstance(read, typed.TopicRead) or not read.topic.input:
                self._report_no_input(item, read, context.scope)
            elif read.topic in input_by_topic:
                first = input_by_topic[read.topic].span
                self.shared.names.report_repeated(
                    f"`{item.topic.text}` is drawn twice", item.topic.span, first
                )
            elif not item.values and has_list(read.type):
                self.diagnostics.error(
                    "T018",
                    f"{with_article(read.type)} cannot be drawn: it has a list inside",
                    item.topic.span,
                    also=((read.topic.span, "declared here"),),
                    helps=("list the values to draw from: `in { ... }`",),
                )
            elif every is not None:
                input_by_topic[read.topic] = typed.InputSymbol(
                    item.topic.text, read.topic, every, item.topic.span, values
                )
        return list(input_by_topic.values())

    def check_values(
        self,
        item: tree.DriveInput | tree.StatedValues,
        read: typed.TypedExpr,
        context: Context,
        of: str,
    ) -> tuple[typed.TypedExpr, ...]:
        """Checks the values of an input or a stand-in, which messages call `of`."""
        place = Context(context.scope, f"the value of {of}")
        because = (item.topic.span, f"this is {with_article(read.type)}")
        number = self.shared.check_number
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
        return tuple(v for v in values if not has_error(v))

    def _report_no_values(self, item: tree.DriveInput) -> None:
        self.diagnostics.error(
            "E002",
            f"there is nothing that `{item.topic.text}` could be",
            item.span,
            "an empty choice",
            notes=("an input that changes has at least one value to change to",),
            helps=("list its values, or leave `in { }` out: then they are those of the topic",),
        )

    def _report_no_input(
        self, item: tree.DriveInput, read: typed.TypedExpr, scope: FileScope
    ) -> None:
        topic = read.topic if isinstance(read, typed.TopicRead) else None
        name = item.topic.parts[-1].text
        help_ = (
            "leave this line out: a plant or a node of the program publishes it"
            if topic and is_published_or_driven([e.decl for e in scope.entries.values()], name)
            else f"declare it `input topic {name}`"
        )
        self.diagnostics.error(
            "M011",
            f"`{item.topic.text}` is not an input topic",
            item.topic.span,
            also=((topic.span, "declared here"),) if topic else (),
            notes=("only topics of the environment are drawn",),
            helps=(help_,) if topic else (),
        )


def path_expr(path: tree.DottedPath) -> tree.SyntaxExpr:
    """Gives the path as an expression."""
    first = path.parts[0]
    expr: tree.SyntaxExpr = tree.NameExpr(first.span, first)
    for part in path.parts[1:]:
        expr = tree.FieldExpr(first.span.to(part.span), expr, part)
    return expr


def _property_text(item: tree.PropertyItem) -> str:
    within = f" within {item.within.span.text_on_one_line}" if item.within is not None else ""
    if item.premise is not None:
        return f"{expression_text(item.premise)} leadsto {expression_text(item.condition)}{within}"
    return f"{item.kind} {expression_text(item.condition)}{within}"


def invariant_call(item: tree.PropertyItem, context: Context) -> tree.SyntaxExpr | None:
    """Gives the condition if it is the builtin `invariant(M)` or `invariants`; else None."""
    e = item.condition
    if isinstance(e, tree.CallExpr) and isinstance(e.callee, tree.NameExpr):
        asked = e.callee.name.text == "invariant" and len(e.arguments) == 1
        name = "invariant"
    else:
        asked = isinstance(e, tree.NameExpr) and e.name.text == "invariants"
        name = "invariants"
    taken = name in context.scope.entries or name in (context.instances or {})
    return e if asked and not taken else None


def check_externals(
    checker: ItemChecker, decl: tree.SystemDecl, scope: FileScope
) -> tuple[typed.ExternalSymbol, ...]:
    """Checks the external topics of a system; each may be declared once."""
    shared = checker.shared
    context = Context(scope, f"system `{decl.name.text}`")
    external_by_topic: dict[typed.TopicSymbol, typed.ExternalSymbol] = {}
    for item in decl.externals:
        at = shared.topic_of_path(item.topic, scope)
        every = checker.check_time(item.every, context, "`every`")
        delayed = checker.check_time(item.delayed, context, "`delayed`")
        if at is None:
            continue
        topic, below, _ = at
        if below:
            shared.diagnostics.error(
                "N003",
                f"`{item.topic.text}` is a part of a topic",
                item.topic.span,
                notes=("a topic is published and read as a whole",),
                helps=(f"write `external topic {item.topic.parts[0].text};`",),
            )
        elif topic in external_by_topic:
            message = f"`{item.topic.text}` is said twice to be outside"
            also = ((external_by_topic[topic].span, "before"),)
            shared.diagnostics.error("N002", message, item.topic.span, "again", also=also)
        else:
            measured = tuple(_check_errors(shared, item, topic, context))
            external_by_topic[topic] = typed.ExternalSymbol(
                topic, every, delayed, measured, item.topic.span
            )
    return tuple(external_by_topic.values())


def _check_errors(
    shared: Shared, item: tree.ExternalTopic, topic: typed.TopicSymbol, context: Context
) -> Iterator[typed.MeasuredSymbol]:
    """Yields the checked measurement errors of a topic; each leaf may have one error."""
    taken: list[tuple[tuple[str, ...], Span]] = []
    for path, bound in item.measured:
        within = shared.check_number(bound, context, FLOAT, "the bound of an error")
        at = shared.topic_of_path(path, context.scope)
        if at is None:
            continue
        named, below, t = at
        first = next((s for p, s in taken if p[: len(below)] == below[: len(p)]), None)
        if named is not topic:
            shared.diagnostics.error(
                "M009",
                f"`{path.span.text}` is no part of `{item.topic.text}`",
                path.span,
                notes=("an external topic says the errors of its own fields only",),
            )
        elif not is_vector_part(t):
            shared.diagnostics.error(
                "T018",
                f"only floats and vectors are measured with an error, not {with_article(t)}",
                path.span,
                helps=("name the fields that are floats",),
            )
        elif first is not None:
            message = f"the error of `{path.span.text}` is given twice"
            shared.names.report_repeated(message, path.span, first)
        elif not has_error(within):
            yield typed.MeasuredSymbol(topic, below, within, path.span)
        taken.append((below, path.span))
