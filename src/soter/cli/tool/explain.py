"""`soter explain CODE`: the page of a diagnostic code.

Purpose: prints a page (what was wrong, an example, its remedy); without argument all codes.
Non-goals: the pages (`diagnostics/pages`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.cli.terminal.command_outcome import DIAGNOSTICS, CommandOutcome
from soter.diagnostics.codes import all_codes, explain, known_code, similar_codes, title
from soter.diagnostics.command_records import option
from soter.diagnostics.diagnostic import Diagnostic
from soter.diagnostics.render import safe

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.console import Console

EXAMPLES = """\
  soter explain P1a
  soter explain ttf        also safer, start and DM: what else `soter verify` shows
  soter explain rest       also moves, within and anchor: where SC ends
  soter explain            all codes with their titles
"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Explain a diagnostic code, or list all of them."""

    code: str | None = option("[CODE]", None, "such as P1a; none lists all")


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Prints the page of the code, or the list of codes; a diagnostic for an unknown code."""
    if args.code is None:
        return _list_codes(console)
    code = known_code(args.code)
    page = explain(args.code)
    if page is None or code is None:
        return _unknown_code_outcome(args.code)
    console.say(_coloured_page(page, console))
    return CommandOutcome(fields={"code": code, "title": title(code), "page": page})


def _list_codes(console: Console) -> CommandOutcome:
    titles = {code: title(code) or "" for code in all_codes()}
    for code, text in titles.items():
        console.say(f"{console.paint('bold', code)}{' ' * (6 - len(code))}{text}")
    return CommandOutcome(fields={"codes": [{"code": c, "title": t} for c, t in titles.items()]})


def _unknown_code_outcome(code: str) -> CommandOutcome:
    near = ", ".join(f"`{c}`" for c in similar_codes(code))
    helps = (f"did you mean {near}?",) if near else ("`soter explain` lists all codes",)
    return CommandOutcome(
        DIAGNOSTICS, (Diagnostic("U007", f"there is no code `{safe(code)[:40]}`", helps=helps),)
    )


def _coloured_page(page: str, console: Console) -> str:
    """The page's Markdown, with coloured headings and code if the console shows colours."""
    if not console.color_out:
        return page.rstrip()
    lines, in_code = [], False
    for line in page.rstrip().split("\n"):
        if line.startswith("```"):
            in_code = not in_code
            continue
        if in_code:
            lines.append(f"    {console.paint('blue', line)}")
        elif line.startswith("#"):
            lines.append(console.paint("bold", line.lstrip("# ")))
        else:
            lines.append(re.sub(r"`([^`]+)`", lambda m: console.paint("bold", m[1]), line))
    return "\n".join(lines)
