"""Run every benchmark and write docs/benchmarks.md from what they print.

    make bench            (or: .venv/bin/python bench/run_all.py [--only NAME | --write])

Purpose: no figure in the docs that a command did not make. bench/results.json holds when each
command ran, at which commit and where; docs/benchmarks/ what it printed, below a line of `=`, with
notes beside that, and above the line what to know before: the first lines of the program that ran,
until somebody writes something better there. The table of the page is made of both. `--only` makes
one row anew, `--write` but the page.
Non-goals: judging; every benchmark prints its targets beside its figures.
"""

from __future__ import annotations

import argparse
import ast
import json
import platform
import re
import shlex
import subprocess
import sys
import textwrap
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from bench.headlines import headlines, targets  # noqa: E402 - needs the path

PAGE = ROOT / "docs" / "benchmarks.md"
OUTPUTS = ROOT / "docs" / "benchmarks"
RESULTS = ROOT / "bench" / "results.json"
BLOCK = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
RULE = "=" * 80
"""Above it is what this program writes into a file of an output."""
CITED = re.compile(r"\[[\d-]{10}, [0-9a-f]{8}\]\(benchmarks/([\w-]+\.txt)\)")
"""A row as other pages cite it, by when it was made and after which commit."""
HEAD = """# Benchmarks

Written by `make bench`, a command a row. The name leads to the whole output and to the sentences
that say what it means. *Last* are lines of that output, or the cells of a table in it that matter
most. The machines are shared ones with two cores: read ratios and medians, not single times.
*Machine* is empty where nobody wrote it down; an empty target means that the benchmark states none.

A change is committed with its own figures, a line of [line.jsonl](benchmarks/line.jsonl) that `make
bench-line` appends in some minutes. All lines so far, each figure from its least to its largest:

![Figures of each change: lines of code, times as ratios, slips, escapes, outputs](img/line.svg)

| what | target | last | made | machine | command |
|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Result:
    """What a command printed: when (YYYY-MM-DD), after which commit, where, with notes around.

    `about` is what to know before.
    """

    command: str
    made: str
    commit: str
    machine: str
    text: str
    about: str = ""


@dataclass(frozen=True)
class Benchmark:
    """A row of the page: its name, and what of Python's command line stands behind `python`.

    `last` and `heads` say which lines and columns of it the table shows: see bench/headlines.py.
    """

    name: str
    arguments: str
    last: str = ""
    heads: str = ""


BENCHMARKS = (
    Benchmark("Slips of newcomers", "bench/newcomers/slips.py"),
    Benchmark("The drone's laps", "bench/drone/laps.py"),
    Benchmark(
        "Hostile advanced controllers", "bench/drone/laps.py --adversaries", heads="violations"
    ),
    Benchmark("The surveillance drone, whole", "bench/drone/stack.py --missions 10000"),
    Benchmark(
        "The drone against the plant of its proof",
        "bench/drone/conformance.py",
        last="Protected|Rhythmic",
        heads="flights|of D",
    ),
    Benchmark(
        "The drone on MuJoCo's rigid body",
        "bench/drone/off_model.py --hours 10 --system Protected",
        heads="violations|alarms|of D",
    ),
    Benchmark(
        "Go-to legs that PX4 flew",
        "bench/drone/real_logs.py",
        last="%",
        heads="tube|legs|left the tube|AC share",
    ),
    Benchmark(
        "The rhythm that the drone follows worst", "bench/drone/rhythms.py", last=r"sequences of"
    ),
    Benchmark(
        "Coverage of the C that ships",
        "bench/c_code/c_coverage.py",
        last="nothing found|under ASan",
    ),
    Benchmark("The C that ships under Frama-C's EVA", "bench/c_code/static_analysis.py"),
    Benchmark(
        "Filters of others on the same flights",
        "bench/peers/beside_peers.py --rta rta/bin/python --hj hj/bin/python"
        " --gatekeeper safe_control --rtreach rtreach/src/rtreach",
        last=r"^ *soter",
    ),
    Benchmark("What a check of rest costs", "bench/tubes/check_cost.py", last="mean"),
    Benchmark(
        "A check of rest on a Cortex-M7",
        "bench/tubes/check_cost.py --board mps2-an500",
        heads="takes|inside",
    ),
    Benchmark("Bad files and options", "bench/hostile/bad_input.py --count 1000 --jobs 2"),
    Benchmark("Hostile files", "bench/hostile/hostile_files.py"),
    Benchmark(
        "Policies of every kind against their libraries",
        "bench/policies/policy_kinds.py --peer peer/bin/python",
        last="kinds:",
    ),
    Benchmark(
        "Damaged logs",
        "bench/hostile/damaged_logs.py",
        last="damaged logs:|without a word|changed bits",
    ),
    Benchmark(
        "Logs of strangers",
        "bench/hostile/logs_of_strangers.py --data strangers",
        last="logs of",
        heads="files|read|in part|refused|values|differ",
    ),
    Benchmark(
        "The mountain car: four drivers, alone and with RTA", "bench/running/mountain_car.py"
    ),
    Benchmark(
        "The mountain car: Gymnasium against the proved map",
        "bench/running/mountain_car.py --conformance",
    ),
    Benchmark(
        "The mountain car: training with and without the module",
        "examples/mountain_car/train.py -o .soter/policy.json",
        last="falls",
    ),
    Benchmark("What people wait for", "bench/quick.py"),
    Benchmark(
        "From the wheel to proved, re-checked, flown",
        "bench/newcomers/from_wheel.py --everything --tools",
    ),
    Benchmark(
        "The surveillance drone: stacks that must not be proved", "bench/drone/wrong_stacks.py"
    ),
    Benchmark("The house", "bench/house/house_figures.py"),
    Benchmark(
        "Mutants of Python before and after the tests were made faster",
        "bench/house/mutation_sample.py --before ../before --count 156",
    ),
    Benchmark("Axes that wrap around", "bench/verify/wrapping.py --systems 300 --wide 6"),
    Benchmark(
        "The model of time against every schedule", "bench/verify/time_model.py", heads="exceeded"
    ),
    Benchmark(
        "The same schedules against figures that are wrong on purpose",
        "bench/verify/time_model.py --blind all --systems 200",
    ),
    Benchmark("Threads: the analysis against executions", "bench/verify/schedulability.py"),
    Benchmark(
        "The same sets, with something hidden from the analysis",
        "bench/verify/schedulability.py --blind --sets 1000",
        heads="accepted, and one misses|refused, instance does not",
    ),
    Benchmark(
        "P1c of deployed modules against all executions",
        "bench/verify/p1c_phases.py",
        last="exceeded",
    ),
    Benchmark(
        "The same switches, with something the program does not say",
        "bench/verify/p1c_phases.py --blind --cases 500",
        last=" of 500",
    ),
    Benchmark(
        "Wrong modules that must not be proved without a word",
        "bench/wrong_modules/verdicts.py",
        last=r"^(wrong modules|proved \(|control arms)",
    ),
    Benchmark("Random problems and adversaries", "bench/verify/soundness.py"),
    Benchmark(
        "A closed-loop adversary against proved modules",
        "bench/adversary/against_proofs.py --modules 300 --steps 300000000",
        last="^all ",
        heads="proved|safe only|violations",
    ),
    Benchmark(
        "A closed-loop adversary against shields",
        "bench/adversary/against_shields.py",
        heads="violations",
    ),
    Benchmark(
        "Topics that fall silent one by one",
        "bench/adversary/topics_apart.py",
        last="^flights|^programs",
    ),
    Benchmark("Shields that are wrong", "bench/adversary/against_shields.py --wrong"),
    Benchmark("Holes put back into the prover", "bench/adversary/against_proofs.py --holes"),
    Benchmark(
        "The same adversaries against an engine that is not told everything",
        "bench/verify/soundness.py --blind --problems 8",
        heads="problems with escapes|escapes",
    ),
    Benchmark(
        "Verify, recheck and run against each other",
        "bench/verify/contradictions.py --modules 450 --stiff 50",
    ),
    Benchmark("The time of soter recheck", "bench/recheck/beside_verify.py"),
    Benchmark(
        "An F-16 of JSBSim beside its model", "bench/tubes/identify_f16.py", last="the bounds"
    ),
    Benchmark(
        "Dives of an F-16 of JSBSim",
        "bench/tubes/dives.py",
        last="^all |left the model|^alarms",
        heads="dives|hit alone|hit with it|alarms",
    ),
    Benchmark(
        "Certificates made wrong and sealed again",
        "bench/recheck/corruptions.py --count 200",
        last="^all |target",
        heads="count|accepted, FALSE",
    ),
    Benchmark("Forged certificates of every kind of proof", "bench/recheck/forged.py --count 100"),
    Benchmark(
        "Odd modules: proved, then checked again",
        "bench/recheck/odd_modules.py",
        last="^of |^wrong",
    ),
    Benchmark("Mutants of the re-checker's core", "bench/recheck/core_mutants.py"),
    Benchmark(
        "Certificates that say more than is true",
        "bench/recheck/overstated.py --share 0.1",
        last="^all |target",
        heads="count|OVERSTATED|REJECTED",
    ),
    Benchmark(
        "soter verify: honest robots at the first attempt",
        "bench/newcomers/first_attempt.py --recheck-below 30",
        last="^[0-9]+ of",
    ),
    Benchmark("soter verify: robots made wrong", "bench/newcomers/wrong_robots.py"),
    Benchmark(
        "soter verify: kinds of robots by figures of data sheets",
        "bench/verify/robot_kinds.py",
        last="^draws|^proved or",
    ),
    Benchmark(
        "soter verify: kinds made wrong", "bench/verify/robot_kinds.py --wrong", "^wrong|^proved"
    ),
    Benchmark(
        "soter test against the brute-force enumerator",
        "bench/testing/soundness.py --programs 600",
    ),
    Benchmark(
        "soter test: bugs seeded in the examples",
        "bench/testing/mutants.py",
        last=r"^mutants|\.\.\. (found|trace)",
    ),
    Benchmark("Delays of the trusted part", "bench/real_time/delays.py"),
    Benchmark(
        "Real time: misses, controllers that fail, the way to SC's output",
        "bench/real_time/driver.py --minutes 10 --trials 100 --kills 10000 --deaths 200",
    ),
    Benchmark(
        "Words, signals, and when the law comes", "bench/real_time/scenes.py", last="scenes;"
    ),
    Benchmark(
        "ROS 1: who dies, and what the wheels are told",
        "bench/ros/ros1_kills.py",
        heads="max ms|bound|over it",
    ),
    Benchmark("ROS 1: what is wrong on the wire", "bench/ros/ros1_bad_input.py"),
    Benchmark(
        "The wire of ROS 2: samples",
        "bench/ros/dds_samples.py --samples 100000",
        heads="lost|misread",
    ),
    Benchmark(
        "A ground robot among walls",
        "bench/ros/ground_robot.py",
        last=" all ",
        heads="runs|collide|touches",
    ),
    Benchmark(
        "Safe exploration: a thousand worlds",
        "bench/exploration/worlds.py --only frontier ramming",
        last=r"^\w",
        heads="worlds|collided|box|cells",
    ),
    Benchmark(
        "Safe exploration: other controllers, planners with bugs, and by contrast",
        "bench/exploration/worlds.py --worlds 200 --only jerking 'boxes into the unknown' "
        "'boxes anywhere' 'boxes shifted' 'frontier, silence says nothing' "
        "'frontier, by SC alone' 'bare: frontier' 'bare: ramming' "
        "'stop zone of 1 m: ramming' 'stop zone of 3 m: ramming'",
        heads="worlds|collided|box|cells",
    ),
    Benchmark(
        "Safe exploration: planners of others",
        "bench/exploration/worlds.py --only 'OMPL'\"'\"'s RRTConnect' learned 'bare: learned' "
        "'boxes of an old map'",
        heads="worlds|collided|box|cells",
    ),
    Benchmark(
        "Safe exploration: a lidar that is worse than assumed",
        "bench/exploration/sensors.py --worlds 20",
    ),
    Benchmark(
        "A rover among people", "bench/exploration/people.py", last="^Soter", heads="touched"
    ),
    Benchmark(
        "Betaflight below a proved geofence", "bench/autopilot/flights.py", heads="flights|violated"
    ),
    Benchmark(
        "Betaflight on the drone's laps",
        "bench/autopilot/laps.py",
        last="^lap,",
        heads="flights|touch|box|AC share",
    ),
    Benchmark(
        "MAVLink: who dies beside an autopilot's double",
        "bench/mavlink/peer_loss.py -n 20",
        heads="max ms|bound|beyond",
    ),
    Benchmark("MAVLink: what is wrong on the wire", "bench/mavlink/bad_input.py"),
    Benchmark("Bugs of the fleet's leases", "bench/fleet/protocol_bugs.py"),
    Benchmark(
        "Four robots at a junction, one machine in trouble",
        "bench/fleet/junction.py",
        heads="over|lease|neither",
    ),
    Benchmark(
        "The junction as processes over DDS", "bench/fleet/dds_junction.py", heads="collisions"
    ),
    Benchmark(
        "Two drones as processes over DDS", "bench/fleet/dds_drones.py", heads="overlaps|outside"
    ),
)


def machine() -> str:
    """Facts about this machine, in a line."""
    cpu = "unknown CPU"
    info = Path("/proc/cpuinfo")
    if info.exists():
        match = re.search(r"model name\s*: (.*)", info.read_text())
        cpu = match.group(1) if match else cpu
    cc = subprocess.run(["cc", "--version"], capture_output=True, text=True, check=False)
    compiler = cc.stdout.splitlines()[0] if cc.stdout else "no cc"
    python = platform.python_version()
    return f"{cpu}; {compiler}; Python {python}; {platform.system()} {platform.machine()}"


def file_of(name: str) -> Path:
    """Where the output of a benchmark stands, named as a forge names the anchor of a heading."""
    return OUTPUTS / (re.sub(r"[^\w\- ]", "", name.lower()).replace(" ", "-") + ".txt")


def results() -> dict[str, Result]:
    """What is kept, by benchmark."""
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))
    there = {name: file_of(name).read_text(encoding="utf-8").split(RULE) for name in kept}
    return {
        name: Result(**kept[name], text=text.strip(), about=" ".join(head.split("\n\n")[1].split()))
        for name, (head, text) in there.items()
    }


def first_lines(program: str) -> str:
    """What a program says first about itself."""
    if program.startswith("-m"):
        return ""
    tree = ast.parse((ROOT / program).read_text(encoding="utf-8"))
    return (ast.get_docstring(tree) or "").partition("\n\n")[0]


def printed(text: str) -> str:
    """What a command printed of a kept text: its blocks; notes stand around them."""
    return "\n".join(m.group(2) for m in BLOCK.finditer(text)) or text


def write(made: dict[str, Result]) -> None:
    """The data, the outputs, the page in the order of BENCHMARKS, and dates on other pages."""
    stated = {"command", "made", "commit", "machine"}
    kept = {name: {k: v for k, v in asdict(made[name]).items() if k in stated} for name in made}
    text = json.dumps(kept, indent=1, ensure_ascii=False, sort_keys=True)
    RESULTS.write_text(text + "\n", encoding="utf-8")
    there = [b for b in BENCHMARKS if b.name in made]
    OUTPUTS.mkdir(exist_ok=True)
    for path in OUTPUTS.glob("*.txt"):
        path.unlink()
    for b in there:
        file_of(b.name).write_text(output_file(b, made[b.name]), encoding="utf-8")
    rows = [table_row(b, made[b.name]) for b in there]
    PAGE.write_text("\n".join([HEAD, *rows, ""]), encoding="utf-8")
    dated = {file_of(b.name).name: citation(b.name, made[b.name]) for b in there}
    for page in PAGE.parent.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        page.write_text(CITED.sub(lambda m: dated.get(m[1], m[0]), text), encoding="utf-8")


def citation(name: str, r: Result) -> str:
    """How other pages cite a row."""
    return f"[{r.made}, {r.commit}](benchmarks/{file_of(name).name})"


def output_file(b: Benchmark, r: Result) -> str:
    """The command, when and where it ran, what to know, what it printed."""
    about = textwrap.fill(r.about, 100, break_long_words=False, break_on_hyphens=False)
    where = r.machine or "a machine that was not written down"
    return (
        f"{b.name}\n\n{about}\n\n{r.command}\n"
        f"Made {r.made}, after {r.commit}, on {where}\n\n{RULE}\n{r.text}\n"
    )


def table_row(b: Benchmark, r: Result) -> str:
    """A row of the page: name, target, what came of it, day and commit, machine, command."""
    output = printed(r.text)
    target = targets(output) or re.findall(r"Target: (.*?)\.?$", r.about)
    last = headlines(output, b.last, b.heads) or ["see output"]
    cells = ["; ".join(dict.fromkeys(target)), "<br>".join(map(escaped, last))]
    link = f"[{b.name}](benchmarks/{file_of(b.name).name})"
    when = f"{r.made}, {r.commit}"
    return f"| {' | '.join([link, *cells, when, r.machine, f'`{r.command}`'])} |"


def escaped(line: str) -> str:
    """A line of an output in a cell of Markdown."""
    return re.sub(r"([|*_<`\[])", r"\\\1", line)


def now() -> tuple[str, str]:
    """The day, and the first commit on the way to this one that has its code and examples.

    A branch that changes neither names a commit that stays when others take its work.
    """
    words = ["git", "log", "--first-parent", "-1", "--format=%h", "--abbrev=8", "--"]
    told = subprocess.run(
        [*words, "src", "examples"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return datetime.now(tz=timezone.utc).date().isoformat(), told.stdout.strip()


def main() -> int:
    """Run, and write each output as soon as it is there; others stay as they were."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", help="run the benchmarks whose name contains this")
    parser.add_argument("--write", action="store_true", help="only write the page")
    arguments = parser.parse_args()
    if arguments.write:
        write(results())
        return 0
    made, failed = results(), 0
    for b in BENCHMARKS:
        if arguments.only and arguments.only.lower() not in b.name.lower():
            continue
        print(f"== {b.name}", flush=True)
        when, words = now(), shlex.split(b.arguments)
        done = subprocess.run(
            [sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False
        )
        failed += done.returncode != 0
        print(done.stdout + done.stderr, flush=True)
        if "Traceback (most recent call last)" in done.stderr:
            print("no figures: what is kept stays as it was", flush=True)
            continue
        text = f"```\n{done.stdout.rstrip()}\n```"
        about = made[b.name].about if b.name in made else first_lines(words[0])
        made[b.name] = Result(f"python {b.arguments}", *when, machine(), text, about)
        write(made)
    print(f"wrote {PAGE.relative_to(ROOT)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
