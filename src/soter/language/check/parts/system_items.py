"""Check items of systems: wires, parameters that are set, topics of the outside, measures, faults.

Purpose: where the far end of a wire is; `set` of the system, of an instance by its path, or in the
braces of one; `external topic` and `deploys`; what campaigns read, `measure` and `faults { ... }`.
Paths that are mentioned count as used.
Non-goals: whose value holds in the end, where wires lead, numbers, whether a deployed system is the
proved one (`language/elaborate/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import insert, replace
from soter.language.check.checker_interface import Context
from soter.language.check.expression_base import a_type, is_error, sound
from soter.language.check.expressions.field import find_instance
from soter.language.model import typed
from soter.language.model.types import DURATION, FLOAT, INT, is_vector_part
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope
    from soter.language.model.types import Type


class Wires:
    """Finds topics that instances are wired to."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared

    def end(
        self,
        path: tree.DottedPath,
        instances: dict[str, typed.InstanceSymbol],
        scope: FileScope,
    ) -> typed.TopicSymbol | None:
        """`topic`, `file.topic` or `instance.topic`; None after a report."""
        names = path.parts
        what, depth = find_instance(instances, names)
        if depth == 0 or (len(names) == 1 and "[" not in names[0].text):
            return self._beside(path, scope)
        if isinstance(what, typed.SystemSymbol) and len(names) == depth + 1:
            for topic in self.shared.topics_of(what):
                if topic.name.rsplit(".", 1)[-1] == names[-1].text:
                    prefix = [n.text for n in names[:-1]]
                    return self.shared.stand_in(what, prefix, topic, names[-1].span)
        if what in self.shared.damaged:
            self.shared.names.losses += 1
            return None
        self._no_topic(path, what, depth)
        return None

    def is_parameter(self, inner: tree.Ref, outer: tree.DottedPath, scope: FileScope) -> bool:
        """Whether a parameter stands where a topic is wired: N003, as it is set."""
        entry = scope.entries.get(inner.name.text) if inner.qualifier is None else None
        if entry is None or entry.kind != "parameter":
            return False
        self.shared.diagnostics.error(
            "N003",
            f"`{inner.text}` is a parameter, not a topic",
            inner.span,
            also=((entry.decl.name.span, "declared here"),),
            helps=(insert(inner.span, "set ", f"write `set {inner.text} = {outer.text}`"),),
        )
        return True

    def backwards(
        self,
        inner: tree.Ref,
        outer: tree.DottedPath,
        topic: typed.TopicSymbol,
    ) -> None:
        """M011 for a wire from the publisher to the input of another instance."""
        helps: tuple[Help, ...] = ("wire it to a topic that is declared without `input`",)
        names = outer.span.text.rpartition(".")
        if names[0]:
            turned = f"{names[2]} = {names[0]}.{inner.text}"
            helps = (f"a wire stands with the instance whose input it feeds: `{turned}`",)
        self.shared.diagnostics.error(
            "M011",
            f"`{inner.text}` is driven by this instance, `{outer.span.text}` is an input topic",
            inner.span.to(outer.span),
            "an input topic is not driven through a wire of another instance",
            also=((topic.span, "declared `input` here"),) if not names[0] else (),
            helps=helps,
        )

    def is_reversed(self, what: object, inner: typed.TopicSymbol, outer: typed.TopicSymbol) -> bool:
        """Whether an instance of `what` would drive, through its topic `inner`, an input topic."""
        return outer.input and not inner.input and self._drives(what, inner)

    def _drives(self, what: object, topic: typed.TopicSymbol) -> bool:
        if isinstance(what, typed.NodeSymbol):
            return topic in what.publishes
        if isinstance(what, typed.PlantSymbol):
            return any(t is topic for t, _ in what.drives)
        if isinstance(what, typed.ModuleSymbol):
            return topic in what.sc.publishes
        if not isinstance(what, typed.SystemSymbol):
            return False
        return any(
            self._drives(i.what, inner)
            for i in what.instances
            for inner in (topic, *(k for k, outer in i.renames.items() if outer is topic))
            if inner is not topic or topic not in i.renames
        )

    def _beside(self, path: tree.DottedPath, scope: FileScope) -> typed.TopicSymbol | None:
        names = path.parts
        if len(names) <= 2:
            first = names[0] if len(names) == 2 else None
            return self.shared.topic_ref(tree.Ref(first, names[-1], path.span), scope)
        self._no_topic(path, None, 0)
        return None

    def _no_topic(self, path: tree.DottedPath, what: object, depth: int) -> None:
        """N004 for a path that leads to no topic."""
        helps: tuple[Help, ...] = ()
        notes: tuple[str, ...] = ("right of `=` stands a topic, or a topic of another instance",)
        prefix = ".".join(n.text for n in path.parts[:depth])
        rest = path.parts[depth] if depth < len(path.parts) else path.parts[-1]
        if isinstance(what, typed.SystemSymbol):
            topics = [t.name.rsplit(".", 1)[-1] for t in self.shared.topics_of(what)]
            helps = self.shared.diagnostics.did_you_mean(rest.text, topics, rest.span)
        elif what is not None:
            notes = (*notes, "only a system has topics of its own: others use those beside them")
        message = (
            f"`{prefix}` has no topic `{rest.text}`" if depth else f"`{path.text}` is no topic"
        )
        if depth == len(path.parts):
            message = f"`{prefix}` is an instance, not a topic"
        self.shared.diagnostics.error("N004", message, path.span, notes=notes, helps=helps)


