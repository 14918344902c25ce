"""An SC that only stops, and comes to rest anywhere: what is proved of it, and what is not.

The brake has a closed solution: from (gap, v), v > 0, it stops after v^2 / (2 b) with b the
weakest brake that there is, and at v <= 0 it stands, or goes away. Everything in K and in S_0 is
held to that.
"""

from __future__ import annotations

import json
import shutil
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.api import recheck
from soter.certificate.cell_sets import Axes, Cells, Grid
from soter.certificate.extras.resting import resting_cells_unshown
from soter.certificate.grid.flow_enclosures import LocalFlow
from soter.certificate.grid.group_claims import RESTS as MARK
from soter.certificate.grid.sc_chains import uncrossed_ends
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import exact
from soter.language.front_end import check_file, system_of
from soter.verify.claims import claims
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.grid.claims import GridProof
from soter.verify.grid.resting import cells_at_rest
from soter.verify.grid.sets import RESTS
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import EVERY_SOLUTION
from unit.certificate.small_proofs import facts_of, reseal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy.typing as npt

    from soter.certificate.cell_sets import Block
    from soter.verify.claims.results import GroupSets
    from soter.verify.grid.case import Case

    Bools = npt.NDArray[np.bool_]

BRAKE, GRIP, THROTTLE = 6.0, 0.5, 2.0
HORIZON = 0.1
ERRORS = (0.3, 0.1)
TEXT = """
soter 1;
const BRAKE: float = 6.0;
const A: float = 2.0;
topic seen: { gap: float, v: float } max_age 60ms;
topic accel: float in [-BRAKE, A] = 0.0;
plant Car period 10ms {
  reads accel;
  drives seen = { gap: gap, v: v };
  state gap: float = 80.0;
  state v: float = 10.0;
  disturbance grip: float in [-0.5, 0.5];
  der gap = -v;
  der v = v > 0.0 || accel > 0.0 ? accel + grip : 0.0;
  measured seen.gap within 0.3, seen.v within 0.1;
}
node Drive period 20ms {
  subscribes seen;
  publishes accel;
  step { publish accel = clamp(16.0 - seen.v, -BRAKE, A); }
}
node Brake period 20ms { subscribes seen; publishes accel; step { publish accel = -BRAKE; } }
rta Aeb {
  ac Drive;
  sc Brake;
  period 40ms;
  safe seen.gap > 0.0;
  verify {
    grid seen.gap in [0.0, 100.0] / 100, seen.v in [-1.0, 18.0] / 76;
    recover never;
  }
}
system S default { c: Car; module Aeb; until 30s; always c.truth.gap > 0.0; }
"""
STANDS, BY = "der v = v > 0.0 || accel > 0.0 ? accel + grip : 0.0;", "der gap = -v;"
SC = "step { publish accel = -BRAKE; }"
BESIDE = (
    "der gap = v > 0.0 || v < 0.0 ? -v - 0.5 : 0.0;\n"
    "  der v = v > 0.0 || accel > 0.0 ? accel + grip : v < 0.0 ? 5.0 : 0.0;"
)
"""It goes to and fro at rest, and comes nearer by 0.5 m/s for ever; at v = 0 itself it does not."""


