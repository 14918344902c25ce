"""The tests of a program, explored one after the other.

Purpose: which tests, their flat systems, their traces and pages, and one report.
Non-goals: exploring one test (`explore/command.py`), options (`explore/settings.py`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.files import write_test_page
from soter.api.given import complete, params_as_json, time_ns, values_of
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.explore.command import Told, chosen, explore_test, replaced_in, save, with_times
from soter.explore.results import ExploreReport
from soter.program.build import system_of_test

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.explore.results import Looked, Options
    from soter.program.build import Checked
    from soter.program.model.system import System
    from soter.program.model.types import Value


def explore(
    checked: Checked,
    path: str,
    options: Options,
    *,
    test: str | None,
    skew: float | str | None,
    horizon: float | str | None,
    params: Mapping[str, object] | None,
    output: str | Path | None,
    html: bool,
    progress: Callable[[Looked], None] | None,
) -> ExploreReport:
    """Explore every test of a sound program, or one, as `Program.explore` says."""
    program = checked.program
    assert program is not None
    tests = chosen(checked.tests, path, test)
    values = values_of(program, params)
    systems = _tests(checked, [t.name for t in tests], values, skew, horizon)
    told = params_as_json(program, values)
    results = []
    for symbol, system in zip(tests, systems, strict=True):
        result = explore_test(system, options, Told(path, told, replaced_in(symbol)), progress)
        results.append(result)
        if output is not None and save(result, Path(output)) is not None and html:
            for one in (result, *(o for o in result.others if o.trace is not None)):
                write_test_page(one)
        if result.interrupted:
            break
    not_started = tuple([t.name for t in tests[len(results) :]])
    return ExploreReport(path, program.sha256, tuple(results), not_started)


def _tests(
    checked: Checked,
    names: Sequence[str],
    values: Mapping[str, Value],
    skew: float | str | None,
    horizon: float | str | None,
) -> list[System]:
    """The flattened systems of tests, complete; every diagnostic of all of them at once."""
    found = Diagnostics()
    skew_ns, horizon_ns = time_ns("skew", skew), time_ns("horizon", horizon)
    systems = []
    for name in names:
        try:
            system = system_of_test(checked, name, values)
        except SoterError as error:
            for d in error.diagnostics:
                found.add(d)
        else:
            systems.append(with_times(system, skew_ns, horizon_ns))
    if found.has_errors:
        raise SoterError(found.items)
    for system in systems:
        complete(system)
    return systems
