"""What systems say about their instances: wires between them, parameters of theirs.

Purpose: the far end of a wire, a topic beside the instance or one of another instance; `set` of
the whole system, of an instance by its path, or in the braces of one.
Non-goals: whose value holds in the end, and where wires lead (`language/elaborate/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fix import insert, replace
from soter.language.check.expressions.field import find_instance
from soter.language.model import typed
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.diagnostics.fix import Help
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope


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
