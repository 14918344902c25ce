"""Four robots at one junction, with one machine stopped, cut off, late, or with a wrong clock.

Purpose: `examples/fleet/junction.soter` from many seeds, each kind of trouble with each machine:
collisions, whether those whose proof reads the machine had SC in control within the derived bound,
whether a wrong clock was noticed or changed no age that anybody relied on, and how many crossings
there still were.
Non-goals: the protocol's own bugs (`protocol_bugs.py`); processes and DDS (`dds_junction.py`).

    python bench/fleet/junction.py              100 runs of 60 s of each kind and machine
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
NOBODY = -1
PERIOD_S = {"Gauge": 0.01, "Guard": 0.05}
"""Of who stands between the newest message that was heard and the DM."""
NEVER = -1_000_000_000
"""`reservation.NEVER`: no time on a clock."""


@dataclass(frozen=True)
class Kind:
    """What goes wrong: WHAT of the program, from the start or suddenly, with any machine."""

    name: str
    what: str = "Nothing"
    at_start: bool = False
    clock_errors: int = 0
    """Of E_CLOCK: the machine's clock is so far from the manager's, or from some robots'."""
    hurry: bool = True

    @property
    def machines(self) -> tuple[int, ...]:
        """Whom it happens to, in turn."""
        return (NOBODY,) if self.what == "Nothing" else MACHINES

    def params(self, who: int, error_ms: int) -> dict[str, Any]:
        """Of a run in which it happens to machine `who`; `error_ms` is E_CLOCK."""
        params: dict[str, Any] = {"WHAT": self.what, "WHO": who, "HURRY": self.hurry}
        params["AT_START"] = self.at_start
        if self.what == "Late":
            for i in range(ROBOTS) if who == MANAGER else (who,):
                params |= {f"r[{i}].radio.SOON": "15ms", f"r[{i}].radio.LATE": "180ms"}
        if self.clock_errors:
            half = error_ms // 2  # clocks of robots are so far before the manager's, or behind
            sign = 1 if self.clock_errors > 0 else -1
            offset = -sign * half if who == MANAGER else half if who % 2 == 0 else -half
            if who == MANAGER:
                params["JUMP"] = self.clock_errors * error_ms + offset
            else:
                params["JUMP"] = self.clock_errors * error_ms - offset
        return params


KINDS = (
    Kind("nothing"),
    Kind("nothing, drivers by chance", hurry=False),
    Kind("stopped suddenly", "Stopped"),
    Kind("cut off suddenly", "Cut"),
    Kind("3 times as late", "Late", at_start=True),
    Kind("3 times as late, suddenly", "Late"),
    Kind("clock 2 E_CLOCK before", "Clock", at_start=True, clock_errors=2),
    Kind("clock jumps 2 E_CLOCK before", "Clock", clock_errors=2),
    Kind("clock 2 E_CLOCK behind", "Clock", at_start=True, clock_errors=-2),
    Kind("clock jumps 2 E_CLOCK behind", "Clock", clock_errors=-2),
)


def bound_s(program: soter.Program) -> float:
    """From when nothing of the manager comes any more until SC has control, at most, in s."""
    return float(program.constant("robot.CONTACT")) + sum(PERIOD_S.values())


@dataclass
class Tally:
    """Of some runs; times in s, the longest ones."""

    bound_s: float
    runs: int = 0
    collisions: int = 0
    crossings: int = 0
    in_ac: float = 0.0
    to_sc_s: list[float] = field(default_factory=list)
    """From when a machine fell silent until SC had control for good, of each who reads it."""
    never_sc: int = 0
    news_s: float = 0.0
    """How old the newest message of the manager was while AC had control."""
    over_bound: int = 0
    """Runs in which that was more than the bound."""
    lease_over: int = 0
    """Runs with a live robot in the junction whose lease was over on the manager's clock."""
    noticed: int = 0
    noticed_s: float = 0.0
    """After the trouble began."""
    neither: int = 0
    """Runs in which no clock was noticed, and an age was over its bound."""

    @property
    def line(self) -> str:
        """Of the table, after the names."""
        to_sc = f"{max(self.to_sc_s):.3f}" if self.to_sc_s else "-"
        after = f"{self.noticed_s:.2f}" if self.noticed else "-"
        return (
            f"{self.runs:>5} {self.collisions:>10} {self.crossings / self.runs:>9.1f} "
            f"{100 * self.in_ac / self.runs:>5.1f} {to_sc:>8} {self.never_sc:>3} "
            f"{self.news_s:>10.3f} {self.over_bound:>4} {self.lease_over:>5} {self.noticed:>7} "
            f"{after:>8} {self.neither:>7}"
        )


