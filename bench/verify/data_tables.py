"""Tables of data, of a hundred thousand to four million numbers: time and memory of every stage.

    .venv/bin/python bench/verify/data_tables.py [--numbers N ...]

For each size and kind of file a program whose node reads a row a step: `check` (read, packed and
checked), `first run` (lowered, C generated, compiled and run for 1 s, cache folder empty), `again`
(the next process, which finds the library in the cache), `step` (the run's time for one instant),
`interp` (the same run in the reference interpreter). Memory is the most that the process, and that
the compiler, held. A last line says how fast constants are computed. Exit code 1 where the engines
disagree, or a kind of file gives other bits.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

SIZES = (100_000, 1_000_000, 4_000_000)
WIDTH = 10
KINDS = ("npy", "json", "csv")
PROGRAM = """
soter 1;
const ROWS: float[{width}][{rows}] = data "rows.{kind}";
topic one: float = 0.0;
topic sum: float = 0.0;
node Look period 1ms {{
  publishes one, sum;
  var i: int = 0;
  step {{
    i = (i + 7919) % ROWS.len;
    let row = ROWS[i];
    publish one = ROWS[i][3];
    publish sum = row[0] + row[{width} - 1];
  }}
}}
system S {{ node Look; until 1s; }}
"""
STAGES = """
import json, resource, sys, time
import numpy, soter, soter.simulate.run
def timed(call):
    began = time.perf_counter()
    found = call()
    return time.perf_counter() - began, found
def held(who): return resource.getrusage(who).ru_maxrss / 1024
check_s, program = timed(lambda: soter.load(sys.argv[1]))
check_mb = held(resource.RUSAGE_SELF)
first_s, run = timed(program.simulate)
interp_s, interpreted = timed(lambda: program.simulate(engine="interp"))
print(json.dumps({
    "ok": program.ok, "check_s": check_s, "check_mb": check_mb, "first_s": first_s,
    "step_us": min(program.simulate(sha256=False, trace=False).wall_s for _ in range(5)) * 1e3,
    "interp_s": interp_s, "own_mb": held(resource.RUSAGE_SELF),
    "compiler_mb": held(resource.RUSAGE_CHILDREN),
    "trace": [run.trace_sha256, interpreted.trace_sha256],
}))
"""
CONSTANT = """
soter 1;
fun f(): int { var s = 0; for i in 0..2000 { for j in 0..2000 { s = s + 1; } } return s; }
const A: int = f();
"""
OPERATIONS = 2000 * (2 * 2000 + 2)
SPEED = """
import sys, time
from soter.language.front_end import check_file
began = time.perf_counter()
assert check_file("m.soter", sys.stdin.read()).ok
print(time.perf_counter() - began)
"""


def write_rows(folder: Path, kind: str, rows: np.ndarray[Any, Any]) -> None:
    """The data file; `rows` (n, WIDTH)."""
    if kind == "npy":
        np.save(folder / "rows.npy", rows)
        return
    lines = rows.tolist()
    text = json.dumps(lines) if kind == "json" else "\n".join(",".join(map(repr, r)) for r in lines)
    (folder / f"rows.{kind}").write_text(text)


def stages(folder: Path, main: Path) -> dict[str, Any]:
    """What one process measures."""
    environment = {**os.environ, "SOTER_CACHE": str(folder / "cache")}
    command = [sys.executable, "-c", STAGES, str(main)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    measurements: dict[str, Any] = json.loads(done.stdout)
    return measurements


def measure(numbers: int) -> bool:
    """Print a line for every kind of file; whether all traces are equal."""
    rows = np.random.default_rng(numbers).uniform(-100.0, 100.0, size=(numbers // WIDTH, WIDTH))
    traces: set[str] = set()
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_rows(folder, kind, rows)
            size_mb = (folder / f"rows.{kind}").stat().st_size / 1e6
            main = folder / "look.soter"
            main.write_text(PROGRAM.format(width=WIDTH, rows=len(rows), kind=kind))
            first, again = stages(folder, main), stages(folder, main)
            traces.update(first["trace"], again["trace"])
            print(
                f"{numbers:9,} {kind:5} {size_mb:6.1f} {first['check_s']:8.2f} "
                f"{first['first_s']:10.2f} {again['first_s']:8.2f} {first['step_us']:9.2f} "
                f"{first['interp_s']:8.2f} {first['check_mb']:9.0f} {first['own_mb']:7.0f} "
                f"{first['compiler_mb']:9.0f}",
                flush=True,
            )
    return len(traces) == 1


def main() -> int:
    """Measure all sizes; 1 where two traces differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--numbers", type=int, nargs="+", default=SIZES)
    print(
        "  numbers file      MB  check s  first run s  again s   step us interp s  check MB  all MB"
        "  compiler MB"
    )
    equal = [measure(n) for n in parser.parse_args().numbers]
    command = [sys.executable, "-c", SPEED]
    done = subprocess.run(command, input=CONSTANT, check=True, capture_output=True, text=True)
    rate = OPERATIONS / float(done.stdout) / 1e6
    print(f"constants: {rate:.1f} million operations a second; one may take 50, all 100 million")
    print("all traces of a size are equal" if all(equal) else "WRONG: traces of a size differ")
    return 0 if all(equal) else 1


if __name__ == "__main__":
    sys.exit(main())
