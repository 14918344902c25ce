"""What one check of a decision module that follows SC costs, in C at -O2 on this machine.

    .venv/bin/python bench/tubes/check_cost.py [--draws N] [--board mps2-an500] [PROGRAM ...]

For each program with `rest` (examples/rest and examples/evidence/follow.soter) the check that flies
is compiled and asked of estimates that are drawn in the ranges below: mean and largest microseconds
of the processor, the share that is good, and how quick the machine is (`loop_s`). The largest of
single calls holds what else the machine did meanwhile; so each call is tried three times, and its
least time counts. With `--board` the first thousand instants of each program fly in QEMU: what a
step of the DM takes there, and what that comes to at `CLOCK_HZ` with `CLOCKS` an instruction.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cffi

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT))

import soter  # noqa: E402 - needs the path
from soter.api.deploy.building import built_image, stack_bound  # noqa: E402
from soter.codegen.unit import generate  # noqa: E402
from soter.diagnostics.diagnostic import SoterError  # noqa: E402
from soter.language.front_end import check_file, system_of, system_to_prove  # noqa: E402
from soter.native.compiler import compile_with, find_compiler  # noqa: E402
from soter.native.shared_library import CHECK_FAILED, RUNTIME, library_flags  # noqa: E402
from soter.report.tables import table  # noqa: E402
from soter.verify.deploy.missing_predicates import rest_claims  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402
from soter.verify.tubes.problem import TubeProblem  # noqa: E402
from soter.verify.tubes.tube_check import TubeCheck  # noqa: E402

RANGES: dict[str, list[tuple[float, float]]] = {
    "follow": [(0, 100), (0, 390), (0, 30)],
    "cruise": [(2, 120), (0, 36), (0, 36)],
    "lane": [(-1.2, 1.2), (-0.15, 0.15)],
    "hall": [(0.6, 15.4), (0.6, 9.4), (-3, 3), (-0.5, 1.5), (-2, 2)],
    "bicycle": [(-5, 55), (-10, 35), (-3, 3), (0, 12), (-0.45, 0.45)],
    "dive": [(50, 2500), (150, 270), (-0.75, 0.4), (-0.75, 0.4), (-0.75, 0.4), (-0.8, 0.8)],
    "docking": [(-60, 60), (-120, -20), (-0.5, 0.5), (-0.5, 0.5)],
    "docking_3d": [
        (-60, 60), (-120, -20), (-60, 60), (-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5),
    ],
    "hills": [(10, 30)],
    "pull_up": [(50, 1200), (-0.5, 0.3), (-0.5, 3)],
    "slip": [(-5.5, 5.5), (-3.2, 3.2), (-0.5, 1.6)],
    "swerve": [(0, 60), (-1, 1), (-0.3, 0.3), (0, 22)],
    "quadrotor": [(-6, 6), (1, 7), (-2.5, 2.5), (-1.5, 1.5), (-0.3, 0.3), (-1.5, 1.5)],
}  # fmt: skip
"""Of estimates, in the order of the states."""
RANGES["obstacles"] = RANGES["bicycle"]
MAPS = {
    "obstacles": [
        25.0, 10.0, 60.0, 25.0, -4.0, 1.0, 30.0, 8.0, 1.5, 53.0, 12.0, 1.0, 24.0, 19.0, 2.0,
    ],
}  # fmt: skip
"""What a program that reads a map is asked with: four of its pillars."""
CLOCK_HZ, CLOCKS = 480e6, 2.0
"""Of a Cortex-M7 as they are sold; what an instruction takes there is stated, not measured."""
WRAP = """
#include "probe.c"
#include <time.h>
static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}
int ask(double *estimate, double *us) {
  PROBE_ARRAY x;
  int good = 0;
  soter_fault fault;
  memcpy(&x, estimate, sizeof x);
  *us = 1e300;
  for (int k = 0; k < 3; k++) {
    memset(&fault, 0, sizeof fault);
    const double began = now();
    good = PROBE_CALL && !fault;
    const double took = now() - began;
    if (took < *us) *us = took;
  }
  return good;
}
"""


def loop_s() -> float:
    """Processor seconds of three million turns of a loop with a product and a remainder."""
    began, x = time.process_time(), 1
    for _ in range(3_000_000):
        x = x * 7 % 1_000_003
    return time.process_time() - began


def built(path: Path, folder: Path) -> tuple[Any, Any, int]:
    """The library of one check, and how many numbers an estimate has."""
    checked = check_file(str(path), path.read_text(encoding="utf-8"))
    flat = system_to_prove(checked, None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    check = TubeCheck(problem)
    n = len(check.states)
    known = MAPS.get(path.stem)
    given = "" if known is None else f", {known}"
    probe = f"""soter 1;
{check.text_in_flight(rest_claims(check).ways)}
fun asked(x: float[{n}]): bool {{ return good(x{given}); }}
topic done: bool = false;
node Probe period 10ms {{
  publishes done;
  var x: float[{n}];
  step {{ publish done = asked(x); }}
}}
system Probing default {{ node Probe; until 1s; }}
"""
    unit = generate(system_of(check_file("probe.soter", probe), "Probing"), prefix="probe")
    (folder / "probe.h").write_text(unit.header, encoding="utf-8")
    (folder / "probe.c").write_text(unit.source, encoding="utf-8")
    faults = re.search(r"probe_asked_fn\([^;{]*fault", unit.source)
    call = f"probe_asked_fn(x{', &fault' if faults else ''})"
    text = WRAP.replace("PROBE_CALL", call).replace("PROBE_ARRAY", f"probe_double_{n}")
    (folder / "wrap.c").write_text(text, encoding="utf-8")
    library = folder / "wrap.so"
    command = [*find_compiler().command, *library_flags(), "-w", "-D_POSIX_C_SOURCE=199309L"]
    command += [f"-I{RUNTIME}", "-o", str(library), str(folder / "wrap.c"), str(CHECK_FAILED)]
    compile_with([*command, "-lm"], folder, "the check does not compile")
    ffi = cffi.FFI()
    ffi.cdef("int ask(double *estimate, double *us);")
    return ffi, ffi.dlopen(str(library)), n


def on_board(path: Path, board: str) -> list[str]:
    """A row: what a step of the DM takes, in instructions, bytes and shares of its period."""
    program = soter.load(path)
    with tempfile.TemporaryDirectory() as name:
        package = program.build("cortex-m", Path(name) / "out", board=board)
        stack = stack_bound(package, board)
        try:
            image = built_image(package, board, stack)
        except SoterError as error:  # X015
            what = error.diagnostics[0].message.split(": ")[-1]
            return [path.stem, *["-"] * 4, "no", "-", what, "-"]
    assert image is not None
    (step,) = [s for s in image.steps if s.name.endswith(".dm")]
    (module,) = program.flat().modules
    period_ms = module.period_ns / 1e6
    most_ms = 1e3 * step.most * CLOCKS / CLOCK_HZ
    return [
        path.stem,
        f"{step.mean:,}",
        f"{step.most:,}",
        f"{most_ms:.1f} ms",
        f"{period_ms:.0f} ms",
        "yes" if most_ms <= period_ms else "no",
        f"{image.flash:,}",
        f"{image.stack_used:,}",
        "same" if image.same_as_host else "-",
    ]


def main() -> None:
    """One line a program."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=2000)
    every = [*sorted((ROOT / "examples" / "rest").glob("*.soter"))]
    every.append(ROOT / "examples" / "evidence" / "follow.soter")
    parser.add_argument("programs", type=Path, nargs="*", default=every)
    parser.add_argument("--board", help="a board that QEMU emulates")
    given = parser.parse_args()
    if given.board:
        heads = ["a step of the DM", "on average", "at most", "takes", "period", "inside"]
        rows = [on_board(path, given.board) for path in given.programs]
        print(table([*heads, "flash", "stack", "trace"], rows))
        return
    for path in given.programs:
        rng = random.Random(path.stem)  # noqa: S311 - drawn estimates
        with tempfile.TemporaryDirectory() as name:
            ffi, library, n = built(path, Path(name))
            us = ffi.new("double *")
            times, good = [], 0
            assert len(RANGES[path.stem]) == n
            for _ in range(given.draws):
                estimate = ffi.new("double[]", [rng.uniform(*r) for r in RANGES[path.stem]])
                good += library.ask(estimate, us)
                times.append(us[0])
        print(
            f"{path.stem}: mean {sum(times) / len(times):.0f} us, largest {max(times):.0f} us, "
            f"good {good / len(times):.0%} of {len(times):,}, loop {loop_s():.2f} s"
        )


if __name__ == "__main__":
    main()
