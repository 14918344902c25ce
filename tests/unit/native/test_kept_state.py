"""Which C of externs may keep something from call to call, and that runs begin without it."""

from __future__ import annotations

import struct
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import pytest

import soter
from generators import stateful_externs
from generators.flights_of_runs import alone, figures
from soter.codegen.unit import generate
from soter.native.kept_state import why_input_is_unknown, why_it_keeps_state
from soter.native.shared_library import library
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from pathlib import Path

    from soter.codegen.unit import Unit

KEEPS = {
    "counter": "static int calls;\ndouble moved(double s, double u, double w) "
    "{ return s + u * w + (double)calls++; }",
    "initialised": "static double table[2] = {1.0, 2.0};\n"
    "double moved(double s, double u, double w) "
    "{ table[u > w] += 0.5; return table[s > 0.0]; }",
    "another thread's": "static _Thread_local double last;\n"
    "double moved(double s, double u, double w) { last += s; return last * u + w; }",
    "error number": "#include <errno.h>\ndouble moved(double s, double u, double w) "
    "{ errno += 1; return s + u + w + errno; }",
    "a file": "#include <stdio.h>\ndouble moved(double s, double u, double w) "
    '{ FILE *const f = fopen("kept", "a"); if (f) { fclose(f); } return s + u + w; }',
    "memory": "#include <stdlib.h>\ndouble moved(double s, double u, double w) "
    "{ return s + u + w + (malloc(8) ? 0.5 : 0.0); }",
    "the clock": "#include <time.h>\ndouble moved(double s, double u, double w) "
    "{ return s + u + w + (double)time(NULL); }",
    "signgam": "double lgamma(double);\ndouble moved(double s, double u, double w) "
    "{ return lgamma(s + u + w); }",
}
KEEPS_NOTHING = {
    "arithmetic": "double moved(double s, double u, double w) { return s + u * w; }",
    "functions of math.h": "#include <math.h>\ndouble moved(double s, double u, double w) "
    "{ return sqrt(fabs(s)) + sin(u) * cos(u) + pow(w, 3.0) + fmod(s, 2.0) + floor(u); }",
    "constants": "static const double table[3] = {1.0, 2.0, 4.0};\n"
    "double moved(double s, double u, double w) { return table[(s > u) + (u > w)]; }",
    "constant addresses": "static double plus(double x) { return x + 1.0; }\n"
    "static double minus(double x) { return x - 1.0; }\n"
    "static double (*const table[2])(double) = {plus, minus};\n"
    "double moved(double s, double u, double w) { return table[s > u](w); }",
    "constants of a function": "double moved(double s, double u, double w) "
    '{ static const char said[] = "text"; return s + u + w + said[s > 0.0]; }',
    "large values on the stack": "#include <string.h>\ndouble moved(double s, double u, double w) "
    "{ volatile double all[99]; memset((void *)all, 0, sizeof all); all[s > u] = w; "
    "return all[1]; }",
}


def unit_of(folder: Path, text: str) -> Unit:
    file = stateful_externs.write(folder, "nothing", 0)
    said = file.read_text(encoding="utf-8").replace('from "c:body.c:moved"', 'from "c:own.c:moved"')
    file.write_text(said, encoding="utf-8")
    (folder / "own.c").write_text(text, encoding="utf-8")
    return generate(soter.load(file).flat())


@pytest.mark.whole
@pytest.mark.parametrize("name", KEEPS)
def test_what_may_keep_something_is_said(name: str, tmp_path: Path) -> None:
    assert why_it_keeps_state(unit_of(tmp_path, KEEPS[name]))


@pytest.mark.whole
@pytest.mark.parametrize("name", KEEPS_NOTHING)
def test_what_cannot_keep_anything_is_not(name: str, tmp_path: Path) -> None:
    assert why_it_keeps_state(unit_of(tmp_path, KEEPS_NOTHING[name])) == ""


def test_what_is_local_to_another_file_hides_no_function_of_a_library(tmp_path: Path) -> None:
    drawn = "double drand48(void);\ndouble moved(double s, double u, double w) "
    unit = unit_of(tmp_path, drawn + "{ return s + u * w + drand48(); }")
    own = "__attribute__((noinline)) static double drand48(double x) { return x; }\n"
    other = tmp_path / "other.c"
    other.write_text(own + "double more(double x); double more(double x) { return drand48(x); }")
    assert "drand48" in why_it_keeps_state(replace(unit, c_sources=(*unit.c_sources, str(other))))


