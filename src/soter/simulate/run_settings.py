"""What a person may set from outside: parameters and lengths of time, as text or as numbers.

Purpose: `--set K=3`, `--until 30s` and their twins in Python become values of the program's
types, or a diagnostic that says what would have been right (U001, U004).
Non-goals: bounds of parameters (`language/elaborate/elaborator.py` knows them), bindings
(`bindings.py`).
"""

from __future__ import annotations

import math
import operator
import re
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.elaborate.system_numbers import has_param
from soter.language.model.durations import TEXT_MAX, WrongTextError, duration_ns
from soter.language.model.types import BoolType, DurationType, EnumType, FloatType, IntType
from soter.language.model.values import ValueShapeError, from_python

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Type, Value

_NUMBER = re.compile(r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,3})?")


# ---------------------------------------------------------------- lengths of time


def until_ns(given: float | str) -> int:
    """The length of a run in ns; SoterError U001 unless it is a time longer than zero."""
    try:
        ns = duration_ns(given)
    except WrongTextError as error:
        raise mistake("U001", f"`until` cannot be `{_short(given)}`: {error}") from error
    if ns <= 0:
        raise mistake("U001", f"`until` cannot be `{_short(given)}`: a run takes time")
    return ns


def seed_value(given: object) -> int:
    """A seed as an int, from anything that is a whole number; SoterError U001."""
    try:
        number = operator.index(given)  # type: ignore[arg-type]  # it checks
    except TypeError:
        number = -1
    if not 0 <= number < 2**64:
        help_ = "a seed is a whole number, 0 to 2^64 - 1"
        raise mistake("U001", f"`seed` cannot be `{_short(given)}`", help_)
    return number


# ---------------------------------------------------------------- parameters


def param_values(program: TypedProgram, given: Mapping[str, object]) -> dict[str, Value]:
    """The values of parameters by full name; SoterError U001, U004 with all mistakes at once."""
    values: dict[str, Value] = {}
    problems: list[Diagnostic] = []
    for name, value in given.items():
        param = program.param(name)
        if param is not None and not has_param(program, program.systems.values(), name):
            path = name[: -len(param.name) - 1]
            text = f"no system has an instance `{path}`, whose `{param.name}` could be set"
            problems.append(Diagnostic("U004", text))
            continue
        if param is None:
            help_ = nearest_or_all(name, program.params) or "the program declares no `param`"
            problems.append(Diagnostic("U004", f"there is no parameter `{name}`", helps=(help_,)))
            continue
        try:
            values[name] = _param_value(param.type, value)
        except (WrongTextError, ValueShapeError) as error:
            message = f"parameter `{name}` cannot be `{_short(value)}`: {error}"
            problems.append(Diagnostic("U001", message))
    if problems:
        raise SoterError(tuple(problems))
    return values


def _param_value(t: Type, given: object) -> Value:
    if isinstance(t, DurationType):
        return duration_ns(given)  # type: ignore[arg-type]  # it checks
    if isinstance(given, str) and not isinstance(t, EnumType):
        return _value_of_text(t, given.strip())
    if isinstance(t, EnumType) and not (isinstance(given, str) and given in t.members):
        raise WrongTextError(f"it is one of {', '.join(t.members)}")
    value = from_python(t, given)
    if isinstance(t, FloatType) and not math.isfinite(value):
        raise WrongTextError("a parameter is finite")
    return value


def _value_of_text(t: Type, text: str) -> Value:
    if isinstance(t, BoolType):
        if text in ("true", "false"):
            return text == "true"
        raise WrongTextError("it is true or false")
    if len(text) > TEXT_MAX or not _NUMBER.fullmatch(text):
        raise WrongTextError("a number is expected")
    if isinstance(t, IntType):
        if not text.lstrip("+-").isdigit():
            raise WrongTextError("a whole number is expected")
        return from_python(t, int(text))
    value = float(text)
    if not math.isfinite(value):
        raise WrongTextError("the number is too large")
    return value


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 40 else text[:37] + "..."
