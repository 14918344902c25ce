"""Single operations of the re-checker's programs: each encloses what it names, and no more."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from flint import arb

from soter.certificate.extras.array_elements import range_of_table
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.straight_line import (
    OPERATIONS,
    Builder,
    Function,
    NotCertainError,
    choose_by_truth,
    growth_bound,
    product_range,
    range_after,
    range_between,
    require_certain,
)
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

ENDS = (-2.5, -1.0, -0.25, 0.0, 0.5, 1.0, 3.0)
INTERVALS = [(a, b) for a in ENDS for b in ENDS if a <= b]
FALSE, TRUE, EITHER = 1, 2, 3
MAY_BE = {FALSE: {False}, TRUE: {True}, EITHER: {False, True}}


def test_a_product_has_the_range_of_its_corners() -> None:
    for (al, ah), (bl, bh) in itertools.product(INTERVALS, INTERVALS):
        low, high = product_range(*(exact(v) for v in (al, ah, bl, bh)))
        products = [a * b for a in (al, ah) for b in (bl, bh)]
        assert (float(low), float(high)) == (min(products), max(products))


def test_truths_are_those_that_are_possible() -> None:
    for a, b in itertools.product(MAY_BE, MAY_BE):
        both = {x and y for x in MAY_BE[a] for y in MAY_BE[b]}
        one = {x or y for x in MAY_BE[a] for y in MAY_BE[b]}
        assert MAY_BE[OPERATIONS["and"](a, b)] == both
        assert MAY_BE[OPERATIONS["or"](a, b)] == one
        assert MAY_BE[OPERATIONS["not"](a)] == {not x for x in MAY_BE[a]}


@pytest.mark.parametrize(
    ("low", "high", "negative", "not_positive"),
    [
        (-2.0, -1.0, TRUE, TRUE),
        (-2.0, 0.0, EITHER, TRUE),
        (-2.0, 1.0, EITHER, EITHER),
        (0.0, 0.0, FALSE, TRUE),
        (0.0, 1.0, FALSE, EITHER),
        (1.0, 2.0, FALSE, FALSE),
    ],
)
def test_a_sign_is_certain_where_it_is_one(
    low: float, high: float, negative: int, not_positive: int
) -> None:
    ends = exact(low), exact(high)
    assert OPERATIONS["negative"](*ends) == negative
    assert OPERATIONS["not_positive"](*ends) == not_positive


def test_a_sign_of_a_wide_end_is_not_certain() -> None:
    around = arb(0, 1)
    assert OPERATIONS["negative"](exact(-3.0), around) == EITHER
    assert OPERATIONS["not_positive"](around, exact(3.0)) == EITHER


def test_what_is_chosen_by_a_truth() -> None:
    yes, no, both = exact(1.0), exact(2.0), exact(3.0)
    assert [choose_by_truth(t, yes, no, both) for t in (TRUE, FALSE, EITHER)] == [yes, no, both]


def test_what_is_demanded_has_to_be_certain() -> None:
    require_certain(TRUE)
    for truth in (FALSE, EITHER):
        with pytest.raises(NotCertainError):
            require_certain(truth)


TABLE = np.array([[4.0, -1.0, 7.0], [2.0, 9.0, -3.0]])
POSITIONS = (-math.inf, -2.0, 0.0, 0.5, 1.0, 1.5, 2.0, 5.0, math.inf)


def test_a_table_gives_all_that_stands_between_two_positions() -> None:
    for rows, columns in itertools.product(itertools.combinations(POSITIONS, 2), repeat=2):
        low, high = range_of_table(TABLE, *rows, *columns)
        between = [
            float(TABLE[i, j])
            for i, j in np.ndindex(TABLE.shape)
            if rows[0] <= i <= rows[1] and columns[0] <= j <= columns[1]
        ]
        if between:
            assert (float(low), float(high)) == (min(between), max(between))


def test_growth_is_the_integral() -> None:
    for own, span in itertools.product((-3.0, -0.5, 0.5, 2.0), (0.0, 0.1, 1.0)):
        value = math.expm1(own * span) / own
        assert value <= float(growth_bound(exact(own), exact(span))) * (1 + 1e-15) <= value + 1e-12
    assert float(growth_bound(exact(0.0), exact(0.5))) == 0.5
    assert float(growth_bound(arb(0, 0.1), exact(1.0)).upper()) >= math.expm1(0.1) / 0.1
    assert float(growth_bound(arb(-0.05, 0.05), exact(1.0)).upper()) >= 1.0


@all_rows("own", [-2.0, -0.5, 0.5])
@all_rows("rest", [(-1.0, -0.8), (-0.2, 0.3), (0.1, 0.4), (0.8, 1.0)])
@all_rows("box", [(-1.0, -0.5), (-0.3, 0.4), (0.0, 0.1), (0.5, 1.0)])
def test_a_state_between_two_instants_is_in_the_swept_range(
    own: float, rest: tuple[float, float], box: tuple[float, float]
) -> None:
    """x' = own x + rest, rest between two numbers: here constant, and changing half way."""
    span, instants = 0.5, 40
    runs = []
    for first, second in itertools.product(rest, rest):
        for start in np.linspace(*box, 5):
            x = start
            way = [x]
            for k in range(instants):
                pull = first if 2 * k < instants else second
                dt = span / instants
                x = x * math.exp(own * dt) + pull * (math.exp(own * dt) - 1) / own
                way.append(x)
            runs.append(way)
    after = [way[-1] for way in runs]
    between = [x for way in runs for x in way]
    ball = exact(min(between)).union(exact(max(between)))
    pulls = exact(rest[0]).union(exact(rest[1]))
    ends = (exact(v) for v in (*box, min(after), max(after)))
    rate = exact(own) * ball + pulls
    rates = arb(rate.lower()), arb(rate.upper())
    grown = growth_bound(exact(own), exact(span))
    numbers = [*ends, *rates, exact(own), pulls, exact(span), grown]
    low, high = range_between(*numbers)
    assert low <= min(between)
    assert max(between) <= high
    assert low >= min(between) - 1.0
    assert high <= max(between) + 1.0
    law = exact(own), pulls, grown
    low, high = range_after(exact(box[0]), exact(box[1]), exact(-9.0), exact(9.0), *law)
    assert low <= min(after)
    assert max(after) <= high
    assert low >= min(between) - 1e-9, "no farther than where nothing else acts"
    assert high <= max(between) + 1e-9
    assert range_after(exact(box[0]), exact(box[1]), exact(0.0), exact(0.0), *law)[1] <= 0, "known"


