"""Honest modules of other kinds than carts: verdicts, times, and the share of P2b.

    .venv/bin/python bench/verify/generality.py [--json FILE] [--recheck] [--only NAME ...]
        [--program FILE ...]

Every program of `examples/generality` is verified cold: a process of its own, imports included, and
an empty cache folder, so that the engine, the enclosures and the decision module are compiled as
well. CPU is user and system time of the process and all its children; the target is 30 s on two
idle cores, so half of it is what an idle machine may take at best. With `--recheck` a certificate
is written and checked, also timed; `/ verify` is the CPU time of that over the one of the proof.
Purpose: that a person's own module is proved, soon, and that P2b takes no longer than the rest.
Non-goals: the shipped modules (`beside_verify.py`), wrong programs (`mutants.py`).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from soter.report.terminal_tables import table

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ROOT / "examples" / "generality"
START = "import sys; from soter.cli.main import main; sys.exit(main())"
TARGET_S = 30.0


@dataclass(frozen=True)
class Spent:
    """One process: seconds, exit status, what it said."""

    wall_s: float
    cpu_s: float
    code: int
    said: str


@dataclass(frozen=True)
class Row:
    """What is known of one program."""

    program: str
    verdict: str
    unproved: tuple[str, ...]
    wall_s: float
    cpu_s: float
    engine_s: float
    """Of the wall time, what the properties took."""
    p2b_s: float
    shares: dict[str, float]
    recheck: str
    recheck_wall_s: float
    recheck_cpu_s: float

    @property
    def p2b_share(self) -> float:
        """Of the time that all properties took."""
        return self.p2b_s / self.engine_s if self.engine_s else 0.0


def spent(arguments: list[str], cache: Path) -> Spent:
    """Runs soter once."""
    environment = {**os.environ, "SOTER_CACHE": str(cache)}
    command = [sys.executable, "-c", START, *arguments]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    wall = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return Spent(wall, cpu, done.returncode, done.stdout or done.stderr)


def row_of(program: Path, recheck: bool) -> Row:
    """Verifies a program, and has its certificate checked."""
    with tempfile.TemporaryDirectory(prefix="soter-bench-") as folder:
        cache, certificate = Path(folder) / "cache", Path(folder) / "certificate"
        name = str(program.relative_to(ROOT))
        run = spent(["verify", name, "--json"], cache)
        report = json.loads(run.said)
        if "modules" not in report:
            sys.exit(f"{name}: {report.get('diagnostics')}")
        said, times = "", (0.0, 0.0)
        if recheck:
            spent(["verify", name, "--cert", str(certificate)], cache)
            checked = spent(["recheck", str(certificate)], cache)
            lines = [line.strip() for line in checked.said.splitlines() if line.strip()]
            first = lines[0] if lines else ""
            said = f"{checked.code}: {first.replace(str(certificate), '').replace('    ', '  ')}"
            times = (checked.wall_s, checked.cpu_s)
    modules = list(report["modules"].values())
    properties = [(p, f) for m in modules for p, f in m["properties"].items()]
    seconds = {p: sum(float(f["seconds"]) for q, f in properties if q == p) for p, _ in properties}
    unproved = (p for p, f in properties if f["verdict"] not in ("proved", "assumed"))
    given = [m["shares"]["lets_ac"] for m in modules if "lets_ac" in m.get("shares", {})]
    return Row(
        program.stem,
        report["together"],
        tuple(dict.fromkeys(unproved)),
        run.wall_s,
        run.cpu_s,
        sum(seconds.values()) - _counted_twice(seconds),
        seconds["P2b"],
        {"lets_ac": min(given)} if given else {},
        said,
        *times,
    )


def _counted_twice(seconds: dict[str, float]) -> float:
    """P3 counts `ttf` and `safer` again."""
    return min(seconds["P3"], seconds["ttf"] + seconds["safer"])


def main() -> int:
    """Measure and print; 1 where something is not proved or takes too long."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--recheck", action="store_true")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--program", type=Path, nargs="*", help="these in place of the folder's")
    arguments = parser.parse_args()
    programs = [p for p in sorted(PROGRAMS.glob("*.soter"))
                if not arguments.only or p.stem in arguments.only]  # fmt: skip
    programs = [p.resolve() for p in arguments.program] if arguments.program else programs
    rows = [row_of(p, arguments.recheck) for p in programs]
    heads = ["module", "verdict", "wall", "CPU", "CPU / 2", "P2b of it", "AC", "<= 30 s"]
    heads += ["recheck", "CPU", "/ verify"] if arguments.recheck else []
    lines = []
    for r in rows:
        line = [
            r.program,
            r.verdict + (f" ({', '.join(r.unproved)})" if r.unproved else ""),
            f"{r.wall_s:.1f} s",
            f"{r.cpu_s:.1f} s",
            f"{r.cpu_s / 2:.1f} s",
            f"{100 * r.p2b_share:.0f} %",
            f"{100 * r.shares['lets_ac']:.0f} %" if "lets_ac" in r.shares else "",
            "yes" if r.wall_s <= TARGET_S else "if idle" if r.cpu_s / 2 <= TARGET_S else "NO",
        ]
        if arguments.recheck:
            ratio = f"{r.recheck_cpu_s / r.cpu_s:.2f}"
            line += [r.recheck, f"{r.recheck_cpu_s:.1f} s", ratio]
        lines.append(tuple(line))
    print(table(tuple(heads), lines))
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(f"load of the machine at the end (1, 5, 15 minutes): {load}; {os.cpu_count()} cores")
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(r) for r in rows], indent=2) + "\n")
    bad = [r for r in rows if r.verdict != "proved" or r.cpu_s / 2 > TARGET_S]
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
