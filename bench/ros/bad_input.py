"""ROS 2 and 1: what is wrong on the wire, beside the whole stack of shuttle_ros.soter.

    .venv/bin/python bench/ros/bad_input.py [--ros 2] [--cases CASE ...]

A node says that the shuttle is at 0.25 m, so that SC (nobody is AC) commands -0.25 m/s, then
something bad, then the good again (hostile.py). A wrong command is any that is neither -0.25
nor the law, 0. What the bridge and the trusted part said of it is read from /diagnostics, whose
last state each case prints. Exit code 1 where a command was wrong, or nobody said anything.
ROS 2 is the one that the shell has sourced.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.ros import dds_nodes, ros1_nodes, ros2_nodes  # noqa: E402

if TYPE_CHECKING:
    from types import ModuleType

    from bench.processes import Processes

EXAMPLE = ROOT / "examples" / "ros" / "shuttle_ros.soter"
HERE = Path(__file__).resolve().parent
ROS = {"2": ros2_nodes, "1": ros1_nodes, "dds": dds_nodes}
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
OF_ROS_2 = {
    "a latched wish": ("soter: /wish", "message"),
    "as another type": (OF_BRIDGE, "message"),
    "as torn bytes": (OF_BRIDGE, "no value of its type"),
    "cut short": (OF_BRIDGE, "no value of its type"),
}
"""Nothing of before is sent to who hears as the bridge does; rclcpp says nothing of a type, and
hands on what Cyclone DDS could read of bytes that are no value."""
BESIDE = frozenset(("as another node", "as another commander", "as another type", "as torn bytes"))
ACTUATORS = "the actuators are killed"
LATCHED = "a latched wish"
COMMAND = re.compile(r"^cmd (.+)$")
RIGHT = frozenset(("-0.25", "0.0", "-0.0"))


def cases(ros: ModuleType) -> dict[str, tuple[str, str]]:
    """The cases as this ROS tells of them."""
    return CASES if ros is ros1_nodes else CASES | OF_ROS_2


def counters(lines: list[str]) -> dict[tuple[str, str], str]:
    """Of the last line of diagnostics.py: (name, key) -> value."""
    last = next((line for line in reversed(lines) if line.startswith("{")), "{}")
    told = json.loads(last)
    return {(name, key): value for name, own in told.items() for key, value in own.items()}


def one(
    ros: ModuleType, all_: Processes, build: Path, case: str
) -> tuple[list[str], dict[tuple[str, str], str]]:
    """Commands that were heard, and what was said at the end."""
    hostile = (ros.PYTHON, HERE / "hostile.py")
    with tempfile.TemporaryDirectory(dir="/dev/shm") as channels:
        all_.start("actuator", build / "shuttle_ros_actuator", "--channels", channels)
        driver = all_.start("driver", *hostile, "NaN" if case in BESIDE else case)
        while case == LATCHED and "latched\n" not in all_.heard["driver"]:
            time.sleep(0.01)
        words = ros.parameters(channels=channels)
        all_.start("bridge", build / "shuttle_ros_bridge", *words)
        while "ready\n" not in all_.heard["driver"] and driver.poll() is None:
            time.sleep(0.01)
        words = ["--channels", channels, "--misses", "1000000"]
        all_.start("trusted", build / "shuttle_ros", *words)
        all_.start("diagnostics", ros.PYTHON, HERE / "diagnostics.py")
        if case in BESIDE:
            all_.start("beside", *hostile, case)
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
        told = counters(all_.heard.pop("diagnostics"))
        lines = all_.heard.pop("driver")
        told["ended", ""] = ", ".join(ended)
        logs = [*all_.heard.pop("bridge"), *all_.heard.pop("beside", [])]
        said = [x.strip() for x in logs if "error" in x.lower() or "type" in x]
        told["of ROS", "log"] = (said or [""])[0]
        return [m[1] for m in map(COMMAND.match, lines) if m], told


def absent(versions: list[str]) -> str:
    """Which of these is not here, and why, printed; "": all are."""
    whys = [f"ROS {n}: {why}" for n in versions if (why := ROS[n].missing())]
    print(*(f"not run: {why} is not here" for why in whys), sep="\n", end="\n" if whys else "")
    return "; ".join(whys)


def run(ros: ModuleType, chosen: list[str]) -> bool:
    """Print the table of one ROS; whether all was as it has to be."""
    wrong = silent = 0
    with tempfile.TemporaryDirectory() as folder, ros.nodes() as all_:
        mapping = EXAMPLE.with_suffix(".toml")
        build = ros.built_package(EXAMPLE, "Vehicle", mapping, Path(folder) / "package")
        print(f"{ros.version() + ', on the wire':<32} {'commands':<18} what is said")
        for case in chosen or cases(ros):
            commands, told = one(ros, all_, build, case)
            name, key = cases(ros)[case]
            said = told.get((name, key), "")
            bad = sorted({*commands} - RIGHT)
            ended = told["ended", ""]
            wrong += bool(bad) or bool(ended)
            shown = f"{key}: {said}" if key != "message" else said
            if not key:
                said = told["of ROS", "log"]
                shown = f"of ROS itself: {said}"
            silent += said in ("", "0", "published", "taken")
            shown = f"ENDED: {ended}" if ended else shown[:90].rstrip("\\")
            print(f"{case:<32} {', '.join(dict.fromkeys(commands)):<18} {shown}", flush=True)
    print(
        f"ROS {ros.VERSION}: {len(chosen or cases(ros))} cases: {wrong} with a wrong command, "
        f"{silent} of which nobody said a word"
    )
    return not (wrong or silent)


def main() -> int:
    """Run; 1 where a command was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ros", nargs="+", choices=ROS, default=["2", "1"])
    parser.add_argument("--cases", nargs="+", metavar="CASE", default=[])
    given = parser.parse_args()
    if absent(given.ros):
        return 2
    ended = [run(ROS[n], given.cases) for n in given.ros]
    return 0 if all(ended) else 1


if __name__ == "__main__":
    sys.exit(main())
