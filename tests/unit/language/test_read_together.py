"""Which topics a decision module reads together, and how far apart in time they may be."""

from __future__ import annotations

import pytest

from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates import PredicateEvaluator
from soter.language.front_end import check_file, system_of
from soter.language.model.read_together import allowed_stamp_differences, permits_on_close_reads
from soter.language.model.system import Shield, System
from soter.language.model.typed import AgeRead, Literal, TypedBinary
from soter.language.model.types import BOOL, FLOAT

MS = 1_000_000
TEXT = """soter 1;
topic pos: float max_age 60ms;
topic vel: float max_age 90ms;
topic tank: float max_age 60ms;
topic wall: float;
topic u: float in [-1.0, 1.0];
plant P period 10ms {
  reads u; drives pos = x; drives vel = v; drives wall = 9.0;
  state x: float; state v: float;
  der x = v; der v = u;
}
plant Q period PERIOD { drives tank = l; state l: float; der l = -l; }
node Fast period 20ms { publishes u; step { publish u = 1.0; } }
node Slow period 20ms { subscribes pos; publishes u; step { publish u = clamp(-pos, -1.0, 1.0); } }
rta M {
  ac Fast; sc Slow; period 20ms;
  safe pos < wall;
  ttf pos + abs(vel) + tank > wall - 2.0;
  safer pos + abs(vel) + tank < wall - 3.0;
}
system S default { p: P; q: Q; module M; }
system World deploys S {
  module M;
  external topic pos every 10ms delayed 2ms measured pos within 0.0;
  external topic vel every 30ms delayed 1ms measured vel within 0.0;
  external topic tank every 10ms measured tank within 0.0;
  external topic wall every 1s;
  external topic u;
}
"""


def flat_of(system: str, period: str = "10ms") -> System:
    checked = check_file("test.soter", TEXT.replace("PERIOD", period))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    return system_of(checked, system)


@pytest.mark.parametrize(
    ("system", "period", "pairs"),
    [
        ("S", "10ms", {("pos", "vel"): 0, ("pos", "tank"): 0, ("vel", "tank"): 0}),
        ("S", "20ms", {("pos", "vel"): 0}),
        (
            "World",
            "10ms",
            {("pos", "vel"): 31 * MS, ("pos", "tank"): 12 * MS, ("vel", "tank"): 31 * MS},
        ),
    ],
)
def test_what_has_an_age_and_is_published_together_is_compared(
    system: str, period: str, pairs: dict[tuple[str, str], int]
) -> None:
    flat = flat_of(system, period)
    (module,) = flat.modules
    found = {
        (flat.topics[i].name, flat.topics[j].name): most
        for i, j, most in allowed_stamp_differences(flat, module.inputs)
    }
    assert found == pairs


@pytest.mark.parametrize(("system", "most"), [("S", 0), ("World", 31 * MS)])
def test_a_shield_permits_nothing_on_reads_that_are_further_apart(system: str, most: int) -> None:
    flat = flat_of(system)
    (module,) = flat.modules
    pos, vel = (s for s, i in module.scope.topics.items() if flat.topics[i].name in {"pos", "vel"})
    span = module.symbol.span
    ages = [AgeRead(FLOAT, span, symbol) for symbol in (pos, vel)]
    fresh = [TypedBinary(BOOL, span, "<=", age, Literal(FLOAT, span, 1.0)) for age in ages]
    module.shield = Shield(1, 0, permits=TypedBinary(BOOL, span, "&&", *fresh))
    permits = PredicateEvaluator.for_scope(module.scope).compiled(
        permits_on_close_reads(flat, module)
    )
    for apart in (0, most, most + 1):
        for older in (pos, vel):
            stamps = [100 * MS] * len(flat.topics)
            stamps[module.scope.topics[older]] -= apart
            env = Environment(topics=[0.0] * len(stamps), stamps=stamps, time_ns=150 * MS)
            assert permits(env) is (apart <= most), (apart, older.name)
