"""Flags that a user gives the compiler in SOTER_CC, and what is compiled first."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter import SoterError, load
from soter.api.assurance.certificate_check import compiler_used
from soter.native import shared_library
from soter.native.compiler import compile_with, find_compiler

if TYPE_CHECKING:
    from collections.abc import Sequence


def test_flags_that_the_user_gives_the_compiler_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = compiler_used().split()
    monkeypatch.setenv("SOTER_CC", f"{find_compiler().command[0]} -DNAMED -fno-common")
    find_compiler.cache_clear()
    try:
        told = compiler_used().split()
    finally:
        find_compiler.cache_clear()
    assert [word for word in told if word not in plain] == ["-DNAMED", "-fno-common"]


PROGRAM = """soter 1;
topic a: float = 0.0;
extern fun twice(x: float): float from "c:twice.c:twice";
node N period 10ms { publishes a; step { publish a = twice(1.0); } }
system S { node N; until 20ms; }
"""


@pytest.mark.parametrize(
    "text",
    [
        '#include "another_program.h"\ndouble twice(double x) { return x; }\n',
        "double twice(double x, int of) { return x * of; }\n",
        "#error not on this machine\n",
    ],
)
def test_a_mistake_in_linked_c_is_said_before_the_program_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    """A large program takes minutes, and the person's file a moment."""
    (tmp_path / "mine.soter").write_text(PROGRAM)
    (tmp_path / "twice.c").write_text(text)
    compiled: list[str] = []

    def noting(command: Sequence[str], *given: Any) -> None:
        compiled.extend(word for word in command if word.endswith(".c"))
        compile_with(command, *given)

    monkeypatch.setattr(shared_library, "compile_with", noting)
    with pytest.raises(SoterError, match="does not compile"):
        load(tmp_path / "mine.soter").simulate("S")
    assert not [name for name in compiled if name.endswith("mine.c")]
    (tmp_path / "twice.c").write_text("double twice(double x) { return 2.0 * x; }\n")
    assert load(tmp_path / "mine.soter").simulate("S").topic("a")[-1] == 2.0
    assert [Path(name).name for name in compiled][-2:] == ["extern_1.c", "mine.c"]
