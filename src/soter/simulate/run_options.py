"""The options of a run, and the parameters and lengths of time that a user sets.

Purpose: `RunOptions` declares each option once, with its range, default, help text and flag.
`--set K=3`, `--until 30s` and their keywords in Python become values of the program's types, or a
diagnostic that names valid values (U001, U004).
Non-goals: how options are read (`diagnostics/command_records.py`), bounds of parameters
(`language/elaborate/flatten_system.py`), bindings (`native/extern_bindings.py`).
"""

from __future__ import annotations

import math
import operator
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

from soter.diagnostics.command_records import SWITCH, choice, option, whole
from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.elaborate.passes.system_numbers import has_param
from soter.language.model.types import (
    TEXT_MAX,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    WrongTextError,
    duration_ns,
)
from soter.language.model.values import ValueShapeError, from_python

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Type, Value
    from soter.simulate.run_log import RunLog
    from soter.simulate.run_observer import Kept


ENGINES = ("native", "interp")
AGAINST = "run against the clock, externs in processes of their own (docs/real-time.md)"
RECORDED = "run nothing: tell the flight that a program of `soter build` recorded (`--record FILE`)"
WHOLE = "the report in one file; by default its drawing script lies beside it"
LATE = "in real time: exit 4 beyond so many late steps of the trusted part; by default {default}"
SEED = whole(0, 2**64 - 1, "seed")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """The options of a run; `keyword=False` marks options of the command line only."""

    system: str | None = option("--system S", None, "by default the only one, or the `default`")
    until: float | str | None = option(
        "--until TIME", None, "such as 30s; by default the system's own"
    )
    seed: int = option("--seed N", 1, "by default {default}", SEED)
    flight: int | None = option(
        "--flight K", None, "flight K of a campaign that begins with --seed", SEED, keyword=False
    )
    arm: str | None = option(
        "--arm A", None, "by the rules of that arm of the campaign: ac, paper, ..."
    )
    campaign: str | Path | None = option(
        "--campaign DIR", None, "of arm paper: its folder, by default as `soter campaign`"
    )
    engine: str = option(
        f"--engine {{{','.join(ENGINES)}}}",
        "native",
        "native C, or the reference interpreter",
        choice(*ENGINES),
    )
    params: Mapping[str, object] | None = option("", None, "values of parameters by full name")
    log: str | Path | RunLog | None = option("--log [PATH]", None, "write an MCAP log")
    report: str | Path | None = option("--report [PATH]", None, "write an HTML report")
    self_contained: bool = option("--self-contained", False, WHOLE, SWITCH, keyword=False)
    output: str = option(
        "-o --output DIR",
        ".soter",
        "folder of logs and reports without a path; by default {default}",
        keyword=False,
    )
    why: bool = option(
        "--why", False, "list every change of mode, and on which values", SWITCH, keyword=False
    )
    real_time: bool = option("--real-time", False, AGAINST, SWITCH)
    recorded: str | Path | None = option("--recorded FILE", None, RECORDED)
    misses: int = option("--misses N", 0, LATE, whole(0, 2**63), keyword=False)
    trace: Kept = option("", True, "keep the state after every instant, or what is named of it")
    sha256: bool = option("", True, "hash it: equal hashes are equal states", SWITCH)
    progress: Callable[[float], None] | None = option(
        "", None, "called with the share that is done, 0 to 1"
    )
    partial: bool = option("", False, "on Ctrl-C give back what was reached", SWITCH)
    apart: bool = option("", False, "nodes in Python as processes (docs/externs.md)", SWITCH)
    NEEDS = (
        ("!recorded", "until seed flight arm engine real_time"),
        ("arm=paper", "campaign"),
        ("report", "self_contained"),
        ("log=|report=", "output"),
        ("real_time", "misses"),
        ("!engine=interp", "misses"),
    )


class RunKeywords(TypedDict, total=False):
    """The keyword-only options of `Program.simulate`, for type checkers."""

    arm: str | None
    campaign: str | Path | None
    log: str | Path | RunLog | None
    report: str | Path | None
    real_time: bool
    recorded: str | Path | None
    trace: Kept
    sha256: bool
    progress: Callable[[float], None] | None
    partial: bool
    apart: bool


_NUMBER = re.compile(r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,3})?")


# ---------------------------------------------------------------- lengths of time


def until_ns(until: float | str) -> int:
    """The length of a run in ns; raises `SoterError` U001 unless it is longer than zero."""
    try:
        ns = duration_ns(until)
    except WrongTextError as error:
        raise mistake("U001", f"`until` cannot be `{_shown_value(until)}`: {error}") from error
    if ns <= 0:
        raise mistake("U001", f"`until` cannot be `{_shown_value(until)}`: a run takes time")
    return ns


def seed_value(seed: object) -> int:
    """A seed as an int; raises `SoterError` U001 unless the seed is a whole number."""
    try:
        number = operator.index(seed)  # type: ignore[arg-type]  # it checks
    except TypeError:
        number = -1
    if not 0 <= number < 2**64:
        help_ = "a seed is a whole number, 0 to 2^64 - 1"
        raise mistake("U001", f"`seed` cannot be `{_shown_value(seed)}`", help_)
    return number


# ---------------------------------------------------------------- parameters


def param_values(program: TypedProgram, values_by_name: Mapping[str, object]) -> dict[str, Value]:
    """Checks and converts parameters by full name; `SoterError` U001, U004 with all mistakes."""
    values: dict[str, Value] = {}
    problems: list[Diagnostic] = []
    for name, value in values_by_name.items():
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
            message = f"parameter `{name}` cannot be `{_shown_value(value)}`: {error}"
            problems.append(Diagnostic("U001", message))
    if problems:
        raise SoterError(tuple(problems))
    return values


def _param_value(t: Type, choice: object) -> Value:
    if isinstance(t, DurationType):
        return duration_ns(choice)  # type: ignore[arg-type]  # it checks
    if isinstance(choice, str) and not isinstance(t, EnumType):
        return _value_of_text(t, choice.strip())
    if isinstance(t, EnumType) and not (isinstance(choice, str) and choice in t.members):
        raise WrongTextError(f"it is one of {', '.join(t.members)}")
    value = from_python(t, choice)
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


def _shown_value(value: object) -> str:
    text = str(value)
    return text if len(text) <= 40 else text[:37] + "..."
