"""Random draws: docs/semantics.md, section Random draws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.language.model.system import Bound
from soter.language.model.types import BOOL, FLOAT, INT, ArrayType, EnumType, IntType, RecordType
from soter.semantics.draws import (
    SeededDraws,
    chosen_value,
    draw_bits,
    draw_float,
    fnv1a_64,
    splitmix64,
    stream_key,
)

GOLDEN = 0x9E3779B97F4A7C15


def test_mix_is_the_finaliser_of_splitmix64() -> None:
    # the published first outputs of SplitMix64 with seed 1234567
    state, outputs = 1234567, []
    for _ in range(5):
        state = (state + GOLDEN) % 2**64
        outputs.append(splitmix64(state))
    assert outputs == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", 0xCBF29CE484222325),
        ("a", 0xAF63DC4C8601EC8C),
        ("foobar", 0x85944171F73967E8),
    ],
)
def test_fnv_gives_the_published_values(text: str, value: int) -> None:
    assert fnv1a_64(text) == value


@given(seed=st.integers(0, 2**64 - 1), index=st.integers(0, 2**62), name=st.text(max_size=8))
def test_bits_are_those_of_unsigned_64_bit_arithmetic(seed: int, index: int, name: str) -> None:
    def finalised(z: np.uint64) -> np.uint64:
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed: np.uint64 = z ^ (z >> np.uint64(31))
        return mixed

    with np.errstate(over="ignore"):
        key = finalised(finalised(np.uint64(seed) + np.uint64(GOLDEN)) ^ np.uint64(fnv1a_64(name)))
        bits = finalised(key + (np.uint64(index) + np.uint64(1)) * np.uint64(GOLDEN))
    assert stream_key(seed, name) == int(key)
    assert draw_bits(seed, name, index) == int(bits)


@given(index=st.integers(0, 10**9), low=st.floats(-1e3, 1e3), width=st.floats(0, 1e3))
def test_floats_are_low_plus_width_times_u(index: int, low: float, width: float) -> None:
    high = low + width
    u = (draw_bits(3, "s", index) >> 11) * 2.0**-53
    assert 0.0 <= u < 1.0
    assert draw_float(3, "s", index, low, high) == low + (high - low) * u


def test_every_leaf_draws_from_its_own_stream() -> None:
    t = RecordType((("p", ArrayType(FLOAT, 2)), ("n", IntType(0, 9)), ("b", BOOL)))
    bounds = [Bound(0.0, 1.0), Bound(-1.0, 0.0), Bound(2, 4), None]
    drawn = chosen_value(t, bounds, SeededDraws(5), "base", 7)
    assert drawn == (
        (
            draw_float(5, "base.p.[0]", 7, 0.0, 1.0),
            draw_float(5, "base.p.[1]", 7, -1.0, 0.0),
        ),
        2 + draw_bits(5, "base.n", 7) % 3,
        draw_bits(5, "base.b", 7) >= 2**63,
    )


def test_scalars_draw_from_the_base_stream() -> None:
    colour = EnumType("Colour", ("R", "G", "B"))
    assert chosen_value(colour, [None], SeededDraws(1), "c", 0) == draw_bits(1, "c", 0) % 3
    assert (
        chosen_value(IntType(-2, 2), [None], SeededDraws(1), "c", 0)
        == -2 + draw_bits(1, "c", 0) % 5
    )
    assert chosen_value(INT, [None], SeededDraws(1), "c", 0) == -(2**63) + draw_bits(1, "c", 0)


def test_no_draw_depends_on_another() -> None:
    alone = draw_bits(1, "wind", 9)
    for index in range(9):
        draw_bits(1, "wind", index)
        draw_bits(1, "other", index)
    assert draw_bits(1, "wind", 9) == alone
