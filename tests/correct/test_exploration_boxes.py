"""What is flown before the first word of `Surveyor`, in doubt, and with a lidar at its worst.

Flights end with a map: the exact referee finds no cell in it that meets a wall.
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from generators.exploration_mappers import EXAMPLES, edited
from generators.exploration_referee import Grid, met_cells, rectangle
from long_tests import examples, seeds

if TYPE_CHECKING:
    from pathlib import Path

HARMFUL = (
    (
        "    let d = measured_at(all, p, 2.0 * PI * float(ray) / float(RAYS) + heading);",
        """    let angle = 2.0 * PI * float(ray) / float(RAYS);
    let right = measured_at(all, p, angle - ERROR_HEADING);
    let left = measured_at(all, p, angle + ERROR_HEADING);
    let straight = measured_at(all, p, angle);
    let d = max(right <= RANGE ? right : 0.0, max(left <= RANGE ? left : 0.0, straight));""",
    ),
    ("clamp(d + NOISE * noise[k], 0.0, RANGE)", "clamp(d + ERROR_RANGE, 0.0, RANGE)"),
    (
        "  disturbance noise:",
        "  disturbance side: float[4] in [-1.0, 1.0] hold 500ms;\n  disturbance noise:",
    ),
    (
        "{ x: iris.body.p.x + jump, y: iris.body.p.y, vx: iris.body.v.x, vy: iris.body.v.y };",
        """{
    x: iris.body.p.x + bound(side[0], iris.ERROR_P),
    y: iris.body.p.y + bound(side[1], iris.ERROR_P),
    vx: iris.body.v.x + bound(side[2], iris.ERROR_V),
    vy: iris.body.v.y + bound(side[3], iris.ERROR_V)
  };""",
    ),
    ("  measured scan.at.x within iris.ERROR_P, scan.at.y within iris.ERROR_P;\n", ""),
    ("  measured scan.at.vx within iris.ERROR_V, scan.at.vy within iris.ERROR_V;\n", ""),
    (
        "plant Lidar period FIRE {",
        (
            "fun bound(side: float, most: float): float { return side < 0.0 ? -most : most; }\n"
            "plant Lidar period FIRE {"
        ),
    ),
)
"""Each ray turned to where it goes farthest and as much too long as it may be, the pose wrong by
all that it may be wrong."""
MUTE = """soter 1;
import "../drone/corridor.soter" as corridor;
import "exploration.soter" as exploration;
import "mapper.soter" as mapper;
node Mute period 100ms {
  subscribes mapper.known;
  publishes corridor.way, mapper.survey;
  step {
    publish mapper.survey = { judged: 0, adopted: 0, refused: 0 };
    publish corridor.way = corridor.NO_WAY;
  }
}
system Unguided {
  e: exploration.Explore;
  replace e.Surveyor by Mute;
  set corridor.LAP = false;
  until 20s;
}
"""
PUPPET = """soter 1;
import "../drone/boxes.soter" as boxes;
import "../drone/corridor.soter" as corridor;
import "../drone/iris.soter" as iris;
import "grid.soter" as grid;
import "mapper.soter" as mapper;

