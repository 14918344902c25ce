"""Checks again what other commands wrote: certificates, traces, counterexamples.

Purpose: `recheck` reports on a certificate of `soter verify --cert` and on flights of its system,
or raises a SoterError if there is no certificate, or no package to check it with. `replay` runs a
trace of `soter test`, or a counterexample of `soter verify`, again, and returns a `ReplayReport`.
Non-goals: the checker (`soter.certificate`); the run itself (`explore/replay.py`,
`verify/counterexample.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import params_from_json
from soter.api.computed_ttf import compute_ttf
from soter.api.output_files import write_trace_page
from soter.diagnostics.current_phase import whole_shares_to
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.language.evaluate.arithmetic import require_default_float_rules
from soter.language.front_end import check_file, system_of_test
from soter.report.templates import PageSection
from soter.version import VERSION, pip_command

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.api.arguments import Progress
    from soter.certificate.report import Report as RecheckReport
    from soter.explore.replay import Replayed
    from soter.explore.trace import Trace
    from soter.report.run.record import ReportPage
    from soter.report.sequence_view import SequenceView
    from soter.verify.counterexample import Replay as CounterexampleRun


def recheck(
    folder: str | Path, progress: Progress | None = None, logs: Sequence[str | Path] = ()
) -> RecheckReport:
    """Checks the certificate in a folder, independently of the code that wrote it.

    `logs`: logs of `soter run --log` of the same program. The re-checker then computes again, with
    its tube, each verdict "AC" of a module with `rest`; in the report, `flights` counts the
    confirmed verdicts and names the others. Ctrl-C ends this, and the report calls the flight
    `interrupted`. Flights are checked only if nothing in the certificate is false.

    The report's `verdict` is `accepted`, `rejected` (something in it is false) or `not re-checked`
    (it may be right, but the re-checker cannot check it); `reason` explains the last two. Raises
    SoterError D009 if there is no certificate, D007 without python-flint, or for logs without
    `mcap`, X012 if the process's floats do not follow IEEE rules, D006 for a file that is no log,
    D023 for a log of another program.
    """
    require_flint()
    require_default_float_rules()
    from soter.certificate.extras.flight_check import open_flights  # noqa: PLC0415 - an extra
    from soter.certificate.reading.folder import NotACertificateError  # noqa: PLC0415 - an extra
    from soter.certificate.rechecker import recheck as check  # noqa: PLC0415 - an extra

    with whole_shares_to(progress):
        try:
            flights = open_flights(Path(folder), list(map(str, logs))) if logs else None
            report = check(Path(folder))
        except NotACertificateError as error:
            raise no_certificate_error(error) from None
        if flights is not None:
            flights.add_to_report(report)
    return report


def require_flint() -> None:
    """Raises SoterError D007 without python-flint, the arithmetic of the re-checker."""
    if find_spec("flint") is None:
        raise mistake(
            "D007",
            "certificates are checked with `python-flint`, which is not installed",
            f"install it: {pip_command('recheck')}",
        )


def no_certificate_error(error: Exception) -> SoterError:
    """The error D009 for a folder that is not a certificate."""
    message = f"this is no certificate: {error}"
    return mistake("D009", message, "`soter verify --cert DIR` makes one")


TIME = "time (s)"
ROWS = (
    "Each row is an instant of the decision modules: seconds, who is in control, true states, "
    "topics, and what the environment and the adversary chose last."
)


@dataclass(frozen=True, eq=False)
class ReplayReport:
    """The result of `soter.replay`.

    `kind`: "trace" (from `soter test`; `trace` has every step) or "counterexample" (from `soter
    verify`; `counterexample` is the run). `outcome` is a sentence.
    """

    path: str
    kind: str
    program: str
    program_sha256: str
    reproduced: bool
    outcome: str
    trace: Replayed | None = None
    counterexample: CounterexampleRun | None = None

    def view(self) -> SequenceView:
        """The trace as records for logs and tables. Raises U001 for a counterexample."""
        from soter.explore.trace_view import make_sequence_view  # noqa: PLC0415 - see `soter.api`

        if self.trace is None:
            raise mistake(
                "U001",
                f"`{self.path}` is a run that refutes a proof: it has no sequence of steps",
                "`soter replay --report` writes its last instants as a page",
            )
        return make_sequence_view(self.trace, VERSION, {"trace": self.path}, self.program)

    def write_html(self, path: str | Path) -> Path:
        """Writes the run as a page. Raises D006 or D007, or U001 if the run was not reproduced."""
        if self.counterexample is None:
            view = self.view()
            assert self.trace is not None
            return write_trace_page(self.trace, view, Path(path))
        from soter.report.html import write_html  # noqa: PLC0415 - see `soter.api`

        return write_html(_counterexample_page(self, self.counterexample), path)

    def write_mcap(self, path: str | Path) -> Path:
        """Writes the MCAP log of a trace. Raises SoterError D006, D007 or U001."""
        from soter.report.trace_log import write_log  # noqa: PLC0415 - an extra

        return write_log(self.view(), path)


def _counterexample_page(report: ReplayReport, run: CounterexampleRun) -> ReportPage:
    """The page of the last instants of a refuting run, as far as the prover kept them."""
    from soter.diagram.svg import picture  # noqa: PLC0415 - see `soter.api`
    from soter.report.run import counterexample_page as pages  # noqa: PLC0415 - needs NumPy

    same, head, rows = counterexample_table(run)
    words, says = f"{report.outcome}.", (ROWS, same) if same else (ROWS,)
    page_words = pages.PageWords(
        title=report.program,
        headline=words,
        subtitle="",
        violated=report.outcome.rpartition(" at ")[0],
        notes=(),
        assumptions=(),
        provenance={
            "program": report.program,
            "program sha256": report.program_sha256,
            "counterexample": report.path,
            "soter": VERSION,
        },
        sections=(PageSection("The last instants", says, head, rows, len(rows) - 1),),
        svg=picture(run.system),
    )
    instants = [pages.Instant(*(x[n] for n in pages.Instant._fields)) for x in run.steps]
    return pages.counterexample_page(run.system, page_words, instants, run.time_ns / 1e9)


def counterexample_table(
    run: CounterexampleRun,
) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """The values shared by a run's last instants as a sentence, and a table of all other values."""
    rows = _instant_rows(run)
    columns = {
        n: tuple(r.get(n, "") for r in rows) for n in dict.fromkeys(n for r in rows for n in r)
    }
    same = [f"{n} = {x[0]}" for n, x in columns.items() if n != TIME and len({*x}) == 1]
    varying = {n: x for n, x in columns.items() if n == TIME or len({*x}) > 1}
    table = tuple(zip(*varying.values(), strict=True))
    return f"always: {', '.join(same)}" if same else "", tuple(varying), table


