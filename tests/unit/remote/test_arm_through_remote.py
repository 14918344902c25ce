"""A flight of the arm beside a person: a policy in another process plays chunks of candidates.

Non-goals: that the arm is safe (`test_arm_beside_person.py`); chunks over a clock of one's own
(`test_action_chunks.py`).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
import soter.remote
from generators.c_packages import make
from generators.channel_programs import ended, going, soon

if TYPE_CHECKING:
    from soter.remote import Robot

ARM = Path(__file__).resolve().parents[3] / "examples" / "arm" / "arm.soter"
PLACE = np.array([1.0, -0.6, 0.8, 0.5, -0.5, 0.3])
LENGTH, EVERY_S, PATIENCE_S, NONE = 10, 0.02, 0.1, -1
FORGIVING = ("--misses", "1000000", "--late", "1000000")


def candidates(q: np.ndarray) -> np.ndarray:
    """A chunk from these angles: to the place as fast as may be, slowly, not at all; (10, 3, 6)."""
    left = np.exp(-2.0 * EVERY_S * np.arange(LENGTH))[:, None] * (PLACE - q)
    fast = np.clip(2.0 * left, -1.0, 1.0)
    return np.stack([fast, 0.2 * fast, 0.0 * fast], axis=1)


def flown(robot: Robot) -> set[int]:
    """Plays a chunk; the numbers of its actions of which a candidate flew, as the robot tells."""
    arm = next(robot.every("arm", timeout="60s"))["arm"]
    chunk = robot.publish_chunk("wishes", candidates(arm["q"]), every=EVERY_S)
    slots = set()
    for verdict in robot.every("told", timeout="60s"):
        told = verdict["told"]
        if told["acts"] in {0, 1, 2}:
            slots.add(chunk.slot(verdict.measured - round(1e9 * told["age"])))
        if time.monotonic_ns() > chunk.begin_ns(LENGTH):
            break
    return slots & set(range(LENGTH))


@pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")
@pytest.mark.real_time
def test_actions_of_a_chunk_fly_one_by_one_and_silence_hands_the_arm_to_sc(tmp_path: Path) -> None:
    for system in ("Vehicle", "World"):
        soter.load(ARM).build("posix", tmp_path / system, system)
        done = make(tmp_path / system, "CFLAGS=-O2 -Werror")
        assert done.returncode == 0, done.stdout + done.stderr
    channels = tmp_path / "channels"
    channels.mkdir()
    with (
        going(tmp_path / "World" / "arm", channels, *FORGIVING),
        going(tmp_path / "Vehicle" / "arm", channels, "--wait", "1", *FORGIVING) as trusted,
        soter.remote.connect(tmp_path / "Vehicle", channels=channels) as robot,
    ):
        soon(lambda: len(flown(robot)) > LENGTH // 2)
        verdicts = zip(range(100), robot.every("told", timeout="60s"), strict=False)
        told = [verdict["told"] for _, verdict in verdicts]  # nobody wishes any more
        speed = robot.read("speed")
        report = ended(trusted)
    assert {t["acts"] for t in told if t["age"] > PATIENCE_S} == {NONE}
    assert speed is not None
    assert not np.any(speed.value)
    wishes = report["topics"]["wishes"]
    assert wishes["taken"] >= LENGTH // 2
    assert (wishes["refused"], wishes["future"], wishes["bad"]) == (0, 0, 0)
