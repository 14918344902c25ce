"""`examples/rest/obstacles.soter`: what its map calls free is free, and a wild AC hits nothing."""

from __future__ import annotations

from math import hypot
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import Program
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from collections.abc import Callable

EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "rest" / "obstacles.soter"
TEXT = EXAMPLE.read_text(encoding="utf-8")
STEERED = """    publish drive = {
      gas: clamp(wanted / ENGINE, 0.0, 1.0),
      brake: clamp(-wanted / BRAKES, 0.0, 1.0),
      steer: clamp(off, -0.45, 0.45)
    };
"""
WILD = """    publish drive = {
      gas: choose { 0.3, 1.0, 1.0 },
      brake: choose { 0.0, 0.0, 0.1 },
      steer: clamp(off + choose { -0.3, 0.0, 0.3 } + 0.0 * wanted, -0.45, 0.45)
    };
"""
MODULE = "  module Park;\n"


def function(name: str) -> Callable[..., Any]:
    checked = check_file(str(EXAMPLE))
    assert checked.program is not None
    made = Evaluator({}).closure_of(checked.program.funs[name])
    return lambda *given: made(Environment(), given)


def test_what_a_map_calls_free_is_free_of_all_pillars() -> None:
    """Wherever it was made, far away from all pillars or among more than it can tell."""
    look, clear, alone = (function(n) for n in ("look", "clear", "alone"))
    draw = Random(3)  # noqa: S311 - drawn examples
    free, full = 0, 0
    for _ in range(300):
        at = draw.uniform(-30.0, 80.0), draw.uniform(-30.0, 60.0)
        seen = look((*at, 0.0, 0.0, 0.0))
        full += seen[2] < 21.9
        for _ in range(20):
            p = (
                at[0] + draw.uniform(-25.0, 25.0),
                at[1] + draw.uniform(-25.0, 25.0),
                0.0,
                0.0,
                0.0,
            )
            if clear(p, seen):
                free += 1
                assert alone(p)
                assert hypot(p[0] - at[0], p[1] - at[1]) < seen[2]
    assert free > 500
    assert full > 20


def wild(folder: Path, text: str) -> Program:
    assert text.count(STEERED) == 1
    at = folder / "wild.soter"
    at.write_text(text.replace(STEERED, WILD), encoding="utf-8")
    return Program(str(at))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_wild_driver_hits_nothing(tmp_path: Path, seed: int) -> None:
    run = wild(tmp_path, TEXT).simulate(until="20s", seed=seed)
    assert run.violations == 0
    assert 0.0 < run.modules["Park"].ac_share < 1.0


def test_a_wild_driver_alone_does(tmp_path: Path) -> None:
    assert TEXT.count(MODULE) == 1
    alone = wild(tmp_path, TEXT.replace(MODULE, "  node Planner;\n"))
    assert alone.simulate(until="60s", seed=1).violations > 0
