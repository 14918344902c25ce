"""What reaches compiled C: functions outlive whoever opened their library."""

from __future__ import annotations

import gc
from typing import TYPE_CHECKING

from soter.native.c_interface import interface, open_library
from soter.native.compiler import find_compiler, run_compiler

if TYPE_CHECKING:
    from pathlib import Path


def test_a_function_outlives_the_library_that_nobody_holds(tmp_path: Path) -> None:
    (tmp_path / "two.c").write_text("int two(int x);\nint two(int x) { return 2 * x; }\n")
    command = [*find_compiler().command, "-shared", "-fPIC", "two.c", "-o", "two.so"]
    assert run_compiler(command, tmp_path, 60).code == 0
    two = open_library(interface("int two(int x);"), tmp_path / "two.so").two
    gc.collect()
    assert str(tmp_path / "two.so") in open_files()
    assert two(21) == 42


def open_files() -> str:
    """What this process has mapped (Linux)."""
    with open("/proc/self/maps", encoding="utf-8") as maps:  # noqa: PTH123 - no file to walk to
        return maps.read()
