"""Intervals for counts: how often something happens, from how often it did.

Purpose: exact intervals of Poisson rates (Garwood 1936) and of shares (Clopper and Pearson 1934),
from regularized incomplete gamma and beta functions; for what does not scatter as a Poisson count
does, intervals by flight that take no distribution for granted (Waudby-Smith and Ramdas 2024).
Non-goals: what is counted (`result.py`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import exp, fsum, inf, lgamma, log, log1p, sqrt
from statistics import NormalDist
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

CONFIDENCE = 0.95
POISSON, FLIGHTS = "poisson", "flights"
"""The assumption of an interval: counts scatter as Poisson's do, or flights are independent."""
STAKES = tuple(2.0**-k for k in range(16))
"""The shares of the capital that bets put at stake (`_betting_interval`)."""
STEPS = 200
TERMS = 1_000_000


@dataclass(frozen=True)
class RateInterval:
    """The interval of a rate per hour; `basis` is POISSON or FLIGHTS."""

    low: float
    high: float
    basis: str


def garwood_interval(count: int, amount: float) -> tuple[float, float]:
    """The interval of a Poisson rate per unit of `amount`, from `count` events.

    For amount 0 it is (0, inf). Without events it is one-sided: all of the error lies above.
    """
    if amount <= 0.0:
        return 0.0, inf
    missed = 1.0 - CONFIDENCE
    if count == 0:
        return 0.0, -log(missed) / amount
    return (
        _gamma_quantile(count, missed / 2) / amount,
        _gamma_quantile(count + 1, 1.0 - missed / 2) / amount,
    )


def clopper_pearson_interval(count: int, total: int) -> tuple[float, float]:
    """The interval of a probability from `count` of `total`; one-sided for 0 and for `total`."""
    if total <= 0:
        return 0.0, 1.0
    missed = 1.0 - CONFIDENCE
    if count in (0, total):
        bound = missed ** (1.0 / total)
        return (0.0, 1.0 - bound) if count == 0 else (bound, 1.0)
    return (
        _beta_quantile(count, total - count + 1, missed / 2),
        _beta_quantile(count + 1, total - count, 1.0 - missed / 2),
    )


# ---------------------------------------------------------------- by flight


def rate_interval(
    counts: Sequence[int],
    hours: Sequence[float],
    *,
    most: int,
    kinds: Sequence[Hashable] | None = None,
) -> RateInterval:
    """The interval of the rate per hour, from counts (n,) in flights of `hours` (n,).

    It is Garwood's if Fisher's dispersion test passes or all counts are 0. Otherwise it is a
    betting interval by flight, in which no count exceeds `most`. `kinds` (n,): flights of a kind
    are copies; the result also contains the interval from one flight of each kind.
    """
    interval = _garwood_or_betting_interval(counts, hours, most)
    if kinds is None or len(set(kinds)) == len(kinds):
        return interval
    first = {kind: k for k, kind in reversed(list(enumerate(kinds)))}.values()
    lone = _garwood_or_betting_interval([counts[k] for k in first], [hours[k] for k in first], most)
    basis = POISSON if interval.basis == lone.basis == POISSON else FLIGHTS
    return RateInterval(min(interval.low, lone.low), max(interval.high, lone.high), basis)


def share_interval(bad: Sequence[bool], kinds: Sequence[Hashable]) -> tuple[float, float]:
    """The interval of the share of `bad` flights; `kinds` is as in `rate_interval`."""
    low, high = clopper_pearson_interval(sum(bad), len(bad))
    bad_by_kind = dict(zip(kinds, bad, strict=True))
    if len(bad_by_kind) == len(bad):
        return low, high
    other = clopper_pearson_interval(sum(bad_by_kind.values()), len(bad_by_kind))
    return min(low, other[0]), max(high, other[1])


def scatters_as_poisson(counts: Sequence[int], hours: Sequence[float]) -> bool:
    """Whether Fisher's dispersion test (1950, two-sided, 5 %) passes; false for a single flight."""
    total, amount = sum(counts), fsum(hours)
    if len(counts) < 2 or total == 0 or amount <= 0.0:
        return False
    if any(c and h <= 0.0 for c, h in zip(counts, hours, strict=True)):
        return False
    pairs = [(c, total * h / amount) for c, h in zip(counts, hours, strict=True) if h > 0.0]
    if len(pairs) < 2:
        return False
    spread = fsum((c - mean) ** 2 / mean for c, mean in pairs)
    below = _regularized_gamma((len(pairs) - 1) / 2, spread / 2)
    missed = 1.0 - CONFIDENCE
    return missed / 2 <= below <= 1.0 - missed / 2


def _garwood_or_betting_interval(
    counts: Sequence[int], hours: Sequence[float], most: int
) -> RateInterval:
    """The interval of `rate_interval` for flights that are no copies of each other."""
    amount = fsum(hours)
    if amount <= 0.0:
        return RateInterval(0.0, inf, FLIGHTS)
    total = sum(counts)
    # without events the bound also holds for the share of violated flights, by any distribution:
    # -log(missed) / n is no less than Clopper's and Pearson's 1 - missed ** (1 / n)
    if total == 0 or scatters_as_poisson(counts, hours):
        return RateInterval(*garwood_interval(total, amount), POISSON)
    low, high = _betting_interval(counts, most)
    return RateInterval(low * len(counts) / amount, high * len(counts) / amount, FLIGHTS)


