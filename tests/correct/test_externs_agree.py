"""Programs with externs: whatever Python answers, both engines give the same bytes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar

import pytest

from generators.engine_comparison import Subject, first_difference
from soter.language.front_end import check_file, system_of
from soter.native.compiler import WARNINGS
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.language.model.system import System

UNTIL_NS = 5 * 10**9

PROGRAM = """soter 1;
topic motion : { x: float, double: int in [0, 9] };
topic accel : float in [-3.0, 3.0] = 0.0;
topic double : int in [0, 100] = 0;
type Pair = { a: bool, b: float[<=2] };
topic extra : Pair;
extern plant Cart period 5ms {
  reads accel;
  drives motion = { x: x + w, double: n };
  state x: float = 0.0;
  state n: int in [0, 9];
  disturbance w: float in [-0.1, 0.1];
  measured motion.x within 0.02;
}
extern node Learned period 10ms BINDING {
  subscribes motion; publishes accel, double;
  var k: int in [0, 200] = 3;
  var spare: float[2];
  on takeover { k = min(k + 1, 150); spare[1] = -spare[0]; TAKEOVER }
}
extern node Helper period 15ms {
  subscribes double; publishes extra;
  failsafe extra = { a: true, b: [1.0] };
}
node Careful period 10ms {
  subscribes motion; publishes accel, double;
  var seen: int;
  on takeover { seen = seen + 1; }
  step { publish accel = clamp(-motion.x, -3.0, 3.0); publish double = min(seen, 100); }
}
rta Guard {
  ac Learned; sc Careful; period 20ms; clean 2;
  safe true; ttf motion.x > 0.4; safer motion.x < 0.3;
}
system S { c: Cart; module Guard; node Helper; until 5s; always c.truth.x < 2.0; }
"""


class Cart:
    """Oscillates; leaves states out now and then; gives a NaN late, which latches it."""

    def reset(self, _seed: int) -> None:
        self.t = 0

    def step(self, inputs: Any) -> dict[str, object]:
        self.t += 1
        if self.t == 900:
            return {"x": math.nan}
        x = inputs.state.x + 0.005 * inputs.accel + 0.02 * math.sin(self.t * 0.02)
        return {"x": x, "n": self.t % 10} if self.t % 50 else {"x": x}


class Learned:
    """Gives every kind of bad answer in turn, most of the time a good one."""

    BAD: ClassVar[dict[int, object]] = {
        9: {"accel": 7.0, "double": 1},
        12: {"accel": math.inf, "double": 1},
        15: {"accel": 1.0, "double": 1000},
        18: {"accel": "no", "double": 1},
        20: {"double": 1},
        21: None,
        22: {"double": True},
        23: {"accel": 1, "double": 2.5},
        24: {"nonsense": 1.0},
        25: 3.0,
        26: {"accel": -0.0, "double": 0},
    }

    def reset(self, _seed: int) -> None:
        self.t = 0

    def step(self, _inputs: Any) -> object:
        self.t += 1
        turn = self.t % 37
        if turn == 5:
            msg = "mishap"
            raise ValueError(msg)
        return self.BAD.get(turn, {"accel": 1.0, "double": self.t % 100})


class Helper:
    """A trusted extern that fails for good after a while."""

    def reset(self, _seed: int) -> None:
        self.t = 0

    def step(self, inputs: Any) -> dict[str, object]:
        self.t += 1
        many = self.t > 150
        return {"extra": {"a": inputs.double > 3, "b": [1.0] * (3 if many else self.t % 3)}}


def flat(text: str, folder: Path) -> System:
    checked = check_file(str(folder / "externs.soter"), text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    return system_of(checked, None)


@pytest.fixture(scope="module", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOTER_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.mark.parametrize("takeover", ["", "assert spare[0] == 0.0;", "assert k != 7;"])
def test_engines_agree_whatever_python_answers(takeover: str, tmp_path: Path) -> None:
    system = flat(PROGRAM.replace("BINDING", "").replace("TAKEOVER", takeover), tmp_path)
    bound = {"c": Cart(), "Guard.Learned": Learned(), "Helper": Helper()}
    one = NativeProgram(system, "-O2", WARNINGS).run(UNTIL_NS, 7, bound, keep_trace=True)
    other = run_interpreted(system, UNTIL_NS, 7, bound, keep_trace=True)
    assert one.trace is not None
    assert other.trace is not None
    s = Subject("externs", "", system, one.layout, UNTIL_NS, 7)
    rows = [t.view("u1").reshape(len(t), -1) for t in (one.trace, other.trace)]
    assert first_difference(s, *rows) is None
    assert set(one.trace["components"]["last_fault"].ravel()) == (
        {0, 5, 7, 8, 9} if "!=" in takeover else {0, 7, 8, 9}
    )
    assert one.modules["Guard"].switches_to_ac > 9


LINKED = """#include "externs.h"
int learned(const externs_Guard_Learned_in *in, externs_Guard_Learned_local *local,
            externs_Guard_Learned_out *out) {
  local->k = (uint8_t)(local->k < 200U ? local->k + 1U : 200U);
  local->spare.at[0] = in->motion.x - in->motion.x + (local->k > 100 ? (double)NAN : 0.5);
  out->accel = 2.0;
  out->has_accel = 1;
  out->double_ = (int8_t)(local->k % 100U);
  out->has_double = 1;
  return in->motion.double_ == 4;
}
"""


def test_a_linked_function_gets_and_keeps_the_locals(tmp_path: Path) -> None:
    (tmp_path / "learned.c").write_text(LINKED)
    text = PROGRAM.replace("BINDING", 'from "c:learned.c:learned"').replace("TAKEOVER", "")
    system = flat(text, tmp_path)
    program = NativeProgram(system, "-O1", WARNINGS)
    run = program.run(UNTIL_NS, 7, {"c": Cart(), "Helper": Helper()}, keep_trace=True)
    assert run.trace is not None
    local = run.trace["Guard.Learned"]
    assert run.modules["Guard"].gate_faults > 0
    assert local["k"][0] == 5, "3 at first, one more at takeover or not, one more in the function"
    assert local["k"].max() > 100
    nan = local["spare"][local["k"] > 110][:, 0]
    assert set(nan.view("u8")) == {0x7FF8000000000000}, "NaN is stored in one form only"
