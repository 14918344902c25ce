"""Ends of a grid that the plant itself keeps, and rates that are zero but for rounding.

Purpose: what `soter_reach_invariant_ends.c` goes by. A level that is never below zero, a state
between two stops: a grid may end exactly there, though images round outward.
Non-goals: ends that only SC keeps; commands may be anything in U here.

An end is kept when the flow points inwards, or along it, all over a strip beyond it, for all
commands, disturbances and other states within their ranges. The strip is a part of the domain of
the enclosures: what lies between the grid and what a run, followed back to where it was read, may
have come from. The argument stands in `soter_reach_invariant_ends.c`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.verify.grid.group_inputs import GridInputs

    Floats = NDArray[np.float64]

UNBOUNDED, WRAPS = 2, 3
"""As `SOTER_REACH_UNBOUNDED`, `SOTER_REACH_WRAPS`: beyond such an end of an axis is its last cell,
or its first one."""
BACK = 4.0
"""How much further than |x'| (d + 2 j) the strip goes: a-priori boxes are larger than runs."""
DUST = 1e-10
"""Rates of this share of the largest one may be zero but for rounding: worth a second look."""
LOOK_AHEAD = 4.0
"""Steps of the simulator by whose rates its stages stay near the state."""


class BorderedModel(Protocol):
    """What of a group's model the borders look at, and change: `low`, `high`, `crossed`."""

    c: Any
    inputs: GridInputs
    axes: tuple[int, ...]
    open_ends: frozenset[int]
    unbounded: frozenset[int]
    wraps: frozenset[int]
    covers_scheme: bool
    crossed: list[str]
    low: Floats
    high: Floats

    @property
    def edges(self) -> Sequence[Floats]:
        """Breakpoints of each axis, (cells + 1,)."""

    def rates_within(self, low: Floats, high: Floats) -> Floats | None:
        """Bounds (states, 2) of the rates over ranges of all inputs; None: a possible fault."""

    def hangs_on_states(self, state: int) -> bool:
        """Whether the rate of a state is another one at other states."""


def keep_borders(model: BorderedModel) -> None:
    """Finds the ends that are kept; the domain then goes on beyond them.

    An end that is kept by the exact flow only, not with what the simulator's scheme adds, is none:
    the scheme of a linear flow is in the proof. A rate that no state changes is the same in all
    stages of a step, which then goes the way it says, rounding included.
    """
    g = model.c
    whole = _rates(model, model.low, model.high)
    if whole is None:
        return
    steps = [step for step, _, _ in model.inputs.steps]
    step = max(steps, default=0.0) if model.covers_scheme else 0.0
    g.scheme = LOOK_AHEAD * step
    back = BACK * (g.delay + max(2 * g.jitter, g.swept)) if g.is_local else 0.0
    for i, state in enumerate(model.axes):
        largest = float(np.abs(whole[state]).max())
        g.dust[i] = DUST * largest + 8.0 * g.extra_w[i]
        if state in model.unbounded:
            g.kept_low[i] = g.kept_high[i] = UNBOUNDED
            continue
        if state in model.wraps:
            g.kept_low[i] = g.kept_high[i] = WRAPS
            continue
        for upper in (False, True):
            _keep_end(model, i, back * largest, upper=upper)


def _keep_end(model: BorderedModel, i: int, back: float, *, upper: bool) -> None:
    """One end of one axis."""
    g, state, edges = model.c, model.axes[i], model.edges[i]
    low, high = model.low.copy(), model.high.copy()
    if upper:
        low[state], high[state] = edges[-1], high[state] + back
    else:
        low[state], high[state] = low[state] - back, edges[0]
    rates = _rates(model, low, high)
    if rates is None:
        return
    if upper and state in model.open_ends:
        g.kept_high[i] = 1
        model.high[state] = high[state]
        return
    inwards = -rates[state][1] if upper else rates[state][0]
    if not inwards >= 0.0:
        return
    if not inwards >= g.extra_w[i] and model.hangs_on_states(state):
        names = model.inputs.names or tuple(f"state {k}" for k in range(len(model.inputs.states)))
        side, end = ("below", edges[-1]) if upper else ("above", edges[0])
        model.crossed.append(f"{names[state]} {side} {float(end):g}")
        return
    if upper:
        g.kept_high[i] = 1
        model.high[state] = high[state]
    else:
        g.kept_low[i] = 1
        model.low[state] = low[state]


def _rates(model: BorderedModel, low: Floats, high: Floats) -> Floats | None:
    """Bounds (states, 2) of every rate of the exact flow; None where a step fault is possible."""
    ends = model.rates_within(low, high)
    return ends if ends is not None and bool(np.all(np.isfinite(ends))) else None
