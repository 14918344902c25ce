"""`soter test FILE`: explores every execution of the tests of a file.

Purpose: prints each test's verdict, what the search covered and what it did not, and for a
violation its shortest trace, step by step; the same as JSON, and as findings for continuous
integration, one for each test at its `test` block (a test that was not started is `open`).
`--junit` writes the verdicts, or why there are none, to a file, so that no older file is taken for
this run's.
Non-goals: searching (`explore/`), the XML (`cli/terminal/ci_formats.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.cli.terminal.ci_findings import CiFinding, Kind
from soter.cli.terminal.ci_formats import junit_of_problems, junit_of_tests
from soter.cli.terminal.command_line import keyword_arguments
from soter.cli.terminal.command_outcome import INTERRUPTED, CommandOutcome, exit_of_kinds
from soter.cli.terminal.console import Console, LineOfProgress, memory_text, rate_text
from soter.cli.terminal.program_loading import loaded_program
from soter.cli.terminal.shared_options import FORMAT, file_option
from soter.diagnostics.command_records import JsonObject, one_of, option, options_of
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.explore.engine.coverage import Coverage, CoverageKind
from soter.explore.results import (
    BOUND,
    BOUNDS,
    ENDED,
    EXHAUSTED,
    UNJUDGED,
    VIOLATED,
    ExploreReport,
    TestResult,
    bound_text,
    wholes_by_parts,
)
from soter.explore.search_options import REDUCTIONS, SAMPLING, STORAGES, STRATEGIES, SearchOptions
from soter.language.model.types import show_ns
from soter.report.html import write_text

if TYPE_CHECKING:
    import argparse


CI_KINDS: dict[str, Kind] = {"exhausted": "pass", "violated": "fail", "bound": "open"}
RULE = "test"


def findings_of_tests(report: ExploreReport) -> tuple[CiFinding, ...]:
    """A finding for each test; its span is the `test` block."""
    findings = []
    for t in report.tests:
        text = f"{t.name}: every execution was covered, none violates a property"
        details: tuple[str, ...] = ()
        if t.broken is not None:
            text = f"{t.name}: violated: {t.broken.text}"
            details = () if t.trace is None else (f"soter replay {t.trace}",)
        elif t.verdict == "bound":
            text = f"{t.name}: no violation was found, and not everything was covered: {t.why}"
        span = None if t.system.test is None else t.system.test.span
        findings.append(
            CiFinding(CI_KINDS[t.verdict], RULE, t.name, text, span, details, t.seconds)
        )
    findings += [
        CiFinding("open", RULE, name, f"{name}: not started") for name in report.not_started
    ]
    return tuple(findings)


def write_problems_as_junit(
    file: str, why: SoterError, path: str, warnings: tuple[Diagnostic, ...]
) -> None:
    """Writes as JUnit XML why no test was explored; `SoterError` D006 if it cannot be written."""
    try:
        write_text(junit_of_problems(file, (*warnings, *why.diagnostics)), path)
    except SoterError as error:
        raise SoterError((*why.diagnostics, *error.diagnostics)) from error


EXAMPLES = """\
  soter test late_sc.soter                            every test of the file
  soter test late_sc.soter --test Late --report       with a page for the trace
  soter test two.soter --storage fingerprint          64 bits a configuration
  soter test two.soter --strategy random --runs 1000  where it is too large
  soter test two.soter --skew 2ms --horizon 1s        in place of the test's own
  soter test late_sc.soter --json | jq '.tests[].verdict'
  soter test late_sc.soter --junit results.xml        for CI; --format junit prints it
  soter replay .soter/late_sc-Late.trace.json         a trace again

in the folder of traces, of each test that is violated: FILE-TEST.trace.json, its page
FILE-TEST.html, and the script that pages share (soter-plotly-....js)

exit codes: 0 exhausted and clean, 3 violated, 4 a bound was reached, 1 diagnostics, 2 usage,
            130 interrupted by Ctrl-C, SIGTERM or SIGHUP (what was covered until then is printed)
