"""Gives stand-ins the values that tests state for them.

Purpose: reads `guarantees t.x in { a, b };` of all tests of a system. A test in which the real part
runs judges it by the values that other tests state of its stand-in. Gives stand-ins their steps.
Non-goals: what a stand-in does in a step (`stand_ins.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants_and_types import Calculator
from soter.language.elaborate.distinguishable_values import Readers
from soter.language.elaborate.passes.stand_ins import (
    StatedValues,
    equality_with_one_of,
    give_step_to_stand_in,
    part_at,
    topic_and_path,
    with_part,
)
from soter.language.elaborate.passes.topics import topic_index_at
from soter.language.elaborate.passes.value_sets import require_in_set
from soter.language.model import typed
from soter.language.model.system import Property
from soter.language.model.types import RecordType

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.elaborate.distinguishable_values import Path
    from soter.language.elaborate.passes.flattening import Flattening
    from soter.language.model.system import Component, Scope, StandIn, System
    from soter.language.model.types import Value


def add_checks_of_stated_values(flat: Flattening, running_test: typed.TestSymbol) -> None:
    """Adds `stated`, and properties that check real parts against the values other tests state."""
    sets = settings_in(running_test)
    for test in flat.program.tests.values():
        alike = test.system is running_test.system and settings_in(test) == sets
        flat.stated[test] = _stated_values(flat, test) if alike or test is running_test else []
    _check_stated_values(flat, running_test)
    for test, known in flat.stated.items():
        for s in known:
            for c in flat.components:
                if test is not running_test and _is_real_driver(flat, running_test, c, s.topic):
                    index = len(flat.properties)
                    flat.properties.append(_stated_property(c, s, test, index))


def _stated_values(flat: Flattening, test: typed.TestSymbol) -> list[StatedValues]:
    """Gives the values that a test of this system states; reports V005 for one outside its set."""
    known: list[StatedValues] = []
    for item in test.stated:
        symbol, path = topic_and_path(item.read)
        topic = flat.topics[topic_index_at(flat, flat.parts[0], symbol)]
        values = []
        for e in item.values:
            value = flat.value_of(e, "the value of a stand-in")
            if value is not None:
                values.append(value)
                topic_value = with_part(topic.default, path, value)
                require_in_set(flat, topic, topic_value, e, f"this value of `{topic.symbol.name}`")
        first, promised = part_at(topic.default, path), item.kind == "guarantees"
        known.append(
            StatedValues(topic.index, path, tuple(values), first, promised, item.text, item.span)
        )
    return known


def _is_real_driver(flat: Flattening, test: typed.TestSymbol, c: Component, topic: int) -> bool:
    """Whether `c` publishes `topic` and belongs to the system itself, not to the test."""
    by_test = flat.put_in.get(c.name) in [span for _, _, span in test.replaces]
    if c.node is None or c.stands_for is not None or by_test:
        return False
    return topic in c.writes


def _stated_property(c: Component, s: StatedValues, test: typed.TestSymbol, index: int) -> Property:
    assert c.node is not None
    symbol = next(t for t in c.node.publishes if c.scope.topics[t] == s.topic)
    read: typed.TypedExpr = typed.TopicRead(symbol.type, s.span, symbol)
    for i in s.path:
        assert isinstance(read.type, RecordType)
        read = typed.TypedField(read.type.fields[i][1], s.span, read, i)
    condition = equality_with_one_of(read, s.tried_values)
    says = "has" if s.promised else "assumes"
    text = f"{s.text}, as {test.name} {says} it, in {c.name}"
    return Property(index, "guarantees", condition, c.scope, text, s.span, c.index)


def _check_stated_values(flat: Flattening, test: typed.TestSymbol) -> None:
    """Reports E020 for values of a topic of no stand-in, N002 for values that are stated twice."""
    published = {t for c in flat.components if c.stands_for is not None for t in c.writes}
    before: list[StatedValues] = []
    for s in flat.stated[test]:
        for other in before:
            short = min(len(s.path), len(other.path))
            if s.topic == other.topic and s.path[:short] == other.path[:short]:
                flat.diagnostics.error(
                    "N002",
                    f"the values of `{flat.topics[s.topic].name}` are stated twice",
                    s.span,
                    "again",
                    also=((other.span, "the first time"),),
                )
        before.append(s)
        if s.topic not in published and not flat.partial:
            flat.diagnostics.error(
                "E020",
                f"nobody who publishes `{flat.topics[s.topic].name}` is replaced by a contract",
                s.span,
                also=((test.span, "in this test"),),
                notes=("values are stated of what stands in: who runs as it is has its own",),
                helps=("write `replace ... by contract;`, or leave this line out",),
            )


def give_steps_to_stand_ins(flat: Flattening, test: typed.TestSymbol, system: System) -> None:
    """Gives stand-ins their steps, which publish all values that code of `system` distinguishes."""
    if flat.partial or flat.diagnostics.error_count:
        return
    asked = [(e, p.scope) for p in flat.timed for e in (p.premise, p.condition) if e]
    readers = Readers(system, asked, _constant_value)
    stated: dict[int, dict[Path, tuple[Value, ...]]] = {}
    here = flat.stated[test]
    for s in here:
        stated.setdefault(s.topic, {})[s.path] = s.tried_values
    for c in system.components:
        if c.stands_for is None or c.node is None:
            continue
        outputs = {*c.writes}
        c.stands_for = _with_stated_values(c.stands_for, [s for s in here if s.topic in outputs])
        give_step_to_stand_in(c, system.topics, stated, readers, flat.diagnostics)


def _constant_value(e: typed.TypedExpr, scope: Scope) -> Value | None:
    """Gives the value of an expression of constants and parameters; None if it has no value."""
    return Calculator(Diagnostics(), scope.params).value(e, "a constant")


def settings_in(test: typed.TestSymbol) -> set[tuple[str, typed.ParamSymbol, str]]:
    """Gives the parameters that a test sets, each with its value as text."""
    return {(s.path, s.param, repr(s.value)) for s in test.sets}


def _with_stated_values(stand_in: StandIn, stated: Sequence[StatedValues]) -> StandIn:
    """Gives the record of a stand-in, for reports, with the values that the test states."""
    promised = [s.text for s in stated if s.promised]
    tried = [s.text for s in stated if not s.promised]
    return replace(stand_in, clauses=(*stand_in.clauses, *promised), tried=tuple(tried))
