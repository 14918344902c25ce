"""What the way through a policy in another process costs: observation, policy, action.

    python bench/real_time/remote_policy.py [--seconds 5] [--json FILE]

Purpose: a robot's side, C that writes an observation and waits for the action that answers it
(`remote_policy_robot.c`), and a policy that answers a constant, in a Python process of its own:
`soter.remote` over the channels, and the same over a bare `multiprocessing.Pipe`, whose robot's
side is Python. p50 and p99 in us, at 50 Hz and as quick as it goes.
Non-goals: inference; the trusted part, which looks into its channels at its instants.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import soter
import soter.remote
from soter.native.build import RUNTIME
from soter.native.compiler import STRICT, find

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

ROBOT = """soter 1;
topic position: float in [-50.0, 50.0];
topic wish: float in [-1.0, 1.0];
node Look period 20ms { subscribes position, wish; step {} }
system Robot { external topic position; external topic wish; node Look; }
"""
SOURCE = Path(__file__).with_name("remote_policy_robot.c")
RATES = {"50 Hz": 0.02, "as quick as it goes": 0.0}
WARM = 50
"""Exchanges at the begin that are not counted."""


def soter_policy(package: str, channels: str) -> None:
    """The policy's process: until nobody measures any more."""
    with soter.remote.connect(package, channels=channels) as robot:
        try:
            for observation in robot.every("position", timeout="3s"):
                robot.publish("wish", 0.5, measured=observation.measured)
        except TimeoutError:
            return


def pipe_policy(connection: Connection) -> None:
    """The same over a pipe."""
    while connection.recv() is not None:
        connection.send(0.5)


def built(folder: Path) -> Path:
    """The robot's side; its package stands beside it."""
    (folder / "robot.soter").write_text(ROBOT, encoding="utf-8")
    soter.load(folder / "robot.soter").build("posix", folder / "out", "Robot")
    program = folder / "robot"
    parts = [SOURCE, *(RUNTIME / "posix" / f"soter_{n}.c" for n in ("outside", "channel"))]
    parts.append(RUNTIME / "posix" / "soter_posix_check.c")
    flags = [*STRICT, "-O2", f"-I{folder / 'out'}", "-o", str(program)]
    subprocess.run([*find().command, *flags, *map(str, parts)], check=True)
    return program


def through_channels(seconds: float, period_s: float) -> list[float]:
    """Round trips in us."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as at:  # noqa: PTH112, S108 - shared memory
        folder = Path(at)
        program = built(folder)
        channels = folder / "channels"
        channels.mkdir()
        policy = multiprocessing.get_context("spawn").Process(
            target=soter_policy, args=(str(folder / "out"), str(channels))
        )
        policy.start()
        command = [str(program), str(channels), str(seconds), str(period_s)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        policy.join()
    return [int(line) / 1e3 for line in done.stdout.split()]


def through_a_pipe(seconds: float, period_s: float) -> list[float]:
    """The same between two Python processes."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    policy = context.Process(target=pipe_policy, args=(there,))
    policy.start()
    here.send(0.0)
    here.recv()  # it is there
    trips: list[float] = []
    end = time.monotonic() + seconds
    due = time.monotonic()
    while due < end:
        began = time.monotonic_ns()
        here.send(1.0)
        here.recv()
        trips.append((time.monotonic_ns() - began) / 1e3)
        due = max(due + period_s, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic())) if period_s else None
    here.send(None)
    policy.join()
    return trips


def percentile(trips: list[float], share: float) -> float:
    """The least trip that so many are not longer than."""
    ordered = sorted(trips)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


WAYS: dict[str, Callable[[float, float], list[float]]] = {
    "soter.remote": through_channels,
    "multiprocessing.Pipe": through_a_pipe,
}


def main() -> int:
    """Measures, prints a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=5.0, help="of each of the four runs")
    parser.add_argument("--json", type=Path, help="write the figures to this file as well")
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    print(f"{'observation to action, us':32}{'count':>8}{'p50':>9}{'p99':>9}{'max':>10}")
    for way, measure in WAYS.items():
        for rate, period_s in RATES.items():
            trips = measure(arguments.seconds, period_s)[WARM:]
            figures = {"p50": percentile(trips, 0.5), "p99": percentile(trips, 0.99)}
            rows.append({"way": way, "rate": rate, "count": len(trips), **figures})
            shown = "".join(f"{x:9.1f}" for x in figures.values())
            print(f"{way + ', ' + rate:41.41}{len(trips):>8}{shown}{max(trips):10.1f}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
