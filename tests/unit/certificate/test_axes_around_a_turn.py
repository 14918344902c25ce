"""The re-checker wraps an axis where a certificate says so, and it finds nobody counting turns.

Its cells around a turn against exact numbers; programs in which somebody counts turns; and proofs
that are accepted as they are, and not once they say something else.
"""

from __future__ import annotations

import json
import math
import shutil
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from generators.turning_systems import Drawn
from soter.api import recheck
from soter.certificate.cell_sets import Cells, Grid
from soter.certificate.extras.left_out_states import (
    SEAM,
    interval_turned_back,
    read_turning,
    refuse_turns_read,
)
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.report import NotRecheckedError, RejectedError
from unit.certificate import small_proofs
from unit.certificate.grid_tables import grid_beyond

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts

EXACT_TURN = 2 * Fraction(314159265358979323846264338327950288419716939937510, 10**50)
KEEPS = next(d for d in map(Drawn, range(40)) if not d.moves and not d.by_sine)
MOVES = next(d for d in map(Drawn, range(20)) if d.moves and not d.from_zero and not d.by_sine)


@pytest.mark.parametrize("low", [-math.pi, 0.0, -1.25])
def test_cells_around_a_turn_cover_what_they_are_asked_for(low: float) -> None:
    chance = np.random.default_rng(3)
    edges = (*(low + 2 * math.pi * k / 12 for k in range(12)), low + 2 * math.pi)
    grid = grid_beyond((edges,), wraps=(True,))
    ends = [Fraction(e) for e in (edges[0] - SEAM, *edges[1:-1], edges[-1] + SEAM)]
    near = [
        e + 2 * math.pi * k + d for e in edges for k in (-2, 0, 1) for d in (-SEAM, 0.0, SEAM / 2)
    ]
    for start in [*near, *chance.uniform(-9.0, 9.0, size=300).tolist()]:
        for width in (0.0, 0.1, float(chance.uniform(0.0, 7.0))):
            block = grid.cells_around((start, start + width))
            assert block is not None
            ((first, last),) = block
            assert 0 <= first < 12
            assert first < last <= first + 12
            for x in (start, start + width, *chance.uniform(start, start + width, size=6)):
                places = [Fraction(float(x)) - k * EXACT_TURN for k in range(-4, 5)]
                cells = [k % 12 for k in range(first, last)]
                assert any(ends[c] <= p <= ends[c + 1] for p in places for c in cells)


def test_a_set_holds_a_box_that_goes_on_at_the_other_end() -> None:
    edges = (*(-math.pi + 2 * math.pi * k / 12 for k in range(12)), math.pi)
    grid = grid_beyond((edges, (0.0, 1.0, 2.0)), wraps=(True, False))
    members = np.zeros((12, 2), dtype=np.bool_)
    members[[0, 11], 0] = True
    cells = Cells(grid, members)
    assert cells.contains((3.0, 3.3, 0.0, 1.0))
    assert cells.contains((-3.3, -3.0, 0.0, 1.0))
    assert not cells.contains((3.0, 3.3, 0.5, 1.5))
    assert not cells.contains((2.0, 3.3, 0.0, 1.0))
    assert not cells.contains((3.0, 3.8, 0.0, 1.0))
    assert not cells.contains((3.0, 9.5, 0.0, 1.0))
    assert not Cells(Grid(grid.edges), members).contains((3.0, 3.3, 0.0, 1.0))


def facts_of(folder: Path, text: str) -> Facts:
    path = folder / "boat.soter"
    path.write_text(text, encoding="utf-8")
    facts = small_proofs.facts_of(path, "S", "Fence")
    facts.extents = tuple(facts.axes[i] for i in range(len(facts.states)))
    return facts


def shown(facts: Facts) -> None:
    facts.turning = {len(facts.states) - 1}
    refuse_turns_read(CaseModel(facts, (), facts.extents))


@pytest.mark.parametrize("seed", range(8))
def test_that_nobody_counts_turns_is_shown_of_what_was_drawn(tmp_path: Path, seed: int) -> None:
    shown(facts_of(tmp_path, Drawn(seed).text(32)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("publish turn = clamp({g}", "publish turn = clamp(0.01 * pose.h + {g}"),
        (
            "publish turn = clamp({g}",
            "let u = pose.h > 9.0 ? 0.1 : 0.0; publish turn = clamp(u + {g}",
        ),
        ("wrap_angle({a}", "wrap_angle(1.5 * pose.h + {a}"),
        ("wrap_angle({a}", "wrap_angle(1000000.0 * pose.x + {a}"),
        ("der x = ", "der x = 0.001 * h + "),
        ("der x = ", "der x = abs(h) > 50.0 ? 0.1 : 0.0 + "),
        ("safe abs", "safe pose.h < 99.0 && abs"),
        ("h: float }", "h: float } in { h in [-9.0, 9.0] }"),
        ("levels 2;", "levels 2;"),
    ],
)
def test_where_somebody_counts_turns_it_is_refused(tmp_path: Path, old: str, new: str) -> None:
    n = MOVES.numbers
    numbers = {"{g}": repr(n["gain"]), "{a}": repr(n["away"])}
    for name, value in numbers.items():
        old, new = old.replace(name, value), new.replace(name, value)
    text = MOVES.text(32)
    assert text.count(old) == 1
    facts = facts_of(tmp_path, text.replace(old, new))
    if old == new:
        shown(facts)
        return
    with pytest.raises((RejectedError, NotRecheckedError)):
        shown(facts)


