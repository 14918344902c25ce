"""P2b on smaller cells than the declared ones, where SC keeps no set of those in `safer`.

A cart between two ends: of the estimates that the DM gives back there is one cell of half a metre,
or three, so that whatever SC keeps inside is smaller than a cell.
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
from soter.verify.claims.results import PROVED, UNDECIDED
from soter.verify.problem.extract import extract
from soter.verify.verify_module import verify_module
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

TEXT = """soter 1;
topic b: { x: float } max_age 20ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period 10ms {
  reads u;
  drives b = { x: x };
  state x: float = 0.0;
  disturbance w: float in [-0.02, 0.02];
  der x = u + w;
  measured b.x within 0.02;
}
node Push period 20ms { publishes u; step { publish u = 1.0; } }
node Middle period 20ms {
  subscribes b;
  publishes u;
  step { publish u = clamp(-4.0 * b.x, -1.0, 1.0); }
}
rta Slot {
  ac Push;
  sc Middle;
  period 20ms;
  safe abs(b.x) < 4.25;
  verify { grid b.x in [-4.25, 4.25] / 17; levels 3; }
}
system S default { p: P; module Slot; until 30s; }
"""
NOTE = "P2b: Q on cells of half the size (p.x 17 -> 20); the DM's table is as declared"

GIVEN_BACK = 0.75
"""S_1 reaches so far on either side."""


def text(*changes: tuple[str, str]) -> str:
    source = TEXT
    for old, new in changes:
        assert old in source, old
        source = source.replace(old, new)
    return source


def verified(source: str, *, explain: bool | None = None) -> ModuleResult:
    """On the declared cells: smaller ones, of K too, show more (`test_chosen_cells.py`)."""
    checked = check_file("slot.soter", source)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    problem = replace(extract(flat, flat.modules[0]), cells_open=False)
    return verify_module(problem, refute=False, explain=explain)


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finer")
    (folder / "slot.soter").write_text(TEXT)
    given = ["verify", str(folder / "slot.soter"), "--no-refute", "--cert", str(folder / "cert")]
    assert main(given) == 0
    return folder / "cert"


def test_q_on_half_cells_is_proved_said_and_accepted(certificate: Path) -> None:
    result = verified(TEXT)
    assert result.findings["P2b"].verdict == PROVED
    assert NOTE in result.notes
    report = recheck(certificate)
    assert report.verdict == "accepted"
    assert "P2b" in report.modules[0].claims


def test_tables_of_the_dm_and_k_stay_on_the_declared_cells(certificate: Path) -> None:
    sets = certificate / "sets"
    assert len((sets / "0_0_0_K.bin").read_bytes()) == 17
    assert len(np.frombuffer((sets / "0_dm0_axis0.bin").read_bytes(), "<f8")) == 18
    assert len((sets / "0_0_0_Q.bin").read_bytes()) == 20


@pytest.mark.parametrize(
    "change",
    [
        ("clamp(-4.0 * b.x", "clamp(4.0 * b.x"),
        ("clamp(-4.0 * b.x, -1.0, 1.0)", "0.0"),
        ("clamp(-4.0 * b.x", "clamp(-0.05 * b.x"),
        ("-4.0 * b.x", "-4.0 * (b.x - 1.0)"),
        ("w: float in [-0.02, 0.02]", "w: float in [-0.9, 0.9]"),
        ("b.x within 0.02", "b.x within 0.24"),
        ("max_age 20ms", "max_age 500ms"),
    ],
)
def test_what_sc_does_not_keep_is_not_proved(change: tuple[str, str]) -> None:
    assert verified(text(change)).findings["P2b"].verdict == UNDECIDED


def test_what_was_tried_is_said() -> None:
    finding = verified(text(("-4.0 * b.x", "-4.0 * (b.x - 1.0)"))).findings["P2b"]
    assert (
        "nor where SC rests on cells of half or a quarter of the size, the DM's table as"
        in finding.text
    )


# ---------------------------------------------------------------- forged certificates


def _numbers(certificate: Path, name: str, kind: str) -> Any:
    return np.frombuffer((certificate / "sets" / name).read_bytes(), kind)


def _entry(manifest: dict[str, Any]) -> dict[str, Any]:
    found: list[dict[str, Any]] = []

    def look(at: object) -> None:
        if isinstance(at, dict):
            found.extend([at] * ("Q_axes" in at))
            for value in at.values():
                look(value)
        elif isinstance(at, list):
            for value in at:
                look(value)

    look(manifest)
    return found[0]


def _forged(certificate: Path, to: Path, files: dict[str, bytes], **entry: object) -> Any:
    shutil.copytree(certificate, to)
    for name, data in files.items():
        (to / "sets" / name).write_bytes(data)
    manifest = json.loads((to / "manifest.json").read_text())
    _entry(manifest).update(entry)
    small_proofs.reseal(to, manifest)
    return recheck(to)


def test_a_cell_more_in_q_is_rejected(certificate: Path, tmp_path: Path) -> None:
    """Each one of whose estimates some are not given back; of others it may be true."""
    names = {"Q": "u1", "W": "<u2", "W_N": "u1"}
    tables = [_numbers(certificate, f"0_0_0_{name}.bin", kind) for name, kind in names.items()]
    edges = _numbers(certificate, "0_0_0_Q_axis0.bin", "<f8")
    far = np.flatnonzero((edges[:-1] < -GIVEN_BACK) | (edges[1:] > GIVEN_BACK))
    assert len(far) < len(edges) - 1
    for cell in far:
        more = [x.copy() for x in tables]
        for table, value in zip(more, (int(tables[0].max()), 1, 0), strict=True):
            table[cell] = value
        files = {f"0_0_0_{n}.bin": x.tobytes() for n, x in zip(names, more, strict=True)}
        assert _forged(certificate, tmp_path / str(cell), files).verdict == REJECTED


def test_other_cells_of_q_are_rejected(certificate: Path, tmp_path: Path) -> None:
    names = ("0_0_0_axis0.bin", "0_0_0_Q_axis0.bin")
    declared, cut = (_numbers(certificate, name, "<f8") for name in names)
    moved, wider = cut.copy(), cut.copy()
    moved[3] += 0.01 * (moved[4] - moved[3])
    assert cut[3] in declared
    wider[-1] += 0.5
    for k, edges in enumerate((moved, wider, declared, np.linspace(cut[0], cut[-1], len(cut)))):
        files = {"0_0_0_Q_axis0.bin": edges.tobytes()}
        assert _forged(certificate, tmp_path / str(k), files).verdict == REJECTED
    for k, axes in enumerate(([], ["sets/0_0_0_axis0.bin"], ["sets/0_0_0_Q_axis0.bin"] * 2)):
        assert _forged(certificate, tmp_path / f"a{k}", {}, Q_axes=axes).verdict == REJECTED
