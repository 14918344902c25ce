"""A command line: options in; exit code, findings and JSON document out.

Purpose: `CommandParser`, an `ArgumentParser` that raises instead of leaving, and the options many
commands share. `CommandOutcome`: how a command ends: the contract of DESIGN §5 in one place;
docs/json.md documents the documents. `CiFinding`: a verdict or a diagnostic with its place, before
it is written in a format of somebody else.
Non-goals: what the options mean; writing documents (`console.py`) and formats
(`cli/ci/sarif_junit_github.py`).
"""

from __future__ import annotations

import argparse
import re
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from soter.diagnostics.command_records import options_of
from soter.diagnostics.diagnostic import Severity

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.diagnostics.source import Span


Kind = Literal["pass", "fail", "open", "warning"]
"""`fail`: wrong, as is shown; `open`: nothing is shown either way, which is no success either."""


@dataclass(frozen=True)
class CiFinding:
    """One finding. `rule`: a code that `soter explain` knows; `name`: what it is about."""

    kind: Kind
    rule: str
    name: str
    text: str
    span: Span | None = None
    """Where it stands; None: in no file."""
    details: tuple[str, ...] = ()
    seconds: float = 0.0


def of_diagnostics(items: Iterable[Diagnostic]) -> list[CiFinding]:
    """A finding for every diagnostic."""
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
"""Version of the documents; a field that goes or changes its meaning raises it."""

FINE = 0
DIAGNOSTICS = 1
USAGE = 2
VIOLATED = 3
UNDECIDED = 4
NOT_RECHECKED = 5
"""A certificate of which nothing was found to be false, and that is beyond the re-checker."""
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
        """The programs that it is about."""
        several = self.fields.get("files")
        entries = several if isinstance(several, list) else [self.fields]
        return [str(e["file"]) for e in entries if isinstance(e, dict) and "file" in e]

    def document(self, command: str | None) -> dict[str, object]:
        """The JSON document."""
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
    """A command line that cannot be understood; `usage` says how it is written."""

    def __init__(self, message: str, usage: str) -> None:
        super().__init__(message)
        self.usage = usage.removeprefix("usage: ").strip()


def exit_of_kinds(kinds: Iterable[Kind]) -> int:
    """The exit code of findings: the one rule of every command that JUnit tells of, too."""
    found = set(kinds)
    return VIOLATED if "fail" in found else UNDECIDED if "open" in found else FINE


def exit_of(diagnostics: Iterable[Diagnostic]) -> int:
    """0 without errors; 2 where every error is one of the command line (U...); else 1."""
    errors = [d.code for d in diagnostics if d.severity is Severity.ERROR]
    if not errors:
        return FINE
    return USAGE if all(code.startswith("U") for code in errors) else DIAGNOSTICS


CERTIFICATE_FOLDER = """\
in the folder of a certificate: manifest.json (claims, times, assumptions), SEAL (its SHA-256),
program/ (every source and data file), sets/ (the sets of the proof, as bytes)
"""
CAMPAIGN_FOLDER = """\
in the folder of a campaign: campaign.json (what is flown), flights.csv (a row a flight),
arm-NAME/ (the same of an arm), campaign.lock (who is flying), and where asked for report.html and
flights.parquet
"""
"""What lies in folders that several commands take, for their help."""


class HelpWantedError(Exception):
    """`--help` was given; the message is the text."""


class CommandParser(argparse.ArgumentParser):
    """One command's parser. `examples`: lines for the end of its help."""

    def __init__(self, command: str, about: str, examples: str) -> None:
        super().__init__(
            prog=f"soter {command}",
            description=about,
            epilog=f"examples:\n{examples.rstrip()}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
            add_help=False,
        )
        self.add_argument(
            "--json", action="store_true", help="print one JSON document (docs/json.md)"
        )
        self.add_argument("-h", "--help", action=_Help, nargs=0, help="show this text")

    def error(self, message: str) -> NoReturn:
        """A wrong command line: raises UsageError."""
        raise UsageError(message, self.format_usage().removeprefix("usage: ").strip())


