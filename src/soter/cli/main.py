"""`soter`: chooses the command, runs it, and ends with the right exit code whatever happens.

Purpose: holds the command table and the top-level help, and turns every way to end into an exit
code and, with `--json`, exactly one document. After a defect of soter itself `apologise` shows a
short apology instead of a traceback, and writes a file for whoever repairs it.
Non-goals: the commands (one file each). Nothing heavy is imported here: `soter check` is as fast as
the checker.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, cast

from soter import __version__
from soter.addons import load_module
from soter.cli.terminal.command_line import Command, CommandParser, HelpWantedError, UsageError
from soter.cli.terminal.command_outcome import (
    DIAGNOSTICS,
    FINE,
    INTERNAL,
    INTERRUPTED,
    USAGE,
    CommandOutcome,
    failure,
)
from soter.cli.terminal.console import ChildResult, Console
from soter.cli.terminal.shared_options import format_of
from soter.diagnostics.command_records import unused_options
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import closest
from soter.diagnostics.system_texts import reason, utf8_text

if TYPE_CHECKING:
    from collections.abc import Sequence


COMMANDS = {
    "check": "parse, types, well-formedness, composition, timing",
    "show": "draw a system: nodes, topics, modules, plants",
    "run": "run a system in virtual time",
    "verify": "prove P2a, P2b, P3 per module",
    "recheck": "check certificates independently",
    "monitor": "does the verified model explain a recorded run",
    "identify": "fit parameters to logs, and say how far that goes",
    "advise": "what the decision period and the levels cost",
    "campaign": "many seeded runs, and what they say",
    "test": "explore every schedule, find the shortest counterexample",
    "assure": "a safety case whose leaves are checked as it is made",
    "replay": "run a trace again, step by step",
    "policy": "what the file of a learned policy says",
    "diff": "what a change of a program leaves standing",
    "measure": "time the steps on this machine",
    "build": "write C99, or a package for a target",
    "explain": "what a diagnostic code means, and what to do",
    "fmt": "lay out source files",
    "lsp": "serve an editor: the language server",
    "new": "make a small robot that runs",
    "completion": "what a shell completes: bash, zsh, fish",
    "cache": "what compiled programs take on the disk",
    "help": "this text, or that of a command",
}
TOOL = frozenset({"explain", "fmt", "completion", "cache", "show"})
"""Commands whose files stand in `cli/tool/`: about the tool itself, texts and pictures."""


BLAS_SPINS = ("OPENBLAS_THREAD_TIMEOUT", "20")
"""NumPy's threads, one a core, wait busily for 2^26 cycles for work; this setting makes it 2^20."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command line and returns its exit code."""
    os.environ.setdefault(*BLAS_SPINS)
    arguments = list(sys.argv[1:] if argv is None else argv)
    options = arguments[: arguments.index("--")] if "--" in arguments else arguments
    name = next((a for a in options if not a.startswith("-")), None)
    wanted = format_of(name, options)
    quiet = "--json" in options or wanted in ("sarif", "junit")
    with Console(json=quiet, own_process=argv is None) as console:
        console.words = arguments
        try:
            code = _run_and_print(name, arguments, console, wanted)
            console.hand_over_output(code)
        except ChildResult as done:
            console.write(done.text)
            code = done.exit
        console.flush()
        return _exit_code_after_output(code, console)


def _run_and_print(
    name: str | None, arguments: list[str], console: Console, format_: str | None = None
) -> int:
    """Runs the command, prints its outcome in the wanted format, and returns its exit code."""
    if "--json" in arguments:
        format_ = None  # `_run_command` refuses both, and `--json` decides how that is told
    outcome = _outcome_of_line(name, arguments, console)
    console.write_diagnostics(outcome.diagnostics)
    if format_ is not None and name is not None and "help" not in outcome.fields:
        from soter.cli.terminal.ci_formats import formatted_outcome  # noqa: PLC0415 - only then

        if text := formatted_outcome(format_, name, outcome):
            console.write_document(text)
    elif console.json:
        import json  # noqa: PLC0415 - only with --json

        document = outcome.json_document(name if name in COMMANDS else None)
        console.write_document(json.dumps(document, indent=2, allow_nan=False))
    return outcome.exit


