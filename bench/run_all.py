"""Run every benchmark and write docs/benchmarks.md from what they print.

    make bench            (or: .venv/bin/python bench/run_all.py [--only NAME | --write])

Purpose: no figure in the docs that a command did not make. bench/results.json holds when each
command ran, at which commit and where; docs/benchmarks/ what it printed, below a line of `=`, and
notes beside that. The table of the page, and what stands above these lines, are made of both.
`--only` makes one row anew, `--write` but the page.
Non-goals: judging; every benchmark prints its targets beside its figures.
"""

from __future__ import annotations

import argparse
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
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.headlines import headlines, targets  # noqa: E402 - needs the path

PAGE = ROOT / "docs" / "benchmarks.md"
OUTPUTS = ROOT / "docs" / "benchmarks"
RESULTS = ROOT / "bench" / "results.json"
BLOCK = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
RULE = "=" * 80
"""Above it is what this program writes into a file of an output."""
HEAD = """# Benchmarks

Written by `make bench`, a command a row. The name leads to the whole output and to the sentences
that say what it means. *Last* are lines of that output, or the cells of a table in it that matter
most. The machines are shared ones with two cores: read ratios and medians, not single times.
*Machine* is empty where nobody wrote it down; an empty target means that the benchmark states none.

| what | target | last | made | machine | command |
|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Result:
    """What a command printed: when (YYYY-MM-DD), after which commit, where, with notes around."""

    command: str
    made: str
    commit: str
    machine: str
    text: str


@dataclass(frozen=True)
class Benchmark:
    """A command, and what a reader should know before its output.

    `last` and `heads` say which lines and columns of it the table shows: see bench/headlines.py.
    """

    name: str
    arguments: tuple[str, ...]
    about: str
    last: str = ""
    heads: str = ""


BENCHMARKS = (
    Benchmark(
        "Slips of newcomers",
        ("bench/newcomers/slips.py",),
        "Wrong programs, each an edit of a right one, as people write them who come from C, "
        "C++, Python, Rust, ROS or control; the place and the remedy were written down before "
        "the answer was seen. Then messages were mended until all were right: before, 52 of "
        "them had place and remedy right, and 39 misled. The 36 slips `not seen before` were "
        "written when that was done: when they were first asked, 29 had place and remedy right "
        "and 6 misled; some of these were mended since. So were the 22 of the `second look`, "
        "later: when they were first asked, 11 had place and remedy right and 3 misled. The `third "
        "set` is of two people who had read nothing but the README and two pages, sixty each: "
        "first 40 and 42 right, 8 and 7 misled, 4 and 2 silent; mended since. Two others wrote "
        "sixty each then, which are not among these: 43 of 57 and 40 of 59 right, 3 and 6 misled, "
        "4 and 4 silent, by their own judgement (one silent one of each was no mistake). "
        "The `fourth set` is of one who knew the messages, and was written before it was asked: "
        "25 right at first, 13 misled, 3 silent. Target: 52 of 60, 2, 0: missed.",
    ),
    Benchmark(
        "The drone's laps",
        ("bench/drone/laps.py",),
        "1,000 seeded laps per arm, wind and estimator errors drawn within their declared bounds. "
        "A violation is a touch of a building, ground, ceiling or edge, or (protected, SC) leaving "
        "the tube φ_safe, on the true state; lap time of AC alone counts clean laps. The seeds "
        "were not used for tuning.",
    ),
    Benchmark(
        "Hostile advanced controllers",
        ("bench/drone/laps.py", "--adversaries"),
        "The same module with ACs that mean harm: bang-bang on all axes, pushing at a wall, "
        "ramming, faulting outputs; wind at its bounds.",
        heads="violations",
    ),
    Benchmark(
        "The drone's laps with a shield",
        ("bench/drone/laps.py", "--shield"),
        "The laps with the AC that overshoots and with a gentle one, under the module that looks "
        "at the state alone and under one with `shield 8`.",
        heads="arm|with violation|mean clean lap|AC share",
    ),
    Benchmark(
        "The drone in corridors of boxes",
        ("bench/drone/corridors.py", "--hours", "4"),
        "Four hours an arm over ways of the roadmap, with the example's AC at 3 m/s, SC alone, and "
        "ACs that mean harm with the wind at its bounds. A violation is a touch of a building, "
        "ground, ceiling or edge, or leaving the box that is flown, on the true state.",
    ),
    Benchmark(
        "The surveillance drone, whole",
        ("bench/drone/stack.py", "--missions", "10000"),
        "The whole program with missions that never charge, battery ACs that land when they like, "
        "planners that lie and ACs that ram, wind at its bounds; two shorter arms have "
        "RRT*. A violation is a collision, leaving the box in force, a plan in force that is not "
        "sound, an empty battery aloft, a landing that is not over in time. `by DM`: landings that "
        "the decision module asked for; `s left`: of the time for a landing, at touch-down.",
    ),
    Benchmark(
        "The drone against the plant of its proof",
        ("bench/drone/conformance.py",),
        "Every 5 ms of 1,000 seeded laps and of flights with hostile ACs: the least bound on |d| "
        "with which the verification plant explains what the 13-state vehicle did, on true states.",
        last="Protected|Rhythmic",
        heads="flights|of D",
    ),
    Benchmark(
        "The drone on MuJoCo's rigid body",
        ("bench/drone/off_model.py", "--minutes", "12"),
        "Laps of the proved module, and of an AC that means harm, on physics that nobody here "
        "wrote: the model monitor's verdict on every step, on true states, and the least |d| that "
        "explains 5 ms. `InAir` has MuJoCo's drag, which the plant of the proof has not: there the "
        "monitor is to raise alarms. Flights are kept: the next call goes on.",
        heads="violations|alarms|of D",
    ),
    Benchmark(
        "Go-to legs that PX4 flew",
        ("bench/drone/real_logs.py",),
        "40 of 1,678 legs, positions every 0.1 s, judged by the module of goto.soter in tubes "
        "around the planned line (docs/real-logs.md); velocity is derived, from the past alone. "
        "With `--data DIR` all of them.",
        last="%",
        heads="tube|legs|left the tube|AC share",
    ),
    Benchmark(
        "What every AC can make the drone miss",
        ("bench/drone/bound.py",),
        "Derived in Arb balls for every sequence of set-points: what the vehicle misses of its "
        "reference to first order, beside the RESIDUAL of the proofs, and what hostile flights "
        "show of every quantity of the derivation. Exit code 1 where one is beyond its bound.",
    ),
    Benchmark(
        "The rhythm that the drone follows worst",
        ("bench/drone/rhythms.py",),
        "A search of 10,000,000 sequences for the set-points that are followed worst, on laps and "
        "in corridors: by axis the least bound on |d| that explains each 5 ms, beside the D of the "
        "proof, and the rest that is not derived, beside what is left for it. Exit code 1 where D "
        "is exceeded.",
        last=r"sequences of",
    ),
    Benchmark(
        "The drone's plans",
        ("bench/drone/plans.py",),
        "10,000 plans by OMPL's RRT*, 10,000 by the roadmap, 10,000 by RRT* with a bug put in, "
        "starts and goals at random in the authors' city. `wrong` counts corridors that were "
        "accepted and that the exact referee, on fractions, calls wrong. Cover is the compiled C, "
        "CPU time a plan.",
    ),
    Benchmark(
        "Coverage of the C that ships",
        ("bench/c_code/c_coverage.py",),
        "Lines, branches and conditions on their own (MC/DC) that runs of small programs and the "
        "drone reach, the same runs under ASan and UBSan. `--show` lists what was not reached: of "
        "soter.h what says that a compiler computes wrongly, of generated code what cannot be "
        "(a step that always publishes asks whether it did).",
        last="nothing found|under ASan",
    ),
    Benchmark(
        "The C that ships under Frama-C's EVA",
        ("bench/c_code/static_analysis.py",),
        "Every alarm of a run from any seed that never ends, with its explanation.",
    ),
    Benchmark(
        "A decision and its gate, against run-time-assurance",
        ("bench/running/simplex_peer.py", "--peer", "peer/bin/python"),
        "The same docking on a line in one run, in turns; `peer` is a Python environment with "
        "run-time-assurance 1.18.6 (its filter is compiled by JAX, its call is not).",
    ),
    Benchmark(
        "Images for a Cortex-M",
        ("bench/bare_metal/cortex_m.py",),
        "Flash, RAM and stack of images at `-Os`, and instructions under `qemu -icount`, the same "
        "in ten runs. With their plants examples repeat the host's first 1,000 instants of their "
        "calendar in virtual time (`an instant`); `to commands` is the image against the clock, "
        "from the interrupt that makes an instant due until its commands are there. `tables` are "
        "those of computed predicates, in flash and read in place. The trusted part is the image "
        "of its loop, without plants: `its test` is what the image is larger with the test of the "
        "arithmetic, its words and the doubles that nothing else needs. No hardware.",
    ),
    Benchmark(
        "What a check of rest costs",
        ("bench/tubes/check_cost.py",),
        "The check of a DM that follows SC, compiled at `-O2` and asked of 2,000 estimates that "
        "are drawn in the ranges of the bench; the least of three calls each.",
        last="mean",
    ),
    Benchmark(
        "A check of rest on a Cortex-M7",
        ("bench/tubes/check_cost.py", "--board", "mps2-an500"),
        "The first 1,000 instants of each program under `qemu -icount`: instructions of a step of "
        "the DM that follows SC. `takes`: at 480 MHz with two clocks an instruction, which is "
        "stated, not measured. Images at `-Os`, their plants included.",
        heads="takes|inside",
    ),
    Benchmark(
        "Bad files and options",
        ("bench/hostile/bad_input.py", "--count", "1000", "--jobs", "2"),
        "1,000 mutants of every format that a command reads (bytes, numbers, types; pipes, devices,"
        " 20 GB of holes), and 1,000 command lines of each command with options that do not fit.",
    ),
    Benchmark(
        "Hostile files",
        ("bench/hostile/hostile_files.py",),
        "Of every format that a command reads 30 files that mean harm, and those in its own words: "
        "devices, pipes, links, pickles, what unpacks or grows to gigabytes, code and paths where "
        "words stood. A command has 60 s and 2 GiB more than it begins with. `read outside`: "
        "words of a file elsewhere in what it says or writes; `defects`: exits of 70, and "
        "processes that outlive it.",
    ),
    Benchmark(
        "Damaged logs",
        ("bench/hostile/damaged_logs.py",),
        "Logs of somebody else, seven kinds, after disks, transfers and recorders that die: "
        "refused with a place, read as before, or read with a word about what was found. *Not "
        "covered*: a value was changed where the format has no checksum, which the judgement says. "
        "Then changed bits of a log of `soter run --log`.",
        last="damaged logs:|without a word|changed bits",
    ),
    Benchmark(
        "The mountain car: four drivers, alone and with RTA",
        ("bench/running/mountain_car.py",),
        "10,000 seeded episodes of each driver on the proved map, until flag, cliff or 999 steps. "
        "AC share is of all steps of all episodes; a takeover is a switch from AC to SC.",
    ),
    Benchmark(
        "The mountain car: Gymnasium against the proved map",
        ("bench/running/mountain_car.py", "--conformance"),
        "Every step of MountainCarContinuous-v0, from all over the plane, has to be a step of the "
        "map for some rounding within the declared bounds.",
    ),
    Benchmark(
        "The mountain car: training with and without the module",
        ("examples/mountain_car/train.py", "-o", ".soter/policy.json"),
        "The same network, seeds and cross-entropy method twice: falls during training.",
        last="falls",
    ),
    Benchmark(
        "What people wait for",
        ("bench/quick.py",),
        "`make bench-quick`: the ratios of speed with their targets, on a quiet machine. Times "
        "are of processors, of an installed package.",
    ),
    Benchmark(
        "Honest modules of other kinds",
        ("bench/verify/generality.py", "--recheck"),
        "Ten small robots, cold: verify and recheck as whole processes. `standing` has no P2b and "
        "can have none: where SC stands still nothing leads back to where `safer` holds.",
        heads="verdict|wall|recheck",
    ),
    Benchmark(
        "The surveillance drone, proved",
        (
            "bench/verify/generality.py",
            "--recheck",
            "--program",
            "examples/drone/surveillance.soter",
        ),
        "Battery, planner and motion primitive in one program, cold, and the conjunction; then the "
        "certificates of all of them. Whole processes; 120 s and 300 s are asked for, 30 s is the "
        "goal.",
        heads="verdict|wall|recheck",
    ),
    Benchmark(
        "The surveillance drone: stacks that must not be proved",
        ("bench/drone/wrong_stacks.py",),
        "Changes to the sources of the whole drone, each unsafe in a world that is admissible. "
        "`verify` stops at the first module or view that is not proved. `repeated`: the reference "
        "interpreter flies the same seed to the same violation, at the same time, with the same "
        "hash of all states. The second table breaks what the proofs take for granted of the "
        "program: those are proved, and the verdict has to name what is broken.",
    ),
    Benchmark(
        "The generated program and the kernel",
        (
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "tests/correct/test_no_heap.py",
            "tests/correct/test_sanitizers.py",
        ),
        "Random programs and the shipped examples: objects of program and kernel have no "
        "undefined symbol of the malloc family; runs under ASan and UBSan "
        "(`-fsanitize=address,undefined -fno-sanitize-recover=all`) are clean and end in the "
        "interpreter's state.",
    ),
    Benchmark(
        "The house",
        ("bench/house/house_figures.py",),
        "Counts over src/, tests/ and bench/ as tests assert them (what is over a figure stands in "
        "`tests/unit/test_house_figures.py` with its reason; complexity: a rough count over the "
        "text).",
    ),
    Benchmark(
        "Mutants of Python before and after the tests were made faster",
        ("bench/house/mutation_sample.py", "--before", "../before"),
        "Mutants drawn by seed at lines that this checkout and 0146af3e have, each judged by the "
        "quick tests that name its module, or of its room, six files at most.",
    ),
    Benchmark(
        "Axes that wrap around",
        ("bench/verify/wrapping.py", "--systems", "300", "--wide", "6"),
        "Drawn plants with a heading that turns for ever. From states of K up to 2,000 turns away "
        "SC is flown in doubles against an adversary, and has to keep safe; every sixth program is "
        "proved on an axis of five turns as well, which does not wrap; and wherever somebody "
        "counts turns the axis may not wrap.",
    ),
    Benchmark(
        "The model of time against every schedule",
        ("bench/verify/time_model.py",),
        "5,000 random systems of small whole times: each quantity beside the largest value over "
        "all schedules. Exceeded: the model would be wrong. Reached: no smaller figure is sound; "
        "in the limit: short of it by units of the grid, however fine the grid is.",
        heads="exceeded",
    ),
    Benchmark(
        "The same schedules against figures that are wrong on purpose",
        ("bench/verify/time_model.py", "--blind", "all", "--systems", "200"),
        "A check that the comparison would see a wrong figure: what is hidden from the model must "
        "show as quantities that are exceeded.",
    ),
    Benchmark(
        "Threads: the analysis against executions",
        ("bench/verify/schedulability.py",),
        "10,000 random sets of tasks that keep a thread busy for 60 to 100 % of the time "
        "(docs/timing.md). Accepted: executions are simulated tick by tick, the one in which all "
        "is as late as it may be and random ones; none may miss. Refused: the instance that comes "
        "with it is replayed, and has to miss.",
    ),
    Benchmark(
        "The same sets, with something hidden from the analysis",
        ("bench/verify/schedulability.py", "--blind", "--sets", "1000"),
        "A check that the comparison would see a wrong analysis.",
        heads="accepted, and one misses|refused, instance does not",
    ),
    Benchmark(
        "P1c of deployed modules against all executions",
        ("bench/verify/p1c_phases.py",),
        "20,000 random programs: what `soter check` says that the horizon must be, beside the "
        "longest switch over all delays of releases, lengths of steps and ages of what is read.",
        last="exceeded",
    ),
    Benchmark(
        "The same switches, with something the program does not say",
        ("bench/verify/p1c_phases.py", "--blind", "--cases", "500"),
        "A check that the comparison would see a figure that is too small.",
        last=" of 500",
    ),
    Benchmark(
        "Changed modules that must not be proved",
        ("bench/verify/mutants.py",),
        "Every mutant is first confirmed bad by a NumPy simulation of its own (`escapes`: runs "
        "that leave C; `stuck`: runs that SC never gives back); `replayed run` is what the "
        "reference interpreter saw, given nothing but the choices of the counterexample.",
    ),
    Benchmark(
        "Wrong modules that must not be proved without a word",
        ("bench/wrong_modules/verdicts.py",),
        "Made from five right modules that are proved; `named`: the verdict prints what is wrong "
        "with it among what it assumes or does not cover; `--demos` runs what shows them wrong: "
        "runs, tests, a simulation of their own (265 of 298).",
        last=r"^(wrong modules|proved \(|control arms)",
    ),
    Benchmark(
        "Random problems and adversaries",
        ("bench/verify/soundness.py",),
        "Every claimed set of 200 random problems is attacked by NumPy simulations with delays, "
        "jitter, errors and disturbances at their bounds; an escape is a state inside a claimed "
        "set that does what the claim excludes.",
    ),
    Benchmark(
        "A closed-loop adversary against proved modules",
        ("bench/adversary/against_proofs.py", "--steps", "300000000"),
        "Random modules that are proved, simulated from the definitions of the model of time, with "
        "state feedback and every lateness, response, latency, error, disturbance and drop-out at "
        "its bounds. `closest` is the largest |x| relative to the border of C, `by SC` while SC "
        "was in control; `safe only`: everything but P2b is proved.",
        last="^all ",
        heads="proved|safe only|violations",
    ),
    Benchmark(
        "What a shield is worth",
        ("bench/adversary/shield.py",),
        "The same modules with `shield 8` and without it, under an AC that brakes as late as it "
        "dares and under hostile ones, 1,000 flights each, disturbances and errors drawn within "
        "their bounds. `SC` is its share of the time; a step of AC in C, the judgement in it.",
        last="a step of AC, ns",
    ),
    Benchmark(
        "A closed-loop adversary against shields",
        ("bench/adversary/against_shields.py",),
        "Modules with a shield that are proved, 10,000 runs each: AC publishes any command at "
        "any tick, or nothing, with every lateness, latency, error and disturbance at its bound. "
        "`closest` is the largest |x| relative to the border of C; a violation is a state outside "
        "of C, or a command that acted and was not among those judged.",
        heads="violations",
    ),
    Benchmark(
        "Shields that are wrong",
        ("bench/adversary/against_shields.py", "--wrong"),
        "Slips in the gate, the prover, the DM and its tables, and programs that must have no "
        "proof, and who notices each.",
    ),
    Benchmark(
        "Towers flown against",
        ("bench/adversary/towers.py", "--towers", "14", "--flights", "12"),
        "Random modules with another one in the place of their AC, many of them wrong; an AC that "
        "pushes, one that flips, one that lures; DMs as late as declared, wind held. The outer one "
        "is claimed at all times, the inner one while the outer one is in AC.",
        last="proved",
    ),
    Benchmark(
        "The drone's tower under faults",
        (
            *("-m", "soter", "campaign", "examples/drone/tower.soter"),
            *("--system", "Faulty", "--hours", "10"),
        ),
        "A return along the corridor inside, a stop outside. The outer module is proved (49 s) and "
        "re-checked (71 s) beside other work; of the inner one nothing is claimed.",
        last="violations;",
    ),
    Benchmark(
        "Holes put back into the prover",
        ("bench/adversary/against_proofs.py", "--holes"),
        "Each is patched in by hand; on a module that the prover then calls proved, and does not "
        "without it, the same adversary has to find a run that leaves C.",
    ),
    Benchmark(
        "The same adversaries against an engine that is not told everything",
        ("bench/verify/soundness.py", "--blind", "--problems", "8"),
        "A check that the adversaries would see an unsound set: what is hidden must show as "
        "escapes.",
        heads="problems with escapes|escapes",
    ),
    Benchmark(
        "Verify, recheck and run against each other",
        ("bench/verify/contradictions.py", "--modules", "300", "--stiff", "50"),
        "Random modules (grids, polytopes, inductions, instances, dials nobody reads) and 50 with "
        "a group that no command moves, under schemes that may diverge. `proved, rejected` is what "
        "verify proves and recheck rejects, `accepted, not proved` the other way round; `proved, "
        "violated` and `proved, stops` are runs that leave `safe` or in which a plant stops.",
    ),
    Benchmark(
        "Contradictions on the examples",
        ("bench/verify/contradictions.py", "--examples", "--seconds", "600"),
        "The same of every example that has a default system with modules whose DM switches: "
        "verified, rechecked, run and attacked, ten minutes each.",
    ),
    Benchmark(
        "Before and after the house was cut anew",
        ("bench/house/same_outputs.py", "--before", "../before"),
        "Every system of every example in two checkouts, this one and 59e39d35, from before files "
        "and rooms were renamed: the C that is generated (the runtime aside), the trace of seed 1, "
        "and of eleven programs all verdicts and the certificate (names of assumptions aside).",
    ),
    Benchmark(
        "The time of soter recheck",
        ("bench/recheck/beside_verify.py",),
        "`soter verify --cert` of every example, cold, and `soter recheck` of its certificate, as "
        "whole processes. Target: each accepted in 600 s of CPU, the median 60.",
    ),
    Benchmark(
        "Flights, every verdict checked again",
        ("bench/tubes/flights.py",),
        "examples/evidence/follow.soter with an advanced controller that is wild, twenty seconds a "
        "flight: every verdict AC of its log once more in Arb balls. In the first ten logs one "
        "verdict says AC of a state that is not good, and nothing else contradicts that.",
    ),
    Benchmark(
        "An F-16 of JSBSim beside its model",
        ("bench/tubes/identify_f16.py",),
        "What examples/rest/dive.soter leaves of flights of an aircraft that nobody here wrote: "
        "the speed is fitted to some flights, and bounds are of others. `no lag` and `one lag`: "
        "the same with a path that follows what is asked at once, or behind one lag.",
        last="the bounds",
    ),
    Benchmark(
        "Dives of an F-16 of JSBSim",
        ("bench/tubes/dives.py",),
        "Each dive alone and with the module of examples/rest/dive.soter, which decides in flight. "
        "`aims` never pulls up, `late` means to but often too late, `any` gives any command, `low` "
        "flies level at some hundred metres. `for nothing`: SC had control for a "
        "while, and alone this pilot would not have hit; `alarms`: dives in which a step was "
        "outside of the model. Targets: 50 or more hit alone, none with it.",
        last="^all |left the model|^alarms",
        heads="dives|hit alone|hit with it|alarms",
    ),
    Benchmark(
        "Certificates made wrong and sealed again",
        ("bench/recheck/corruptions.py", "--count", "1000"),
        "Sets enlarged, witnesses, bounds, times, grids and programs changed, every hash written "
        "anew; what is accepted all the same is attacked by simulation: `accepted, true` is what "
        "no run breaks.",
        last="^all |target",
        heads="count|accepted, FALSE",
    ),
    Benchmark(
        "Forged certificates of every kind of proof",
        ("bench/recheck/forged.py", "--count", "100"),
        "Eighteen kinds of forgeries of grids, polytopes, inductions, deployed and composed "
        "systems, each checked in a process with a minute and 8 GiB. False is what is confirmed of "
        "a program, a system, a module and values and not proved of exactly these, and a shield "
        "that permits what leaves K; `untouched` is what `soter verify` writes: one base with "
        "its variants is not re-checked, as it says.",
    ),
    Benchmark(
        "Mutants of the re-checker's core",
        ("bench/recheck/core_mutants.py",),
        "Mutants of the files that docs/recheck.md lists in its steps 1 to 9, drawn by seed, each "
        "judged by the quick tests of the room. Harmless is what changes no verdict, each with its "
        "reason in `bench/recheck/core_mutants_harmless.txt`.",
    ),
    Benchmark(
        "Certificates that say more than is true",
        ("bench/recheck/overstated.py", "--share", "0.5"),
        "Edits of programs, parameters, modules, systems, times, claims, inputs, assumptions and "
        "tables of small modules, every hash written anew. What an edit is is known beforehand, or "
        "the edited program is proved anew; `written` is what `soter verify` writes of those.",
        last="^all |target",
        heads="count|OVERSTATED|REJECTED",
    ),
    Benchmark(
        "soter test: tests that judge nothing, and times off the grid",
        ("bench/testing/vacuous.py",),
        "Each test would be clean for want of looking. Those that compare times are searched on "
        "the grid that soter chooses and on one of a quarter of a millisecond. Then tests that say "
        "nothing: `without a word` counts those that are clean and told of nothing, `cries wolf` "
        "tests that could fail and are told as vacuous.",
    ),
    Benchmark(
        "soter verify: honest robots at the first attempt",
        ("bench/newcomers/first_attempt.py", "--recheck-below", "30"),
        "Robots as engineers wrote them, with figures of textbooks, verified as they stand. Where "
        "one is not proved, what is printed as tried is written into it, as it stands there, and "
        "it is asked again, four times at most. Certificates of what is proved in full are "
        "re-checked, but for those of long proofs, which the table names. `--folder`: other ones.",
        last="^[0-9]+ of",
    ),
    Benchmark(
        "soter verify: robots made wrong",
        ("bench/newcomers/wrong_robots.py",),
        "Six wrong variants of each of the same robots. That each is wrong is shown by flights "
        "that know nothing of Soter, from a lattice of `safe`: every start leaves it, or, where a "
        "variant has a `ttf` of its own, some start that leaves AC in control. `refuted`: "
        "`verify` has found a run that violates.",
    ),
    Benchmark(
        "soter verify: polytopes of drawn systems",
        ("bench/verify/undecided_costs.py",),
        "Linear robots of two to four states, lightly damped, with long holds: each answer, and "
        "the CPU time until it is given. An answer without a proof is to take 20 s at most.",
    ),
    Benchmark(
        "soter verify: robots that are not proved",
        ("bench/verify/undecided_costs.py", "--systems", "0", "--robots"),
        "CPU time of runs that end undecided: robots of engineers, and wrong variants of some that "
        "are proved. 20 s, or three times the proof of the right one, is what each may take.",
    ),
    Benchmark(
        "K against what survives an adversary",
        ("bench/verify/survivors.py",),
        "States drawn from all cells of C, flown by SC against an adversary who searches: of those "
        "that never leave C the share that lies in K. `wrong` lie in K and leave C; target 0.",
    ),
    Benchmark(
        "soter verify: honest robots with a rest in the place of a grid",
        ("bench/newcomers/rest_attempt.py",),
        "The same robots with a `rest` clause, and nothing else changed but a `max_age` that "
        "`verify` has tried with success, which the table then names. Flights of those that are "
        "proved begin in the corners and on a lattice of the box around rest, by a simulator that "
        "knows nothing of Soter; their ways are those of the certificate. `--folder`: other ones.",
    ),
    Benchmark(
        "soter test: whole robots",
        ("bench/testing/whole_robots.py",),
        "Two robots of three modules each, by parts, each module as it is with the others as "
        "contracts; and the surveillance drone: its modules one at a time, and its whole by parts "
        "for its first 990 ms. Every mutant is one edit of a module, and has to be found.",
    ),
    Benchmark(
        "soter test against the brute-force enumerator",
        ("bench/testing/soundness.py", "--programs", "600"),
        "Random small programs with every feature of docs/testing.md: verdicts, configurations or "
        "observations, and lengths of least traces, with every strategy and reduction.",
    ),
    Benchmark(
        "soter test and parts that share only time",
        ("bench/testing/soundness.py", "--apart", "--programs", "400"),
        "The same comparison on programs made to depend on which moments are observed: late and "
        "skewed nodes beside clocks that let time pass, under deadlines and invariants.",
    ),
    Benchmark(
        "soter test and groups of actors within an instant",
        ("bench/testing/soundness.py", "--instants", "--programs", "300"),
        "The same comparison on programs whose actors fall into groups that meet at the end of an "
        "instant: middles that are read, queues, contracts, choices, several starts.",
    ),
    Benchmark(
        "soter test and parts that only properties join",
        ("bench/testing/soundness.py", "--joined", "--programs", "100"),
        "The same comparison on parts that share nothing but a property.",
    ),
    Benchmark(
        "soter test and instances that are equal, or nearly",
        ("bench/testing/soundness.py", "--equal", "--programs", "300"),
        "Programs of two or three instances that share something: verdicts, lengths of traces, "
        "coverage, and one configuration stored for every orbit of those that the enumerator "
        "reaches, with instances swapped by their names.",
    ),
    Benchmark(
        "soter test: bugs seeded in the examples",
        ("bench/testing/mutants.py",),
        "Each shipped example is exhausted and clean; each changed one has to be violated, its "
        "trace read back from the file and replayed by the reference interpreter. `minimal`: a "
        "breadth-first search without reduction meets its first violation, of whatever property, "
        "after equally many steps; `brute`: so does the enumerator over the interpreter, where it "
        "can (200,000 transitions).",
        last=r"^mutants|\.\.\. (found|trace)",
    ),
    Benchmark(
        "Delays of the trusted part",
        ("bench/real_time/delays.py",),
        "One node of the trusted part late or dead, every shipped module that is proved on sets, "
        "virtual time, the C of leases as it ships. In time: every output of SC, no lease ends. "
        "Law in time: the fail-safe law acts before H runs out, and nothing is obeyed afterwards. "
        "Third: neither; the target is 0. The watchdog is obeyed and fed by whatever comes. Only "
        "`stop` declares a law; of the others this says when theirs would act.",
    ),
    Benchmark(
        "Real time: misses, controllers that fail, the way to SC's output",
        (
            *(
                "bench/real_time/driver.py",
                "--minutes",
                "10",
                "--trials",
                "100",
                "--kills",
                "10000",
            ),
            *("--deaths", "200"),
        ),
        "A loop at 1 kHz, its processor kept busy by eight ordinary processes; late is more than "
        "200 us behind, counted by a second clock and compared with what the driver counted. Then "
        "an AC in a process of its own that fails in ten ways, or is killed at random instants; "
        "the trusted part killed, its actuators by the law; and SC's output against bare "
        "wake-ups. Three quarters of an hour.",
    ),
    Benchmark(
        "ROS 1 under /clock",
        ("bench/ros/ros1_clock.py",),
        "Systems with their plants inside, built as packages of ROS 1, beside a master and a node "
        "that ticks; the hash is that of `soter run`.",
        last="equal|differ",
    ),
    Benchmark(
        "ROS 1: who dies, and what the wheels are told",
        ("bench/ros/ros1_kills.py",),
        "rosmaster, a plant, AC, and of examples/ros/shuttle_ros.soter the trusted part, its "
        "actuators and the bridge, on loopback, with SCHED_FIFO.",
        heads="max ms|bound|over it",
    ),
    Benchmark(
        "ROS 1: what is wrong on the wire",
        ("bench/ros/ros1_bad_input.py",),
        "The same programs without AC; right is SC's command, -0.25 m/s, or the law, 0.",
    ),
    Benchmark(
        "The wire of ROS 2: samples",
        ("bench/ros/dds_samples.py", "--samples", "100000"),
        "The bridge of a `dds` package and the package's code, against Fast DDS and PyPI's "
        "cyclonedds, on loopback.",
        heads="lost|misread",
    ),
    Benchmark(
        "A ground robot among walls",
        ("bench/ros/ground_robot.py",),
        "examples/ros/ground_robot_hall.soter: 500 runs of 60 s of each column, five hostile "
        "wishers, simulated.",
        last=" all ",
        heads="runs|collide|touches",
    ),
    Benchmark(
        "Safe exploration: a thousand worlds",
        ("bench/exploration/worlds.py", "--only", "frontier", "ramming"),
        "examples/exploration/exploration_adversaries.soter, simulated, a world a seed: frontier "
        "exploration for 5 min, and a controller that flies at the nearest wall for 100 s.",
        last=r"^\w",
        heads="worlds|collided|box|cells",
    ),
    Benchmark(
        "Safe exploration: other controllers, planners with bugs, and by contrast",
        (
            *("bench/exploration/worlds.py", "--worlds", "200", "--only", "jerking"),
            *("boxes into the unknown", "boxes anywhere", "boxes shifted"),
            *("frontier, silence says nothing", "frontier, by SC alone", "bare: frontier"),
            *("bare: ramming", "stop zone of 1 m: ramming", "stop zone of 3 m: ramming"),
        ),
        "The same seeds. `bare`: without a decision module; `stop zone`: it brakes while anything "
        "is measured within so many metres, and reckons with no time.",
        heads="worlds|collided|box|cells",
    ),
    Benchmark(
        "Safe exploration: planners of others",
        (
            *("bench/exploration/worlds.py", "--only", "OMPL's RRTConnect", "learned"),
            *("bare: learned", "boxes of an old map"),
        ),
        "The same seeds; none of these worlds was trained in. `bare`: without a decision module.",
        heads="worlds|collided|box|cells",
    ),
    Benchmark(
        "Safe exploration: the mapper's margins",
        ("bench/exploration/mapper.py",),
        "Scenes with every error at its bound, judged in exact arithmetic.",
        last="^all|caught",
        heads="wrong",
    ),
    Benchmark(
        "Safe exploration: a lidar that is worse than assumed",
        ("bench/exploration/sensors.py",),
        "Frontier exploration for 2 min; detection, no proof.",
    ),
    Benchmark(
        "A rover among people",
        ("bench/exploration/people.py",),
        "examples/exploration, simulated: 120 s a run, three people, W = 1 m/s, the same seeds for "
        "each vehicle. people: a rover with a perfect scanner; street: with a lidar of 180 rays, "
        "errors at their bounds, 0.5 % of the rays dropped, nobody thinner than 0.2 m, cars 2 m "
        "from the middle; wheels: a velocity command; announced: others are robots that say how "
        "fast they go, or are not heard; hover: the drone.",
        last="^Soter",
        heads="touched",
    ),
    Benchmark(
        "A rover among people, proved",
        (
            *("bench/verify/generality.py", "--recheck", "--program"),
            "examples/exploration/people.soter",
        ),
        "Beside much other work. P2b is not asked; an axis without ends.",
        heads="verdict|wall|recheck",
    ),
    Benchmark(
        "Safe exploration, proved",
        (
            *("bench/verify/generality.py", "--recheck", "--program"),
            "examples/exploration/exploration.soter",
        ),
        "Beside much other work. Six walls, a view each.",
        heads="verdict|wall|recheck",
    ),
    Benchmark(
        "Betaflight below a proved geofence",
        ("bench/autopilot/flights.py",),
        "Flights of 20 s of unmodified firmware in lock-step, hostile controllers, seeds on which "
        "nothing was identified; `residual`: of its bound; `left`: the fence, after the alarm.",
        heads="flights|violated",
    ),
    Benchmark(
        "Betaflight on the drone's laps",
        ("bench/autopilot/laps.py",),
        "The same boxes and the same AC on unmodified firmware and on the drone's own attitude "
        "loop, below the module that is proved of each, and alone; held-out seeds.",
        last="^lap,",
        heads="flights|touch|box|AC share",
    ),
    Benchmark(
        "MAVLink: who dies beside an autopilot's double",
        ("bench/mavlink/peer_loss.py", "-n", "20"),
        "The package of examples/mavlink/geofence.soter beside a pymavlink peer that behaves as "
        "PX4's pages say of OFFBOARD; no autopilot.",
        heads="max ms|bound|beyond",
    ),
    Benchmark(
        "MAVLink: what is wrong on the wire",
        ("bench/mavlink/bad_input.py",),
        "The same programs.",
    ),
    Benchmark(
        "Bugs of the fleet's leases",
        ("bench/fleet/protocol_bugs.py",),
        "Each is one text of `reservation.soter` in place of another; the test that is violated, "
        "the steps and the time of its counterexample, and whether no shorter run violates it.",
    ),
    Benchmark(
        "Four robots at a junction, one machine in trouble",
        ("bench/fleet/junction.py",),
        "Every kind of trouble with every machine, 100 runs of 60 s each. `over`, `lease` and "
        "`neither` are to be 0, and `to SC` and `news` no more than the bound.",
        heads="over|lease|neither",
    ),
    Benchmark(
        "The junction as processes over DDS",
        ("bench/fleet/dds_junction.py",),
        "Five packages of `--target dds` on loopback, a robot or the manager killed or stopped "
        "after 20 s. `moved`: how long those whom it concerns still moved. One run a row.",
        heads="collisions",
    ),
    Benchmark(
        "Two drones as processes over DDS",
        ("bench/fleet/dds_drones.py",),
        "Two packages of `--target dds` on loopback, drone 1 killed or stopped after a third of "
        "the time. `overlaps`, `outside`: steps at which claims were nearer than APART, or a drone "
        "was not in its claim. `changes`: of claims, and of drone 0's afterwards. One run a row.",
        heads="overlaps|outside",
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
    return {
        name: Result(
            **fields, text=file_of(name).read_text(encoding="utf-8").split(RULE)[1].strip()
        )
        for name, fields in kept.items()
    }


def printed(text: str) -> str:
    """What a command printed of a kept text: its blocks; notes stand around them."""
    return "\n".join(m.group(2) for m in BLOCK.finditer(text)) or text


def write(made: dict[str, Result]) -> None:
    """The data, the outputs, and the page in the order of BENCHMARKS."""
    kept = {name: {k: v for k, v in asdict(made[name]).items() if k != "text"} for name in made}
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


def output_file(b: Benchmark, r: Result) -> str:
    """The command, when and where it ran, what to know, what it printed."""
    about = textwrap.fill(b.about, 100, break_long_words=False, break_on_hyphens=False)
    where = r.machine or "a machine that was not written down"
    return (
        f"{b.name}\n\n{about}\n\n{r.command}\n"
        f"Made {r.made}, after {r.commit}, on {where}\n\n{RULE}\n{r.text}\n"
    )


def table_row(b: Benchmark, r: Result) -> str:
    """A row of the page: name, target, what came of it, day and commit, machine, command."""
    output = printed(r.text)
    target = targets(output) or re.findall(r"Target: (.*?)\.?$", b.about)
    last = headlines(output, b.last, b.heads) or ["see output"]
    cells = ["; ".join(dict.fromkeys(target)), "<br>".join(map(escaped, last))]
    link = f"[{b.name}](benchmarks/{file_of(b.name).name})"
    when = f"{r.made}, {r.commit}"
    return f"| {' | '.join([link, *cells, when, r.machine, f'`{r.command}`'])} |"


def escaped(line: str) -> str:
    """A line of an output in a cell of Markdown."""
    return re.sub(r"([|*_<`\[])", r"\\\1", line)


def now() -> tuple[str, str]:
    """The day, and the commit that is checked out."""
    command = ["git", "rev-parse", "--short=8", "HEAD"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
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
        when = now()
        done = subprocess.run(
            [sys.executable, *b.arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
        failed += done.returncode != 0
        print(done.stdout + done.stderr, flush=True)
        if "Traceback (most recent call last)" in done.stderr:
            print("no figures: what is kept stays as it was", flush=True)
            continue
        command = shlex.join(["python", *b.arguments])
        text = f"```\n{done.stdout.rstrip()}\n```"
        made[b.name] = Result(command, *when, machine(), text)
        write(made)
    print(f"wrote {PAGE.relative_to(ROOT)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
