"""Clamps within clamps: a polytope lies where the inner ones are clear of their ends."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from soter.certificate.rechecker import recheck
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("highspy")

PROGRAM = """soter 1;
topic m: { p: float, v: float } max_age 10ms;
topic a: float in [-4.0, 4.0] = 0.0;
plant Cart period 10ms {
  reads a;
  drives m = { p: p, v: v };
  state p: float = 0.0;
  state v: float = 0.0;
  disturbance w: float in [-0.1, 0.1];
  der p = v;
  der v = a + w;
  measured m.p within 0.01, m.v within 0.01;
}
node Policy period 20ms { publishes a; step { publish a = 4.0; } }
node Home period 20ms {
  subscribes m;
  publishes a;
  step { publish a = clamp(4.0 * (clamp(-1.0 * m.p, -1.0, 1.0) - m.v), -4.0, 4.0); }
}
rta Held {
  ac Policy;
  sc Home;
  period 20ms;
  safe abs(m.p) < 3.0;
  verify { polytope m.p in [-3.0, 3.0], m.v in [-3.0, 3.0]; }
}
system S default { r: Cart; module Held; until 20s; always abs(r.truth.p) < 3.0; }
"""


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("right")
    path = folder / "cart.soter"
    path.write_text(PROGRAM)
    report = soter.load(path).verify(cert=folder / "cert", refute=False)
    assert report.verdict == "proved"
    return folder / "cert"


def box_file(folder: Path) -> Path:
    manifest = json.loads((folder / "manifest.json").read_text())
    (group,) = manifest["modules"][0]["cases"][0]["groups"]
    return folder / str(group["C"]["file"])


def test_a_cascade_is_proved_where_it_is_linear_and_accepted(right: Path) -> None:
    low, high = np.fromfile(box_file(right), dtype="<f8").reshape(2, 2)
    assert 0.9 < high[0] <= 0.99, "as far as the inner clamp is clear of its end"
    assert -0.99 <= low[0] < -0.9
    assert high[1] == 3.0, "the outer one is kept clear by a half-space"
    found = recheck(right, workers=1)
    assert found.accepted, found.reason


def test_a_cascade_is_not_taken_for_linear_beyond_its_inner_clamp(
    right: Path, tmp_path: Path
) -> None:
    at = shutil.copytree(right, tmp_path / "cert")
    path = box_file(at)
    wider = np.fromfile(path, dtype="<f8").reshape(2, 2)
    wider[:, 0] = -2.0, 2.0
    path.write_bytes(wider.tobytes())
    small_proofs.reseal(at, json.loads((at / "manifest.json").read_text()))
    assert not recheck(at, workers=1).accepted


def test_an_inner_clamp_that_is_narrower_than_the_proof_says_is_rejected(
    right: Path, tmp_path: Path
) -> None:
    at = shutil.copytree(right, tmp_path / "cert")
    small_proofs.edit_program(at, ("m.p, -1.0, 1.0", "m.p, -0.5, 0.5"))
    assert not recheck(at, workers=1).accepted
