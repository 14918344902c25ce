"""How much stack the trusted part of the examples needs at most, by gcc and by clang.

    .venv/bin/python bench/c_code/stack_bounds.py

Purpose: issue 14's "stack bound, 8 KiB for the trusted drone": the bound of `soter build` for each
example, and the function whose way it is.
Non-goals: other processors; what is really used (tests/correct/test_firmware.py).
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import soter
from soter.api.deploying import stack_bound
from soter.native.compiler import find
from soter.report.terminal_tables import table

ROOT = Path(__file__).resolve().parents[2]
TARGET = 8 * 1024
KERNEL = ("soter_firmware_step", "run_step", "dm_step")
EXAMPLES = (
    "wall/cart_firmware",
    "wall/lift",
    "drone/motion_primitive",
    "drone/corridor",
    "drone/surveillance",
)


def row(example: str, compilers: list[str]) -> list[str]:
    """Name, bytes by each compiler, whether all fit, the last function of the first one's way."""
    program = soter.load(ROOT / "examples" / f"{example}.soter")
    bounds = []
    with tempfile.TemporaryDirectory() as folder:
        package = program.build("c", Path(folder) / "out")
        for name in compilers:
            os.environ["SOTER_CC"] = name
            find.cache_clear()
            bounds.append(stack_bound(package))
    sizes = ["-" if s.bytes is None else f"{s.bytes}" for s in bounds]
    fits = all(s.bytes is not None and s.bytes <= TARGET for s in bounds)
    steps = [w for w in bounds[0].way if w.endswith("_step") and w not in KERNEL]
    return [example, *sizes, "yes" if fits else "no", steps[-1] if steps else bounds[0].why]


def main() -> int:
    """Print the table."""
    compilers = [c for c in ("gcc", "clang") if shutil.which(c)]
    rows = [row(example, compilers) for example in EXAMPLES]
    heads = ["example", *(f"{c}, bytes" for c in compilers), "<= 8 KiB", "the dearest step"]
    print(table(heads, rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
