"""What callers give, as the rooms below want it, and what a program leaves to be computed.

Purpose: times, parameters of traces and chosen modules, each refused in words where it
is wrong; `ttf` and `safer` of modules that have neither.
Non-goals: bindings and `params` of runs (`simulate/`), options of searches
(`explore/search_options.py`).
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import utf8_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.diagnostics.codes import Code
    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Value
    from soter.verify.deploy.missing_predicates import Known

    Progress = Callable[[float], None]
    Tell = Callable[[str], None]


def mistake(code: Code, message: str, help_: str) -> SoterError:
    """An error of one diagnostic, with what helps."""
    return SoterError((Diagnostic(code, message, helps=(help_,)),))


def require_utf8(*names: object) -> None:
    """`SoterError` U003 for a path that no report, certificate or document could say.

    What the current folder is called, and those above it, is no matter.
    """
    here = ""
    with suppress(OSError):
        here = str(Path.cwd() / "_")[:-1]
    for name in names:
        if not isinstance(name, (str, Path)):
            continue
        said = str(name).removeprefix(here)
        if (shown := utf8_text(said)) != said:
            text = f"`{shown}` is not UTF-8, which everything that soter writes is"
            raise mistake("U003", text, "rename it")


def time_ns(what: str, given: float | str | None) -> int | None:
    """A length of time from outside in ns; `SoterError` U001."""
    if given is None:
        return None
    from soter.language.model.durations import WrongTextError, duration_ns  # noqa: PLC0415 - see `soter.api`

    try:
        return duration_ns(given)
    except WrongTextError as error:
        message = f"`{what}` cannot be `{str(given)[:40]}`: {error}"
        raise SoterError((Diagnostic("U001", message),)) from error


def end_of(system: System, until: float | str | None) -> int:
    """When a run ends, in ns; `SoterError` U001 where nobody says."""
    from soter.simulate.run_settings import until_ns  # noqa: PLC0415 - see `soter.api`

    if until is not None:
        return until_ns(until)
    if system.until_ns is None:
        raise mistake(
            "U001",
            f"system `{system.name}` does not say how long it runs",
            "say it: --until 30s, or `until 30s;` in the system",
        )
    return system.until_ns


def chosen_modules(flat: System, module: str | None) -> list[Module]:
    """The modules of a full or declared name, all by default; `SoterError` U001 for none."""
    modules = [m for m in flat.modules if module is None or module in (m.name, m.symbol.name)]
    if not modules:
        there = ", ".join(f"`{m.name}`" for m in flat.modules) or "none"
        what = f"no module `{module}`" if module else "no module"
        message = f"system `{flat.name}` has {what}"
        raise SoterError((Diagnostic("U001", message, notes=(f"there are: {there}",)),))
    return modules


def add_stale_monitors(checked: CheckResult) -> None:
    """D022 for each model monitor of a sound program that was written for another model."""
    if not checked.ok or checked.loaded is None:
        return
    if any("soter monitor --emit" in file.source.text for file in checked.loaded.files):
        from soter.monitor.outdated_monitor_files import stale_monitors  # noqa: PLC0415 - needs NumPy

        for wrong in stale_monitors(checked):
            checked.diagnostics.add(wrong)


def values_of(program: TypedProgram, params: Mapping[str, object] | None) -> dict[str, Value]:
    """The values of parameters by full name; `SoterError` U001, U004."""
    if not params:
        return {}
    from soter.simulate.run_settings import param_values  # noqa: PLC0415 - see `soter.api`

    return param_values(program, params)


def params_as_json(program: TypedProgram, values: Mapping[str, Value]) -> dict[str, object]:
    """Parameters for a trace: durations in ns."""
    from soter.language.model.python_values import to_json  # noqa: PLC0415 - see `soter.api`

    params: dict[str, object] = {}
    for name, value in values.items():
        param = program.param(name)
        assert param is not None
        params[name] = to_json(param.type, value)
    return params


def params_from_json(
    program: TypedProgram, given: Mapping[str, object], file: Path
) -> dict[str, Value]:
    """The parameters of a trace; `SoterError` D010."""
    from soter.explore.trace.trace import no_trace  # noqa: PLC0415 - see `soter.api`
    from soter.language.model.python_values import ValueShapeError, from_json  # noqa: PLC0415 - the same

    params: dict[str, Value] = {}
    for name, value in given.items():
        param = program.param(name)
        if param is None:
            raise no_trace(file, f"its program has no parameter `{name}`")
        try:
            params[name] = from_json(param.type, value, name)
        except ValueShapeError as error:
            raise no_trace(file, f"a parameter: {error}") from error
    return params


def complete(
    system: System, progress: Progress | None = None, known: Known | None = None
) -> list[str]:
    """Compute `ttf` and `safer` for modules that have neither; a note on each.

    `known`: as `soter.verify.deploy.missing_predicates.complete` takes it.
    """
    if all(m.symbol.ttf is not None for m in system.modules):
        return []
    from soter.verify.deploy.missing_predicates import complete as compute  # noqa: PLC0415 - needs NumPy

    return compute(system, progress, known)
