"""The prelude's functions in mpmath, and arguments worth trying.

`exact(name, arguments)` is the exact result to 160 bits; `arguments_of(name, count)` mixes dense,
random, log-random and hard arguments. Everything is seeded: a failure repeats.
"""

from __future__ import annotations

import itertools
import math
import random
from functools import cache
from typing import TYPE_CHECKING

import mpmath
from mpmath import mp, mpf

from soter.language.prelude.function_error_bounds import BOUNDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PRECISION_BITS = 160
LARGEST = math.nextafter(math.inf, 0.0)
OVERFLOW = mpf(2) ** 1024
HARDEST: dict[str, tuple[tuple[float, ...], ...]] = {
    "wrap_angle": ((78.539816339744831,),),
    "radians": ((28.635293178550114,),),
    "degrees": ((1.1166425651562921,),),
    "sin": ((-92724.87525702639,), (-57180.924026258785,), (2.355984610206292,)),
    "cos": ((0.80429893173571365,), (-73927.156573927874,)),
    "tan": ((2.3567233905740235,), (-77569.835268758514,)),
    "asin": ((0.50017566340185127,), (0.50882918642606967,)),
    "acos": ((-0.51533324697915117,), (-0.53351042136160265,)),
    "atan": ((0.51694666527069744,),),
    "atan2": ((0.073713896120523037, 0.29282105855787144),),
    "exp": ((-708.79731958051707,), (-0.94591623277298154,)),
    "log": ((1.4121107484667517,),),
    "pow": (
        (6.5190457834032526e-80, 3.8869771204827002),
        (0.75002367305229245, 3.6066692333641157),
    ),
    "tanh": ((0.5505799753662135,),),
    "hypot": ((0.50028117244510439, 0.76597146432057839),),
}
"""Arguments with the largest errors found so far, in sweeps of some 10^7 arguments a function."""


def _lerp(a: mpf, b: mpf, t: mpf) -> mpf:
    return (1 - t) * a + t * b


def _smoothstep(lo: mpf, hi: mpf, x: mpf) -> mpf:
    if lo == hi:
        return mpf(0 if x < lo else 1)
    t = min(max((x - lo) / (hi - lo), mpf(0)), mpf(1))
    return t * t * (3 - 2 * t)


def _atan2(y: mpf, x: mpf) -> mpf:
    return mpf(0) if x == y == 0 else mpmath.atan2(y, x)


def _pow(x: mpf, y: mpf) -> mpf:
    if abs(y) > 1e30 and abs(x) != 1:  # too large even for mpmath: only the direction matters
        y = mpf(10) ** 30 * mpmath.sign(y)
    power = (
        mpmath.exp(y * mpmath.log(abs(x)))
        if abs(y * mpmath.log(abs(x))) < 2000
        else (OVERFLOW * 2 if (y > 0) == (abs(x) > 1) else mpf(0))
    )
    return -power if x < 0 and y % 2 == 1 else power


SCALAR: dict[str, Callable[..., mpf]] = {
    "clamp": lambda x, lo, hi: min(max(x, lo), hi),
    "sign": mpmath.sign,
    "lerp": _lerp,
    "smoothstep": _smoothstep,
    "radians": lambda x: x * mp.pi / 180,
    "degrees": lambda x: x * 180 / mp.pi,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "tan": mpmath.tan,
    "asin": mpmath.asin,
    "acos": mpmath.acos,
    "atan": mpmath.atan,
    "atan2": _atan2,
    "exp": mpmath.exp,
    "log": mpmath.log,
    "pow": _pow,
    "tanh": mpmath.tanh,
    "hypot": mpmath.hypot,
}


def exact(name: str, arguments: tuple[float, ...]) -> mpf:
    """The exact value of a scalar function, to 160 bits."""
    with mpmath.workprec(PRECISION_BITS):
        return +SCALAR[name](*(mpf(a) for a in arguments))


def distance(computed: float, value: mpf) -> mpf:
    """|computed - exact|, an infinity standing for the first double that there is not."""
    with mpmath.workprec(PRECISION_BITS):
        if math.isnan(computed):
            return mpf("inf")
        limited = min(max(value, -OVERFLOW), OVERFLOW)
        shown = math.copysign(1.0, computed) * OVERFLOW if math.isinf(computed) else mpf(computed)
        return abs(shown - limited)


