"""Four robots at one junction, with one machine stopped, cut off, late, or with a wrong clock.

Purpose: `examples/fleet/junction.soter` from many seeds: collisions, how long after a machine fell
silent those whose proof reads it had SC in control, how old what AC went by ever was, whether a
wrong clock was noticed, and how many crossings there still were.
Non-goals: the protocol's own bugs (`protocol_bugs.py`); processes and DDS (`dds_junction.py`).

    python bench/fleet/junction.py              100 runs of 60 s a row
    python bench/fleet/junction.py --runs 10
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import soter

JUNCTION = Path(__file__).parents[2] / "examples" / "fleet" / "junction.soter"
ROBOTS = 4
MANAGER = 100
MACHINES = (0, 1, 2, 3, MANAGER)
PERIOD_S = {"Gauge": 0.01, "Guard": 0.05}
"""Of who stands between the newest message that was heard and the DM."""


@dataclass(frozen=True)
class Row:
    """What goes wrong: `params` are made of the machine and its place in the program."""

    name: str
    what: str = "Nothing"
    slow: bool = False
    clock_errors: int = 0
    """Of E_CLOCK, from the clock of the manager, or from those of the robots."""
    hurry: bool = True

    def params(self, who: int, error_ms: int) -> dict[str, Any]:
        """Of a run in which it happens to that machine; `error_ms` is E_CLOCK."""
        params: dict[str, Any] = {"WHAT": self.what, "WHO": who, "HURRY": self.hurry}
        places = range(ROBOTS) if who == MANAGER else (who,)
        if self.slow:
            for i in places:
                params |= {f"r[{i}].radio.SLOW": 3, f"r[{i}].radio.SOON": "15ms"}
                params |= {f"r[{i}].radio.LATE": "180ms"}
        if self.clock_errors:
            half = error_ms // 2 if who == MANAGER else 0  # robots are half of E_CLOCK off already
            off = self.clock_errors * error_ms
            off -= half if off > 0 else -half
            place = "post" if who == MANAGER else f"r[{who}]"
            params[f"{place}.reservation.OFFSET"] = off
        return params


ROWS = (
    Row("nothing"),
    Row("nothing, drivers by chance", hurry=False),
    Row("stopped", "Stopped"),
    Row("cut off", "Cut"),
    Row("3 times as late", slow=True),
    Row("clock 2 E_CLOCK before", clock_errors=2),
    Row("clock 2 E_CLOCK behind", clock_errors=-2),
)


@dataclass
class Tally:
    """Of some runs."""

    runs: int = 0
    collisions: int = 0
    crossings: int = 0
    to_sc_s: list[float] = field(default_factory=list)
    never_sc: int = 0
    news_s: float = 0.0
    noticed: int = 0
    in_ac: float = 0.0


def _silent(who: int) -> range | tuple[int, ...]:
    """The robots whose proof reads a machine that falls silent: they hear the manager alone."""
    return range(ROBOTS) if who == MANAGER else (who,)


def one_run(program: soter.Program, row: Row, who: int, seed: int, tally: Tally) -> None:
    """A minute; adds to the tally."""
    error = int(program.flat("Junction").params["reservation.E_CLOCK"])
    parts = ("base.truth", "Guard", "reservation.permit")
    trace = [f"r[{i}].car.{part}" for i in range(ROBOTS) for part in parts]
    trace += [f"r[{i}].cut" for i in range(ROBOTS)] + ["post.reservation.suspects"]
    params = row.params(who, error)
    run = program.simulate(seed=seed, params=params, sha256=False, trace=trace)
    t = run.time_s()
    ahead = params.get("post.reservation.OFFSET", 0)
    tally.runs += 1
    tally.collisions += run.violations
    noticed = bool(run.topic("post.reservation.suspects")[-1].any())
    for i in range(ROBOTS):
        ac = run.mode(f"r[{i}].car.Guard") == 1
        permit = run.topic(f"r[{i}].car.reservation.permit")
        tally.crossings += int((np.diff(permit["through"].astype(int)) < 0).sum())
        tally.in_ac += float(ac.mean()) / ROBOTS
        noticed |= bool(permit["wrong"][-1])
        if ac.any():
            news = t - 0.001 * (permit["newest"] - ahead)
            tally.news_s = max(tally.news_s, float(news[ac].max()))
        cut = run.topic(f"r[{i}].cut")
        if cut.any() and i in _silent(who):
            since = int(np.argmax(cut))
            last = np.flatnonzero(ac)
            until = t[min(int(last[-1]) + 1, len(t) - 1)] if len(last) else 0.0
            tally.never_sc += int(ac[-1])
            tally.to_sc_s.append(max(0.0, float(until - t[since])))
    tally.noticed += int(noticed)


def tallied(program: soter.Program, row: Row, runs: int) -> Tally:
    """Of a row: the machines take turns."""
    tally = Tally()
    for k in range(runs):
        one_run(program, row, MACHINES[k % len(MACHINES)], 1 + k, tally)
    return tally


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_args().runs
    program = soter.load(JUNCTION)
    bound = 0.5 + sum(PERIOD_S.values())
    print(f"to SC within {bound:.2f} s: CONTACT, a step of Gauge, a period of the DM")
    print(
        f"{'one machine':<28} {'runs':>5} {'collisions':>10} {'crossings':>9} {'AC %':>5} "
        f"{'to SC, s':>9} {'not':>4} {'news of AC, s':>13} {'noticed':>8}"
    )
    for row in ROWS:
        t = tallied(program, row, runs)
        slowest = f"{max(t.to_sc_s):.3f}" if t.to_sc_s else "-"
        print(
            f"{row.name:<28} {t.runs:>5} {t.collisions:>10} {t.crossings / t.runs:>9.1f} "
            f"{100 * t.in_ac / t.runs:>5.1f} {slowest:>9} {t.never_sc:>4} {t.news_s:>13.3f} "
            f"{t.noticed:>8}",
            flush=True,
        )


if __name__ == "__main__":
    main()
