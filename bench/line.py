"""Append a line of figures to docs/benchmarks/line.jsonl, and draw all lines again.

    make bench-line       (or: .venv/bin/python bench/line.py [--draw])

Purpose: figures of each change, committed with it, which take under five minutes of a processor:
lines of each room of src; `soter check` beside `import numpy`; a proof, its re-check, and what came
of both; escapes in ten seconds of bench/verify/soundness.py; slips of newcomers; hashes of the
outputs of a dozen examples. Times are ratios of times of a processor. `commit` is the one on which
the change stands. `--draw` measures nothing and writes docs/img/line.svg.
Non-goals: judging; targets stand in docs/benchmarks.md.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "docs" / "site")]

from bench.house.example_outputs import EXAMPLES, hashes_of  # noqa: E402 - needs the path
from bench.house.house_figures import beside_numpy  # noqa: E402
from bench.recheck.beside_verify import measure  # noqa: E402
from bench.run_all import machine, now  # noqa: E402
from line_picture import LINES, PICTURE, drawn, read_lines  # noqa: E402

from unit.test_house_figures import sizes  # noqa: E402

PROOF = "wall/brake.soter"
SOUNDNESS = ("bench/verify/soundness.py", "--problems", "8", "--steps", "4e5")
ESCAPES = re.compile(r"^([\d,]+) adversarial steps; escapes: (\d+)", re.MULTILINE)
SLIPS = re.compile(r"^all +(\d+) +\d+ +\d+ +(\d+) +(\d+) ", re.MULTILINE)
"""Of the row of all slips: how many, place and remedy right, misleading."""


def figures_of(pattern: re.Pattern[str], *words: str) -> list[int]:
    """The figures that a pattern finds in what a benchmark prints."""
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False
    )
    found = pattern.search(done.stdout)
    if found is None:
        raise ValueError(f"{words[0]} printed no such figures:\n{done.stdout}{done.stderr}")
    return [int(x.replace(",", "")) for x in found.groups()]


def proof_figures() -> dict[str, Any]:
    """Of one example: exit codes of proof and re-check, and the ratio of their times."""
    row = measure(ROOT / "examples" / PROOF)
    assert row is not None, "it has a `verify` block"
    ratio = round(row.recheck.cpu_s / row.verify.cpu_s, 2)
    return {
        "program": PROOF,
        "verify": row.verify.code,
        "recheck": row.recheck.code,
        "recheck_beside_verify": ratio,
    }


def measured() -> dict[str, Any]:
    """A line."""
    made, commit = now()
    steps, escapes = figures_of(ESCAPES, *SOUNDNESS)
    slips, right, misleading = figures_of(SLIPS, "bench/newcomers/slips.py")
    with tempfile.TemporaryDirectory(prefix="soter-line-") as folder:
        outputs = {name: hashes_of(name, Path(folder)) for name in EXAMPLES}
    return {
        "made": made,
        "commit": commit,
        "machine": machine(),
        "lines": {room: of["all"] for room, of in sizes().items()},
        "check_beside_numpy": {name: round(x, 2) for name, x in beside_numpy()},
        "proof": proof_figures(),
        "soundness": {"steps": steps, "escapes": escapes},
        "slips": {"all": slips, "right": right, "misleading": misleading},
        "outputs": outputs,
    }


def main() -> int:
    """Measure, append, draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draw", action="store_true", help="only draw")
    if not parser.parse_args().draw:
        line = json.dumps(measured(), sort_keys=True)
        with LINES.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
        print(line)
    PICTURE.write_text(drawn(read_lines()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
