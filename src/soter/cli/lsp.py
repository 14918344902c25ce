"""`soter lsp`: the language server, which an editor starts.

Purpose: serve one editor over standard input and output, or over TCP.
Non-goals: what it answers (`soter.editor`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.cli.terminal.command_line import UsageError
from soter.cli.terminal.command_outcome import CommandOutcome
from soter.diagnostics.command_records import SWITCH, Kind, option
from soter.diagnostics.diagnostic import mistake
from soter.version import pip_command

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.console import Console

EXAMPLES = """\
  soter lsp                    over standard input and output: editors start it so (docs/editor.md)
  soter lsp --tcp 7658         waits for one client at port 7658 of this machine
"""
PORT_MAX = 65_535


@dataclass(frozen=True, kw_only=True)
class Options:
    """Serve an editor: the language server of Soter."""

    stdio: bool = option("--stdio", False, "over standard input and output", SWITCH)
    tcp: int | None = option("--tcp PORT", None, "over a port of this machine", Kind("whole"))


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Serves until the editor leaves; UsageError for wrong options, SoterError without pygls."""
    if args.tcp is not None and not 0 < args.tcp <= PORT_MAX:
        raise UsageError(f"{args.tcp} is no port: 1 to {PORT_MAX} are", "soter lsp --tcp PORT")
    if args.tcp is not None and args.stdio:
        raise UsageError("`--tcp` or `--stdio`, not both", "soter lsp [--tcp PORT]")
    if args.json and args.tcp is None:
        raise UsageError("standard output is the editor's: no `--json`", "soter lsp [--tcp PORT]")
    try:
        from soter.editor.server import serve  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in {"pygls", "lsprotocol"}:
            raise
        message = "the language server speaks with pygls, which is not installed"
        raise mistake("D007", message, f"install it: {pip_command('editor')}") from error
    if args.tcp is not None:
        console.note(f"waiting for a client at port {args.tcp}")
    from soter.verify.proof_cache import stored_verdicts_of_file  # noqa: PLC0415 - only then

    serve(stored_verdicts_of_file, None if args.tcp is None else ("127.0.0.1", args.tcp))
    return CommandOutcome()
