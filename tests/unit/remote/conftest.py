"""A robot's folder of channels, and a program of a few types, for the tests of this folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter
import soter.remote
from soter.targets.world_interface import channel_document

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Any

    from soter.remote import Robot

PROGRAM = """soter 1;
type Kind = enum { Near, Far };
type Pose = { x: float, y: float };
type Wide = { at: Pose, kind: Kind, ok: bool, n: int in [-3, 9] };
topic position: float in [-50.0, 50.0] max_age 80ms;
topic goal: Pose;
topic wish: float in [-1.0, 1.0];
topic arm: float[3] in [-2.0, 2.0];
topic wide: Wide in { n in [0, 5] };
topic few: float[<=2] in [0.0, 1.0];
topic speed: float in [-1.0, 1.0];
node Wish period 20ms {
  subscribes wish;
  publishes speed;
  step { publish speed = wish; }
}
node Look period 20ms { subscribes position, goal, arm, wide, few; step {} }
node Still period 20ms { publishes speed; step { publish speed = 0.0; } }
system Track default { node Still; }
system Robot {
  external topic position; external topic goal; external topic wish; external topic arm;
  external topic wide; external topic few; external topic speed;
  node Wish; node Look;
}
"""


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("remote") / "robot.soter"
    path.write_text(PROGRAM)
    return path


@pytest.fixture(scope="session")
def document(program: Path) -> dict[str, Any]:
    return channel_document(soter.load(program).declared("Robot"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "channels"
    made.mkdir()
    return made


@pytest.fixture
def robot(program: Path, folder: Path) -> Iterator[Robot]:
    with soter.remote.connect(program, system="Robot", channels=folder) as connected:
        yield connected
