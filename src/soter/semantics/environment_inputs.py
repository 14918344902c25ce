"""Values from outside: what the environment may put on which topic, and when.

Purpose: the premises of ENVIRONMENT-INPUT, checked before a value from outside is believed; the
twin of `soter_publish` in `soter.h`.
Non-goals: who publishes what (drivers), the rule itself (`rules.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.model.system import environment_topics
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.semantics.publication_gate import to_ends
from soter.semantics.rules import next_instant

if TYPE_CHECKING:
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


def refusal(
    machine: ExecutableSystem,
    c: Configuration,
    topic: int,
    value: Value,
    time_ns: int,
    *,
    within: bool = False,
) -> FaultKind | None:
    """Why `topic` does not take `value`, measured at `time_ns`; None where it does.

    EXTERN: the topic is not the environment's, the value is none of its type, or the time is before
    the topic's stamp or after the next instant (while one waits: after ct). NONFINITE, RANGE: the
    value is not in the topic's set (`to_ends`). `within`: time has moved to an instant that is not
    over, though FN may be empty: nobody is released when only an input is drawn.
    """
    topics = machine.system.topics
    if topic not in environment_topics(machine.system):
        return FaultKind.EXTERN
    latest = c.ct if c.FN or within else next_instant(machine, c)
    if not c.stamps[topic] <= time_ns <= latest or not is_value(topics[topic].type, value):
        return FaultKind.EXTERN
    try:
        machine.checks[topic](to_ends(topics[topic], value), topics[topic].symbol.span)
    except StepFault as fault:
        return fault.kind
    return None


def is_value(t: Type, value: Value) -> bool:
    """Whether an object is a value of a type, as the interpreter keeps it."""
    if isinstance(t, FloatType):
        return isinstance(value, float)
    if isinstance(t, BoolType):
        return isinstance(value, bool)
    if isinstance(t, (EnumType, IntType)):
        low, high = (0, len(t.members) - 1) if isinstance(t, EnumType) else (t.low, t.high)
        return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
    if not isinstance(value, tuple):
        return False
    if isinstance(t, RecordType):
        return len(value) == len(t.fields) and all(
            is_value(f, v) for (_, f), v in zip(t.fields, value, strict=True)
        )
    assert isinstance(t, (ArrayType, ListType)), t
    fits = len(value) == t.size if isinstance(t, ArrayType) else len(value) <= t.capacity
    return fits and all(is_value(t.element, v) for v in value)
