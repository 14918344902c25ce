"""Commands that are killed in the middle of their work: which processes outlive them.

    .venv/bin/python bench/hostile/orphans.py [--instants 20] [--only NAME]

Purpose: of every command that starts processes, and of externs that spin or fork, so many runs
that are ended by SIGKILL and as many by SIGTERM, at instants spread evenly over the time that the
command takes; counted is what lives `GRACE_S` after its end, whatever group it has moved to.
Non-goals: what the command leaves on the disk; scripts (`program.simulate`), whose externs are part
of the person's own process. Linux (orphans come to this process).
"""

from __future__ import annotations

import argparse
import ctypes
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PR_SET_CHILD_SUBREAPER = 36
GRACE_S = 2.0
LONGEST_S = 6.0
"""A command that would go on for longer is killed in its first so many seconds."""
PATIENCE_S = 30.0
"""How long a command may take to end after SIGTERM, s."""

PROGRAM = """soter 1;
topic u: float in [-1.0, 1.0] = 0.0;
extern node Learned period 10ms from "BOUND" { publishes u; }
system S default { node Learned; until 1h; }
"""
SPINS = """#include "spins.h"
int given(const spins_Learned_in *in, spins_Learned_out *out) {
  volatile unsigned long n = 0;
  (void)in;
  (void)out;
  for (;;) n++;
}
"""
FORKS = """import os, subprocess, time
began = False
def given(i):
    global began
    if not began:
        began = True
        if os.fork() == 0:
            os.setsid()
            subprocess.Popen(["sleep", "1000"], start_new_session=True)
            time.sleep(1000)
        subprocess.Popen(["sleep", "1000"], start_new_session=True)
    return {"u": 0.0}
"""
"""What it leaves is in sessions of its own, and asleep."""
COMPILER = """#!/bin/sh
"{python}" -c 'import time; time.sleep(1000)' "$@" &
wait
"""
"""It leaves its work to a child, as gcc does, and takes for ever."""
SOTER = (sys.executable, "-m", "soter.cli.main")
COMMANDS: dict[str, tuple[str, ...]] = {
    "run, C that spins": (*SOTER, "run", "spins.soter"),
    "run, C that is compiled": ("env", "SOTER_CC=./cc", *SOTER, "run", "spins.soter"),
    "run, Python that forks": (*SOTER, "run", "forks.soter"),
    "run --real-time": (*SOTER, "run", "forks.soter", "--real-time"),
    "campaign --workers 2": (
        *SOTER,
        "campaign",
        "track.soter",
        "--flights",
        "9000",
        "--workers",
        "2",
    ),
    "campaign --arms paper": (
        *SOTER,
        "campaign",
        "track.soter",
        "--flights",
        "4",
        "--arms",
        "paper",
    ),
    "verify": (*SOTER, "verify", "track.soter", "--cert", "again"),
    "test": (*SOTER, "test", "search.soter"),
    "recheck": (*SOTER, "recheck", "proof"),
}
SEARCH = """soter 1;
topic n: int in [0, 2000000] = 0;
topic by: int in [1, 9] = 1;
plant Count period 10ms {
  reads by;
  drives n = k;
  state k: int in [0, 2000000] = 0;
  next k = min(2000000, k + by * by);
}
node Chooser period 10ms { publishes by; step { publish by = choose { 1, 2, 3, 4, 5, 6, 7 }; } }
system S default { c: Count; node Chooser; until 10s; always n < 1900000; }
test T { system S; horizon 10s; }
"""


