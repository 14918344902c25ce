"""The schemes of integration that may follow `integrate`.

Purpose: the only list of their names, stages and orders.
Non-goals: the arithmetic: each engine has its own (docs/semantics.md, Plants), and looks it up by
name, so that an unknown scheme is an error and never another scheme.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scheme:
    """A Runge-Kutta scheme; `stages` is how often one step evaluates the derivative."""

    name: str
    stages: int
    order: int


DEFAULT_SCHEME = "rk4"
SCHEMES = {s.name: s for s in (Scheme(DEFAULT_SCHEME, 4, 4), Scheme("euler", 1, 1))}
