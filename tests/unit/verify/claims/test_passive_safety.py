"""A rover that stands whoever walks into it: proved, and no wrong one; also not by its tables."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from generators.passive_program import FALLING, PASSIVE, WRONG_ROVERS
from soter.api import recheck
from soter.certificate.reading.module_times import TIME_KEYS
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.problem.extract import extract
from soter.verify.verify_module import verify_module
from unit.certificate.small_proofs import edit_program, facts_of, reseal

if TYPE_CHECKING:
    from generators.passive_program import WrongRover
    from soter.verify.claims.results import ModuleResult

QUICK = (
    "people run, and ttf counts with people who walk",
    "SC creeps on",
    "ttf without the time until SC acts",
    "safe without at rest",
    "an SC that speeds up where nobody is near",
)
EVERY = [
    pytest.param(w, id=w.name, marks=() if w.name in QUICK else pytest.mark.long)
    for w in WRONG_ROVERS
]
SAME = [p for p, w in zip(EVERY, WRONG_ROVERS, strict=True) if w.same_shape]
REASONS = (
    "`safe` is not certain",
    "does not certainly lead back to K",
    "leads out of K within H",
    "leave AC in control outside R(H)",
    "is read by SC or a plant",
    "lies in its declared set",
    "an initial state may leave K",
)
"""What a certificate is to be rejected for: an inclusion that does not hold, not a figure."""


def verified(text: str) -> ModuleResult:
    checked = check_file("rover.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return verify_module(extract(flat, flat.modules[0]), refute=False)


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("passive")
    path = folder / "rover.soter"
    path.write_text(PASSIVE)
    report = soter.load(path).verify(cert=folder / "cert", refute=False)
    assert report.verdict == "proved"
    return folder / "cert"


def test_the_re_checker_confirms_what_was_proved(proved: Path) -> None:
    report = recheck(proved)
    assert report.accepted, report.reason
    assert report.safe
    assert {"P2a", "P3", "start"} <= set(report.modules[0].confirmed)


@pytest.mark.parametrize("wrong", EVERY)
def test_a_wrong_rover_is_not_proved(wrong: WrongRover) -> None:
    if wrong.reads_the_place:
        with pytest.raises(SoterError, match=r"reads `one\.gap`, whose axis is `open`"):
            verified(wrong.text)
        return
    result = verified(wrong.text)
    assert not result.findings["P3"].holds or not result.findings["start"].holds
    assert result.findings["P2b"].verdict == "assumed", "nobody asks for it"


@pytest.mark.parametrize("wrong", SAME)
def test_the_tables_of_the_right_one_do_not_prove_a_wrong_one(
    proved: Path, tmp_path: Path, wrong: WrongRover
) -> None:
    folder = Path(shutil.copytree(proved, tmp_path / "cert"))
    manifest = edit_program(folder, *wrong.edits)
    facts = facts_of(folder / "program" / manifest["main"], "Proved", "Passive")
    entry = manifest["modules"][0]
    entry["times"] = {k: facts.times[k] for k in TIME_KEYS}
    known = [*facts.controls, *facts.disturbances, *facts.errors, *facts.others]
    for given, x in zip(entry["inputs"][len(facts.states) :], known, strict=True):
        given["low"], given["high"] = x.low.hex(), x.high.hex()
    reseal(folder, manifest)
    report = recheck(folder)
    assert not report.accepted
    assert any(why in report.reason for why in REASONS), report.reason


def test_without_the_word_nothing_is_kept() -> None:
    """With ends, beyond which all is unsafe, no set of places is kept by an SC that stands."""
    result = verified(PASSIVE.replace("/ 100 open", "/ 100"))
    assert result.findings["P2a"].verdict == "undecided"
    assert result.findings["P2b"].verdict == "assumed"


def forged(text: str, folder: Path, speeds: tuple[int, int], holds: int) -> Path:
    """A certificate that claims more: of the upper outer cell at some speeds, after some holds."""
    path = folder / "falling.soter"
    path.write_text(text)
    soter.load(path).verify(cert=folder / "cert", refute=False)
    manifest = json.loads((folder / "cert" / "manifest.json").read_text())
    table = folder / "cert" / manifest["modules"][0]["cases"][0]["groups"][0]["K"]
    core = np.frombuffer(table.read_bytes(), dtype=np.uint8).reshape(12, -1).copy()
    assert not core[-1].any()
    core[-1, slice(*speeds)] = holds
    table.write_bytes(core.tobytes())
    reseal(folder / "cert", manifest)
    return folder / "cert"


@pytest.mark.parametrize(
    ("speeds", "holds", "why"),
    [
        ((0, 0), 0, ""),
        ((5, 10), 7, "does not certainly lead back to K"),
        ((5, 10), 1, "does not certainly lead back to K"),
        ((45, 46), 7, "`safe` is not certain"),
    ],
    ids=("as proved", "near ones come down", "they stay up", "too fast"),
)
def test_a_cell_without_an_end_is_not_kept_by_what_becomes_of_its_near_states(
    tmp_path: Path, speeds: tuple[int, int], holds: int, why: str
) -> None:
    report = recheck(forged(FALLING, tmp_path, speeds, holds))
    assert report.accepted == (not why), report.reason
    assert why in report.reason


def test_safe_of_a_cell_without_an_end_is_looked_at_all_the_way_out(tmp_path: Path) -> None:
    """Every state of the last cell falls by less than that is wide, and `safe` ends at 30."""
    text = FALLING.replace("safe seen.x < 5.0 || seen.v < 3.0", "safe seen.x < 30.0")
    report = recheck(forged(text, tmp_path, (0, 40), 1))
    assert "`safe` is not certain" in report.reason


def test_beyond_an_end_nothing_is_said_of_what_no_proof_follows() -> None:
    for old, new, what in (
        ("der x = -8.0", "next x = x - 0.8", "steps"),
        (" / 10 open, seen.v", " / 10 open; grid seen.v", "several groups"),
    ):
        text = FALLING.replace(
            "ttf true;\n  safer false;", "ttf seen.x > 0.0;\n  safer seen.x > 1.0;"
        )
        text = text.replace("der v = 3.5 - v + u", "next v = v") if "next" in new else text
        with pytest.raises(SoterError, match="is `open`") as raised:
            verified(text.replace(old, new))
        assert what in raised.value.diagnostics[0].message


def test_beyond_an_end_no_controller_is_looked_for() -> None:
    text = FALLING.replace("ttf true;\n  safer false;", "ttf seen.x > 0.0;\n  safer seen.x > 1.0;")
    text = text.replace("sc Slow;", "sc synthesized period 100ms;")
    text = text.replace(
        "recover never;", "core seen.x > 1.0; commands u in { 0.0, 0.001 }; recover never;"
    )
    flat = system_of(check_file("rover.soter", text), None)
    with pytest.raises(SoterError, match=r"R007.*`open`.*an SC that is to be found"):
        extract(flat, flat.modules[0], synthesize=True)
