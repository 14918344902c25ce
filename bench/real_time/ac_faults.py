"""An AC in a process of its own that fails or is killed, life after life.

A run has many lives of AC: each fails, in one way, at a step drawn by chance, or is killed at a
random instant, and AC is started again. AC says when a fault happened; the driver's log says who
had control then, and afterwards.

Purpose: every step of DM and SC happens; AC has lost control at the first decision after its
budget.
Non-goals: what the driver counts of itself is not believed about control: the log is read.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import time
from bisect import bisect_left
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.real_time.driver_runs import MODULE, WORKER, log_of, run, steps_left_out, trusted_misses

if TYPE_CHECKING:
    from bench.pieces import Pieces
    from bench.real_time.driver_runs import Line

KINDS = ("crash", "hang", "spin", "hog", "flood", "torn", "stale", "size", "scribble", "nan")
SLICE_S = 10
MS = 1_000_000
WITHIN_NS = 13 * MS
"""The next request, its budget, the next decision (10 ms), and that instant; 1 ms where none."""
LIVES = ("--late", "1000", "--bare", "0", "--again", "0.002", "--restarts", "999999")
BATCH = 500


def judged(times: list[int], lines: list[Line]) -> tuple[int, int, int]:
    """(faults, with AC in control, of these: AC had lost it within `WITHIN_NS`); times are ct."""
    cts = [x.ct for x in lines]
    last = cts[-1] if cts else 0
    seen = [t for t in times if t >= 0 and t + WITHIN_NS <= last]
    controlled = lost = 0
    for t in seen:
        first = max(bisect_left(cts, t) - 1, 0)
        after = lines[first : bisect_left(cts, t + WITHIN_NS) + 1]
        if after[0].modes & 1:
            controlled += 1
            lost += any(not x.modes & 1 for x in after)
    return len(seen), controlled, lost


def lives(program: Path, place: Path, kind: str) -> list[int]:
    """One run of one kind: violations, a step left out, late steps, instants, then `judged`."""
    log, faults = place / "lives.csv", place / "faults"
    faults.unlink(missing_ok=True)
    fault = {} if kind == "none" else {"AC_FAULT": kind, "AC_FAULT_LOG": str(faults)}
    options = ("--until", str(SLICE_S), "--patience", "0.03", "--worker-memory", "256")
    report = run(program, *options, *LIVES, "--log", str(log), **fault)
    times = []
    if faults.exists():
        times = [int(x) - report["origin_ns"] for x in faults.read_text().split()]
    counts = judged(times, log_of(log))
    late = trusted_misses(report)
    return [report["violations"], int(steps_left_out(report)), late, report["instants"], *counts]


def faults(program: Path, place: Path, trials: int, pieces: Pieces) -> bool:
    """Every kind of fault in real processes; against the same without one."""
    fine = True
    rows = []
    for kind in ("none", *KINDS):
        total = [0] * 7
        turn = 0
        while total[4] < trials and (turn == 0 or kind != "none"):
            name = f"faults {kind}, slice {turn}"
            counts = pieces.piece(name, partial(lives, program, place, kind))
            total = [a + int(b) for a, b in zip(total, counts, strict=True)]
            turn += 1
            if turn > trials:
                break
        rows.append((kind, total))
        violated, left_out, _, _, seen, controlled, lost = total
        fine = fine and violated == 0 and left_out == 0 and lost == controlled
        fine = fine and (kind == "none" or seen >= trials)
    print(f"lives of AC, at least {trials} faults a kind, at a step drawn by chance; late: 1 ms")
    print(
        "kind       faults  AC in control  lost it in 13 ms  violations  steps left out  late steps"
    )
    for kind, (violated, left_out, late, instants, seen, controlled, lost) in rows:
        share = f"{late} of {instants}"
        print(
            f"{kind:<11}{seen:>6}{controlled:>15}{lost:>18}{violated:>12}{left_out:>16}{share:>18}"
        )
    return fine


# ---------------------------------------------------------------- kills


def worker_of(process: int) -> int | None:
    """The worker below a driver."""
    for child in children(process):
        for grandchild in children(child):
            return grandchild
    return None


def children(process: int) -> list[int]:
    """Processes that a process started and that are there."""
    pids = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        try:
            pids += [int(w) for w in task.read_text().split()]
        except OSError:
            continue
    return pids


def batch(program: Path, place: Path, number: int, kills: int) -> dict[str, Any]:
    """One run whose AC is killed at so many random instants."""
    draws = random.Random(number)  # noqa: S311 - no secret
    log = place / "kills.csv"
    command = [str(program), "--json", "--quiet", "--until", "100000", *LIVES, "--log", str(log)]
    times: list[int] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        time.sleep(0.3)
        while len(times) < kills and process.poll() is None:
            time.sleep(draws.uniform(0.004, 0.044))
            worker = worker_of(process.pid)
            if worker is not None:
                try:
                    os.kill(worker, signal.SIGKILL)
                except ProcessLookupError:
                    continue
                times.append(time.monotonic_ns())
        time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate()
    report = json.loads(out)
    counts = judged([t - report["origin_ns"] for t in times], log_of(log))
    return {
        "kills": len(times),
        "judged": counts,
        "violations": report["violations"],
        "left_out": int(steps_left_out(report)),
        "late": trusted_misses(report),
        "instants": report["instants"],
        "ends": report["workers"][WORKER]["ends"],
        "share": report["modules"][MODULE]["ac_share"],
    }


def killed(program: Path, place: Path, kills: int, pieces: Pieces) -> bool:
    """AC killed at random instants, in runs of `BATCH` kills."""
    batches = []
    for number, first in enumerate(range(0, kills, BATCH)):
        count = min(BATCH, kills - first)
        name = f"kills {first} to {first + count}"
        batches.append(pieces.piece(name, partial(batch, program, place, number, count)))

    def total(what: str) -> int:
        return sum(x[what] for x in batches)

    seen, controlled, lost = (sum(x["judged"][i] for x in batches) for i in range(3))
    share = sum(x["share"] * x["instants"] for x in batches) / max(total("instants"), 1)
    left_out = total("left_out")
    print(f"AC killed at {total('kills')} random instants, in {total('instants')} instants of 1 ms")
    print(
        f"  {seen} judged: AC had control at {controlled}, and had lost it 13 ms later at {lost}; "
        f"{total('ends')} ends, AC had control {100 * share:.0f} % of the time"
    )
    print(
        f"  violations {total('violations')}, runs with a step of DM or SC left out {left_out}, "
        f"steps late by 1 ms: {total('late')}"
    )
    return total("violations") == 0 and left_out == 0 and lost == controlled
