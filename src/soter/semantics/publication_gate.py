"""The gate: which publications reach the topics, and the consequences of a refused step.

Purpose: checks what a step published, publishes it, fills queues, sets the latches of AC and of
trusted components, and counts clean outputs (docs/semantics.md, AC-or-SC-Step 4 to 6 and Queues).
Non-goals: running steps (`rules.py`, `interpreter.py`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.model.types import ArrayType, FloatType, IntType, ListType, RecordType, leaves
from soter.semantics.configuration import LOST, NEVER, with_value

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Bound, Module, Topic
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration

    Check = Callable[[Value, Span], None]


# ---------------------------------------------------------------- the topic's set


def check_of_topic(topic: Topic) -> Check:
    """Gives a check `(value, span)` that raises StepFault for a value outside the topic's set."""
    bounds = iter(topic.bounds)
    names = iter([".".join((topic.name, *path)) for path, _ in leaves(topic.type)])
    return _check_of_type(topic.type, bounds, names)


def _check_of_type(t: Type, bounds: Iterator[Bound | None], names: Iterator[str]) -> Check:
    """Gives the check of a type, which takes a bound and a name for each leaf of the type."""
    if isinstance(t, RecordType):
        return _check_of_parts([_check_of_type(f, bounds, names) for _, f in t.fields])
    if isinstance(t, ArrayType):
        return _check_of_parts([_check_of_type(t.element, bounds, names) for _ in range(t.size)])
    if isinstance(t, ListType):
        element = _check_of_type(t.element, bounds, names)

        def check_list(value: Value, span: Span) -> None:
            for item in value:
                element(item, span)

        return check_list
    return _check_of_leaf(t, next(bounds), next(names))


def _check_of_parts(parts: list[Check]) -> Check:
    def check_parts(value: Value, span: Span) -> None:
        for part, component in zip(parts, value, strict=True):
            part(component, span)

    return check_parts


def _check_of_leaf(t: Type, bound: Bound | None, name: str) -> Check:
    is_float = isinstance(t, FloatType)

    def check_leaf(value: Value, span: Span) -> None:
        if is_float and not math.isfinite(value):
            raise StepFault(FaultKind.NONFINITE, span, f"`{name}` would be {value}")
        if bound is not None and not bound.low <= value <= bound.high:
            within = f"[{bound.low}, {bound.high}]"
            raise StepFault(FaultKind.RANGE, span, f"`{name}` would be {value}, not in {within}")

    return check_leaf if is_float or isinstance(t, IntType) else lambda _value, _span: None


def check_publications(
    checks: tuple[Check, ...],
    outputs: Iterable[int],
    published: Mapping[int, Value],
    span: Span,
    bursts: Collection[int] = (),
) -> None:
    """Raises a step fault for a publication outside the set of its topic.

    It checks `outputs` in order (a node's `publishes`, a plant's `drives`), the messages of a burst
    in order, and leaves in declared order.
    """
    for topic in outputs:
        if topic in published:
            for value in messages_of(topic, published[topic], bursts):
                checks[topic](value, span)


def messages_of(topic: int, published: Value, bursts: Collection[int]) -> tuple[Value, ...]:
    """Gives the messages that a step published on a topic, in order: one, or all of a burst."""
    return published if topic in bursts else (published,)


def with_rounded_ends(topic: Topic, value: Value) -> Value:
    """Gives an outside value with each number between an end and its float32 set to the end."""
    if all(b is None or b.float32_ends == (b.low, b.high) for b in topic.bounds):
        return value
    return _map_leaves(_round_to_end, topic.type, iter(topic.bounds), value)


def clip_to_set(t: Type, bounds: Sequence[Bound | None], value: Value) -> Value:
    """Gives a value whose numbers are limited to a topic's set; NaN and infinities stay."""
    return _map_leaves(_clip_leaf, t, iter(bounds), value)


def _map_leaves(
    leaf: Callable[[Type, Bound | None, Value], Value],
    t: Type,
    bounds: Iterator[Bound | None],
    value: Value,
) -> Value:
    """Gives a value with `leaf` applied to each of its leaves, each with its bound."""
    if isinstance(t, RecordType):
        fields = zip(t.fields, value, strict=True)
        return tuple([_map_leaves(leaf, f, bounds, part) for (_, f), part in fields])
    if isinstance(t, ArrayType):
        return tuple([_map_leaves(leaf, t.element, bounds, part) for part in value])
    if isinstance(t, ListType):
        element_bounds = [next(bounds) for _ in leaves(t.element)]
        return tuple([_map_leaves(leaf, t.element, iter(element_bounds), part) for part in value])
    return leaf(t, next(bounds), value)


