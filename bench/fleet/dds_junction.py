"""Four robots and a manager as processes of their own, with DDS between them, at one junction.

Purpose: `examples/fleet/vehicle.soter` by `--target dds`, five packages on loopback; here are the
bases, the clocks and whoever drives. One machine is killed or stopped; who is in the junction, how
soon the others' wheels stood, and how many crossings there were afterwards.
Non-goals: measured delays of networks; what was proved (`soter verify`).

    python bench/fleet/dds_junction.py
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
FLEET = HERE.parents[1] / "examples" / "fleet"
ROBOTS = 4
LENGTH, LAP, FASTEST, BRAKE, PICKUP = 1.5, 10.0, 0.5, 1.0, 0.9
STEP_S = 0.01
WATCHDOG_S = 0.3  # without a command for so long a base brakes
LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
    "<Peers><Peer address='localhost'/></Peers></Discovery></Domain></CycloneDDS>"
)


def _run(*words: str | Path) -> None:
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{words[0]} failed:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")


def build_package(
    package: Path, system: str, map_name: str, map_text: str, *more: str, source: Path = FLEET
) -> None:
    """A machine of vehicle.soter, compiled, with `more` options."""
    maps = package.parent / f"{package.name}_map"
    shutil.copytree(FLEET / "msg", maps / "msg", dirs_exist_ok=True)
    (maps / map_name).write_text(map_text, "utf-8")
    program = source / "vehicle.soter"
    words: tuple[str | Path, ...] = ("-m", "soter", "build", program, "--system", system, *more)
    where = ("--target", "dds", "--map", maps / map_name, "-o", package)
    _run(sys.executable, *words, *where)
    _run("make", "-C", package)


def build(folder: Path) -> None:
    """The five packages."""
    robot = (FLEET / "vehicle.toml").read_text("utf-8")
    for name in machines():
        if name == "post":
            text = (FLEET / "post.toml").read_text("utf-8")
            build_package(folder / name, "Post", "post.toml", text)
        else:
            number = name.removeprefix("robot_")
            text = robot.replace("/robot_0/", f"/robot_{number}/")
            own = ("--set", f"reservation.ID={number}")
            build_package(folder / name, "Vehicle", "vehicle.toml", text, *own)


def machines() -> list[str]:
    """Names of their packages."""
    return [f"robot_{i}" for i in range(ROBOTS)] + ["post"]


# ---------------------------------------------------------------- processes


@dataclass
class Machine:
    """A trusted part and its bridge."""

    name: str
    channels: Path
    clock_error_s: float = 0.05
    """By which the bridge takes every stamp for older."""
    processes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start(self, package: Path) -> None:
        """Both of them."""
        shutil.rmtree(self.channels, ignore_errors=True)
        self.channels.mkdir(parents=True)
        words: list[str | Path] = [package / "trusted" / "vehicle", "--channels", self.channels]
        more = [
            "--misses",
            "1000000000",
            "--wait",
            "1",
            "--policy",
            "other",
            "--quiet",
            "--core",
            "none",
        ]
        bridge = [next((package / "build").glob("*_bridge")), "--channels", self.channels]
        for command in ([*words, *more], [*bridge, "--clock-error", str(self.clock_error_s)]):
            said = (self.channels.parent / f"{self.name}_{len(self.processes)}.txt").open("wb")
            self.processes.append(
                subprocess.Popen([str(w) for w in command], stdout=said, stderr=said)
            )
            time.sleep(0.2)

    def send(self, what: int) -> None:
        """A signal to both."""
        for p in self.processes:
            if p.poll() is None:
                p.send_signal(what)

    def end(self) -> None:
        """Both are gone."""
        self.send(signal.SIGCONT)
        self.send(signal.SIGKILL)
        for p in self.processes:
            p.wait()


# ---------------------------------------------------------------- the world


@dataclass
class Base:
    """A robot's motion, as the plant of robot.soter has it."""

    x: float
    v: float = 0.0
    commanded: float = 0.0
    heard_s: float = 0.0

    def step(self, now: float) -> None:
        """So much time later."""
        commanded = self.commanded if now - self.heard_s < WATCHDOG_S else 0.0
        gained = (
            min(self.v + PICKUP * STEP_S, commanded)
            if self.v < commanded
            else max(self.v - BRAKE * STEP_S, commanded)
        )
        self.x += 0.5 * (self.v + gained) * STEP_S
        self.v = gained
        if self.x >= 0.5 * LAP:
            self.x -= LAP

    @property
    def inside(self) -> bool:
        """In the junction."""
        return 0.0 < self.x < LENGTH


def message_types() -> dict[str, Any]:
    """The messages, named as ROS 2 names them on the wire."""
    from cyclonedds.idl import make_idl_struct, types  # noqa: PLC0415 - an extra

    moment = make_idl_struct(
        "Time_",
        "builtin_interfaces.msg.dds_.Time_",
        {"sec_": types.int32, "nanosec_": types.uint32},
    )
    header = make_idl_struct(
        "Header_", "std_msgs.msg.dds_.Header_", {"stamp_": moment, "frame_id_": str}
    )
    one = {
        n: make_idl_struct(f"{n}_", f"std_msgs.msg.dds_.{n}_", {"data_": kind})
        for n, kind in (("Float64", types.float64), ("Int64", types.int64), ("Bool", bool))
    }
    motion = make_idl_struct(
        "Motion_",
        "fleet_msgs.msg.dds_.Motion_",
        {"header_": header, "x_": types.float64, "v_": types.float64},
    )
    claim = make_idl_struct(
        "Claim_",
        "fleet_msgs.msg.dds_.Claim_",
        {"header_": header, **dict.fromkeys(("from_whom_", "lo_", "hi_", "sent_"), types.int64)},
    )
    return {"Time": moment, "Header": header, "Motion": motion, "Claim": claim, **one}


