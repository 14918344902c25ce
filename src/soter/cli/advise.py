"""`soter advise FILE`: which period a decision module may have, and what its levels change.

Purpose: prints a table for each module and the longest period (the paper's Delta) that verifies,
and draws a figure in `.soter/`; with `--delay` it finds how late commands may act, with `--rest` a
clause `rest`.
Non-goals: the sweeps (`verify/period_advice.py`), the drawing (`report/proof_page.py`), the search
(`verify/search/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.cli.terminal.command_line import Pairs, UsageError
from soter.cli.terminal.command_outcome import CommandOutcome
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.program_loading import loaded_program
from soter.cli.terminal.proof_hints import SEARCHES, print_tries
from soter.cli.terminal.shared_options import MODULE, SET, file_option
from soter.cli.terminal.stored_outcome import Printout
from soter.diagnostics.command_records import SWITCH, JsonObject, option
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    import argparse

    from soter.api.program import Program
    from soter.report.tables import Entry, Tone
    from soter.verify.period_advice import Advice, DelayAdvice

EXAMPLES = """\
  soter advise cart.soter
  soter advise cart.soter --levels 2,3,4,6
  soter advise cart.soter --factors 0.5,1,2,8      multiples of the declared period
  soter advise drone.soter --module SafeMotionPrimitive --report advice.html
  soter advise cart.soter --delay                 how late commands may act, proof by proof
  soter advise cart.soter --rest                  where SC comes to rest, as a clause that proves
  soter advise cart.soter --buffer                how far from the fence SC takes over, by speed
  soter advise drone.soter --buffer motion.p.x,motion.v.x
  soter advise cart.soter --json | jq '.modules[].best_s'

Nothing is changed: every row is the program's problem with another period of the decision module.
SC's period stays as it is; where it is the decision module's, rows in which it is changed with that
are tried, too. What is said of the largest period is said of those tried, on the declared grid.

With --delay the periods stay, and `acts within` grows: the largest value with which everything is
proved, and the next one with what is not. Each takes as long as `soter verify`.

With --rest clauses `rest` are tried in place of the program's hints at a proof, and of `ttf` and
`safer`, for 120 s of processor time a module: what each gave, and the one that proves.

With --buffer the compiled decision module is asked at 8 speeds how near to the end of `safe` it
leaves control to AC, and SC is flown from there in the model, without disturbances. Position and
speed are found where `safe` reads a number whose rate reads another one; else name the two.

