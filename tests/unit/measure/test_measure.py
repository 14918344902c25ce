"""Times of steps: what is timed, from which states, and what is told. Not how long it takes."""

from __future__ import annotations

import json
import random
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import soter
from soter.api.measuring import DOCUMENT, measure, measure_on_board, write_measurement
from soter.core.layout import state_layout
from soter.diagnostics.diagnostic import SoterError
from soter.measure.stopwatch import sampled_states, varied_states
from soter.targets.cortex_m_board import BOARDS, read_board
from soter.targets.cortex_m_image import build_image, missing_tool

TEXT = """soter 1;
type Seen = { flag: bool, at: float, many: float[<=3], few: int in [2, 5] };
topic seen: Seen in { at in [-2.0, 3.0], many in [0.0, 1.0] } max_age 100ms;
topic free: float;
topic u: float in [-1.0, 1.0];
topic out: int in [0, 9];
topic far: int in [0, 9];
node Fast period 10ms {
  subscribes seen;
  publishes u;
  step { publish u = seen.at > 0.0 ? 1.0 : 0.0; }
}
node Slow period 10ms {
  subscribes seen, free;
  publishes u;
  step { publish u = seen.few > 2 && free < 9.0 ? 0.5 : 0.0; }
}
node Late period 20ms {
  subscribes u;
  publishes free;
  takes [1ms, 5ms];
  step { publish free = u; }
}
node Count period 20ms {
  subscribes seen;
  publishes out;
  step { assert seen.few < 5; publish out = 1; }
}
extern node Far period 50ms { subscribes out; publishes far; }
extern plant World period 10ms from "python:none.py:World" {
  reads u;
  drives seen = s;
  state s: Seen;
}
rta M { ac Fast; sc Slow; period 20ms; safe true; ttf seen.at > 1.0; safer seen.at < 0.0; }
system S { w: World; module M; node Late; node Count; node Far; until 200ms; }
"""


def program(folder: Path) -> soter.Program:
    path = folder / "timed.soter"
    path.write_text(TEXT)
    loaded_program = soter.load(path)
    assert loaded_program.ok, loaded_program.diagnostics

    class World:
        def step(self, *_: object) -> dict[str, object]:
            return {"s": {"flag": True, "at": 0.5, "many": [0.5], "few": 3}}

    class Far:
        def step(self, *_: object) -> dict[str, object]:
            return {"far": 1}

    return loaded_program.bind("w", World).bind("Far", Far)


def test_what_runs_in_the_thread_is_timed_and_nothing_else(tmp_path: Path) -> None:
    measurement = measure(program(tmp_path), samples=40)
    assert [s.name for s in measurement.steps] == ["M.dm", "M.Slow", "M.Fast", "Late", "Count"]
    assert [s.declared for s in measurement.steps] == ["M", "Slow", "Fast", "Late", "Count"]
    for s in measurement.steps:
        assert 0 < s.percentiles[0][1] <= s.percentiles[-1][1] <= s.longest_ns
        assert s.wcet_ns >= measurement.margin * s.longest_ns
        assert s.wcet_ns % 1000 == 0
        assert s.wcet_ns < measurement.margin * s.longest_ns + 1000


def test_random_states_find_faults_that_the_run_does_not(tmp_path: Path) -> None:
    count = measure(program(tmp_path), samples=400).steps[-1]
    assert 0 < count.faulted < count.samples / 2


def test_the_margin_multiplies_the_longest(tmp_path: Path) -> None:
    for step in measure(program(tmp_path), samples=40, margin=5.0).steps:
        assert 5 * step.longest_ns <= step.wcet_ns < 5 * step.longest_ns + 1000
    with pytest.raises(SoterError, match="U001"):
        measure(program(tmp_path), samples=40, margin=0.5)


def test_states_made_of_a_run_differ_in_what_is_read_alone(tmp_path: Path) -> None:
    run = program(tmp_path).simulate(until=0.1, seed=1)
    assert run.trace is not None
    layout = state_layout(run.system)
    size = layout.size
    seen = sampled_states(run.trace.view("u1").reshape(-1, size), 5)
    assert seen.shape == (5, size)
    slow = run.system.component("M.Slow")
    made = varied_states(run.system, layout, slow, seen, 200, random.Random(1))  # noqa: S311
    states = made.view(run.dtype).reshape(-1)
    topic = states["topics"]["seen"]
    assert topic["at"].min() >= -2.0
    assert topic["at"].max() <= 3.0
    assert {-2.0, 3.0} <= set(topic["at"])
    assert set(topic["few"]) == {2, 3, 4, 5}
    assert set(topic["many"]["len"]) == {0, 1, 2, 3}
    assert len(set(states["topics"]["free"])) > 100
    stamps = states["stamps"][:, run.system.topic("seen").index]
    assert (stamps == states["header"]["ct"]).all()
    for k in range(5):
        assert set(states["topics"]["out"]) <= set(
            seen.view(run.dtype).reshape(-1)["topics"]["out"]
        )
        assert np.isin(states["topics"]["u"], seen.view(run.dtype)["topics"]["u"]).all(), k


