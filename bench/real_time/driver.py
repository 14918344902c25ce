"""The real-time driver: misses under load, controllers that fail, kills, the way to SC's output.

    .venv/bin/python bench/real_time/driver.py [--minutes M] [--busy N] [--early US] [--trials N]
        [--kills N] [--deaths N] [--only WHAT] [--keep FILE]

WHAT is misses, faults, leases or output. With --keep every finished piece is written to FILE, and a
run that was stopped goes on behind it. Misses: a loop at 1 kHz with its processor kept busy by N
ordinary processes that spin (8), for M minutes as FIFO, as DEADLINE and as an ordinary thread, in
turns of some seconds; beside them a thread that never sleeps, whose gaps are what no driver can
help: the machine below takes the processor away. Late is a release more than 200 us behind. What
the driver counted is compared, instant by instant, with what the time stamps of another clock say
(CLOCK_MONOTONIC_RAW, each second's earliest wake-up as its zero). Faults: `ac_faults.py`, leases:
the trusted part of real_time_stop.soter is killed at random instants while its commands are obeyed,
and what the actuators say of themselves is read. Output: from the release to SC's output, AC a
process beside it, against wake-ups with nothing to do, in the same run. Exit code 1 where a miss
was not seen, a step did not happen, AC kept control, an old command was applied, or a property was
violated.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import select
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.pieces import Pieces  # noqa: E402
from bench.real_time.ac_faults import faults, killed  # noqa: E402
from bench.real_time.driver_runs import HERE, LOOP, Line, build, busy, log_of, run, said  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

STOP = HERE / "real_time_stop.soter"
SAID = re.compile(r"([0-9.]+) Guard: (armed|commands|the lease)")
LEASE_MS = 15.0
"""SC's period, and until its next output is due: lateness and response (printed by the build)."""
PATIENCE_S = 20.0
BATCH = 50


