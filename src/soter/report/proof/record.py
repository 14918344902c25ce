"""What a proof report is made of: plain records, filled by whoever verified.

Purpose: the page of `page.py` as data; nothing here knows about programs or sets.
Non-goals: verdicts (`verify/`), drawing (`page.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

R1, R2, R3, R4, R5 = 1, 2, 3, 4, 5
"""The paper's regions, innermost last: unsafe; safe but lost; K; R(H); where AC may return."""


@dataclass(frozen=True)
class PropertyRow:
    """One property: `verdict` is proved, refuted, undecided or assumed."""

    name: str
    meaning: str
    verdict: str
    method: str
    seconds: float
    detail: str = ""


@dataclass(frozen=True)
class Trajectory:
    """A run drawn into the regions: (n,) along both axes, whether AC was in control."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    in_control: NDArray[np.bool_]
    title: str = ""
    leaves: bool = False
    """It begins at the first point and leaves C at the last one: both are marked."""


@dataclass(frozen=True)
class RegionSlice:
    """A region figure at another place of the third axis: `where` says at which, for people.

    `regions` as of `RegionFigure`, of the same shape.
    """

    where: str
    regions: NDArray[np.uint8]
    lets_ac: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class RegionFigure:
    """The paper's region figure for one group, or a slice of it.

    `regions[i, j]` is 1 to 5 for the cell between `x_edges[i:i+2]` and `y_edges[j:j+2]`. A group
    of one axis has a single row with `y_name` empty. Of three axes: `slices` through the third
    one, `across`, from its lowest value on, of which number `shown` is the figure's own.
    """

    title: str
    x_name: str
    y_name: str
    x_edges: NDArray[np.float64]
    y_edges: NDArray[np.float64]
    regions: NDArray[np.uint8]
    note: str = ""
    trajectory: Trajectory | None = None
    x_unit: str = ""
    y_unit: str = ""
    across: str = ""
    slices: tuple[RegionSlice, ...] = ()
    shown: int = 0
    lets_ac: NDArray[np.bool_] | None = None
    """As `regions`: where `ttf` may be false; its border is drawn."""


@dataclass(frozen=True)
class ModuleProof:
    """One module: what was shown, with which times, and how large the sets are."""

    name: str
    verdict: str
    headline: str
    properties: tuple[PropertyRow, ...]
    times: tuple[tuple[str, str, str], ...]
    """(symbol, meaning, value with unit)."""
    shares: tuple[tuple[str, str], ...]
    """Vacuity figures: (what, share)."""
    figures: tuple[RegionFigure, ...] = ()
    counterexample: tuple[str, ...] = ()
    """Lines that tell a refutation: from where, by what, when."""
    open: tuple[tuple[str, tuple[str, ...]], ...] = ()
    """Of every property that is not shown: (heading, where, why, what was tried, what helps)."""
    switches: bool = True
    """Whether `ttf` and P3 hold: where AC must not act, the DM has switched."""
    but: str = ""
    """Why a proof says little: AC never, or hardly ever, has control."""
    leaving: tuple[RegionFigure, ...] = ()
    """The run of the model that leaves C soonest."""
    leaving_text: str = ""


@dataclass(frozen=True)
class TakenRow:
    """What a module takes for granted of others, and why it may; `open`: that is not proved."""

    module: str
    what: str
    why: str
    open: bool


@dataclass(frozen=True)
class ProofPage:
    """The whole page."""

    title: str
    headline: str
    subtitle: str
    modules: tuple[ModuleProof, ...]
    assumptions: tuple[str, ...]
    trusted_base: tuple[str, ...]
    provenance: dict[str, str] = field(default_factory=dict)
    """Hashes, versions, commands."""
    together: str = ""
    """Of several modules: the verdict of the conjunction."""
    taken: tuple[TakenRow, ...] = ()
    not_covered: tuple[str, ...] = ()
    """What the verdict says nothing about."""
