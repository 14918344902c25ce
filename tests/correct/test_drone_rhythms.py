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
