"""K without the cells from which no way back was found, where predicates are computed.

A cart between two ends, of which the way back is looked for with one or two lengths of chain only:
then W lacks some cells of K. What is proved of the rest is proved by the re-checker as well.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.api import recheck
from soter.certificate.report import REJECTED
from soter.cli.main import main
from soter.language.front_end import check_file, system_of
from soter.verify.claims import choose_cells_and_levels
from soter.verify.claims.results import PROVED, UNDECIDED
from soter.verify.deploy import missing_predicates
from soter.verify.deploy.level_tables import Estimates
from soter.verify.grid import recovery
from soter.verify.problem.extract import extract
from soter.verify.verify_module import verify_module
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult
    from soter.verify.problem.problem import Problem

TEXT = """soter 1;
topic b: { x: float, v: float } max_age 20ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period 10ms {
  reads u;
  drives b = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance w: float in [-0.05, 0.05];
  der x = v;
  der v = u + w;
  measured b.x within 0.01, b.v within 0.01;
}
node Push period 50ms { publishes u; step { publish u = 1.0; } }
node Middle period 50ms {
  subscribes b;
  publishes u;
  step { publish u = clamp(-GAINS, -1.0, 1.0); }
}
rta Slot {
  ac Push;
  sc Middle;
  period 100ms;
  safe abs(b.x) < 2.0;
  verify { grid b.x in [-2.0, 2.0] / 40, b.v in [-2.5, 2.5] / 40; }
}
system S default { p: P; module Slot; until 30s; }
"""
DECLARED = TEXT.replace("GAINS", "b.x - 1.4 * b.v")
"""Of it Q is a set of declared cells; with one length of 16 holds one of half cells."""
GIVEN_UP = "cells that SC keeps are no part of K"


def _problem(source: str) -> Problem:
    checked = check_file("slot.soter", source)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return extract(flat, flat.modules[0])


def _verified(source: str) -> ModuleResult:
    return verify_module(_problem(source), refute=False, explain=False)


def _only(patch: pytest.MonkeyPatch, *lengths: int) -> None:
    """The way back is looked for with chains of these lengths."""
    for name in ("LENGTHS", "FINER"):
        patch.setattr(recovery, name, (lengths,))
    patch.setattr(recovery, "STRAGGLERS_MAX", 0)


def _core(result: ModuleResult) -> Any:
    return result.cases[0].groups[0].core > 0


@pytest.mark.parametrize(("lengths", "finer"), [((8,), False), ((6, 12), False), ((16,), True)])
def test_what_is_not_led_back_is_no_part_of_k_and_the_rest_is_accepted(
    lengths: tuple[int, ...], finer: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = _core(_verified(DECLARED))
    _only(monkeypatch, *lengths)
    result = _verified(DECLARED)
    less = _core(result)
    assert result.findings["P2b"].verdict == PROVED
    assert (less <= whole).all()
    lost = int((whole & ~less).sum())
    assert 0 < lost <= choose_cells_and_levels.SHRINK_MAX * whole.sum()
    assert sum(f"{lost} of" in n and GIVEN_UP in n for n in result.notes) == 1
    assert (result.cases[0].groups[0].finer is not None) == finer
    (tmp_path / "slot.soter").write_text(DECLARED)
    given = ["verify", str(tmp_path / "slot.soter"), "--no-refute", "--cert", str(tmp_path / "c")]
    assert main(given) == 0
    report = recheck(tmp_path / "c")
    assert report.verdict == "accepted"
    assert "P2b" in report.modules[0].claims


def test_a_cell_that_was_given_up_is_no_part_of_an_accepted_k(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = DECLARED.replace("0.05]", "0.04]")
    whole = _verified(source)
    _only(monkeypatch, 8)
    less = _core(_verified(source))
    (tmp_path / "slot.soter").write_text(source)
    given = ["verify", str(tmp_path / "slot.soter"), "--no-refute", "--cert", str(tmp_path / "c")]
    assert main(given) == 0
    witness = whole.cases[0].groups[0].core
    lost = np.argwhere(_core(whole) & ~less)
    assert len(lost)
    for k in (0, len(lost) // 2, len(lost) - 1):
        forged = tmp_path / str(k)
        shutil.copytree(tmp_path / "c", forged)
        core = np.frombuffer((forged / "sets" / "0_0_0_K.bin").read_bytes(), "u1").reshape(40, 40)
        more = core.copy()
        more[tuple(lost[k])] = witness[tuple(lost[k])]
        (forged / "sets" / "0_0_0_K.bin").write_bytes(more.tobytes())
        small_proofs.reseal(forged, json.loads((forged / "manifest.json").read_text()))
        assert recheck(forged).verdict == REJECTED


@pytest.mark.parametrize("length", [4, 8])
def test_where_too_much_would_be_lost_all_is_as_it_was(
    length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of length 4 more than a tenth of K; of length 8, as is made up here, the start."""
    _only(monkeypatch, length)
    with monkeypatch.context() as patch:
        patch.setattr(
            choose_cells_and_levels, "_is_start_shown", lambda case: "given_up" not in case.counts
        )
        asked = _verified(DECLARED)
    monkeypatch.setattr(choose_cells_and_levels, "ROUNDS", 0)
    never = _verified(DECLARED)
    assert asked.findings["P2b"].verdict == UNDECIDED
    assert not any(GIVEN_UP in n for n in asked.notes)
    for one, other in zip(asked.cases[0].groups, never.cases[0].groups, strict=True):
        assert np.array_equal(one.core, other.core)
        assert all(map(np.array_equal, one.levels, other.levels))
    assert [f.text for f in asked.findings.values()] == [f.text for f in never.findings.values()]


def test_a_flight_has_the_tables_of_the_smaller_k(monkeypatch: pytest.MonkeyPatch) -> None:
    """With `levels` of its own as without."""
    for levels_open in (True, False):
        problem = replace(_problem(DECLARED), levels_open=levels_open, levels=2)
        whole = verify_module(problem, refute=False, explain=False).cases[0].groups[0].levels[0]
        with monkeypatch.context() as patch:
            _only(patch, 16)
            patch.setattr(missing_predicates, "_cached_sets", lambda *_: None)
            patch.setattr(missing_predicates, "_store_sets", lambda *_: None)
            proved = verify_module(problem, refute=False, explain=False)
            flown, pairs = missing_predicates.find_sets(problem)
        assert pairs is not None
        assert flown.levels == proved.problem.levels
        flown_pair = pairs[0][0]
        assert isinstance(flown_pair, Estimates)
        assert np.array_equal(flown_pair.outer, proved.cases[0].groups[0].levels[0])
        assert flown_pair.outer.sum() < whole.sum()