def _outcome_of_line(name: str | None, arguments: list[str], console: Console) -> CommandOutcome:
    """The outcome of a command line; every exception except `ChildResult` becomes an outcome."""
    try:
        _require_utf8(arguments)
        _require_no_linked_folder()
        return _run_command(name, arguments, console)
    except ChildResult:
        raise
    except HelpWantedError as wanted:
        console.say(str(wanted))
        return CommandOutcome(fields={"help": str(wanted)})
    except UsageError as error:
        problem = Diagnostic("U003", str(error), helps=(f"usage: {error.usage}",))
        return CommandOutcome(USAGE, (problem,))
    except SoterError as error:
        return failure(error)
    except KeyboardInterrupt as stopped:
        for line in ("interrupted", *getattr(stopped, "__notes__", ())):
            console.note(line)
        return CommandOutcome(INTERRUPTED)
    except OSError as error:
        return CommandOutcome(DIAGNOSTICS, (_os_diagnostic(error),))
    except Exception as error:  # noqa: BLE001 - a defect: apologise, keep the details
        return CommandOutcome(INTERNAL, (apologise(error, arguments),))


def _require_utf8(arguments: Sequence[str]) -> None:
    """Raises UsageError for an argument that is not UTF-8, as no output could print it."""
    for word in arguments:
        if (shown := utf8_text(word)) != word:
            text = f"`{shown}` is not UTF-8, which everything that soter writes is: rename it"
            raise UsageError(text, "soter COMMAND ...; soter --help")


def _require_no_linked_folder() -> None:
    """Raises OSError if `.soter`, where commands write, is a link, perhaps made by a stranger."""
    if os.path.lexists(".soter"):
        from soter.report.atomic_write import path_without_links, require_no_links  # noqa: PLC0415 - then only

        require_no_links(path_without_links(Path(), ".soter"))


def _run_command(name: str | None, arguments: list[str], console: Console) -> CommandOutcome:
    if name is None:
        return _outcome_without_command(arguments, console)
    rest = list(arguments)
    rest.remove(name)
    if name == "help":
        return _help_outcome(rest, console)
    if "--json" in rest and format_of(name, rest) is not None:
        raise UsageError("`--format` or `--json`, not both", f"soter {name} ... --format FORMAT")
    if name in COMMANDS:
        return _outcome_of_command(name, rest, console)
    raise _unknown_command(name)


def _outcome_of_command(name: str, rest: list[str], console: Console) -> CommandOutcome:
    """Runs a known command, and adds its program's diagnostics and its subject to the outcome."""
    parser = command_parser(name)
    args = parser.read_line(rest)
    if problems := unused_options(parser.record, vars(args), args.written, flags=True):
        return CommandOutcome(USAGE, problems, parser.subject_fields(args))
    try:
        outcome = command_module(name).run(args, console)
    except UsageError as error:
        error.usage = error.usage or parser.usage_line
        raise
    except SoterError as error:
        outcome = failure(error)
    outcome.diagnostics = (*console.of_program, *outcome.diagnostics)
    outcome.fields = parser.subject_fields(args) | outcome.fields
    return outcome


def command_module(name: str) -> Command:
    """The module that implements a command; `help` has no module."""
    room = "soter.cli.tool" if name in TOOL else "soter.cli"
    return cast("Command", load_module(f"{room}.{name}"))


def command_parser(name: str) -> CommandParser:
    """The parser of a command's line; `help` has no parser."""
    return CommandParser(name, command_module(name))


