"""Properties: docs/semantics.md, section Properties."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.interpreter import Interpreter
    from soter.semantics.run_record import PropertyRecord

    Build = Callable[..., Interpreter]

MS = 1_000_000

WATCHED = """
input topic x: float;
topic y: float;
node N period 10ms {{ subscribes x; publishes y; step {{ publish y = 2.0 * x; }} }}
system S {{ node N; until 1s; {prop} }}
"""


def watch(build: Build, prop: str, inputs: Sequence[float]) -> PropertyRecord:
    """The record of one property; one input for each instant, every 10 ms."""

    def choose_input(c: Configuration) -> list[tuple[int, Value]]:
        return [(0, inputs[c.ct // (10 * MS)])]

    it = build(WATCHED.format(prop=prop))
    _, record = it.run((len(inputs) - 1) * 10 * MS, choose_input=choose_input)
    assert record.violations == record.properties[0].count
    return record.properties[0]


def test_always_counts_onsets_and_keeps_the_time_of_the_first(build: Build) -> None:
    record = watch(build, "always x < 1.0;", [0, 2, 2, 0, 0, 2, 0])
    assert (record.count, record.first_ns, record.active) == (2, 10 * MS, False)


def test_never_is_violated_while_true(build: Build) -> None:
    record = watch(build, "never x > 1.0;", [0, 0, 2, 2])
    assert (record.count, record.first_ns, record.active) == (1, 20 * MS, True)


def test_a_violation_may_begin_with_the_first_instant(build: Build) -> None:
    record = watch(build, "always x < 1.0;", [2, 2])
    assert (record.count, record.first_ns) == (1, 0)


def test_properties_see_the_end_of_the_instant(build: Build) -> None:
    assert watch(build, "always y == 2.0 * x;", [1, 2, 3]).count == 0


@pytest.mark.parametrize("kind", ["always", "never"])
@pytest.mark.parametrize("condition", ["1.0 / x > 0.0", "1.0 / x < 0.0"])
def test_a_property_that_faults_is_violated(build: Build, kind: str, condition: str) -> None:
    assert watch(build, f"{kind} {condition} || true;", [1.0, 0.0]).active


@pytest.mark.parametrize(
    ("prop", "violated"),
    [
        ("always sqrt(x) < 9.0;", True),
        ("always !(sqrt(x) > 9.0);", False),
        ("never sqrt(x) > 9.0;", False),
    ],
)
def test_a_nan_compares_as_ieee_says(build: Build, prop: str, violated: bool) -> None:
    assert watch(build, prop, [-1.0]).active is violated


def test_properties_are_judged_on_the_truth_not_on_measurements(build: Build) -> None:
    it = build(
        """topic y: float;
        plant P period 10ms { drives y = x; state x: float = 1.0; measured y within 0.5; }
        system S { p: P; until 1s; always p.truth.x == 1.0; always y == 1.0; }"""
    )
    _, record = it.run(20 * MS)
    assert (record.properties[0].count, record.properties[1].count) == (0, 1)


def test_properties_read_modes_and_time(build: Build) -> None:
    it = build(
        """input topic x: float in [-9.0, 9.0]; topic u: float in [-1.0, 1.0];
        node Ac period 10ms { subscribes x; publishes u; step { } }
        node Sc period 10ms { subscribes x; publishes u; step { } }
        rta M { ac Ac; sc Sc; period 10ms; safe true; ttf x > 5.0; safer x < 1.0; }
        system S { m: M; until 1s; never mode(m) == Mode.AC; always time < 0.015; }"""
    )
    _, record = it.run(20 * MS)
    assert record.properties[0].first_ns == 0
    assert record.properties[1].first_ns == 20 * MS
