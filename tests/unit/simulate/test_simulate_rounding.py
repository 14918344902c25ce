"""What changes how the processor rounds changes no run: it is put back, or the run fails."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import pytest

import processes
import soter
from generators.c_packages import CART
from soter.diagnostics.diagnostic import SoterError
from soter.language.evaluate.arithmetic import broken_float_rule, restore_float_settings
from soter.native.compiler import find_compiler

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PROGRAM = """soter 1;
topic u: float in [-1.0, 1.0] = 0.0;
topic third: float;
extern node Learned period 20ms { publishes u; failsafe u = 0.0; }
node Divides period 20ms { subscribes u; publishes third; step { publish third = u / 3.0; } }
system S { node Learned; node Divides; until 1s; never third > 1.0 / 3.0; }
"""
LIBRARY = """#include <fenv.h>
int rounds_up(void);
int rounds_up(void) { return fesetround(FE_UPWARD); }
"""
EXTERN = """#include "robot.h"
#include <fenv.h>
int rounds_up(const robot_Learned_in *in, robot_Learned_out *out);
int rounds_up(const robot_Learned_in *in, robot_Learned_out *out) {
  (void)in;
  out->u = 1.0;
  out->has_u = 1;
  return fesetround(FE_UPWARD);
}
"""
engines = pytest.mark.parametrize("engine", ["native", "interp"])


@pytest.fixture(autouse=True)
def _plain() -> Iterator[None]:
    yield
    restore_float_settings()
    assert broken_float_rule() == ""


@pytest.fixture
def program(tmp_path: Path) -> soter.Program:
    (tmp_path / "robot.soter").write_text(PROGRAM)
    return soter.load(tmp_path / "robot.soter")


@pytest.fixture
def library(tmp_path: Path) -> ctypes.CDLL:
    (tmp_path / "up.c").write_text(LIBRARY)
    command = [*find_compiler().command, "-shared", "-fPIC", "up.c", "-o", "up.so", "-lm"]
    processes.run(command, cwd=tmp_path, check=True)
    return ctypes.CDLL(str(tmp_path / "up.so"))


@engines
def test_an_extern_that_rounds_otherwise_changes_nothing(
    program: soter.Program, library: ctypes.CDLL, engine: str
) -> None:
    def rounds_up(_: object) -> float:
        assert library.rounds_up() == 0
        return 1.0

    plain = program.bind("Learned", lambda _: 1.0).simulate(engine=engine)
    done = program.bind("Learned", rounds_up).simulate(engine=engine)
    assert done.trace_sha256 == plain.trace_sha256
    assert done.violations == 0
    assert broken_float_rule() == ""


@engines
def test_linked_c_that_rounds_otherwise_ends_the_run(
    program: soter.Program, tmp_path: Path, engine: str
) -> None:
    (tmp_path / "up.c").write_text(EXTERN)
    program.bind("Learned", f"c:{tmp_path / 'up.c'}:rounds_up")
    with pytest.raises(SoterError) as caught:
        program.simulate(engine=engine)
    assert [d.code for d in caught.value.diagnostics] == ["X012"]


@engines
def test_a_process_that_rounds_otherwise_runs_nothing(
    program: soter.Program, library: ctypes.CDLL, engine: str
) -> None:
    program.bind("Learned", lambda _: 1.0)
    library.rounds_up()
    with pytest.raises(SoterError, match="not rounded to the nearest"):
        program.simulate(engine=engine)


def test_nor_does_it_prove_or_check_a_certificate(library: ctypes.CDLL, tmp_path: Path) -> None:
    library.rounds_up()
    for does in (soter.load(CART).verify, lambda: soter.recheck(tmp_path)):
        with pytest.raises(SoterError) as caught:
            does()
        assert [d.code for d in caught.value.diagnostics] == ["X012"]