def _clip_leaf(t: Type, bound: Bound | None, value: Value) -> Value:
    if isinstance(t, IntType):
        value = min(max(value, t.low), t.high)
    if bound is None or not isinstance(t, (FloatType, IntType)) or not math.isfinite(value):
        return value
    return type(value)(min(max(value, bound.low), bound.high))


def _round_to_end(t: Type, bound: Bound | None, value: Value) -> Value:
    if bound is None or not isinstance(t, FloatType):
        return value
    low, high = bound.float32_ends
    if low <= value <= bound.low:
        return bound.low
    return bound.high if bound.high <= value <= high else value


# ---------------------------------------------------------------- publishing, latching, counting


def publish(
    topics: Sequence[Topic],
    c: Configuration,
    published: Mapping[int, Value],
    time_ns: int | None = None,
    bursts: Collection[int] = (),
) -> Configuration:
    """Gives the configuration with `published` on its topics, stamped `time_ns` (None: ct).

    Topics' = out united with Topics[T without dom(out)]. Each value also enters the queues of its
    topic. For a topic in `bursts` every message does, and the topic holds the last message.
    """
    if not published:
        return c
    values, stamps = list(c.Topics), list(c.stamps)
    for topic, out in published.items():
        stamps[topic] = c.ct if time_ns is None else time_ns
        for value in messages_of(topic, out, bursts):
            values[topic] = value
            for queue in topics[topic].queues:
                _push_to_queue(topics[queue], values, stamps, value)
    return replace(c, Topics=tuple(values), stamps=tuple(stamps))


def _push_to_queue(queue: Topic, values: list[Value], stamps: list[int], value: Value) -> None:
    """Puts a value at the end of a queue; the queue's policy applies if it is full."""
    assert isinstance(queue.type, ListType), queue.name
    waiting = values[queue.index]
    if len(waiting) < queue.type.capacity:
        values[queue.index] = (*waiting, value)
    elif queue.policy == "drop_oldest":
        values[queue.index] = (*waiting[1:], value)
    elif queue.policy == "fault":
        stamps[queue.index] = LOST


def require_nothing_lost(c: Configuration, queues: Iterable[int], span: Span) -> None:
    """Raises StepFault if a queue with the policy `fault` lost a value."""
    if any(c.stamps[q] == LOST for q in queues):
        raise StepFault(FaultKind.CAPACITY, span, "a queue was full")


def clear_lost_queues(c: Configuration, queues: Iterable[int]) -> Configuration:
    """Gives the configuration after emptying the queues that lost a value."""
    for q in queues:
        if c.stamps[q] == LOST:
            c = replace(empty_queues(c, (q,)), stamps=with_value(c.stamps, q, NEVER))
    return c


def empty_queues(c: Configuration, queues: Iterable[int]) -> Configuration:
    """Gives the configuration after emptying these queues, as at the end of a complete step."""
    for q in queues:
        if c.Topics[q]:
            c = replace(c, Topics=with_value(c.Topics, q, ()))
    return c


def note_ac_fault(c: Configuration, module: Module) -> Configuration:
    """Notes a step fault of AC; its DM sees it if AC had control, and clean steps count anew."""
    gate_fault = c.gate_fault
    if c.OE[module.ac]:
        gate_fault = with_value(gate_fault, module.index, True)
    owed = with_value(c.clean_needed, module.index, module.clean)
    return replace(c, gate_fault=gate_fault, clean_needed=owed)


def latch_component(c: Configuration, n: int) -> Configuration:
    """Latches the trusted component `n` after its step fault; it never runs again."""
    return replace(c, latched=with_value(c.latched, n, True))


def count_clean_step(
    c: Configuration, module: Module, outputs: Iterable[int], published: Iterable[int]
) -> Configuration:
    """Counts a step of the module's AC as clean if the step published all outputs of AC."""
    owed = c.clean_needed[module.index]
    if owed == 0 or not set(outputs) <= set(published):
        return c
    return replace(c, clean_needed=with_value(c.clean_needed, module.index, owed - 1))
