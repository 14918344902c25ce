"""The machine operations of Soter in Python, bit for bit those of C.

Purpose: one place for the traps between Python and the machine: unbounded ints, division that
floors, `math` functions that raise. The constant evaluator and the reference interpreter use
nothing else for arithmetic that can differ; float `+ - *` and all comparisons are Python's own. For
vectors (records and arrays of only floats) it builds functions that work on each component, so that
nothing looks at types while a program runs. `require_default_float_rules` checks that this thread
computes doubles by IEEE rules, and restores its settings: loading a library that was built with
`-ffast-math` is enough to make numbers below 2e-308 zero, and a violation may then go unnoticed.
Non-goals: which operation an expression means (`expressions.py`), intervals (`verify/`), the
settings of other threads and of a package (`runtime/soter_self_test.c`).

Every operation that may fault takes the span to report, and raises `StepFault`. Fault codes,
`min`, `max`, `abs`, `floor` and `sqrt` are those of docs/semantics.md, section Numbers.
"""

from __future__ import annotations

import ctypes
import math
from contextlib import suppress
from enum import IntEnum
from typing import TYPE_CHECKING, TypeVar

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.model.types import INT_MAX, INT_MIN, ArrayType, FloatType, RecordType

Number = TypeVar("Number", int, float)

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.types import Type, Value

    Unary = Callable[[float], float]
    Binary = Callable[[float, float], float]


NAN = math.nan
"""The only NaN that is ever stored: 0x7ff8000000000000."""

_INTEGRAL_FROM = 2.0**52
"""From this magnitude on every binary64 number is a whole number."""

_INT_BEYOND = 2.0**63
"""The first float above every 64-bit int."""


class FaultKind(IntEnum):
    """The kinds of step faults, with the codes of docs/semantics.md."""

    OVERFLOW = 1
    INDEX = 2
    DIVIDE = 3
    CONVERT = 4
    ASSERT = 5
    CAPACITY = 6
    NONFINITE = 7
    RANGE = 8
    EXTERN = 9
    SHIELD = 10


class StepFault(Exception):  # noqa: N818  the paper's steps fault; "error" would suggest a bug
    """An error in a step of the program, which therefore has no effect.

    `detail` is for people (the text of an `assert`, the exception of an extern).
    """

    def __init__(self, kind: FaultKind, span: Span | None = None, detail: str = "") -> None:
        super().__init__(kind.name.lower() + (f": {detail}" if detail else ""))
        self.kind = kind
        self.span = span
        self.detail = detail


# ---------------------------------------------------------------- int


def require_int64(result: int, span: Span | None = None) -> int:
    """Gives `result` if it fits 64 bits; raises StepFault (overflow) otherwise."""
    if INT_MIN <= result <= INT_MAX:
        return result
    raise StepFault(FaultKind.OVERFLOW, span)


def add_int(a: int, b: int, span: Span | None = None) -> int:
    """Gives `a + b`; raises StepFault (overflow) if the sum does not fit 64 bits."""
    return require_int64(a + b, span)


def sub_int(a: int, b: int, span: Span | None = None) -> int:
    """Gives `a - b`; raises StepFault (overflow) if the difference does not fit 64 bits."""
    return require_int64(a - b, span)


def mul_int(a: int, b: int, span: Span | None = None) -> int:
    """Gives `a * b`; raises StepFault (overflow) if the product does not fit 64 bits."""
    return require_int64(a * b, span)


def neg_int(a: int, span: Span | None = None) -> int:
    """Gives `-a`; raises StepFault (overflow) for the smallest int."""
    return require_int64(-a, span)


def abs_int(a: int, span: Span | None = None) -> int:
    """Gives `|a|`; raises StepFault (overflow) for the smallest int."""
    return require_int64(abs(a), span)


def div_int(a: int, b: int, span: Span | None = None) -> int:
    """Gives `a / b`, truncated; raises StepFault for b = 0 and for the smallest int by -1."""
    if b == 0:
        raise StepFault(FaultKind.DIVIDE, span)
    quotient = abs(a) // abs(b)
    return require_int64(quotient if (a < 0) == (b < 0) else -quotient, span)


def mod_int(a: int, b: int, span: Span | None = None) -> int:
    """Gives `a % b` with the sign of `a`, as in C; smallest int % -1 is 0; StepFault for b = 0."""
    if b == 0:
        raise StepFault(FaultKind.DIVIDE, span)
    remainder = abs(a) % abs(b)
    return -remainder if a < 0 else remainder


def require_in_range(a: int, low: int, high: int, span: Span | None = None) -> int:
    """Gives `a` if it lies in `[low, high]`; raises StepFault (overflow) otherwise."""
    if low <= a <= high:
        return a
    raise StepFault(FaultKind.OVERFLOW, span)


# ---------------------------------------------------------------- float


def div_float(a: float, b: float, span: Span | None = None) -> float:
    """Gives `a / b`; raises StepFault if b is zero of either sign, whatever `a` is."""
    if b == 0.0:
        raise StepFault(FaultKind.DIVIDE, span)
    return a / b


def sqrt(x: float) -> float:
    """Gives the correctly rounded square root; NaN for negative numbers, and -0.0 for -0.0."""
    return NAN if x < 0.0 else math.sqrt(x)


