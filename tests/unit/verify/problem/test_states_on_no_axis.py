"""What becomes of bounded states that no `grid` line mentions: groups of their own, and a line."""

from __future__ import annotations

from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.verify_module import verify_module

CART = """soter 1;
topic m: { x: float, v: float } max_age 40ms;
topic a: float in [-2.0, 2.0] = 0.0;
topic load: float in [0.0, 1.0];
plant Cart period 10ms {
  reads a;
  drives m = { x: x, v: v };
  state x: float;
  state v: float;
  state payload: float in [0.0, 1.0];
  der x = v;
  der v = a / (1.0 + 0.3 * payload);
  measured m.x within 0.02, m.v within 0.02;
}
node Fast period 40ms { publishes a; step { publish a = 2.0; } }
node Park period 40ms {
  subscribes m; publishes a; step { publish a = clamp(-m.x - 2.0 * m.v, -2.0, 2.0); }
}
rta Keep {
  ac Fast; sc Park; period 40ms;
  safe abs(m.x) < 10.0;
  verify { grid m.x in [-10.0, 10.0] / 50, m.v in [-6.0, 6.0] / 30; }
}
system Hall { g: Cart; module Keep; }
"""
TOLD = ("drives m =", "drives load = 0.5 * payload + 0.2;\n  drives m =")


def cells(*pairs: tuple[str, str]) -> list[int]:
    text = CART
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    checked = check_file("cart.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    return [len(g.axes[0].edges) - 1 for g in problem.groups]


def test_a_state_that_stays_and_that_no_topic_tells_of_is_one_cell() -> None:
    assert cells() == [50, 1]


def test_one_that_a_topic_tells_of_or_that_moves_has_some() -> None:
    assert cells(TOLD) == [50, 100]
    moves = ("  der x", "  der payload = 0.1 * (0.5 - payload);\n  der x")
    assert cells(("drives m =", "drives load = payload;\n  drives m ="), moves) == [50, 100]


def test_the_state_and_its_cells_are_told() -> None:
    checked = check_file("cart.soter", CART)
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    result = verify_module(problem, refute=False, explain=False)
    assert "g.payload stands on no axis: a group of its own, 1 cells over [0, 1]" in "".join(
        result.notes
    )
    assert result.findings["P2a"].holds
