"""What the diagram of a program shows while a run or a log is replayed, as plain data.

Purpose: `Live` holds rows of values, when components step, who is in control and what the decision
modules saw. `LedPicture` holds where SC would lead from each look (a decision of a module on its
estimate), as boxes of states, rounded outwards and joined where they are many. Both become JSON,
as small as a screen allows. Times are in seconds.
Non-goals: the diagram, the scripts (`assets/replay.js`, `assets/led.js`), reading runs and logs,
the boxes (`simulate/decisions.py`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.report.templates import numbers, packed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray


BOXES_MAX = 16
"""Boxes that are drawn for one look; more would touch each other."""
DIGITS = 3
"""Digits that count, in parts of the span of a state over all looks."""
BY_SC, FAILED = 1, 2
"""The first number of a box: SC leads here, or that is not shown; 0: before SC acts."""


@dataclass(frozen=True, eq=False)
class LedLook:
    """One look at `time_s`; `told`: how it ends, as HTML.

    `boxes` (k, 3 + 2 n): the kind; from and until when, in s after the estimate; the least and
    the largest value of each of n states.
    """

    time_s: float
    boxes: NDArray[np.float64]
    told: str


@dataclass(frozen=True, eq=False)
class LedPicture:
    """One module: n states by name and unit, and some of its `of` looks, in order of time."""

    module: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    looks: tuple[LedLook, ...]
    of: int


def led_json(picture: LedPicture) -> dict[str, Any]:
    """The picture as the page's script reads it: ms, and states as whole numbers over `scale`."""
    every = np.concatenate([look.boxes for look in picture.looks])
    shown = every[every[:, 0] != FAILED] if (every[:, 0] != FAILED).any() else every
    spans = np.maximum(shown[:, 4::2].max(axis=0) - shown[:, 3::2].min(axis=0), 1e-9)
    scale = 10.0 ** (DIGITS - np.floor(np.log10(spans)) - 1)
    return {
        "names": list(picture.names),
        "units": list(picture.units),
        "scale": scale.tolist(),
        "looks": [
            {
                "t": round(look.time_s, 4),
                "told": look.told,
                "boxes": _whole(look.boxes, scale),
            }
            for look in picture.looks
        ],
    }


def _whole(boxes: NDArray[np.float64], scale: NDArray[np.float64]) -> list[list[int]]:
    """Round boxes outwards to whole numbers."""
    joined = _joined(boxes)
    rounded = joined.copy()
    rounded[:, 1] = np.floor(joined[:, 1] * 1e3)
    rounded[:, 2] = np.ceil(joined[:, 2] * 1e3)
    rounded[:, 3::2] = np.floor(joined[:, 3::2] * scale)
    rounded[:, 4::2] = np.ceil(joined[:, 4::2] * scale)
    return [[int(x) for x in row] for row in np.clip(rounded, -1e15, 1e15)]


