"""Terms against plain functions beside them, asked at points; truths against their tables."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.extras.array_elements import term_of_table
from soter.certificate.extras.prelude_functions import with_error_bound
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.compile_terms import (
    compile_lines,
    compile_step,
    compile_truths,
    form_of_box,
)
from soter.certificate.terms.linear_enclosures import ONE, ZERO, exact
from soter.certificate.terms.terms import FALSE, TRUE, Linear, Proposition, Terms
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Of = Callable[[float, float], float]
    Pair = tuple[Linear, Of]

GRID = [-6.0, -2.0, -0.75, 0.0, 0.5, 2.0, 6.0]
POINTS = list(itertools.product(GRID, GRID))
BOXES = [((-6.0, -2.0), (0.0, 0.5)), ((-0.75, 0.5), (-2.0, 2.0)), ((0.5, 2.0), (2.0, 6.0))]
BOXES += [((-6.0, 6.0), (-6.0, 6.0)), ((-0.75, 0.0), (-0.75, 0.0))]


def two_inputs() -> Any:
    terms = Terms()
    return terms, *(terms.add_input("state", n, exact(-6.0), exact(6.0)) for n in "xy")


def at_points(terms: Terms, value: Linear) -> Callable[[float, float], tuple[float, float]]:
    """What it is at points, compiled once."""
    step = compile_step(terms, [0, 1], 2, [value], ranges=[value])

    def at(x: float, y: float) -> tuple[float, float]:
        found: Any = step(form_of_box([(exact(v), exact(v)) for v in (x, y)], symbols=True))
        return found[1]  # type: ignore[no-any-return]

    return at


def image(terms: Terms, value: Linear, box: Sequence[tuple[float, float]]) -> Any:
    step = compile_step(terms, [0, 1], 2, [value], ranges=[value])
    return step(form_of_box([(exact(a), exact(b)) for a, b in box], symbols=True))


def ends(terms: Terms, value: Linear, x: float, y: float = 0.0) -> tuple[float, float]:
    """At a point."""
    return at_points(terms, value)(x, y)


def bits(terms: Terms, truth: Proposition, box: Sequence[tuple[float, float]]) -> int:
    of = compile_truths(terms, [0, 1], [truth], {})
    found: int = of(form_of_box([(exact(a), exact(b)) for a, b in box], symbols=False))[0]
    return found


def holds(terms: Terms, truth: Proposition, x: float, y: float = 0.0) -> bool:
    """At a point, where it is certain."""
    found = bits(terms, truth, [(x, x), (y, y)])
    assert found in (1, 2)
    return found == 2


# ---------------------------------------------------------------- single operations


def test_so_many_atoms_and_no_more() -> None:
    terms = Terms(limit=2)
    for name in "xy":
        terms.add_input("state", name, ZERO, ONE)
    with pytest.raises(NotRecheckedError, match="too large"):
        terms.add_input("state", "z", ZERO, ONE)


def test_numbers_that_are_not_negative() -> None:
    terms, x, _ = two_inputs()
    for value in (-1.0, -0.0, 0.0, 2.0):
        assert terms.constant(value).nonnegative is (value >= 0)
    kept = {n: replace(x, nonnegative=n) for n in (True, False)}
    others = {
        n: replace(terms.add_input("box", "b", ZERO, ONE), nonnegative=n) for n in (True, False)
    }
    truth = terms.below_zero(x)
    for (m, a), (n, b) in itertools.product(kept.items(), others.items()):
        assert terms.add(a, b).nonnegative is (m and n)
        assert terms.multiply(a, b).nonnegative is (m and n)
        assert terms.subtract(a, b).nonnegative is False
        assert terms.choose(truth, a, b).nonnegative is (m and n)
        for tight in (True, False):
            assert terms.maximum(a, b, tight=tight).nonnegative is (m or n)
    for factor, sign in itertools.product((-2.0, 0.0, 2.0), (True, False)):
        number = terms.constant(factor)
        assert terms.multiply(kept[sign], number).nonnegative is (sign and factor >= 0)
        assert terms.multiply(number, kept[sign]).nonnegative is (sign and factor >= 0)
        assert terms.atoms[-1].kind != "product"
    assert terms.multiply(x, x).nonnegative is True
    assert terms.apply_function("square", x).nonnegative is False
    assert terms.rounded_term(kept[True]).nonnegative is True
    assert terms.rounded_term(kept[False]).nonnegative is False
    assert x.nonnegative is False


@pytest.mark.parametrize(("low", "high"), [(-6.0, 2.0), (-1.0, 8.0), (0.0, 0.0), (3.0, 3.5)])
def test_rounding_is_half_a_unit_of_the_largest(low: float, high: float) -> None:
    terms = Terms()
    x = terms.add_input("state", "x", exact(low), exact(high))
    r = terms.rounded_term(x)
    least = exact(2.0**-53) * max(-low, high) + exact(5e-324)
    most = least * (1 + exact(2.0**-50))
    assert least <= r.radius <= most
    assert r.terms == x.terms
    assert terms.obligations == []
    assert (r.low, r.high) == (x.low, x.high)  # doubles: rounding is monotone
    third = replace(x, low=x.low / 3, high=x.high / 3)
    for end, of in ((terms.rounded_term(third).low, low), (-terms.rounded_term(third).high, -high)):
        assert end <= exact(of) / 3 <= end + 2 * exact(math.ulp(of / 3))
        assert end.rad() == 0


def test_a_number_that_may_be_too_large_has_to_be_a_double() -> None:
    for bound, fine in ((2.0**1023, False), (math.nextafter(2.0**1023, 0), True)):
        for low, high in ((-bound, 0.0), (0.0, bound)):
            terms = Terms()
            x = terms.add_input("state", "x", exact(low), exact(high))
            terms.add_input("state", "y", ZERO, ZERO)
            r = terms.rounded_term(x)
            demands = [d for d in r.beyond if d is not TRUE]
            assert terms.obligations == []
            assert len(demands) == (0 if fine else 1)
            if fine:
                continue
            (demand,) = demands
            assert not holds(terms, demand, low + high)
            assert holds(terms, demand, (low + high) / 2)
            at = (low + high) / 2
            (weight,) = terms.atoms[-1].weights
            assert exact(2.0**-53) * (1 + exact(2.0**-53)) <= weight <= exact(2.0**-52)
            assert ends(terms, r, at) == (at, at)  # it is a double
            *_, rest = image(terms, r, [(at, at), (0.0, 0.0)])[0]
            assert 2.0**-53 <= rest / abs(at) <= 2.0**-51
            assert r.radius >= exact(5e-324)
            assert r.radius < exact(5e-323)
            assert terms.rounded_term(replace(x, nonnegative=True)).nonnegative is True


def test_a_sum_is_known_as_well_as_its_parts_and_its_atoms() -> None:
    terms, x, y = two_inputs()
    for f, g, c in itertools.product((-2.0, 0.0, 1.0), (-1.0, 3.0), (-4.0, 0.0, 5.0)):
        total = terms.combine(((exact(f), x), (exact(g), y)), exact(c))
        size = 6 * (abs(f) + abs(g))
        assert (float(total.low), float(total.high)) == (c - size, c + size)
        assert (0 in total.terms) is (f != 0)
        for a, b in ((1.0, 2.0), (-3.0, 0.5)):
            assert ends(terms, total, a, b) == (f * a + g * b + c,) * 2
    nothing = terms.subtract(x, terms.combine(((ONE, x),)))
    assert nothing.terms == {}
    assert (float(nothing.low), float(nothing.high)) == (0.0, 0.0)
    noisy = Linear(ONE, dict(x.terms), exact(0.5), exact(-5.5), exact(7.5))
    for sign, low, high in ((-1.0, 0.5, 1.5), (1.0, -11.5, 13.5)):
        total = terms.combine(((ONE, noisy), (exact(sign), x)))
        assert total.radius == 0.5
        assert (float(total.low), float(total.high)) == (low, high)
    twice = terms.combine(((exact(2.0), x), (exact(-3.0), x), (ONE, y)))
    assert (float(twice.low), float(twice.high)) == (-12.0, 12.0)
    # where parts are known better than their atoms
    narrow = replace(x, low=exact(-1.0), high=exact(2.0))
    total = terms.combine(((exact(-2.0), narrow), (ONE, y)))
    assert (float(total.low), float(total.high)) == (-10.0, 8.0)


def test_what_is_off_counts_in_a_product_and_a_quotient() -> None:
    """Numbers and inputs that are off by a half, at a point: every corner is in the image."""
    terms, x, y = two_inputs()
    half, one = exact(0.5), terms.constant(1.0)

    def off(v: Linear) -> Linear:
        return replace(v, radius=half, low=v.low - half, high=v.high + half)

    for a, (b, of_b) in itertools.product((x, one), ((y, None), (one, 1.0), (x, 2.0))):
        for m, n in itertools.product((True, False), repeat=2):
            first, second = off(a) if m else a, off(b) if n else b
            made = terms.multiply(first, second)
            low, high = ends(terms, made, 2.0, 3.0)
            va, vb = (2.0 if a is x else 1.0), of_b or 3.0
            sides_a = (va - 0.5, va + 0.5) if m else (va,)
            sides_b = (vb - 0.5, vb + 0.5) if n else (vb,)
            corners = [p * q for p in sides_a for q in sides_b]
            assert low <= min(corners) + 1e-12
            assert high >= max(corners) - 1e-12
            assert high - low <= max(corners) - min(corners) + 0.6
            assert made.low <= min(corners)
            assert made.high >= max(corners)


@pytest.mark.parametrize("divisor", [-4.0, 0.5, 0.0])
def test_what_is_divided_by_is_not_zero(divisor: float) -> None:
    terms, x, y = two_inputs()
    made = terms.divide(x, terms.constant(divisor))
    if divisor:
        assert terms.obligations == []
        assert ends(terms, made, 3.0) == (3.0 / divisor,) * 2
        assert len(terms.atoms) == 2
    else:
        assert terms.obligations == [FALSE]
    terms.obligations.clear()
    noisy = replace(terms.constant(1.0), radius=exact(0.5), low=exact(0.5), high=exact(1.5))
    low, high = ends(terms, terms.divide(x, noisy), 3.0)
    assert 1.5 < low <= 2.0 + 1e-12
    assert 6.0 - 1e-12 <= high < 7.0
    assert terms.obligations == []
    terms.divide(x, y)
    (demand,) = terms.obligations
    assert [holds(terms, demand, 1.0, v) for v in (-1.0, 0.0, 1.0)] == [True, False, True]


def test_a_soft_sign_is_found_where_there_is_one() -> None:
    """Of y / (k |y| + c) the range is that of its ends; of all else what comes out encloses it."""
    for k, c, f in ((0.5, 1.0, 1.0), (2.0, 3.0, -2.0), (1.0, 0.5, 3.0)):
        terms, x, y = two_inputs()
        b = terms.combine(((exact(k), terms.apply_function("abs", y)),), exact(c))
        end = 6.0 * abs(f) / (6.0 * k + c)
        quotients: list[tuple[Linear, Of]] = [
            (terms.divide(terms.combine(((exact(f), y),)), b), lambda _, v, f=f: f * v),  # type: ignore[misc]
            (
                terms.divide(terms.combine(((exact(f), terms.multiply(x, y)),)), b),
                lambda u, v, f=f: f * u * v,  # type: ignore[misc]
            ),
            (
                terms.divide(terms.combine(((exact(f), terms.multiply(y, x)),)), b),
                lambda u, v, f=f: f * u * v,  # type: ignore[misc]
            ),
        ]
        for (made, of), most in zip(quotients, (end, 6 * end, 6 * end), strict=True):
            low, high = image(terms, made, [(-6.0, 6.0), (-6.0, 6.0)])[1]
            assert abs(low + most) < 1e-9
            assert abs(high - most) < 1e-9
            assert abs(made.high - exact(most)) < 1e-6
            for u, v in ((1.0, 2.0), (-2.0, -0.5), (3.0, 0.0)):
                at = of(u, v) / (k * abs(v) + c)
                assert ends(terms, made, u, v) == pytest.approx((at, at), abs=1e-12)


def test_what_is_no_soft_sign_is_not_taken_for_one() -> None:
    terms, x, y = two_inputs()
    half = exact(0.5)
    size = terms.apply_function("abs", y)
    plus = terms.combine(((ONE, size),), ONE)
    other = terms.combine(((ONE, terms.apply_function("square", y)),), ONE)
    two = terms.combine(((ONE, size), (ONE, terms.apply_function("square", y))), ONE)
    falling = terms.combine(((-ONE, size),), exact(8.0))
    below = terms.combine(((ONE, size),), exact(-8.0))
    of_x = terms.combine(((ONE, terms.apply_function("abs", x)),), ONE)
    shifted = terms.combine(((ONE, y),), ONE)
    total = terms.add(x, y)
    cases: list[tuple[Linear, Linear, Of]] = [
        (shifted, plus, lambda _, v: (v + 1) / (1 + abs(v))),
        (total, plus, lambda u, v: (u + v) / (1 + abs(v))),
        (y, other, lambda _, v: v / (1 + v * v)),
        (y, two, lambda _, v: v / (1 + abs(v) + v * v)),
        (y, falling, lambda _, v: v / (8 - abs(v))),
        (y, below, lambda _, v: v / (abs(v) - 8)),
        (y, of_x, lambda u, v: v / (1 + abs(u))),
        (x, plus, lambda u, v: u / (1 + abs(v))),
        (terms.apply_function("square", y), plus, lambda _, v: v * v / (1 + abs(v))),
        (terms.apply_function("abs", y), plus, lambda _, v: abs(v) / (1 + abs(v))),
        (terms.constant(2.0), plus, lambda _, v: 2 / (1 + abs(v))),
        (y, size, lambda _, v: v / abs(v)),
        (
            terms.combine(((ONE, terms.multiply(x, y)),), ONE),
            plus,
            lambda u, v: (u * v + 1) / (1 + abs(v)),
        ),
        (
            terms.choose(terms.below_zero(x), y, x),
            plus,
            lambda u, v: (v if u < 0 else u) / (1 + abs(v)),
        ),
    ]
    for a, b, of in cases:
        made = terms.divide(a, b)
        for u, v in ((1.0, 2.0), (-2.0, -0.5), (0.5, 3.0)):
            assert ends(terms, made, u, v) == pytest.approx((of(u, v),) * 2, abs=1e-9)
    noisy = replace(y, radius=half, low=y.low - half, high=y.high + half)
    for a, b, by in ((noisy, plus, 2.5), (noisy, plus, 1.5)):
        low, high = ends(terms, terms.divide(a, b), 0.0, 2.0)
        assert low <= by / 3.0 <= high
    times = terms.multiply(x, y)
    noisy = replace(times, radius=half, low=times.low - half, high=times.high + half)
    low, high = ends(terms, terms.divide(noisy, plus), 1.0, 2.0)
    assert low <= 1.5 / 3.0
    assert high >= 2.5 / 3.0
    wide = replace(plus, radius=half, low=plus.low - half, high=plus.high + half)
    low, high = ends(terms, terms.divide(y, wide), 0.0, 2.0)
    assert low <= 2.0 / 3.5
    assert high >= 2.0 / 2.5


@pytest.mark.parametrize("tight", [True, False])
@pytest.mark.parametrize("name", ["minimum", "maximum"])
def test_the_lesser_and_the_greater_one(name: str, tight: bool) -> None:
    of = min if name == "minimum" else max
    terms, x, y = two_inputs()
    pairs: list[tuple[Linear, Linear, Of]] = [
        (x, y, of),
        (x, terms.constant(1.0), lambda u, _: of(u, 1.0)),
        (terms.constant(1.0), x, lambda u, _: of(u, 1.0)),
        (terms.combine(((ONE, x),), exact(-2.0)), y, lambda u, v: of(u - 2.0, v)),
        (y, terms.combine(((ONE, x),), exact(-2.0)), lambda u, v: of(u - 2.0, v)),
        (y, terms.combine(((ONE, x),), exact(2.0)), lambda u, v: of(u + 2.0, v)),
    ]
    for a, b, wanted in pairs:
        made = getattr(terms, name)(a, b, tight=tight)
        values = [wanted(u, v) for u, v in POINTS]
        assert made.low <= min(values)
        assert made.high >= max(values)
        if tight:
            assert (float(made.low), float(made.high)) == (min(values), max(values))
        at = at_points(terms, made)
        for u, v in POINTS:
            assert at(u, v) == pytest.approx((wanted(u, v),) * 2, abs=1e-12)
    # a number is never passed, whatever is enclosed; and what is not asked for is not read
    one = terms.constant(1.0)
    for limit in (getattr(terms, name)(x, one), getattr(terms, name)(one, x)):
        low, high = image(terms, limit, [(-6.0, 6.0), (0.0, 0.0)])[1]
        assert (high if name == "minimum" else low) == 1.0
        assert terms.atoms[-1].kind == "max0"
    getattr(terms, name)(x, y)
    assert terms.atoms[-1].kind == "max0"
    getattr(terms, name)(x, y, tight=True)
    assert terms.atoms[-1].kind == name[:3]
    apart = terms.combine(((ONE, y),), exact(20.0))
    made = getattr(terms, name)(x, apart, tight=True)
    low, high = image(terms, made, [(-6.0, 6.0), (-6.0, 6.0)])[1]
    assert (low, high) == ((-6.0, 6.0) if name == "minimum" else (14.0, 26.0))


def test_a_choice_is_one_of_two() -> None:
    terms, x, y = two_inputs()
    truth = terms.below_zero(x)
    assert terms.choose(TRUE, x, y) is x
    assert terms.choose(FALSE, x, y) is y
    assert terms.choose(truth, x, terms.combine(((ONE, x),))) is x
    far = terms.combine(((ONE, y),), exact(20.0))
    for a, b in ((y, far), (far, y)):
        made = terms.choose(truth, a, b)
        assert (float(made.low), float(made.high)) == (-6.0, 26.0)
        for u, v in ((-1.0, 2.0), (1.0, 2.0), (0.0, -3.0)):
            wanted = v + (20.0 if (a is far) is (u < 0) else 0.0)
            assert ends(terms, made, u, v) == (wanted, wanted)
        form, (low, high) = image(terms, made, [(-1.0, 1.0), (1.0, 2.0)])
        assert (low, high) == (1.0, 22.0)
        assert form[2] == 11.5  # y and the middle of both
        assert form[4] == 0.5
        assert form[5] == 10.0


def test_a_spread_is_as_wide_as_its_weights_say() -> None:
    terms, x, y = two_inputs()
    weights = [exact(-0.5), ZERO, exact(2.0)]
    made = terms.term_within_sizes(weights, [x, y, terms.combine(((ONE, y),), ONE)])
    assert (float(made.low), float(made.high)) == (-17.0, 17.0)
    assert ends(terms, made, 2.0, -3.0) == (-5.0, 5.0)
    assert ends(terms, made, -2.0, 3.0) == (-9.0, 9.0)
    low, high = image(terms, made, [(-1.0, 3.0), (-4.0, 0.5)])[1]
    assert (low, high) == (-7.5, 7.5)
    for weight, kept in (((ZERO,), [x]), ((), [])):
        nothing = terms.term_within_sizes(weight, kept)
        assert nothing.is_constant
        assert nothing.const == 0


def test_a_table_is_read_where_it_has_elements() -> None:
    terms, x, y = two_inputs()
    values = [float(10 * r + c) for r in range(3) for c in range(2)]
    made = term_of_table(terms, values, [x, y], [3, 2])
    assert (float(made.low), float(made.high)) == (0.0, 21.0)
    for r, c in itertools.product(range(-1, 4), range(-1, 3)):
        inside = all(holds(terms, o, r, c) for o in terms.obligations)
        assert inside is (0 <= r < 3 and 0 <= c < 2)
        if inside:
            assert ends(terms, made, r, c) == (10.0 * r + c,) * 2
    assert image(terms, made, [(0.5, 1.5), (0.0, 1.0)])[1] == (10.0, 11.0)
    for wrong in (math.inf, -math.inf, math.nan):
        with pytest.raises(NotRecheckedError, match="not finite"):
            term_of_table(terms, [1.0, wrong], [x], [2])


def test_a_function_that_is_off_is_kept_in_its_range() -> None:
    for low, high, wanted in ((-9.0, 9.0, (-1.25, 1.25)), (-1.0, 1.0, (-1.0, 1.0))):
        terms, x, _ = two_inputs()
        wide = with_error_bound(
            terms, terms.apply_function("sin", x), ZERO, exact(0.25), exact(low), exact(high)
        )
        assert (float(wide.low), float(wide.high)) == pytest.approx(wanted, abs=1e-6)
        assert wide.const == 0 == wide.radius
        atom = terms.atoms[-1]
        assert (atom.low, atom.high, atom.extra) == (wide.low, wide.high, exact(0.25))


# ---------------------------------------------------------------- drawn expressions


def drawn(terms: Terms, chance: np.random.Generator, pool: list[Pair]) -> Pair:
    """Something made of what there is, with what it means."""

    def one() -> Pair:
        return pool[chance.integers(len(pool))]

    (a, f), (b, g), (d, h) = one(), one(), one()
    c, k = (float(v) for v in chance.integers(-3, 4, 2) / 2)
    plain: dict[str, Callable[[float], float]] = {
        "max0": lambda v: max(v, 0.0), "abs": abs, "square": lambda v: v * v, "floor": math.floor,
        "soft_sign": lambda v: v / (1 + abs(v)), "sin": math.sin, "cos": math.cos,
        "tanh": math.tanh, "atan": math.atan,
    }  # fmt: skip
    name = sorted(plain)[chance.integers(len(plain))]
    truth = terms.compare("<", a, b)
    made: list[Callable[[], Pair]] = [
        lambda: (
            terms.combine(((exact(c), a), (exact(k), b)), exact(c)),
            lambda x, y: c * f(x, y) + k * g(x, y) + c,
        ),
        lambda: (terms.multiply(a, b), lambda x, y: f(x, y) * g(x, y)),
        lambda: (terms.minimum(a, b, tight=c > 0), lambda x, y: min(f(x, y), g(x, y))),
        lambda: (terms.maximum(a, b, tight=c > 0), lambda x, y: max(f(x, y), g(x, y))),
        lambda: (terms.apply_function(name, a), lambda x, y: plain[name](f(x, y))),
        lambda: (terms.choose(truth, d, b), lambda x, y: h(x, y) if f(x, y) < g(x, y) else g(x, y)),
        lambda: (
            terms.divide(a, terms.combine(((ONE, terms.apply_function("square", b)),), ONE)),
            lambda x, y: f(x, y) / (1 + g(x, y) ** 2),
        ),
    ]
    return made[chance.integers(len(made))]()


@all_rows("seed", range(12))
def test_drawn_expressions_are_enclosed_and_at_points_they_are_numbers(seed: int) -> None:
    chance = np.random.default_rng(seed)
    terms, x, y = two_inputs()
    pool: list[Pair] = [
        (x, lambda u, _: u),
        (y, lambda _, v: v),
        (terms.constant(1.5), lambda *_: 1.5),
    ]
    for _ in range(6):
        pool.append(drawn(terms, chance, pool))
    value, of = pool[-1]
    step = compile_step(terms, [0, 1], 2, [value], ranges=[value])
    lines = compile_lines(terms, [0, 1], 2, [value], [], {})
    for box in [*BOXES, *(((u, u), (v, v)) for u, v in POINTS[::5])]:
        form = form_of_box([(exact(a), exact(b)) for a, b in box], symbols=True)
        image_, (low, high) = step(form)  # type: ignore[misc]
        *factors, constant, spread, least, most = lines(form)
        (a, b), (c, d) = box
        for s, t in itertools.product((-1.0, -0.5, 0.0, 0.75, 1.0), repeat=2):
            u, v = (a + b) / 2 + s * (b - a) / 2, (c + d) / 2 + t * (d - c) / 2
            wanted = of(u, v)
            slack = exact(1e-9 * (1 + abs(wanted)))
            assert low - slack <= wanted <= high + slack
            assert least - slack <= wanted <= most + slack
            assert not wanted < value.low - slack
            assert not wanted > value.high + slack
            assert not abs(wanted - image_[2] - s * image_[3] - t * image_[4]) > image_[5] + slack
            assert not abs(wanted - factors[0] * u - factors[1] * v - constant) > spread + slack
        if a == b and c == d:
            near = 1e-9 * (1 + abs(of(a, c)))
            at_jump = high - low > near  # of a floor or a choice; there both sides are enclosed
            assert not at_jump or any(atom.kind in ("floor", "choice") for atom in terms.atoms)
