"""Robots of `soter new --robot` with figures drawn from the ranges of data sheets: how many prove.

    .venv/bin/python bench/verify/robot_kinds.py [--draws 60] [--first 0] [KIND ...]
    .venv/bin/python bench/verify/robot_kinds.py --way [KIND ...]
    .venv/bin/python bench/verify/robot_kinds.py --wrong [KIND ...]

Purpose: *draws*: each figure is drawn from its range in `RANGES`, evenly in its logarithm, and the
program is proved as it is made; `--first`: the number of the first draw (ranges were chosen while
looking at those from 0 to 9). *Proved*: every claim, or decided in flight with P2a and the start
proved, and AC has control of a part of the states. One that is neither that nor safe but for P2b
is asked again with one figure after another at its default: those with which it proves are in its
way. *--way*: the commands from `soter new` to a robot that is proved, checked again, flown and
tested, with their CPU time, on figures that are drawn. *--wrong*: programs of `robot_kinds.txt`
with one thing made wrong: that it is, a run of SC alone shows; then none may be proved.
Non-goals: whether a range is that of somebody's robot.
"""

from __future__ import annotations

import argparse
import math
import random
import re
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import soter
from soter.cli.tool.robot_kinds import texts_of_kind
from soter.language.model.types import duration_ns, write_ns

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from bench.rows import edited, edits_of, rows  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

Figures = dict[str, str]
PROGRAM = "x.soter"
RANGES: dict[str, dict[str, tuple[float | str, float | str]]] = {
    # UR3e to UR16e, Franka, Kinova, Dynamixel Pro; encoders of 12 to 20 bits; 125 Hz to 1 kHz
    "joint": {
        "STOP": (1.5, 6.2), "SPEED": (1.5, 4.0), "TORQUE": (10.0, 150.0), "INERTIA": (1.0, 8.0),
        "RIPPLE": (0.1, 1.0), "Q_ERROR": (0.0001, 0.002), "W_ERROR": (0.005, 0.03),
        "AGE": ("2ms", "16ms"), "ACTS": ("1ms", "8ms"),
    },
    # Igus, Festo, Bosch Rexroth belts and spindles; goods lifts; servo drives of 1 to 20 ms
    "axis": {
        "TRAVEL": (0.5, 30.0), "SPEED": (0.2, 2.5), "LAG": (0.02, 0.3), "PUSH": (0.02, 0.5),
        "P_ERROR": (0.0001, 0.005), "V_ERROR": (0.002, 0.02), "AGE": ("5ms", "40ms"),
        "ACTS": ("1ms", "20ms"),
    },
    # process tanks of 1 to 30 m^3; Grundfos CR, KSB Etanorm; ultrasonic and pressure gauges
    "tank": {
        "AREA": (0.8, 12.0), "LOW": (0.1, 0.5), "HIGH": (1.5, 4.0), "PUMP": (15.0, 60.0),
        "DRAW": (4.0, 12.0), "DRAIN": (2.0, 15.0), "GAUGE": (0.003, 0.05),
        "AGE": ("200ms", "2s"), "ACTS": ("200ms", "5s"),
    },
    # laboratory ovens, baths, heated beds of printers; thermocouples of classes 1 and 2, Pt100
    "heater": {
        "POWER": (300.0, 3000.0), "ELEMENT": (80.0, 400.0), "CONTACT": (5.0, 20.0),
        "OVEN": (1500.0, 20000.0), "LOSS": (1.0, 4.0), "LIMIT": (100.0, 250.0),
        "KEEP": (30.0, 70.0), "DOOR": (10.0, 60.0), "T_ERROR": (0.3, 2.5), "AGE": ("200ms", "2s"),
        "ACTS": ("20ms", "400ms"),
    },
    # BlueROV2, Sparus, inspection vehicles; Bar30 and Keller sensors; DVLs of 4 to 10 Hz
    "auv": {
        "SHALLOW": (1.0, 3.0), "DEEP": (15.0, 150.0), "SPEED": (0.2, 1.5), "LAG": (0.3, 1.5),
        "SURGE": (0.01, 0.1), "Z_ERROR": (0.02, 0.2), "W_ERROR": (0.005, 0.04),
        "AGE": ("50ms", "250ms"), "ACTS": ("10ms", "100ms"),
    },
    # CubeSats to servicers; Fehse; lidars, cameras
    "docking": {
        "MASS": (8.0, 60.0), "THRUST": (0.5, 5.0), "TOUCH": (0.04, 0.15), "GLIDE": (0.01, 0.03),
        "FAR": (50.0, 150.0), "WAITS": (12.0, 25.0), "PUSH": (0.004, 0.04),
        "R_ERROR": (0.01, 0.06), "V_ERROR": (0.001, 0.005), "AGE": ("100ms", "300ms"),
        "ACTS": ("10ms", "100ms"),
    },
    # PX4 and ArduPilot: their parameters' ranges, GNSS of 5 to 10 Hz, links of telemetry
    "multicopter": {
        "EAST": (25.0, 150.0), "NORTH": (25.0, 150.0), "FLOOR": (1.0, 4.0),
        "CEILING": (20.0, 120.0), "FAST": (2.0, 8.0), "CLIMB": (1.0, 3.0), "LAG": (0.3, 1.2),
        "GUST": (0.1, 0.4), "P_ERROR": (0.1, 1.0), "V_ERROR": (0.05, 0.2),
        "AGE": ("50ms", "200ms"), "ACTS": ("10ms", "80ms"),
    },
    # cars and shuttles at 5 to 30 m/s; lane cameras, RTK
    "car": {
        "SPEED": (5.0, 25.0), "WHEELBASE": (2.3, 3.2), "STEER": (0.4, 0.6), "LATERAL": (2.0, 4.0),
        "EDGE": (0.7, 1.6), "SLIP": (0.0001, 0.001), "Y_ERROR": (0.02, 0.08),
        "H_ERROR": (0.002, 0.008), "AGE": ("10ms", "40ms"), "ACTS": ("1ms", "10ms"),
    },
    # TurtleBot3 and 4, Jackal, MiR100
    "rover": {
        "LENGTH": (6.0, 40.0), "WIDTH": (5.0, 20.0), "BODY": (0.1, 0.6), "SPEED": (0.2, 2.0),
        "SPIN": (0.5, 3.0), "LAG": (0.08, 0.4), "DRAG": (0.02, 0.2), "P_ERROR": (0.01, 0.1),
        "H_ERROR": (0.005, 0.03), "V_ERROR": (0.005, 0.05), "AGE": ("20ms", "100ms"),
        "ACTS": ("2ms", "15ms"),
    },
    # small aircraft of ArduPlane and PX4: their parameters' ranges
    "aircraft": {
        "SPEED": (14.0, 35.0), "FLOOR": (20.0, 100.0), "DIVE": (0.2, 0.5), "CLIMB": (0.12, 0.25),
        "LAG": (0.3, 1.2), "SINK": (0.2, 1.0), "H_ERROR": (1.0, 6.0), "G_ERROR": (0.005, 0.03),
        "AGE": ("20ms", "100ms"), "ACTS": ("5ms", "40ms"),
    },
    # small craft and surface vehicles; GNSS of 2 to 10 Hz
    "boat": {
        "SPEED": (1.5, 6.0), "BANK": (15.0, 80.0), "TURN": (0.4, 0.8), "LAG": (1.5, 5.0),
        "CURRENT": (0.05, 0.4), "YAW": (0.005, 0.03), "Y_ERROR": (0.1, 1.5),
        "H_ERROR": (0.005, 0.04), "AGE": ("200ms", "600ms"), "ACTS": ("50ms", "300ms"),
    },
    # UR, Franka, Fanuc CRX; SICK and Hokuyo scanners: response times of 60 to 200 ms
    "arm": {
        "REACH": (0.1, 0.6), "SPEED": (0.25, 2.0), "LAG": (0.05, 0.3), "CRAWL": (0.03, 0.1),
        "WALK": (1.6, 2.0), "D_ERROR": (0.03, 0.1), "V_ERROR": (0.002, 0.02),
        "AGE": ("40ms", "160ms"), "ACTS": ("2ms", "20ms"),
    },
}  # fmt: skip


