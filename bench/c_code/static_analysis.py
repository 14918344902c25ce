"""Frama-C's EVA over the C that flies: every alarm, and why it is none.

    .venv/bin/python bench/c_code/static_analysis.py [PROGRAM ...]

Purpose: the run-time and the generated C of each program, from any seed, run for ever: no
read or write outside of what is there, no overflow, no division by zero, no shift, no pointer that
is none. Numbers are IEEE's (NaN and infinities are values of the language, so they are no alarm).
Every alarm has to match one line of `EXPLAINED`, else exit code 1. Needs `frama-c` of the system.
Non-goals: functional correctness: two engines compare bits for that.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import soter
from soter.report.tables import table

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ("wall/cart", "drone/motion_primitive", "drone/battery", "drone/corridor")
HARNESS = """#include "{name}.h"
#include "__fc_builtin.h"
static {name}_state state;
int main(void) {{
  uint32_t due = 0;
  soter_start(&{name}_program, &state, (uint64_t)Frama_C_unsigned_int_interval(0, 4294967295U));
  for (;;) {{
    (void)soter_virtual_instant(&{name}_program, &state, &due);
  }}
}}
"""
EXPLAINED = (
    (
        r"ct \+ info->period_ns|m->ac_ns \+|header\.ct - s\w*->stamps\[",
        "times: a sum or difference of times overflows after 2^62 ns, 146 years of one run",
    ),
    (
        r"valid_function\(\(p->component \+ \w+\)->step\)",
        "DMs have no step, and soter_fire asks none for one: EVA forgets which row it reads",
    ),
)


def alarms(text: str) -> list[str]:
    """Every alarm of a log: where it is and what would have to hold."""
    return [
        " ".join(block.removeprefix("[eva:alarm] ").split())
        for block in re.split(r"^(?=\[)", text, flags=re.MULTILINE)
        if block.startswith("[eva:alarm]")
    ]


def why(alarm: str) -> str | None:
    """The explanation of an alarm."""
    return next((said for pattern, said in EXPLAINED if re.search(pattern, alarm)), None)


def analysed(program: str) -> tuple[list[str], float]:
    """Alarms, and how long the analysis took, in s."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        name = program.rpartition("/")[2]
        soter.load(ROOT / "examples" / f"{program}.soter").build(output=folder / "c", target="c")
        harness = folder / "harness.c"
        harness.write_text(HARNESS.format(name=name), encoding="utf-8")
        sources = (f"{name}.c", "soter_kernel.c", "soter_virtual.c")
        began = time.perf_counter()
        done = subprocess.run(
            [
                *("frama-c", "-eva", "-eva-precision", "1", "-warn-special-float", "none"),
                f"-cpp-extra-args=-I{folder / 'c'} -DSOTER_UNCHECKED",
                *map(str, (harness, *(folder / "c" / s for s in sources))),
            ],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        took = time.perf_counter() - began
        if done.returncode:
            raise RuntimeError(done.stdout[-3000:] + done.stderr[-3000:])
        text = done.stdout.replace(f"{folder}/", "")
        return alarms(text), took


def main() -> int:
    """Analyse; 1 where an alarm is left, 2 without Frama-C."""
    if shutil.which("frama-c") is None:
        print("`frama-c` was not found: apt install frama-c-base")
        return 2
    rows, left = [], []
    used: dict[str, int] = {}
    for program in sys.argv[1:] or PROGRAMS:
        findings, took = analysed(program)
        unexplained = [a for a in findings if why(a) is None]
        left += [f"{program}: {a}" for a in unexplained]
        for alarm in findings:
            said = why(alarm)
            if said:
                used[said] = used.get(said, 0) + 1
        cells = (len(findings), len(findings) - len(unexplained), len(unexplained))
        rows.append([program, *map(str, cells), f"{took:.0f} s"])
    print(table(["program", "alarms", "explained", "left", "time"], rows))
    for said, times in used.items():
        print(f"{times} x {said}")
    for alarm in left:
        print(f"not explained: {alarm}")
    print(f"{len(left)} alarms are not explained: {'ok' if not left else 'missed'}")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
