"""The parameters of a run, for people and documents.

Purpose: what differs from the program's defaults, as text with units, and as JSON in seconds.
Non-goals: reading what a person sets (`simulate/run_options.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.statements import Evaluator
from soter.language.model.types import BoolType, DurationType, EnumType, show_ns
from soter.language.model.values import to_json

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.language.model.types import Type, Value


def changed(system: System) -> dict[str, tuple[str, str]]:
    """Value and default, as text, of every parameter that is not at its default.

    Those of an instance (`r[0].GAIN`) with what they would be without their own value.
    """
    basic = Evaluator({})
    changes = {}
    for name, value in system.params.items():
        param = system.program.param(name)
        assert param is not None
        default = basic.value(param.default)
        if name != param.name:
            default = system.params[param.name]
        if value != default:
            changes[name] = (shown(param.type, value), shown(param.type, default))
    return changes


def shown(t: Type, value: Value) -> str:
    """A parameter's value as a program writes it."""
    if isinstance(t, DurationType):
        return show_ns(value)
    if isinstance(t, BoolType):
        return "true" if value else "false"
    return str(t.members[value]) if isinstance(t, EnumType) else str(value)


def as_json(system: System) -> dict[str, object]:
    """Every parameter; durations in s."""
    value_by_name = {}
    for name, value in system.params.items():
        param = system.program.param(name)
        assert param is not None
        t = param.type
        value_by_name[name] = value / 1e9 if isinstance(t, DurationType) else to_json(t, value)
    return value_by_name
