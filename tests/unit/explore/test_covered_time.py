"""What a search that ended early says it has covered, against everything that there is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from generators.explorer_configurations import stored_configurations
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.results import CHOICES, EXHAUSTED, MEMORY, SAMPLED, STATES
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

EXAMPLES = Path(__file__).resolve().parents[3] / "examples/testing"
MS = 1_000_000

WIDE = """soter 1;
topic t: int in [0, 100000];
topic u: int in [0, 100000];
node N period 10ms { publishes t; var k: int in [0, 100000]; step {
  k = choose { k, min(k + 1, 100000), min(k + 3, 100000) };
  publish t = k;
} }
node M period 15ms { publishes u; var k: int in [0, 100000]; step {
  k = choose { k, min(k + 1, 100000), min(k + 7, 100000) };
  publish u = k;
} }
node Reads period 10ms { subscribes t; publishes seen; step { publish seen = age(t) > 0.012; } }
topic seen: bool;
system S default { node N; node M; node Reads; until 1s; always t < 100000; }
test T { system S; skew 4ms; quantum 2ms; horizon 70ms; }
"""

CUT = """soter 1;
topic a: bool;
topic b: int in [0, 1];
topic c: int in [0, 1];
topic d: int in [0, 300];
node A period 100ms phase 5ms { publishes a; step { publish a = true; } }
node B period 100ms { publishes b; step { publish b = 1; } }
node C period 100ms { publishes c; step { publish c = 1; } }
node D period 100ms { subscribes a; publishes d; step {
  var k: int in [0, 300] = 0;
  if a { for i in 0..300 { if choose bool { k = i; } } }
  publish d = k;
} }
node E period 100ms { subscribes a; publishes e; step { publish e = time > 1.0 || age(a) > 2.0; } }
topic e: bool;
system S default { node A; node B; node C; node D; node E; until 1s; always d < 301; }
test T { system S; skew 20ms; quantum 5ms; horizon 50ms; }
"""
"""Once A has stepped, D asks for more than there is room for: what came after in that layer is
never looked at, some of it earlier than anything that waits for the next one."""


class Whole:
    """A test and all its configurations, none left out by a reduction, with the time of each."""

    def __init__(self, path: Path, test: str) -> None:
        self.engine = Engine(system_of_test(check_file(str(path)), test))
        program = self.engine.model.program
        self.at = (int(program.state_size) + 7) & ~7
        self.horizon = self.engine.plan.horizon_ns
        exploration = self.engine.explore(EngineSettings(reduction="none", keep=True))
        assert exploration.status == "exhausted"
        assert exploration.covered_ns >= self.horizon
        self.states = exploration.states
        self.keys, self.times = self.kept()
        configurations = stored_configurations(self.engine)
        first = self.at + 8 * (1 + int(self.engine.model.timeds) + int(program.modules))
        done = configurations[:, first : first + 4 * len(self.engine.actors)].copy().view(np.uint32)
        self.steps: npt.NDArray[np.int64] = done.sum(axis=1, dtype=np.int64)

    def kept(self) -> tuple[npt.NDArray[np.void], npt.NDArray[np.int64]]:
        """Of the configurations that the last search stored: bytes and times, (states,) each."""
        configurations = np.ascontiguousarray(stored_configurations(self.engine))
        times = configurations[:, self.at : self.at + 8].copy().view(np.int64)[:, 0]
        return configurations.view(np.dtype((np.void, configurations.shape[1])))[:, 0], times

    def missing_before(self, covered_ns: int) -> int:
        """How many configurations before a time the last search did not store."""
        keys, _ = self.kept()
        before = np.unique(self.keys[(self.times >= 0) & (self.times < covered_ns)])
        return len(before) - int(np.isin(before, np.unique(keys)).sum())


@pytest.fixture(scope="module", params=["wide", "battery.soter"])
def whole(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Whole]:
    if request.param == "wide":
        path = tmp_path_factory.mktemp("covered") / "wide.soter"
        path.write_text(WIDE, encoding="utf-8")
        state_space = Whole(path, "T")
    else:
        state_space = Whole(EXAMPLES / request.param, "AnyMission")
    yield state_space
    state_space.engine.close()


@pytest.mark.parametrize("share", [0.05, 0.6])
@pytest.mark.parametrize("reduction", ["none", "sleep"])
def test_everything_before_the_covered_time_was_reached(
    whole: Whole, share: float, reduction: str
) -> None:
    most = max(int(whole.states * share), 10)
    for threads in (1, 2):
        how = EngineSettings(reduction=reduction, max_states=most, threads=threads, keep=True)
        exploration = whole.engine.explore(how)
        assert exploration.status == "states"
        assert 0 <= exploration.covered_ns < whole.horizon + 100 * MS
        assert whole.missing_before(exploration.covered_ns) == 0
        assert exploration.covered_ns > 0 or share < 0.1


def test_a_layer_that_was_cut_short_is_not_covered(tmp_path: Path) -> None:
    path = tmp_path / "cut.soter"
    path.write_text(CUT, encoding="utf-8")
    result = soter.load(path).explore(reduction="none")["T"]
    assert (result.bound, result.depth) == (CHOICES, 2)
    assert result.covered_ns == 0
    assert result.covered_text == "no part of 50 ms was covered in all executions"


def test_breadth_first_covers_as_much_as_there_is(whole: Whole) -> None:
    """No later time could be told: at the covered time itself something is missing."""
    how = EngineSettings(reduction="none", max_states=whole.states // 2, keep=True)
    exploration = whole.engine.explore(how)
    assert whole.missing_before(exploration.covered_ns) == 0
    assert whole.missing_before(exploration.covered_ns + whole.horizon // 2) > 0


def test_a_search_without_memory_says_what_it_covered(tmp_path: Path) -> None:
    path = tmp_path / "wide.soter"
    path.write_text(WIDE.replace("horizon 70ms", "horizon 900ms"), encoding="utf-8")
    result = soter.load(path).explore(memory=2**22)["T"]
    assert result.bound == MEMORY
    assert result.covered_ns is not None
    assert 10 * MS <= result.covered_ns < 900 * MS
    told = f"all executions were covered before {result.covered_ns / MS:g} ms of 900 ms"
    assert result.covered_text == told


def test_progress_tells_the_covered_time(tmp_path: Path) -> None:
    path = tmp_path / "wide.soter"
    path.write_text(WIDE.replace("horizon 70ms", "horizon 900ms"), encoding="utf-8")
    seen: list[int] = []
    soter.load(path).explore(max_states=3_000_000, progress=lambda p: seen.append(p.covered_ns))
    assert seen == sorted(seen)
    assert seen[-1] > 0


def test_bounds_of_a_search_that_ended_say_so(tmp_path: Path) -> None:
    text = WIDE.replace("topic u", "input topic f: float in [0.0, 1.0];\ntopic u")
    text = text.replace(
        "node M period 15ms {", "node M period 15ms { subscribes f; assumes f < 2.0;"
    )
    text = text.replace("test T { system S;", "test T { system S; input f every 30ms;")
    path = tmp_path / "sampled.soter"
    path.write_text(text.replace("70ms", "40ms"), encoding="utf-8")
    program = soter.load(path)
    ended = program.explore()["T"]
    assert (ended.bound, ended.covered_ns, ended.short_of) == (SAMPLED, 40 * MS, None)
    assert ended.covered_text == "but for that, all executions up to 40 ms were covered"
    cut = program.explore(max_states=2000)["T"]
    assert (cut.bound, cut.short_of) == (STATES, SAMPLED)
    assert "of 40 ms; also, a continuum is sampled" in cut.covered_text
    drawn = program.explore(strategy="random", runs=10)["T"]
    assert (drawn.covered_ns, drawn.covered_text) == (None, "")


def test_a_clean_test_is_covered_to_its_horizon(tmp_path: Path) -> None:
    path = tmp_path / "wide.soter"
    path.write_text(WIDE, encoding="utf-8")
    result = soter.load(path).explore()["T"]
    assert (result.verdict, result.covered_ns, result.covered_text) == (EXHAUSTED, 70 * MS, "")
