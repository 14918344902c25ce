"""The explorer against the brute-force enumerator on random small programs.

    .venv/bin/python bench/testing/soundness.py [--programs 500] [--first SEED] [--json FILE]
                                          [--apart | --instants | --joined | --equal]

Per program every exhaustive strategy and every reduction, two threads, fingerprints, and the
least trace to every violation; tests/generators/explorer_agreement.py says what has to be equal.
With `--equal` programs of two or three instances that are equal, or nearly: verdicts, lengths of
traces, coverage, and one configuration stored for each orbit
(tests/generators/symmetry_agreement.py).

Purpose: the soundness figure of issue 4. Non-goals: speed.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import Counter
from itertools import islice
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from generators.equal_instance_programs import equal_instances  # noqa: E402 - from tests/
from generators.explorer_agreement import (  # noqa: E402 - from tests/
    REDUCTIONS,
    compared,
    small,
    small_ones,
)
from generators.programs_apart import program_apart  # noqa: E402 - from tests/
from generators.programs_in_instants import (  # noqa: E402 - from tests/
    program_in_instants,
    program_joined,
)
from generators.small_test_programs import small_program  # noqa: E402 - from tests/
from generators.symmetry_agreement import compared_as_equals  # noqa: E402 - from tests/
from soter.report.terminal_tables import table  # noqa: E402 - after the path


def of_equals(arguments: argparse.Namespace) -> int:
    """Programs of nearly equal instances; those that are refused or too large count for nothing."""
    began = time.perf_counter()
    count: Counter[str] = Counter()
    different: dict[int, list[str]] = {}
    seed = arguments.first
    while count["programs"] < arguments.programs:
        s = small(seed, 4_000, equal_instances)
        seed += 1
        if s is None:
            continue
        told = compared_as_equals(s, tuple(arguments.flags))
        if told.complaints:
            different[s.seed] = told.complaints
            print(f"program {s.seed}:", *told.complaints, sep="\n  ", flush=True)
        count["programs"] += 1
        count["violated"] += bool(s.found.least)
        count["equal"] += bool(told.equal)
        count["counted"] += told.stored > 0
        count["whole"] += told.whole if told.stored else 0
        count["stored"] += told.stored
    print(
        f"{count['programs']} programs, {count['violated']} of them violated, {count['equal']} "
        f"with equal instances; in {count['counted']} orbits were counted: {count['whole']:,} "
        f"configurations, {count['stored']:,} stored; {len(different)} differ (target: none); "
        f"{time.perf_counter() - began:.0f} s"
    )
    if arguments.json:
        figures = {**count, "different": different}
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 1 if different else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--programs", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--apart", action="store_true", help="parts that share nothing but time")
    parser.add_argument("--instants", action="store_true", help="groups of actors in an instant")
    parser.add_argument("--joined", action="store_true", help="parts that properties join")
    parser.add_argument("--equal", action="store_true", help="instances that are nearly equal")
    parser.add_argument("--flags", nargs="*", default=("-O1",), help="for the C compiler")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.equal:
        return of_equals(arguments)
    began = time.perf_counter()
    states: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    different: dict[int, list[str]] = {}
    largest = violated = finer = ends = joined = 0
    make = program_apart if arguments.apart else small_program
    make = program_in_instants if arguments.instants else make
    make = program_joined if arguments.joined else make
    for s in islice(small_ones(arguments.first, make), arguments.programs):
        told = compared(s, tuple(arguments.flags))
        if told.complaints:
            different[s.seed] = told.complaints
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
        f"{len(different)} differ (target: none); "
        f"{time.perf_counter() - began:.0f} s"
    )
    if arguments.json:
        figures = {"programs": arguments.programs, "violated": violated, "different": different}
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
