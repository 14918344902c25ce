"""What is done to words and signals of every process that ships, and when the law comes then.

    .venv/bin/python bench/real_time/scenes.py [--only WORD]

A robot moves. To one of its processes something is done (a descriptor is closed, nobody empties a
pipe, who read it has gone, a terminal is stopped or gone, a signal) before the trusted part begins,
while commands are obeyed, or while the law is held, after which it is armed anew. Then the trusted
part is killed, unless what was done ends the process. The law has to be at the outermost output
(the channel of the drive; what a bridge sends) within the lease and MARGIN_MS, for good, and the
process has to be there until then, and to end when it is told to. What is late is flown again.
`examples/ros/shuttle_ros.soter` is the robot, by MAVLink `examples/mavlink/geofence.soter`.

Purpose: a table; exit code 1 where the law came late or never. Non-goals: SIGKILL, SIGSTOP.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.mavlink import mavlink_stack  # noqa: E402
from bench.real_time.scene_parts import Deed  # noqa: E402
from bench.ros import dds_peers, ros1_nodes  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

EXAMPLE = ROOT / "examples" / "ros" / "shuttle_ros.soter"
MARGIN_MS, PATIENCE_S, TRIES = 25.0, 8.0, 3
LEASE_MS = {"shuttle_ros": 69.0, "talker": 69.0, "geofence": 119.0}
"""As `soter build` prints them."""
TOLD = re.compile(r"^(?:set )?(\d{6,}) (-?[\d.e-]+)(?: (-?[\d.e-]+) -?[\d.e-]+ \d)?")
"""What is printed by whoever is told the commands: ns, and a speed, or two."""
FLOATS = 'system = "Vehicle"\n' + "".join(
    f'[topics.{t}]\nchannel = "/{t}"\ntype = "std_msgs/Float64"\n'
    f'[topics.{t}.fields]\nvalue = "data"\n'
    for t in ("position", "wish", "speed")
)
NODE = re.compile(r"^node Wish .*?^}\n", re.MULTILINE | re.DOTALL)
TALKER = 'extern node Wish period 20ms from "c:t.c:talk" { subscribes wish; publishes speed; }\n'
TALKS = """#include <stdio.h>
#include "talker.h"
int talk(const talker_Guard_Wish_in* in, talker_Guard_Wish_out* out) {
  for (int k = 0; k < 40; k++) fprintf(stderr, "what a policy says, again and again, %d\\n", k);
  out->speed = in->wish;
  out->has_speed = 1;
  return 0;
}
"""


# ---------------------------------------------------------------- robots


@dataclass
class Robot:
    """Its processes by name, in the order of their start, and those `around` it, which stay."""

    lease_ms: float
    channels: Path
    heard: Path
    words: dict[str, list[str]]
    around: dict[str, list[str]]
    environment: dict[str, str] = field(default_factory=dict)
    running: dict[str, subprocess.Popen[Any]] = field(default_factory=dict)

    def start(self, who: str, given: dict[str, Any]) -> None:
        """A process of a session of its own, silent but where `given` says otherwise."""
        quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        given = {**quiet, "start_new_session": True, **given}
        environment = {**os.environ, **self.environment}
        words = {**self.around, **self.words}[who]
        self.running[who] = subprocess.Popen(words, env=environment, **given)

    def end_all(self) -> None:
        """Whatever runs is killed."""
        for who in [*self.running]:
            self.end(who, signal.SIGKILL)

    def renew(self) -> None:
        """What is around it begins, or begins anew, with channels that nobody has spoilt."""
        self.end_all()
        for channel in self.channels.iterdir():
            channel.unlink()
        for who in self.around:
            output = self.heard.open("w") if who == "world" else subprocess.DEVNULL
            self.start(who, {"stdout": output})

    def told(self) -> list[tuple[int, bool]]:
        """When the drive was told something else, ns, and whether it moves from then on."""
        found = (TOLD.match(line) for line in self.heard.read_text().splitlines())
        return [(int(m[1]), any(float(x or 0) for x in m.groups()[1:])) for m in found if m]

    def wait(self, moves: bool, limit_s: float = 3.0) -> int | None:
        """When it was told so; None: it never is."""
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            if (told := self.told()) and told[-1][1] == moves:
                return told[-1][0]
            time.sleep(0.01)
        return None

    def end(self, who: str, number: int = signal.SIGTERM) -> bool:
        """Ends a process; False where it had to be killed for that."""
        process = self.running.pop(who)
        process.send_signal(number)
        with suppress(subprocess.TimeoutExpired):
            return process.wait(PATIENCE_S) is not None
        process.kill()
        return process.wait() is None


def built(target: str, folder: Path, source: Path, mapping: Path | None = None) -> Path:
    """The folder of the programs of the trusted part, compiled."""
    words = [sys.executable, "-m", "soter", "build", str(source), "--system", "Vehicle", "-o"]
    words += [str(folder), "--target", target, *(["--map", str(mapping)] if mapping else [])]
    subprocess.run(words, check=True, capture_output=True)
    subprocess.run(["make", "-C", str(folder)], check=True, capture_output=True)
    return folder / "trusted" if mapping else folder


def robots(place: Path, stack: ExitStack, only: str) -> Iterator[tuple[str, Robot]]:
    """Each kind, built, with what is around it."""
    shm = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=mavlink_stack.SHARED)))

    def robot(name: str, program: Path, bridge: list[str], **around: list[str]) -> Robot:
        channels = ["--channels", str(shm / name)]
        (shm / name).mkdir()
        made = {"actuator": [f"{program}_actuator", *channels]}
        made |= {"bridge": [b.replace("HERE", str(shm / name)) for b in bridge]} if bridge else {}
        made |= {"trusted": [str(program), *channels, "--misses", "1000000"]}
        return Robot(LEASE_MS[program.name], shm / name, place / f"{name}.txt", made, around)

    world = [sys.executable, str(Path(__file__).with_name("scene_parts.py"))]
    talker = place / "talker.soter"
    talker.write_text(NODE.sub(TALKER, EXAMPLE.read_text(encoding="utf-8")))
    (place / "t.c").write_text(TALKS)
    for name, source in (("posix", EXAMPLE), ("worker", talker)):
        if only in name:
            package = built("posix", place / name, source)
            around = [*world, str(package), str(shm / name)]
            yield name, robot(name, package / source.stem, [], world=around)
    if only in "dds":
        (place / "dds.toml").write_text(FLOATS)
        program = built("dds", place / "dds", EXAMPLE, place / "dds.toml") / EXAMPLE.stem
        bridge = [f"{place}/dds/build/shuttle_ros_bridge", "--channels", "HERE"]
        made = robot("dds", program, bridge, world=[*world, "", ""])
        made.environment["CYCLONEDDS_URI"] = dds_peers.LOOPBACK
        made.environment["ROS_DOMAIN_ID"] = str(os.getpid() % 200 + 1)
        yield "dds", made
    if only in "ros1" and not ros1_nodes.missing():
        mapping = EXAMPLE.with_suffix(".toml")
        program = (
            ros1_nodes.built_package(EXAMPLE, "Vehicle", mapping, place / "ros1") / EXAMPLE.stem
        )
        plant, ac = (str(ros1_nodes.built_node(n, place)) for n in ("plant", "ac"))
        made = robot(
            "ros1", program, [f"{program}_bridge", "_channels:=HERE"], world=[plant], ac=[ac]
        )
        made.environment |= stack.enter_context(ros1_nodes.nodes()).environment or {}
        yield "ros1", made
    if only in "mavlink":
        package, port = mavlink_stack.built_package(place / "mavlink"), mavlink_stack.free_port()
        bridge = [f"{package}/build/geofence_bridge", "--channels", "HERE"]
        bridge += ["--url", f"udpin://127.0.0.1:{port}"]
        python, peer = [sys.executable, "-u"], str(mavlink_stack.HERE / "px4_peer.py")
        hurry = [*python, str(mavlink_stack.EXAMPLE.with_name("hurry.py")), str(port)]
        program = package / "trusted" / "geofence"
        yield (
            "mavlink",
            robot("mavlink", program, bridge, world=[*python, peer, str(port)], ac=hurry),
        )


# ---------------------------------------------------------------- a scene


def flown(robot: Robot, who: str, what: str, when: str) -> str | float:
    """Until the law came, ms; or in words what was wrong."""
    deed = Deed(what)
    try:
        for name in robot.words:
            robot.start(name, deed.given if name == who else {})
            if name == who and when == "before":
                deed.now(robot.running[who])
        if robot.wait(True, 2 * PATIENCE_S) is None:
            return "does not move"
        if when == "held":
            robot.end("trusted", signal.SIGKILL)
            if robot.wait(False) is None:
                return "never"
            deed.now(robot.running[who])
            robot.start("trusted", {})
            time.sleep(0.6)
            arm = [*robot.words["actuator"], "--arm", "--unchecked"]
            armed = subprocess.run(arm, check=False, capture_output=True).returncode == 0
            if armed != (robot.wait(True) is not None):
                return "arm lies"
        return judged(robot, who, deed, when)
    finally:
        for name in {*robot.words} & {*robot.running}:
            robot.end(name, signal.SIGKILL)
        deed.over()


def judged(robot: Robot, who: str, deed: Deed, when: str) -> str | float:
    """The robot moves: it happens, if it has not yet, and the trusted part is killed."""
    since = time.monotonic_ns()
    if when == "obeyed":
        deed.now(robot.running[who])
    if not deed.ends:
        time.sleep(0.3)
        if robot.running[who].poll() is not None:
            return "dies"
        since = time.monotonic_ns()
        robot.end("trusted", signal.SIGKILL)
    law = robot.wait(False)
    time.sleep(0.2)
    if law is None or robot.told()[-1][1]:
        return "never"
    if who in robot.running:
        if not deed.ends and robot.running[who].poll() is not None:
            return "dies"
        if not robot.end(who):
            return "does not end"
    return (law - since) / 1e6 if law > since else "stood before"


def scenes(name: str) -> Iterator[tuple[str, str, str]]:
    """Of a robot: the process, what is done to it, and when."""
    pipes = ["stderr full", "stderr gone", "terminal stopped"]
    streams = ["stdin closed", "stdout closed", "stderr closed", "stdout full", "stdout gone"]
    signals = [f"SIG{n}" for n in ("HUP", "TERM", "PIPE", "TSTP", "QUIT", "ALRM")]
    others = ("INT", "USR1", "XFSZ", "TTIN", "TTOU", "XCPU", "PWR", "IO", "PROF", "RTMIN+3")
    if name == "posix":
        yield from (("actuator", what, when) for what in pipes for when in ("before", "held"))
        for what in (*pipes, *streams, "terminal gone", *signals, *(f"SIG{n}" for n in others)):
            yield "actuator", what, "obeyed"
    for what in pipes if name == "worker" else (*pipes, *streams, "terminal gone", *signals):
        yield "trusted" if name in ("posix", "worker") else "bridge", what, "obeyed"


def main() -> int:
    """Fly all scenes and print the table; 1 where the law was late or never came."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="robots whose name contains it")
    given = parser.parse_args()
    count, bad = 0, 0
    with ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        print(f"{'robot':<9} {'process':<9} {'what':<18} {'when':<7} {'law after, ms':>14}  bound")
        for name, robot in robots(place, stack, given.only):
            stack.callback(robot.end_all)
            robot.renew()
            for who, what, when in scenes(name):
                bound = robot.lease_ms + MARGIN_MS
                for _ in range(TRIES):
                    found = flown(robot, who, what, when)
                    wrong = isinstance(found, str) or found > bound
                    if not wrong:
                        break
                    if found == "does not move":
                        robot.renew()
                count, bad = count + 1, bad + wrong
                shown = found if isinstance(found, str) else f"{found:.1f}"
                print(f"{name:<9} {who:<9} {what:<18} {when:<7} {shown:>14}  {bound:g}", flush=True)
    print(
        f"{count} scenes; the law late or never, or a process that dies or stays: {bad} (target 0)"
    )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
