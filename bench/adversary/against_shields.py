"""A closed-loop adversary against modules with a shield, and shields that are wrong.

    .venv/bin/python bench/adversary/against_shields.py [--runs N] [--toward]
    .venv/bin/python bench/adversary/against_shields.py --wrong

Purpose: modules of twelve kinds whose commands are judged, with actuators that are late, some that
two commands move, one that moves in steps and one behind a node with sensors of its own among them,
and one that is all border, each attacked with so many runs: AC may publish anything in its set at
any tick, or nothing; errors, disturbances, lateness, responses and latencies are at their bounds.
A true state outside C is a violation, and so is a command that acts on the state behind a
judgement, or later, and was not among those judged. `--toward`: with shields that move commands
toward SC's before they judge them. `--wrong`: every wrong shield must get no proof, be rejected by
the re-checker, or be one on which the same adversary finds a violation, and finds none without it.
Exit code 1 where a module is left, or a wrong shield goes unnoticed.
Non-goals: modules without a shield (`against_proofs.py`).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402 - needs the path
from bench.adversary import wrong_shields  # noqa: E402
from bench.adversary.closed_loop import SLIPS, attack  # noqa: E402
from bench.adversary.module_families import FAMILIES, of_commands  # noqa: E402
from bench.adversary.proofs import armed, prove, widened  # noqa: E402
from bench.adversary.wrong_shields import PROGRAM, patched  # noqa: E402

import soter  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.adversary.closed_loop import Machine
    from bench.adversary.proofs import Proof
    from bench.adversary.random_modules import Module

KINDS = (
    *("tank", "integrator", "lag", "mode", "drag", "swing", "pair", "behind", "silent", "map2"),
    *("coupled", "sensing"),
)
TRIES = 40
RUNS = 10_000
STEPS = 20_000_000
"""Of the attacks on a wrong shield, on each of `SEEDS` modules."""
SEEDS = 3


# ---------------------------------------------------------------- modules that are proved


def modules(*, toward: bool = False) -> Iterator[Proof]:
    """One of each kind whose safety is proved, its actuators late; and one that is all border.

    `toward`: commands are moved toward SC's.
    """
    for kind in KINDS:
        for seed in range(TRIES):
            rng = np.random.default_rng([4, seed])
            drawn = of_commands(FAMILIES[kind](seed, rng), rng)
            if drawn.times.acts == 0 and not drawn.is_map:
                continue
            drawn = replace(drawn, toward=toward)
            first = prove(drawn, whole=False)
            if not first.safe:
                continue
            wide = prove(widened(first, rng))
            yield wide if wide.safe else prove(drawn)
            break
    yield prove(replace(wrong_shields.late_to_act(np.random.default_rng(4)), toward=toward))


def attacked(runs: int, *, toward: bool = False) -> int:
    """A line for each module; how many were left."""
    lost = 0
    print("| module | cells | L, ms | runs | steps | switches | closest | violations |")
    print("|---|---|---|---|---|---|---|---|")
    for number, proof in enumerate(modules(toward=toward)):
        assert proof.safe, proof.why
        m = proof.module
        told = attack(armed(proof), m, 0, number, runs=runs, stop=False)
        lost += told.violations
        print(
            f"| {m.family} | {m.shield} | {m.times.acts} | {told.runs:,} | {told.steps:,} "
            f"| {told.switches:,} | {told.closest:.4f} | {told.violations} |",
            flush=True,
        )
    return lost


# ---------------------------------------------------------------- shields that are wrong


@dataclass(frozen=True)
class Noticed:
    """Who noticed a wrong shield; nobody: ""."""

    name: str
    who: str


def _leaves(machine: Machine, module: Module, seed: int, steps: int) -> bool:
    """Whether the adversary leaves C, and by the same choices does not with the right shield."""
    told = attack(machine, module, steps, seed)
    if told.found is None:
        return False
    honest = told.found.again(armed(prove(module)))
    return not (honest.left or honest.forgot)


def _drawn_for(slip: str) -> Callable[[np.random.Generator], Module]:
    """Modules on which a slip of the gate matters."""
    if "moved" in slip:
        return wrong_shields.moved_toward_sc
    return wrong_shields.two_axes if "groups" in slip else wrong_shields.late_to_act


def of_gate(steps: int = STEPS) -> Iterator[Noticed]:
    """Gates that do what they should not: the adversary has to find each."""
    for name, slip in SLIPS.items():
        make = _drawn_for(name)
        who = ""
        for seed in range(SEEDS):
            proof = prove(make(np.random.default_rng([6, seed])))
            machine = armed(proof)
            machine.c.slip = slip
            if proof.safe and _leaves(machine, proof.module, seed, steps):
                who = "adversary"
                break
        yield Noticed(name, who)


def of_prover(steps: int = STEPS) -> Iterator[Noticed]:
    """Provers with a slip: the adversary, and where it stands in a certificate the re-checker."""
    for slip in wrong_shields.OF_PROVER:
        who = []
        for seed in range(SEEDS):
            drawn = slip.make(np.random.default_rng([6, seed]))
            with patched(slip.patches):
                proof = prove(drawn)
                machine = armed(proof)  # it asks how long a command may act
            if proof.safe and _leaves(machine, drawn, seed, steps):
                who.append("adversary")
                break
        if slip.table and _rejected(drawn.text, slip.patches):
            who.append("re-checker")
        yield Noticed(slip.name, ", ".join(who))


def _rejected(text: str, patches: wrong_shields.Patches) -> bool:
    """Whether a certificate that was made with the slip is rejected."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "wrong.soter"
        path.write_text(text, "utf-8")
        with patched(patches):
            soter.load(path).verify(cert=Path(folder) / "cert", refute=False)
        return not soter.recheck(Path(folder) / "cert").accepted


