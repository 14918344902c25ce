"""Enters the values of topics whose publisher is outside the system.

Purpose: makes the drive of each `input`, and the record of each external topic, for the system and
its parts; the outermost declaration counts. Reports inputs that nothing bounds (V009).
Non-goals: draws (`semantics/`), messages of a robot (`mapping/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.passes.topics import topic_index_at
from soter.language.elaborate.passes.value_sets import require_in_set
from soter.language.model.system import External, InputDrive
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.elaborate.passes.flattening import Flattening, SubSystem
    from soter.language.model import typed
    from soter.language.model.system import Topic
    from soter.language.model.types import Value


def add_inputs(flat: Flattening) -> None:
    """Adds to `inputs` how each input topic is drawn; the outermost system decides."""
    result: dict[int, InputDrive] = {}
    for part, item in _input_items(flat):
        index = topic_index_at(flat, part, item.topic)
        with flat.with_params(part.params):
            every = flat.duration_ns(item.every, f"`every` of `{item.path}`")
            if index in result:
                continue
            topic = flat.topics[index]
            values = _declared_values(flat, item, topic)
        if not (item.values or topic.set_declared or topic.symbol in flat.program.damaged):
            flat.diagnostics.error(
                "V009",
                f"input topic `{topic.symbol.name}` has no value set to be drawn from",
                item.span,
                "drawn here",
                also=((topic.symbol.span, "declared here"),),
                helps=(
                    "add a set: `in [-1.0, 1.0]` with your bounds",
                    "or list values where it is drawn: `in { ... }`",
                ),
            )
        result[index] = InputDrive(index, every or 1_000_000_000, values)
    flat.inputs += result.values()


def _declared_values(flat: Flattening, item: typed.InputSymbol, topic: Topic) -> tuple[Value, ...]:
    """Gives the declared values of an input; reports V005 for one outside the topic's set."""
    values: list[Value] = []
    for expr in item.values:
        value = flat.value_of(expr, "the value of an input")
        if value is None:
            continue
        values.append(value)
        require_in_set(flat, topic, value, expr, f"this value of `{topic.symbol.name}`")
    return tuple(values)


def _input_items(flat: Flattening) -> Iterator[tuple[SubSystem, typed.InputSymbol]]:
    """Yields (part, `input` item) for each unwired input of the test, the system and its parts."""
    if flat.test is not None:
        yield from ((flat.parts[0], item) for item in flat.test.inputs)
    for part in flat.parts:
        for item in part.system.inputs:
            if part.prefix and any(item.topic in table for table in part.wires):
                continue  # it is wired: the outer system drives it
            yield part, item


def add_externals(flat: Flattening) -> None:
    """Adds each topic from outside to `externals`, as the outermost of its systems declares it."""
    external_by_topic: dict[int, External] = {}
    for part in flat.parts:
        for item in part.system.externals:
            index = topic_index_at(flat, part, item.topic)
            with flat.with_params(part.params):
                external_by_topic.setdefault(index, _make_external(flat, item, index))
    flat.externals += external_by_topic.values()


def _make_external(flat: Flattening, item: typed.ExternalSymbol, index: int) -> External:
    owner = f"of external topic `{item.topic.name}`"
    every = flat.duration_ns(item.every, f"`every` {owner}")
    delay = flat.delay_ns(item.delayed, f"`delayed` {owner}")
    errors: list[float | None] = [None for _ in leaves(item.topic.type)]
    for m in item.measured:
        bound = flat.bound(m.within, "the bound of an error")
        for k, (path, _) in enumerate(leaves(item.topic.type)):
            if path[: len(m.path)] == m.path:
                errors[k] = bound
    return External(index, every, delay, tuple(errors), item.span)
