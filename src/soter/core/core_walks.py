"""Finds, by walks over Core, which parts of the state a piece of code touches.

Purpose: `footprint_of` finds the topics, locals, states, modes and stamps that a step reads.
Reduction in the explorer and the frame of a proof rest on it. What a step writes follows from its
outputs (`cells_of_publication`) and locals. `operations` roughly measures what code costs, by which
campaigns decide what is worth a test at run time.
Non-goals: alias analysis (cells are whole topics, locals and states); times; the cost of a step
that a program may have (`language/model/tree_walk.py`); Core over other values (`execution.py`).
"""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import TYPE_CHECKING, Any

from soter.core import core
from soter.core.core import Call, If, Loop

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.core.core import Function, Stmt
    from soter.language.model.system import System

_NOT_WALKED = frozenset({"type", "span", "value"})
"""Fields that are no code, unless an expression stands in them."""


@cache
def _code_fields(kind: type) -> tuple[tuple[str, type | tuple[type, ...]], ...] | None:
    """Gives the fields of a class of Core, last first, with types of code in them; else None."""
    if not issubclass(kind, (core.Expr, core.Stmt)):
        return None
    code = (tuple, core.Expr, core.Stmt)
    return tuple(
        (f.name, core.Expr if f.name in _NOT_WALKED else code) for f in reversed(fields(kind))
    )


def walk(root: object) -> Iterator[object]:
    """Yields every Core expression and statement below `root`, in order."""
    stack = [root]
    while stack:
        node = stack.pop()
        if isinstance(node, tuple):
            stack.extend(reversed(node))
            continue
        kind: Any = type(node)
        parts = _code_fields(kind)
        if parts is None:
            continue
        yield node
        for name, code in parts:
            part = getattr(node, name)
            if isinstance(part, code):
                stack.append(part)


def footprint_of(statements: tuple[core.Stmt, ...]) -> core.Footprint:
    """Gives the cells, modes and stamps that some statements may read."""
    result = core.Footprint()
    for node in walk(statements):
        if isinstance(node, core.Get):
            result.reads.add(node.cell)
        elif isinstance(node, core.Fact):
            if node.fact == "mode":
                result.modes.add(node.index)
            elif node.fact == "age":
                result.stamps.add(node.index)
    return result


def written_names(statements: tuple[core.Stmt, ...]) -> set[str]:
    """Gives the names of temporaries that are assigned after their creation."""
    names = set()
    for n in walk(statements):
        if isinstance(n, (core.Set, core.Push)):
            names.add(n.name)
        elif isinstance(n, core.Choose) and n.ages is not None:
            names.add(n.ages)
    return names


def cells_of_publication(system: System, topic: int) -> list[core.Cell]:
    """Gives the cells that a publication changes: the topic and the queues behind it."""
    indices = (topic, *system.topics[topic].queues)
    return [core.Cell("topic", i, system.topics[i].name) for i in indices]


def outputs_always_published(code: tuple[core.Stmt, ...]) -> set[int]:
    """Gives the numbers of the outputs that a step publishes whichever branches it takes."""
    outputs: set[int] = set()
    for s in code:
        if isinstance(s, core.Publish):
            outputs.add(s.output)
        elif isinstance(s, core.If):
            outputs |= outputs_always_published(s.then) & outputs_always_published(s.otherwise)
    return outputs


def operations_by_name(functions: tuple[Function, ...]) -> dict[str, int]:
    """Gives function name -> its `operations`; `functions` has callees before their callers."""
    known: dict[str, int] = {}
    for f in functions:
        known[f.name] = operations(f.body, known)
    return known


def operations(body: tuple[Stmt, ...], known: dict[str, int]) -> int:
    """Gives roughly how many expressions a body evaluates at most; `known`: counts of functions."""
    count = 0
    for s in body:
        if isinstance(s, Loop):
            count += max(0, s.high - s.low) * operations(s.body, known)
        elif isinstance(s, If):
            count += operations(s.then, known) + operations(s.otherwise, known)
        else:
            count += sum(known[x.function] if isinstance(x, Call) else 1 for x in walk(s))
    return count
