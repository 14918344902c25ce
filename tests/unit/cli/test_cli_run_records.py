"""What a run leaves on record: parameters, names of files, and what was said of externs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

BOUND = ("--bind", "Learned=python:policies.py:good")


def test_changed_parameters_stand_in_the_summary(soter: Soter, robot: Path) -> None:
    assert robot.exists()
    plain = soter("run", "robot.soter", *BOUND)
    assert "params" not in plain.out
    done = soter("run", "robot.soter", *BOUND, "--set", "EVERY=50ms", "--set", "LIMIT=0.9")
    assert "params  EVERY = 50 ms (default 20 ms)\n" in done.out


def test_what_a_system_sets_stands_in_the_summary(soter: Soter, robot: Path) -> None:
    robot.write_text(robot.read_text().replace("until 2s;", "until 2s; set COUNT = 3;"))
    done = soter("run", "robot.soter", *BOUND)
    assert "params  COUNT = 3 (default 1)\n" in done.out


def test_changed_parameters_stand_in_log_report_and_names(
    soter: Soter, robot: Path, here: Path
) -> None:
    assert robot.exists()
    done = soter("run", "robot.soter", *BOUND, "--log", "--report", "--set", "EVERY=50ms", "--json")
    assert done.document["params"]["EVERY"] == 0.05
    assert done.document["log"] == ".soter/robot-S-1-EVERY=50ms.mcap"
    with (here / done.document["log"]).open("rb") as stream:
        (about,) = [m for m in make_reader(stream).iter_metadata() if m.name == "soter"]
    assert about.metadata["param EVERY"] == "50 ms"
    assert "param LIMIT" not in about.metadata
    page = (here / done.document["report"]).read_text()
    assert "<dt>param EVERY</dt><dd>50 ms</dd>" in page


def test_a_name_of_many_settings_is_no_longer_than_a_file_name_may_be(
    soter: Soter, robot: Path, here: Path
) -> None:
    assert robot.exists()
    sets = [word for n in range(30) for word in ("--set", f"LIMIT=0.{n:020d}")]
    assert soter("run", "robot.soter", *BOUND, "--log", *sets).exit == 0
    (log,) = (here / ".soter").iterdir()
    assert len(log.name) < 200


def test_a_policy_that_says_nothing_is_noted(soter: Soter, robot: Path, here: Path) -> None:
    assert robot.exists()
    (here / "silent.py").write_text("def step(inputs):\n    pass\n")
    arguments = ("run", "robot.soter", "--bind", "Learned=python:silent.py:step")
    said = "Guard.Learned published nothing in 101 of 101 steps"
    assert f"note  {said}\n" in soter(*arguments).out
    for engine in ("native", "interp"):
        document = soter(*arguments, "--json", "--engine", engine).document
        assert document["notes"] == [said]
        assert document["extern_silences"] == {"Guard.Learned": {"steps": 101, "silent": 101}}


# ---------------------------------------------------------------- externs in C


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_a_wrong_signature_is_an_error_of_the_compiler(
    soter: Soter, robot: Path, here: Path, engine: str
) -> None:
    assert robot.exists()
    (here / "wrong.c").write_text("int policy_step(double x) { return x > 0.0; }\n")
    done = soter(
        "run", "robot.soter", "--bind", "Learned=c:wrong.c:policy_step", "--engine", engine
    )
    assert done.exit == 1
    assert "X004" in done.err
    assert "conflicting types" in done.err
    assert "robot.h" in done.err


def test_the_header_does_not_get_in_the_way_of_what_a_file_asks_of_the_system(
    soter: Soter, robot: Path, here: Path
) -> None:
    assert robot.exists()
    text = (here / "policy.c").read_text().replace("0.8", "M_PI / 4.0")
    (here / "pi.c").write_text(f"#define _GNU_SOURCE\n#include <math.h>\n{text}")
    done = soter("run", "robot.soter", "--bind", "Learned=c:pi.c:policy_step")
    assert done.exit == 0, done.err


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_a_missing_function_is_missed_in_its_file(soter: Soter, robot: Path, engine: str) -> None:
    assert robot.exists()
    done = soter("run", "robot.soter", "--bind", "Learned=c:policy.c:stepp", "--engine", engine)
    assert "`policy.c` has no function `stepp`" in done.err


# ---------------------------------------------------------------- what `check` sees of externs


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("python:nowhere.py:step", "there is no file `nowhere.py`"),
        ("python:policies.py:god", "`policies.py` does not define `god`"),
        ("python:policy.c:step", "`policy.c` is not valid Python"),
        ("c:nowhere.c:step", "there is no file `nowhere.c`"),
        ("c:policy.c:step", "`policy.c` does not define `step`"),
        ("python:policies.py:good", ""),
        ("python:policies.py:Counting", ""),
        ("python:policies.py:number", ""),
        ("c:policy.c:policy_step", ""),
    ],
)
def test_check_warns_of_externs_without_code(
    soter: Soter, robot: Path, source: str, reason: str
) -> None:
    declared = f'extern node Learned period EVERY from "{source}"'
    robot.write_text(robot.read_text().replace("extern node Learned period EVERY", declared))
    done = soter("check", "robot.soter")
    assert done.exit == 0
    assert ("W007" in done.err) == bool(reason)
    assert reason in done.err
    bound = soter("check", "robot.soter", *BOUND)
    assert "W007" not in bound.err


def test_names_that_come_by_other_ways_are_not_missed(
    soter: Soter, robot: Path, here: Path
) -> None:
    declared = 'extern node Learned period EVERY from "python:ways.py:step"'
    robot.write_text(robot.read_text().replace("extern node Learned period EVERY", declared))
    for text in (
        "from policies import good as step",
        "from policies import *",
        "import step",
        "step = lambda i: 0.0",
        "a, step = 1, print",
        "try:\n    import torch\nexcept ImportError:\n    def step(i): return 0.0",
        "globals().update(step=print)",
    ):
        (here / "ways.py").write_text(text)
        assert soter("check", "robot.soter").err == "", text
