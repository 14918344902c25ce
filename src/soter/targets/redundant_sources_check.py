"""Several sources of a topic against what the deploying system declares of it.

Purpose: D015, with the figures, for a source that is worse than `external topic` says, alone or at
a takeover; and what was compared, in words.
Non-goals: how sources take over (`mapping/topic_sources.py`), the proof, which rests on what the
system declares and on nothing of a mapping (`verify/deploy/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.durations import show_ns
from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import External, System, Topic
    from soter.mapping.topic_mapping import TopicMap
    from soter.mapping.topic_sources import SourcePromise


def several(mapped: Sequence[TopicMap]) -> dict[int, list[tuple[TopicMap, SourcePromise]]]:
    """By topic its sources, the preferred first; topics with one are left out."""
    by_topic: dict[int, list[tuple[TopicMap, SourcePromise]]] = {}
    for m in mapped:
        if m.promise is not None:
            by_topic.setdefault(m.topic.index, []).append((m, m.promise))
    return by_topic


def broken_promises(system: System, mapped: Sequence[TopicMap]) -> Iterator[str]:
    """Where a source gives less than the system declares."""
    declared = {e.topic: e for e in system.externals}
    stepped = _of_plants_in_steps(system.proved)
    for index, sources in several(mapped).items():
        topic = system.topics[index]
        if topic.driver != "input" and index in declared:
            yield f"`{topic.name}` goes out: it has no `sources`"
        elif topic.name in stepped:
            yield (
                f"`{topic.name}` shows a plant that moves in steps, and has to come with each of "
                "them: at a takeover one would be missing, so it has no `sources`"
            )
        elif index in declared:
            for m, promise in sources:
                yield from _too_old(topic, m, promise, declared[index])
                yield from _too_rough(topic, m, promise, declared[index])


def _of_plants_in_steps(proved: System | None) -> set[str]:
    """The topics whose reads the proof takes for the step of their instant (`next`)."""
    if proved is None:
        return set()
    return {
        proved.topics[c.scope.topics[topic]].name
        for c in proved.components
        if c.plant is not None and c.plant.next
        for topic, _ in c.plant.drives
    }


def _too_old(topic: Topic, m: TopicMap, promise: SourcePromise, e: External) -> Iterator[str]:
    if e.every_ns is None:
        return  # nothing rests on its age
    allowed = e.every_ns + (e.delay_ns or 0)
    if promise.oldest_ns > allowed:
        terms = [("every", promise.every_ns), ("delayed", promise.delayed_ns)]
        terms = [("after", promise.after_ns), *terms] if promise.rank else terms
        figures = " + ".join(f"{name} {show_ns(ns)}" for name, ns in terms)
        what = "when it takes over" if promise.rank else "alone"
        yield (
            f"`{topic.name}` may be {show_ns(promise.oldest_ns)} old with {m.channel} {what} "
            f"({figures}), and the system declares {_declared_age(e)}"
        )


def _too_rough(topic: Topic, m: TopicMap, promise: SourcePromise, e: External) -> Iterator[str]:
    for (path, t), most in zip(leaves(topic.type), e.errors, strict=True):
        own = promise.errors.get(path)
        if most is None or not isinstance(t, FloatType) or (own is not None and own <= most):
            continue
        name = ".".join((topic.name, *path))
        exactness = "does not say how exact it is" if own is None else f"is within {own!r}"
        yield f"`{name}` from {m.channel} {exactness}, and the system declares within {most!r}"


def compared(system: System, mapped: Sequence[TopicMap]) -> list[str]:
    """A line a topic of several sources: how old and how exact it is with each of them."""
    declared = {e.topic: e for e in system.externals}
    lines = []
    for index, sources in several(mapped).items():
        topic, e = system.topics[index], declared.get(index)
        parts = [_alone(topic, m, promise) for m, promise in sources]
        worst = max(promise.oldest_ns for _, promise in sources)
        against = f"of {_declared_age(e)}" if e is not None and e.every_ns else "nothing declared"
        parts.append(f"at a takeover at most {show_ns(worst)} old, {against}")
        lines.append(f"{topic.name}: {'; '.join(parts)}")
    return lines


def _alone(topic: Topic, m: TopicMap, promise: SourcePromise) -> str:
    """What a source gives by itself, in words."""
    errors = [
        f"{'.'.join((topic.name, *path)) if path else ''} within {error!r}".strip()
        for path, error in promise.errors.items()
    ]
    return ", ".join([f"{m.channel} at most {show_ns(promise.alone_ns)} old", *errors])


def _declared_age(e: External) -> str:
    assert e.every_ns is not None
    age = show_ns(e.every_ns + (e.delay_ns or 0))
    return f"{age} (every {show_ns(e.every_ns)}, delayed {show_ns(e.delay_ns or 0)})"
