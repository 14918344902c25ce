"""A C function that answers outside its types: the fault `extern`, on both engines alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
type Colour = enum { Red, Green, Blue };
type Mixed = { on: bool, level: float, few: int in [0, 5] };
topic colour: Colour;
topic few: int in [0, 5];
topic items: float[<=3] in [-9.0, 9.0];
topic mixed: Mixed in { level in [-1.0, 1.0] };
extern node Odd period 10ms from "c:odd.c:odd_step" { publishes colour, few, items, mixed; }
extern fun pick(x: float): Colour from "c:odd.c:pick";
topic chosen: bool;
node Pick period 10ms {
  publishes chosen;
  step { publish chosen = pick(1.0) == Colour.Blue; }
}
system S { node Odd; node Pick; until 100ms; always true; }
"""
CODE = """#include <string.h>
#include "p.h"
int odd_step(const p_Odd_in *in, p_Odd_out *out) {
  (void)in;
  memset(out, 0x5a, sizeof *out);
  out->colour = 1; out->few = 3; out->items.len = 2;
  out->items.items[0] = 1.0; out->items.items[1] = 2.0; out->items.items[2] = 77.0;
  out->mixed.on = 7; out->mixed.level = 0.5; out->mixed.few = 2;
  out->has_colour = 1; out->has_few = 1; out->has_items = 1; out->has_mixed = 1;
  CHANGE
  return 0;
}
PICK
"""
GOOD_PICK = "uint8_t pick(double x) { return x > 0.0 ? 2 : 0; }"
CHANGES = {
    "nothing wrong": ("", 0),
    "enum": ("out->colour = 7;", 1),
    "int": ("out->few = 9;", 1),
    "length": ("out->items.len = 7;", 1),
    "negative length": ("out->items.len = -1;", 1),
    "field": ("out->mixed.few = 200;", 1),
    "set": ("out->mixed.level = 3.0;", 1),
    "return code": ("return 5;", 1),
    "nothing given": ("memset(out, 0, sizeof *out);", 0),
}


def run_both(folder: Path, change: str, pick: str) -> tuple[int, ...]:
    (folder / "p.soter").write_text(PROGRAM)
    (folder / "odd.c").write_text(CODE.replace("CHANGE", change).replace("PICK", pick))
    runs = [
        soter.load(folder / "p.soter").simulate(engine=engine, trace=False)
        for engine in ("native", "interp")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    return tuple(r.violations for r in runs)


@pytest.mark.parametrize("name", CHANGES)
def test_an_answer_of_a_c_node_is_taken_alike(name: str, tmp_path: Path) -> None:
    change, violations = CHANGES[name]
    assert run_both(tmp_path, change, GOOD_PICK) == (violations, violations)


def test_a_result_of_a_c_function_outside_its_type_is_a_fault(tmp_path: Path) -> None:
    pick = "uint8_t pick(double x) { return x > 0.0 ? 7 : 0; }"
    assert run_both(tmp_path, "", pick) == (1, 1)
