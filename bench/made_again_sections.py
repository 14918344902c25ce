"""Which command makes which figures of docs/, and which figures no command makes.

Purpose: `PAGES` are tables, blocks and sentences of the pages; `SMALL` the smaller runs of sections
of docs/benchmarks.md, each of which is a command by itself (bench/run_all.py); `EXCEPT` what
nothing here makes again, each with its reason. bench/made_again.py reads them, and
tests/unit/test_made_again.py refuses a table, block or sentence that is in none.
Non-goals: running, comparing.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Made:
    """Figures of a page, and what makes them.

    `where` is how a table's first row begins (`| …`), how a block's first line does (```` ``` ````
    and the line), or a regex of a sentence whose groups are the figures. `command` is run in the
    root of the repository; `@NAME` is that row of docs/benchmarks.md, whose kept output the
    page has to agree with as well. `small` is a quicker run: of so many `flights` a row. `given`
    are numbers that the program declares and nothing prints; `spread`: a row's figures stand in
    several lines of the output; `reads`: what the command writes, in place of what it prints.
    """

    page: str
    where: str
    command: str
    small: str = ""
    flights: int = 1
    times: str | None = None
    given: str = ""
    spread: bool = False
    reads: str = ""


@dataclass(frozen=True)
class Small:
    """A quicker run of a row of docs/benchmarks.md.

    `arguments` come behind the section's own; `instead` in place of them. None of both: there is no
    smaller one than the whole. `times`: headings of columns of times, where those that
    made_again_compare knows are times of the simulated world. `machine`: why its figures are
    another machine's or another moment's: only what is 0 is compared. `apart`: why `make test-all`
    does not make it. `part`: the smaller run has fewer rows, and they are those of the whole one.
    """

    arguments: str = ""
    instead: str = ""
    flights: int = 1
    times: str | None = None
    machine: str = ""
    apart: str = ""
    part: bool = False


SIMULATED = ""
"""No column is of times: all of them are the simulated world's."""
CLOCK = "times of this machine"
SCHEDULER = "when this machine schedules whom"
BETAFLIGHT = "needs Betaflight's sources"
BEFORE = "needs a checkout of an older commit"
PEERS = "needs the libraries of others in environments of their own"
ROS = "needs ROS 1"
MINUTES = "nothing smaller than the whole, which takes minutes; tests of its own hold it"

SMALL = {
    "Slips of newcomers": Small(apart=MINUTES),
    "The drone's laps": Small("--laps 30 --jobs 1", flights=30, times=SIMULATED),
    "Hostile advanced controllers": Small("--laps 6 --jobs 1", flights=6, times=SIMULATED),
    "The surveillance drone, whole": Small("--missions 40 --rrt-hours 0.02", flights=2),
    "The drone against the plant of its proof": Small(
        "--laps 5 --hostile 1 --jobs 1", flights=1, times=SIMULATED
    ),
    "The drone on MuJoCo's rigid body": Small("--hours 0.1", flights=20),
    "Go-to legs that PX4 flew": Small(times=SIMULATED, apart=MINUTES),
    "The rhythm that the drone follows worst": Small(
        "--sequences 20000", apart="fewer sequences find others"
    ),
    "Coverage of the C that ships": Small(apart=MINUTES),
    "The C that ships under Frama-C's EVA": Small(apart="needs Frama-C"),
    "Filters of others on the same flights": Small(apart=PEERS),
    "Policies of every kind against their libraries": Small(apart=PEERS),
    "Logs of strangers": Small(apart="needs a folder of public logs"),
    "What a check of rest costs": Small("--draws 20", machine=CLOCK),
    "An F-16 of JSBSim beside its model": Small(apart="needs JSBSim"),
    "Dives of an F-16 of JSBSim": Small(apart="needs JSBSim"),
    "A check of rest on a Cortex-M7": Small(apart=MINUTES),
    "Bad files and options": Small("--count 5 --jobs 1", flights=5),
    "Hostile files": Small(
        "--only data_csv,map_toml,policy_onnx", machine="fewer kinds of files", part=True
    ),
    "Damaged logs": Small("--flips 20", flights=20),
    "The mountain car: four drivers, alone and with RTA": Small(
        "--episodes 40 --jobs 1", flights=40
    ),
    "The mountain car: Gymnasium against the proved map": Small("--steps 5000 --jobs 1"),
    "The mountain car: training with and without the module": Small(),
    "What people wait for": Small(machine=CLOCK),
    "From the wheel to proved, re-checked, flown": Small(machine=CLOCK),
    "The surveillance drone: stacks that must not be proved": Small("--quick"),
    "The house": Small(apart="counts of the code, others after every commit"),
    "Mutants of Python before and after the tests were made faster": Small(machine=BEFORE),
    "The model of time against every schedule": Small(
        "--systems 40", flights=40, times="+slack .*"
    ),
    "The same schedules against figures that are wrong on purpose": Small(
        instead="bench/verify/time_model.py --blind path --systems 10",
        flights=10,
        apart="its counts are of all systems",
    ),
    "Threads: the analysis against executions": Small("--sets 100", flights=1),
    "The same sets, with something hidden from the analysis": Small("--sets 50"),
    "P1c of deployed modules against all executions": Small("--cases 30", flights=30),
    "The same switches, with something the program does not say": Small("--cases 20"),
    "Wrong modules that must not be proved without a word": Small(apart=MINUTES),
    "Random problems and adversaries": Small("--problems 3 --steps 1e5"),
    "A closed-loop adversary against proved modules": Small("--modules 3 --steps 100000"),
    "A closed-loop adversary against shields": Small("--runs 20"),
    "Topics that fall silent one by one": Small(apart=MINUTES),
    "Shields that are wrong": Small("--steps 100000"),
    "Holes put back into the prover": Small(apart=MINUTES),
    "The same adversaries against an engine that is not told everything": Small("--problems 1"),
    "Verify, recheck and run against each other": Small("--modules 4 --stiff 1"),
    "The time of soter recheck": Small(
        instead="bench/recheck/beside_verify.py examples/wall/cart.soter", machine=CLOCK
    ),
    "Certificates made wrong and sealed again": Small("--count 6 --jobs 1"),
    "Forged certificates of every kind of proof": Small("--count 2 --jobs 1"),
    "Odd modules: proved, then checked again": Small(apart=MINUTES),
    "Mutants of the re-checker's core": Small(apart=MINUTES),
    "Certificates that say more than is true": Small("--share 0.01 --jobs 1"),
    "soter verify: honest robots at the first attempt": Small(apart=MINUTES),
    "soter verify: robots made wrong": Small(apart=MINUTES),
    "soter verify: kinds of robots by figures of data sheets": Small(apart=MINUTES),
    "soter verify: kinds made wrong": Small(
        apart="nothing smaller than the whole, which takes minutes; no test holds it"
    ),
    "soter test against the brute-force enumerator": Small("--programs 12"),
    "soter test: bugs seeded in the examples": Small("--only two_modules --brute 1000", part=True),
    "Delays of the trusted part": Small("--runs 1", times=SIMULATED),
    "Real time: misses, controllers that fail, the way to SC's output": Small(
        instead="bench/real_time/driver.py --minutes 0.05 --trials 1 --kills 5 --deaths 1",
        machine=SCHEDULER,
    ),
    "Words, signals, and when the law comes": Small("--only worker", machine=SCHEDULER, part=True),
    "ROS: who dies, and what the wheels are told": Small(
        "--ac 2 --trusted 1 --bridge 1", machine=SCHEDULER
    ),
    "ROS: what is wrong on the wire": Small(machine=SCHEDULER),
    "The wire of ROS 2: samples": Small("--samples 200", apart="needs Fast DDS and cyclonedds"),
    "A ground robot among walls": Small("--runs 20", flights=4, times=SIMULATED),
    "Safe exploration: a thousand worlds": Small(
        instead="bench/exploration/worlds.py --worlds 8 --workers 1 --only frontier ramming",
        flights=2,
        times="time|x real",
    ),
    "Safe exploration: other controllers, planners with bugs, and by contrast": Small(
        instead="bench/exploration/worlds.py --worlds 20 --workers 1 --only jerking "
        "'boxes anywhere' 'bare: ramming'",
        flights=1,
        times="time|x real",
    ),
    "Safe exploration: planners of others": Small(
        instead="bench/exploration/worlds.py --worlds 20 --workers 1 --only learned "
        "'bare: learned' 'boxes of an old map'",
        flights=1,
        times="time|x real",
    ),
    "Safe exploration: a lidar that is worse than assumed": Small(
        "--worlds 1 --workers 1", times=SIMULATED
    ),
    "A rover among people": Small("--only hover --runs 3", flights=3, times="x real"),
    "Betaflight below a proved geofence": Small(
        "--flights 8 --workers 1", flights=8, times="wall", apart=BETAFLIGHT
    ),
    "Betaflight on the drone's laps": Small(
        "--flights 6 --workers 1", flights=6, times="wall", apart=BETAFLIGHT
    ),
    "MAVLink: who dies beside an autopilot's double": Small("-n 1", machine=SCHEDULER),
    "MAVLink: what is wrong on the wire": Small(machine=SCHEDULER),
    "Bugs of the fleet's leases": Small(times=SIMULATED, apart=MINUTES),
    "Four robots at a junction, one machine in trouble": Small(
        "--runs 4", flights=4, times=SIMULATED
    ),
    "Axes that wrap around": Small("--systems 2 --wide 0"),
    "Edits: which proofs are done again": Small("--edits 1", machine="fewer edits"),
    "The junction as processes over DDS": Small("--row 0 --seconds 10", machine=SCHEDULER),
    "Two drones as processes over DDS": Small("--seconds 10", machine=SCHEDULER),
}
"""Every row of docs/benchmarks.md."""

NOT_SEEN = frozenset(
    {
        "Bad files and options",
        "The surveillance drone: stacks that must not be proved",
        "Shields that are wrong",
        "Certificates made wrong and sealed again",
        "Forged certificates of every kind of proof",
        "Certificates that say more than is true",
        "soter test: bugs seeded in the examples",
        "Delays of the trusted part",
        "A ground robot among walls",
        "A rover among people",
    }
)
"""Sections whose smaller run has not been seen to come out yet: none of them is a long test."""

LAPS = "@The drone's laps"
FENCE = "@Betaflight below a proved geofence"
JUNCTION = "@Four robots at a junction, one machine in trouble"
WORLDS = "@Safe exploration: a thousand worlds"
LIDAR = "@Safe exploration: a lidar that is worse than assumed"
LEARNED = "@Safe exploration: planners of others"
DEATHS = "@MAVLink: who dies beside an autopilot's double"
READING = "-m pytest -q -p no:cacheprovider -n 0 tests/unit/certificate/test_reading_order.py"
GALLERY = "-m pytest -q -p no:cacheprovider -n 0 --all tests/correct/test_gallery.py"
RHYTHM = "@The rhythm that the drone follows worst"
PAGE_OF_RESULTS = "bench/running/results_page.py --out build/made-again --page build/results.md"
DESIGN = "-m pytest -q -p no:cacheprovider -n 0 --all tests/correct/test_drone_design.py"

PAGES = (
    Made("assure.md", "| program | conditions", "bench/c_code/traced_conditions.py"),
    Made("tool-qualification.md", "| rule | generated", "bench/c_code/misra_rules.py"),
    Made("autopilot.md", "| flights of 20 s", FENCE, given="10 2.5 30 70 6 1.5 20 10,001"),
    Made("autopilot.md", "```arm  ", "@Betaflight on the drone's laps", times="wall"),
    Made(
        "autopilot.md",
        r"AC has ([\d.]+) % of it in place of ([\d.]+) %",
        "@Betaflight on the drone's laps",
        spread=True,
    ),
    Made("autopilot.md", "```$ python", "examples/autopilot/identify.py"),
    Made(
        "autopilot.md",
        "```$ soter verify examples/autopilot/autopilot",
        "-m soter verify examples/autopilot/autopilot.soter",
    ),
    Made(
        "autopilot.md",
        "```$ soter verify examples/autopilot/corridor",
        "-m soter verify examples/autopilot/corridor.soter --module SafeCorridor",
    ),
    Made("dds.md", "| through the bridge", "@The wire of ROS 2: samples", given="720 8 1.1 0.3"),
    Made(
        "dds.md",
        r"Of (\d+) payloads (?:.|\n)*? were no value of the\ntype, (\d+) of another length, (\d+) ",
        "@The wire of ROS 2: samples",
    ),
    Made("dds.md", "| killed | most", "@ROS: who dies, and what the wheels are told"),
    Made("ros.md", "| killed | at most", "@ROS: who dies, and what the wheels are told"),
    Made(
        "ros.md",
        r"on the wire: (\d+) cases of ROS 2",
        "@ROS: what is wrong on the wire",
    ),
    Made("ros.md", r"and (\d+) of ROS 1 \(NaN", "@ROS: what is wrong on the wire"),
    Made("drone.md", "| leg | length", DESIGN),
    Made("drone.md", r"downwards (29) mm are left to the ground †", DESIGN),
    Made("drone.md", r"grows by at most ([\d.]+), (?:.|\n)*? TURN = ([\d.]+) †", DESIGN),
    Made("drone.md", r"\*\*Residual\*\* (?:.|\n)*? †: ([\d.]+) m/s² in bang-bang", DESIGN),
    Made("drone.md", r"Check on the five-state axis †(?:.|\n)*? wall is ([\d.]+) m along", DESIGN),
    Made(
        "drone.md",
        "```           flights",
        "@The drone against the plant of its proof",
        times=SIMULATED,
    ),
    Made("drone.md", "```           axis", "bench/drone/bound.py"),
    Made("drone.md", "```                   found", RHYTHM),
    Made(
        "deploy.md",
        r"tries it: (\d+) scenes, and in none the law late",
        "@Words, signals, and when the law comes",
    ),
    Made(
        "drone.md",
        "```system     hours",
        "bench/drone/off_model.py --minutes 12",
        small="bench/drone/off_model.py --hours 0.1",
        flights=10,
    ),
    Made("drone.md", "```arm           laps", LAPS, times=SIMULATED),
    Made("drone.md", "```AC         runs", "@Hostile advanced controllers", times=SIMULATED),
    Made(
        "exploration.md",
        "| what is wrong",
        LIDAR,
        given="2 5 10 20 50 1 30 0.3",
        spread=True,
    ),
    Made(
        "exploration.md",
        r"knew ([\d.]+) % of what can be reached after five minutes \(([\d.]+) % in the worst;\n"
        r".*with (\d+) takeovers a flight",
        LEARNED,
    ),
    Made(
        "exploration.md",
        "| from the middle of the street",
        "bench/exploration/people.py --price",
    ),
    Made("exploration.md", r"alone it hit one in (\d+) of them", LEARNED),
    Made("exploration.md", r"In (1,000) worlds frontier exploration knew", WORLDS),
    Made("fleet.md", "| bug | test", "@Bugs of the fleet's leases", given="21"),
    Made("fleet.md", "| one machine | runs", JUNCTION, spread=True, given="500 400 3 2"),
    Made("fleet.md", "| one machine, from", "@The junction as processes over DDS", given="20 70 1"),
    Made("fleet.md", "| one drone, from", "@Two drones as processes over DDS", given="1 20"),
    Made(
        "fleet.md",
        r"the four collide (\d+) times in a minute",
        "-m soter run examples/fleet/junction.soter --system Unprotected",
    ),
    Made(
        "for-learning-researchers.md",
        "| driver | |",
        "@The mountain car: four drivers, alone and with RTA",
    ),
    Made(
        "for-learning-researchers.md",
        r"twice: (\d+) falls without the module and (\d+) with it, in (\d+) and (\d+) steps",
        "@The mountain car: training with and without the module",
        spread=True,
    ),
    Made(
        "for-learning-researchers.md",
        r"measured ([\d,]+)\nsteps of Gymnasium's own code: (\d+) lay outside",
        "@The mountain car: Gymnasium against the proved map",
        spread=True,
    ),
    Made(
        "for-learning-researchers.md",
        r"A protected\nstep took ([\d.]+) times a bare one",
        "@What people wait for",
    ),
    Made(
        "for-robotics-engineers.md",
        r"flew ([\d,]+) seeded laps\. The fast controller alone ended (\d+) with a violation; "
        r"(?:.|\n)*? it ended (\d+)\. (?:.|\n)*?\n([\d.]+) % of the time, and a lap took "
        r"([\d.]+) times (?:.|\n)*? needs ([\d.]+) times",
        "@The drone's laps",
        given="1,000",
        spread=True,
    ),
    Made("for-robotics-engineers.md", "| before the wheels", "@A ground robot among walls"),
    Made(
        "for-robotics-engineers.md",
        r"there after ([\d.]+) ms at most \(bound ([\d.]+)\), the wheels' fail-safe after\n"
        r"([\d.]+) ms \(bound ([\d.]+)\)",
        "@ROS: who dies, and what the wheels are told",
        spread=True,
    ),
    Made(
        "for-safety-engineers.md",
        r"on purpose: (\d+) modules; (\d+) were proved",
        "@Wrong modules that must not be proved without a word",
        spread=True,
    ),
    Made(
        "for-safety-engineers.md",
        r"against (\d+) modules that are proved, for ([\d,]+) steps: (\d+) violations",
        "@A closed-loop adversary against proved modules",
    ),
    Made(
        "for-safety-engineers.md",
        r"into the prover: (\d+) of (\d+) found",
        "@Holes put back into the prover",
    ),
    Made(
        "for-safety-engineers.md",
        r"random programs: (\d+) contradiction in (\d+)",
        "@Verify, recheck and run against each other",
    ),
    Made(
        "for-safety-engineers.md",
        r"1,800 forged certificates: (\d+) false ones accepted, (\d+) right ones rejected",
        "@Forged certificates of every kind of proof",
    ),
    Made(
        "for-safety-engineers.md",
        r"tests noticed (\d+) of (\d+) \(target: (\d+) %",
        "@Mutants of the re-checker's core",
    ),
    Made("gallery.md", "| file | test | verdict", GALLERY),
    Made(
        "identify.md",
        "```200 vehicles",
        "bench/logs/identify.py",
        small="bench/logs/identify.py --plants 20",
        flights=20,
    ),
    Made("ground-robot.md", "| | runs that", "@A ground robot among walls"),
    Made(
        "mavlink.md",
        r"left OFFBOARD after (\d+) ms at most \(bound (\d+)\)",
        DEATHS,
    ),
    Made("mavlink.md", r"had the law after (\d+) ms at most \(bound (\d+)\)", DEATHS),
    Made("mavlink.md", r"had SC's\ncommand after (\d+) ms at most \(bound (\d+)\)", DEATHS),
    Made(
        "assure.md",
        r"of (41) proofs that have to be done again each is named, and of (39) that stand (7)",
        "@Edits: which proofs are done again",
        spread=True,
    ),
    Made("newcomers.md", r"last two sets (\d+) of 68", "@Slips of newcomers"),
    Made("newcomers.md", r"of 68 and (\d+) of 60", "@Slips of newcomers"),
    Made("recheck.md", "| step", READING),
    Made("real-logs.md", "```40 legs", "@Go-to legs that PX4 flew", times=SIMULATED),
    Made(
        "results.md",
        "*",
        PAGE_OF_RESULTS,
        small=f"{PAGE_OF_RESULTS} --hours 0.5 --stack 2 --laps 10",
        flights=2,
        times="wall",
        reads="build/results.md",
    ),
    Made(
        "surveillance.md",
        r"NumPy: ([\d,]+)\s+commands,\s+imitated to ([\d.]+) m/s²",
        "examples/drone/eight_train.py -o build/eight.json",
        spread=True,
    ),
    Made(
        "surveillance.md",
        r"`Learned` alone(?:.|\n)*?: (\d+) stay within ([\d.]+) m of the loop\s\(([\d.]+) to "
        r"([\d.]+) rad/s\), (\d+) do not \(([\d.]+) to ([\d.]+) rad/s, up to ([\d.]+) m\), "
        r"(\d+) of them\scollide(?:.|\n)*?for ([\d.]+) %. Right, (\d+) laps (?:.|\n)*?: (\d+) coll",
        "examples/drone/figures.py 5 -o build/figure-5.html",
        spread=True,
    ),
    Made(
        "surveillance.md",
        r"over (\d+) laps ([\d.]+) s, ([\d.]+) s and\s([\d.]+) s; (\d+) laps of AC alone "
        r"collide, of\sthe protected ones none; AC is in control for ([\d.]+) %",
        "examples/drone/figures.py 12a -o build/figure-12a.html",
        spread=True,
    ),
    Made(
        "surveillance.md",
        r"\*Ours\*: (\d+) s of the mission with its (\d+)\splans; SC (?:.|\n)*?, for ([\d.]+) s in "
        r"all \(AC\s([\d.]+) %(?:.|\n)*?the drone is ([\d.]+) m off its plan",
        "examples/drone/figures.py 12b -o build/figure-12b.html",
        spread=True,
    ),
    Made(
        "surveillance.md",
        r"takes over after ([\d.]+) s with ([\d.]+) % of charge left, a margin\nof ([\d.]+) % over "
        r"(?:.|\n)*?in a dock ([\d.]+) s later, of (\d+) s put by, with ([\d.]+) %",
        "examples/drone/figures.py 12c -o build/figure-12c.html",
        spread=True,
    ),
    Made(
        "testing.md",
        "| program | flights: violated",
        "bench/tubes/attack.py --only follow --runs 10000 --holds 1000000 --dives 100 --programs 0",
        times=SIMULATED,
    ),
    Made("evidence.md", "| drawn | states | verdict", "bench/tubes/drawn_robots.py"),
    Made("evidence.md", "| designed | states | verdict", "bench/tubes/drawn_robots.py"),
    Made(
        "testing.md",
        r"(0) of (100) wrong variants",
        "bench/tubes/wrong_rests.py --count 100",
    ),
    Made(
        "testing.md",
        r"([\d,]+) of ([\d,]+)\sare\sconfirmed",
        "bench/tubes/flights.py --flights 100 --until 6 --changed 10",
        spread=True,
    ),
    Made(
        "testing.md",
        "| example | flights: violated",
        "bench/tubes/attack.py --runs 2000 --holds 300000 --dives 30 --programs 0",
        times=SIMULATED,
    ),
    Made(
        "testing.md",
        r"with three\splans AC loses control ([\d.]+) m before it, "
        r"with braking alone ([\d.]+) m before it; (0) of ([\d,]+) adversarial",
        "bench/tubes/swerve.py --runs 2000 --seeds 20",
    ),
    Made(
        "testing.md",
        r"(\d+) of (\d+) are seen",
        "bench/tubes/smaller_constants.py",
        spread=True,
    ),
    Made(
        "timing.md",
        r"`bench/verify/schedulability.py` draws (10,000) sets of tasks",
        "@Threads: the analysis against executions",
    ),
    Made(
        "timing.md",
        r"P1c of (20,000) random programs",
        "@P1c of deployed modules against all executions",
    ),
)

