"""Six wrong variants of each robot of a folder: none may be proved in full.

    .venv/bin/python bench/newcomers/wrong_robots.py [--folder ../shared/robots]
        [--without-hints] [--kept .soter/newcomers] [NAME ...]

Purpose: a variant changes one thing of a robot's program: SC, an error, a disturbance, a time, a
set, an equation. That it is wrong is shown first, by flights that know nothing of Soter:
from *every* state of a lattice of `safe` some flight of SC, or of AC until the DM may act and SC
then, leaves `safe`; of a variant with sets of its own, from some state that leaves AC in control.
Then the proof of `soter verify` is asked, without its advice and without its search for a run that
violates. `--without-hints`: hints at a proof are taken out first, so that it
has to be searched for; variants whose sets are their own are left out, as those would go with them.
*Decided in flight* with P2a and the start proved is proved, too. Answers are kept, by program and
the tool's sources: the next call goes on.
Non-goals: the robots as they stand (`first_attempt.py`); other wrong modules
(`bench/wrong_modules`).
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.verify.claims.results import ASSUMED, PROVED, UNDECIDED

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from bench.newcomers.equations import robot_of  # noqa: E402 - needs the path
from bench.newcomers.first_attempt import HELD, kept, tool, without_hints  # noqa: E402
from bench.newcomers.flights import leaves  # noqa: E402

SAFE = ("P2a", "start")
Ends = dict[str, tuple[float | None, float | None]]


@dataclass(frozen=True)
class Wrong:
    """One robot made wrong: why it is, and what stands in the program in place of what."""

    why: str
    edits: dict[str, str]
    until_s: float | None = None
    """How long it flies, where the right robot needs not fly as long."""
    left: Ends = field(default_factory=dict)
    """Where sets of its own leave AC in control, {}: sets are computed."""


def sets(why: str, **left: tuple[float | None, float | None]) -> Wrong:
    """AC is left in control until what is measured (`b_y` is `b.y`) leaves these ends."""
    ends = {name.replace("_", "."): two for name, two in left.items()}
    sides = [(name, *side) for name, two in ends.items() for side in zip("<>", two, strict=True)]
    out = " || ".join(f"{name} {than} {end}" for name, than, end in sides if end is not None)
    return Wrong(why, {"  verify {": f"  ttf {out};\n  safer !({out});\n  verify {{"}, left=ends)


def ovens() -> tuple[Wrong, ...]:
    """Of both."""
    return (
        Wrong("SC heats most where it is hot", {"(0.5 + 0.02 *": "(0.5 - 0.02 *"}),
        Wrong("SC heats always", {"clamp(0.5 + 0.02 * (100.0 - temp), 0.0, 1.0)": "0.8"}),
        Wrong("SC never heats enough", {"temp), 0.0, 1.0)": "temp), 0.0, 0.25)"}),
        Wrong("the door costs more than SC heats", {"in [-0.05, 0.02]": "in [-1.3, 0.02]"}),
        Wrong("the temperature is measured within 60 K", {"temp within 0.5": "temp within 60.0"}),
        Wrong("readings are minutes old", {"max_age 2s": "max_age 120s"}),
    )


VARIANTS = {
    "boat": (
        Wrong("SC's rudder is weaker than the waves", {"b.r, -D, D": "b.r, -0.06, 0.06"}),
        Wrong("SC steers away", {"-0.05 * b.y": "0.05 * b.y"}),
        Wrong("SC's course has the wrong sign", {"1.2 * (wanted": "-1.2 * (wanted"}),
        Wrong("the current is faster than the boat", {"in [-0.4, 0.4]": "in [-3.2, 3.2]"}),
        Wrong("y is measured within 35 m", {"b.y within 0.5": "b.y within 35.0"}),
        sets("AC is left until the last half metre", b_y=(-29.5, 29.5)),
    ),
    "car_on_a_lane": (
        Wrong(
            "SC turns less than the road",
            {"3.0 * pose.h, -TURN, TURN": "3.0 * pose.h, -0.015, 0.015"},
        ),
        Wrong("SC steers away from the middle", {"-0.25 * pose.y": "0.25 * pose.y"}),
        Wrong("SC holds the heading only", {"-0.25 * pose.y - 3.0": "-3.0"}, 200.0),
        Wrong("y is measured within 2 m", {"pose.y within 0.05": "pose.y within 2.0"}),
        Wrong("the road bends more than the car", {"in [-0.02, 0.02]": "in [-0.3, 0.3]"}),
        Wrong("readings 3 s old", {"max_age 40ms": "max_age 3s"}),
    ),
    "cruise_control": (
        Wrong(
            "SC never brakes", {"-BRAKE, v > 29.0 ? 0.0 : A)": "0.1, v > 29.0 ? 0.1 : A)"}, 200.0
        ),
        Wrong("SC keeps a distance of minus 30 m", {"1.0 * v - 4.0": "1.0 * v + 30.0"}, 200.0),
        Wrong("the gap is measured within 160 m", {"gap within 0.3": "gap within 160.0"}, 200.0),
        Wrong("the lead may drive backwards", {"lead <= 0.0 &&": "lead <= -5.0 &&"}, 200.0),
        Wrong("readings 9 s old", {"max_age 60ms": "max_age 9s"}, 100.0),
        sets("AC is left until the last metre", seen_gap=(1.0, None)),
    ),
    "differential_drive": (
        Wrong("SC goes on slowly", {"{ v: 0.0, w: 0.0 };": "{ v: 0.3, w: 0.0 };"}, 80.0),
        Wrong("it rolls by itself", {"8.0 * (cmd.v - v)": "8.0 * (cmd.v + 0.2 - v)"}, 80.0),
        Wrong(
            "it is pushed",
            {
                "  der x = v * cos(h)": "  disturbance push: float in [-0.2, 0.2];\n"
                "  der x = v * cos(h) + push"
            },
            80.0,
        ),
        Wrong("readings 20 s old", {"max_age 50ms": "max_age 20s"}),
        Wrong(
            "SC turns on the spot, and half of the heading counts",
            {"{ v: 0.0, w: 0.0 };": "{ v: 0.3, w: 0.0 };", "(h)": "(0.5 * h)"},
            80.0,
        ),
        sets("AC is left until the last decimetre", p_x=(-4.9, 4.9), p_y=(-4.9, 4.9)),
    ),
    "dubins_uav": (
        Wrong(
            "SC flies straight on",
            {"clamp(V / R + 1.0 * wrap_angle(wanted - pose.h), -W, W)": "0.0"},
        ),
        Wrong(
            "SC circles wider than the arena",
            {"wanted - pose.h), -W, W)": "wanted - pose.h), -0.03, 0.03)"},
        ),
        Wrong(
            "SC circles with the wind, wherever it is",
            {"clamp(V / R + 1.0 * wrap_angle(wanted - pose.h), -W, W)": "0.25"},
            900.0,
        ),
        Wrong("more wind than speed", {"wx: float in [-1.0, 1.0]": "wx: float in [-14.0, 14.0]"}),
        Wrong("the place is measured within 400 m", {"within 1.0": "within 400.0"}, 600.0),
        Wrong("a heading that is no period: half of it counts", {"(h)": "(0.5 * h)"}),
    ),
    "emergency_brake": (
        Wrong(
            "SC brakes less than the road pushes", {"accel = -BRAKE; }": "accel = -0.3; }"}, 400.0
        ),
        Wrong(
            "SC goes on slowly",
            {"accel = -BRAKE; }": "accel = clamp(0.5 - seen.v, -BRAKE, A); }"},
            400.0,
        ),
        Wrong(
            "the road pushes more than the brake holds", {"in [-0.5, 0.5]": "in [-6.5, 6.5]"}, 400.0
        ),
        Wrong("the gap closes where it stands", {"der gap = -v;": "der gap = -v - 0.2;"}, 600.0),
        Wrong("readings 9 s old", {"max_age 60ms": "max_age 9s"}),
        sets("AC is left until the last metre", seen_gap=(1.0, None)),
    ),
    "ground_avoidance": (
        Wrong(
            "SC pulls less than its weight",
            {"wanted - f.g), -1.0, 5.0)": "wanted - f.g), -1.0, 0.5)"},
        ),
        Wrong("SC descends", {"clamp(0.002 * (1000.0 - f.h), -0.2, 0.2)": "-0.1"}),
        Wrong("SC levels off below the ground", {"(1000.0 - f.h)": "(40.0 - f.h)"}),
        Wrong("gusts of 60 m/s downwards", {"in [-2.0, 2.0]": "in [-60.0, 2.0]"}),
        Wrong("the height is measured within 1,200 m", {"f.h within 3.0": "f.h within 1200.0"}),
        sets("AC is left until the last 10 m", f_h=(60.0, None)),
    ),
    "hopper": (
        Wrong("SC thrusts too little", {"0.1 + 0.5 * (0.4": "0.03 + 0.05 * (0.4"}),
        Wrong("SC thrusts most where it is high", {"0.1 + 0.5 * (0.4": "0.1 - 0.5 * (0.4"}),
        Wrong(
            "SC overshoots",
            {
                "0.1 + 0.5 * (0.4 - apex), 0.0, 0.3)": "0.1 + 9.0 * (0.4 - apex), 0.0, 0.9)",
                "[0.0, 0.3]": "[0.0, 0.9]",
            },
        ),
        Wrong("the ground moves by more than SC", {"in [-0.03, 0.03]": "in [-0.3, 0.3]"}),
        Wrong(
            "the apex is measured within 40 cm",
            {"apex within 0.01": "apex within 0.4", "0.1 + 0.5 * (0.4": "0.1 + 1.0 * (0.4"},
        ),
        sets("AC is left until the last centimetre", apex=(0.17, 0.78)),
    ),
    "lift": (
        Wrong("SC drives away", {"0.35 * (15.0 - m.h)": "-0.35 * (15.0 - m.h)"}),
        Wrong("the speed has the wrong sign", {"0.9 * (v - m.v)": "-0.9 * (v - m.v)"}),
        Wrong("the acceleration is not fed back", {"4.0 * (a - m.a)": "4.0 * a"}),
        Wrong("more sway than SC accelerates", {"in [-0.05, 0.05]": "in [-1.2, 1.2]"}),
        Wrong("the speed is measured within 2.5 m/s", {"m.v within 0.02": "m.v within 2.5"}),
        Wrong("readings 3 s old", {"max_age 40ms": "max_age 3s"}),
    ),
    "motor": (
        Wrong("SC drives on", {"m.i - clamp(": "m.i + clamp("}, 1.0),
        Wrong(
            "SC shorts the wrong way",
            {"0.0302 * m.w - 0.2 * m.i - clamp(0.01 * m.w, -3.0, 3.0)": "6.0 * m.i"},
        ),
        Wrong("SC holds 40 A", {"- 0.2 * m.i - clamp(0.01 * m.w, -3.0, 3.0)": "+ 0.299 * 40.0"}),
        Wrong("a load that SC does not hold", {"in [-0.05, 0.05]": "in [-1.0, 1.0]"}),
        Wrong("the current is measured within 60 A", {"m.i within 0.1": "m.i within 60.0"}),
        Wrong("readings 3 ms old", {"max_age 40us": "max_age 3ms"}),
    ),
    "oven": ovens(),
    "pendulum": (
        Wrong("SC is weaker than the push", {"3.0 * p.w, -T, T)": "3.0 * p.w, -0.03, 0.03)"}),
        Wrong("SC holds less than gravity pulls", {"-12.0 * p.a": "-4.0 * p.a"}),
        Wrong("SC undamps", {"- 3.0 * p.w": "+ 3.0 * p.w"}),
        Wrong("pushed more than SC holds", {"in [-0.1, 0.1]": "in [-6.5, 6.5]"}),
        Wrong("the angle is measured within .3 rad", {"p.a within 0.005": "p.a within 0.3"}),
        Wrong("readings 600 ms old", {"max_age 50ms": "max_age 600ms"}),
    ),
    "six_joints": (
        Wrong("SC is weaker than what disturbs", {"4.0 * j.w, A)": "4.0 * j.w, 0.4)"}),
        Wrong("SC undamps", {"- 4.0 * j.w": "+ 1.0 * j.w"}),
        Wrong("SC damps only", {"-4.0 * j.q - 4.0 * j.w": "-4.0 * j.w"}, 60.0),
        Wrong("more disturbance than SC", {"in [-0.5, 0.5]": "in [-6.0, 6.0]"}),
        Wrong("the angle is measured within 4 rad", {"j.q within 0.001": "j.q within 4.0"}),
        Wrong("readings 2 s old", {"max_age 10ms": "max_age 2s"}),
    ),
    "slow_oven": ovens(),
}
FLOWN_S = {
    "boat": 150.0,
    "car_on_a_lane": 40.0,
    "cruise_control": 60.0,
    "differential_drive": 30.0,
    "dubins_uav": 300.0,
    "emergency_brake": 60.0,
    "ground_avoidance": 300.0,
    "hopper": 40.0,
    "lift": 90.0,
    "motor": 0.3,
    "oven": 1500.0,
    "pendulum": 20.0,
    "six_joints": 20.0,
    "slow_oven": 1500.0,
}
"""How long each robot flies."""
STARTS: dict[str, Ends] = {
    "cruise_control": {"seen.v": (0.0, None), "seen.lead": (0.0, None)},
    "emergency_brake": {"seen.v": (0.0, None)},
}
"""Where flights begin inside of the grid: no car drives backwards."""
RIGHT = {"motor": Wrong("nothing but readings 40 us old", {"max_age 100us": "max_age 40us"})}
"""What is changed in a robot first: as it stands AC may leave from everywhere, one way or other."""


NOTHING = Wrong("nothing", {})
READERS = "equations", "flights"


def edited(text: str, wrong: Wrong) -> str:
    """The program of a variant; every edit must fit, once or more often."""
    for old, new in wrong.edits.items():
        assert old in text, (wrong.why, old)
        text = text.replace(old, new)
    return text


def flown(name: str, text: str, wrong: Wrong) -> dict[str, int]:
    """From how many starts a program leaves `safe`, of how many."""
    ends = {**STARTS.get(name, {}), **wrong.left}
    robot = robot_of(text, wrong.until_s or FLOWN_S[name], ends)
    left, starts = leaves(robot, own_sets=bool(wrong.left))
    return {"left": left, "starts": starts}


def answered(name: str, text: str) -> dict[str, Any]:
    """What `verify` says of a program, and its CPU seconds."""
    began = cpu_now_s()
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / f"{name}.soter"
        program.write_text(text)
        try:
            (module,) = soter.load(program).verify(refute=False, explain=False).modules
        except SoterError as error:
            return {"verdict": f"error {error.diagnostics[0].code}", "cpu_s": cpu_now_s() - began}
    if module.verdict == ASSUMED and all(module.findings[c].verdict == PROVED for c in SAFE):
        return {"verdict": HELD[1], "cpu_s": cpu_now_s() - began}
    open_ = [claim for claim, f in module.findings.items() if f.verdict == UNDECIDED]
    undecided = f"undecided: {', '.join(open_)}"
    verdict = undecided if module.verdict == UNDECIDED else module.verdict
    return {"verdict": verdict, "cpu_s": cpu_now_s() - began}


def cpu_now_s() -> float:
    """CPU seconds of this process and of the compilers that it started."""
    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(use.ru_utime + use.ru_stime for use in uses)


def flights_of(folder: Path, name: str, text: str, wrong: Wrong) -> dict[str, Any]:
    """How it flies."""
    reader = "".join((HERE / f"{file}.py").read_text() for file in READERS)
    about = text, reader, f"{FLOWN_S[name]} {STARTS.get(name)} {wrong}"
    return kept(folder, about, partial(flown, name, text, wrong))


def main(argv: list[str]) -> int:
    """0; 3 where one is proved, or flights show something else."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("--without-hints", action="store_true")
    parser.add_argument("--kept", type=Path, default=ROOT / ".soter" / "newcomers")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    names = options.names or list(VARIANTS)
    told, bare = Counter[str](), options.without_hints
    print("| robot | what is wrong | starts that leave `safe` | `soter verify` | CPU s |")
    print("|---|---|---|---|---|")
    for name in names:
        stands, nothing = (options.folder / f"{name}.soter").read_text(), RIGHT.get(name, NOTHING)
        for wrong in (nothing, *(v for v in VARIANTS[name] if not (bare and v.left))):
            text = edited(stands, nothing)
            text = text if wrong is nothing else edited(text, wrong)
            of = flights_of(options.kept, name, text, wrong)
            leaving, verdict, cpu_s = f"{of['left']} of {of['starts']}", "-", "-"
            told["right robots fly"] += wrong is nothing and of["left"] < of["starts"]
            shown = of["left"] >= (1 if wrong.left else of["starts"])
            told["shown to be wrong"] += wrong is not nothing and shown
            told["flown and not so"] += shown == (wrong is nothing)
            if wrong is not nothing:
                text = without_hints(text) if bare else text
                asked = name, text, tool()
                answer = kept(options.kept, asked, partial(answered, name, text))
                verdict, cpu_s = answer["verdict"], f"{answer['cpu_s']:.0f}"
                told[verdict.partition(":")[0]] += 1
                told["asked"] += 1
            print(f"| {name} | {wrong.why} | {leaving} | {verdict} | {cpu_s} |", flush=True)
    count = sum(not (bare and v.left) for name in names for v in VARIANTS[name])
    proved = sum(told[verdict] for verdict in HELD)
    print(
        f"\n{proved} of {told['asked']} wrong variants proved, {told['refuted']} refuted, "
        f"{count - told['asked']} not asked yet; {told['shown to be wrong']} of {count} shown to "
        f"be wrong; {told['right robots fly']} of {len(names)} right robots fly"
    )
    return 3 if proved or told["flown and not so"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
