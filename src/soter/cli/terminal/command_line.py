"""What every command line is made of: options in; exit code, findings and JSON document out.

Purpose: seven subjects, in the order of the file.
1. `CiFinding`: a verdict or a diagnostic with its place, before a format of continuous integration.
2. `CommandOutcome`: how a command ends; docs/json.md describes its exit codes and documents.
3. `UsageError`, and the rules that give an exit code to findings and diagnostics.
4. Texts and options that several commands share (`SYSTEM`, `SETTINGS`, ...).
5. `CommandParser`, an `ArgumentParser` made from a record of options, which raises instead of
   ending the process. `Option.flags` (`diagnostics/command_records.py`) describes each argument.
6. Fields for such a record (`file_option`, `report_option`), and what reads a value's text.
7. `loaded` loads the command's program with a line that shows progress and binds externs as
   `--bind` says; `standard_input` reads the text for `-`.
Non-goals: what the options mean; `--set`, whose values each command hands on; writing documents
(`console.py`) and formats (`ci_formats.py`).
"""

from __future__ import annotations

import argparse
import re
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from inspect import cleandoc
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn, Protocol, TypeAlias

from soter.cli.terminal.console import Console, LineOfProgress
from soter.diagnostics.command_records import Option, gone, option, options_of
from soter.diagnostics.diagnostic import Diagnostic, Severity, SoterError, Span, mistake

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.api import Program


Pairs: TypeAlias = tuple[tuple[str, str], ...]
Kind = Literal["pass", "fail", "open", "warning"]
"""`fail`: shown to be wrong; `open`: nothing is shown either way, which is no success."""


@dataclass(frozen=True)
class CiFinding:
    """A finding. `rule`: a diagnostic's code, a property or a command; `name`: its subject."""

    kind: Kind
    rule: str
    name: str
    text: str
    span: Span | None = None
    """Where the finding stands in a program; None: in no file."""
    details: tuple[str, ...] = ()
    seconds: float = 0.0


def of_diagnostics(items: Iterable[Diagnostic]) -> list[CiFinding]:
    """A finding for every diagnostic: `fail` for an error, `warning` for any other."""
    return [
        CiFinding(
            "fail" if d.severity is Severity.ERROR else "warning",
            d.code,
            d.code,
            d.message,
            None if d.primary is None else d.primary.span,
            (
                *((d.primary.text,) if d.primary is not None and d.primary.text else ()),
                *d.notes,
                *(f"help: {text}" for text in d.helps),
            ),
        )
        for d in items
    ]


def place(span: Span | None) -> tuple[str, int, int, int, int] | None:
    """File, line, column, end line, end column (one past the last); None where there is no file."""
    if span is None or span.source.name.startswith("<"):
        return None  # standard input, the prelude
    source, end = span.source, span.end
    return source.name, span.line, span.column, source.line_of(end), source.column_of(end)


SCHEMA = 1
"""Version of the JSON documents; it rises when a field goes or changes its meaning."""

FINE = 0
DIAGNOSTICS = 1
USAGE = 2
VIOLATED = 3
UNDECIDED = 4
NOT_RECHECKED = 5
"""Nothing in a certificate was found to be false, but the re-checker cannot check all of it."""
INTERNAL = 70
"""A defect of soter itself (EX_SOFTWARE of sysexits.h)."""
INTERRUPTED = 130


@dataclass
class CommandOutcome:
    """The exit code, every diagnostic, and the command's own fields of the document."""

    exit: int = FINE
    diagnostics: tuple[Diagnostic, ...] = ()
    fields: dict[str, object] = field(default_factory=dict)
    found: tuple[CiFinding, ...] = ()
    """Verdicts, for `--format`; diagnostics are added to them."""
    junit: str = ""
    """The XML of `--format junit`, where the command has its own."""

    @property
    def files(self) -> list[str]:
        """The paths of the programs that the command was about."""
        several = self.fields.get("files")
        entries = several if isinstance(several, list) else [self.fields]
        return [str(e["file"]) for e in entries if isinstance(e, dict) and "file" in e]

    def document(self, command: str | None) -> dict[str, object]:
        """The JSON document of the outcome, as a dict."""
        from soter.diagnostics.render import to_json  # noqa: PLC0415 - only with --json

        return {
            "schema": SCHEMA,
            "command": command,
            "ok": self.exit == FINE,
            "exit": self.exit,
            "diagnostics": [to_json(d) for d in self.diagnostics],
            **self.fields,
        }