HEADER = (
    f"{'runs':>5} {'collisions':>10} {'crossings':>9} {'AC %':>5} {'to SC, s':>8} {'not':>3} "
    f"{'news, s':>10} {'over':>4} {'lease':>5} {'noticed':>7} {'after, s':>8} {'neither':>7}"
)
LEGEND = """\
to SC    longest time from when nothing of the manager came until its reader had SC for good
not      of these readers, who had AC at the end
news     oldest that the newest message of the manager ever was while AC had control
over     runs in which that was more than the bound
lease    runs with a live robot in the junction by a lease that was over on the manager's clock
noticed  runs in which some machine saw a message of the future, and how long after it began
neither  runs in which nobody did, and an age was over: `over` or `lease`"""


def _readers(who: int) -> tuple[int, ...]:
    """The robots whose proof reads a machine that falls silent: they hear the manager alone."""
    return tuple(range(ROBOTS)) if who == MANAGER else (who,)


TRACED_OF_ROBOT = ("car.base.truth", "car.Guard", "car.reservation.permit", "cut", "stopped")
TRACED_OF_POST = ("suspects", "grant", "clock")


def _ages_s(run: soter.Run, sent: np.ndarray) -> np.ndarray:
    """How long ago the manager published what it stamped `sent`; inf where that is NEVER."""
    grant = run.topic("post.reservation.grant")["sent"]
    stamps, first = np.unique(grant, return_index=True)
    place = np.minimum(np.searchsorted(stamps, sent), len(stamps) - 1)
    never = sent == NEVER
    assert (never | (stamps[place] == sent)).all()
    t = run.time_s()
    return np.where(never, np.inf, t - t[first[place]])


def one_run(program: soter.Program, kind: Kind, who: int, seed: int, tally: Tally) -> None:
    """A minute; adds to the tally."""
    number = program.flat("Junction").params
    error, lease = int(number["reservation.E_CLOCK"]), int(number["reservation.LEASE"])
    trace = [f"r[{i}].{part}" for i in range(ROBOTS) for part in TRACED_OF_ROBOT]
    trace += [f"post.reservation.{topic}" for topic in TRACED_OF_POST] + ["begun"]
    params = kind.params(who, error)
    run = program.simulate(seed=seed, params=params, sha256=False, trace=trace)
    t = run.time_s()
    clock = run.topic("post.reservation.clock")
    saw = (run.topic("post.reservation.suspects") != 0).any(axis=1)
    length = program.constant("robot.LENGTH")
    news_s, lease_over = 0.0, False
    for i in range(ROBOTS):
        ac = run.mode(f"r[{i}].car.Guard") == 1
        permit = run.topic(f"r[{i}].car.reservation.permit")
        x = run.truth(f"r[{i}].car.base")["x"]
        saw |= permit["wrong"] != 0
        tally.crossings += int((np.diff(permit["through"].astype(int)) < 0).sum())
        tally.in_ac += float(ac.mean()) / ROBOTS
        ages = _ages_s(run, permit["newest"])[ac]
        news_s = max(news_s, float(ages.max(initial=0.0)))
        alive = run.topic(f"r[{i}].stopped") == 0
        inside = alive & (x > 0.0) & (x < length)
        granted = permit["until"] - lease + error
        lease_over |= bool((clock - granted > lease)[inside & (permit["through"] != 0)].any())
        cut = run.topic(f"r[{i}].cut")
        if cut.any() and i in _readers(who):
            since = int(np.argmax(cut))
            last = np.flatnonzero(ac)
            until = t[min(int(last[-1]) + 1, len(t) - 1)] if len(last) else 0.0
            tally.never_sc += int(ac[-1])
            tally.to_sc_s.append(max(0.0, float(until - t[since])))
    over = news_s > tally.bound_s
    tally.runs += 1
    tally.collisions += run.violations
    tally.news_s = max(tally.news_s, news_s)
    tally.over_bound += int(over)
    tally.lease_over += int(lease_over)
    tally.neither += int((over or lease_over) and not saw.any())
    if saw.any():
        began = t[np.argmax(run.topic("begun"))]
        tally.noticed += 1
        tally.noticed_s = max(tally.noticed_s, float(t[np.argmax(saw)] - began))


def tallied(program: soter.Program, kind: Kind, who: int, runs: int) -> Tally:
    """Of a kind of trouble with a machine, from the seeds 1 to `runs`."""
    tally = Tally(bound_s(program))
    for k in range(runs):
        one_run(program, kind, who, 1 + k, tally)
    return tally


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_args().runs
    program = soter.load(JUNCTION)
    print(f"bound: {bound_s(program):.2f} s = CONTACT, a step of Gauge, a period of the DM")
    print(LEGEND)
    print(f"{'kind':<29} {'machine':<8} {HEADER}")
    names = {NOBODY: "-", MANAGER: "manager"}
    for kind in KINDS:
        for who in kind.machines:
            machine = names.get(who, f"robot {who}")
            line = tallied(program, kind, who, runs).line
            print(f"{kind.name:<29} {machine:<8} {line}", flush=True)


if __name__ == "__main__":
    main()
