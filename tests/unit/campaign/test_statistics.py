"""Exact intervals, against incomplete gamma and beta functions of mpmath."""

from __future__ import annotations

from math import inf, log

import mpmath
import pytest

from soter.campaign.statistics import rate, share


@pytest.mark.parametrize("count", [1, 2, 5, 34, 700])
def test_a_rate_is_that_of_garwood(count: int) -> None:
    low, high = rate(count, 2.0)
    # P(X >= count | low) = P(X <= count | high) = 2.5 %
    assert float(mpmath.gammainc(count, 0, 2 * low, regularized=True)) == pytest.approx(0.025)
    assert float(mpmath.gammainc(count + 1, 2 * high, regularized=True)) == pytest.approx(0.025)


@pytest.mark.parametrize(("count", "of"), [(1, 2), (3, 10), (34, 800), (799, 800)])
def test_a_share_is_that_of_clopper_and_pearson(count: int, of: int) -> None:
    low, high = share(count, of)
    below = mpmath.betainc(count, of - count + 1, 0, low, regularized=True)
    above = mpmath.betainc(count + 1, of - count, high, 1, regularized=True)
    assert (float(below), float(above)) == pytest.approx((0.025, 0.025))


def test_nothing_in_104_hours_is_a_bound() -> None:
    assert rate(0, 104.0)[1] == pytest.approx(-log(0.05) / 104.0)
    assert share(0, 1000)[1] == pytest.approx(1.0 - 0.05 ** (1 / 1000))
    assert share(1000, 1000)[0] == pytest.approx(0.05 ** (1 / 1000))


def test_of_nothing_nothing_is_known() -> None:
    assert rate(0, 0.0) == (0.0, inf)
    assert share(0, 0) == (0.0, 1.0)
