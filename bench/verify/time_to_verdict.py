"""How long `soter verify` takes, cold and warm, on the shipped modules.

    .venv/bin/python bench/verify/time_to_verdict.py [--json FILE] [--repeats N]

Each run is a process of its own, imports included. Cold: an empty cache folder, so the engine, the
enclosures and the decision module are compiled as well; warm: the folder of the run before. CPU is
user and system time of the process and all its children, over all threads; on a shared machine it
says more than wall time does, and where it is below a target, so is the wall time of an idle one.
Purpose: the times of issue 3 for the drone, and that the verdicts are those expected.
Non-goals: the engine alone (`reach_sets.py`).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from soter.report.terminal_tables import table

ROOT = Path(__file__).resolve().parents[2]
START = "import sys; from soter.cli.main import main; sys.exit(main())"


@dataclass(frozen=True)
class Subject:
    """A program, and what is wanted of its verification: seconds of wall time, null: nothing."""

    name: str
    program: str
    cold_s: float | None
    warm_s: float | None


SUBJECTS = (
    Subject("cart", "examples/wall/cart.soter", None, 3.0),
    Subject("drone", "examples/drone/motion_primitive.soter", 15.0, None),
    Subject("mountain car", "examples/mountain_car/cliff.soter", None, None),
)


@dataclass(frozen=True)
class Run:
    """One process."""

    wall_s: float
    cpu_s: float
    verdict: str
    properties: dict[str, str]


@dataclass(frozen=True)
class Times:
    """What a subject took: medians, and the best run."""

    wall_s: float
    best_wall_s: float
    cpu_s: float
    best_cpu_s: float


def run(program: str, cache: Path) -> Run:
    """Verify once. A run without a verdict is an error."""
    environment = {**os.environ, "SOTER_CACHE": str(cache)}
    command = [sys.executable, "-c", START, "verify", program, "--json"]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    wall = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    report = json.loads(done.stdout)
    if "modules" not in report:
        sys.exit(f"{program}: {report.get('diagnostics')}")
    properties = {
        name: finding["verdict"]
        for module in report["modules"].values()
        for name, finding in module["properties"].items()
    }
    return Run(wall, cpu, report["verdict"], properties)


def times_of(runs: list[Run]) -> Times:
    """Medians and best."""
    walls, cpus = [r.wall_s for r in runs], [r.cpu_s for r in runs]
    return Times(statistics.median(walls), min(walls), statistics.median(cpus), min(cpus))


def measured(subject: Subject, repeats: int) -> tuple[list[Run], list[Run]]:
    """Cold and warm runs, turn by turn; every cold one in a folder of its own."""
    cold, warm = [], []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory(prefix="soter-bench-") as folder:
            cold.append(run(subject.program, Path(folder)))
            warm.append(run(subject.program, Path(folder)))
    return cold, warm


def row(subject: Subject, what: str, times: Times, target: float | None) -> tuple[str, ...]:
    """One line of the table."""
    said = "" if target is None else f"<= {target:g} s"
    held = "" if target is None else "NO"
    if target is not None and min(times.best_cpu_s, times.best_wall_s) <= target:
        held = "yes" if times.best_wall_s <= target else "if idle"
    return (
        subject.name,
        what,
        f"{times.wall_s:.2f} s",
        f"{times.best_wall_s:.2f} s",
        f"{times.cpu_s:.2f} s",
        f"{times.best_cpu_s:.2f} s",
        said,
        held,
    )


def main() -> int:
    """Measure, print the table and the verdicts; 1 where a verdict is not `proved`."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    rows, figures, verdicts = [], {}, []
    unproved = 0
    for subject in SUBJECTS:
        cold, warm = measured(subject, arguments.repeats)
        both = {"cold": times_of(cold), "warm": times_of(warm)}
        rows.append(row(subject, "cold", both["cold"], subject.cold_s))
        rows.append(row(subject, "warm", both["warm"], subject.warm_s))
        last = warm[-1]
        wrong = [r for r in (*cold, *warm) if r.verdict != "proved"]
        unproved += bool(wrong)
        verdicts.append(f"{subject.name}: {(wrong or [last])[0].verdict}")
        figures[subject.name] = {
            **{name: asdict(times) for name, times in both.items()},
            "verdict": (wrong or [last])[0].verdict,
            "properties": last.properties,
            "runs": arguments.repeats,
        }
    heads = ("module", "cache", "wall", "best", "CPU", "best CPU", "target (wall)", "met")
    print(table(heads, rows))
    print("verdicts: " + ", ".join(verdicts))
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(f"load of the machine at the end (1, 5, 15 minutes): {load}; {os.cpu_count()} cores")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 1 if unproved else 0


if __name__ == "__main__":
    sys.exit(main())
