"""What docs/externs.md says of learned policies: the example as it is, and as a function."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import soter
from soter.cli.main import main
from soter.policy.network import last_layer_numbers
from soter.policy.sb3_file import read_sb3
from soter.policy.soter_source import error_bound

ROOT = Path(__file__).resolve().parents[2]
WALL = ROOT / "examples" / "wall"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("cart.soter", "rush.soter", "rush.zip"):
        shutil.copy(WALL / name, tmp_path)
    page = (ROOT / "docs" / "externs.md").read_text(encoding="utf-8")
    block = re.search(r"^```soter file=function.soter\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert block is not None
    (tmp_path / "function.soter").write_text(block[1], encoding="utf-8")
    assert main(["policy", "rush.zip", "-o", "learned.soter"]) == 0
    return tmp_path


def test_a_policy_of_a_file_is_kept_from_the_walls(here: Path) -> None:
    program = soter.load(here / "rush.soter")
    run = program.simulate(apart=True)
    assert (run.violations, run.extern_failures) == (0, {})
    assert 0.3 < run.modules["SafeCart"].ac_share < 1.0
    both = [program.simulate(engine=engine, until="2s") for engine in ("native", "interp")]
    assert both[0].trace_sha256 == both[1].trace_sha256


def test_the_function_is_the_file_within_its_bound(here: Path) -> None:
    program = soter.load(here / "function.soter")
    runs = [program.simulate(engine=engine, until="5s") for engine in ("native", "interp")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    run, network = program.simulate(), read_sb3(here / "rush.zip").network
    assert run.violations == 0
    motion, goal, sent = (run.array(f"cart.{t}") for t in ("motion", "goal", "accel"))
    ac, released = run.mode("SafeCart") == 1, np.round(run.time_s() * 1e3) % 10 == 0
    compared = np.flatnonzero(ac & np.roll(ac, 1) & released)[1:]
    assert len(compared) > 500
    for now in compared[:1000]:
        x = np.array([*motion[now], goal[now]])
        single = float(last_layer_numbers(network, x.astype(np.float32))[0])
        bound = float(error_bound(network, x, x)[0])
        assert abs(sent[now] - single) <= bound < 0.01
