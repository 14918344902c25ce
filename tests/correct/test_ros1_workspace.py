"""A package of ROS 1 in a catkin workspace, and its own test, run by rostest.

Needs Debian's catkin, roscpp and rostest, and says so where they are not. Whoever is late: the
package's test waits for what is said, and no command is a matter of time.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from bench.ros.ros1_nodes import ROOT, missing

import processes
import soter

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

TOOLS = ("catkin_make", "rostest")
LACKING = missing() or " and ".join(t for t in TOOLS if not os.access(f"/usr/bin/{t}", os.X_OK))
pytestmark = pytest.mark.skipif(bool(LACKING), reason=f"ROS 1 is not here: {LACKING}")

EXAMPLE = ROOT / "examples" / "ros" / "shuttle_ros.soter"
WORKSPACE = ROOT / "build" / "ros1-workspace"
"""Stays from run to run: make compiles what has changed."""
LATE = "lease->state == SOTER_LEASE_ENDED || "
"""Of soter_lease.c: why what comes after the end of a lease is not taken."""


def in_workspace(folder: Path, command: str) -> tuple[int, str]:
    """A command in a shell as Debian's ROS wants it: no virtual environment."""
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(folder), "ROS_HOME": str(folder / "ros")}
    done = processes.run(
        ["bash", "-c", command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The workspace, built; nobody else has it meanwhile."""
    package = tmp_path_factory.mktemp("package") / "shuttle_ros"
    mapping = EXAMPLE.with_suffix(".toml")
    soter.load(EXAMPLE).build("ros1", package, "Vehicle", mapping=mapping)
    WORKSPACE.mkdir(parents=True, exist_ok=True)
    with (WORKSPACE / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made_alike(WORKSPACE / "src" / "shuttle_ros", package)
        shutil.rmtree(WORKSPACE / "ros", ignore_errors=True)
        told, said = in_workspace(WORKSPACE, "catkin_make -j1")
        assert told == 0, said[-3000:]
        yield WORKSPACE


def made_alike(folder: Path, wanted: Path) -> None:
    """The same files with the same bytes; what is already there is not touched."""
    folder.mkdir(parents=True, exist_ok=True)
    names = {p.relative_to(wanted) for p in wanted.rglob("*") if p.is_file()}
    for path in [p for p in folder.rglob("*") if p.is_file()]:
        if path.relative_to(folder) not in names:
            path.unlink()
    for name in names:
        path = folder / name
        if not path.is_file() or path.read_bytes() != (wanted / name).read_bytes():
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(wanted / name, path)


def outcome_of(folder: Path) -> tuple[int, dict[str, str]]:
    """The exit code of rostest, and how each test of the package ended."""
    channels = folder / "channels"
    run = f"source devel/setup.bash && rostest shuttle_ros shuttle_ros.test channels:={channels}"
    told, said = in_workspace(folder, run)
    shutil.rmtree(channels, ignore_errors=True)
    found = {}
    for file in (folder / "ros" / "test_results" / "shuttle_ros").glob("rosunit-*.xml"):
        for case in ET.parse(file).getroot().iter("testcase"):  # noqa: S314 - rosunit's own
            wrong = [child.tag for child in case if child.tag in ("failure", "error", "skipped")]
            found[case.attrib["name"]] = wrong[0] if wrong else "passed"
    assert found, said[-3000:]
    return told, found


def test_the_packages_own_test_passes(workspace: Path) -> None:
    told, found = outcome_of(workspace)
    assert (told, {*found.values()}) == (0, {"passed"}), found
    assert len(found) == 3


@pytest.mark.long
def test_the_packages_own_test_fails_where_actuators_obey_unarmed(workspace: Path) -> None:
    lease = workspace / "src" / "shuttle_ros" / "trusted" / "soter_lease.c"
    text = lease.read_text()
    assert text.count(LATE) == 1
    lease.write_text(text.replace(LATE, ""))
    built, said = in_workspace(workspace, "catkin_make -j1")
    assert built == 0, said[-3000:]
    told, found = outcome_of(workspace)
    assert told != 0
    assert found["test_2_nothing_but_the_law_leaves_before_arming"] == "failure"
