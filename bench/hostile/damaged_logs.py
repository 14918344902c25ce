"""Logs that were damaged in 44 ways, of eleven kinds, and Soter's own with a changed bit.

    .venv/bin/python bench/hostile/damaged_logs.py [--seed 1] [--seeds 3] [--flips 1000]

Purpose: a cart that runs against its wall, recorded by somebody else; whatever happened to the
file, `soter monitor --map` refuses it, reads the same values as before, or says what it found. The
oracle is the whole file: times, stamps, every value, and the verdict. Where nothing in a file
covers its values (CSV, bags, logs of autopilots) one that was changed in its place cannot be seen,
nor, where nothing counts them, that messages are missing which begin and end where others do, nor
in a text that a digit is: counted apart as *not covered*, as the judgement says no more than that
no checksum covers them. *Wrong* is all else that differs without a word. Of each way and kind the
worst of all seeds is told.
Then bits of a log of `soter run --log` are changed, one at a time: its verdict may not be another.
Non-goals: the kinds and ways (`log_damages.py`); files that mean harm (`bad_input.py`), or whose
values somebody wrote anew.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(p) for p in (ROOT, ROOT / "tests") if str(p) not in sys.path]

from bench.hostile.log_damages import KINDS, WAYS, flight, flipped  # noqa: E402 - needs the path

from generators.robot_logs import CART  # noqa: E402 - the same
from soter.api import load  # noqa: E402 - the same
from soter.diagnostics.diagnostic import SoterError  # noqa: E402 - the same
from soter.mapping.read_mapping import make_log_map  # noqa: E402 - the same
from soter.monitor.log_files.read_columns import read_columns  # noqa: E402 - the same
from soter.monitor.typed_samples import read_samples  # noqa: E402 - the same

if TYPE_CHECKING:
    from bench.hostile.log_damages import Kind

    from soter.api import Program

TEXTS = (KINDS["CSV"].name, KINDS["DataFlash, text"].name)

# ---------------------------------------------------------------- what becomes of them

REFUSED, SAME, TOLD, UNSEEN, WRONG = "refused", "the same", "told", "not covered", "wrong"
FROM_BEST = ("", REFUSED, SAME, TOLD, UNSEEN, WRONG)


@cache
def cart() -> Program:
    """The program that judges."""
    return load(CART)


@dataclass(frozen=True)
class Outcome:
    """What a log gave: values with their times, the verdict, what was said besides."""

    values: list[tuple[int, int, object]]
    modules: object
    words: tuple[object, ...]
    unchecked: bool
    size: int


def read(kind: Kind, log: Path) -> Outcome:
    """Raises SoterError."""
    time = {"time": {"from": "t", "unit": "ns"}} if ".csv" in log.name else {}
    given = {"system": "Protected", "topics": {"motion": kind.topic}, **time}
    j = cart().judge_log(log, given)
    declared = make_log_map(given, cart().flat("Protected"))
    (samples,) = read_samples(log, declared, read_columns(log, declared))
    values = [*zip(samples.times_ns, samples.stamps_ns, samples.values, strict=True)]
    in_part = any(m.judged_share < 1.0 for m in j.modules)
    said = (j.notes, j.left_out, j.refused, j.faulted, in_part)
    return Outcome(values, repr(j.modules), said, j.unchecked, kind.messages(log).stat().st_size)


def outcome(kind: Kind, log: Path, good: Outcome) -> str:
    """Which of the five a damaged log is; any other error is raised."""
    try:
        found = read(kind, log)
    except SoterError:
        return REFUSED
    if (found.values, found.modules) == (good.values, good.modules):
        return SAME
    if any(now and now != before for now, before in zip(found.words, good.words, strict=True)):
        return TOLD
    return UNSEEN if found.unchecked and is_uncovered(kind, found, good) else WRONG


def is_uncovered(kind: Kind, found: Outcome, good: Outcome) -> bool:
    """Whether a format has nothing that could tell: a change in its place, messages lost whole.

    In a text that a digit is gone, too, or all from one line to the same column of another.
    """
    by_whole = {value[2] for value in good.values}
    changed = sum(value[2] not in by_whole for value in found.values)
    in_place = found.size == good.size and len(found.values) == len(good.values)
    return in_place or changed <= (kind.name in TEXTS)


def cells(ways: list[str], kinds: list[str], seed: int) -> dict[tuple[str, str], str]:
    """What became of a log of each kind that was damaged in each way; "" where there is none."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in kinds:
            good = read(KINDS[name], KINDS[name].written(Path(folder) / name, flight()))
            for number, way in enumerate(ways):
                place = Path(folder) / f"{name} {number}"
                log = WAYS[way](KINDS[name], place, Random(f"{seed} {name} {way}"))  # noqa: S311
                found[way, name] = "" if log is None else outcome(KINDS[name], log, good)
                shutil.rmtree(place, ignore_errors=True)
    return found


def flips(number: int, seed: int) -> Counter[str]:
    """What became of a log of `soter run --log` with one changed bit, so many times."""
    counts: Counter[str] = Counter()
    chance = Random(seed)  # noqa: S311 - a benchmark
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        cart().simulate(system="Protected", seed=5, until="500ms", log=log)
        data = log.read_bytes()
        good = repr(cart().monitor(log, system="Protected"))
        for place in chance.sample(range(8 * len(data)), number):
            log.write_bytes(flipped(data, place))
            try:
                found = repr(cart().monitor(log, system="Protected"))
            except SoterError:
                counts[REFUSED] += 1
            else:
                counts[SAME if found == good else WRONG] += 1
    return counts


def main() -> int:
    """Damage them all; 0 where nothing was read wrongly without a word."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--flips", type=int, default=1000)
    args = parser.parse_args()
    seeds = range(args.seed, args.seed + args.seeds)
    by_seed = [cells(list(WAYS), list(KINDS), seed) for seed in seeds]
    found = {key: max((f[key] for f in by_seed), key=FROM_BEST.index) for key in by_seed[0]}
    print(f"{len(WAYS)} ways, {len(KINDS)} kinds of logs, {len(seeds)} of each\n")
    print(f"{'':34}" + "".join(f"{name:>17}" for name in KINDS))
    for way in WAYS:
        print(f"{way:34}" + "".join(f"{found[way, name] or '-':>17}" for name in KINDS))
    counts = Counter(what for f in by_seed for what in f.values() if what)
    print(f"\n{'':34}" + "".join(f"{name:>17}" for name in KINDS))
    for what in (REFUSED, SAME, TOLD, UNSEEN, WRONG):
        row = [sum(f[way, name] == what for f in by_seed for way in WAYS) for name in KINDS]
        print(f"{what:34}" + "".join(f"{n:17}" for n in row))
    print(
        f"\n{sum(counts.values())} damaged logs: {counts[REFUSED]} refused, {counts[SAME]} read as "
        f"before, {counts[TOLD]} read with a word\nabout what was found, {counts[UNSEEN]} changed "
        f"where no checksum covers values, which is said of every log of\nsuch a kind; "
        f"{counts[WRONG]} read wrongly without a word, target 0"
    )
    own = flips(args.flips, args.seed)
    print(
        f"\n{args.flips:,} changed bits of a log of `soter run --log`: {own[REFUSED]:,} refused, "
        f"{own[SAME]:,} with the same verdict, {own[WRONG]:,} with\nanother one, target 0"
    )
    return int(bool(counts[WRONG] + own[WRONG]))


if __name__ == "__main__":
    raise SystemExit(main())
