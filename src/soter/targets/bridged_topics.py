"""Which topics of a mapping a middleware may carry: those that meet the world, each mapped whole.

Purpose: every mistake as D015, all of them at once.
Non-goals: what a mapping may say (`soter.mapping`), the code (`ros/`, `dds/`, `mavlink/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.mapping.topic_mapping import SignalSource
from soter.targets.redundant_sources_check import broken_promises

if TYPE_CHECKING:
    import re
    from collections.abc import Collection, Iterator

    from soter.language.model.system import System
    from soter.mapping.topic_mapping import LogMap, TopicMap


def bridged_topics(
    system: System, mapping: LogMap, middleware: str, name: re.Pattern[str] | None
) -> tuple[TopicMap, ...]:
    """Its topics, in order; SoterError D015 for what does not meet the world, or is not whole.

    `name`: what a topic of the middleware may be called; None: it has none. Of a system without a
    world of its own, which has its plants inside, every topic may be carried.
    """
    outside = {e.topic for e in system.externals}
    outside = outside or {t.index for t in system.topics if t.queue_of is None and not t.held}
    problems = []
    for m in mapping.topics:
        named = f"`{m.topic.name}`"
        if m.topic.index not in outside:
            problems.append(f"{named} does not meet the world: nobody declares it `external topic`")
        if name is not None and system.externals:
            problems += _of_the_other_way(m)
        if name is None:
            pass
        elif m.channel is None:
            problems.append(f"{named} has no `channel`: which topic of {middleware} is it?")
        elif not name.fullmatch(m.channel):
            problems.append(f"{named}: `{m.channel}` is no name of a topic of {middleware}")
        if m.where:
            problems.append(
                f"`where` of {named} chooses rows of a log: a bridge takes all messages"
            )
        if m.message is None:
            problems.append(f"{named} has no `type`: which messages are its?")
        elif m.stamp is not None and m.message.field(m.stamp.path).through == "sequence":
            problems.append(f"{named}: its `stamp` is in a list, which may be empty in a message")
    given = {m.topic.index for m in mapping.topics}
    for e in system.externals:
        topic = system.topics[e.topic]
        if topic.driver == "input" and e.topic not in given:
            problems.append(
                f"`{topic.name}` comes from the world, and the mapping does not say how"
            )
    problems += [p for m in mapping.topics if m.topic.driver != "input" for p in _filled_twice(m)]
    problems += [*_shared(mapping), *broken_promises(system, mapping.topics)]
    if problems:
        raise SoterError(tuple(Diagnostic("D015", p) for p in problems))
    return mapping.topics


def by_topic(mapped: tuple[TopicMap, ...], middleware: str) -> dict[int, TopicMap]:
    """The mapping by topic; SoterError D015 where one has several sources."""
    named = dict.fromkeys(m.topic.name for m in mapped if m.promise is not None)
    if named:
        why = f"has several `sources`: the bridges of ROS read them, that of {middleware} does not"
        raise SoterError(tuple(Diagnostic("D015", f"`{name}` {why}") for name in named))
    return {m.topic.index: m for m in mapped}


def _of_the_other_way(m: TopicMap) -> Iterator[str]:
    """What a mapping says of a topic that ROS and DDS would not look at."""
    if m.topic.driver == "input":
        if m.constants:
            yield f"`{m.topic.name}` comes in, and `set` is of what goes out"
        return
    if m.publisher is not None:
        yield f"`{m.topic.name}` goes out, and `publisher` is who sends what comes in"
    if m.frame_id is not None:
        yield f'`{m.topic.name}` goes out: `frame_id` is said in `set`, as "header.frame_id"'


def _filled_twice(mapped: TopicMap) -> Iterator[str]:
    """Fields of a message that goes out into which two leaves go: one of them would be lost."""
    leaf_by_field: dict[str, str] = {}
    for path, leaf in mapped.leaves.items():
        if isinstance(leaf, SignalSource):
            name = mapped.name_of(path)
            first = leaf_by_field.setdefault(leaf.name, name)
            if first != name:
                yield f"`{first}` and `{name}` go out in the same field, `{leaf.name}`"


def _shared(mapping: LogMap) -> Iterator[str]:
    """What is wrong with a channel of two: other messages, its own way back in, no other source."""
    by_channel: dict[str, TopicMap] = {}
    for m in mapping.topics:
        if m.channel is None:
            continue
        first = by_channel.setdefault(m.channel.lstrip("/"), m)  # `/a` may be what `a` is
        names = f"`{first.topic.name}` and `{m.topic.name}` share `{m.channel}`"
        if first is not m and first.topic.index == m.topic.index:
            yield f"two `sources` of `{m.topic.name}` are one topic: `{m.channel}`"
        elif first is not m and first.message != m.message:
            yield f"{names}, with messages of two types"
        elif first is not m and {first.topic.driver, m.topic.driver} != {"input"}:
            yield f"{names}, and one of them goes out: nobody else may publish it"


def unsaid(system: System, mapped: Collection[TopicMap], where: str) -> list[str]:
    """A note about what goes out and is not mapped."""
    said = {m.topic.index for m in mapped}
    names = [
        system.topics[e.topic].name
        for e in system.externals
        if e.topic not in said and system.topics[e.topic].driver != "input"
    ]
    text = f"not published {where}, as the mapping does not name it: {', '.join(names)}"
    return [text] if names else []
