"""The tests that are shipped: what `soter test` says of each, and that their comments are true."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest

import processes
from generators.file_listing import files_in
from soter.diagnostics.render import render_all
from soter.language.front_end import check_file
from tables import all_rows

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CLEAN, VIOLATED, BOUND = 0, 3, 4
SHIPPED = {
    "testing/battery": CLEAN,
    "testing/delivery": CLEAN,
    "testing/deployed_order": CLEAN,
    "testing/first_cause": CLEAN,
    "testing/gate": CLEAN,
    "testing/late_sc": VIOLATED,
    "testing/late_sc_on_time": CLEAN,
    "testing/late_sc_repaired": CLEAN,
    "testing/planner": CLEAN,
    "testing/queue_overflow": CLEAN,
    "testing/slow_planner": CLEAN,
    "testing/stale_topic": CLEAN,
    "testing/takeover": CLEAN,
    "testing/three_modules": CLEAN,
    "testing/three_modules_stubborn": VIOLATED,
    "testing/two_modules": CLEAN,
    "testing/two_modules_greedy": VIOLATED,
    "wall/cart_test": BOUND,
    "mountain_car/cliff_test": BOUND,
}
# What the comments say of one line changed: file, old text, new text, the file it stands in.
CHANGED = [
    ("late_sc_on_time", "const LOOK: int = 6;", "const LOOK: int = 5;", "late_sc"),
    ("late_sc_repaired", "const LOOK: int = 8;", "const LOOK: int = 7;", "late_sc_repaired"),
    ("stale_topic", "max_age 20ms;\ntopic", "max_age 1s;\ntopic", "stale_topic"),
    ("gate", "Asked in [-1, 1]", "Asked in [-3, 3]", "gate"),
    ("deployed_order", "  order deployed;\n", "", "deployed_order"),
    ("deployed_order", "NEAR: int = 4", "NEAR: int = 5", "deployed_order"),
    ("first_cause", "drop_newest", "drop_oldest", "first_cause"),
    ("queue_overflow", "queue 4 drop_oldest", "queue 3 drop_oldest", "queue_overflow"),
    ("slow_planner", "NOTICE: int = 9", "NOTICE: int = 8", "slow_planner"),
    ("planner", "SETTLED: duration = 30ms", "SETTLED: duration = 20ms", "planner"),
    ("three_modules", "RESERVE: int = 7", "RESERVE: int = 6", "three_modules"),
    ("three_modules", "NEAR: int = 1", "NEAR: int = 2", "three_modules"),
    ("three_modules", "SETTLED: duration = 30ms", "SETTLED: duration = 20ms", "three_modules"),
    ("battery", "fair choose {", "choose {", "battery"),
    ("takeover", "  on takeover {\n    known = false;\n  }\n", "", "takeover"),
]


def _tested(file: Path, folder: Path) -> tuple[int, dict[str, str]]:
    """Exit code, and per test its verdict."""
    command = [
        sys.executable,
        "-m",
        "soter.cli.main",
        "test",
        "--json",
        "--minimise",
        "3",
        str(file),
    ]
    done = processes.run(command, cwd=folder, capture_output=True, text=True, check=False)
    document = json.loads(done.stdout)
    return done.returncode, {t["name"]: t["verdict"] for t in document["tests"]}


def _changed(folder: Path, old: str, new: str, where: str) -> None:
    shutil.copytree(EXAMPLES / "testing", folder / "testing")
    file = folder / "testing" / f"{where}.soter"
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")


@all_rows("name", [*SHIPPED, "drone/motion_primitive_test"])
def test_a_shipped_test_gets_no_diagnostics(name: str) -> None:
    checked = check_file(str(EXAMPLES / f"{name}.soter"))
    assert render_all(checked.diagnostics.items) == ""
    assert checked.ok
    assert checked.tests


def test_every_program_in_the_folder_of_testing_is_in_the_list() -> None:
    there = {f"testing/{p.stem}" for p in files_in(EXAMPLES / "testing", "*.soter")}
    assert there == {name for name in SHIPPED if name.startswith("testing/")}


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_test_has_the_verdict_that_it_says(name: str, tmp_path: Path) -> None:
    code, _ = _tested(EXAMPLES / f"{name}.soter", tmp_path)
    assert code == SHIPPED[name]


LARGE = ("RESERVE", "SETTLED: duration = 30ms")
"""Of `three_modules.soter`, which takes longer than all others: `NEAR` stays."""


@pytest.mark.parametrize(
    ("name", "old", "new", "where"),
    [
        pytest.param(*c, marks=[pytest.mark.long] if large else [])
        for c in CHANGED
        for large in [c[0] == "three_modules" and c[1].startswith(LARGE)]
    ],
)
def test_a_comment_that_names_a_bug_is_right(
    name: str, old: str, new: str, where: str, tmp_path: Path
) -> None:
    _changed(tmp_path, old, new, where)
    code, _ = _tested(tmp_path / "testing" / f"{name}.soter", tmp_path)
    assert code == VIOLATED


def test_a_longer_look_ahead_alone_spares_the_wall_but_not_the_theorem(tmp_path: Path) -> None:
    _changed(tmp_path, "const LOOK: int = 8;", "const LOOK: int = 9;", "late_sc_repaired")
    file = tmp_path / "testing" / "late_sc_repaired.soter"
    slow = file.read_text(encoding="utf-8").replace("Brake period 10ms", "Brake period 20ms")
    file.write_text(slow, encoding="utf-8")
    assert _tested(file, tmp_path)[1]["Late"] == "violated"
    file.write_text(slow.replace("  always invariant(Protection);\n", ""), encoding="utf-8")
    assert _tested(file, tmp_path)[0] == CLEAN