exit codes: 0 always when there was something to compute, 1 diagnostics, 2 usage
"""
NONE_PROVES = "none of these proves all of it; a `rest` of the program itself was not asked"
NO_REST = "no clause `rest` was tried: none came out of runs of the model under SC"
BAR = 30
"""Characters of the longest bar."""
FLOWN = (
    "█ what SC needs, flown without disturbances; ░ what the decision module keeps for lateness, "
    "errors, disturbances and whatever AC does until SC acts"
)
LARGEST = 100.0
LONGEST = "YES, the longest"
"""The mark of the row with the longest period that verifies."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the decision period and the levels cost."""

    file: str = file_option()
    module: str | None = option(*MODULE)
    system: str | None = option("--system S", None, "the system its plants stand in")
    params: Pairs = option(*SET)
    levels: str = option("--levels LIST", "2,3,4", "m to try (2,3,4)")
    factors: str = option(
        "--factors LIST",
        "0.25,0.5,1,1.5,2,3,4",
        "multiples of the declared period to try (0.25 to 4)",
    )
    delay: bool = option(
        "--delay", False, "how late commands may act, in place of the periods", SWITCH
    )
    rest: bool = option("--rest", False, "a clause `rest`, in place of the periods", SWITCH)
    buffer: str | None = option(
        "--buffer [X,V]", None, "how far from the fence SC takes over, by speed", keyword=False
    )
    output: str | None = option("-o --report FILE", None, "the figure (.soter/...html)")
    NEEDS = (
        ("!delay", "rest buffer levels factors output"),
        ("!rest", "buffer levels factors output"),
        ("!buffer", "levels factors output"),
    )


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Runs the sweeps and prints their advice; UsageError for options that exclude each other."""
    levels = [int(x) for x in _number_list(args.levels, "--levels", 2.0)]
    factors = _number_list(args.factors, "--factors", 1e-3)
    program = loaded_program(args, console)
    if args.delay:
        return _tell_delays(args, console, program)
    if args.rest:
        return _tell_rests(args, console, program)
    if args.buffer is not None:
        return _tell_buffers(args, console, program)
    page = Path(args.output or Path(".soter") / f"{Path(args.file).stem}-advise.html")
    with ProgressBar(console) as progress:
        all_advice = program.advise(
            args.module,
            system=args.system,
            params=dict(args.params),
            levels=levels,
            factors=factors,
            report=page,
            progress=progress,
        )
    for advice in all_advice:
        _say_advice(advice, console)
    if all_advice:
        console.say(f"\nfigure  {page}")
    else:
        console.say("there is no module to advise on")
    fields: dict[str, object] = {
        "program_sha256": program.sha256,
        "report": str(page) if all_advice else None,
        "modules": {a.module: ADVICE.of(a) for a in all_advice},
    }
    return CommandOutcome(fields=fields)


def _tell_delays(args: argparse.Namespace, console: Console, program: Program) -> CommandOutcome:
    """Finds and prints, for `--delay`, how late the commands of each module may take effect."""
    with ProgressBar(console) as progress:
        delays = program.largest_delays(
            args.module, system=args.system, params=dict(args.params), progress=progress
        )
    for delay in delays:
        console.say(f"\n{console.paint('bold', delay.module)}\n  {delay.summary}")
        tried = ", ".join(show_ns(ns) for ns in delay.why_not)
        console.say(console.paint("muted", f"  tried, each by a proof: {tried}"))
    fields: dict[str, object] = {
        "program_sha256": program.sha256,
        "delays": {d.module: DELAY.of(d) for d in delays},
    }
    return CommandOutcome(fields=fields)


def _tell_rests(args: argparse.Namespace, console: Console, program: Program) -> CommandOutcome:
    """Finds and prints, for `--rest`, a clause `rest` with which each module can be proved."""
    with ProgressBar(console) as progress:
        choices = {"module": args.module, "system": args.system, "params": dict(args.params)}
        searches = program.rest_clauses(**choices, progress=progress)
    printed = Printout()
    for search in searches:
        printed.say(f"\n{printed.paint('bold', search.module)}")
        if search.tries:
            print_tries(search, printed)
        found = f"found   {printed.paint('green', str(search.found))}" if search.proved else ""
        printed.say("\n" + (found or (NONE_PROVES if search.tries else NO_REST)))
    printed.print_to(console)
    if not searches:
        from soter.verify.search.searched_program import NOT_LOOKED_FOR  # noqa: PLC0415 - rarely

        console.say(NOT_LOOKED_FOR)
    fields: dict[str, object] = {
        "program_sha256": program.sha256,
        "rests": {s.module: SEARCHES.of(s) for s in searches},
    }
    return CommandOutcome(fields=fields)


def _tell_buffers(args: argparse.Namespace, console: Console, program: Program) -> CommandOutcome:
    """Prints, for `--buffer`, where SC takes over in each module, with one bar for each speed."""
    named = tuple(args.buffer.split(",")) if args.buffer else None
    if named is not None and len(named) != 2:
        raise UsageError(f"--buffer takes a position and a speed, not `{args.buffer}`")
    from soter.api.buffer_advice import buffers  # noqa: PLC0415 - needs a compiler

    with ProgressBar(console) as progress:
        choices = {"module": args.module, "system": args.system, "params": dict(args.params)}
        found = buffers(program, named, progress=progress, **choices)
    for b in found:
        console.say(f"\n{console.paint('bold', b.module)}  {b.position} to {b.fence:.6g}\n")
        widest = max((r.room for r in b.rows), default=1.0)
        unit, per = (f" {u}" if u else "" for u in b.units)
        rows: list[list[Entry]] = []
        for r in b.rows:
            bar = "█" * round(BAR * r.used / widest)
            bar += "░" * (round(BAR * r.room / widest) - len(bar))
            numbers = (f"{round(x, 6):.4g}{unit}" for x in (r.taken_at, r.room, r.used))
            rows.append([f"{r.speed:.4g}{per}", *numbers, bar])
        head = (b.speed, "SC takes over at", "to the fence", "SC needs", "")
        console.say(console.table(head, rows))
        faster = f"faster than {b.fastest:.4g}{per} AC has no control where the module starts"
        console.say(console.paint("muted", f"{FLOWN}\n{faster}"))
    return CommandOutcome(fields={"buffers": {b.module: BUFFERS.of(b) for b in found}})


def _number_list(text: str, option: str, least: float) -> list[float]:
    """The numbers listed in an option, each from `least` to LARGEST; UsageError for others."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        message = f"{option} takes numbers with commas between, not `{text}`"
        raise UsageError(message) from None
    if not all(least <= x <= LARGEST for x in numbers):
        raise UsageError(f"{option} takes numbers from {least:g} to {LARGEST:g}, not `{text}`")
    return numbers


def _say_advice(advice: Advice, console: Console) -> None:
    from soter.report.tables import Styled  # noqa: PLC0415 - needs NumPy

    head, table = advice.table()
    mark, best = head.index("verifies"), advice.best_ns
    rows: list[list[Entry]] = []
    for row, cells in zip(advice.rows, table, strict=True):
        verifies = row.verifies(advice.levels)
        cell = LONGEST if verifies and row.delta_ns == best else cells[mark]
        tone: Tone = "good" if verifies else "muted"
        rows.append([Styled(cell if k == mark else t, tone) for k, t in enumerate(cells)])
    console.say(f"\n{console.paint('bold', advice.module)}\n")
    console.say(console.table(head, rows))
    console.say(console.paint("muted", "* as the program says"))
    console.say(console.paint("muted", advice.legend))
    console.say(f"\n{advice.summary}")


def _row_documents(advice: Advice) -> list[dict[str, object]]:
    return [ROW.of(r) | {"verifies": r.verifies(advice.levels), "why": r.why} for r in advice.rows]


def _tried_delays(delay: DelayAdvice) -> list[dict[str, object]]:
    return [
        {"acts_s": ns / 1e9, "proved": not why, "why": why} for ns, why in delay.why_not.items()
    ]


ROW = JsonObject(
    "soter.verify.period_advice.AdviceRow",
    "period_s=delta_ns/s sc_period_s=sc_ns/s h_star_s=h_star_ns/s horizon_s=horizon_ns/s in_time "
    "core allowed levels returns written",
)
ADVICE = JsonObject(
    "soter.verify.period_advice.Advice",
    "period_s=delta_ns/s levels summary best_s=best_ns/s rows",
    {"rows": _row_documents},
)
DELAY = JsonObject(
    "soter.verify.period_advice.DelayAdvice",
    "declared_s=declared_ns/s largest_s=largest_ns/s refused_s=refused_ns/s summary tried",
    {"tried": _tried_delays},
)
BUFFERS = JsonObject(
    "soter.api.buffer_advice.Buffers",
    "module position speed units fence fastest rows",
    rows=JsonObject("soter.api.buffer_advice.BufferRow", "speed taken_at room used"),
)
