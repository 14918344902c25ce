"""How long a generated decision module takes: one call of `decide`, on states of a run.

    .venv/bin/python bench/real_time/dm_time.py

Purpose: issue 3's "DM <= 1 us": cart (predicates written, and computed), drone's motion primitive,
mountain car (computed). Every state of a run is decided on again and again; the fastest and the
median round are printed, per call, and the bytes of the tables.
Non-goals: worst-case times on a microcontroller.
"""

from __future__ import annotations

import re
import statistics
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI

import soter
from soter.codegen.unit import generate
from soter.native.build import library
from soter.report.terminal_tables import table

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = 30
CALLS = 20_000
TARGET_NS = 1000.0
TIMER = """
#include <time.h>
double soter_bench_decide(char *states, size_t count, size_t calls);
double soter_bench_decide(char *states, size_t count, size_t calls) {{
  struct timespec a, b;
  unsigned sum = 0U;
  (void)timespec_get(&a, TIME_UTC);
  for (size_t k = 0; k < calls; k++) {{
    void *const state = states + (k % count) * {prefix}_program.state_size;
    sum += (unsigned){prefix}_program.module[0].decide(state);
  }}
  (void)timespec_get(&b, TIME_UTC);
  const double ns = (double)(b.tv_sec - a.tv_sec) * 1e9 + (double)(b.tv_nsec - a.tv_nsec);
  return sum > 4000000000U ? -1.0 : ns / (double)calls;
}}
"""


def measured(name: str, path: Path, system: str, until: str) -> list[str]:
    """A row: name, fastest and median ns a call, states, bytes of tables."""
    program = soter.load(path)
    run = program.simulate(system, until, seed=1)
    assert run.trace is not None
    flat = replace(run.system)
    flat.components = tuple(replace(x, binding=None) for x in flat.components)
    unit = generate(flat)
    text = unit.source + TIMER.format(prefix=unit.prefix)
    built = library(replace(unit, source=text, c_sources=()), extra=("-std=gnu11",))
    ffi: Any = FFI()
    ffi.cdef("double soter_bench_decide(char *states, size_t count, size_t calls);")
    lib = ffi.dlopen(str(built))
    states = np.ascontiguousarray(run.trace).view(np.uint8).reshape(len(run.trace), -1).copy()
    pointer = ffi.cast("char *", states.ctypes.data)
    times = [lib.soter_bench_decide(pointer, len(states), CALLS) for _ in range(ROUNDS)]
    size = sum(int(n) for n in re.findall(r"uint8_t at\[(\d+)\]", unit.header))
    size += sum(8 * int(n) for n in re.findall(r"double at\[(\d+)\]", unit.header))
    fast, middle = min(times), statistics.median(times)
    verdict = "yes" if middle <= TARGET_NS else "NO"
    return [name, f"{fast:.0f}", f"{middle:.0f}", verdict, f"{len(states)}", f"{size}"]


def open_cart(folder: Path) -> Path:
    """The cart with neither `ttf` nor `safer`."""
    text = (ROOT / "examples" / "wall" / "cart.soter").read_text(encoding="utf-8")
    path = folder / "open_cart.soter"
    path.write_text(re.sub(r"\n  (ttf|safer) [^\n]*", "", text), encoding="utf-8")
    return path


def main() -> None:
    """Measure and print."""
    examples = ROOT / "examples"
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            measured("cart, written", examples / "wall" / "cart.soter", "Protected", "20s"),
            measured("cart, computed", open_cart(Path(folder)), "Protected", "20s"),
            measured(
                "drone, written",
                examples / "drone" / "motion_primitive.soter",
                "Protected",
                "20s",
            ),
            measured(
                "mountain car, computed",
                examples / "mountain_car" / "cliff.soter",
                "Protected",
                "300s",
            ),
        ]
    head = ["DM", "ns a call, best", "median", "<= 1 us", "states", "table bytes"]
    print(table(head, rows))


if __name__ == "__main__":
    main()
