"""A user's mistake, where nobody catches it: as short as on the command line.

Purpose: a script that ends by `SoterError` prints its own lines and the diagnostics, not ours; a
notebook the same. `SOTER_TRACEBACK=1` shows everything.
Non-goals: other exceptions; whoever has an `excepthook` of their own keeps it.
"""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.render import render_all

if TYPE_CHECKING:
    from types import TracebackType

HERE = str(Path(__file__).resolve().parents[1])
ALL = "SOTER_TRACEBACK"


def install() -> None:
    """Have Python and IPython show a `SoterError` shortly; nothing where somebody else does."""
    setattr(SoterError, "_render_traceback_", _lines)  # noqa: B010 - IPython asks for that name
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _hook


def _hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if not isinstance(error, SoterError) or os.environ.get(ALL) or sys.stderr is None:
        sys.__excepthook__(kind, error, trace)
        return
    print("\n".join(_lines(error)), file=sys.stderr)


def _lines(error: SoterError) -> list[str]:
    """Where it was called, outside of soter, then the diagnostics."""
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(HERE)
    ]
    lines = [f'  File "{f.filename}", line {f.lineno}: {f.line}'.rstrip(": ") for f in frames]
    return [*lines, render_all(error.diagnostics)]
