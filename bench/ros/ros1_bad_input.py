"""ROS 1: what is wrong on the wire, beside the whole stack of examples/ros/shuttle_ros.soter.

    .venv/bin/python bench/ros/ros1_bad_input.py [CASE ...]

A node says that the shuttle is at 0.25 m, so that SC (nobody is AC) commands -0.25 m/s, then
something bad, then the good again (ros1_hostile.py). A wrong command is any that is neither -0.25
nor the law, 0. What the bridge and the trusted part said of it is read from /diagnostics, whose
last state each case prints. Exit code 1 where a command was wrong, or nobody said anything.
"""

from __future__ import annotations

import re
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.ros.ros1_nodes import HERE, SYSTEM_PYTHON, Nodes, built_package, missing, nodes  # noqa: E402

EXAMPLE = ROOT / "examples" / "ros" / "shuttle_ros.soter"
HOSTILE = HERE / "ros1_hostile.py"
OF_BRIDGE = "soter: /odom"
OF_TRUSTED = "soter: the trusted part's position"
OF_WISH = "soter: the trusted part's wish"
CASES = {
    "NaN": (OF_TRUSTED, "not finite, or outside its set"),
    "infinity": (OF_TRUSTED, "not finite, or outside its set"),
    "minus infinity": (OF_TRUSTED, "not finite, or outside its set"),
    "beyond the set": (OF_TRUSTED, "not finite, or outside its set"),
    "greatest double": (OF_TRUSTED, "not finite, or outside its set"),
    "another frame": (OF_BRIDGE, "in another frame"),
    "no frame": (OF_BRIDGE, "in another frame"),
    "a frame of a megabyte": (OF_BRIDGE, "in another frame"),
    "no stamp": (OF_BRIDGE, "without a stamp"),
    "ns beyond a second": (OF_BRIDGE, "without a stamp"),
    "stamped in an hour": (OF_BRIDGE, "stamped later than now"),
    "stamped in 50 ms": (OF_BRIDGE, "stamped later than now"),
    "the last stamp there is": (OF_BRIDGE, "stamped later than now"),
    "stamped an hour ago": (OF_TRUSTED, "older than the one before"),
    "stamped 1970": (OF_TRUSTED, "older than the one before"),
    "silence": ("soter: module Guard", "message"),
    "a flood of the good": (OF_BRIDGE, "taken"),
    "a flood of NaN": (OF_TRUSTED, "not finite, or outside its set"),
    "NaN as a wish": (OF_WISH, "not finite, or outside its set"),
    "a wish beyond the set": (OF_WISH, "not finite, or outside its set"),
    "a latched wish": ("soter: /wish", "without a stamp"),
    "as another node": (OF_BRIDGE, "of another publisher"),
    "as another commander": ("soter: /cmd_vel", "message"),
    "the actuators are killed": ("soter: /cmd_vel", "message"),
    "as another type": ("", ""),
    "as torn bytes": ("", ""),
}
"""Case, and whose counter tells of it ("": roscpp itself, on its own log)."""
BESIDE = frozenset(("as another node", "as another commander", "as another type", "as torn bytes"))
ACTUATORS = "the actuators are killed"
COMMAND = re.compile(r"^cmd (.+)$")
RIGHT = frozenset(("-0.25", "0.0", "-0.0"))


def counters(text: str) -> dict[tuple[str, str], str]:
    """Of the last message of `rostopic echo /diagnostics`: (name, key) -> value."""
    told: dict[tuple[str, str], str] = {}
    name = key = ""
    for line in text.rpartition("\n---")[0].rpartition("---\n")[2].splitlines():
        what, _, value = line.strip().partition(": ")
        value = value.strip('"')
        if what == "name":
            name = value
        elif what in ("message", "level"):
            told[name, what] = value
        elif what == "key":
            key = value
        elif what == "value":
            told[name, key] = value
    return told


def one(all_: Nodes, build: Path, case: str) -> tuple[list[str], dict[tuple[str, str], str]]:
    """Commands that were heard, and what was said at the end."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as channels:
        all_.start("actuator", build / "shuttle_ros_actuator", "--channels", channels)
        all_.start("bridge", build / "shuttle_ros_bridge", f"_channels:={channels}")
        driver = all_.start("driver", SYSTEM_PYTHON, HOSTILE, "NaN" if case in BESIDE else case)
        while "ready\n" not in all_.heard["driver"] and driver.poll() is None:
            time.sleep(0.01)
        words = ["--channels", channels, "--misses", "1000000"]
        all_.start("trusted", build / "shuttle_ros", *words)
        echo = [SYSTEM_PYTHON, "/usr/bin/rostopic", "echo", "/diagnostics"]
        all_.start("diagnostics", *echo)
        if case in BESIDE:
            all_.start("beside", SYSTEM_PYTHON, HOSTILE, case)
        while case == ACTUATORS and "kill\n" not in all_.heard["driver"]:
            time.sleep(0.01)
        if case == ACTUATORS:
            all_.running["actuator"].kill()
        driver.wait(60)
        time.sleep(1.2)
        watched = ["bridge", "trusted", *(["actuator"] if case != ACTUATORS else [])]
        codes = {n: all_.running[n].poll() for n in watched}
        ended = [f"{n} with {code}" for n, code in codes.items() if code is not None]
        for name in [n for n in all_.running if n != "master"]:
            all_.end(name)
        told = counters("".join(all_.heard.pop("diagnostics")))
        lines = all_.heard.pop("driver")
        told["ended", ""] = ", ".join(ended)
        logs = [*all_.heard.pop("bridge"), *all_.heard.pop("beside", [])]
        words = [x.strip() for x in logs if "error" in x.lower() or "type" in x]
        told["of roscpp", "log"] = (words or [""])[0]
        return [m[1] for m in map(COMMAND.match, lines) if m], told


def main() -> int:
    """Run; 1 where a command was wrong."""
    if why := missing():
        print(f"not run: {why} is not here")
        return 2
    chosen = sys.argv[1:] or [*CASES]
    wrong = silent = 0
    with tempfile.TemporaryDirectory() as folder, nodes() as all_:
        mapping = EXAMPLE.with_suffix(".toml")
        build = built_package(EXAMPLE, "Vehicle", mapping, Path(folder) / "package")
        print(f"{'on the wire':<26} {'commands':<18} what is said")
        for case in chosen:
            commands, told = one(all_, build, case)
            name, key = CASES[case]
            said = told.get((name, key), "")
            bad = sorted({*commands} - RIGHT)
            ended = told["ended", ""]
            wrong += bool(bad) or bool(ended)
            shown = f"{key}: {said}" if key != "message" else said
            if not key:
                said = told["of roscpp", "log"]
                shown = f"of roscpp, rospy: {said}"
            silent += said in ("", "0", "published")
            shown = f"ENDED: {ended}" if ended else shown[:90].rstrip("\\")
            print(f"{case:<26} {', '.join(dict.fromkeys(commands)):<18} {shown}", flush=True)
    print(
        f"{len(chosen)} cases: {wrong} with a wrong command, {silent} of which nobody said a word"
    )
    return 1 if wrong or silent else 0


if __name__ == "__main__":
    sys.exit(main())
