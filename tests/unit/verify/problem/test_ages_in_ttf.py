"""`ttf e || age(t) > c`: what only takes control from AC is proved as e is, and by both."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.certificate.rechecker import recheck
from soter.diagnostics.diagnostic import SoterError
from unit.certificate import small_proofs
from unit.verify.diagnosis.tank_modules import TANK, changed

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.report import Report
    from soter.verify.claims.results import ModuleResult

TTF = "ttf level < 0.25 || level > 1.75;"
HEARD = (
    ("topic pump:", "topic beat: int in [0, 9];\ntopic pump:"),
    (
        "rta SafeTank",
        "node Beat period 100ms { publishes beat; step { publish beat = 1; } }\nrta SafeTank",
    ),
    ("t: Tank;", "t: Tank; node Beat;"),
)
SOUND = (
    "ttf level < 0.25 || level > 1.75 || age(level) > seconds(60ms);",
    "ttf age(level) > 0.05 || level < 0.25 || age(beat) > 1.0 || level > 1.75;",
    "ttf !(level >= 0.25 && level <= 1.75 && age(level) <= 0.05);",
    "ttf level < 0.25 || level > 1.75 || level > 1.0 && age(level) > 0.05;",
)
WRONG = (
    "ttf level < 0.25 || level > 1.75 && age(level) > 0.05;",
    "ttf level < 0.25 || (age(level) > 0.05 ? level > 1.7 : level > 1.75);",
    "ttf level < 0.25 || !(level <= 1.75 || age(level) <= 0.05);",
)


def proved(folder: Path, ttf: str) -> ModuleResult:
    """Verified, with a certificate in `folder`."""
    (folder / "tank.soter").write_text(changed((TTF, ttf), *HEARD))
    report = soter.load(folder / "tank.soter").verify(cert=folder / "cert", refute=False)
    return report.modules[0]


def claimed(cert: Path) -> Report:
    """The certificate where everything is said to be proved."""
    manifest: dict[str, Any] = json.loads((cert / "manifest.json").read_text())
    for entry in manifest["modules"]:
        entry["claims"].update(dict.fromkeys(("P3", "ttf", "P2b"), "proved"))
    small_proofs.seal(cert, manifest)
    return recheck(cert)


@pytest.mark.parametrize("ttf", SOUND)
def test_what_only_takes_control_away_is_proved_and_confirmed(tmp_path: Path, ttf: str) -> None:
    result = proved(tmp_path, ttf)
    assert result.verdict == "proved"
    assert any("takes control from AC and never gives it" in note for note in result.notes)
    assert recheck(tmp_path / "cert").accepted


@pytest.mark.parametrize("ttf", WRONG)
def test_an_age_beside_which_ac_keeps_control_is_not_proved(tmp_path: Path, ttf: str) -> None:
    result = proved(tmp_path, ttf)
    assert result.findings["ttf"].verdict == result.findings["P3"].verdict == "undecided"
    report = claimed(tmp_path / "cert")
    assert not report.accepted
    assert "`ttf` may leave AC in control outside R(H)" in str(report)


@pytest.mark.parametrize(
    "ttf", ["ttf age(level) > 0.05;", "ttf (level < 0.25) == (age(level) > 0.05);"]
)
def test_a_ttf_of_nothing_but_ages_is_refused(tmp_path: Path, ttf: str) -> None:
    with pytest.raises(SoterError, match="R007"):
        proved(tmp_path, ttf)


def test_safer_may_not_ask_for_an_age(tmp_path: Path) -> None:
    text = re.sub(r"safer level > 0.4", "safer age(level) < 0.05 || level > 0.4", TANK)
    (tmp_path / "tank.soter").write_text(text)
    with pytest.raises(SoterError, match="R007"):
        soter.load(tmp_path / "tank.soter").verify(refute=False)
