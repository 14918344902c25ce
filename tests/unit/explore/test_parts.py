"""Parts of a system that share nothing: found, explored apart, and put together again."""

from __future__ import annotations

from pathlib import Path

import pytest

import soter
from generators.explorer_configurations import replay
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.language.front_end import check_file, system_of_test

EXAMPLES = Path(__file__).resolve().parents[3] / "examples/testing"

LANES = """soter 1;
type Cell = int in [-3, 3];
topic cell: Cell;
topic move: int in [-1, 1];
plant Lane period 10ms {{
  reads move;  drives cell = at;  state at: Cell;  next at = max(-3, min(3, at + move));
}}
node Any period 20ms {{ publishes move; step {{ publish move = choose {{ 0, 1, -1 }}; }} }}
system One {{ lane: Lane; node Any; {one} }}
system Both default {{ left: One; right: One; {both} until 1s; }}
test T {{ system Both; horizon {horizon}; }}
"""


def program(
    tmp_path: Path, one: str = "", both: str = "", horizon: str = "60ms", more: str = ""
) -> Path:
    path = tmp_path / "lanes.soter"
    path.write_text(LANES.format(one=one, both=both, horizon=horizon) + more, encoding="utf-8")
    return path


def parts(path: Path) -> tuple[tuple[int, int, int], ...]:
    engine = Engine(system_of_test(check_file(str(path)), "T"))
    return tuple((p.actors.bit_count(), p.properties, p.timeds) for p in engine.parts)


def test_instances_that_share_nothing_are_parts_with_their_own_properties(tmp_path: Path) -> None:
    path = program(tmp_path, one="always abs(lane.truth.at) <= 3;")
    assert parts(path) == ((2, 0b01, 0), (2, 0b10, 0))


def test_a_property_of_both_joins_them(tmp_path: Path) -> None:
    path = program(tmp_path, both="always left.lane.truth.at + right.lane.truth.at <= 6;")
    assert parts(path) == ((4, 1, 0),)


def test_who_drives_what_both_read_joins_them(tmp_path: Path) -> None:
    text = LANES.format(one="", both="", horizon="40ms")
    text = text.replace("soter 1;", "soter 1;\ninput topic wish: bool;\ninput topic all: bool;", 1)
    text = text.replace("publishes move;", "subscribes wish; publishes move;")
    text = text.replace("step { publish", "step { if wish { assert true; } publish")
    text = text.replace("left: One;", "left: One { wish = all };")
    text = text.replace("right: One;", "right: One { wish = all };")
    text = text.replace("test T {", "test T { input all every 20ms;")
    path = tmp_path / "wish.soter"
    path.write_text(text, encoding="utf-8")
    assert [count for count, _, _ in parts(path)] == [5]


@pytest.mark.parametrize("at", [1, 2, 3, 4])
def test_the_verdict_is_that_of_the_whole(tmp_path: Path, at: int) -> None:
    path = program(tmp_path, one=f"always lane.truth.at < {at};")
    whole = soter.load(path).explore(reduction="ample")["T"]
    apart = soter.load(path).explore(reduction="all")["T"]
    assert (whole.parts, apart.parts) == (1, 2)
    assert whole.verdict == apart.verdict == ("exhausted" if at == 4 else "violated")
    if apart.verdict == "exhausted":
        assert apart.states < whole.states / 5
    else:
        assert apart.minimal
        assert apart.replayed is not None
        assert whole.replayed is not None
        assert len(apart.replayed.steps) == len(whole.replayed.steps)


def test_only_the_second_part_may_violate(tmp_path: Path) -> None:
    path = program(tmp_path, both="always right.lane.truth.at > -2;")
    test_result = soter.load(path).explore()["T"]
    assert test_result.parts == 2
    assert test_result.verdict == "violated"
    assert test_result.broken is not None
    assert "right" in test_result.broken.text


def test_a_part_is_completed_to_an_execution_of_the_whole(tmp_path: Path) -> None:
    path = program(tmp_path, both="always right.lane.truth.at > -2;")
    engine = Engine(system_of_test(check_file(str(path)), "T"))
    settings = EngineSettings(part=engine.parts[1])
    alone = engine.explore(settings)
    assert alone.status == "violated"
    whole = engine.complete_trace(settings, alone.steps)
    assert whole is not None
    assert len(whole.steps) > len(alone.steps)
    possible, breaks, _ = replay(engine, whole.steps, whole.broken, settings.seed)
    assert (possible, breaks) == (len(whole.steps), True)


def test_two_modules_are_two_parts() -> None:
    test_result = soter.load(EXAMPLES / "two_modules.soter").explore()["BothStayInside"]
    assert (test_result.verdict, test_result.parts) == ("exhausted", 2)
    assert test_result.states < 10_000
