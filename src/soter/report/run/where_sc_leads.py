"""The states to which the SC of a module would lead from each look, as plain data.

Purpose: `LedPicture` holds looks (each a decision of a module on its estimate): boxes of states,
rounded outwards and joined where they are many, as JSON for a screen. Times are in seconds.
Non-goals: the script (`assets/led.js`), the boxes (`simulate/tube_looks.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


BOXES_MAX = 16
"""Boxes that are drawn for one look; more would touch each other."""
DIGITS = 3
"""Digits that count, in parts of the span of a state over all looks."""
BY_SC, FAILED = 1, 2
"""The first number of a box: SC leads here, or that is not shown; 0: before SC acts."""


@dataclass(frozen=True, eq=False)
class LedLook:
    """A prediction made at `time_s` of where SC leads; `told` says in HTML how it ends.

    `boxes` (k, 3 + 2 n): the kind; the begin and the end in s after the estimate; the least and the
    largest value of each of n states.
    """

    time_s: float
    boxes: NDArray[np.float64]
    told: str


@dataclass(frozen=True, eq=False)
class LedPicture:
    """A module: n states by name and unit, and some of its `of` looks, in order of time."""

    module: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    looks: tuple[LedLook, ...]
    of: int


def led_json(picture: LedPicture) -> dict[str, Any]:
    """The picture as JSON for the page's script: ms, and states as integers over `scale`."""
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
                "boxes": _rounded_outwards(look.boxes, scale),
            }
            for look in picture.looks
        ],
    }


def _rounded_outwards(boxes: NDArray[np.float64], scale: NDArray[np.float64]) -> list[list[int]]:
    """The boxes with all values scaled to integers, rounded so that no box shrinks."""
    joined = _joined_boxes(boxes)
    rounded = joined.copy()
    rounded[:, 1] = np.floor(joined[:, 1] * 1e3)
    rounded[:, 2] = np.ceil(joined[:, 2] * 1e3)
    rounded[:, 3::2] = np.floor(joined[:, 3::2] * scale)
    rounded[:, 4::2] = np.ceil(joined[:, 4::2] * scale)
    return [[int(x) for x in row] for row in np.clip(rounded, -1e15, 1e15)]


def _joined_boxes(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The boxes, with neighbouring boxes of SC merged into their hull if they are too many."""
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
