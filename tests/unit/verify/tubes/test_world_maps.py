"""Maps: what `safe` of a module with `rest` reads and no plant drives."""

from __future__ import annotations

from functools import cache
from math import inf, nan
from random import Random
from typing import TYPE_CHECKING

import pytest

from soter.api import Program
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import AgeRead
from soter.simulate.run_report import report_page
from soter.verify.deploy.missing_predicates import complete
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.tube_check import TubeCheck

if TYPE_CHECKING:
    from pathlib import Path

BEFORE_A_WALL = """
soter 1;
type Push = { gas: float, brake: float };
type Sled = { p: float, v: float };
type Free = { low: float, high: float };
topic sled: Sled in { v in [-1.0, 12.0] } max_age 20ms;
topic push: Push in { gas in [0.0, 1.0], brake in [0.0, 1.0] } = { gas: 0.0, brake: 1.0 };
input topic free: Free in { low in [-50.0, 0.0], high in [-10.0, 20.0] } = { low: -5.0, high: 5.0 }
    max_age 250ms static;
node Fast period 50ms { publishes push; step { publish push = { gas: 1.0, brake: 0.0 }; } }
node Brake period 50ms { publishes push; step { publish push = { gas: 0.0, brake: 1.0 }; } }
plant Track period 10ms {
  reads push;
  drives sled = { p: p, v: v };
  state p: float;
  state v: float;
  disturbance grip: float in [0.9, 1.1];
  der p = v;
  der v = 2.0 * push.gas - 4.0 * grip * push.brake * v / (abs(v) + 0.1);
  measured sled.p within 0.05, sled.v within 0.05;
}
rta Stop {
  ac Fast;
  sc Brake;
  period 50ms;
  safe sled.p > free.low && sled.p < free.high;
  rest abs(sled.v) < 0.3 moves sled.p by 0.1 within 3s;
  verify { late dm 1ms, sc 1ms; response dm 1ms, sc 1ms; acts within 5ms; }
}
system World {
  t: Track;
  input free every 100ms;
  module Stop;
  always t.truth.p < 20.0 && t.truth.p > -0.5;
  always t.truth.p > 0.0 || time < 5.0;
}
"""
"""Whatever `free` says is free: p stays in [-0.5, 20]."""
ALONE = "  input free every 100ms;\n"
NODE = "node Eye period 100ms {{ {0}publishes free; step {{ publish free = {1}; }} }}\nrta Stop"


def changed(text: str, *pairs: tuple[str, str]) -> str:
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def seen_by(value: str, reads: str = "") -> str:
    """With a node that publishes the map."""
    return changed(
        BEFORE_A_WALL,
        ("rta Stop", NODE.format(reads, value)),
        (ALONE, "  node Eye;\n"),
        ("input topic", "topic"),
    )


def problem_of(text: str) -> TubeProblem:
    checked = check_file("module.soter", text)
    assert checked.program is not None, [str(d) for d in checked.diagnostics.items]
    flat = system_to_prove(checked, "World", {}, exact=False)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return problem


@cache
def check_of(text: str) -> Caller:
    check = TubeCheck(problem_of(text))
    return Caller(check.text_in_flight({s: Interval(-0.5, 0.5) for s in check.states}))


def program(tmp_path: Path, text: str) -> Program:
    at = tmp_path / "world.soter"
    at.write_text(text, encoding="utf-8")
    return Program(str(at))


# ---------------------------------------------------------------- the check


def test_a_map_is_read_as_the_same_constants_would_be() -> None:
    """A check whose `safe` has these numbers in the program gives the same answers."""
    draw = Random(7)  # noqa: S311 - drawn examples
    said = set()
    for _ in range(3):
        low, high = draw.uniform(-3.0, -1.0), draw.uniform(4.0, 9.0)
        fixed = changed(BEFORE_A_WALL, ("free.low", f"{low!r}"), ("free.high", f"{high!r}"))
        fixed = changed(fixed, (ALONE, ""), ("input topic", "topic"))
        for _ in range(5):
            at = [draw.uniform(-4.0, 9.0), draw.uniform(0.0, 6.0)]
            good = check_of(BEFORE_A_WALL).returns_true("good", at, [low, high])
            assert good == check_of(fixed).returns_true("good", at)
            said.add(good)
    assert said == {False, True}


