"""How often new episodes leave what `soter identify` fitted: known vehicles, and strangers'.

    python bench/logs/identify.py [--plants 200] [--held-out 9] [--new 10]
    python bench/logs/identify.py --data DIR

Purpose: draw vehicles (`tests/generators/simulated_plants.py`), fit each to its episodes by true
states, and count new episodes that the monitor does not explain, with bounds as they are written
and as the held-out half alone wants them; the same where new episodes are pushed harder. With
`--data` fit logs that strangers recorded (docs/identify.md says whose), each cut into sixty pieces,
of which every third is new: one number of each vehicle follows another with a lag. The go-to legs
of `examples/drone` are whole episodes.
Non-goals: a good model of these vehicles.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests")]

from generators.simulated_plants import SimulatedPlant  # noqa: E402 - needs the path
from soter.api import load  # noqa: E402 - the same
from soter.api.arguments import chosen_modules  # noqa: E402 - the same
from soter.api.identifying import cut_episodes  # noqa: E402 - the same
from soter.api.monitoring import mapped_record  # noqa: E402 - the same
from soter.monitor.identification import (  # noqa: E402 - the same
    Episode,
    Identification,
    OpenParameter,
    identified_parameters,
    open_parameters,
)
from soter.monitor.model_membership import Judgement, judge_run  # noqa: E402 - the same
from soter.report.tables import table  # noqa: E402 - the same
from soter.verify.problem.extract import problem_of_sets  # noqa: E402 - the same

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.monitor.identification import Posed

STEPS = 15
HARDER = 1.2
PIECES = 60
BEHIND = """soter 1;
param LAG: float = 2.0 in [0.0, 200.0];
param PUSH: float = 1.0 in [0.0, 10000.0];
param OFF: float = 0.02 in [0.0, 100.0];
topic seen: float max_age 2s;
topic asked: float in [-10000.0, 10000.0] = 0.0;
plant Vehicle period 10ms {
  reads asked; drives seen = v;
  state v: float = 0.0;
  disturbance push: float in [-PUSH, PUSH];
  der v = LAG * (asked - v) + push;
  measured seen within OFF;
}
node Ask period 10ms { subscribes seen; publishes asked; step { publish asked = seen; } }
node Stop period 10ms { subscribes seen; publishes asked; step { publish asked = -seen; } }
rta Keeper {
  ac Ask; sc Stop; period 10ms;
  safe abs(seen) < 1000.0; ttf abs(seen) > 500.0; safer abs(seen) < 250.0;
  verify {
    grid seen in [-2000.0, 2000.0] / 100;
    late dm 0ms, sc 0ms; response dm 0ms, sc 0ms; acts within 0ms;
  }
}
system Flying default { m: Vehicle; module Keeper; until 1s; }
"""
LEG = (
    BEHIND.replace("topic seen: float", "type Axis = { p: float, v: float };\ntopic seen: Axis")
    .replace("drives seen = v;", "drives seen = { p: p, v: v };\n  state p: float = 0.0;")
    .replace("LAG * (asked - v) + push", "LAG * (asked - p) - DRAG * v + push;\n  der p = v")
    .replace("param OFF", "param DRAG: float = 1.0 in [0.0, 200.0];\nparam OFF")
    .replace("seen within OFF", "seen.p within 0.1, seen.v within OFF")
    .replace("abs(seen)", "abs(seen.v)")
    .replace("asked = seen", "asked = seen.p")
    .replace("asked = -seen", "asked = seen.p")
    .replace("grid seen in", "grid seen.p in [-2000.0, 2000.0] / 10, seen.v in")
)
"""A leg on one axis: as a spring to its goal, with a damper."""


@dataclass(frozen=True)
class Log:
    """A log: of its fields one follows another; each `channel field`."""

    file: str
    what: str
    seen: str
    asked: str
    unit: str = ""

    @property
    def mapping(self) -> dict[str, Any]:
        """The mapping."""
        parts = {"seen": self.seen.split(), "asked": self.asked.split()}
        value = {
            t: {"from": field, "unit": self.unit} if t == "asked" and self.unit else field
            for t, (_, field) in parts.items()
        }
        return {
            "topics": {
                t: {"channel": channel, "fields": {"value": value[t]}}
                for t, (channel, _) in parts.items()
            }
        }


LOGS = (
    Log(
        "sample.ulg",
        "PX4, roll rate",
        "vehicle_attitude rollspeed",
        "vehicle_rates_setpoint roll",
    ),
    Log(
        "sample_px4_events.ulg",
        "PX4, speed",
        "vehicle_local_position vx",
        "vehicle_local_position_setpoint vx",
    ),
    Log(
        "sample_log_small.ulg",
        "PX4, roll rate",
        "vehicle_angular_velocity xyz.0",
        "vehicle_rates_setpoint roll",
    ),
    Log("sample01.bin", "ArduPilot, speed", "PSC VX", "PSC TVX"),
    Log("sample02.bin", "ArduPilot, speed", "PSC VY", "PSC TVY"),
    Log(
        "vtol.tlog",
        "ArduPilot, roll",
        "ATTITUDE roll",
        "NAV_CONTROLLER_OUTPUT nav_roll",
        "deg",
    ),
)


class Program:
    """A program, posed at values of its parameters, and what the monitor says of episodes."""

    def __init__(self, text: str, folder: Path, *, truths: bool) -> None:
        path = folder / "vehicle.soter"
        path.write_text(text, encoding="utf-8")
        self.program, self.truths = load(path), truths
        flat = self.program.declared()
        self.declared = [
            OpenParameter(n, float(value), 0.0, 10000.0) for n, value in flat.params.items()
        ]
        self.estimates = not truths

    def pose(self, values: Mapping[str, float]) -> Posed:
        """The modules and problems."""
        flat = self.program.declared(None, dict(values))
        return [(flat, m, problem_of_sets(flat, m)) for m in chosen_modules(flat, None)]

    def fit(self, episodes: Sequence[Episode]) -> Identification:
        """What all open parameters are fitted to."""
        opened = open_parameters(self.pose, self.declared, named=False)
        return identified_parameters(
            self.pose, opened, episodes, estimates=self.estimates, truths=self.truths
        )

    def judged(self, values: Mapping[str, float], episodes: Sequence[Episode]) -> list[Judgement]:
        """What the monitor says of each."""
        ((flat, module, problem),) = self.pose(values)
        how = {"estimates": self.estimates, "truths": self.truths}
        return [judge_run(flat, module, problem, e.record, models=None, **how) for e in episodes]

    def leaving(self, values: Mapping[str, float], episodes: Sequence[Episode]) -> float:
        """The share of episodes that are not explained."""
        return float(np.mean([j.alarms > 0 for j in self.judged(values, episodes)]))


def simulated(plants: int, held_out: int, new: int, folder: Path) -> None:
    """Fits as many vehicles, and says how many new episodes leave."""
    shares: dict[str, list[float]] = {"as written": [], "held-out half alone": [], "harder": []}
    off = []
    for seed in range(plants):
        plant = SimulatedPlant(seed, axes=1 + seed % 2)
        program = Program(plant.program(), folder, truths=True)
        found = program.fit([plant.episode(STEPS) for _ in range(2 * held_out)])
        assert found.factor is not None
        off.append(abs(found.values["DRAG"] / plant.drag - 1))
        scale = found.factor / max(1.0, found.factor)
        alone = {n: v * scale if n in found.bounds else v for n, v in found.values.items()}
        fresh = [plant.episode(STEPS) for _ in range(new)]
        shares["as written"].append(program.leaving(found.values, fresh))
        shares["held-out half alone"].append(program.leaving(alone, fresh))
        plant.harder = HARDER
        shares["harder"].append(
            program.leaving(found.values, [plant.episode(STEPS) for _ in range(new)])
        )
        sys.stderr.write(f"\r{seed + 1} of {plants}")
    rate = f"1/(N+1) is {1 / (held_out + 1):.1%}"
    print(f"{plants} vehicles, {held_out} held-out episodes each, {new} new ones: {rate}\n")
    rows = [
        [name, f"{np.mean(x):.1%}", f"{np.std(x) / np.sqrt(len(x)):.1%}"]
        for name, x in shares.items()
    ]
    print(table(["bounds", "new episodes that leave", "standard error"], rows))
    print(f"\ndrag is off by {np.median(off):.1%} in the median, {np.max(off):.0%} at most")


def strangers(data: Path, folder: Path) -> None:
    """Fits logs of strangers."""
    rows = []
    for log in LOGS:
        program = Program(BEHIND, folder, truths=False)
        record = mapped_record(
            program.program.declared, data / log.file, log.mapping, partial=True
        ).record
        length_ns = record.times_ns[-1] - record.times_ns[0]
        episodes = cut_episodes(log.file, record, length_ns // PIECES)
        rows.append(row(f"{log.file}, {log.what}", program, episodes))
        print(*rows[-1], sep=" | ", file=sys.stderr)
    program = Program(LEG, folder, truths=False)
    rows.append(row("go-to legs of PX4, x", program, legs(program, folder)))
    print(table(["log", "fitted to", "N", "values", "new", "explained", "first alarm"], rows))


def row(name: str, program: Program, episodes: Sequence[Episode]) -> list[str]:
    """Fits two of three pieces, and asks the third."""
    told = [e for e, j in zip(episodes, program.judged({}, episodes), strict=True) if j.steps]
    used = [e for i, e in enumerate(told) if i % 3 != 2]
    fresh = told[2::3]
    found = program.fit(used)
    judged = program.judged({**found.declared, **found.values}, fresh)
    alarm = next(((e, j) for e, j in zip(fresh, judged, strict=True) if j.alarms), None)
    values = ", ".join(f"{n} {v:.3g}" for n, v in found.values.items())
    kept = f"; not shown: {', '.join(found.kept)}" if found.kept else ""
    still = f"; never excited: {', '.join(found.never_excited)}" if found.never_excited else ""
    first = (
        ""
        if alarm is None
        else f"{', '.join(alarm[1].alarm_states)} at {alarm[1].first_alarm_s:.2f} s"
    )
    share = np.mean([not j.alarms for j in judged])
    return [
        name,
        f"{found.episodes}",
        f"{found.held_out}",
        values + kept + still,
        f"{len(fresh)}",
        f"{share:.0%}",
        first,
    ]


def legs(program: Program, folder: Path) -> list[Episode]:
    """The legs of the sample, each a CSV of its own, as the mapping of the drone has them."""
    with gzip.open(
        ROOT / "examples/drone/px4_goto.csv.gz", "rt", encoding="utf-8", newline=""
    ) as file:
        rows = list(csv.DictReader(file))
    slope = {"slope": "p", "window": "0.4s"}
    mapping = {
        "time": {"from": "sample", "scale": 0.1, "unit": "s"},
        "topics": {
            "seen": {"fields": {"p": "x", "v": slope}},
            "asked": {"fields": {"value": "goal_x"}},
        },
    }
    found = []
    for key in dict.fromkeys((r["set"], r["leg"]) for r in rows):
        path = folder / f"{'-'.join(key)}.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            out = csv.DictWriter(file, list(rows[0]))
            out.writeheader()
            out.writerows(r for r in rows if (r["set"], r["leg"]) == key)
        record = mapped_record(program.program.declared, path, mapping).record
        found.append(Episode(path.stem, record))
    return found


def main() -> None:
    """Read the options and run."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--plants", type=int, default=200)
    parser.add_argument("--held-out", type=int, default=9)
    parser.add_argument("--new", type=int, default=10)
    parser.add_argument("--data", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if args.data is not None:
            strangers(args.data, Path(folder))
        else:
            simulated(args.plants, args.held_out, args.new, Path(folder))


if __name__ == "__main__":
    main()
