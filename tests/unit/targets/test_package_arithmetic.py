"""What flags of a compiler cannot do to a package: take the gate, the DM and the monitors away."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

import soter
from generators.c_packages import CART, command, make, package, trace
from soter.native.compiler import find_compiler

if TYPE_CHECKING:
    from pathlib import Path

OWN_MAIN = """#include "soter.h"
#include <fenv.h>
#include <stdio.h>
int main(void) {
  const char* wrong = soter_self_test(NULL);
  if (wrong != NULL) { (void)puts(wrong); return 1; }
  (void)fesetround(FE_UPWARD);
  wrong = soter_self_test(NULL);
  (void)puts(wrong != NULL ? wrong : "nothing is wrong");
  return 0;
}
"""


UNSAFE_WITHOUT_A_MACRO = (
    "-funsafe-math-optimizations -fno-reciprocal-math -fno-associative-math -fsigned-zeros "
    "-ftrapping-math"
)


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    package(CART, tmp_path / "out")
    return tmp_path / "out"


def predefined(folder: Path, *flags: str) -> str:
    asked = [*find_compiler().command, *flags, "-dM", "-E", "-x", "c", "/dev/null"]
    said: str = command(asked, folder).stdout
    return said


def is_gcc_on_x86(folder: Path) -> bool:
    said = predefined(folder)
    return "__x86_64__" in said and "__clang__" not in said


@pytest.mark.parametrize(
    "flags",
    [
        "-ffast-math",
        "-O2 -ffinite-math-only",
        "-O2 -funsafe-math-optimizations",
        "-ffp-contract=fast",
    ],
)
def test_the_flags_of_the_meaning_win_over_those_of_a_person(cart: Path, flags: str) -> None:
    built = make(cart, f"CFLAGS={flags}")
    assert built.returncode == 0, built.stderr
    ran = command(["./cart"], cart)
    assert ran.returncode == 0, ran.stderr
    assert trace(ran.stdout) == soter.load(CART).simulate().trace_sha256


@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_without_the_makefile_the_header_refuses_them(cart: Path, flag: str) -> None:
    sources = sorted(p.name for p in cart.glob("*.c"))
    built = command(
        [*find_compiler().command, "-std=c99", flag, *sources, "-o", "cart", "-lm"], cart
    )
    assert built.returncode != 0
    assert re.search(r"error.*soter: -f[a-z-]+.* removes the gate and the monitors", built.stderr)
    assert not (cart / "cart").exists()


def test_the_header_refuses_more_precision_than_double(cart: Path) -> None:
    if not is_gcc_on_x86(cart):
        pytest.skip("needs gcc on x86, which still has the x87")
    built = make(cart, "CFLAGS=-mfpmath=387")
    assert built.returncode != 0
    assert "soter: doubles are computed in another precision" in built.stderr


def test_a_build_that_flushes_small_numbers_says_so_and_does_not_run(cart: Path) -> None:
    if not is_gcc_on_x86(cart):
        pytest.skip("needs gcc on x86, which links other start code for -Ofast")
    assert make(cart, "CFLAGS=-Ofast").returncode == 0
    ran = command(["./cart"], cart)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert "not run: small numbers are flushed to zero" in ran.stderr


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        ("-std=gnu11 -march=native", "rounded together"),
        ("-std=c99 -march=native -ffp-contract=fast", "rounded together"),
        ("-std=c99 -fsingle-precision-constant", "single precision"),
        (f"-std=c99 {UNSAFE_WITHOUT_A_MACRO}", "replaced by others"),
    ],
)
def test_flags_of_the_programs_own_file_are_found_too(cart: Path, flags: str, said: str) -> None:
    if not is_gcc_on_x86(cart):
        pytest.skip("these are flags of gcc on x86")
    if "march" in flags and "__FMA__" not in predefined(cart, "-march=native"):
        pytest.skip("needs a processor with a fused multiply-add")
    compiler = [*find_compiler().command, "-I.", "-O2", "-c"]
    sources = sorted(p.name for p in cart.glob("*.c"))
    assert command([*compiler, "-std=c99", *sources], cart).returncode == 0
    assert command([*compiler, *flags.split(), "cart.c"], cart).returncode == 0
    objects = [s.replace(".c", ".o") for s in sources]
    assert command([*find_compiler().command, *objects, "-o", "cart", "-lm"], cart).returncode == 0
    ran = command(["./cart"], cart)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert said in ran.stderr


def test_ones_own_main_may_ask_whether_the_machine_computes_as_it_should(cart: Path) -> None:
    (cart / "own.c").write_text(OWN_MAIN)
    compiler = [*find_compiler().command, "-std=c99", "-frounding-math", "-I."]
    built = command([*compiler, "own.c", "soter_self_test.c", "-o", "own", "-lm"], cart)
    assert built.returncode == 0, built.stderr
    ran = command(["./own"], cart)
    assert (ran.returncode, "rounded to the nearest" in ran.stdout) == (0, True), ran.stdout
