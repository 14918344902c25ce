"""`soter monitor FILE [LOG]`: whether the model that was proved explains what was recorded.

Purpose: judges a log, or a fresh run, module by module; or writes the monitor as a Soter node; with
`--map` it judges a log of another system. Continuous integration gets a finding for each module, at
its declaration: `fail` for an alarm or a read outside `safe`, `open` where nothing was judged or
the log does not decide.
Non-goals: the judgements (`monitor/`).
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.output_files import write_sections
from soter.cli.terminal.child_process import fork_into_child
from soter.cli.terminal.ci_findings import CiFinding, Kind
from soter.cli.terminal.command_line import Pairs, seed_number
from soter.cli.terminal.command_outcome import (
    FINE,
    UNDECIDED,
    VIOLATED,
    CommandOutcome,
    exit_of_kinds,
)
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.log_judgement import (
    DAMAGE,
    FOREIGN_LOG,
    NOTHING,
    judgement_lines,
    judgement_sections,
    loss_lines,
    share_words,
    undecided_warning,
    unheard_sentences,
    verdict_line,
)
from soter.cli.terminal.program_loading import bound_program, loaded_program, opened_program
from soter.cli.terminal.shared_options import (
    FORMAT,
    MODULE,
    SET,
    SYSTEM,
    file_option,
    report_option,
    report_path,
)
from soter.diagnostics.command_records import SEVERAL, SWITCH, JsonObject, one_of, option, read_by
from soter.diagnostics.diagnostic import mistake
from soter.diagnostics.render import safe
from soter.report.judged_curves import JudgedTimes, drawing_html
from soter.report.templates import PageSection
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.api import Program
    from soter.monitor.log_files.log_columns import Damage
    from soter.monitor.log_judgement import LogJudgement
    from soter.monitor.model_membership import Judgement


RULE = "monitor"


def judgement_findings(judged: Sequence[Judgement]) -> tuple[CiFinding, ...]:
    """A finding for each module: whether the plant that was proved explains every step."""
    findings = []
    for j in judged:
        how = f"judged on {j.source}{share_words(j.judged_share)}"
        text = f"{j.module}: the model explains each of {j.steps:,} steps, {how}"
        if j.alarms:
            text = (
                f"{j.module}: the model is false: alarms in {j.alarms:,} of {j.steps:,} steps, "
                f"the first at {j.first_alarm_s:.3f} s, {how}"
            )
        elif not j.judged:
            text = f"{j.module}: {NOTHING}"
        details = (*(f"{state}: {n:,} alarms" for state, n in j.alarm_states.items()), *j.notes)
        if j.damage is not None:
            text = f"{j.module}: {j.damage}: {text.partition(': ')[2]}"
        kind: Kind = "fail" if j.alarms else "pass" if j.judged else "open"
        kind = "open" if j.damage is not None else kind
        findings.append(CiFinding(kind, RULE, j.module, text, j.span, details))
    return tuple(findings)


def log_findings(judged: LogJudgement) -> tuple[CiFinding, ...]:
    """A finding for each module: whether a value it read was outside `safe`, with assumptions."""
    findings = []
    for m in judged.modules:
        text = f"{m.module}: {verdict_line(m)}"
        if not m.decided:
            missing = tuple(f"missing: {name}" for name in m.missing)
            findings.append(CiFinding("open", RULE, m.module, text, m.span, missing))
            continue
        lost = (t.strip() for t in loss_lines(judged))
        details = (*unheard_sentences(m), *lost, *(f"assumed: {a}" for a in judged.assumptions))
        kind: Kind = "fail" if m.violated else "pass" if m.judged else "open"
        kind = "open" if m.damage is not None else kind
        findings.append(CiFinding(kind, RULE, m.module, text, m.span, details))
    return tuple(findings)


EXAMPLES = """\
  soter run drone.soter --log flight.mcap
  soter monitor drone.soter flight.mcap            on the true states of a log
  soter monitor drone.soter --seed 7               on those of a fresh run
  soter monitor drone.soter --seed 1..20           of twenty, a line each
  soter monitor drone.soter flight.mcap --estimates     on what the DM saw
  soter monitor drone.soter flight.mcap --format junit > flight.xml    for CI; or sarif, github
  soter monitor drone.soter flight.mcap --report flight.html     a page to file
  soter monitor drone.soter --emit watch.soter     the monitor as a trusted node
  soter monitor drone.soter px4.csv --map px4.toml      a log of somebody else: when would each
                                                        module have switched, how near it came
  soter monitor drone.soter flight.bag --map ros.toml   the same: bags of ROS 1 and 2, any MCAP
  soter monitor drone.soter flight.ulg --map px4.toml   of PX4, .bin and .log of ArduPilot, .tlog
  soter monitor drone.soter pose.csv battery.csv --map two.toml    several CSVs that are one log
  soter monitor drone.soter crash.bin --map ap.toml --partial      what stands before a damage
  soter monitor drone.soter px4.csv --map px4.toml --estimates    whether the model explains it

