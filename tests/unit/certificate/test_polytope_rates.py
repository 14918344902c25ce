"""Half-spaces of flows that are not linear: a line for the rates is named, and noise is found."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.certificate.polytope.certificate_tables import ClaimedRates
from soter.certificate.polytope.linear_laws import enclosed_flow
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.rechecker import recheck
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytest.importorskip("highspy")

PROGRAM = """soter 1;
topic seen: { x: float, v: float } max_age 1ms;
topic push: float in [-1.55, 1.55] = 0.0;
plant Cart period 40ms {
  reads push;
  drives seen = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance w: float in [-0.03, 0.03];
  der x = v;
  der v = push + w - 0.144 * v * abs(v);
}
node Fast period 1ms { publishes push; step { publish push = 1.55; } }
node Careful period 40ms {
  subscribes seen;
  publishes push;
  step { publish push = clamp(-(1.0 * seen.x + 1.55 * seen.v), -1.24, 1.24); }
}
rta SafeCart {
  ac Fast;
  sc Careful;
  period 120ms;
  safe abs(seen.x) < 1.5 && abs(seen.v) < 2.16;
  verify {
    polytope seen.x in [-1.5, 1.5], seen.v in [-2.16, 2.16];
    late dm 0us, sc 0us;
    response dm 0us, sc 0us;
    acts within 1ms;
    levels 2;
  }
}
system S default { c: Cart; module SafeCart; until 10s; }
"""
DRAG = "- 0.144 * v * abs(v)"
"""It slows down, so a line has to go below and above it."""
RATES: dict[str, tuple[str, Callable[..., Any]]] = {
    DRAG: (DRAG, lambda _x, v, _u: -0.144 * v * np.abs(v)),
    "a product with the command": ("+ 0.3 * x * push", lambda x, _v, u: 0.3 * x * u),
    "a choice": ("- (v > 1.0 ? 0.1 * v : 0.0)", lambda _x, v, _u: np.where(v > 1, -0.1 * v, 0.0)),
    "a sine": ("- 0.2 * sin(x)", lambda x, _v, _u: -0.2 * np.sin(x)),
}


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("right")
    path = folder / "cart.soter"
    path.write_text(PROGRAM)
    report = soter.load(path).verify(cert=folder / "cert", refute=False)
    assert report.verdict == "proved"
    return folder / "cert"


def test_what_the_prover_writes_is_accepted(right: Path) -> None:
    found = recheck(right, workers=1)
    assert found.accepted, found.reason
    assert found.safe
    assert found.returns
    (module,) = found.modules
    assert any("not the simulator's scheme" in a.text for a in module.assumptions)


def changed(folder: Path, tmp_path: Path, edit: Callable[[Path, dict[str, Any]], None]) -> str:
    """Why a certificate is rejected after a change of the group in it."""
    at = shutil.copytree(folder, tmp_path / "cert")
    manifest = json.loads((at / "manifest.json").read_text())
    edit(at, manifest["modules"][0]["cases"][0]["groups"][0])
    small_proofs.reseal(at, manifest)
    found = recheck(at, workers=1)
    assert not found.accepted
    return found.reason


def scaled(part: str, factor: float) -> Callable[[Path, dict[str, Any]], None]:
    def edit(folder: Path, group: dict[str, Any]) -> None:
        path = folder / group["flow"][part]["file"]
        path.write_bytes((np.fromfile(path, dtype="<f8") * factor).astype("<f8").tobytes())

    return edit


EDITS: dict[str, tuple[Callable[[Path, dict[str, Any]], None], str]] = {
    "another A": (scaled("A", 1.1), "not confirmed by its multipliers"),
    "another B": (scaled("B", 1.2), "not confirmed by its multipliers"),
    "no numbers": (scaled("A", np.nan), "numbers that are not finite"),
    "no c": (lambda _, group: group["flow"].pop("c"), "is A, B and c"),
    "c of another shape": (
        lambda _, group: group["flow"].update(c=group["flow"]["A"]),
        "another shape",
    ),
}


@pytest.mark.parametrize("name", EDITS)
def test_another_line_is_no_proof(name: str, right: Path, tmp_path: Path) -> None:
    edit, why = EDITS[name]
    assert why in changed(right, tmp_path, edit)


def test_drag_that_drives_is_rejected(right: Path, tmp_path: Path) -> None:
    at = shutil.copytree(right, tmp_path / "cert")
    small_proofs.edit_program(at, ("- 0.144 * v", "+ 0.144 * v"))
    found = recheck(at, workers=1)
    assert not found.accepted
    assert "not confirmed by its multipliers" in found.reason


@all_rows("name", RATES)
@all_rows("seed", range(3))
def test_the_rates_are_as_far_from_the_line_as_is_found(
    name: str, seed: int, tmp_path: Path
) -> None:
    """Of states, commands and disturbances drawn from all ranges, whichever line is named."""
    text, rate = RATES[name]
    (tmp_path / "cart.soter").write_text(PROGRAM.replace(DRAG, text))
    facts = small_proofs.facts_of(tmp_path / "cart.soter", "S", "SafeCart")
    model = CaseModel(facts, (), ((-1.5, 1.5), (-2.16, 2.16)))
    draw = np.random.default_rng(seed)
    a, b = draw.uniform(-1, 1, (2, 2)), draw.uniform(-1, 1, (2, 1))
    c = draw.uniform(-0.2, 0.2, 2)
    flow = enclosed_flow(model, (0, 1), (0,), ClaimedRates(a, b, c))
    noise = np.array([sum(float(x.upper()) for x in row) for row in flow.noise])
    ends = [np.array([[-1.5], [-2.16]]), np.array([[-1.55]]), np.array([[-0.03]])]
    state, command, wind = (
        -low + 2 * low * np.where(p < 0.1, 0.0, np.where(p > 0.9, 1.0, p))
        for low, p in zip(ends, (draw.random((len(e), 40_000)) for e in ends), strict=True)
    )
    x, v = state
    rates = np.array([v, (command + wind)[0] + rate(x, v, command[0])])
    far = np.abs(rates - a @ state - b @ command - c[:, None]).max(axis=1)
    assert (far <= noise + 1e-12).all()
    assert (noise <= 1.15 * far + 0.01).all(), "what encloses everything says nothing"
