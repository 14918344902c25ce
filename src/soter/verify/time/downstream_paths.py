"""From what SC publishes to the plants, through the flying system.

Purpose: for every output of a module the nodes that its commands pass on their way, where the
plants of the proof are abstractions (docs/proof.md, "The model of time").
Non-goals: times (`schedule.py`).

Three kinds of nodes stand there. One that also reads what comes from a plant is a controller of
its own and belongs, with everything behind it, to what the abstraction stands for: it is named, and
may not skip a command. One that reads commands only passes them on: its wait is counted, unless
it is released whenever SC is and declared behind the one before it, without times of its own: then
it runs behind SC in the module's thread, in the same instant. Below a shield that is asked of the
first one with sensors of its own, too, as it says until when a command of AC is taken over.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd
from typing import TYPE_CHECKING

from soter.language.model.tree_walk import topic_reads
from soter.verify.problem.verification_system import sc_reads
from soter.verify.time.always_publishes import UnfollowedError, must_publish, publishes_always

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Component
    from soter.verify.problem.verification_system import VerificationSystem

WAYS_MAX = 64


@dataclass(frozen=True, eq=False)
class DownstreamPath:
    """One way from an output to a plant: nodes whose wait counts, others that are named."""

    counted: tuple[Component, ...] = ()
    in_step: tuple[Component, ...] = ()
    inner: tuple[Component, ...] = ()


def find_downstream_paths(place: VerificationSystem) -> list[DownstreamPath]:
    """Every way from the module's outputs to a plant of the flying system.

    UnfollowedError where they are more than `WAYS_MAX`.
    """
    ways: list[DownstreamPath] = []
    for index in place.home.outputs:
        for nodes in _chains(place, index, ()):
            ways.append(_way(place, nodes))
            if len(ways) > WAYS_MAX:
                sc = place.flat.components[place.home.sc]
                raise UnfollowedError(sc, f"more than {WAYS_MAX} ways lead from it to plants")
    return ways


def _chains(
    place: VerificationSystem, index: int, seen: tuple[Component, ...]
) -> Iterator[tuple[Component, ...]]:
    """The nodes in order, of every way that ends at a plant and does not run in a circle."""
    for c in place.flat.components:
        if c.plant is not None and index in [c.scope.topics[t] for t in c.plant.reads]:
            yield seen
        if c.node is None or c in seen or index not in _read_by(place, c):
            continue
        for topic in c.node.publishes:
            yield from _chains(place, c.scope.topics[topic], (*seen, c))


def _read_by(place: VerificationSystem, c: Component) -> set[int]:
    """Topics that a node reads, those that reach it through a queue too."""
    assert c.node is not None
    topics = [place.flat.topics[c.scope.topics[s.topic]] for s in c.node.subscribes]
    return {t.index if t.queue_of is None else t.queue_of for t in topics}


def _way(place: VerificationSystem, nodes: tuple[Component, ...]) -> DownstreamPath:
    counted: list[Component] = []
    in_step: list[Component] = []
    before = -1
    for k, node in enumerate(nodes):
        assert node.node is not None
        if node.role != "node":
            raise UnfollowedError(node, "the AC of another module may publish anything there")
        if _reads_sensors(place, node, set(nodes[: k + 1])):
            if place.module.symbol.shield is not None and not counted and node.index > before:
                in_step += [node] if _prompt(place, node) else []
            return DownstreamPath(tuple(counted), tuple(in_step), nodes[k:])
        if any(
            place.flat.topics[node.scope.topics[s.topic]].queue_of is not None
            for s in node.node.subscribes
        ):
            raise UnfollowedError(node, "it reads a queue, whose commands may be of any age")
        after = nodes[k + 1] if k + 1 < len(nodes) else None
        for topic in node.node.publishes:
            published = node.scope.topics[topic]
            if after is None or published in _read_by(place, after):
                must_publish(node, published)
        if _in_step(place, node) and not counted and node.index > before:
            in_step.append(node)
            before = node.index
        else:
            counted.append(node)
    return DownstreamPath(tuple(counted), tuple(in_step))


def _prompt(place: VerificationSystem, node: Component) -> bool:
    """Whether a node with sensors of its own takes a command over behind SC, at every step."""
    assert node.node is not None
    always = all(publishes_always(node.node.step, t) for t in node.node.publishes)
    return always and is_state_of_proof(place, node) and _in_step(place, node)


def is_state_of_proof(place: VerificationSystem, node: Component) -> bool:
    """Whether all that a node publishes is read by the maps of `abstracts`."""
    assert node.node is not None
    shown = topic_reads(*(link.value for link in place.module.symbol.verify.abstracts))
    return set(node.node.publishes) <= shown.keys()


def _in_step(place: VerificationSystem, node: Component) -> bool:
    """Whether it is in the thread, released whenever SC is, and no times of it are declared."""
    if node.extern and not node.inline:
        return False
    sc = place.sc
    aligned = gcd(node.period_ns, sc.period_ns) == node.period_ns
    aligned = aligned and (sc.phase_ns - node.phase_ns) % node.period_ns == 0
    return aligned and all(place.declared(node, w) is None for w in ("late", "response"))


def _reads_sensors(place: VerificationSystem, node: Component, behind: set[Component]) -> bool:
    """Whether what it reads comes from a plant, not only through the nodes before it."""
    flat, todo, seen = place.flat, [node], {node}
    while todo:
        c = todo.pop()
        assert c.node is not None
        named = sc_reads(c.node)  # what it subscribes to and never looks at is no sensor of its own
        topics = [flat.topics[c.scope.topics[t]] for t in named]
        read = {t.index if t.queue_of is None else t.queue_of for t in topics}
        for other in flat.components:
            if other.plant is not None and read & {
                other.scope.topics[t] for t, _ in other.plant.drives
            }:
                return True
            if other.node is None or other in seen or other in behind or other.role != "node":
                continue
            if read & {other.scope.topics[t] for t in other.node.publishes}:
                seen.add(other)
                todo.append(other)
    return False