def _instant_rows(run: CounterexampleRun) -> list[dict[str, str]]:
    """The values at each instant, as texts by name."""
    from soter.explore.trace_view import value_text  # noqa: PLC0415 - see `soter.api`

    rows: list[dict[str, str]] = []
    for step in run.steps:
        topics, row = step["topics"], {TIME: value_text(step["time_s"]), **step["modes"]}
        parts = {f"{plant}.truth": states for plant, states in step["truth"].items()}
        parts |= {n: v for n, v in topics.items() if n.rpartition("_")[0] not in topics}
        parts |= {f"chosen {stream}": value for stream, value in step["chosen"].items()}
        rows.append(row | {name: value_text(leaf) for name, leaf in _named_values("", parts)})
    return rows


def _named_values(name: str, value: object) -> Iterator[tuple[str, object]]:
    """Yields the name and value of each part of a JSON value that is not an object."""
    if not isinstance(value, dict):
        yield name, value
        return
    for part, inner in value.items():
        yield from _named_values(f"{name}.{part}" if name else part, inner)


def replay(path: str | Path) -> ReplayReport:
    """Runs a trace of `soter test` or a counterexample of `soter verify` in the interpreter.

    Raises SoterError D010 if the file is neither, D011 if its program has changed, or the errors of
    the program.
    """
    from soter.explore.trace import read_document, trace_from_document  # noqa: PLC0415 - see `soter.api`

    file = Path(path)
    document = read_document(file)
    if document.get("kind") == "counterexample":
        return _replay_counterexample(file, document)
    return _replay_trace(trace_from_document(document, file), file)


def _replay_trace(trace: Trace, file: Path) -> ReplayReport:
    from soter.api.exploring import with_skew_and_horizon  # noqa: PLC0415 - the same
    from soter.explore import trace as traces  # noqa: PLC0415 - see `soter.api`
    from soter.explore.replay import replay as run  # noqa: PLC0415 - the same

    path = traces.program_path(trace)
    if not Path(path).exists():
        raise traces.missing_program_error(trace, path)
    checked = check_file(path)
    if not checked.begins_as_program:
        raise traces.changed_program_error(trace, path)
    if not checked.ok or checked.program is None:
        raise SoterError(checked.diagnostics.items)
    if checked.program.sha256 != trace.sha256:
        raise traces.changed_program_error(trace, path)
    if trace.test not in checked.tests:
        raise traces.no_trace_error(file, "its program has no such test")
    params = params_from_json(checked.program, trace.params, file)
    system = system_of_test(checked, trace.test, params)
    system = with_skew_and_horizon(system, trace.skew_ns, trace.horizon_ns)
    compute_ttf(system)
    replay_result = run(trace, system)
    return ReplayReport(
        str(file),
        "trace",
        path,
        trace.sha256,
        replay_result.reproduced,
        replay_result.outcome,
        trace=replay_result,
    )


def _replay_counterexample(file: Path, document: Mapping[str, Any]) -> ReplayReport:
    from soter.explore.trace import no_trace_error  # noqa: PLC0415 - see `soter.api`
    from soter.verify.counterexample import AnotherVersionError, replay_file  # noqa: PLC0415 - the same

    program, sha256 = str(document.get("program", "")), str(document.get("program_sha256", ""))
    try:
        run = replay_file(file)
    except AnotherVersionError as error:
        raise mistake("D011", str(error), "verify again: `soter verify`") from error
    except ValueError as error:
        raise no_trace_error(file, str(error)) from error
    except SoterError as error:
        if any(d.code == "U002" for d in error.diagnostics):
            raise no_trace_error(file, "its program has no such system") from error
        raise
    outcome = "the run does not show what the file says"
    if run is not None:
        outcome = f"{document.get('module')}: {document.get('shows')} at {run.time_ns / 1e9:.9g} s"
    return ReplayReport(
        str(file), "counterexample", program, sha256, run is not None, outcome, counterexample=run
    )
