"""What a system lacks whose topic nobody drives.

Purpose: for M005 the plants, modules and nodes of the program that would drive it, as edits.
Non-goals: the rule itself (`composition_check.py`).
"""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Edit, Fix, Span, insert

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Help
    from soter.language.model.system import Topic
    from soter.language.model.typed import SystemSymbol, TopicSymbol, TypedProgram

SHOWN = 2
_CAPITALS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def would_drive(program: TypedProgram, system: SystemSymbol, topic: Topic) -> tuple[Help, ...]:
    """Instances that would drive a topic of the system itself; nothing for those further inside."""
    if topic.name != topic.symbol.name:
        return ()
    declarations = itertools.islice(_drivers(program, system, topic.symbol), SHOWN)
    return tuple(added(system, item) for item in declarations)


def _drivers(program: TypedProgram, system: SystemSymbol, topic: TopicSymbol) -> Iterator[str]:
    """What the program declares, a system has not and would drive a topic, as items."""
    taken = {i.name for i in system.instances}
    there: set[object] = {i.what for i in system.instances}
    modules = program.modules.values()
    there |= {part for m in modules for part in (*m.own, *m.below)}
    for name, plant in program.plants.items():
        if plant not in there and any(t is topic for t, _ in plant.drives):
            yield f"{_instance(name, taken)}: {name};"
    for name, module in program.modules.items():
        if module not in there and topic in module.sc.publishes:
            yield f"module {name};"
    for name, node in program.nodes.items():
        if node not in there and topic in node.publishes:
            yield f"node {name};"


def _instance(name: str, taken: set[str]) -> str:
    """A name for an instance of a plant: `my_cart` for `MyCart`."""
    base = _CAPITALS.sub("_", name.rpartition(".")[2]).lower()
    while base in taken:
        base += "_2"
    return base


def added(system: SystemSymbol, item: str) -> Fix:
    """An item put in front of all others of a system."""
    text = system.span.source.text
    opener = text.find("{", system.span.end) + 1
    at = Span(system.span.source, opener, opener)
    return Fix(f"add `{item}` to system `{system.name}`", (Edit(at, f"\n  {item}"),))


def as_input(program: TypedProgram, topic: Topic) -> tuple[Help, ...]:
    """The declaration of a topic, made one of the environment's, if nothing ever drives it."""
    symbol = topic.symbol
    if any(symbol in n.publishes for n in program.nodes.values()) or any(
        symbol is t for p in program.plants.values() for t, _ in p.drives
    ):
        return ()
    name = topic.symbol.span
    text = name.source.text
    start = text.rfind("topic", 0, name.start)
    title = f"if the environment sets it, declare `input topic {name.text}`"
    if start < 0 or text[start + len("topic") : name.start].strip():
        return (title,)
    return (insert(Span(name.source, start, name.start), "input ", title),)
