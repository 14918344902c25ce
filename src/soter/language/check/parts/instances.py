"""Unrolls arrays of instances into single ones, and finds the topics at the far ends of wires.

Purpose: `Unroller` turns `for i in 0..3 { r[i]: Robot; }` into instances called `r[0]`, `r[1]`,
`r[2]`, and `r[(i + 1) % 3].pose` into a path with one of these names; later checks see names only.
`Wires` finds the topic at the far end of a wire, and reports what is wrong with a wire.
Non-goals: what the items mean (`system.py`); where wires lead in a flat system
(`language/elaborate/`); loops of steps (`language/check/statements.py`).
"""

from __future__ import annotations

import re
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar, cast

from soter.diagnostics.fixes import insert
from soter.language.check.dots_and_brackets import find_instance, names_of_chain
from soter.language.check.expression_base import CheckerPart
from soter.language.model import typed
from soter.language.model.types import INT
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Help, Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope

    Values = Mapping[str, int]

_VARIABLE = re.compile(r"[A-Za-z_]\w*")
_Item = TypeVar("_Item")

ITEMS_MAX = 10_000
"""Most items that the loops of one system or test may make."""


class _LostError(Exception):
    """An error for an item that is left out, because one of its errors was reported."""


class Unroller:
    """Unrolls the loops of one system or test, whose items may name the `instances`."""

    def __init__(
        self,
        shared: Shared,
        scope: FileScope,
        subject: str,
        instances: Mapping[str, typed.InstanceSymbol] | None = None,
    ) -> None:
        self.shared = shared
        self.scope = scope
        self.subject = subject
        self.instances = {} if instances is None else instances
        self._left = ITEMS_MAX
        self._arrays: dict[int, dict[str, int]] = {}

    # ------------------------------------------------------------ loops

    def named_instances(
        self, items: Sequence[tree.Instance | tree.Repeated]
    ) -> Iterator[tuple[tree.Name, tree.Instance, Values]]:
        """Yields the name of each instance, the instance, and the values of its loop variables."""
        for item, values in self._unrolled(items, {}):
            assert isinstance(item, tree.Instance)
            try:
                yield self._element_name(item.name, values), item, values
            except _LostError:
                self.shared.names.losses += 1
        self._arrays.clear()  # now that all instances are known

    def unroll(self, items: Sequence[_Item | tree.Repeated]) -> list[_Item]:
        """Gives the items of all rounds of loops, with numbers in place of the loop variables."""
        filled = (self.unrolled_item(item, values) for item, values in self._unrolled(items, {}))
        return [cast("_Item", item) for item in filled if item is not None]

    def unrolled_item(self, item: object, values: Values) -> object | None:
        """Gives the item with numbers for loop variables, `r[0]` for `r[i]`; None after errors."""
        try:
            concrete_item = self._unrolled_syntax(item, values)
        except _LostError:
            self.shared.names.losses += 1
            return None
        if values and isinstance(concrete_item, tree.PropertyItem):
            return replace(concrete_item, in_loop=True)
        return concrete_item

    def _unrolled(self, items: Sequence[object], values: Values) -> Iterator[tuple[object, Values]]:
        for item in items:
            if not isinstance(item, tree.Repeated):
                yield item, values
                continue
            try:
                bound = f"the bound of a loop of {self.subject}"
                low, high = (
                    self._constant_int(e, values, bound, "T007") for e in (item.low, item.high)
                )
            except _LostError:
                self.shared.names.losses += 1
                continue
            if high < low and not values:
                self._warn_of_empty_loop(item, low, high)
            for i in range(low, high):
                if self._left <= 0:
                    self._report_too_many(item)
                    self._left = -1
                    return
                self._left -= len(item.items)
                yield from self._unrolled(item.items, {**values, item.name.text: i})

    @property
    def has_too_many_items(self) -> bool:
        """Whether the loops made more than ITEMS_MAX items; the error has been reported already."""
        return self._left < 0

    def _report_too_many(self, item: tree.Repeated) -> None:
        if self._left < 0:
            return  # reported
        self.shared.names.losses += 1
        self.shared.diagnostics.error(
            "M007",
            f"the loops of {self.subject} come to more than {ITEMS_MAX} items",
            item.low.span.to(item.high.span),
            "here at the latest",
            notes=("everything that runs has a place in memory of its own from the start",),
        )

    def _warn_of_empty_loop(self, item: tree.Repeated, low: int, high: int) -> None:
        """Warns W011 of a loop that ends before it begins, unless a loop around sets its bounds."""
        name = item.name.text
        self.shared.diagnostics.warning(
            "W011",
            f"the loop over `{name}` makes nothing: it goes from {low} up to before {high}",
            item.low.span.to(item.high.span),
            "the end is less than the beginning",
            helps=(
                f"the end is the first number that is left out: `for {name} in 0..3` is 0, 1, 2",
            ),
        )

    def _constant_int(
        self, expr: tree.SyntaxExpr, values: Values, subject: str, code: Code = "T008"
    ) -> int:
        """Gives the value of a constant expression over loop variables; raises `_LostError`."""
        expr = self._unrolled_expr(expr, values)
        if isinstance(expr, tree.IntLit):
            return expr.value
        value = self.shared.const_value(expr, self.scope, INT, subject, None, code)
        if not isinstance(value, int):
            raise _LostError
        return value

    # ------------------------------------------------------------ filling in

    def _unrolled_expr(self, expr: tree.SyntaxExpr, values: Values) -> tree.SyntaxExpr:
        concrete_expr = self._unrolled_syntax(expr, values)
        assert isinstance(concrete_expr, tree.SyntaxExpr)
        return concrete_expr

    def _unrolled_syntax(self, node: object, values: Values) -> object:
        """Gives syntax with numbers for loop variables, and with `r[0]` for an element `r[i]`."""
        if isinstance(node, tuple):
            parts = tuple(self._unrolled_syntax(x, values) for x in node)
            return parts if any(a is not b for a, b in zip(parts, node, strict=True)) else node
        if isinstance(node, tree.NameExpr):
            return self._unrolled_variable(node, values)
        if isinstance(node, tree.Name):
            return self._element_name(node, values)
        if isinstance(node, tree.DottedPath):
            return self._unrolled_path(node, values)
        if isinstance(node, tree.IndexExpr):
            return self._unrolled_index(node, values)
        if not isinstance(node, _FILLED):
            return node
        called = isinstance(node, tree.CallExpr)
        changed: dict[str, Any] = {}
        for field in ["arguments"] if called else [f.name for f in fields(node)]:
            old = getattr(node, field)
            new = self._unrolled_syntax(old, values)
            if new is not old:
                changed[field] = new
        return replace(node, **changed) if changed else node

    def _unrolled_variable(self, node: tree.NameExpr, values: Values) -> tree.SyntaxExpr:
        value = values.get(node.name.text)
        if value is None:
            return node
        literal = tree.IntLit(node.span, abs(value))
        return literal if value >= 0 else tree.UnaryExpr(node.span, "-", literal)

    # ------------------------------------------------------------ elements

    def _element_name(self, name: tree.Name, values: Values) -> tree.Name:
        """Gives the name `r[0]` for `r[i]`."""
        if not isinstance(name, tree.ElementName):
            return name
        subject = f"the index of `{name.text}`"
        numbers = [self._constant_int(i, values, subject) for i in name.indices]
        text = name.text + "".join(f"[{n}]" for n in numbers)
        if any(n < 0 for n in numbers):
            self._report_no_element(text, name.span, (), name.indices, values)
        return tree.Name(text, name.span)

    def _unrolled_path(self, path: tree.DottedPath, values: Values) -> tree.DottedPath:
        """Gives a path with names such as `r[0]` for elements; reports a missing element."""
        if not any(isinstance(p, tree.ElementName) for p in path.parts):
            return path
        names: list[tree.Name] = []
        for part in path.parts:
            name = self._element_name(part, values)
            if isinstance(part, tree.ElementName):
                inside = self._instances_in(names)
                if inside is not None and name.text not in inside:
                    known = _element_names(inside, part.text)
                    self._report_no_element(name.text, name.span, known, part.indices, values)
            names.append(name)
        return tree.DottedPath(tuple(names), path.span)

    def _unrolled_index(self, node: tree.IndexExpr, values: Values) -> tree.SyntaxExpr:
        """Gives the name `r[0]` for `r[i]` if `r` is an array of instances, else the expression."""
        base: tree.SyntaxExpr = node
        indices: list[tree.SyntaxExpr] = []
        while isinstance(base, tree.IndexExpr):
            indices.append(base.index)
            base = base.target
        base = self._unrolled_expr(base, values)
        names = names_of_chain(base)
        inside = self._instances_in(names[:-1]) if names else None
        count = self._index_count(inside, names[-1].text) if names and inside is not None else 0
        if not names or not 0 < count <= len(indices):
            target = self._unrolled_expr(node.target, values)
            return replace(node, target=target, index=self._unrolled_expr(node.index, values))
        assert inside is not None
        numbers = [
            self._constant_int(i, values, f"the index of `{names[-1].text}`") for i in indices[::-1]
        ]
        text = names[-1].text + "".join(f"[{n}]" for n in numbers[:count])
        if text not in inside:
            known = _element_names(inside, names[-1].text)
            self._report_no_element(text, node.span, known, indices[::-1], values)
        name = tree.Name(text, node.span)
        result: tree.SyntaxExpr = (
            tree.FieldExpr(node.span, base.target, name)
            if isinstance(base, tree.FieldExpr)
            else tree.NameExpr(node.span, name)
        )
        for i in indices[: len(indices) - count][::-1]:
            result = tree.IndexExpr(node.span, result, self._unrolled_expr(i, values))
        return result

    def _instances_in(self, path: Sequence[tree.Name]) -> Mapping[str, typed.InstanceSymbol] | None:
        """Gives the instances inside the system at `path`; None if `path` names no system."""
        inside = self.instances
        for name in path:
            instance = inside.get(name.text)
            if instance is None or not isinstance(instance.what, typed.SystemSymbol):
                return None
            inside = instance.what.by_name
        return inside

    def _index_count(self, inside: Mapping[str, typed.InstanceSymbol], array: str) -> int:
        """Gives how many indices an element of the instance array has; 0 if it is no array."""
        known = self._arrays.get(id(inside))
        if known is None:
            known = self._arrays[id(inside)] = {
                n.partition("[")[0]: n.count("[") for n in inside if "[" in n
            }
        return known.get(array, 0)

    def _report_no_element(
        self,
        text: str,
        span: Span,
        known: Sequence[str],
        indices: Sequence[tree.SyntaxExpr],
        values: Values,
    ) -> None:
        notes: tuple[str, ...] = ()
        if known:
            last = f" to `{known[-1]}`" if len(known) > 1 else ""
            notes = (f"there is `{known[0]}`{last}",)
        variables = dict.fromkeys(v for i in indices for v in _VARIABLE.findall(i.span.text))
        at = " and ".join(f"`{v}` is {values[v]}" for v in variables if v in values)
        helps: tuple[Help, ...] = ()
        if len(indices) == 1 and isinstance(indices[0], tree.BinaryExpr) and at:
            index = indices[0].span.text
            below = "[-" in text
            around = f"({index}{f' + {len(known)}' if below else ''}) % {len(known) or 1}"
            sooner = f"let the loop {'begin later' if below else 'end sooner'}"
            helps = (sooner, f"or go around: `{around}`") if known else (sooner,)
        array = text.partition("[")[0]
        self.shared.diagnostics.error(
            "M020",
            f"the array of instances `{array}` has no `{text}`",
            span,
            f"where {at}" if at else "",
            notes=notes,
            helps=helps,
        )
        raise _LostError