WRONG = pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param("grip: float in [-0.5, 0.5]", "grip: float in [-0.5, 6.0]", id="no brake"),
        pytest.param(BY, "der gap = -v - 0.001;", id="creeps"),
        pytest.param(BY, "der gap = -v - 0.001 * grip;", id="may creep"),
        pytest.param(BY, "der gap = -v - 0.001 * clamp(v, 0.0, 0.1) - 1e-9;", id="hardly creeps"),
        pytest.param(STANDS, STANDS.replace(": 0.0;", ": -0.01;"), id="rolls backwards"),
        pytest.param(STANDS, STANDS.replace(": 0.0;", ": grip;"), id="pushed at rest"),
        pytest.param(STANDS, STANDS.replace("v > 0.0 |", "v > 0.01 |"), id="slow, never at rest"),
        pytest.param(STANDS, "der v = v > 0.0 ? -6.0 * v + grip : 0.0;", id="coasts"),
        pytest.param("safe seen.gap > 0.0", "safe abs(seen.gap - 50.0) < 49.0", id="on both sides"),
        pytest.param("gap > 0.0;", "gap > 0.0 && seen.gap < 100.5;", id="beyond"),
        pytest.param("gap > 0.0;", "gap > 0.0 && seen.gap < 1e200;", id="far beyond"),
        pytest.param("} max_age", "} in { gap in [-1.0, 101.0] } max_age", id="unpublished"),
        pytest.param(
            f"{BY}\n  {STANDS}",
            f"der gap = -v - 0.001;\n  {STANDS}".replace(": 0.0;", ": 0.5;"),
            id="creeps, pushed back",
        ),
        pytest.param(f"{BY}\n  {STANDS}", BESIDE, id="creeps beside rest, not at it"),
        pytest.param(SC, "step { publish accel = seen.gap > 250.0 ? A : -BRAKE; }", id="far out"),
        pytest.param(SC, "step { publish accel = seen.gap > 50.0 ? -BRAKE : -5.9; }", id="by it"),
        pytest.param(STANDS, STANDS.replace("+ grip", "+ grip + 0.001 * gap"), id="rate by it"),
        pytest.param("safe seen.gap > 0.0;", "safe seen.gap > 0.0; shield 8;", id="shield"),
    ],
)


def text(*changes: tuple[str, str]) -> str:
    source = TEXT
    for old, new in changes:
        assert old in source, old
        source = source.replace(old, new)
    return source


def kept(source: str) -> GroupSets:
    """K of the only case."""
    case = opened(source)
    assert claims.compute_core(case)
    (group,) = case.sets.groups
    return group


def opened(source: str) -> Case:
    """With its C."""
    checked = check_file("brake.soter", source)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    problem = extract(flat, flat.modules[0])
    case = claims.open_case(problem, library_of(problem)[0], problem.groups, ())
    assert claims.compute_constraint(case)
    return case


def at_rest(source: str) -> Bools:
    """Cells that the prover finds without a chain."""
    case = opened(source)
    (proof,) = case.proofs
    assert isinstance(proof, GridProof)
    return cells_at_rest(case, proof.engine, proof.found.allowed)


def unshown(source: str, marked: Bools, c: Bools, folder: Path) -> Iterator[Block]:
    """The marked cells that the re-checker does not show; `c`: cells of C."""
    (folder / "brake.soter").write_text(source)
    facts = facts_of(folder / "brake.soter", "S", "Aeb")
    edges = tuple(
        tuple(np.linspace(*facts.axes[k], n + 1).tolist()) for k, n in enumerate(marked.shape)
    )
    group = Axes((0, 1), Grid(edges))
    model = CaseModel(facts, (), tuple(facts.axes[k] for k in (0, 1)))
    return resting_cells_unshown(model, group, marked, Cells(group.grid, c))(group.grid.all_cells)


def shown(source: str, marked: Bools, folder: Path) -> bool:
    """Whether the re-checker shows marks, all of whose cells and those around it takes for C."""
    c = np.ones(marked.shape, dtype=np.bool_)
    c[0] = False
    try:
        return next(unshown(source, marked & c, c, folder), None) is None
    except NotRecheckedError:
        return False


def left(gap: Any, v: Any, b: float = BRAKE - GRIP) -> Any:
    """What of the gap is left at rest."""
    return gap - np.maximum(v, 0.0) ** 2 / (2 * b)


def test_prover_and_rechecker_mark_such_cells_alike() -> None:
    assert RESTS == MARK


def test_what_is_kept_is_what_stops_in_time() -> None:
    group = kept(text())
    gaps, speeds = (np.array(e) for e in group.edges)
    core = group.core > 0
    assert (group.core == RESTS).any()
    assert ((group.core > 0) & (group.core < RESTS)).any()
    worst = left(gaps[:-1, None], speeds[None, 1:])
    assert (worst[core] > 0.0).all()
    assert np.mean(core[worst > 4.0]) == 1.0, "and little is lost to cells"


@WRONG
def test_no_cell_rests_where_it_is_not_so_or_not_settled(old: str, new: str) -> None:
    assert not at_rest(text((old, new))).any()


def test_where_control_is_to_come_back_no_cell_is_taken_without_a_chain() -> None:
    assert not claims.compute_core(opened(text(("recover never;", "")))), (
        "chains alone keep no cell"
    )


