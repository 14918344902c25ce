"""Options that several commands share, for the records of their options.

Purpose: `SYSTEM`, `MODULE`, `FORMAT` and the like, with texts for help; fields of a
record: `file_option`, `report_option`; what two options ask for: `report_path`, `format_of`.
Non-goals: `--set` and `--bind`, which the parser adds (`command_line.py`); writing the formats
(`ci_formats.py`).
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.diagnostics.command_records import option

if TYPE_CHECKING:
    from collections.abc import Sequence


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


def file_option(flags: str = "FILE", words: str = "the program", json_name: str = "file") -> Any:  # noqa: ANN401 - a field
    """The positional argument that a command is about; `json_name`: its field in the document."""
    return option(flags, ..., words, json_name=json_name, keyword=False)


def report_option(what: str, ending: str, flags: str = "--report") -> Any:  # noqa: ANN401 - a field
    """The option --report; `what`: the page's contents; `ending`: ends the default file name."""
    words = f"write {what}: one HTML page (.soter/...{ending})"
    return option(f"{flags} [PATH]", None, words, keyword=False)


def report_path(report: str, of: str, ending: str) -> Path:
    """The path of a report: `report`, or if that is "" a file in `.soter/` named after `of`."""
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
    """The format that a command line asks for; None if it asks for none, or for an unknown one."""
    if name not in WITH_FORMAT:
        return None
    asked = [b for a, b in pairwise(options) if a == "--format"]
    asked += [a.removeprefix("--format=") for a in options if a.startswith("--format=")]
    return asked[-1] if asked and asked[-1] in FORMATS else None
