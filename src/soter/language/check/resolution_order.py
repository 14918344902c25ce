"""In which order declarations are resolved.

Purpose: resolution follows names on demand, one call inside another; here a program of many
declarations is put into an order in which what is needed comes first, so that no chain of
constants or systems, however long, nests deeper than Python allows.
Non-goals: finding cycles (`checker.py` reports them when it meets them).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.span import Span
    from soter.language.check.scope import Entry, FileScope, Names

    Circle = tuple[list[Entry], Span]
    # entries that need each other in turn, and where the last needs the first

SHORT = 50
"""A program of so few declarations cannot have a long chain."""

CHAINING = {"type", "constant", "parameter", "function", "system"}
"""Declarations that can need one of their own kind."""


def in_order_of_need(entries: list[Entry], names: Names) -> tuple[list[Entry], list[Circle]]:
    """The entries, each after the ones it mentions, and the circles that stand in the way.

    Functions may mention names that are locals of theirs, so circles through them are left to
    the checker.
    """
    if len(entries) <= SHORT:
        return entries, []
    ordered: list[Entry] = []
    circles: list[Circle] = []
    seen: set[int] = set()
    for root in entries:
        if id(root) in seen:
            continue
        seen.add(id(root))
        open_ = {id(root)}
        path = [(root, _needs(root, names))]
        while path:
            entry, needs = path[-1]
            need = next(needs, None)
            if need is None:
                ordered.append(entry)
                open_.discard(id(entry))
                path.pop()
                continue
            needed, span = need
            if id(needed) not in seen:
                seen.add(id(needed))
                open_.add(id(needed))
                path.append((needed, _needs(needed, names)))
            elif id(needed) in open_:
                stack = [e for e, _ in path]
                circle = stack[next(i for i, e in enumerate(stack) if e is needed) :]
                if all(e.kind != "function" for e in circle):
                    circles.append((circle, span))
    return ordered, circles


def _needs(entry: Entry, names: Names) -> Iterator[tuple[Entry, Span]]:
    """Entries that a declaration mentions and that could lead to a long chain, and where."""
    if entry.kind not in CHAINING:
        return
    for qualifier, name, span in mentioned(entry.decl):
        scope: FileScope | None = entry.scope
        if qualifier is not None:
            scope = entry.scope.imports.get(qualifier)
        dependency = scope.entries.get(name) if scope is not None else None
        if dependency is None and qualifier is None:
            dependency = names.prelude.get(name)
        if (
            dependency is not None
            and dependency.kind in CHAINING
            and not dependency.scope.loaded.prelude
        ):
            yield dependency, span


def mentioned(root: object) -> Iterator[tuple[str | None, str, Span]]:
    """`(qualifier, name, place)` of all names below a piece of syntax that may be declared."""
    todo = [root]
    while todo:
        node = todo.pop()
        if isinstance(node, tuple):
            todo.extend(reversed(node))
        elif isinstance(node, tree.Ref):
            yield (node.qualifier.text if node.qualifier else None), node.name.text, node.span
        elif isinstance(node, tree.NameExpr):
            yield None, node.name.text, node.span
        elif hasattr(node, "__dataclass_fields__"):
            if isinstance(node, tree.FieldExpr) and isinstance(node.target, tree.NameExpr):
                yield node.target.name.text, node.field.text, node.span
            fields = node.__dataclass_fields__
            todo.extend(getattr(node, f) for f in reversed(fields) if not f.endswith("span"))
