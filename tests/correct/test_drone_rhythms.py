"""The search for the worst rhythm flies what the program flies.

Purpose: one rhythm by `drone_rhythms.c` and by the compiled program in still air, the same
figures as `bench/drone/conformance.py` and `bound.py` have; a search finds what is planted.
Non-goals: searches of full size.
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from bench.drone import rhythms as search
from bench.drone.bound import DRONE, derived, seen
from bench.drone.conformance import needed

from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from pathlib import Path

FIRST, SECOND = 0.705, 0.255
"""Spells in s, between the instants of the pilot."""
PILOT = f"""node Pilot period 10ms {{
  publishes corridor.control;
  step {{
    let s = time < {FIRST} || time >= {FIRST + SECOND} ? 1.0 : -1.0;
    publish corridor.control = vec3(s * corridor.U, -s * corridor.U, s * corridor.U_UP);
  }}
}}
"""


def still_air(folder: Path) -> Path:
    """drone_vehicle.soter with this pilot in the corridors, and no wind."""
    shutil.copytree(DRONE, folder / "examples" / "drone")
    iris = folder / "examples" / "drone" / "iris.soter"
    text = iris.read_text(encoding="utf-8")
    assert "const WIND: float = 0.3;" in text
    iris.write_text(text.replace("const WIND: float = 0.3;", "const WIND: float = 0.0;"))
    text = search.VEHICLE.read_text(encoding="utf-8")
    begin, end = text.index("node Pilot period"), text.index("system Laps")
    (folder / "bench" / "drone").mkdir(parents=True)
    vehicle = folder / "bench" / "drone" / search.VEHICLE.name
    vehicle.write_text(text[:begin] + PILOT + "\n" + text[end:], encoding="utf-8")
    return vehicle


def rhythm() -> search.Floats:
    row = np.zeros((1, search.COLUMNS + search.LEGS))
    axes = row[:, : search.COLUMNS].reshape(search.AXES, 1 + search.SPELLS)
    axes[:, 0] = (1.0, -1.0, 1.0)
    axes[:, 1:3] = (FIRST, SECOND)
    axes[:, 3:] = 9.0
    return row


def test_a_rhythm_is_flown_as_the_program_flies_it(tmp_path: Path) -> None:
    checked = check_file(str(still_air(tmp_path)))
    assert checked.program is not None, checked.diagnostics.items
    run = NativeProgram(system_of(checked, "Corridors")).run(1_500_000_000, 1, keep_trace=True)
    known = {n: c.value for n, c in checked.program.consts.items()}
    d, stray = needed(run, known)
    found = seen(derived("corridors"), run)
    rest = [found[f"rest {axis}"][0] for axis in "xyz"]
    maxima = search.flown(search.place("corridors"), rhythm())[0]
    assert stray < 1e-9
    assert maxima[:3] == pytest.approx(d.max(axis=0), rel=1e-6)
    assert maxima[3:] == pytest.approx(rest, rel=1e-6)


def test_a_search_breeds_rhythms_that_are_followed_worse() -> None:
    where = search.place("corridors")
    rng = np.random.default_rng(1)
    random = search.flown(where, search.drawn(rng, 400)).max(axis=0)
    for aim in (2, 3):
        assert search.search((where, aim, 6_400, 1)).missed[aim] > 1.02 * random[aim]


WORST = {
    ("laps", 0): (0.115, "-0.97 0.72 0.51 0.23, +0.21 1.06 0.96 0.19, -2.24 0.25", (0, 1, 2.43)),
    ("corridors", 1): (0.111, "-0.93 0.75 0.52, +1.24 0.99 0.19, -2.25 0.24", (0, 0, 0.0)),
}
"""By place and axis |d| without wind, m/s^2, that climbs from outside came to, and their rhythm."""
BETWEEN = 0.005
"""s before an instant of the pilot: so no rounding moves a change to the next one."""


@pytest.mark.parametrize(("name", "axis"), WORST)
def test_the_worst_rhythms_that_are_known_stay_within_D(  # noqa: N802 - its name
    name: str, axis: int
) -> None:
    least, spelled, legs = WORST[name, axis]
    row = np.full((1, search.COLUMNS + search.LEGS), 9.0)
    axes = row[:, : search.COLUMNS].reshape(search.AXES, 1 + search.SPELLS)
    for own, text in zip(axes, spelled.split(", "), strict=True):
        first, *others = text[1:].split()
        own[0] = 1.0 if text[0] == "+" else -1.0
        own[1 : 2 + len(others)] = [float(first) - BETWEEN, *map(float, others)]
    row[:, search.COLUMNS :] = legs
    row[:, -1] -= BETWEEN
    where = search.place(name)
    found = search.flown(where, row)[0][axis]
    assert least < found < where.bounds[axis]
    page = (DRONE.parents[1] / "docs" / "drone.md").read_text(encoding="utf-8")
    assert spelled in page.replace("\n", " ")
    assert (
        f"{(found + where.wind) / (where.bounds[axis] + where.wind):.1%}".replace("%", " %") in page
    )
