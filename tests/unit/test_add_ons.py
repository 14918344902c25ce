"""The core works without its add-ons, and each add-on beside the core and what it needs alone."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

import processes
from soter.addons import ADD_ONS

ROOT = Path(__file__).resolve().parents[2]
FILES = (
    "examples/wall/cart.soter",
    "examples/ros/shuttle_ros.soter",
    "examples/ros/shuttle_ros.toml",
    "tests/unit/policy/files/ppo.zip",
)
HIDING = """
import sys
from soter.addons import ADD_ONS, add_on_of
there = {None, *sys.argv[1].split(",")}
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if add_on_of(name) not in there:
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Hidden())
from soter.cli.main import main
for line in sys.argv[2].splitlines():
    print("#", line, "->", main(line.split()), flush=True)
exec(sys.argv[3])
"""
USES = {
    "robots": (
        "monitor cart.soter --until 1s",
        "build shuttle_ros.soter --system Vehicle --target dds --map shuttle_ros.toml -o dds",
    ),
    "learn": ("policy ppo.zip",),
    "campaign": ("campaign cart.soter --flights 2 --until 1s", "run cart.soter --arm ac"),
    "editor": ("lsp --help",),
    "assure": ("assure cart.soter -o case",),
}
"""Commands of each add-on."""
IMPORTED = {
    "robots": "import soter.remote, soter.targets.ros_packages, soter.targets.mavlink_package",
    "learn": "import soter.gym, soter.policy.policy_extern",
    "editor": "import soter.editor.server, soter.playground.session",
}
VERDICTS = (0, 3, 4)
"""Fine, violated (AC alone is, some seconds on), undecided."""
EXTRAS = {"learn": "gymnasium", "editor": "pygls"}


def outcomes(folder: Path, there: tuple[str, ...], lines: tuple[str, ...], then: str = "") -> str:
    """What commands say where only some add-ons are installed, and with which code they end."""
    for file in FILES:
        shutil.copy(ROOT / file, folder)
    words = [sys.executable, "-c", HIDING, ",".join(there), "\n".join(lines), then]
    done = processes.run(words, cwd=folder, capture_output=True, text=True)
    return str(done.stdout + done.stderr)


def test_the_core_needs_no_add_on(tmp_path: Path) -> None:
    lines = (
        "check cart.soter",
        "build cart.soter --target posix -o out",
        "verify cart.soter --no-refute",
        "run cart.soter --until 1s",
    )
    told = outcomes(tmp_path, (), lines)
    assert [f"# {line} -> 0" in told for line in lines] == [True] * len(lines), told


def test_what_only_an_add_on_does_is_refused_by_its_name(tmp_path: Path) -> None:
    lines = tuple(line for lines in USES.values() for line in lines if "--help" not in line)
    told = outcomes(tmp_path, (), lines)
    for name in USES.keys() - {"editor"}:
        assert f"is part of the add-on `{name}`, which is not installed" in told, told
    assert [f"# {line} -> 1" in told for line in lines] == [True] * len(lines), told


@pytest.mark.parametrize("name", ADD_ONS)
def test_an_add_on_needs_the_core_and_what_it_says(name: str, tmp_path: Path) -> None:
    if name in EXTRAS:
        pytest.importorskip(EXTRAS[name])
    lines = USES[name]
    then = f"{IMPORTED.get(name, '')}\nprint('# imported')"
    told = outcomes(tmp_path, (name, *ADD_ONS[name].needs), lines, then)
    assert "# imported" in told, told
    fine = [any(f"# {line} -> {code}" in told for code in VERDICTS) for line in lines]
    assert fine == [True] * len(lines), told
