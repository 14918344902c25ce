"""Flags that a user gives the compiler in SOTER_CC."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.api.assurance.provenance import compiler_used
from soter.native.compiler import find

if TYPE_CHECKING:
    import pytest


def test_flags_that_the_user_gives_the_compiler_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = compiler_used().split()
    monkeypatch.setenv("SOTER_CC", f"{find().command[0]} -DNAMED -fno-common")
    find.cache_clear()
    try:
        told = compiler_used().split()
    finally:
        find.cache_clear()
    assert [word for word in told if word not in plain] == ["-DNAMED", "-fno-common"]
