"""Tests that would be clean for want of looking, or that say nothing: what they are told now.

    .venv/bin/python bench/testing/vacuous.py [--random N]

Each of the programs of tests/generators/vacuous_tests.py says nothing in some way: a property that
cannot fail, a contract that permits nothing, a fault that cannot occur. `without a word` counts
those that are clean and of which nothing is told, `cries wolf` those beside them, which could fail,
of which something is told.

Each of the programs of tests/generators/empty_tests.py is a test that judges nothing, leaves an
input alone, or compares times that lie between those of its calendar. Those that compare times, and
random programs of that kind, are searched on their own grid and on one of a quarter of a
millisecond: where the finer one finds a violation, the own one must not be clean.

Purpose: the other half of the first figure of issue 11, vacuous tests of issue 26.
Non-goals: how fast it searches.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.command import TraceHeader, explore_test
from soter.explore.contract_use import replaced_in
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

if TYPE_CHECKING:
    from soter.explore.results import TestResult

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from generators.empty_tests import (
    CALCULATED,
    GRIDDED,
    NOTHING_JUDGED,
    UNDRIVEN,
    watching,
    with_item,
)
from generators.vacuous_tests import OTHERS, RELATED, TAUTOLOGIES, TELLING, TIMED, VACUOUS

FINE = "quantum 250us; "


@dataclass
class Kind:
    """What the programs of one kind are told; `missed`: clean, and violated on the finer grid."""

    name: str
    told: Counter[str] = field(default_factory=Counter)
    finer: Counter[str] = field(default_factory=Counter)
    unjudged: list[str] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)

    def row(self) -> list[str]:
        """Of the table."""
        finer = ", ".join(f"{n} {v}" for v, n in self.finer.most_common()) or "-"
        told = ", ".join(f"{n} {v}" for v, n in self.told.most_common())
        clean = str(len(self.unjudged)), str(len(self.missed))
        return [self.name, str(self.told.total()), told, finer, *clean]


def result_of(text: str) -> TestResult:
    """What the test of a program is told."""
    checked = check_file("small.soter", text)
    about = TraceHeader("small.soter", {}, replaced_in(checked.tests["T"]))
    return explore_test(system_of_test(checked, "T"), SearchOptions(minimise=0), about)


def word(result: TestResult) -> str:
    """The verdict, and which bound was reached."""
    return result.verdict if result.bound is None else f"{result.verdict} ({result.bound})"


def look(kind: Kind, name: str, text: str, *, finer: bool) -> None:
    """One program, on its own grid and, where it compares times, on the finer one."""
    own = result_of(text)
    kind.told[word(own)] += 1
    clean = own.verdict == "exhausted"
    if clean and not own.coverage.properties.reached:
        kind.unjudged.append(name)
    if finer:
        fine = result_of(with_item(text, FINE))
        kind.finer[word(fine)] += 1
        if clean and fine.verdict == "violated":
            kind.missed.append(name)


def vacuous() -> list[str]:
    """Prints the table of vacuous tests; those that are clean without a word, or cry wolf."""
    kinds = (
        ("no value violates it", TAUTOLOGIES, VACUOUS, True),
        ("floats compared with each other", RELATED, VACUOUS, True),
        ("never put to the test", TIMED, VACUOUS, True),
        ("what a test changes", OTHERS, VACUOUS, True),
        ("what could fail", TELLING, TELLING, False),
    )
    rows, bad = [], []
    for kind, names, programs, is_vacuous in kinds:
        result_by_name = {name: result_of(programs[name]) for name in names}
        silent = [
            n for n, r in result_by_name.items() if r.verdict == "exhausted" and not r.vacuous
        ]
        violated = [n for n, r in result_by_name.items() if is_vacuous and r.verdict == "violated"]
        wolf = [n for n, r in result_by_name.items() if r.vacuous or r.bound == "unjudged"]
        missed = silent if is_vacuous else wolf
        count = str(len(silent)) if is_vacuous else "-"
        rows.append([kind, str(len(result_by_name)), count, "-" if is_vacuous else str(len(wolf))])
        bad += [f"{kind}: {name}" for name in (*missed, *violated)]
        print(kind, file=sys.stderr)
    print(table(["what is wrong", "tests", "without a word", "cries wolf"], rows))
    return bad


def main() -> int:
    """The tables; 1 where something is clean that must not be."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--random", type=int, default=100)
    args = parser.parse_args()
    drawn = {f"number {seed}": watching(seed) for seed in range(args.random)}
    given = (
        ("nothing is judged", NOTHING_JUDGED, False),
        ("an input keeps its default", UNDRIVEN, False),
        ("times between those of the calendar", GRIDDED, True),
        ("times are calculated with", CALCULATED, True),
        ("random comparisons of times", drawn, True),
    )
    kinds = []
    for name, programs, finer in given:
        kinds.append(Kind(name))
        for own, text in programs.items():
            look(kinds[-1], own, text, finer=finer)
            print(f"{name}: {own}", file=sys.stderr)
    head = [
        "what is wrong",
        "tests",
        "told",
        "on 250 us",
        "clean unjudged",
        "clean on its own only",
    ]
    print(table(head, [k.row() for k in kinds]))
    bad = [f"{k.name}: {name}" for k in kinds for name in (*k.unjudged, *k.missed)]
    clean = sum(k.told["exhausted"] for k in kinds[:2])
    print("\n".join(bad) if bad else f"0 clean that must not be; {clean} unlooked at clean (0)")
    told = vacuous()
    print("\n".join(told) if told else "0 vacuous without a word (5), 0 that could fail told (0)")
    return 1 if bad or clean or told else 0


if __name__ == "__main__":
    sys.exit(main())
