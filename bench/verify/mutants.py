"""Changed modules that must not be proved, and the unchanged ones that must.

    .venv/bin/python bench/verify/mutants.py [--only BASE] [--budget SECONDS] [--json FILE]

Purpose: every mutant of `mutant_models.py` (changed SC, `ttf` or `safer`; never a plant, a set, an
error, an age or a period) is first confirmed bad by the NumPy simulation there: it leaves C, or the
DM never gives control back (P2b). What is not confirmed is not counted. Then `soter verify` must
not prove it, and should refute it with a run that the reference interpreter replays, while it
proves the module that nothing was changed in.
Non-goals: mutants of the tool itself (tests), of certificates (`bench/recheck/corruptions.py`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.verify.mutant_models import BASES  # noqa: E402 - needs the path

from soter.language.front_end import check_file, system_of  # noqa: E402
from soter.verify.attack.counterexample import LEAVES, Counterexample, replay  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402
from soter.verify.verify_module import verify_module  # noqa: E402

if TYPE_CHECKING:
    from bench.verify.mutant_models import Base, Outcome, Params

SEEDS = (1, 2, 3)
RUNS = 600


@dataclass
class Row:
    """One module."""

    base: str
    mutant: str
    """"" for the base itself."""
    escapes: int
    stuck: int
    verdict: str
    properties: dict[str, str]
    replayed: str
    """What the interpreter's replay of the counterexample showed; "" without one."""
    seconds: float

    @property
    def bad(self) -> bool:
        """Whether the independent falsifier says so."""
        return self.escapes > 0 or self.stuck > 0


def falsify(base: Base, changed: Params) -> Outcome:
    """The worst of a few seeds of the NumPy simulation."""
    worst = None
    for seed in SEEDS:
        worst = base.attack(changed, RUNS, seed)
        if worst.escapes or worst.stuck:
            break
    assert worst is not None
    return worst


def examine(base: Base, name: str, changes: Params) -> Row:
    """Falsify, verify, replay."""
    changed = {**base.defaults, **changes}
    seen = falsify(base, changed)
    checked = check_file(f"{base.name}.soter", base.text(changed))
    assert checked.ok, (base.name, name, [d.message for d in checked.diagnostics.items])
    flat = system_of(checked, "Protected")
    began = time.perf_counter()
    problem = extract(flat, flat.modules[0])
    result = verify_module(problem)
    seconds = time.perf_counter() - began
    shown = ""
    for finding in result.findings.values():
        c = finding.counterexample
        if finding.verdict == "refuted" and isinstance(c, Counterexample):
            again = replay(c, problem.system)
            if again is not None:
                kind = "leaves C" if c.shows == LEAVES else "never returns"
                shown = f"{kind} at {again.time_ns / 1e9:g} s"
    return Row(
        base.name,
        name,
        seen.escapes,
        seen.stuck,
        result.verdict,
        {k: v.verdict for k, v in result.findings.items()},
        shown,
        seconds,
    )


def main() -> int:
    """Run all, print the table; 1 unless the targets are met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", help="the base with this name")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = []
    print(
        f"{'base':9} {'mutant':58} {'escapes':>7} {'stuck':>5}  {'verdict':9} {'replayed run':26} s"
    )
    for base in BASES:
        if arguments.only not in (None, base.name):
            continue
        for name, changes in (("", {}), *base.mutants):
            row = examine(base, name, changes)
            rows.append(row)
            print(
                f"{row.base:9} {row.mutant or '(as it is)':58} {row.escapes:7} {row.stuck:5}  "
                f"{row.verdict:9} {row.replayed:26} {row.seconds:.1f}",
                flush=True,
            )
    figures = _figures(rows)
    print()
    for name, value in figures.items():
        print(f"{name:60} {value}")
    if arguments.json:
        document = {"figures": figures, "modules": [asdict(r) for r in rows]}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    return 0 if _met(figures, whole=arguments.only is None) else 1


UNCHANGED, MUTANTS = "modules as they are", "mutants confirmed bad by the independent falsifier"


def _figures(rows: list[Row]) -> dict[str, int]:
    bases = [r for r in rows if not r.mutant]
    mutants = [r for r in rows if r.mutant and r.bad]
    verdicts = Counter(r.verdict for r in mutants)
    return {
        UNCHANGED: len(bases),
        "... proved": sum(r.verdict in ("proved", "assumed") for r in bases),
        "... harmed by the falsifier (0)": sum(r.bad for r in bases),
        "changed modules that are not confirmed and not counted": sum(
            bool(r.mutant) and not r.bad for r in rows
        ),
        MUTANTS + " (>= 60)": len(mutants),
        "... proved (0)": verdicts["proved"] + verdicts["assumed"],
        "... refuted, the run replayed by the interpreter (>= 40)": sum(
            bool(r.replayed) for r in mutants
        ),
        "... undecided": verdicts["undecided"],
    }


def _met(figures: dict[str, int], *, whole: bool) -> bool:
    values = list(figures.values())
    unchanged, proved, harmed, _, mutants, wrong, replayed, _ = values
    enough = not whole or (mutants >= 60 and replayed >= 40)
    return proved == unchanged and harmed == 0 and wrong == 0 and enough


if __name__ == "__main__":
    sys.exit(main())
