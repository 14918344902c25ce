"""`soter fmt FILE...`: gives all programs one layout.

Purpose: rewrites files in place, each whole or not at all; `--check` and `--diff` only look.
Non-goals: the layout (`language/syntax/printer.py`).
"""

from __future__ import annotations

import difflib
import os
import shlex
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api import format_text, read_text
from soter.cli.terminal.command_outcome import DIAGNOSTICS, CommandOutcome, exit_code
from soter.cli.terminal.program_loading import STDIN, standard_input
from soter.cli.terminal.shared_options import file_option
from soter.diagnostics.command_records import SWITCH, option
from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.report.atomic_write import atomic_write

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.console import Console

EXAMPLES = """\
  soter fmt drone.soter iris.soter
  soter fmt --check *.soter      exit 1 where something would change
  soter fmt --diff drone.soter   show what would change
  soter fmt - < drone.soter      standard input to standard output
"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Lay out source files, in place."""

    files: list[str] = file_option("FILE...", "a program; - for standard input", json_name="files")
    check: bool = option("--check", False, "change nothing, exit 1 if needed", SWITCH)
    diff: bool = option("--diff", False, "change nothing, show the difference", SWITCH)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Lays out every file, even if others have errors."""
    problems: list[Diagnostic] = []
    changed: list[str] = []
    texts: dict[str, str] = {}
    differences: list[str] = []
    for name in args.files:
        try:
            before = standard_input() if name == "-" else read_text(name)
            after = format_text(STDIN if name == "-" else name, before)
            texts[name] = after
            if before != after:
                changed.append(name)
            differences += _write_or_show(name, before, after, args, console)
        except SoterError as error:
            problems += error.diagnostics
    _say_changed(args, changed, problems, console)
    code = exit_code(problems) or (DIAGNOSTICS if args.check and changed else 0)
    fields: dict[str, object] = {"changed": changed}
    if args.diff:
        fields["diff"] = "\n".join(differences)
    if "-" in texts:
        fields["text"] = texts["-"]
    return CommandOutcome(code, tuple(problems), fields)


def _write_or_show(
    name: str, before: str, after: str, args: argparse.Namespace, console: Console
) -> list[str]:
    """Writes or shows the new layout; gives the lines of the difference, for `--diff`."""
    lines: list[str] = []
    if args.diff:
        names = name, f"{name} (laid out)"
        lines += difflib.unified_diff(before.splitlines(), after.splitlines(), *names, lineterm="")
        for line in lines:
            style = {"+": "green", "-": "red", "@": "blue"}.get(line[:1])
            console.say(console.paint(style, line) if style else line)
    elif args.check:
        pass
    elif name == "-":
        console.say(after.removesuffix("\n"))
    elif before != after:
        replace_file(Path(name), after)
    return lines


def _say_changed(
    args: argparse.Namespace, changed: list[str], problems: list[Diagnostic], console: Console
) -> None:
    if args.diff or "-" in args.files:
        return
    for name in changed:
        console.say(f"{'would change' if args.check else 'laid out'}  {name}")
    if not changed and not problems:
        n = len(args.files)
        console.say(f"{n} file{'' if n == 1 else 's'} laid out already")


def replace_file(path: Path, text: str) -> None:
    """Replaces a file completely or not at all, and keeps its permissions; SoterError D006."""
    try:
        again = shlex.quote(str(path))
        help_ = f"chmod u+w {again} && soter fmt {again}"
        require_permission(path, help_, f"only look: soter fmt --diff {again}")
        mode = stat.S_IMODE(path.stat().st_mode)
        with atomic_write(path) as stream:
            os.chmod(stream.fileno(), mode)  # noqa: PTH101 - a descriptor has no path
            stream.write(text.encode("utf-8", "surrogatepass"))
    except OSError as error:
        raise mistake("D006", f"cannot write `{path}`: {reason(error)}") from error


def require_permission(path: Path, *helps: str) -> None:
    """Raises SoterError D006 if a file is read-only, as `atomic_write` would replace it."""
    if not (path.stat().st_mode & 0o222 and os.access(path, os.W_OK)):
        raise mistake("D006", f"cannot write `{path}`: it is read-only", *helps)