def _element_names(inside: Mapping[str, object], array: str) -> list[str]:
    return [n for n in inside if n.partition("[")[0] == array and "[" in n]


_FILLED = (
    tree.SyntaxExpr,
    tree.IntervalExpr,
    tree.Instance,
    tree.PropertyItem,
    tree.Force,
    tree.Inline,
    tree.Replace,
    tree.SetParam,
    tree.DriveInput,
    tree.StatedValues,
    tree.TimingFaultItem,
    tree.SystemFault,
)
"""Classes of syntax that may contain expressions or paths; references and types do not."""


class Wires(CheckerPart):
    """Finds the topics that instances are wired to."""

    def topic_at_far_end(
        self, path: tree.DottedPath, instances: dict[str, typed.InstanceSymbol], scope: FileScope
    ) -> typed.TopicSymbol | None:
        """Gives the topic of `topic`, `file.topic` or `instance.topic`; None after an error."""
        names = path.parts
        symbol, depth = find_instance(instances, names)
        if len(names) <= 2 and (depth == 0 or (len(names) == 1 and "[" not in names[0].text)):
            first = names[0] if len(names) == 2 else None
            return self.shared.topic_of_ref(tree.Ref(first, names[-1], path.span), scope)
        if isinstance(symbol, typed.SystemSymbol) and len(names) == depth + 1:
            for topic in self.shared.topics_of_system(symbol):
                if topic.name.rsplit(".", 1)[-1] == names[-1].text:
                    prefix = [n.text for n in names[:-1]]
                    return self.shared.topic_of_instance(symbol, prefix, topic, names[-1].span)
        if symbol in self.shared.damaged:
            self.shared.names.losses += 1
            return None
        self._report_path_without_topic(path, symbol, depth)
        return None

    def names_parameter(self, inner: tree.Ref, outer: tree.DottedPath, scope: FileScope) -> bool:
        """Whether a wire names a parameter; reports N003 if so, as wires cannot set parameters."""
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

    def report_reversed_wire(
        self, inner: tree.Ref, outer: tree.DottedPath, topic: typed.TopicSymbol
    ) -> None:
        """Reports M011 of a wire by which an instance would publish an input topic."""
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

    def is_reversed_wire(
        self, symbol: object, inner: typed.TopicSymbol, outer: typed.TopicSymbol
    ) -> bool:
        """Whether an instance of `symbol` would publish the input topic `outer` through a wire."""
        return outer.input and not inner.input and self._drives_topic(symbol, inner)

    def _drives_topic(self, symbol: object, topic: typed.TopicSymbol) -> bool:
        if isinstance(symbol, typed.NodeSymbol):
            return topic in symbol.publishes
        if isinstance(symbol, typed.PlantSymbol):
            return any(t is topic for t, _ in symbol.drives)
        if isinstance(symbol, typed.ModuleSymbol):
            return topic in symbol.sc.publishes
        if not isinstance(symbol, typed.SystemSymbol):
            return False
        return any(
            self._drives_topic(i.what, inner)
            for i in symbol.instances
            for inner in (topic, *(k for k, outer in i.renames.items() if outer is topic))
            if inner is not topic or topic not in i.renames
        )

    def _report_path_without_topic(self, path: tree.DottedPath, symbol: object, depth: int) -> None:
        """Reports N004 for a path that leads to no topic."""
        helps: tuple[Help, ...] = ()
        notes: tuple[str, ...] = ("right of `=` stands a topic, or a topic of another instance",)
        prefix = ".".join(n.text for n in path.parts[:depth])
        rest = path.parts[depth] if depth < len(path.parts) else path.parts[-1]
        if isinstance(symbol, typed.SystemSymbol):
            topics = [t.name.rsplit(".", 1)[-1] for t in self.shared.topics_of_system(symbol)]
            helps = self.shared.diagnostics.did_you_mean(rest.text, topics, rest.span)
        elif symbol is not None:
            notes = (*notes, "only a system has topics of its own: others use those beside them")
        message = (
            f"`{prefix}` has no topic `{rest.text}`" if depth else f"`{path.text}` is no topic"
        )
        if depth == len(path.parts):
            message = f"`{prefix}` is an instance, not a topic"
        self.shared.diagnostics.error("N004", message, path.span, notes=notes, helps=helps)