@pytest.fixture(scope="module")
def honest() -> Bools:
    return at_rest(TEXT)


@WRONG
def test_the_rechecker_does_not_show_honest_marks_of_a_wrong_module(
    old: str, new: str, honest: Bools, tmp_path: Path
) -> None:
    """By a search of its own; of C it is told more than there is."""
    assert not shown(text((old, new)), honest, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (SC, "step { publish accel = seen.v > 0.0 ? -BRAKE : -6.1; }", "answer within its sets"),
        (STANDS, STANDS.replace("+ grip", "+ grip * sqrt(accel + 5.0)"), "not defined everywhere"),
    ],
)
def test_where_sc_or_the_plant_is_not_sure_to_go_on_no_cell_rests(
    old: str, new: str, why: str, honest: Bools, tmp_path: Path
) -> None:
    with pytest.raises(NotRecheckedError, match=why):
        unshown(text((old, new)), honest, honest, tmp_path)


def test_at_rest_are_only_cells_on_which_safe_is_certain(honest: Bools, tmp_path: Path) -> None:
    unshown(TEXT, honest, honest, tmp_path)
    with pytest.raises(RejectedError, match="on which `safe` is not certain"):
        unshown(TEXT, honest, ~honest, tmp_path)


def test_the_rechecker_sees_what_a_way_does_beside_rest(honest: Bools, tmp_path: Path) -> None:
    """Of marks so far from the wall, and so slow, that nothing else is wrong with them."""
    far = honest.copy()
    far[:60], far[:, 12:] = False, False
    assert shown(TEXT, far, tmp_path)
    assert not shown(text((f"{BY}\n  {STANDS}", BESIDE)), far, tmp_path)


def test_the_rechecker_shows_what_was_found_and_nothing_that_does_not_stop(
    honest: Bools, tmp_path: Path
) -> None:
    assert honest.any()
    assert shown(TEXT, honest, tmp_path)
    gaps, speeds = np.linspace(0.0, 100.0, 101), np.linspace(-1.0, 18.0, 77)
    for k in np.flatnonzero(speeds[1:] > 2.0):
        too_near = int(np.flatnonzero(left(gaps[:-1], speeds[k + 1]) < gaps[1])[-1])
        assert not honest[too_near, k]
        one = honest.copy()
        one[too_near, k] = too_near > 0
        assert too_near == 0 or not shown(TEXT, one, tmp_path)


def test_a_way_that_goes_on_both_ways_is_bounded_on_both_sides() -> None:
    """Speeds of both signs are braked, so the gap rises by a bounded way, too."""
    both = STANDS.replace(
        "v > 0.0 || accel > 0.0 ? accel + grip : 0.0",
        "v > 0.0 ? accel + grip : v < 0.0 ? -accel - grip : 0.0",
    )
    changes = (
        (STANDS, both),
        ("safe seen.gap > 0.0", "safe seen.gap > 0.0 && seen.gap < 99.5"),
        ("seen.v in [-1.0, 18.0] / 76", "seen.v in [-18.0, 18.0] / 72"),
    )
    core = at_rest(text(*changes))
    gaps, speeds = np.linspace(0.0, 100.0, 101), np.linspace(-18.0, 18.0, 73)
    assert core.any()
    for v in (speeds[:-1], speeds[1:]):
        down, up = left(gaps[:-1, None], v[None, :]), left(-gaps[1:, None], -v[None, :])
        assert (down[core] > 0.0).all()
        assert (up[core] > -99.5).all()


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    folder = tmp_path_factory.mktemp("brake")
    (folder / "brake.soter").write_text(text())
    report = soter.load(folder / "brake.soter").verify(cert=folder / "cert", refute=False)
    return report.modules[0], folder / "cert"


def test_the_brake_is_proved_and_accepted(proved: tuple[Any, Path]) -> None:
    module, folder = proved
    assert module.verdict == "proved"
    assert "at rest" in module.findings["P2a"].text
    report = recheck(folder)
    assert report.accepted, report.reason


