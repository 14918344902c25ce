"""Fly laps through the authors' city three ways, then the whole mission; write two reports.

    make demo            (or: .venv/bin/python examples/drone/demo.py)

Purpose: the paper's Section V in one command. Laps with AC alone, RTA-protected and with SC alone;
then the surveillance program with all three modules, once as it is meant and once with a planner
that lies and nobody who charges (`mission.py`).
Non-goals: the 1,000 laps behind docs/benchmarks.md (bench/drone/laps.py), hours of missions
(bench/drone/stack.py).
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from pathlib import Path

import mission
from city_view import CityView
from flights import ARMS, PROGRAM, Lap, flight, read_lap, scene

import soter
from soter.report.html import write_html
from soter.report.run.record import Cell, Comparison, ReportPage
from soter.report.tables import mode_timeline, table

PAPER_LAP_S = {"AdvancedOnly": "10 s", "Protected": "14 s", "SafeOnly": "24 s"}
PAPER_VIOLATIONS = {"AdvancedOnly": "collides", "Protected": "0", "SafeOnly": "0"}
PAPER_SHARE = {"AdvancedOnly": "", "Protected": "> 96 %", "SafeOnly": ""}
ASSUMPTIONS = (
    (
        "φ_safe, ttf and φ_safer of this module are closed forms with margins; that P1c, P2a, P2b "
        "and P3 hold of them is not tested here: `soter verify` of motion_primitive.soter proves "
        "it, under the assumptions that it prints"
    ),
    (
        "wind within ±0.3 m/s² on every axis, redrawn every 0.5 s; position known within ±0.05 m, "
        "velocity within ±0.1 m/s; attitude and body rates exact"
    ),
    (
        "virtual time: plants, DM, SC, then the rest, each in no time at all; execution times and "
        "jitter are not simulated (H leaves 10 ms for them)"
    ),
    "the vehicle is the 13-state Iris model with rotor lag, without drag; as a sphere of 0.35 m",
)


def show(progress: str) -> None:
    """A line of progress on a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{progress}", end="", file=sys.stderr, flush=True)


def fly(program: soter.Program, laps: int) -> dict[str, list[Lap]]:
    """`laps` seeded laps per arm."""
    laps_by_arm: dict[str, list[Lap]] = {}
    for name, title in ARMS.items():
        show(f"{title}: compiling")
        laps_by_arm[name] = []
        for seed in range(1, laps + 1):
            laps_by_arm[name].append(read_lap(program.simulate(name, seed=seed, trace=False)))
            if seed % 10 == 0:
                show(f"{title}: {seed} of {laps} laps")
    show("")
    return laps_by_arm


def row(laps: list[Lap]) -> dict[str, str]:
    """The figures of one arm, as text."""
    clean = [x.lap_s for x in laps if x.lap_s is not None and not x.collided]
    hits = sum(x.collided for x in laps)
    return {
        "lap time (clean laps)": f"{statistics.mean(clean):.1f} s" if clean else "none clean",
        "laps with a collision": f"{hits} of {len(laps)}",
        "switches to SC a lap": f"{statistics.mean(x.switches_to_sc for x in laps):.1f}",
        "AC in control": f"{100 * statistics.mean(x.ac_share for x in laps):.1f} %",
    }


def surveillance(seconds: float, seed: int, output: Path) -> int:
    """Fly the mission and a hostile one, print, write the report; the number of violations."""
    flown = []
    for file, system, title in (
        (mission.STACK, "Protected", "The mission"),
        (mission.HOSTILE, "Buggy", "Buggy planner, no charging"),
    ):
        show(f"{title}: flying")
        flown.append(mission.fly(file, system, title, until_s=seconds, seed=seed))
    show("")
    flight_figures = [mission.quantities(m) for m in flown]
    quantities = dict.fromkeys(q for figures in flight_figures for q in figures)
    rows = [[q, *(figures.get(q, "-") for figures in flight_figures)] for q in quantities]
    print(f"\nthe surveillance program, {seconds:g} s, twice, seed {seed}\n")
    print(table(["", *(m.title for m in flown)], rows, color=sys.stdout.isatty()))
    for m in flown:
        for name, why in m.run.extern_failures.items():
            print(f"first failure of {name}: {why}")
    write_html(mission.page(flown, "make demo"), output)
    return sum(m.run.violations for m in flown)


