"""`soter test` against SPIN on two_modules: the same configurations, the same verdict, one core.

    .venv/bin/python bench/testing_spin.py [--repeats 5] [--json FILE]

The Promela models (bench/two_modules*.pml) have atomic steps, and a state of theirs at a step's
end is a configuration of examples/testing/two_modules.soter: all of them store equally many
without reduction. `two_modules.pml` is one process over what is due, the fastest we found;
`_eight` has a process for every actor; `_local` one a module with everything in local
variables, made for SPIN's partial order reduction. pan is compiled with `-DSAFETY -O2`; NOVSZ
leaves the length out of its vectors.

Turn by turn, each process on one core. CPU is user and system time: of the whole process for
pan, of the search for the explorer. Not counted: SPIN's generator and gcc; the explorer's
generator and its compiler.

Purpose: the speed figure of issue 4. Non-goals: what the reduction gains
(`testing_reduction.py`), SPIN's other strengths (LTL, for one).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from soter.report.summary import table

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = ROOT / "examples/testing/two_modules.soter"
TEST = "BothStayInside"
CHILD = """
import json, sys, time
from soter.explore.engine.engine import Engine, Settings
from soter.program.build import check_file, system_of_test
engine = Engine(system_of_test(check_file(sys.argv[1]), sys.argv[2]))
how = Settings(sys.argv[3], reduction=sys.argv[4], storage=sys.argv[5])
before = time.process_time()
found = engine.explore(how)
cpu = time.process_time() - before
print(json.dumps([found.status, found.states, found.transitions, found.seconds, cpu]))
"""
OPTIONS = {
    "two_modules": (("-DNOREDUCE",), ("-DNOREDUCE", "-DNOVSZ"), ()),
    "two_modules_eight": (("-DNOREDUCE",), ()),
    "two_modules_local": (("-DNOREDUCE",), ()),
}
HASH = ("22", "23")
"""pan -w: 2^22 and 2^23 slots, best of 21 to 24."""


@dataclass
class Way:
    """One way to search, and what its runs gave. `reduced`: not all configurations are stored."""

    name: str
    command: tuple[str, ...]
    reduced: bool = False
    states: int = 0
    transitions: int = 0
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        """Seconds of CPU."""
        return statistics.median(self.cpu)


def run(command: tuple[str, ...], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: {done.stderr or done.stdout}")
    return done.stdout


def pans(folder: Path, core: str) -> list[Way]:
    """SPIN's verifiers, compiled."""
    ways = []
    for model, variants in OPTIONS.items():
        place = folder / model
        place.mkdir()
        run(("spin", "-a", str(ROOT / f"bench/{model}.pml")), place)
        for options in variants:
            pan = place / "_".join(("pan", *options))
            run(("gcc", "-DSAFETY", *options, "-O2", "-o", str(pan), "pan.c"), place)
            name = " ".join((model, *options))
            for w in HASH:
                command = ("taskset", "-c", core, str(pan), "-E", "-m200", f"-w{w}")
                ways.append(Way(f"{name} -w{w}", command, not options))
    return ways


def explorers(core: str, everything: bool) -> list[Way]:
    """The explorer's ways."""
    ways = [
        ("bfs", "none", "exact"),
        ("dfs", "none", "exact"),
        ("bfs", "sleep", "exact"),  # fewer moves, the same configurations
        ("bfs", "all", "exact"),
    ]
    if everything:
        ways += [("dfs", "all", "exact"), ("bfs", "none", "fingerprint")]
    found = []
    for strategy, reduction, storage in ways:
        command = ("taskset", "-c", core, sys.executable, "-c", CHILD, str(PROGRAM), TEST)
        name = f"soter {strategy}, {storage}, reduction {reduction}"
        found.append(Way(name, (*command, strategy, reduction, storage), reduction == "all"))
    return found


def measure(way: Way, folder: Path) -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    said = run(way.command, folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if way.name.startswith("soter"):
        status, states, transitions, wall, cpu = json.loads(said.splitlines()[-1])
        if status != "exhausted":
            sys.exit(f"{way.name}: {status}")
    else:
        if "errors: 0" not in said:
            sys.exit(said)
        states, transitions = (
            number(r"(\d+) states, stored", said),
            number(r"(\d+) transitions", said),
        )
        wall = number(r"elapsed time ([\d.]+)", said)
        cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    way.states, way.transitions = int(states), int(transitions)
    way.wall.append(float(wall))
    way.cpu.append(float(cpu))


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found is not None, text
    return float(found.group(1))


def line(w: Way) -> tuple[str, ...]:
    return (
        w.name,
        f"{w.states:,}",
        f"{w.transitions:,}",
        f"{statistics.median(w.wall):.3f} s",
        f"{w.median:.3f} s",
        f"{min(w.cpu):.3f} s",
        f"{w.states / w.median / 1e6:.2f} M/s",
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--core", default="1")
    parser.add_argument("--all", action="store_true", help="more of the explorer's ways")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="soter-bench-") as name:
        folder = Path(name)
        theirs = pans(folder, arguments.core)
        ours = explorers(arguments.core, arguments.all)
        for _ in range(arguments.repeats):
            for way in (*theirs, *ours):
                measure(way, folder)
    print(run(("spin", "-V"), ROOT).strip())
    heads = ("way", "states", "transitions", "wall", "CPU", "best CPU", "rate")
    print(table(heads, [line(w) for w in (*theirs, *ours)]))
    same = {w.states for w in (*theirs, *ours) if not w.reduced}
    print(f"states stored where none is left out: {', '.join(f'{n:,}' for n in sorted(same))}")
    best, mine = (
        min((w for w in some if not w.reduced), key=lambda w: w.median) for some in (theirs, ours)
    )
    anyhow = min(theirs, key=lambda w: w.median)
    reduced = min((w for w in ours if w.reduced), key=lambda w: w.median)
    rows = [
        ("the same configurations", best, mine, "1.5, goal 5"),
        ("the best of SPIN, reduced or not", anyhow, mine, "1.5"),
        ("both reduced", anyhow, reduced, ""),
    ]
    said = [
        (what, a.name, b.name, f"{a.median / b.median:.1f} times", target)
        for what, a, b, target in rows
    ]
    print(table(("over", "SPIN", "soter", "faster", "target"), said))
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(f"load of the machine at the end (1, 5, 15 minutes): {load}; {os.cpu_count()} cores")
    if arguments.json:
        figures = {w.name: [w.states, w.transitions, w.wall, w.cpu] for w in (*theirs, *ours)}
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 0 if len(same) == 1 and best.median >= 1.5 * mine.median else 1


if __name__ == "__main__":
    sys.exit(main())
