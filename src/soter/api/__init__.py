"""The public interface: what `import soter` gives, and what the command line is made of.

Purpose: `load` reads a program, which can then be checked, bound, simulated, built and formatted;
most commands that take a program are methods of `Program`. A user's mistake is always a
`SoterError` with diagnostics. Other packages are imported when needed: `check` loads neither NumPy
nor cffi.
Non-goals: printing, exit codes (`cli/`). In reading order:

- `program.py`: `load`, and `Program`, whose methods call most of the other files.
- `arguments.py` checks what callers give: times, parameters, modules, sources; `output_files.py`
  what they name for output; `computed_ttf.py` computes predicates that modules leave out.
- `check_report.py` makes the report of `check`; `measured_times.py` reads files of execution times;
  `diagrams.py` has the diagram of `soter show`.
- `running.py` runs a system with its externs bound (`simulate`).
- `exploring.py` explores tests; `rechecking.py` checks certificates again, and replays traces.
- `deploy/` builds packages, and says which proof a deployed system inherits.
- `comparing.py` says what a change of a program leaves standing.
- `buffer_advice.py` says how far from a fence a decision module takes over.
- `measuring.py` measures times of steps, or counts instructions on an emulated board.
- `monitoring.py` judges runs and logs; `identifying.py` fits parameters to logs;
  `campaigning.py` runs campaigns.
- `assurance/` makes safety cases, and checks their evidence.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING

from soter.api.arguments import format_text, read_text
from soter.api.check_report import (
    CheckReport,
    ModuleReport,
    StepReport,
    SwitchReport,
    SystemReport,
    ThreadRow,
    TimingReport,
)
from soter.api.output_files import require_writers
from soter.api.program import Program, load
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from types import TracebackType

    from soter.api.comparing import compare
    from soter.api.rechecking import ReplayReport, recheck, replay
    from soter.simulate.result import Run
    from soter.simulate.run_options import ENGINES

__all__ = [
    "ENGINES",
    "CheckReport",
    "ModuleReport",
    "Program",
    "ReplayReport",
    "Run",
    "SoterError",
    "StepReport",
    "SwitchReport",
    "SystemReport",
    "ThreadRow",
    "TimingReport",
    "compare",
    "format_text",
    "load",
    "read_text",
    "recheck",
    "replay",
    "require_writers",
]


LATER = {
    **dict.fromkeys(("ReplayReport", "replay"), "soter.api.rechecking"),
    "recheck": "soter.api.rechecking",
    "compare": "soter.api.comparing",
    "Run": "soter.simulate.result",
    "ENGINES": "soter.simulate.run_options",
}
"""Public name -> the module from which it is imported when somebody asks for it."""

ALL = "SOTER_TRACEBACK"


def _error_lines(error: SoterError) -> list[str]:
    """The lines that Python and IPython show for a SoterError that was not caught."""
    from soter.diagnostics.render import traceback_lines  # noqa: PLC0415 - only then

    return traceback_lines(error)


def _print_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    if not isinstance(error, SoterError) or os.environ.get(ALL) or sys.stderr is None:
        sys.__excepthook__(kind, error, trace)
        return
    print("\n".join(_error_lines(error)), file=sys.stderr)


setattr(SoterError, "_render_traceback_", _error_lines)  # noqa: B010 - IPython asks for that name
if sys.excepthook is sys.__excepthook__:  # else another package shows errors
    sys.excepthook = _print_uncaught


def __getattr__(name: str) -> object:
    if name not in LATER:
        raise AttributeError(f"module `soter.api` has no attribute `{name}`")
    value: object = getattr(import_module(LATER[name]), name)
    return value
