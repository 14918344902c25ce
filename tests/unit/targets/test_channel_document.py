"""`channels.json` says what the package's C says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import soter

Channel = tuple[str, str, str]
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
OPENER = re.compile(
    r'soter_outside_open\(channel, folder, "(\w+)", UINT64_C\((0x\w+)\), sizeof\(\w+\), (\w+)\)'
)
LASTING = """soter 1;
topic x: float max_age 10ms;
topic u: float in [-1.0, 1.0] = 0.0;
node Fast period 20ms { publishes u; step { publish u = 1.0; } }
node Back period 20ms { subscribes x; publishes u; step { publish u = clamp(-x, -1.0, 1.0); } }
node Seen period 20ms {
  subscribes raw;
  publishes x;
  takes [1ms, 2ms];
  step { publish x = raw; }
}
input topic raw: float in [-9.0, 9.0];
rta M {
  ac Fast;
  sc Back;
  period 20ms;
  safe abs(x) < 3.0;
  ttf abs(x) > 2.0;
  safer abs(x) < 1.0;
  failsafe u = 0.0;
}
system Robot { external topic raw; module M; node Seen; }
"""


def both(source: Path, system: str, folder: Path) -> tuple[set[Channel], set[Channel]]:
    """Channels as the header has them, and as the document has them."""
    soter.load(source).build("posix", folder, system)
    (header,) = folder.glob("*_channels.h")
    document = json.loads((folder / "channels.json").read_text())
    ours = {"outside": "true", "here": "false"}
    topics = document["topics"]
    told = {(t["channel"], t["number"], ours[t["published"]]) for t in topics}
    return set(OPENER.findall(header.read_text())), told


@pytest.mark.parametrize(
    ("file", "system", "count"),
    [
        ("wall/remote.soter", "Vehicle", 3),
        ("wall/remote.soter", "World", 2),
        ("wall/stop_vehicle.soter", "Vehicle", 2),
        ("wall/stop_vehicle.soter", "World", 2),
    ],
)
def test_header_and_document_name_the_same_channels(
    tmp_path: Path, file: str, system: str, count: int
) -> None:
    header, document = both(EXAMPLES / file, system, tmp_path)
    assert header == document
    assert len(header) == count


def test_a_module_without_leases_has_no_channel_of_its_outputs(tmp_path: Path) -> None:
    (tmp_path / "robot.soter").write_text(LASTING)
    header, document = both(tmp_path / "robot.soter", "Robot", tmp_path / "out")
    assert header == document
    assert {name for name, *_ in header} == {"raw"}


def test_a_package_that_meets_nobody_has_none(tmp_path: Path) -> None:
    soter.load(EXAMPLES / "wall" / "cart.soter").build("posix", tmp_path)
    assert not (tmp_path / "channels.json").exists()
