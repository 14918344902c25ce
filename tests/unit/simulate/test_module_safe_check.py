"""When a module's own `safe` was false in a run: on estimates, beside the properties."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from generators.random_programs import program
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from soter.simulate.result import ModuleSummary, Run

ROOT = Path(__file__).resolve().parents[3]
CART = (ROOT / "examples" / "wall" / "cart.soter").read_text("utf-8")
PERIOD_NS = 50_000_000
SAFE = "safe Clear(motion);"


def cart(folder: Path, *changes: tuple[str, str]) -> soter.Program:
    text = CART
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / "cart.soter"
    path.write_text(text, encoding="utf-8")
    return soter.load(path)


def own(run: Run) -> ModuleSummary:
    return run.modules["SafeCart"]


@pytest.fixture(scope="module")
def within(tmp_path_factory: pytest.TempPathFactory) -> soter.Program:
    """A cart whose `safe` has a limit that a parameter says."""
    changes = (
        ("rta SafeCart {", "param LIMIT: float = 10.0;\nrta SafeCart {"),
        (SAFE, "safe abs(motion.x) < LIMIT;"),
    )
    return cart(tmp_path_factory.mktemp("within"), *changes)


@pytest.mark.parametrize("seed", range(5))
def test_it_is_counted_as_the_trace_says_and_alike_by_both_engines(
    within: soter.Program, seed: int
) -> None:
    limit = float(np.random.default_rng(seed).uniform(0.5, 9.5))
    params = {"LIMIT": limit}
    runs = [
        within.simulate(until=3.0, seed=seed, engine=engine, params=params)
        for engine in ("native", "interp")
    ]
    native, interpreted = runs
    at_look = native.require_trace()["header"]["ct"] % PERIOD_NS == 0
    false = (np.abs(native.array("motion.x")) >= limit) & at_look
    assert own(native) == own(interpreted)
    assert own(native).looks == at_look.sum() == 61
    assert own(native).outside == false.sum()
    if false.any():
        assert own(native).first_outside_s == native.time_s()[false][0]


def test_a_note_and_the_page_say_so_where_every_property_holds(
    within: soter.Program, tmp_path: Path
) -> None:
    run = within.simulate(until=5.0, params={"LIMIT": 5.0})
    assert run.violations == 0
    summary = own(run)
    assert summary.outside is not None
    assert summary.outside > 10
    (note,) = run.notes
    assert note == (
        f"SafeCart: its `safe` was false on what its topics held in {summary.outside} of "
        f"{summary.looks} looks of its DM, first at {summary.first_outside_s:.3f} s"
    )
    page = tmp_path / "run.html"
    within.write_report(run, page)
    assert "its `safe` was false" in re.sub(r"</?code>", "`", page.read_text(encoding="utf-8"))
    assert within.simulate(until=5.0).notes == []


def test_a_look_on_a_stale_read_is_none(tmp_path: Path) -> None:
    silent = ("until 30s;", "faults { silent c at 600 per 1h for 1s; }\n  until 30s;")
    program = cart(tmp_path, (SAFE, "safe motion.x < -100.0;"), silent)
    run = program.simulate(until=20.0)
    assert own(run).looks == own(run).outside
    stale = run.require_trace()["modules"]["stale"][:, 0]
    at_look = run.require_trace()["header"]["ct"] % PERIOD_NS == 0
    assert own(run).looks == (at_look & (stale == 0)).sum() < at_look.sum() - 15


def test_a_fault_in_it_counts_as_false(tmp_path: Path) -> None:
    program = cart(tmp_path, (SAFE, "safe 1 / int(motion.x * 0.0) > 0;"))
    for engine in ("native", "interp"):
        summary = own(program.simulate(until=1.0, engine=engine))
        assert summary.outside == summary.looks == 21


def test_what_nobody_published_yet_is_nobodys_state(tmp_path: Path) -> None:
    echo = """topic echo: float;
node Echo period 50ms phase 10ms { subscribes motion; publishes echo; step { publish echo = 1.0; } }
rta SafeCart {"""
    placed = ("  module SafeCart;", "  node Echo;\n  module  SafeCart;")
    program = cart(tmp_path, ("rta SafeCart {", echo), placed, placed, (SAFE, "safe echo > 100.0;"))
    summary = own(program.simulate(until=1.0))
    assert summary.looks == 20, "at 0 s there was nothing to read"


def test_a_safe_that_asks_an_extern_function_is_left_to_the_run(tmp_path: Path) -> None:
    asks = ("fun Clear(", "extern fun Near(x: float): bool;\nfun Clear(")
    program = cart(tmp_path, asks, (SAFE, "safe Near(motion.x);"))
    for engine in ("native", "interp"):
        run = program.simulate(until=1.0, engine=engine)
        assert own(run).outside is None
        assert run.violations == 0


@pytest.mark.whole
@pytest.mark.parametrize("number", [100, 102, 103, 105])
def test_random_programs_are_judged_alike_by_both_engines(number: int) -> None:
    system = system_of(check_file("random.soter", program(number)), None)
    until_ns = 40 * max(m.period_ns for m in system.modules)
    native = NativeProgram(system, "-O0").run(until_ns, number, observed=True)
    interpreted = run_interpreted(system, until_ns, number)
    assert native.safe_looks == interpreted.safe_looks
    assert any(of.outside for of in native.safe_looks)