@pytest.mark.parametrize(
    ("names", "ends"),
    [
        (["b.h"], (-math.pi, 3.0)),
        (["b.h"], (-3.1415, 3.1415)),
        (["b.h"], (-2 * math.pi, 2 * math.pi)),
        (["b.h"], (40 * math.pi, 42 * math.pi)),
        (["b.x"], (-math.pi, math.pi)),
        (["b.q"], (-math.pi, math.pi)),
        (["b.h", "b.h"], (-math.pi, math.pi)),
        ([], (-math.pi, math.pi)),
        ("b.h", (-math.pi, math.pi)),
    ],
)
def test_what_is_no_full_turn_is_refused(
    tmp_path: Path, names: Any, ends: tuple[float, float]
) -> None:
    facts = facts_of(tmp_path, MOVES.text(32))
    facts.extents = (facts.extents[0], ends)
    with pytest.raises(RejectedError):
        read_turning(facts, names)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("safe ", "shield 4; safe "),
        ("levels 2;", "levels 2; enters abs(pose.x) < 0.5;"),
    ],
)
def test_an_axis_wraps_around_beside_nothing_that_counts_turns_elsewhere(
    tmp_path: Path, old: str, new: str
) -> None:
    read_turning(facts_of(tmp_path, MOVES.text(32)), ["b.h"])
    facts = facts_of(tmp_path, MOVES.text(32).replace(old, new))
    with pytest.raises(RejectedError, match="where that is not settled"):
        read_turning(facts, ["b.h"])


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A heading that is kept across the seam, and its certificate; not to be changed."""
    folder = tmp_path_factory.mktemp("turning")
    (folder / "boat.soter").write_text(KEEPS.text(48))
    result = soter.load(folder / "boat.soter").verify(cert=folder / "cert", refute=False)
    assert result.modules[0].findings["P2a"].verdict == "proved"
    return folder / "cert"


def test_a_proof_across_the_seam_is_accepted_and_says_what_it_takes_for_granted(
    proof: Path,
) -> None:
    report = recheck(proof)
    assert report.accepted, report
    (module,) = report.modules
    assert {"P2a", "P3", "start"} <= {*module.confirmed}
    assert any("its axis wraps around" in a.text for a in module.assumptions)


def test_the_same_sets_are_refused_where_the_certificate_does_not_wrap(
    proof: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "cert"
    shutil.copytree(proof, folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["modules"][0]["wraps"]
    small_proofs.seal(folder, manifest)
    assert not recheck(folder).accepted


@pytest.mark.parametrize("low", [-math.pi, 0.0, -1.25])
def test_what_is_brought_back_by_whole_turns_holds_what_there_was(low: float) -> None:
    chance = np.random.default_rng(7)
    edges = (low, low + 1.0, low + 2 * math.pi)
    for _ in range(300):
        start = float(chance.uniform(-(2**13), 2**13) * chance.choice([1e-3, 1.0]))
        width = float(chance.choice([0.0, 0.3, 2.9, 7.0]))
        first, last = interval_turned_back(edges, start, start + width)
        assert edges[0] - 1e-9 <= first <= edges[-1]
        assert last <= edges[-1] + math.pi
        for x in (start, start + width):
            turns = Fraction(x) // EXACT_TURN
            places = [Fraction(x) - (turns + k) * EXACT_TURN for k in range(-3, 4)]
            assert any(Fraction(first) <= p <= Fraction(last) for p in places)
    assert interval_turned_back(edges, 2.0**15, 2.0**15) == (2.0**15, 2.0**15), (
        "nothing is known there"
    )


@pytest.mark.parametrize("start", ["{h} + 6.0 * PI", "in [{h} - 0.1 - 80.0 * PI, {h} - 80.0 * PI]"])
def test_a_start_some_turns_away_is_proved_and_accepted(tmp_path: Path, start: str) -> None:
    declared = f"state h: float = {KEEPS.numbers['away']!r};"
    text = KEEPS.text(48)
    assert declared in text
    written = start.replace("{h}", repr(KEEPS.numbers["away"]))
    line = f"state h: float {written};" if "in" in start else f"state h: float = {written};"
    (tmp_path / "boat.soter").write_text(text.replace(declared, line))
    result = soter.load(tmp_path / "boat.soter").verify(cert=tmp_path / "cert", refute=False)
    assert result.modules[0].findings["start"].verdict == "proved"
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason
    assert "start" in report.modules[0].confirmed


def test_a_start_on_the_wrong_side_some_turns_away_is_not_proved(tmp_path: Path) -> None:
    """Opposite to where SC turns to: `safe` is false there."""
    declared = f"state h: float = {KEEPS.numbers['away']!r};"
    text = KEEPS.text(48).replace(
        declared, f"state h: float = {KEEPS.numbers['away']!r} + 7.0 * PI;"
    )
    (tmp_path / "boat.soter").write_text(text)
    result = soter.load(tmp_path / "boat.soter").verify(refute=False)
    assert result.modules[0].findings["start"].verdict != "proved"
