"""Walks over checked trees: what an expression or a body contains.

Purpose: one definition of "the parts of a node", and the questions the later passes ask of it.
Non-goals: meaning; nothing here follows a call into the function.
"""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import TYPE_CHECKING, Any

from soter.language.model import typed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

_SKIPPED = {"type", "span", "fun", "param", "topic", "module", "variable"}


@cache
def _part_names(kind: type) -> tuple[str, ...]:
    """The fields of a class in which parts may stand."""
    if issubclass(kind, typed.Literal):
        return ()  # its value may be large, and is no code
    return tuple(n for n in getattr(kind, "__dataclass_fields__", {}) if n not in _SKIPPED)


def children(node: object) -> list[object]:
    """Direct typed sub-nodes of an expression, statement or place, in written order."""
    sub_nodes: list[object] = []
    kind: Any = type(node)
    for name in _part_names(kind):
        part = getattr(node, name)
        if isinstance(part, (typed.TypedExpr, typed.TypedStmt, typed.Place)):
            sub_nodes.append(part)
        elif isinstance(part, tuple):
            stack = [*reversed(part)]
            while stack:
                v = stack.pop()
                if isinstance(v, (typed.TypedExpr, typed.TypedStmt, typed.Place)):
                    sub_nodes.append(v)
                elif isinstance(v, tuple):
                    stack.extend(reversed(v))
    return sub_nodes


def nodes(roots: Iterable[object]) -> Iterator[object]:
    """Every typed node below `roots`, each before its parts, in written order."""
    todo = list(roots)
    todo.reverse()
    while todo:
        node = todo.pop()
        yield node
        todo.extend(reversed(children(node)))


def rewritten(node: Any, instead: Callable[[Any], Any]) -> Any:  # noqa: ANN401 - any part of a tree
    """Code with other expressions in the places of some; expressions have no effects.

    `instead` is asked of each, parts before the whole, and gives what it was given where it stays.
    """
    if isinstance(node, tuple):
        parts_ = tuple(rewritten(x, instead) for x in node)
        return node if all(a is b for a, b in zip(node, parts_, strict=True)) else parts_
    if not isinstance(node, (typed.TypedExpr, typed.TypedStmt, typed.Place)):
        return node
    names = [f.name for f in fields(node) if f.name not in ("type", "span", "fun")]
    parts = {name: rewritten(getattr(node, name), instead) for name in names}
    same = all(parts[name] is getattr(node, name) for name in names)
    new_node = node if same else replace(node, **parts)
    return instead(new_node) if isinstance(node, typed.TypedExpr) else new_node


def calls_in(*roots: object) -> list[typed.TypedCall]:
    """Calls of declared functions."""
    return [n for n in nodes(roots) if isinstance(n, typed.TypedCall)]


def topic_reads(*roots: object) -> dict[typed.TopicSymbol, typed.TypedExpr]:
    """Topics that are read, each with its first reading."""
    read_by_topic: dict[typed.TopicSymbol, typed.TypedExpr] = {}
    for node in nodes(roots):
        if isinstance(node, (typed.TopicRead, typed.AgeRead)):
            read_by_topic.setdefault(node.topic, node)
    return read_by_topic


def mode_reads(*roots: object) -> dict[typed.ModuleSymbol | str, typed.TypedExpr]:
    """Modules whose mode or margin is read, each with its first reading."""
    read_by_module: dict[typed.ModuleSymbol | str, typed.TypedExpr] = {}
    for node in nodes(roots):
        if isinstance(node, (typed.ModeRead, typed.MarginRead)):
            read_by_module.setdefault(node.module, node)
    return read_by_module


def margin_reads(*roots: object) -> set[typed.ModuleSymbol | str]:
    """Modules whose margin is read."""
    return {n.module for n in nodes(roots) if isinstance(n, typed.MarginRead)}


def topics_mentioned(what: object) -> list[typed.TopicSymbol]:
    """Topics that a plant, a node or a module reads or writes."""
    if isinstance(what, typed.NodeSymbol):
        return [*(s.topic for s in what.subscribes), *what.publishes]
    if isinstance(what, typed.PlantSymbol):
        return [*what.reads, *(t for t, _ in what.drives)]
    if isinstance(what, typed.ModuleSymbol):
        nodes_ = [*topics_mentioned(what.ac), *topics_mentioned(what.sc)]
        below = [t for m in what.below for t in topics_mentioned(m)]
        reads = [*what.topics_read, *topic_reads(*what.expressions), *what.moved]
        return [*nodes_, *below, *reads, *what.acknowledgements]
    return []


def topics_beside(system: typed.SystemSymbol) -> list[typed.TopicSymbol]:
    """The topics that stand beside the instances of a system, wires applied."""
    topics: dict[typed.TopicSymbol, None] = {}
    for instance in system.instances:
        if isinstance(instance.what, typed.SystemSymbol):
            for outer in instance.renames.values():
                topics.setdefault(outer)
        for topic in topics_mentioned(instance.what):
            topics.setdefault(instance.renames.get(topic, topic))
    return list(topics)


def chooses(*roots: object) -> bool:
    """Whether some of it leaves a choice open."""
    return any(isinstance(n, typed.TypedChoose) for n in nodes(roots))


def plant_code(plant: typed.PlantSymbol) -> list[typed.TypedExpr]:
    """Every expression that a step of a plant evaluates."""
    lets, drives = [e for _, e in plant.lets], [e for _, e in plant.drives]
    return [*lets, *plant.next.values(), *plant.der.values(), *drives]


def chosen_lets(plant: typed.PlantSymbol) -> tuple[typed.Variable, ...]:
    """The lets of a plant that choose: they are evaluated once a step, and hold for all of it."""
    return tuple([v for v, e in plant.lets if chooses(e)])


def first_lets(
    plant: typed.PlantSymbol,
) -> tuple[tuple[typed.Variable, typed.TypedExpr], ...]:
    """The lets that a step evaluates first of all: up to the last one that chooses."""
    last = max((i for i, (_, e) in enumerate(plant.lets) if chooses(e)), default=-1)
    return plant.lets[: last + 1]