const EAST: Vec3 = { x: 4.0, y: 0.0, z: 0.0 };
param DOUBT: bool = true;
plant Puppet period 10ms {
  drives iris.localPosition = { p: grid.START + (clock < 3.0 ? 0.0 : 1.0) * EAST, v: 0.0 * EAST };
  state clock: float;
  next clock = clock + 0.01;
}
fun all_free(): grid.Cells {
  var all: grid.Cells;
  for k in 0..grid.CELLS { all[k] = true; }
  return all;
}
node Told period 100ms {
  publishes mapper.known, mapper.doubt, mapper.proposal;
  step {
    let home = mapper.AT_HOME;
    publish mapper.known = all_free();
    publish mapper.doubt = DOUBT && time >= 2.0;
    publish mapper.proposal = { number: time >= 1.0 ? 1 : 0,
      corridor: { verdict: boxes.Verdict.Covered,
        blocks: [{ low: home.low + EAST, high: home.high + EAST, aim: home.aim + EAST }] },
      stay: false, careful: false };
  }
}
node Still period 10ms {
  publishes iris.reference;
  step { publish iris.reference = { a: 0.0 * EAST, j: 0.0 * EAST, s: 0.0 * EAST }; }
}
system Show {
  p: Puppet; node Told; node mapper.Surveyor; node Still; node corridor.Follower; until 4s;
}
"""


def laid_out(work: Path, name: str = "", text: str = "") -> Path:
    """A copy of the examples with a program in it; the folder of exploration."""
    for folder in ("drone", "exploration"):
        shutil.copytree(EXAMPLES / folder, work / folder)
    if name:
        (work / "exploration" / name).write_text(text, encoding="utf-8")
    return work / "exploration"


def test_a_surveyor_that_says_nothing_leaves_the_vehicle_at_home(tmp_path: Path) -> None:
    program = soter.load(laid_out(tmp_path, "mute.soter", MUTE) / "mute.soter")
    run = program.simulate(trace=False, sha256=False)
    happened = [v.what for v in run.violation_list]
    assert not [w for w in happened if "Collides" in w or "Contains" in w]


@pytest.mark.parametrize(("doubt", "number"), [(True, 1), (False, 2)])
def test_in_doubt_a_box_that_was_told_and_is_not_flown_yet_is_not_flown(
    tmp_path: Path, doubt: bool, number: int
) -> None:
    program = soter.load(laid_out(tmp_path, "puppet.soter", PUPPET) / "puppet.soter")
    assert program.ok, program.diagnostics
    params = {"DOUBT": doubt}
    run = program.simulate(trace=["corridor.flown", "corridor.way"], params=params)
    assert run.topic("corridor.way")["number"][-1] == 2
    assert run.topic("corridor.flown")["number"][-1] == number


def end_of(run: soter.Run, topic: str) -> Any:
    """What was published last on a topic, whatever system it belongs to."""
    topics = run.final["topics"]
    (name,) = (n for n in topics.dtype.names if n.endswith(topic))
    return topics[name]


@pytest.mark.parametrize("system", ["Ramming", "Jerking", "BareFrontier", "Careful"])
@pytest.mark.long
def test_a_flight_with_a_lidar_at_its_worst_ends_with_a_true_map(
    tmp_path: Path, system: str
) -> None:
    folder = laid_out(tmp_path)
    worlds = folder / "worlds.soter"
    worlds.write_text(edited(worlds.read_text(encoding="utf-8"), HARMFUL), encoding="utf-8")
    program = soter.load(folder / "exploration_adversaries.soter")
    grid = Grid.of(program.constant)
    for seed in seeds(1, 1 + examples(4)):
        run = program.simulate(
            system=system,
            seed=seed,
            until="60s",
            trace=False,
            sha256=False,
            params={"mapper.SILENCE": seed % 2 == 1},
        )
        cells = np.array(end_of(run, "mapper.known")).reshape(grid.count, grid.count)
        free = {(int(i), int(j)) for i, j in np.argwhere(cells)}
        walls = end_of(run, "worlds.walls")
        assert len(free) > 400
        for w in walls["items"][: walls["len"]]:
            corners = rectangle(*(float(x) for x in w))
            assert met_cells(grid, corners, free.__contains__) == set(), (system, seed)
        assert not end_of(run, "mapper.doubt")
        assert run.violations == 0 or system == "BareFrontier"


@pytest.mark.parametrize("axis", ["", "x", "y", "z"])
def test_a_box_that_is_upside_down_is_not_known_to_be_free(axis: str) -> None:
    program = soter.load(EXAMPLES / "exploration" / "grid.soter")
    start = program.constant("START")
    low = {a: getattr(start, a) - 0.2 for a in "xyz"}
    high = {a: getattr(start, a) + 0.2 for a in "xyz"}
    if axis:
        low[axis], high[axis] = high[axis], low[axis]
    sums = program.function("sums")(program.constant("AT_START"))
    box = {"low": low, "high": high, "aim": low}
    assert program.function("KnownFree")(sums, box) is (not axis)
