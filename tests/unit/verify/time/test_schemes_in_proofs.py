"""The scheme that flies is in the proof of a linear flow, or the proof says that it is not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.grid.scheme_error import scheme_error, scheme_weight
from soter.verify.verify_module import verify_module
from tables import all_rows

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

CART = """soter 1;
topic pos: float max_age 20ms;
topic push: float in [-2.0, 2.0] = 0.0;
topic shown: float;
node Fast period 10ms { subscribes pos; publishes push; step { publish push = 2.0 - pos; } }
node Careful period 10ms {
  subscribes pos; publishes push; step { publish push = clamp(-3.0 * pos, -2.0, 2.0); }
}
rta G {
  ac Fast; sc Careful; period 20ms;
  safe pos < 1.0 && pos > -1.0;
  verify { grid pos in [-1.2, 1.2] / 60; grid p.z in [-1.0, 1.0] / 1; }
}
plant P period 10ms {
  reads push; drives pos = x; drives shown = z;
  state x: float = 0.0;
  state z: float = 0.5;
  disturbance d: float in [-0.5, 0.5];
  der x = push;
  der z = RATE;
  integrate SCHEME;
}
system S { p: P; module G; until 1s; }
"""


def found_of(rate: str, scheme: str = "rk4", *changes: tuple[str, str]) -> ModuleResult:
    text = CART.replace("RATE", rate).replace("SCHEME", scheme)
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    checked = check_file("cart.soter", text)
    assert checked.ok, checked.diagnostics.items
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    return verify_module(problem, refute=False, explain=False)


@pytest.mark.parametrize(
    ("rate", "scheme", "verdict"),
    [
        ("-1000.0 * z", "rk4", "undecided"),
        ("400.0 * (d - z)", "rk4", "undecided"),
        ("-1000.0 * z", "euler", "undecided"),
        ("400.0 * (d - z)", "rk4 substeps 8", "proved"),
        ("-1000.0 * z", "rk4 substeps 20", "proved"),
        ("-50.0 * z", "rk4", "proved"),
        ("-20.0 * z", "euler", "proved"),
    ],
)
def test_a_group_that_no_command_moves_is_stepped_too(rate: str, scheme: str, verdict: str) -> None:
    module_result = found_of(rate, scheme)
    assert module_result.findings["P2a"].verdict == verdict
    if verdict == "proved":
        assert "scheme" not in module_result.assumed
    else:
        assert "rate x step of p.z is" in module_result.findings["P2a"].text
        assert "substeps" in module_result.findings["P2a"].hint


FORWARD = (
    ("in [-2.0, 2.0] = 0.0", "in [0.0, 2.0] = 0.0"),
    ("clamp(-3.0 * pos, -2.0, 2.0)", "0.0"),
    ("2.0 - pos", "2.0"),
    ("safe pos < 1.0 && pos > -1.0", "safe pos < 1.0"),
    ("[-1.2, 1.2] / 60", "[-1.0, 1.2] / 55"),
    ("state x: float = 0.0", "state x: float = -0.5"),
)
"""Nothing pushes x back, so that it stays above the end of its grid without any room."""


@pytest.mark.parametrize(
    ("rate", "changes", "verdict"),
    [
        ("-20.0 * z", (("in [-1.0, 1.0] / 1", "in [0.0, 1.0] / 1"),), "undecided"),
        ("-20.0 * z", (("in [-1.0, 1.0] / 1", "in [-0.1, 1.0] / 1"),), "proved"),
        ("0.0 * z", (), "proved"),
        ("0.0 * z", FORWARD, "proved"),
    ],
)
def test_an_end_is_kept_by_the_scheme_or_it_is_not_kept(
    rate: str, changes: tuple[tuple[str, str], ...], verdict: str
) -> None:
    """Of a linear flow the scheme is never assumed; what no state changes is stepped as it is."""
    found = found_of(rate, "rk4", *changes)
    assert found.findings["P2a"].verdict == verdict
    assert "scheme" not in found.assumed
    kept = "the differential equation keeps p.z above 0, and that the scheme which integrates it"
    assert (kept in found.findings["P2a"].text) == (verdict == "undecided")
    assert ("further out" in found.findings["P2a"].hint) == (verdict == "undecided")


def test_what_is_not_in_the_proof_is_in_the_headline() -> None:
    between = ("node Careful period 10ms {", "node Careful period 10ms phase 5ms {")
    module_result = found_of("-50.0 * z", "rk4", between)
    assert "scheme" in module_result.assumed
    assert "scheme" in found_of("-z * z * z", "rk4", ("/ 60;", "/ 24;")).assumed


def test_a_stiff_plant_beside_the_one_that_is_moved() -> None:
    """With a period of its own: both are stepped as they are."""
    beside = "plant Q period 5ms { drives shown = z; state z: float = 0.5; der z = FAST * z; }\n"
    plants = ("system S { p: P;", f"{beside}system S {{ p: P; q: Q;")
    other = ("grid p.z in", "grid q.z in")
    for fast, verdict in (("-1000.0", "undecided"), ("-50.0", "proved")):
        module_result = found_of(
            "",
            "rk4",
            (" drives shown = z;", ""),
            ("  state z: float = 0.5;\n", ""),
            ("  disturbance d: float in [-0.5, 0.5];\n", ""),
            ("  der z = ;\n", ""),
            (plants[0], plants[1].replace("FAST", fast)),
            other,
        )
        assert module_result.findings["P2a"].verdict == verdict, module_result.findings["P2a"].text
        assert ("scheme" in module_result.assumed) == (verdict == "undecided")


def test_a_linear_group_is_covered_beside_one_that_is_not() -> None:
    """z by itself is stepped; that x bends does not turn its scheme into an assumption."""
    bent = ("der x = push;", "der x = push - 0.01 * x * x * x;")
    coarse = ("/ 60;", "/ 24;")
    finding = found_of("-1000.0 * z", "rk4", bent, coarse).findings["P2a"]
    assert (finding.verdict, "rate x step of p.z is" in finding.text) == ("undecided", True)


@pytest.mark.parametrize(("by", "verdict"), [("rk4", "undecided"), ("rk4 substeps 8", "proved")])
def test_a_flow_that_bends_and_diverges_by_a_bound_of_its_slope(by: str, verdict: str) -> None:
    """K is there, as the differential equation has one; the steps leave it."""
    rate = "-300.0 * z + 0.001 * sin(z)"
    module_result = found_of(rate, by, ("/ 60;", "/ 24;"))
    assert module_result.findings["P2a"].verdict == verdict
    assert ("makes z diverge" in module_result.findings["P2a"].text) == (verdict == "undecided")
    assert "scheme" in module_result.assumed
    text = CART.replace("RATE", rate).replace("SCHEME", by)
    warned = {d.code for d in check_file("cart.soter", text).diagnostics.items}
    assert ("W019" in warned) == (verdict == "undecided")


def test_measuring_ends_where_no_axis_has_an_inside() -> None:
    """Why K is empty is asked of a state deep in C; of an axis of one cell it went on for ever."""
    text = CART.replace("RATE", "-1000.0 * z + 10.0 * z * z * z").replace("SCHEME", "rk4")
    (problem,) = problems_of(modules_of(check_file("cart.soter", text), None, None, {}))
    finding = verify_module(problem, refute=False, explain=True).findings["P2a"]
    assert (finding.verdict, bool(finding.causes)) == ("undecided", True)


@all_rows("order", [1, 4])
@all_rows("seed", range(8))
def test_the_error_holds_one_step_whatever_the_units(seed: int, order: int) -> None:
    rng = np.random.default_rng(seed)
    n, h = int(rng.integers(1, 4)), 0.01
    a = rng.normal(0.0, 30.0, (n, n)) * (rng.random((n, n)) < 0.7)
    units = 10.0 ** rng.uniform(-3.0, 3.0, n)
    a = a * units[:, None] / units
    b = rng.normal(0.0, 1.0, (n, 1)) * units[:, None]
    if not np.all(np.isfinite(scheme_weight(a, h, order))):
        assert np.abs(np.linalg.eigvals(np.abs(a) * h)).max() > 0.9
        return
    model = {"A": a, "B": b, "c": np.zeros(n), "w": np.zeros(n)}
    w = scheme_error(model, units, np.full(1, 2.0), h, order)
    m = np.zeros((2 * n, 2 * n))
    m[:n, :n], m[:n, n:] = a, np.eye(n)
    grown = _exponential(m * h)
    for _ in range(50):
        x, u = units * rng.uniform(-1.0, 1.0, n), rng.uniform(-2.0, 2.0, 1)
        drive = b @ u
        if order == 1:
            stepped = x + h * (a @ x + drive)
        else:
            k1 = a @ x + drive
            k2 = a @ (x + h / 2 * k1) + drive
            k3 = a @ (x + h / 2 * k2) + drive
            k4 = a @ (x + h * k3) + drive
            stepped = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        error = np.linalg.solve(grown[:n, n:], stepped - grown[:n, :n] @ x - grown[:n, n:] @ drive)
        assert np.all(np.abs(error) <= w * (1 + 1e-6) + 1e-9 * units)


def _exponential(m: np.ndarray) -> np.ndarray:
    """By scaling and squaring."""
    total = term = np.eye(len(m))
    for k in range(1, 20):
        term = term @ (m / 1024) / k
        total = total + term
    for _ in range(10):
        total = total @ total
    return np.asarray(total)
