"""Exact intervals, against incomplete gamma and beta functions of mpmath."""

from __future__ import annotations

from math import inf, log

import mpmath
import numpy as np
import pytest

from soter.campaign.statistics import (
    FLIGHTS,
    POISSON,
    RateInterval,
    clopper_pearson_interval,
    garwood_interval,
    rate_interval,
)
from work import work_of

CALLS_MAX = 20_000
"""However many events there were."""


@pytest.mark.parametrize("count", [1, 2, 5, 34, 700])
def test_a_rate_is_that_of_garwood(count: int) -> None:
    low, high = garwood_interval(count, 2.0)
    # P(X >= count | low) = P(X <= count | high) = 2.5 %
    assert float(mpmath.gammainc(count, 0, 2 * low, regularized=True)) == pytest.approx(0.025)
    assert float(mpmath.gammainc(count + 1, 2 * high, regularized=True)) == pytest.approx(0.025)


@pytest.mark.parametrize(("count", "of"), [(1, 2), (3, 10), (34, 800), (799, 800)])
def test_a_share_is_that_of_clopper_and_pearson(count: int, of: int) -> None:
    low, high = clopper_pearson_interval(count, of)
    below = mpmath.betainc(count, of - count + 1, 0, low, regularized=True)
    above = mpmath.betainc(count + 1, of - count, high, 1, regularized=True)
    assert (float(below), float(above)) == pytest.approx((0.025, 0.025))


def test_nothing_in_104_hours_is_a_bound() -> None:
    assert garwood_interval(0, 104.0)[1] == pytest.approx(-log(0.05) / 104.0)
    assert clopper_pearson_interval(0, 1000)[1] == pytest.approx(1.0 - 0.05 ** (1 / 1000))
    assert clopper_pearson_interval(1000, 1000)[0] == pytest.approx(0.05 ** (1 / 1000))


def test_of_nothing_nothing_is_known() -> None:
    assert garwood_interval(0, 0.0) == (0.0, inf)
    assert clopper_pearson_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("count", [50_000, 400_000])
def test_many_events_are_as_exact_and_take_no_more_work(count: int) -> None:
    (low, high), calls = work_of(lambda: garwood_interval(count, 2.0))
    below = mpmath.gammainc(count, 0, 2 * low, regularized=True)
    above = mpmath.gammainc(count + 1, 2 * high, regularized=True)
    assert (float(below), float(above)) == pytest.approx((0.025, 0.025), rel=1e-5)
    assert calls <= CALLS_MAX


@pytest.mark.parametrize(("count", "of"), [(25_000, 50_000), (1, 1_000_000), (999_990, 1_000_000)])
def test_a_share_of_many_is_as_exact_and_takes_no_more_work(count: int, of: int) -> None:
    (low, high), calls = work_of(lambda: clopper_pearson_interval(count, of))
    with mpmath.workdps(30):
        below = _binomial_from(count, of, mpmath.mpf(low))
        above = 1 - _binomial_from(count + 1, of, mpmath.mpf(high))
    assert (float(below), float(above)) == pytest.approx((0.025, 0.025), rel=1e-5)
    assert calls <= CALLS_MAX


def _binomial_from(least: int, of: int, p: mpmath.mpf) -> mpmath.mpf:
    """P(X >= least), added up from its largest term outwards."""
    whole = mpmath.loggamma(of + 1)

    def term(k: int) -> mpmath.mpf:
        logs = whole - mpmath.loggamma(k + 1) - mpmath.loggamma(of - k + 1)
        return mpmath.exp(logs + k * mpmath.log(p) + (of - k) * mpmath.log(1 - p))

    odds = p / (1 - p)
    if least > of * p:  # the tail itself is small
        total, t, k = mpmath.mpf(0), term(least), least
        while k <= of and t > mpmath.mpf(10) ** -25:
            total, t, k = total + t, t * odds * (of - k) / (k + 1), k + 1
        return total
    total, k = mpmath.mpf(0), least - 1
    t = term(k)
    while k >= 0 and t > mpmath.mpf(10) ** -25:
        total, t, k = total + t, t / odds * k / (of - k + 1), k - 1
    return 1 - total


# ---------------------------------------------------------------- by flight


def test_what_scatters_as_poisson_does_is_called_so() -> None:
    rng = np.random.default_rng(1)
    counts, hours = rng.poisson(4.0, 500).tolist(), [0.1] * 500
    interval = rate_interval(counts, hours, most=100)
    assert interval == RateInterval(*garwood_interval(sum(counts), 50.0), POISSON)


@pytest.mark.parametrize(
    "counts",
    [
        [40, 41, 40, 39] * 300,  # the planner's episodes: variance / mean is 0.01
        [0] * 990 + [30] * 10,  # they come in bursts
        [3, 3, 3, 3, 3, 3],
        [2],
    ],
)
def test_what_does_not_scatter_so_is_bounded_by_flight(counts: list[int]) -> None:
    hours, n, most = 0.5, len(counts), 300
    interval = rate_interval(counts, [hours] * n, most=most)
    assert interval.basis == FLIGHTS
    assert interval.low < sum(counts) / n / hours < interval.high < most / hours
    with mpmath.workdps(40):  # capital that was staked on other means grew 40 times
        grown = []
        for bound, up in ((interval.low, True), (interval.high, False)):
            m, capital = mpmath.mpf(bound) * hours / most, mpmath.mpf(0)
            for k in range(16):
                product = mpmath.mpf(1)
                for value in set(counts):
                    x = mpmath.mpf(value) / most
                    gain = x / m - 1 if up else (m - x) / (1 - m)
                    product *= (1 + mpmath.mpf(2) ** -k * gain) ** counts.count(value)
                capital += product / 16
            grown.append(float(capital))
    assert grown == pytest.approx([40.0, 40.0], rel=1e-6)


def test_what_comes_like_clockwork_is_bounded_closely() -> None:
    interval = rate_interval([40, 41, 40, 39] * 300, [1.0] * 1200, most=301)
    assert 39.5 < interval.low < 40.0 < interval.high < 42.0
    bursts = rate_interval([0] * 990 + [30] * 10, [1.0] * 1000, most=301)
    exact = garwood_interval(300, 1000.0)
    assert bursts.low < exact[0] < exact[1] < bursts.high


def test_bounds_by_flight_hold_as_often_as_they_say() -> None:
    rng = np.random.default_rng(2)
    missed = 0
    for _ in range(150):
        counts = (rng.random(60) < 0.3) * rng.integers(0, 9, 60)  # mean 1.2, in bursts
        interval = rate_interval(counts.tolist(), [1.0] * 60, most=8)
        missed += not interval.low <= 1.2 <= interval.high
    assert missed <= 7


def test_copies_of_a_flight_widen_a_bound_and_never_narrow_it() -> None:
    clean = rate_interval([0] * 3600, [1 / 120] * 3600, most=9, kinds=["a"] * 3600)
    assert clean.high == pytest.approx(garwood_interval(0, 1 / 120)[1])
    often = rate_interval(
        [1] * 900 + [0] * 7, [1.0] * 907, most=9, kinds=["a"] * 900 + list("bcdefgh")
    )
    assert often.low < 1 / 8 < 900 / 907 < often.high


def test_flights_of_no_time_aloft_bound_nothing() -> None:
    assert rate_interval([0, 0], [0.0, 0.0], most=5) == RateInterval(0.0, inf, FLIGHTS)
    assert rate_interval([], [], most=5) == RateInterval(0.0, inf, FLIGHTS)
