"""Small enclosure units by hand, and runs of the same systems in numpy."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.enclose.compiled_enclosures import ReachLibrary

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.core.layout import Bools
    from soter.verify.grid.sets import GridGroup

    Floats = npt.NDArray[np.float64]

HEAD = '#define SOTER_INPUTS {n}\n#include "soter_form.h"\n'
SIGNATURE = "unsigned soter_{name}(const soter_form in[], const int64_t param[], {type} out[]) {{\n"
END = "  (void)in;\n  (void)param;\n  return 0U;\n}}\n"

# in: p, v, u, w, ep, ev;  p' = v, v' = u + w;  u = clamp(-kp (p + ep) - kv (v + ev), +-brake);
# param: kp, kv, brake in thousandths
CAR = (
    SIGNATURE.format(name="law", type="soter_form")
    + """  soter_form p, v, a, b, s;
  const double kp = 1e-3 * (double)param[0], kv = 1e-3 * (double)param[1];
  const double brake = 1e-3 * (double)param[2];
  soter_n_add(SOTER_INPUTS, &p, &in[0], &in[4]);
  soter_n_add(SOTER_INPUTS, &v, &in[1], &in[5]);
  soter_n_scale(SOTER_INPUTS, &a, &p, -kp, -kp);
  soter_n_scale(SOTER_INPUTS, &b, &v, -kv, -kv);
  soter_n_add(SOTER_INPUTS, &s, &a, &b);
  soter_n_at_most(SOTER_INPUTS, &a, &s, brake);
  soter_n_at_least(SOTER_INPUTS, &out[0], &a, -brake);
"""
    + END.format()
    + SIGNATURE.format(name="derivative", type="soter_form")
    + "  out[0] = in[1];\n  soter_n_add(SOTER_INPUTS, &out[1], &in[2], &in[3]);\n"
    + END.format()
    + SIGNATURE.format(name="safe", type="soter_truth")
    + """  soter_form wall, size;
  soter_n_range(SOTER_INPUTS, &wall, 1.5, 1.5);
  soter_n_abs(SOTER_INPUTS, &size, &in[0]);
  out[0] = soter_n_no_more(SOTER_INPUTS, &size, &wall);
"""
    + END.format()
)

# in: angle, rate, u, w;  angle' = rate, rate' = -sin(angle) - rate |rate| / 5 + u + w;  a pendulum
# held at rest. sin by a form: x - x^3 / 6 encloses it within |x|^5 / 120.
PENDULUM = (
    SIGNATURE.format(name="law", type="soter_form")
    + """  soter_form a, b, s;
  soter_n_scale(SOTER_INPUTS, &a, &in[0], -KP, -KP);
  soter_n_scale(SOTER_INPUTS, &b, &in[1], -KV, -KV);
  soter_n_add(SOTER_INPUTS, &s, &a, &b);
  soter_n_at_most(SOTER_INPUTS, &a, &s, BRAKE);
  soter_n_at_least(SOTER_INPUTS, &out[0], &a, -BRAKE);
"""
    + END.format()
    + SIGNATURE.format(name="derivative", type="soter_form")
    + """  soter_form square, cube, sine, size, drag, a, b;
  const double most = soter_size(&in[0]);
  const double rest = most * most * most * most * most / 119.0;
  out[0] = in[1];
  soter_n_square(SOTER_INPUTS, &square, &in[0]);
  soter_n_mul(SOTER_INPUTS, &cube, &square, &in[0]);
  soter_n_scale(SOTER_INPUTS, &a, &cube, -1.0 / 6.0, -1.0 / 6.0);
  soter_n_add(SOTER_INPUTS, &b, &in[0], &a);
  soter_n_shift(SOTER_INPUTS, &sine, &b, -rest - 1e-15, rest + 1e-15);
  soter_n_abs(SOTER_INPUTS, &size, &in[1]);
  soter_n_mul(SOTER_INPUTS, &a, &size, &in[1]);
  soter_n_scale(SOTER_INPUTS, &drag, &a, 0.2, 0.2);
  soter_n_add(SOTER_INPUTS, &a, &in[2], &in[3]);
  soter_n_sub(SOTER_INPUTS, &b, &a, &sine);
  soter_n_sub(SOTER_INPUTS, &out[1], &b, &drag);
"""
    + END.format()
)

# in: x, v, u;  v+ = clip(v + 0.1 u - 0.05 x, +-0.5), x+ = x + v+
HILL = (
    SIGNATURE.format(name="law", type="soter_form")
    + """  soter_form a, b, s;
  soter_n_scale(SOTER_INPUTS, &a, &in[0], -KP, -KP);
  soter_n_scale(SOTER_INPUTS, &b, &in[1], -KV, -KV);
  soter_n_add(SOTER_INPUTS, &s, &a, &b);
  soter_n_at_most(SOTER_INPUTS, &a, &s, 1.0);
  soter_n_at_least(SOTER_INPUTS, &out[0], &a, -1.0);
