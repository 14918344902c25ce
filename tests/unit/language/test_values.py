"""Values across the border to Python and JSON."""

from __future__ import annotations

import enum
import json
import math
from collections import namedtuple
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.language.model.types import (
    BOOL,
    DURATION,
    FLOAT,
    INT,
    INT_MAX,
    INT_MIN,
    ArrayType,
    EnumType,
    IntType,
    ListType,
    RecordType,
    Type,
    Value,
)
from soter.language.model.values import (
    ValueShapeError,
    from_json,
    from_python,
    inputs_to_python,
    outputs_from_python,
    to_json,
    to_python,
)
from tables import all_rows

VEC = RecordType((("x", FLOAT), ("y", FLOAT)), "Vec")
POSE = RecordType((("p", VEC), ("n", INT)), "Pose")
COLOUR = EnumType("Colour", ("RED", "GREEN"))


def types(depth: int = 2) -> st.SearchStrategy[Type]:
    scalars = st.sampled_from([BOOL, INT, FLOAT, DURATION, COLOUR, IntType(-3, 7)])
    if depth == 0:
        return scalars
    inner = types(depth - 1)
    return st.one_of(
        scalars,
        st.builds(ArrayType, inner, st.integers(1, 3)),
        st.builds(ListType, inner, st.integers(1, 3)),
        st.lists(inner, min_size=1, max_size=3).map(
            lambda ts: RecordType(tuple((f"f{i}", t) for i, t in enumerate(ts)))
        ),
    )


def values(t: Type) -> st.SearchStrategy[Value]:
    if t == BOOL:
        return st.booleans()
    if t == FLOAT:
        return st.floats(width=64)
    if t == COLOUR:
        return st.integers(0, 1)
    if isinstance(t, RecordType):
        return st.tuples(*[values(f) for _, f in t.fields])
    if isinstance(t, ArrayType):
        return st.tuples(*[values(t.element)] * t.size)
    if isinstance(t, ListType):
        return st.lists(values(t.element), max_size=t.capacity).map(tuple)
    low, high = (t.low, t.high) if isinstance(t, IntType) else (INT_MIN, INT_MAX)
    return st.integers(low, high)


@given(data=st.data(), t=types())
def test_python_and_back_is_the_same_value(data: st.DataObject, t: Type) -> None:
    value = data.draw(values(t))
    assert repr(from_python(t, to_python(t, value))) == repr(value)


@given(data=st.data(), t=types())
def test_json_text_and_back_is_the_same_value(data: st.DataObject, t: Type) -> None:
    value = data.draw(values(t))
    text = json.dumps(to_json(t, value), allow_nan=False)
    assert repr(from_json(t, json.loads(text))) == repr(value)


# ---------------------------------------------------------------- what Python programmers see


def test_records_are_namespaces_and_enums_are_names() -> None:
    pose = to_python(POSE, ((1.0, 2.0), 3))
    assert (pose.p.x, pose.p.y, pose.n) == (1.0, 2.0, 3)
    assert to_python(COLOUR, 1) == "GREEN"


def test_arrays_of_floats_are_numpy_and_nest_into_dimensions() -> None:
    matrix = to_python(ArrayType(ArrayType(FLOAT, 2), 3), ((1.0, 2.0), (3.0, 4.0), (5.0, 6.0)))
    assert isinstance(matrix, np.ndarray)
    assert matrix.shape == (3, 2)
    assert matrix.dtype == np.float64
    assert to_python(ListType(ArrayType(FLOAT, 2), 4), ()).shape == (0, 2)


def test_other_arrays_are_lists() -> None:
    assert to_python(ArrayType(INT, 2), (1, 2)) == [1, 2]
    assert to_python(ListType(COLOUR, 4), (0, 1)) == ["RED", "GREEN"]


# ---------------------------------------------------------------- what they may give

Named = namedtuple("Named", "y x")  # noqa: PYI024  the untyped one is what users have


class Slotted:
    __slots__ = ("x", "y")

    def __init__(self) -> None:
        self.x, self.y = 1, 2


@pytest.mark.parametrize(
    "given_record",
    [
        {"y": 2, "x": 1},
        SimpleNamespace(x=1, y=2, extra="not looked at"),
        Slotted(),
        Named(y=2, x=1),
        (1, 2),
        [1.0, np.float32(2)],
        np.array([1, 2]),
        np.array([1.0, 2.0], dtype=np.float32),
    ],
)
def test_a_record_comes_as_mapping_object_or_sequence(given_record: object) -> None:
    assert from_python(VEC, given_record) == (1.0, 2.0)


@pytest.mark.parametrize("number", [1, 1.0, True, np.float32(1), np.int8(1), np.array(1.0)])
def test_a_float_is_anything_with_float(number: object) -> None:
    result = from_python(FLOAT, number)
    assert (type(result), result) == (float, 1.0)


def test_nan_and_infinity_have_the_right_shape() -> None:
    assert math.isnan(from_python(FLOAT, np.nan))
    assert from_python(FLOAT, math.inf) == math.inf


def test_an_int_is_anything_with_index() -> None:
    assert from_python(INT, np.int32(5)) == 5
    assert type(from_python(INT, np.int32(5))) is int


