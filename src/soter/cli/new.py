"""`soter new NAME`: makes a small robot that runs, or a start for a given log.

Purpose: writes a folder with a program, its policy in Python and in C, and a test; with `--robot`
those of a kind of robot, by figures of its data sheet (`robot_kinds.py`); with `--from` a mapping
and the head of a program for a log of another system. It writes all of it or nothing.
Non-goals: reading the log (`monitor/log_survey.py`).
"""

from __future__ import annotations

import os
import re
import secrets
import shlex
import shutil
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.addons import load_module
from soter.api import load
from soter.api.output_files import require_utf8
from soter.cli.terminal.command_outcome import CommandOutcome
from soter.cli.terminal.shared_options import file_option
from soter.cli.tool.robot_kinds import texts_of_kind
from soter.codegen.c_names import program_prefix
from soter.diagnostics.command_records import SEVERAL, SWITCH, option
from soter.diagnostics.diagnostic import Severity, mistake
from soter.diagnostics.render import safe
from soter.diagnostics.system_texts import reason
from soter.version import pip_command

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping, Sequence

    from soter.cli.terminal.console import Console

TEMPLATE = Path(__file__).parent / "templates" / "robot"
FILES = {
    "NAME.soter": "{name}.soter",
    "policy.py.in": "policy.py",
    "policy.c": "policy.c",
    "test_NAME.py.in": "test_{prefix}.py",
    "README.md": "README.md",
    "gitignore": ".gitignore",
}
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")

EXAMPLES = """\
  soter new rover
  soter run rover/rover.soter
  soter new lift --robot axis --set TRAVEL=12.5 --set AGE=20ms     by the figures of a data sheet
  soter new rover --from flight.ulg       topics, types, a first max_age, and the mapping to them
  soter new rover --from pose.csv --from battery.csv     of several CSVs that are one log
"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Make a small robot that runs, in a new folder."""

    name: str = file_option("NAME", "of the robot and of its folder", json_name="")
    robot: str | None = option("--robot KIND", None, "a kind of robot; `soter new x --robot help`")
    figures: Sequence[str] = option(
        "--set NAME=X", (), "with --robot: a figure, as in its program; may be repeated", SEVERAL
    )
    logs: Sequence[str] = option(
        "--from LOG",
        (),
        "a log: its mapping and the head of a program; with --robot AGE; may be repeated",
        SEVERAL,
    )
    partial: bool = option(
        "--partial", False, "with --from: of a damaged log what stands before that", SWITCH
    )
    NEEDS = (("logs", "partial"), ("robot", "figures"))


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Makes the folder and prints the next commands; SoterError if it cannot be made."""
    folder = Path(args.name)
    name = _checked_name(folder, args.name)
    names = {"name": name, "prefix": program_prefix(name)}
    if args.robot is not None:
        survey = _surveyed_logs(args) if args.logs else None
        texts = texts_of_kind(args.robot, names, args.figures, survey)
        _require_sound(f"{name}.soter", texts)
        commands = _next_commands(folder, name, kind=True)
    elif args.logs:
        texts, commands = _files_of_log(name, args), _commands_of_log(folder, name, args.logs)
    else:
        texts = {f.format(**names): _filled_template(t, names) for t, f in FILES.items()}
        commands = _next_commands(folder, name, kind=False)
    _make_folder(folder, texts)
    files = sorted(texts)
    _say_files_made(folder, files, commands, console)
    fields: dict[str, object] = {
        "folder": str(folder),
        "files": files,
        "commands": [c for c, _ in commands],
    }
    return CommandOutcome(fields=fields)


def _require_sound(program: str, texts: Mapping[str, str]) -> None:
    """Raises SoterError U001 if the robot's program has an error with the figures given."""
    loaded = load(program, text=texts[program])
    if not loaded.ok:
        first = next(d for d in loaded.diagnostics if d.severity is Severity.ERROR)
        place = first.primary
        line = "" if place is None else place.span.source.line(place.span.line).strip()
        message = f"no robot of this kind has these figures: {first.message}"
        raise mistake("U001", message, notes=(f"in `{line}` of {program}",))


