"""Flows whose solution is known by a formula, and rows of a flow beside what is written."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.reading import linear_flows
from soter.certificate.reading.linear_flows import (
    LinearFlow,
    exp_integral,
    exponential,
    linear_flow,
)
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import ONE, ZERO, exact
from unit.certificate.test_problem_by_definition import facts_with, model_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.certificate.reading.module_facts import Facts


arb = type(ZERO)


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> Facts:
    return facts_with(tmp_path_factory.mktemp("all"))


def test_a_row_of_a_flow_is_its_factors(facts: Facts) -> None:
    first, second = linear_flows._rows_of_all_states(model_of(facts, (0, 1, 4)))
    assert first is not None
    assert second is not None
    assert [float(x) for x in (*first.a, *first.b, first.constant)] == [0.0, 1.0, 0.0, 0.0]
    # w in [-0.25, 0.75] and 4 wind in [-3, 2]: middles 0.25 and -0.5
    assert [float(x) for x in (*second.a, *second.b, second.constant)] == [0.0, -0.5, 2.0, 3.75]
    assert [float(x) for x in second.noise] == [0.5, 2.5]
    assert all(x.is_zero() for x in first.noise)


def test_what_moves_a_group_from_outside_is_a_disturbance(facts: Facts) -> None:
    model = model_of(facts, (1, 1, 2))
    flow = linear_flow(model, [0])
    assert [float(x) for x in (*flow.a[0], *flow.b[0])] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert float(flow.constant[0]) == pytest.approx(0.25, abs=1e-4)  # v in [-1, 1.5]
    assert sum(abs(float(x)) for x in flow.noise[0]) == pytest.approx(1.25, abs=1e-4)
    both = linear_flow(model, [1, 0])
    assert both.members == (1, 0)
    found = [[float(x) for x in (*a, *b)] for a, b in zip(both.a, both.b, strict=True)]
    assert np.allclose(found, [[-0.5, 0.0, 1.0], [1.0, 0.0, 0.0]], atol=1e-6)
    assert [float(c) for c in both.constant] == pytest.approx([1.75, 0.0], abs=1e-4)
    assert sum(abs(float(x)) for x in both.noise[0]) == pytest.approx(3.0, abs=1e-3)
    assert [(float(a), float(b)) for a, b in both.ranges] == [(-1.0, 2.0)]


def matrix(*rows_of: Iterable[float]) -> Any:
    return [[exact(float(x)) for x in row] for row in rows_of]


SPANS = [Fraction(0), Fraction(1, 3), Fraction(-1, 2), Fraction(3)]


@pytest.mark.parametrize(
    ("start", "end"), list(itertools.combinations_with_replacement(sorted(SPANS), 2))
)
def test_exponentials_of_matrices_that_are_known(start: Fraction, end: Fraction) -> None:
    nilpotent, turning = matrix([0.0, 1.0], [0.0, 0.0]), matrix([0.0, 1.0], [-1.0, 0.0])
    shear, turn = (exponential(a, start, end) for a in (nilpotent, turning))
    half = float(end - start) / 2
    for k in range(9):
        t = float(start) + float(end - start) * k / 8
        exactly = [[math.cos(t), math.sin(t)], [-math.sin(t), math.cos(t)]]
        for i, j in itertools.product(range(2), repeat=2):
            assert abs(turn[i][j] - exactly[i][j]).lower() < 1e-12
        assert abs(shear[0][1] - t).lower() < 1e-12
    assert (shear[0][0], shear[1][1]) == (1, 1)
    assert shear[1][0].is_zero()
    assert float(shear[0][1].rad()) == pytest.approx(half, rel=1e-6)
    # by a series of terms that are each as large as they may be
    assert all(float(x.rad()) <= 2 * (math.exp(half) - 1) + 1e-9 for row in turn for x in row)


def test_so_long_a_span_is_summed_up() -> None:
    """For rates of 1 per s: as many terms as halve the rest, 256 at most."""
    one = matrix([1.0])
    for half in (Fraction(1, 2), Fraction(12), Fraction(13), Fraction(40), Fraction(257, 2)):
        ((x,),) = linear_flows._exponential_around_zero(one, half)
        most = math.exp(float(half))
        assert float(x.upper()) >= most * (1 - 1e-12)
        assert float(x.upper()) <= most * (1 + 1e-2)
        assert float(x.lower()) <= 1 / most
        assert float(x.lower()) >= 1 - math.sinh(float(half)) * (1 + 1e-2) - 1e-12
    with pytest.raises(NotRecheckedError, match="too long"):
        linear_flows._exponential_around_zero(one, Fraction(129))
    assert linear_flows._exponential_around_zero([], Fraction(1)) == []


@pytest.mark.parametrize("time", [Fraction(1, 4), Fraction(2), Fraction(-1)])
def test_integrals_of_exponentials_that_are_known(time: Fraction) -> None:
    t = float(time)
    found = exp_integral(matrix([0.0, 1.0], [0.0, 0.0]), time)
    wanted = [[t, t * t / 2], [0.0, t]]
    assert np.allclose([[float(x) for x in row] for row in found], wanted, atol=1e-12)
    ((decay,),) = exp_integral(matrix([-2.0]), time)
    assert float(decay) == pytest.approx((1 - math.exp(-2 * t)) / 2)


def test_entries_that_differ_lie_on_paths() -> None:
    dice = np.random.default_rng(29)
    for n in (1, 2, 3, 5):
        for _ in range(20):
            links = dice.random((n, n)) < 0.3
            steps, reach = links.copy(), links.copy()
            for _ in range(n):
                steps = (steps.astype(int) @ links.astype(int)) > 0
                reach |= steps
            a = matrix(*([float(x) for x in row] for row in links))
            assert linear_flows._reachable_entries(a) == reach.tolist()
            seven = [[exact(7.0)] * n for _ in range(n)]
            cleaned = linear_flows._with_exact_entries(a, seven)
            for i, j in itertools.product(range(n), repeat=2):
                assert cleaned[i][j] == (7 if reach[i, j] else int(i == j))


def test_a_size_is_bounded_in_three_ways() -> None:
    of, share = linear_flows._bound_of_integral, exact(0.5)
    for values in itertools.product((-2.0, 0.0, 3.0), repeat=3):
        whole = exact(sum(values) / 2)
        found = of(whole, [exact(v) for v in values], share)
        assert float(found) == pytest.approx(sum(map(abs, values)) / 2)
    wide = arb(0, 1)
    assert float(of(ZERO, [wide], share)) == pytest.approx(0.5)
    mostly = arb(0.95, 1.05)  # [-0.1, 2]: the whole and twice what is below zero
    assert float(of(exact(0.5), [mostly], share)) == pytest.approx(0.6)
    assert float(of(exact(-0.5), [-mostly], share)) == pytest.approx(0.6)


@pytest.mark.parametrize("rate", [-2.0, 0.5])
def test_what_is_added_over_a_span(rate: float) -> None:
    columns = matrix([1.5, -0.5])
    flow = LinearFlow((0,), matrix([rate]), [[]], [ZERO], columns, ())
    for start, end in ((0, 1), (-1, 0), (-2, 1), (0, 0), (1, 2)):
        (most,) = flow.noise_bounds(columns, Fraction(start), Fraction(end))
        wanted = max(abs(math.expm1(rate * t) / rate) * 2 for t in (min(start, 0), max(end, 0)))
        assert wanted - 1e-9 <= float(most) <= wanted * 1.001 + 1e-9
    assert flow.noise_bounds([[]], Fraction(-1), Fraction(1)) == [ZERO]
    turning = LinearFlow((0, 1), matrix([0.0, 1.0], [-1.0, 0.0]), [[], []], [ZERO] * 2, [], ())
    found = turning.noise_bounds(matrix([1.0], [0.0]), Fraction(0), Fraction(3))
    for x, y in zip(found, (2 - math.sin(3), 1 - math.cos(3)), strict=True):
        assert y - 1e-9 <= float(x) <= 1.2 * y


@pytest.mark.parametrize("constant", [0.0, 1.0, -3.0, 1e6])
def test_a_solution_is_linear_in_state_command_and_constant(constant: float) -> None:
    flow = LinearFlow((0,), matrix([-2.0]), matrix([3.0]), [exact(constant)], [[]], ((ZERO, ZERO),))
    for t in (Fraction(1, 2), Fraction(-1, 4)):
        solution = flow.solution(t, t)
        grown = -math.expm1(-2.0 * float(t)) / 2.0
        found = [solution.state[0][0], solution.control[0][0], solution.constant[0]]
        wanted = [math.exp(-2.0 * float(t)), 3.0 * grown, constant * grown]
        assert [float(x) for x in found] == pytest.approx(wanted, abs=1e-9)
        assert [len(x) for x in (solution.state[0], solution.control[0])] == [1, 1]


def test_powers_of_a_matrix_are_bounded_by_the_row_sums_of_scaled_states() -> None:
    """S is the largest row sum of t |A| with states in the scales d: so |tA|^k <= S^k d_i / d_j."""
    dice = np.random.default_rng(37)
    for n in (1, 2, 3, 4):
        for _ in range(25):
            a = dice.uniform(-2, 2, (n, n)) * 10.0 ** dice.integers(-3, 4, (n, n))
            a *= dice.random((n, n)) < 0.7
            time = float(2.0 ** dice.integers(-6, 3))
            most, scales = linear_flows.scaled_row_sum(matrix(*a), exact(time))
            d = np.array([float(x) for x in scales])
            assert all(math.frexp(x)[0] == 0.5 for x in d)
            sums, plain = (time * (abs(a) @ e / e).max() for e in (d, np.ones(n)))
            assert sums * (1 - 1e-12) <= float(most) <= sums * (1 + 1e-12)
            assert sums <= plain
            assert plain > 1 or list(d) == [1.0] * n
            power = np.eye(n)
            for k in range(1, 5):
                power = power @ abs(a * time)
                assert (power <= float(most) ** k * d[:, None] / d[None, :] * (1 + 1e-9)).all()


def test_scales_make_what_is_fast_and_small_no_larger_than_it_is() -> None:
    for size in (2.0, 50.0, 1000.0):
        turning = matrix([0.0, size], [-1.0 / size, 0.0])
        assert float(linear_flows.scaled_row_sum(turning, ONE)[0]) <= 2.0
    assert float(linear_flows.scaled_row_sum([[arb(0.0, 3.0)]], exact(0.5))[0]) == pytest.approx(
        1.5
    )
    assert not linear_flows.scaled_row_sum([[arb("inf")]], ONE)[0].is_finite()
