"""What follows from one side of `&&` or `||` is known even where the other is undecided."""

from __future__ import annotations

import pytest

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
fun Low(x: float): bool {{ let shifted = x + 1.0; return shifted < 2.0; }}
rta M {{
  ac Ac; sc Sc; period 50ms;
  safe abs(y.a) < 9.0 && abs(y.b) < 9.0;
  ttf {ttf};
  safer y.a < 0.0;
  verify {{ grid y.a in [-9.0, 9.0] / 9, y.b in [-9.0, 9.0] / 9; }}
}}
system S {{ p: P; module M; until 1s; }}
"""


@pytest.mark.parametrize(
    "ttf",
    [
        "!(Low(y.a) && Low(y.b))",  # a undecided, b not low
        "!Low(y.a) || !Low(y.b)",
        "(Low(y.a) && Low(y.b)) == false",
        "!(Low(y.b) && Low(y.a))",
    ],
)
def test_the_decided_side_decides(ttf: str) -> None:
    flat = system_of(check_file("conjunction.soter", TEXT.format(ttf=ttf)), "S")
    problem = extract(flat, flat.modules[0])
    forms = CompiledEnclosures(library_of(problem)[0], problem, ())
    box = forms.whole.copy()
    box[0], box[1] = (0.5, 1.5), (3.0, 4.0)
    assert forms.is_surely_true("ttf", box)
    box[1] = (-4.0, -3.0)
    assert not forms.is_surely_true("ttf", box)
