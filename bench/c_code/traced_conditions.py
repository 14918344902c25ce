"""Conditions of five modules that a requirement reaches, and which of them some run covers.

    .venv/bin/python bench/c_code/traced_conditions.py [PROGRAM ...]

Purpose: `soter assure --hazards --trace` of each program with the hazards beside it: conditions of
the generated C that hazards and requirements reach, how many of them a run covers (MC/DC, counted
in the C itself), what keeps the others uncovered, and conditions that nobody reaches.
Non-goals: the proof, without which no goal is supported; C of the run-time (`c_coverage.py`).
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import soter
from soter.report.tables import table

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PROGRAMS = ("wall/cart", "rest/cruise", "rest/lane", "drone/battery", "drone/motion_primitive")


def main() -> int:
    """Traces each; 1 where a condition is neither covered nor named with what is missing."""
    rows, missing, silent = [], Counter[tuple[str, str]](), 0
    for name in sys.argv[1:] or PROGRAMS:
        hazards = EXAMPLES / f"{name}_hazards.csv"
        with tempfile.TemporaryDirectory() as folder:
            program = soter.load(EXAMPLES / f"{name}.soter")
            case = program.assure(folder, hazards=hazards, trace=True).case
        trace = case.conditions
        assert trace is not None
        reached = trace.reached
        covered = [x for x in reached if x.covered_by]
        named = [x for x in reached if x.not_covered]
        silent += len(reached) - len(covered) - len(named)
        missing.update((x.condition, x.not_covered) for x in named)
        orphans = len(trace.conditions) - len(reached)
        figures = (len(trace.conditions), len(reached), len(covered), len(named), orphans)
        rows.append([name, *map(str, (*figures, len(trace.empty)))])
    heads = ["program", "conditions", "reached", "covered", "named", "orphans", "rows without one"]
    print(table(heads, rows))
    print("not covered:")
    for said, times in sorted(missing.items(), key=lambda x: (-x[1], x[0])):
        print(f"{times} x {said[0]}: {said[1]}")
    print(f"neither covered nor named: {silent}: {'ok' if not silent else 'missed'}")
    return 1 if silent else 0


if __name__ == "__main__":
    sys.exit(main())
