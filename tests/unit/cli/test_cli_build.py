"""`soter build`: sources that compile clean and do what `soter run` does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import processes
from generators import c_packages
from soter.addons import load_module
from soter.codegen.c_names import program_prefix
from soter.native.compiler import WARNINGS, find_compiler
from soter.targets.c99 import c99_package
from soter.targets.package import TARGETS, Package, PackageFile, Target

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    from soter.core.core import CoreSystem
    from soter.language.model.system import System

    Soter = Callable[..., Any]


FLAGS = f"CFLAGS=-O2 {' '.join(WARNINGS)}"


def make(folder: Path, name: str, *arguments: str) -> processes.Done:
    """Build with the strict flags as errors, and run."""
    done = c_packages.make(folder, FLAGS)
    assert done.returncode == 0, done.stderr
    return built_command(folder, name, *arguments)


def built_command(folder: Path, name: str, *arguments: str) -> processes.Done:
    return processes.run(
        [str(folder / name), *arguments], capture_output=True, text=True, check=False
    )


def facts(text: str) -> dict[str, str]:
    return dict(line.split(" ", 1) for line in text.splitlines())


def test_the_cart_gives_the_same_trace(soter: Soter, here: Path) -> None:
    assert soter("build", "cart.soter", "--target", "c", "-o", "out").exit == 0
    built = make(here / "out", "cart")
    run = soter("run", "cart.soter", "--json").document
    assert built.returncode == 0
    assert facts(built.stdout)["trace_sha256"] == run["trace_sha256"]
    assert "safe: 0 violations" in built.stdout
    assert "module SafeCart: AC share 94.0 %, 4 to AC, 3 to SC, 0 gate faults" in built.stdout
    again = built_command(here / "out", "cart", "--seed", "5", "--until", "2.5")
    other = soter("run", "cart.soter", "--seed", "5", "--until", "2500ms", "--json").document
    assert facts(again.stdout)["trace_sha256"] == other["trace_sha256"]


def test_a_violated_system_exits_3(soter: Soter, here: Path) -> None:
    assert soter("build", "cart.soter", "-o", "out", "--system", "Unprotected").exit == 0
    built = make(here / "out", "cart")
    assert built.returncode == 3
    assert "violated always Clear(c.truth): 2, the first at 2.635 s" in built.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ("--seed", "x"),
        ("--until", "0"),
        ("--until", "-1"),
        ("--until",),
        ("what",),
        ("--seed", "99999999999999999999"),
        ("--until", "nan"),
    ],
)
def test_the_built_command_refuses_nonsense(
    soter: Soter, here: Path, arguments: tuple[str, ...]
) -> None:
    soter("build", "cart.soter", "-o", "out")
    built = make(here / "out", "cart", *arguments)
    assert built.returncode == 2
    assert built.stderr.startswith("usage:")


def test_externs_bound_to_c_are_copied_with_their_headers(
    soter: Soter, robot: Path, here: Path
) -> None:
    assert robot.exists()
    (here / "lib").mkdir()
    (here / "lib" / "gain.h").write_text("#define GAIN 0.8\n")
    (here / "lib" / "mine.c").write_text(
        '#include "robot.h"\n#include "gain.h"\n'
        "int mine(const robot_Guard_Learned_in *in, robot_Guard_Learned_out *out) {\n"
        "  (void)in; out->u = GAIN; out->has_u = 1; return 0;\n}\n"
    )
    bind = ("--bind", "Learned=c:lib/mine.c:mine")
    assert soter("build", "robot.soter", "-o", "out", *bind).exit == 0
    (here / "lib" / "gain.h").unlink()
    built = make(here / "out", "robot")
    run = soter(
        "run", "robot.soter", "--bind", "Learned=python:recovery.py:good", "--json"
    ).document
    assert facts(built.stdout)["trace_sha256"] == run["trace_sha256"]


@pytest.mark.parametrize("target", ["c", "posix"])
def test_a_binding_to_python_that_a_package_drops_is_told(
    soter: Soter, robot: Path, here: Path, target: str
) -> None:
    assert robot.exists()
    bind = ("--bind", "Learned=python:recovery.py:good", "--target", target)
    notes = soter("build", "robot.soter", "-o", "out", *bind, "--json").document["notes"]
    assert any("Learned" in n and "Python" in n for n in notes)
    assert (here / "out").exists()


def test_a_policy_that_a_package_drops_is_to_be_written_as_soter_where_its_file_is_there(
    soter: Soter, robot: Path, here: Path
) -> None:
    text = robot.read_text()
    robot.write_text(text.replace("period EVERY {", 'period EVERY from "onnx:p.onnx" {'))
    notes = []
    for _ in ("missing", "there"):
        found = soter("build", "robot.soter", "-o", "out", "--json").document["notes"]
        notes.append(next(n for n in found if "its policy is left out" in n))
        (here / "p.onnx").write_bytes(b"")
    assert notes[0].endswith(": there is no file `p.onnx`")
    assert "`soter policy p.onnx -o p.soter`" in notes[1]


def test_other_externs_get_a_file_to_fill_in_that_is_kept(
    soter: Soter, robot: Path, here: Path
) -> None:
    assert robot.exists()
    first = soter("build", "robot.soter", "-o", "out", "--json").document
    assert first["notes"] == [
        "fill in externs.c: Guard.Learned fail until then",
        "Guard: P1c P2a P2b P3 assumed, not checked (`soter verify` does)",
    ]
    built = make(here / "out", "robot")
    assert "faults Guard.Learned: 101, the last of kind 9" in built.stdout
    stub = here / "out" / "externs.c"
    filled = stub.read_text().replace(
        "  return 1;", "  out->u = 0.8;\n  out->has_u = 1;\n  return 0;"
    )
    stub.write_text(filled)
    again = soter("build", "robot.soter", "-o", "out", "--json").document
    assert again["kept"] == ["externs.c"]
    assert stub.read_text() == filled
    plain = [
        "make",
        f"CC={' '.join(find_compiler().command)}",
        FLAGS,
    ]  # which sees that the stub changed
    assert c_packages.command(plain, here / "out").returncode == 0
    built = built_command(here / "out", "robot")
    run = soter(
        "run", "robot.soter", "--bind", "Learned=python:recovery.py:good", "--json"
    ).document
    assert facts(built.stdout)["trace_sha256"] == run["trace_sha256"]


@pytest.mark.long
def test_an_extern_plant_gets_a_function_too(soter: Soter, here: Path) -> None:
    (here / "p.soter").write_text(
        "soter 1;\ntopic x: float;\n"
        "extern plant Sim period 10ms { state p: float = 1.0; drives x = p; }\n"
        "system S { sim: Sim; until 100ms; always x < 3.0; }\n"
    )
    assert soter("build", "p.soter", "-o", "out").exit == 0
    assert make(here / "out", "p").returncode == 3, "an extern plant that fails is latched"
    stub = here / "out" / "externs.c"
    stub.write_text(
        stub.read_text().replace(
            "  return SOTER_EXTERN_FAULT;", "  out->p = state->sim.p + 0.5;\n  return SOTER_OK;"
        )
    )
    (here / "sim.py").write_text("def step(inputs):\n    return inputs.state.p + 0.5\n")
    run = soter("run", "p.soter", "--bind", "sim=python:sim.py:step", "--json").document
    built = make(here / "out", "p")
    assert facts(built.stdout)["trace_sha256"] == run["trace_sha256"]


def test_an_extern_function_without_c_is_noted(soter: Soter, here: Path) -> None:
    (here / "f.soter").write_text(
        "soter 1;\ntopic y: float in [0.0, 1.0];\nextern fun f(x: float): float;\n"
        "node N period 10ms { publishes y; failsafe y = 0.5; step { publish y = f(0.0); } }\n"
        "system S { node N; until 50ms; }\n"
    )
    done = soter("build", "f.soter", "-o", "out", "--json")
    assert "extern function f is not bound to C" in done.document["notes"][0]
    assert make(here / "out", "f").returncode == 3


@pytest.mark.parametrize("name", ["main", "externs", "soter_app", "soter", "int"])
def test_a_program_may_be_called_like_one_of_the_files(soter: Soter, here: Path, name: str) -> None:
    (here / f"{name}.soter").write_text((here / "cart.soter").read_text())
    assert soter("build", f"{name}.soter", "-o", "out").exit == 0
    assert make(here / "out", program_prefix(name)).returncode == 0


def test_targets_that_are_not_there(soter: Soter) -> None:
    for target in ("ros1", "cortex-m", "nonsense"):
        done = soter("build", "cart.soter", "--target", target, "-o", "out", "--json")
        assert (done.exit, done.codes) == (2, ["U001"])


def toy(system: System, core: CoreSystem, folder: Path) -> Package:
    """A target that is made over another."""
    package = c99_package(system, core, folder)
    package.files.append(PackageFile("TOY.txt", "a toy"))
    return package


def test_another_target_is_called_by_its_own_name(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(TARGETS, "toy", Target(f"{__name__}:toy"))
    assert "target toy" in soter("build", "cart.soter", "--target", "toy", "-o", "out").out
    assert (here / "out" / "TOY.txt").read_text() == "a toy"
    done = soter("build", "cart.soter", "--target", "toy", "-o", "out", "--json")
    assert done.document["target"] == "toy"


def test_help_names_every_target(soter: Soter) -> None:
    names = "c (the default) or posix or ros1 or ros2 or dds or mavlink or cortex-m"
    assert names in " ".join(soter("build", "--help").out.split())
    assert names.replace(" (the default)", "").split(" or ") == [*TARGETS]


def test_every_target_is_made_by_a_function() -> None:
    makers = [target.make.partition(":") for target in TARGETS.values()]
    assert all(callable(getattr(load_module(module), name)) for module, _, name in makers)


def test_files_of_others_are_not_overwritten(soter: Soter, here: Path) -> None:
    (here / "out").mkdir()
    (here / "out" / "main.c").write_text("int main(void) { return 0; }\n")
    done = soter("build", "cart.soter", "-o", "out", "--json")
    assert (done.exit, done.codes) == (1, ["D008"])
    assert [p.name for p in (here / "out").iterdir()] == ["main.c"]
    assert soter("build", "cart.soter", "-o", "cart.soter").exit == 1
