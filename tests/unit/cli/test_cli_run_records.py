"""What a run leaves on record, and what is told before it: of parameters, files and externs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

import soter
from soter.gym import make_vec

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

TANK = """soter 1;
topic level: float;
topic pump: float in [-0.1, 0.1] = 0.0;
plant Tank period 50ms {{
  reads pump; drives level = h; state h: float = 1.0; der h = pump;
}}
extern node Learned period 100ms {source} {{ subscribes level; publishes pump; }}
node Hold period 100ms {{
  subscribes level; publishes pump; step {{ publish pump = clamp(1.0 - level, -0.1, 0.1); }}
}}
{more}
rta SafeTank {{
  ac Learned; sc Hold; period 100ms; safe level > 0.2 && level < 1.8;
  verify {{ grid level in [0.2, 1.8] / 64; }}
}}
system Plant default {{ t: Tank; module SafeTank; until 1s; always t.truth.h < 1.8; }}
system Idle {{ t: Tank; module SafeTank; force SafeTank sc; until 1s; }}
"""
BOUND = ("--bind", "Learned=python:recovery.py:good")


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
        ("python:recovery.py:god", "`recovery.py` does not define `god`"),
        ("python:policy.c:step", "`policy.c` is not valid Python"),
        ("c:nowhere.c:step", "there is no file `nowhere.c`"),
        ("c:policy.c:step", "`policy.c` does not define `step`"),
        ("python:recovery.py:good", ""),
        ("python:recovery.py:Counting", ""),
        ("python:recovery.py:number", ""),
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


# ---------------------------------------------------------------- files that are not there


def program(folder: Path, source: str, more: str = "") -> Path:
    path = folder / "tank.soter"
    path.write_text(TANK.format(source=source and f'from "{source}"', more=more))
    return path


@pytest.fixture
def nothing_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever computes sets is too late."""

    def computed(*_: object) -> None:
        raise AssertionError("sets were computed for a program whose file is not there")

    monkeypatch.setattr("soter.verify.deploy.missing_predicates.complete", computed)


@pytest.mark.usefixtures("nothing_computed")
@pytest.mark.parametrize("system", ["Plant", "Idle"])
@pytest.mark.parametrize(
    ("source", "code"),
    [
        ("onnx:absent.onnx", "X003"),
        ("sb3:absent.zip", "X003"),
        ("python:absent.py:step", "X003"),
        ("c:absent.c:step", "X003"),
        ("sb3:tank.soter", "X014"),
        ("", "X001"),
    ],
)
def test_a_run_and_a_campaign_tell_it_first(
    soter: Soter, here: Path, source: str, code: str, system: str
) -> None:
    """Missing, broken, or bound to nothing; also where the module is forced."""
    program(here, source)
    done = soter("run", "tank.soter", "--system", system, "--json")
    assert done.codes == [code]
    assert done.document["diagnostics"][0]["line"] == 7
    done = soter("campaign", "tank.soter", "--flights", "2", "--json", "-o", "fly")
    assert done.codes == [code]


@pytest.mark.usefixtures("nothing_computed")
def test_a_package_tells_of_c_that_it_compiles(soter: Soter, here: Path) -> None:
    program(here, "c:absent.c:step")
    done = soter("build", "tank.soter", "--target", "c", "-o", "out", "--json")
    assert done.codes == ["W007", "X003"]


def test_a_proof_tells_of_what_only_runs_need(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It goes on, as it asks no AC: but whoever waits for it has been warned before."""

    def verified(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    program(here, "onnx:absent.onnx")
    monkeypatch.setattr("soter.api.Program.verify", verified)
    assert "warning[W007]" in soter("verify", "tank.soter").err


@pytest.mark.usefixtures("nothing_computed")
def test_an_environment_asks_no_file_of_the_controller_that_is_outside(tmp_path: Path) -> None:
    """The agent answers in its place; of another extern the file is asked for first."""
    path = program(tmp_path, "onnx:absent.onnx")
    with pytest.raises(AssertionError, match="sets were computed"):
        make_vec(path, 2)
    more = """
extern node Other period 100ms from "c:absent.c:step" { publishes lamp; }
topic lamp: float;
"""
    path = program(tmp_path, "onnx:absent.onnx", more)
    path.write_text(path.read_text().replace("module SafeTank;", "module SafeTank; node Other;"))
    with pytest.raises(soter.SoterError, match=r"absent\.c"):
        make_vec(path, 2)
