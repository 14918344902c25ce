"""What `soter recheck` cannot check `soter verify` says, in its headline, and nothing else."""

from __future__ import annotations

import importlib
import json
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.cli.main import main
from tables import all_rows
from unit.verify.diagnosis.tank_modules import TANK, changed
from unit.verify.induction.test_induction import PLANNER

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

OPEN = changed(
    ("  ttf level < 0.25 || level > 1.75;\n", ""),
    ("  safer level > 0.4 && level < 1.6;\n", ""),
    text=TANK,
)
PROGRAMS = {
    "a grid": TANK,
    "computed": OPEN,
    "an induction": PLANNER,
}


def verified(folder: Path, text: str) -> ModuleResult:
    """Proved, with a certificate in `folder`."""
    (folder / "p.soter").write_text(text)
    report = soter.load(folder / "p.soter").verify(cert=folder / "cert", refute=False)
    return report.modules[0]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, ModuleResult]:
    """Of each kind of proof one."""
    return {n: verified(tmp_path_factory.mktemp("of"), text) for n, text in PROGRAMS.items()}


@pytest.mark.parametrize("name", PROGRAMS)
def test_where_nothing_stands_in_the_way_nothing_is_said(
    name: str, results: dict[str, ModuleResult]
) -> None:
    result = results[name]
    assert result.verdict == "proved"
    assert result.not_rechecked == ""
    assert "re-checked" not in result.headline


BEYOND = {
    "a takeover": (
        "publishes pump;\n  step { publish pump = clamp(0.5",
        "publishes pump;\n  on takeover { assert true; }\n  step { publish pump = clamp(0.5",
    ),
}


@pytest.mark.whole
@pytest.mark.parametrize("name", BEYOND)
def test_what_is_beyond_the_rechecker_is_said_by_verify(name: str, tmp_path: Path) -> None:
    result = verified(tmp_path, changed(BEYOND[name], text=TANK))
    assert result.verdict == "proved"
    assert result.not_rechecked
    assert result.headline == f"proved, not re-checked: {result.not_rechecked}"
    report = soter.recheck(tmp_path / "cert")
    assert (report.verdict, report.reason) == (
        "not re-checked",
        f"SafeTank: {result.not_rechecked}",
    )


STAGES = {
    "read_times": ("soter.certificate.reading.problem", "a grid"),
    "require_supported": ("soter.certificate.rechecker", "a grid"),
    "sc_chain": ("soter.certificate.grid.group_claims", "a grid"),
    "free_phase_steps": ("soter.certificate.grid.group_claims", "computed"),
    "require_defined_rates": ("soter.certificate.case_check", "a grid"),
    "axes_seen_by_dm": ("soter.certificate.extras.estimates_and_shield", "computed"),
    "_require_affordable": ("soter.certificate.induction.check_claims", "an induction"),
    "_check_times": ("soter.certificate.induction.induction_problem", "an induction"),
}


@all_rows("stage", STAGES)
@all_rows("error", [NotRecheckedError("no"), MemoryError("no"), RejectedError("no")])
def test_each_stage_is_gone_through(
    stage: str, error: Exception, results: dict[str, ModuleResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    module, program = STAGES[stage]

    def fails(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(importlib.import_module(module), stage, fails)
    ask: Any = results[program].ask_rechecker
    assert "no" in ask()


def test_the_headline_and_the_document_say_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "p.soter"
    path.write_text(changed(BEYOND["a takeover"], text=TANK))
    assert main(["verify", str(path), "--no-refute"]) == 0
    assert ", not re-checked: an SC with `on takeover` is not rechecked yet  " in (
        capsys.readouterr().out
    )
    assert main(["verify", str(path), "--no-refute", "--json"]) == 0
    (module,) = json.loads(capsys.readouterr().out)["modules"].values()
    assert module["not_rechecked"] == "an SC with `on takeover` is not rechecked yet"
    path.write_text(TANK.replace("safe level > 0.2", "safe level > 0.9"))
    main(["verify", str(path), "--no-refute", "--json"])
    (module,) = json.loads(capsys.readouterr().out)["modules"].values()
    assert (module["verdict"], module["not_rechecked"]) == ("undecided", None)
