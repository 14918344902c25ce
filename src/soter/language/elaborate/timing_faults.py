"""Enters the faults of time that a test permits.

Purpose: turns `late`, `skip` and `overrun` of a test, and the `takes` of nodes, into `TimingFault`s
of components, with diagnostics for impossible ones.
Non-goals: the `faults` of a system, which chance decides on (`faults.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.faults import components_named, refuse_path
from soter.language.elaborate.passes.memory_topics import refuse_overrun
from soter.language.model.system import TimingFault

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Span
    from soter.language.elaborate.passes.flattening import Flattening
    from soter.language.model import typed
    from soter.language.model.system import Component, System

MAX_SKIPS = 1_000
_VERBS = {"late": "be late", "skip": "skip a step", "overrun": "overrun"}


def overruns_of_takes(flat: Flattening, system: System) -> Iterator[TimingFault]:
    """Yields an overrun fault of every step for each node that declares `takes`."""
    for c in system.components:
        if c.takes_ns is not None:
            assert c.node is not None
            assert c.node.takes is not None
            low, high = c.takes_ns
            span = c.node.takes[0].span.to(c.node.takes[1].span)
            _require_no_queue(flat, system, c, span)
            yield TimingFault("overrun", c.index, high, 0, span, low)


def timing_faults(
    flat: Flattening, test: typed.TestSymbol, system: System
) -> Iterator[TimingFault]:
    """Yields the faults that a test declares, one for each component."""
    seen: dict[tuple[str, int], typed.FaultSymbol] = {}
    for item in test.faults:
        by = flat.duration_ns(item.by, f"`by` of `{item.path}`") if item.by is not None else 0
        at_most = flat.count(item.at_most, "`at most`", 1, MAX_SKIPS)
        for component in _components_of_fault(flat, system, item):
            first = seen.setdefault((item.kind, component.index), item)
            if first is not item:
                flat.diagnostics.error(
                    "N002",
                    f"`{item.kind}` of `{component.name}` is said twice",
                    item.span,
                    "again",
                    also=((first.span, "the first time"),),
                )
            elif item.kind == "overrun":
                _refuse_overrun(flat, system, component, item)
            skips = (at_most or 1) if item.kind == "skip" else 0
            yield TimingFault(item.kind, component.index, by or 0, skips, item.span)


def _components_of_fault(
    flat: Flattening, system: System, item: typed.FaultSymbol
) -> list[Component]:
    """Gives the components that a path names; reports E009 if such a fault is impossible there."""
    components = components_named(system, item.path)
    if not components:
        if not flat.partial:
            verb = _VERBS[item.kind]
            refuse_path(system, item.path, item.span, flat.diagnostics, verb=verb, plants=False)
        return []
    wrong = {c.role for c in components} & (
        {"plant", "dm"} if item.kind == "overrun" else {"plant"}
    )
    if not wrong:
        return components
    plant = "plant" in wrong
    flat.diagnostics.error(
        "E009",
        f"`{item.path}` is a {'plant' if plant else 'decision module'}: it cannot "
        f"{_VERBS[item.kind]}",
        item.span,
        also=((components[0].span, "declared here"),),
        notes=("physical time is never skewed",)
        if plant
        else ("a decision module publishes nothing that could come late",),
        helps=() if plant else (f"let its step be late: `late {item.path} by ...;`",),
    )
    return []


def _refuse_overrun(
    flat: Flattening, system: System, c: Component, item: typed.FaultSymbol
) -> None:
    assert c.node is not None
    refuse_overrun(system, c, f"overrun {item.path}", flat.diagnostics)
    if c.takes_ns is None:
        _require_no_queue(
            flat, system, c, item.span, f"let it be late instead: `late {item.path} by ...;`"
        )
        return
    assert c.node.takes is not None
    flat.diagnostics.error(
        "N002",
        f"how long a step of `{c.name}` takes is said twice",
        item.span,
        "an overrun",
        also=((c.node.takes[0].span.to(c.node.takes[1].span), "what it says itself"),),
        notes=("all times that the node says are tried",),
        helps=("leave out the overrun",),
    )


def _require_no_queue(
    flat: Flattening, system: System, c: Component, span: Span, instead: str = ""
) -> None:
    """Reports E010 if a topic that a component publishes with delay has a queue."""
    assert c.node is not None
    for symbol in c.node.publishes:
        topic = system.topics[c.scope.topics[symbol]]
        if not topic.queues:
            continue
        queue = system.topics[topic.queues[0]]
        problem = "cannot overrun" if instead else "takes time, which no test can try"
        flat.diagnostics.error(
            "E010",
            f"`{c.name}` {problem}: it publishes `{topic.name}`, which is queued",
            span,
            also=((topic.symbol.span, f"collected in `{queue.name}`"),),
            notes=("a publication that takes effect later has no place in a queue",),
            helps=(instead or "replace it in this test by a node without `takes`",),
        )
        return
