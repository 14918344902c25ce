"""The benchmarks: a row of docs/benchmarks.md each.

Purpose: the commands that `make bench` runs, in the order of the page, each with its name and what
of its output the page shows.
Non-goals: running them (run_all.py).
"""

from __future__ import annotations

from dataclasses import dataclass


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
    Benchmark(
        "Edits: which proofs are done again", "bench/verify/changes.py", last="^[0-9]+ proofs"
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
        "ROS: who dies, and what the wheels are told",
        "bench/ros/kills.py",
        heads="max ms|bound|over it",
    ),
    Benchmark("ROS: what is wrong on the wire", "bench/ros/bad_input.py", last="cases"),
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
