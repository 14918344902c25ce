"""Holds what the targets `ros1`, `ros2`, `dds` and `mavlink`, which bridge to a middleware, share.

Purpose: a `BridgedSystem` has the package of target `posix` around which a bridge is made, in its
own folder, and for each topic that goes out the fail-safe law, and when its writer counts as gone.
`bridged_topics` checks a mapping (D015, all mistakes at once): it may carry topics that meet the
world, each whole, with no source worse than `external topic` says, alone or at a takeover.
Non-goals: what a mapping may say (`soter.mapping`), the proof, which rests on what the system
declares (`verify/deploy/`), the code of bridges (`ros/`, `dds/`, `mavlink/`).
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from soter.codegen.c_names import field_name
from soter.codegen.unit import generate
from soter.diagnostics.diagnostic import mistake
from soter.language.model.types import FloatType, leaves, show_ns
from soter.mapping.mapping_errors import wrong_mapping_error
from soter.mapping.topic_mapping import LogMap, SignalSource, SourcePromise, TopicMap
from soter.targets import TRUSTED
from soter.targets.c99 import command_name
from soter.targets.package import Package, PackageFile
from soter.targets.posix_package import extern_nodes, posix_package
from soter.targets.world_interface import WorldTables

if TYPE_CHECKING:
    import re
    from collections.abc import Collection, Iterator, Sequence
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import External, System, Topic


LINKED = tuple(
    f"soter_{n}.c" for n in ("outside", "channel", "posix_check", "process", "status_text")
)
"""Files of the trusted folder that bridges are linked with: they open channels and report."""
COMMON = ("soter_bridge_common.h", "soter_stamp_numbers.h")
"""Files that all bridges in C share."""
SILENT_OF_LEASED_NS = 20_000_000
"""Without a value for so long, in ns, a leased topic's writer is gone: it writes each 0.5 ms."""
SILENT_PERIODS = 3


def sources_by_topic(mapped: Sequence[TopicMap]) -> dict[int, list[tuple[TopicMap, SourcePromise]]]:
    """Maps each topic that has several sources to these sources, the preferred one first."""
    by_topic: dict[int, list[tuple[TopicMap, SourcePromise]]] = {}
    for m in mapped:
        if m.promise is not None:
            by_topic.setdefault(m.topic.index, []).append((m, m.promise))
    return by_topic


def promise_mistakes(system: System, mapped: Sequence[TopicMap]) -> Iterator[str]:
    """Yields a mistake for each source that promises less of a topic than the system declares."""
    declared = {e.topic: e for e in system.externals}
    stepped = _topics_of_stepped_plants(system.proved)
    for index, sources in sources_by_topic(mapped).items():
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
                yield from _age_mistakes(topic, m, promise, declared[index])
                yield from _error_mistakes(topic, m, promise, declared[index])


def _topics_of_stepped_plants(proved: System | None) -> set[str]:
    """The names of topics that show plants which move in steps (`next`) in the proved system."""
    if proved is None:
        return set()
    return {
        proved.topics[c.scope.topics[topic]].name
        for c in proved.components
        if c.plant is not None and c.plant.next
        for topic, _ in c.plant.drives
    }


def _age_mistakes(topic: Topic, m: TopicMap, promise: SourcePromise, e: External) -> Iterator[str]:
    if e.every_ns is None:
        return  # the system declares no age
    allowed = e.every_ns + (e.delay_ns or 0)
    if promise.age_max_ns > allowed:
        terms = [("every", promise.every_ns), ("delayed", promise.delayed_ns)]
        terms = [("after", promise.after_ns), *terms] if promise.rank else terms
        figures = " + ".join(f"{name} {show_ns(ns)}" for name, ns in terms)
        when = "when it takes over" if promise.rank else "alone"
        yield (
            f"`{topic.name}` may be {show_ns(promise.age_max_ns)} old with {m.channel} {when} "
            f"({figures}), and the system declares {_age_text(e)}"
        )


