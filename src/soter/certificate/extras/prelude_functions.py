"""Functions of the prelude but `clamp`, read as what they mean: `sin`, `atan2`, `pow`, ...

Purpose: `term_of_prelude_call` makes the term of a call, the exact function within its tested
bound; of `FUNCTIONS` each gives the line over one of them (of two numbers a slope for each).
Non-goals: functions whose body is read (`symbolic_reading.py`); the bounds, which are tested and
not proved (`language/prelude/function_error_bounds.py`), an assumption.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from flint import arb

from soter.certificate.reading.symbolic_operations import remembered_with_doubts
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import (
    HALF,
    ONE,
    TINIEST,
    UNIT,
    UNIT_ROUNDOFF,
    ZERO,
    exact,
    hull,
    larger,
    least_and_greatest,
    line_square,
    monotone_range,
    smaller,
    tangent,
    unbounded_line,
)
from soter.certificate.terms.terms import Linear, Terms, or_of
from soter.language.prelude.function_error_bounds import BOUNDS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.certificate.reading.symbolic_operations import Operations
    from soter.certificate.reading.symbolic_values import Value
    from soter.certificate.terms.linear_enclosures import Function, Line, Range

    Plane: TypeAlias = tuple[arb, arb, arb, arb, arb, arb]
    """A slope for each of two numbers, offset, spread, least, most."""


PI_UP = arb(arb.pi().upper())
PRELUDE = frozenset(
    "sin cos exp log tanh atan tan asin acos wrap_angle atan2 hypot pow smoothstep".split()  # noqa: SIM905 - a list of words
)
"""Functions of the prelude that are read as what they mean; of the others the body is read."""
OF_A_TURN = frozenset({"sin", "cos", "tan", "wrap_angle"})
"""Functions of the prelude that are the same a turn further."""
FAR_TURNS = exact(2.0**-33)
"""By how much more a sum with an angle in it may be rounded where that is many turns further: what
is shown of such sums in `left_out_states.py`."""
JUMPS = frozenset({"atan2", "wrap_angle"})
"""Functions of the prelude that jump where they have a value."""
EVERYWHERE = frozenset({"sin", "cos", "tanh", "atan"})
"""Functions of the prelude that have a value, and no large one, of all real numbers."""


def term_of_prelude_call(make: Operations, name: str, operands: Sequence[Value]) -> Value | None:
    """The term of a call that depends on inputs; None if the function's body must be read."""
    step = name == "smoothstep" and operands[0] == operands[1]
    if name in PRELUDE and not step:
        return prelude_function(make, name, *operands)
    return nearest_whole(make, *operands) if name == "_round" and not make.is_rounded else None


@remembered_with_doubts
def prelude_function(make: Operations, name: str, *operands: Value) -> Linear:
    """A prelude function: the exact function within its tested bound (an assumption).

    The claim: the result covers all values that the machine may compute. Let y be the exact value
    and u the unit roundoff. On the domain the machine computes y with an error of `ulps` units of y
    plus `absolute`, in `values` (`prelude/function_error_bounds.py`). A unit of y is at most 2 u
    |y|, or 1 + u times as much for the rounded double, and `TINIEST` if y is subnormal: the error
    is a share of |y| plus a constant. A flow uses y. Doubts that the result rests on: the argument
    is in the domain, and `exp` is finite. After whole turns an argument has `FAR_TURNS` more
    rounding. Raises NotRecheckedError for a bound of another kind.
    """
    bound, numbers = BOUNDS[name], [make.finite_term(x) for x in operands]
    if bound.relative:
        raise NotRecheckedError(f"`{name}` has a bound of another kind")
    turned = name in OF_A_TURN and may_be_turned(make.terms, numbers[0])
    if turned:
        (x,), far = numbers, FAR_TURNS
        around = x.low - far, x.high + far
        numbers = [Linear(x.const, x.terms, x.radius + far, *around, x.nonnegative)]
    if name in JUMPS:
        numbers = [make.widened_at_jump(x) for x in numbers]
    if make.everywhere and name in EVERYWHERE:
        return make.terms.apply_function(name, *numbers)
    for x, ends in zip(numbers, bound.domain, strict=True):
        low, high = map(exact, ends)
        make.add_doubt_below_zero(make.terms.combine(((ONE, x),), -low))
        make.add_doubt_below_zero(make.terms.combine(((-ONE, x),), high))
    if name == "wrap_angle" and make.is_rounded and not turned:
        return make.terms.apply_function("wrapped_double", *numbers)
    value = _exact_function(make, name, *numbers)
    ulps, absolute, low, high = map(exact, (bound.ulps, bound.absolute, *bound.values))
    relative = ulps * 2 * UNIT_ROUNDOFF * (1 + UNIT_ROUNDOFF)  # a unit is that of a double
    absolute += ulps * TINIEST
    if name in ("exp", "hypot", "pow") and value.low >= 0:  # what is computed is not, either
        value.nonnegative, low = True, ZERO
    beyond = make.terms.no_overflow_conditions(value)
    if not (make.is_rounded or beyond):
        return value
    off = with_error_bound(make.terms, value, relative, absolute, low, high)
    return replace(off, beyond=beyond)


