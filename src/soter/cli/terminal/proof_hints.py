"""What a search for hints of a proof tried and found, for people; and writing it into the program.

Purpose: `print_search` prints the table of tries, `SEARCHES` is what JSON has of it; `write_hints`
puts what was found into the file.
Non-goals: the search (`verify/search/`).
"""

from __future__ import annotations

import hashlib
import shlex
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

from soter.api import read_text
from soter.diagnostics.command_records import JsonObject
from soter.diagnostics.diagnostic import mistake

if TYPE_CHECKING:
    from soter.cli.terminal.console import Console
    from soter.cli.terminal.stored_outcome import Printout
    from soter.verify.claims.results import ProofSearch, VerifyReport

SHOWN = 100
"""The most characters of what a try gave; JSON has all of it."""
NOT_FOUND = "no hint was found with which all of it is proved"
NO_HINTS = "the program says no grid and no `rest`"
NOTHING_TRIED = "runs of its model gave none"
NOTHING_OPEN = "the program says how it is proved"


def seconds_text(value: float) -> str:
    """A time in seconds as text for people: `1.2 s` or `340 ms`."""
    return f"{value:.1f} s" if value >= 1.0 else f"{value * 1000:.0f} ms"


def print_search(search: ProofSearch, command: str, printed: Printout) -> None:
    """Prints the hints tried and found for a module; `command` is the line that verifies it."""
    why = "what the program says leaves it undecided" if search.own else NO_HINTS
    none = NOTHING_TRIED if search.refused is None else search.refused.message
    tried = "tried" if search.tries else f"no hint was tried: {none}"
    printed.say(f"\n{printed.paint('bold', search.module)}  {why}; {tried}")
    if search.tries:
        print_tries(search, printed)
    if any(t.untried for t in search.tries):
        printed.say("\nwhat was not tried needs a longer `--budget`")
    if search.proved:
        printed.say(f"\nfound   {printed.paint('green', str(search.found))}")
        printed.say(
            f"        `{command} --write` puts it into the program; "
            "what follows is about the program with it"
        )
    elif not search.own:
        printed.say(f"\nthe best of these, and what follows is with it: {search.found}")


def print_tries(search: ProofSearch, printed: Printout) -> None:
    """Prints a table of the hints that were tried, each with the result and the time it took."""
    rows = []
    for t in search.tries:
        took = f"about {seconds_text(t.cpu_s)}" if t.untried else seconds_text(t.cpu_s)
        rows.append((t.hints, shorten(t.gave, SHOWN, placeholder=" …"), took))
    printed.say("")
    printed.add_table(("hint", "what it gave", "processor"), rows)


def require_writable(path: Path) -> None:
    """Raises SoterError D006 before the search if hints could not be written to the file later."""
    from soter.cli.tool.fmt import require_permission  # noqa: PLC0415 - only then

    if path.exists() and not path.is_file():
        raise mistake("D006", f"cannot write `{path}`: it is no plain file")
    if path.exists():
        require_permission(path, f"chmod u+w {shlex.quote(str(path))}, or leave `--write` out")


def write_hints(report: VerifyReport, console: Console) -> str | None:
    """Writes found hints into the program if they prove it; gives the path; or SoterError D006."""
    from soter.cli.tool.fmt import replace_file  # noqa: PLC0415 - only then

    found = [s for s in report.searches if s.proved]
    if not found or len(found) < len(report.searches):
        console.say("\nnothing was written: " + (NOT_FOUND if report.searches else NOTHING_OPEN))
        return None
    path, now = Path(report.path), read_text(report.path).encode("utf-8", "surrogatepass")
    if report.contents.get(path) != hashlib.sha256(now).hexdigest():
        why = f"cannot write `{path}`: it has changed since it was read"
        raise mistake("D006", why, "verify it again")
    replace_file(path, found[-1].text)
    console.say(f"\nwritten {report.path}")
    return report.path


def _found_hints_text(search: ProofSearch) -> str | None:
    return None if search.found is None else str(search.found)


SEARCHES = JsonObject(
    "soter.verify.claims.results.ProofSearch",
    "module own proved found? tries",
    {"found": _found_hints_text},
    tries=JsonObject("soter.verify.claims.results.Try", "hints gave cpu_s untried"),
)
"""What the document of `soter verify` has of a search."""