def _error_mistakes(
    topic: Topic, m: TopicMap, promise: SourcePromise, e: External
) -> Iterator[str]:
    for (path, t), most in zip(leaves(topic.type), e.errors, strict=True):
        error = promise.errors.get(path)
        if most is None or not isinstance(t, FloatType) or (error is not None and error <= most):
            continue
        name = ".".join((topic.name, *path))
        exactness = "does not say how exact it is" if error is None else f"is within {error!r}"
        yield f"`{name}` from {m.channel} {exactness}, and the system declares within {most!r}"


def promise_notes(system: System, mapped: Sequence[TopicMap]) -> list[str]:
    """Notes on the greatest age and the errors of each source, for topics with several sources."""
    declared = {e.topic: e for e in system.externals}
    lines = []
    for index, sources in sources_by_topic(mapped).items():
        topic, e = system.topics[index], declared.get(index)
        parts = [_promise_text(topic, m, promise) for m, promise in sources]
        worst = max(promise.age_max_ns for _, promise in sources)
        against = f"of {_age_text(e)}" if e is not None and e.every_ns else "nothing declared"
        parts.append(f"at a takeover at most {show_ns(worst)} old, {against}")
        lines.append(f"{topic.name}: {'; '.join(parts)}")
    return lines


def _promise_text(topic: Topic, m: TopicMap, promise: SourcePromise) -> str:
    """Describes the greatest age and the errors that a source promises."""
    errors = [
        f"{'.'.join((topic.name, *path)) if path else ''} within {error!r}".strip()
        for path, error in promise.errors.items()
    ]
    return ", ".join([f"{m.channel} at most {show_ns(promise.own_age_max_ns)} old", *errors])


def _age_text(e: External) -> str:
    assert e.every_ns is not None
    age = show_ns(e.every_ns + (e.delay_ns or 0))
    return f"{age} (every {show_ns(e.every_ns)}, delayed {show_ns(e.delay_ns or 0)})"


def bridged_topics(
    system: System, mapping: LogMap, middleware: str, name: re.Pattern[str] | None
) -> tuple[TopicMap, ...]:
    """The topics of a mapping, in order; SoterError D015 reports all that a bridge cannot do.

    `name`: the pattern of the middleware's topic names; None if it has no names. If the system has
    its plants inside, a bridge may carry every topic.
    """
    outside = {e.topic for e in system.externals}
    outside = outside or {t.index for t in system.topics if t.queue_of is None and not t.held}
    problems: list[str] = []
    for m in mapping.topics:
        if m.topic.index not in outside:
            named = f"`{m.topic.name}`"
            problems.append(f"{named} does not meet the world: nobody declares it `external topic`")
        if name is not None and system.externals:
            problems += _direction_mistakes(m)
        if name is not None:
            problems += _channel_mistakes(m, middleware, name)
        problems += _message_mistakes(m)
    problems += _unmapped_mistakes(system, mapping)
    problems += [p for m in mapping.topics for p in _shared_field_mistakes(m)]
    problems += [*_shared_channel_mistakes(mapping), *promise_mistakes(system, mapping.topics)]
    if problems:
        raise wrong_mapping_error(problems)
    return mapping.topics


def maps_by_topic(mapped: tuple[TopicMap, ...], middleware: str) -> dict[int, TopicMap]:
    """The mapping of each topic by its index; SoterError D015 if a topic has several sources."""
    if named := dict.fromkeys(m.topic.name for m in mapped if m.promise is not None):
        why = f"has several `sources`: the bridges of ROS read them, that of {middleware} does not"
        raise wrong_mapping_error(f"`{name}` {why}" for name in named)
    return {m.topic.index: m for m in mapped}


def _unmapped_mistakes(system: System, mapping: LogMap) -> Iterator[str]:
    """Yields a mistake for each topic that the outside world must provide but that is unmapped."""
    mapped = {m.topic.index for m in mapping.topics}
    for topic in (system.topics[e.topic] for e in system.externals):
        if topic.driver == "input" and topic.index not in mapped:
            yield f"`{topic.name}` comes from the world, and the mapping does not say how"


def _channel_mistakes(m: TopicMap, middleware: str, name: re.Pattern[str]) -> Iterator[str]:
    if m.channel is None:
        yield f"`{m.topic.name}` has no `channel`: which topic of {middleware} is it?"
    elif not name.fullmatch(m.channel):
        yield f"`{m.topic.name}`: `{m.channel}` is no name of a topic of {middleware}"


