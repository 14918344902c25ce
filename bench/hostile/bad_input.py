"""Bad files and bad options: what every command says of them, and what it leaves behind.

    .venv/bin/python bench/hostile/bad_input.py [--count 1000] [--seed 1] [--only FORMAT] [--jobs 1]

Purpose: of every format that a command reads `--count` mutants, and as many command lines with
wrong options, run as `soter` would run them. Counted are exits with 70, ends by a signal, hangs
(over 20 s) and processes that outlive their command; all have to be none. What a mutant is follows
from `--seed`, its format and its number: it does not depend on `--jobs`.
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
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.hostile.bad_input_commands import LIMIT_S, Forked, Tried  # noqa: E402 - needs the path
from bench.hostile.bad_input_mutants import placed  # noqa: E402
from bench.hostile.bad_input_samples import OPTIONS, formats, samples, wrong_options  # noqa: E402

Share = tuple[str, list[Tried], float]
"""A format, some of its trials, and how long they took in seconds."""


def trials(share: tuple[str, range], *, seed: int, sample: Path, work: Path) -> Share:
    """What became of these mutants of a format, or of these command lines with wrong options."""
    name, numbers = share
    start = time.monotonic()
    forked = Forked(work / f"{name}-{numbers.start}")
    one = formats().get(name)
    if one is not None:
        for words in one.commands:  # a re-check leaves the workers of its pool
            start_up = forked.warm if one.sealed is None else forked.accepted
            start_up([*words], sample, one.stdin)
    outcomes = []
    for k in numbers:
        chance = Random(f"{seed} {name} {k}")  # noqa: S311 - a benchmark
        folder = forked.folder(sample)
        if one is None:
            outcomes.append(forked.run(wrong_options(chance, k), folder, f"{name} {k}"))
        else:
            how = placed(one, k, chance, folder)
            line = [*chance.choice(one.commands)]
            outcomes.append(forked.run(line, folder, f"{name} {k}: {how}", one.stdin))
    return name, outcomes, time.monotonic() - start


def shares(names: list[str], count: int, jobs: int) -> list[tuple[str, range]]:
    """Every format in as many equal parts as there are jobs."""
    return [(name, range(j, count, jobs)) for name in names for j in range(min(jobs, count))]


def table(rows: dict[str, tuple[list[Tried], float]]) -> int:
    """Print a row a format and what was wrong; how many were. `took`: of all jobs together."""
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
        one = partial(trials, seed=given.seed, sample=sample, work=Path(work) / "tried")
        rows: dict[str, tuple[list[Tried], float]] = {name: ([], 0.0) for name in names}
        parts = shares(names, given.count, given.jobs)
        fork = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(given.jobs, fork) as pool:  # of a Pool nobody may have children
            for name, tried, took in pool.map(one, parts):
                rows[name] = (rows[name][0] + tried, rows[name][1] + took)
        return 1 if table(rows) else 0


if __name__ == "__main__":
    sys.exit(main())
