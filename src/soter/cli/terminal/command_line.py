"""The parser of a command's line, made from the record of the command's options.

Purpose: `CommandParser` is an `ArgumentParser` that raises `UsageError` instead of ending the
process. `Option.flags` (`diagnostics/command_records.py`) describes each argument; `READERS` read
the text of its value. `keyword_arguments` hands the arguments on as keywords of a method in Python.
Non-goals: what the options mean; options of several commands (`shared_options.py`).
"""

from __future__ import annotations

import argparse
import re
from contextlib import suppress
from inspect import cleandoc
from typing import TYPE_CHECKING, Any, NoReturn, Protocol, TypeAlias

from soter.diagnostics.command_records import Option, options_of, removed_flags
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.cli.terminal.command_outcome import CommandOutcome
    from soter.cli.terminal.console import Console


Pairs: TypeAlias = tuple[tuple[str, str], ...]


class UsageError(Exception):
    """A wrong command line. `usage`: the right form; "" if the command's help shows it."""

    def __init__(self, message: str, usage: str = "") -> None:
        super().__init__(message)
        self.usage = usage


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
    """Raised for `--help`; the message is the help text."""


class Command(Protocol):
    """The module of a command; `EXAMPLES`: lines that end the help."""

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
        self._about = {n: o.json_name for n, o in options.items() if o.json_name and not o.dashed}

    def read_line(self, line: Sequence[str]) -> argparse.Namespace:
        """The line's arguments; `written`: the names in it. SoterError U001 for a removed flag."""
        if problems := removed_flags(self.record, [word.partition("=")[0] for word in line]):
            raise SoterError(problems)
        defaults = {action.dest: action.default for action in self._actions}
        dashed = {action.dest for action in self._actions if action.option_strings}
        args = self.parse_args(line, argparse.Namespace(**dict.fromkeys(defaults)))
        given_values = {n: v for n, v in vars(args).items() if v is not None}
        written = {n for n, v in given_values.items() if n in dashed or v != defaults[n]}
        return argparse.Namespace(**{**defaults, **given_values, "written": written})

    def subject_fields(self, args: argparse.Namespace) -> dict[str, object]:
        """Fields of the JSON document that name what the command was about."""
        return {field_name: getattr(args, name) for name, field_name in self._about.items()}

    def _add_argument_of(self, name: str, known: Option) -> None:
        """Adds the option or positional argument that the field's `Option.flags` describes."""
        *flags, metavar = known.flags.split()
        kind, needed = known.kind.text, known.default is ...
        how: dict[str, Any] = {
            "default": None if needed else known.default,
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
            default = None if known.default is None else list(known.default)
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
                type=_name_and_value,
                dest=name,
                help=about,
            )

    def error(self, message: str) -> NoReturn:
        """Raises UsageError with argparse's message."""
        raise UsageError(message, self.usage_line)

    @property
    def usage_line(self) -> str:
        """The usage of the command as one line of text."""
        return self.format_usage().removeprefix("usage: ").strip()


class _Help(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        raise HelpWantedError(parser.format_help().rstrip())


def keyword_arguments(args: argparse.Namespace, record: type) -> dict[str, Any]:
    """The arguments that are keywords of `record`, as a dict for the method in Python."""
    options = options_of(record, keyword=True)
    values = {name: getattr(args, name) for name in options if name in args}
    return values | ({PARAMS: dict(args.params)} if PARAMS in options else {})


def _name_and_value(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign or not name.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"`{text}`: write NAME=VALUE")
    return name.strip(), value.strip()


def whole_number(text: str) -> int:
    """The whole number in a text of plain digits (no `1_000`); ArgumentTypeError for others."""
    if not re.fullmatch("[+-]?[0-9]{1,20}", text):
        raise argparse.ArgumentTypeError(f"`{text}` is no whole number")
    return int(text)


def at_least_one(text: str) -> int:
    """A whole number above 0; ArgumentTypeError for any other text."""
    if whole_number(text) < 1:
        raise argparse.ArgumentTypeError("it has to be 1 at least: leave it out for no such bound")
    return whole_number(text)


def duration_s(text: str) -> float:
    """The seconds in plain digits, or in a number with a unit; ArgumentTypeError for others."""
    from soter.language.model.types import WrongTextError, duration_ns  # noqa: PLC0415 - only then

    if text.isascii() and "_" not in text:
        with suppress(ValueError):
            return float(text)
        with suppress(WrongTextError):
            return duration_ns(text) / 10**9
    raise argparse.ArgumentTypeError(
        f"`{text}` is no time: write seconds, or a number with its unit, such as 10min"
    )


def seed_number(text: str) -> int:
    """A seed: a whole number of 64 bits without sign; ArgumentTypeError for any other text."""
    if not (text.isascii() and text.isdigit()) or len(text) > 20 or int(text) >= 2**64:
        raise argparse.ArgumentTypeError(f"`{text}`: a seed is 0 to 2^64 - 1")
    return int(text)


TIMES = ", such as 90 (seconds) or 10min"
"""Help text: how a time is written."""
READERS = {"whole": whole_number, "seed": seed_number, "bound": at_least_one, "seconds": duration_s}
"""`Kind.text` -> the function that reads the text of such a value."""