def _message_mistakes(m: TopicMap) -> Iterator[str]:
    named = f"`{m.topic.name}`"
    if m.where:
        yield f"`where` of {named} chooses rows of a log: a bridge takes all messages"
    if m.clip:
        yield f"`clip` of {named} is of a log: a bridge refuses what lies outside of its set"
    if m.message is None:
        yield f"{named} has no `type`: which messages are its?"
    elif m.stamp is not None and m.message.field_at(m.stamp.path).through == "sequence":
        yield f"{named}: its `stamp` is in a list, which may be empty in a message"


def _direction_mistakes(m: TopicMap) -> Iterator[str]:
    """Yields a mistake for each mapping entry that ROS and DDS ignore in the topic's direction."""
    if m.topic.driver == "input":
        if m.constants:
            yield f"`{m.topic.name}` comes in, and `set` is of what goes out"
        return
    if m.publisher is not None:
        yield f"`{m.topic.name}` goes out, and `publisher` is who sends what comes in"
    if m.frame_id is not None:
        yield f'`{m.topic.name}` goes out: `frame_id` is said in `set`, as "header.frame_id"'


def _shared_field_mistakes(mapped: TopicMap) -> Iterator[str]:
    """Yields a mistake if two leaves go out in the same field, so that one would be lost."""
    leaf_by_field: dict[str, str] = {}
    if mapped.topic.driver == "input":
        return
    for path, leaf in mapped.leaves.items():
        if isinstance(leaf, SignalSource):
            name = mapped.leaf_name(path)
            first = leaf_by_field.setdefault(leaf.name, name)
            if first != name:
                yield f"`{first}` and `{name}` go out in the same field, `{leaf.name}`"


def _shared_channel_mistakes(mapping: LogMap) -> Iterator[str]:
    """Yields a mistake for two topics on one channel: two types, one source, or one goes out."""
    by_channel: dict[str, TopicMap] = {}
    for m in mapping.topics:
        if m.channel is None:
            continue
        first = by_channel.setdefault(m.channel.lstrip("/"), m)  # `/a` may be what `a` is
        names = f"`{first.topic.name}` and `{m.topic.name}` share `{m.channel}`"
        if first is m:
            continue
        if first.topic.index == m.topic.index:
            yield f"two `sources` of `{m.topic.name}` are one topic: `{m.channel}`"
        elif first.message != m.message:
            yield f"{names}, with messages of two types"
        elif {first.topic.driver, m.topic.driver} != {"input"}:
            yield f"{names}, and one of them goes out: nobody else may publish it"


def qos_problems(m: TopicMap, *, inward: bool) -> Iterator[str]:
    """Yields a mistake for each quality of service that a ROS 2 topic must not have."""
    if inward and m.stamp is None and m.qos.durability == "transient_local":
        yield (
            f"`{m.topic.name}` has no stamp and is `transient_local`: what somebody published long "
            "ago would count as measured when it comes"
        )
    if not inward and m.qos.depth == 0:
        yield (
            f"`{m.topic.name}` goes out with all of its history: a reader that stopped would hold "
            "up what the others read"
        )


def unmapped_notes(system: System, mapped: Collection[TopicMap], where: str) -> list[str]:
    """A note that names outgoing topics without a mapping; no note if all are mapped."""
    named = {m.topic.index for m in mapped}
    names = [
        system.topics[e.topic].name
        for e in system.externals
        if e.topic not in named and system.topics[e.topic].driver != "input"
    ]
    text = f"not published {where}, as the mapping does not name it: {', '.join(names)}"
    return [text] if names else []