"""
PAINTS = {"exhausted": "green", "violated": "red", "bound": "yellow"}
UNREACHED_SHOWN, LINES_MAX = 6, 400


@dataclass(frozen=True, kw_only=True)
class Options(SearchOptions):
    """Explore every execution of the tests of a file."""

    file: str = file_option()
    format: str | None = option(*FORMAT, keyword=False)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Explores the tests, prints the results, and writes the file of `--junit`."""
    console.listen_to_signals()
    try:
        program = loaded_program(args, console)
        with LineOfProgress(console) as line:
            report = program.explore(
                **keyword_arguments(args, Options),
                progress=None if line is None else lambda looked: line(progress_text(looked)),
                partial=True,
            )
    except SoterError as error:
        if args.junit is not None:
            write_problems_as_junit(args.file, error, args.junit, console.of_program)
        raise
    _say_report(report, console)
    if args.junit is not None:
        console.say(f"\njunit  {write_text(junit_of_tests(report), args.junit)}")
    found = findings_of_tests(report)
    code = INTERRUPTED if report.interrupted else exit_of_kinds(f.kind for f in found)
    junit = junit_of_tests(report) if args.format == "junit" else ""
    return CommandOutcome(code, (), DOCUMENT.of(report), found, junit)


def progress_text(looked: object) -> str:
    """The progress of a search as text: `Late 1,204,000 states, 1.4 M/s, depth 55, 9.6 MB`."""
    from soter.explore.search_options import SearchProgress  # noqa: PLC0415 - loaded above, too

    assert isinstance(looked, SearchProgress)
    count = looked.states or looked.transitions
    noun = "states" if looked.states else "steps"
    rate = count / looked.seconds if looked.seconds > 0 else 0.0
    doing = "  violated: looking for a trace" if looked.tracing else ""
    doing = "  violated: looking for the shortest trace" if looked.minimising else doing
    more = f", covered to {show_ns(looked.covered_ns)}" if looked.covered_ns else ""
    more += f", {looked.answers:,} answers of one step" if looked.answers else ""
    return (
        f"{looked.test}{doing}  {count:,} {noun}, {rate_text(rate)}/s, depth {looked.depth}, "
        f"{memory_text(looked.bytes)}{more}"
    )


# ---------------------------------------------------------------- for people


def _say_report(report: ExploreReport, console: Console) -> None:
    console.say(console.paint("muted", f"{report.path}  {report.program_sha256[:12]}"))
    for test in report.tests:
        console.say("\n".join(("", *_test_lines(test, console))))
    if len(report.tests) + len(report.not_started) > 1:
        console.say("\n".join(("", *_summary_lines(report, console))))


def _summary_lines(report: ExploreReport, console: Console) -> list[str]:
    """A line for each test, then lines on results that hold for all tests."""
    width = max(map(len, (*(test.name for test in report.tests), *report.not_started)))
    lines = ["all tests"]
    for test in report.tests:
        word, colour, more = _verdict_words(test)
        more = more or report.unclean_contracts_note(test)
        lines.append(
            f"  {test.name:<{width}}  {console.paint(colour, f'{word:<19}')}  {more}".rstrip()
        )
    lines += [
        f"  {name:<{width}}  {console.paint('yellow', 'NOT STARTED')}"
        for name in report.not_started
    ]
    return lines + [f"  {whole.text}" for whole in wholes_by_parts(report.tests)]


def _verdict_words(test: TestResult) -> tuple[str, str, str]:
    """The verdict in a word, the colour of that word, and a further text or ""."""
    if test.verdict == "violated":
        assert test.broken is not None
        return "VIOLATED", "red", test.broken.text
    if test.verdict == "exhausted":
        return "EXHAUSTED AND CLEAN", "green", ""
    word = "INTERRUPTED" if test.interrupted else "BOUND REACHED"
    return word, "yellow", "" if test.bound == "interrupted" else str(test.bound)