def test_a_form_of_another_length_is_refused() -> None:
    """Constants stand behind the form: one number more or less would shift all of them."""
    make = Builder()
    function = Function(make, 2, [make.input_at(0) + make.input_at(1) + make.constant(exact(3.0))])
    assert function((exact(1.0), exact(2.0))) == (6,)
    for form in ((exact(1.0),), (exact(1.0),) * 3, (make.input_at(0),)):
        with pytest.raises(AssertionError, match="another length"):
            function(form)


MEANT: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "smaller": min,
    "larger": max,
}


@all_rows("known", [0.0, 1.0, -1.0])
@all_rows("name", list(MEANT))
def test_what_needs_no_operation_is_left_out(name: str, known: float) -> None:
    """Sums with 0 and products with 0, 1 and -1 are known, of what nothing bounds as well."""
    make = Builder()
    x, number = make.input_at(0), make.constant(exact(known))
    for turned in (False, True):
        made = make.apply(name, *((x, number) if turned else (number, x)))
        value = {
            ("add", 0.0): x,
            ("sub", 0.0): x if turned else -x,
            ("mul", 0.0): make.zero,
            ("mul", 1.0): x,
            ("mul", -1.0): -x,
        }.get((name, known))
        if value is not None:
            assert made is value
        else:
            assert made.operation == name
        (computed,) = Function(make, 1, [made])((exact(3.0),))
        assert computed == MEANT[name](*((3.0, known) if turned else (known, 3.0)))
    nothing = make.apply("mul", number, x)
    (of_all,) = Function(make, 1, [nothing])((arb(0, math.inf),))
    assert of_all.is_zero() is (known == 0.0)
