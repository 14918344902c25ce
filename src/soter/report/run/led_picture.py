"""Where SC would lead from each look of a decision module: boxes of states, as plain data.

Purpose: `LedPicture` of a module, its section of the page and the JSON that `assets/led.js` draws
at the moment of the player. Boxes are rounded outwards, and next ones joined where there are many.
Non-goals: the boxes (`simulate/outputs/led_looks.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.report.run.packed_json import script_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

BOXES_MAX = 16
"""Of a look; more of them touch each other in a drawing."""
DIGITS = 3
"""Of the span of a state over all looks."""
BY_SC, FAILED = 1, 2
"""What the first number of a box says: SC leads, it is not shown; 0: before SC acts."""
NOTE = (
    "From what the decision module read, at the last look drawn: all states that are possible "
    "before SC acts (grey), and then while it leads to rest (blue). They are of the compiled check "
    "itself, asked again. Where it failed, the box that decided is dashed, red. Of {looks} looks "
    "{drawn} are drawn."
)


@dataclass(frozen=True, eq=False)
class LedLook:
    """A look at `time_s`; `told`: how it ends, as HTML.

    `boxes` (k, 3 + 2 n): a kind, from and until when in s after the estimate, the least and the
    largest of each of n states.
    """

    time_s: float
    boxes: NDArray[np.float64]
    told: str


@dataclass(frozen=True, eq=False)
class LedPicture:
    """Of a module: n states by name and unit, and some of its `of` looks, in order of time."""

    module: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    looks: tuple[LedLook, ...]
    of: int


def led_section(pictures: Sequence[LedPicture]) -> str:
    """Places for pictures, and their data; empty where there are none."""
    return "".join(
        f'<figure class="led"><h3>Where SC would lead: {escape(p.module)}</h3>'
        f'<p class="note lead">{NOTE.format(looks=p.of, drawn=len(p.looks))}</p>'
        f'<p class="note told"></p><div class="drawn"></div>'
        f'<script type="application/json">{script_json(led_json(p))}</script></figure>'
        for p in pictures
    )


def led_json(picture: LedPicture) -> dict[str, Any]:
    """As the page's script reads it: times in ms, states in whole numbers over `scale`."""
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
    """Boxes in whole numbers, rounded outwards."""
    joined = _joined(boxes)
    rounded = joined.copy()
    rounded[:, 1] = np.floor(joined[:, 1] * 1e3)
    rounded[:, 2] = np.ceil(joined[:, 2] * 1e3)
    rounded[:, 3::2] = np.floor(joined[:, 3::2] * scale)
    rounded[:, 4::2] = np.ceil(joined[:, 4::2] * scale)
    return [[int(x) for x in row] for row in np.clip(rounded, -1e15, 1e15)]


def _joined(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Next boxes of SC as their hull, where they are many."""
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
