"""Small programs that once made the engines differ, or the generated C not compile, stay right.

Each file of `tests/corners` is one such case, and says which. They, the examples and the other
small programs of the tests run on both engines, compiled with every warning an error; their
properties hold.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.engine_comparison import (
    compile_library,
    first_difference,
    interpreted_trace,
    native_trace,
)
from generators.shipped_programs import ROOT, files, subjects_of
from long_tests import examples
from soter.language.front_end import check_file, system_of
from soter.native.cache import cache_dir
from soter.simulate.run import NativeProgram, run_interpreted
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

INSTANTS = examples(150)
NOTHING_TO_RUN = {
    f"examples/{name}.soter"
    for name in (
        *("autopilot/autopilot", "autopilot/corridor", "autopilot/flights", "autopilot/laps"),
        "autopilot/watch",
        *("drone/boxes", "drone/city", "drone/cover", "drone/docks", "drone/iris"),
        *("drone/logbook", "drone/planner", "drone/roadmap", "drone/surveillance"),
        *("evidence/balance_net", "evidence/courier", "evidence/reel"),
        *("exploration/frontier", "exploration/grid", "exploration/mapper"),
        *("exploration/recorder", "exploration/rrt_connect", "exploration/sight"),
        *("exploration/walkers", "exploration/worlds"),
        *("mountain_car/gymnasium", "testing/late_sc_on_time", "drone/mujoco_quad", "wall/rush"),
    )
} | {f"tests/correct/{name}.soter" for name in ("a_library", "externs", "files/shapes")}
"""Libraries, and programs whose nodes somebody else answers or has still to write."""
LARGE = {
    *("surveillance_adversaries.soter", "corridor_adversaries.soter"),
    *("exploration_adversaries.soter", "exploration.soter", "learned.soter", "paper.soter"),
}
"""A dozen systems of what `corridor.soter` and `adversaries.soter` have, too; large maps."""
FILES = [
    pytest.param(
        p, id=str(p.relative_to(ROOT)), marks=[pytest.mark.long] if p.name in LARGE else []
    )
    for p in files()
    if str(p.relative_to(ROOT)) not in NOTHING_TO_RUN
]


@pytest.mark.parametrize("path", FILES)
def test_engines_agree(path: Path, tmp_path: Path) -> None:
    subjects = subjects_of(path, INSTANTS)
    assert subjects, "it has nothing to run"
    libraries = [compile_library(subjects, tmp_path, level) for level in ("-O0", "-O2")]
    for s in subjects:
        interpreted = interpreted_trace(s)
        for library in libraries:
            assert first_difference(s, native_trace(library, s), interpreted) is None, s.system.name


@pytest.mark.parametrize("name", sorted(NOTHING_TO_RUN))
def test_a_program_that_is_left_out_has_nothing_to_run(name: str) -> None:
    assert subjects_of(ROOT / name, 2) == []


@all_rows("path", files("tests/corners"), ids=lambda p: p.stem)
def test_properties_of_a_corner_hold(path: Path) -> None:
    for s in subjects_of(path, INSTANTS):
        run = run_interpreted(s.system, s.until_ns, s.seed)
        assert [v for v in run.violation_list if v.kind == "property"] == []


@pytest.mark.parametrize(
    "name", ["math", "string", "soter", "soter_kernel", "int", "double", "7up", "ä"]
)
def test_a_program_may_have_any_name(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A header `math.h` of ours would hide the one of C; a prefix must be an identifier."""
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))
    text = (ROOT / "examples" / "wall" / "cart.soter").read_text(encoding="utf-8")
    checked = check_file(str(tmp_path / f"{name}.soter"), text)
    system = system_of(checked, None)
    native = NativeProgram(system).run(10**9, 1, hash_trace=True)
    assert native.trace_sha256 == run_interpreted(system, 10**9, 1).trace_sha256
    assert cache_dir() == tmp_path / "cache"