def _joined(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Join boxes of SC that follow each other to their hull, where they are many."""
    ours = boxes[:, 0] == BY_SC
    many = -(-int(ours.sum()) // BOXES_MAX) if ours.any() else 1
    number = np.where(ours, np.cumsum(ours) // max(many, 1), -1 - np.arange(len(boxes)))
    firsts = np.flatnonzero(np.r_[True, number[1:] != number[:-1]])
    low = np.minimum.reduceat(boxes, firsts)
    high = np.maximum.reduceat(boxes, firsts)
    upper = np.zeros(boxes.shape[1], dtype=np.bool_)
    upper[2::2] = True
    hulls: NDArray[np.float64] = np.where(upper, high, low)
    return hulls


ALONE_MAX, BESIDE_MAX = 100_000, 4_000
"""How many numbers a page may carry for its diagram, without time lines and with them."""
POINTS_MIN = 180
"""Points that a row has at least, however many rows there are."""
CHANGES_MAX = 2000
"""Changes of mode that a page has for a module; later ones are not shown."""
STEPS_MAX = 2000
"""Steps that a page has for a component that does not keep its calendar."""
DIGITS_MAX = 4
HALF_S = 5e-5
"""Half of the last digit that times are written with."""
SMALL = 0.01
"""Rows whose numbers all stay below are written with an exponent."""


@dataclass(frozen=True, eq=False)
class Values:
    """A row of a box: `values`, (N,) for each of its signals `names`, hold from `time_s` (N,) on.

    `key`, `label`, `unit`, `words`: as the diagram's row has them.
    """

    key: str
    label: str
    names: tuple[str, ...]
    time_s: NDArray[np.float64]
    values: tuple[NDArray[np.float64], ...]
    unit: str = ""
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Steps:
    """When a component steps: `period_ns` from `phase_ns` on, or, where it is late, `times_ns`.

    `latched_ns`: from when on it steps no more, after a fault.
    """

    component: str
    period_ns: int
    phase_ns: int
    times_ns: tuple[int, ...] | None = None
    latched_ns: int | None = None


@dataclass(frozen=True)
class Control:
    """One module: its components AC and SC, who is in control from when (s), what its DM saw."""

    module: str
    ac: str
    sc: str
    modes: tuple[tuple[float, bool], ...]
    """(time in s, whether AC is in control from then on)."""
    saw_key: str
    saw: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class Live:
    """Everything that moves on a diagram."""

    end_s: float
    values: tuple[Values, ...]
    steps: tuple[Steps, ...]
    control: tuple[Control, ...]


def live_json(live: Live, drawn: Mapping[str, tuple[int, int]] | None = None) -> dict[str, object]:
    """The record as the page's script reads it.

    `drawn`: signals whose numbers stand on the page already, as (figure, trace), where the script
    takes them from. Rows that change oftener than the page has room for are on a grid of times.
    """
    told = Counter(name for v in live.values for name in v.names)
    drawn = {n: at for n, at in (drawn or {}).items() if told[n] < 2}  # else it is unclear whose
    own = [v for v in live.values if any(n not in drawn for n in v.names)]
    many = sum(len(v.values) + 1 for v in own)
    points = max((BESIDE_MAX if drawn else ALONE_MAX) // max(many, 1), POINTS_MIN)
    grid = np.linspace(0.0, live.end_s, points)
    return {
        "end": round(live.end_s, 6),
        "grid": packed(numbers(grid, 4)),
        "values": [_row(v, drawn, np.round(grid, 4)) for v in live.values],
        "steps": [_steps(s) for s in live.steps],
        "control": [_control(c) for c in live.control],
    }


def _control(c: Control) -> dict[str, object]:
    return {
        "module": c.module,
        "ac": c.ac,
        "sc": c.sc,
        "modes": [[round(t, 4), int(ac)] for t, ac in c.modes[:CHANGES_MAX]],
        "key": c.saw_key,
        "saw": [[round(t, 4), text] for t, text in c.saw[:CHANGES_MAX]],
    }


def _row(
    v: Values, drawn: Mapping[str, tuple[int, int]], grid: NDArray[np.float64]
) -> dict[str, object]:
    """A row as a list of its changes, or on the grid where that is shorter."""
    row: dict[str, object] = {"key": v.key, "label": v.label, "unit": v.unit}
    digits = 0 if v.words else _digits(v)
    if v.words:
        row["words"] = list(v.words)
    else:
        row["digits"] = digits
    if all(n in drawn for n in v.names):
        return {**row, "drawn": [list(drawn[n]) for n in v.names]}
    chosen = _changes(v)
    if len(chosen) > len(grid):
        chosen = np.maximum(np.searchsorted(v.time_s, grid + HALF_S, side="right") - 1, 0)
    else:
        row["t"] = packed(numbers(v.time_s[chosen], 4))
    written = 9 if digits is None else digits
    return {**row, "v": [packed(numbers(each[chosen], written)) for each in v.values]}


def _digits(v: Values) -> int | None:
    """Decimals that leave four digits that count; 0 for whole numbers; None for an exponent."""
    finite = [np.abs(each[np.isfinite(each)]) for each in v.values]
    if all(bool(np.all(each == np.rint(each))) for each in finite):
        return 0
    most = max((float(each.max()) for each in finite if each.size), default=0.0)
    if 0 < most < SMALL:
        return None
    return int(np.clip(3 - np.floor(np.log10(most)), 0, DIGITS_MAX))


def _changes(v: Values) -> NDArray[np.intp]:
    """The indices at which a row changed, with the first sample."""
    changed = np.zeros(len(v.time_s), dtype=np.bool_)
    changed[:1] = True
    for each in v.values:
        changed[1:] |= (each[1:] != each[:-1]) & ~(np.isnan(each[1:]) & np.isnan(each[:-1]))
    return np.flatnonzero(changed)


def _steps(s: Steps) -> dict[str, object]:
    entry: dict[str, object] = {"of": s.component, "period": s.period_ns, "phase": s.phase_ns}
    if s.times_ns is not None:
        entry["at"] = list(s.times_ns[:STEPS_MAX])
    if s.latched_ns is not None:
        entry["until"] = s.latched_ns
    return entry
