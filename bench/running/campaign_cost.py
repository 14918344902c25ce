"""What a campaign costs: the whole drone, saves, workers, small flights, compilers, kills.

    .venv/bin/python bench/running/campaign_cost.py [--flights N] [--kills N] [--compilers CC,...]

The stack of examples/drone/campaign.soter with prepared plans, 600 s a flight, on one core: without
faults, with those that are inside the assumptions, and with saves besides; medians of five batches,
in seconds of the processor. How quick the machine is says a loop of Python beside it (`loop_s`).
Two threads against one, alternating. Flights of no length through the batch door. The digest of the
same flights by other compilers and optimisations. A campaign killed at random instants, again and
again, until it is through: its digest against that of one that was left alone. Exit code 1 where a
digest differs.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import soter
from soter.campaign.batch_flights import Fleet
from soter.campaign.fly_campaign import fly
from soter.campaign.store import CampaignIdentity, CampaignStore, digest_of
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.derived_systems import faultless
from soter.native.compiler import find

if TYPE_CHECKING:
    from soter.language.model.system import System

ROOT = Path(__file__).resolve().parents[2]
STACK = ROOT / "examples" / "drone" / "campaign.soter"
CART = ROOT / "examples" / "wall" / "cart.soter"
SECOND = 10**9
LENGTH_S = 600
HOURS = 104
TARGET_S, SAVES, WORKERS, CALL_US = 60.0, 3.0, 1.8, 100.0
LOOP_S = 0.22
"""What `loop_s` gives on the machine that TARGET_S is for."""
REPEATS = 5
OPTIMISE = ("-O0", "-O2", "-O3")
COMMAND = "import sys; from soter.cli.main import main; sys.exit(main())"


def said(right: bool) -> str:
    """Whether a target was met."""
    return "ok" if right else "missed"


def loop_s() -> float:
    """Processor seconds of three million turns of a loop with a product and a remainder."""
    began, x = time.process_time(), 1
    for _ in range(3_000_000):
        x = x * 7 % 1_000_003
    return time.process_time() - began


def seconds(fleet: Fleet, flights: int) -> float:
    """Processor seconds of so many flights, one thread."""
    began = time.process_time()
    fleet.fly(range(flights), first_seed=1)
    return time.process_time() - began


def speeds(flat: System, flights: int) -> None:
    """104 hours of the stack: bare, with faults, with saves."""
    cases = {
        "no faults": Fleet(faultless(flat), LENGTH_S * SECOND),
        "faults inside": Fleet(flat, LENGTH_S * SECOND),
        "no faults, saves of 10 s": Fleet(
            faultless(flat), LENGTH_S * SECOND, horizon_ns=10 * SECOND
        ),
        "faults inside, saves of 10 s": Fleet(flat, LENGTH_S * SECOND, horizon_ns=10 * SECOND),
    }
    took: dict[str, list[float]] = {name: [] for name in cases}
    loops: list[float] = []
    for _ in range(REPEATS):
        loops.append(loop_s())
        for name, fleet in cases.items():
            took[name].append(seconds(fleet, flights))
    goal = TARGET_S * statistics.median(loops) / LOOP_S
    print(f"the loop of Python: {statistics.median(loops):.3f} s; {TARGET_S:g} s where it takes "
          f"{LOOP_S:g} s are {goal:.1f} s here")  # fmt: skip
    print(f"104 h of the stack on one core, {flights} flights of {LENGTH_S} s a batch, medians")
    for name, times in took.items():
        ratio = flights * LENGTH_S / statistics.median(times)
        whole = HOURS * 3600 / ratio
        target = f"  target <= {goal:.1f} s: {said(whole <= goal)}" * (name == "no faults")
        print(f"  {name:30s} {ratio:8,.0f} x real time, {whole:6.1f} s{target}")
    for name in ("no faults", "faults inside"):
        each = [b / a for a, b in zip(took[name], took[f"{name}, saves of 10 s"], strict=True)]
        ratio = statistics.median(each)
        print(f"  saves, {name:23s} {ratio:8.2f} x  target <= {SAVES:g}: {said(ratio <= SAVES)}")


def workers(flat: System, flights: int) -> bool:
    """Two threads against one, and the same flights."""
    fleet = Fleet(flat, LENGTH_S * SECOND)
    digests, ratios = set(), []
    for _ in range(REPEATS):
        took = []
        for threads in (1, 2):
            with tempfile.TemporaryDirectory() as folder:
                names = [m.name for m in flat.modules]
                measures = [m.name for m in flat.measures]
                about = CampaignIdentity("x", "", "", {}, fleet.until_ns, 1, names, measures)
                store = CampaignStore(Path(folder) / "c", about)
                began = time.perf_counter()
                fly(fleet, store, flights, threads, lambda _: None)
                took.append(time.perf_counter() - began)
                digests.add(digest_of(store.flights))
        ratios.append(took[0] / took[1])
    ratio = statistics.median(ratios)
    print(
        f"two threads against one: {ratio:.2f} x  target >= {WORKERS:g}: {said(ratio >= WORKERS)}"
    )
    return len(digests) == 1


def overhead() -> None:
    """What a flight costs that has nothing in it, beyond its first instant."""
    fleet = Fleet(soter.load(CART).flat("Protected"), 1)
    count = 20_000
    fleet.fly(range(count), first_seed=1)
    took = [seconds(fleet, count) / count * 1e6 for _ in range(REPEATS)]
    us = statistics.median(took)
    print(f"a flight of one instant, from Python: {us:.1f} us  target <= {CALL_US:g}: "
          f"{said(us <= CALL_US)}")  # fmt: skip


def compilers(flat: System, names: list[str]) -> bool:
    """The same flights, whoever compiles them."""
    digest_by_compiler: dict[str, str] = {}
    seen: set[str] = set()
    before = os.environ.get("SOTER_CC")
    for name in names:
        os.environ["SOTER_CC"] = name
        find.cache_clear()
        try:
            used = find()
        except SoterError:
            print(f"  {name}: not on this machine")
            continue
        seen.add(used.identity)
        for optimise in OPTIMISE:
            fleet = Fleet(flat, 60 * SECOND, optimise)
            digest_by_compiler[f"{name} {optimise}"] = digest_of(fleet.fly(range(4), first_seed=1))
    os.environ.pop("SOTER_CC", None)
    if before:
        os.environ["SOTER_CC"] = before
    find.cache_clear()
    same = len(set(digest_by_compiler.values())) == 1
    told = "the same" if same else str(digest_by_compiler)
    print(f"digest by {', '.join(digest_by_compiler)} ({len(seen)} different compilers): {told}")
    return same


def killed(kills: int) -> bool:
    """A campaign that is killed at random instants goes on to the same digest."""
    rng = random.Random(1)  # noqa: S311 - instants
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "c"
        ask = ["campaign", str(CART), "--system", "Unprotected", "--until", "60s"]
        ask += ["--flights", "6000", "-o", str(folder)]
        command = [sys.executable, "-c", COMMAND, *ask]
        early = 0
        for _ in range(kills):
            process = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            time.sleep(rng.uniform(0.2, 2.2))
            early += process.poll() is None
            process.send_signal(signal.SIGKILL)
            process.wait()
        how = {"flights": 6000, "until": "60s", "output": folder}
        campaign = soter.load(CART).campaign("Unprotected", **how)
        shutil.rmtree(folder)
        whole = soter.load(CART).campaign("Unprotected", **how)
    same = campaign.result == whole.result
    print(
        f"killed at {kills} random instants ({early} of them while it flew), "
        f"{6000 - campaign.flown} flights kept: {'the same digest' if same else 'ANOTHER DIGEST'}"
    )
    return same


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=8)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--compilers", default="gcc,clang,zig")
    args = parser.parse_args()
    flat = soter.load(STACK).flat()
    speeds(flat, args.flights)
    right = workers(flat, max(64, args.flights))
    overhead()
    right &= compilers(flat, args.compilers.split(","))
    right &= killed(args.kills)
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