class UsageError(Exception):
    """A wrong command line; `usage`: the right form, if it is not that of the command's help."""

    def __init__(self, message: str, usage: str = "") -> None:
        super().__init__(message)
        self.usage = usage


def exit_of_kinds(kinds: Iterable[Kind]) -> int:
    """The exit code of findings, by the one rule of all commands that give verdicts."""
    found = set(kinds)
    return VIOLATED if "fail" in found else UNDECIDED if "open" in found else FINE


def exit_of(diagnostics: Iterable[Diagnostic]) -> int:
    """0 without errors; 2 where every error is one of the command line (U...); else 1."""
    errors = [d.code for d in diagnostics if d.severity is Severity.ERROR]
    if not errors:
        return FINE
    return USAGE if all(code.startswith("U") for code in errors) else DIAGNOSTICS


def failed(error: SoterError) -> CommandOutcome:
    """The outcome of a command that ended with this error."""
    return CommandOutcome(exit_of(error.diagnostics) or DIAGNOSTICS, error.diagnostics)


CERTIFICATE_FOLDER = """\
in the folder of a certificate: manifest.json (claims, times, assumptions), SEAL (its SHA-256),
program/ (every source and data file), sets/ (the sets of the proof, as bytes)
"""
CAMPAIGN_FOLDER = """\
in the folder of a campaign: campaign.json (what is flown), flights.csv (a row a flight),
arm-NAME/ (the same of an arm), campaign.lock (who is flying), and where asked for report.html and
flights.parquet
"""
"""Help text: which files lie in the folders that several commands read or write."""


SYSTEM = ("--system S", None, "by default the only one, or the `default`")
SET: tuple[str, tuple[()], str] = ("", (), "what --set and --bind give")
MODULE = ("--module M", None, "only this module; by default all")
"""Options that several commands share: the first arguments of `option`."""
SETTINGS = (
    (
        "--set",
        "K=V",
        "params",
        "value of a parameter, such as --set GAIN=3, --set d.PERIOD=20ms, --set r[0].GAIN=2",
    ),
    (
        "--bind",
        "X=WHAT",
        "bindings",
        "what answers extern X: python:file.py:name, c:file.c:name, onnx:a.onnx, sb3:a.zip",
    ),
)
"""What stands in the place of a field `PARAMS` of a record: flag, metavar, name in `args`, help."""
PARAMS = "params"


class HelpWantedError(Exception):
    """`--help` was given; the message is the text."""


class Command(Protocol):
    """The module of a command; `EXAMPLES`: lines for the end of its help."""

    EXAMPLES: str
    Options: type
    """The record of its options (`options_of`); its docstring is the description in the help."""

    def run(self, args: argparse.Namespace, console: Console) -> CommandOutcome:
        """Runs the command; `main.py` adds to its outcome the diagnostics of the program."""


