"""`soter recheck`: exits and documents; which of the three verdicts is said of what."""

from __future__ import annotations

import json
import shutil
from concurrent.futures import BrokenExecutor
from typing import TYPE_CHECKING, Any, cast

import pytest

from json_documents import problems_of
from soter.api.program import load
from soter.certificate import rechecker
from soter.certificate.case_check import CLAIMS
from soter.certificate.grid.group_claims import FREE_PIECES
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.rechecker import recheck
from soter.certificate.report import (
    ACCEPTED,
    NOT_RECHECKED,
    REJECTED,
    SAFETY,
    NotRecheckedError,
    RecheckedModule,
    RejectedError,
    Report,
)
from soter.cli.main import main
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.front_end import check_file
from soter.verify.grid.sets import SEGMENTS_MAX
from unit.certificate import small_proofs
from unit.verify.diagnosis.tank_modules import changed as changed_tank

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Entry = dict[str, Any]


def document(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    recheck_document: dict[str, object] = json.loads(capsys.readouterr().out)
    assert not problems_of(recheck_document)
    return recheck_document


@pytest.mark.long
def test_accepted_is_0(proved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", str(proved), "--json"]) == 0
    recheck_document = document(capsys)
    assert recheck_document["accepted"] is True
    assert recheck_document["reason"] == ""
    assert main(["recheck", str(proved)]) == 0
    assert "ACCEPTED" in capsys.readouterr().out


def test_rejected_is_3(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (copied / "sets" / "more.bin").write_bytes(b"\0")
    assert main(["recheck", str(copied), "--json"]) == 3
    recheck_document = document(capsys)
    assert recheck_document["accepted"] is False
    assert "more.bin" in str(recheck_document["reason"])
    assert main(["recheck", str(copied)]) == 3
    assert "more.bin" in capsys.readouterr().out


def test_no_certificate_is_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", str(tmp_path), "--json"]) == 1
    assert document(capsys)["diagnostics"][0]["code"] == "D009"  # type: ignore[index]


def test_no_folder_is_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", "--json"]) == 2
    document(capsys)


def claiming(copied: Path, **claims: str) -> str:
    """The folder of the certificate with other claims."""
    manifest = json.loads((copied / "manifest.json").read_text())
    manifest["modules"][0]["claims"].update(claims)
    small_proofs.only_claimed(copied, manifest)
    small_proofs.seal(copied, manifest)
    return str(copied)


@pytest.mark.parametrize("name", ["P1a", "P1c", "P2a", "P3", "ttf", "safer", "start"])
def test_what_safety_needs_and_is_not_claimed_is_accepted_in_part(name: str) -> None:
    claims = dict.fromkeys(CLAIMS, "proved") | {name: "undecided"}
    module = RecheckedModule("M", claims, confirmed=[n for n in CLAIMS if n != name])
    report = Report(ACCEPTED, modules=[module])
    assert module.missing == [name]
    assert not report.safe


def test_p1c_may_be_assumed() -> None:
    claims = dict.fromkeys(CLAIMS, "proved") | {"P1c": "assumed"}
    confirmed = [n for n in CLAIMS if n != "P1c"]
    assert Report(ACCEPTED, modules=[RecheckedModule("M", claims, confirmed=confirmed)]).safe


def test_nothing_else_may_be_assumed() -> None:
    claims = dict.fromkeys(CLAIMS, "assumed")
    assert RecheckedModule("M", claims, confirmed=[]).missing == ["P1a", "P1b", *SAFETY[3:]]


def test_without_the_start_it_is_accepted_in_part(
    copied: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = claiming(copied, start="undecided", ttf="undecided")
    assert main(["recheck", folder, "--json"]) == 4
    recheck_document = document(capsys)
    assert (recheck_document["accepted"], recheck_document["safe"], recheck_document["ok"]) == (
        True,
        False,
        False,
    )
    assert main(["recheck", folder]) == 4
    out = capsys.readouterr().out
    assert f"ACCEPTED IN PART  {folder}: safety is not established (ttf, start not claimed)" in out


def test_without_p2b_that_is_said(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = claiming(copied, P2b="undecided")
    code = main(["recheck", folder, "--json"])
    recheck_document = document(capsys)
    assert (
        code,
        recheck_document["accepted"],
        recheck_document["safe"],
        recheck_document["returns"],
    ) == (4, True, True, False), recheck_document["reason"]
    assert main(["recheck", folder]) == 4
    assert f"ACCEPTED, without P2b  {folder}" in capsys.readouterr().out


NEVER = ("safe level > 0.2", "returns never; safe level > 0.2")
VACUOUS = {
    "keeps control": ("ttf level < 0.25 || level > 1.75;", "ttf level < 1.0 || level >= 1.0;"),
    "has control": (
        "safer level > 0.4 && level < 1.6;",
        "safer level > 1.0 && level < 1.0 && level > 0.9;",
    ),
    "`ttf` holds of whatever is fresh": (
        "ttf level < 0.25 ||",
        "ttf level < 0.25 || age(level) <= seconds(100ms) && level > 0.1 ||",
    ),
    "`safe` holds of all values": ("level > 0.2 && level < 1.8;", "level > 0.2 || level < 1.8;"),
    "holds of all values that": (
        "level > 0.2 && level < 1.8;",
        "level > 0.2 || level - level < 0.5;",
    ),
    "nothing says that AC ever gets control": ("&& level < 1.6;", "&& level < 0.6;"),
    "": ("ttf level < 0.25", "ttf level < 0.25"),
}


@pytest.mark.parametrize("said", VACUOUS)
def test_a_proof_about_an_ac_that_never_flies_is_no_plain_accepted(
    said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By states that are drawn from the K of the certificate."""
    (tmp_path / "tank.soter").write_text(changed_tank(VACUOUS[said], NEVER))
    folder = tmp_path / "cert"
    load(tmp_path / "tank.soter").verify(cert=folder, refute=False)
    assert main(["recheck", str(folder), "--json"]) == 0
    (module,) = cast("dict[str, Any]", document(capsys)["modules"]).values()
    assert (bool(module["vacuous"]), module["vacuity_unseen"]) == (bool(said), "")
    assert said in module["vacuous"]
    assert main(["recheck", str(folder)]) == 0
    out = capsys.readouterr().out
    assert ("ACCEPTED, of next to nothing" in out) == bool(said)


# ---------------------------------------------------------------- three verdicts

OTHERS = "system Track default { c: Cart; module SafeCart; until 10s; }"
SYSTEMS = ("Track", "Road", "Rail")


@pytest.fixture
def three(proved: Path, tmp_path: Path) -> Callable[..., Path]:
    """A certificate of the module in three systems, each changed as it is told.

    Of each one P1a alone is claimed, which takes no time.
    """

    def make(*changes: Callable[[Entry], object]) -> Path:
        folder: Path = shutil.copytree(proved, tmp_path / "three")
        own = folder / "program" / "cart.soter"
        text = own.read_text()
        more = [OTHERS.replace("Track default", name) for name in SYSTEMS[1:]]
        own.write_text("\n".join([text, *more, ""]))
        manifest = json.loads((folder / "manifest.json").read_text())
        checked = check_file(str(own)).program
        assert checked is not None
        manifest["program_sha256"] = checked.sha256
        entry = manifest["modules"][0]
        entry["claims"] = {"P1a": "proved"}
        small_proofs.only_claimed(folder, manifest)
        core = folder / entry["cases"][0]["groups"][0]["K"]
        core.write_bytes(bytes(core.stat().st_size))
        manifest["modules"] = []
        for name, change in zip(SYSTEMS, changes, strict=True):
            manifest["modules"].append(json.loads(json.dumps(entry)) | {"system": name})
            change(manifest["modules"][-1])
        small_proofs.reseal(folder, manifest)
        return folder

    return make


def right(_: Entry) -> None:
    """As it is."""


def beyond(entry: Entry) -> None:
    """Of a kind of sets that nobody here knows."""
    entry["cases"][0]["groups"][0]["kind"] = "octagon"


def longer(entry: Entry) -> None:
    """True, perhaps, of schedules that there are not."""
    entry["times"]["H_ns"] = 3_600 * 10**9


def induction(entry: Entry) -> None:
    """A module proved by induction, which needs the solver."""
    entry["induction"] = {}


def false(entry: Entry) -> None:
    """Another figure than that of the program."""
    entry["times"]["Delta_ns"] += 1


@pytest.mark.parametrize(
    ("changes", "verdict", "which"),
    [
        ((right, right, right), ACCEPTED, {}),
        ((right, right, beyond), NOT_RECHECKED, {"Rail": "octagon"}),
        ((longer, right, right), NOT_RECHECKED, {"Track": "no program needs"}),
        ((beyond, right, longer), NOT_RECHECKED, {"Track": "octagon", "Rail": "no program"}),
        ((right, false, right), REJECTED, {}),
        ((beyond, right, false), REJECTED, {}),
        ((false, beyond, right), REJECTED, {}),
    ],
)
def test_one_false_module_rejects_all_else_it_is_said_which_were_not_rechecked(
    changes: tuple[Callable[[Entry], object], ...],
    verdict: str,
    which: dict[str, str],
    three: Callable[..., Path],
) -> None:
    report = recheck(three(*changes))
    assert report.verdict == verdict, report.reason
    assert report.accepted == (verdict == ACCEPTED)
    assert bool(report.reason) == (verdict != ACCEPTED)
    if verdict == REJECTED:
        assert "Delta_ns" in report.reason
        return
    assert sorted(m.system for m in report.modules) == sorted(SYSTEMS)
    for module in report.modules:
        beyond_us = module.system in which
        assert module.verdict == (NOT_RECHECKED if beyond_us else ACCEPTED)
        assert which.get(module.system, "") in module.not_rechecked
        assert bool(module.confirmed) != beyond_us


def test_without_the_solver_an_induction_alone_is_not_rechecked(
    three: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.certificate.proof_methods.find_spec", lambda _: None)
    report = recheck(three(right, induction, right))
    assert report.verdict == NOT_RECHECKED
    left = [m for m in report.modules if not m.confirmed]
    assert len(report.modules) == 3
    assert ["z3-solver" in m.not_rechecked for m in left] == [True]


@pytest.mark.parametrize(
    "error",
    [
        NotRecheckedError("no"),
        AssertionError("no"),
        MemoryError("no"),
        RecursionError("no"),
        ZeroDivisionError("no"),
        BrokenExecutor("no"),
        OSError("no"),
        KeyError("no"),
        StepFault(FaultKind.ASSERT, detail="no"),
    ],
)
@pytest.mark.parametrize("where", ["_check_module", "read_certificate"])
def test_what_fails_here_is_no_fault_of_the_certificate(
    error: Exception, where: str, three: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise error

    folder = three(right, right, right)
    monkeypatch.setattr(rechecker, where, fails)
    report = recheck(folder)
    assert report.verdict == NOT_RECHECKED
    assert "no" in report.reason
    assert not any(m.confirmed for m in report.modules)


@pytest.mark.parametrize("error", [RejectedError("no"), DiffersError("no")])
def test_what_is_false_is_rejected(
    error: Exception, three: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise error

    folder = three(right, right, right)
    monkeypatch.setattr(rechecker, "_check_module", fails)
    assert recheck(folder).verdict == REJECTED


@pytest.mark.parametrize("reason", ["SC does not certainly come nearer to Q from [0, 1]", "no"])
def test_of_a_witness_that_is_not_confirmed_it_is_said_that_a_right_one_may_fail(
    reason: str,
    three: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise RejectedError(reason)

    folder = three(right, right, right)
    monkeypatch.setattr(rechecker, "_check_module", fails)
    assert main(["recheck", str(folder)]) == 3
    assert ("a right proof may fail here, too" in capsys.readouterr().out) == (reason != "no")


def test_it_has_an_exit_code_a_word_and_a_json_value(
    three: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(three(right, beyond, right))
    assert main(["recheck", folder, "--json"]) == 5
    document = json.loads(capsys.readouterr().out)
    assert not problems_of(document)
    assert (document["exit"], document["ok"]) == (5, False)
    assert (document["verdict"], document["accepted"]) == (NOT_RECHECKED, False)
    assert {n: m["verdict"] for n, m in document["modules"].items()} == {
        "Track.SafeCart": ACCEPTED,
        "Road.SafeCart": NOT_RECHECKED,
        "Rail.SafeCart": ACCEPTED,
    }
    page = tmp_path / "page.html"
    assert main(["recheck", folder, "--report", str(page)]) == 5
    out = capsys.readouterr().out
    assert out.startswith(f"NOT RE-CHECKED  {folder}")
    assert "SafeCart of system Road: not re-checked: `octagon` groups" in out
    assert "SafeCart of system Rail: accepted: P1a" in out
    assert "REJECTED" not in out
    assert "NOT RE-CHECKED" in page.read_text()
    assert "Not re-checked: " in page.read_text()


ROTATION = """soter 1;
topic y: { x0: float, x1: float } max_age 10ms;
topic u: float in [-0.274, 0.274] = -0.274;
plant P period 5ms {
  reads u;
  drives y = { x0: x0, x1: x1 };
  state x0: float = 0.0;
  state x1: float = 0.0;
  der x0 = 3.62 * x1;
  der x1 = -3.62 * x0 - 0.0217 * x1 + u;
}
node Ac period 1ms { publishes u; step { publish u = 0.274; } }
node Sc period 40ms phase 39ms {
  subscribes y;
  publishes u;
  step { publish u = clamp(-(0.0446 * y.x0 + 0.102 * y.x1), -0.274, 0.274); }
}
rta M {
  ac Ac;
  sc Sc;
  period 120ms;
  safe abs(y.x0) < 1.0 && abs(y.x1) < 1.0;
  verify {
    grid y.x0 in [-1.0, 1.0] / 60, y.x1 in [-1.0, 1.0] / 60;
    late dm 0us, sc 3ms;
    response dm 3ms, sc 2ms;
    acts within 0us;
  }
}
system S default { p: P; module M; until 10s; }
"""


@pytest.mark.long
def test_a_tube_that_turns_is_cut_as_finely_as_the_proof_cuts_it(tmp_path: Path) -> None:
    """A state that turns by half a radian between two looks: boxes of 16 pieces are too wide."""
    program, folder = tmp_path / "m.soter", tmp_path / "cert"
    program.write_text(ROTATION)
    assert main(["verify", str(program), "--cert", str(folder)]) == 0
    assert recheck(folder).accepted


def test_the_finest_tubes_are_those_of_the_prover() -> None:
    assert FREE_PIECES[-1] >= SEGMENTS_MAX
