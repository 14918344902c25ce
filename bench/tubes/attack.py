"""What decisions by tubes claim, measured and attacked.

    python bench/tubes/attack.py --runs 10000 --holds 1000000 --programs 300

Purpose: a row an example: adversarial closed loops of the compiled module decided by the tube, by a
point simulation, and not at all; holds of fall-back runs outside of their tube; how much earlier
than needed AC is stopped. A row more for small programs that are drawn.
Non-goals: the adversary (`tube_loop.c`), wrong variants (`wrong_rests.py`).
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bench.tubes.small_rests import drawn  # noqa: E402
from bench.tubes.tube_module import Loop, Told, module_of  # noqa: E402

from soter.diagnostics.diagnostic import SoterError  # noqa: E402

BY_TUBE, BY_POINT, ALWAYS_AC, BY_SAMPLES = range(4)
SEED = 56
DECIDES = {
    "the tube": BY_TUBE,
    "the point": BY_POINT,
    "12 sampled runs from the state itself": BY_SAMPLES,
}
FEWER = {
    "docking": 20,
    "docking_3d": 20,
    "dive": 20,
    "bicycle": 20,
    "quadrotor": 200,
}
"""Where a check takes milliseconds so many times fewer runs, holds and dives are asked for."""
APART = re.compile(r" static;|^  sc \w+,", re.MULTILINE)
SHIELD = re.compile(r"^  shield;.*\n", re.MULTILINE)
HEAD = (
    "| program | flights: violated | by the point | AC alone | AC, adversarial | holds: outside "
    "| stopped too early | the point |"
)


def programs() -> list[Path]:
    """The examples that rest; not those with maps, which no adversary here draws, or with plans.

    One tube is compared here: of several plans see `swerve.py`.
    """
    every = sorted((ROOT / "examples" / "rest").glob("*.soter"))
    found = [p for p in every if not APART.search(p.read_text(encoding="utf-8"))]
    return [ROOT / "examples" / "evidence" / "follow.soter", *found]


def row(path: Path, runs: int, holds: int, dives: int) -> tuple[str, bool]:
    """A line of the table, and whether everything held."""
    text = path.read_text(encoding="utf-8")
    loop = Loop(module_of(path.name, text))
    flown = [loop.run("fly", SEED, runs, how) for how in (BY_TUBE, BY_POINT, ALWAYS_AC)]
    any_command = SHIELD.sub("", text)  # a tube of the states alone, which is what is compared
    followed = loop if any_command == text else Loop(module_of(path.name, any_command))
    held = followed.run("contain", SEED, holds, 0)
    early = loop.run("late", SEED, dives, 0)
    _explain(path.stem, flown[BY_TUBE], held)
    told = [f"{t.violated:,} of {t.runs:,}" for t in flown]
    share = flown[BY_TUBE].in_ac / max(1, flown[BY_TUBE].in_all)
    mean = [n / max(1, early.dives) for n in (early.early, early.late)]
    cells = [*told, f"{share:.1%}", _holds(held), *(f"{x:+.1f}" for x in mean)]
    right = not (flown[BY_TUBE].violated or held.outside or held.violated or early.violated)
    return f"| {path.stem} | {' | '.join(cells)} |", right


def shares(path: Path, runs: int) -> str:
    """How much of the time AC has control, by who decides, in so many of the same flights."""
    loop = Loop(module_of(path.name, path.read_text(encoding="utf-8")))
    told = {who: loop.run("fly", SEED, runs, how) for who, how in DECIDES.items()}
    every = (
        f"{t.in_ac / max(1, t.in_all):.1%} by {who} ({t.violated} of {t.runs} violated)"
        for who, t in told.items()
    )
    return f"{path.stem}: AC has control for {', '.join(every)}"


def _holds(t: Told) -> str:
    return f"{t.outside + t.violated:,} of {t.holds:,}"


def _explain(name: str, flown: Told, held: Told) -> None:
    """What to look at again, where something did not hold."""
    if flown.violated:
        print(f"{name}: flight {flown.seed}, condition {flown.where} at {flown.at / 1e9} s")
    if held.outside or held.violated:
        print(f"{name}: tube {held.seed}, part {held.where} at {held.at / 1e9} s, by {held.off}")


def small(count: int, holds: int) -> tuple[str, bool]:
    """Containment in drawn programs; what is shown of rest is asked of every third one."""
    total, kept, flown, outside = 0, 0, 0, 0
    for number in range(count):
        try:
            module = module_of("small.soter", drawn(number), claimed=number % 3 == 0)
        except SoterError as error:
            print(f"small program {number}: {error.diagnostics[0].message}")
            continue
        t = Loop(module, "-O1").run("contain", number * 1000, holds, 0)
        kept += module.kept
        flown += t.holds > 0
        total += t.holds
        outside += t.outside + (t.violated if module.kept else 0)
        if t.outside or (t.violated and module.kept):
            _explain(f"small program {number}", Told(), t)
    return (
        f"{outside:,} of {total:,} holds outside in {flown} drawn programs, {kept} of them kept",
        (not outside),
    )


def main(argv: list[str]) -> int:
    """0; 3 where something did not hold."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--holds", type=int, default=100_000)
    parser.add_argument("--dives", type=int, default=30)
    parser.add_argument("--programs", type=int, default=30)
    parser.add_argument("--only", default="", help="examples whose names have this")
    parser.add_argument("--shares", type=int, default=0, help="AC's share alone, of N flights")
    options = parser.parse_args(argv)
    right = True
    for path in programs() if options.shares else ():
        if options.only in path.stem:
            print(shares(path, options.shares), flush=True)
    if options.shares:
        return 0
    print(f"{HEAD}\n|{'---|' * (HEAD.count('|') - 1)}")
    for path in programs():
        if options.only in path.stem:
            began = time.process_time()
            asked = (options.runs, options.holds, options.dives)
            line, fine = row(path, *(max(1, n // FEWER.get(path.stem, 1)) for n in asked))
            right = right and fine
            print(line, flush=True)
            print(f"  {time.process_time() - began:.0f} s of CPU", file=sys.stderr)
    if options.programs:
        line, fine = small(options.programs, max(1000, options.holds // options.programs))
        right = right and fine
        print(f"\n{line}")
    return 0 if right else 3


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
