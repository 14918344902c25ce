"""Modules without `ttf` and `safer`: their sets are computed, and every engine reads them."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import soter
from soter.diagnostics.diagnostic import Source, Span
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file, system_of
from soter.language.model import typed as t
from soter.language.model.system import Module, Scope, System
from soter.language.model.types import FLOAT
from soter.verify.deploy import missing_predicates as complete_
from soter.verify.deploy.level_tables import GroupTable, Writer, level_function
from soter.verify.deploy.missing_predicates import complete
from soter.verify.grid import estimate_sets as levels_
from soter.verify.grid.case import Case

SPAN = Span(Source("table.soter", "x"), 0, 1)


def flat(path: Path, system: str = "Protected") -> System:
    return system_of(check_file(str(path)), system)


def reader(table: GroupTable) -> Callable[..., int]:
    """The level function of a table as a Python function of floats, by the evaluator."""
    w = Writer(SPAN)
    fun = level_function(w, "level", table)
    evaluator = Evaluator.for_scope(Scope({}, {}), {})

    def read(*values: float) -> int:
        literals = [t.Literal(FLOAT, SPAN, float(v)) for v in values]
        entry = evaluator.compiled(w.call_of(fun, *literals))(environment())
        assert isinstance(entry, int)
        return entry

    return read


def environment() -> Environment:
    return Environment(
        topics=(),
        stamps=(),
        time_ns=0,
        period_ns=0,
        in_control=True,
        mode=lambda _: 0,
        truth=lambda _: (),
    )


EDGES = ((-2.0, -0.3, -0.1, 0.0, 5e-324, 0.7, 1.9), (0.0, 0.1, 0.2, 0.30000000000000004, 1.0))
ENTRIES = np.arange(24, dtype=np.uint8).reshape(6, 4) % 3
READ = reader(GroupTable((0, 1), EDGES, ENTRIES))
special = st.sampled_from([math.nan, math.inf, -math.inf, -0.0, 1e308, *EDGES[0], *EDGES[1]])
near = special.map(lambda x: math.nextafter(x, math.inf)) | special.map(
    lambda x: math.nextafter(x, -math.inf)
)
number = special | near | st.floats(-2.5, 2.5)


@given(number, number)
@settings(max_examples=400, deadline=None)
def test_a_level_is_that_of_a_closed_cell_that_holds_the_estimate(x: float, y: float) -> None:
    cells = [
        ENTRIES[i, j]
        for i in range(6)
        for j in range(4)
        if EDGES[0][i] <= x <= EDGES[0][i + 1] and EDGES[1][j] <= y <= EDGES[1][j + 1]
    ]
    assert READ(x, y) in (cells or [0])


def test_one_cell_and_no_axis_are_tables_too() -> None:
    assert reader(GroupTable((0,), ((0.0, 1.0),), np.array([2], dtype=np.uint8)))(1.0) == 2
    assert reader(GroupTable((), (), np.array(1, dtype=np.uint8)))() == 1


def test_every_entry_of_a_table_is_found_again() -> None:
    entries = np.random.default_rng(1).integers(0, 3, size=(37, 5)).astype(np.uint8)
    edges = (tuple(np.linspace(-1, 3, 38)), tuple(np.geomspace(1, 9, 6)))
    read = reader(GroupTable((0, 1), edges, entries))
    middle = [np.add(e[1:], e[:-1]) / 2 for e in edges]
    lookups = [[read(x, y) for y in middle[1]] for x in middle[0]]
    assert np.array_equal(lookups, entries)


def test_both_engines_read_the_same_sets(open_cart: Path) -> None:
    program = soter.load(open_cart)
    native, interp = (
        program.simulate("Protected", "6s", seed=3, engine=e) for e in ("native", "interp")
    )
    assert native.trace_sha256 == interp.trace_sha256
    assert native.modules["SafeCart"].switches_to_ac > 0, "AC gets control"
    assert "ttf and safer computed" in native.notes[0]


def test_no_push_at_the_wall_gets_through(open_cart: Path) -> None:
    program = soter.load(open_cart)
    for seed in range(4):
        run = program.simulate("Protected", "20s", seed=seed)
        assert run.violations == 0
        assert run.modules["SafeCart"].switches_to_sc > 0
    assert program.simulate("Unprotected", "20s").violations > 0, "the wall would be hit"


@pytest.mark.long
def test_sets_that_are_too_large_would_be_noticed(
    open_cart: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(levels_, "errors_by_state", lambda _: {})

    def everything(case: Case) -> None:
        for part in case.sets.groups:
            part.levels = [part.allowed, part.allowed]

    monkeypatch.setattr(complete_, "compute_levels", everything)
    assert soter.load(open_cart).simulate("Protected", "20s").violations > 0


@pytest.mark.long
def test_the_second_time_they_come_from_the_cache(
    open_cart: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))
    first = complete(flat(open_cart))
    monkeypatch.setattr(complete_, "_compute_sets", lambda *_: pytest.fail("computed again"))
    assert complete(flat(open_cart)) == first
    wider = open_cart.read_text(encoding="utf-8").replace("[-0.2, 0.2]", "[-0.3, 0.3]")
    open_cart.write_text(wider, encoding="utf-8")
    with pytest.raises(pytest.fail.Exception, match="again"):
        complete(flat(open_cart))


def test_without_a_problem_ac_never_gets_control(open_cart: Path) -> None:
    text = open_cart.read_text(encoding="utf-8").replace(" max_age 20ms", "")
    open_cart.write_text(text, encoding="utf-8")
    run = soter.load(open_cart).simulate("Protected", "2s")
    assert run.modules["SafeCart"].ac_share == 0.0
    assert "never gets control" in run.notes[0]
    assert "age" in run.notes[0]


def test_where_nothing_is_safe_ac_never_gets_control(open_cart: Path) -> None:
    text = open_cart.read_text(encoding="utf-8").replace("[-0.2, 0.2]", "[-9.0, 9.0]")
    open_cart.write_text(text, encoding="utf-8")
    system = flat(open_cart)
    assert "never gets control" in complete(system)[0]
    assert system.modules[0].symbol.ttf is None


def test_the_dm_refuses_estimates_that_are_too_old(open_cart: Path) -> None:
    system = flat(open_cart)
    complete(system)
    module: Module = system.modules[0]
    assert [system.topics[i].name for i in module.inputs] == ["motion"]


def test_verify_proves_what_was_computed(open_cart: Path) -> None:
    (module,) = soter.load(open_cart).verify(system="Protected", refute=False).modules
    verdicts = {n: f.verdict for n, f in module.findings.items()}
    assert verdicts.pop("P2b") in ("proved", "undecided")  # the grid is coarse
    assert verdicts.pop("failsafe") == "assumed"  # no law is declared
    assert set(verdicts.values()) == {"proved"}, verdicts


def test_a_build_carries_the_table(open_cart: Path, tmp_path: Path) -> None:
    package = soter.load(open_cart).build("c", tmp_path / "out", "Protected")
    source = (tmp_path / "out" / "open.c").read_text(encoding="utf-8")
    assert "SafeCart_level_TABLE" in source
    assert any("computed" in note for note in package.notes)
