"""Slopes and lines: exact where they can be, and their errors where they cannot.

Of angles the oracle is the same motion written without an end: what is said of it is the same.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.api import load
from soter.mapping.read_mapping import make_log_map
from soter.mapping.units import UNITS
from soter.monitor.derived_signals import (
    begin_of_turn,
    error_quantiles,
    line_errors,
    slope_errors,
    value_on_line,
    window_slopes,
)
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.typed_samples import read_samples
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

    from soter.monitor.typed_samples import TopicSamples


def times(seed: int, n: int = 60) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).uniform(0.05, 0.15, n))


@pytest.mark.parametrize("seed", range(5))
def test_a_slope_is_that_of_the_parabola_of_least_squares(seed: int) -> None:
    t = times(seed)
    x = np.sin(t) + 0.01 * np.random.default_rng(seed).normal(size=len(t))
    slope_values = window_slopes(t, x, 0.5)
    tried = 0
    for i in range(len(t)):
        near = (t <= t[i]) & (t >= t[i] - 0.5 * (1 + 1e-9))
        if near.sum() >= 3:
            assert slope_values[i] == pytest.approx(
                np.polyfit(t[near] - t[i], x[near], 2)[1], abs=1e-8
            )
            tried += 1
    assert tried > 50


@all_rows("n", [2, 3, 4, 60])
@all_rows("window", [0.01, 0.5, 100.0])
def test_a_parabola_has_its_own_slope_whatever_the_window(n: int, window: float) -> None:
    t = times(3, n) + 1e6  # far from the beginning of time
    u = t - t[0]
    x = 2.0 + 3.0 * u - (0.7 * u * u if n > 2 else 0.0)
    exact = 3.0 - (1.4 * u if n > 2 else 0.0 * u)
    exact[1] = (x[1] - x[0]) / u[1]
    slope_values = window_slopes(t, x, window)
    assert np.isnan(slope_values[0])
    assert np.allclose(slope_values[1:], exact[1:], atol=1e-6)
    assert slope_errors(t, x, window, window_slopes(t, x, window)).max(initial=0.0) < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_the_error_of_lines_is_about_what_they_miss(seed: int) -> None:
    """Against samples that were there twice as often."""
    fine = np.linspace(0.0, 6.0, 121)
    x = np.sin((1 + seed) * fine)
    told = error_quantiles(line_errors(fine[::2], x[::2], 1.0))
    assert told is not None
    half = x[2:-2:2] + (x[2:-2:2] - x[:-4:2]) / 2  # half-way to the next sample
    missed = float(np.abs(half - x[3:-1:2]).max())
    assert missed < told[2] < 4 * missed


def test_of_nothing_there_is_no_error() -> None:
    assert error_quantiles(np.zeros(0)) is None
    assert len(line_errors(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 2.0)) == 0
    assert len(line_errors(np.array([0.0, 1.0, 9.0]), np.zeros(3), 2.0)) == 0, "across a gap"


# ---------------------------------------------------------------- angles

PROGRAM = """soter 1;
type Turn = {{ yaw: float{unit}, rate: float{per_s} }};
topic motion: Turn max_age 250ms;
topic turn: float in [-1.0, 1.0];
node Nav period 50ms {{ publishes turn; step {{ publish turn = 0.2; }} }}
node Stop period 50ms {{ publishes turn; step {{ publish turn = 0.0; }} }}
rta Slow {{ ac Nav; sc Stop; period 50ms;
  safe motion.rate < 1.0; ttf motion.rate > 0.8; safer motion.rate < 0.6; }}
plant R period 10ms {{
  reads turn; drives motion = {{ yaw: yaw, rate: 0.0 }}; state yaw: float; der yaw = turn; }}
