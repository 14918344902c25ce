"""Steps that are too wide to be tried to the end, and what the explorer has no room for."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import processes
from soter.explore import assumptions
from soter.explore.command import TraceHeader, explore_test
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.search import Found
from soter.explore.search_options import CHOICES_MAX, THREADS_BFS, WORDS_MAX, SearchOptions
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from soter.explore.engine.coverage import EngineProgress
    from soter.explore.results import TestResult

TOLD = TraceHeader("wide.soter", {})
HEADER = Path(__file__).resolve().parents[3] / "src/soter/explore/engine/c/soter_explore.h"


def choosing(count: int, most: int) -> str:
    """A step with so many choices, which end in four configurations."""
    asked = "\n".join(f"if choose bool {{ s = min(s + 1, {most}); }}" for _ in range(count))
    return f"""soter 1;
topic n: int in [0, {most}];
node Wide period 10ms {{ publishes n; step {{ var s: int = 0; {asked} publish n = s; }} }}
system S {{ w: Wide; until 100ms; }}
test Clean {{ system S; horizon 20ms; always n <= {most}; }}
test Broken {{ system S; horizon 20ms; always n <= 2; }}
"""


BIRTHS = """soter 1;
topic pos: float;
plant Point period 10ms { drives pos = a0;
"""
BIRTHS += "".join(f"state a{i}: float in [-1.0, 1.0]; next a{i} = 0.0;\n" for i in range(40))
BIRTHS += """}
system S { p: Point; until 100ms; }
test T { system S; horizon 20ms; always pos <= 2.0; }
"""
GUARANTEE = """soter 1;
topic n: int in [0, 9];
node Wide period 10ms { publishes n; guarantees n < 3; step { var s: int = 0;
"""
GUARANTEE += "if choose bool { s = min(s + 1, 9); }\n" * 70
GUARANTEE += """publish n = s; } }
system S { w: Wide; until 100ms; }
test T { system S; horizon 20ms; }
"""


def interrupted(text: str, test: str, after_s: float = 0.5, **how: object) -> object:
    """What a search found that was interrupted. One that does not listen never ends."""
    engine = Engine(system_of_text(text, test))

    def press(progress: EngineProgress) -> None:
        if progress.seconds > after_s:
            raise KeyboardInterrupt

    return engine.explore(replace(EngineSettings(), **how), press)  # type: ignore[arg-type]


# ---------------------------------------------------------------- interrupting


@pytest.mark.parametrize("plainly", [False, True])
def test_a_step_that_never_ends_can_be_interrupted(plainly: bool) -> None:
    exploration = interrupted(choosing(70, 3), "Clean", plainly=plainly)
    assert exploration.status == "stopped"  # type: ignore[attr-defined]
    assert exploration.stopped == "interrupted"  # type: ignore[attr-defined]
    assert exploration.states >= 5  # type: ignore[attr-defined]


@pytest.mark.parametrize("reduction", ["instants", "groups", "all"])
def test_ends_that_differ_in_the_highest_bits_can_be_interrupted(reduction: str) -> None:
    values = ", ".join(["choose bool"] * 64)
    text = f"""soter 1;