class BridgedSystem:
    """A system, its C (`unit`) and tables of its world; `trusted`: its `posix` package, if any."""

    def __init__(self, system: System, core: CoreSystem, folder: Path) -> None:
        self.system = system
        meets = bool(system.externals)
        self.trusted = posix_package(system, core, folder) if meets else Package(folder)
        self.unit = generate(system, core, apart=frozenset(x.index for x in extern_nodes(system)))
        self.world = WorldTables(system, self.unit)
        self.leased = {i: g for g in self.world.granted for i in g.module.outputs}
        self.command = command_name(self.unit.prefix)

    @property
    def has_actuators(self) -> bool:
        """Whether the trusted part includes an actuator program."""
        return bool(self.system.externals and self.world.granted)

    # ------------------------------------------------------------ the trusted folder

    def bridge_package(self, files: Sequence[PackageFile], notes: Sequence[str]) -> Package:
        """Makes the package of a bridge in C from the trusted part and these files and notes."""
        folder, name = self.trusted.folder, self.unit.prefix
        channels = f"/dev/shm/{name}"  # noqa: S108 - where channels belong
        return Package(
            folder,
            [*self.trusted_files(), *files],
            notes=[*self.trusted.notes, *notes],
            commands=[f"make -C {folder}", f"{folder}/build/{name}_bridge --channels {channels}"],
            programs=self.trusted_programs,
            trusted=TRUSTED,
        )

    def trusted_files(self) -> list[PackageFile]:
        """The files of the trusted part, with paths relative to the package's folder."""
        return [moved_into_folder(TRUSTED, f) for f in self.trusted.files]

    @cached_property
    def trusted_programs(self) -> dict[str, list[str]]:
        """The flags and sources of each program of the trusted part, relative to the package."""
        return {
            n: [_path_from_package(word) for word in words]
            for n, words in self.trusted.programs.items()
        }

    @cached_property
    def trusted_sources(self) -> dict[str, list[str]]:
        """The C files of each program of the trusted part."""
        return {
            n: [w for w in words if not w.startswith("-")]
            for n, words in self.trusted_programs.items()
        }

    @property
    def linked_sources(self) -> list[str]:
        """The C files of the trusted part that are linked into a bridge."""
        laws = [f"{self.command}_lease.c"] if self.has_actuators else []
        return [f"{TRUSTED}/{name}" for name in (*LINKED, *laws)]

    # ------------------------------------------------------------ topics

    def topic(self, index: int) -> Topic:
        """The topic with this index."""
        return self.system.topics[index]

    def value_type(self, index: int) -> str:
        """The C type of a topic's value."""
        return self.unit.topics[index][0]

    def channel_hash(self, index: int) -> str:
        """The number of a topic's layout, which the head of its channel holds, as C."""
        return f"UINT64_C({self.world.number(self.topic(index)):#018x})"

    def is_inward(self, index: int) -> bool:
        """Whether the topic is published by a program outside the system."""
        return self.topic(index).driver == "input"

    def silent_ns(self, index: int) -> int:
        """The time without a value, in ns, after which the writer of a channel counts as gone."""
        if index in self.leased:
            return SILENT_OF_LEASED_NS
        return SILENT_PERIODS * max(c.period_ns for c in self.system.components if c.plant is None)

    def law_statements(self, index: int) -> list[str]:
        """C (and C++) that fills `to` with the fail-safe law, or returns false without one."""
        lease = self.leased.get(index)
        if lease is None:
            return ["(void)to;", "return false;"]
        field = field_name(self.topic(index).symbol.name.rpartition(".")[2])
        kind = f"{lease.name}_command"
        return [
            f"const {kind}* const law =",
            f"    (const {kind}*){lease.name}_lease.law;",
            f"(void)memcpy(to, &law->{field}, sizeof({self.value_type(index)}));",
            "return true;",
        ]


def require_world(system: System) -> None:
    """Raises SoterError U001 for a system that has its plants inside: no mapping changes that."""
    if not system.externals:
        text = f"`{system.name}` meets no world: with its plants inside there is nothing to bridge"
        help_ = "`system S deploys ... { external topic t; ... }` (docs/deploy.md)"
        raise mistake("U001", text, help_)


def moved_into_folder(folder: str, file: PackageFile) -> PackageFile:
    """The same file with its path moved below this folder."""
    return PackageFile(f"{folder}/{file.path}", file.text, file.yours)


def _path_from_package(word: str) -> str:
    """A flag or source of a trusted program, with its path relative to the package."""
    if word.startswith("-I"):
        return f"-I{TRUSTED}/{word[2:]}" if word != "-I." else f"-I{TRUSTED}"
    return f"{TRUSTED}/{word}" if word.endswith(".c") else word
