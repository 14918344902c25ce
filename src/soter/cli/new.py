"""`soter new NAME`: a small robot that runs.

Purpose: a folder with a program, its policy in Python and in C, and a test; all or nothing.
Non-goals: more than one kind of robot.
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
from typing import TYPE_CHECKING

from soter.cli.terminal.command_line import CommandOutcome, file_option
from soter.codegen.c.names import program_prefix
from soter.diagnostics.diagnostic import mistake
from soter.diagnostics.os_error_text import reason
from soter.diagnostics.render import safe
from soter.version import pip_install

if TYPE_CHECKING:
    import argparse

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
"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Make a small robot that runs, in a new folder."""

    name: str = file_option("NAME", "of the robot and of its folder", told="")


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Make it."""
    folder = Path(args.name)
    name = _checked(folder, args.name)
    names = {"name": name, "prefix": program_prefix(name)}
    _make(folder, {f.format(**names): _filled(t, names) for t, f in FILES.items()})
    files = sorted(f.format(**names) for f in FILES.values())
    commands = _commands(folder, name)
    _say(folder, files, commands, console)
    fields: dict[str, object] = {
        "folder": str(folder),
        "files": files,
        "commands": [c for c, _ in commands],
    }
    return CommandOutcome(fields=fields)


def _checked(folder: Path, given: str) -> str:
    """The robot's name: the last part of the path."""
    name = folder.name
    if not NAME.fullmatch(name):
        rule = "letters, digits, - and _, a letter first, 64 characters at most"
        raise mistake("U001", f"`{safe(given)[:60]}` cannot be the name of a robot", rule)
    if os.path.lexists(folder):
        raise mistake("D008", f"`{folder}` exists already", "choose another name")
    if not folder.absolute().parent.is_dir():
        raise mistake("D001", f"there is no folder `{folder.parent}`", "make it first")
    return name


def _filled(template: str, names: dict[str, str]) -> str:
    text = (TEMPLATE / template).read_text(encoding="utf-8")
    for key, value in names.items():
        text = text.replace("{{" + key + "}}", value)
    return text


def _make(folder: Path, texts: dict[str, str]) -> None:
    """Fill a folder under another name, then give it its own: it is there whole or not at all."""
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


def _commands(folder: Path, name: str) -> list[tuple[str, str]]:
    """What to type where `soter new` was typed, in this order, and what it does."""
    at, program = shlex.quote(str(folder)), shlex.quote(str(folder / f"{name}.soter"))
    proof = shlex.quote(str(folder / "proof"))
    learned = shlex.quote(f"Learned=c:{folder / 'policy.c'}:policy_step")
    missing = [(pip_install("prove"), "what re-checks: it is not here")] * (not find_spec("flint"))
    return [
        *missing,
        (f"soter verify {program} --cert {proof}", "proves it, under what it prints"),
        (f"soter recheck {proof}", "checks the proof again, by other code"),
        (f"soter run {program}", "the policy, guarded: stays on the rail"),
        (f"soter run {program} --system Unguarded", "the policy alone: leaves it, exit 3"),
        (f"soter test {program}", "tries every schedule of its `test` block"),
        (f"soter run {program} --bind {learned}", "the same policy in C"),
        (f"python -m unittest discover {at}", "its tests; pytest runs them too"),
    ]


def _say(folder: Path, files: list[str], commands: list[tuple[str, str]], console: Console) -> None:
    console.say(f"{console.paint('green', 'made')}  {folder}/  {'  '.join(files)}\n\nnext")
    width = max(len(c) for c, _ in commands)
    for command, about in commands:
        console.say(f"  {command:<{width}}  {console.paint('muted', about)}")
