"""Robustness: its sign is the truth, as the interpreter sees it; what is nearer is smaller."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.brute_force import BruteForce
from soter.explore.engine.explorer_library import Engine, RawChoice, RawStep
from soter.explore.trace import STEP_KINDS
from soter.semantics.draws import fnv
from unit.explore.random_walks import system_of_text, walk

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.explore.trace import Step

PROGRAM = """soter 1;
type Hue = enum {{ Red, Green }};
type Pair = {{ x: float, n: int }};
topic x: float;
topic n: int in [-3, 3];
topic on: bool;
topic hue: Hue;
topic pair: Pair;
node Any period 10ms {{
  publishes x, n, on, hue, pair;
  step {{
    let k: int = choose [-3, 3];
    publish n = k;
    publish x = choose {{ 0.0, 1.0, -2.5, 1000.0 }};
    publish on = choose bool;
    publish hue = choose Hue;
    publish pair = {{ x: choose {{ 0.5, -0.5 }}, n: k }};
  }}
}}
fun Early(v: float, k: int, b: bool): bool {{
  if k > 1 {{ return v < 0.0; }}
  let near = abs(v) < 2.0;
  if b && near {{ return !(k == 0); }}
  return near || b;
}}
fun Looped(v: float): bool {{
  var fine = v > -1.0;
  for i in 0..3 {{ fine = fine && v != float(i); }}
  return fine;
}}
fun MayFail(v: float): bool {{ return 1.0 / v > 0.5 && v * 2.0 <= 2.0; }}
system S {{ any: Any; until 1s; }}
test T {{
  system S;
  horizon 60ms;
  {properties}
}}
"""


def condition(rng: random.Random, depth: int) -> str:
    """A random condition over the topics."""
    if depth > 0 and rng.random() < 0.75:
        a, b = condition(rng, depth - 1), condition(rng, depth - 1)
        two = rng.choice((f"{a} && {b}", f"{a} || {b}", f"{a} ? {b} : !({b})", f"({a}) == ({b})"))
        return rng.choice((f"({two})", f"!({two})"))
    order = rng.choice(("<", "<=", ">", ">=", "==", "!="))
    number = rng.choice(("x", "pair.x", "x * 2.0", "max(x, pair.x)", "0.0"))
    whole = rng.choice(("n", "pair.n", "n + 1"))
    return rng.choice(
        (
            f"{number} {order} {rng.choice(('0.5', '1.0', 'pair.x'))}",
            f"{whole} {order} {rng.randint(-2, 2)}",
            "on",
            "hue == Hue.Green",
            f"Early({number}, {whole}, on)",
            f"Looped({number})",
            f"MayFail({number})",
            "time > 0.025",
        )
    )


def raw(engine: Engine, step: Step) -> RawStep:
    names = {a.name: i for i, a in enumerate(engine.actors)}
    choices = tuple(RawChoice(fnv(c.stream), c.of, c.pick) for c in step.choices)
    kind = STEP_KINDS.index(step.kind)
    return RawStep(names.get(step.actor, -1), kind, step.release_ns, step.time_ns, choices)


def margins(engine: Engine, configuration: np.ndarray, scale: np.ndarray) -> Iterator[float]:
    """Of every premise in a configuration."""
    state = engine.ffi.cast("void *", configuration.ctypes.data)
    room = engine.ffi.cast("double *", scale.ctypes.data)
    for i in range(engine.model.guides):
        yield engine.model.guide[i].premise(state, room)


@pytest.mark.whole
@pytest.mark.parametrize("seed", range(4))
def test_a_margin_is_positive_where_the_interpreter_says_true(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311 - a test
    premises = [condition(rng, 3) for _ in range(12)]
    stated = [f"({p}) leadsto n <= 3 within 10ms;" for p in premises]
    system = system_of_text(PROGRAM.format(properties="\n  ".join(stated)), "T")
    engine, judge = Engine(system), BruteForce(system)
    scale = np.zeros(engine.model.scales + 1)
    seen = set()
    for number in range(4):
        walked = walk(system, 10 * seed + number)
        assert walked.broken is None
        steps = [raw(engine, s) for s in walked.trace.steps]
        possible, _, configurations = engine.replay(steps)
        assert possible == len(steps)
        for packed, configuration in zip(configurations, walked.configurations, strict=True):
            margin_values = list(margins(engine, packed, scale))
            truths = [judge._holds(p, configuration) for p in judge.premises]
            assert [m > 0.0 for m in margin_values] == truths, premises
            assert all(m != 0.0 and abs(m) <= 1.0 for m in margin_values)
            seen |= set(enumerate(truths))
    assert len(seen) > 12, "most conditions were true and false"
    engine.close()


SAFE = """soter 1;
topic x: float;
topic far: float;
node Any period 10ms {
  publishes x, far;
  step { publish x = choose { 1.0, 4.0, 9.0 }; publish far = choose { 0.0, 500.0 }; }
}
fun Fine(v: float): bool { let limit = 10.0; return v < limit; }
system S {
  any: Any;
  until 1s;
  always Fine(x) && far < 1000.0;
  never x > 10.0;
}
test T { system S; horizon 100ms; }
"""


def test_nearer_to_a_violation_is_less_whatever_the_scale_and_the_function() -> None:
    system = system_of_text(SAFE, "T")
    engine = Engine(system)
    scale = np.zeros(engine.model.scales + 1)
    margins_by_value: dict[float, list[float]] = {}
    assert engine.model.guides == 3, "both sides of && are followed apart"
    for seed in range(12):
        walked = walk(system, seed)
        _, _, configurations = engine.replay([raw(engine, s) for s in walked.trace.steps])
        for configuration, c in zip(configurations, walked.configurations, strict=True):
            state = engine.ffi.cast("void *", configuration.ctypes.data)
            room = engine.ffi.cast("double *", scale.ctypes.data)
            if c.Topics[1] == 0.0 and seed > 5:  # the scale is known by then
                now = [engine.model.guide[i].of(state, room) for i in (0, 2)]
                margins_by_value[c.Topics[0]] = now
    for of in range(2):
        assert (
            0.0
            < margins_by_value[9.0][of]
            < margins_by_value[4.0][of]
            < margins_by_value[1.0][of]
            <= 1.0
        )
    assert margins_by_value[9.0][0] == margins_by_value[9.0][1] == pytest.approx(0.1)
    engine.close()
