"""Small systems from text, and one system of one module that most tests start from."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import pytest

from soter.language.front_end import check_file, system_of
from soter.semantics.interpreter import Interpreter

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import System

ONE_MODULE = """
input topic x: float in [-100.0, 100.0] max_age 50ms;
topic u: float in [-1.0, 1.0];
topic v: float in [0.0, 9.0];

node Ac period 10ms {
  subscribes x; publishes u, v;
  var steps: int; var taken: int;
  on takeover { taken = taken + 1; }
  step { steps = steps + 1; publish u = x; if x >= 0.0 { publish v = 1.0; } }
}
node Sc period 10ms {
  subscribes x; publishes u, v; failsafe u = -1.0; failsafe v = 0.5;
  var steps: int;
  step { steps = steps + 1; publish u = 0.0; publish v = 1.0 / (x + 5.0); }
}
rta M {
  ac Ac; sc Sc; period 20ms; clean 2;
  safe true;
  ttf x > 50.0 || 1.0 / (x - 40.0) > 1e9;
  safer 1.0 / (x - 30.0) < 1.0;
}
system S default { module M; until 1s; always x < 90.0; never u > 0.5; }
system ForcedAc { module M; force M ac; until 1s; }
system ForcedSc { module M; force M sc; until 1s; }
"""


@lru_cache(maxsize=128)
def system_from(text: str, name: str | None) -> System:
    checked = check_file("test.soter", "soter 1;\n" + text)
    return system_of(checked, name)


@pytest.fixture
def build() -> Callable[..., Interpreter]:
    """`build(text, system=None, seed=0, externs=None)` gives an interpreter."""

    def make(text: str = ONE_MODULE, system: str | None = None, **options: Any) -> Interpreter:
        return Interpreter(system_from(text, system), **options)

    return make