topic t: bool[64];
node W period 10ms {{ publishes t; step {{ publish t = [{values}]; }} }}
system S {{ w: W; until 100ms; }}
test T {{ system S; horizon 30ms; never t[0] && !t[0]; }}
"""
    exploration = interrupted(text, "T", reduction=reduction)
    assert getattr(exploration, "status", None) == "stopped"


def test_a_start_that_never_ends_can_be_interrupted() -> None:
    exploration = interrupted(BIRTHS, "T", memory=2**40, max_states=2**60)
    assert exploration.status == "stopped"  # type: ignore[attr-defined]
    assert exploration.states > 0  # type: ignore[attr-defined]


def test_the_answers_of_a_long_step_are_counted_while_they_are_tried() -> None:
    engine = Engine(system_of_text(choosing(70, 3), "Clean"))
    looks: list[EngineProgress] = []

    def look(progress: EngineProgress) -> None:
        looks.append(progress)
        if progress.answers > 0:
            raise KeyboardInterrupt

    assert engine.explore(EngineSettings(), look, 30.0).stopped == "interrupted"
    assert looks[-1].answers >= 2**16


def test_the_least_trace_of_a_step_that_never_ends_is_given_up() -> None:
    engine = Engine(system_of_text(choosing(70, 3), "Broken"))
    assert engine.find_shortest_trace(EngineSettings(), (0, 0), None, 0.3).status == "stopped"


@pytest.mark.parametrize(("text", "test"), [(choosing(70, 3), "Broken"), (GUARANTEE, "T")])
def test_a_violation_in_a_step_that_never_ends_is_found(text: str, test: str) -> None:
    test_result = explored(text, test, minimise=0.0, time=30.0)
    assert test_result.verdict == "violated"
    assert test_result.replayed is not None


# ---------------------------------------------------------------- time


def explored(text: str, test: str, **options: object) -> TestResult:
    made = replace(SearchOptions(), **options)  # type: ignore[arg-type]
    return explore_test(system_of_text(text, test), made, TOLD)


@pytest.mark.parametrize("strategy", ["bfs", "random"])
def test_the_time_of_a_search_can_be_bounded(strategy: str) -> None:
    text = choosing(70, 3)
    test_result = explored(text, "Clean", strategy=strategy, time=0.4, runs=10**12)
    assert (test_result.verdict, test_result.bound) == ("bound", "time")
    assert "--time" in test_result.why
    assert test_result.seconds >= 0.4
    assert not test_result.interrupted


def test_a_search_that_ends_in_time_says_nothing_of_it() -> None:
    assert explored(choosing(3, 3), "Clean", time=60.0).verdict == "exhausted"


# ---------------------------------------------------------------- limits


def test_more_choices_than_there_is_room_for_name_the_step() -> None:
    test_result = explored(choosing(CHOICES_MAX + 1, 3), "Clean")
    assert (test_result.verdict, test_result.bound) == ("bound", "choices")
    assert f"a step of w asks for more than {CHOICES_MAX} choices" in test_result.why
    assert test_result.states > 0


@pytest.mark.long
def test_as_many_choices_as_there_is_room_for_are_no_limit() -> None:
    test_result = explored(choosing(CHOICES_MAX, 3), "Clean", time=0.3)
    assert test_result.bound == "time"


def floats(count: int) -> str:
    zeros = ", ".join(["0.0"] * count)
    return f"""soter 1;
topic n: int in [0, 1];
node N period 10ms {{ publishes n; var a: float[{count}] = [{zeros}];
  step {{ a[0] = a[0] + 1.0; publish n = choose [0, 1]; }} }}
