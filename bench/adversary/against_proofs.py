"""A closed-loop adversary against modules that `soter verify` calls proved.

    .venv/bin/python bench/adversary/against_proofs.py [--modules N] [--steps N]
    .venv/bin/python bench/adversary/against_proofs.py --holes

Purpose: random modules are written as programs and proved; those that are proved are simulated from
the definitions of the model of time (adversary_loop.c), with state feedback, and with lateness,
responses, latencies, errors, disturbances and drop-outs at their bounds. A true state outside C is
a violation, and printed with what is needed to have the run again. `--holes` puts holes back
into the prover, one by one: on a module that it then calls proved, and does not without the hole,
the adversary must find a violation.
Non-goals: the engine's sets (`bench/verify/soundness.py`), the formulas of the model of time
against an enumeration (tests), the re-checker.

A step is one plant integration step of a run, a millisecond of a flow or one step of a map.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402 - needs the path
from bench.adversary.closed_loop import Attack, attack  # noqa: E402
from bench.adversary.module_families import module, retimed  # noqa: E402
from bench.adversary.proofs import Proof, armed, prove, widened, written  # noqa: E402
from bench.adversary.prover_holes import HOLES, Hole  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.adversary.random_modules import Module

PROCESSES = 2
AHEAD = 24
"""Seeds under way: one that takes long holds up nobody."""
VARIANTS = 4
"""So many more modules with other times a plant and law: they need no other enclosures."""
TRIES = 12
"""So many modules are made for a hole."""
HOLE_STEPS = 60_000_000


@dataclass
class Row:
    """One module that was attacked."""

    seed: int
    family: str
    predicates: str
    """computed or written."""
    verdict: str
    text: str
    runs: int
    steps: int
    switches: int
    closest: float
    closest_sc: float
    share: float
    """Of the grid's volume on which AC may have control."""
    violations: int
    again: str = ""
    """The module and the run that leaves C, as Python has them."""


@dataclass
class Batch:
    """What came of one seed."""

    tried: list[tuple[str, str, str]] = field(default_factory=list)
    """Family, verdict, what stood against it."""
    rows: list[Row] = field(default_factory=list)


# ---------------------------------------------------------------- modules


def of_seed(seed: int, family: str, steps: int) -> Batch:
    """Modules of one plant and law: as drawn, widened to the border, with other times."""
    rng = np.random.default_rng([5, seed])
    batch = Batch()
    for k in range(1 + VARIANTS):
        drawn = module(seed, family)
        if k:
            drawn = retimed(drawn, rng)
        first = prove(drawn, whole=False)
        if not first.safe:
            batch.tried.append((drawn.family, first.verdict, first.why))
            if k == 0:
                break  # other times will hardly help
            continue
        last = _closer(first, rng)
        batch.tried.append((drawn.family, last.verdict, last.why))
        if last.safe:
            batch.rows.append(_attacked(last, steps, seed + k))
    return batch


def _closer(first: Proof, rng: np.random.Generator) -> Proof:
    """A start, and perhaps predicates, at the border of what can be proved; else as drawn."""
    wide = widened(first, rng)
    choices = [wide]
    if rng.random() < 0.35:
        bold = written(first, rng, hysteresis=float(rng.choice([0.15, 0.4])))
        if bold is not None:
            choices.insert(0, replace(bold, start=wide.start))
    for choice in choices:
        proof = prove(choice)
        if proof.proved:
            return proof
    return prove(first.module)


def _attacked(proof: Proof, steps: int, seed: int) -> Row:
    machine = armed(proof)
    told = attack(machine, proof.module, steps, seed)
    assert proof.result is not None
    return Row(
        seed,
        proof.module.family,
        "written" if proof.module.ttf else "computed",
        proof.verdict,
        proof.module.text if told.violations else "",
        told.runs,
        told.steps,
        told.switches,
        told.closest,
        told.closest_sc,
        float(proof.result.shares.get("lets_ac", 0.0)),
        told.violations,
        f"{proof.module!r}\n{told.found!r}" if told.violations else "",
    )


def _seeds(first: int) -> Iterator[int]:
    while True:
        yield first
        first += 1