def test_every_kind_of_the_generator_is_known(tmp_path: Path) -> None:
    for kind in stateful_externs.KINDS:
        unit = generate(stateful_externs.system(tmp_path / kind, kind, 0))
        assert bool(why_it_keeps_state(unit)) == (kind != "nothing"), kind


def test_what_is_no_c_may_keep_anything(tmp_path: Path) -> None:
    unit = unit_of(tmp_path, KEEPS_NOTHING["arithmetic"])
    assert "own.o" in why_it_keeps_state(replace(unit, c_sources=(str(tmp_path / "own.o"),)))


def test_a_header_that_changes_is_looked_at_again(tmp_path: Path) -> None:
    text = '#include "inner.h"\ndouble moved(double s, double u, double w) { return add(s, u, w); }'
    inner = "static double add(double s, double u, double w) { return s + u + w; }\n"
    (tmp_path / "inner.h").write_text(inner, encoding="utf-8")
    unit = unit_of(tmp_path, text)
    assert why_it_keeps_state(unit) == ""
    inner = inner.replace("{ return", "{ static double all; all += s; return all +")
    (tmp_path / "inner.h").write_text(inner, encoding="utf-8")
    assert why_it_keeps_state(unit)


BEGUN = "double moved(double s, double u, double w) { return s + u * w + "
ASKED = '#if __has_include("other.h")\n#define G 0.5\n#else\n#define G 0.0\n#endif\n'
HELD = (
    '__asm__(".pushsection .rodata\\n.globl held_in_c\\nheld_in_c:"\n'
    '  ".incbin \\"{}\\"\\n.popsection");\nextern const double held_in_c[1];\n'
)


@pytest.mark.parametrize("how", ["asked", "held"])
def test_what_c_depends_on_without_including_it_is_compiled_anew(how: str, tmp_path: Path) -> None:
    other = tmp_path / "other.h"
    if how == "held":
        other.write_bytes(struct.pack("d", 0.0))
    begin, value = (ASKED, "G") if how == "asked" else (HELD.format(other), "held_in_c[0]")
    unit = unit_of(tmp_path, f"{begin}{BEGUN}{value}; }}")
    unit = replace(unit, c_sources=(str(tmp_path / "own.c"),))
    before = library(unit)
    assert library(unit) == before
    other.write_bytes(struct.pack("d", 0.5))
    assert library(unit) != before


@pytest.mark.parametrize("when", ["__TIME__", "__DATE__", "__TIMESTAMP__"])
def test_nobody_knows_what_c_depends_on_that_says_when_it_was_compiled(
    when: str, tmp_path: Path
) -> None:
    unit = unit_of(tmp_path, f"{BEGUN}{when}[4]; }}")
    assert when in why_input_is_unknown(unit)


# ---------------------------------------------------------------- runs in one process


@pytest.mark.whole
@pytest.mark.parametrize(
    ("kind", "engine"), [("static", "native"), ("thread", "native"), ("heap", "interp")]
)
def test_a_run_is_the_same_whatever_ran_before(kind: str, engine: str, tmp_path: Path) -> None:
    program = soter.load(stateful_externs.write(tmp_path, kind, 2))

    def run(seed: int) -> str | None:
        return program.simulate(seed=seed, engine=engine).trace_sha256

    first = [alone(partial(run, seed)) for seed in (3, 4)]
    assert [run(3), run(4), run(3)] == [first[0], first[1], first[0]]
    assert first[0] != first[1]
    again = soter.load(tmp_path / "stateful.soter")
    assert again.simulate(seed=4, engine=engine).trace_sha256 == first[1]


def test_runs_of_threads_share_nothing(tmp_path: Path) -> None:
    program = NativeProgram(stateful_externs.system(tmp_path, "heap", 3))

    def run(seed: int) -> object:
        return figures(program.run(10**9, seed, keep_trace=True))

    seeds = range(12)
    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(run, seeds)) == [alone(partial(run, s)) for s in seeds]
