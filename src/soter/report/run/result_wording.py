"""Say a run's figures in words.

Purpose: the headline, the verdict and the captions of summary figures.
Non-goals: judging; the counts come from the caller.
"""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.report.run.record import Chart, Flight, ReportPage, Summary, Violation

KNOWN = ("lap_s", "violations", "ac_share", "switches_to_sc", "switches_to_ac", "min_clearance_m")
CAPTIONS = {
    "lap_s": "a lap",
    "ac_share": "AC in control",
    "switches_to_sc": "SC took over",
    "switches_to_ac": "AC was given control",
    "min_clearance_m": "closest approach",
}
CODE = re.compile(r"`([^`]+)`")
SUBSCRIPTS = re.compile(r"(φ|ttf)_(safer|safe|2Δ|\{2Δ\})")
UNITS = {"_s": "s", "_m": "m", "_km": "km", "_ns": "ns"}


def prose(text: str) -> str:
    """Escape a text for HTML; set code, and the paper's symbols with their subscripts."""
    set_off = CODE.sub(r"<code>\1</code>", escape(text))
    return SUBSCRIPTS.sub(lambda match: f"{match[1]}<sub>{match[2].strip('{}')}</sub>", set_off)


def quantity(name: str, unit: str) -> str:
    """What an axis or a panel shows: `x / m`, `speed / (m/s)`; without a unit the name alone."""
    if not unit:
        return name
    return f"{name} / ({unit})" if "/" in unit else f"{name} / {unit}"


def violation_count(arm: Flight | Chart) -> int:
    """Return how often the properties failed: as summarized, else as listed."""
    told = arm.summary.get("violations")
    return int(told) if isinstance(told, (int, float)) else len(arm.violations)


def violations_title(violations: Sequence[Violation]) -> str:
    """A property that fails again and again has a mark where it failed first."""
    again = any(violation.times > 1 for violation in violations)
    return "violations, the first of each property" if again else "violations"


def count_text(count: int, noun: str) -> str:
    """Write a count with its noun: `no violation`, `1 violation`, `3 violations`."""
    return f"{count or 'no'} {noun}{'s' if count > 1 else ''}"


def headline(page: ReportPage) -> list[str]:
    """Return the result in a sentence or two: the protected arm first, then those that failed."""
    if page.headline:
        return [page.headline]
    arms: list[Flight | Chart] = [*page.flights, *page.charts]
    if not arms:
        return [page.title]
    protected = [arm for arm in arms if _is_mixed(arm.summary)]
    subject = protected[0] if protected else arms[0]
    rest = [arm for arm in arms if arm is not subject and violation_count(arm) > 0]
    return [_sentence(arm) for arm in (subject, *rest)]


def figures(summary: Summary) -> list[tuple[str, str]]:
    """Return caption and value of each figure but the lap and the violations, known ones first."""
    known = [key for key in KNOWN if key in summary and key not in ("lap_s", "violations")]
    others = [key for key in summary if key not in KNOWN]
    return [(_caption(key), value_text(key, summary[key])) for key in (*known, *others)]


def value_text(key: str, value: float | str) -> str:
    """Write one figure of a summary with its unit, which its key tells."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if key.endswith("share"):
        return f"{100 * value:.1f} %"
    if key.startswith("switches"):
        return f"{int(value)} \N{MULTIPLICATION SIGN}"
    unit = next((text for suffix, text in UNITS.items() if key.endswith(suffix)), "")
    number = f"{value:d}" if isinstance(value, int) else f"{value:.3g}"
    if key.endswith("_s") and not isinstance(value, int):
        number = f"{value:.1f}"
    if key == "min_clearance_m":
        number = f"{value:.2f}"
    return f"{number} {unit}".rstrip().replace("-", "\N{MINUS SIGN}")


def _caption(key: str) -> str:
    """Name a figure: known ones in words, others by their key without the unit."""
    if key in CAPTIONS:
        return CAPTIONS[key]
    for suffix in UNITS:
        if key.endswith(suffix):
            return key[: -len(suffix)].replace("_", " ")
    return key.replace("_", " ")


def _is_mixed(summary: Summary) -> bool:
    """Tell whether both controllers had their turn."""
    share = summary.get("ac_share")
    return isinstance(share, (int, float)) and 0 < share < 1


def _sentence(arm: Flight | Chart) -> str:
    """Say one arm's lap and violations."""
    violations = count_text(violation_count(arm), "violation")
    lap = arm.summary.get("lap_s")
    if lap is None:
        return f"{arm.title}: {violations}."
    return f"{arm.title}: {violations}, {value_text('lap_s', lap)} a lap."


def longest_s(arms: Sequence[Flight | Chart]) -> float:
    """Return the end of the longest time axis in s."""
    return max((float(arm.time_s[-1]) for arm in arms), default=0.0)
