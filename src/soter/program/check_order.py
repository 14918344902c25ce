"""In which order declarations are resolved.

Purpose: resolution follows names on demand, one call inside another; here a program of many
declarations is put into an order in which what is needed comes first, so that no chain of
constants or systems, however long, nests deeper than Python allows.
Non-goals: finding cycles (`checker.py` reports them when it meets them).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.program.scope import Entry, FileScope, Names

SHORT = 50
"""A program of so few declarations cannot have a long chain."""

CHAINING = {"type", "constant", "parameter", "function", "system"}
"""Declarations that can need one of their own kind."""


def in_order_of_need(entries: list[Entry], names: Names) -> list[Entry]:
    """The entries, each after the ones it mentions, as far as that is possible."""
    if len(entries) <= SHORT:
        return entries
    ordered: list[Entry] = []
    seen: set[int] = set()
    for root in entries:
        if id(root) in seen:
            continue
        seen.add(id(root))
        path = [(root, _needs(root, names))]
        while path:
            entry, needs = path[-1]
            needed = next((n for n in needs if id(n) not in seen), None)
            if needed is None:
                ordered.append(entry)
                path.pop()
            else:
                seen.add(id(needed))
                path.append((needed, _needs(needed, names)))
    return ordered


def _needs(entry: Entry, names: Names) -> Iterator[Entry]:
    """Entries that a declaration mentions and that could lead to a long chain."""
    if entry.kind not in CHAINING:
        return
    for qualifier, name in mentioned(entry.decl):
        scope: FileScope | None = entry.scope
        if qualifier is not None:
            scope = entry.scope.imports.get(qualifier)
        found = scope.entries.get(name) if scope is not None else None
        if found is None and qualifier is None:
            found = names.prelude.get(name)
        if found is not None and found.kind in CHAINING and not found.scope.loaded.prelude:
            yield found


def mentioned(root: object) -> Iterator[tuple[str | None, str]]:
    """`(qualifier, name)` of every name below a piece of syntax that may be a declaration's."""
    todo = [root]
    while todo:
        node = todo.pop()
        if isinstance(node, tuple):
            todo.extend(reversed(node))
        elif isinstance(node, tree.Ref):
            yield (node.qualifier.text if node.qualifier else None), node.name.text
        elif isinstance(node, tree.NameExpr):
            yield None, node.name.text
        elif hasattr(node, "__dataclass_fields__"):
            if isinstance(node, tree.FieldExpr) and isinstance(node.target, tree.NameExpr):
                yield node.target.name.text, node.field.text
            fields = node.__dataclass_fields__
            todo.extend(getattr(node, f) for f in reversed(fields) if not f.endswith("span"))
