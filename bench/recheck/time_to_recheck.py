"""How long `soter recheck` takes, and whether it notices a changed byte.

    .venv/bin/python bench/recheck/time_to_recheck.py [--only NAME] [--bytes 200] [--json FILE]

Purpose: prove each example, check its certificate, then flip single bits of random files of it, the
seal and the hashes left as they were.
Non-goals: corruptions with valid hashes (`corruptions.py`).
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import soter
from soter.api import recheck

if TYPE_CHECKING:
    from soter.certificate.report import Report

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Example:
    """A program, and the time its certificate may take."""

    name: str
    path: str
    target_s: float


EXAMPLES = (
    Example("mountain_car", "examples/mountain_car/cliff.soter", 30.0),
    Example("cart", "examples/wall/cart.soter", 60.0),
    Example("drone", "examples/drone/motion_primitive.soter", 120.0),
    Example("corridor", "examples/drone/corridor.soter", 300.0),
    Example("surveillance", "examples/drone/surveillance.soter", 300.0),
)


def processor_s() -> float:
    """Time that this process and those it waited for have computed."""
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(u.ru_utime + u.ru_stime for u in map(resource.getrusage, who))


def noticed(folder: Path, count: int, seed: int) -> int:
    """Of so many flipped bits, how many are rejected; the folder is as before afterwards."""
    draw = np.random.default_rng(seed)
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    rejections = 0
    for _ in range(count):
        path = files[draw.integers(len(files))]
        data = path.read_bytes()
        at, bit = int(draw.integers(len(data))), 1 << int(draw.integers(8))
        path.write_bytes(data[:at] + bytes([data[at] ^ bit]) + data[at + 1 :])
        rejections += not recheck(folder).accepted
        path.write_bytes(data)
    return rejections


def measure(example: Example, flips: int) -> dict[str, object]:
    """Prove, check, flip."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "cert"
        proved = soter.load(ROOT / example.path).verify(cert=folder, refute=False)
        began, spent = time.perf_counter(), processor_s()
        report: Report = recheck(folder)
        seconds, spent = time.perf_counter() - began, processor_s() - spent
        size = sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
        seen = noticed(folder, flips, 1) if report.accepted else 0
    return {
        "verdict": proved.verdict,
        "accepted": report.accepted,
        "rechecked": report.verdict,
        "reason": report.reason,
        "confirmed": [c for m in report.modules for c in m.confirmed],
        "cells": sum(m.cells for m in report.modules),
        "bytes": size,
        "seconds": seconds,
        "processor_s": spent,
        "target_s": example.target_s,
        "flipped": flips,
        "noticed": seen,
    }


def main() -> int:
    """Print the table; exit 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=[e.name for e in EXAMPLES])
    parser.add_argument("--bytes", type=int, default=200)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    row_by_example = {}
    missed = False
    for example in EXAMPLES:
        if args.only not in (None, example.name):
            continue
        row = row_by_example[example.name] = measure(example, args.bytes)
        print(f"{example.name}: {row['verdict']}, {row['cells']:,} cells, {row['bytes']:,} bytes")
        said = (
            "accepted" if row["accepted"] else f"{str(row['rechecked']).upper()}: {row['reason']}"
        )
        spent = f"{row['seconds']:.1f} s, {row['processor_s']:.1f} s of all processors together"
        print(f"  recheck {spent}, target {example.target_s:g} s: {said}")
        print(f"  confirmed: {' '.join(str(c) for c in row['confirmed'])}")  # type: ignore[attr-defined]
        print(f"  flipped bits noticed: {row['noticed']} of {row['flipped']}")
        in_time = float(row["seconds"]) <= example.target_s  # type: ignore[arg-type]
        missed |= not (row["accepted"] and in_time and row["noticed"] == row["flipped"])
    if args.json:
        args.json.write_text(json.dumps(row_by_example, indent=1))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
