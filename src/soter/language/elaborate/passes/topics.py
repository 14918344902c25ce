"""Finds the topic that a name means at a place in the flat system, or makes it there.

Purpose: follows wires to the home of a topic, and makes one topic for all that is wired together
when it is first mentioned. A node that collects messages gets a queue.
Non-goals: value sets (`value_sets.py`), hidden topics (`memory_topics.py`), who drives a topic.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.dots_and_brackets import quoted
from soter.language.elaborate.passes.system_numbers import TooLargeError
from soter.language.elaborate.passes.value_sets import set_and_default
from soter.language.model import typed
from soter.language.model.system import Topic
from soter.language.model.types import ListType

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.elaborate.passes.flattening import (
        Flattening,
        PlacedInstance,
        SubSystem,
        TopicKey,
        Wires,
    )


def topic_index_at(
    flat: Flattening, place: PlacedInstance | SubSystem, symbol: typed.TopicSymbol
) -> int:
    """Gives the index of the topic that `symbol` means at a place, and makes it if it is new.

    Raises TooLargeError if no room is left for its values.
    """
    key = home_of_topic(flat, symbol, place.prefix, place.wires)
    known = flat.topic_by_key.get(key)
    if known is None:
        prefix, symbol = key
        if not flat.sizes.has_room_for(symbol.type):
            raise TooLargeError
        with flat.with_params(flat.params_at[prefix]):
            bounds, declared, default = set_and_default(flat, symbol)
            max_age = flat.duration_ns(symbol.max_age, f"`max_age` of `{symbol.name}`")
        known = Topic(
            index=len(flat.topics),
            name=prefix + symbol.name,
            symbol=symbol,
            type=symbol.type,
            bounds=bounds,
            set_declared=declared,
            default=default,
            max_age_ns=max_age,
            driver="",
        )
        flat.topic_by_key[key] = known
        flat.topics.append(known)
    return known.index


def make_queue(flat: Flattening, source: Topic, subscribed: typed.Subscribed, node: str) -> int:
    """Makes the topic that queues values of `source`; gives its index, or raises TooLargeError."""
    assert subscribed.queue is not None
    t = ListType(source.type, subscribed.queue)
    if not flat.sizes.has_room_for(t):
        raise TooLargeError
    index = len(flat.topics)
    queue = Topic(
        index=index,
        name=f"{node}.{subscribed.topic.name}.queue",
        symbol=source.symbol,
        type=t,
        bounds=source.bounds,
        set_declared=source.set_declared,
        default=(),
        max_age_ns=None,
        driver="",
        queue_of=source.index,
        policy=subscribed.policy,
    )
    flat.topics.append(queue)
    source.queues = (*source.queues, index)
    return index


def home_of_topic(
    flat: Flattening, topic: typed.TopicSymbol, prefix: str, wires: list[Wires]
) -> TopicKey:
    """Gives the topic that a symbol means at a place, with the prefix of the topic's system."""
    if topic in flat.program.stand_ins:
        return _home_along_wires(flat, [*filter(None, prefix.split("."))], topic)
    for table in wires:
        if topic in table:
            return table[topic]
    return prefix, topic


def _home_along_wires(flat: Flattening, path: list[str], topic: typed.TopicSymbol) -> TopicKey:
    """Gives the topic, and the prefix of its system, to which wires lead from `topic` at `path`.

    Wires may lead from instance to instance; M021 is reported if they lead in a circle.
    """
    seen: dict[tuple[tuple[str, ...], typed.TopicSymbol], Span] = {}
    while True:
        while topic in flat.program.stand_ins:  # of a sub-system, which is further inside
            further, topic = flat.program.stand_ins[topic]
            path = [*path, *further]
        *outer, last = path or [""]
        instance = _system_at(flat, outer).by_name.get(last) if path else None
        if instance is None or topic not in instance.renames:
            return "".join(f"{p}." for p in path), topic
        place = tuple(path), topic
        if place in seen:
            _report_circle(flat, seen)
            return "", topic
        seen[place] = instance.rename_spans[topic]
        path, topic = outer, instance.renames[topic]


def _system_at(flat: Flattening, path: list[str]) -> typed.SystemSymbol:
    system = flat.symbol
    for name in path:
        declaration = system.by_name[name].what
        assert isinstance(declaration, typed.SystemSymbol)
        system = declaration
    return system


def _report_circle(
    flat: Flattening, seen: dict[tuple[tuple[str, ...], typed.TopicSymbol], Span]
) -> None:
    names = [".".join((*path, topic.name)) for (path, topic) in seen]
    spans = list(seen.values())
    first = min(spans, key=lambda span: span.start)
    flat.diagnostics.error(
        "M021",
        f"`{names[0]}` is wired to itself"
        if len(names) == 1
        else f"{quoted(sorted(names))} are wired in a circle",
        first,
        also=tuple((s, "and back here") for s in spans if s is not first)[:1],
        notes=("a wire gives a topic the place of another one: somewhere there must be one",),
        helps=("leave one of the wires out",),
    )
