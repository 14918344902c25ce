"""The tables of a DM with computed predicates: in the certificate, checked, and deployed."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.recheck.models import Cart
from bench.recheck.small_modules import PROGRAMS

import soter
from soter.api import recheck
from soter.certificate.cell_sets import Grid
from soter.certificate.extras.estimates_and_shield import (
    least_levels,
    packed_levels,
)
from soter.certificate.grid.group_claims import GroupTables
from soter.language.front_end import check_file, system_of
from soter.verify.deploy.missing_predicates import complete
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable

CELLS = (40, 30)


@pytest.fixture(scope="session")
def open_proof(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cart whose predicates are computed, and its certificate; not to be changed."""
    folder = tmp_path_factory.mktemp("open")
    text = Cart(cells_x=CELLS[0], cells_v=CELLS[1]).text()
    (folder / "cart.soter").write_text(re.sub(r"\n  (ttf|safer) [^\n]*", "", text))
    verify_report = soter.load(folder / "cart.soter").verify(cert=folder / "cert", refute=False)
    assert {n: verify_report.modules[0].findings[n].verdict for n in ("P3", "ttf", "safer")} == {
        "P3": "proved",
        "ttf": "proved",
        "safer": "proved",
    }
    return folder


@pytest.fixture
def copied_proof(open_proof: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(open_proof / "cert", tmp_path / "cert"))


def entry_of(folder: Path) -> dict[str, Any]:
    entry: dict[str, Any] = json.loads((folder / "manifest.json").read_text())["modules"][0]
    return entry


def rewritten(folder: Path, name: str, how: Callable[[NDArrayU8], None]) -> str:
    """Change a file, seal again; why it is rejected now."""
    data = np.frombuffer((folder / name).read_bytes(), dtype=np.uint8).copy()
    how(data)
    (folder / name).write_bytes(data.tobytes())
    return resealed(folder, lambda _: None)


