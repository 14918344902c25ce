"""The trusted part killed at random instants: the law, and no command older than its lease.

Three processes (docs/real-time.md): the trusted part of real_time_stop.soter, its actuators,
and a world that goes on. Each turn arms the actuators, waits until they obey, and kills the trusted
part at a random instant, with SIGKILL; what the actuators say of themselves is read.

Purpose: every kill is followed by the law; `older`, commands applied after the end of their lease,
is 0. Non-goals: how late this machine is: a lease may also end because it was.
"""

from __future__ import annotations

import json
import random
import re
import select
import signal
import subprocess
import time
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Any

from bench.real_time.driver_runs import HERE, build

if TYPE_CHECKING:
    from pathlib import Path

    from bench.pieces import Pieces

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