def ulp(value: mpf) -> mpf:
    """The spacing of the doubles at an exact value."""
    magnitude = abs(value)
    exponent = mpmath.frexp(magnitude)[1] - 1 if magnitude else -1022
    return mpf(2) ** (min(max(exponent, -1022), 1023) - 52)


# ---------------------------------------------------------------- arguments


def seeded(name: str) -> random.Random:
    """The same draws every time, different ones for every name."""
    return random.Random(f"{name} of the prelude")  # noqa: S311  nothing secret here


@cache
def hard_angles() -> tuple[float, ...]:
    """The doubles up to 1e5 next to multiples of pi/2: where a reduction loses most.

    m * 2^e is near a multiple of pi/2 when m is a small combination of the denominators of the
    continued fraction of 2^e * 2/pi.
    """
    angles: set[float] = set()
    with mpmath.workprec(400):
        for exponent in range(-53, -35):
            ratio = mpf(2) ** exponent * 2 / mp.pi
            for m in _near_whole(ratio):
                x = math.ldexp(m, exponent)
                if 0.5 < x <= 1.0e5:
                    angles.add(x)
    for quarter in range(1, 200):
        x = quarter * math.pi / 2
        angles.update((x, math.nextafter(x, 0.0), math.nextafter(x, math.inf)))
    return tuple(sorted(angles))


