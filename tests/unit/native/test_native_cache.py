"""The cache of compiled programs: keyed by everything that matters, and never half of something."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.codegen.unit import generate
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.native.cache import included_files
from soter.native.compiler import compile_with, find_compiler
from soter.native.shared_library import KERNEL, RUNTIME, library

if TYPE_CHECKING:
    from soter.codegen.unit import Unit

PROGRAM = """soter 1;
topic out: float in [0.0, 9.0];
extern node Gain period 10ms from "c:gain.c:gain_step" { publishes out; }
"""
CODE = """#include "inc/deep.h"
#include "lib.h"
int gain_step(const lib_Gain_in *in, lib_Gain_out *out) {
  (void)in;
  out->out = GAIN;
  out->has_out = 1;
  return 0;
}
"""


@pytest.fixture
def unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Unit:
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))
    (tmp_path / "inc").mkdir()
    (tmp_path / "inc" / "deep.h").write_text('#include "deeper.h"\n')
    (tmp_path / "inc" / "deeper.h").write_text("#define GAIN 1.0\n")
    (tmp_path / "gain.c").write_text(CODE)
    checked = check_file(str(tmp_path / "lib.soter"), PROGRAM)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    return generate(system_of(checked, None))


def test_the_same_content_is_compiled_once(unit: Unit) -> None:
    first = library(unit)
    changed = first.stat().st_mtime_ns
    assert library(unit) == first
    assert first.stat().st_mtime_ns == changed


def test_a_change_in_a_header_below_another_compiles_anew(unit: Unit, tmp_path: Path) -> None:
    first = library(unit)
    (tmp_path / "inc" / "deeper.h").write_text("#define GAIN 2.0\n")
    assert library(unit) != first


@pytest.mark.parametrize("damage", [b"", b"\x7fELF half of it"])
def test_a_damaged_library_is_made_anew(unit: Unit, damage: bytes) -> None:
    path = library(unit)
    whole = path.read_bytes()
    path.write_bytes(damage)
    assert library(unit).read_bytes()[:4] == whole[:4]
    assert len(library(unit).read_bytes()) == len(whole)


def test_what_lies_beside_an_extern_does_not_matter(unit: Unit, tmp_path: Path) -> None:
    (tmp_path / "folder.h").mkdir()
    (tmp_path / ".#lock.h").symlink_to("nobody@nowhere.1")
    os.mkfifo(tmp_path / "pipe.h")
    assert library(unit).exists()


def test_includes_in_a_circle_end(tmp_path: Path) -> None:
    (tmp_path / "a.h").write_text('#include "b.h"\n')
    (tmp_path / "b.h").write_text('#include "a.h"\n')
    assert len(included_files(str(tmp_path / "a.h"))) == len(["a.h", "b.h"])


def test_a_cache_that_others_may_write_to_is_not_used(unit: Unit, tmp_path: Path) -> None:
    library(unit)
    (tmp_path / "cache").chmod(0o777)
    with pytest.raises(SoterError, match="X006"):
        library(unit)


def test_the_kernel_is_compiled_once_for_programs_compiled_alike(
    tmp_path: Path, unit: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []

    def noted(command: list[str], *rest: Any) -> None:
        asked.append(command)
        compile_with(command, *rest)

    monkeypatch.setattr("soter.native.shared_library.compile_with", noted)

    def of_soter(change: str, level: str) -> list[str]:
        (tmp_path / "gain.c").write_text(f"#define GAIN {change}\n{CODE}")
        asked.clear()
        library(unit, level)
        return [Path(x).name for c in asked for x in c if Path(x).parent == RUNTIME]

    assert of_soter("1.0", "-O1") == list(KERNEL)
    assert of_soter("2.0", "-O1") == []
    assert of_soter("2.0", "-O0") == list(KERNEL)


def test_what_was_compiled_with_other_flags_of_the_compiler_is_not_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    command = find_compiler().command[0]
    identities = []
    for flags in ("", " -O0", " -DNAMED"):
        monkeypatch.setenv("SOTER_CC", command + flags)
        find_compiler.cache_clear()
        identities.append(find_compiler().identity)
    find_compiler.cache_clear()
    assert len(set(identities)) == 3
