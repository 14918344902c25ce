"""ROS 1 under /clock: whether the trace is that of `soter run`.

    .venv/bin/python bench/ros/ros1_clock.py

For the cart, the mountain car and the drone, with their plants inside: `soter build --target ros1`,
the simulation node beside rosmaster and a node that ticks /clock in uneven steps (ros1_clock.cpp);
then once more with a /clock that goes back on the way. Exit code 1 where a hash differs.
Non-goals: systems in the world, whose messages come when they come.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.ros.ros1_nodes import built_node, built_package, missing, nodes  # noqa: E402

PROGRAMS: dict[str, tuple[str, str, str, str, dict[str, str], str]] = {
    "cart": (
        *("examples/wall/cart.soter", "Protected", "motion", "nav_msgs/Odometry"),
        {"x": "pose.pose.position.x", "v": "twist.twist.linear.x"},
        "2.0",
    ),
    "mountain car": (
        *("examples/mountain_car/cliff.soter", "Protected", "car", "geometry_msgs/Point"),
        {"x": "x", "v": "y"},
        "20.0",
    ),
    "drone": (
        *("examples/drone/motion_primitive.soter", "Protected", "control"),
        *("geometry_msgs/Vector3", {"x": "x", "y": "y", "z": "z"}, "2.0"),
    ),
}
"""Program, system, a topic that goes out, its messages and fields, step of /clock in ms."""
HASH = re.compile(r"trace_sha256 ([0-9a-f]{64})")


def run_hash(path: Path, system: str) -> str:
    """Of `soter run`."""
    words = [sys.executable, "-m", "soter", "run", str(path), "--system", system, "--json"]
    told = subprocess.run(words, capture_output=True, text=True, check=False)
    return str(json.loads(told.stdout)["trace_sha256"])


def under_clock(build: Path, name: str, clock: Path, *words: str) -> str:
    """What the node says at its end."""
    with nodes() as all_:
        node = all_.start("simulation", build / f"{name}_simulation")
        all_.start("clock", clock, *words)
        node.wait(600)
        told = HASH.search("".join(all_.heard["simulation"]))
        return told[1] if told else "no hash: " + "".join(all_.heard["simulation"])[-200:]


def main() -> int:
    """Run; 1 where a trace differs."""
    if why := missing():
        print(f"not run: {why} is not here")
        return 2
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        clock = built_node("ros1_clock", place)
        for what, (path, system, topic, kind, fields, step) in PROGRAMS.items():
            mapping = place / f"{what}.json"
            entry = {"channel": f"/{topic}", "type": kind, "fields": fields}
            mapping.write_text(json.dumps({"topics": {topic: entry}}), encoding="utf-8")
            build = built_package(ROOT / path, system, mapping, place / what)
            expected = run_hash(ROOT / path, system)
            name = Path(path).stem
            for how, back in (("/clock", ()), ("/clock that goes back", ("3.0",))):
                told = under_clock(build, name, clock, step, *back)
                same = told == expected
                wrong += not same
                print(f"{what:<14} {how:<22} {'equal' if same else told}  {expected[:12]}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
