"""What the comments in `math.soter` and `vectors.soter` promise outside the ordinary."""

from __future__ import annotations

import math
import struct

import pytest
from soter_functions import SIGNATURES, components, flat_call, soter_function  # type: ignore[import-not-found]

from soter.language.front_end import check_file
from tables import all_rows

INF, NAN, PI = math.inf, math.nan, math.pi
LARGEST = math.nextafter(INF, 0.0)
LEAST = 5e-324

CASES: dict[str, tuple[tuple[float, ...], ...]] = {
    # arguments..., result
    "clamp": (
        (5.0, -1.0, 1.0, 1.0), (-5.0, -1.0, 1.0, -1.0), (0.5, -1.0, 1.0, 0.5),
        (INF, -1.0, 1.0, 1.0), (-INF, -1.0, 1.0, -1.0), (3.0, -INF, INF, 3.0),
        (0.0, 1.0, -1.0, NAN), (0.0, NAN, 1.0, NAN), (0.0, -1.0, NAN, NAN), (NAN, -1.0, 1.0, NAN),
        (2.0, 1.0, 1.0, 1.0),
    ),
    "sign": ((3.0, 1.0), (-LEAST, -1.0), (0.0, 0.0), (-0.0, -0.0), (INF, 1.0), (-INF, -1.0)),
    "lerp": (
        (3.0, 7.0, 0.0, 3.0), (3.0, 7.0, 1.0, 7.0), (3.0, 7.0, 0.5, 5.0), (3.0, 7.0, 2.0, 11.0),
        (0.1, 0.7, 1.0, 0.7), (-LARGEST, LARGEST, 0.5, 0.0), (INF, 1.0, 1.0, NAN),
    ),
    "smoothstep": (
        (0.0, 1.0, -1.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 1.0, 0.5, 0.5), (0.0, 1.0, 2.0, 1.0),
        (1.0, 0.0, 2.0, 0.0), (1.0, 0.0, -1.0, 1.0), (1.0, 1.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0),
        (0.0, 1.0, INF, 1.0), (0.0, 1.0, -INF, 0.0), (0.0, LEAST, LEAST, 1.0),
    ),
    "radians": ((180.0, PI), (90.0, PI / 2), (INF, INF), (-0.0, -0.0)),
    "degrees": ((PI, 180.0), (LARGEST, INF), (-INF, -INF), (-0.0, -0.0)),
    "wrap_angle": (
        (PI, PI), (-PI, PI), (0.0, 0.0), (-0.0, -0.0), (-3.0, -3.0), (1.0e5 + 1.0, NAN), (INF, NAN),
        (-INF, NAN), (2 * PI, -2.4492935982947064e-16),  # TAU is that much short of a turn
    ),
    "sin": ((0.0, 0.0), (-0.0, -0.0), (LEAST, LEAST), (INF, NAN), (-1.1e5, NAN), (PI / 2, 1.0)),
    "cos": ((0.0, 1.0), (-0.0, 1.0), (LEAST, 1.0), (INF, NAN), (-INF, NAN), (1.1e5, NAN)),
    "tan": ((0.0, 0.0), (-0.0, -0.0), (-LEAST, -LEAST), (INF, NAN), (1.1e5, NAN)),
    "asin": ((0.0, 0.0), (-0.0, -0.0), (1.0, PI / 2), (-1.0, -PI / 2), (1.0000001, NAN)),
    "acos": ((1.0, 0.0), (0.0, PI / 2), (-1.0, PI), (-1.0000001, NAN), (-INF, NAN)),
    "atan": ((0.0, 0.0), (-0.0, -0.0), (1.0, PI / 4), (INF, PI / 2), (-INF, -PI / 2)),
    "atan2": (
        (0.0, 0.0, 0.0), (-0.0, 1.0, -0.0), (0.0, -1.0, PI), (-0.0, -1.0, PI), (1.0, 0.0, PI / 2),
        (-1.0, 0.0, -PI / 2), (-1.0, -0.0, -PI / 2), (1.0, 1.0, PI / 4), (-1.0, -1.0, -3 * PI / 4),
        (INF, 1.0, PI / 2), (1.0, INF, 0.0), (1.0, -INF, PI), (INF, INF, PI / 4),
        (-INF, -INF, -3 * PI / 4), (-INF, INF, -PI / 4), (LEAST, LEAST, PI / 4),
        (LARGEST, LARGEST, PI / 4), (-LEAST, -1.0, -PI), (LEAST, LARGEST, 0.0),
    ),
    "exp": (
        (0.0, 1.0), (-0.0, 1.0), (LEAST, 1.0), (1.0, math.e), (INF, INF), (-INF, 0.0),
        (709.79, INF),
        (-745.14, 0.0), (-745.13, LEAST), (LARGEST, INF), (-LARGEST, 0.0),
    ),
    "log": (
        (1.0, 0.0), (0.0, -INF), (-0.0, -INF), (-LEAST, NAN), (-INF, NAN), (INF, INF),
        (LEAST, -744.4400719213812),
    ),
    "pow": (
        (2.0, 10.0, 1024.0), (2.0, -1074.0, LEAST), (2.0, -1075.5, 0.0), (2.0, 1024.0, INF),
        (-2.0, 3.0, -8.0), (-2.0, 2.0, 4.0), (-2.0, 0.5, NAN), (-8.0, 1.0 / 3.0, NAN),
        (0.0, 0.0, 1.0), (INF, 0.0, 1.0), (NAN, 0.0, NAN), (1.0, NAN, NAN), (1.0, INF, 1.0),
        (0.0, 2.0, 0.0), (0.0, 3.0, 0.0), (-0.0, 3.0, -0.0), (-0.0, 2.0, 0.0), (0.0, 0.5, 0.0),
        (0.0, -1.0, INF), (-0.0, -1.0, INF), (0.0, INF, 0.0), (0.0, -INF, INF),
        (2.0, INF, INF), (2.0, -INF, 0.0), (0.5, INF, 0.0), (0.5, -INF, INF), (-1.0, INF, 1.0),
        (-2.0, INF, INF), (-0.5, INF, 0.0), (INF, 2.0, INF), (INF, -2.0, 0.0), (INF, LEAST, INF),
        (-INF, 3.0, -INF), (-INF, 2.0, INF), (-INF, 0.5, INF), (-INF, -3.0, -0.0),
        (-INF, -0.5, 0.0),
        (-1.0, 2.0**53, 1.0), (-1.0, 2.0**53 - 1.0, -1.0), (9.0, 0.5, 3.0), (4.0, -0.5, 0.5),
    ),
    "tanh": ((0.0, 0.0), (-0.0, -0.0), (LEAST, LEAST), (INF, 1.0), (-INF, -1.0), (20.0, 1.0)),
    "hypot": (
        (3.0, 4.0, 5.0), (-3.0, 4.0, 5.0), (0.0, -0.0, 0.0), (0.0, LEAST, LEAST), (INF, 1.0, INF),
        (1.0, -INF, INF), (INF, NAN, NAN), (LARGEST, LARGEST, INF), (LARGEST, 0.0, LARGEST),
        (3.0 * 2.0**-1070, 4.0 * 2.0**-1070, 5.0 * 2.0**-1070), (3e300, 4e300, 5e300),
    ),
    # flattened arguments and results
    "cross": ((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),),
    "unit": (
        (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0),
        (-0.0, 0.0, 0.0, NAN, 0.0, 1.0, NAN, 0.0, 1.0),
        (3.0, 0.0, 4.0, 0.0, 0.0, 1.0, 0.6, 0.0, 0.8),
        (3e300, 0.0, 4e300, 0.0, 0.0, 1.0, 0.6, 0.0, 0.8),
        (LEAST, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0),
        (0.0, LARGEST, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        (INF, 1.0, 0.0, 0.0, 0.0, 1.0, NAN, 0.0, 0.0),
    ),
    "unit2": (
        (0.0, 0.0, 1.0, 0.0, 1.0, 0.0), (0.0, -2.0, 1.0, 0.0, 0.0, -1.0),
        (-LEAST, 0.0, 0.0, 1.0, -1.0, 0.0),
    ),
    "quat_conj": ((1.0, 2.0, -3.0, 0.0, 1.0, -2.0, 3.0, -0.0),),
    "quat_mul": (
        (1.0, 0.0, 0.0, 0.0, 5.0, 6.0, 7.0, 8.0, 5.0, 6.0, 7.0, 8.0),
        (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),  # i j = k
        (0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0),  # j i = -k
    ),
    "quat_normalize": (
        (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -3e-320, 0.0, 0.0, 0.0, -1.0, 0.0),
        (2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
    ),
    # half a turn about z, and none
    "quat_rotate": (
        (0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 3.0, -1.0, -2.0, 3.0),
        (1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 1.0, 2.0, 3.0),
    ),
}  # fmt: skip


def _bits(x: float) -> bytes:
    """All of a float but the payload of a NaN."""
    return struct.pack("<d", NAN if math.isnan(x) else x)


@all_rows(("name", "case"), [(n, c) for n, cases in CASES.items() for c in cases], ids=str)
def test_special_value(name: str, case: tuple[float, ...]) -> None:
    arguments, expected = case[: components(name)], case[components(name) :]
    computed = flat_call(name, arguments)
    assert [_bits(c) for c in computed] == [_bits(e) for e in expected], computed


def test_quarter_turn_about_z_takes_x_to_y() -> None:
    half = math.sqrt(0.5)
    turned = flat_call("quat_rotate", (half, 0.0, 0.0, half, 1.0, 0.0, 0.0))
    assert turned == pytest.approx((0.0, 1.0, 0.0), abs=1e-15)
    back = flat_call("quat_rotate_inverse", (half, 0.0, 0.0, half, 0.0, 1.0, 0.0))
    assert back == pytest.approx((1.0, 0.0, 0.0), abs=1e-15)


@pytest.mark.parametrize("name", ["sin", "tan", "asin", "atan", "tanh", "sign", "radians"])
def test_odd_functions_are_odd_in_every_bit(name: str) -> None:
    function = soter_function(name)
    for k in range(1, 400):
        x = 0.01234 * k * k if name != "asin" else k / 400.0
        assert _bits(function(-x)) == _bits(-function(x))


@all_rows("name", SIGNATURES)
def test_constants_may_call_it(name: str) -> None:
    values = {"float": "0.5", "Vec2": "vec2(0.5, 1.0)", "Vec3": "vec3(0.5, 1.0, 2.0)"}
    values["Quat"] = "quat(0.5, 1.0, 2.0, 3.0)"
    types, result = SIGNATURES[name]
    arguments = ", ".join(values[t] for t in types)
    checked = check_file("c.soter", f"soter 1;\nconst C: {result} = {name}({arguments});\n")
    assert checked.program is not None
    assert not checked.diagnostics.items
