"""How far a predicate is from changing: its sign is the truth, nothing nearer says otherwise."""

from __future__ import annotations

import random
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from long_tests import examples, seed_of
from soter.api import load
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.model.types import BoolType, EnumType, FloatType, IntType
from soter.monitor.predicate_margins import PredicateMargins

if TYPE_CHECKING:
    from soter.language.model.system import System, Topic

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def random_value(t: Any, chance: random.Random, low: float, high: float) -> Any:
    if isinstance(t, FloatType):
        return chance.choice([chance.uniform(low, high), chance.gauss(0.0, 1.0), 0.0])
    if isinstance(t, BoolType):
        return chance.random() < 0.5
    if isinstance(t, IntType):
        return chance.randint(max(t.low, -3), min(t.high, 3))
    assert isinstance(t, EnumType)
    return chance.randrange(len(t.members))


def read_at_random(topic: Topic, chance: random.Random) -> Any:
    bounds = iter(topic.bounds)

    def build(t: Any) -> Any:
        if hasattr(t, "fields"):
            return tuple(build(f) for _, f in t.fields)
        if hasattr(t, "element"):
            count = t.size if hasattr(t, "size") else chance.randint(0, t.capacity)
            return tuple(build(t.element) for _ in range(count))
        bound = next(bounds, None)
        low, high = (bound.low, bound.high) if bound else (-5.0, 40.0)
        return random_value(t, chance, low, high)

    return build(topic.type)


@pytest.mark.parametrize(
    "file",
    ["wall/cart.soter", "drone/motion_primitive.soter", "drone/corridor.soter", "drone/goto.soter"],
)
@pytest.mark.random
def test_a_distance_has_the_sign_of_its_predicate(file: str) -> None:
    flat_ = load(EXAMPLES / file).flat()
    chance = random.Random(seed_of(7))  # noqa: S311
    for module in flat_.modules:
        evaluator = Evaluator.for_scope(module.scope)
        for predicate in module.symbol.predicates:
            margin, truth = (
                PredicateMargins(evaluator).distance_of(predicate),
                evaluator.compiled(predicate),
            )
            both = set()
            for _ in range(examples(300)):
                env = Environment(topics=[read_at_random(t, chance) for t in flat_.topics])
                try:
                    holds = truth(env)
                except StepFault:
                    continue
                far = margin(env).far
                assert far >= 0.0 if holds else far <= 0.0
                both.add(holds)
            assert both


CONDITIONS = """soter 1;
type Seen = { x: float, y: float, n: int, b: bool };
topic seen: Seen;
topic push: float in [-1.0, 1.0];
fun Steps(s: Seen): bool {
  for i in 0..3 {
    if s.x > float(i) && s.x < float(i) + 0.5 { return false; }
  }
  if s.b { return s.y < 2.0; } elseif s.n > 2 { return true; }
  let twice = 2.0 * s.y;
  return twice < 3.0 || s.x < -1.0;
}
node A period 10ms { publishes push; step { publish push = 0.0; } }
rta M { ac A; sc B; period 10ms; safe Steps(seen); ttf !Steps(seen) || seen.x > 9.0; safer @; }
node B period 10ms { publishes push; step { publish push = 0.0; } }
plant P period 10ms { drives seen = { x: x, y: x, n: 0, b: false }; state x: float; }
system S { p: P; module M; }
"""


def test_no_read_nearer_than_the_distance_decides_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "conditions.soter"
    path.write_text(CONDITIONS.replace("@", "seen.b ? seen.x < 1.0 : seen.y < 1.0"))
    program = load(path)
    assert program.ok, program.diagnostics
    flat_ = program.flat()
    module = flat_.modules[0]
    at = flat_.topic("seen").index
    evaluator = Evaluator.for_scope(module.scope)
    chance = random.Random(seed_of(3))  # noqa: S311
    tried = 0
    for predicate in module.symbol.predicates:
        margin, truth = (
            PredicateMargins(evaluator).distance_of(predicate),
            evaluator.compiled(predicate),
        )
        for _ in range(examples(400)):
            x, y = chance.uniform(-2.0, 11.0), chance.uniform(-1.0, 4.0)
            n, b = chance.randint(0, 4), chance.random() < 0.5
            env = env_of(flat_, at, (x, y, n, b))
            far, holds = abs(margin(env).far), truth(env)
            for _ in range(5):  # `twice` moves twice as fast as y
                dx, dy = (chance.uniform(-1.0, 1.0) * min(far, 9.0) * s for s in (0.999, 0.499))
                other = env_of(flat_, at, (x + dx, y + dy, n, b))
                assert truth(other) == holds, (x, y, n, b, dx, dy)
                tried += 1
    assert tried > 1000


def env_of(flat_: System, at: int, value: Any) -> Environment:
    topics = [t.default for t in flat_.topics]
    topics[at] = value
    return Environment(topics=topics)
