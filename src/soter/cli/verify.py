"""`soter verify FILE`: proves P1c, P2a, P2b, P3, `ttf` and `safer` of every module.

Purpose: prints verdicts and their assumptions, also as JSON; writes a certificate and a report.
Non-goals: the proofs (`verify/`), checking certificates (`soter recheck`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api import load
from soter.cli.terminal.ci_findings import CiFinding, Kind
from soter.cli.terminal.command_line import TIMES, Pairs
from soter.cli.terminal.command_outcome import CommandOutcome, exit_of_kinds
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.program_loading import loaded_program, warn_of_extern_files
from soter.cli.terminal.proof_hints import (
    SEARCHES,
    print_search,
    require_writable,
    seconds_text,
    write_hints,
)
from soter.cli.terminal.shared_options import (
    CERTIFICATE_FOLDER,
    FORMAT,
    MODULE,
    SET,
    file_option,
    report_option,
    report_path,
)
from soter.cli.terminal.stored_outcome import (
    Printout,
    StoredOutcome,
    remember_verdicts,
    store_outcome,
    stored_outcome,
)
from soter.diagnostics.command_records import SWITCH, JsonObject, one_of, option
from soter.diagnostics.command_records import seconds as time_in_seconds
from soter.diagnostics.diagnostic import mistake
from soter.language.model.assumption_words import numbered_assumptions

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from soter.verify.claims.results import Finding, LeavingRun, ModuleResult, VerifyReport
    from soter.verify.scope import ComposedAssumption

EXAMPLES = f"""\
  soter verify cart.soter
  soter verify drone.soter --module SafeMotionPrimitive
  soter verify drone.soter --set MASS=1.2          with another value of a parameter
  soter verify rover.soter --write                 without hints: finds them, and writes them down
  soter verify cart.soter --cert proof/            then: soter recheck proof/
  soter verify cart.soter --report proof.html      a page to file
  soter verify cart.soter --synthesize             for modules with `sc synthesized period d;`
  soter verify cart.soter --format sarif > cart.sarif     for CI: sarif, junit, github
  soter verify cart.soter --json | jq '.modules[].verdict'

{CERTIFICATE_FOLDER}
exit codes: 0 proved (under the assumptions that are printed), 3 refuted, 4 undecided (also where
            only a declared fail-safe law is), 1 diagnostics, 2 usage
