"""The float32 of an end of a topic's set is that end, wherever numbers come from outside.

A float32 further out is outside, as a float64 further out is; one that lies inside stays itself.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.system import Bound
from soter.policy.network import Affine, Clipped, Network, Policy
from soter.policy.soter_source import soter_source
from soter.remote.topics import Topic

if TYPE_CHECKING:
    from pathlib import Path

BOUNDS = [0.1, 0.2, 0.3, 0.7, 1.5, 1e-40, 1e300, 16777217.0]
"""Float32 has 0.1, 0.2 and 0.3 further out, 0.7 further in, 1.5 itself; 1e300 is none."""
PROGRAM = """soter 1;
type Two = {{ x: float, y: float }};
topic one: float in [-{0}, {0}] = 0.0;
topic two: Two in {{ x in [-{0}, 9.0], y in [0.0, {0}] }} = {{ x: 0.0, y: 0.0 }};
topic row: Two[2] in [-{0}, {0}];
topic some: float[<=3] in [-{0}, {0}];
extern node Odd period 10ms from "{1}" {{ publishes one, two, row, some; }}
system S {{
  node Odd;
  until 100ms;
  always time < 0.05 || (one == {2} && two.x == -{2} && two.y == {2} && row[1].x == -{2}
    && row[0].y == {2} && some.len == 2 && some[1] == {2});
}}
"""
PYTHON = """import numpy as np

def Odd(_):
    x = np.float32({0})
    x = {1}
    return {{"one": x, "two": (-x, x), "row": [(0.0, x), (-x, 0.0)], "some": [0.0, float(x)]}}
"""
C = """#include <math.h>
#include <string.h>
#include "p.h"
int odd_step(const p_Odd_in *in, p_Odd_out *out) {{
  float x = (float){0};
  x = {1};
  (void)in;
  memset(out, 0, sizeof *out);
  out->one = x; out->two.x = -x; out->two.y = x;
  out->row.at[0].y = x; out->row.at[1].x = -x;
  out->some.len = 2; out->some.items[1] = x;
  out->has_one = 1; out->has_two = 1; out->has_row = 1; out->has_some = 1;
  return 0;
}}
"""
FURTHER = {"python": "np.nextafter(x, np.float32(np.inf))", "c": "nextafterf(x, INFINITY)"}


def violations(folder: Path, kind: str, bound: float, expected: float, change: str) -> int:
    """Of a run, which both engines have alike; a fault of the node is one."""
    code, name = (PYTHON, "odd.py:Odd") if kind == "python" else (C, "odd.c:odd_step")
    text = PROGRAM.format(bound, f"{kind}:{name}", repr(expected))
    (folder / "p.soter").write_text(text, encoding="utf-8")
    (folder / name.partition(":")[0]).write_text(code.format(bound, change), encoding="utf-8")
    runs = [
        soter.load(folder / "p.soter").simulate(engine=engine) for engine in ("native", "interp")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert runs[0].violations == runs[1].violations
    return runs[0].violations


@pytest.mark.parametrize("kind", FURTHER)
@pytest.mark.parametrize("bound", [0.1, 0.7])
def test_the_float32_of_an_end_is_that_end(tmp_path: Path, kind: str, bound: float) -> None:
    inside = float(np.float32(bound)) < bound
    expected = float(np.float32(bound)) if inside else bound
    assert violations(tmp_path, kind, bound, expected, "x") == 0


@pytest.mark.parametrize("kind", FURTHER)
@pytest.mark.parametrize("bound", [0.1, 0.7, 1.5])
def test_a_float32_further_out_is_outside(tmp_path: Path, kind: str, bound: float) -> None:
    assert violations(tmp_path, kind, bound, bound, FURTHER[kind]) > 0


@pytest.mark.parametrize("end", BOUNDS)
def test_how_far_beyond_an_end_is_that_end(end: float) -> None:
    """As NumPy rounds; nothing where float32 has the end itself, has it inside, or has none."""
    with np.errstate(over="ignore"):
        single = float(np.float32(end))
    beyond = single if math.isfinite(single) and single > end else end
    assert Bound(-end, end).float32_ends == (-beyond, beyond)
    assert Bound(end, 2.0 * end).float32_ends[0] == (min(end, single))


def test_a_remote_value_is_taken_alike() -> None:
    topic = soter_topic(Bound(-0.1, 0.1))
    at = np.float32(0.1)
    assert topic.value(topic.image(at, clip=False)) == 0.1
    assert topic.value(topic.image(-at, clip=False)) == -0.1
    with pytest.raises(SoterError, match="is not in"):
        topic.image(np.nextafter(at, np.float32(1.0)), clip=False)


def soter_topic(bound: Bound) -> Topic:
    from soter.language.model.types import FloatType

    ends = ((bound.low, bound.high),)
    return Topic("x", "x", 0, True, FloatType(), ends)


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_a_policy_that_is_written_as_soter_keeps_to_its_bounds(tmp_path: Path, engine: str) -> None:
    """Its clip is to 0.1, as the topic's set is, and not to what float32 has of it."""
    end = np.array([0.1], np.float32)
    layer = Affine(np.array([[5.0]], np.float32), np.zeros(1, np.float32))
    network = Network(1, (layer, Clipped(-end, end)))
    (tmp_path / "net.soter").write_text(soter_source(Policy("net", network), []))
    (tmp_path / "p.soter").write_text(
        """soter 1;
import "net.soter" as net;
topic x: float;
topic u: float in [-0.1, 0.1];
plant P period 10ms { reads u; drives x = p; state p: float = -1.0; der p = 9.0 + u; }
node L period 10ms { subscribes x; publishes u; step { let a = net.act([x]); publish u = a[0]; } }
system S { p: P; node L; until 1s; always time < 0.9 || u == 0.1; }
"""
    )
    assert soter.load(tmp_path / "p.soter").simulate(engine=engine).violations == 0
