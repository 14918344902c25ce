"""`import soter`: what a script or a notebook gets."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

import processes
import soter

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"

ROBOT = """
soter 1;
topic pos: float;
topic u: float in [-1.0, 1.0];
param EVERY: duration = 20ms in [10ms, 100ms];
plant Point period 10ms { reads u; drives pos = x; state x: float; der x = u; }
extern node Learned period EVERY { subscribes pos; publishes u; }
node Stay period 20ms { subscribes pos; publishes u; step { publish u = 0.0; } }
rta Guard { ac Learned; sc Stay; period 100ms; safe true; ttf pos > 0.6; safer pos < 0.4; }
system S { p: Point; module Guard; until 2s; always p.truth.x < 1.0; }
"""


@pytest.fixture
def robot(tmp_path: Path) -> soter.Program:
    path = tmp_path / "robot.soter"
    path.write_text(ROBOT)
    return soter.load(path)


def in_a_fresh_python(code: str) -> str:
    command = [sys.executable, "-c", code]
    done = processes.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    return str(done.stdout)


def test_importing_soter_imports_next_to_nothing() -> None:
    loaded = in_a_fresh_python(
        "import sys; before = set(sys.modules); import soter; "
        "print(*sorted(m for m in set(sys.modules) - before if 'soter' in m or '.' not in m))"
    ).split()
    assert [m for m in loaded if "soter" in m] == ["soter", "soter.version"]
    assert "dataclasses" not in loaded


def test_checking_needs_neither_numpy_nor_cffi() -> None:
    loaded = in_a_fresh_python(
        f"import sys, soter; soter.load({str(CART)!r}).check(); print(*sys.modules)"
    ).split()
    heavy = {"numpy", "cffi", "mcap", "plotly", "soter.codegen", "subprocess", "tempfile"}
    assert heavy & set(loaded) == set()


def test_a_program_knows_itself() -> None:
    program = soter.load(CART)
    assert program.ok
    assert program.systems == ("Protected", "Unprotected")
    assert program.diagnostics == ()
    assert len(program.sha256 or "") == 64
    assert repr(program) == f"<soter.Program {CART}: Protected, Unprotected>"


def test_check_reports_what_is_proved_and_what_assumed() -> None:
    report = soter.load(CART).check()
    protected, unprotected = report.systems
    (module,) = protected.modules
    assert module.verdicts == {
        "P1a": "proved",
        "P1b": "proved",
        "P1c": "assumed",
        "P2a": "assumed",
        "P2b": "assumed",
        "P3": "assumed",
    }
    assert unprotected.modules[0].forced == "ac"
    assert protected.default
    assert protected.until_s == 30.0


def test_a_program_with_mistakes_is_loaded_and_then_refuses(tmp_path: Path) -> None:
    path = tmp_path / "bad.soter"
    path.write_text("soter 1;\nconst A: int = true;\n")
    program = soter.load(path)
    assert not program.ok
    for method in (program.check, program.simulate, lambda: program.build("c", tmp_path / "o")):
        with pytest.raises(soter.SoterError) as caught:
            method()
        assert caught.value.diagnostics == program.diagnostics


def test_a_file_that_is_not_there() -> None:
    program = soter.load("nowhere.soter")
    assert not program.ok
    assert program.sha256 is None
    with pytest.raises(soter.SoterError):
        program.format()


def test_simulate_runs_on_both_engines() -> None:
    program = soter.load(CART)
    native = program.simulate(until=2.5, seed=4)
    interpreted = program.simulate(until="2500ms", seed=4, engine="interp")
    assert isinstance(native, soter.Run)
    assert native.trace_sha256 == interpreted.trace_sha256
    assert native.topic("motion")["x"].shape == native.time_s().shape == (501,)
    assert native.modules["SafeCart"].switches_to_ac == 2
    assert program.simulate("Unprotected", trace=False).trace is None


def test_simulate_refuses_nonsense() -> None:
    program = soter.load(CART)
    wrong: list[dict[str, Any]] = [
        {"system": "Nobody"},
        {"until": 0},
        {"until": "soon"},
        {"engine": "steam"},
        {"params": {"K": 3}},
    ]
    for options in wrong:
        with pytest.raises(soter.SoterError):
            program.simulate(**options)


def test_bind_takes_callables_objects_and_classes(robot: soter.Program) -> None:
    class Policy:
        def step(self, inputs: Any) -> float:
            return 0.3 if inputs.pos < 0.5 else 0.0

    hashes = {
        robot.bind("Learned", what).simulate().trace_sha256
        for what in (Policy, Policy(), Policy().step, lambda i: {"u": 0.3 if i.pos < 0.5 else 0.0})
    }
    assert len(hashes) == 1


def test_bind_takes_a_text(robot: soter.Program, tmp_path: Path) -> None:
    (tmp_path / "p.py").write_text("def step(inputs):\n    return 0.5\n")
    run = robot.bind("Learned", f"python:{tmp_path / 'p.py'}:step").simulate()
    assert run.violations == 0
    assert run.externs == {"Guard.Learned": f"python:{tmp_path / 'p.py'}:step"}
    with pytest.raises(soter.SoterError):
        robot.bind("Learned", "nonsense")


def test_an_unbound_extern_is_a_soter_error(robot: soter.Program) -> None:
    with pytest.raises(soter.SoterError, match="X001"):
        robot.simulate()


def test_a_changed_c_file_is_compiled_again(robot: soter.Program, tmp_path: Path) -> None:
    file = tmp_path / "p.c"
    text = (
        '#include "robot.h"\n'
        "int go(const robot_Guard_Learned_in *in, robot_Guard_Learned_out *out) {\n"
        "  (void)in; out->u = VALUE; out->has_u = 1; return 0; }\n"
    )
    file.write_text(text.replace("VALUE", "0.1"))
    robot.bind("Learned", f"c:{file}:go")
    slow = robot.simulate()
    file.write_text(text.replace("VALUE", "0.2"))
    assert robot.simulate().final["p"]["x"] > slow.final["p"]["x"]


def test_parameters_may_be_seconds_text_or_numbers(robot: soter.Program) -> None:
    robot.bind("Learned", lambda _: 0.1)
    assert robot.simulate(params={"EVERY": 0.05}).system.params["EVERY"] == 50_000_000
    assert robot.simulate(params={"EVERY": "50ms"}).system.params["EVERY"] == 50_000_000
    with pytest.raises(soter.SoterError):
        robot.simulate(params={"EVERY": 1.0})


def test_logs_and_reports(tmp_path: Path) -> None:
    soter.load(CART).simulate(until=1, log=tmp_path / "a.mcap", report=tmp_path / "a.html")
    assert (tmp_path / "a.mcap").stat().st_size > 1000
    assert (tmp_path / "a.html").stat().st_size > 1000


def test_ctrl_c_in_a_script_is_a_keyboard_interrupt(robot: soter.Program) -> None:
    import os
    import signal

    def pressed(_: object) -> float:
        os.kill(os.getpid(), signal.SIGINT)
        return 0.0

    robot.bind("Learned", pressed)
    with pytest.raises(KeyboardInterrupt):
        robot.simulate()
    assert robot.simulate(partial=True).interrupted


def test_format() -> None:
    text = soter.load(CART).format()
    assert text.startswith("soter 1;\n")


def test_build(tmp_path: Path) -> None:
    package = soter.load(CART).build("c", tmp_path / "out")
    assert "cart.c" in package.written
    assert (tmp_path / "out" / "Makefile").exists()


def test_names_that_are_not_there() -> None:
    with pytest.raises(AttributeError):
        soter.nonsense  # noqa: B018
    assert "load" in dir(soter)
