"""`soter new --robot KIND`: each kind as it is made, and figures of one's own."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
from bench.verify.robot_kinds import PROGRAM, RANGES, answer, drawn, made

from generators.autopilot_logs import flight, tlog, written
from processes import run
from soter.api import load
from soter.cli.tool.robot_kinds import FIGURE, robot_kinds
from soter.mapping.read_mapping import make_log_map, read_mapping, system_name

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

KINDS = sorted(robot_kinds())


def test_each_kind_has_a_line_and_ranges_of_its_figures() -> None:
    assert len(KINDS) == 12
    assert all(10 < len(line) < 90 for line in robot_kinds().values())
    for kind in KINDS:
        figures = {m[1]: m for m in FIGURE.finditer(made(kind, {})[PROGRAM])}
        assert set(RANGES[kind]) == set(figures)


@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_is_sound_short_and_laid_out(soter: Soter, here: Path, kind: str) -> None:
    assert soter("new", "mine", "--robot", kind, "--json").exit == 0
    text = (here / "mine" / "mine.soter").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
    assert not [p for p in (here / "mine").iterdir() if "{{" in p.read_text(encoding="utf-8")]
    assert soter("fmt", "--check", "mine/mine.soter").exit == 0
    checked = soter("check", "mine/mine.soter")
    assert (checked.exit, checked.err) == (0, "")


@pytest.mark.parametrize("kind", KINDS)
def test_its_mapping_is_one_of_its_program(soter: Soter, here: Path, kind: str) -> None:
    soter("new", "mine", "--robot", kind)
    file = here / "mine" / "mine.toml"
    given = read_mapping(file)
    system = load(here / "mine" / "mine.soter").flat(system_name(given))
    assert len(make_log_map(given, system, file=file).topics) == 2


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_proves_is_accepted_and_passes_its_own_tests(
    soter: Soter, here: Path, kind: str
) -> None:
    soter("new", "mine", "--robot", kind)
    assert answer((here / "mine" / "mine.soter").read_text(encoding="utf-8"))[0] == "proved"
    soter("verify", "mine/mine.soter", "--cert", "proof")
    assert soter("recheck", "proof").out.startswith("ACCEPTED")
    command = [sys.executable, "-m", "unittest", "discover", "mine"]  # as `soter new` prints it
    done = run(command, cwd=here, capture_output=True, text=True)
    assert (done.returncode, "Ran 4 tests" in done.stderr) == (0, True), done.stderr


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_most_figures_of_data_sheets_prove(kind: str) -> None:
    verdicts = [answer(made(kind, drawn(kind, seed))[PROGRAM])[0] for seed in range(3)]
    assert verdicts.count("proved") >= 2, verdicts


def test_figures_stand_where_the_defaults_stood(soter: Soter, here: Path) -> None:
    soter("new", "lift", "--robot", "axis", "--set", "TRAVEL=12.5", "--set", "AGE=0.03s")
    text = (here / "lift" / "lift.soter").read_text(encoding="utf-8")
    assert "\nconst TRAVEL: float = 12.5;  // m, from switch" in text
    assert "\nconst AGE: duration = 30ms;  // " in text
    assert "TRAVEL, SPEED = 12.5, 1.0" in (here / "lift" / "policy.py").read_text()


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["--robot", "boot"], "U001", "boat: a boat in a channel"),
        (["--robot", "axis", "--set", "MASS=3"], "U004", "TRAVEL: m, from switch to switch"),
        (["--robot", "axis", "--set", "TRAVEL"], "U001", "a number from 0 on: m, from switch"),
        (["--robot", "axis", "--set", "TRAVEL=-1"], "U001", "a number from 0 on"),
        (["--robot", "axis", "--set", "TRAVEL=nan"], "U001", "a number from 0 on"),
        (["--robot", "axis", "--set", "TRAVEL=1e999"], "U001", "a number from 0 on"),
        (["--robot", "axis", "--set", "AGE=3"], "U001", "write a number with its unit"),
        (["--robot", "axis", "--set", "TRAVEL=0"], "U001", "constant `KP` has no value"),
        (["--robot", "joint", "--set", "AGE=0ms"], "U001", "topic joints: Joints max_age AGE;"),
        (["--set", "AGE=3ms"], "U001", "does nothing without `--robot`"),
    ],
)
def test_what_cannot_be_is_told_and_nothing_is_made(
    soter: Soter, here: Path, words: list[str], code: str, told: str
) -> None:
    assert soter("new", "mine", *words, "--json").codes == [code]
    done = soter("new", "mine", *words)
    assert (done.exit, told in done.err) == (2, True)
    assert not (here / "mine").exists()


def test_a_log_gives_the_age_and_ranges(soter: Soter, here: Path) -> None:
    pytest.importorskip("pymavlink", reason="the extra `logs` is not installed")
    written(here / "flight.tlog", tlog(flight()))
    done = soter("new", "mine", "--robot", "multicopter", "--from", "flight.tlog")
    assert done.exit == 0
    text = (here / "mine" / "mine.soter").read_text(encoding="utf-8")
    assert "\nconst AGE: duration = 20ms;" in text
    assert "// A log's `LOCAL_POSITION_NED` gave AGE" in text
    assert soter("fmt", "--check", "mine/mine.soter").exit == 0
    own = soter("new", "b", "--robot", "multicopter", "--from", "flight.tlog", "--set", "AGE=90ms")
    assert own.exit == 0
    assert "AGE: duration = 90ms;" in (here / "b" / "b.soter").read_text(encoding="utf-8")
    other = soter("new", "c", "--robot", "rover", "--from", "flight.tlog", "--json")
    assert other.codes == ["D016"]
    assert not (here / "c").exists()
