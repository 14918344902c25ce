"""Modules whose times are seconds and minutes: what is proved of them is accepted.

Of an SC that steps with its plant no sample is old, and a certificate counts with `max_age`; rates
of such plants are small, and their spans of time long.
"""

from __future__ import annotations

import json
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import pytest
from flint import arb_mat

import soter
from soter.api import recheck
from soter.certificate.reading.linear_flows import TAYLOR, exponential
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import ZERO, exact
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

OVEN = """soter 1;
topic temp: float max_age AGE;
topic power: float in [0.0, 1.0] = 0.0;
plant Oven period STEP {
  reads power; drives temp = x;
  state x: float = 100.0;
  disturbance door: float in [-0.05, 0.02];
  der x = (200.0 * power - x) / TAU + door;
  measured temp within 0.5;
}
node Policy period HOLD { publishes power; step { publish power = 1.0; } }
node Keep period HOLD {
  subscribes temp; publishes power;
  step { publish power = clamp(0.5 + GAIN * (100.0 - temp), 0.0, 1.0); }
}
rta M {
  ac Policy; sc Keep; period HOLD;
  safe temp < 140.0 && temp > 60.0;
  verify { grid temp in [60.0, 140.0] / 160; levels 2; MORE }
}
system S default { o: Oven; module M; until 1200s; }
"""
CASES = {
    "samples 2 s old": ("2s", "500ms", "16s", "120.0", "0.01", "acts within 8s;"),
    "samples 20 s old": ("20s", "10s", "20s", "600.0", "0.03", ""),
    "acts late, samples fresh": ("1s", "500ms", "16s", "120.0", "0.01", "acts within 8s;"),
    "rates small, spans long": ("1s", "1s", "40s", "300.0", "0.01", "acts within 20s;"),
    "silent for long": ("3s", "1s", "4s", "120.0", "0.03", "dropout 5s;"),
}
"""max_age, periods of the plant and of the controllers, tau in s, gain; what `verify` says more."""


def oven(case: str) -> str:
    text = OVEN
    names = ("AGE", "STEP", "HOLD", "TAU", "GAIN", "MORE")
    for name, value in zip(names, CASES[case], strict=True):
        text = text.replace(name, value)
    return text


def proved(tmp_path: Path, text: str) -> Path:
    """The folder of a certificate in which everything but P1c is proved."""
    path = tmp_path / "slow.soter"
    path.write_text(text)
    (module,) = soter.load(path).verify(cert=tmp_path / "cert", refute=False).modules
    assert module.findings["P2b"].verdict == module.findings["P3"].verdict == "proved"
    return tmp_path / "cert"


@pytest.mark.parametrize("case", CASES)
def test_what_is_proved_of_a_slow_module_is_accepted(tmp_path: Path, case: str) -> None:
    report = recheck(proved(tmp_path, oven(case)))
    assert report.accepted, report.reason
    assert report.safe
    assert report.has_return


@pytest.mark.parametrize(
    "change",
    [("within 0.5", "within 4.0"), ("-0.05, 0.02", "-0.05, 0.4"), ("/ 120.0", "/ 40.0")],
    ids=["errors", "disturbance", "rates"],
)
def test_the_sets_of_another_slow_module_are_rejected(
    tmp_path: Path, change: tuple[str, str]
) -> None:
    """Ranges of the manifest are those of the changed program, so that the sets alone are wrong."""
    folder = proved(tmp_path, oven("acts late, samples fresh"))
    manifest = small_proofs.edit_program(folder, change)
    for given in manifest["modules"][0]["inputs"]:
        low, high = (float.fromhex(given[k]) for k in ("low", "high"))
        if given["kind"] == "error" and "within" in change[0]:
            given |= {"low": (8 * low).hex(), "high": (8 * high).hex()}
        if given["kind"] == "disturbance" and high == 0.02 and "0.02" in change[0]:
            given["high"] = (0.4).hex()
    small_proofs.reseal(folder, manifest)
    report = recheck(folder)
    assert not report.accepted
    assert "certain" in report.reason


def test_an_age_far_beyond_the_times_of_a_slow_module_is_refused(tmp_path: Path) -> None:
    folder = proved(tmp_path, oven("samples 2 s old"))
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["modules"][0]["times"]["A_sc_ns"] = 3_600 * 10**9
    small_proofs.seal(folder, manifest)
    assert "no program needs" in recheck(folder).reason


# ---------------------------------------------------------------- e^{At} over long spans

MATRICES: dict[str, list[list[float]]] = {
    "decay": [[-0.5]],
    "two tanks": [[-0.5, 0.0], [0.5, -0.25]],
    "oscillation": [[0.0, 1.0], [-1.0, -0.125]],
    "integrators": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]],
}


@all_rows("name", MATRICES)
@all_rows("width", [1, 10, 40])
def test_exponentials_over_long_spans_hold_those_of_every_instant(name: str, width: int) -> None:
    a: Any = [[exact(x) for x in row] for row in MATRICES[name]]
    n = len(a)
    start, end = Fraction(3), Fraction(3 + 2 * width)
    over = exponential(a, start, end)
    for k in range(17):
        at = start + (end - start) * k / 16
        there = (arb_mat(a) * exact(at)).exp().tolist()
        assert all(over[i][j].contains(there[i][j]) for i in range(n) for j in range(n))


def test_a_long_span_needs_more_terms_and_one_that_is_too_long_is_refused() -> None:
    a: Any = [[exact(1.0), exact(0.5)], [ZERO, exact(-0.5)]]
    half = Fraction(TAYLOR, 2)  # beyond what so many terms reach: 1.5 half / (TAYLOR + 2) > 1/2
    (row, _) = exponential(a, -half, half)
    for t in (-half, half):
        assert row[0].contains(exact(t).exp())
    assert row[0].rad() < 4 * exact(half).exp()
    with pytest.raises(NotRecheckedError, match="too long for these rates"):
        exponential(a, Fraction(0), Fraction(10_000))
