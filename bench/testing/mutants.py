"""Seeded bugs in the shipped examples: `soter test` finds them, by the least trace.

    .venv/bin/python bench/testing/mutants.py [--only TEXT] [--brute TRANSITIONS]

Per mutant of `mutant_models.py`: the example as it is is explored and clean; the changed
one is written beside copies of its imports, explored, and its trace is read back from the file and
replayed by the reference interpreter. `minimal`: a breadth-first search without any reduction that
runs every step (none is remembered) meets its first violation, of whatever property, after as many
steps as the trace has: no execution with fewer steps violates anything. `brute`: the steps to the
first violation by the enumerator over the interpreter, which shares no code with the explorer; "-"
where it would take more than `--brute` transitions.
Purpose: the figure of issue 4. Non-goals: mutants of Soter; plants over floats beyond a few, in a
table of their own.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(p) for p in (ROOT, ROOT / "tests") if str(p) not in sys.path]

from bench.testing.mutant_models import CONTINUOUS, HARMLESS, MUTANTS  # noqa: E402 - needs the path

import soter  # noqa: E402 - after the path
from generators.brute_force import BruteForce, TooLargeError  # noqa: E402 - the same
from soter.explore.engine.explorer_library import Engine, EngineSettings  # noqa: E402 - the same

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bench.testing.mutant_models import Mutant, Subject

    from soter.explore.engine.explorer_library import Searched
    from soter.explore.results import TestResult
    from soter.language.model.system import System

EXAMPLES = ROOT / "examples"
BRUTE = 200_000
"""Transitions of the enumerator: it takes about 15 s for them."""
ENOUGH = 48
CLEAN = {"bfs": ("exhausted",), "random": ("bound", "exhausted")}
"""Verdicts of the example as it is, by strategy."""


@dataclass
class Row:
    """One mutant. `shortest`: steps to the first violation without reduction; None: not looked.

    `brute`: the same by the enumerator. `seconds`: from the text to the replayed trace.
    """

    file: str
    test: str
    kind: str
    verdict: str
    violated: str = ""
    steps: int = 0
    states: int = 0
    seconds: float = 0.0
    check_seconds: float = 0.0
    claims_minimal: bool = False
    shortest: int | None = None
    brute: int | None = None
    replayed: bool = False

    @property
    def found(self) -> bool:
        """Whether it was."""
        return self.verdict == "violated"

    @property
    def minimal(self) -> bool:
        """Shown by the search without reduction, and not denied by the enumerator."""
        return (
            self.found
            and self.claims_minimal
            and self.shortest == self.steps
            and self.brute in (None, self.steps)
        )


# ---------------------------------------------------------------- one mutant


def changed(m: Mutant, folder: Path) -> Path:
    """The changed program beside copies of what it imports."""
    shutil.copytree(EXAMPLES / Path(m.subject.file).parent, folder, dirs_exist_ok=True)
    place = folder / Path(m.subject.where).name
    text = place.read_text(encoding="utf-8")
    assert text.count(m.old) == 1, f"{m.subject.where}: {text.count(m.old)} times {m.old!r}"
    place.write_text(text.replace(m.old, m.new), encoding="utf-8")
    return folder / Path(m.subject.file).name


def explored(subject: Subject, file: Path, output: Path | None = None) -> TestResult:
    """What `soter test FILE --test NAME` finds."""
    return soter.load(file).explore(
        subject.test,
        strategy=subject.strategy,
        runs=subject.runs,
        horizon=subject.horizon,
        output=output,
    )[subject.test]


@cache
def is_clean(subject: Subject) -> bool:
    """Whether the example as it is passes its test."""
    return explored(subject, EXAMPLES / subject.file).verdict in CLEAN[subject.strategy]


def examine(m: Mutant, most: int) -> Row:
    """Explore, replay, and count again in two other ways."""
    s = m.subject
    row = Row(Path(s.file).name, s.test, m.kind, "NOT CLEAN AS SHIPPED")
    if not is_clean(s):
        return row
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        result = explored(s, changed(m, Path(folder)), Path(folder))
        row.verdict, row.states = result.verdict, result.states
        if result.broken is not None:
            assert result.trace is not None
            row.replayed = soter.replay(result.trace).reproduced
            _tell(row, result)
        row.seconds = time.perf_counter() - began
        began = time.perf_counter()
        if s.strategy == "bfs":
            _check(row, result.system, most)
        row.check_seconds = time.perf_counter() - began
    return row


def _tell(row: Row, result: TestResult) -> None:
    assert result.broken is not None
    assert result.replayed is not None
    row.violated = result.broken.text
    row.steps = sum(bool(step.actor) for step in result.replayed.trace.steps)
    row.claims_minimal = result.minimal


def _check(row: Row, system: System, most: int) -> None:
    """Breadth first without reduction and without remembered steps; then the enumerator."""
    engine = Engine(system)
    try:
        exploration = engine.explore(EngineSettings(strategy="bfs", reduction="none", plainly=True))
    finally:
        engine.close()
    row.shortest = moves(exploration) if exploration.broken is not None else None
    if exploration.transitions <= most:
        row.brute = brute(system, most)


def moves(exploration: Searched) -> int:
    """Steps of a trace without the start of the world."""
    return sum(step.actor >= 0 for step in exploration.steps)


def brute(system: System, most: int) -> int | None:
    """Steps to the first violation by the enumerator, 0 without one; None where too large."""
    try:
        return BruteForce(system).run(most, first=True).shortest or 0
    except TooLargeError:
        return None


# ---------------------------------------------------------------- all of them


def show(rows: Iterable[Row]) -> list[Row]:
    """Print as they come."""
    print(
        f"{'file':27} {'kind':43} {'verdict':9} {'steps':>5} {'states':>9} {'s':>5} "
        f"{'check s':>7}  {'minimal':7} {'brute':5} {'replayed':8} property"
    )
    seen = []
    for r in rows:
        seen.append(r)
        by_brute = "-" if r.brute is None else str(r.brute)
        replayed = _yes(r.replayed) if r.found else "-"
        minimal = _yes(r.minimal) if r.found and r.shortest is not None else "-"
        print(
            f"{r.file:27} {r.kind:43} {r.verdict:9} {r.steps:5} {r.states:9,} {r.seconds:5.1f} "
            f"{r.check_seconds:7.1f}  {minimal:7} {by_brute:>5} {replayed:8} {r.violated}",
            flush=True,
        )
    print()
    return seen


def _yes(fact: bool) -> str:
    return "yes" if fact else "no"


def chosen(mutants: Iterable[Mutant], only: str) -> list[Mutant]:
    """Those whose file or kind contains the text."""
    return [m for m in mutants if only in m.subject.file or only in m.kind]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", help="mutants whose file or kind contains this")
    parser.add_argument("--brute", type=int, default=BRUTE, help="transitions of the enumerator")
    arguments = parser.parse_args()
    most, only = arguments.brute, arguments.only
    began = time.perf_counter()
    print("Mutants. steps, states, s: of `soter test` and the replay (compiled systems are kept);")
    print("check s: of the search without reduction and the enumerator")
    rows = show(examine(m, most) for m in chosen(MUTANTS, only))
    print("Mutants of plants over floats")
    floats = show(examine(m, most) for m in chosen(CONTINUOUS, only))
    print("Changes that violate nothing (0 under `brute`: the enumerator agrees)")
    harmless_ones = chosen(HARMLESS, only)
    harmless = show(examine(m, most) for m in harmless_ones)
    for m in harmless_ones:
        print(f"{m.kind}: {m.why}")
    figures = {
        "mutants": len(rows),
        "... of how many programs": len({r.file for r in rows}),
        f"... found (all, >= {ENOUGH})": sum(r.found for r in rows),
        "... trace minimal, by exhaustive search without reduction (all)": sum(
            r.minimal for r in rows
        ),
        "... of these also by the enumerator over the interpreter": sum(
            r.brute is not None and r.minimal for r in rows
        ),
        "... trace replayed by the interpreter (all)": sum(r.replayed for r in rows),
        "mutants of plants over floats": len(floats),
        "... found and replayed (all)": sum(r.found and r.replayed for r in floats),
        "... trace minimal": sum(r.minimal for r in floats),
        "changes that violate nothing": len(harmless),
        "... exhausted (all)": sum(r.verdict == "exhausted" for r in harmless),
        "... also by the enumerator": sum(r.brute == 0 for r in harmless),
    }
    print()
    for name, value in figures.items():
        print(f"{name:66} {value:3}")
    print(f"{time.perf_counter() - began:.0f} s")
    fine = (
        all(r.minimal and r.replayed for r in rows)
        and all(r.found and r.replayed for r in floats)
        and all(r.verdict == "exhausted" and r.brute in (None, 0) for r in harmless)
    )
    return 0 if fine and (bool(only) or len(rows) >= ENOUGH) else 1


if __name__ == "__main__":
    sys.exit(main())