class CommandParser(argparse.ArgumentParser):
    """The parser of one command's line, made from the command's `Options`."""

    def __init__(self, name: str, command: Command) -> None:
        super().__init__(
            prog=f"soter {name}",
            description=cleandoc(command.Options.__doc__ or ""),
            epilog=f"examples:\n{command.EXAMPLES.rstrip()}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
            add_help=False,
        )
        self.add_argument(
            "--json", action="store_true", help="print one JSON document (docs/json.md)"
        )
        self.add_argument("-h", "--help", action=_Help, nargs=0, help="show this text")
        self.record, options = command.Options, options_of(command.Options)
        for field_name, known in options.items():
            if field_name == PARAMS:
                self._add_settings()
            elif known.flags:
                self._add_argument_of(field_name, known)
        self._about = {n: o.told for n, o in options.items() if o.told and not o.dashed}

    def read(self, line: Sequence[str]) -> argparse.Namespace:
        """The arguments of a line; `written`: names of what stands there. SoterError U001: gone."""
        if problems := gone(self.record, [word.partition("=")[0] for word in line]):
            raise SoterError(problems)
        defaults = {action.dest: action.default for action in self._actions}
        dashed = {action.dest for action in self._actions if action.option_strings}
        args = self.parse_args(line, argparse.Namespace(**dict.fromkeys(defaults)))
        given_values = {n: v for n, v in vars(args).items() if v is not None}
        written = {n for n, v in given_values.items() if n in dashed or v != defaults[n]}
        return argparse.Namespace(**{**defaults, **given_values, "written": written})

    def subject(self, args: argparse.Namespace) -> dict[str, object]:
        """Fields of the document that say what the command was about, however it ends."""
        return {field_name: getattr(args, name) for name, field_name in self._about.items()}

    def _add_argument_of(self, name: str, known: Option) -> None:
        """Adds the option or the positional argument that `Option.flags` of a field describes."""
        *flags, metavar = known.flags.split()
        kind, needed = known.kind.text, known.given is ...
        how: dict[str, Any] = {
            "default": None if needed else known.given,
            "help": known.help(TIMES),
        }
        if metavar.startswith("--"):
            self.add_argument(*flags, metavar, dest=name, action="store_true", **how)
            return
        how |= {"type": kind if callable(kind) else READERS.get(kind, str)}
        how |= {"metavar": metavar.strip("[].")}
        if metavar.endswith("..."):
            how["nargs"] = "+"
        if metavar.startswith("["):
            how["nargs"] = "*" if metavar.endswith("...]") else "?"
        if metavar.startswith("{"):
            how |= {"choices": metavar.strip("{}").split(","), "metavar": None}
        if not known.dashed:
            self.add_argument(name, choices=known.kind.names or None, **how)
            return
        if kind == "several":
            default = None if known.given is None else list(known.given)
            how |= {"action": "append", "default": default}
        elif metavar.startswith("["):
            how["const"] = ""
        self.add_argument(*flags, dest=name, required=needed, **how)

    def _add_settings(self) -> None:
        for flag, metavar, name, about in SETTINGS:
            self.add_argument(
                flag,
                action="append",
                default=[],
                metavar=metavar,
                type=_pair,
                dest=name,
                help=about,
            )

    def error(self, message: str) -> NoReturn:
        """Raises UsageError with argparse's message."""
        raise UsageError(message, self.usage_line)

    @property
    def usage_line(self) -> str:
        """The form of the command's line, in one line."""
        return self.format_usage().removeprefix("usage: ").strip()