@pytest.mark.parametrize("wrong", [nan, inf, -inf, 1e101, -1e101])
@pytest.mark.parametrize("at", [0, 1])
def test_what_is_no_number_is_never_good(wrong: float, at: int) -> None:
    free = [-5.0, 15.0]
    assert check_of(BEFORE_A_WALL).returns_true("good", [0.0, 1.0], free)
    free[at] = wrong
    assert not check_of(BEFORE_A_WALL).returns_true("good", [0.0, 1.0], free)


def test_a_number_that_is_not_compared_has_to_be_one_too() -> None:
    """`||` leaves nothing out: what is not asked of a map is no reason to trust it."""
    either = changed(BEFORE_A_WALL, ("free.low &&", "-90.0 || sled.p > free.low ||"))
    assert check_of(either).returns_true("good", [0.0, 1.0], [-5.0, 15.0])
    assert not check_of(either).returns_true("good", [0.0, 1.0], [nan, 15.0])


def test_less_that_is_free_is_good_less_often() -> None:
    check = check_of(BEFORE_A_WALL)
    for x in range(2, 8):
        at = [1.2 * x, 3.0]
        wide, narrow = (check.returns_true("good", at, [-5.0, high]) for high in (11.0, 8.0))
        assert wide or not narrow
    assert not check.returns_true("good", [9.0, 3.0], [-5.0, 8.0])


# ---------------------------------------------------------------- in flight


@pytest.mark.parametrize("seed", range(4))
def test_maps_that_change_and_forget_do_no_harm(tmp_path: Path, seed: int) -> None:
    """Drawn anew each 100 ms, within what is free; AC drives on."""
    run = program(tmp_path, BEFORE_A_WALL).simulate(until="8s", seed=seed)
    assert run.violations == 0
    assert run.modules["Stop"].ac_share > 0.02