class Actuators:
    """Their process, and what it said last."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.state, self.at = "", 0.0

    def wait(self, state: str, seconds: float) -> bool:
        """Whether they come to say so in that time."""
        end = time.monotonic() + seconds
        assert self.process.stderr is not None
        while self.state != state:
            left = end - time.monotonic()
            ready = select.select([self.process.stderr], [], [], max(left, 0.0))[0]
            if not ready:
                return False
            line = self.process.stderr.readline()
            if not line:
                raise RuntimeError("the actuators have ended")
            match = SAID.match(line)
            if match:
                self.at, self.state = float(match[1]), match[2]
        return True


def batch(folder: Path, channels: Path, number: int, kills: int) -> dict[str, Any]:
    """So many kills, with one process of actuators and one world."""
    draws = random.Random(number)  # noqa: S311 - no secret
    common = ["--channels", str(channels), "--json"]
    name = STOP.stem
    lawful, after, spent = 0, [], 0
    with ExitStack() as stack:

        def start(program: Path, *options: str, **streams: Any) -> subprocess.Popen[str]:  # noqa: ANN401
            process = subprocess.Popen(
                [str(program), *common, *options], stdout=subprocess.PIPE, text=True, **streams
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        actuator = start(folder / "Vehicle" / f"{name}_actuator", stderr=subprocess.PIPE, bufsize=1)
        world = start(folder / "World" / name, "--quiet", "--late", "1000000")
        told = Actuators(actuator)
        told.wait("armed", PATIENCE_S)  # before it says so a signal would end it
        while lawful < kills and spent < 4 * kills:
            trusted = start(folder / "Vehicle" / name, "--quiet", "--bare", "0")
            actuator.send_signal(signal.SIGUSR2)  # before it speaks: without a look
            told.wait("commands", PATIENCE_S)
            time.sleep(draws.uniform(0.02, 0.25))
            spent += 1
            if told.wait("the lease", 0.0):  # the machine was late: the flight had ended already
                trusted.kill()
                trusted.wait()
                continue
            trusted.kill()
            dead = time.monotonic()
            trusted.wait()
            if told.wait("the lease", PATIENCE_S):
                lawful += 1
                after.append(1e3 * (told.at - dead))
        reports = []
        for process in (world, actuator):
            process.send_signal(signal.SIGTERM)
            reports.append(json.loads(process.communicate()[0]))
    acted = reports[1]["modules"]["Guard"]
    return {
        "kills": lawful,
        "starts": spent,
        "after_ms": after,
        "violations": reports[0]["violations"],
        "older": acted["older"],
        "taken": acted["taken"],
        "law_after_ns": acted["law_after_ns"],
    }


def leases(place: Path, kills: int, pieces: Pieces) -> bool:
    """The table of all batches; False where an old command was applied, or a law did not come."""
    for system in ("Vehicle", "World"):
        build(STOP, place / "stop" / system, system)
    batches = []
    for number, first in enumerate(range(0, kills, BATCH)):
        channels = place / f"channels_{number}"
        channels.mkdir(exist_ok=True)
        count = min(BATCH, kills - first)
        batches.append(
            pieces.piece(
                f"trusted part killed {first} to {first + count}",
                partial(batch, place / "stop", channels, number, count),
            )
        )
    done, older = sum(x["kills"] for x in batches), sum(x["older"] for x in batches)
    starts, taken = sum(x["starts"] for x in batches), sum(x["taken"] for x in batches)
    violations = sum(x["violations"] for x in batches)
    after = sorted(t for x in batches for t in x["after_ms"])
    worst = max(x["law_after_ns"] for x in batches) / 1e3
    print(f"trusted part killed at {done} random instants while its commands were obeyed")
    print(
        f"  the law every time; from the kill to the law {after[len(after) // 2]:.1f} ms at the "
        f"median, {after[-1]:.1f} ms at most (a lease: {LEASE_MS:g} ms at most)"
    )
    print(
        f"  commands applied after the end of their lease: {older} of {taken}; the law "
        f"{worst:.0f} us after the end of a lease at most; violations {violations}"
    )
    print(f"  {starts - done} of {starts} lives had ended by themselves: the machine was late")
    return bool(older == 0 and violations == 0 and done == kills)


LATE_US = 200
ANEW_NS = 500_000_000
"""The driver begins its calendar anew where it is a second behind (GIVE_UP_NS of its C)."""
TURN_S = 10.0
POLICIES = ("fifo", "deadline", "other")
FEWER, RATIO = 100.0, 1.2
BURSTS = 2
"""Of 0.4 s: how long the thread that never sleeps looks, each turn."""


# ---------------------------------------------------------------- misses


def independent(log: Path) -> tuple[int, int, int]:
    """Instants, those late by the other clock, and those of them that the driver did not count."""
    lines = log_of(log)
    late, unseen = 0, 0
    for calendar in calendars(lines):
        for first in range(0, len(calendar), 1000):
            part = calendar[first : first + 1000]
            zero = min(x.raw - x.ct for x in part)
            for x in part:
                if x.raw - x.ct - zero > LATE_US * 1000:
                    late += 1
                    unseen += x.misses == 0
    return len(lines), late, unseen


def calendars(lines: list[Line]) -> Iterator[list[Line]]:
    """What has one calendar: a second behind it begins anew, which is a miss of its own.

    Where that is, the driver's own lateness says: it is counted from another time zero then.
    """
    first, origin = 0, 0
    for k, x in enumerate(lines):
        own = x.raw - x.ct - x.behind
        if k > 0 and own - origin > ANEW_NS:
            yield lines[first:k]
            first = k
        origin = own
    yield lines[first:]


def turn(
    program: Path, place: Path, policy: str, seconds: float, load: tuple[int, int, int]
) -> Any:  # noqa: ANN401
    """One turn: instants, late, not seen, late by the driver, worst and median ns, why not."""
    core, count, early_us = load
    log = place / "log.csv"
    options = ["--until", f"{seconds}", "--policy", policy, "--core", str(core), "--bare", "0"]
    options += ["--late", str(LATE_US), "--early", str(early_us if policy != "other" else 0)]
    with busy(core, count):
        report = run(program, *options, "--log", str(log))
    wake = report["wake"]
    refused = ""
    if report["policy"] == "ordinary" and policy != "other":
        refused = report["notes"][0]
    return [*independent(log), report["late_instants"], wake["max_ns"], wake["p50_ns"], refused]


def gaps(spinner: Path, core: int) -> list[int]:
    """What a thread that never sleeps saw: see real_time_gaps.c."""
    words = [str(spinner), str(core), str(LATE_US), str(BURSTS)]
    done = subprocess.run(words, capture_output=True, check=True)
    return [int(x) for x in done.stdout.split()]


def spinner_in(place: Path) -> Path:
    """The program of `gaps`."""
    made = place / "gaps"
    subprocess.run(["cc", "-O2", "-o", str(made), str(HERE / "real_time_gaps.c")], check=True)
    return made


def misses(
    program: Path, place: Path, minutes: float, load: tuple[int, int, int], kept: Pieces
) -> bool:
    """The three policies in turns; False where a miss was not seen."""
    core, count, early_us = load
    turns = max(round(minutes * 60 / TURN_S), 1)
    seconds = minutes * 60 / turns
    spinner = spinner_in(place)
    rows_by_policy: dict[str, list[Any]] = {p: [] for p in POLICIES}
    taken = []
    for k in range(turns):
        for p in POLICIES:
            name = f"misses {p}, {count} busy, early {early_us}, {seconds:g} s, turn {k} of {turns}"
            rows_by_policy[p].append(
                kept.piece(name, partial(turn, program, place, p, seconds, load))
            )
        taken.append(kept.piece(f"gaps, turn {k} of {turns}", lambda: gaps(spinner, core)))
    print(
        f"1 kHz, processor {core} kept busy by {count} ordinary processes, {minutes:g} min a "
        f"policy in turns of {seconds:g} s"
        + (f"; FIFO and DEADLINE wake {early_us} us early and spin" if early_us else "")
    )
    print("policy    instants   late, other clock   late, driver   not seen   p50 us   worst us")
    shares = {}
    for p, rows in rows_by_policy.items():
        n, late, unseen, own = (sum(r[i] for r in rows) for i in range(4))
        worst, median = max(r[4] for r in rows) / 1e3, statistics.median(r[5] for r in rows) / 1e3
        shares[p] = late / max(n, 1)
        percent = f"{100 * shares[p]:.3f} %"
        print(
            f"{p:<9}{n:>9}{late:>12} {percent:>8}{own:>14}{unseen:>11}{median:>9.1f}{worst:>11.0f}"
        )
        for why in {r[6] for r in rows if r[6]}:
            print(f"{p} was refused: {why}")
    looked, late = sum(g[1] for g in taken), sum(g[4] for g in taken)
    print(
        f"a thread that never sleeps, {looked / 1e9:.0f} s between them: "
        f"{sum(g[2] for g in taken)} gaps of more than {LATE_US} us, the longest "
        f"{max(g[5] for g in taken) / 1e3:.0f} us; late by them: {100 * late / looked:.3f} %"
    )
    granted = [p for p in POLICIES[:2] if not any(r[6] for r in rows_by_policy[p])]
    best = min((shares[p] for p in granted), default=1.0)
    ratio = shares["other"] / max(best, 1 / max(sum(r[0] for r in rows_by_policy["fifo"]), 1))
    print(f"fewer than ordinary: {ratio:.0f} x (target {FEWER:.0f} x): {said(ratio >= FEWER)}")
    unseen = sum(r[2] for rows in rows_by_policy.values() for r in rows)
    print(f"late and not seen: {unseen}: {said(unseen == 0)}")
    return bool(unseen == 0)


# ---------------------------------------------------------------- output


def output(program: Path, turns: int, kept: Pieces) -> bool:
    """From the release to SC's output, against bare wake-ups of the same thread."""

    def once() -> list[int]:
        report = run(program, "--until", "3", "--bare", "3", "--late", "1000000")
        return [report["bare"]["p50_ns"], report["output"]["p50_ns"]]

    rows = [kept.piece(f"output, turn {k}", once) for k in range(turns)]
    bare = statistics.median(b for b, _ in rows) / 1e3
    out = statistics.median(o for _, o in rows) / 1e3
    ratio = statistics.median(o / b for b, o in rows)
    print(
        f"{turns} turns of 3 s each, 1 kHz, medians: bare wake-up {bare:.1f} us, from the release"
    )
    print(f"to SC's output, AC's answer taken on the way, {out:.1f} us")
    print(f"ratio {ratio:.2f} (target <= {RATIO}): {said(ratio <= RATIO)}")
    return True


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=0.5)
    parser.add_argument("--busy", type=int, default=8)
    parser.add_argument("--early", type=int, default=0)
    parser.add_argument("--core", type=int, default=max(os.sched_getaffinity(0)))
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--deaths", type=int, default=20, help="of the trusted part")
    parser.add_argument("--only", choices=("misses", "faults", "leases", "output"))
    parser.add_argument("--keep", type=Path, help="where finished pieces are written")
    given = parser.parse_args()
    fine = True
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        program = build(LOOP, place / "loop")
        sources = sorted((place / "loop").rglob("*.[ch]"))
        about = hashlib.sha256(b"".join(p.read_bytes() for p in sources)).hexdigest()[:12]
        kept = Pieces(given.keep, about)
        if given.only in (None, "misses"):
            load = (given.core, given.busy, given.early)
            fine = misses(program, place, given.minutes, load, kept) and fine
            print()
        if given.only in (None, "faults"):
            fine = faults(program, place, given.trials, kept) and fine
            fine = killed(program, place, given.kills, kept) and fine
            print()
        if given.only in (None, "leases"):
            fine = leases(place, given.deaths, kept) and fine
            print()
        if given.only in (None, "output"):
            fine = output(program, 5, kept) and fine
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