def of_dm() -> Iterator[Noticed]:
    """DMs and tables that are wrong: the check of the compiled DM, or the re-checker."""
    for name, patches in wrong_shields.OF_DM.items():
        with tempfile.TemporaryDirectory() as folder, patched(patches):
            path = Path(folder) / "wrong.soter"
            path.write_text(PROGRAM, "utf-8")
            verdict = soter.load(path).verify(refute=False)["Keep"].findings["DM"].verdict
        yield Noticed(name, "check of the DM" if verdict == "refuted" else "")
    for name, patches in wrong_shields.OF_TABLES.items():
        yield Noticed(name, "re-checker" if _rejected(PROGRAM, patches) else "")


def refused() -> Iterator[Noticed]:
    """Programs of which a shield is not proved, from one of which it is."""
    for name, (code, changes) in wrong_shields.REFUSED.items():
        text = PROGRAM
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        told = _why_not(text)
        yield Noticed(name, told if told == code else "")


def _why_not(text: str) -> str:
    """The code with which a program is refused, or its verdict; "" where it is proved."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "refused.soter"
        path.write_text(text, "utf-8")
        try:
            verdict = soter.load(path).verify(refute=False)["Keep"].verdict
        except soter.SoterError as error:
            return error.diagnostics[0].code
        return "" if verdict == "proved" else verdict


def wrong(steps: int) -> int:
    """A line for each wrong shield; how many nobody noticed."""
    assert not _why_not(PROGRAM), "without a slip it is proved"
    every = [*of_gate(steps), *of_prover(steps), *of_dm(), *refused()]
    print("| wrong shield | who notices |")
    print("|---|---|")
    for one in every:
        print(f"| {one.name} | {one.who or 'NOBODY'} |")
    unseen = sum(not one.who for one in every)
    print(f"{len(every)} wrong shields, {unseen} unnoticed")
    return unseen


def main() -> int:
    """Run; 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=RUNS, help="on each module")
    parser.add_argument("--steps", type=int, default=STEPS, help="on each wrong shield")
    parser.add_argument("--wrong", action="store_true")
    parser.add_argument("--toward", action="store_true", help="commands are moved toward SC's")
    said = parser.parse_args()
    if said.wrong:
        return 1 if wrong(said.steps) else 0
    return 1 if attacked(said.runs, toward=said.toward) else 0


if __name__ == "__main__":
    sys.exit(main())
