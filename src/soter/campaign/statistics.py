"""Exact intervals for counts: how often something happens, from how often it did.

Purpose: Poisson rates and binomial shares with a two-sided confidence, by bisection on the exact
sums (Garwood 1936; Clopper and Pearson 1934).
Non-goals: approximations, anything that needs a distribution's table.
"""

from __future__ import annotations

from math import exp, inf, lgamma, log
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

CONFIDENCE = 0.95


def rate(count: int, amount: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """What the rate per unit of `amount` lies in, for `count` events; (0, inf) of no amount.

    Where nothing happened the bound is one-sided: all of what may be missed lies above.
    """
    if amount <= 0.0:
        return 0.0, inf
    missed = 1.0 - confidence
    if count == 0:
        return 0.0, -log(missed) / amount
    low = _solved(lambda m: 1.0 - _poisson(count - 1, m), missed / 2, rising=True, high=count)
    high = _solved(lambda m: _poisson(count, m), missed / 2, rising=False, high=10.0 * count + 50.0)
    return low / amount, high / amount


def share(count: int, of: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """What a probability lies in, for `count` of so many; one-sided where it is none, or all."""
    if of <= 0:
        return 0.0, 1.0
    missed = 1.0 - confidence
    if count in (0, of):
        bound = missed ** (1.0 / of)
        return (0.0, 1.0 - bound) if count == 0 else (bound, 1.0)
    low = _solved(lambda p: 1.0 - _binomial(count - 1, of, p), missed / 2, rising=True, high=1.0)
    high = _solved(lambda p: _binomial(count, of, p), missed / 2, rising=False, high=1.0)
    return low, high


def _solved(f: Callable[[float], float], value: float, *, rising: bool, high: float) -> float:
    """Where a monotone function takes a value, in [0, high]."""
    low = 0.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if (f(middle) < value) == rising:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _poisson(most: int, mean: float) -> float:
    """P(X <= most)."""
    if mean <= 0.0:
        return 1.0
    return min(1.0, sum(exp(k * log(mean) - mean - lgamma(k + 1)) for k in range(most + 1)))


def _binomial(most: int, of: int, p: float) -> float:
    """P(X <= most)."""
    if p <= 0.0 or p >= 1.0:
        return 1.0 if p <= 0.0 or most >= of else 0.0
    whole = lgamma(of + 1)
    terms = (
        exp(whole - lgamma(k + 1) - lgamma(of - k + 1) + k * log(p) + (of - k) * log(1.0 - p))
        for k in range(most + 1)
    )
    return min(1.0, sum(terms))
