"""Linear combinations of forms cancel: the drone's predictor coordinates come back exactly.

The lag behind the drone's gate is undone by the functions `Ahead` and `Remaining`, here as in
examples/drone. A state given in the coordinates (q1, q2, q3, w, p) of docs/drone.md, written as p,
v, a, j, s, must give back q3 and w, however large the box: intervals would be many times too wide.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

import pytest

from generators.python_enclosures import INPUTS, Compiled, enclosure
from soter.core.lower_statements import FunctionTable
from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from pathlib import Path

    from generators.python_enclosures import Statics

PROGRAM = """soter 1;
const BAND: float = 7.25;
const FAST: float = 80.5;
const T: float = 2.0 / BAND + 1.0 / FAST;
const V_OF_A: float = 2.0 / BAND;
const V_OF_J: float = 1.0 / (BAND * BAND);
const V_OF_S: float = 1.0 / FAST;
const P_OF_A: float = 1.0 / (BAND * BAND) + 2.0 / (BAND * FAST);
const P_OF_J: float = 1.0 / (BAND * BAND * FAST);
type Axes = { p: Vec3, v: Vec3, a: Vec3, j: Vec3, s: Vec3 };
topic tick: float;
fun Remaining(m: Axes): Vec3 { return m.v + V_OF_A * m.a + V_OF_J * m.j + V_OF_S * m.s; }
fun Ahead(m: Axes): Vec3 { return m.p + T * m.v + P_OF_A * m.a + P_OF_J * m.j; }
node Idle period 10ms { publishes tick; step { publish tick = 0.0; } }
system Only { node Idle; }
"""
BAND, FAST = Fraction(7.25), Fraction(80.5)
NAMES = ("p", "v", "a", "j", "s")
AXES = 3
COORDINATES = ("q1", "q2", "q3", "w", "p")
WIDTH = 10.0


def inverse() -> dict[str, dict[str, Fraction]]:
    """p, v, a, j, s of an axis as combinations of its coordinates, by exact elimination."""
    b, fast = 1 / BAND, FAST
    total = 2 * b + 1 / fast
    rows: dict[str, dict[str, Fraction | int]] = {
        "q1": {"p": 1, "v": b},
        "q2": {"p": 1, "v": 2 * b, "a": b * b},
        "q3": {"p": 1, "v": total, "a": b * b + 2 * b / fast, "j": b * b / fast},
        "w": {"v": 1, "a": 2 * b, "j": b * b, "s": 1 / fast},
        "p": {"p": 1},
    }
    matrix = [
        [Fraction(rows[c].get(n, 0)) for n in NAMES] + [Fraction(c == d) for d in COORDINATES]
        for c in COORDINATES
    ]
    size = len(NAMES)
    for k in range(size):
        pivot = next(r for r in range(k, size) if matrix[r][k])
        matrix[k], matrix[pivot] = matrix[pivot], matrix[k]
        matrix[k] = [x / matrix[k][k] for x in matrix[k]]
        for r in range(size):
            if r != k:
                factor = matrix[r][k]
                matrix[r] = [x - factor * y for x, y in zip(matrix[r], matrix[k], strict=True)]
    return {n: dict(zip(COORDINATES, matrix[k][size:], strict=True)) for k, n in enumerate(NAMES)}


def fill(forms: Any, rows: dict[str, dict[str, Fraction]]) -> None:
    """A box of the x axis in its coordinates; the other axes are zero."""
    for k, name in enumerate(NAMES):
        form = forms[AXES * k]
        slopes = [float(rows[name][c] * Fraction(WIDTH)) for c in COORDINATES]
        reach = sum(abs(x) for x in slopes) * (1 + 1e-12)
        form.lo, form.hi, form.c, form.r = -reach, reach, 0.0, 0.0
        for i, slope in enumerate(slopes):
            form.g[i] = slope


@pytest.mark.parametrize(("function", "coordinate"), [("Ahead", "q3"), ("Remaining", "w")])
def test_predictor_coordinates_come_back(function: str, coordinate: str, tmp_path: Path) -> None:
    system = system_of(check_file("predictor.soter", PROGRAM), None)
    table = FunctionTable(system)
    statics: Statics = {}
    lowered = table.lowered_function(system.program.funs[function], {})
    made = enclosure("soter_f0", table.by_name, lowered, statics)
    compiled = Compiled([made], statics, tmp_path)
    forms = compiled.inputs([(0.0, 0.0)] * INPUTS)
    fill(forms, inverse())
    out, fault = compiled.result_of(made, forms)
    assert fault == 0
    x = out[0]
    wanted = [WIDTH if c == coordinate else 0.0 for c in COORDINATES]
    assert [x.g[i] for i in range(len(wanted))] == pytest.approx(wanted, abs=1e-10)
    assert x.r < 1e-11
    assert x.hi - x.lo == pytest.approx(2 * WIDTH, abs=1e-9)
