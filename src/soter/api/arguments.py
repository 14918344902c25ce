"""Checks what callers give: times, parameters, modules, sources.

Purpose: turns times, parameters of traces and names of modules into the values that other packages
take, with a diagnostic for wrong ones. It reads and formats sources.
Non-goals: bindings and `params` of runs (`simulate/`), options of searches
(`explore/search_options.py`), files for output (`output_files.py`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError, Source, mistake
from soter.language.load.loader import read_text as read_source
from soter.language.model.types import WrongTextError, duration_ns
from soter.language.model.values import ValueShapeError, from_json, to_json
from soter.language.syntax.printer import format_source

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Value

    Progress = Callable[[float], None]
    Tell = Callable[[str], None]


def time_ns(name: str, time: float | str | None) -> int | None:
    """Gives the time of argument `name` in ns, or None for None; raises U001 for a wrong time."""
    if time is None:
        return None
    try:
        return duration_ns(time)
    except WrongTextError as error:
        raise mistake("U001", f"`{name}` cannot be `{str(time)[:40]}`: {error}") from error


def run_end_ns(system: System, until: float | str | None) -> int:
    """The end of a run in ns, from `until` or the system. Raises U001 if neither sets an end."""
    from soter.simulate.run_options import until_ns  # noqa: PLC0415 - see `soter.api`

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
    """The modules of full or declared name `module`, by default all. Raises U001 if none."""
    modules = [m for m in flat.modules if module is None or module in (m.name, m.symbol.name)]
    if not modules:
        names = ", ".join(f"`{m.name}`" for m in flat.modules) or "none"
        message = f"system `{flat.name}` has no module" + f" `{module}`" * bool(module)
        raise mistake("U001", message, notes=(f"there are: {names}",))
    return modules


def read_params(program: TypedProgram, params: Mapping[str, object] | None) -> dict[str, Value]:
    """Reads the parameter values of a caller, by full name. Raises SoterError U001 or U004."""
    if not params:
        return {}
    from soter.simulate.run_options import param_values  # noqa: PLC0415 - see `soter.api`

    return param_values(program, params)


def params_as_json(program: TypedProgram, values: Mapping[str, Value]) -> dict[str, object]:
    """The parameter values as JSON for a trace, with durations in ns."""
    params: dict[str, object] = {}
    for name, value in values.items():
        param = program.param(name)
        assert param is not None
        params[name] = to_json(param.type, value)
    return params


def params_from_json(
    program: TypedProgram, values: Mapping[str, object], file: Path
) -> dict[str, Value]:
    """The parameter values, read from the JSON of a trace. Raises SoterError D010."""
    from soter.explore.trace import no_trace_error  # noqa: PLC0415 - see `soter.api`

    params: dict[str, Value] = {}
    for name, value in values.items():
        param = program.param(name)
        if param is None:
            raise no_trace_error(file, f"its program has no parameter `{name}`")
        try:
            params[name] = from_json(param.type, value, name)
        except ValueShapeError as error:
            raise no_trace_error(file, f"a parameter: {error}") from error
    return params


def read_text(path: str) -> str:
    """The text of a source file. Raises SoterError D001 or D005 if the file cannot be read."""
    diagnostics = Diagnostics()
    text = read_source(Path(path), path, diagnostics)
    if text is None:
        raise SoterError(diagnostics.items)
    return text


def format_text(name: str, text: str) -> str:
    """The text of a program in the standard layout. Raises SoterError if it does not parse."""
    diagnostics = Diagnostics()
    formatted = format_source(Source(name, text), diagnostics)
    if formatted is None:
        raise SoterError(diagnostics.items)
    return formatted