def _files_of_log(name: str, args: argparse.Namespace) -> dict[str, str]:
    """Texts by file name, for a log: a mapping and the head of a program; SoterError D016, D007."""
    drafts, found = load_module("soter.monitor.survey_drafts"), _surveyed_logs(args)
    log = ", ".join(Path(log).name for log in args.logs)
    return {
        f"{name}.soter": drafts.program_head(found, log, name),
        f"{name}.toml": drafts.mapping_of_log(found, log),
    }


def _surveyed_logs(args: argparse.Namespace) -> Any:  # noqa: ANN401 - of an add-on
    """The survey of the logs: their channels and fields; SoterError D016, D007."""
    require_utf8(*args.logs)
    survey = load_module("soter.monitor.log_survey")
    return survey.survey_of_logs([Path(log) for log in args.logs], partial=args.partial)


def _commands_of_log(folder: Path, name: str, logs: Sequence[str]) -> list[tuple[str, str]]:
    program, files = folder / f"{name}.soter", " ".join(map(shlex.quote, logs))
    return [
        (f"soter check {program}", "types and topics; write a module over those that it reads"),
        (f"soter monitor {program} {files} --map {folder / name}.toml", "then judge the log"),
    ]


def _checked_name(folder: Path, text: str) -> str:
    """The robot's name, which is the last part of the path; SoterError U001, D008 or D001."""
    name = folder.name
    if not NAME.fullmatch(name):
        rule = "letters, digits, - and _, a letter first, 64 characters at most"
        raise mistake("U001", f"`{safe(text)[:60]}` cannot be the name of a robot", rule)
    if os.path.lexists(folder):
        raise mistake("D008", f"`{folder}` exists already", "choose another name")
    if not folder.absolute().parent.is_dir():
        raise mistake("D001", f"there is no folder `{folder.parent}`", "make it first")
    return name


def _filled_template(template: str, names: dict[str, str]) -> str:
    text = (TEMPLATE / template).read_text(encoding="utf-8")
    for key, value in names.items():
        text = text.replace("{{" + key + "}}", value)
    return text


def _make_folder(folder: Path, texts: dict[str, str]) -> None:
    """Fills a hidden folder, and renames it to `folder`; removes all of it on SoterError D006."""
    hidden = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
    try:
        hidden.mkdir()
        for name, text in texts.items():
            (hidden / name).write_text(text, encoding="utf-8", newline="\n")
        hidden.rename(folder)
    except BaseException as error:
        shutil.rmtree(hidden, ignore_errors=True)
        if isinstance(error, OSError):
            why = f"cannot make the folder `{folder}`: {reason(error)}"
            raise mistake("D006", why) from error
        raise


def _next_commands(folder: Path, name: str, *, kind: bool) -> list[tuple[str, str]]:
    """The commands that the user types next, in this order, each with a text on its effect."""
    at, program = shlex.quote(str(folder)), shlex.quote(str(folder / f"{name}.soter"))
    proof = shlex.quote(str(folder / "proof"))
    learned = shlex.quote(f"Learned=c:{folder / 'policy.c'}:policy_step")
    missing = [(pip_command("prove"), "what re-checks: it is not here")] * (not find_spec("flint"))
    stays, leaves = ("keeps `safe`", "breaks it") if kind else ("stays on the rail", "leaves it")
    return [
        *missing,
        (f"soter verify {program} --cert {proof}", "proves it, under what it prints"),
        (f"soter recheck {proof}", "checks the proof again, by other code"),
        (f"soter run {program}", f"the policy, guarded: {stays}"),
        (f"soter run {program} --system Unguarded", f"the policy alone: {leaves}, exit 3"),
        (f"soter run {program} --system Troubled", "guarded, with faults")
        if kind
        else (f"soter test {program}", "tries every schedule of its `test` block"),
        (f"soter run {program} --bind {learned}", "the same policy in C"),
        (f"python -m unittest discover {at}", "its tests; pytest runs them too"),
    ]


def _say_files_made(
    folder: Path, files: list[str], commands: list[tuple[str, str]], console: Console
) -> None:
    console.say(f"{console.paint('green', 'made')}  {folder}/  {'  '.join(files)}\n\nnext")
    width = max(len(c) for c, _ in commands)
    for command, about in commands:
        console.say(f"  {command:<{width}}  {console.paint('muted', about)}")
