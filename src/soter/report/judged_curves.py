"""What a judgement compared, over time: curves, the bands that they should have kept, and alarms.

Purpose: `JudgedTimes` keeps of each curve, in each of `COLUMNS` equal parts of the time, the least
and the greatest value, so that a log of any length is a drawing of one size in which nothing that
lay outside is lost; `drawing_html` makes HTML and SVG of it, without scripts.
Non-goals: judging: what lies outside, and when an alarm is, the caller says.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import chain
from math import inf, isfinite
from typing import TYPE_CHECKING

from soter.report.templates import filled
from soter.report.wording import quantity

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    Compared = tuple[str, str, str]

COLUMNS, HELD = 480, 24
"""Of a drawing; where nothing came for longer than HELD of them a curve has a gap."""
OUTSIDE_MAX, NEAREST_MAX = 6, 3
"""Curves that are drawn: those that left their bands, or if none did those that came nearest."""
ROOM, APART = 0.08, 14
"""Of the height of a drawing: what stays empty above and below; % between two numbers beside it."""


@dataclass
class JudgedCurve:
    """A compared value. `columns`: by column, its least and greatest value and the band's ends."""

    columns: dict[int, tuple[float, float, float, float]] = field(default_factory=dict)
    outside: int = 0
    nearest: tuple[float, float] = (inf, 0.0)


@dataclass
class JudgedTimes:
    """Curves and alarms, by column; `changes`: when "AC" or "SC" took control, or began."""

    begin_s: float
    end_s: float
    alarms: Counter[int] = field(default_factory=Counter)
    curves: dict[Compared, JudgedCurve] = field(default_factory=dict)
    changes: Sequence[tuple[float, str]] = ()

    def column_at(self, at_s: float) -> int:
        """The number of the column in which a time lies."""
        share = (at_s - self.begin_s) / ((self.end_s - self.begin_s) or 1.0)
        return min(max(int(share * COLUMNS), 0), COLUMNS - 1)

    def note_value(
        self, of: Compared, at_s: float, value: float, band: Sequence[float], *, alarm: bool
    ) -> None:
        """Adds a value to the curve `of`; counts it as outside of `band` only if `alarm`."""
        if isfinite(value):
            curve, at = self.curves.setdefault(of, JudgedCurve()), self.column_at(at_s)
            low, high, *_ = curve.columns.get(at, (value, value))
            curve.columns[at] = min(low, value), max(high, value), band[0], band[1]
            far = min(value - band[0], band[1] - value)
            curve.outside += alarm and far < 0
            curve.nearest = min(curve.nearest, (far, at_s))


def drawing_html(times: JudgedTimes, noun: str) -> str:
    """The HTML of the curves, or "" if there are none; `noun`: what an alarm is called."""
    most, span = max([*times.alarms.values(), 1]), times.end_s - times.begin_s
    starts = [times.column_at(at_s) for at_s, _ in times.changes]
    wrong = [(of, c) for of, c in times.curves.items() if c.outside]
    nearest = sorted(wrong or times.curves.items(), key=lambda c: (-c[1].outside, c[1].nearest))
    if not nearest:
        return ""
    return filled(
        "report/judged_curves.html.j2",
        controls=list(zip(times.changes, starts, [*starts[1:], COLUMNS], strict=False)),
        alarms=[(k, 100 - 30 - 70 * n / most) for k, n in sorted(times.alarms.items()) if n],
        count=times.alarms.total(),
        noun=noun,
        panels=[_panel_values(*c) for c in nearest[: OUTSIDE_MAX if wrong else NEAREST_MAX]],
        ticks=[f"{round(times.begin_s + span * k / 4, 2):g} s" for k in range(5)],
        columns=COLUMNS,
    )


def _places_and_labels(
    columns: Iterable[tuple[float, ...]],
) -> tuple[dict[float, float], list[float]]:
    """The place of each value in percent from the top, and the values that get labels."""
    lows, highs, *ends = (set(values) for values in zip(*columns, strict=True))
    seen = [v for v in chain(lows, highs, *ends) if isfinite(v)]
    room = ROOM * ((max(seen) - min(seen)) or 1.0)
    low, high = min(seen) - room, max(seen) + room
    y = {v: 100 * (high - min(max(v, low), high)) / (high - low) for v in (*seen, inf, -inf)}
    numbers: list[float] = []
    for value in (*chain(*(e for e in ends if len(e) == 1)), max(seen), min(seen)):
        if isfinite(value) and all(abs(y[value] - y[n]) > APART for n in numbers):
            numbers.append(value)
    return y, numbers


def _panel_values(of: Compared, curve: JudgedCurve) -> dict[str, object]:
    (name, unit, asked), columns = of, sorted(curve.columns.items())
    y, numbers = _places_and_labels(curve.columns.values())
    band = [*((k, c[3]) for k, c in columns), *((k, c[2]) for k, c in reversed(columns))]
    far, at_s = curve.nearest
    how = f"outside {curve.outside:,} times, furthest" if curve.outside else "nearest"
    return {
        "name": quantity(name, unit),
        "told": f"{asked} (shaded); {how} at {at_s:.3f} s, by {abs(far):.3g} {unit}",
        "band": "M" + "L".join(f"{k} {y[v]:.1f}" for k, v in band),
        "curve": "".join(
            f"{'L' if k - before <= HELD else 'M'}{k} {y[c[0]]:.1f}L{k} {y[c[1]]:.1f}"
            for before, (k, c) in zip([-COLUMNS, *sorted(curve.columns)], columns, strict=False)
        ),
        "numbers": [(y[n], f"{n:.4g}".replace("-", "\N{MINUS SIGN}")) for n in numbers],
    }
