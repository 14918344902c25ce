"""Several sensors of a deployed system: taken for one state, or refused."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import TYPE_CHECKING

import pytest

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.render import render_all
from soter.language.front_end import check_file, system_of
from soter.verify.deploy import deployed_sensors
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from pathlib import Path

PROVED = """soter 1;
topic place: float in [-20.0, 20.0] max_age 20ms;
topic heat: float in [-9.0, 9.0] max_age 20ms;
topic push: float in [-1.0, 1.0];
input topic goal: float in [-9.0, 9.0];
plant Point period 10ms {
  reads push;
  drives place = x;
  drives heat = h;
  state x: float in [-1.0, 1.0];
  state h: float = 1.0;
  disturbance wind: float in [-0.25, 0.25];
  der x = push + wind;
  der h = -0.5 * h;
  measured place within 0.1, heat within 0.05;
}
node Fast period 10ms {
  subscribes goal;
  publishes push;
  step { publish push = clamp(goal, -1.0, 1.0); }
}
node Back period 10ms {
  subscribes place, heat;
  publishes push;
  step { publish push = heat > 4.5 ? 0.0 : clamp(-place, -1.0, 1.0); }
}
rta Keep {
  ac Fast;
  sc Back;
  period 50ms;
  safe abs(place) < 9.0 && heat < 4.0 && heat > -1.0;
  verify {
    grid place in [-10.0, 10.0] / 200;
    grid heat in [-1.0, 4.0] / 50;
    late dm 1ms, sc 2ms;
    response dm 1ms, sc 1ms;
    acts within 1ms;
  }
}
system Protected default { p: Point; module Keep; input goal every 1s; until 10s; }
"""
VEHICLE = """soter 1;
import "point.soter" as point;
system Vehicle deploys point.Protected {
  external topic point.place every 10ms delayed 3ms measured point.place within 0.0876;
  external topic point.heat every 5ms delayed 1ms measured point.heat within 0.042;
  external topic point.goal;
  external topic point.push;
  module point.Keep;
}
"""
"""Places move at most at 1.25/s: 0.0124 are 9.9 ms. Heat falls at most at 2/s: 0.008 are 4 ms."""


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "point.soter").write_text(PROVED)
    (tmp_path / "vehicle.soter").write_text(VEHICLE)
    return tmp_path


def changed(folder: Path, name: str, old: str, new: str) -> None:
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))


def built(folder: Path) -> list[str]:
    return soter.load(folder / "vehicle.soter").build("c", folder / "out").inherits


def refused(folder: Path) -> str:
    with pytest.raises(SoterError) as caught:
        built(folder)
    assert {d.code for d in caught.value.diagnostics} == {"D019"}
    return render_all(caught.value.diagnostics)


def test_sensors_that_come_one_by_one_are_covered_where_errors_leave_the_time_for_it(
    here: Path,
) -> None:
    lines = built(here)
    assert any("measured one by one" in line for line in lines)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("every 10ms delayed 3ms", "every 10ms delayed 4ms"),
        ("within 0.0876", "within 0.09"),
        ("within 0.042", "within 0.045"),
        ("every 5ms delayed 1ms", "every 14ms delayed 1ms"),
    ],
)
def test_sensors_that_may_show_other_instants_than_errors_cover_are_refused(
    here: Path, old: str, new: str
) -> None:
    changed(here, "vehicle.soter", old, new)
    text = refused(here)
    assert "may show states" in text
    assert "one instant" in text


def test_a_plant_that_moves_faster_needs_larger_errors(here: Path) -> None:
    changed(here, "point.soter", "der h = -0.5 * h", "der h = -1.0 * h")
    assert "may show states 13 ms apart" in refused(here)


def test_a_silence_that_the_proof_allows_is_time_between_sensors_too(here: Path) -> None:
    changed(here, "point.soter", "late dm", "dropout 2ms; late dm")
    assert "a silence of 2 ms included" in refused(here)


def test_sc_is_not_built_for_reads_that_are_older_than_their_age(here: Path) -> None:
    """`max_age` has room for what comes so late, and the proof's `age` has not."""
    changed(here, "point.soter", "late dm", "age 13ms; late dm")
    changed(here, "vehicle.soter", "every 10ms delayed 3ms", "every 10ms delayed 4ms")
    assert "is about 13 ms (`age`)" in refused(here)


def test_an_order_of_the_topics_changes_nothing(here: Path) -> None:
    text = (here / "vehicle.soter").read_text()
    lines = text.splitlines()
    lines[3], lines[4] = lines[4], lines[3]
    (here / "vehicle.soter").write_text("\n".join(lines) + "\n")
    built(here)


def test_a_missing_sensor_is_refused(here: Path) -> None:
    lines = [line for line in VEHICLE.splitlines() if "point.heat" not in line]
    (here / "vehicle.soter").write_text("\n".join(lines) + "\n")
    with pytest.raises(SoterError):
        built(here)


def test_what_is_no_state_as_it_is_has_to_be_the_newest_and_the_oldest(here: Path) -> None:
    """How fast `2 h` moves is not derived, so the other one alone has to cover the time."""
    changed(here, "point.soter", "drives heat = h", "drives heat = 2.0 * h")
    changed(here, "point.soter", "grid heat in", "grid p.h in")
    changed(
        here,
        "point.soter",
        "safe ",
        "ttf abs(place) > 5.0 || heat > 2.0; safer abs(place) < 4.0 && heat < 1.5; safe ",
    )
    changed(here, "vehicle.soter", "every 10ms delayed 3ms", "every 6ms delayed 3ms")
    built(here)
    changed(here, "vehicle.soter", "every 6ms", "every 7ms")
    assert "may show states" in refused(here)


# ---------------------------------------------------------------- against the definition


def test_pairs_say_what_every_choice_of_instants_says() -> None:
    """Over all instants on a grid: one state is within every slack iff no pair is too far apart.

    A point is looked for on a grid twice as fine, which holds all ends of the intervals; it is to
    lie between the oldest and the newest, and not to go back when instants go on.
    """
    for count, most in ((2, 4), (3, 3)):
        every = itertools.product(
            itertools.product(range(1, most + 1), repeat=count),
            itertools.product(range(3), repeat=count),
        )
        for ages, slacks in every:
            told = deployed_sensors._skewed_pairs(ages, [Fraction(s) for s in slacks])
            assert (not told) == _all_have_one(ages, slacks), (ages, slacks)


def _all_have_one(ages: tuple[int, ...], slacks: tuple[int, ...]) -> bool:
    return all(
        _one(instants, slacks) for instants in itertools.product(*(range(-a, 1) for a in ages))
    )


def _one(instants: tuple[int, ...], slacks: tuple[int, ...]) -> bool:
    halves = range(2 * min(instants), 2 * max(instants) + 1)
    pairs = list(zip(instants, slacks, strict=True))
    fits = [h for h in halves if all(abs(h - 2 * s) <= 2 * slack for s, slack in pairs)]
    chosen = 2 * max(min(instants), *(s - slack for s, slack in pairs))
    assert not fits or chosen in fits, "the state that the proof takes"
    return bool(fits)


def test_rates_hold_at_every_point_and_are_reached(here: Path) -> None:
    flat = system_of(check_file(str(here / "point.soter")), None)
    place, heat = deployed_sensors.greatest_rates_of(extract(flat, flat.modules[0]))
    assert 1.25 <= place <= 1.2501, "push and wind at their ends"
    assert 2.0 <= heat <= 2.0001, "heat at the end of its grid"
