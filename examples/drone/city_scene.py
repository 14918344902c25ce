"""The city that flights are drawn in: buildings, goals, tubes; and what a reader may switch off.

Purpose: plain data, filled from the program (`flights.py`, `mission.py`). SI units, z up.
Non-goals: drawing (`city_view.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.report.run.figure_parts import group_of_arm

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from soter.report.run.record import Vec3

TUBE_GROUP = "tubes"
PLAN_GROUP, REFUSED_GROUP = "plans", "refused"


@dataclass(frozen=True, eq=False)
class Tube:
    """The regions of one segment w_i→w_f, in the tube frame of the motion-primitive module.

    `start`, `end`: the segment in m. The half widths, in m, hold across the segment in both
    directions and extend it by as much at either end; each is one number, or an array of any
    length >= 1 of values at equally spaced stations from `start` to `end`:
    `half_width_m` of φ_safe, `look_ahead_half_width_m` of the set where ttf_2Δ does not hold
    (outside it the DM switches AC→SC), `safer_half_width_m` of φ_safer (inside it the DM may
    give back).
    """

    start: Vec3
    end: Vec3
    half_width_m: float | NDArray[np.float64]
    look_ahead_half_width_m: float | NDArray[np.float64]
    safer_half_width_m: float | NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scene:
    """Where the flights took place.

    `lo`, `hi`: corners of the workspace in m, z up. `boxes`: (n, 2, 3) low and high corners of
    the buildings in m. `ceiling_m`: greatest height flown. `goals`: name and position of each.
    `tubes`: the segments flown. `note`: what a reader must know about the regions as drawn, such
    as the speed they hold for. `credit`: whose map it is.
    """

    lo: Vec3
    hi: Vec3
    boxes: NDArray[np.float64]
    ceiling_m: float
    goals: tuple[tuple[str, Vec3], ...] = ()
    tubes: tuple[Tube, ...] = ()
    note: str = ""
    credit: str = ""

    def __post_init__(self) -> None:
        if self.boxes.ndim != 3 or self.boxes.shape[1:] != (2, 3):
            raise ValueError(f"boxes: shape (n, 2, 3) expected, found {self.boxes.shape}")


def plans_group(name: str, *, refused: bool) -> str:
    """Return the groups of an arm's plans: they go with their arm, and with all plans."""
    return f"{group_of_arm(name)} {REFUSED_GROUP if refused else PLAN_GROUP}"
