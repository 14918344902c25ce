"""What a package of target `c` is: its files, its Makefile, and what it never overwrites."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

import soter
from generators import c_packages
from generators.c_packages import CART, EXAMPLES, command, make, package, trace
from soter.diagnostics.diagnostic import SoterError
from soter.native.compiler import MEANING, STANDARD, WARNINGS
from soter.native.shared_library import FAULTS
from soter.native.shared_library import RUNTIME as OF_SOTER
from soter.targets.leases import FILES as LEASES

RUNTIME = {
    *("soter.h", "soter_kernel.c", "soter_virtual.c", "soter_self_test.c"),
    *("soter_sha256.h", "soter_sha256.c", "soter_firmware.h", "soter_firmware.c"),
    "soter_check.h",
}
OWN = {
    *("cart.h", "cart.c", "soter_app.h", "soter_app.c", "main.c", "Makefile", "README.md"),
    *("Protected_firmware.h", "Protected_firmware.c", "messages.json"),
}
MANIFEST = ".soter-files.json"
NAMES = (
    *("_Atomic", "__LINE__", "m___LINE__", "__func__", "_Generic"),
    *("unix", "linux", "class", "new", "template", "this"),
)


def test_the_run_time_is_what_ships() -> None:
    own = {p.name for p in OF_SOTER.iterdir() if p.suffix in {".c", ".h"}}
    assert own == RUNTIME | {*LEASES, "soter_main.c", FAULTS}


def test_a_program_with_faults_ships_what_they_need_and_no_other_does(tmp_path: Path) -> None:
    text = CART.read_text()
    source = tmp_path / "cart.soter"
    source.write_text(text.replace("until 30s;", "until 30s; faults { late all by 1ms; }", 1))
    package(source, tmp_path / "out")
    assert files(tmp_path / "out") == OWN | RUNTIME | {MANIFEST, FAULTS}
    make(tmp_path / "out")
    ran = command(["./cart"], tmp_path / "out")
    assert trace(ran.stdout) == soter.load(source).simulate().trace_sha256


def test_a_program_with_a_law_ships_its_leases(tmp_path: Path) -> None:
    source = tmp_path / "stop.soter"
    source.write_text((EXAMPLES / "wall" / "stop.soter").read_text())
    package(source, tmp_path / "out")
    more = files(tmp_path / "out") - RUNTIME - {MANIFEST}
    assert more >= {*LEASES, "stop_lease.h", "stop_lease.c", "stop_grant.c"}
    make(tmp_path / "out")
    ran = command(["./stop"], tmp_path / "out")
    assert trace(ran.stdout) == soter.load(source).simulate().trace_sha256


def files(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def cart_called(name: str, folder: Path) -> Path:
    return Path(shutil.copy(CART, folder / f"{name}.soter"))


def test_a_package_has_the_program_the_runtime_and_how_to_build_them(tmp_path: Path) -> None:
    made = package(CART, tmp_path / "out")
    assert files(tmp_path / "out") == OWN | RUNTIME | {MANIFEST}
    assert set(made.written) == OWN | RUNTIME
    assert made.commands == [f"make -C {tmp_path / 'out'}", str(tmp_path / "out" / "cart")]
    noted = json.loads((tmp_path / "out" / MANIFEST).read_text())
    assert set(noted) == OWN | RUNTIME


def test_the_flags_of_the_meaning_stand_after_those_of_a_person(tmp_path: Path) -> None:
    package(CART, tmp_path / "out")
    said = make(tmp_path / "out", "-n", "CFLAGS=-mine").stdout.split()
    assert said[-1] == "-lm"
    at = said.index("-mine")
    assert said.index(STANDARD) < at, "a person may choose another C"
    assert all(said.index(flag) > at for flag in MEANING)
    assert all(flag in said for flag in WARNINGS if flag != "-Werror")
    assert "-Werror" not in said, "warnings of tomorrow's compilers do not stop a build"


def test_building_again_changes_nothing_and_a_new_program_replaces_its_files(
    tmp_path: Path,
) -> None:
    source = cart_called("cart", tmp_path)
    package(source, tmp_path / "out")
    before = {p: p.read_bytes() for p in (tmp_path / "out").iterdir()}
    package(source, tmp_path / "out")
    assert {p: p.read_bytes() for p in (tmp_path / "out").iterdir()} == before
    package(source, tmp_path / "out", "Unprotected")
    assert (tmp_path / "out" / "cart.c").read_bytes() != before[tmp_path / "out" / "cart.c"]


@pytest.mark.parametrize("name", ["cart.c", "soter_kernel.c", "Makefile"])
def test_what_a_person_changed_is_not_overwritten(tmp_path: Path, name: str) -> None:
    package(CART, tmp_path / "out")
    changed = tmp_path / "out" / name
    changed.write_text("changed")
    with pytest.raises(SoterError, match="D008") as caught:
        package(CART, tmp_path / "out", "Unprotected")
    assert f"`{name}`" in caught.value.diagnostics[0].message
    assert changed.read_text() == "changed"


def test_files_of_a_person_beside_the_package_stay(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.c").write_text("int mine;\n")
    package(CART, tmp_path / "out")
    assert (tmp_path / "out" / "mine.c").read_text() == "int mine;\n"


def test_a_package_is_built_once_and_anew_when_anything_of_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of `c_packages.make`, which many tests rest on."""
    calls: list[list[str]] = []

    def counted(words: list[str], folder: Path) -> c_packages.Done:
        calls.append(words)
        return command(words, folder)

    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(c_packages, "command", counted)
    for name in ("once", "again"):
        out = tmp_path / name
        package(CART, out)
        assert make(out, "CFLAGS=-O0").returncode == 0
        assert command(["./cart"], out).returncode == 0
        assert len(calls) == 1
    (out / "cart").unlink()
    (out / "cart.c").write_text((out / "cart.c").read_text() + "int more;\n")
    assert make(out, "CFLAGS=-O0").returncode == 0
    (out / "cart").unlink()
    assert make(out, "CFLAGS=-O1").returncode == 0
    (out / "cart").unlink()
    (out / "cart.c").write_text("wrong")
    for _ in range(2):
        assert make(out, "CFLAGS=-O0").returncode != 0
    assert len(calls) == 5


