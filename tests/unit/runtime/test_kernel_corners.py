"""Corners of the kernel that random programs hardly reach, in C and in the interpreter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.engine_comparison import (
    compile_library,
    first_difference,
    interpreted_trace,
    native_trace,
    subject,
)
from generators.outside_input_driver import Outside
from soter.language.evaluate.arithmetic import FaultKind
from soter.semantics.interpreter import Interpreter

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from generators.engine_comparison import Subject

    Build = Callable[[str, str], tuple[Subject, Path]]

MS = 1_000_000
INT_MAX, INT_MIN = 2**63 - 1, -(2**63)
OK = 0


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    def make(name: str, text: str) -> tuple[Subject, Path]:
        s = subject(name, "soter 1;\n" + text, 7, 10)
        return s, compile_library([s], tmp_path_factory.mktemp(name), "-O2")

    return make


# ---------------------------------------------------------------- the first instant


def test_an_input_is_drawn_at_zero_where_every_phase_is_later(build: Build) -> None:
    s, library = build(
        "phased",
        """input topic x: float in [-1.0, 1.0]; topic y: float;
        node N period 10ms phase 5ms { subscribes x; publishes y; step { publish y = x; } }
        system S { node N; input x every 8ms; until 1s; }""",
    )
    native = native_trace(library, s)
    times = [int(state.view(s.dtype)[0]["header"]["ct"]) for state in native]
    assert times[:5] == [0, 5 * MS, 8 * MS, 15 * MS, 16 * MS]
    assert int(native[0].view(s.dtype)[0]["stamps"][0]) == 0
    assert first_difference(s, native, interpreted_trace(s)) is None


# ---------------------------------------------------------------- an extern that fails

EXTERN = """
input topic x: float in [-9.0, 9.0];
topic y: float in [-1.0, 1.0];
extern node E period 10ms {
  subscribes x; publishes y; failsafe y = 0.5;
  assumes x < 1.0;
  guarantees y < 0.0;
}
system S { node E; until 1s; }
"""


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        (FaultKind.EXTERN, FaultKind.EXTERN),
        (OK, FaultKind.EXTERN),
        (FaultKind.DIVIDE, FaultKind.DIVIDE),
    ],
)
def test_an_extern_that_fails_is_judged_by_what_it_read_and_keeps_its_kind(
    build: Build, given: int, kind: FaultKind
) -> None:
    s, library = build(f"failing_{given}", EXTERN)
    native = Outside(library, s)
    assert native.publish(s.system.topic("x").index, 3.0, 0) == OK
    assert native.instant() == 0
    native.answer(0, given)
    assert native.instant() is None
    state = native.record
    assert (state["components"][0]["faults"], state["components"][0]["last_fault"]) == (1, kind)
    assert state["components"][0]["latched"] == 1
    kinds = [p.kind for p in s.system.properties]
    counts = dict(zip(kinds, (int(n) for n in state["properties"]["count"]), strict=True))
    assert counts == {"assumes": 1, "guarantees": 0}
    assert state["header"]["violations"] == 2
    assert native.topic(s.system.topic("y").index) == 0.5


def test_the_interpreter_judges_an_extern_that_fails_in_the_same_way(build: Build) -> None:
    s, _ = build("failing_there", EXTERN)
    it = Interpreter(s.system, s.seed, {"E": lambda _: 1 / 0})
    c, refused = it.publish_input(it.initial(), s.system.topic("x").index, 3.0, 0)
    assert refused is None
    record = it.record()
    c = it.instant(c, record=record)
    counts = {p.kind: r.count for p, r in zip(s.system.properties, record.properties, strict=True)}
    assert counts == {"assumes": 1, "guarantees": 0}
    assert (record.components[0].faults, record.components[0].last_fault) == (1, FaultKind.EXTERN)
    assert (c.latched, record.violations) == ((True,), 2)


# ---------------------------------------------------------------- 64 bits, exactly

INTS = """
input topic a: int; input topic b: int;
topic total: int; topic difference: int; topic product: int; topic size: int;
node Add period 10ms { subscribes a, b; publishes total; step { publish total = a + b; } }
node Sub period 10ms { subscribes a, b; publishes difference; step { publish difference = a - b; } }
node Mul period 10ms { subscribes a, b; publishes product; step { publish product = a * b; } }
node Abs period 10ms { subscribes a; publishes size; step { publish size = abs(a); } }
system S { node Add; node Sub; node Mul; node Abs; until 1s; }
"""
SEVENTH = INT_MAX // 7  # 7 divides 2**63 - 1
PAIRS = [
    (INT_MAX, 0), (INT_MAX, 1), (INT_MAX, -1), (INT_MAX - 1, 1), (INT_MAX - 1, -1), (1, INT_MAX),
    (INT_MIN, 0), (INT_MIN, 1), (INT_MIN, -1), (INT_MIN + 1, -1), (INT_MIN + 1, 1), (-1, INT_MIN),
    (0, INT_MIN), (0, INT_MAX), (-1, INT_MAX), (-2, INT_MAX), (INT_MAX, INT_MIN), (1, INT_MIN),
    (7, SEVENTH), (7, SEVENTH + 1), (-7, -SEVENTH), (-7, -SEVENTH - 1), (SEVENTH + 1, 7),
    (2**31, -(2**32)), (-(2**31), 2**32), (2**31, -(2**32) - 1), (-(2**31), 2**32 + 1),
    (-(2**31) - 1, 2**32), (2**32 + 1, -(2**31)), (-(2**31), -(2**32)), (2**31, 2**32),
    (-1, INT_MIN + 1), (INT_MAX, 2), (2, INT_MIN // 2), (2, INT_MIN // 2 - 1),
]  # fmt: skip


def test_sums_and_products_are_right_up_to_the_last_int(build: Build) -> None:
    s, library = build("whole_ints", INTS)
    topics = [s.system.topic(n).index for n in ("total", "difference", "product", "size")]
    a_topic, b_topic = s.system.topic("a").index, s.system.topic("b").index
    it = Interpreter(s.system, s.seed)
    for a, b in PAIRS:
        exact = (a + b, a - b, a * b, abs(a))
        native, c, record = Outside(library, s), it.initial(), it.record()
        for topic, value in ((a_topic, a), (b_topic, b)):
            assert native.publish(topic, value, 0) == OK
            c, refused = it.publish_input(c, topic, value, 0)
            assert refused is None
        assert native.instant() is None
        it.instant(c, record=record)
        for n, (topic, wanted) in enumerate(zip(topics, exact, strict=True)):
            fits = INT_MIN <= wanted <= INT_MAX
            fault = OK if fits else FaultKind.OVERFLOW
            assert native.record["components"][n]["last_fault"] == fault, (a, b, n)
            assert record.components[n].last_fault == fault, (a, b, n)
            assert native.topic(topic) == (wanted if fits else 0), (a, b, n)
