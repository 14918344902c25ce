"""`soter recheck` of every example beside the `soter verify` that wrote its certificate.

    .venv/bin/python bench/recheck/beside_verify.py [FILE ...]

Every program of `examples` with a `verify` block is verified in a process of its own with an empty
cache folder (engine, enclosures and decision module are compiled, too), and its certificate is
checked in another one. Wall time, and processor time of all threads and children.
Purpose: that everybody can wait for a re-check: `MOST_S` of processor time each, `MEDIAN_S` in the
middle. (That it takes no longer than the proof was asked until decision 283.)
Non-goals: whether changed certificates are noticed (`corruptions.py`).
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from soter.report.tables import table

ROOT = Path(__file__).resolve().parents[2]
MOST_S, MEDIAN_S = 600.0, 60.0
"""Seconds of processor time of all processes of a re-check, at most, and in the middle."""
ACCEPTED = (0, 4)
"""Exits: accepted; in part, where `verify` has not proved all."""


@dataclass(frozen=True)
class Spent:
    """One process: its times in s, its exit code, what it wrote."""

    wall_s: float
    cpu_s: float
    code: int
    output: str


@dataclass(frozen=True)
class Row:
    """Both commands for one program."""

    program: str
    verify: Spent
    recheck: Spent

    @property
    def met(self) -> bool:
        """Whether the re-check accepts all that is claimed, in at most `MOST_S`."""
        return self.recheck.code in ACCEPTED and self.recheck.cpu_s <= MOST_S


def spent(arguments: list[str], cache: Path) -> Spent:
    """Runs soter once."""
    environment = {**os.environ, "SOTER_CACHE": str(cache)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "soter", *arguments],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    wall = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return Spent(wall, cpu, done.returncode, done.stdout or done.stderr)


def measure(program: Path) -> Row | None:
    """Proves and checks a program; None where it has nothing that `verify` could write."""
    name = str(program.relative_to(ROOT))
    with tempfile.TemporaryDirectory(prefix="soter-bench-") as place:
        folder, cache = Path(place) / "certificate", Path(place) / "cache"
        proof = spent(["verify", name, "--cert", str(folder)], cache)
        if not folder.exists():
            return None
        return Row(name, proof, spent(["recheck", str(folder)], cache))


def programs() -> list[Path]:
    """Every example with a `verify` block, and the drone whose modules have theirs elsewhere."""
    every = sorted((ROOT / "examples").glob("*/*.soter"))
    return [
        p
        for p in every
        if p.name == "surveillance.soter"
        or any(x.split()[:1] == ["verify"] for x in p.open(encoding="utf-8"))
    ]


def said_of(recheck: Spent) -> str:
    """What was not accepted, in words."""
    first = (recheck.output.strip().splitlines() or [""])[0]
    without = re.search(r"(without .*?)  ", first)
    return "" if recheck.code == 0 else without[1] if without else first.split(" ")[0]


def line_of(row: Row) -> tuple[str, ...]:
    """A row as it is shown."""
    proof = row.verify
    return (
        row.program.removeprefix("examples/"),
        f"{proof.wall_s:.1f} s",
        f"{proof.cpu_s:.1f} s",
        f"{row.recheck.wall_s:.1f} s",
        f"{row.recheck.cpu_s:.1f} s",
        f"{row.recheck.cpu_s / proof.cpu_s:.1f}",
        "" if row.met else "missed",
        said_of(row.recheck),
    )


def main() -> int:
    """Measure and print; 1 where a re-check takes longer than it may, or does not accept."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("program", type=Path, nargs="*", help="by default every example")
    given = parser.parse_args()
    rows: list[Row] = []
    for program in [p.resolve() for p in given.program] or programs():
        row = measure(program)
        if row is not None:
            rows.append(row)
            print("  ".join(line_of(row)), file=sys.stderr, flush=True)
    heads = ("program", "verify", "CPU", "recheck", "CPU", "ratio", "", "")
    print(table(heads, [line_of(r) for r in rows], color=False))
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    median = statistics.median(r.recheck.cpu_s for r in rows)
    print(f"{sum(r.met for r in rows)} of {len(rows)} accepted within {MOST_S:.0f} s of CPU")
    print(f"median {median:.1f} s of CPU (target {MEDIAN_S:.0f})")
    print(f"load of the machine at the end (1, 5, 15 minutes): {load}; {os.cpu_count()} cores")
    return 0 if all(r.met for r in rows) and median <= MEDIAN_S else 1


if __name__ == "__main__":
    sys.exit(main())
