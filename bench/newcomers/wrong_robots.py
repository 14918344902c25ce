"""Six wrong variants of each robot of a folder: none may be proved in full.

    .venv/bin/python bench/newcomers/wrong_robots.py [--folder ../shared/robots]
        [--simulate] [NAME ...]

Purpose: a variant changes one thing of a robot's program: SC, an error, a disturbance, a time, a
set, an equation. That it is wrong is shown first, by `flights.py`, which knows nothing of the
program: from *every* state of a lattice of `safe` some flight of SC, or of AC until the DM may act
and SC then, leaves `safe`; of a variant with sets of its own, from some state that leaves AC in
control. Then `soter verify` is asked. `--simulate`: only the first half.
Non-goals: the robots as they stand (`first_attempt.py`); other wrong modules
(`bench/wrong_modules`).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.newcomers.first_attempt import run, said  # noqa: E402 - needs the path
from bench.newcomers.flights import leaves  # noqa: E402
from bench.newcomers.wrong_variants import VARIANTS, Variant  # noqa: E402


def edited(text: str, variant: Variant) -> str:
    """The program of a variant; every edit must fit, once or more often."""
    for old, new in variant.edits.items():
        assert old in text, (variant.why, old)
        text = text.replace(old, new)
    return text


def verdict(name: str, text: str) -> tuple[str, float]:
    """What `soter verify` says of a program, and its CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{name}.soter").write_text(text)
        document, cpu_s = run("verify", f"{name}.soter", folder=Path(folder))
    return said(document), cpu_s


def main(argv: list[str]) -> int:
    """0; 3 where one is proved, or a variant is not shown to be wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("--simulate", action="store_true")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    asked = shown = proved = flies = 0
    print("| robot | what is wrong | starts that leave `safe` | `soter verify` | CPU s |")
    print("|---|---|---|---|---|")
    for name, (right, variants) in VARIANTS.items():
        if options.names and name not in options.names:
            continue
        left, starts = leaves(right, own_sets=False)
        flies += left < starts
        print(f"| {name} | nothing | {left} of {starts} | | |", flush=True)
        text = (options.folder / f"{name}.soter").read_text()
        for variant in variants:
            left, starts = leaves(variant.robot, variant.own_sets)
            wrong = left > 0 if variant.own_sets else left == starts
            answer, cpu_s = "", 0.0
            if not options.simulate:
                answer, cpu_s = verdict(name, edited(text, variant))
            asked, shown = asked + 1, shown + wrong
            proved += answer == "proved"
            row = f"{left} of {starts}{'' if wrong else ': NOT SHOWN'} | {answer} | {cpu_s:.0f}"
            print(f"| {name} | {variant.why} | {row} |", flush=True)
    right_ones = len(options.names or VARIANTS)
    print(
        f"\n{proved} of {asked} wrong variants proved; {shown} of {asked} shown to be wrong; "
        f"{flies} of {right_ones} right robots fly"
    )
    return 0 if not proved and shown == asked and flies == right_ones else 3


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