def test_both_engines_read_the_same_map(tmp_path: Path) -> None:
    world = program(tmp_path, BEFORE_A_WALL)
    runs = [world.simulate(until="400ms", seed=1, engine=e) for e in ("native", "interp")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert runs[0].modules["Stop"].ac_share > 0.2


def test_a_map_that_breaks_its_contract_does_harm(tmp_path: Path) -> None:
    """Nothing keeps the sled in what was free a moment ago but the contract."""
    assert (
        program(tmp_path, BEFORE_A_WALL.replace("20.0 &&", "4.0 &&"))
        .simulate(until="8s", seed=0)
        .violations
    )


def test_ac_has_control_while_a_map_is_fresh(tmp_path: Path) -> None:
    """Not before the first one, though the start is proved of its default; not after the last."""
    free = "{ low: -5.0, high: 20.0 }"
    flies = program(tmp_path, seen_by(free)).simulate(until="3s")
    assert flies.modules["Stop"].ac_share > 0.8
    never = program(
        tmp_path,
        changed(BEFORE_A_WALL, (ALONE, "  external topic free;\n"), ("input topic", "topic")),
    )
    assert never.simulate(until="1s").modules["Stop"].ac_share == 0.0
    rare = changed(BEFORE_A_WALL, (ALONE, "  input free every 1s;\n"))
    share = program(tmp_path, rare).simulate(until="8s", seed=2).modules["Stop"].ac_share
    assert share < 0.3


def test_a_run_rests_on_what_its_map_says(tmp_path: Path) -> None:
    run = program(tmp_path, BEFORE_A_WALL).simulate(until="100ms")
    rests_on = report_page(run, "a map", {}).assumptions
    assert "Stop: what free calls free stays free, for ever" in rests_on


def test_commands_are_judged_by_a_fresh_map_alone() -> None:
    """Between two looks, too, in which its DM sees that a map is old."""
    text = changed(BEFORE_A_WALL, ("  rest abs", "  shield;\n  rest abs"))
    flat = system_to_prove(check_file("module.soter", text), "World", {}, exact=False)
    complete(flat)
    shield = flat.modules[0].shield
    assert shield is not None
    aged = {n.topic.name for n in nodes([shield.permits]) if isinstance(n, AgeRead)}
    assert aged == {"sled", "free"}


def test_the_start_is_proved_of_the_default(tmp_path: Path) -> None:
    (module,) = program(tmp_path, BEFORE_A_WALL).verify(refute=False).modules
    assert module.findings["start"].verdict == "proved"
    assert "map free" in {a.key for a in module.assumptions}
    nothing = changed(BEFORE_A_WALL, ("high: 5.0 }", "high: -5.0 }"))
    (module,) = program(tmp_path, nothing).verify(refute=False).modules
    assert module.findings["start"].verdict == "undecided"
    assert module.findings["P2a"].verdict == "proved"


# ---------------------------------------------------------------- what is no map

REFUSED: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "SC reads it": (
        "R007",
        (
            ("node Brake period 50ms {", "node Brake period 50ms { subscribes free;"),
            ("gas: 0.0, brake: 1.0 }; } }", "gas: 0.0 * free.low, brake: 1.0 }; } }"),
        ),
    ),
    "rest reads it": ("R007", (("< 0.3 moves", "< 0.3 && free.low < 0.0 moves"),)),
    "it has no age": ("R011", (("\n    max_age 250ms", ""),)),
    "nobody says that it stays true": ("R001", ((" static;", ";"),)),
    "it is what the robot filters of itself": (
        "R007",
        (("sled.p > free.low && sled.p < free.high", "free.low > -6.0 && sled.v < 10.0"),),
    ),
    "it counts": (
        "R014",
        (
            ("high: float };", "high: float, n: int in [0, 9] };"),
            ("high: 5.0 }", "high: 5.0, n: 0 }"),
        ),
    ),
    "it is a list": (
        "R014",
        (
            ("type Free = { low: float, high: float };", "type Free = float[<=2];"),
            (" in { low in [-50.0, 0.0], high in [-10.0, 20.0] } = { low: -5.0, high: 5.0 }", ""),
            ("sled.p > free.low && sled.p < free.high", "free.len < 1 || sled.p < free[0]"),
            (ALONE, "  external topic free;\n"),
            ("input topic", "topic"),
        ),
    ),
    "the module publishes it": (
        "R001",
        (("sled.p > free.low &&", "push.gas < 0.9 && sled.p > free.low &&"),),
    ),
    "a plant drives it": (
        "R007",
        (
            ("drives sled", "drives free = { low: -5.0, high: p };\n  drives sled"),
            (ALONE, ""),
            ("input topic", "topic"),
        ),
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_map_is_refused(tmp_path: Path, name: str) -> None:
    code, pairs = REFUSED[name]
    with pytest.raises(SoterError) as raised:
        program(tmp_path, changed(BEFORE_A_WALL, *pairs)).verify(refute=False)
    assert [d.code for d in raised.value.diagnostics][:1] == [code]


def test_without_rest_nothing_is_a_map(tmp_path: Path) -> None:
    text = changed(
        BEFORE_A_WALL,
        ("rest abs(sled.v) < 0.3 moves sled.p by 0.1 within 3s;", ""),
        ("verify {", "verify { grid sled.p in [-9.0, 9.0] / 9, sled.v in [-1.0, 9.0] / 9;"),
    )
    with pytest.raises(SoterError) as raised:
        program(tmp_path, text).verify(refute=False)
    assert raised.value.diagnostics[0].code == "R001"
