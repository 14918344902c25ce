"""Cells that are too coarse for any K: smaller ones are chosen, by every command the same."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.claims import choose_cells_and_levels as chooser
from soter.verify.deploy import missing_predicates
from soter.verify.grid import claims as grid_claims
from soter.verify.grid import sets
from soter.verify.grid.grid_refinement import cell_count, finer_problem
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Collection

    from soter.verify.claims.results import ModuleResult
    from soter.verify.problem.problem import Group, Problem

CART = """soter 1;
topic m: { x: float, v: float } max_age 20ms;
topic u: float in [-3.0, 3.0] = 0.0;
plant Cart period 10ms {
  reads u;
  drives m = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance w: float in [-0.1, 0.1];
  der x = v;
  der v = u + w;
  measured m.x within 0.02, m.v within 0.02;
}
node Fast period 20ms { publishes u; step { publish u = 1.0; } }
node Home period 20ms {
  subscribes m;
  publishes u;
  step { publish u = clamp(-2.0 * m.x - 3.0 * m.v, -3.0, 3.0); }
}
rta SafeCart {
  ac Fast; sc Home; period 40ms;
  safe abs(m.x) < 2.0 && abs(m.v) < 2.0;
  verify { grid m.x in [-2.0, 2.0] / 5, m.v in [-2.0, 2.0] / 5; recover never; }
}
system Track { c: Cart; module SafeCart; until 20s; }
"""
WRITTEN = CART.replace("/ 5", "/ 10")
WALL = "cells of half the size: on the declared ones K is empty: c.x 5 -> 10, c.v 5 -> 10 "
ROBOT = """soter 1;
import "p.soter" as p;
system Vehicle deploys p.Track {
  external topic p.m every 10ms measured p.m.x within 0.02, p.m.v within 0.02;
  external topic p.u;
  module p.SafeCart;
}
"""


def verified(folder: Path, text: str) -> ModuleResult:
    """With a certificate beside the program."""
    (folder / "p.soter").write_text(text)
    report = soter.load(folder / "p.soter").verify(cert=folder / "cert", refute=False)
    return report.modules[0]


def table_of(folder: Path) -> bytes:
    """What the DM of a certificate holds."""
    (module,) = json.loads((folder / "cert" / "manifest.json").read_text())["modules"]
    (table,) = module["tables"]
    return Path(folder, "cert", table["levels"]).read_bytes()


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> tuple[ModuleResult, Path]:
    """The cart on cells that are too coarse, and a robot that deploys it."""
    folder = tmp_path_factory.mktemp("proof")
    (folder / "robot.soter").write_text(ROBOT)
    return verified(folder, CART), folder


def test_smaller_cells_are_chosen_said_and_as_good_as_if_they_were_declared(
    proved: tuple[ModuleResult, Path], tmp_path: Path
) -> None:
    result, folder = proved
    assert (result.verdict, result.cells) == ("proved", 100)
    assert f"{WALL}(25 -> 100 cells)" in result.notes
    (cost,) = (note for note in result.notes if note.startswith("smaller cells: "))
    assert "before nothing can fly; with it " in cost
    declared = verified(tmp_path, WRITTEN)
    assert (declared.verdict, declared.cells) == ("proved", 100)
    assert not any("cells" in note for note in declared.notes)
    assert table_of(folder) == table_of(tmp_path)
    assert soter.recheck(folder / "cert").accepted


@pytest.mark.parametrize("known", [True, False], ids=["from the cache", "computed"])
def test_what_is_proved_is_what_flies(
    known: bool, proved: tuple[ModuleResult, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, folder = proved
    if known:
        monkeypatch.setattr(missing_predicates, "_compute_sets", lambda *_: pytest.fail("again"))
    else:
        monkeypatch.setattr(missing_predicates, "_cached_sets", lambda *_: None)
    flat = system_of(check_file(str(folder / "p.soter")), None)
    (note,) = missing_predicates.complete(flat)
    assert "; on 100 cells, as less is shown on those that are declared" in note
    assert f"{tuple(table_of(folder))}" in repr(flat.modules[0].symbol.safer)


def test_a_run_is_that_of_the_cells_that_were_chosen(
    proved: tuple[ModuleResult, Path], tmp_path: Path
) -> None:
    (tmp_path / "p.soter").write_text(WRITTEN)
    flown, declared = (
        soter.load(folder / "p.soter").simulate() for folder in (proved[1], tmp_path)
    )
    assert flown.trace_sha256 == declared.trace_sha256
    assert flown.modules["SafeCart"].ac_share > 0.0


def test_a_build_has_the_cells_of_the_certificate_and_refuses_others(
    proved: tuple[ModuleResult, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, folder = proved
    robot = soter.load(folder / "robot.soter")
    assert "checked again" in robot.build("c", tmp_path / "a", cert=folder / "cert").inherits[0]

    def twice(problem: Problem, coarse: Collection[Group]) -> Problem:
        once = finer_problem(problem, coarse)
        return finer_problem(once, once.groups)

    monkeypatch.setattr(missing_predicates, "_store_sets", lambda *_: None)
    monkeypatch.setattr(chooser, "finer_problem", twice)
    (tmp_path / "robot.soter").write_text(ROBOT)
    assert verified(tmp_path, CART).cells == 400
    monkeypatch.undo()
    assert soter.recheck(tmp_path / "cert").accepted
    with pytest.raises(SoterError, match="is built with other tables than it has"):
        soter.load(tmp_path / "robot.soter").build("c", tmp_path / "b", cert=tmp_path / "cert")


def test_where_no_cells_help_it_is_said_which_were_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = verified(tmp_path, CART.replace("-2.0 * m.x - 3.0", "2.0 * m.x + 3.0"))
    tried = ["in vain: cells of half the size", "in vain: cells of a quarter of the size"]
    assert result.findings["P2a"].tried == tried
    assert (result.verdict, result.cells) == ("undecided", 25)
    monkeypatch.setitem(chooser.CELLS_MAX, "P2a", 99)
    result = verified(tmp_path, CART)
    assert result.findings["P2a"].tried == ["not: cells of half the size, as 100 are more than 99"]
    assert (result.verdict, result.cells) == ("undecided", 25)


def test_where_holds_are_used_up_on_the_declared_cells_no_smaller_ones_are_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a flow that is not linear; of a linear one, whose holds cost little, they are."""
    bent = CART.replace("der v = u + w", "der v = u + w - 0.01 * sin(x)")
    assert verified(tmp_path, bent).cells == 100
    monkeypatch.setattr(grid_claims, "HOLDS", 1)
    monkeypatch.setattr(sets, "HOLDS_LEAST", 1)
    result = verified(tmp_path, bent)
    assert (result.verdict, result.cells) == ("undecided", 25)
    assert result.findings["P2a"].tried == []
    assert verified(tmp_path, CART).cells == 100