def sample(folder: Path) -> None:
    """The programs, and a certificate."""
    for name, bound in (
        ("spins", "c:spins.c:given"),
        ("forks", "python:forks.py:given"),
    ):
        (folder / f"{name}.soter").write_text(PROGRAM.replace("BOUND", bound))
    (folder / "spins.c").write_text(SPINS)
    (folder / "cc").write_text(COMPILER.replace("{python}", sys.executable))
    (folder / "cc").chmod(0o755)
    (folder / "forks.py").write_text(FORKS)
    (folder / "search.soter").write_text(SEARCH)
    wall = ROOT / "examples" / "wall" / "shuttle.soter"
    (folder / "track.soter").write_text(wall.read_text(encoding="utf-8"))
    car = ROOT / "examples" / "mountain_car"
    (folder / "car.soter").write_text((car / "cliff.soter").read_text(encoding="utf-8"))
    (folder / "SafeCarSC.npy").write_bytes((car / "SafeCarSC.npy").read_bytes())
    made = subprocess.run(
        (*SOTER, "verify", "car.soter", "--cert", "proof"), cwd=folder, capture_output=True,
        check=False,
    )  # fmt: skip
    assert made.returncode in (0, 4), made.stderr


def children(of: int) -> list[int]:
    """The children of a process that are no zombies."""
    found = []
    for place in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = place.read_bytes().rpartition(b")")[2].split()
            if int(fields[1]) == of and fields[0] != b"Z":
                found.append(int(place.parent.name))
    return found


def below(pid: int) -> list[int]:
    """Everything that a process has started and that lives."""
    own = children(pid)
    return [*own, *(p for child in own for p in below(child))]


def lifetime(command: tuple[str, ...], folder: Path) -> float:
    """How long a command takes, s, or `LONGEST_S`."""
    began = time.monotonic()
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    with suppress(subprocess.TimeoutExpired):
        process.wait(LONGEST_S)
    took = time.monotonic() - began
    process.kill()
    process.wait()
    sweep()
    return took


def sweep() -> list[str]:
    """End whatever came to us; what it was."""
    names: dict[int, str] = {}
    while left := below(os.getpid()):
        for pid in left:
            with suppress(OSError):
                words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
                if any(words) and pid not in names:  # without words it has ended already
                    names[pid] = b" ".join(words[:6]).decode(errors="replace")[:100]
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        reap()
    reap()
    return list(names.values())


def reap() -> None:
    """Wait for every child that has ended."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def trial(command: tuple[str, ...], folder: Path, how: signal.Signals, at_s: float) -> Trial:
    """Kill a command after so long; how many it had started then, and what outlives it."""
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    time.sleep(at_s)
    had = len(below(process.pid))
    process.send_signal(how)
    hung = False
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        hung = True
        process.kill()
        process.wait()
    end = time.monotonic() + GRACE_S
    while below(os.getpid()) and time.monotonic() < end:
        reap()
        time.sleep(0.02)
    return had, hung, sweep()


Trial = tuple[int, bool, list[str]]


def main() -> int:
    """A row a command and signal; 0 where nothing outlives anything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=20)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="orphans_") as work:
        folder = Path(work)
        sample(folder)
        print(
            f"{'':34} {'signal':8} {'tried':>6} {'had children':>13} {'hung':>5} {'orphans':>8}"
            f" {'in trials':>10}"
        )
        for name, command in COMMANDS.items():
            if given.only not in name:
                continue
            lasts = lifetime(command, folder)
            for how in (signal.SIGKILL, signal.SIGTERM):
                instants = [(k + 0.5) / given.instants * lasts for k in range(given.instants)]
                os.environ["SOTER_CACHE"] = str(folder / f"cache_{how.name}_{len(name)}")
                tried = [trial(command, folder, how, at_s) for at_s in instants]
                os.environ.pop("SOTER_CACHE")
                had, hung = sum(t[0] > 0 for t in tried), sum(t[1] for t in tried)
                orphans, trials = sum(len(t[2]) for t in tried), sum(bool(t[2]) for t in tried)
                print(
                    f"{name:34} {how.name:8} {len(tried):6} {had:13} {hung:5} {orphans:8}"
                    f" {trials:10}",
                    flush=True,
                )
                for what in sorted({x for t in tried for x in t[2]})[:4]:
                    print(f"    {what}")
                wrong += orphans + hung
    print(f"\n{wrong} processes outlive their command, or hang; target 0, {GRACE_S:g} s after it")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