def main() -> None:
    """Fly, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laps", type=int, default=100, help="laps per arm for the table")
    parser.add_argument("--seconds", type=float, default=600.0, help="of each mission")
    parser.add_argument("--seed", type=int, default=1, help="of the missions")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(".soter/drone.html"),
        help="report of the laps; mission.html lies beside it",
    )
    arguments = parser.parse_args()
    began = time.perf_counter()
    program = soter.load(str(PROGRAM))
    laps = fly(program, arguments.laps)
    figures = {name: row(laps[name]) for name in ARMS}
    paper = {
        "lap time (clean laps)": PAPER_LAP_S,
        "laps with a collision": PAPER_VIOLATIONS,
        "AC in control": PAPER_SHARE,
    }
    rows = []
    for quantity in figures["Protected"]:
        cells = [figures[name][quantity] for name in ARMS]
        theirs = paper.get(quantity, {})
        rows.append([quantity, *cells])
        if theirs:
            rows.append(["  the paper's", *(theirs[name] or "-" for name in ARMS)])
    print(f"\n{arguments.laps} laps g1-g2-g3-g4 between the buildings, three ways\n")
    print(table(["", *ARMS.values()], rows, color=sys.stdout.isatty()))

    # The drawn lap: the first seed at which the autopilot alone hits something.
    seed = next((x.seed for x in laps["AdvancedOnly"] if x.collided), 1)
    flights = []
    print(f"\nthe lap in the report, seed {seed}:")
    for name, title in ARMS.items():
        run = program.simulate(name, seed=seed)
        record = flight(program, name, run)
        bar = mode_timeline(record.time_s, record.in_control, 48)
        lap_s = record.summary["lap_s"]
        hit = "  hits a building" if record.violations else ""
        print(f"  {title:14} {bar} {lap_s:5} s{hit}")
        flights.append(record)
    comparison = Comparison(
        tuple(ARMS.values()),
        tuple(
            (
                quantity,
                tuple(
                    Cell(figures[name][quantity], paper.get(quantity, {}).get(name, ""))
                    for name in ARMS
                ),
            )
            for quantity in figures["Protected"]
        ),
        f"Ours: {arguments.laps} seeded laps per arm of about 37 m between the buildings, wind and "
        "noise drawn anew each lap. The paper's lap, drone and simulator are others: compare "
        "ratios.",
    )
    hits = sum(x.collided for x in laps["Protected"])
    alone = sum(x.collided for x in laps["AdvancedOnly"])
    headline = (
        f"Protected: {hits or 'none'} of {arguments.laps} laps with a collision, "
        f"{figures['Protected']['lap time (clean laps)']} a lap. "
        f"The autopilot alone: {alone} of {arguments.laps} laps."
    )
    page = ReportPage(
        "An RTA-protected drone in the authors' city",
        f"{PROGRAM.name}: systems {', '.join(ARMS)}. Cards, maps and charts show one lap of each, "
        f"of seed {seed}; the table beside the paper is about all laps",
        headline,
        comparison,
        CityView(scene(program)),
        tuple(flights),
        (),
        ASSUMPTIONS,
        {
            "program": program.sha256,
            "seed of the drawn lap": str(seed),
            "soter": soter.__version__,
            "command": "make demo",
        },
    )
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    write_html(page, arguments.output)
    beside = arguments.output.with_name("mission.html")
    broken = surveillance(arguments.seconds, arguments.seed, beside)
    print(f"\nreports: {arguments.output} (the laps), {beside} (the mission)")
    print(f"{time.perf_counter() - began:.1f} s in all")
    print("rests on: declared bounds of wind and estimator error; virtual time; see the reports")
    sys.exit(3 if hits or broken else 0)


if __name__ == "__main__":
    main()