DEFINED = "what the language, a format or a program declares"
MEASURED_ONCE = "measured once; no command makes it again"
HELD = "a test holds it: tests/"
ELSEWHERE = "its figures stand in docs/benchmarks.md alone"
SESSION = f"{HELD}correct/test_"

EXCEPT: dict[tuple[str, str], str] = {
    ("architecture.md", "| what | new | touched |"): DEFINED,
    ("assure.md", "| question"): DEFINED,
    ("autopilot.md", "| a quiet flight, from"): f"{MEASURED_ONCE}: a body without J",
    ("campaigns.md", "| violation"): DEFINED,
    ("commands.md", "| format"): DEFINED,
    ("compose-proved-modules.md", "```all of them"): f"{SESSION}compose_page.py",
    ("compared.md", "| who"): "what documents of others say, with their dates",
    ("compared.md", "| scenario"): "two blocks of that output, side by side",
    ("compared.md", "bench/peers/beside_peers.py"): "stands in the output of that command",
    ("compose-proved-modules.md", "```node Creep"): DEFINED,
    ("dds.md", "| `trusted/`"): DEFINED,
    ("dds.md", "| key"): DEFINED,
    ("deploy.md", "``` your loop"): "a drawing",
    ("deploy.md", "| process | SIGTERM"): DEFINED,
    ("deploy.md", "Functions with a check, counted"): MEASURED_ONCE,
    ("drone.md", "| file"): DEFINED,
    ("drone.md", "| gains"): DEFINED,
    ("drone.md", "```w  = v"): "a formula",
    ("evidence.md", "| item"): DEFINED,
    ("evidence.md", "| program | states that are followed"): DEFINED,
    ("evidence.md", "**A network as SC.**"): DEFINED,
    ("evidence.md", "what one check costs"): ELSEWHERE,
    ("exploration.md", "| δ"): DEFINED,
    ("exploration.md", "paper.soter -o paper.html"): f"{SESSION}exploration_flights.py",
    ("find-the-bug.md", "| option"): DEFINED,
    ("find-the-bug.md", "```$ soter test"): f"{SESSION}find_the_bug.py",
    ("gallery.md", "```$ soter test"): f"{SESSION}gallery_page.py",
    ("gallery.md", "```$ soter verify examples/robots"): f"{SESSION}gallery_page.py",
    ("gallery.md", "```$ soter run examples/robots"): f"{SESSION}gallery_page.py",
    ("gallery.md", "| robot | SC"): DEFINED,
    ("gallery.md", "```          every"): "a drawing",
    ("gallery.md", "```  home 0"): "a drawing",
    ("glossary.md", "| Soter"): DEFINED,
    ("ground-robot.md", "| part"): DEFINED,
    ("ground-robot.md", "| in `ranges`"): DEFINED,
    (
        "ground-robot.md",
        "| | page | faster",
    ): f"{DEFINED}; {HELD}correct/test_ground_robot.py proves"
    " both; from where AC has control is of the formula above it",
    ("gym.md", "| key"): DEFINED,
    ("gym.md", "| arm"): f"{PEERS}; `python bench/gym/learning.py` prints it",
    ("gym.md", "PPO of Stable"): "what that command is told, and its table",
    ("json.md", "| exit"): DEFINED,
    ("language-card.md", "| type"): DEFINED,
    ("language.md", "| type"): DEFINED,
    ("language.md", "| operators"): DEFINED,
    ("mavlink.md", "| what ends"): DEFINED,
    ("migrating.md", "| there"): DEFINED,
    ("migrating.md", "| what stops"): f"{SESSION}migration.py",
    ("migrating.md", "| what is between"): f"{SESSION}migration.py",
    ("mountain_car.md", "| AC"): DEFINED,
    ("stability.md", "| went"): "lines of commits, by `git show --numstat`",
    ("stability.md", "| figure"): "the same, once; and rows of benchmarks of that day",
    ("newcomers.md", "| who, robot"): "people, each once",
    ("newcomers.md", "- **25 robots"): "robots, each once; the page says how they are asked",
    ("newcomers.md", "- **The same 25 as"): "robots, each once; the page says how they are asked",
    ("newcomers.md", "- **The same 25 with"): "robots, each once; the page says how they are asked",
    ("newcomers.md", "- **78 wrong"): "programs, each once; the page says how they are asked",
    ("newcomers.md", "- **Twelve kinds"): "a row of benchmarks, and one sentence about its rows",
    (
        "newcomers.md",
        "- **What help",
    ): "judgements of people, each once; the page says how the lines are asked",
    ("prelude.md", "| function"): f"{HELD}unit/prelude",
    ("proof.md", "| | what"): DEFINED,
    ("proof.md", "| symbol"): DEFINED,
    ("proof-flight.md", "| | value | derivation"): DEFINED,
    ("proof-flight.md", "| a naive version"): DEFINED,
    ("prove-your-module.md", "| cells declared"): f"{SESSION}prove_your_module.py",
    ("prove-your-module.md", "```SafeLane"): f"{SESSION}prove_your_module.py",
    ("prove-your-module.md", "```SafeTank"): f"{SESSION}prove_your_module.py",
    ("prove-your-module.md", "```P3"): f"{SESSION}prove_your_module.py",
    ("prove-your-module.md", "```P2a"): f"{SESSION}prove_your_module.py",
    ("prove-your-module.md", "```verify {"): DEFINED,
    ("identify.md", "| log of strangers"): "logs of strangers, which are not kept here",
    ("identify.md", "In a first try pieces were longer"): MEASURED_ONCE,
    ("identify.md", "They came from PX4/pyulog"): "of logs of strangers, as the table above it",
    ("identify.md", "```type Fit"): DEFINED,
    ("real-logs.md", "bench/hostile/logs_of_strangers.py"): "stands in the output of that command",
    ("real-logs.md", "| file"): DEFINED,
    ("real-time.md", "| what | needs"): DEFINED,
    ("real-time.md", "| mechanism"): DEFINED,
    ("real-time.md", "``` process 1"): "a drawing",
    ("recheck.md", "| what | how much"): DEFINED,
    ("recheck.md", "| hypothesis"): DEFINED,
    ("recheck.md", "| assumption that is printed"): DEFINED,
    ("semantics.md", "| part"): DEFINED,
    ("semantics.md", "| code"): DEFINED,
    ("semantics.md", "```euler"): "a formula",
    ("semantics.md", "```mix(z)"): "a formula",
    ("stability.md", "| what | what stays"): DEFINED,
    ("surveillance.md", "| verdict"): DEFINED,
    ("surveillance.md", "| `MARGIN_H`"): f"{SESSION}drone_roadmap.py",
    ("surveillance.md", "The walls of the city"): f"{SESSION}drone_roadmap.py, its pieces",
    ("surveillance.md", "| bug"): DEFINED,
    ("surveillance.md", "| | value"): DEFINED,
    ("surveillance.md", "| | per second"): DEFINED,
    ("surveillance.md", "| assumed"): DEFINED,
    ("surveillance.md", "**Hand-over.**"): "times of a proof",
    ("testing.md", "| what is promised"): f"{MEASURED_ONCE}: attacks by hand",
    ("testing.md", "Once more holds were drawn"): f"{MEASURED_ONCE}: half an hour of attack.py",
    ("evidence.md", "Of 33 such robots"): f"{MEASURED_ONCE}: robots drawn by others",
    ("testing.md", "When things were taken out"): f"{MEASURED_ONCE}: beside the tree before",
    ("testing.md", "| the report says"): DEFINED,
    ("testing.md", "an aircraft that nobody here wrote"): DEFINED,
    ("testing.md", "`bench/tubes/identify_f16.py` fits"): ELSEWHERE,
    ("testing.md", "`bench/tubes/dives.py` flies"): ELSEWHERE,
    ("testing.md", "| | 4aa7b032 | | | 43b8a6f1"): MEASURED_ONCE,
    ("testing.md", "| | examples"): DEFINED,
    ("testing.md", "| command | what it runs"): DEFINED,
    ("timing.md", "```thread"): f"{HELD}unit/cli/test_cli_timing.py",
    ("tool-qualification.md", "| part | tried by"): f"{HELD}correct/test_docs_site.py",
    ("what-runs.md", "| file | of it is executed"): f"{HELD}correct/test_hostile_files.py",
    ("verification.md", "| what is written"): DEFINED,
    ("verification.md", "| what | how it is measured"): DEFINED,
    ("verification.md", "| kind"): DEFINED,
    ("verification.md", "| changed | how"): DEFINED,
    ("verification.md", "| function | what is enclosed"): "bounds of a theorem; "
    f"{HELD}unit/certificate/test_functions_of_the_prelude.py",
    ("verification.md", '```{ "system"'): DEFINED,
}
"""(page, how a table or block begins, or words of a paragraph) -> why nothing here makes it."""
