"""States from which steps are timed: those of a run, and others made of them.

Purpose: `of_run`, and `varied`: the same with what a component reads drawn at random.
Non-goals: timing (`stopwatch.py`); locals, which only a run makes as they are.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from soter.core.layout import encode_into
from soter.language.model.system import queues_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator

    from soter.core.layout import StateLayout
    from soter.language.model.system import Bound, Component, System
    from soter.language.model.types import Type, Value
    from soter.native.library import Bytes

WILD = 1e3
"""Floats of a topic without a set are drawn between this, below and above zero."""
FAR = 1 << 31
"""The same of ints."""


def of_run(trace: Bytes, count: int) -> Bytes:
    """At most `count` states of a trace (n, size), spread over it evenly; a copy."""
    places = np.unique(np.linspace(0, len(trace) - 1, min(count, len(trace))).astype(int))
    states: Bytes = trace[places].copy()
    return states


def read_by(system: System, c: Component) -> tuple[int, ...]:
    """The topics that a step or a decision of a component reads; no queues."""
    if c.role == "dm":
        assert c.module is not None
        topics: set[int] = set(system.modules[c.module].reads)
    else:
        topics = set() if c.node is None else {c.scope.topics[s.topic] for s in c.node.subscribes}
    return tuple(sorted(topics - set(queues_of(system, c))))


def varied(
    system: System,
    layout: StateLayout,
    c: Component,
    states: Bytes,
    count: int,
    rng: random.Random,
) -> Bytes:
    """`count` states (count, size) made of some (n, size): what the component reads is drawn.

    Its topics take values of their sets, published at the time of the state. In one of eight all
    numbers are at an end of their sets, and lists are full.
    """
    variants: Bytes = states[[rng.randrange(len(states)) for _ in range(count)]].copy()
    group = next(g for g in layout.groups if g.owner < 0)
    at = {m.name: group.offset + m.offset for m in group.struct.members}

    def stamp(index: int) -> int:
        return layout.stamp_offset + 8 * index

    for k in range(count):
        ends = rng.random() < 0.125
        row = bytearray(variants[k].tobytes())
        for index in read_by(system, c):
            topic = system.topics[index]
            value = _drawn(topic.type, iter(topic.bounds), rng, ends=ends)
            encode_into(row, at[topic.name], topic.type, value)
            row[stamp(index) : stamp(index) + 8] = row[:8]  # ct is the first of a state
        variants[k] = np.frombuffer(row, dtype=np.uint8)
    return variants


def _drawn(t: Type, bounds: Iterator[Bound | None], rng: random.Random, *, ends: bool) -> Value:
    if isinstance(t, RecordType):
        return tuple(_drawn(f, bounds, rng, ends=ends) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(_drawn(t.element, bounds, rng, ends=ends) for _ in range(t.size))
    if isinstance(t, ListType):
        n = t.capacity if ends else rng.randint(0, t.capacity)
        of = [next(bounds, None) for _ in leaves(t.element)]
        return tuple(_drawn(t.element, iter(of), rng, ends=ends) for _ in range(n))
    return _scalar(t, next(bounds, None), rng, ends=ends)


def _scalar(t: Type, bound: Bound | None, rng: random.Random, *, ends: bool) -> float | int:
    if isinstance(t, BoolType):
        return rng.random() < 0.5
    if isinstance(t, EnumType):
        return rng.randrange(len(t.members))
    if isinstance(t, IntType):
        low = max(t.low, -FAR) if bound is None else int(bound.low)
        high = min(t.high, FAR) if bound is None else int(bound.high)
        return rng.choice((low, high)) if ends else rng.randint(low, high)
    assert isinstance(t, FloatType)
    below, above = (-WILD, WILD) if bound is None else (bound.low, bound.high)
    below, above = max(below, -1e300), min(above, 1e300)
    value = rng.choice((below, above)) if ends else rng.uniform(below, above)
    return value if math.isfinite(value) else 0.0
