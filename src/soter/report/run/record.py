"""The records a report is made of: plain data, filled by the caller from a run's trace.

Purpose: the interface of this folder. Everything is in SI units; arrays are NumPy; N is the
number of samples, which share one time axis.
Non-goals: computing any of it. Clearance, violations and summaries are the engines' findings;
a report that recomputed them could disagree with the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.report.run.where_sc_leads import LedPicture
    from soter.report.templates import PageSection

Vec3 = tuple[float, float, float]
Summary = Mapping[str, "float | int | str"]
Controller = Literal["SC", "AC"]
Json = dict[str, object]
SHARED_MIN = 50
"""Lists of x with more numbers than that are written once for all traces that share them."""


@dataclass(frozen=True)
class Decision:
    """A step of the DM that changed the mode (rules dm1, dm2 of the paper).

    `module`: full dotted name. `to`: who is in control from `time_s` on. `reason`: a text for
    people. `predicates`: name to value as the DM saw them (`ttf`, `safer`, margins ...). `position`
    of the vehicle in m; if it is None, the flight gives the position. `why`: one phrase for each
    value that decided.
    """

    time_s: float
    module: str
    to: Controller
    reason: str = ""
    predicates: Mapping[str, bool | float] = field(default_factory=dict)
    position: Vec3 | None = None
    why: tuple[str, ...] = ()


class Violation(NamedTuple):
    """A system property that true states violated: first at `time_s`, and `times` times in all."""

    time_s: float
    text: str
    position: Vec3 | None = None
    times: int = 1


@dataclass(frozen=True, eq=False)
class Way:
    """A planned path; `points` (k, 3) in m lead from its start to its goal.

    `text`, for people: the number of the path, since when it is in force, why it was `refused`.
    """

    points: NDArray[np.float64]
    text: str
    refused: bool = False

    def __post_init__(self) -> None:
        _check_shape("points", self.points, (len(self.points), 3))


@dataclass(frozen=True, eq=False)
class Flight:
    """One arm of a comparison that moves through a scene.

    `name`: the system's name; `title`: what people call it. `time_s` (N,) increasing; `position`
    (N, 3) in m; `in_control` (N,) bool, true where AC is in control from this sample to the next;
    `module`: the RTA module it belongs to; `clearance_m` (N,), distance to the nearest obstacle,
    the vehicle's radius taken off; `speed` (N,) in m/s. `summary` may hold `lap_s`, `violations`,
    `switches_to_sc`, `switches_to_ac`, `ac_share` (0..1), `min_clearance_m`, and other figures,
    which are shown under their own names. `ways`: the plans that it was given, those refused among
    them.
    """

    name: str
    title: str
    time_s: NDArray[np.float64]
    position: NDArray[np.float64]
    in_control: NDArray[np.bool_]
    module: str
    clearance_m: NDArray[np.float64]
    speed: NDArray[np.float64]
    decisions: tuple[Decision, ...] = ()
    violations: tuple[Violation, ...] = ()
    summary: Summary = field(default_factory=dict)
    ways: tuple[Way, ...] = ()

    def __post_init__(self) -> None:
        count = _sample_count(self.time_s)
        _check_shape("position", self.position, (count, 3))
        for name in ("in_control", "clearance_m", "speed"):
            _check_shape(name, getattr(self, name), (count,))


@dataclass(frozen=True)
class Figure:
    """One drawing. `key` links it to its page element; `label` describes it to blind readers."""

    key: str
    label: str
    data: tuple[Json, ...]
    layout: Json

    def to_json(self) -> Json:
        """The JSON for the drawing library, in which traces with equal x values share one list."""
        first: dict[tuple[object, ...], int] = {}
        data: list[Json] = []
        for i, trace in enumerate(self.data):
            x = trace.get("x")
            same = (
                first.setdefault(tuple(x), i) if isinstance(x, list) and len(x) > SHARED_MIN else i
            )
            data.append(trace if same == i else {**trace, "x": {"of": same}})
        return {"key": self.key, "data": data, "layout": self.layout}


class SceneView(Protocol):
    """Draws the scene that flights move through, as `examples/drone/city_view.py` does."""

    def thumbnail(self, flight: Flight, flights: Sequence[Flight]) -> str:
        """Draws one flight as SVG, in a window that is large enough for all `flights`."""

    def sections(self, flights: Sequence[Flight]) -> tuple[str, list[Figure]]:
        """The HTML sections of the scene, and the figures that the script draws into them."""


@dataclass(frozen=True)
class Threshold:
    """A level that is drawn as a line in a panel; `value` is in the unit of the panel's series."""

    label: str
    value: float


