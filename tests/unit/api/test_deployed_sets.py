"""What a certificate carries is deployed as it stands there, and not computed once more."""

from __future__ import annotations

import copy
import json
import re
import shutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from test_deployed_kinds import BELT, LINE  # type: ignore[import-not-found]
from test_deploying import PROVED, VEHICLE  # type: ignore[import-not-found]

import soter
from correct.test_shield import SMALL
from soter.api.deploy import inheritance
from soter.certificate.reading.folder import read_certificate
from soter.diagnostics.diagnostic import SoterError
from soter.verify.deploy import missing_predicates
from soter.verify.deploy.proof_transfer import certified_sets
from soter.verify.problem.extract import extract
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

GRID = (PROVED, VEHICLE.replace("point.soter", "proved.soter"))
KINDS = {"grid": GRID, "map": (BELT, LINE)}


@pytest.fixture(scope="module", params=list(KINDS))
def proved(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A proved program, its certificate, and a robot that deploys it."""
    folder = tmp_path_factory.mktemp(request.param)
    for name, text in zip(("proved.soter", "robot.soter"), KINDS[request.param], strict=True):
        (folder / name).write_text(text)
    assert soter.load(folder / "proved.soter").verify(cert=folder / "cert").verdict == "proved"
    return folder


def compute_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("it was computed again")

    for name in ("library_of", "_cached_sets", "_compute_sets"):
        monkeypatch.setattr(missing_predicates, name, refuse)


def code_of(folder: Path) -> dict[str, str]:
    """The generated C, but for what names the certificate."""
    files = {p.name: p.read_text() for p in folder.glob("*.[ch]") if "soter" not in p.name}
    return {n: re.sub(r".*CERTIFICATE.*\n", "", text) for n, text in files.items()}


def test_the_sets_of_a_certificate_give_the_code_that_computing_them_gives(
    proved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = soter.load(proved / "robot.soter").build("c", tmp_path / "computed")
    compute_nothing(monkeypatch)
    read = soter.load(proved / "robot.soter").build("c", tmp_path / "read", cert=proved / "cert")
    assert "checked again" in read.inherits[0]
    assert read.notes == computed.notes
    assert any("ttf and safer computed" in note for note in read.notes)
    code = code_of(tmp_path / "computed")
    assert "level" in "".join(code.values())
    assert code_of(tmp_path / "read") == code
    with pytest.raises(AssertionError, match="computed again"):
        soter.load(proved / "robot.soter").build("c", tmp_path / "alone")


@pytest.mark.parametrize("claim", ["P2a", "P3", "ttf", "safer"])
def test_sets_that_were_not_confirmed_are_computed(
    proved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, claim: str
) -> None:
    report = soter.recheck(proved / "cert")
    for module in report.modules:
        module.confirmed.remove(claim)
    monkeypatch.setattr(inheritance, "recheck", lambda *_: report)
    compute_nothing(monkeypatch)
    with pytest.raises(AssertionError, match="computed again"):
        soter.load(proved / "robot.soter").build("c", tmp_path / "out", cert=proved / "cert")


def test_a_certificate_that_is_changed_while_it_is_checked_is_refused(
    proved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked = soter.recheck(proved / "cert")
    report = copy.copy(checked)
    report.seal = "0" * 64
    monkeypatch.setattr(inheritance, "recheck", lambda *_: report)
    with pytest.raises(SoterError, match="changed while it was checked") as caught:
        soter.load(proved / "robot.soter").build("c", tmp_path / "out", cert=proved / "cert")
    assert caught.value.diagnostics[0].code == "D020"
    assert (proved / "cert" / "SEAL").read_text().strip() == checked.seal


def other_edges(entry: dict[str, Any]) -> None:
    axis = entry["cases"][0]["groups"][0]["axes"][0]
    axis["edges"] = next(iter(entry["cases"][0]["groups"][0]["S"]))  # no such breakpoints


def other_state(entry: dict[str, Any]) -> None:
    entry["cases"][0]["groups"][0]["axes"][0]["state"] = "another.x"


def other_case(entry: dict[str, Any]) -> None:
    entry["cases"][0]["parameter"] = [1]


def no_sets(entry: dict[str, Any]) -> None:
    del entry["cases"][0]["groups"][0]["S"]


def other_kind(entry: dict[str, Any]) -> None:
    entry["cases"][0]["groups"][0]["kind"] = "ball"


def one_group_more(entry: dict[str, Any]) -> None:
    entry["cases"][0]["groups"].append(entry["cases"][0]["groups"][0])


def of_a_view(entry: dict[str, Any]) -> None:
    entry["view"] = "V"


CHANGES = (other_edges, other_state, other_case, no_sets, other_kind, one_group_more, of_a_view)


@pytest.mark.parametrize("change", CHANGES)
def test_sets_of_other_cases_groups_or_grids_are_not_taken(proved: Path, change: Any) -> None:
    certificate = read_certificate(proved / "cert")
    flat = soter.load(proved / "proved.soter").declared("Protected")
    problem = extract(flat, flat.modules[0])
    asked = (certificate, "Protected", "Keep", problem)
    assert certified_sets(*asked) is not None
    assert certified_sets(certificate, "Protected", "Other", problem) is None
    certificate.manifest = json.loads(json.dumps(certificate.manifest))
    change(certificate.manifest["modules"][0])
    assert certified_sets(*asked) is None


# ---------------------------------------------------------------- what is built is what was checked


def sealed_again(folder: Path, name: str, data: bytes) -> None:
    """A certificate with another file, its hashes right."""
    (folder / name).write_bytes(data)
    small_proofs.reseal(folder, json.loads((folder / "manifest.json").read_text()))


def as_accepted(monkeypatch: pytest.MonkeyPatch, before: Path, folder: Path) -> None:
    """Whoever asks hears that a certificate is accepted as that one is."""
    report = copy.deepcopy(soter.recheck(before))
    report.seal = (folder / "SEAL").read_text().strip()
    monkeypatch.setattr(inheritance, "recheck", lambda *_: report)


def test_tables_that_were_computed_are_those_of_the_certificate(
    proved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last number of the last table is another one; a right certificate is built as it is."""
    monkeypatch.setattr(inheritance._CertifiedTables, "sets", lambda *_: None)
    made = soter.load(proved / "robot.soter").build("c", tmp_path / "right", cert=proved / "cert")
    assert "checked again" in made.inherits[0]
    forged: Path = shutil.copytree(proved / "cert", tmp_path / "cert")
    table = json.loads((forged / "manifest.json").read_text())["modules"][0]["tables"][-1]
    name = table["levels"] if "levels" in table else table["inner"]["box"]["file"]
    data = bytearray((forged / name).read_bytes())
    data[-1] ^= 1
    sealed_again(forged, name, bytes(data))
    as_accepted(monkeypatch, proved / "cert", forged)
    with pytest.raises(SoterError, match="is built with other tables than it has") as caught:
        soter.load(proved / "robot.soter").build("c", tmp_path / "out", cert=forged)
    assert caught.value.diagnostics[0].code == "D020"
    assert not (tmp_path / "out").exists()


SHIELDED = SMALL.replace("plant Cart period 5ms", "plant Cart period 10ms").replace(
    "/ 250", "/ 125"
)
SHIELDED_ROBOT = """soter 1;
import "proved.soter" as p;
system Robot deploys p.S {
  external topic p.at every 10ms measured p.at within 0.01;
  external topic p.speed;
  module p.Keep;
}
"""


def nothing(tops: Any) -> None:
    """No command is permitted anywhere."""
    tops[...] = 0


def less_at_one_place(tops: Any) -> None:
    """In one cell of estimates alone, nothing."""
    tops[np.flatnonzero(tops[:, 0])[0]] = 0


def less_at_the_end(tops: Any) -> None:
    """The last cell that is permitted anywhere is not."""
    last = np.flatnonzero(tops[:, -1])[-1]
    tops[last, -1] = 0


@pytest.mark.parametrize("change", [nothing, less_at_one_place, less_at_the_end])
def test_a_shield_that_permits_less_is_true_and_is_not_what_is_built(
    change: Any, tmp_path: Path
) -> None:
    (tmp_path / "proved.soter").write_text(SHIELDED)
    (tmp_path / "robot.soter").write_text(SHIELDED_ROBOT)
    cert = tmp_path / "cert"
    assert soter.load(tmp_path / "proved.soter").verify(cert=cert).verdict == "proved"
    robot = soter.load(tmp_path / "robot.soter")
    assert "checked again" in robot.build("c", tmp_path / "right", cert=cert).inherits[0]
    name = json.loads((cert / "manifest.json").read_text())["modules"][0]["tables"][0]["commands"]
    tops = np.frombuffer((cert / name).read_bytes(), dtype=np.uint8).reshape(-1, 4).copy()
    change(tops)
    sealed_again(cert, name, tops.tobytes())
    assert soter.recheck(cert).accepted
    with pytest.raises(SoterError, match="is built with other tables than it has"):
        robot.build("c", tmp_path / "out", cert=cert)
