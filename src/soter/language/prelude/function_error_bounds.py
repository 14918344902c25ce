"""How far the functions of the prelude may be from the exact value.

Purpose: the one machine-readable table of error bounds: the comments in `math.soter` and
`vectors.soter` repeat it, `tests/unit/prelude/` measures it, and an interval back
end widens by it.
Non-goals: computing anything; bounds of expressions made of several functions.

The bounds are tested, not proved. Each was first estimated by hand: what the polynomial leaves out,
and half a unit for every rounding, by the weight with which it reaches the result. The worst errors
found so far, at arguments that the tests know, stay below the bounds by a sixth to a half.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_LARGEST = math.nextafter(math.inf, 0.0)
_EVERY = (-math.inf, math.inf)
_FINITE = (-_LARGEST, _LARGEST)
_ANGLE = (-1.0e5, 1.0e5)
_UNIT = (-1.0, 1.0)
_HALF_PI = math.pi / 2

UNIT_ROUNDOFF = 2.0**-53


@dataclass(frozen=True, slots=True)
class ErrorBound:
    """|computed - exact| <= ulps * ulp(exact) + absolute + relative * 2^-53 * scale.

    `ulp(v)` is the spacing of the doubles at v (2^-1074 where subnormal). For a record, the bound
    holds for each component. If the exact value rounds to infinity or zero, so does the computed
    value. `scale` is an expression in the argument names, with |.| for the Euclidean norm.
    """

    domain: tuple[tuple[float, float], ...]
    """A closed interval for each float argument, for each component of a record argument."""
    ulps: float = 0.0
    absolute: float = 0.0
    relative: float = 0.0
    scale: str = ""
    values: tuple[float, float] = _EVERY
    """No computed value lies outside, for whatever argument (NaN apart)."""
    outside: str = ""
    """What an argument outside the domain gives; empty where there is none but NaN."""

    def at(self, exact: float) -> float:
        """Gives the bound on the error at the exact value, for a function without a `scale`."""
        assert not self.relative, "the scale depends on the arguments"
        return self.ulps * math.ulp(exact) + self.absolute


BOUNDS: dict[str, ErrorBound] = {
    # ------------------------------------------------ comparison and interpolation
    "clamp": ErrorBound((_EVERY, _EVERY, _EVERY), outside="NaN where lo > hi"),
    "sign": ErrorBound((_EVERY,), values=_UNIT),
    "lerp": ErrorBound((_FINITE, _FINITE, _FINITE), relative=4.0, scale="|1-t| |a| + |t| |b|"),
    "smoothstep": ErrorBound((_FINITE, _FINITE, _FINITE), absolute=1.0e-15, values=(0.0, 1.0)),
    # ------------------------------------------------ angles
    "radians": ErrorBound((_FINITE,), ulps=1.0),
    "degrees": ErrorBound((_FINITE,), ulps=1.0),
    "wrap_angle": ErrorBound(
        (_ANGLE,),
        absolute=7.0e-16,
        values=(-math.pi, math.pi),
        outside="NaN",
    ),  # modulo a full turn
    "sin": ErrorBound((_ANGLE,), ulps=1.0, values=_UNIT, outside="NaN"),
    "cos": ErrorBound((_ANGLE,), ulps=1.0, values=_UNIT, outside="NaN"),
    "tan": ErrorBound((_ANGLE,), ulps=3.0, outside="NaN"),
    "asin": ErrorBound((_UNIT,), ulps=1.0, values=(-_HALF_PI, _HALF_PI), outside="NaN"),
    "acos": ErrorBound((_UNIT,), ulps=1.0, values=(0.0, math.pi), outside="NaN"),
    "atan": ErrorBound((_EVERY,), ulps=1.5, values=(-_HALF_PI, _HALF_PI)),
    "atan2": ErrorBound((_EVERY, _EVERY), ulps=2.0, values=(-math.pi, math.pi)),
    # ------------------------------------------------ exponentials and powers
    "exp": ErrorBound((_EVERY,), ulps=1.0, values=(0.0, math.inf)),
    "log": ErrorBound(((0.0, math.inf),), ulps=1.0, outside="NaN"),
    "pow": ErrorBound((_EVERY, _EVERY), ulps=1.0, outside="NaN where x < 0 and y is not whole"),
    "tanh": ErrorBound((_EVERY,), ulps=2.0, values=_UNIT),
    "hypot": ErrorBound((_EVERY, _EVERY), ulps=1.5, values=(0.0, math.inf)),
    # ------------------------------------------------ vectors
    "cross": ErrorBound((_FINITE,) * 6, relative=3.0, scale="|a| |b|"),
    "unit": ErrorBound((_FINITE,) * 6, ulps=3.0, absolute=1.0e-290),
    "unit2": ErrorBound((_FINITE,) * 4, ulps=3.0, absolute=1.0e-290),
    "quat_conj": ErrorBound((_EVERY,) * 4),
    "quat_mul": ErrorBound((_FINITE,) * 8, relative=5.0, scale="|a| |b|"),
    "quat_normalize": ErrorBound((_FINITE,) * 4, ulps=3.5, absolute=1.0e-290),
    # q within 1e-9 of the unit sphere
    "quat_rotate": ErrorBound((_UNIT,) * 4 + (_FINITE,) * 3, relative=16.0, scale="|v|"),
    "quat_rotate_inverse": ErrorBound((_UNIT,) * 4 + (_FINITE,) * 3, relative=16.0, scale="|v|"),
}
