"""The stack bound: frames added up along the dearest way, or no figure and the reason."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from soter.native.compiler import find_compiler
from soter.native.stack_bound import RED_ZONE, SILENT, StackBound, stack_bound

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HEADER = """
void user_step(int n);
void user_publish(int n);
void deep(int n);
void flat(int n);
typedef struct { void (*step)(int n); } table;
extern const table user_table;
"""
FRAME = "volatile char a[{size}]; a[n] = 1; a[{size} - 1 - n] = 2;"
MAIN = (
    '#include "user.h"\nvoid user_step(int n) {'
    + FRAME.format(size=1000)
    + " deep(n); a[0] = 3; }\n"
)
OTHER = (
    '#include "user.h"\nstatic __attribute__((noinline)) void inner(int n) {'
    + FRAME.format(size=3000)
    + "}\nvoid deep(int n) { inner(n); inner(n + 1); }\n"
    + "void flat(int n) {"
    + FRAME.format(size=200)
    + "}\n"
)
OVER = 200 + RED_ZONE
"""What saved registers and return addresses may add to the arrays."""


@pytest.fixture(params=["gcc", "clang"], autouse=True)
def _compiler(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    if shutil.which(request.param) is None:
        pytest.skip(f"no {request.param} here")
    monkeypatch.setenv("SOTER_CC", request.param)
    find_compiler.cache_clear()
    yield
    monkeypatch.undo()
    find_compiler.cache_clear()


def bound(*left_out: str, **files: str) -> StackBound:
    texts = {f"{name}.c": text for name, text in files.items()}
    return stack_bound({"user.h": HEADER, **texts}, "user_", left_out)


def test_frames_along_the_dearest_way_are_added() -> None:
    stack_bound = bound(main=MAIN, other=OTHER)
    assert stack_bound.bytes is not None
    assert 4000 <= stack_bound.bytes <= 4000 + OVER
    assert stack_bound.way[0] == "user_step"
    assert stack_bound.way[-1] == "inner"
    assert stack_bound.not_counted == ()


def test_a_call_through_a_pointer_may_go_to_any_function_of_the_tables() -> None:
    text = '#include "user.h"\nvoid user_step(int n) { user_table.step(n); }\n'
    table = '#include "user.h"\nconst table user_table = {.step = deep};\n'
    through = bound(main=text, other=OTHER, tables=table)
    assert through.bytes is not None
    assert through.bytes >= 3000
    without = bound("deep", main=text, other=OTHER, tables=table)
    assert without.bytes is not None
    assert without.bytes <= OVER


def test_the_dearest_function_of_the_interface_counts() -> None:
    more = MAIN + "void user_publish(int n) {" + FRAME.format(size=9000) + " flat(n); a[0] = 3; }\n"
    stack_bound = bound(main=more, other=OTHER)
    assert stack_bound.bytes is not None
    assert 9200 <= stack_bound.bytes <= 9200 + OVER
    assert stack_bound.way[0] == "user_publish"


def test_a_circle_of_calls_has_no_bound() -> None:
    text = OTHER.replace("void flat(int n) {", "void flat(int n) { if (n > 0) { user_step(n); }")
    stack_bound = bound(main=MAIN.replace("deep(n)", "flat(n - 1)"), other=text)
    assert stack_bound.bytes is None
    assert "circle" in stack_bound.why


def test_a_frame_that_depends_on_data_has_no_bound() -> None:
    text = "volatile char a[n]; a[0] = 1; a[n - 1] = 2;"
    stack_bound = bound(main=f'#include "user.h"\nvoid user_step(int n) {{ {text} }}\n')
    assert stack_bound.bytes is None
    assert "depends on data" in stack_bound.why


def test_what_is_called_and_not_there_is_named() -> None:
    stack_bound = bound(main=MAIN)
    assert stack_bound.bytes is not None
    assert stack_bound.not_counted == ("deep",)


def test_no_function_of_the_interface_is_no_bound_of_zero() -> None:
    stack_bound = bound(other=OTHER)
    assert stack_bound.bytes is None
    assert "interface" in stack_bound.why


def test_a_compiler_that_says_nothing_gives_no_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "quiet"
    script.write_text(
        '#!/bin/sh\ncase "$*" in *-f*usage*|*callgraph*) exit 1;; esac\nexec cc "$@"\n'
    )
    script.chmod(0o755)
    monkeypatch.setenv("SOTER_CC", str(script))
    find_compiler.cache_clear()
    stack_bound = bound(main=MAIN, other=OTHER)
    assert stack_bound.bytes is None
    assert "no stack usage" in stack_bound.why


def test_assembly_of_a_processor_that_is_not_known_is_not_guessed_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "foreign"
    script.write_text(
        '#!/bin/sh\ncase "$*" in\n*callgraph*) exit 1;;\n'
        '--version) echo "clang version 14"; echo "Target: armv7-unknown-linux-gnu"; exit 0;;\n'
        'esac\nexec cc "$@"\n'
    )
    script.chmod(0o755)
    monkeypatch.setenv("SOTER_CC", str(script))
    find_compiler.cache_clear()
    stack_bound = bound(main=MAIN, other=OTHER)
    assert stack_bound.bytes is None
    assert stack_bound.why == SILENT


def test_no_compiler_at_all_gives_no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOTER_CC", "there-is-none")
    find_compiler.cache_clear()
    stack_bound = bound(main=MAIN, other=OTHER)
    assert stack_bound.bytes is None
    assert "no C compiler" in stack_bound.why
