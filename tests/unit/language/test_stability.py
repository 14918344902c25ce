"""Whether a scheme diverges: what is said of random plants against what their steps do."""

from __future__ import annotations

import math
import random

import pytest

from soter.language.evaluate.integration_stability import groups_that_diverge
from soter.language.front_end import check_file, system_of
from tables import all_rows

PLANT = """soter 1;
topic pull: float in [-1.0, 1.0];
topic shown: float;
plant P period 10ms {{
  reads pull;
  drives shown = x0;
  {states}
  disturbance d: float in [-1.0, 1.0];
  {rates}
  integrate {method} substeps {substeps};
}}
node N period 100ms {{
  subscribes shown; publishes pull;
  step {{ publish pull = clamp(shown, -1.0, 1.0); }}
}}
system S {{ p: P; node N; until 1s; }}
"""
H = 0.01


def told(rates: list[str], method: str = "rk4", substeps: int = 1) -> list[tuple[str, ...]]:
    states = " ".join(f"state x{k}: float;" for k in range(len(rates)))
    equations = " ".join(f"der x{k} = {e};" for k, e in enumerate(rates))
    text = PLANT.format(states=states, rates=equations, method=method, substeps=substeps)
    checked = check_file("plant.soter", text)
    assert checked.ok, checked.diagnostics.items
    system = system_of(checked, "S")
    divergences = groups_that_diverge(system, system.components[0])
    warned = [d for d in checked.diagnostics.items if d.code == "W019"]
    assert len(warned) == len(divergences)
    return [d.names for d in divergences]


@all_rows(
    ("rate", "method", "diverges"),
    [
        ("-1000.0 * x0", "rk4", True),
        ("400.0 * (d - x0)", "rk4", True),
        ("270.0 * (d - x0)", "rk4", False),
        ("-1000.0 * x0", "euler", True),
        ("190.0 * (pull - x0)", "euler", False),
        ("210.0 * (pull - x0)", "euler", True),
        ("1000.0 * x0", "rk4", False),  # so does the plant
        ("-(1000.0 + 100.0 * sin(x0)) * 1.0", "rk4", False),  # its slope is small
        ("-1000.0 * x0 + 100.0 * sin(x0)", "rk4", True),
        ("-1000.0 * x0 + 1000.0 * sin(x0)", "rk4", False),  # nothing is known
        ("-(700.0 + 300.0 * d) * x0", "rk4", True),
        ("clamp(-1000.0 * x0, -5.0, 5.0)", "rk4", False),
        ("-1000.0 * x0 * x0 * x0", "rk4", False),
        ("(d > 0.0 ? -1000.0 : -2000.0) * x0", "rk4", True),
        ("(d > 0.0 ? -1000.0 : -20.0) * x0", "rk4", False),
    ],
)
def test_one_state(rate: str, method: str, diverges: bool) -> None:
    assert bool(told([rate], method)) == diverges


def test_lists_of_different_lengths_are_any_value() -> None:
    text = PLANT.format(
        states="state x0: float;",
        rates="der x0 = -1000.0 * x0; let one: float[<=2] = [x0]; let none: float[<=2] = [];\n"
        "  let some: float[<=2] = pull > 0.0 ? one : none;",
        method="rk4",
        substeps=1,
    )
    checked = check_file("plant.soter", text)
    assert checked.ok, checked.diagnostics.items
    system = system_of(checked, "S")
    assert groups_that_diverge(system, system.components[0])


def test_only_what_diverges_is_named_and_substeps_count() -> None:
    rates = ["x1", "-2.0 * x0 - x1 + 3.0 * x2", "800.0 * (pull - x2)"]
    assert told(rates) == [("x2",)]
    assert told(rates, substeps=3) == []
    assert told(["x1", "-100.0 * x0"], "euler") == [("x0", "x1")]  # nothing damps it
    assert told(["x1", "-100.0 * x0"], "rk4") == []
    assert told(["x1", "pull"], "euler") == []


@pytest.mark.parametrize("seed", range(6))
def test_random_linear_plants_against_their_steps(seed: int) -> None:
    """Run from a random state, by the formulas of docs/semantics.md, beside tiny steps."""
    rng = random.Random(seed)  # noqa: S311
    n, method = rng.choice((2, 3)), rng.choice(("rk4", "euler"))
    a = [[rng.choice((0.0, 1.0)) * rng.gauss(0.0, 60.0) for _ in range(n)] for _ in range(n)]
    for i in range(n):
        a[i][i] = -rng.uniform(50.0, 450.0)
    divergences = told(
        [" + ".join(f"({x!r}) * x{j}" for j, x in enumerate(row)) for row in a], method
    )
    grown = _size(a, method, H, 300)
    exact = _size(a, "rk4", H / 32, 300 * 32)
    if exact < 0.0:
        assert bool(divergences) == (grown > 0.0)


def _size(a: list[list[float]], method: str, h: float, steps: int) -> float:
    """The logarithm of what a state is multiplied by."""
    x, size = [1.0, -0.7, 0.4][: len(a)], 0.0

    def f(at: list[float]) -> list[float]:
        return [sum(c * y for c, y in zip(row, at, strict=True)) for row in a]

    def moved(scale: float, k: list[float]) -> list[float]:
        return [p + scale * q for p, q in zip(x, k, strict=True)]

    for _ in range(steps):
        if method == "euler":
            x = moved(h, f(x))
        else:
            k1 = f(x)
            k2 = f(moved(h / 2, k1))
            k3 = f(moved(h / 2, k2))
            k4 = f(moved(h, k3))
            x = [
                p + h / 6 * (q + 2 * r + 2 * s + t)
                for p, q, r, s, t in zip(x, k1, k2, k3, k4, strict=True)
            ]
        scale = max(map(abs, x)) or 1e-300
        size += math.log(scale)
        x = [v / scale for v in x]
    return size
