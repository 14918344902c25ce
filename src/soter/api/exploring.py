"""Explores the tests of a program one after the other.

Purpose: chooses the tests, flattens their systems, writes traces and pages, and makes one report.
Non-goals: exploring one test (`explore/command.py`), options (`explore/search_options.py`),
checkpoints (`explore/checkpoints.py`).
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import complete, params_as_json, time_ns, values_of, write_test_page
from soter.diagnostics.command_records import made
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.explore.assumptions import replaced_in
from soter.explore.checked_options import asked, checkpoints, chosen, with_times
from soter.explore.command import TraceHeader, explore_test, save
from soter.explore.results import ExploreReport
from soter.explore.search_options import SearchOptions
from soter.language.front_end import system_of_test
from soter.simulate.interrupt import listening, stop_request

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.explore.results import TestResult
    from soter.language.front_end import CheckResult
    from soter.language.model.system import System
    from soter.language.model.types import Value


def explore(checked: CheckResult, path: str, given: Mapping[str, Any]) -> ExploreReport:
    """Explores every test of a sound program, or some, as `Program.explore` says.

    After an interrupt it returns what was covered with `partial`, else raises KeyboardInterrupt.
    """
    options = made(SearchOptions, given)
    wanted = asked(options)
    program = checked.program
    assert program is not None
    tests = chosen(checked.tests, path, options.test)
    values = values_of(program, options.params)
    systems = _tests(checked, [t.name for t in tests], values, options)
    told = params_as_json(program, values)
    kept = checkpoints(wanted, systems, options, told)
    results: list[TestResult] = []
    listener = stop_request()
    with listening(listener), _keeping_results(results, tests):
        for symbol, system, place in zip(tests, systems, kept, strict=True):
            about = TraceHeader(path, told, replaced_in(symbol))
            result = explore_test(system, options, about, options.progress, listener, place)
            results.append(result)
            output = options.output
            if output is not None and save(result, Path(output)) is not None and options.html:
                for one in (result, *(o for o in result.others if o.trace is not None)):
                    write_test_page(one)
            if result.interrupted or listener.wanted:
                break
    not_started = tuple([t.name for t in tests[len(results) :]])
    report = ExploreReport(path, program.sha256, tuple(results), not_started)
    if report.interrupted and not options.partial:
        raise KeyboardInterrupt
    return report


@contextmanager
def _keeping_results(results: Sequence[object], tests: Sequence[object]) -> Iterator[None]:
    """Ends its block at a KeyboardInterrupt; raises it if all tests have been explored."""
    try:
        yield
    except KeyboardInterrupt:
        if len(results) == len(tests):
            raise


def _tests(
    checked: CheckResult,
    names: Sequence[str],
    values: Mapping[str, Value],
    options: SearchOptions,
) -> list[System]:
    """The flat systems of tests, predicates computed; SoterError with all their diagnostics."""
    diagnostics = Diagnostics()
    skew_ns, horizon_ns = time_ns("skew", options.skew), time_ns("horizon", options.horizon)
    systems = []
    for name in names:
        try:
            system = system_of_test(checked, name, values, exact=len(names) == 1)
        except SoterError as error:
            for d in error.diagnostics:
                diagnostics.add(d)
        else:
            systems.append(with_times(system, skew_ns, horizon_ns))
    diagnostics.raise_errors()
    for system in systems:
        complete(system)
    return systems
