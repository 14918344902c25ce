"""ROS 1: the bridge beside a bare echo of the same middleware.

    .venv/bin/python bench/ros/ros1_latency.py [--count N] [--rounds N]

Turn by turn in one run: /odom until /cmd_vel is there, through a node that does nothing else
(ros1_echo.cpp); and /odom until the value is in the topic's channel plus a command in its channel
until /cmd_vel is there, through the bridge of examples/ros/shuttle_ros.soter. What comes between
these two on a robot, the release that is waited for and the actuators' turn, is stated apart: it is
the calendar's. Exit code 1 where the ratio of the medians is above 1.2.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.ros.ros1_nodes import HERE, PACKAGES, built_node, built_package, missing, nodes  # noqa: E402

EXAMPLE = ROOT / "examples" / "ros" / "shuttle_ros.soter"
TARGET = 1.2


def built_latency(package: Path, folder: Path) -> Path:
    """The measuring node, with the channels of the package."""
    told = subprocess.run(
        ["pkg-config", "--cflags", "--libs", *PACKAGES], check=True, capture_output=True, text=True
    )
    trusted = package / "trusted"
    objects = []
    for name in ("soter_outside", "soter_channel", "soter_posix_check", "shuttle_ros_lease"):
        objects.append(str(folder / f"{name}.o"))
        words = ["cc", "-O2", f"-I{trusted}", "-c", "-o", objects[-1], str(trusted / f"{name}.c")]
        subprocess.run(words, check=True)
    program = folder / "ros1_latency"
    includes = [f"-I{trusted}", f"-I{package / 'src'}"]
    words = ["g++", "-O2", *includes, "-o", str(program), str(HERE / "ros1_latency.cpp"), *objects]
    subprocess.run([*words, *told.stdout.split()], check=True)
    return program


def one_round(what: str, other: list[str], program: Path, count: int) -> list[tuple[float, float]]:
    """The samples of one run; `other`: the node between."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as channels, nodes() as all_:
        all_.start("other", *[w.replace("CHANNELS", channels) for w in other])
        node = all_.start("latency", program, what, str(count), channels)
        node.wait(600)
        lines = [*all_.heard["latency"]]
    if lost := lines.count("lost\n"):
        print(f"{what}: {lost} of {count} lost")
    pairs = [line.split() for line in lines if line[:1].isdigit()]
    return [(float(a), float(b)) for a, b in pairs]


def shown(what: str, values: list[float]) -> float:
    """A line of the table; the median."""
    ordered = sorted(values)
    p50, p99 = statistics.median(ordered), ordered[len(ordered) * 99 // 100]
    print(f"{what:<46} {len(ordered):>7} {p50:>8.0f} {p99:>8.0f} {ordered[-1]:>8.0f}")
    return p50


def main() -> int:
    """Run; 1 where the target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    if why := missing():
        print(f"not run: {why} is not here")
        return 2
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        package = place / "package"
        build = built_package(EXAMPLE, "Vehicle", EXAMPLE.with_suffix(".toml"), package)
        program = built_latency(package, place)
        echo = [str(built_node("ros1_echo", place))]
        bridge = [str(build / "shuttle_ros_bridge"), "_channels:=CHANNELS"]
        bare, ours = [], []
        for _ in range(given.rounds):
            bare += one_round("echo", echo, program, given.count)
            ours += one_round("bridge", bridge, program, given.count)
    print(f"{'microseconds':<46} {'n':>7} {'p50':>8} {'p99':>8} {'max':>8}")
    base = shown("bare echo: /odom until /cmd_vel", [a for a, _ in bare])
    shown("bridge: /odom until the channel", [a for a, _ in ours])
    shown("bridge: the channel until /cmd_vel", [b for _, b in ours])
    both = shown("bridge: both", [a + b for a, b in ours])
    print(f"ratio of the medians {both / base:.2f} (target {TARGET})")
    return 1 if both / base > TARGET else 0


if __name__ == "__main__":
    sys.exit(main())