"""
    + END.format()
    + SIGNATURE.format(name="next", type="soter_form")
    + """  soter_form a, b, s;
  soter_n_scale(SOTER_INPUTS, &a, &in[2], 0.1, 0.1);
  soter_n_add(SOTER_INPUTS, &s, &in[1], &a);
  soter_n_scale(SOTER_INPUTS, &b, &in[0], 0.05, 0.05);
  soter_n_sub(SOTER_INPUTS, &a, &s, &b);
  soter_n_at_most(SOTER_INPUTS, &b, &a, 0.5);
  soter_n_at_least(SOTER_INPUTS, &out[1], &b, -0.5);
  soter_n_add(SOTER_INPUTS, &out[0], &in[0], &out[1]);
"""
    + END.format()
)


def _source(text: str, inputs: int, constants: dict[str, float]) -> str:
    defined = "".join(f"#define {k} ({v!r})\n" for k, v in constants.items())
    return HEAD.format(n=inputs) + defined + text


QUICK = ("-O1",)
"""Compiling takes longer than running."""


@lru_cache(maxsize=1)
def car() -> ReachLibrary:
    """A double integrator with a wall on both sides, noise on the rate, errors on both readings."""
    return ReachLibrary(_source(CAR, 6, {}), QUICK)


@lru_cache(maxsize=8)
def linear(source: str) -> ReachLibrary:
    """A system of `linear_source`."""
    return ReachLibrary(source, QUICK)


@lru_cache(maxsize=2)
def pendulum(kp: float, kv: float, brake: float) -> ReachLibrary:
    """A damped pendulum: a nonlinear flow."""
    return ReachLibrary(_source(PENDULUM, 4, {"KP": kp, "KV": kv, "BRAKE": brake}), QUICK)


@lru_cache(maxsize=2)
def hill(kp: float, kv: float) -> ReachLibrary:
    """A map of two states."""
    return ReachLibrary(_source(HILL, 3, {"KP": kp, "KV": kv}), QUICK)


def safe_in_pieces(engine: GridGroup, t_ns: int, target: Bools, pieces: int) -> Bools:
    """R(t) by tubes of so many pieces; the engine itself takes more of them while that pays off."""
    return engine._cells_safe_in_pieces(t_ns, target, np.zeros_like(target), pieces)


def corner(rng: np.random.Generator, low: float, high: float, shape: tuple[int, ...]) -> Floats:
    """Draws in [low, high], mostly at its ends."""
    inside = rng.uniform(low, high, shape)
    ends = np.where(rng.random(shape) < 0.5, low, high)
    return np.where(rng.random(shape) < 0.7, ends, inside)


def linear_source(a: Floats, b: Floats, gains: Floats, limit: float) -> str:
    """in: x (n), u (m), w (n); x' = a x + b u + w, u = clamp(-gains x, +-limit)."""
    n, m = b.shape

    def combined(target: str, weights: Floats, first: int, more: str = "") -> list[str]:
        lines = [
            "    soter_form sum, part, next;",
            "    soter_n_range(SOTER_INPUTS, &sum, 0.0, 0.0);",
        ]
        for k, weight in enumerate(weights):
            if weight:
                lines += [
                    f"    soter_n_scale(SOTER_INPUTS, &part, &in[{first + k}], {weight!r},",
                    f"                  {weight!r});",
                    "    soter_n_add(SOTER_INPUTS, &next, &sum, &part);",
                    "    sum = next;",
                ]
        return ["  {", *lines, more, f"    {target} = sum;", "  }"]

    law = []
    for k in range(m):
        clamped = (
            f"    soter_n_at_most(SOTER_INPUTS, &part, &sum, {limit!r});\n"
            f"    soter_n_at_least(SOTER_INPUTS, &sum, &part, {-limit!r});"
        )
        law += combined(f"out[{k}]", -gains[k], 0, clamped)
    rate = []
    for i in range(n):
        weights = np.concatenate([a[i], b[i], np.eye(n)[i]])
        rate += combined(f"out[{i}]", weights, 0)
    text = SIGNATURE.format(name="law", type="soter_form") + "\n".join(law) + "\n" + END.format()
    text += SIGNATURE.format(name="derivative", type="soter_form") + "\n".join(rate) + "\n"
    return _source(text + END.format(), 2 * n + m, {}).replace("np.float64(", "(")


def exact(a: Floats, h: float) -> tuple[Floats, Floats]:
    """e^(a h) and its integral over [0, h]."""
    z, n = a * h / 64, len(a)
    power, phi, integral = np.eye(n), np.eye(n), np.eye(n)
    for k in range(1, 20):
        power = power @ z / k
        phi = phi + power
        integral = integral + power / (k + 1)
    integral = integral * h / 64
    for _ in range(6):
        integral = integral + phi @ integral
        phi = phi @ phi
    return phi, integral