exit codes: 0 every step is explained, 3 an alarm: the model is false, 4 no step was judged,
1 diagnostics, 2 usage; with --map: 0 no read lay outside `safe`, 3 one did, 4 of a module none
was judged: the log does not decide it, or every read came too late (--module M asks of one);
with --partial 4, too, where the log is damaged, whatever was found before that
"""
SEEDS_MAX = 10_000
HEAD = ("module", "steps", "alarms", "first alarm", "most of the disturbance used", "by")
ALARM = (
    "an alarm: no disturbance within its declared bounds explains the step. The model is false, "
    "and what was proved with it says nothing about this run. `by` names the state (or the "
    "command) that does not fit: look at what its rate reads, and at its sensor."
)
MEANING = (
    "The model explains a step where disturbances within the ranges that the program declares lead "
    "from one recorded state to the next. An alarm is a step that none explains. Judged on truth: "
    "on the states of the plants; on estimates: on what the DM read, with the measurement errors "
    "that the program declares. Most of the disturbance used: of all steps the largest part of a "
    "declared range that one needed, and the state (column `by`) that needed it; at most 100% is "
    "as declared. On estimates nothing stands there, and `by` names the states of which the alarms "
    "left nothing. Times are seconds from where the record begins. That every step is explained "
    "does not say that the run was safe: `soter run` judges that."
)
"""What the words of the table mean, for a page that somebody reads without the program."""
ALLOWED = "may be from -100 to 100 %"
OFFSET_MAX = 5.0
OFFSETS = (
    "Each curve is a state: how far a step led from the middle of what the model allows, as a "
    "share of what the declared bounds and errors allow; above 500 % it is drawn there."
)
ENDING = "-monitor.html"


def _seed_range(text: str) -> range:
    """The seeds of `N` or of a range such as `1..9`; ArgumentTypeError for other text."""
    first, dots, last = text.partition("..")
    seeds = range(seed_number(first), (seed_number(last) if dots else seed_number(first)) + 1)
    if not 0 < len(seeds) <= SEEDS_MAX:
        raise argparse.ArgumentTypeError(f"`{text}`: A..B are 1 to {SEEDS_MAX:,} seeds, A first")
    return seeds


@dataclass(frozen=True, kw_only=True)
class Options:
    """Does the verified model explain a recorded run?"""  # noqa: D400 - a question

    file: str = file_option()
    log: Sequence[str] = option(
        "[LOG...]", (), "an MCAP log, with --map others, or several CSVs; by default a fresh run"
    )
    map: str | None = option("--map FILE", None, "TOML or JSON: which topic is what in the LOG")
    where: Sequence[str] = option(
        "--where COLUMN=TEXT", (), "with --map: rows that count; may be repeated", SEVERAL
    )
    partial: bool = option(
        "--partial", False, "with --map: of a damaged log what stands before that; exit 4", SWITCH
    )
    system: str | None = option(*SYSTEM)
    module: str | None = option(*MODULE)
    until: str | None = option("--until TIME", None, "of a fresh run; by default the system's")
    seed: Sequence[int] = option(
        "--seed N|A..B",
        range(1, 2),
        "of a fresh run, or of one for each from A to B; by default 1",
        read_by(_seed_range),
    )
    estimates: bool = option(
        "--estimates", False, "judge what was measured, not the true states", SWITCH
    )
    emit: str | None = option("--emit PATH", None, "write the monitor as a Soter node")
    alarm: str | None = option("--alarm TOPIC", None, "with --emit: a bool topic of the program")
    report: str | None = report_option("the judgement", ENDING)
    params: Pairs = option(*SET)
    format: str | None = option(*FORMAT)
    NEEDS = (
        ("log", "map"),
        ("map", "where partial"),
        ("emit", "alarm"),
        ("!emit", "log until seed estimates report"),
        ("!log", "until seed"),
    )


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Judges a run or a log, or writes the monitor; SoterError U001 for options that clash."""
    logs, args.log = [*args.log], ", ".join(args.log) or None
    if args.map is not None:
        return _judge_foreign_log(args, logs, console)
    if len(logs) > 1:
        raise mistake("U001", "several logs are one where `--map` describes them")
    program = opened_program(args, console)
    if program.externs and args.log is None and args.emit is None:
        fork_into_child(console, lambda _: ())
    bound_program(program, args)
    choices = {"system": args.system, "params": dict(args.params)}
    if args.emit is not None:
        program.emit_monitor(args.emit, args.module, alarm=args.alarm, **choices)
        console.say(f"wrote {args.emit}")
        return CommandOutcome(fields=DOCUMENT.of(Monitored(args.emit)))
    choices |= {"until": args.until, "estimates": args.estimates}
    by_seed = [program.monitor(args.log, args.module, seed=one, **choices) for one in args.seed]
    if len(args.seed) > 1:
        return _say_runs(args.seed, by_seed, args, console, program)
    return _tell_judgements(by_seed[0], args, console, program)