system S {{ n: N; until 100ms; }}
test T {{ system S; horizon 20ms; always n < 2; }}
"""


@pytest.mark.parametrize("strategy", ["bfs", "random"])
def test_a_configuration_wider_than_there_is_room_for_says_so(strategy: str) -> None:
    test_result = explored(floats(WORDS_MAX), "T", strategy=strategy)
    assert (test_result.verdict, test_result.bound) == ("bound", "width")
    assert f"takes {WORDS_MAX + 1:,} words of 64 bits" in test_result.why
    assert f"room for {WORDS_MAX:,}" in test_result.why


def test_a_wide_configuration_is_explored() -> None:
    assert explored(floats(1000), "T").verdict == "exhausted"


def test_memory_that_is_too_little_to_begin_says_how_much_is_needed() -> None:
    test_result = explored(floats(1000), "T", memory=2**20)
    assert (test_result.verdict, test_result.bound) == ("bound", "memory")
    assert re.search(r"the first tables alone take [0-9,]{9,} bytes", test_result.why)


def test_what_there_is_room_for_is_what_the_c_says() -> None:
    header = HEADER.read_text(encoding="utf-8")
    named = {"CHOICES": CHOICES_MAX, "WORDS": WORDS_MAX, "THREADS": THREADS_BFS}
    for name, value in named.items():
        assert re.search(rf"^#define SOTER_{name} {value}U\b", header, re.MULTILINE), name


MEMBERS = ", ".join(f"M{i}" for i in range(300))
MANY_MEMBERS = f"""soter 1;
type Many = enum {{ {MEMBERS} }};
topic m: Many = Many.M5;
node N period 10ms {{ publishes m; step {{ publish m = Many.M256; }} }}
system S {{ n: N; until 100ms; }}
test T {{ system S; horizon 20ms; never m == Many.M7; }}
"""


def test_a_member_that_has_no_class_is_not_taken_for_another() -> None:
    assert "m = M0" in explored(MANY_MEMBERS, "T").coverage.values.unreached


def test_scalars_that_coverage_has_no_room_for_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    system = system_of_text(COUNTERS, "T")
    sentence = "what was reached counts the first 3 scalars of topics, of 4"
    outcome: Found = Found(status="exhausted", broken=None, steps=())
    assert sentence not in assumptions.test_assumptions(system, SearchOptions(), outcome, (), None)
    monkeypatch.setattr(assumptions, "LEAVES_MAX", 3)
    assert sentence in assumptions.test_assumptions(system, SearchOptions(), outcome, (), None)


# ---------------------------------------------------------------- threads and memory

COUNTERS = "soter 1; type K = int in [0, 1000000];" + "".join(
    f"topic t{i}: K; node N{i} period 10ms {{ publishes t{i}; var n: K = 0;"
    f" step {{ n = choose {{ n, n + 1, n + 2 }}; publish t{i} = n; }} }}"
    for i in range(4)
)
COUNTERS += (
    "system S { node N0; node N1; node N2; node N3; never t0 + t1 + t2 + t3 >= 100000; }"
    " test T { system S; horizon 30ms; } test Long { system S; horizon 300ms; }"
)

TREE = COUNTERS.replace("n + 1, n + 2", "3 * n + 1, 3 * n + 2").replace("{ n,", "{ 3 * n,")
"""No configuration is reached twice: memory is full soon, though a layer is all that is kept."""


@pytest.mark.parametrize("threads", [3, 8, THREADS_BFS])
def test_as_many_threads_search_as_are_asked_for(threads: int) -> None:
    engine = Engine(system_of_text(COUNTERS, "T"))
    alone = engine.explore(EngineSettings(reduction="none"))
    exploration = engine.explore(EngineSettings(reduction="none", threads=threads))
    assert (alone.threads, exploration.threads) == (1, threads)
    assert exploration.status == alone.status == "exhausted"
    assert (exploration.states, exploration.transitions) == (alone.states, alone.transitions)


MEASURE = """
import sys
sys.path.insert(0, {tests!r})
from soter.explore.engine.explorer_library import Engine, EngineSettings
from unit.explore.random_walks import system_of_text
from unit.explore.test_wide_steps import TREE

def resident(what):
    lines = open("/proc/self/status").read().splitlines()
    return 1024 * int(next(x for x in lines if x.startswith(what)).split()[1])

engine = Engine(system_of_text(TREE, "Long"))
before, told = resident("VmRSS"), []
how = EngineSettings(memory={memory}, threads={threads})
found = engine.explore(how, lambda p: told.append(p.bytes))
print(found.status, resident("VmHWM") - before, found.total_bytes, max(told, default=0))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("threads", [1, 4])
@pytest.mark.long
def test_memory_bounds_what_the_process_takes(threads: int) -> None:
    memory = 160 * 2**20
    tests = str(Path(__file__).resolve().parents[2])
    code = MEASURE.format(tests=tests, memory=memory, threads=threads)
    done = processes.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    status, peak, total, told = done.stdout.split()
    assert status == "memory"
    assert 0.8 * memory <= int(peak) <= 1.2 * memory
    assert 0.8 * memory <= int(total) <= memory
    assert int(told) <= memory


def test_the_memory_told_has_the_frontier_in_it() -> None:
    engine = Engine(system_of_text(COUNTERS, "Long"))
    exploration = engine.explore(EngineSettings(max_states=300_000))
    assert exploration.frontier_bytes > 0
    assert exploration.total_bytes >= exploration.table_bytes + exploration.frontier_bytes