def drawn(kind: str, seed: int) -> Figures:
    """Figures of one robot of a kind."""
    chance, figures = random.Random(f"{kind} {seed}"), Figures()  # noqa: S311 - repeatable
    for name, (low, high) in RANGES[kind].items():
        if isinstance(low, str):
            ends = math.log(duration_ns(low)), math.log(duration_ns(high))
            figures[name] = write_ns(round(math.exp(chance.uniform(*ends)) / 1e6) * 10**6)
        else:
            figures[name] = f"{math.exp(chance.uniform(math.log(low), math.log(float(high)))):.3g}"
    return figures


def made(kind: str, figures: Figures) -> dict[str, str]:
    """The files of a robot that is called x."""
    given = [f"{name}={value}" for name, value in figures.items()]
    return texts_of_kind(kind, {"name": "x", "prefix": "x"}, given, None)


def answer(text: str) -> tuple[str, float, str]:
    """Verdict, CPU seconds, and the rows of the claims that are open."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    try:
        report = soter.load(PROGRAM, text=text).verify(refute=False, explain=False)
        verdict, told = verdict_of(report.modules[0])
    except soter.SoterError as error:
        verdict, told = "neither", str(error)[:300]
    return verdict, resource.getrusage(resource.RUSAGE_SELF).ru_utime - before, told


def verdict_of(module: ModuleResult) -> tuple[str, str]:
    """`proved`, `but for P2b` or `neither`, and why."""
    found = module.findings
    is_open = [n for n, p in found.items() if p.verdict not in ("proved", "assumed")]
    flown = found["P3"].verdict == "assumed"
    if flown and not all(found[n].verdict == "proved" for n in ("P2a", "start")):
        is_open.append("start")
    if module.vacuity is not None:
        return "neither", module.vacuity.text
    verdict = "neither" if set(is_open) - {"P2b"} else "but for P2b" if is_open else "proved"
    return verdict, "; ".join(f"{n}: {found[n].text}"[:160] for n in is_open)


def in_the_way(kind: str, figures: Figures) -> list[str]:
    """The figures of which the default is enough for a proof."""
    others = ({n: v for n, v in figures.items() if n != name} for name in figures)
    proved = [answer(made(kind, o)[PROGRAM])[0] == "proved" for o in others]
    return [name for name, fine in zip(figures, proved, strict=True) if fine]


def print_draws(names: list[str], first: int, draws: int) -> int:
    total: Counter[str] = Counter()
    for kind in names:
        counts, spent = Counter[str](), list[float]()
        for seed in range(first, first + draws):
            figures = drawn(kind, seed)
            verdict, cpu_s, told = answer(made(kind, figures)[PROGRAM])
            counts[verdict] += 1
            spent.append(cpu_s)
            if verdict != "proved":
                way = ", ".join(in_the_way(kind, figures)) if verdict == "neither" else ""
                print(f"  {kind} {seed}: {verdict}; in the way: {way or '-'}; {told}")
                print("   ", " ".join(f"{n}={v}" for n, v in figures.items()), flush=True)
        told = f"{counts['but for P2b']} but for P2b, {counts['neither']} neither"
        most = f"CPU s {sum(spent) / draws:.1f}, at most {max(spent):.1f}"
        print(f"{kind}: {counts['proved']} of {draws} proved, {told}; {most}", flush=True)
        total += counts
    count = sum(total.values())
    safe = total["proved"] + total["but for P2b"]
    print(f"draws: proved {total['proved']} of {count} ({total['proved'] / count:.0%}, target 85%)")
    print(f"proved or safe but for P2b {safe} of {count} ({safe / count:.0%}, target 97%)")
    return 0


def print_way(names: list[str]) -> int:
    """The way of each kind, on figures that are drawn; 1 where one does not end well."""
    bad = 0
    for kind in names:
        given = [word for n, v in drawn(kind, 0).items() for word in ("--set", f"{n}={v}")]
        commands = (
            ("soter", "new", "x", "--robot", kind, *given),
            ("soter", "verify", "x/x.soter", "--cert", "proof"),
            ("soter", "recheck", "proof"),
            ("soter", "run", "x/x.soter", "--system", "Troubled"),
            ("unittest", "discover", "x"),
        )
        before, exits = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, list[int]()
        with tempfile.TemporaryDirectory() as folder:
            for command in commands:
                line = [sys.executable, "-m", *command]
                done = subprocess.run(line, cwd=folder, capture_output=True, check=False)
                exits.append(done.returncode)
        spent = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        bad += any(exits)
        print(f"{kind}: {len(commands)} commands, exits {exits}, CPU s {spent:.1f}", flush=True)
    print(f"ways: {len(names) - bad} of {len(names)} end well in 5 commands")
    return bad > 0


def print_wrong(names: list[str]) -> int:
    """Programs made wrong: shown to be, and proved; 1 where one is proved, or not shown."""
    counts: Counter[str] = Counter()
    for row in rows(HERE / "robot_kinds.txt", (), {}):
        if row.section not in names:
            continue
        text = made(row.section, {})[PROGRAM]
        edits = tuple(edit for line in row.said[""] for edit in edits_of(line, {}))
        text = edited(text, edits)
        alone = text.replace("force Guard ac;", "force Guard sc;")
        flown = soter.load(PROGRAM, text=with_own_policy(alone))
        shown = any(flown.simulate("Unguarded", seed=k).violations for k in range(10))
        verdict = answer(text)[0]
        counts.update(asked=1, shown=shown, proved=verdict == "proved")
        if verdict == "proved" or not shown:
            print(f"  {row.section}: {row.name}: {verdict}, shown to be wrong: {shown}")
    print(f"wrong variants {counts['asked']}, shown to be {counts['shown']}")
    print(f"proved {counts['proved']} (target 0)")
    return counts["proved"] > 0 or counts["shown"] < counts["asked"]


def with_own_policy(text: str) -> str:
    """The program with SC's own text in the place of AC, which has no control in it."""
    sc = re.search(r"^  sc (\w+);", text, re.MULTILINE)
    assert sc is not None
    node = re.search(rf"^node {sc[1]} .*?^}}\n", text, re.MULTILINE | re.DOTALL)
    assert node is not None
    learned = re.sub(r"^node \w+", "node Learned", node[0])
    return re.sub(r"^extern node .*?^}\n", lambda _: learned, text, flags=re.MULTILINE | re.DOTALL)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("kinds", nargs="*")
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--way", action="store_true")
    parser.add_argument("--wrong", action="store_true")
    options = parser.parse_args()
    names = options.kinds or list(RANGES)
    if options.way:
        return print_way(names)
    return print_wrong(names) if options.wrong else print_draws(names, options.first, options.draws)


if __name__ == "__main__":
    sys.exit(main())