class _Help(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        raise HelpWantedError(parser.format_help().rstrip())


def file_option(flags: str = "FILE", words: str = "the program", told: str = "file") -> Any:  # noqa: ANN401 - a field
    """The positional argument that a command is about; `told`: its field in the document."""
    return option(flags, ..., words, told=told, keyword=False)


def report_option(what: str, ending: str, flags: str = "--report") -> Any:  # noqa: ANN401 - a field
    """The option --report; `what` it writes; `ending`: of the file's name without a path."""
    words = f"write {what}: one HTML page (.soter/...{ending})"
    return option(f"{flags} [PATH]", None, words, keyword=False)


def report_path(report: str, of: str, ending: str) -> Path:
    """The file that --report writes: the path given, else one in `.soter/` named after `of`."""
    stem = Path(of).resolve().name.removesuffix(".soter").removesuffix(".trace.json")
    return Path(report or Path(".soter") / f"{stem}{ending}")


FORMATS = ("sarif", "junit", "github")
FORMAT = (
    f"--format {{{','.join(FORMATS)}}}",
    None,
    "for CI, on standard output (docs/commands.md)",
)
"""The option of commands that print a format for continuous integration."""
WITH_FORMAT = ("check", "verify", "test", "monitor")


def format_of(name: str | None, options: Sequence[str]) -> str | None:
    """The format that a command line asks for; None if it asks for none, or a wrong one."""
    if name not in WITH_FORMAT:
        return None
    asked = [b for a, b in pairwise(options) if a == "--format"]
    asked += [a.removeprefix("--format=") for a in options if a.startswith("--format=")]
    return asked[-1] if asked and asked[-1] in FORMATS else None


def given(args: argparse.Namespace, record: type) -> dict[str, Any]:
    """The arguments that are keywords of `record`, as a dict for the method in Python."""
    options = options_of(record, keyword=True)
    values = {name: getattr(args, name) for name in options if name in args}
    return values | ({PARAMS: dict(args.params)} if PARAMS in options else {})


def _pair(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign or not name.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"`{text}`: write NAME=VALUE")
    return name.strip(), value.strip()


def whole(text: str) -> int:
    """A whole number in plain digits; ArgumentTypeError for any other text.

    `int` alone would read `1_000` and digits of any script, too.
    """
    if not re.fullmatch("[+-]?[0-9]{1,20}", text):
        raise argparse.ArgumentTypeError(f"`{text}` is no whole number")
    return int(text)


def at_least_one(text: str) -> int:
    """A whole number that is not 0; ArgumentTypeError for any other text."""
    if whole(text) == 0:
        raise argparse.ArgumentTypeError("it has to be 1 at least: leave it out for no such bound")
    return whole(text)


def seconds(text: str) -> float:
    """Seconds: a number in plain digits, or one with its unit; ArgumentTypeError for other text."""
    from soter.language.model.types import WrongTextError, duration_ns  # noqa: PLC0415 - only then

    if text.isascii() and "_" not in text:
        with suppress(ValueError):
            return float(text)
        with suppress(WrongTextError):
            return duration_ns(text) / 10**9
    raise argparse.ArgumentTypeError(
        f"`{text}` is no time: write seconds, or a number with its unit, such as 10min"
    )


def seed(text: str) -> int:
    """A seed: a whole number of 64 bits without sign; ArgumentTypeError for any other text."""
    if not (text.isascii() and text.isdigit()) or len(text) > 20 or int(text) >= 2**64:
        raise argparse.ArgumentTypeError(f"`{text}`: a seed is 0 to 2^64 - 1")
    return int(text)


TIMES = ", such as 90 (seconds) or 10min"
"""Help text: how a time is written."""
READERS = {"whole": whole, "seed": seed, "bound": at_least_one, "seconds": seconds}
"""`Kind.text` -> the function that reads the text of such a value."""


def opened(args: argparse.Namespace, console: Console) -> Program:
    """Loads `args.file`; if it is correct, its warnings are told with the outcome."""
    from soter.api import load  # noqa: PLC0415 - commands about the tool itself open none

    with LineOfProgress(console) as line:
        program = load(args.file, line)
    console.of_program = program.diagnostics if program.ok else ()
    return program


def bound(program: Program, args: argparse.Namespace) -> Program:
    """Binds externs as `args.bindings` says; `SoterError` if one cannot be. Returns `program`."""
    for name, target in args.bindings:
        program.bind(name, target)
    return program


def warned_of_files(program: Program, console: Console) -> Program:
    """Tells at once what is wrong with files of externs (W007, W037). Returns `program`.

    It is for commands that do not call externs: a proof, or a package that leaves them out.
    """
    warnings = program.check().warnings if program.externs else ()
    missing = tuple(w for w in warnings if w.code in ("W007", "W037"))
    if console.json:
        console.of_program += missing
    console.write_diagnostics(missing)
    return program


def loaded(args: argparse.Namespace, console: Console) -> Program:
    """Loads the program that the arguments name, and binds its externs; `SoterError`."""
    return bound(opened(args, console), args)


STDIN = "<stdin>"
"""The path of a program from standard input; its imports are read from the current folder."""


def standard_input() -> str:
    """All of standard input; SoterError D005 if it is over MAX_FILE_BYTES or not UTF-8."""
    from soter.language.load.loader import MAX_FILE_BYTES  # noqa: PLC0415 - for `-`

    stream = sys.stdin
    if stream is None:
        return ""
    data = getattr(stream, "buffer", stream).read(MAX_FILE_BYTES + 1)
    if len(data) > MAX_FILE_BYTES:
        why = f"it is larger than {MAX_FILE_BYTES >> 20} MiB"
        raise mistake("D005", f"cannot read standard input: {why}")
    try:
        return data if isinstance(data, str) else data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        why = f"standard input is not UTF-8: byte {error.start} is wrong"
        raise mistake("D005", why) from error