def run(wanted: int, steps: int, first: int, family: str) -> list[Batch]:
    """Seeds in their order until so many modules are proved; the same whatever the processes."""
    each = max(1, -(-steps // max(1, wanted)))
    batches: list[Batch] = []
    proved = spent = 0
    began = time.perf_counter()
    with ProcessPoolExecutor(PROCESSES) as pool:
        seeds = _seeds(first)
        running = [pool.submit(of_seed, next(seeds), family, each) for _ in range(AHEAD)]
        while proved < wanted:
            batch = running.pop(0).result()
            running.append(pool.submit(of_seed, next(seeds), family, each))
            batches.append(batch)
            proved += sum(r.verdict == "proved" for r in batch.rows)
            spent += sum(r.steps for r in batch.rows)
            for row in batch.rows:
                if row.violations:
                    print(f"\nVIOLATION {row.family} seed {row.seed}\n{row.text}\n{row.again}")
            seconds = time.perf_counter() - began
            told = f"{proved}/{wanted} proved of {len(batches)} seeds, {spent:,} steps"
            print(f"\r{told}, {seconds:.0f} s ", end="", file=sys.stderr, flush=True)
        for waiting in running:
            waiting.cancel()
    print(file=sys.stderr)
    return batches


def table(batches: list[Batch]) -> None:
    """By family: tried, proved, attacked, how close."""
    tried = Counter(f for b in batches for f, _, _ in b.tried)
    rows = [r for b in batches for r in b.rows]
    print(
        f"{'family':18} {'tried':>5} {'proved':>6} {'safe only':>9} {'runs':>8} {'steps':>14}",
        end="",
    )
    print(f" {'closest':>8} {'by SC':>7} {'violations':>10}")
    for family in (*sorted(tried), ""):
        own = [r for r in rows if family in ("", r.family)]
        count = sum(tried.values()) if not family else tried[family]
        proved = sum(r.verdict == "proved" for r in own)
        print(
            f"{family or 'all':18} {count:5} {proved:6} {len(own) - proved:9} "
            f"{sum(r.runs for r in own):8} {sum(r.steps for r in own):14,} "
            f"{max((r.closest for r in own), default=0.0):8.4f} "
            f"{max((r.closest_sc for r in own), default=0.0):7.4f} "
            f"{sum(r.violations for r in own):10}"
        )


# ---------------------------------------------------------------- holes


@dataclass
class Found:
    """What came of one hole."""

    hole: str
    tried: int = 0
    proved: int = 0
    """By the prover with the hole."""
    steps: int = 0
    found: bool = False
    declared: bool = False
    without: str = ""
    """What the prover says without the hole."""
    module: Module | None = None
    attack: Attack | None = None


def through(hole: Hole, number: int, steps: int = HOLE_STEPS) -> Found:
    """Modules for one hole until one of them is proved by it, and leaves C."""
    finding = Found(hole.name)
    for seed in range(TRIES):
        rng = np.random.default_rng([3, number, seed])
        finding.tried += 1
        with hole.open():
            proof = _shaped(hole, hole.make(rng), rng)
        if proof is None or not proof.proved:
            continue
        finding.proved += 1
        for border in (False, True):  # rather from where the program starts
            told = attack(armed(proof), proof.module, steps // 2, seed, border=border)
            finding.steps += told.steps
            if told.violations:
                break
        if not told.violations:
            continue
        honest = prove(proof.module, whole=False)
        if honest.safe:
            continue  # the violation would be one of the prover as it is
        finding.found, finding.declared = True, told.declared
        finding.module, finding.attack = proof.module, told
        finding.without = f"{honest.verdict}: {honest.why}"
        break
    return finding


def _shaped(hole: Hole, drawn: Module, rng: np.random.Generator) -> Proof | None:
    """The module at the border of what the holed prover believes."""
    first = prove(drawn, whole=hole.shape == "computed")
    if not first.safe or hole.shape == "computed":
        return first
    bold = written(first, rng, hysteresis=0.3) if hole.shape == "written" else widened(first, rng)
    return None if bold is None else prove(bold)


def holes() -> list[Found]:
    """Every hole, with a line each."""
    findings = []
    print(
        f"{'hole':52} {'tried':>5} {'proved':>6} {'steps':>12} {'found':>5}  start      without it"
    )
    for number, hole in enumerate(HOLES):
        one = through(hole, number)
        findings.append(one)
        start = "" if not one.found else "declared" if one.declared else "of AC"
        print(
            f"{one.hole:52} {one.tried:5} {one.proved:6} {one.steps:12,} "
            f"{'yes' if one.found else 'NO':>5}  {start:10} {one.without[:70]}",
            flush=True,
        )
    return findings


def main() -> int:
    """Run; 1 where a proved module leaves C, or a hole is not found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--modules", type=int, default=300)
    parser.add_argument("--steps", type=int, default=100_000_000)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--family", default="", help="only this one")
    parser.add_argument("--holes", action="store_true")
    arguments = parser.parse_args()
    if arguments.holes:
        told = holes()
        seen = sum(f.found for f in told)
        print(f"{seen} of {len(told)} holes found")
        return 0 if seen == len(told) else 1
    a = arguments
    batches = run(a.modules, a.steps, a.first, a.family)
    table(batches)
    return 1 if any(r.violations for b in batches for r in b.rows) else 0


if __name__ == "__main__":
    sys.exit(main())
