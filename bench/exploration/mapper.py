"""The mapper on scenes with every error at its bound, judged in exact arithmetic.

Purpose: what `tests/correct/test_exploration_mapper.py` holds, as figures: the cells that the
mapper frees and how many of them an obstacle touches; of the mappers with one margin less how many
a scene catches, and after how many scenes; of the margins that no scene needs how many free a cell
that is not free.
Non-goals: flights (`worlds.py`), why each margin is there (docs/exploration.md).

    python bench/exploration/mapper.py                      24,000 scenes
    python bench/exploration/mapper.py --scenes 400 --tries 100
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from generators.exploration_margins import (
    ALL_OF_THEM,
    RIGHT,
    SILENCE,
    SILENT,
    SPARE,
    WRONG,
    Court,
    courts_of,
)
from generators.exploration_scenes import KINDS

SPARE_TRIES = 1200
"""Scenes at most for a margin that is said to be spare."""


def judged(court: Court, kind: str, count: int) -> Counter[str]:
    """Scenes, scans that were taken, cells freed and wrong ones."""
    found: Counter[str] = Counter()
    for number in range(count):
        scene = court.scene(kind, number)
        found["scenes"] += 1
        for name in ALL_OF_THEM if scene.silence else (RIGHT,):
            cells = court.freed(name, scene)
            found["scans"] += 1
            found["freed"] += len(cells)
            found["wrong"] += len(court.taken(scene, cells))
    return found


def scenes(count: int, work: Path) -> None:
    """The first table: a line a kind."""
    court = Court({RIGHT: (), SILENT: SILENCE}, work)
    whole: Counter[str] = Counter()
    print(f"{'scenes':<22}{'':>8}{'scans':>8}{'cells freed':>14}{'wrong':>8}{'s':>8}")
    for kind in KINDS:
        begun = time.perf_counter()
        found = judged(court, kind, count // len(KINDS))
        whole += found
        print(line(kind, found, time.perf_counter() - begun), flush=True)
    print(line("all", whole), flush=True)


def line(name: str, found: Counter[str], seconds: float | None = None) -> str:
    """Of the first table."""
    text = f"{name:<22}{found['scenes']:>8}{found['scans']:>8}{found['freed']:>14}"
    return f"{text}{found['wrong']:>8}" + (f"{seconds:>8.0f}" if seconds is not None else "")


def mappers(tries: int, work: Path) -> None:
    """The second table: who was caught."""
    caught = {}
    courts = courts_of({**WRONG, **SPARE}, lambda: Path(tempfile.mkdtemp(dir=work)))
    kinds = list(KINDS)
    for name, court in courts.items():
        most = min(tries, SPARE_TRIES) if name in SPARE else tries
        lie = court.first_lie(name, most // len(KINDS)) if name != RIGHT else None
        if lie is not None:
            caught[name] = lie[1] * len(kinds) + kinds.index(lie[0]) + 1
    print(f"\nmappers with one margin less, at most {tries} scenes each; spare ones: {SPARE_TRIES}")
    needed = sorted(caught[n] for n in WRONG if n in caught)
    told = f", after {needed[len(needed) // 2]} scenes (median), {needed[-1]} (most)"
    print(f"  caught: {len(needed)} of {len(WRONG)}{told if needed else ''}")
    for name in WRONG:
        if name not in caught:
            print(f"    not caught: {name}")
    print(f"  said to be spare: {len(SPARE)}, of which caught: {sum(n in caught for n in SPARE)}")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=24_000, help="of all kinds together")
    parser.add_argument("--tries", type=int, default=8_000, help="scenes for each wrong mapper")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        (folder := Path(work) / "right").mkdir()
        scenes(asked.scenes, folder)
        mappers(asked.tries, Path(work))


if __name__ == "__main__":
    main()