@pytest.mark.parametrize("name", ["Makefile", "GNUmakefile", "run", "clean", "extern", "README"])
def test_a_command_is_never_called_like_a_file_or_goal_of_its_package(
    tmp_path: Path, name: str
) -> None:
    made = package(cart_called(name, tmp_path), tmp_path / "out")
    (tmp_path / "out" / "extern").mkdir(exist_ok=True)
    built = make(tmp_path / "out")
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "out" / "Makefile").read_text().startswith("# Written by soter")
    again = command(["make", "run"], tmp_path / "out")
    assert "safe: 0 violations" in again.stdout
    assert command([made.commands[1]], tmp_path).returncode == 0
    assert command(["make", "clean"], tmp_path / "out").returncode == 0


def test_headers_can_be_included_from_cpp(tmp_path: Path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("there is no C++ compiler")
    package(nasty(tmp_path), tmp_path / "out")
    (tmp_path / "own.cpp").write_text(
        '#include "out/nasty.h"\n#include "out/soter_sha256.h"\nint main() {\n'
        "  static nasty_state s;\n  soter_start(&nasty_program, &s, 1);\n"
        "  return soter_header_of(&s)->ct == -1 ? 0 : 1;\n}\n"
        "void soter_check_failed(const char*, int, const char*) { throw 1; }\n"
    )
    strict = ["-std=c++17", "-Wall", "-Wextra", "-Werror"]
    done = command(["g++", *strict, "-c", "own.cpp", "-Iout"], tmp_path)
    assert done.returncode == 0, done.stderr
    parts = ["out/nasty.c", "out/soter_kernel.c"]
    assert command(["cc", "-std=c99", "-c", *parts, "-Iout"], tmp_path).returncode == 0
    objects = ["own.o", "nasty.o", "soter_kernel.o"]
    assert command(["g++", *objects, "-o", "own", "-lm"], tmp_path).returncode == 0
    assert command(["./own"], tmp_path).returncode == 0


def nasty(folder: Path) -> Path:
    """A program whose names mean something to C, C++ or their compilers."""
    fields = ", ".join(f"{n}: float" for n in NAMES)
    values = ", ".join(f"{n}: {i}.0" for i, n in enumerate(NAMES))
    adding = "\n".join(f"    var {n}: float = r.{n} + 1.0;" for n in NAMES)
    (folder / "nasty.soter").write_text(
        f"soter 1;\ntype All = {{ {fields} }};\n"
        f"topic _Bool: All = {{ {values} }};\ntopic class: float;\n"
        "node delete period 10ms {\n"
        f"  publishes _Bool; failsafe _Bool = {{ {values} }};\n"
        f"  step {{ publish _Bool = {{ {values} }}; }}\n}}\n"
        "node operator period 10ms {\n"
        "  subscribes _Bool; publishes class; failsafe class = 0.0;\n"
        f"  step {{\n    var r: All = _Bool;\n{adding}\n"
        f"    publish class = {' + '.join(NAMES)} + _Bool.new;\n  }}\n}}\n"
        "system S { node delete; node operator; until 50ms; always class < 100.0; }\n"
    )
    return folder / "nasty.soter"


def test_names_that_mean_something_to_a_compiler_are_told_apart(tmp_path: Path) -> None:
    source = nasty(tmp_path)
    runs = [soter.load(source).simulate(engine=e).trace_sha256 for e in ("native", "interp")]
    package(source, tmp_path / "out")
    built = make(tmp_path / "out", "CFLAGS=-std=gnu11 -O2")
    assert built.returncode == 0, built.stderr
    ran = command(["./nasty"], tmp_path / "out")
    assert {trace(ran.stdout), *runs} == {runs[0]}


def test_nothing_that_is_read_is_marked_as_unused(tmp_path: Path) -> None:
    package(CART, tmp_path / "out")
    functions = re.split(r"^}$", (tmp_path / "out" / "cart.c").read_text(), flags=re.MULTILINE)
    marked = [(f, n) for f in functions for n in re.findall(r"\(void\)(\w+);", f)]
    assert marked, "some functions of a table do not need all that they are given"
    for function, name in marked:
        body = function.split("{", 1)[1]
        reads = re.findall(rf"\b{name}\b", body.replace(f"(void){name};", ""))
        declared = re.findall(rf"\b{name} = ", body)
        assert len(reads) == len(declared), function