def _test_lines(test: TestResult, console: Console) -> list[str]:
    """All lines about one test."""
    muted = "muted"
    lines = [_test_headline(test, console), console.paint(muted, _figures_text(test))]
    lines += [console.paint("yellow", test.slow_search_note)] if test.slow_search_note else []
    lines += ["", *_coverage_lines(test, console)]
    if test.replayed is not None:
        lines += ["", *_trace_lines(test, console)]
    for other in test.others:
        lines += ["", *_other_violation_lines(other, console)]
    if test.options.all_properties and test.replayed is not None:
        lines += ["", console.paint("muted", _other_properties_line(test))]
    lines += ["", "rests on"]
    vacuous = {v.text for v in test.vacuous}
    lines += [console.paint(muted, f"  {text}") for text in test.assumptions if text not in vacuous]
    return lines


def _test_headline(test: TestResult, console: Console) -> str:
    word, colour, text = _verdict_words(test)
    if test.verdict == "exhausted":
        text = f"every execution was covered, none violates a property{test.for_ever_clause}"
        cannot = sum(v.cannot_fail for v in test.vacuous)
        none = cannot >= test.coverage.properties.reached
        words = "none of its properties can" if none else f"{cannot} of its properties cannot"
        text += f"; {words} fail" if cannot else ""
    elif test.unshown:
        text = f"{text}\n{test.not_shown}"
    elif test.verdict == "bound":
        why = "not everything was covered" if test.interrupted else test.why
        text = f"no violation was found; {why}"
        if test.covered_text:
            text += f"\n{test.covered_text}"
    return f"{console.paint('bold', test.name)}  {console.paint(colour, word)}  {text}"


def _figures_text(test: TestResult) -> str:
    options = test.options
    parts = [f"{test.states:,} states"] if test.states else []
    parts.append(f"{test.transitions:,} transitions")
    if options.strategy in SAMPLING:
        parts.append(f"{test.runs:,} runs")
    parts += [f"depth {test.depth}", f"{test.seconds:.2f} s"]
    if test.minimise_s:
        prefix = "" if test.minimal else "not found in "
        parts.append(f"shortest trace {prefix}{test.minimise_s:.2f} s")
    parts.append(f"{rate_text(test.states_per_s)} {'states' if test.states else 'steps'}/s")
    if test.states:
        parts.append(f"{test.bits} bits a state, {memory_text(test.total_bytes)}")
    how = f"{options.strategy}, {options.storage} storage, reduction {options.reduction}"
    if options.strategy in SAMPLING:
        how = f"{options.strategy}, seed {options.seed}"
    how += f", {test.threads} thread{'s'[: test.threads > 1]}"
    if test.threads_fewer:
        how += f" of {options.threads} asked for: {test.threads_fewer}"
    if test.quantum_ns is not None:
        how += f"; times at multiples of {show_ns(test.quantum_ns)}"
    return f"{', '.join(parts)}\n{how}{test.parts_clause}"


def _coverage_lines(test: TestResult, console: Console) -> list[str]:
    """Lines for how much was reached, what was never reached, and what in the test cannot fail."""
    from soter.report.wording import visible  # noqa: PLC0415 - needs NumPy

    parts = [(name, part) for name, part in test.coverage.kinds_by_name() if part.total]
    lines = ["reached  " + "  ".join(f"{name} {p.reached}/{p.total}" for name, p in parts)]
    for name, part in parts:
        shown = part.unreached[:UNREACHED_SHOWN]
        lines += [console.paint("yellow", f"  never  {visible(one)}") for one in shown]
        rest = len(part.unreached) - UNREACHED_SHOWN
        if rest > 0:
            lines.append(console.paint("muted", f"         and {rest} more {name}"))
    return lines + [console.paint("yellow", f"vacuous  {visible(v.text)}") for v in test.vacuous]