def test_smaller_cells_are_chosen_where_they_show_p2b_and_what_flies_has_them(
    tmp_path: Path,
) -> None:
    text = CART.replace(" / 5", " / 10").replace(" recover never;", "")
    result = verified(tmp_path, text)
    assert (result.verdict, result.cells) == ("proved", 400)
    chosen = "cells of half the size: on the declared ones P2b is not shown: "
    assert any(note.startswith(chosen) for note in result.notes)
    (cost,) = (note for note in result.notes if note.startswith("smaller cells: "))
    assert "AC 0.0%" not in cost
    before, after = (int(n.replace(",", "")) for n in re.findall(r"([\d,]+) bytes of tables", cost))
    assert before < after
    flat = system_of(check_file(str(tmp_path / "p.soter")), None)
    (note,) = missing_predicates.complete(flat)
    assert "; on 400 cells" in note
    assert soter.recheck(tmp_path / "cert").accepted


@given(
    st.sampled_from(["P2a", "P2b"]), st.integers(0, 5), st.booleans(), st.booleans(), st.booleans()
)
def test_the_largest_cells_on_which_there_is_a_k_are_chosen(
    claim: str, needed: int, otherwise: bool, computed: bool, is_open: bool
) -> None:
    """`needed`: so often they are halved until a claim holds; `otherwise`: P2a fails of smaller."""
    flat = system_of(check_file("p.soter", CART), None)
    problem = replace(extract(flat, flat.modules[0]), computed=computed, cells_open=is_open)
    asked = []

    def attempt(tried: Any) -> Any:
        asked.append(cell_count(tried))
        fails = asked[-1] < 25 * 4**needed
        failed: dict[str, Any] = {claim: ()} if fails else {}
        failed |= {"P2a": None} if otherwise and asked[-1] > 25 else {}
        failures = [
            SimpleNamespace(
                claim=name, text="", cells=cells, proof=SimpleNamespace(group=tried.groups[0])
            )
            for name, cells in failed.items()
        ]
        case: Any = SimpleNamespace(failures=failures, proofs=[None])
        case.failures_of = lambda claim: [f for f in case.failures if f.claim == claim]
        return [case]

    choice = chooser.choose_cells_and_levels(replace(problem, levels_open=False), attempt)
    open_to_it = is_open and (claim == "P2a" or computed)
    smaller = 0 < needed <= 2 and not otherwise and open_to_it
    assert asked[0] == 25
    assert cell_count(choice.problem) == (25 * 4**needed if smaller else 25)
    assert bool(choice.size) == bool(choice.problem.declared_groups) == smaller
    assert not smaller or choice.failed == claim
    assert bool(choice.tried) == (needed > 0 and not smaller and open_to_it)