def floor(x: float) -> float:
    """Gives the largest whole number not above `x`, as a float; NaN, infinities and -0.0 stay."""
    if not -_INTEGRAL_FROM < x < _INTEGRAL_FROM or x == 0.0:
        return x
    return float(math.floor(x))


def int_of_float(x: float, span: Span | None = None) -> int:
    """Gives `x` truncated towards zero; raises StepFault if it is NaN or does not fit 64 bits."""
    if -_INT_BEYOND <= x < _INT_BEYOND:
        return int(x)
    raise StepFault(FaultKind.CONVERT, span)


def seconds(ns: int) -> float:
    """Gives a duration of `ns` nanoseconds in seconds."""
    return float(ns) / 1e9


def with_stored_nan(x: float) -> float:
    """Gives `x`, but for any NaN the one value `NAN` that is stored."""
    return x if x == x else NAN  # noqa: PLR0124  only NaN differs from itself


# ---------------------------------------------------------------- both


def minimum(a: Number, b: Number) -> Number:
    """Gives `b < a ? b : a`, which is `a` if either number is NaN."""
    return b if b < a else a  # noqa: FURB136  Python's min(a, b) leaves this order unsaid


def maximum(a: Number, b: Number) -> Number:
    """Gives `b > a ? b : a`, which is `a` if either number is NaN."""
    return b if b > a else a  # noqa: FURB136  as above


def saturate(x: float, limit: float) -> float:
    """Gives `min(max(x, -limit), limit)`."""
    return minimum(maximum(x, -limit), limit)


def _component_types(t: Type) -> tuple[Type, ...]:
    if isinstance(t, RecordType):
        return tuple(f for _, f in t.fields)
    assert isinstance(t, ArrayType), t
    return (t.element,) * t.size


def _has_only_floats(t: Type) -> bool:
    return all(isinstance(c, FloatType) for c in _component_types(t))


def function_on_pairs(t: Type) -> Callable[[Binary, Value, Value], Value]:
    """Gives `(op, a, b) -> value`, which applies `op` to the components of two values of `t`."""
    if isinstance(t, FloatType):
        return lambda op, a, b: op(a, b)
    if _has_only_floats(t):
        return lambda op, a, b: tuple(map(op, a, b))
    parts = [function_on_pairs(c) for c in _component_types(t)]
    return lambda op, a, b: tuple([z(op, x, y) for z, x, y in zip(parts, a, b, strict=True)])


def function_on_components(t: Type) -> Callable[[Unary, Value], Value]:
    """Gives `(op, a) -> value`, which applies `op` to each component of a value of type `t`."""
    if isinstance(t, FloatType):
        return lambda op, a: op(a)
    if _has_only_floats(t):
        return lambda op, a: tuple(map(op, a))
    parts = [function_on_components(c) for c in _component_types(t)]
    return lambda op, a: tuple([m(op, x) for m, x in zip(parts, a, strict=True)])


def leaves_function(t: Type) -> Callable[[Value], tuple[float, ...]]:
    """Gives `value -> leaves` for values of type `t`, with the leaves in declared order."""
    if isinstance(t, FloatType):
        return lambda a: (a,)
    if _has_only_floats(t):
        return lambda a: a
    parts = [leaves_function(c) for c in _component_types(t)]
    return lambda a: tuple([leaf for f, x in zip(parts, a, strict=True) for leaf in f(x)])


def dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Gives `((a0*b0 + a1*b1) + a2*b2) + ...` of two vectors of at least one float."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total += x * y
    return total


ONE, HALF_STEP, ODD = 1.0, 2.0**-53, 1.0 + 2.0**-52
LEAST_NORMAL, HALF = 2.0**-1022, 0.5
ENVIRONMENT_BYTES = 512
"""A buffer of this size holds the `fenv_t` of any C library."""


def broken_float_rule() -> str:
    """Gives the default IEEE rule that this thread's floats break, in words; "" if none."""
    if ONE + HALF_STEP != ONE or ODD + HALF_STEP == ODD or -ONE - HALF_STEP != -ONE:
        return "sums are not rounded to the nearest double"
    if not LEAST_NORMAL * HALF > 0.0:
        return "numbers below 2e-308 are taken for zero"
    return ""


def require_default_float_rules() -> None:
    """Raises SoterError X012 if this thread's floats do not follow the default IEEE rules."""
    wrong = broken_float_rule()
    if wrong:
        raise SoterError(
            (
                Diagnostic(
                    "X012",
                    f"this process does not compute as programs mean it: {wrong}",
                    notes=("what it computed since then is not what the program means",),
                    helps=("look for libraries built with `-Ofast`, and for `fesetround`",),
                ),
            )
        )


def restore_float_settings() -> None:
    """Restores the floating-point settings that held when this file was loaded."""
    if _PLAIN is not None and broken_float_rule():
        _PLAIN[0].fesetenv(_PLAIN[1])


def _default_float_settings() -> tuple[ctypes.CDLL, ctypes.Array[ctypes.c_char]] | None:
    """Gives the C library and its present float settings; None if they are not the default."""
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        kept = ctypes.create_string_buffer(ENVIRONMENT_BYTES)
        if not broken_float_rule() and library.fegetenv(kept) == 0 and library.fesetenv(kept) == 0:
            return library, kept
    return None


_PLAIN = _default_float_settings()