def _other_violation_lines(test: TestResult, console: Console) -> list[str]:
    """Lines about another property that can be violated, with a trace."""
    word, colour, text = _verdict_words(test)
    head = f"{console.paint('bold', 'also')}  {console.paint(colour, word)}  {text}"
    return [head, "", *_trace_lines(test, console)] if test.replayed is not None else [head]


def _other_properties_line(test: TestResult) -> str:
    """A line on how the search for violations of further properties ended."""
    count = 1 + len(test.others)
    head = f"{count} {'property' if count == 1 else 'properties'} violated"
    if test.others_bound is None:
        return f"{head}; the search for violations of others ended without one"
    return f"{head}; there may be others: {bound_text(test.others_bound, test.options)}"


def _trace_lines(test: TestResult, console: Console) -> list[str]:
    from soter import __version__  # noqa: PLC0415 - loaded above, too
    from soter.explore.trace_view import make_sequence_view  # noqa: PLC0415 - only for a trace
    from soter.report.sequence_view import table_text  # noqa: PLC0415 - needs NumPy

    assert test.replayed is not None
    view = make_sequence_view(test.replayed, __version__)
    lines = table_text(view, color=console.color_out, most=LINES_MAX, width=console.width)
    lines.append(view.remark if test.minimal else console.paint("yellow", view.remark))
    files = (("trace", test.trace), ("page", test.page))
    return lines + [f"{kind:<6} {path}" for kind, path in files if path is not None]


# --- as JSON; a list of words has `field` or `field=path.in.record` each, ? as in JsonObject


def _step_count(t: TestResult) -> int | None:
    return None if t.replayed is None else len(t.replayed.steps)


def _is_minimal(t: TestResult) -> bool | None:
    return None if t.replayed is None else t.minimal


def _test_itself(t: TestResult) -> TestResult:
    return t


VERDICTS = one_of(EXHAUSTED, VIOLATED, BOUND)
SAYS_NOTHING = "property premise contract module fault input replacement"
TRACE = "trace page steps minimal not_shortest? unshown=not_shown? shrunk_from? minimise_s"
OPTIONS = " ".join(
    f"{o.json_name}=options.{n}" for n, o in options_of(SearchOptions).items() if o.json_name
)
MADE = {"steps": _step_count, "minimal": _is_minimal, "memory": _test_itself}
COVERED = JsonObject(CoverageKind, "reached total unreached", named="covered")
KINDS = "properties actors modes switches branches values"
TEST = JsonObject(
    TestResult,
    "name system=system.name verdict bound violated=broken.text violated_there others others_bound "
    f"states transitions runs seconds states_per_s depth {TRACE} {OPTIONS} parts "
    "contracts quantum_ns covered_ns closed_ns short_of threads "
    "threads_fewer? memory coverage vacuous assumptions",
    MADE,
    verdict=VERDICTS,
    bound=one_of(*BOUNDS, None),
    others=JsonObject(TestResult, f"violated=broken.text violated_there {TRACE}", MADE, "other"),
    strategy=one_of(*STRATEGIES),
    storage=one_of(*STORAGES),
    reduction=one_of(*REDUCTIONS),
    short_of=one_of(*sorted(ENDED - {UNJUDGED}), None),
    memory=JsonObject(
        TestResult, "table_bytes frontier_bytes total_bytes bytes_per_state packed_bits=bits"
    ),
    coverage=JsonObject(Coverage, KINDS, shapes=dict.fromkeys(KINDS.split(), COVERED)),
    vacuous=JsonObject(
        "soter.explore.vacuous_tests.VacuousPart",
        "what name why",
        what=one_of(*SAYS_NOTHING.split()),
    ),
)
DOCUMENT = JsonObject(
    ExploreReport,
    "file=path program_sha256 verdict interrupted not_started tests",
    verdict=VERDICTS,
    tests=TEST,
)
