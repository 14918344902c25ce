"""A flat system as a graph of boxes and arrows.

Purpose: `DiagramGraph` has components and topics with their periods, and modules as frames around
DM, AC and SC. Topics with the same writers and the same readers share a box, as nobody can follow
twenty parallel arrows.
Non-goals: places (`layered_layout.py`), drawing (`svg.py`); arrows for what only properties read
(the true state of a plant).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Component, Module, System


@dataclass(frozen=True)
class DiagramBox:
    """A box with text: `lines` are titles, and `caption` is below them in small letters.

    `kind`: plant, node, ac, sc, dm, topic or input. Arrows refer to boxes by `key`. `names`: the
    full names of all that the box shows, which are several if topics share it.
    """

    key: str
    kind: str
    lines: tuple[str, ...]
    caption: str = ""
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class ModuleFrame:
    """A module: a frame with a title around its AC, DM and SC."""

    key: str
    title: str
    inside: tuple[DiagramBox, ...]


Part = DiagramBox | ModuleFrame


@dataclass(frozen=True)
class Edge:
    """An arrow from one box or frame to another, by their keys."""

    source: str
    target: str


@dataclass(frozen=True)
class DiagramGraph:
    """The parts and arrows of a diagram. `first`: keys of parts to place at the top if possible."""

    title: str
    parts: tuple[Part, ...]
    arrows: tuple[Edge, ...]
    first: frozenset[str] = frozenset()


def boxes_in(part: Part) -> tuple[DiagramBox, ...]:
    """The boxes of a part, from left to right."""
    return (part,) if isinstance(part, DiagramBox) else part.inside


ROLES = {"ac": "AC", "sc": "SC", "dm": "DM"}
TOGETHER_MAX = 9
"""How many names stand in one box of topics at most."""


def graph_of(system: System) -> DiagramGraph:
    """The graph of a system, with each component and each topic of the program once."""
    frames = _module_frames(system)
    framed = {cell.key for frame in frames for cell in boxes_in(frame)}
    alone = [_component_box(c) for c in system.components if _box_key(c) not in framed]
    writers, readers = _topic_writers(system), _topic_readers(system)
    topics, boxes = _topic_boxes(system, writers, readers)
    arrows: dict[Edge, None] = {}
    for topic, box in boxes.items():
        arrows |= dict.fromkeys(Edge(key, box) for key in writers[topic])
        arrows |= dict.fromkeys(Edge(box, key) for key in _arrow_ends(frames, readers[topic]))
    plants = frozenset(_box_key(c) for c in system.components if c.plant is not None)
    return DiagramGraph(f"System {system.name}", (*alone, *frames, *topics), tuple(arrows), plants)


# ---------------------------------------------------------------- components


def _box_key(c: Component) -> str:
    return f"c:{c.name}"


def _component_box(c: Component) -> DiagramBox:
    """The box of a component, with its name, and below it the kind and period."""
    name = c.name.rpartition(".")[2] if c.role in ROLES else c.name
    lines = [ROLES[c.role]] if c.role in ROLES else []
    symbol = c.plant or c.node
    if c.role in {"plant", "node"} and symbol is not None and _leaf(symbol.name) != _leaf(name):
        lines.append(_leaf(symbol.name))
    lines.append(show_ns(c.period_ns))
    if c.extern:
        lines.append("extern")
    if c.takes_ns is not None:
        lines.append(f"takes {show_ns(c.takes_ns[1])}")
    if c.role == "dm":  # its title says so already
        name, lines = "DM", lines[1:]
    return DiagramBox(_box_key(c), c.role, (name,), " · ".join(lines), (c.name,))


def _leaf(name: str) -> str:
    return name.rpartition(".")[2]


def _module_frames(system: System) -> list[ModuleFrame]:
    """The frame of each module."""
    return [_module_frame(system, m) for m in system.modules]


def _module_frame(system: System, m: Module) -> ModuleFrame:
    inside = tuple(_component_box(system.components[i]) for i in (m.ac, m.dm, m.sc))
    held = "" if m.forced is None else f" (always {m.forced.upper()})"
    return ModuleFrame(f"m:{m.name}", f"{m.name}{held}", inside)


def _arrow_ends(frames: Iterable[ModuleFrame], readers: frozenset[str]) -> list[str]:
    """The keys where arrows to these readers end: a frame if all of its boxes read, else boxes."""
    left, ends = set(readers), []
    for frame in frames:
        inside = {cell.key for cell in frame.inside}
        if inside <= left:
            ends.append(frame.key)
            left -= inside
    return [*ends, *sorted(left)]


# ---------------------------------------------------------------- topics


def _program_topics(system: System) -> list[int]:
    """The indices of the program's topics, without queues and topics that only delay values."""
    return [t.index for t in system.topics if t.queue_of is None and not t.held]


def _topic_writers(system: System) -> dict[int, frozenset[str]]:
    """By topic: the keys of its writers; a module's outputs come from its frame."""
    writers_by_topic: dict[int, set[str]] = {i: set() for i in _program_topics(system)}
    gated = {i: f"m:{m.name}" for m in system.modules for i in m.outputs}
    for c in system.components:
        for i in c.writes:
            if i in writers_by_topic and not (c.module is not None and i in gated):
                writers_by_topic[i].add(_box_key(c))
    for i, key in gated.items():
        writers_by_topic[i].add(key)
    return {i: frozenset(keys) for i, keys in writers_by_topic.items()}


def _topic_readers(system: System) -> dict[int, frozenset[str]]:
    """By topic: keys of the components that read it."""
    readers_by_topic: dict[int, set[str]] = {}
    for c in system.components:
        read: list[int] = []
        if c.plant is not None or c.node is not None:
            read = c.reads
        elif c.module is not None:
            read = list(system.modules[c.module].reads)
        for i in read:
            source = system.topics[i].queue_of
            readers_by_topic.setdefault(i if source is None else source, set()).add(_box_key(c))
    return {i: frozenset(readers_by_topic.get(i, ())) for i in _program_topics(system)}


def _topic_boxes(
    system: System, writers: dict[int, frozenset[str]], readers: dict[int, frozenset[str]]
) -> tuple[list[DiagramBox], dict[int, str]]:
    """The boxes of topics, and by topic the key of its box; an unused topic has no box."""
    groups: dict[object, list[int]] = {}
    for i in _program_topics(system):
        if writers[i] or readers[i]:
            groups.setdefault((writers[i], readers[i], _is_from_outside(system, i)), []).append(i)
    topic_cells: list[DiagramBox] = []
    boxes: dict[int, str] = {}
    for group in groups.values():
        for start in range(0, len(group), TOGETHER_MAX):
            part = group[start : start + TOGETHER_MAX]
            names = tuple(system.topics[i].name for i in part)
            kind = "input" if _is_from_outside(system, part[0]) else "topic"
            topic_cells.append(DiagramBox(f"t:{names[0]}", kind, names, "", names))
            boxes |= dict.fromkeys(part, f"t:{names[0]}")
    return topic_cells, boxes


def _is_from_outside(system: System, topic: int) -> bool:
    """Whether only the environment sets a topic."""
    drawn = {d.topic for d in system.inputs} | {e.topic for e in system.externals}
    driven = system.topics[topic].driver
    return driven == "input" or (topic in drawn and driven in {"", "input"})
