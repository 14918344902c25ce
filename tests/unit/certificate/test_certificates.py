"""Which certificates are accepted, and why others are not."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.recheck.corruptions import corrupt, judge
from bench.recheck.models import Attack

import soter
from long_tests import examples, seeds
from soter.api import recheck
from soter.certificate.case_check import CLAIMS
from soter.certificate.cell_sets import Grid
from soter.certificate.extras.estimates_and_shield import read_shield_table
from soter.certificate.grid.group_claims import GroupTables
from soter.certificate.reading.folder import FORMAT
from soter.certificate.report import RejectedError
from soter.diagnostics.diagnostic import SoterError
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.recheck.corruptions import Sealed

    Change = Callable[[Callable[[dict[str, Any]], None]], Path]

CORRUPTIONS = examples(6)


def reason_of(folder: Path) -> str:
    report = recheck(folder)
    assert not report.accepted
    return report.reason


def entry_of(manifest: dict[str, Any]) -> dict[str, Any]:
    entry: dict[str, Any] = manifest["modules"][0]
    return entry


def test_a_right_certificate_is_accepted(proved: Path) -> None:
    report = recheck(proved)
    assert report.accepted, report.reason
    assert report.modules[0].confirmed == [
        c for c in CLAIMS if c not in ("P1c", "failsafe")
    ]  # undeclared times
    assert report.safe


@pytest.mark.long
def test_what_the_prover_writes_is_accepted(tmp_path: Path, sealed: Sealed) -> None:
    path = tmp_path / "cart.soter"
    path.write_text(sealed.cart.text())
    verify_report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert verify_report.verdict == "proved"
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason


# ---------------------------------------------------------------- bytes


def test_every_changed_byte_is_rejected(copied: Path) -> None:
    draw = np.random.default_rng(3)
    for path in sorted(p for p in copied.rglob("*") if p.is_file()):
        data = path.read_bytes()
        for at in {0, len(data) - 1, *draw.integers(len(data), size=3)}:
            path.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
            assert reason_of(copied)
        path.write_bytes(data + b"\n")
        assert reason_of(copied)
        path.write_bytes(data)
    assert recheck(copied).accepted


@pytest.mark.parametrize("name", ["extra.txt", "sets/extra.bin", "program/other.soter"])
def test_a_file_too_many_is_rejected(copied: Path, name: str) -> None:
    (copied / name).write_bytes(b"")
    assert "not listed" in reason_of(copied)


def test_a_missing_file_is_rejected(copied: Path) -> None:
    next((copied / "sets").iterdir()).unlink()
    assert "missing" in reason_of(copied)


def test_an_empty_folder_is_rejected(copied: Path) -> None:
    (copied / "sets" / "nothing").mkdir()
    assert "empty" in reason_of(copied)


def test_a_link_is_rejected(copied: Path, tmp_path: Path) -> None:
    path = copied / "program" / "cart.soter"
    (tmp_path / "elsewhere.soter").write_bytes(path.read_bytes())
    path.unlink()
    path.symlink_to(tmp_path / "elsewhere.soter")
    assert "neither a file nor a folder" in reason_of(copied)


def test_a_manifest_that_is_not_canonical_is_rejected(copied: Path) -> None:
    raw = json.dumps(json.loads((copied / "manifest.json").read_text()), indent=1).encode()
    (copied / "manifest.json").write_bytes(raw)
    (copied / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")
    assert "canonical" in reason_of(copied)


def test_what_is_no_certificate_is_a_diagnostic(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(SoterError) as error:
            recheck(folder)
        assert error.value.diagnostics[0].code == "D009"


# ---------------------------------------------------------------- what nothing reads


def with_cell(name: str, where: str, value: int) -> Callable[[Path, dict[str, Any]], None]:
    """Another number in one cell of a table: in the last cell of which something holds."""

    def change(folder: Path, manifest: dict[str, Any]) -> None:
        group = entry_of(manifest)["cases"][0]["groups"][0]
        tables = {
            n: np.frombuffer((folder / group[n]).read_bytes(), dtype=kind).copy()
            for n, kind in (("Q", "<u1"), ("W", "<u2"), ("W_N", "<u1"))
        }
        cells = {
            "outside W": tables["W"] == 0,
            "in Q": tables["Q"] > 0,
        }[where]
        tables[name][np.flatnonzero(cells)[-1]] = value
        (folder / group[name]).write_bytes(tables[name].tobytes())

    return change


def claiming(*claims: str) -> Callable[[Path, dict[str, Any]], None]:
    """These claims alone, with all that the others rest on."""

    def change(_: Path, manifest: dict[str, Any]) -> None:
        for name in entry_of(manifest)["claims"]:
            if name not in claims:
                entry_of(manifest)["claims"][name] = "undecided"

    return change


def levels(folder: Path, manifest: dict[str, Any]) -> None:
    """Of predicates that are not computed."""
    group = entry_of(manifest)["cases"][0]["groups"][0]
    (folder / "sets" / "S0.bin").write_bytes((folder / group["R"]).read_bytes())
    manifest["files"]["sets/S0.bin"] = ""
    group["S"] = ["sets/S0.bin"]


def time_to_return(folder: Path, manifest: dict[str, Any]) -> None:
    """Of a way back that is not claimed."""
    entry_of(manifest)["claims"]["P2b"] = "undecided"
    small_proofs.only_claimed(folder, manifest)
    entry_of(manifest)["recover_ns"] = 10**9


def core_alone(folder: Path, manifest: dict[str, Any]) -> None:
    """K, of which nothing is claimed."""
    claiming("P1a", "P1b")(folder, manifest)
    small_proofs.only_claimed(folder, manifest)


WHERE_NOTHING_GOES = "W says how long it takes where there is nowhere to go"
UNREAD: dict[str, tuple[Callable[[Path, dict[str, Any]], None], str]] = {
    "N outside W": (with_cell("W_N", "outside W", 7), WHERE_NOTHING_GOES),
    "N in Q": (with_cell("W_N", "in Q", 1), WHERE_NOTHING_GOES),
    "a rank in Q": (with_cell("W", "in Q", 2), "W does not begin with Q"),
    "no rank in Q": (with_cell("W", "in Q", 0), "W does not begin with Q"),
    "a way back": (claiming("P1a", "P2a", "P3", "ttf", "safer", "start"), "no claim rests on `Q`"),
    "R": (claiming("P1a", "P2a", "P2b", "start"), "no claim rests on `R`"),
    "K": (core_alone, "K holds cells, and nothing is claimed of them"),
    "levels": (levels, "no claim rests on `S`"),
    "a time": (time_to_return, "no claim rests on the time to return"),
}


@pytest.mark.whole
@pytest.mark.parametrize("name", UNREAD)
def test_what_nothing_reads_is_rejected(copied: Path, name: str) -> None:
    change, why = UNREAD[name]
    manifest = json.loads((copied / "manifest.json").read_text())
    change(copied, manifest)
    small_proofs.reseal(copied, manifest)
    report = recheck(copied)
    assert (report.verdict, report.reason.partition(" of a group")[0]) == ("rejected", why)


def test_a_shield_names_no_greatest_cell_below_the_least() -> None:
    group = GroupTables((0,), Grid(((0.0, 1.0),)), np.ones(1, np.uint8))
    assert read_shield_table(bytes([3, 0, 3, 4]), group, 4).tolist() == [[3, 0, 3, 4]]
    for wrong in ([3, 1, 3, 4], [3, 0, 2, 4], [3, 0, 3, 3]):
        with pytest.raises(RejectedError, match="below the least one"):
            read_shield_table(bytes(wrong), group, 4)


# ---------------------------------------------------------------- the manifest

TRAPS: dict[str, Callable[[dict[str, Any]], None]] = {
    "no module": lambda m: m.update(modules=[]),
    "another module": lambda m: entry_of(m).update(module="Other"),
    "another system": lambda m: entry_of(m).update(system="Other"),
    "other plants": lambda m: entry_of(m).update(plants=["d"]),
    "a parameter": lambda m: entry_of(m).update(parameters=[{"name": "c.k", "values": [0]}]),
    "no case": lambda m: entry_of(m).update(cases=[]),
    "a case too many": lambda m: entry_of(m).update(cases=2 * entry_of(m)["cases"]),
    "a case of another value": lambda m: entry_of(m)["cases"][0].update(parameter=[1]),
    "no group": lambda m: entry_of(m)["cases"][0].update(groups=[]),
    "a group twice": lambda m: entry_of(m)["cases"][0].update(
        groups=2 * entry_of(m)["cases"][0]["groups"]
    ),
    "another kind": lambda m: entry_of(m)["cases"][0]["groups"][0].update(kind="polytope"),
    "a set outside": lambda m: entry_of(m)["cases"][0]["groups"][0].update(K="sets/../SEAL"),
    "a table less": lambda m: entry_of(m)["cases"][0]["groups"][0].pop("Q"),
    "nothing claimed": lambda m: entry_of(m).update(claims={}),
    "claims that are no object": lambda m: entry_of(m).update(claims=[]),
    "cases that are no list": lambda m: entry_of(m).update(cases=3),
    "axes that are no list": lambda m: entry_of(m)["cases"][0]["groups"][0].update(axes=None),
    "an input that is no text": lambda m: entry_of(m)["inputs"][0].update(low=1),
    "an unknown claim": lambda m: entry_of(m)["claims"].update(P9="proved"),
    "an unknown field": lambda m: entry_of(m).update(trust="me"),
    "a time that is a truth value": lambda m: entry_of(m)["times"].update(L_ns=False),
    "main outside": lambda m: m.update(main="../../cart.soter"),
    "an unknown parameter": lambda m: m.update(params={"K": 1}),
    "another hash of the program": lambda m: m.update(program_sha256="0" * 64),
    "a format that is no number": lambda m: m.update(schema=str(FORMAT)),
    "a format that is a truth value": lambda m: m.update(schema=True),
    "a format before the first": lambda m: m.update(schema=0),
    "no format": lambda m: m.pop("schema"),
    "what made it": lambda m: m.update(soter="0.1.0"),
    "an infinite bound": lambda m: entry_of(m)["inputs"][0].update(high="inf"),
    "a longer horizon in the manifest": lambda m: entry_of(m)["times"].update(H_ns=10**9),
}


@pytest.mark.parametrize("name", TRAPS)
def test_a_wrong_manifest_is_rejected(changed: Change, name: str) -> None:
    assert reason_of(changed(TRAPS[name]))


def test_a_module_without_sets_is_not_rechecked(changed: Change) -> None:
    """Though what is claimed of it is no matter of sets."""

    def change(manifest: dict[str, Any]) -> None:
        entry_of(manifest)["claims"] = dict.fromkeys(("P1a", "P1b"), "proved")
        entry_of(manifest)["cases"][0]["groups"] = []

    report = recheck(changed(change))
    assert report.verdict == "not re-checked"
    assert "no sets were found: P2a, P3 and the start were not proved" in report.reason


@pytest.mark.parametrize(
    ("what", "edges"),
    [
        ("increase", [2.0, 1.0]),
        ("finite", [float("nan"), 1.0]),
        ("finite", [0.0, float("inf")]),
        ("increase", [0.0, 0.0]),
        ("span", [-1.0, 1.0]),
    ],
)
def test_wrong_edges_are_rejected(
    changed: Change, copied: Path, what: str, edges: list[float]
) -> None:
    data = np.array(edges, dtype="<f8").tobytes()

    def change(manifest: dict[str, Any]) -> None:
        name = entry_of(manifest)["cases"][0]["groups"][0]["axes"][0]["edges"]
        (copied / name).write_bytes(data)
        manifest["files"][name] = hashlib.sha256(data).hexdigest()

    assert what in reason_of(changed(change))


def test_a_program_that_reads_outside_its_folder_is_rejected(copied: Path) -> None:
    """The hash of the program covers what it reads, wherever that lies."""
    outside = copied.parent / "more.soter"
    outside.write_text("soter 1;\nconst WALL: float = 2.0;\n")
    text = (copied / "program" / "cart.soter").read_text()
    text = text.replace("soter 1;", 'soter 1;\nimport "../../more.soter" as more;')
    entry = entry_of(json.loads((copied / "manifest.json").read_text()))
    sets = {f"sets/{p.name}": p.read_bytes() for p in (copied / "sets").iterdir()}
    text = text.replace("< 2.0", "< more.WALL")
    small_proofs.write(copied, {"cart.soter": text}, "cart.soter", [entry], sets)
    assert "outside" in reason_of(copied)


# ---------------------------------------------------------------- inclusions


def test_a_state_from_which_ac_may_leave_k_within_h_is_none_of_r(
    tmp_path: Path, sealed: Sealed
) -> None:
    wrong = sealed.copy()
    wrong.tables["R"] = wrong.tables["K"] > 0
    assert not (wrong.tables["R"] <= sealed.tables["R"]).all()
    wrong.write(tmp_path)
    assert reason_of(tmp_path).startswith("some command leads out of K within H from")


@pytest.mark.random
def test_corruptions_that_are_sealed_again_are_rejected_or_true(sealed: Sealed) -> None:
    outcomes = [judge(sealed, seed) for seed in seeds(CORRUPTIONS)]
    assert not [o for o in outcomes if o.accepted and o.broken]
    assert sum(not o.accepted for o in outcomes) > CORRUPTIONS / 2


@pytest.mark.long
def test_the_adversary_sees_what_is_wrong(sealed: Sealed) -> None:
    """Where the simulations see a broken claim, the re-checker rejects; and they see many."""
    seen = 0
    for seed in range(100, 130):
        kind, wrong, suspects = corrupt(sealed, seed)
        if kind in ("program changed", "K enlarged", "R enlarged", "table moved"):
            seen += bool(Attack(wrong.cart, wrong.as_tables(), seed).broken(suspects, 1000))
    assert seen >= 5


def test_bits_behind_the_last_cell_are_rejected(copied: Path) -> None:
    """36 x 24 cells fill their bytes, 5 do not: so the reader is asked itself."""
    from soter.certificate.reading.folder import Certificate
    from soter.certificate.report import RejectedError

    certificate = Certificate(copied, {}, {"sets/a": b"\x3f"}, set())
    with pytest.raises(RejectedError, match="behind the last cell"):
        certificate.set_of_cells("sets/a", (5, 1))
    certificate.contents["sets/a"] = b"\x1f"
    assert certificate.set_of_cells("sets/a", (5, 1)).all()


def test_python_flint_is_asked_for(monkeypatch: pytest.MonkeyPatch, proved: Path) -> None:
    monkeypatch.setattr("soter.api.rechecking.find_spec", lambda _: None)
    with pytest.raises(SoterError) as error:
        recheck(proved)
    assert error.value.diagnostics[0].code == "D007"
    assert proved.exists()


CAREFUL = "step { publish accel = clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A); }"


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (
            CAREFUL,
            CAREFUL.replace("clamp", "choose { 0.0, clamp").replace(", A);", ", A) };"),
            "`choose`",
        ),
        (CAREFUL, CAREFUL.replace("= clamp", "= fair choose bool ? 0.0 : clamp"), "choose"),
        (
            f"subscribes motion;\n  publishes accel;\n  {CAREFUL}",
            f"subscribes motion queue 2;\n  publishes accel;\n  {CAREFUL}".replace(
                "motion.", "motion[0]."
            ),
            "is a queue",
        ),
    ],
)
def test_an_sc_that_chooses_or_reads_a_queue_is_not_rechecked(
    tmp_path: Path, sealed: Sealed, old: str, new: str, why: str
) -> None:
    changed = sealed.copy()
    text = changed.cart.text()
    assert old in text
    changed.text = text.replace(old, new)
    changed.write(tmp_path / "cert")
    assert why in reason_of(tmp_path / "cert")