@dataclass(frozen=True, eq=False)
class Series:
    """A signal over time, `values` (N,) in `unit`; all series with the same `panel` share a panel.

    `held`: each value stays until the next sample, as with topics, integers and booleans.
    """

    name: str
    unit: str
    values: NDArray[np.float64]
    panel: str = ""
    thresholds: tuple[Threshold, ...] = ()
    held: bool = False


@dataclass(frozen=True, eq=False)
class ModeBand:
    """Whether AC controls `module`: `in_control` (N,) bool; `told`: its figures in words."""

    module: str
    in_control: NDArray[np.bool_]
    told: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Chart:
    """One arm of a program without geometry, such as the cart before the wall.

    `time_s` (N,) increasing, the time axis of `series` and `modes`; `summary` as in `Flight`;
    `properties`: the text of each watched property, None if unknown; `opens`: for a counterexample,
    the time span (s) that is shown first, which ends at the violation.
    """

    name: str
    title: str
    time_s: NDArray[np.float64]
    series: tuple[Series, ...]
    modes: tuple[ModeBand, ...] = ()
    decisions: tuple[Decision, ...] = ()
    violations: tuple[Violation, ...] = ()
    summary: Summary = field(default_factory=dict)
    properties: tuple[str, ...] | None = None
    opens: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        count = _sample_count(self.time_s)
        for series in self.series:
            _check_shape(series.name, series.values, (count,))
        for band in self.modes:
            _check_shape(band.module, band.in_control, (count,))


@dataclass(frozen=True)
class Cell:
    """Our number and the paper's, as texts with units; `paper` may be empty."""

    ours: str
    paper: str = ""


@dataclass(frozen=True)
class Comparison:
    """The table that compares results with numbers in the paper.

    `columns`: one title for each arm; `rows`: a quantity and one cell for each column; `note`: why
    the numbers are comparable, or why not.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for quantity, cells in self.rows:
            if len(cells) != len(self.columns):
                raise ValueError(
                    f"{quantity}: {len(self.columns)} cells expected, found {len(cells)}"
                )


@dataclass(frozen=True)
class Picture:
    """A drawing of the program; `led` shows to where the SC of each module would lead."""

    svg: str
    led: tuple[LedPicture, ...] = ()


@dataclass(frozen=True, eq=False)
class ReportPage:
    """Everything one report shows.

    `headline` states the result; if it is empty, the summaries give it. `notes`: remarks for the
    reader. `assumptions`: one text for each assumption. `provenance`: program hash, seed, tool
    versions, command line ..., shown in this order. `picture`: the program's diagram; `sections`:
    sentences and tables below it, which the command adds.
    """

    title: str
    subtitle: str = ""
    headline: str = ""
    comparison: Comparison | None = None
    scene: SceneView | None = None
    flights: tuple[Flight, ...] = ()
    charts: tuple[Chart, ...] = ()
    assumptions: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)
    picture: Picture | None = None
    notes: tuple[str, ...] = ()
    sections: tuple[PageSection, ...] = ()

    def __post_init__(self) -> None:
        if self.flights and self.scene is None:
            raise ValueError("flights need a scene to fly in")


def _sample_count(time_s: NDArray[np.float64]) -> int:
    """The number N >= 1 of samples; ValueError unless `time_s` is (N,) and never runs backwards."""
    if time_s.ndim != 1 or time_s.size == 0:
        raise ValueError(f"time_s: shape (N,) with N >= 1 expected, found {time_s.shape}")
    if not bool(np.all(np.diff(time_s) >= 0)):
        raise ValueError("time_s: must not run backwards")
    return int(time_s.size)


def _check_shape(name: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> None:
    """Raises a `ValueError` that names the array unless the array has this shape."""
    if array.shape != shape:
        raise ValueError(f"{name}: shape {shape} expected, found {array.shape}")
