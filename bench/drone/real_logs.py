"""Go-to legs that PX4 flew, judged by a module of the drone: when would it have switched, how near.

    python bench/drone/real_logs.py [--data DIR]

Purpose: a summary by set and tube: legs without a switch, legs that left the tube, AC share, least
distances, errors of what is derived. Positions alone are in the data: velocity is derived.
Non-goals: single legs (`soter monitor ... --map`, docs/real-logs.md), what PX4 would have done with
SC in the loop.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from soter.api import load
from soter.mapping.read_mapping import read_mapping
from soter.report.tables import table

if TYPE_CHECKING:
    from soter.monitor.log_judgement import LogJudgement, ModuleOfLog

ROOT = Path(__file__).resolve().parents[2]
DRONE = ROOT / "examples" / "drone"
SAMPLE = DRONE / "px4_goto.csv.gz"
HEAD = ["set", "leg", "sample", "x", "y", "z"]
HEAD += [f"{end}_{axis}" for end in ("start", "goal") for axis in "xyz"]
RADII = (3.0, 8.0)
Row = dict[str, str]
Key = tuple[str, str]


@dataclass(frozen=True)
class Judged:
    """A leg in a tube."""

    key: Key
    radius: float
    log: LogJudgement

    @property
    def module(self) -> ModuleOfLog:
        """The only one."""
        return self.log.modules[0]


def legs_of(data: Path | None) -> dict[Key, list[Row]]:
    """Rows of every leg, with its start and goal beside each sample."""
    if data is None:
        with gzip.open(SAMPLE, "rt", encoding="utf-8", newline="") as file:
            return _by_leg(list(csv.DictReader(file)))
    with (data / "legs.csv").open(encoding="utf-8", newline="") as file:
        ends = {(r["set"], r["leg"]): r for r in csv.DictReader(file)}
    with gzip.open(data / "tracks.csv.gz", "rt", encoding="utf-8", newline="") as file:
        return _by_leg([{**ends[r["set"], r["leg"]], **r} for r in csv.DictReader(file)])


def _by_leg(rows: list[Row]) -> dict[Key, list[Row]]:
    rows_by_leg: dict[Key, list[Row]] = {}
    for row in rows:
        rows_by_leg.setdefault((row["set"], row["leg"]), []).append(row)
    return rows_by_leg


def judge(legs: dict[Key, list[Row]], folder: Path) -> list[Judged]:
    """Every leg in every tube."""
    program = load(DRONE / "goto.soter")
    mapping = read_mapping(DRONE / "px4_goto.toml")
    judgements = []
    for key, rows in legs.items():
        path = folder / f"{key[0]}-{key[1]}.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, HEAD, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows)
        for radius in RADII:
            params = {"RADIUS": radius, "HEIGHT": radius}
            judged = program.judge_log(path, mapping, params=params)
            judgements.append(Judged(key, radius, judged))
        path.unlink()
    return judgements


def summary(judged: list[Judged]) -> list[list[str]]:
    """A row for each set and tube."""
    rows = []
    for name, radius in sorted({(j.key[0], j.radius) for j in judged}):
        chosen = [j for j in judged if (j.key[0], j.radius) == (name, radius)]
        modules = [j.module for j in chosen]
        steps = sum(m.steps for m in modules)
        near = [m.margin.distance for m in modules if m.margin is not None]
        clear = [m.clearance.distance for m in modules if m.clearance is not None]
        rows.append(
            [
                name,
                f"{radius:g} m",
                f"{len(chosen)}",
                _share(sum(m.ac == 0 for m in modules), len(modules)),
                _share(sum(m.ac == m.steps for m in modules), len(modules)),
                _share(sum(bool(m.outside) for m in modules), len(modules)),
                f"{sum(m.ac for m in modules) / steps:.1%}",
                f"{sum(len(m.switches) for m in modules) / len(modules):.2f}",
                " ".join(f"{x:.2f}" for x in np.quantile(near, [0.05, 0.5])),
                " ".join(f"{x:.2f}" for x in np.quantile(clear, [0.05, 0.5])),
            ]
        )
    return rows


def warned(judged: list[Judged]) -> list[list[str]]:
    """Of the legs that left the tube: how long before that the module had taken over."""
    rows = []
    for name, radius in sorted({(j.key[0], j.radius) for j in judged}):
        ahead, none = [], 0
        for j in judged:
            m = j.module
            if (j.key[0], j.radius) != (name, radius) or m.first_outside_s is None:
                continue
            before = [c for c in m.changes if c.time_s <= m.first_outside_s]
            if not before or before[-1].to == "SC":
                began = before[-1].time_s if before else j.log.from_s
                ahead.append(m.first_outside_s - began)
            else:
                none += 1
        if ahead or none:
            least = f"{min(ahead):.2f} s" if ahead else ""
            half = f"{np.median(ahead):.2f} s" if ahead else ""
            rows.append([name, f"{radius:g} m", str(len(ahead)), str(none), least, half])
    return rows


def _share(count: int, of: int) -> str:
    return f"{count} ({count / of:.0%})"


def errors(judged: list[Judged]) -> list[list[str]]:
    """What is derived, over all legs: the worst of each quantile, and its median."""
    errors_by_quantity: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
    for j in judged:
        if j.radius == judged[0].radius:
            for d in j.log.derived:
                if d.error is not None:
                    key = d.name, d.how.split(";")[0]
                    errors_by_quantity.setdefault(key, []).append(d.error)
    rows = []
    for (name, how), triples in errors_by_quantity.items():
        all_ = np.array(triples)
        middle, worst = np.median(all_, axis=0), all_.max(axis=0)
        rows.append([name, how, f"{middle[0]:.3f}", f"{middle[1]:.3f}", f"{worst[2]:.2f}"])
    return rows


def main() -> int:
    """Judge the legs and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--data", type=Path, help="a folder with legs.csv and tracks.csv.gz")
    args = parser.parse_args()
    legs = legs_of(args.data)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        judged = judge(legs, Path(folder))
    wall = time.perf_counter() - began
    head = ["set", "tube", "legs", "AC never", "AC throughout", "left the tube", "AC share"]
    head += ["switches", "to ttf 5 % 50 %", "to safe 5 % 50 %"]
    print(f"{len(legs)} legs, {sum(map(len, legs.values())):,} positions\n")
    print(table(head, summary(judged)))
    print("\nlegs that left the tube: what the module had said before\n")
    print(table(["set", "tube", "SC before", "AC until then", "least", "half"], warned(judged)))
    print("\nderived: error (median of the legs' 50 % and 95 %, worst of all)\n")
    print(table(["topic", "how", "50 %", "95 %", "worst"], errors(judged)))
    steps = sum(j.module.steps for j in judged)
    flown = sum(j.log.to_s for j in judged)
    print(
        f"\n{wall:.0f} s, {steps / wall:,.0f} steps of the DM a second, {flown / wall:.0f} x real"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