def _say_runs(
    seeds: Sequence[int],
    by_seed: Sequence[list[Judgement]],
    args: argparse.Namespace,
    console: Console,
    program: Program,
) -> CommandOutcome:
    """Prints one line for each module in each run, then one for each module over all runs."""
    rows = [
        (str(s), *_module_row(j)) for s, judged in zip(seeds, by_seed, strict=True) for j in judged
    ]
    together = [_joined_judgement(of) for of in zip(*by_seed, strict=True)]
    rows += [("all", *_module_row(j)) for j in together]
    return _tell_table(together, (("seed", *HEAD), rows), args, console, program)


def _joined_judgement(of: Sequence[Judgement]) -> Judgement:
    """The judgement of one module over several runs: sums, first alarm, and largest share."""
    states = Counter[str]()
    for j in of:
        states.update(j.alarm_states)
    return replace(
        max(of, key=lambda j: j.share),
        steps=sum(j.steps for j in of),
        judged_ns=sum(j.judged_ns for j in of),
        length_ns=sum(j.length_ns for j in of),
        empty_runs=sum(not j.judged for j in of),
        alarms=sum(j.alarms for j in of),
        first_alarm_s=min(
            (j.first_alarm_s for j in of if j.first_alarm_s is not None), default=None
        ),
        alarm_states=dict(states),
    )


def _tell_judgements(
    judged: list[Judgement], args: argparse.Namespace, console: Console, program: Program
) -> CommandOutcome:
    """Prints the judgements of one run or log, and gives the outcome."""
    return _tell_table(judged, (HEAD, [_module_row(j) for j in judged]), args, console, program)


def _offset_sections(
    judged: Sequence[Judgement], args: argparse.Namespace
) -> Iterator[PageSection]:
    """Page sections that show, over time, how far the states of one run are from those allowed."""
    asked = args.report is not None and len(args.seed) == 1
    for j in (j for j in judged if asked and j.offsets):
        times = JudgedTimes(j.offset_times_s[0], j.offset_times_s[-1], changes=j.modes)
        times.alarms.update(map(times.column_at, j.alarm_times_s))
        for at_s, offsets in zip(j.offset_times_s, j.offsets, strict=True):
            for name, x in zip(j.state_names, offsets.tolist(), strict=True):
                share = 100.0 * min(max(x, -OFFSET_MAX), OFFSET_MAX)
                times.note_value((name, "%", ALLOWED), at_s, share, (-100.0, 100.0), alarm=True)
        title = f"{j.module}: its states beside the model"
        yield PageSection(title, (OFFSETS,), drawn=drawing_html(times, "alarms"))


def _tell_table(
    judged: Sequence[Judgement],
    table: tuple[tuple[str, ...], list[tuple[str, ...]]],
    args: argparse.Namespace,
    console: Console,
    program: Program,
) -> CommandOutcome:
    source, part = judged[0].source, min(j.judged_share for j in judged)
    says = f"{args.log or args.file}  judged on {source}{share_words(part)}"
    head, rows = table
    alarms = sum(j.alarms for j in judged)
    empty = [j.module for j in judged if not j.judged]
    notes = [safe(n) for j in judged for n in j.notes]
    if alarms:
        notes.insert(0, ALARM)
    if empty:
        notes.append(f"{', '.join(empty)}: {NOTHING}")
    fields = DOCUMENT.of(Monitored(judged=tuple(judged)))
    found = judgement_findings(judged)
    code = exit_of_kinds(f.kind for f in found)
    damage = next((j.damage for j in judged if j.damage is not None), None)
    headline = _headline(code, part, damage, alarms)
    if damage is not None:
        says = f"{says}\n{headline}"
        notes.insert(0, damage.told)
    console.say(f"{says}\n")
    console.say(console.table(head, rows))
    for text in dict.fromkeys(notes):
        console.say(f"\n{text}")
    sections_ = [
        PageSection("What was judged", (says, *dict.fromkeys(notes)), head, tuple(rows)),
        *_offset_sections(judged, args),
        PageSection("How to read it", (MEANING,)),
        PageSection("Provenance", _provenance_lines(program)),
    ]
    fields |= _write_report_page(args, headline, _headline_tone(code, part), sections_, console)
    return CommandOutcome(code, (), fields, found)


