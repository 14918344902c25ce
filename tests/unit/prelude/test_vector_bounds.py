"""The vector functions stay within the bounds of `bounds.py`, against exact rational arithmetic.

Products are sums of products of doubles, so `fractions` has them exactly; only lengths need mpmath.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import mpmath
import pytest
from exact_functions import PRECISION_BITS, distance, seeded, ulp  # type: ignore[import-not-found]
from mpmath import mpf
from soter_functions import SIGNATURES, VECTORS, components, flat_call  # type: ignore[import-not-found]

from soter.language.prelude.function_error_bounds import BOUNDS, UNIT_ROUNDOFF
from tables import all_rows

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator, Sequence

SAMPLES = 500
EXACT_BY_NATURE = {"vec2", "vec3", "quat"}


def _cross(a: Sequence[Fraction], b: Sequence[Fraction]) -> tuple[Fraction, ...]:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _quat_mul(a: Sequence[Fraction], b: Sequence[Fraction]) -> tuple[Fraction, ...]:
    """(w, v) (w', v') = (w w' - v v', w v' + w' v + v x v')."""
    across = _cross(a[1:], b[1:])
    real = a[0] * b[0] - sum(x * y for x, y in zip(a[1:], b[1:], strict=True))
    imaginary = tuple(a[0] * b[k + 1] + b[0] * a[k + 1] + across[k] for k in range(3))
    return (real, *imaginary)


def _rotate(q: Sequence[Fraction], v: Sequence[Fraction]) -> tuple[Fraction, ...]:
    """v + 2 w (n x v) + 2 n x (n x v): the definition where |q| = 1."""
    n = q[1:]
    once = _cross(n, v)
    twice = _cross(n, once)
    return tuple(v[k] + 2 * q[0] * once[k] + 2 * twice[k] for k in range(3))


def _exact(name: str, flat: Sequence[Fraction]) -> tuple[Fraction, ...]:
    if name == "cross":
        return _cross(flat[:3], flat[3:])
    if name == "quat_mul":
        return _quat_mul(flat[:4], flat[4:])
    if name == "quat_rotate":
        return _rotate(flat[:4], flat[4:])
    conjugate = (flat[0], *(-x for x in flat[1:4]))
    return _rotate(conjugate, flat[4:]) if name == "quat_rotate_inverse" else conjugate


def _length(vector: Sequence[float]) -> mpf:
    return mpmath.sqrt(mpmath.fsum(mpf(x) ** 2 for x in vector))


def _scale(name: str, flat: Sequence[float]) -> mpf:
    """The `scale` of the bound: |a| |b|, or |v|."""
    half = components(name) // 2
    if BOUNDS[name].scale == "|a| |b|":
        return _length(flat[:half]) * _length(flat[half:])
    return _length(flat[4:])


def _random(rng: random.Random, count: int, spread: float) -> list[float]:
    return [rng.gauss(0.0, 1.0) * 10.0 ** rng.uniform(-spread, spread) for _ in range(count)]


def _arguments(name: str) -> Iterator[tuple[float, ...]]:
    rng = seeded(name)
    for k in range(SAMPLES):
        spread = (0.0, 1.0, 30.0)[k % 3]
        flat = _random(rng, components(name), spread)
        if "rotate" in name:
            q = flat_call("quat_normalize", tuple(_random(rng, 4, spread)))
            flat[:4] = q
        yield tuple(flat)


@pytest.mark.parametrize("name", [n for n in VECTORS if n in BOUNDS and not BOUNDS[n].ulps])
def test_products_stay_within_bound(name: str) -> None:
    bound, worst = BOUNDS[name], mpf(0)
    with mpmath.workprec(PRECISION_BITS):
        for flat in _arguments(name):
            allowed = bound.relative * UNIT_ROUNDOFF * (_scale(name, flat) if bound.scale else 0)
            exact = _exact(name, [Fraction(x) for x in flat])
            for computed, value in zip(flat_call(name, flat), exact, strict=True):
                gap = abs(Fraction(computed) - value)
                error = mpf(gap.numerator) / mpf(gap.denominator)
                assert error <= allowed, f"{name}{flat}"
                if allowed:
                    worst = max(worst, error / allowed)
    print(f"{name}: {float(worst):.3f} of the bound")


@pytest.mark.parametrize("name", ["unit", "unit2", "quat_normalize"])
def test_directions_stay_within_bound(name: str) -> None:
    bound, worst = BOUNDS[name], mpf(0)
    size = len(flat_call(name, (1.0,) * components(name)))
    rng = seeded(name)
    with mpmath.workprec(PRECISION_BITS):
        for k, flat in enumerate(_arguments(name)):
            factor = (1.0, 1e300, 1e-300, 1e-320)[k % 4] if max(map(abs, flat)) < 1e8 else 1.0
            scaled = tuple(x * factor for x in flat)
            length = _length(scaled[:size])
            if length == 0:
                continue
            for computed, x in zip(flat_call(name, scaled), scaled, strict=False):
                value = mpf(x) / length
                error = distance(computed, value)
                allowed = bound.ulps * ulp(value) + mpf(bound.absolute)
                assert error <= allowed, f"{name}{scaled}"
                worst = max(worst, error / allowed)
        for _ in range(SAMPLES):
            wide = tuple(_random(rng, components(name), 300.0))
            length = _length(wide[:size])
            for computed, x in zip(flat_call(name, wide), wide, strict=False):
                value = mpf(x) / length
                assert distance(computed, value) <= bound.ulps * ulp(value) + mpf(bound.absolute)
    print(f"{name}: {float(worst):.3f} of the bound")


def test_rotation_turns_by_the_angle_about_the_axis() -> None:
    """The formula checked above is the rotation: about z by t, x becomes (cos t, sin t, 0)."""
    for k in range(-10, 11):
        t = 0.3 * k
        q = (math.cos(t / 2), 0.0, 0.0, math.sin(t / 2))
        turned = flat_call("quat_rotate", (*q, 1.0, 0.0, 0.0))
        assert turned == pytest.approx((math.cos(t), math.sin(t), 0.0), abs=1e-15)


def test_product_of_quaternions_turns_by_the_right_one_first() -> None:
    rng = seeded("composition")
    for _ in range(100):
        a = flat_call("quat_normalize", tuple(_random(rng, 4, 0.0)))
        b = flat_call("quat_normalize", tuple(_random(rng, 4, 0.0)))
        v = tuple(_random(rng, 3, 0.0))
        both = flat_call("quat_rotate", (*flat_call("quat_mul", (*a, *b)), *v))
        in_turn = flat_call("quat_rotate", (*a, *flat_call("quat_rotate", (*b, *v))))
        assert both == pytest.approx(in_turn, abs=1e-13)


def test_inverse_rotation_undoes_the_rotation() -> None:
    rng = seeded("inverse")
    for _ in range(100):
        q = flat_call("quat_normalize", tuple(_random(rng, 4, 0.0)))
        v = tuple(_random(rng, 3, 0.0))
        back = flat_call("quat_rotate_inverse", (*q, *flat_call("quat_rotate", (*q, *v))))
        assert back == pytest.approx(v, abs=1e-13)


def test_every_public_vector_function_has_a_bound() -> None:
    assert set(VECTORS) - EXACT_BY_NATURE <= set(BOUNDS)
    assert set(BOUNDS) <= set(SIGNATURES)


@all_rows("name", BOUNDS)
def test_domain_has_an_interval_for_every_component(name: str) -> None:
    domain = BOUNDS[name].domain
    assert len(domain) == components(name)
    assert all(low < high for low, high in domain)
