"""The explorer against the brute-force enumerator on random small programs.

    .venv/bin/python bench/testing/soundness.py [--programs 500]

Per program every reduction, two threads, fingerprints, and the
least trace to every violation; tests/generators/explorer_agreement.py says what has to be equal.

Purpose: the soundness figure of issue 4. Non-goals: speed; programs of other kinds (`make soak`).
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from itertools import islice
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from generators.explorer_agreement import REDUCTIONS, compared, small_ones  # noqa: E402 - from tests/
from soter.report.tables import table  # noqa: E402 - after the path


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--programs", type=int, default=500)
    arguments = parser.parse_args()
    began = time.perf_counter()
    states: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    different = largest = violated = finer = ends = joined = 0
    for s in islice(small_ones(0), arguments.programs):
        told = compared(s, ("-O1",))
        if told.complaints:
            different += 1
            print(f"program {s.seed}:", *told.complaints, sep="\n  ", flush=True)
        violated += bool(s.found.least)
        if not s.found.least:  # elsewhere searches end where they find something
            states.update(told.states)
        kinds.update({what for what, _ in s.found.least})
        finer += told.twice > 0
        ends += told.ends
        joined += told.joined
        largest = max(largest, len(s.found.configurations))
    whole = states["none"] or math.nan  # no program may be clean
    rows = [(r, f"{states[r]:,}", f"{states[r] / whole:.2f}") for r in REDUCTIONS]
    print(table(("reduction", "configurations of the clean programs", "share"), rows))
    breakdown = ", ".join(f"{what} {n}" for what, n in sorted(kinds.items()))
    print(
        f"{arguments.programs} programs, {violated} of them violated ({breakdown}), at most "
        f"{largest:,} configurations; {ends} where only ends of instants are stored, "
        f"{joined} with parts that only properties join; "
        f"{finer} stored more finely than needed; "
        f"{different} differ (target: none); "
        f"{time.perf_counter() - began:.0f} s"
    )
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
