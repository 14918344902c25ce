"""Bad files and bad options: what every command says of them, and what it leaves behind.

    .venv/bin/python bench/bad_input.py [--count 1000] [--seed 1] [--only FORMAT] [--jobs 1]

Purpose: of every format that a command reads `--count` mutants, and as many command lines with
wrong options of each command, run as `soter` would run them. Counted are exits with 70, ends by a
signal, hangs (over 20 s) and processes that outlive their command; all have to be none.
Non-goals: whether a refusal's words are good; the mutants themselves (`bad_input_mutants.py`).
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.bad_input_commands import LIMIT_S, Forked, Tried  # noqa: E402 - needs the path
from bench.bad_input_mutants import placed  # noqa: E402
from bench.bad_input_samples import OPTIONS, formats, samples, wrong_options  # noqa: E402


def trials(
    name: str, *, count: int, seed: int, sample: Path, work: Path
) -> tuple[list[Tried], float]:
    """What became of `count` mutants of a format, or of so many wrong lines of each command."""
    forked, start = Forked(work / name), time.monotonic()
    chance = Random(f"{seed} {name}")  # noqa: S311 - a benchmark
    found = []
    for k in range(count):
        if name == OPTIONS:
            lines = wrong_options(chance)
            found += [forked.run(w, forked.folder(sample), f"{name} {k}") for w in lines]
            continue
        one = formats()[name]
        folder = forked.folder(sample)
        how = placed(one, k, chance, folder)
        words = chance.choice(one.commands)
        found.append(forked.run([*words], folder, f"{name} {k}: {how}", one.stdin))
    return found, time.monotonic() - start


def table(rows: dict[str, tuple[list[Tried], float]]) -> int:
    """Print a row a format and what was wrong; how many were."""
    print(
        f"{'':14} {'tried':>6} {'0':>5} {'1':>6} {'2':>5} {'3, 4':>5} {'70':>4} "
        f"{'died':>5} {'hung':>5} {'orphans':>8} {'longest':>9} {'took':>8}"
    )
    wrong: Counter[str] = Counter()
    first: dict[str, Tried] = {}
    for name, (tried, took) in rows.items():
        exits = Counter(t.exit for t in tried)
        others = sum(n for e, n in exits.items() if e not in (0, 1, 2, 3, 4, 70, None))
        orphans, longest = sum(t.orphans for t in tried), max((t.took_s for t in tried), default=0)
        print(
            f"{name:14} {len(tried):6} {exits[0]:5} {exits[1]:6} {exits[2]:5} "
            f"{exits[3] + exits[4]:5} {exits[70]:4} {others:5} {exits[None]:5} {orphans:8} "
            f"{longest:8.1f}s {took:7.0f}s"
        )
        for t in tried:
            if t.wrong:
                wrong[t.wrong] += 1
                first.setdefault(t.wrong, t)
    for why, n in wrong.most_common():
        t = first[why]
        print(f"\n{n} x {why}\n  {t.what}\n  soter {' '.join(t.words)[:200]!r}")
    total = sum(len(tried) for tried, _ in rows.values())
    print(
        f"\n{total} tried: {sum(wrong.values())} wrong; target 0 exits of 70, 0 orphans, 0 hangs"
        f" of more than {LIMIT_S:.0f} s"
    )
    return sum(wrong.values())


def main() -> int:
    """Try all of them; 0 where nothing was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="formats, with commas")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="bad_input_") as work:
        os.environ["SOTER_CACHE"] = str(Path(work) / "cache")
        sample = Path(work) / "sample"
        names = given.only.split(",") if given.only else [*formats(), OPTIONS]
        samples(sample, names)
        one = partial(
            trials, count=given.count, seed=given.seed, sample=sample, work=Path(work) / "tried"
        )
        with multiprocessing.get_context("fork").Pool(given.jobs, maxtasksperchild=1) as pool:
            rows = dict(zip(names, pool.map(one, names, chunksize=1), strict=True))
        return 1 if table(rows) else 0


if __name__ == "__main__":
    sys.exit(main())
