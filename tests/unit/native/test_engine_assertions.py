"""What must be so inside an engine and is not ends the process as a defect: it is no verdict."""

from __future__ import annotations

import os
import re
import sys
from typing import TYPE_CHECKING

import pytest

import processes
from soter.explore.engine.explorer_library import FLAGS as EXPLORER
from soter.native.cache import SOTER
from soter.native.compiler import STRICT, WARNINGS, find_compiler
from soter.native.shared_library import CHECK_FAILED, RUNTIME, include_flags
from soter.verify.enclose.compiled_enclosures import FLAGS as SETS

if TYPE_CHECKING:
    from pathlib import Path

SWITCH = "-DSOTER_UNCHECKED"
C = """#include "soter_check.h"
static int half(int n) {
  SOTER_CHECK(n % 2 == 0);
  return n / 2;
}
int main(int argc, char** argv) {
  (void)argv;
  return half(argc + 1) + half(argc + 2);
}
"""
FORMS = """#define SOTER_INPUTS 2
#include "soter_form.h"
int main(void) {
  const soter_form one = {.lo = 1.0, .hi = 2.0, .c = 1.5, .r = 0.5};
  soter_form other = one;
  const int64_t items[3] = {1, 2, 3};
  soter_truth undecided = 3U;
  (void)items;
  (void)undecided;
  soter_n_shift(SOTER_INPUTS, &other, &one, 0.0, 1.0);
  %s;
  return other.lo <= other.hi ? 0 : 1;
}
"""
BROKEN = {
    "soter_n_range": "soter_n_range(SOTER_INPUTS, &other, 2.0, 1.0)",
    "soter_n_shift": "soter_n_shift(SOTER_INPUTS, &other, &one, 1.0, 0.0)",
    "soter_not": "(void)soter_not(0U)",
    "soter_both": "(void)soter_both(undecided, 4U)",
    "soter_ints_of": "(void)soter_ints_of(1, 0)",
    "soter_ints_table": "(void)soter_ints_table(items, (soter_ints){.lo = 2, .hi = 1})",
    "soter_n_widen": "soter_n_widen(SOTER_INPUTS, &other, -1.0)",
}
REVERSED = """
import numpy as np
from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.small_enclosure_units import hill
inputs = GridInputs(kind="map", states=((-2.0, 2.0), (-2.0, 2.0)),
    controls=((-1.0, 1.0),), period_ns=10**9)
edges = np.linspace(-1, 1, 5)
group = GridGroup(hill(1.0, 1.0), inputs, [(0, edges), (1, edges)])
group.images_and_tubes(np.array([0.5, 0.0]), np.array([0.25, 0.0]), 1)
print("undecided")
"""


SAID = re.compile(r"soter has a defect, sorry: (soter_form\w*\.h):(\d+): not ")
BEGIN = re.compile(r"^SOTER_(?:INLINE|OPERATION) [\w ]+?\**(\w+)\(", re.MULTILINE)


def _function(said: str) -> str:
    """The function of the forms whose check failed; "": none did."""
    found = SAID.search(said)
    if found is None:
        assert said == ""
        return ""
    lines = (SOTER / "verify" / "engine" / found[1]).read_text(encoding="utf-8").splitlines()
    last: str = BEGIN.findall("\n".join(lines[: int(found[2])]))[-1]
    return last


def _run(command: list[str]) -> processes.Done:
    path = os.pathsep.join((str(SOTER.parent), str(SOTER.parents[1] / "tests")))
    return processes.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )


@pytest.mark.parametrize(("flags", "code"), [((), 70), (("-DNDEBUG",), 70), ((SWITCH,), 2)])
def test_the_switch_decides_whether_assertions_are_checked(
    tmp_path: Path, flags: tuple[str, ...], code: int
) -> None:
    (tmp_path / "odd.c").write_text(C, encoding="utf-8")
    made = str(tmp_path / "odd")
    build = [*find_compiler().command, *STRICT, *WARNINGS, *flags, f"-I{RUNTIME}", "-o", made]
    built = _run([*build, str(tmp_path / "odd.c"), str(CHECK_FAILED)])
    assert built.returncode == 0, built.stderr
    done = _run([made])
    assert done.returncode == code
    assert done.stderr == (
        "error[I001]: soter has a defect, sorry: odd.c:3: not n % 2 == 0\n" if code == 70 else ""
    )


def test_a_broken_invariant_of_the_set_engine_ends_the_process_with_70() -> None:
    done = _run([sys.executable, "-c", REVERSED])
    assert done.returncode == 70
    assert re.search(r"sorry: soter_reach_hold\.c:\d+: not lo\[i\] <= hi\[i\]\n", done.stderr)
    assert done.stdout == ""


@pytest.mark.parametrize(("where", "call"), [("", "(void)0"), *BROKEN.items()])
def test_a_form_that_encloses_nothing_is_a_defect(tmp_path: Path, where: str, call: str) -> None:
    (tmp_path / "forms.c").write_text(FORMS % call, encoding="utf-8")
    made = str(tmp_path / "forms")
    headers = include_flags(SOTER / "verify" / "engine" / "soter_form.h")
    build = [*find_compiler().command, *STRICT, *WARNINGS, *headers, "-o", made, str(CHECK_FAILED)]
    built = _run([*build, str(tmp_path / "forms.c"), "-lm"])
    assert built.returncode == 0, built.stderr
    done = _run([made])
    assert done.returncode == (70 if where else 0)
    assert _function(done.stderr) == where


@pytest.mark.parametrize("operation", ["sub", "mul", "div"])
def test_what_may_be_no_number_is_anything(tmp_path: Path, operation: str) -> None:
    """Infinity less infinity, times nothing, by infinity."""
    operands = {
        "sub": "{.lo = SOTER_INF, .hi = SOTER_INF, .r = SOTER_INF}",
        "mul": "{.lo = 0.0, .hi = SOTER_INF, .r = SOTER_INF}",
        "div": "{.lo = SOTER_INF, .hi = SOTER_INF, .r = SOTER_INF}",
    }
    call = (
        f"const soter_form wide = {operands[operation]};\n"
        f"  soter_n_{operation}(SOTER_INPUTS, &other, &wide, &wide);\n"
        "  if (!soter_form_wild(&other)) { return 3; }"
    )
    source = FORMS.replace("return other.lo <= other.hi ? 0 : 1;", "return 0;") % call
    (tmp_path / "wild.c").write_text(source, encoding="utf-8")
    made = str(tmp_path / "wild")
    headers = include_flags(SOTER / "verify" / "engine" / "soter_form.h")
    build = [*find_compiler().command, *STRICT, *WARNINGS, *headers, "-o", made, str(CHECK_FAILED)]
    built = _run([*build, str(tmp_path / "wild.c"), "-lm"])
    assert built.returncode == 0, built.stderr
    done = _run([made])
    assert (done.returncode, done.stderr) == (0, "")


def test_engines_and_what_is_deployed_are_checked() -> None:
    assert SWITCH not in SETS
    assert SWITCH not in EXPLORER
    shipped = sorted(RUNTIME.rglob("*.c"))
    assert sum(p.read_text(encoding="utf-8").count("SOTER_CHECK(") for p in shipped) > 100
    for path in shipped:
        assert "assert" not in path.read_text(encoding="utf-8"), path.name