def resealed(folder: Path, how: Callable[[dict[str, Any]], None]) -> str:
    manifest = json.loads((folder / "manifest.json").read_text())
    how(manifest["modules"][0])
    for name in manifest["files"]:
        manifest["files"][name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    small_proofs.seal(folder, manifest)
    report = recheck(folder)
    assert not report.accepted
    return report.reason


NDArrayU8 = Any


def test_what_the_prover_writes_of_computed_predicates_is_accepted(open_proof: Path) -> None:
    report = recheck(open_proof / "cert")
    assert report.accepted, report.reason


def numbers_of(source: str, name: str) -> list[str]:
    """The elements of a constant array in C."""
    match = re.search(rf"{name} = \{{\s*\.at = \{{([^}}]*)\}}", source)
    assert match, name
    return [x.strip() for x in match.group(1).split(",") if x.strip()]


def test_build_deploys_the_bytes_of_the_certificate(open_proof: Path, tmp_path: Path) -> None:
    soter.load(open_proof / "cart.soter").build("c", tmp_path, "Track")
    source = (tmp_path / "cart.c").read_text()
    (table,) = entry_of(open_proof / "cert")["tables"]
    kept = (open_proof / "cert" / table["levels"]).read_bytes()
    assert bytes(int(x) for x in numbers_of(source, "SafeCart_level_TABLE")) == kept
    assert set(kept) & {85, 170}, "there is a cell of each level"
    for k, axis in enumerate(table["axes"]):
        edges = np.fromfile(open_proof / "cert" / axis["edges"], dtype="<f8").tolist()
        deployed = numbers_of(source, f"SafeCart_level_place{k}_EDGES")
        assert [float(x) for x in deployed] == edges


def test_a_run_reads_the_bytes_of_the_certificate(open_proof: Path) -> None:
    system = system_of(check_file(str(open_proof / "cart.soter")), "Track")
    complete(system)
    (table,) = entry_of(open_proof / "cert")["tables"]
    kept = (open_proof / "cert" / table["levels"]).read_bytes()
    assert f"{tuple(kept)}" in repr(system.modules[0].symbol.ttf)
    assert f"{tuple(kept)}" in repr(system.modules[0].symbol.safer)


def test_one_cell_more_in_the_table_is_rejected(copied_proof: Path) -> None:
    (table,) = entry_of(copied_proof)["tables"]

    def more(data: NDArrayU8) -> None:
        at = int(np.flatnonzero(data == 85)[0])  # four cells of level 1
        data[at] += 1

    assert "is not that of S" in rewritten(copied_proof, table["levels"], more)


def test_one_cell_less_in_the_table_is_rejected(copied_proof: Path) -> None:
    (table,) = entry_of(copied_proof)["tables"]

    def less(data: NDArrayU8) -> None:
        data[int(np.flatnonzero(data == 85)[0])] -= 1

    assert "is not that of S" in rewritten(copied_proof, table["levels"], less)


def test_another_breakpoint_of_the_table_is_rejected(copied_proof: Path) -> None:
    (table,) = entry_of(copied_proof)["tables"]

    def moved(data: NDArrayU8) -> None:
        data[8 * 5] ^= 1

    assert "cuts" in rewritten(copied_proof, table["axes"][0]["edges"], moved)


@pytest.mark.parametrize(("level", "by"), [(0, 1), (-1, 4)])
def test_a_larger_set_with_a_table_that_fits_is_rejected(
    copied_proof: Path, level: int, by: int
) -> None:
    """Enlarging S and adapting the table leaves the inclusion wrong.

    The prover gives away a cell or two of S_1: one more may be right, and is accepted then.
    """
    group = entry_of(copied_proof)["cases"][0]["groups"][0]
    levels = []
    for name in group["S"]:
        data = np.frombuffer((copied_proof / name).read_bytes(), dtype=np.uint8)
        bits = np.unpackbits(data, bitorder="little")[: CELLS[0] * CELLS[1]]
        levels.append(bits.astype(bool).reshape(CELLS))
    inside = levels[level]
    beside = np.zeros_like(inside)
    for k in range(1, by + 1):
        beside[k:] |= inside[:-k]
        beside[:-k] |= inside[k:]
    larger = inside | beside
    assert larger.sum() > inside.sum()
    levels[level] = larger
    if level:
        levels[0] |= larger
    for name, members in zip(group["S"], levels, strict=True):
        data = np.packbits(members.reshape(-1), bitorder="little")
        (copied_proof / name).write_bytes(data.tobytes())
    grid = Grid(tuple(tuple(float(k) for k in range(n + 1)) for n in CELLS))
    made = GroupTables((0, 1), grid, np.zeros(CELLS, dtype=np.uint8), levels=levels)
    (table,) = entry_of(copied_proof)["tables"]
    (copied_proof / table["levels"]).write_bytes(packed_levels(least_levels([made])))
    reason = resealed(copied_proof, lambda _: None)
    assert "S_" in reason
    assert "that of S" not in reason


def test_a_shield_permits_only_commands_that_keep_the_state_in_k(tmp_path: Path) -> None:
    """Where two quarters of the commands are permitted, one is as well, and three are not."""
    text = PROGRAMS["computed"].replace("  verify {", "  shield 4;\n  verify {")
    (tmp_path / "small.soter").write_text(text)
    folder = tmp_path / "cert"
    soter.load(tmp_path / "small.soter").verify(cert=folder, refute=False)
    assert recheck(folder).accepted
    path = folder / entry_of(folder)["tables"][0]["commands"]
    greatest = bytearray(path.read_bytes())
    at = greatest.index(bytes([2, 2, 0, 0]))
    for quarters, accepted in ((1, True), (3, False)):
        greatest[at] = quarters
        path.write_bytes(greatest)
        small_proofs.reseal(folder, json.loads((folder / "manifest.json").read_text()))
        report = recheck(folder)
        assert report.accepted is accepted, report.reason
    assert "u in [-1, 0.5], which the shield permits, may lead out of K from" in report.reason


TRAPS: dict[str, Callable[[dict[str, Any]], None]] = {
    "no tables": lambda e: e.pop("tables"),
    "too few": lambda e: e.update(tables=[]),
    "twice": lambda e: e.update(tables=2 * e["tables"]),
    "no list": lambda e: e.update(tables=3),
    "other axes": lambda e: e["tables"][0]["axes"].reverse(),
    "an axis less": lambda e: e["tables"][0]["axes"].pop(),
    "an unknown key": lambda e: e["tables"][0].update(trust="me"),
    "no levels": lambda e: e["tables"][0].update(levels="sets/none.bin"),
}


@pytest.mark.parametrize("name", TRAPS)
def test_wrong_tables_are_rejected(copied_proof: Path, name: str) -> None:
    assert resealed(copied_proof, TRAPS[name])


def test_tables_beside_written_predicates_are_rejected(copied: Path) -> None:
    assert "tables of its DM" in resealed(copied, lambda e: e.update(tables=[]))


def test_the_table_is_what_holds_in_every_case() -> None:
    grid = Grid(((0.0, 1.0, 2.0, 3.0, 4.0, 5.0),))
    none = np.zeros(5, dtype=np.uint8)

    def group(outer: list[int], inner: list[int]) -> GroupTables:
        levels = [np.array(outer, dtype=bool), np.array(inner, dtype=bool)]
        return GroupTables((0,), grid, none, levels=levels)

    cases = [group([1, 1, 1, 0, 1], [1, 0, 1, 0, 1]), group([1, 1, 1, 1, 0], [1, 1, 0, 1, 0])]
    assert least_levels(cases).tolist() == [2, 1, 1, 0, 0]
    assert packed_levels(least_levels(cases)) == bytes([2 + 4 + 16, 0])