system T default {{ c: R; module Slow; until 5s; }}
"""
STEP_S, ROWS = 0.1, 100
WHOLE = 2 * math.pi


def samples(folder: Path, yaws: list[float], of: str = "rad", **field: Any) -> TopicSamples:
    """The motion with these angles, in a unit that the program declares, or the mapping alone."""
    declared = {"unit": f' unit "{of}"', "per_s": f' unit "{of}/s"'} if not field else {}
    program = folder / "turn.soter"
    program.write_text(PROGRAM.format(**{"unit": "", "per_s": "", **declared}))
    log = folder / "turn.csv"
    rows = [f"{round(STEP_S * k, 6)},{yaw!r}" for k, yaw in enumerate(yaws)]
    log.write_text("\n".join(["t,yaw", *rows, ""]))
    fields = {"yaw": {"from": "yaw", **field}, "rate": {"slope": "yaw", "window": "0.4s"}}
    topics = {"motion": {"between": "linear", "fields": fields}}
    mapping = make_log_map({"time": {"from": "t"}, "topics": topics}, load(program).flat())
    (made,) = read_samples(log, mapping, read_columns(log, mapping))
    return made


def turning(rate: float, begin: float = 2.8) -> np.ndarray:
    return begin + rate * STEP_S * np.arange(ROWS)


RANGES = {"around 0": -0.5, "from 0": 0.0, "from a quarter": 0.25}
"""Where a turn begins, in turns."""


@pytest.mark.parametrize("unit", ["rad", "deg"])
@pytest.mark.parametrize("begin", RANGES.values(), ids=RANGES)
@pytest.mark.parametrize("rate", [0.9, -0.9])
def test_slopes_and_errors_are_those_of_a_motion_without_an_end(
    tmp_path: Path, unit: str, begin: float, rate: float
) -> None:
    in_unit = turning(rate) / UNITS[unit]
    whole = WHOLE / UNITS[unit]
    wrapped = begin * whole + (in_unit - begin * whole) % whole
    assert np.abs(np.diff(wrapped)).max() > whole / 2, "it comes to the end of a turn"
    found = samples(tmp_path, wrapped.tolist(), unit)
    rates = np.array([value[1] for value in found.values])
    assert np.allclose(rates, rate / UNITS[unit], rtol=1e-6)
    assert all(d.error is None or d.error[2] < 1e-6 * whole for d in found.derived)


def test_a_line_stays_in_the_turn_of_its_column(tmp_path: Path) -> None:
    for begin, low in (("around 0", -math.pi), ("from 0", 0.0)):
        wrapped = low + (turning(0.9) - low) % WHOLE
        found = samples(tmp_path, wrapped.tolist())
        between: list[Any] = [
            found.value_at(t) for t in range(found.from_ns, found.times_ns[-1], 17_000_000)
        ]
        assert len(between) > 200, begin
        for value in between:
            assert low <= value[0] <= low + WHOLE
            assert abs(value[1] - 0.9) < 1e-6


def test_an_angle_that_counts_on_goes_on_along_its_line(tmp_path: Path) -> None:
    found = samples(tmp_path, turning(0.9).tolist())
    beyond: Any = found.value_at(found.times_ns[-1] + 50_000_000)
    assert beyond[0] == pytest.approx(2.8 + 0.9 * (STEP_S * (ROWS - 1) + 0.05))


def test_the_unit_of_the_mapping_says_so_where_the_program_has_none(tmp_path: Path) -> None:
    wrapped = (np.degrees(turning(0.9)) + 180.0) % 360.0 - 180.0
    found = samples(tmp_path, wrapped.tolist(), unit="deg")
    assert all(value[1] == pytest.approx(0.9, rel=1e-6) for value in found.values)


@pytest.mark.parametrize("gear", [0.1, -0.5, 3.0])
def test_a_shaft_behind_a_gear_turns_by_its_share(tmp_path: Path, gear: float) -> None:
    wrapped = turning(0.9) % WHOLE
    found = samples(tmp_path, wrapped.tolist(), unit="rad", scale=gear)
    assert all(value[1] == pytest.approx(0.9 * gear, rel=1e-6) for value in found.values)


def test_what_is_no_angle_jumps_as_far_as_it_jumps(tmp_path: Path) -> None:
    wrapped = (turning(0.9) + math.pi) % WHOLE - math.pi
    found = samples(tmp_path, wrapped.tolist(), scale=1.0)
    assert min(value[1] for value in found.values) < -10.0


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-20.0, 20.0), st.floats(-3.0, 3.0), st.floats(0.0, 3.0), st.sampled_from([-0.5, 0.0])
)
def test_a_line_is_the_one_without_an_end_but_for_whole_turns(
    begin: float, step: float, share: float, low: float
) -> None:
    a, b = (low * WHOLE + (x - low * WHOLE) % WHOLE for x in (begin, begin + step))
    x = value_on_line(a, b, share, WHOLE, low * WHOLE)
    apart = x - (begin + step + share * step)
    assert math.remainder(apart, WHOLE) == pytest.approx(0.0, abs=1e-9)
    assert low * WHOLE - 1e-9 <= x <= (low + 1) * WHOLE + 1e-9


def test_where_a_turn_begins_is_seen_in_its_column() -> None:
    assert begin_of_turn([-3.1, 3.1], WHOLE) == -math.pi
    assert begin_of_turn([0.1, 6.2], WHOLE) == 0.0
    assert begin_of_turn([1.6, 7.8], WHOLE) == pytest.approx(4.7 - math.pi)
    assert math.isnan(begin_of_turn([0.0, 7.0], WHOLE))
    assert math.isnan(begin_of_turn([0.0, 7.0], math.inf))
