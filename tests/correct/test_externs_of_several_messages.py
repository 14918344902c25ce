"""Externs that publish several messages a step, and extern plants that choose: engines agree."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import soter
from generators.engine_comparison import Subject, first_difference
from soter.language.front_end import check_file, system_of
from soter.native.compiler import WARNINGS
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.simulate.result import Run

UNTIL_NS = 10**9
PROGRAM = """soter 1;
type Note = { n: int in [0, 9], x: float };
topic motion : { x: float, n: int in [0, 9] };
topic notes : Note in { x in [0.0, 10.0] };
topic sum : int in [0, 100000];
extern plant Cart period 10ms {
  drives motion = { x: x + bias, n: choose { n, 9, 0 } };
  state x: float = 0.0;
  state n: int in [0, 9];
  let bias = choose { 0.0, 0.5, 1.0 };
}
extern node Talker period 20ms BINDING { subscribes motion; publishes notes[<=3]; }
node Sums period 70ms {
  subscribes notes queue 5;
  publishes sum;
  var s: int in [0, 100000];
  step {
    for note in notes { s = min(10 * s % 10000 + note.n, 100000); }
    publish sum = s;
  }
}
system S { c: Cart; node Talker; node Sums; until 1s; }
"""


class Cart:
    """Moves on."""

    def reset(self, _seed: int) -> None:
        self.t = 0

    def step(self, inputs: Any) -> dict[str, object]:
        self.t += 1
        return {"x": inputs.state.x + 0.1, "n": self.t % 10}


class Talker:
    """From no message to one too many, at `fails`."""

    def __init__(self, fails: int = 1000, last: object = None) -> None:
        self.fails = fails
        self.last = last

    def reset(self, _seed: int) -> None:
        self.t = 0

    def step(self, inputs: Any) -> object:
        self.t += 1
        if self.t == self.fails:
            return {"notes": self.last}
        note = {"n": self.t % 10, "x": 5.0 + 0.1 * inputs.motion.n}
        return {"notes": [note] * (self.t % 4)} if self.t % 7 else None


NOTE = {"n": 1, "x": 1.0}
FAILURES = {
    "none": (1000, None, 0),
    "four": (30, [NOTE] * 4, 9),
    "one that stands alone": (30, NOTE, 9),
    "the middle one outside of the set": (30, [NOTE, {"n": 1, "x": 11.0}, NOTE], 8),
}


def both(text: str, folder: Path, bound: dict[str, object]) -> Run:
    """The native run, whose bytes are those of the interpreter's."""
    checked = check_file(str(folder / "several.soter"), text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    system = system_of(checked, None)
    one = NativeProgram(system, "-O2", WARNINGS).run(UNTIL_NS, 7, bound, keep_trace=True)
    other = run_interpreted(system, UNTIL_NS, 7, bound, keep_trace=True)
    assert one.trace is not None
    assert other.trace is not None
    s = Subject("several", "", system, one.layout, UNTIL_NS, 7)
    rows = [t.view("u1").reshape(len(t), -1) for t in (one.trace, other.trace)]
    assert first_difference(s, *rows) is None
    return one


@pytest.fixture(scope="module", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOTER_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.mark.parametrize("name", FAILURES)
def test_engines_agree_on_several_messages_of_python(name: str, tmp_path: Path) -> None:
    fails, last, kind = FAILURES[name]
    text = PROGRAM.replace("BINDING", "")
    run = both(text, tmp_path, {"c": Cart(), "Talker": Talker(fails, last)})
    assert run.trace is not None
    assert set(run.trace["components"]["last_fault"].ravel()) == {0, kind}
    assert run.trace["topics"]["sum"].max() > 1000
    biased = run.trace["topics"]["motion"]["x"] - run.trace["c"]["x"]
    assert set(biased.round(1)) == {0.0, 0.5, 1.0}
    assert {0, 9} < set(run.trace["topics"]["motion"]["n"])


LINKED = """#include "several.h"
int talker(const several_Talker_in *in, several_Talker_out *out) {
  int n = in->motion.x > 8.0 ? 4 : (int)(in->motion.x * 7.0) % 4;
  out->has_notes = n != 2;
  out->notes.len = (uint8_t)n;
  for (int i = 0; i < 3; i++) {
    out->notes.items[i].n = (int8_t)(i + 1);
    out->notes.items[i].x = 1.0;
  }
  return 0;
}
"""


def test_engines_agree_on_several_messages_of_c(tmp_path: Path) -> None:
    (tmp_path / "talker.c").write_text(LINKED)
    path = tmp_path / "several.soter"
    path.write_text(PROGRAM.replace("BINDING", 'from "c:talker.c:talker"'))
    program = soter.load(path)
    program.bind("c", Cart())
    runs = [program.simulate(seed=7, engine=engine) for engine in ("native", "interp")]
    assert runs[0].trace is not None
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert set(runs[0].trace["components"]["last_fault"].ravel()) == {0, 9}, "four, in the end"
    assert runs[0].trace["topics"]["sum"].max() > 10
