"""What the reductions leave out: configurations with and without, for the same verdict.

    .venv/bin/python bench/testing/reduction.py [--json FILE] [--most STATES]

First the yardstick, examples/testing/two_modules.soter. Then programs of 2, 4, 6, 8 and 10
nodes that choose a bool every tick, over three instants; a property reads the first two topics.
*Independent* nodes publish what they chose a tick ago and read nothing; in *pairs* they read
each other; in a *ring* each reads the one before it, so that no node is independent of its
neighbours: the case against reduction.

`all` is sleep and ample sets on the whole system; `soter test` besides explores parts of a system
that share nothing one after the other: their number, and the sum of what is stored.

Purpose: the figure and the curve of issue 4. Non-goals: speed against others
(`spin.py`).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.engine.explorer_library import Engine, EngineSettings, Searched
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

if TYPE_CHECKING:
    from soter.language.model.system import System

ROOT = Path(__file__).resolve().parents[2]
YARDSTICK = ROOT / "examples/testing/two_modules.soter"
REDUCTIONS = ("none", "sleep", "ample", "all")
COUPLINGS = ("independent", "pairs", "ring")
SIZES = (2, 4, 6, 8, 10)


def program(nodes: int, coupling: str) -> str:
    """The text of one of the generated programs."""
    lines = ["soter 1;"]
    for i in range(nodes):
        other = {"independent": None, "pairs": i ^ 1, "ring": (i - 1) % nodes}[coupling]
        if other is None:
            body = f"  var kept: bool;\n  step {{ publish t{i} = kept; kept = choose bool; }}\n"
        else:
            body = (
                f"  subscribes t{other};\n"
                f"  step {{ publish t{i} = choose {{ t{other}, !t{other} }}; }}\n"
            )
        lines.append(f"topic t{i} : bool;\nnode N{i} period 10ms {{\n  publishes t{i};\n{body}}}")
    items = "".join(f"  node N{i};\n" for i in range(nodes))
    lines.append(f"system S {{\n{items}}}")
    lines.append("test T { system S; horizon 20ms; always t0 || !t0 || t1; }")
    return "\n".join(lines)


def searches(engine: Engine, most: int) -> dict[str, Searched]:
    """One search per reduction."""
    return {
        r: engine.explore(
            EngineSettings(strategy="bfs", reduction=r, memory=3 * 2**30, max_states=most)
        )
        for r in REDUCTIONS
    }


def apart(system: System) -> tuple[int, str]:
    """Configurations that `soter test` stores, which explores parts apart, and how many parts."""
    with Search(system, SearchOptions(memory=3 * 2**30)) as search:
        outcome = search.run()
        return outcome.states, f"{outcome.states:,} in {search.parts}"


def cells(exploration_by_reduction: dict[str, Searched], parts: str) -> list[str]:
    """Configurations per reduction, verdict, and by how much there are fewer."""
    shown = [
        f"{f.states:,}" if f.status == "exhausted" else f"> {f.states:,}"
        for f in exploration_by_reduction.values()
    ]
    share = exploration_by_reduction["all"].states / exploration_by_reduction["none"].states
    at_most = "" if exploration_by_reduction["none"].status == "exhausted" else "< "
    statuses = {f.status for f in exploration_by_reduction.values()}
    return [*shown, f"{at_most}1/{1 / share:.1f}", parts, "/".join(sorted(statuses))]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--most", type=int, default=30_000_000)
    arguments = parser.parse_args()
    system = system_of_test(check_file(str(YARDSTICK)), "BothStayInside")
    engine = Engine(system)
    yardstick = searches(engine, arguments.most)
    states, parts = apart(system)
    rows = [["two_modules", str(len(engine.actors)), *cells(yardstick, parts)]]
    figures = {"two_modules": {r: f.states for r, f in yardstick.items()} | {"parts": states}}
    for coupling in COUPLINGS:
        for nodes in SIZES:
            text = program(nodes, coupling)
            system = system_of_test(check_file(f"{coupling}{nodes}.soter", text), "T")
            exploration_by_reduction = searches(Engine(system), arguments.most)
            states, parts = apart(system)
            rows.append([coupling, str(nodes), *cells(exploration_by_reduction, parts)])
            figures[f"{coupling} {nodes}"] = {
                r: f.states for r, f in exploration_by_reduction.items()
            }
            figures[f"{coupling} {nodes}"]["parts"] = states
    heads = ("program", "actors", *REDUCTIONS, "all / none", "soter test: parts", "status")
    print(table(heads, rows))
    share = yardstick["all"].states / yardstick["none"].states
    print(f"two_modules with reduction: {share:.3f} of the configurations (target: <= 0.2)")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 0 if share <= 0.2 else 1


if __name__ == "__main__":
    sys.exit(main())
