"""The surveillance drone broken on purpose: no wrong stack may be proved, and flights show most.

    .venv/bin/python bench/drone/wrong_stacks.py [--kind K] [--only NAME] [--quick]

Purpose: every change of `wrong_base.py` is made in a copy of
`examples/drone/`, and what it touches is verified: it has to be undecided, refuted or refused. The
changed program is flown in an admissible world until a property is violated on true states, and
the reference interpreter flies the same seed: same property, same time, same hash of all states.
The unbroken stack is proved by the same function, and violates nothing in the same worlds. A last
table: changes that break what a proof takes for granted; their verdicts have to name it.
Non-goals: counterexamples of `soter verify`: where plants are abstractions, none is of the program.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.drone.wrong_base import (  # noqa: E402 - needs the path  # noqa: E402 - the same
    ASSUMED,
    WRONG,
    Refutation,
    Verdict,
    flown,
    laid_out,
    refuted,
    verdict,
)

from soter.report.tables import table  # noqa: E402 - the same

if TYPE_CHECKING:
    from bench.drone.wrong_base import Edit, Tree, World, Wrong

CHANGES, REFUTED_LEAST = 40, 25
"""The targets of issue 12."""
QUICK = ("no reserve", "adopts, then looks", "SC lets go", "next box unseen")
HEADS = ("kind", "change", "in words", "verdict", "refuted by", "s")


@dataclass(frozen=True)
class Row:
    """One changed stack."""

    wrong: Wrong
    verdict: Verdict
    found: Refutation | None
    seconds: float

    @property
    def refuted(self) -> bool:
        """By a flight that the interpreter repeated."""
        return self.found is not None and self.found.repeated

    @property
    def named(self) -> str:
        """What the verdict says of what is broken, where that is assumed."""
        told = (a for a in self.verdict.assumptions if re.search(self.wrong.assumed, a))
        return next(told, "") if self.wrong.assumed else ""

    def cells(self) -> tuple[str, ...]:
        """A line of the table."""
        return (
            self.wrong.kind,
            self.wrong.name,
            self.wrong.words,
            self.verdict.text + ("  <== PROVED" if self.verdict.proved else ""),
            _shown(self),
            f"{self.seconds:.0f}",
        )


def _shown(row: Row) -> str:
    if row.found is None:
        return f"no flight: {row.wrong.why}" if row.wrong.why else "no flight found"
    refutation = row.found
    how = "repeated" if refutation.repeated else "NOT REPEATED"
    what = refutation.what.removeprefix("always ")
    what = what if len(what) <= 40 else what[:37] + "..."
    return (
        f"{refutation.world.name} seed {refutation.seed}, {refutation.at_s:.4g} s: {what} ({how})"
    )


def examine(wrong: Wrong) -> Row:
    """Verify and fly."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        said = verdict(laid_out(Path(folder) / "verified", wrong.edits), wrong.verify)
        refutation = refuted(Path(folder) / "flown", wrong.edits, wrong.worlds)
    return Row(wrong, said, refutation, time.perf_counter() - began)


def unbroken(chosen: tuple[Wrong, ...]) -> list[tuple[str, str, bool]]:
    """What the same verifications and the same flights say of the stack as it is."""
    rows: list[tuple[str, str, bool]] = []
    targets = dict.fromkeys(w.verify for w in chosen)
    worlds: dict[tuple[object, ...], World] = {}
    for world in (world for w in chosen for world in w.worlds):
        worlds.setdefault((world.file, world.system, world.params, world.narrowed), world)
    with tempfile.TemporaryDirectory() as folder:
        for target in targets:
            said = verdict(laid_out(Path(folder) / str(len(rows)), ()), target)
            rows.append((f"{target[0]} {target[1] or 'all'}", said.text, said.proved))
            _tell(" | ".join(rows[-1][:2]))
        trees: dict[tuple[Edit, ...], Tree] = {}
        for world in worlds.values():
            if world.narrowed not in trees:
                there = Path(folder) / f"worlds{len(trees)}"
                trees[world.narrowed] = laid_out(there, world.narrowed)
            violation = flown(trees[world.narrowed], world)
            said_ = (
                "no violation"
                if violation is None
                else f"VIOLATED at {violation[2]:.4g} s: {violation[1]}"
            )
            flights = f"{world.seeds} x {world.until_s:.0f} s"
            rows.append((f"{world.name}, {flights}", said_, violation is None))
            _tell(" | ".join(rows[-1][:2]))
    return rows


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> int:
    """Verify, fly, print; 1 where a wrong stack is proved, or the right one is not."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kind", nargs="*", help="only these kinds")
    parser.add_argument("--only", help="only changes with this in their name")
    parser.add_argument("--quick", action="store_true", help="four changes")
    arguments = parser.parse_args()
    os.nice(10)
    began = time.perf_counter()

    def meant(wrong: Wrong) -> bool:
        return (
            (arguments.kind is None or wrong.kind in arguments.kind)
            and (arguments.only is None or arguments.only in wrong.name)
            and (not arguments.quick or wrong.name in QUICK)
        )

    rows: list[Row] = []
    assumed: list[Row] = []
    for wrong in filter(meant, (*WRONG, *ASSUMED)):
        row = examine(wrong)
        (assumed if wrong.assumed else rows).append(row)
        _tell(" | ".join(row.cells()))
    right = unbroken(tuple(filter(meant, (*WRONG, *ASSUMED))))
    print(table(HEADS, [row.cells() for row in rows]))
    if assumed:
        print("\nproved, but for something that is assumed, and broken here:\n")
        print(
            table(
                ("change", "in words", "verdict", "shown by", "the verdict names", "s"),
                [_assumed(row) for row in assumed],
            )
        )
    print("\nthe unbroken stack, by the same functions:\n")
    print(table(("what", "says", ""), [(a, b, "" if ok else "<== WRONG") for a, b, ok in right]))
    proved = sum(r.verdict.proved for r in rows)
    print(f"\nwrong stacks: {len(rows)} (target {CHANGES})")
    print(f"proved: {proved} (target 0)")
    print(
        f"refuted, and repeated by the interpreter: {sum(r.refuted for r in rows)} "
        f"(target {REFUTED_LEAST})"
    )
    print(
        f"no flight can show it: {sum(bool(r.wrong.why) for r in rows)}; none was found: "
        f"{sum(not r.wrong.why and not r.refuted for r in rows)}"
    )
    unnamed = [r.wrong.name for r in assumed if r.verdict.proved and not r.named]
    print(f"broken assumptions: {len(assumed)}, of which the verdict does not name {len(unnamed)}")
    print(f"{time.perf_counter() - began:.0f} s")
    fine = all(ok for _, _, ok in right)
    return 1 if proved or unnamed or not fine else 0


def _assumed(row: Row) -> tuple[str, ...]:
    named = row.named or "NOTHING"
    return (
        row.wrong.name,
        row.wrong.words,
        row.verdict.text,
        _shown(row),
        named if len(named) <= 90 else named[:87] + "...",
        f"{row.seconds:.0f}",
    )


if __name__ == "__main__":
    raise SystemExit(main())