def _near_whole(ratio: mpf) -> Iterator[int]:
    """Integers m in [2^52, 2^53) with m * ratio very near a whole number."""
    previous, current, rest = 0, 1, ratio
    while current < 2**53:
        for a, b in itertools.product(range(-3, 4), repeat=2):
            combined = a * previous + b * current
            for m in (combined, combined * (2**52 // combined + 1) if combined > 0 else 0):
                if 2**52 <= m < 2**53:
                    yield m
        rest = 1 / (rest - mpmath.floor(rest))
        previous, current = current, previous + int(rest) * current


EDGES: dict[str, tuple[float, ...]] = {
    "sin": (math.pi / 4, 2.0**-27, 1.0e5),
    "cos": (math.pi / 4, 1.0e5),
    "tan": (math.pi / 4, 2.0**-27, 1.0e5),
    "asin": (0.5, 1.0),
    "acos": (0.5, 1.0),
    "atan": (0.5, 1.0, 2.0, 2.0**-27),
    "exp": tuple((k + 0.5) * math.log(2) for k in (*range(-4, 4), -1075, -1022, 1022)),
    "log": (1.0, math.sqrt(0.5), math.sqrt(2), 2.0**31, 1e300, 1e-300, 2.2250738585072014e-308),
    "tanh": (0.55, 2.0**-27, 19.06, 22.0),
}
"""Where a function changes its formula, and where a result is small beside its parts."""

RANGES: dict[str, tuple[tuple[float, float], ...]] = {
    "sin": ((-0.8, 0.8), (-7.0, 7.0), (-1.0e5, 1.0e5)),
    "cos": ((-0.8, 0.8), (-7.0, 7.0), (-1.0e5, 1.0e5)),
    "tan": ((-0.8, 0.8), (-7.0, 7.0), (-1.0e5, 1.0e5)),
    "asin": ((-1.0, 1.0), (0.499, 0.6)),
    "acos": ((-1.0, 1.0), (0.499, 0.6)),
    "atan": ((-3.0, 3.0), (0.49, 0.6)),
    "exp": ((-1.0, 1.0), (-745.2, 709.8), (-745.2, -708.0), (709.0, 709.79)),
    "log": ((0.5, 2.0), (0.0, 100.0)),
    "tanh": ((-1.0, 1.0), (0.54, 0.7), (-22.0, 22.0)),
}
MAGNITUDES: dict[str, tuple[float, float]] = {
    "sin": (1e-320, 1e5),
    "cos": (1e-320, 1e5),
    "tan": (1e-320, 1e5),
    "asin": (1e-320, 1.0),
    "acos": (1e-320, 1.0),
    "exp": (1e-320, 745.0),
}
"""Log-uniform magnitudes; every double where nothing is said."""


def _log_uniform(rng: random.Random, low: float, high: float) -> float:
    return min(max(math.exp(rng.uniform(math.log(low), math.log(high))), low), high)


def _any_double(rng: random.Random, low: float = 5e-324, high: float = LARGEST) -> float:
    return _log_uniform(rng, low, high) * rng.choice((-1.0, 1.0))


def _near(edge: float) -> Iterator[float]:
    """The edge and its neighbours, on both sides of zero."""
    below = above = edge
    for _ in range(4):
        yield from (below, above, -below, -above)
        below, above = math.nextafter(below, 0.0), math.nextafter(above, math.inf)


def _one(name: str, rng: random.Random, count: int) -> Iterator[tuple[float]]:
    ranges = RANGES.get(name, ((-10.0, 10.0),))
    for low, high in ranges:
        step = (high - low) / count
        yield from ((low + step * k,) for k in range(count + 1))
        yield from ((rng.uniform(low, high),) for _ in range(count))
    low, high = MAGNITUDES.get(name, (5e-324, LARGEST))
    yield from ((_any_double(rng, low, high),) for _ in range(count))
    yield from ((x,) for edge in EDGES.get(name, ()) for x in _near(edge))
    if name in {"sin", "cos", "tan"}:
        yield from ((s * x,) for x in hard_angles() for s in (1.0, -1.0))


def _two(name: str, rng: random.Random, count: int) -> Iterator[tuple[float, float]]:
    for _ in range(count):
        yield rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)
        yield _any_double(rng), _any_double(rng)
        x = _any_double(rng)
        yield x, x * rng.uniform(-3.0, 3.0)
        yield _any_double(rng, 5e-324, 1e-320), _any_double(rng, 5e-324, 1e-320)
        if name == "pow":
            yield rng.uniform(0.0, 10.0), rng.uniform(-10.0, 10.0)
            base = _log_uniform(rng, 1e-300, 1e300)
            yield base, rng.uniform(-745.0, 710.0) / math.log(base)
            near_one = 1.0 + rng.uniform(-1.0, 1.0) * 10.0 ** rng.uniform(-16.0, -1.0)
            if near_one != 1.0:
                yield near_one, rng.uniform(-745.0, 710.0) / math.log(near_one)
            yield -_log_uniform(rng, 1e-5, 1e5), float(rng.randint(-30, 30))
        else:
            yield rng.uniform(-1.0, 1.0), 10.0 ** rng.uniform(-9.0, 0.0)


def _three(name: str, rng: random.Random, count: int) -> Iterator[tuple[float, float, float]]:
    for _ in range(count):
        a, b, c = (rng.uniform(-10.0, 10.0) for _ in range(3))
        yield a, b, c
        yield a, math.nextafter(a, b), rng.choice((a, b))
        if name != "clamp":
            d, e, f = (_any_double(rng, 1e-100, 1e100) for _ in range(3))
            yield d, e, f


def arguments_of(name: str, count: int) -> Iterator[tuple[float, ...]]:
    """About `count` arguments of each kind, all inside the domain of the bound."""
    rng = seeded(name)
    makers = {1: _one, 2: _two, 3: _three}
    bound = BOUNDS[name]
    made = makers[len(bound.domain)](name, rng, count)
    for arguments in itertools.chain(HARDEST.get(name, ()), made):
        inside = all(
            low <= a <= high for a, (low, high) in zip(arguments, bound.domain, strict=True)
        )
        if inside and _defined(name, arguments):
            yield arguments


def _defined(name: str, arguments: tuple[float, ...]) -> bool:
    """Whether the exact function has a finite value there."""
    if not all(map(math.isfinite, arguments)):
        return False
    if name == "log":
        return arguments[0] > 0.0
    if name == "clamp":
        return arguments[1] <= arguments[2]
    if name == "pow":
        x, y = arguments
        return x != 0.0 and (x > 0.0 or y == math.floor(y))
    return True
