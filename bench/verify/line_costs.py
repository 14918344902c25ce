"""What one more line of a program costs: CPU time of `soter build --target c`, before and after.

    .venv/bin/python bench/verify/line_costs.py [--json FILE] [--program NAME]

Each build is a process of its own, compilers and imports included, with a cache folder in which
another small program was built before: the engine is there, nothing of the program is. CPU is user
and system time of it and its children. `ttf` and `safer` are left to be computed.
Purpose: ten changes, a line or a module each, of two programs; a factor of more than 3 is marked.
Non-goals: runs and proofs of what is built; wall times.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from soter.report.terminal_tables import table

ROOT = Path(__file__).resolve().parents[2]
START = "import sys; from soter.cli.main import main; sys.exit(main())"
FACTOR = 3.0
"""More than so often the CPU time of the program as it is wants a reason."""
ROWS = 250_000
"""Numbers of a large table, 2 MB."""
DATA = f'\nconst ROWS: float[{ROWS}] = data "rows.npy";\n\nsystem '
SMALL = (ROOT / "examples" / "generality" / "altitude.soter").read_text(encoding="utf-8")
"""What was built before."""
Changes = dict[str, tuple[str, str]]

CART: Changes = {
    "levels 4": ("acts within 1ms;", "acts within 1ms;\n    levels 4;"),
    "shield 8": ("safe Clear(motion);", "safe Clear(motion);\n  shield 8;"),
    "failsafe": ("safe Clear(motion);", "safe Clear(motion);\n  failsafe accel = 0.0;"),
    "a contract": ("motion, goal;", "motion, goal;\n  guarantees abs(accel) <= A;"),
    "a queue": (
        """goal;
  publishes accel;
  step {
    publish accel = clamp(4.0 * (goal""",
        """goal queue 4;
  publishes accel;
  step {
    let to = goal.len > 0 ? goal[0] : 0.0;
    publish accel = clamp(4.0 * (to""",
    ),
    "a large table": ("clamp(4.0 *", "clamp(ROWS[0] + 4.0 *"),
    "a smaller max_age": ("max_age 20ms", "max_age 10ms"),
}
TRUCK: Changes = {
    "levels 3": ("levels 2;", "levels 3;"),
    "shield 8": ("safe upright(truck);", "safe upright(truck);\n  shield 8;"),
    "failsafe": (
        "safe upright(truck);",
        "safe upright(truck);\n  failsafe command = { lift: 0.0, drive: 0.0 };",
    ),
    "a contract": ("shelf, speed;", "shelf, speed;\n  guarantees abs(command.drive) <= A;"),
    "a queue": (
        """shelf, speed;
  publishes command;
  step {
    publish command = {
      lift: clamp(2.0 * (shelf""",
        """shelf queue 4, speed;
  publishes command;
  step {
    let up = shelf.len > 0 ? shelf[0] : 0.5;
    publish command = {
      lift: clamp(2.0 * (up""",
    ),
    "a large table": ("clamp(3.0 *", "clamp(ROWS[0] + 3.0 *"),
    "a smaller max_age": ("max_age 20ms", "max_age 15ms"),
}
SUBJECTS = {
    "cart": ("examples/wall/cart.soter", CART),
    "truck": ("bench/verify/truck.soter", TRUCK),
}
PREDICATES = re.compile(r"^  (ttf|safer) .*\n", re.MULTILINE)
DECLARED = re.compile(r"^(?:input )?(?:type|topic|fun|plant|node|rta) (\w+)", re.MULTILINE)
SYSTEM = re.compile(r"^system (\w+) default (\{.*?^\}\n)", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Row:
    """A build: CPU seconds, and how often that of the program as it is."""

    program: str
    change: str
    cpu_s: float
    factor: float
    said: str
    """The first line of what went wrong; "" where it was built."""


def programs(name: str) -> dict[str, str]:
    """The program as it is under "", and every changed one, by what was changed."""
    file, changes = SUBJECTS[name]
    text = PREDICATES.sub("", (ROOT / file).read_text(encoding="utf-8"))
    made = {"": text} | {what: changed(text, change) for what, change in changes.items()}
    made["a large table"] = made["a large table"].replace("\nsystem ", DATA, 1)
    levels = next(iter(changes))
    made[f"failsafe, {levels}"] = changed(made["failsafe"], changes[levels])
    default = SYSTEM.search(text)
    assert default is not None
    made["a second system"] = f"{text}\nsystem Second {default[2]}"
    made["a second module"] = with_second_module(text)
    return made


def changed(text: str, change: tuple[str, str]) -> str:
    """The first place only."""
    assert change[0] in text, change
    return text.replace(*change, 1)


def with_second_module(text: str) -> str:
    """All that is declared before the systems once more, under other names."""
    body = text[text.index("\ntype ") : text.index("\nsystem ")]
    again = body
    for name in DECLARED.findall(body):
        again = re.sub(rf"\b{name}\b", f"{name}2", again)
    (plant,), (module,) = (
        re.findall(rf"^{k} (\w+)", again, re.MULTILINE) for k in ("plant", "rta")
    )
    more = f" default {{\n  second: {plant};\n  module {module};\n"
    return changed(text.replace(body, body + again), (" default {\n", more))


def build(text: str, warm: Path) -> tuple[float, str]:
    """CPU seconds of a build of the default system, and what it said where it failed.

    `warm`: a cache folder, of which it gets a copy.
    """
    with tempfile.TemporaryDirectory() as folder:
        if warm.exists():
            shutil.copytree(warm, Path(folder) / "cache")
        (Path(folder) / "program.soter").write_text(text, encoding="utf-8")
        np.save(Path(folder) / "rows.npy", np.zeros(ROWS))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [sys.executable, "-c", START, "build", "program.soter", "--target", "c", "-o", "out"],
            cwd=folder,
            env={**os.environ, "SOTER_CACHE": str(Path(folder) / "cache")},
            capture_output=True,
            text=True,
            check=False,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if not warm.exists():
            shutil.copytree(Path(folder) / "cache", warm)
    cpu_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return cpu_s, "" if done.returncode == 0 else (done.stderr.strip() or "failed").splitlines()[0]


def rows_of(name: str, warm: Path) -> list[Row]:
    """The program as it is first."""
    rows: list[Row] = []
    build(SMALL, warm)
    for what, text in programs(name).items():
        cpu_s, said = build(text, warm)
        rows.append(
            Row(name, what or "as it is", cpu_s, cpu_s / (rows[0].cpu_s if rows else cpu_s), said)
        )
        print(f"{name}: {rows[-1].change}: {cpu_s:.1f} s {said}", file=sys.stderr, flush=True)
    return rows


def main() -> int:
    """Build, and print; exit code 1 where something is not built."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--program", choices=SUBJECTS)
    arguments = parser.parse_args()
    names = [arguments.program] if arguments.program else [*SUBJECTS]
    with tempfile.TemporaryDirectory() as folder:
        rows = [row for name in names for row in rows_of(name, Path(folder) / name)]
    shown = [
        (r.program, r.change, f"{r.cpu_s:.1f} s", f"{r.factor:.2f}", r.said or marked(r))
        for r in rows
    ]
    print(table(("program", "change", "CPU", "factor", ""), shown))
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(r) for r in rows], indent=1), encoding="utf-8")
    return 1 if any(r.said for r in rows) else 0


def marked(row: Row) -> str:
    """Whether a reason is wanted."""
    return f"more than {FACTOR:g}" if row.factor > FACTOR else ""


if __name__ == "__main__":
    sys.exit(main())
