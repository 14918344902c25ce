"""The schemes of integration that may follow `integrate`.

Purpose: the one list of their names, with evaluations of the derivative and orders.
Non-goals: the arithmetic: each engine has its own (docs/semantics.md, Plants), and looks it up by
name, so that an unknown scheme is an error and never another scheme.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scheme:
    """A Runge-Kutta scheme: evaluations of the derivative a step, and its order."""

    name: str
    stages: int
    order: int


DEFAULT_SCHEME = "rk4"
SCHEMES = {s.name: s for s in (Scheme(DEFAULT_SCHEME, 4, 4), Scheme("euler", 1, 1))}
