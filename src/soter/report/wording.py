"""Words and numbers for people: prose, counts, parameters, and texts from outside made harmless.

Purpose: `visible` keeps what an extern, a file or a name says from moving a terminal's cursor or
colouring it. `changed_parameters` are those that differ from the defaults, as text with units,
`parameters_json` all of them, durations in seconds; `prose`, `count_text`: words that pages share.
Non-goals: cutting to a width; reading what a person sets (`simulate/run_options.py`).
"""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING

from soter.language.evaluate.statements import Evaluator
from soter.language.model.types import BoolType, DurationType, EnumType, Type, Value, show_ns
from soter.language.model.values import to_json

if TYPE_CHECKING:
    from soter.language.model.system import System


CODE = re.compile(r"`([^`]+)`")


SUBSCRIPTS = re.compile(r"(φ|ttf)_(safer|safe|2Δ|\{2Δ\})")


def prose(text: str) -> str:
    """A text as HTML, with its code marked and the paper's symbols with subscripts."""
    set_off = CODE.sub(r"<code>\1</code>", escape(text))
    return SUBSCRIPTS.sub(lambda match: f"{match[1]}<sub>{match[2].strip('{}')}</sub>", set_off)


def quantity(name: str, unit: str) -> str:
    """The title of an axis or a panel: `x / m`, `speed / (m/s)`; the name alone without a unit."""
    if not unit:
        return name
    return f"{name} / ({unit})" if "/" in unit else f"{name} / {unit}"


def count_text(count: int, noun: str) -> str:
    """A count with its noun: `no violation`, `1 violation`, `3 violations`."""
    return f"{count or 'no'} {noun}{'s' if count > 1 else ''}"


def visible(text: str) -> str:
    r"""The text on one line with escapes such as `\x1b` for characters that cannot be seen."""
    return "".join(char if char.isprintable() else _escaped_character(char) for char in text)


def _escaped_character(char: str) -> str:
    return char.encode("unicode_escape").decode("ascii")


def changed_parameters(system: System) -> dict[str, tuple[str, str]]:
    """Maps each parameter that is not at its default to its value and its default, as texts.

    The default of an instance's parameter (`r[0].GAIN`) is its value outside of the instance.
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
            changes[name] = (parameter_text(param.type, value), parameter_text(param.type, default))
    return changes


def parameter_text(t: Type, value: Value) -> str:
    """A parameter's value as it is written in a program."""
    if isinstance(t, DurationType):
        return show_ns(value)
    if isinstance(t, BoolType):
        return "true" if value else "false"
    return str(t.members[value]) if isinstance(t, EnumType) else str(value)


def parameters_json(system: System) -> dict[str, object]:
    """All parameters as JSON, with durations in s."""
    value_by_name = {}
    for name, value in system.params.items():
        param = system.program.param(name)
        assert param is not None
        t = param.type
        value_by_name[name] = value / 1e9 if isinstance(t, DurationType) else to_json(t, value)
    return value_by_name