def _exact_function(make: Operations, name: str, *numbers: Linear) -> Linear:
    """A prelude function over real numbers; the result assumes that the function has a value."""
    terms = make.terms
    if name == "tan":  # it has no value where the cosine is 0
        cosine = terms.apply_function("cos", *numbers)
        minus = terms.combine(((-ONE, cosine),))
        make.add_doubt(or_of(terms.below_zero(cosine), terms.below_zero(minus)))
    elif name == "hypot":
        squares = [terms.multiply(x, x) for x in numbers]
        return terms.apply_function("sqrt", terms.add(*squares), nonnegative=True)
    elif name == "pow":
        x, y = numbers
        if y.low == y.high >= 0 and y.low.is_integer():
            return terms.apply_function(name, x, Linear(y.low, {}, ZERO, y.low, y.low))
        make.add_doubt_below_zero(x)
        above, rises = (terms.below_zero(terms.combine(((-ONE, v),))) for v in (x, y))
        make.add_doubt(or_of(above, rises))
    elif name == "smoothstep":
        low, high, x = numbers
        parts = terms.subtract(x, low), terms.subtract(high, low)
        for difference in parts:
            make.finite_term(terms.rounded_term(difference))
        return terms.apply_function("smooth_step", terms.divide(*parts))
    return terms.apply_function(name, *numbers)


@remembered_with_doubts
def nearest_whole(make: Operations, x: Linear) -> Linear:
    """The whole number nearest to x over real numbers; a half is rounded up."""
    return make.terms.apply_function(
        "floor", make.widened_at_jump(make.terms.combine(((ONE, x),), HALF))
    )


def may_be_turned(terms: Terms, x: Linear) -> bool:
    """Whether a term contains angles that may be any number of turns further."""
    return not terms.turning.isdisjoint(x.terms)


def with_error_bound(
    terms: Terms, x: Linear, share: arb, extra: arb, low: arb, high: arb
) -> Linear:
    """The value `x` of a prelude function plus an error: `share` of x and `extra`; in [low, high].

    It holds for arguments in the function's domain; that domain is a separate obligation.
    """
    index = x.atom
    atom = terms.atoms[index]
    atom.extra, atom.share = extra, share
    atom.low = larger(atom.low - share * abs(atom.low) - extra, low)
    atom.high = smaller(atom.high + share * abs(atom.high) + extra, high)
    return Linear(ZERO, {index: ONE}, ZERO, atom.low, atom.high, x.nonnegative)


# ---------------------------------------------------------------- lines over functions


def _wave_range(shift: arb, f: Function, low: arb, high: arb) -> Range:
    """The range of a wave that is extreme only at (shift + k) pi: 1 for even k, -1 for odd k."""
    first = (low / arb.pi() - shift).lower().ceil()
    last = (high / arb.pi() - shift).upper().floor()
    if not last < first + 1:
        return -ONE, ONE
    least, most = monotone_range(f, low, high)
    if last < first:
        return least, most
    return (least, ONE) if first == 2 * (first * HALF).floor() else (-ONE, most)


def _line_log(low: arb, high: arb) -> Line:
    if not low > 0:
        return unbounded_line()
    curve = lambda x, _: -1 / (2 * x * x)  # noqa: E731
    return tangent(arb.log, lambda v: 1 / v, curve, monotone_range, low, high)


def _line_tan(low: arb, high: arb) -> Line:
    """The line over tan between two of its poles, which are at odd multiples of pi / 2."""
    turns = [(x / arb.pi() + HALF).floor() for x in (low, high)]
    if not turns[0] == turns[1]:  # noqa: SIM201 - of balls neither is certain
        return unbounded_line()
    slope, curve = (lambda v: 1 + v.tan() ** 2), (lambda _, y: y * (1 + y * y))
    return tangent(arb.tan, slope, curve, monotone_range, low, high)


def _line_of_arc(sign: int, f: Function, low: arb, high: arb) -> Line:
    """The line over asin (`sign` 1) or acos (-1) for the x in [-1, 1] of the interval."""
    low, high = (x.max(-ONE).min(ONE) for x in (low.lower(), high.upper()))

    def slope(v: arb) -> arb:
        return sign / (1 - v * v).sqrt()

    return tangent(f, slope, lambda x, _: HALF * x * slope(x) ** 3, monotone_range, low, high)


def line_smooth_step(low: arb, high: arb) -> Line:
    """The line over 3 t^2 - 2 t^3, with t as x clipped to [0, 1].

    The derivative is continuous, and changes with x as 6 - 12 t, or not at all beyond the ends.
    """
    if high <= 0 or low >= 1:
        end = ZERO if high <= 0 else ONE
        return ZERO, end, ZERO, end, end

    def clip(x: arb) -> arb:
        return x.max(ZERO).min(ONE)

    def curve(x: arb, _: arb) -> arb:
        inner = 3 - 6 * hull(clip(low), clip(high))
        return inner if x >= 0 and x <= 1 else hull(inner, ZERO)

    def smooth_step(x: arb) -> arb:
        return clip(x) ** 2 * (3 - 2 * clip(x))

    return tangent(
        smooth_step, lambda x: 6 * clip(x) * (1 - clip(x)), curve, monotone_range, low, high
    )


