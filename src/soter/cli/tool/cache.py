"""`soter cache`: tells how much of the disk compiled programs and computed sets take.

Purpose: shows the cache, clears it, or sets how large it may grow.
Non-goals: what is kept, and for how long (`native/cache.py`).
"""

from __future__ import annotations

import argparse
import re
import time
from dataclasses import dataclass

from soter.cli.terminal.command_line import UsageError
from soter.cli.terminal.command_outcome import CommandOutcome
from soter.cli.terminal.console import Console, disk_size_text
from soter.diagnostics.command_records import choice, option, read_by
from soter.native.cache import (
    LIMIT,
    YOUNG_S,
    cache_dir,
    cache_entries,
    cache_limit,
    clear_cache,
    set_limit,
)

EXAMPLES = f"""\
  soter cache                  where it is, what it holds, how much it may hold
  soter cache clear            remove everything: it is made again when it is needed
  soter cache limit 500MB      and no more from now on; the least recently used go first
  SOTER_CACHE=/tmp/c soter run cart.soter      another folder, for one command

Nothing is lost with an entry but the time to make it. What was used less than
{YOUNG_S / 60:.0f} minutes ago stays, above the limit, too: a command may be about to load it.
The environment variable {LIMIT} goes before `soter cache limit`.
"""
GB = 1000
SIZE = re.compile(r"([0-9]{1,9})\s*([MG])?B?", re.IGNORECASE)


def _megabytes(text: str) -> int:
    """A size in MB; ArgumentTypeError for any other text."""
    match = SIZE.fullmatch(text.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"`{text}` is no size: write 500MB or 2GB")
    return int(match[1]) * (GB if (match[2] or "").upper() == "G" else 1)


@dataclass(frozen=True, kw_only=True)
class Options:
    """What compiled programs take on the disk."""

    action: str = option("[ACTION]", "show", "by default show", choice("show", "clear", "limit"))
    size: int | None = option("[SIZE]", None, "such as 500MB, 2GB", read_by(_megabytes))


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Shows or clears the cache or sets its limit; UsageError for a missing or needless size."""
    if (args.size is None) != (args.action != "limit"):
        wants = "takes a SIZE, such as 500MB" if args.size is None else "takes no SIZE"
        raise UsageError(f"`soter cache {args.action}` {wants}")
    removed = clear_cache() if args.action == "clear" else None
    if args.size is not None:
        set_limit(args.size)
    listed, (most, said_by) = cache_entries(), cache_limit()
    held = sum(size for _, size, _ in listed)
    if removed is not None:
        noun = "entry" if removed[0] == 1 else "entries"
        console.say(f"removed  {removed[0]} {noun}, {disk_size_text(removed[1])}")
    console.say(f"folder   {cache_dir()}")
    console.say(
        f"holds    {disk_size_text(held)} in {len(listed)} entr{'y' if len(listed) == 1 else 'ies'}"
    )
    console.say(f"limit    {disk_size_text(most)} ({said_by})")
    if listed:
        console.say(f"oldest   used {_ago_text(time.time() - listed[0][0])} ago")
    fields: dict[str, object] = {
        "folder": str(cache_dir()),
        "entries": len(listed),
        "bytes": held,
        "limit_bytes": most,
        "limit_from": said_by,
        "removed": None if removed is None else {"entries": removed[0], "bytes": removed[1]},
    }
    return CommandOutcome(fields=fields)


def _ago_text(seconds: float) -> str:
    for unit, length in (("day", 86_400.0), ("hour", 3_600.0), ("minute", 60.0)):
        if count := int(seconds // length):
            return f"{count} {unit}{'s' if count > 1 else ''}"
    return "less than a minute"