"""
TONES: Any = {"proved": "good", "assumed": "plain", "refuted": "bad", "undecided": "strong"}
HOLDING = ("proved", "assumed")
PAINTS = {"proved": "green", "assumed": "green", "refuted": "red", "undecided": "yellow"}
REGIONS_SHOWN, LONG = 3, 40
"""How many regions are shown; from how many characters on a sentence is not repeated in a table."""
TOLD_AGAIN = "soter: nothing has changed since this was proved: told from the cache"
ENDING = "-proof.html"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Prove P1c, P2a, P2b, P3, ttf, safer and the law of `failsafe`."""

    file: str = file_option()
    module: str | None = option(*MODULE)
    system: str | None = option("--system S", None, "the system its plants stand in")
    params: Pairs = option(*SET)
    cert: str | None = option("--cert DIR", None, "write a certificate for `soter recheck`")
    report: str | None = report_option("a report", ENDING)
    synthesize: bool = option(
        "--synthesize",
        False,
        "first find the controllers that are `sc synthesized`, and write them",
        SWITCH,
    )
    output: str | None = option("-o FILE", None, "what --synthesize writes (FILE_sc.soter)")
    no_refute: bool = option(
        "--no-refute", False, "do not look for a counterexample to what cannot be proved", SWITCH
    )
    budget: float = option(
        "--budget T",
        120.0,
        f"of the processor, to find a grid or `rest` where the program says none{TIMES}",
        time_in_seconds("from 0 to", 1_000_000),
    )
    write: bool = option("--write", False, "put what was found into the program", SWITCH)
    format: str | None = option(*FORMAT)
    NEEDS = (("synthesize", "output"),)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Proves the modules and prints the verdicts, or prints verdicts stored in the cache."""
    console.listen_to_signals()
    words = _cache_key(args, console)
    if (stored := _tell_stored(args, words, console)) is not None:
        return stored
    if args.report is not None:
        args.report = str(report_path(args.report, args.file, ENDING))
    if args.write and not args.synthesize:
        require_writable(Path(args.file))
    report, written = _prove(args, console)
    _save_refuting_runs(report)
    printed, fields = _printed_report(report), DOCUMENT.of(report)
    printed.print_to(console)
    _print_written_files(report, args, console)
    paths = [str(p) for p in written]
    if args.write and (path := write_hints(report, console)) is not None:
        paths += [path] if path not in paths else []
    exit_ = exit_of_kinds(KINDS[f.verdict] for m in report.modules for f in m.findings.values())
    if words and report.verdict in HOLDING:
        outcome = StoredOutcome(exit_, fields, printed, warned=bool(console.of_program))
        store_outcome(args.file, words, report.contents, outcome)
    if not (args.params or args.bindings or report.searches):
        remember_verdicts(report)
    if written:
        console.say("\nwritten " + " ".join(str(p) for p in written))
    if paths:
        fields["written"] = paths
    fields.update({k: getattr(args, k) for k in ("cert", "report") if getattr(args, k)})
    return CommandOutcome(exit_, (), fields, tuple(_ci_findings(report)) if args.format else ())


def _prove(args: argparse.Namespace, console: Console) -> tuple[VerifyReport, tuple[Path, ...]]:
    """Proves the modules; gives the verdicts, and the files of controllers synthesized before."""
    program = warn_of_extern_files(loaded_program(args, console), console)
    choices: Any = {"module": args.module, "system": args.system, "params": dict(args.params)}
    written: tuple[Path, ...] = ()
    with ProgressBar(console, timed=False) as progress:
        if args.synthesize:
            written = program.synthesize(args.output, **choices)
            if not written:
                raise mistake("U001", "`--synthesize` does nothing: no `sc synthesized` is open")
            program = load(written[0])
        report = program.verify(
            **choices,
            cert=args.cert,
            refute=not args.no_refute,
            explain=True,
            report=args.report,
            progress=progress,
            budget_s=args.budget,
        )
    return report, written


def _cache_key(args: argparse.Namespace, console: Console) -> tuple[str, ...]:
    """The options on which the outcome depends; () if the outcome must not be stored or reused."""
    if not console.own_process or args.synthesize or args.bindings or args.write:
        return ()
    asked = (args.module, args.system, args.params, args.no_refute, args.budget)
    return ("verify", *map(repr, asked))


def _tell_stored(
    args: argparse.Namespace, words: tuple[str, ...], console: Console
) -> CommandOutcome | None:
    """Prints and gives the outcome stored for exactly these options; None if none is stored."""
    files = (args.cert, args.report, args.format)
    stored = stored_outcome(args.file, words) if words and not any(files) else None
    if stored is None:
        return None
    if stored.warned and loaded_program(args, console).sha256 != stored.fields["program_sha256"]:
        return None
    console.note(TOLD_AGAIN)
    stored.printed.print_to(console)
    return CommandOutcome(stored.exit, (), stored.fields)


KINDS: dict[str, Kind] = {
    "proved": "pass",
    "assumed": "pass",
    "refuted": "fail",
    "undecided": "open",
}


def _ci_findings(report: VerifyReport) -> Iterator[CiFinding]:
    """Yields a finding for every verdict, at the declaration of its module."""
    for module in report.modules:
        symbol = module.problem.module.symbol
        span = report.places.get(symbol.name, symbol.span)
        for name, f in module.findings.items():
            hint = (f"help: {f.hint}",) if f.hint else ()
            yield CiFinding(
                KINDS[f.verdict],
                name,
                f"{module.name}: {name}",
                f"{module.name}: {name} {f.verdict}: {f.text}".removesuffix(": "),
                span,
                (*(f"where: {r}" for r in f.regions[:REGIONS_SHOWN]), *hint),
                f.seconds,
            )


# ---------------------------------------------------------------- for people


def _printed_report(report: VerifyReport) -> Printout:
    printed, hash_ = Printout(), report.program_sha256[:12]
    numbers = numbered_assumptions(a.text for m in report.modules for a in m.assumptions)
    printed.say(printed.paint("muted", f"{report.path}  {report.system}  {hash_}"))
    for search in report.searches:
        print_search(search, report.command, printed)
    for module in report.modules:
        printed.say(f"\n{_module_headline(module, printed)}\n")
        _print_table(module, printed)
        printed.say("\n".join((*_detail_lines(module, printed), "", "under these assumptions")))
        for text in (a.text for a in module.assumptions):
            printed.say(printed.paint("muted", f"  {numbers[text]:<3} {text}"))
    if not report.modules:
        printed.say("there is no module to be verified")
    for line in _coverage_lines(report):
        printed.say(line)
    if report.composed:
        _print_joint_verdict(report, printed)
    return printed


def _print_written_files(report: VerifyReport, args: argparse.Namespace, console: Console) -> None:
    """Prints the paths of the written files, and notes on claims the certificate leaves out."""
    for kind in ("cert", "report"):
        if getattr(args, kind):
            console.say(f"\n{kind:<7} {getattr(args, kind)}")
        if kind == "cert" and args.cert:
            for line in _certificate_lines(report):
                console.say(f"        {console.paint('yellow', line)}")
    saved = [f.saved for m in report.modules for f in m.findings.values()]
    for path in dict.fromkeys(filter(None, saved)):
        console.say(f"\nrun     {path}")


def _coverage_lines(report: VerifyReport) -> list[str]:
    """Lines on the cases that the verdicts cover (parameters, equal systems), and on all others."""
    coverage, lines = report.coverage, []
    if coverage.params:
        values = ", ".join(f"{name} = {value}" for name, value in coverage.params)
        lines += ["", f"with these values of its parameters, and no other: {values}"]
    if coverage.also:
        lines += [
            "",
            "the same problem, and so the same verdict",
            *(f"  {t}" for t in coverage.also),
        ]
    if coverage.rest:
        lines += ["", "not covered", *(f"  {t}" for t in coverage.rest)]
    return lines


def _print_joint_verdict(report: VerifyReport, printed: Printout) -> None:
    """Prints the verdict on all modules together, and who guarantees what each module assumes."""
    from soter.report.tables import Styled  # noqa: PLC0415 - needs NumPy
    from soter.verify.scope import composed_assumptions_of  # noqa: PLC0415 - what is stored needs none

    verdict = printed.paint(PAINTS[report.together], report.together.upper())
    taken = composed_assumptions_of(report)
    rows = [(t.module, t.what, Styled(t.why, "strong" if t.open else "plain")) for t in taken]
    says = [f"  {text}   (`safe` of {name})" for name, text in report.safe_text_by_module.items()]
    lawful = all(m.findings["failsafe"].verdict == "proved" for m in report.modules)
    how_long = "at all times" if lawful else "for as long as the trusted part runs"
    says = ["", f"in every run that keeps what is assumed, {how_long}", *says]
    says = says if report.together in HOLDING else []
    head = f"all of them together (Theorem 4.1)  {verdict}{_open_clauses_text(report, taken)}"
    printed.say("\n".join(("", head, *says, "")))
    printed.add_table(("module", "takes for granted", "because"), rows)


def _open_clauses_text(report: VerifyReport, taken: list[ComposedAssumption]) -> str:
    """Words on what the verdict on all modules together leaves open; "" if nothing."""
    assumed = sum(t.open and not t.promised for t in taken)
    promised = sum(t.open and t.promised for t in taken)
    clauses = []
    if assumed:
        clauses.append(f"{assumed} of these {'is' if assumed == 1 else 'are'} assumed")
    if promised:
        clauses.append(f"{promised} {'is' if promised == 1 else 'are'} not proved here")
    timed = [m.name for m in report.modules if m.findings["P1c"].verdict == "assumed"]
    timed = list(dict.fromkeys(name.split(" as ")[0] for name in timed))
    if timed:
        clauses.append(f"P1c is assumed of {', '.join(timed)}")
    return f", where {' and '.join(clauses)}" if clauses else ""


def _certificate_lines(report: VerifyReport) -> list[str]:
    """Lines on modules for which the certificate claims less than a full proof."""
    from soter.verify.claims.results import UNCLAIMED  # noqa: PLC0415 - what is stored needs none

    lines = []
    for module in report.modules:
        claimed = [
            n for n, f in module.findings.items() if f.verdict == "proved" and n not in UNCLAIMED
        ]
        open_ = [n for n, f in module.findings.items() if not f.holds and n not in UNCLAIMED]
        if open_ == ["P2b"]:
            lines.append(f"{module.name}: claims safety, without P2b: AC may not get control back")
        elif open_ == ["failsafe"]:
            lines.append(
                f"{module.name}: claims safety while the trusted part runs, not of the law"
            )
        elif open_:
            claims = " ".join(claimed) or "nothing"
            lines.append(f"{module.name}: claims only {claims}: not a proof of safety")
    return lines


def _save_refuting_runs(report: VerifyReport) -> None:
    """Writes the runs that refute a module into `.soter/`."""
    if report.verdict == "refuted":
        from soter.verify.counterexample import save_counterexamples  # noqa: PLC0415 - only then

        save_counterexamples(report)


def _module_headline(module: ModuleResult, printed: Printout) -> str:
    held = module.verdict in ("proved", "assumed")
    verdict = printed.paint(PAINTS[module.verdict], module.verdict.upper())
    verdict += module.verdict_note if held else ""
    if held and module.vacuity is not None:  # proved of next to no states
        little = printed.paint("yellow", module.verdict.upper())
        verdict = f"{little}{module.verdict_note}, but {module.vacuity.text},"
    under = f" under {(count := len(module.assumptions))} assumption{'' if count == 1 else 's'}"
    if module.assumed:
        under += f" ({', '.join(module.assumed)} assumed)"
    if module.verdict not in ("proved", "assumed"):
        worst = [n for n, f in module.findings.items() if f.verdict == module.verdict]
        under = f": {', '.join(worst)}"
        if worst == ["P2b"] and all(f.holds for n, f in module.findings.items() if n != "P2b"):
            under += " alone: safe as proved, but nothing says that SC gives control back"
        if worst == ["failsafe"]:
            under += " alone: safe as proved while the trusted part runs; its law is not shown"
    if module.not_rechecked:
        under += f", {printed.paint('yellow', 'not re-checked')}: {module.not_rechecked}"
    return f"{printed.paint('bold', module.name)}  {verdict}{under}  {seconds_text(module.seconds)}"


def _print_table(module: ModuleResult, printed: Printout) -> None:
    from soter.report.tables import Styled  # noqa: PLC0415 - needs NumPy

    rows, first_with = [], dict[str, str]()
    for name, f in module.findings.items():
        again = len(f.text) >= LONG and first_with.setdefault(f.text, name) != name
        text = f"for the same reason as `{first_with[f.text]}`" if again else f.text
        rows.append((name, Styled(f.verdict, TONES[f.verdict]), seconds_text(f.seconds), text))
    printed.add_table(("property", "verdict", "time", "how"), rows)


def _detail_lines(module: ModuleResult, printed: Printout) -> list[str]:
    """Lines with shares of the grid and notes, and where and why a property is not proved."""
    from soter.verify.claims.results import NO_CORE  # noqa: PLC0415 - what is stored needs none

    names = {"core": "K", "free": "R(H)", "lets_ac": "not ttf", "gives_back": "safer"}
    shares = [f"{n} {module.shares[k]:.1%}" for k, n in names.items() if k in module.shares]
    size = f", {module.cells:,} cells" if module.cells else ""
    lines = ["", f"{' · '.join(shares)} of the grid's volume{size}"] if shares or size else []
    if "estimates" in module.shares:
        share = f"S_0 {module.shares['estimates']:.1%} of the estimates, which leave AC in control"
        lines.append(f"{share}; not ttf: the states that one of these may be of")
    lines += [module.at_the_start] if module.at_the_start else []
    lines += ["", *module.notes] if module.notes else []
    texts: list[str] = []
    for name in ("P2a", "ttf", "safer", *module.findings):
        finding = module.findings[name]
        if not finding.holds and finding.text not in (NO_CORE, *texts):
            texts.append(finding.text)  # P3 fails like one of `ttf` and `safer`
            lines += _failure_lines(name, finding, printed)
    return lines


def _failure_lines(name: str, finding: Finding, printed: Printout) -> list[str]:
    lines = ["", f"{printed.paint(PAINTS[finding.verdict], name)}  {finding.text}"]
    lines += [f"  where  {region}" for region in finding.regions[:REGIONS_SHOWN]]
    rest = len(finding.regions) - REGIONS_SHOWN
    lines += [f"         and {rest} more"] if rest > 0 else []
    lines += [f"  why    {c.text}" for c in finding.causes]
    lines += [f"  tried  {text}" for text in finding.tried]
    lines += [f"  leaves {finding.leaving}"] if finding.leaving is not None else []
    lines += [f"  help   {finding.hint}"] if finding.hint else []
    lines += [f"  costs  {finding.cost}"] if finding.cost is not None else []
    if finding.counterexample is not None:
        lines += [f"  run    {line}" for line in str(finding.counterexample).splitlines()]
    return lines


# --- as JSON; a list of words has `field` or `field=path.in.record` each, ? and * as in JsonObject


def _param_values(report: VerifyReport) -> dict[str, object]:
    return dict(report.coverage.params)


def _modules_by_name(report: VerifyReport) -> dict[str, ModuleResult]:
    return {m.name: m for m in report.modules}


def _horizon_s(module: ModuleResult) -> float | None:
    return module.problem.times.horizon_ns / 1e9 if module.problem.kind != "nodes" else None


def _needed_horizon_s(module: ModuleResult) -> float | None:
    return module.problem.times.h_star / 1e9 if module.problem.kind != "nodes" else None


def _refuting_lines(finding: Finding) -> list[str]:
    return [] if finding.counterexample is None else str(finding.counterexample).splitlines()


def _run_times(run: LeavingRun) -> list[float]:
    return list(run.time_s.tolist())


def _run_states(run: LeavingRun) -> dict[str, list[float]]:
    """By name of a state: the values of that state along the run."""
    return {name: run.states[:, i].tolist() for i, name in enumerate(run.names)}


RESULTS = "soter.verify.claims.results"
VERDICT = one_of(*KINDS)
FLOWN = JsonObject(f"{RESULTS}.FlownFigures", "takeovers_per_min ac_share table_bytes")
COST = JsonObject(
    f"{RESULTS}.RemedyCost", "system until_s before after not_measured", before=FLOWN, after=FLOWN
)
FINDING = JsonObject(
    f"{RESULTS}.Finding",
    "verdict seconds method text hint counts where=regions counterexample=saved run causes tried "
    "cost leaving",
    {"run": _refuting_lines},
    verdict=VERDICT,
    where=JsonObject(f"{RESULTS}.Region", "states=ranges parameters*"),
    causes=JsonObject(f"{RESULTS}.Cause", "kind text hint numbers*"),
    cost=COST,
    leaving=JsonObject(
        f"{RESULTS}.LeavingRun",
        "text axis side safe chosen time_s states",
        {"text": str, "time_s": _run_times, "states": _run_states},
        side=one_of(-1, 1),
    ),
)
VERIFIED = JsonObject(
    f"{RESULTS}.ModuleResult",
    "verdict seconds properties=findings cells core_share shares headline vacuous=vacuity "
    "not_rechecked at_the_start notes levels=problem.levels levels_why levels_cost horizon_s "
    "horizon_needed_s recover_s assumptions=assumptions.text assumption_keys=assumptions.key",
    {"horizon_s": _horizon_s, "horizon_needed_s": _needed_horizon_s},
    verdict=VERDICT,
    properties=FINDING,
    levels_cost=COST,
    vacuous=JsonObject(
        f"{RESULTS}.Vacuity",
        "how_often what share text parameters*",
        how_often=one_of("never", "hardly ever", "not shown"),
        what=one_of("ttf", "safer", "core", "safe"),
    ),
)
DOCUMENT = JsonObject(
    f"{RESULTS}.VerifyReport",
    "file=path program_sha256 system verdict together seconds modules params also=coverage.also "
    "not_covered=coverage.rest guarantees=coverage.guarantees searches",
    {"modules": _modules_by_name, "params": _param_values},
    beside={"cert?": str, "report?": str, "written?": list[str]},
    verdict=VERDICT,
    together=VERDICT,
    modules=VERIFIED,
    searches=SEARCHES,
    guarantees=JsonObject(
        "soter.verify.problem.problem.ScopeGuarantee",
        "module what by how",
        how=one_of("enforced", "declared", "guaranteed", "published", "assumed"),
    ),
)
