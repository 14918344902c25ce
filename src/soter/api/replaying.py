"""Runs in a file, run again: traces of `soter test`, counterexamples of `soter verify`.

Purpose: `replay`, and the `ReplayReport` it gives.
Non-goals: the run itself (`explore/replay.py`, `verify/attack/counterexample.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import complete, params_from_json, write_sections, write_sequence
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.language.front_end import check_file, system_of_test
from soter.report.plain_page import PageSection
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from soter.explore.replay import Replayed
    from soter.explore.trace import Trace
    from soter.report.sequence.view import SequenceView
    from soter.verify.attack.counterexample import Replay as CounterexampleRun

ROWS = (
    "Each row is an instant of the decision modules: seconds, who is in control, true states, "
    "topics, and what the environment and the adversary chose last."
)


@dataclass(frozen=True, eq=False)
class ReplayReport:
    """What `soter.replay` found in a file.

    `kind`: "trace" (of `soter test`, then `trace` has every step) or "counterexample" (of `soter
    verify`, then `counterexample` is the run). `outcome`: one sentence.
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
        """The trace as the records that pages, logs and tables are made of.

        `SoterError` U001 for a counterexample of `soter verify`: a proof has no schedule.
        """
        from soter.explore.trace_view import view_of  # noqa: PLC0415 - see `soter.api`

        if self.trace is None:
            raise mistake(
                "U001",
                f"`{self.path}` is a run that refutes a proof: it has no sequence of steps",
                "`soter replay --report` writes its last instants as a table",
            )
        return view_of(self.trace, VERSION, {"trace": self.path}, self.program)

    def write_html(self, path: str | Path) -> Path:
        """Write the sequence of a trace, or a counterexample's table, as a page; `SoterError` D006.

        U001 where the run of the file does not show what the file says.
        """
        run, file = self.counterexample, Path(path)
        if run is not None:
            about = PageSection("The last instants", (ROWS,), *table_of(run))
            write_sections(file, "soter replay", self.outcome, "bad", [about])
            return file
        return write_sequence(self.view(), Path(path), "html")

    def write_mcap(self, path: str | Path) -> Path:
        """Write the MCAP log of a trace; `SoterError` D006, D007, U001."""
        return write_sequence(self.view(), Path(path), "mcap")


def table_of(run: CounterexampleRun) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """The head of a table of a run's last instants, and its rows of text."""
    from soter.explore.trace_view import shown  # noqa: PLC0415 - see `soter.api`

    rows: list[dict[str, str]] = []
    for step in run.steps:
        topics, row = step["topics"], {"time (s)": shown(step["time_s"]), **step["modes"]}
        parts = {f"{plant}.truth": states for plant, states in step["truth"].items()}
        parts |= {n: v for n, v in topics.items() if n.rpartition("_")[0] not in topics}
        parts |= {f"chosen {stream}": value for stream, value in step["chosen"].items()}
        rows.append(row | {name: shown(leaf) for name, leaf in _leaves("", parts)})
    head = tuple(dict.fromkeys(name for row in rows for name in row))
    return head, tuple(tuple(row.get(name, "") for name in head) for row in rows)


def _leaves(name: str, value: object) -> Iterator[tuple[str, object]]:
    """The numbers of a JSON value that are no records, by name."""
    if not isinstance(value, dict):
        yield name, value
        return
    for part, inner in value.items():
        yield from _leaves(f"{name}.{part}" if name else part, inner)


def replay(path: str | Path) -> ReplayReport:
    """Run a trace of `soter test`, or a counterexample of `soter verify`, in the interpreter.

    `SoterError` D010 where the file is neither, D011 where its program has changed, and whatever is
    wrong with the program.
    """
    from soter.explore.trace import read_document, trace_of  # noqa: PLC0415 - see `soter.api`

    file = Path(path)
    document = read_document(file)
    if document.get("kind") == "counterexample":
        return _replay_counterexample(file, document)
    return _replay_trace(trace_of(document, file), file)


def _replay_trace(trace: Trace, file: Path) -> ReplayReport:
    from soter.explore import trace as traces  # noqa: PLC0415 - see `soter.api`
    from soter.explore.command import (  # noqa: PLC0415 - the same
        changed_program,
        missing_program,
        with_times,
    )
    from soter.explore.replay import replay as run  # noqa: PLC0415 - the same

    path = traces.program_path(trace)
    if not Path(path).exists():
        raise missing_program(trace, path)
    checked = check_file(path)
    if not checked.begins:
        raise changed_program(trace, path)
    if not checked.ok or checked.program is None:
        raise SoterError(checked.diagnostics.items)
    if checked.program.sha256 != trace.sha256:
        raise changed_program(trace, path)
    if trace.test not in checked.tests:
        raise traces.no_trace(file, "its program has no such test")
    params = params_from_json(checked.program, trace.params, file)
    system = system_of_test(checked, trace.test, params)
    system = with_times(system, trace.skew_ns, trace.horizon_ns)
    complete(system)
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
    from soter.explore.trace import no_trace  # noqa: PLC0415 - see `soter.api`
    from soter.verify.attack.counterexample import AnotherVersionError, replay_file  # noqa: PLC0415 - the same

    program, sha256 = str(document.get("program", "")), str(document.get("program_sha256", ""))
    try:
        run = replay_file(file)
    except AnotherVersionError as error:
        hint = "verify again: `soter verify`"
        raise mistake("D011", str(error), hint) from error
    except ValueError as error:
        raise no_trace(file, str(error)) from error
    except SoterError as error:
        if any(d.code == "U002" for d in error.diagnostics):
            raise no_trace(file, "its program has no such system") from error
        raise
    outcome = "the run does not show what the file says"
    if run is not None:
        outcome = f"{document.get('module')}: {document.get('shows')} at {run.time_ns / 1e9:.9g} s"
    return ReplayReport(
        str(file), "counterexample", program, sha256, run is not None, outcome, counterexample=run
    )