def _headline(code: int, part: float, damage: Damage | None, alarms: int) -> str:
    """The verdict in one line; the page shows it, and the terminal if the log is damaged."""
    if damage is not None:
        return f"{damage}: {alarms:,} alarms there"
    headlines = {VIOLATED: "the model is false", UNDECIDED: NOTHING}
    return headlines.get(code, f"the model explains every step{share_words(part)}")


def _judge_foreign_log(
    args: argparse.Namespace, logs: list[str], console: Console
) -> CommandOutcome:
    """Judges a log by the mapping of `--map`; SoterError U001 if a `--where` has no `=`."""
    wrong = next((pair for pair in args.where if "=" not in pair), None)
    if wrong is not None:
        raise mistake("U001", f"`--where` is COLUMN=TEXT, not `{wrong}`")
    program = loaded_program(args, console)
    choices = {"module": args.module, "system": args.system, "params": dict(args.params)}
    choices |= {"where": dict(pair.split("=", 1) for pair in args.where), "partial": args.partial}
    if args.estimates:
        from soter.api.monitoring import log_explained  # noqa: PLC0415 - needs NumPy

        explained = log_explained(program.flat, logs, args.map, **choices)
        return _tell_judgements(explained, args, console, program)
    with ProgressBar(console) as progress:
        judged = program.judge_log(logs, args.map, progress=progress, **choices)
    console.say("\n".join(judgement_lines(judged, console)))
    items = tuple(undecided_warning(m) for m in judged.modules if not m.decided)
    found = log_findings(judged)
    code = exit_of_kinds(f.kind for f in found)
    fields = DOCUMENT.of(Monitored(log=judged))
    headline = "; ".join(f"{m.module}: {verdict_line(m)}" for m in judged.modules)
    page = [*judgement_sections(judged), PageSection("Provenance", _provenance_lines(program))]
    part = min((m.judged_share for m in judged.modules), default=0.0)
    fields |= _write_report_page(args, headline, _headline_tone(code, part), page, console)
    return CommandOutcome(code, items, fields, found)


def _write_report_page(
    args: argparse.Namespace, headline: str, colour: str, of: list[PageSection], console: Console
) -> dict[str, object]:
    """Writes the page if `--report` asks for it; SoterError D006 if it cannot be written."""
    if args.report is None:
        return {}
    title = f"{Path(args.file).name}: {Path(args.log).name if args.log else _seeds_text(args)}"
    path = report_path(args.report, args.file, ENDING)
    write_sections(path, title, headline, colour, of)
    console.say(f"\nreport  {path}")
    return {"report": str(path)}


def _headline_tone(code: int, share: float) -> str:
    """The tone of a page's headline; it is `good` only if the whole record was judged and fine."""
    return "bad" if code == VIOLATED else "good" if code == FINE and share == 1.0 else ""


def _provenance_lines(program: Program) -> tuple[str, ...]:
    """The lines of a page that name the program and the version of soter that judged."""
    return (f"Program {program.path}, SHA-256 {program.sha256}.", f"Judged by soter {VERSION}.")


def _seeds_text(args: argparse.Namespace) -> str:
    first, last = args.seed[0], args.seed[-1]
    return f"seed {first}" if first == last else f"seeds {first} to {last}"


def _module_row(j: Judgement) -> tuple[str, ...]:
    """The cells of a module's row in the table with columns `HEAD`."""
    return (
        j.module,
        f"{j.steps:,}",
        f"{j.alarms:,}",
        "" if j.first_alarm_s is None else f"{j.first_alarm_s:.3f} s",
        "" if j.source == "estimates" else f"{j.share:.0%}",
        j.state or ", ".join(j.alarm_states),
    )


# ---------------------------------------------------------------- for programs


@dataclass(frozen=True)
class Monitored:
    """The result: the file of a monitor, judgements of a run or log, or that of a mapped log."""

    emitted: str | None = None
    judged: tuple[Judgement, ...] = ()
    log: LogJudgement | None = None


def _modules_by_name(m: Monitored) -> dict[str, Judgement]:
    return {j.module: j for j in m.judged}


def _largest_share(j: Judgement) -> float | None:
    return None if j.source == "estimates" else j.share


DOCUMENT = JsonObject(
    Monitored,
    "emitted modules log",
    {"modules": _modules_by_name},
    beside={"file": str, "report?": str},
    modules=JsonObject(
        "soter.monitor.model_membership.Judgement",
        "source judged judged_share steps alarms first_alarm_s largest_share state=state? "
        "alarm_states notes damage",
        {"largest_share": _largest_share},
        source=one_of("truth", "estimates"),
        damage=DAMAGE,
    ),
    log=FOREIGN_LOG,
)