def test_nobody_says_that_the_brake_has_one_solution(proved: tuple[Any, Path]) -> None:
    """At rest its rate jumps: prover and re-checker assume the same of it, in the same words."""
    module, folder = proved
    said = [
        [a.text for a in verdict.assumptions if a.key == "scheme"]
        for verdict in (module, recheck(folder).modules[0])
    ]
    assert said[0] == said[1] == [EVERY_SOLUTION.text]
    assert "scheme" in module.assumed
    assert "jumps" in said[0][0]
    assert "Lipschitz" not in said[0][0]


@pytest.mark.parametrize("at_rest", [False, True])
def test_where_a_rate_jumps_the_rechecker_follows_every_solution(
    at_rest: bool, tmp_path: Path
) -> None:
    """From v = 0 on both v = 0 and v = -t solve it; the grid ends there, too."""
    source = text(
        (STANDS, "der v = v < 0.0 ? -1.0 : 0.0;"),
        ("seen.v in [-1.0, 18.0] / 76", "seen.v in [0.0, 18.0] / 72"),
    )
    (tmp_path / "brake.soter").write_text(source)
    facts = facts_of(tmp_path / "brake.soter", "S", "Aeb")
    facts.at_rest = at_rest
    model = CaseModel(facts, (), tuple(facts.axes[k] for k in (0, 1)))
    box = [(exact(low), exact(high)) for low, high in ((50.0, 51.0), (0.0, 1.0))]
    flow = LocalFlow(model, (0, 1))
    (_, (slowest, _)) = flow.enclose(box, flow.ranges, Fraction(0), Fraction(1, 10)).box
    assert slowest < -0.09
    assert not uncrossed_ends(model, (0, 1))[1][0]


def test_from_where_ac_has_control_the_brake_stops_in_time(proved: tuple[Any, Path]) -> None:
    """Whatever AC does for H: full throttle, with all errors against it."""
    module, _ = proved
    (group,) = module.cases[0].groups
    gaps, speeds = (np.array(e) for e in group.edges)
    outer = group.levels[0]
    gap, v = gaps[:-1, None] - ERRORS[0], speeds[None, 1:] + ERRORS[1]
    faster = np.maximum(v, 0.0) + (THROTTLE + GRIP) * HORIZON
    gap = gap - (np.maximum(v, 0.0) + faster) / 2 * HORIZON
    assert outer.any()
    assert (left(gap, faster)[outer] > 0.0).all()


def test_on_a_free_road_ac_has_control_where_the_axis_has_no_ends(tmp_path: Path) -> None:
    """With ends the table knows nothing of so far a gap, and SC brakes."""
    shares = {}
    for ends in ("", " open"):
        source = text(("gap: float = 80.0", "gap: float = 5000.0"), ("/ 100,", f"/ 100{ends},"))
        (tmp_path / "brake.soter").write_text(source)
        program = soter.load(tmp_path / "brake.soter")
        result = program.simulate(seed=1, until="10s")
        shares[ends] = result.modules["Aeb"].ac_share
        if ends:
            report = program.verify(cert=tmp_path / "cert", refute=False)
            assert report.modules[0].verdict == "proved"
            outer = report.modules[0].cases[0].groups[0].levels[0]
            assert outer[-1].any()
            assert not outer[:2].any()
            assert recheck(tmp_path / "cert").accepted
    assert shares[""] == 0.0
    assert shares[" open"] > 0.9


@pytest.mark.parametrize("how", ["more rests", "all rests", "moved down"])
def test_marks_that_are_not_so_are_rejected(
    how: str, proved: tuple[Any, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "cert"
    shutil.copytree(proved[1], folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    (path,) = folder.rglob("*_K.bin")
    table = np.frombuffer(path.read_bytes(), dtype=np.uint8).reshape(100, 76).copy()
    rest = table == RESTS
    if how == "more rests":
        low = int(np.flatnonzero((table > 0).any(axis=1))[0])
        table[low, int(np.flatnonzero(table[low] > 0)[-1]) + 1] = RESTS
    elif how == "all rests":
        table[table > 0] = RESTS
    else:
        table[1:-1][rest[2:]] = RESTS
    assert (table == RESTS).sum() > rest.sum()
    path.write_bytes(table.tobytes())
    reseal(folder, manifest)
    report = recheck(folder)
    assert not report.accepted
    assert "stand still" in report.reason or "at rest" in report.reason
