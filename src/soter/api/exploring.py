"""Explores tests of a program, and checks before what a person asks of them.

Purpose: `explore` chooses the tests, flattens their systems, has each searched, writes traces and
pages, and makes one report. `chosen_tests` finds tests by name, `with_skew_and_horizon` gives one
another skew or horizon.
Non-goals: exploring one test (`explore/command.py`), the options themselves
(`explore/search_options.py`).
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import params_as_json, read_params, time_ns
from soter.api.computed_ttf import compute_ttf
from soter.api.output_files import write_test_page
from soter.diagnostics.command_records import make_record
from soter.diagnostics.diagnostic import Diagnostics, SoterError, mistake
from soter.explore.assumptions import replacements_in_test
from soter.explore.command import TraceHeader, explore_test, save_traces
from soter.explore.judge import test_plan
from soter.explore.results import ExploreReport, TestResult
from soter.explore.search_options import SearchOptions
from soter.explore.trace import TIME_MAX
from soter.language.elaborate.derived_systems import with_test
from soter.language.elaborate.explorable import MAX_STEPS
from soter.language.front_end import CheckResult, system_of_test
from soter.language.model.types import Value, show_ns
from soter.simulate.interrupt import current_stop_request, receiving_signals

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.language.model.system import System
    from soter.language.model.typed import TestSymbol


def chosen_tests(
    tests: Mapping[str, TestSymbol], path: str, names: str | Sequence[str] | None
) -> list[TestSymbol]:
    """Selects tests by name, in the program's order. Raises U010 for an unknown name."""
    wanted = [names] if isinstance(names, str) else names
    unknown = [n for n in wanted or () if n not in tests]
    if tests and not unknown:
        return [t for n, t in tests.items() if wanted is None or n in wanted]
    if not unknown:
        help_ = "write one: `test Name { system S; horizon 1s; always ...; }`"
        raise mistake("U010", f"`{path}` has no `test`", help_)
    shown = ", ".join(f"`{n}`" for n in tests) or "none"
    raise mistake("U010", f"there is no test `{unknown[0]}`", notes=(f"there are: {shown}",))


def with_skew_and_horizon(system: System, skew_ns: int | None, horizon_ns: int | None) -> System:
    """A copy of the test with another skew or horizon. Raises U001 for an impossible value."""
    plan = test_plan(system)
    for word, ns, least in (("skew", skew_ns, 0), ("horizon", horizon_ns, 1)):
        if ns is not None and not least <= ns <= TIME_MAX:
            raise mistake("U001", f"the {word} cannot be {show_ns(ns)}")
    skew = plan.skew_ns if skew_ns is None else skew_ns
    horizon = plan.horizon_ns if horizon_ns is None else horizon_ns
    _require_few_steps(system, horizon)
    for t in plan.timed:
        reach = t.within_ns + (1 if t.kind == "leadsto" else 0)
        if t.kind != "invariant" and reach > horizon:
            message = f"with a horizon of {show_ns(horizon)} `{t.text}` is not judged"
            note = f"its deadline of {show_ns(t.within_ns)} has to lie before the end"
            raise mistake("E013", message, notes=(note,))
    if plan.ordered and skew:
        message = f"test {plan.name} declares the deployed order: no step of it may be late"
        note = f"with a skew of {show_ns(skew)} steps of one instant happen at different times"
        raise mistake("E017", message, notes=(note,))
    return with_test(system, replace(plan, skew_ns=skew, horizon_ns=horizon))


def _require_few_steps(system: System, horizon: int) -> None:
    calendars = [(c.phase_ns, c.period_ns) for c in system.components]
    calendars += [(0, drive.every_ns) for drive in system.inputs]
    steps = sum((horizon - phase) // period + 1 for phase, period in calendars if phase <= horizon)
    if steps > MAX_STEPS:
        message = f"a horizon of {show_ns(horizon)} can never be exhausted"
        note = f"{steps} steps lie before it, in each execution; at most {MAX_STEPS} are possible"
        raise mistake("E008", message, notes=(note,))


def explore(checked: CheckResult, path: str, choices: Mapping[str, Any]) -> ExploreReport:
    """Explores all or some tests of a sound program, as `Program.explore` describes.

    After an interrupt it returns what was covered if `partial`, else raises KeyboardInterrupt.
    """
    options = make_record(SearchOptions, choices)
    if options.html:
        from soter.report.html import require_report_package  # noqa: PLC0415 - an extra

        require_report_package()
    program = checked.program
    assert program is not None
    tests = chosen_tests(checked.tests, path, options.test)
    values = read_params(program, options.params)
    systems = _flat_tests(checked, [t.name for t in tests], values, options)
    params = params_as_json(program, values)
    results: list[TestResult] = []
    listener = current_stop_request()
    with receiving_signals(listener), _keep_results(results, tests):
        for symbol, system in zip(tests, systems, strict=True):
            about = TraceHeader(path, params, replacements_in_test(symbol))
            result = explore_test(system, options, about, options.progress, listener)
            results.append(result)
            output = options.output
            if (
                output is not None
                and save_traces(result, Path(output)) is not None
                and options.html
            ):
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
def _keep_results(results: Sequence[object], tests: Sequence[object]) -> Iterator[None]:
    """Lets Ctrl-C end the block but keep the results; re-raises it if all tests are done."""
    try:
        yield
    except KeyboardInterrupt:
        if len(results) == len(tests):
            raise


def _flat_tests(
    checked: CheckResult, names: Sequence[str], values: Mapping[str, Value], options: SearchOptions
) -> list[System]:
    """The flat systems of tests, with predicates computed. Raises the errors of all tests."""
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
            systems.append(with_skew_and_horizon(system, skew_ns, horizon_ns))
    diagnostics.raise_errors()
    for system in systems:
        compute_ttf(system)
    return systems
