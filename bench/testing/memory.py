"""Bytes per stored configuration, against the packed size, exact and as fingerprints.

    .venv/bin/python bench/testing/memory.py [--json FILE]

The table of the explorer after an exhaustive depth-first search without reduction, divided by what
it stores (breadth-first search keeps two layers only: size.py); the packed size is the bits
of a configuration in whole bytes. Beside it the stack, at its largest. A table grows in steps, so
the figure depends on where a search ends: it is measured over several horizons.

Purpose: the memory figure of issue 4. Non-goals: the memory of the process (Python, numpy, the
cache).
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

if TYPE_CHECKING:
    from soter.explore.engine.explorer_library import Searched
    from soter.language.model.system import System

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples/testing"
HORIZONS = (6, 9, 12, 15, 18)
"""Ticks of two_modules."""
TICK_NS = 10_000_000
OTHERS = (
    ("stale_topic.soter", "MissedBeats"),
    ("late_sc_repaired.soter", "Late"),
    ("../wall/cart_test.soter", "AnyCommand"),
)
TARGETS = {"exact": 1.3, "fingerprint": 16.0}


def subjects() -> list[tuple[str, System]]:
    """Name and test."""
    system = system_of_test(check_file(str(EXAMPLES / "two_modules.soter")), "BothStayInside")
    assert system.test is not None
    tests = [
        (
            f"two_modules, {ticks} ticks",
            replace(system, test=replace(system.test, horizon_ns=ticks * TICK_NS)),
        )
        for ticks in HORIZONS
    ]
    for file, test in OTHERS:
        name = f"{Path(file).stem}, {test}"
        tests.append((name, system_of_test(check_file(str(EXAMPLES / file)), test)))
    return tests


def line(name: str, engine: Engine, storage: str, exploration: Searched) -> tuple[list[str], float]:
    """A row, and bytes a configuration (fingerprints) or per packed byte (exact)."""
    packed = -(-engine.bits // 8)
    each = exploration.table_bytes / exploration.states
    figure = each / packed if storage == "exact" else each
    target = TARGETS[storage]
    unit = "x packed" if storage == "exact" else "bytes"
    return [
        name,
        storage,
        f"{exploration.states:,}",
        f"{engine.bits} bits in {packed} bytes",
        f"{each:.2f}",
        f"{exploration.frontier_bytes / exploration.states:.2f}",
        f"{figure:.2f} {unit}",
        f"<= {target:g}",
        "yes" if figure <= target else "NO",
    ], figure


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows, figures = [], {}
    for name, system in subjects():
        engine = Engine(system)
        for storage in TARGETS:
            exploration = engine.explore(
                EngineSettings(strategy="dfs", storage=storage, reduction="none")
            )
            assert exploration.status == "exhausted", exploration
            row, figures[f"{name}, {storage}"] = line(name, engine, storage, exploration)
            rows.append(row)
    heads = ("test", "storage", "configurations", "packed", "table", "frontier", "figure")
    print(table((*heads, "target", "met"), rows))
    print("table, frontier: bytes per stored configuration")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 1 if any(row[-1] == "NO" for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
