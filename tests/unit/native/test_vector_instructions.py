"""Vectors are used where the processor has them, and fused operations nowhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.native.compiler import MEANING, VECTORS, processor_flags, vector_flags

if TYPE_CHECKING:
    import pytest

CORE = "processor\t: {}\nmodel name\t: of a test\nflags\t\t: fpu sse2 {}\n\n"


def test_a_processor_has_what_all_of_its_cores_have() -> None:
    eight, four = VECTORS
    assert processor_flags(CORE.format(0, "avx2 fma") + CORE.format(1, "avx2")) == four
    both = "avx2 avx512f avx512dq"
    assert processor_flags(CORE.format(0, both) + CORE.format(1, both)) == eight
    assert processor_flags(CORE.format(0, both) + CORE.format(1, "avx2 avx512f")) == four
    assert processor_flags(CORE.format(0, "avx2") + CORE.format(1, "avx")) == ()
    assert processor_flags(CORE.format(0, "avx avx2_of_another_name")) == ()
    assert processor_flags("") == ()


def test_other_processors_get_no_flag(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "aarch64")
    vector_flags.cache_clear()
    assert vector_flags() == ()
    vector_flags.cache_clear()


def test_nothing_is_fused() -> None:
    assert "-ffp-contract=off" in MEANING
    assert not any("fma" in flag for flag in vector_flags())
