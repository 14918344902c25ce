"""Paths to a part of a value, as `leaves` has them: `motion.x`, `j.q[0]`.

Purpose: what stands behind the name of a topic or of a plant in axes, `measured`, `commands` and
`moves`: fields, and elements of arrays by constant indices.
Non-goals: what the first name means (`declarations.py`, `verify_block.py`); elements of
lists, of which nobody knows beforehand whether they are there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.expressions.field import constant_index, instead_of_index
from soter.language.model import typed
from soter.language.model.types import INT, ArrayType, ErrorType, ListType, RecordType
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.span import Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope
    from soter.language.model.types import Type


def part_of(
    shared: Shared,
    root: Type,
    parts: Sequence[tree.Name],
    scope: FileScope,
    plant: typed.PlantSymbol | None = None,
) -> tuple[tuple[str, ...], Type] | None:
    """The path below `root`, which `parts[0]` means, and the type there; None after a report.

    `plant`: whose states `root` is.
    """
    t, path, whole = root, [], parts[0].span.to(parts[-1].span)
    for part in parts:
        if part is not parts[0]:
            field = _field(shared, t, part, plant if t is root else None)
            if field is None:
                return None
            t = field
            path.append(part.text)
        for index in part.indices if isinstance(part, tree.ElementName) else ():
            number = _index(shared, t, index, whole, scope)
            if number is None:
                return None
            assert isinstance(t, ArrayType)
            t = t.element
            path.append(f"[{number}]")
    return tuple(path), t


def instead_of(t: Type, path: tree.DottedPath) -> str:
    """What to write where a part of `t` was wanted, and `path`, all of it, was named."""
    if not isinstance(t, ArrayType):
        return "name one of its fields"
    return f"name one of its elements, `{path.span.text}[0]` to `{path.span.text}[{t.size - 1}]`"


def _field(
    shared: Shared, t: Type, part: tree.Name, plant: typed.PlantSymbol | None
) -> Type | None:
    at = t.index(part.text) if isinstance(t, RecordType) else None
    if isinstance(t, RecordType) and at is not None:
        return t.fields[at][1]
    if plant in shared.damaged:
        return None
    names = [n for n, _ in t.fields] if isinstance(t, RecordType) else []
    known = ", ".join(f"`{n}`" for n in names)
    what, there = ("field", "its fields") if plant is None else ("state", "there")
    shared.diagnostics.error(
        "N004",
        f"`{t if plant is None else plant.name}` has no {what} `{part.text}`",
        part.word,
        notes=(f"{there} are {known}",) if names else (),
        helps=shared.diagnostics.did_you_mean(part.text, names, part.word),
    )
    return None


def _index(
    shared: Shared, t: Type, index: tree.SyntaxExpr, path: Span, scope: FileScope
) -> int | None:
    """The value of an index in a path; None after a report."""
    value = shared.constant(index, scope, INT, "the index of an element")
    if not isinstance(value, int) or isinstance(t, ErrorType):
        return None
    number = typed.Literal(INT, index.span, value, str(value))
    target = index.span.source.text[path.start : index.span.start].rstrip(" \t\n[")
    if isinstance(t, ArrayType):
        return value if constant_index(shared.diagnostics, t, number, target) else None
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
        helps=instead_of_index(t, path, target, number) if ends else (),
    )
    return None