def test_a_file_of_times_is_what_check_takes(tmp_path: Path) -> None:
    timed_program = program(tmp_path)
    assert timed_program.check().timings == ()
    path = write_measurement(measure(timed_program, samples=40), tmp_path / "new" / "times.json")
    (report,) = timed_program.check(times=path).timings
    given = {s["name"]: s["wcet_ns"] for s in json.loads(path.read_text())["steps"]}
    assert {r.name: r.wcet_ns for r in report.rows} == given
    assert report.elsewhere == ("Far",)


def test_times_of_a_program_that_was_changed_since_are_refused(tmp_path: Path) -> None:
    """A comment is enough: nobody knows what else a change did."""
    path = write_measurement(measure(program(tmp_path), samples=8), tmp_path / "times.json")
    for file in tmp_path.glob("*.soter"):
        file.write_text(file.read_text() + "// changed\n")
        with pytest.raises(SoterError, match="U011") as caught:
            soter.load(file).check(times=path)
        assert "measure" in caught.value.diagnostics[0].helps[0]


@pytest.mark.parametrize(
    "change", ["schema", "system", "steps", "negative", "text", "program", "unsaid", "part"]
)
def test_another_file_is_refused(change: str, tmp_path: Path) -> None:
    timed_program = program(tmp_path)
    told: Any = {"schema": 1, **DOCUMENT.of(measure(timed_program, samples=8))}
    wrong = {
        "schema": {**told, "schema": 2},
        "system": {**told, "system": "Other"},
        "steps": {k: v for k, v in told.items() if k != "steps"},
        "negative": {**told, "steps": [{"name": "Count", "wcet_ns": -1}]},
        "program": {**told, "program_sha256": "0" * 64},
        "unsaid": {k: v for k, v in told.items() if k != "program_sha256"},
        "part": {**told, "steps": [*told["steps"], {"name": "Else", "wcet_ns": 1000}]},
    }
    path = tmp_path / "times.json"
    path.write_text("no JSON" if change == "text" else json.dumps(wrong[change]))
    with pytest.raises(SoterError, match="U011"):
        timed_program.check(times=path)


EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CART, LANE = EXAMPLES / "wall" / "cart.soter", EXAMPLES / "rest" / "lane.soter"


def test_counts_of_a_board_are_times_only_by_a_stated_factor(tmp_path: Path) -> None:
    if missing_tool(read_board("mps2-an500")) or shutil.which("qemu-system-arm") is None:
        pytest.skip("there is no cross compiler, or no emulator")
    cart = soter.load(CART)
    built = cart.build("cortex-m", tmp_path / "out", "Protected", board="mps2-an500")
    counts = {s.name: s.most for s in build_image(built, read_board("mps2-an500")).steps}
    many = measure_on_board(cart, "mps2-an500", "20us", "Protected", margin=3.0)
    assert [s.name for s in many.steps] == ["SafeCart.dm", "SafeCart.Careful", "SafeCart.Fast"]
    for timed in many.steps:
        assert timed.longest_ns == 20_000 * counts[timed.name] > 0
        assert timed.wcet_ns == 3 * timed.longest_ns
        assert timed.samples > 0
        assert timed.percentiles == ()
    path = write_measurement(many, tmp_path / "times.json")
    (timing,) = [t for t in soter.load(CART).check(times=path).timings if t.system == "Protected"]
    assert timing.assumed == many.assumed
    assert "an instruction takes 20000 ns at most on mps2_an500: stated" in timing.assumed
    assert {r.name: r.wcet_ns for r in timing.rows} == {s.name: s.wcet_ns for s in many.steps}


def test_what_needs_more_stack_than_the_board_gives_is_said_before_it_runs(tmp_path: Path) -> None:
    text = (BOARDS / "mps2_an500.c").read_text(encoding="utf-8")
    small = tmp_path / "small.c"
    small.write_text(re.sub("(?<=STACK_BYTES )\\d+", "1024", text), encoding="utf-8")
    if missing_tool(read_board(str(small))):
        pytest.skip("there is no cross compiler")
    with pytest.raises(SoterError) as caught:
        measure_on_board(soter.load(LANE), str(small), "20ns")
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "X015"
    assert "bytes too many for its stack" in diagnostic.message


@pytest.mark.parametrize("factor", ["0ns", "-1ns", "2ms", "soon", "20"])
def test_a_factor_that_is_none_is_refused(factor: str) -> None:
    with pytest.raises(SoterError) as caught:
        measure_on_board(soter.load(CART), "mps2-an500", factor)
    assert caught.value.diagnostics[0].code == "U001"


@pytest.mark.whole
def test_without_an_image_nothing_is_measured_on_a_board(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("soter.targets.cortex_m_image.missing_tool", lambda _: "no tools")
    with pytest.raises(SoterError) as caught:
        measure_on_board(soter.load(CART), "mps2-an500", "20ns")
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "X004"
    assert "no tools" in diagnostic.message