class Hostile:
    def __float__(self) -> float:
        raise RuntimeError("no number today")

    def __index__(self) -> int:
        raise RuntimeError("no int today")


class Colour(enum.Enum):
    RED = 0


WRONG: list[tuple[Type, Any, str, str]] = [
    (
        FLOAT,
        np.array([1.0]),
        "",
        "expected a number, found a sequence of 1: give its one element, `float(y[0])`",
    ),
    (FLOAT, "1.0", "", "expected a number, found '1.0'"),
    (FLOAT, None, "", "expected a number, found None"),
    (FLOAT, 1j, "", "expected a number, found a `complex`"),
    (FLOAT, 10**400, "", "expected a number, but int too large to convert to float"),
    (FLOAT, Hostile(), "", "expected a number, but no number today"),
    (INT, 1.0, "", "expected an int, found 1.0"),
    (INT, True, "", "expected an int, found True"),
    (INT, 2**63, "", f"{2**63} is outside [{INT_MIN}, {INT_MAX}]"),
    (INT, Hostile(), "", "expected an int, but no int today"),
    (IntType(0, 9), 10, "", "10 is outside [0, 9]"),
    (BOOL, 1, "", "expected a bool, found 1"),
    (COLOUR, "BLUE", "", "expected one of 'RED', 'GREEN', found 'BLUE'"),
    (COLOUR, Colour.RED, "", "expected one of 'RED', 'GREEN', found a `Colour`"),
    (VEC, {"x": 1}, "", "field `y` is missing"),
    (VEC, {"x": 1, "y": 2, "z": 3}, "", "there is no field `z`"),
    (VEC, (1, 2, 3), "", "expected 2 elements for `Vec`, found 3"),
    (VEC, SimpleNamespace(x=1), "", "expected `Vec`, found a `SimpleNamespace`"),
    (VEC, "xy", "", "expected `Vec`, found 'xy'"),
    (POSE, {"p": (1, "a"), "n": 0}, "p.y", "expected a number, found 'a'"),
    (ArrayType(FLOAT, 2), [1.0], "", "expected 2 elements for `float[2]`, found 1"),
    (ArrayType(FLOAT, 2), {0: 1.0}, "", "expected a sequence for `float[2]`, found a `dict`"),
    (ListType(VEC, 1), [(1, 2), (3, 4)], "", "at most 1 elements fit `Vec[<=1]`, found 2"),
    (ListType(VEC, 2), [(1, 2), (3,)], "[1]", "expected 2 elements for `Vec`, found 1"),
]


@all_rows(("t", "wrong", "path", "reason"), WRONG)
def test_a_wrong_shape_says_where_and_why(t: Type, wrong: object, path: str, reason: str) -> None:
    with pytest.raises(ValueShapeError) as caught:
        from_python(t, wrong)
    assert (caught.value.path, caught.value.reason) == (path, reason)


def test_json_is_stricter_than_python() -> None:
    for t, wrong in [(FLOAT, True), (VEC, [1, 2]), (INT, 1.0), (ArrayType(INT, 1), "1")]:
        with pytest.raises(ValueShapeError):
            from_json(t, wrong)


def test_json_has_words_for_what_it_cannot_write() -> None:
    assert to_json(ArrayType(FLOAT, 3), (math.inf, -math.inf, math.nan)) == [
        "Infinity",
        "-Infinity",
        "NaN",
    ]


# ---------------------------------------------------------------- extern steps


def test_inputs_have_one_attribute_a_topic() -> None:
    inputs = inputs_to_python([("pose", VEC, (1.0, 2.0)), ("on", BOOL, True)])
    assert (inputs.pose.y, inputs.on) == (2.0, True)


def test_outputs_come_by_name_and_may_be_left_out() -> None:
    named = [("a", FLOAT), ("b", VEC)]
    assert outputs_from_python(named, {"b": (1, 2), "a": 3}) == [3.0, (1.0, 2.0)]
    assert outputs_from_python(named, {"a": 3, "b": None}) == [3.0, None]
    assert outputs_from_python(named, {}) == [None, None]
    assert outputs_from_python(named, None) == [None, None]


def test_a_single_output_may_be_given_bare() -> None:
    assert outputs_from_python([("a", FLOAT)], 2) == [2.0]
    assert outputs_from_python([("a", FLOAT)], {"a": 2}) == [2.0]
    assert outputs_from_python([("v", VEC)], {"x": 1, "y": 2}) == [(1.0, 2.0)]
    assert outputs_from_python([("v", VEC)], {"v": {"x": 1, "y": 2}}) == [(1.0, 2.0)]
    assert outputs_from_python([("v", VEC)], {}) == [None]


@pytest.mark.parametrize(
    ("given_outputs", "where"), [(3.0, ""), ({"c": 1}, ""), ({"a": "one"}, "a"), ([1, 2], "")]
)
def test_outputs_of_the_wrong_shape_are_refused(given_outputs: object, where: str) -> None:
    with pytest.raises(ValueShapeError) as caught:
        outputs_from_python([("a", FLOAT), ("b", FLOAT)], given_outputs)
    assert caught.value.path == where
