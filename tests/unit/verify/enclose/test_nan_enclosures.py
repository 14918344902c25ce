"""What is enclosed of `ttf` and `safer` is what the DM finds, where a NaN is compared, too."""

from __future__ import annotations

import random

import pytest

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates import PredicateEvaluator
from soter.language.front_end import check_file, system_of
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.problem.extract import extract

TEXT = """soter 1;
topic y: {{ a: float, b: float }} max_age 20ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period 5ms {{
  reads u;
  drives y = {{ a: a, b: b }};
  state a: float;
  state b: float;
  der a = u;
  der b = -1.0 * b;
}}
node Ac period 10ms {{ publishes u; step {{ publish u = 1.0; }} }}
node Sc period 10ms {{
  subscribes y; publishes u;
  step {{ publish u = clamp(-y.a, -1.0, 1.0); }}
}}
fun need(x: float): float {{ return max(1.0, sqrt(x)); }}
fun fits(x: float): bool {{ if acos(x / 4.0) > 1.0 {{ return false; }} return true; }}
rta M {{
  ac Ac; sc Sc; period 50ms;
  safe abs(y.a) < 9.0 && abs(y.b) < 9.0;
  ttf {ttf};
  safer {safer};
  verify {{ grid y.a in [-9.0, 9.0] / 9, y.b in [-9.0, 9.0] / 9; }}
}}
system S {{ p: P; module M; until 1s; }}
"""
CASES = [
    ("need(y.a) > 2.0 && y.b > 0.0", "sqrt(y.a) > 9.0 || y.b < 3.0"),
    ("y.b > 1.0 && !(log(y.a) < 0.0)", "y.b > 3.0 || !(sqrt(y.a) == y.b)"),
    ("!fits(y.a) || y.b > 3.0", "fits(y.a) || y.b < 3.0"),
]


@pytest.mark.parametrize(("ttf", "safer"), CASES)
def test_what_is_enclosed_holds_where_a_nan_is_compared(ttf: str, safer: str) -> None:
    text = TEXT.format(ttf=ttf, safer=safer)
    flat = system_of(check_file("nan.soter", text), "S")
    module = flat.modules[0]
    problem = extract(flat, module)
    forms = CompiledEnclosures(library_of(problem)[0], problem, ())
    evaluator = PredicateEvaluator.for_scope(module.scope)
    draw = random.Random(0)  # noqa: S311 - boxes to try, always the same
    y = module.scope.topics[next(iter(module.scope.topics))]
    assert flat.topics[y].name == "y"
    decided = nan = 0
    for name, predicate, unknown in (
        ("ttf", module.symbol.ttf, True),
        ("safer", module.symbol.safer, False),
    ):
        assert predicate is not None
        holds = evaluator.compiled(predicate)
        for _ in range(200):
            box = forms.whole.copy()
            for k in (0, 1):
                low = draw.uniform(-9.0, 8.0)
                box[k] = (low, low + draw.uniform(0.0, 2.0))
            truth = forms.truth(name, box)
            decided += truth != 3
            for _ in range(10):
                topics = [t.default for t in flat.topics]
                topics[y] = (draw.uniform(*box[0]), draw.uniform(*box[1]))
                try:
                    found = bool(holds(Environment(topics=topics)))
                except StepFault:
                    found, nan = unknown, nan + 1
                assert truth & (2 if found else 1), (name, box[:2], topics[y])
    assert decided > 100
    assert nan > 100