class SettingReader:
    """Reads what systems and tests set."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared

    def all(
        self,
        items: Iterable[tuple[str, tree.SetParam]],
        system: typed.SystemSymbol,
        scope: FileScope,
    ) -> list[typed.SetSymbol]:
        """Each `(instance whose braces it stands in, or "", item)`; N002 where one is set twice."""
        setting_by_key: dict[tuple[str, typed.ParamSymbol], typed.SetSymbol] = {}
        for home, item in items:
            symbol = self._one(home, item, system, scope)
            if symbol is None:
                continue
            key = symbol.path, symbol.param
            first = setting_by_key.setdefault(key, symbol)
            if first is not symbol:
                name = f"{symbol.path}.{item.param.parts[-1].text}".lstrip(".")
                self.shared.diagnostics.error(
                    "N002",
                    f"`{name}` is set twice",
                    symbol.span,
                    "again",
                    also=((first.span, "the first time"),),
                )
        return list(setting_by_key.values())

    def _one(
        self, home: str, item: tree.SetParam, system: typed.SystemSymbol, scope: FileScope
    ) -> typed.SetSymbol | None:
        names = item.param.parts
        inside = system.by_name
        if home:
            what = inside[home].what
            inside = what.by_name if isinstance(what, typed.SystemSymbol) else {}
        depth = 0
        if not (names[0].text in scope.imports and names[0].text not in inside):
            _, depth = find_instance(inside, names[:-1])
        path = ".".join([*filter(None, [home]), *(n.text for n in names[:depth])])
        rest = names[depth:]
        if len(rest) > 2 or (len(rest) == 2 and rest[0].text not in scope.imports):
            self._no_instance(item, rest[0], system, inside)
            return None
        ref = tree.Ref(
            rest[0] if len(rest) == 2 else None, rest[-1], rest[0].span.to(rest[-1].span)
        )
        param = self._param(ref, scope)
        if param is None:
            return None
        value = self.shared.constant(item.value, scope, param.type, f"the value of `{ref.text}`")
        if value is None:
            return None
        return typed.SetSymbol(path, param, value, item.param.span)

    def _no_instance(
        self,
        item: tree.SetParam,
        name: tree.Name,
        system: typed.SystemSymbol,
        inside: Mapping[str, typed.InstanceSymbol],
    ) -> None:
        if system in self.shared.damaged or name.text in self.shared.lost.get(system, ()):
            self.shared.names.losses += 1
            return
        self.shared.diagnostics.error(
            "M013",
            f"there is no instance `{name.text}` whose parameter could be set",
            item.param.span,
            helps=_instances_of(name, inside)
            or self.shared.diagnostics.did_you_mean(name.text, inside, name.span),
        )

    def _param(self, ref: tree.Ref, scope: FileScope) -> typed.ParamSymbol | None:
        entry = self.shared.names.find_ref(scope, ref, "parameter")
        symbol = self.shared.resolve(entry, ref.span) if entry else None
        if entry is not None and entry.kind != "parameter":
            self.shared.diagnostics.error(
                "N003",
                f"`{ref.text}` is a {entry.kind}, not a parameter",
                ref.span,
                also=((entry.decl.name.span, "declared here"),),
                helps=("declare it with `param`",) if entry.kind == "constant" else (),
            )
        return symbol if isinstance(symbol, typed.ParamSymbol) else None


def _instances_of(name: tree.Name, inside: Mapping[str, typed.InstanceSymbol]) -> tuple[Help, ...]:
    """The instances of the plant, node or system `name`, which stands where one of them does."""
    paths = [p for p, i in inside.items() if i.what.name.rpartition(".")[2] == name.text]
    if not paths:
        return ()
    last = f" to `{paths[-1]}`" if len(paths) > 1 else ""
    helps = replace(name.span, paths[0], f"name an instance of it: `{paths[0]}`{last}")
    return (helps,)


def deployed_system(
    shared: Shared, decl: tree.SystemDecl, scope: FileScope
) -> typed.SystemSymbol | None:
    """The system that `deploys` names; None where nothing is named, or nothing that is one."""
    if decl.deploys is None:
        return None
    entry = shared.names.find_ref(scope, decl.deploys, "system")
    symbol = shared.resolve(entry, decl.deploys.span) if entry is not None else None
    if isinstance(symbol, typed.SystemSymbol):
        return symbol
    if entry is not None and entry.kind != "system":
        shared.diagnostics.error(
            "N003",
            f"`{decl.deploys.text}` is a {entry.kind}, not a system",
            decl.deploys.span,
            also=((entry.decl.name.span, "declared here"),),
            notes=("`deploys` names the system in which the modules were proved",),
        )
    return None


def externals(
    shared: Shared, decl: tree.SystemDecl, scope: FileScope
) -> tuple[typed.ExternalSymbol, ...]:
    """Every external topic of a system, each once."""
    context = Context(scope, f"system `{decl.name.text}`")
    external_by_topic: dict[typed.TopicSymbol, typed.ExternalSymbol] = {}
    for item in decl.externals:
        at = shared.topic_path(item.topic, scope)
        every = _time(shared, item.every, context, "`every`")
        delayed = _time(shared, item.delayed, context, "`delayed`")
        if at is None:
            continue
        topic, below, _ = at
        if below:
            _no_topic(shared, item)
        elif topic in external_by_topic:
            _twice(shared, item.topic, external_by_topic[topic].span)
        else:
            measured = tuple(_measured(shared, item, topic, context))
            external_by_topic[topic] = typed.ExternalSymbol(
                topic, every, delayed, measured, item.topic.span
            )
    return tuple(external_by_topic.values())


def _time(
    shared: Shared, e: tree.SyntaxExpr | None, context: Context, what: str
) -> typed.TypedExpr | None:
    return None if e is None else sound(shared.number(e, context, DURATION, what))


def _no_topic(shared: Shared, item: tree.ExternalTopic) -> None:
    shared.diagnostics.error(
        "N003",
        f"`{item.topic.text}` is a part of a topic",
        item.topic.span,
        notes=("a topic is published and read as a whole",),
        helps=(f"write `external topic {item.topic.parts[0].text};`",),
    )


def _twice(shared: Shared, again: tree.DottedPath, first: Span) -> None:
    message = f"`{again.text}` is said twice to be outside"
    shared.diagnostics.error("N002", message, again.span, "again", also=((first, "before"),))


def _measured(
    shared: Shared, item: tree.ExternalTopic, topic: typed.TopicSymbol, context: Context
) -> Iterator[typed.MeasuredSymbol]:
    """The errors of its leaves, each given once."""
    taken: list[tuple[tuple[str, ...], Span]] = []
    for path, bound in item.measured:
        within = shared.number(bound, context, FLOAT, "the bound of an error")
        at = shared.topic_path(path, context.scope)
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
                f"only floats and vectors are measured with an error, not {a_type(t)}",
                path.span,
                helps=("name the fields that are floats",),
            )
        elif first is not None:
            message = f"the error of `{path.span.text}` is given twice"
            also = ((first, "the first time"),)
            shared.diagnostics.error("N002", message, path.span, "again", also=also)
        elif not is_error(within):
            yield typed.MeasuredSymbol(topic, below, within, path.span)
        taken.append((below, path.span))


def campaigned(
    shared: Shared,
    system: typed.SystemSymbol,
    decl: tree.SystemDecl,
    inside: Context,
    faults: list[tree.SystemFault],
) -> None:
    """Fill in measures and faults; `inside`: the place of a property of the system."""
    system.measures = tuple(_measures(shared, decl.measures, inside))
    place = Context(inside.scope, f"the faults of `{decl.name.text}`")
    system.faults = tuple(_fault(shared, f, place) for f in faults)


def _measures(
    shared: Shared, items: tuple[tree.MeasureItem, ...], context: Context
) -> Iterator[typed.MeasureSymbol]:
    """What campaigns tell of its runs: a number each, with a name of its own."""
    seen: dict[str, Span] = {}
    place = Context(context.scope, "a measure")
    number = shared.number
    for item in items:
        first = seen.setdefault(item.name.text, item.name.span)
        if first is not item.name.span:
            message = f"measure `{item.name.text}` is said twice"
            also = ((first, "the first time"),)
            shared.diagnostics.error("N002", message, item.name.span, "again", also=also)
        value = shared.check_expr(item.value, context, FLOAT)
        parts = (
            number(item.interval.low, place, FLOAT, "the range of a histogram"),
            number(item.interval.high, place, FLOAT, "the range of a histogram"),
            number(item.bins, place, INT, "the number of bins"),
            number(item.every, place, DURATION, "`every`"),
        )
        if not any(is_error(e) for e in (value, *parts)):
            yield typed.MeasureSymbol(item.name.text, value, *parts, item.span)


def _fault(shared: Shared, item: tree.SystemFault, context: Context) -> typed.SystemFaultSymbol:
    """One item of `faults { ... }`."""
    wanted = DURATION if item.kind in {"late", "overrun"} else FLOAT

    def checked(e: tree.SyntaxExpr | None, what: str, t: Type) -> typed.TypedExpr | None:
        return None if e is None else sound(shared.number(e, context, t, what))

    if item.target is not None:
        mentioned(item.target, context.scope)
    amounts = [checked(e, f"`{item.kind}`", wanted) for e in item.by]
    return typed.SystemFaultSymbol(
        kind=item.kind,
        path=item.target.text if item.target is not None else "",
        by=tuple(e for e in amounts if e is not None),
        rate=checked(item.rate, "how often", FLOAT),
        per=checked(item.per, "`per`", DURATION),
        lasts=checked(item.lasts, "`for`", DURATION),
        text=" ".join(item.span.text.split()).rstrip(" ;"),
        span=item.span,
    )


def mentioned(path: tree.DottedPath, scope: FileScope) -> None:
    """A name that is only replaced or disturbed counts as used."""
    for part in path.parts:
        if part.text in scope.entries:
            scope.entries[part.text].used = True
        elif part.text in scope.imports:
            scope.used_imports.add(part.text)
