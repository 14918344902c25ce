"""Plants: integration, draws, measurement, faults; and externs in their place."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

import pytest

from soter.language.evaluate.arithmetic import FaultKind
from soter.semantics.draws import draw_float

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import SimpleNamespace

    from soter.semantics.configuration import Configuration
    from soter.semantics.interpreter import Interpreter
    from soter.semantics.run_record import Record

    Build = Callable[..., Interpreter]

MS = 1_000_000


def states(it: Interpreter, until_ms: int) -> list[Configuration]:
    """The configurations at the end of all instants up to a time."""
    seen: list[Configuration] = []

    def observe(c: Configuration, _: Record) -> None:
        seen.append(c)

    it.run(until_ms * MS, observe)
    return seen


def plant(items: str, period: str = "10ms") -> str:
    return f"""
        topic y: float;
        plant P period {period} {{ drives y = x; {items} }}
        system S {{ p: P; until 1s; }}"""


# ---------------------------------------------------------------- release


def test_the_first_release_only_publishes(build: Build) -> None:
    it = build(plant("state x: float = 4.0; der x = 1.0;"))
    first, second = states(it, 10)
    assert (first.ct, first.L, first.Topics, first.stamps) == (0, ((4.0,),), (4.0,), (0,))
    assert second.L == ((4.0 + 0.01,),)
    assert second.Topics == second.L[0]
    assert second.stamps == (10 * MS,)


def test_topics_are_held_as_they_are_when_the_plant_steps(build: Build) -> None:
    it = build(
        """topic y: float; topic u: float;
        plant P period 10ms { reads u; drives y = x; state x: float; integrate euler; der x = u; }
        node N period 10ms { subscribes y; publishes u; step { publish u = y + 1.0; } }
        system S { p: P; node N; until 1s; }"""
    )
    seen = states(it, 20)
    y = it.system.topic("y").index
    assert [c.Topics[y] for c in seen] == [0.0, 0.0 + 0.01 * 1.0, 0.01 + 0.01 * (0.01 + 1.0)]


# ---------------------------------------------------------------- integration

PENDULUM = """
state x: float = 0.3; state w: float = -0.2; state kept: float = 1.5;
let pull = -2.0 * x * kept - 0.1 * w;
der x = w; der w = pull + x * x;
"""


def rates(x: float, w: float) -> tuple[float, float]:
    pull = -2.0 * x * 1.5 - 0.1 * w
    return w, pull + x * x


def test_euler_is_x_plus_h_times_f(build: Build) -> None:
    it = build(plant(PENDULUM + "integrate euler;"))
    h = float(10 * MS) / 1e9 / float(1)
    x, w = 0.3, -0.2
    for c in states(it, 30)[1:]:
        dx, dw = rates(x, w)
        x, w = x + h * dx, w + h * dw
        assert c.L[0] == (x, w, 1.5)


@pytest.mark.parametrize("substeps", [1, 3])
def test_rk4_is_evaluated_in_the_documented_order(build: Build, substeps: int) -> None:
    it = build(plant(PENDULUM + f"integrate rk4 substeps {substeps};"))
    h = float(10 * MS) / 1e9 / float(substeps)
    x, w = 0.3, -0.2
    for c in states(it, 30)[1:]:
        for _ in range(substeps):
            a1, b1 = rates(x, w)
            a2, b2 = rates(x + (h * 0.5) * a1, w + (h * 0.5) * b1)
            a3, b3 = rates(x + (h * 0.5) * a2, w + (h * 0.5) * b2)
            a4, b4 = rates(x + h * a3, w + h * b3)
            x = x + (h / 6.0) * (((a1 + 2.0 * a2) + 2.0 * a3) + a4)
            w = w + (h / 6.0) * (((b1 + 2.0 * b2) + 2.0 * b3) + b4)
        assert c.L[0] == (x, w, 1.5)


def test_vector_states_integrate_component_by_component(build: Build) -> None:
    vector = build(
        """type V = { a: float, b: float[2] };
        topic y: V;
        plant P period 10ms { drives y = x; state x: V = { a: 1.0, b: [2.0, 3.0] };
            der x = -0.5 * x; }
        system S { p: P; until 1s; }"""
    )
    scalars = build(
        """topic y: float;
        plant P period 10ms { drives y = a; state a: float = 1.0; state b: float = 2.0;
            state c: float = 3.0; der a = -0.5 * a; der b = -0.5 * b; der c = -0.5 * c; }
        system S { p: P; until 1s; }"""
    )
    for left, right in zip(states(vector, 50), states(scalars, 50), strict=True):
        ((a, (b, c)),) = left.L[0]
        assert (a, b, c) == right.L[0]


def test_next_reads_the_old_states_and_lets(build: Build) -> None:
    it = build(
        plant(
            """state x: float = 1.0; state n: int = 0; state before: float = 0.0;
            let twice = 2.0 * x;
            next n = n + 1; next before = twice; der x = 10.0; integrate euler;"""
        )
    )
    seen = [c.L[0] for c in states(it, 20)]
    assert seen[0] == (1.0, 0, 0.0)
    assert seen[1] == (1.0 + 0.01 * 10.0, 1, 2.0)
    assert seen[2][1:] == (2, 2.0 * (1.0 + 0.01 * 10.0))


def test_states_without_der_are_held_while_others_integrate(build: Build) -> None:
    it = build(
        plant(
            """state x: float = 0.0; state slope: float = 1.0;
            next slope = slope + 1.0; der x = slope;"""
        )
    )
    first = states(it, 10)[-1].L[0]
    assert first == (0.0 + (0.01 / 6.0) * 6.0, 2.0)


def test_time_is_the_release_time_in_every_stage(build: Build) -> None:
    it = build(plant("state x: float; state d: float; der x = time; next d = dt;"))
    second, third = states(it, 20)[1:]
    h, sixth = 0.01, 0.01 / 6.0
    x1 = 0.0 + sixth * (((0.01 + 2.0 * 0.01) + 2.0 * 0.01) + 0.01)
    assert second.L[0] == (x1, h)
    assert third.L[0][0] == x1 + sixth * (((0.02 + 2.0 * 0.02) + 2.0 * 0.02) + 0.02)


def test_a_nan_state_is_stored_canonically(build: Build) -> None:
    it = build(
        """topic y: float;
        plant P period 10ms { drives y = 0.0; state x: float; next x = -sqrt(-1.0); }
        system S { p: P; until 1s; }"""
    )
    (stored,) = states(it, 10)[-1].L[0]
    assert struct.pack(">d", stored).hex() == "7ff8000000000000"


# ---------------------------------------------------------------- draws


def test_disturbances_have_the_index_of_the_period_that_begins(build: Build) -> None:
    it = build(
        """topic y: float;
        plant P period 10ms {
          drives y = gust; state x: float; integrate euler; der x = wind;
          disturbance wind: float in [-1.0, 2.0] hold 30ms;
          disturbance gust: float in [0.0, 1.0];
        }
        system S { p: P; until 1s; }""",
        seed=11,
    )
    x = 0.0
    for c in states(it, 100):
        start = c.ct - 10 * MS
        if c.ct > 0:
            x = x + 0.01 * draw_float(11, "p.wind", start // (30 * MS), -1.0, 2.0)
        assert c.L[0] == (x,)
        gust = draw_float(11, "p.gust", max(start // (10 * MS), 0), 0.0, 1.0)
        assert c.Topics == (gust,), "the same disturbances are seen by `drives`"


def test_every_leaf_of_a_disturbance_has_a_stream(build: Build) -> None:
    it = build(
        """type V = { a: float, b: float }; topic y: V;
        plant P period 10ms { drives y = w; state s: float; disturbance w: V in [-1.0, 1.0]; }
        system S { p: P; until 1s; }"""
    )
    assert states(it, 0)[0].Topics[0] == (
        draw_float(0, "p.w.a", 0, -1.0, 1.0),
        draw_float(0, "p.w.b", 0, -1.0, 1.0),
    )


def test_a_state_that_starts_in_a_range_is_drawn(build: Build) -> None:
    it = build(
        """type V = { a: float, b: float }; topic y: V;
        plant P period 10ms { drives y = x;
          state x: V in [-1.0, 1.0]; state z: float in [2.0, 3.0]; }
        system S { p: P; until 1s; }""",
        seed=3,
    )
    assert it.initial().L[0] == (
        (
            draw_float(3, "p.x.start.a", 0, -1.0, 1.0),
            draw_float(3, "p.x.start.b", 0, -1.0, 1.0),
        ),
        draw_float(3, "p.z.start", 0, 2.0, 3.0),
    )


def test_measurement_errors_are_added_to_their_leaves(build: Build) -> None:
    it = build(
        """type V = { a: float, b: float }; type B = { p: V, q: float[2], n: int }; topic y: B;
        plant P period 10ms {
          drives y = { p: { a: x, b: x }, q: [x, x], n: 7 };
          state x: float = 1.0; der x = 1.0;
          measured y.p.b within 0.5, y.q within 0.25;
        }
        system S { p: P; until 1s; }""",
        seed=2,
    )
    for c in states(it, 50):
        index = c.ct // (10 * MS)
        (x,) = c.L[0]

        def error(leaf: str, bound: float, index: int = index) -> float:
            return draw_float(2, f"p.y.{leaf}", index, -bound, bound)

        assert c.Topics[0] == (
            (x, x + error("p.b", 0.5)),
            (x + error("q.[0]", 0.25), x + error("q.[1]", 0.25)),
            7,
        )


# ---------------------------------------------------------------- faults


@pytest.mark.parametrize(
    ("items", "kind"),
    [
        ("der x = 1.0 / (x - 1.0);", FaultKind.DIVIDE),
        ("let a = 1.0 / (x - 1.0); der x = a;", FaultKind.DIVIDE),
        ("der x = 1e308 * 1e308;", FaultKind.NONFINITE),
        ("state n: int in [0, 0]; next n = n + 1; der x = 1.0;", FaultKind.OVERFLOW),
        ("next x = 100.0;", FaultKind.RANGE),
    ],
)
def test_a_step_fault_keeps_the_old_state_and_latches_the_plant(
    build: Build, items: str, kind: FaultKind
) -> None:
    it = build(
        f"""topic y: float in [-9.0, 9.0];
        plant P period 10ms {{ drives y = x; state x: float = 1.0; {items} }}
        system S {{ p: P; until 1s; }}"""
    )
    start = it.initial()
    c, record = it.run(50 * MS)
    if "let a" in items:  # lets are evaluated for `drives`, so already the first release faults
        assert record.components[0].latched_ns == 0
        assert c.stamps[0] < 0
    else:
        assert record.components[0].latched_ns == 10 * MS
        assert (c.Topics, c.stamps) == ((1.0,), (0,))
    assert c.L == start.L
    assert c.latched == (True,)
    assert record.components[0].last_fault == kind
    assert record.components[0].faults == 1
    assert record.violations == 1


def test_the_first_fault_of_a_step_names_it_next_before_der(build: Build) -> None:
    it = build(plant("state x: float; state n: int; der x = 1.0 / x; next n = int(1e30 + x); "))
    _, record = it.run(10 * MS)
    assert record.components[0].last_fault == FaultKind.CONVERT


# ---------------------------------------------------------------- extern plants

EXTERN = """
topic u: float in [-1.0, 1.0]; topic y: float;
node N period 10ms { publishes u; step { publish u = 0.5; } }
extern plant Cart period 10ms {
  reads u; drives y = 2.0 * x; state x: float = 1.0; state v: float = 2.0; measured y within 0.1;
}
system S { c: Cart; node N; until 1s; }
"""


def test_an_extern_plant_moves_by_its_driver_and_drives_by_soter(build: Build) -> None:
    seen: list[tuple[float, float, float]] = []

    def step(inputs: SimpleNamespace) -> dict[str, float]:
        seen.append((inputs.u, inputs.state.x, inputs.state.v))
        return {"x": inputs.state.x + inputs.u}

    it = build(EXTERN, externs={"c": step})
    c = states(it, 20)[-1]
    assert seen == [(0.5, 1.0, 2.0), (0.5, 1.5, 2.0)], "not called at the first release"
    assert c.L[0] == (2.0, 2.0)
    assert c.Topics[1] == 4.0 + draw_float(0, "c.y", 2, -0.1, 0.1)


@pytest.mark.parametrize("answer", [{"x": "far"}, {"z": 1.0}, 3.0])
def test_an_extern_plant_that_answers_nonsense_is_latched(build: Build, answer: object) -> None:
    it = build(EXTERN, externs={"c": lambda _: answer})
    c, record = it.run(20 * MS)
    assert c.L[0] == (1.0, 2.0)
    assert record.components[0].last_fault == FaultKind.EXTERN
    assert record.violations == 1


def test_a_nan_of_an_extern_plant_is_refused_by_the_gate(build: Build) -> None:
    it = build(EXTERN, externs={"c": lambda _: {"x": math.nan}})
    _, record = it.run(20 * MS)
    assert record.components[0].last_fault == FaultKind.NONFINITE
