"""A defect of soter itself: a short apology, and a file with what is needed to repair it.

Purpose: nobody is shown a traceback; whoever repairs it has one.
Non-goals: users' mistakes, which are diagnostics.
"""

from __future__ import annotations

import platform
import sys
import time
import traceback
from pathlib import Path

from soter import __version__
from soter.diagnostics.diagnostic import Diagnostic

FOLDER = Path(".soter")


def apologise(error: Exception, arguments: list[str]) -> Diagnostic:
    """A diagnostic I001; the details are written to `.soter/crash-....txt`."""
    kind = type(error).__name__
    path = FOLDER / f"crash-{time.strftime('%Y%m%d-%H%M%S')}.txt"
    try:
        FOLDER.mkdir(exist_ok=True)
        path.write_text(_details(error, arguments), encoding="utf-8", errors="replace")
        where = f"the details are in `{path}`: please send it with the program"
    except OSError:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{kind} in {Path(last.filename).name}, line {last.lineno}: {error}"
    return Diagnostic(
        "I001",
        f"soter has a defect, sorry ({kind})",
        notes=(where,),
        helps=("the mistake is ours, not the program's",),
    )


def _details(error: Exception, arguments: list[str]) -> str:
    return "\n".join(
        [
            f"soter {__version__}, Python {sys.version.split()[0]}, {platform.platform()}",
            f"arguments: {arguments!r}",
            "",
            "".join(traceback.format_exception(type(error), error, error.__traceback__)),
        ]
    )