def _help_outcome(rest: list[str], console: Console) -> CommandOutcome:
    """Prints for `soter help [COMMAND]` the text of `--help`; UsageError for other arguments."""
    asked = [a for a in rest if a not in ("--json", "-h", "--help")]
    wrong = next((a for a in asked if a.startswith("-")), "") or "".join(asked[1:2])
    if wrong:
        raise UsageError(f"`{wrong}` is too much", "soter help [COMMAND]")
    if not asked or asked[0] == "help":
        raise HelpWantedError(_help_text(console))
    if asked[0] not in COMMANDS:
        raise _unknown_command(asked[0])
    raise HelpWantedError(command_parser(asked[0]).format_help().rstrip())


def _unknown_command(name: str) -> UsageError:
    near = closest(name, list(COMMANDS))
    hint = f"; did you mean `{near[0]}`?" if near else ""
    return UsageError(f"there is no command `{name}`{hint}", "soter COMMAND ...; soter --help")


def _outcome_without_command(arguments: list[str], console: Console) -> CommandOutcome:
    if {"-V", "--version"} & set(arguments):
        console.say(f"soter {__version__}")
        return CommandOutcome(fields={"version": __version__})
    if {"-h", "--help"} & set(arguments):
        raise HelpWantedError(_help_text(console))
    if unknown := [a for a in arguments if a != "--json"]:
        raise UsageError(f"there is no option `{unknown[0]}`", "soter COMMAND ...; soter --help")
    if not console.json:
        console.note(_help_text(console))
        return CommandOutcome(USAGE)
    raise UsageError("which command?", "soter COMMAND ...; soter --help")


def _help_text(console: Console) -> str:
    def row(name: str, about: str) -> str:
        return f"  {console.paint('bold', name)}{' ' * (12 - len(name))}{about}"

    return "\n".join(
        [
            f"soter {__version__}: run-time assurance for robots",
            "",
            "usage: soter COMMAND [options]",
            "",
            *(row(name, about) for name, about in COMMANDS.items()),
            "",
            "soter COMMAND --help      options and examples; `soter help COMMAND` is the same",
            "soter -V                  the version",
            "soter explain CODE        what a diagnostic means",
            "",
            "exit codes: 0 fine, 1 diagnostics, 2 usage, 3 violated or refuted, 4 undecided,",
            "            70 a defect of soter, 130 interrupted. Warnings exit 0.",
            "--json prints one document on standard output on every exit.",
        ]
    )


def _exit_code_after_output(exit_code: int, console: Console) -> int:
    """The exit code; 1 if it was 0 but standard output could not take the whole result."""
    error = console.output_error
    if error is None or isinstance(error, BrokenPipeError):
        return exit_code
    console.note(f"soter: cannot write to standard output: {reason(error)}")
    return exit_code if exit_code != FINE else DIAGNOSTICS


def _os_diagnostic(error: OSError) -> Diagnostic:
    where = f" `{error.filename}`" if error.filename else ""
    return Diagnostic("D006", f"the system refused{where}: {reason(error)}")


def apologise(error: Exception, arguments: list[str]) -> Diagnostic:
    """Reports a defect of soter as I001, and writes the details to `.soter/crash-....txt`."""
    import platform  # noqa: PLC0415 - only for a defect
    import traceback  # noqa: PLC0415 - the same

    details = [
        f"soter {__version__}, Python {sys.version.split()[0]}, {platform.platform()}",
        f"arguments: {arguments!r}",
        "",
        "".join(traceback.format_exception(error)),
    ]
    kind, folder = type(error).__name__, Path(".soter")
    path = folder / f"crash-{time.strftime('%Y%m%d-%H%M%S')}.txt"
    try:
        folder.mkdir(exist_ok=True)
        path.write_text("\n".join(details), encoding="utf-8", errors="replace")
        where = f"the details are in `{path}`: please send it with the program"
    except OSError:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{kind} in {Path(last.filename).name}, line {last.lineno}: {error}"
    return Diagnostic(
        "I001",
        f"soter has a defect, sorry ({kind})",
        notes=(where,),
        helps=("the mistake is ours, not the program's",),
    )


if __name__ == "__main__":
    sys.exit(main())