class World:
    """Bases, clocks and drivers, over DDS."""

    def __init__(self) -> None:
        from cyclonedds.domain import DomainParticipant  # noqa: PLC0415 - an extra
        from cyclonedds.pub import DataWriter  # noqa: PLC0415 - an extra
        from cyclonedds.sub import DataReader  # noqa: PLC0415 - an extra
        from cyclonedds.topic import Topic  # noqa: PLC0415 - an extra

        self.types = message_types()
        peer = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))

        def writer(topic: str, kind: str) -> Any:  # noqa: ANN401 - of an extra
            return DataWriter(peer, Topic(peer, f"rt/{topic}", self.types[kind]))

        robots = [f"robot_{i}" for i in range(ROBOTS)]
        self.odom = [writer(f"{r}/odom", "Motion") for r in robots]
        self.wish = [writer(f"{r}/wish", "Float64") for r in robots]
        self.clock = [writer(f"{r}/clock", "Int64") for r in [*robots, "post"]]
        self.occupied = writer("post/occupied", "Bool")
        kind = self.types["Float64"]
        self.speed = [DataReader(peer, Topic(peer, f"rt/{r}/cmd_vel", kind)) for r in robots]
        self.bases = [Base(-2.0 - 0.5 * i) for i in range(ROBOTS)]
        self.crossings = 0
        self.collisions = 0

    def turn(self, k: int, now: float) -> None:
        """One step of all of it: `now` in s since it began."""
        before = [b.inside for b in self.bases]
        for b, reader in zip(self.bases, self.speed, strict=True):
            for message in reader.take(20):
                if hasattr(message, "data_"):
                    b.commanded, b.heard_s = message.data_, now
            b.step(now)
        after = [b.inside for b in self.bases]
        self.crossings += sum(b and not a for b, a in zip(before, after, strict=True))
        self.collisions += int(sum(after) > 1 and sum(before) <= 1)
        sec, nanosec = divmod(time.time_ns(), 10**9)
        header = self.types["Header"](self.types["Time"](sec, nanosec), "")
        for b, w in zip(self.bases, self.odom, strict=True):
            w.write(self.types["Motion"](header, b.x, b.v))
        for w in self.clock:
            w.write(self.types["Int64"](int(1000.0 * now)))
        if k % 5 == 0:
            self.occupied.write(self.types["Bool"](any(after)))
        if k % 10 == 0:
            for w in self.wish:
                w.write(self.types["Float64"](10.0))


# ---------------------------------------------------------------- what is measured


@dataclass(frozen=True)
class Row:
    """What happens to which machine, from 20 s on, once robot 1 is in the junction or not."""

    name: str
    machine: str
    signal: int
    inside: bool


ROWS = (
    Row("nothing", "", 0, inside=False),
    Row("robot 1 killed before the line", "robot_1", signal.SIGKILL, inside=False),
    Row("robot 1 killed in the junction", "robot_1", signal.SIGKILL, inside=True),
    Row("robot 1 stopped in the junction", "robot_1", signal.SIGSTOP, inside=True),
    Row("manager stopped", "post", signal.SIGSTOP, inside=False),
)


def fly(row: Row, folder: Path, seconds: float) -> str:
    """A row of the table."""
    world = World()
    made = {n: Machine(n, folder / "channels" / n) for n in machines()}
    try:
        for n, m in made.items():
            m.start(folder / n)
        begun = time.monotonic()
        at, before, stood = 0.0, 0, 0.0
        k = 0
        while (now := time.monotonic() - begun) < seconds:
            world.turn(k, now)
            k += 1
            if row.machine and at == 0.0 and now > 20.0 and world.bases[1].inside == row.inside:
                made[row.machine].send(row.signal)
                at, before = now, world.crossings
            others = world.bases if row.machine == "post" else [world.bases[1]]
            if at and any(b.v > 0.0 for b in others):
                stood = now - at
            time.sleep(max(0.0, begun + k * STEP_S - time.monotonic()))
        late = time.monotonic() - begun - k * STEP_S
        after = world.crossings - before if at else 0
        still = f"{stood:.2f}" if at else "-"
        return (
            f"{row.name:<34} {world.collisions:>10} {world.crossings:>9} {after:>10} {still:>10} "
            f"{late:>6.2f}"
        )
    finally:
        for m in made.values():
            m.end()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=70.0)
    parser.add_argument("--row", type=int, choices=range(len(ROWS)), help="this one alone")
    args = parser.parse_args()
    os.environ |= {"ROS_DOMAIN_ID": str(os.getpid() % 200 + 1), "CYCLONEDDS_URI": LOOPBACK}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        build(folder)
        print(
            f"{'one machine':<34} {'collisions':>10} {'crossings':>9} {'afterwards':>10} "
            f"{'moved, s':>10} {'late':>6}"
        )
        for row in ROWS if args.row is None else ROWS[args.row : args.row + 1]:
            print(fly(row, folder, args.seconds), flush=True)


if __name__ == "__main__":
    main()