class _Help(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        raise HelpWantedError(parser.format_help().rstrip())


def add_file(parser: CommandParser, help_: str = "the program") -> None:
    """The positional FILE."""
    parser.add_argument("file", metavar="FILE", help=help_)


def add_report(parser: CommandParser, what: str, ending: str) -> None:
    """--report; `what` it writes; `ending`: of its file where no path is given."""
    parser.add_argument(
        "--report",
        nargs="?",
        const="",
        metavar="PATH",
        help=f"write {what}: one HTML page (.soter/...{ending})",
    )


def report_path(report: str, of: str, ending: str) -> Path:
    """Where --report writes; `of`: the file or folder that it is about."""
    stem = Path(of).resolve().name.removesuffix(".soter").removesuffix(".trace.json")
    return Path(report or Path(".soter") / f"{stem}{ending}")


def add_settings(parser: CommandParser) -> None:
    """--set and --bind."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="K=V",
        type=_pair,
        dest="params",
        help="value of a parameter, such as --set GAIN=3, --set d.PERIOD=20ms, --set r[0].GAIN=2",
    )
    parser.add_argument(
        "--bind",
        action="append",
        default=[],
        metavar="X=WHAT",
        type=_pair,
        dest="bindings",
        help="what answers extern X: python:file.py:name, c:file.c:name, onnx:a.onnx, sb3:a.zip",
    )


def add_options(parser: CommandParser, record: type) -> None:
    """An argument for each field of a record that has a flag, and --set and --bind at `params`."""
    for name, known in options_of(record).items():
        if name == "params":
            add_settings(parser)
        *flags, metavar = known.flags.split() or [""]
        how: dict[str, Any] = {"dest": name, "default": known.given, "help": known.help(TIMES)}
        if metavar.startswith("--"):
            parser.add_argument(*flags, metavar, action="store_true", **how)
            continue
        how |= {"metavar": metavar.strip("[]"), "type": READERS.get(known.kind.text, str)}
        if metavar.startswith("["):
            how |= {"nargs": "?", "const": ""}
        if metavar.startswith("{"):
            how |= {"choices": metavar.strip("{}").split(","), "metavar": None}
        if flags:
            action = "append" if known.kind.text == "several" else "store"
            parser.add_argument(*flags, action=action, **how)


def given(args: argparse.Namespace, record: type) -> dict[str, Any]:
    """The keywords of a record that a command line has."""
    options = options_of(record, keyword=True)
    values = {name: getattr(args, name) for name in options if name in args}
    return values | {"params": dict(args.params)}


def _pair(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign or not name.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"`{text}`: write NAME=VALUE")
    return name.strip(), value.strip()


def whole(text: str) -> int:
    """A whole number in plain digits: Python reads `1_000` and digits of any script, too.

    ArgumentTypeError for any other text.
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
    from soter.language.model.durations import WrongTextError, duration_ns  # noqa: PLC0415 - only then

    if text.isascii() and "_" not in text:
        with suppress(ValueError):
            return float(text)
        with suppress(WrongTextError):
            return duration_ns(text) / 10**9
    problem = f"`{text}` is no time: write seconds, or a number with its unit, such as 10min"
    raise argparse.ArgumentTypeError(problem)


def seed(text: str) -> int:
    """A seed: a whole number of 64 bits without sign; ArgumentTypeError for any other text."""
    if not (text.isascii() and text.isdigit()) or len(text) > 20 or int(text) >= 2**64:
        raise argparse.ArgumentTypeError(f"`{text}`: a seed is 0 to 2^64 - 1")
    return int(text)


TIMES = ", such as 90 (seconds) or 10min"
"""How times are written."""
READERS = {"whole": whole, "seed": seed, "bound": at_least_one, "seconds": seconds}
"""What reads the text of a kind of value."""
