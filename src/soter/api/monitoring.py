"""Whether runs fit the plants of their proofs.

Purpose: `judged`, what `Program.monitor` does with a log or a run.
Non-goals: the judgement itself (`monitor/membership.py`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.given import chosen_modules
from soter.monitor.membership import Judgement, judge
from soter.reach.problem.extract import extract_sets
from soter.simulate.recorded import read_log, recorded

if TYPE_CHECKING:
    from soter.program.model.system import System
    from soter.simulate.result import Run


def judged(
    flat: System, log: str | Path | None, run: Run | None, module: str | None, *, estimates: bool
) -> list[Judgement]:
    """Every module, or one, on a log of the system `flat` or on a traced run of it."""
    if run is not None:
        flat, record = run.system, recorded(run)
    else:
        assert log is not None
        record = read_log(Path(log), flat)
    chosen = chosen_modules(flat, module)
    return [judge(flat, m, extract_sets(flat, m), record, estimates=estimates) for m in chosen]