def line_wrap_angle(low: arb, high: arb) -> Line:
    """The line over the angle in [-pi, pi] of direction x; allows any angle near half a turn."""
    half = arb.pi()
    if low.is_finite() and high.is_finite():
        turns = ((low + high) * HALF / (2 * half) + HALF).mid().floor()
        back = 2 * half * turns
        if low - back > -half and high - back < half:
            ends = (low - back).lower(), (high - back).upper()
            return ONE, -back.mid(), arb(back.rad()), arb(ends[0]), arb(ends[1])
    return ZERO, ZERO, PI_UP, -PI_UP, PI_UP


def line_wrapped_double(low: arb, high: arb) -> Line:
    """The line over computed `wrap_angle`: x if x is in (-PI, PI], else near the angle of x."""
    if low > -math.pi and high <= math.pi:
        return ONE, ZERO, ZERO, low, high
    error = exact(BOUNDS["wrap_angle"].absolute)
    slope, offset, spread, least, most = line_wrap_angle(low - error, high + error)
    return slope, offset, spread + error, least, most


# ---------------------------------------------------------------- functions of two numbers


def _mean_value_plane(
    f: Callable[[arb, arb], arb], slopes: Sequence[arb], box: Sequence[Range], ends: Range
) -> Plane:
    """The plane over f by the mean value theorem: from ranges of f and of both derivatives."""
    middles, value, factors, rest = [((a + b) * HALF).mid() for a, b in box], hull(*ends), [], ZERO
    offset = f(*middles)
    for (low, high), middle, slope in zip(box, middles, slopes, strict=True):
        far = abs(high - middle).max(abs(low - middle))
        factors.append(ZERO if far.is_zero() else slope.mid())
        offset -= factors[-1] * middle
        rest += ZERO if far.is_zero() else (slope - factors[-1]) * far * UNIT
    if not rest.is_finite():
        return ZERO, ZERO, value.mid(), arb(value.rad()), *ends
    return factors[0], factors[1], offset + rest.mid(), arb(rest.rad()), *ends


def plane_atan2(low_y: arb, high_y: arb, low_x: arb, high_x: arb) -> Plane:
    """The plane over a point's angle; allows any angle near the origin and the negative x axis."""
    box = (low_y, high_y), (low_x, high_x)
    if not (low_x > 0 or low_y > 0 or high_y < 0):
        return ZERO, ZERO, ZERO, PI_UP, -PI_UP, PI_UP
    (a, b), (c, d) = (line_square(*ends)[3:] for ends in box)
    square, y, x = hull(a + c, b + d), hull(*box[0]), hull(*box[1])
    corners = [arb.atan2(a, b) for a in box[0] for b in box[1]]
    return _mean_value_plane(arb.atan2, (x / square, -y / square), box, least_and_greatest(corners))


def plane_pow(low_x: arb, high_x: arb, low_y: arb, high_y: arb) -> Plane:
    """The plane over x^y for x >= 0; for all x if y is a whole number that is at least 0."""
    xs, ys = (low_x.lower(), high_x.upper()), (low_y.lower(), high_y.upper())
    if not (ys[0] == ys[1] >= 0 and ys[0].is_integer()):
        xs = xs[0].max(ZERO), xs[1].max(ZERO)

    def ends(less: int) -> Range:
        values = [x ** (y - less) for x in xs for y in ys]
        return least_and_greatest(values if not xs[0] < 0 < xs[1] else [*values, ZERO])

    slopes = hull(*ys) * hull(*ends(1)), hull(*ends(0)) * hull(xs[0].log(), xs[1].log())
    return _mean_value_plane(arb.__pow__, slopes, (xs, ys), ends(0))


FUNCTIONS: dict[str, Callable[..., tuple[arb, ...]]] = {
    "sin": partial(tangent, arb.sin, arb.cos, lambda _, y: -y * HALF, partial(_wave_range, HALF)),
    "cos": partial(
        tangent, arb.cos, lambda v: -v.sin(), lambda _, y: -y * HALF, partial(_wave_range, ZERO)
    ),
    "exp": partial(tangent, arb.exp, arb.exp, lambda _, y: y * HALF, monotone_range),
    "log": _line_log,
    "tanh": partial(
        tangent,
        *(arb.tanh, lambda v: 1 - v.tanh() ** 2, lambda _, y: -y * (1 - y * y), monotone_range),
    ),
    "atan": partial(
        tangent,
        *(arb.atan, lambda v: 1 / (1 + v * v), lambda x, _: -x / (1 + x * x) ** 2, monotone_range),
    ),
    "tan": _line_tan,
    "asin": partial(_line_of_arc, 1, arb.asin),
    "acos": partial(_line_of_arc, -1, arb.acos),
    "smooth_step": line_smooth_step,
    "wrap_angle": line_wrap_angle,
    "wrapped_double": line_wrapped_double,
    "atan2": plane_atan2,
    "pow": plane_pow,
}
"""Exact functions; the prelude's errors are added by `prelude_function`."""