def _betting_interval(counts: Sequence[int], most: int) -> tuple[float, float]:
    """The interval of the mean of independent counts in [0, most], whatever their distribution.

    By betting (Waudby-Smith and Ramdas 2024): a player stakes the share c of a capital on each
    flight. If the mean were m, the capital would grow 40 times with a chance of at most 1 in 40
    (Ville). A mean is excluded if the capital, spread evenly over STAKES, grows so much.
    """
    largest = max(most, *counts, 1)
    table = [(value / largest, n) for value, n in Counter(counts).items()]
    mean = fsum(x * n for x, n in table) / len(counts)
    goal = log(2.0 * len(STAKES) / (1.0 - CONFIDENCE))

    def growth(factor: Callable[[float], float]) -> float:
        """The log of a capital that was 1; `factor`: the gain per unit of a flight of value x."""
        logs = [fsum(n * _log_or_inf(1.0 + c * factor(x)) for x, n in table) for c in STAKES]
        top = max(logs)
        return top + log(fsum(exp(v - top) for v in logs)) if top > -inf else -inf

    low = _last_included_mean(0.0, mean, lambda m: growth(lambda x: x / m - 1.0) >= goal)
    high = _last_included_mean(1.0, mean, lambda m: growth(lambda x: (m - x) / (1.0 - m)) >= goal)
    return low * largest, high * largest


def _log_or_inf(x: float) -> float:
    return log(x) if x > 0.0 else -inf


def _last_included_mean(end: float, mean: float, is_excluded: Callable[[float], bool]) -> float:
    """The last mean from `mean` towards `end` that is not excluded, rounded outwards."""
    inner, outer = mean, end
    for _ in range(STEPS):
        middle = 0.5 * (inner + outer)
        if middle in (inner, outer):
            break
        if is_excluded(middle):
            outer = middle
        else:
            inner = middle
    return outer


# ---------------------------------------------------------------- incomplete gamma and beta


def _regularized_gamma(a: float, x: float) -> float:
    """P(a, x), the regularized lower incomplete gamma function, by its series."""
    if x <= 0.0:
        return 0.0
    if x > a + 40.0 * sqrt(a) + 400.0:
        return 1.0  # the difference from 1 is too small for a double
    term = total = 1.0
    k = a
    while term > 1e-16 * total:
        k += 1.0
        term *= x / k
        total += term
    return min(1.0, total * exp(a * log(x) - x - lgamma(a + 1.0)))


def _gamma_quantile(a: float, p: float) -> float:
    """The x for which P(a, x) is p; the search starts at Wilson and Hilferty's approximation."""
    z = NormalDist().inv_cdf(p)
    guess = a * max(1.0 - 1.0 / (9.0 * a) + z / (3.0 * sqrt(a)), 1e-3) ** 3
    return _zero_of_rising(
        lambda x: _regularized_gamma(a, x) - p,
        lambda x: exp((a - 1.0) * log(x) - x - lgamma(a)),
        guess,
        a + 40.0 * sqrt(a) + 400.0,
    )


def _regularized_beta(a: float, b: float, x: float) -> float:
    """I_x(a, b), the regularized incomplete beta function, by its continued fraction."""
    if x <= 0.0 or x >= 1.0:
        return 0.0 if x <= 0.0 else 1.0
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _regularized_beta(b, a, 1.0 - x)
    tiny, c = 1e-300, 1.0
    d = 1.0 / (1.0 - (a + b) * x / (a + 1.0) or tiny)
    fraction, factor = d, 0.0
    for m in range(1, TERMS):
        if abs(factor - 1.0) < 1e-15:
            break
        for up in (
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        ):
            d = 1.0 / (1.0 + up * d or tiny)
            c = 1.0 + up / c or tiny
            factor = c * d
            fraction *= factor
    return fraction * exp(_log_beta_density(a, b, x) + log(x) + log1p(-x)) / a


def _log_beta_density(a: float, b: float, x: float) -> float:
    log_scale = lgamma(a + b) - lgamma(a) - lgamma(b)
    return log_scale + (a - 1.0) * log(x) + (b - 1.0) * log1p(-x)


def _beta_quantile(a: float, b: float, p: float) -> float:
    """The x at which I_x(a, b) is p."""
    return _zero_of_rising(
        lambda x: _regularized_beta(a, b, x) - p,
        lambda x: exp(_log_beta_density(a, b, x)),
        a / (a + b),
        1.0,
    )


def _zero_of_rising(
    f: Callable[[float], float], slope: Callable[[float], float], guess: float, high: float
) -> float:
    """The zero of a rising function in (0, high), found by Newton steps or else by bisection."""
    low, x = 0.0, guess
    for _ in range(STEPS):
        value = f(x)
        low, high = (x, high) if value < 0.0 else (low, x)
        rise = slope(x)
        new = x - value / rise if rise > 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-13 * x:
            return new
        x = new
    return x
